"""The documentation site: Markdown pages where they are, and the API from docstrings.

`make docs` builds it, offline; a warning is an error. The source folder is the repository's root,
so that links between pages are the same here as on GitHub.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import softshadow as ss
from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from numpydoc.xref import DEFAULT_LINKS
from softshadow import framing, images
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.domains.python import PythonDomain
from sphinx.environment import BuildEnvironment
from sphinx.transforms import SphinxTransform
from sphinx.util import logging
from sphinx.util.nodes import make_refnode
from sphinx.writers.html5 import HTML5Translator

API = (ss, ss.kernels, ss.metrics, ss.mitsuba, ss.plot, ss.scenes, framing, images)

logger = logging.getLogger(__name__)
REPOSITORY = "https://github.com/softshadow/softshadow"

project = "softshadow"
author = "The softshadow developers"
version = release = ss.__version__

root_doc = "docs/index"
include_patterns = [
    "docs/**",
    "notebooks/*.ipynb",
    "benches/README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
]
# What is not walked through for pages.
exclude_patterns = [
    ".*",
    "demo",
    "dist",
    "docs/templates",
    "python",
    "site",
    "src",
    "target",
    "tests",
]

extensions = ["sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc", "myst_nb"]
nitpicky = True
default_role = "py:obj"
templates_path = [str(Path(__file__).parent / "templates")]

autosummary_ignore_module_all = False  # what is public is what `__all__` has
autosummary_filename_map = {"softshadow.bake": "softshadow.bake-function"}  # beside `Bake`
autodoc_typehints = "none"  # docstrings have them, with shapes
numpydoc_show_class_members = False  # the class template does
numpydoc_xref_param_type = True
numpydoc_xref_aliases = {word: word for word in DEFAULT_LINKS} | {
    name: f"{module.__name__}.{name}"
    for module in API
    for name in module.__all__
    if inspect.isclass(getattr(module, name))
}
numpydoc_xref_ignore = "all"  # types of Python and of other packages stay words

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3  # as GitHub makes them
nb_execution_mode = "off"  # notebooks are committed with their outputs, and the tests run them
nb_ipywidgets_js: dict[str, str] = {}  # nothing from the network

html_math_renderer = "mathml"  # of browsers, where MathJax would be loaded
html_theme = "pydata_sphinx_theme"
html_title = "softshadow"
html_show_sourcelink = False
html_copy_source = False
html_extra_path = ["redirect"]
html_static_path = ["static"]
html_css_files = ["site.css"]
html_sidebars: dict[str, list[str]] = {  # pages with nothing below them
    f"docs/{page}": [] for page in ("concepts", "dense", "hard_cases", "overview", "study")
}
html_theme_options = {
    "github_url": REPOSITORY,
    "header_links_before_dropdown": 9,
    "navigation_with_keys": False,
    "show_prev_next": False,
}


BELOW = {
    "docs/methods/README": ["*"],
    "docs/how_to/README": ["/docs/reports", "/docs/sweeps", "*"],
    "docs/development/README": [
        "/CONTRIBUTING", "/docs/architecture", "/benches/README", "/CHANGELOG", "*",
    ],
}  # fmt: skip
"""What is below pages that are read on GitHub, too, where a list of it would be in the way."""


def links_within(text: str) -> str:
    """Return a page with its links to GitHub, to folders and to the README kept within the site."""
    text = re.sub(rf"{REPOSITORY}/(?:blob|tree)/main/", "/", text)
    text = text.replace("https://raw.githubusercontent.com/softshadow/softshadow/main/", "/")
    text = re.sub(r"\]\((\S*docs/(?:methods|how_to|development))\)", r"](\1/README.md)", text)
    text = text.replace("](/notebooks)", "](/docs/notebooks.md)")
    return re.sub(r"\]\((?:\.\./)+README\.md", "](/docs/overview.md", text)


def read_page(app: Sphinx, docname: str, source: list[str]) -> None:
    """Keep links of a page within the site, and put pages below it."""
    source[0] = links_within(source[0])
    if docname in BELOW:
        pages = "\n".join(BELOW[docname])
        source[0] += f"\n```{{toctree}}\n:hidden:\n:glob:\n\n{pages}\n```\n"


def read_included(app: Sphinx, path: Path, docname: str, source: list[str]) -> None:
    """Keep links of a page's included part within the site."""
    source[0] = links_within(source[0])


def described_names() -> set[str]:
    """Return the names of all parameters and attributes that public docstrings describe."""
    things = [getattr(module, name) for module in API for name in module.__all__]
    things += [
        member for thing in things if inspect.isclass(thing) for member in vars(thing).values()
    ]
    docs = "\n".join(inspect.getdoc(thing) or "" for thing in things)
    lines = re.findall(r"^((?:\w+, )*\w+)(?: :.*)?$", docs, re.M)
    return {name for line in lines for name in line.split(", ")}


DESCRIBED = described_names()


def short_names(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.TextElement
) -> nodes.Node | None:
    """Find what docstrings name in backticks: the package's objects, fields and parameters."""
    if node["reftype"] != "obj":
        return None
    python = env.get_domain("py")
    assert isinstance(python, PythonDomain)
    target = node["reftarget"].removeprefix("softshadow.")
    owner, _, name = target.rpartition(".")
    found = python.objects.get(f"softshadow.{target}")
    if found is None and name in DESCRIBED:
        if not owner:
            return content
        found = python.objects.get(f"softshadow.{owner}")
    if found is None:
        return None
    return make_refnode(app.builder, node["refdoc"], found.docname, found.node_id, content)


class CodeLinks(SphinxTransform):
    """Makes links of pages and public objects that are named as code: `ss.render`, `Wedges`."""

    default_priority = 200  # before references are looked up

    def apply(self) -> None:
        """Wrap literals; an object that does not exist becomes a warning."""
        for literal in list(self.document.findall(nodes.literal)):
            found = self.target(literal.astext())
            if found is None or isinstance(
                literal.parent, (nodes.reference, nodes.title, pending_xref)
            ):
                continue
            domain, kind, target = found
            link = pending_xref(
                "", refdomain=domain, reftype=kind, reftarget=target, refwarn=True,
                refdoc=self.env.docname, refexplicit=True,
            )  # fmt: skip
            literal.replace_self(link)
            link += literal

    def target(self, text: str) -> tuple[str, str, str] | None:
        """Return domain, type and name of what a literal names, None for other code."""
        page, _, suffix = text.rpartition(".")
        if suffix in ("md", "ipynb") and page in self.env.found_docs:
            return "std", "doc", f"/{page}"
        named = re.fullmatch(r"ss\.([\w.]+)(\(.*\))?", text)
        if named:
            return "py", "obj", f"softshadow.{named[1]}"
        return ("py", "obj", f"softshadow.{text}") if inspect.isclass(vars(ss).get(text)) else None


def write_formula(translator: HTML5Translator, node: nodes.math | nodes.math_block) -> None:
    """Write a formula as MathML."""
    block = isinstance(node, nodes.math_block)
    translator.body.append(tex2mathml(node.astext(), as_block=block))
    raise nodes.SkipNode


def check_api(app: Sphinx, env: BuildEnvironment) -> None:
    """Warn of public names that have no entry."""
    python = env.get_domain("py")
    assert isinstance(python, PythonDomain)
    for module in API:
        for name in module.__all__:
            described = not isinstance(getattr(module, name), str)  # the version, the union `Light`
            if described and f"{module.__name__}.{name}" not in python.objects:
                logger.warning("%s.%s is public and not in the API", module.__name__, name)


def setup(app: Sphinx) -> None:
    """Register what this site adds to Sphinx."""
    app.add_html_math_renderer("mathml", (write_formula, None), (write_formula, None))
    app.connect("env-check-consistency", check_api)
    app.connect("missing-reference", short_names)
    app.add_transform(CodeLinks)
    app.connect("source-read", read_page)
    app.connect("include-read", read_included)
