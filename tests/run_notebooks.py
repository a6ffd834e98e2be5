"""Run the notebooks: whole and in place for readers, or in a short form for tests.

``python tests/run_notebooks.py`` (``make notebooks``) runs every notebook, or those that are named,
and stores it with its outputs.

A notebook's settings, such as the size of its pictures, are in one code cell with the tag
``parameters``: plain assignments. The cell's metadata has under ``short`` what the tests take
instead, ``{"size": 64}``. Its assertions hold in both forms.
"""

from __future__ import annotations

import ast
import hashlib
import sys
from pathlib import Path
from typing import Any

import nbclient
import nbformat

FOLDER = Path(__file__).parent.parent / "notebooks"
PATHS = sorted(FOLDER.glob("*.ipynb"))
SOURCES = "softshadow_sources"
"""Where a notebook's metadata has the digest of the sources that its outputs are of."""


def read(path: Path) -> Any:
    return nbformat.read(path, as_version=4)


def code_cells(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def sources(notebook: Any) -> str:
    """Return a digest of what a notebook's code cells say."""
    whole = "\0".join(cell.source for cell in code_cells(notebook))
    return hashlib.sha256(whole.encode()).hexdigest()[:16]


def shorten(notebook: Any) -> None:
    """Give a notebook the short form's settings.

    Raises
    ------
    ValueError
        If there is more than one cell of settings, or it does not assign what the short form sets.
    """
    cells = [c for c in code_cells(notebook) if "parameters" in c.metadata.get("tags", [])]
    if len(cells) > 1:
        raise ValueError(f"expected one cell with the tag parameters, got {len(cells)}")
    for cell in cells:
        short = cell.metadata.get("short", {})
        statements = ast.parse(cell.source).body
        assigned = {ast.unparse(s.targets[0]) for s in statements if isinstance(s, ast.Assign)}
        if not short or set(short) - assigned:
            raise ValueError(f"short: expected some of {sorted(assigned)}, got {sorted(short)}")
        cell.source += "\n" + "\n".join(f"{name} = {value!r}" for name, value in short.items())


def execute(notebook: Any) -> None:
    """Run a notebook; what fails raises nbclient's error with the cell and its traceback."""
    nbclient.NotebookClient(
        notebook,
        timeout=300,
        kernel_name="python3",
        record_timing=False,
        resources={"metadata": {"path": FOLDER}},
    ).execute()


def store(path: Path) -> None:
    """Run a notebook and write it with its outputs, but nothing of the machine."""
    notebook = read(path)
    execute(notebook)
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
        SOURCES: sources(notebook),
    }
    nbformat.write(notebook, path)


if __name__ == "__main__":
    for name in sys.argv[1:] or PATHS:
        print(f"run {name}", flush=True)
        store(Path(name))
