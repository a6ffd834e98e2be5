"""Every public name says what it takes and returns, and the examples do what they say."""

from __future__ import annotations

import dataclasses
import doctest
import importlib
import inspect
import pkgutil
import re
import types

import pytest
import softshadow as ss
from softshadow import framing

MODULES = (ss, ss.kernels, ss.metrics, ss.mitsuba, ss.plot, ss.scenes, ss.images, framing)

MADE_BY_FUNCTIONS = {ss.Bake, ss.Prepared}
"""What users do not make themselves."""

FEWEST_EXAMPLES = 40


def _surface():
    """Public functions, classes, and their public methods and properties."""
    found = {}
    for module in MODULES:
        for name in module.__all__:
            thing = getattr(module, name)
            if isinstance(thing, (types.ModuleType, str, float)):
                continue
            if not callable(thing):  # a union of types
                continue
            found[f"{module.__name__}.{name}"] = thing
            for key, value in vars(thing).items() if inspect.isclass(thing) else ():
                function = getattr(value, "__func__", value)
                public = inspect.isfunction(function) or isinstance(function, property)
                if public and not key.startswith("_"):
                    found[f"{module.__name__}.{name}.{key}"] = function
    return found


SURFACE = _surface()


def _named(doc, *sections):
    """The names that sections of a docstring begin their lines with."""
    names = []
    for section in sections:
        found = re.search(rf"^{section}\n-+\n(.*?)(?=^\w+\n-+\n|\Z)", doc, re.M | re.S)
        for line in found[1].splitlines() if found else ():
            if line and not line.startswith(" "):
                names += [name.strip().lstrip("*") for name in line.partition(":")[0].split(",")]
    return names


def _has(doc, section):
    return re.search(rf"^{section}\n-+\n", doc, re.M) is not None


def test_the_surface_is_looked_at():
    names = {"softshadow.render", "softshadow.Scene.add", "softshadow.kernels.wedges"}
    assert names <= set(SURFACE)
    assert len(SURFACE) > 150


@pytest.mark.parametrize("name", SURFACE)
def test_docstrings_have_all_parameters_and_what_is_returned_and_raised(name):
    thing = SURFACE[name]
    doc = inspect.getdoc(thing)
    assert doc
    assert doc.splitlines()[0].endswith((".", ").", ":"))
    if isinstance(thing, property) or thing in MADE_BY_FUNCTIONS:
        return
    if inspect.isclass(thing):
        if issubclass(thing, Exception):
            return
        if dataclasses.is_dataclass(thing):
            wanted = [f.name for f in dataclasses.fields(thing) if not f.name.startswith("_")]
        else:
            own = "__init__" in vars(thing)
            wanted = list(inspect.signature(thing).parameters) if own else []
        assert set(wanted) <= set(_named(doc, "Parameters", "Attributes"))
        return
    signature = inspect.signature(thing)
    wanted = [parameter for parameter in signature.parameters if parameter not in ("self", "cls")]
    assert _named(doc, "Parameters") == wanted
    if signature.return_annotation not in (None, "None"):
        assert _has(doc, "Returns")
    if re.search(r"^ +raise ", inspect.getsource(thing), re.M):
        assert _has(doc, "Raises")


def _examples():
    finder = doctest.DocTestFinder(exclude_empty=True)
    found = {}
    for info in pkgutil.walk_packages(ss.__path__, "softshadow."):
        if info.name.rpartition(".")[2] in ("_core", "__main__"):
            continue
        module = importlib.import_module(info.name)
        for test in finder.find(module, info.name, globs={}):
            if test.examples:
                found[test.name] = test
    for test in finder.find(ss, "softshadow", globs={}):
        if test.examples and test.name == "softshadow":
            found[test.name] = test
    return found


EXAMPLES = _examples()


def test_there_are_examples():
    assert len(EXAMPLES) >= FEWEST_EXAMPLES
    assert "softshadow" in EXAMPLES


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_do_what_they_say(name):
    said = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    failed, tried = runner.run(EXAMPLES[name], out=said.append)
    assert tried
    assert not failed, "".join(said)
