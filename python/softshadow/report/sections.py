"""The parts of a report, each as HTML; empty where there is nothing to say."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from softshadow import fronts
from softshadow.compare import Comparison
from softshadow.report.html import figure, table
from softshadow.sweep.columns import parameter_columns

if TYPE_CHECKING:
    import pandas as pd

    from softshadow.report import Pictures

__all__ = [
    "cases",
    "failures",
    "front_figures",
    "pictures",
    "reference_facts",
    "summary",
    "table_facts",
]

_OPEN = 6
"""Settings or scenes whose figures are shown at once; more are folded away, each under its name."""

_MANY = 12
"""Settings from which on figures are small: of a prepared frame only, and as pictures."""

_FIRST = [
    *("scene", "light", "camera", "method", "parameters", "prepare_seconds", "frame_seconds"),
    *("bytes", "penumbra_mae", "penumbra_rmse", "mae", "rmse", "max", "bias", "ssim", "flip"),
]
"""Columns that are read most, in this order; all others follow."""

_OF_THE_RUN = ("machine", "threads", "version", "time", "reference")
"""Columns that are said once, under *Machine*."""

_NOT_SHOWN = ("error", "key", "label", "image", "more_stages")
"""Columns that are for programs."""


def summary(rows: pd.DataFrame, skipped: Mapping[str, str]) -> str:
    """Return one line that counts cases, settings, failures and what was left out."""
    wrong = int(fronts.failed(rows).sum())
    count = len(fronts.settings(rows[~fronts.failed(rows)]))
    said = [f"{len(rows)} case{'s' * (len(rows) != 1)}"]
    said += [f"{rows['method'].nunique()} methods"]
    said += [f"{count} settings"] if count > 1 else []
    said += [f"{wrong} failed"] if wrong else []
    said += [f"{len(skipped)} left out"] if skipped else []
    return ", ".join(said) + "."


def front_figures(rows: pd.DataFrame) -> str:
    """Return each setting's error against time, of a frame and with the preparation."""
    out = [
        "<p>Error in the penumbra against time, both logarithmic: lower left is better. What is "
        "named is on the front: nothing else is as fast and as right.</p>\n"
    ]
    found = fronts.settings(rows)
    ok = ~fronts.failed(rows)
    for name, chosen in found.items():
        drawn = _front_figure(rows.iloc[chosen[ok[chosen]]], name, len(found) >= _MANY)
        if len(found) > _OPEN and drawn:
            drawn = _folded(name, drawn)
        out.append(drawn)
    return "".join(out)


def _front_figure(rows: pd.DataFrame, name: str, small: bool) -> str:
    from softshadow.plot import pareto
    from softshadow.plot.pictures import own_figure

    times = ["frame_seconds"] + ["total_seconds"] * (
        "prepare_seconds" in rows.columns and not small
    )
    drawn = own_figure((5.1 * len(times) + 2.4, 4.4))
    axes = drawn.subplots(1, len(times), squeeze=False, sharey=True)[0]
    try:
        for ax, x in zip(axes, times, strict=True):
            pareto(rows, x=x, ax=ax)
            ax.set_title("")
    except ValueError:  # nothing with a time and an error
        return f'<p class="soft">{escape(name)}: no case has a time and an error.</p>\n'
    for ax in axes[1:]:
        ax.set_ylabel("")
    for legend in drawn.legends[:-1]:  # each panel made the figure's legend
        legend.remove()
    caption = "A frame of a static scene"
    if len(times) > 1:
        caption += "; right: everything made anew"
    kind: Literal["svg", "png8"] = "png8" if small else "svg"
    return figure(drawn, f"{name}. {caption}" if name else caption, kind)


def cases(rows: pd.DataFrame) -> str:
    """Return the table of all cases that did not fail, and what is the same in all of them."""
    good = rows[~fronts.failed(rows)]
    if not len(good):
        return ""
    on = fronts.front(good)
    hidden = {*_OF_THE_RUN, *_NOT_SHOWN}
    if "parameters" in good.columns:  # says what the columns of single parameters say
        hidden |= {column for column, _ in parameter_columns().values()} - {"samples"}
    columns = [c for c in _FIRST if c in good.columns]
    for column in good.columns:
        detail = column.endswith(("_seconds_min", "_seconds_spread"))
        detail &= not column.startswith("frame_")
        if column not in columns and column not in hidden and not detail:
            columns.append(column)
    shown = good[columns].dropna(axis=1, how="all")
    if "parameters" in shown and (shown["parameters"].fillna("") == "").all():
        shown = shown.drop(columns="parameters")
    return (
        "<p>Press a heading to sort, again to turn round. Marked rows are on the front of their "
        "setting (<code>frame_seconds</code> and <code>penumbra_mae</code>).</p>\n"
        + table(shown, cast("Any", on.tolist()), "cases")
    )


def pictures(images: Pictures | Mapping[str, Pictures] | None, notes: Mapping[str, str]) -> str:
    """Return strips with signed errors, and a profile, of each scene, under what is said of it."""
    if images is None:
        return ""
    scenes: dict[str, Any] = {"": images}
    if isinstance(images, Mapping) and any(
        isinstance(value, (Comparison, Mapping)) for value in images.values()
    ):
        scenes = dict(images)
    drawn = {name: _scene(name, given, notes.get(name, "")) for name, given in scenes.items()}
    if len(drawn) <= _OPEN:
        return "".join(_heading(name) + body for name, body in drawn.items())
    return "".join(_folded(name, body) for name, body in drawn.items())


def _heading(name: str) -> str:
    return f"<h3>{escape(name)}</h3>\n" if name else ""


def _folded(name: str, body: str) -> str:
    return f"<details><summary>{escape(name)}</summary>{body}</details>\n"


def _scene(name: str, images: Pictures, note: str) -> str:
    from softshadow.plot import scanline, strip

    said = f"<p>{escape(note)}</p>\n" if note else ""
    lit = ""
    if isinstance(images, Comparison):
        from softshadow.plot import show

        drawn = show(images.reference, "radiance")
        lit = figure(drawn, "The reference, as it is lit", "png")
    strips = figure(
        strip(images),
        "Visibility, and below it the signed error: red where too bright, blue where too dark, "
        "grey where nothing was hit. One scale for all; large errors saturate.",
        "png8",
    )
    lines = figure(scanline(images), "Visibility along the row of pixels with the most penumbra")
    return said + lit + strips + lines


def failures(rows: pd.DataFrame, skipped: Mapping[str, str]) -> str:
    """Return what failed, with its message, and what was left out, with the reason."""
    import pandas as pd

    out = ""
    wrong = rows[fronts.failed(rows)]
    if len(wrong):
        columns = [c for c in ("scene", "light", "camera", "method", "parameters") if c in wrong]
        out += table(wrong[[*columns, "error"]], name="failures")
    if skipped:
        left = pd.DataFrame({"method": list(skipped), "why": list(skipped.values())})
        out += ("<h3>Left out</h3>\n" if out else "") + table(left, name="skipped")
    return out


def reference_facts(comparisons: Mapping[str, Comparison]) -> dict[str, str]:
    """Return what the errors are against, and on how many pixels."""
    facts = {}
    for name, result in comparisons.items():
        height, width = result.reference.mask.shape
        by = result.reference_method
        end = f" of {name}" if name and len(comparisons) > 1 else ""
        facts[f"picture{end}"] = f"{width}x{height} pixels"
        facts[f"reference{end}"] = "an image that was given" if by is None else repr(by)
    return facts


def table_facts(rows: pd.DataFrame) -> dict[str, str]:
    """Return what the table says of the machine, of each kind all values that occur."""
    facts = {}
    for name in _OF_THE_RUN:
        if name not in rows.columns or not rows[name].notna().any():
            continue
        values = rows[name].dropna()
        if name == "time":
            low, high = str(values.min()), str(values.max())
            facts[name] = low if low == high else f"{low} to {high}"
        else:
            facts[name] = "; ".join(str(v) for v in np.unique(values.astype(str)))
    return facts
