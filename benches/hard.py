"""What every method makes of the hard cases, `softshadow.scenes.hard`, and how far it may be off.

    python benches/hard.py [--scenes NAME ...] [--seeds N] [--write] [--docs]

Prints a row for each case and method; a row that is out of its bounds ends in "CHANGED".
benches/README.md says how to read it.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import softshadow as ss
from softshadow.plot.pictures import draw_picture, own_figure
from softshadow.scenes.hard_cases.case import MARGIN, RIGHT, ROUNDING
from softshadow.scenes.hard_cases.excuses import POINTS
from tables import fill

ROOT = Path(__file__).parents[1]
MEASURED = ROOT / "python/softshadow/scenes/hard_cases/measured.csv"
PAGE = ROOT / "docs/hard_cases.md"
BEGIN, END = "<!-- python benches/hard.py --docs: from here -->", "<!-- to here -->"

SHEET = (128, 96)
"""Width and height of a picture on the contact sheet, pixels."""


def state(case: ss.scenes.HardCase, method: str, error: float) -> str:
    """Return what is to be said of an error."""
    if math.isnan(error):
        return "refused"
    excused = method in case.excuses
    known = case.measured.get(method, math.nan)
    held = error <= case.tolerance(method) and not (excused and error < known / MARGIN)
    if not held or excused != (error > RIGHT):
        return "CHANGED"
    return "excused" if excused else ""


def report(rows: pd.DataFrame) -> None:
    """Print a row for each case and method."""
    print("scene | method | error | tolerance | excuse")
    for row in rows.itertuples(index=False):
        case = ss.scenes.hard[row.scene]
        print(
            f"{row.scene} | {row.method} | {row.shadow_error:.3g} | {row.tolerance:.3g} | "
            f"{row.excuse} | {state(case, row.method, row.shadow_error)}"
        )


def write(rows: pd.DataFrame) -> None:
    """Write the errors to `MEASURED`, three digits of each."""
    methods = list(ss.method_names())
    with MEASURED.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["scene", *methods])
        for name in ss.scenes.hard:
            found = rows[rows["scene"] == name].set_index("method")["shadow_error"]
            values = [found[m] for m in methods]
            out.writerow([name, *("" if math.isnan(v) else f"{v:.2e}" for v in values)])


def seeds(rows: pd.DataFrame, names: Sequence[str], count: int) -> None:
    """Print by how much errors grow with other seeds, in the cases that are not nearly exact."""
    first = rows.set_index(["scene", "method"])["shadow_error"]
    seeded = [m for m in ss.scenes.hard.methods.values() if hasattr(m, "seed")]
    print("method | largest ratio of errors | where")
    growth: dict[str, tuple[float, str]] = {}
    for seed in range(1, count + 1):
        methods = [dataclasses.replace(m, seed=seed) for m in seeded]
        for row in ss.scenes.hard.table(names, methods).itertuples(index=False):
            before = first[row.scene, row.method]
            if before > ROUNDING and not math.isnan(row.shadow_error):
                ratio = max(row.shadow_error / before, before / row.shadow_error)
                growth[row.method] = max(growth.get(row.method, (0.0, "")), (ratio, row.scene))
    for method, (ratio, scene) in growth.items():
        print(f"{method} | {ratio:.3g} | {scene}")


def excuses(reasons: Mapping[str, ss.scenes.Excuse]) -> str:
    """Return a case's excuses but those of nearly all cases, methods of one reason together."""
    by_reason: dict[str, list[str]] = {}
    for method, excuse in reasons.items():
        if POINTS.get(method) is not excuse:
            said = ("refused: " if excuse.raises else "") + excuse.reason
            by_reason.setdefault(said, []).append(f"`{method}`")
    return "; ".join(
        f"{', '.join(methods)}: {reason[0].lower() + reason[1:].rstrip('.')}"
        for reason, methods in by_reason.items()
    )


def gallery() -> str:
    """Return the page's tables: what is hard, who is excused, and the errors that were measured."""
    lines = [
        "| scene | lights | what is hard | answer | excused, and why |",
        "|---|---|---|---|---|",
    ]
    for name, case in ss.scenes.hard.items():
        answer = "closed form" if case.closed_form else "`ray_traced`"
        kinds = [type(light).__name__ for light in case.make(8, 8).lights]
        lights = ", ".join(kind.removesuffix("Light").lower() for kind in kinds)
        lines.append(f"| `{name}` | {lights} | {case.why} | {answer} | {excuses(case.excuses)} |")
    methods = ss.method_names()
    lines += ["", "| scene | " + " | ".join(f"`{m}`" for m in methods) + " |"]
    lines.append("|---" * (1 + len(methods)) + "|")
    for name, case in ss.scenes.hard.items():
        cells = [
            ""
            if (error := case.measured.get(m)) is None
            # Bold where it is not right.
            else f"**{error:.2g}**"
            if error > RIGHT
            else f"{error:.2g}"
            if error >= ROUNDING
            else "0"
            for m in methods
        ]
        lines.append(f"| `{name}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def docs() -> None:
    """Write the page's tables and its contact sheet."""
    fill(PAGE, BEGIN, END, gallery())
    across = 7
    down = -(-len(ss.scenes.hard) // across)
    figure = own_figure((1.75 * across, 1.6 * down))
    grid = figure.subplots(down, across)
    for ax in grid.flat:
        ax.set_axis_off()
    for ax, (name, case) in zip(grid.flat, ss.scenes.hard.items(), strict=False):
        image = case.answer(*SHEET).image
        # Shaded a little by the slope, so that lit surfaces can be told apart.
        slope = 0.6 + 0.4 * np.abs(image.normal @ np.array([0.3, -0.5, 0.81]))
        seen = np.where(image.mask, image.visibility.mean(axis=0) * slope, 1.0)
        draw_picture(ax, seen.astype(np.float64), None)
        ax.set_title(name, fontsize=7)
    figure.savefig(PAGE.with_suffix(".png"), dpi=100)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", choices=list(ss.scenes.hard), metavar="NAME")
    parser.add_argument("--seeds", type=int, default=0, help="other seeds to try")
    parser.add_argument("--write", action="store_true", help="make these errors the measured ones")
    parser.add_argument(
        "--docs", action="store_true", help="write docs/hard_cases.md and its sheet"
    )
    options = parser.parse_args()
    if options.docs:
        docs()
        return
    names = options.scenes or list(ss.scenes.hard)
    if options.write and options.scenes:
        parser.error("--write is of all scenes")
    rows = ss.scenes.hard.table(names, progress=True)
    if options.write:
        write(rows)
    report(rows)
    if options.seeds:
        seeds(rows, names, options.seeds)


if __name__ == "__main__":
    main()
