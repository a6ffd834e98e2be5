"""A number for each pair of two columns' values, as a coloured table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from softshadow import fronts
from softshadow.plot.pictures import own_figure
from softshadow.plot.studies import rows_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softshadow.compare import Comparison

__all__ = ["matrix"]


def matrix(
    table: pd.DataFrame | Comparison,
    values: str = "penumbra_mae",
    x: str = "method",
    y: str = "scene",
    limit: float | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Draw a column as a table of two others: methods beside each other, scenes below each other.

    Each cell has the median of its rows, as text and as a colour from white for 0 to black; a cell
    without any number, of what failed or was refused, is hatched.

    Parameters
    ----------
    table : pandas.DataFrame or Comparison
        One row a case.
    values : str
        A column of numbers that are not negative, such as errors.
    x, y : str
        Columns, whose values are drawn in the table's order.
    limit : float, optional
        Where black begins; the largest number when not given.
    ax : matplotlib axes, optional
        Where to draw; a new figure when not given.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If a column is missing, there is no number, or `limit` is not positive.

    Examples
    --------
    >>> import pandas as pd
    >>> import softshadow as ss
    >>> rows = [("board", "hard", 0.2), ("board", "pcf", 0.1), ("fork", "hard", 0.4)]
    >>> table = pd.DataFrame(rows, columns=["scene", "method", "penumbra_mae"])
    >>> [text.get_text() for text in ss.plot.matrix(table).axes[0].texts]
    ['0.2', '0.1', '0.4']
    """
    rows = rows_of(table)
    for name in (x, y):
        fronts.check_column(rows, name)
    numbers = fronts.numbers(rows, values)
    usable = np.isfinite(numbers) & ~fronts.failed(rows)
    if not usable.any():
        raise ValueError(f"table: no row with {values}")
    if limit is None:
        limit = float(numbers[usable].max()) or 1.0
    elif not limit > 0:
        raise ValueError(f"limit: expected a positive number, got {limit}")
    medians = rows.assign(_number=numbers)[usable].groupby([y, x])["_number"].median().unstack()
    down, across = rows[y].unique(), rows[x].unique()
    cells = medians.reindex(index=down, columns=across).to_numpy()

    if ax is None:
        ax = own_figure((2.2 + 0.5 * len(across), 1.4 + 0.27 * len(down))).subplots()
    axes = cast("Any", ax)
    axes.set_facecolor("white")
    axes.patch.set(hatch="////", edgecolor="0.75")
    axes.imshow(
        np.ma.masked_invalid(cells), cmap="Greys", vmin=0, vmax=limit, aspect="auto",
        interpolation="nearest",
    )  # fmt: skip
    for (i, j), value in np.ndenumerate(cells):
        if np.isfinite(value):
            colour = "white" if value > 0.6 * limit else "black"
            axes.text(
                j, i, f"{value:.2g}", ha="center", va="center", color=colour, fontsize="x-small"
            )
    axes.set_xticks(range(len(across)), across, rotation=90, fontsize="small")
    axes.set_yticks(range(len(down)), down, fontsize="small")
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.set_xlabel(values.replace("_", " "))
    return cast("Figure", axes.figure)
