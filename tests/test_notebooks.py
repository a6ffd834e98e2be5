"""The notebooks run from top to bottom in their short form, and are stored with their outputs."""

from __future__ import annotations

import pytest

pytest.importorskip("nbclient")
import run_notebooks as runs

each = pytest.mark.parametrize("path", runs.PATHS, ids=lambda p: p.stem)
STALE = "the outputs are of other sources: make notebooks"


def pictures(cell):
    return [o for o in cell.outputs if "image/png" in o.get("data", {})]


def test_there_are_notebooks_to_run():
    assert runs.PATHS


@each
def test_stored_outputs_are_those_of_the_sources(path):
    notebook = runs.read(path)
    assert notebook.metadata.get(runs.SOURCES) == runs.sources(notebook), STALE
    cells = runs.code_cells(notebook)
    # A fresh kernel has run every cell once, from top to bottom.
    assert [c.execution_count for c in cells] == list(range(1, len(cells) + 1))
    for cell in cells:
        assert all(o.output_type != "error" for o in cell.outputs), cell.source
        if "ss.plot." in cell.source:
            assert len(pictures(cell)) == 1, cell.source


@each
def test_stored_notebook_is_small_and_names_no_machine(path):
    assert path.stat().st_size < 1_000_000  # what web pages of repositories still show
    notebook = runs.read(path)
    assert set(notebook.metadata) == {"kernelspec", "language_info", runs.SOURCES}
    for cell in notebook.cells:
        assert "execution" not in cell.metadata  # when it ran
        outputs = cell.get("outputs", [])
        assert all(o.get("name") != "stderr" for o in outputs), "a warning is stored"
        texts = [o.get("text", "") + str(o.get("data", {}).get("text/plain", "")) for o in outputs]
        for private in (str(runs.FOLDER.parent), "/home/", "/root/", "/tmp/"):
            assert private not in "".join([cell.source, *texts])


@each
def test_short_form_runs_and_shows_its_pictures(path):
    notebook = runs.read(path)
    runs.shorten(notebook)
    runs.execute(notebook)
    for cell in runs.code_cells(notebook):
        if "ss.plot." in cell.source:
            assert len(pictures(cell)) == 1, cell.source
