"""What ``softshadow compare`` prints and writes of its comparisons; the demo does the same."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from softshadow import fronts, images
from softshadow.compare import Comparison

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["notes", "shown", "table_text", "write_pictures"]

_SHOWN = {
    "prepare_seconds": "prepare s",
    "frame_seconds": "frame s",
    "MB": "MB",
    "mae": "mae",
    "rmse": "rmse",
    "penumbra_mae": "penumbra mae",
    "penumbra_rmse": "penumbra rmse",
    "ssim": "ssim",
    "flip": "flip",
    "repeats": "repeats",
}
"""Columns of the printed table, and their headings."""


def table_text(result: Comparison) -> str:
    """Return a comparison's table as text, the front marked with a star.

    What was left out follows, a line each, with the reason.

    Parameters
    ----------
    result : Comparison

    Returns
    -------
    str
        Without a newline at the end.
    """
    table = shown(result)
    rows = [list(table.columns), *table.itertuples(index=False)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "  ".join(
            cell.ljust(n) if i < 2 else cell.rjust(n)
            for i, (cell, n) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
    return "\n".join([*lines, *notes(result)])


def shown(result: Comparison) -> pd.DataFrame:
    """Return a comparison's table as it is printed: texts, a star in the first column of the front.

    Parameters
    ----------
    result : Comparison

    Returns
    -------
    pandas.DataFrame
        Its columns are the headings.
    """
    table = result.table.assign(MB=result.table["bytes"] / 1e6)
    cells: pd.DataFrame = table[list(_SHOWN)].rename(columns=_SHOWN).map("{:.4g}".format)
    cells.insert(0, "", ["*" if star else "" for star in fronts.front(table)])
    cells.insert(1, "method", fronts.labels(table))
    return cells


def notes(result: Comparison) -> list[str]:
    """Return what has to be said below the table: what the star is, and what was left out.

    Parameters
    ----------
    result : Comparison
    """
    star = "* on the front: none is as fast a frame and as right in the penumbra"
    return [star, *(f"left out: {label}: {reason}" for label, reason in result.skipped.items())]


def write_pictures(result: Comparison, folder: Path, name: str) -> list[Path]:
    """Write a comparison's pictures and its table into a folder.

    Parameters
    ----------
    result : Comparison
    folder : path
        Must be there.
    name : str
        What the files' names begin with.

    Returns
    -------
    list of Path
        ``<name>.png``, the reference's radiance; ``<name>_strip.png``, all methods' visibilities
        with their signed errors; ``<name>_front.png``, error against time; ``<name>_profile.png``,
        the visibilities along a row of pixels; and ``<name>.csv``.
    """
    from softshadow import plot

    paths = {kind: folder / f"{name}{kind}" for kind in _KINDS}
    images.write(paths[".png"], result.reference.radiance)
    plot.strip(result).savefig(paths["_strip.png"], dpi=110)
    plot.scanline(result).savefig(paths["_profile.png"], dpi=110)
    result.table.to_csv(paths[".csv"], index=False)
    if _has_a_point(result):
        plot.pareto(result).savefig(paths["_front.png"], dpi=130)
    else:
        del paths["_front.png"]
    return list(paths.values())


_KINDS = (".png", "_strip.png", "_front.png", "_profile.png", ".csv")


def _has_a_point(result: Comparison) -> bool:
    """Return whether error against time can be drawn: not where there is no penumbra."""
    return bool((result.table["penumbra_mae"] > 0).any())


def distinct_names(models: list[Path]) -> Mapping[Path, str]:
    """Return a name for each model: the file's without its suffix, numbered where there are two.

    Parameters
    ----------
    models : list of Path
    """
    names: dict[Path, str] = {}
    for model in models:
        name, count = model.stem, 2
        while name in names.values():
            name, count = f"{model.stem}_{count}", count + 1
        names[model] = name
    return names
