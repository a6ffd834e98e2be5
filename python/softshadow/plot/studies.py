"""Figures of a table of measured cases: error against time, and any column against any other."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from softshadow import fronts
from softshadow.compare import Comparison
from softshadow.extras import needs
from softshadow.methods import method_names
from softshadow.plot.pictures import own_figure
from softshadow.plot.styles import MITSUBA, line_styles, style

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["pareto", "versus"]

_NAMES = {
    "frame_seconds": "seconds a frame",
    "prepare_seconds": "seconds to prepare",
    "total_seconds": "seconds to prepare and render one frame",
    "penumbra_mae": "mean absolute error in the penumbra",
    "penumbra_rmse": "root mean square error in the penumbra",
    "mae": "mean absolute error",
    "rmse": "root mean square error",
    "bytes": "bytes kept",
}

_LONGEST = 30
"""Characters of a name in a figure."""

_COLUMNS = 3
"""Panels beside each other."""


def pareto(
    table: pd.DataFrame | Comparison,
    x: str = "frame_seconds",
    y: str = "penumbra_mae",
    ax: Axes | None = None,
) -> Figure:
    """Draw error against time, both logarithmic, with the front marked and labelled.

    The front (`softshadow.front`) is what no other row beats in both: a grey step line, and marks
    with an edge and a name. Rows of one method at several settings are joined by a line; Mitsuba's
    (methods whose names begin with ``mitsuba``) are black, with their sample counts. A table of
    several settings (scenes, lights, cameras, machines) has a panel for each.

    Parameters
    ----------
    table : pandas.DataFrame or Comparison
        One row a case, with the column ``method`` and the two to draw. Rows that failed, or have no
        positive number, are left out.
    x, y : str
        Columns, as in `softshadow.front`.
    ax : matplotlib axes, optional
        Where to draw a table of one setting; a new figure when not given.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If a column is missing, nothing can be drawn, or `ax` is given and there are several
        settings.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> methods = ["hard", ss.RayTraced(samples=4), ss.RayTraced(samples=64)]
    >>> result = ss.compare(setup.scene, setup.camera, setup.light, methods, repeats=1)
    >>> ss.plot.pareto(result).axes[0].get_xscale()
    'log'
    """
    rows = rows_of(table)
    on = fronts.front(rows, x, y)
    times, errors = fronts.badness(rows, x), fronts.badness(rows, y)
    drawn = np.isfinite(times) & np.isfinite(errors) & (times > 0) & (errors > 0)
    drawn &= ~fronts.failed(rows)
    panels = {
        name: chosen[drawn[chosen]]
        for name, chosen in fronts.settings(rows).items()
        if drawn[chosen].any()
    }
    if not panels:
        raise ValueError(f"table: no row with a positive {x} and {y}")
    axes, figure = _panels(len(panels), ax)
    names = rows["method"].astype(str).tolist()
    labels = fronts.labels(rows)
    counts = _counts(rows, labels)
    for panel, (title, chosen) in zip(axes, panels.items(), strict=True):
        panel.set_xscale("log")
        panel.set_yscale("log")
        _decades(panel.xaxis, panel.yaxis)
        panel.grid(True, which="major", color="0.92")
        panel.set_axisbelow(True)
        _front_line(panel, times, errors, chosen[on[chosen]])
        for method in dict.fromkeys(names[i] for i in chosen):
            mine = np.array([i for i in chosen if names[i] == method])
            _points(panel, method, _strangers(names), times, errors, mine, on)
            if method.startswith(MITSUBA):
                _sample_counts(panel, counts, times, errors, mine)
        panel.margins(0.12)
        panel.set_xlabel(_NAMES.get(x, x))
        panel.set_ylabel(_title_of_error(y))
        panel.set_title(title, fontsize="medium")
    _legend(figure, axes)
    figure.draw_without_rendering()  # so that axes are where they will be, and names stay inside
    for panel, chosen in zip(axes, panels.values(), strict=True):
        best = [i for i in chosen[on[chosen]] if not names[i].startswith(MITSUBA)]
        _name(panel, [labels[i] for i in best], times[best], errors[best])
    return figure


def versus(
    table: pd.DataFrame | Comparison,
    x: str,
    y: str = "penumbra_mae",
    by: str = "method",
    ax: Axes | None = None,
) -> Figure:
    """Draw one column against another, a line for each method through the medians.

    Small marks are the rows, large ones the median of the rows with the same `x`. An axis of
    positive numbers that span more than a factor of 20 is logarithmic.

    Parameters
    ----------
    table : pandas.DataFrame or Comparison
        One row a case.
    x : str
        A column such as ``"samples"`` or a size of the light; texts are drawn in the table's order.
    y : str
        A column of numbers.
    by : str
        The column that tells the lines apart.
    ax : matplotlib axes, optional
        Where to draw; a new figure when not given.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If a column is missing, or no row has both.

    Examples
    --------
    >>> import pandas as pd
    >>> import softshadow as ss
    >>> table = pd.DataFrame({"method": "pcf", "light radius": [1, 2], "penumbra_mae": [0.1, 0.2]})
    >>> ss.plot.versus(table, "light radius").axes[0].get_xlabel()
    'light radius'
    """
    rows = rows_of(table)
    for name in (by, x) if x != "total_seconds" else (by,):
        fronts.check_column(rows, name)
    heights = fronts.numbers(rows, y)
    places, ticks = _places(rows, x)
    usable = np.isfinite(heights) & np.isfinite(places) & ~fronts.failed(rows)
    if not usable.any():
        raise ValueError(f"table: no row with {x} and {y}")
    axes, figure = _panels(1, ax)
    panel = axes[0]
    names = rows[by].astype(str).tolist()
    styles = line_styles(names)
    for name in dict.fromkeys(n for n, use in zip(names, usable, strict=True) if use):
        mine = np.array([i for i, n in enumerate(names) if n == name and usable[i]])
        colour, marker, dashes = styles[name]
        at = np.unique(places[mine])
        middle = [float(np.median(heights[mine][places[mine] == place])) for place in at]
        if len(mine) > len(at):
            panel.plot(places[mine], heights[mine], ".", color=colour, alpha=0.35, markersize=4)
        panel.plot(
            at, middle, dashes, color=colour, marker=marker, label=name, linewidth=1.2,
        )  # fmt: skip
    if ticks is not None:
        panel.set_xticks(range(len(ticks)), ticks, rotation=30 if len(ticks) > 4 else 0)
    elif _wide(places[usable]):
        panel.set_xscale("log")
        _decades(panel.xaxis)
    if _wide(heights[usable]):
        panel.set_yscale("log")
        _decades(panel.yaxis)
    panel.grid(True, color="0.92")
    panel.set_axisbelow(True)
    panel.set_xlabel(_NAMES.get(x, x))
    panel.set_ylabel(_NAMES.get(y, y))
    _legend(figure, axes)
    return figure


def rows_of(table: pd.DataFrame | Comparison) -> pd.DataFrame:
    """Return the table of a comparison, or a table as it is."""
    rows = table.table if isinstance(table, Comparison) else table
    if not hasattr(rows, "columns"):
        got = type(table).__name__
        raise TypeError(f"table: expected a pandas table or a Comparison, got {got}")
    return rows


def _strangers(names: list[str]) -> list[str]:
    """Return the names in a table that are none of the methods', in order."""
    return [name for name in dict.fromkeys(names) if name not in method_names()]


def _panels(count: int, ax: Axes | None) -> tuple[list[Any], Figure]:
    if ax is not None:
        if count > 1:
            raise ValueError(f"ax: the table has {count} settings, each needs axes of its own")
        return [ax], cast("Figure", ax.figure)
    columns = 2 if count == 4 else min(count, _COLUMNS)
    lines = math.ceil(count / columns)
    figure = own_figure(
        (7.2 if count == 1 else 4.6 * columns + 1.6, 4.8 if count == 1 else 3.9 * lines)
    )
    grid = list(figure.subplots(lines, columns, squeeze=False).flat)
    for unused in grid[count:]:
        unused.remove()
    return grid[:count], figure


def _points(
    ax: Any,
    method: str,
    strangers: list[str],
    x: npt.NDArray[np.float64],
    y: npt.NDArray[np.float64],
    rows: npt.NDArray[np.int64],
    on: npt.NDArray[np.bool_],
) -> None:
    """Draw one method's rows, joined in the order of their times."""
    colour, marker = style(method, strangers)
    mitsuba = method.startswith(MITSUBA)
    order = rows[np.argsort(x[rows], kind="stable")]
    line = "--" if mitsuba else "-"
    ax.plot(x[order], y[order], line, color=colour, linewidth=1.0 if mitsuba else 0.6, alpha=0.6)
    strong = on[order]
    ax.plot(
        x[order], y[order], marker, color=colour, markersize=6, linestyle="none", label=method,
        alpha=1.0 if strong.any() or mitsuba else 0.65,
    )  # fmt: skip
    best = order[strong]
    ax.plot(
        x[best], y[best], marker, color=colour, markersize=9, linestyle="none",
        markeredgecolor="black" if not mitsuba else colour, markeredgewidth=1.2, zorder=4,
    )  # fmt: skip


def _decades(*axes: Any) -> None:
    """Write an axis's numbers plainly: 0.01, 0.02, 0.05, and only decades where there are many."""
    with needs("plot", "softshadow.plot"):
        from matplotlib.ticker import FuncFormatter

    def between(axis: Any) -> Any:
        def text(value: float, _: int) -> str:
            low, high = axis.get_view_interval()
            leading = round(value / 10 ** math.floor(math.log10(value) + 1e-9))
            return f"{value:g}" if high < 100 * low and leading in (2, 5) else ""

        return text

    for axis in axes:
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(FuncFormatter(between(axis)))


def _front_line(
    ax: Any, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64], rows: npt.NDArray[np.int64]
) -> None:
    """Draw the front as steps: what lies above and to the right of it is beaten."""
    order = rows[np.lexsort((y[rows], x[rows]))]
    ax.step(x[order], y[order], where="post", color="0.6", linewidth=3, alpha=0.45, zorder=1)


def _counts(rows: pd.DataFrame, labels: list[str]) -> list[str]:
    """Return the sample counts that labels tell, or a column ``samples``; or nothing."""
    told = [re.search(r"\b(?:samples|spp)=(\d+)", label) for label in labels]
    given = np.full(len(rows), np.nan)
    if "samples" in rows.columns:
        given = fronts.numbers(rows, "samples")
    return [
        found[1] if found else f"{number:.0f}" if np.isfinite(number) else ""
        for found, number in zip(told, given, strict=True)
    ]


def _sample_counts(
    ax: Any,
    counts: list[str],
    x: npt.NDArray[np.float64],
    y: npt.NDArray[np.float64],
    rows: npt.NDArray[np.int64],
) -> None:
    """Write Mitsuba's sample counts beside its marks."""
    for i in rows:
        note = ax.annotate(
            counts[i], (x[i], y[i]), (5, 4), textcoords="offset points", fontsize="x-small"
        )
        note.set_in_layout(False)


def _name(
    ax: Any, texts: list[str], x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]
) -> None:
    """Name the marks of the front, away from each other: each text gets a free place nearby."""
    taken: list[tuple[float, float, float]] = []
    points = 72.0 / ax.figure.dpi  # of a pixel; all below is in points
    for i in np.lexsort((y, x)):
        text = texts[i] if len(texts[i]) <= _LONGEST else f"{texts[i][: _LONGEST - 1]}…"
        across, up = ax.transData.transform((x[i], y[i])) * points
        width = 5.0 * len(text)
        beside = 9.0 if across + 9.0 + width < ax.bbox.x1 * points else -9.0 - width
        left = across + beside
        for height in (7, -13, 20, -26, 33, -39):
            place, low = (beside, height), up + height
            clear = all(
                left > right or left + width < start or abs(low - at) > 11
                for start, right, at in taken
            )
            if clear:
                break
        taken.append((left, left + width, low))
        far = abs(place[1]) > 15
        note = ax.annotate(
            text, (x[i], y[i]), place, textcoords="offset points", fontsize="small", zorder=5,
            arrowprops={"arrowstyle": "-", "color": "0.5", "linewidth": 0.6} if far else None,
        )  # fmt: skip
        note.set_in_layout(False)  # or a long one makes its panel narrow


def _legend(figure: Figure, axes: list[Any]) -> None:
    found: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    place = "outside right upper"
    figure.legend(list(found.values()), list(found), loc=place, fontsize="small", frameon=False)


def _title_of_error(name: str) -> str:
    if name.endswith("ssim"):
        return f"1 − {name}"
    return f"|{name}|" if name.endswith("bias") else _NAMES.get(name, name)


def _places(rows: pd.DataFrame, x: str) -> tuple[npt.NDArray[np.float64], list[str] | None]:
    """Return where a column's values stand, and their texts where they are no numbers."""
    numbers = fronts.numbers(rows, x)
    if x not in rows.columns or not np.isnan(numbers[rows[x].notna()]).any():
        return numbers, None
    texts = rows[x].astype(str).tolist()
    ticks = list(dict.fromkeys(t for t, there in zip(texts, rows[x].notna(), strict=True) if there))
    places = [ticks.index(t) if t in ticks else math.nan for t in texts]
    return np.array(places, dtype=np.float64), ticks


def _wide(values: npt.NDArray[np.float64]) -> bool:
    return bool(values.min() > 0 and values.max() > 20 * values.min())
