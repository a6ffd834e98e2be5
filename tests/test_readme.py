"""The README's code runs as it stands there, on the bunny that the package's scenes use."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pandas as pd
import pytest
import softshadow as ss
import trimesh
from softshadow.scenes import stanford_bunny_path

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
HOW_TO = sorted((ROOT / "docs" / "how_to").glob("[!R]*.md"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]


def _blocks(language, page=README):
    return re.findall(rf"^```{language}\n(.*?)^```$", page, re.M | re.S)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    if stanford_bunny_path() is None:
        pytest.skip("the bunny's package is not installed")
    return tmp_path_factory.mktemp("readme")


@pytest.fixture(scope="module")
def shell(folder):
    """What the shell's lines write; `make` is what runs this."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    lines = [line for block in _blocks("sh") for line in block.splitlines()]
    lines = [line for line in lines if not line.startswith("make ")]
    assert len(lines) == 4
    out = []
    for line in lines:
        done = subprocess.run(
            line, shell=True, cwd=folder, env={**os.environ, "PATH": path},
            capture_output=True, text=True, timeout=300,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        out.append(done.stdout)
    return out


def _has_light_and_shadow(visibility):
    assert (visibility < 0.02).mean() > 0.01  # umbra
    assert (visibility > 0.98).mean() > 0.3  # lit
    assert ((visibility > 0.05) & (visibility < 0.95)).mean() > 0.005  # and what is between


def test_the_command_line(shell, folder):
    picture = imageio.imread(folder / "bunny.png") / 255
    _has_light_and_shadow(picture)
    assert all(name in shell[2] for name in ss.method_names())
    assert "* on the front" in shell[3]
    assert (folder / "comparison" / "report.html").is_file()


def test_the_python(shell, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    (folder / "bunny.png").unlink()
    blocks = _blocks("python")
    assert len(blocks) == 2
    names: dict[str, object] = {}
    exec(compile(blocks[0], "README.md", "exec"), names)
    image = names["image"]
    assert isinstance(image, ss.Image)
    bunny, ground = (image.mesh_id == i for i in (0, 1))
    assert bunny.mean() > 0.05
    assert ground.mean() > 0.3
    _has_light_and_shadow(image.visibility)
    # The bunny's shadow lies on the ground, in the picture.
    assert (image.visibility[ground] < 0.02).mean() > 0.01
    assert np.percentile(image.radiance[image.mask], 90) > 0.1
    assert float(capsys.readouterr().out.split()[0]) == pytest.approx(image.visibility.mean())
    assert imageio.imread(folder / "bunny.png").max() > 200
    exec(compile(blocks[1], "README.md", "exec"), names)
    table = names["table"]
    assert isinstance(table, pd.DataFrame)
    assert len(pd.read_parquet(folder / "results.parquet")) == len(table) == 6
    errors = table.set_index(["light", "label"])["rmse"]
    for light in ("radius 4", "radius 14"):
        assert errors[light, "wedges"] < errors[light, "hard"]


@pytest.mark.parametrize("path", HOW_TO, ids=lambda path: path.stem)
def test_the_code_of_how_to_pages(path, tmp_path, monkeypatch, capsys):
    if path.stem in ("files", "mitsuba"):
        pytest.importorskip("mitsuba", reason="the optional extra")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in _blocks("python", path.read_text()):
        exec(compile(block, path.name, "exec"), names)
    assert capsys.readouterr().out
    if path.stem == "bake":
        floor = trimesh.load(tmp_path / "room.glb").geometry["floor"]
        picture = np.asarray(floor.visual.material.emissiveTexture)
        assert picture[128, 128].max() == 0  # under the box
        assert picture[-1, -1].min() > 50


def test_every_method_has_a_page_and_a_row():
    for name in ss.method_names():
        page = (ROOT / "docs" / "methods" / f"{name}.md").read_text()
        assert f"`{name}`" in page.splitlines()[0]
        method = ss.prepare(ss.scenes.half_plane(8, 8).scene, ss.SphereLight((0, 0, 2), 0.1), name)
        for parameter in method.method.parameters():
            assert f"`{parameter}`" in page, (name, parameter)
        assert re.search(rf"^\| `{name}` \| `{type(method.method).__name__}` ", README, re.M)
        assert "``docs/methods/" in type(method.method).__doc__


def test_links_lead_somewhere():
    pages = [*PAGES, ROOT / "CHANGELOG.md", ROOT / "benches" / "README.md"]
    for page in pages:
        for link in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page.read_text()):
            assert (page.parent / link).exists(), (page, link)


@pytest.mark.parametrize("name", ss.method_names())
def test_every_method_s_page_has_the_same_headings(name):
    page = (ROOT / "docs" / "methods" / f"{name}.md").read_text()
    assert re.findall(r"^## (.*)$", page, re.M) == [
        "What it computes",
        "When to choose it",
        "Parameters",
        "Errors",
        "Cost",
        "Where it is wrong",
        "Hard cases",
    ]


def test_pages_name_files_that_exist():
    folders = "src|python|tests|benches|docs|examples|notebooks"
    for page in PAGES:
        for path in re.findall(rf"`((?:{folders})/[\w./-]+)`", page.read_text()):
            if re.search(r"/new\b", path):
                continue  # where a new method or light goes
            assert (ROOT / path).exists(), (page.name, path)
