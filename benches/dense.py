"""Time to an error on dense scenes: foliage, hair, scans, a large light; Mitsuba beside.

    python benches/dense.py [--from-table] [--scenes NAME ...]

measures what ``dense.toml`` says, one case after the other (a run that was ended goes on where it
was), writes ``benches/dense.parquet`` and the tables of ``docs/dense.md``, and prints them. Of each
scene and side, time is read from the best of its settings: between two that nothing beats in both
time and error in logarithms, and of one that is better than was asked as it is. Errors of Mitsuba
are those against itself with many samples.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np
import pandas as pd
import softshadow as ss
from softshadow.sweep import Case
from softshadow.sweep.study import Study, read_study
from study import DOCS, END, ERRORS, HERE, MITSUBA, facts, markdown, measured, succeeded
from tables import fill

BEGIN = "<!-- measured: python benches/dense.py -->"

OWN_SAMPLES = 1024
"""Samples of each half of Mitsuba's own reference."""

OURS = "softshadow"
"""All methods together: the best of them at each error."""

RENDER = f"{MITSUBA}.render"
"""Mitsuba's own integrator with either sampler: the better of them at each error."""


def swept(study: Study, cases: Sequence[Case]) -> pd.DataFrame:
    """Return the table of what is measured, Mitsuba's errors against its own reference.

    Its pictures converge to one that differs from ours by what its shadow rays leave out; what is
    compared here is how fast each side comes to its own.
    """
    store = study.store
    store.parent.mkdir(exist_ok=True)
    options = dict(study.options)
    own = ss.mitsuba.Direct(samples=OWN_SAMPLES, seed=options["reference"].seed)
    of_mitsuba = [isinstance(case.method, ss.mitsuba.Direct) for case in cases]
    parts = (
        measured(
            study,
            [c for c, its in zip(cases, of_mitsuba, strict=True) if its == side],
            store,
            options | {"reference": reference},
        )
        for side, reference in ((False, options["reference"]), (True, own))
    )
    return pd.concat(parts, ignore_index=True)


def seconds_to(rows: pd.DataFrame, error: float) -> float:
    """Return the seconds a frame in which the rows' front reaches an error; infinite beyond it."""
    best = rows[ss.front(rows, "frame_seconds", "rmse")].sort_values("rmse")
    x, y = np.log(best["rmse"].to_numpy()), np.log(best["frame_seconds"].to_numpy())
    if not len(x) or np.log(error) < x[0]:
        return float("inf")
    return float(np.exp(np.interp(np.log(error), x, y)))


def times(table: pd.DataFrame) -> pd.DataFrame:
    """Return seconds to each error, a row a scene and side."""
    lines = []
    for scene, rows in table.groupby("scene", sort=False):
        methods = {str(m): its for m, its in rows.groupby("method", sort=False) if m != "hard"}
        found = {m: [seconds_to(its, e) for e in ERRORS] for m, its in methods.items()}
        ours = [t for m, t in found.items() if not m.startswith(MITSUBA)]
        films = [t for m, t in found.items() if m.endswith(" film")]
        best = {OURS: np.min(ours, axis=0), RENDER: np.min(films, axis=0)}
        for side, seconds in {**best, **found}.items():
            at = {f"{e:g}": t for e, t in zip(ERRORS, seconds, strict=True)}
            lines.append({"scene": scene, "side": side, **at})
    return pd.DataFrame(lines)


def ratios(found: pd.DataFrame, other: str) -> pd.DataFrame:
    """Return how many times longer another side takes than ours, a row a scene."""
    columns = [f"{e:g}" for e in ERRORS]
    ours = found[found["side"] == OURS].set_index("scene")[columns]
    return found[found["side"] == other].set_index("scene")[columns] / ours


def shown(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) and value > 0 else "-"


def tables(table: pd.DataFrame) -> str:
    """Return what was measured, as text."""
    good = succeeded(table)
    found = times(good)
    columns = [f"{e:g}" for e in ERRORS]
    head = ["scene", "side", *(f"to {c}" for c in columns)]
    lines = [
        [str(r["scene"]), str(r["side"]), *(shown(r[c]) for c in columns)]
        for _, r in found.iterrows()
    ]
    parts = [facts(table), "### Seconds a frame to an error\n", markdown(head, lines)]
    others = [str(s) for s in found["side"].unique() if str(s).startswith(MITSUBA)]
    for other in (s for s in others if not s.endswith(" film")):
        its = ratios(found, other)
        finite = its.to_numpy()[np.isfinite(its.to_numpy())]
        mean, least = np.exp(np.log(finite).mean()), finite.min()
        parts += [
            f"### Times longer than ours: {other}\n",
            f"Geometric mean {mean:.2f}, least {least:.2f}.\n",
            markdown(
                ["scene", *columns],
                [[str(s), *map(shown, r)] for s, r in zip(its.index, its.to_numpy(), strict=True)],
            ),
        ]
    return "\n".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--from-table", action="store_true", help="measure nothing")
    parser.add_argument("--scenes", nargs="+", help="only these; prints and writes no page")
    arguments = parser.parse_args()
    study = read_study(HERE / "dense.toml")
    parquet = HERE / "dense.parquet"
    some = arguments.scenes or [case.scene_name for case in study.cases]
    cases = [case for case in study.cases if case.scene_name in some]
    table = pd.read_parquet(parquet) if arguments.from_table else swept(study, cases)
    text = tables(table)
    if not arguments.scenes and not arguments.from_table:
        table.to_parquet(parquet, compression="zstd")
    if not arguments.scenes:
        fill(DOCS / "dense.md", BEGIN, END, text)
    sys.stdout.write(text)


if __name__ == "__main__":
    main()
