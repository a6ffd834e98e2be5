"""`report`: a table of measured cases, and their pictures, as one page that needs no network."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy.typing as npt

from softshadow import fronts
from softshadow.compare import Comparison
from softshadow.extras import require
from softshadow.render import Image

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Pictures", "report"]

Pictures: TypeAlias = "Comparison | Mapping[str, Image | npt.ArrayLike]"
"""What `softshadow.plot.strip` draws: images by label, one of them the ``"reference"``."""


def report(
    table: pd.DataFrame | Comparison | Mapping[str, Comparison],
    path: str | os.PathLike[str],
    images: Pictures | Mapping[str, Pictures] | None = None,
    title: str = "Speed against error",
    commands: Sequence[str] = (),
    notes: Mapping[str, str] | None = None,
) -> Path:
    """Write a page that says which method is how fast and how wrong.

    It has the front of every setting, a table that sorts by any column, the images with their
    signed errors and a profile along a row of pixels, what failed or was left out, the machine, and
    the commands to reproduce it. It is one file without links to others: send it to a colleague.

    Parameters
    ----------
    table : pandas.DataFrame or Comparison, or mapping of str to Comparison
        One row a case: what `softshadow.compare` returns, several of them by the scene's name, or
        any table with the columns ``method``, ``frame_seconds`` and ``penumbra_mae`` and whatever
        else there is. Columns ``scene``, ``light``, ``camera``, ``machine`` and ``threads`` tell
        settings apart, a text in ``error`` is a failure.
    path : path
        The file to write, ``.html``.
    images : optional
        As of `softshadow.plot.strip`, or several of them by the name of the scene. When not given,
        those of a `Comparison`, or the ``.npz`` files that a column ``image`` names.
    title : str
        Of the page.
    commands : sequence of str
        What makes the same table again, a line each.
    notes : mapping of str to str, optional
        What is said of a scene over its pictures, by its name.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ValueError
        If the table has no row, or not the columns, or the path does not end in ``.html``.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> result = ss.compare(setup.scene, setup.camera, setup.light, ["hard", "pcf"], repeats=1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     page = ss.report(result, Path(folder) / "report.html")
    ...     "<table" in page.read_text()
    True
    """
    file = Path(path)
    if file.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"{file}: expected a name that ends in .html")
    if not file.parent.is_dir():
        raise FileNotFoundError(f"{file}: there is no folder {file.parent}")
    require("plot", "report", "matplotlib")
    require("metrics", "report", "pandas")
    from softshadow.machine import machine_facts
    from softshadow.report import sections
    from softshadow.report.html import definitions, page
    from softshadow.report.tables import one_table, pictures_of

    comparisons: dict[str, Comparison] = {}
    if isinstance(table, Comparison):
        comparisons, rows = {"": table}, table.table
    elif isinstance(table, Mapping):
        comparisons = dict(table)
        if not comparisons:
            raise ValueError("table: expected at least one comparison")
        rows = one_table(comparisons) if len(comparisons) > 1 else next(iter(table.values())).table
    else:
        rows = table
    if not hasattr(rows, "columns"):
        got = type(table).__name__
        raise TypeError(f"table: expected a pandas table or a Comparison, got {got}")
    if not len(rows):
        raise ValueError("table: expected at least one row")
    for column in ("method", "frame_seconds", "penumbra_mae"):
        fronts.check_column(rows, column)
    if images is None:
        images = dict(comparisons) if comparisons else pictures_of(rows) or None
    skipped = {
        f"{name}: {label}" if len(comparisons) > 1 else label: reason
        for name, result in comparisons.items()
        for label, reason in result.skipped.items()
    }
    facts = sections.table_facts(rows)
    if comparisons:
        facts = {**machine_facts(), **sections.reference_facts(comparisons), **facts}
    lines = "\n".join(escape(line) for line in commands)
    text = page(
        title,
        sections.summary(rows, skipped),
        {
            "The front": sections.front_figures(rows),
            "All cases": sections.cases(rows),
            "Pictures and errors": sections.pictures(images, notes or {}),
            "Failed or left out": sections.failures(rows, skipped),
            "Machine": definitions(facts) if facts else "",
            "How to reproduce": f"<pre>{lines}</pre>\n" if lines else "",
        },
    )
    file.write_text(text, encoding="utf-8")
    return file
