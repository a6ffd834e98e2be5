"""What importing costs, what works with the core's dependencies alone, and what to install else."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
import softshadow as ss

ROOT = Path(__file__).parents[1]

OPTIONAL = [
    *("IPython", "OpenEXR", "PIL", "drjit", "flip_evaluator", "imageio", "ipywidgets"),
    *("matplotlib", "mitsuba", "networkx", "pandas", "rich", "scipy", "skimage", "typer"),
    *("anywidget", "dask", "distributed", "pyarrow"),
]
"""Modules of the extras, and what comes with them."""

UNUSED = (*OPTIONAL, "trimesh", "tqdm", "numpy.ma", "asyncio", "multiprocessing")
"""Modules that neither importing nor rendering needs."""

BLOCKED = f"""
import sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {OPTIONAL}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Refuse())
"""

SMALL = """
import numpy as np
import softshadow as ss

def square(half, z):
    h = half
    return [(-h, -h, z), (h, -h, z), (h, h, z), (-h, h, z)], [(0, 1, 2), (0, 2, 3)]

scene = ss.Scene()
scene.add(square(3, 0), "ground")
scene.add(square(0.5, 1), "board")
light = ss.RectLight((0, 0, 4), (0, 0.5, 0), (0.5, 0, 0))
camera = ss.Camera((0, -4, 3), (0, 0, 0.3), width=32, height=24)
"""


def _fresh(*code, folder=None):
    """What a new interpreter prints, as JSON."""
    program = "\n".join(map(textwrap.dedent, code))
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_importing_and_rendering_load_nothing_that_they_do_not_need():
    loaded = "import json; print(json.dumps(sorted(sys.modules)))"
    for use in ("import sys, softshadow", f"import sys{SMALL}ss.render(scene, camera, light)"):
        modules = set(_fresh(use, loaded))
        assert not modules & set(UNUSED), modules & set(UNUSED)
        assert "softshadow" in modules


def test_importing_takes_little_longer_than_numpy():
    """Processor time, which other processes do not add to; the best of some."""
    code = """
        import json, time
        import numpy
        start = time.process_time()
        import softshadow
        print(json.dumps(time.process_time() - start))
    """
    _fresh(code)  # writes what is compiled
    assert min(_fresh(code) for _ in range(5)) < 0.3


def test_parts_that_are_imported_when_used_are_there():
    code = """
        import json
        import softshadow as ss
        listed = set(dir(ss))
        star = {}
        exec("from softshadow import *", star)
        print(json.dumps([sorted(set(ss.__all__) - listed), sorted(set(ss.__all__) - set(star))]))
    """
    assert _fresh(code) == [[], []]
    for name in ("mitsuba", "plot", "scenes"):
        assert getattr(ss, name) is sys.modules[f"softshadow.{name}"]
    with pytest.raises(AttributeError, match="no attribute 'scene_s'"):
        ss.scene_s  # noqa: B018


def test_functions_stay_functions_whatever_is_imported():
    """Some functions are named as the modules that they are from."""
    for first in (
        *("softshadow.bake.textures", "softshadow.compare", "softshadow.render"),
        *("softshadow.sweep.work", "softshadow.widget.moving"),
    ):
        code = f"""
            import json
            import {first}
            import softshadow as ss
            import softshadow.bake, softshadow.kernels.wedges, softshadow.render, softshadow.sweep
            same = [ss.bake, ss.compare, ss.render, ss.kernels.wedges, ss.sweep, ss.widget]
            print(json.dumps([callable(x) for x in same]))
        """
        assert _fresh(code) == [True] * 6


def test_the_core_works_with_its_own_dependencies_alone(tmp_path):
    """All methods, points, kernels, planar textures, model files, scenes, and arrays as files."""
    code = """
        import json
        import trimesh
        images = {}
        for name in ss.method_names():
            images[name] = ss.render(scene, camera, light, name, progress=True)
            assert images[name].visibility.min() < 0.5, name
        points, normals = np.tile([[0.0, 0, 0]], (4, 1)), np.tile([[0.0, 0, 1]], (4, 1))
        assert (ss.visibility(scene, points, normals, light) < 0.5).all()
        ball = trimesh.creation.icosphere(2)
        for kind in ("ply", "stl", "obj", "glb", "off"):
            ball.export(f"ball.{kind}")
            other = ss.Scene.load(f"ball.{kind}")
            assert other.triangle_count == 320
            other.add(ball)
            assert ss.render(other, camera, light, "hard").mask.any()
        baked = ss.bake(scene, light, "ground", max_size=16)
        baked.save(".", ".npy")
        reference = images["ray_traced"].visibility
        ss.metrics.rmse(images["hard"].visibility, reference)
        for make in (ss.scenes.half_plane, ss.scenes.closed_solids, ss.scenes.stacked_boards):
            ss.render(make(16, 16).scene, camera, light, "hard")
        print(json.dumps(len(images)))
    """
    assert _fresh(BLOCKED, SMALL, code, folder=tmp_path) == len(ss.method_names())


def test_scenes_and_images_show_themselves_without_the_plots():
    code = """
        import json
        image = ss.render(scene, camera, light, "hard")
        print(json.dumps([scene._repr_html_(), image._repr_png_(), repr(image)]))
    """
    html, png, text = _fresh(BLOCKED, SMALL, code)
    assert "<td>ground</td>" in html
    assert "<img" not in html
    assert png is None
    assert text.startswith("Image(32x24, 1 light, ")


CORNERS = "{'board': [(0, 0), (0.5, 0), (0.5, 1), (0, 1)]}"
USES = [
    ("plot", "ss.plot.show(image)"),
    ("plot", "ss.plot.strip({'a': image})"),
    ("plot", "ss.report({}, 'a.html')"),
    ("metrics", "ss.compare(scene, camera, light, ['hard'])"),
    ("metrics", "ss.metrics.errors(image.visibility, image.visibility)"),
    ("metrics", "ss.metrics.ssim(image.visibility, image.visibility)"),
    ("metrics", "ss.metrics.confusion(image.visibility, image.visibility)"),
    ("io", "ss.images.write('a.png', image.visibility)"),
    ("io", "ss.images.write('a.exr', image.visibility)"),
    ("io", "ss.Scene.load(zipped('a.3mf'))"),
    ("io", "ss.bake(scene, light, 'ground', max_size=16).to_glb('a.glb')"),
    ("cli", "import softshadow.cli"),
    ("sweep", "ss.sweep(ss.grid(scene, light, camera, 'hard'), 'results.parquet')"),
    ("cluster", "from softshadow.sweep import pools; pools.cluster('tcp://a:1').__enter__()"),
    ("bake", f"ss.bake(scene, light, 'board', 'hard', uv={CORNERS})"),
    ("scenes", "ss.scenes.landscape(16, 16)"),
    ("scenes", "ss.scenes.fork(16, 16)"),
    ("scenes", "ss.scenes.statue(16, 16)"),
    ("mitsuba", "ss.mitsuba.render(scene, camera, light)"),
    ("widget", "ss.widget(scene, camera, light)"),
]


def test_what_is_missing_says_what_to_install(tmp_path):
    code = f"""
import json, zipfile
import trimesh

def zipped(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/3dmodel.model", "<model/>")
    return path

image = ss.render(scene, camera, light, "hard")
said = []
for extra, use in {USES!r}:
    try:
        exec(use)
        said.append("nothing")
    except ModuleNotFoundError as error:
        said.append(str(error))
print(json.dumps(said))
"""
    said = _fresh(BLOCKED, SMALL, code, folder=tmp_path)
    for (extra, use), message in zip(USES, said, strict=True):
        end = re.escape(f'which is not installed: pip install "softshadow[{extra}]"')
        assert re.fullmatch(rf".+ needs \w+, {end}", message), (use, message)


def test_the_command_says_what_to_install():
    code = """
        import json
        from softshadow.__main__ import main
        print(json.dumps(main()))
    """
    program = BLOCKED + textwrap.dedent(code)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert json.loads(done.stdout) == 2
    line = "error: the command softshadow needs typer, which is not installed: pip install "
    assert done.stderr == f'{line}"softshadow[cli]"\n'


def _extras():
    text = (ROOT / "pyproject.toml").read_text()
    section = text.split("[project.optional-dependencies]\n")[1].split("\n[")[0]
    return {
        name: re.findall(r'"([\w-]+)', packages)
        for name, packages in re.findall(r"^(\w+) = \[(.*)\]$", section, re.M)
    }


def test_every_extra_that_is_named_exists_and_is_installed_for_tests():
    extras = _extras()
    every = set(extras) - {"all"}
    source = "\n".join(p.read_text() for p in (ROOT / "python").rglob("*.py"))
    assert set(re.findall(r'needs\("(\w+)", ', source)) == every
    text = (ROOT / "pyproject.toml").read_text()
    assert set(re.search(r'^all = \["softshadow\[(.*)\]"\]$', text, re.M)[1].split(",")) == every
    makefile = (ROOT / "Makefile").read_text()
    assert set(re.search(r"^EXTRAS := (.*)$", makefile, re.M)[1].split(",")) == every


def test_links_of_the_readme_work_from_the_package_index():
    """They are absolute, and those into the project lead to files that are there."""
    readme = (ROOT / "README.md").read_text()
    project = re.search(r'^Homepage = "(.*)"$', (ROOT / "pyproject.toml").read_text(), re.M)[1]
    raw = project.replace("https://github.com/", "https://raw.githubusercontent.com/")
    links = re.findall(r"\]\(([^)\s]+)\)", readme)
    assert links
    for link in links:
        assert re.match(r"https://|#", link), link
        for start in (f"{project}/blob/main/", f"{project}/tree/main/", f"{raw}/main/"):
            if link.startswith(start):
                path = ROOT / link.removeprefix(start).partition("#")[0]
                assert path.is_dir() if "/tree/" in start else path.is_file(), link
