"""The study: speed against error of every method, and of Mitsuba, on nine scenes under five lights.

    python benches/study.py [--short] [--from-table] [--output FOLDER]

measures what ``study.toml`` says, in three quarters of an hour on two cores that do nothing else
(a run that was ended goes on where it was), and writes

- ``benches/study.parquet``, the table, a row a case;
- ``docs/study.html``, the page about it, and ``docs/study.png``, the fronts by kinds of scenes;
- the tables in ``docs/study.md``, which it prints as well.

``--from-table`` makes the page, the figure and the tables of the committed table again.
``--short`` is a smoke run of some seconds: two scenes, one light, 64x64, small maps.
``--output`` writes all of it into one folder instead.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import softshadow as ss
from softshadow.renderers import rendered, resolve_measurable
from softshadow.sweep import Case, pools
from softshadow.sweep.cases import made, resolved
from softshadow.sweep.study import Study, read_study, resized
from tables import fill

HERE = Path(__file__).parent
DOCS = HERE.parent / "docs"

KINDS = {
    "solids": ("solids", "boards", "fork"),
    "scans and a city": ("bunny", "statue", "munich"),
    "leaves and fur": ("tree", "fur"),
    "translucent leaves": ("translucent_tree",),
}
"""Scenes whose means are taken together."""

TIMES = (0.03, 0.1, 0.3, 1.0)
"""Seconds a frame that a method may take."""

ERRORS = (0.02, 0.01, 0.005)
"""Root mean square errors over the picture that a method is to reach."""

SHOWN = (("fork", "sphere"), ("bunny", "medium"), ("tree", "medium"))
"""Scenes and lights whose pictures the page shows."""

SETTING = ["scene", "light"]

BEGIN, END = "<!-- measured: python benches/study.py -->", "<!-- end -->"

MITSUBA = "mitsuba"
"""What its names begin with."""

FIGURE = (
    "![Root mean square error against seconds a frame, by kinds of scenes](study.png)\n\n"
    "Geometric means over the scenes and lights of each kind. Mitsuba is black, its sample counts "
    "beside its marks; what was not measured in all settings of a kind is not in its panel. "
    "[The page](study.html) has every setting, all cases in a table that sorts and filters, "
    "pictures with their errors, and what failed.\n\n"
)


def shortened(study: Study) -> list[Case]:
    """Return a few small cases: two scenes, a light, the first setting of each method, coarse."""
    first: dict[str, Any] = {}
    for case in study.cases:
        first.setdefault(resolve_measurable(case.method).name, case.method)
    camera = partial(resized, size=(64, 64))
    return [
        replace(case, camera=camera, method=_coarse(case.method))
        for case in study.cases
        if case.scene_name in ("boards", "fork")
        and case.light_name == "sphere"
        and case.method in first.values()
    ]


def _coarse(method: Any) -> Any:
    return replace(method, resolution=256) if "resolution" in method.parameters() else method


def measured(study: Study, cases: Sequence[Case], store: Path, options: dict[str, Any]) -> Any:
    """Sweep the cases, and return their table without what only a store needs."""
    with pools.processes(study.workers) as executor:
        table = ss.sweep(cases, store, executor, **options)
    return table.drop(columns=["camera", "key", "image", "more_stages"]).dropna(axis=1, how="all")


# ---------------------------------------------------------------------------------------------
# What the tables say.


def succeeded(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows that have a time and an error, with ``total_seconds``."""
    good = table[table["error"].isna()] if "error" in table else table
    good = good[good["rmse"] > 0]
    total = good["prepare_seconds"] + good["frame_seconds"]
    timed: pd.DataFrame = good.assign(total_seconds=total)
    return timed


def means(table: pd.DataFrame, kinds: bool = False) -> pd.DataFrame:
    """Return geometric means by scenes, or kinds of scenes, of labels that have all settings."""
    good = succeeded(table)
    good = good.assign(settings=good["scene"] + ", " + good["light"])
    if kinds:
        kind_of = {scene: kind for kind, scenes in KINDS.items() for scene in scenes}
        good = good.assign(scene=good["scene"].map(kind_of))
    wanted = good.groupby("scene")["settings"].nunique()
    keys = ["scene", "method", "label", "parameters", "samples", "machine", "threads"]
    columns = ["frame_seconds", "total_seconds", "rmse", "penumbra_rmse"]
    good[columns] = np.log(good[columns])
    groups = good.groupby(keys, dropna=False, sort=False)
    found = np.exp(groups[columns].mean()).assign(count=groups["settings"].nunique()).reset_index()
    complete = found["count"] == found["scene"].map(wanted)
    whole: pd.DataFrame = found[complete].reset_index(drop=True)
    return whole


def named(row: pd.Series[Any]) -> str:
    """Return a row's label; of Mitsuba, whose method has it all already, with the samples only."""
    if str(row["method"]).startswith(MITSUBA):
        return f"{row['method']}, {row['samples']:.0f} samples,"
    return str(row["label"])


def best_in_time(rows: pd.DataFrame, seconds: float) -> str:
    """Return the method with the least error of those that take at most so long."""
    fast = rows[rows["frame_seconds"] <= seconds]
    if not len(fast):
        return "-"
    best = fast.loc[fast["rmse"].idxmin()]
    return f"{named(best)} {best['rmse']:.4f}"


def first_to_reach(rows: pd.DataFrame, error: float, time: str = "frame_seconds") -> str:
    """Return the method that reaches an error in the least time."""
    good = rows[rows["rmse"] <= error]
    if not len(good):
        return "-"
    best = good.loc[good[time].idxmin()]
    return f"{named(best)} {best[time]:.3f} s"


def winners(table: pd.DataFrame) -> str:
    """Return which method wins on each scene, and Mitsuba's best within the same times."""
    rows = means(table)
    head = ["scene", *(f"within {t:g} s" for t in TIMES), *(f"to {e:g}" for e in ERRORS)]
    head += [f"Mitsuba within {t:g} s" for t in TIMES[1::2]]
    lines = []
    for scene, its in rows.groupby("scene", sort=False):
        cells = [best_in_time(its, t) for t in TIMES] + [first_to_reach(its, e) for e in ERRORS]
        others = its[its["method"].str.startswith(MITSUBA)]
        lines.append([str(scene), *cells, *(best_in_time(others, t) for t in TIMES[1::2])])
    return markdown(head, lines)


def first_in(table: pd.DataFrame, error: float, time: str) -> Counter[str]:
    """Return in how many settings each method, at any parameters, is the first with an error."""
    good = succeeded(table)
    wins: Counter[str] = Counter()
    for _, rows in good[good["rmse"] <= error].groupby(SETTING):
        wins[str(rows.loc[rows[time].idxmin(), "method"])] += 1
    return wins


def counts(table: pd.DataFrame, time: str) -> str:
    """Return in how many settings each method is the first to reach errors."""
    wins = [first_in(table, error, time) for error in ERRORS]
    names = sorted({n for w in wins for n in w}, key=lambda n: -sum(w[n] for w in wins))
    head = [f"of {settings(table)} settings", *(f"first to {e:g}" for e in ERRORS)]
    return markdown(head, [[name, *(str(w[name]) for w in wins)] for name in names])


def settings(table: pd.DataFrame) -> int:
    return int(succeeded(table).groupby(SETTING).ngroups)


def speedups(table: pd.DataFrame) -> tuple[list[str], dict[str, dict[str, list[float]]]]:
    """Return how many times faster than Mitsuba each method reaches its own error.

    Mitsuba's time for an error is read from its curve over the samples of the same setting, in
    logarithms; beyond its ends, from the end.

    Returns
    -------
    sides : list of str
        Mitsuba's names.
    ratios : dict
        By label and side, the logarithm in each setting.
    """
    good = succeeded(table)
    sides = [str(m) for m in good["method"].unique() if str(m).startswith(MITSUBA)]
    ratios: dict[str, dict[str, list[float]]] = {}
    for _, rows in good.groupby(SETTING):
        for side in sides:
            curve = rows[rows["method"] == side].sort_values("rmse")
            if not len(curve):
                continue
            x, y = np.log(curve["rmse"].to_numpy()), np.log(curve["frame_seconds"].to_numpy())
            cells = rows[["label", "rmse", "frame_seconds"]].itertuples(index=False)
            for label, error, seconds in cells:
                ratio = float(np.interp(np.log(error), x, y) - np.log(seconds))
                ratios.setdefault(str(label), {}).setdefault(side, []).append(ratio)
    ours = {label: found for label, found in ratios.items() if not label.startswith(MITSUBA)}
    return sides, ours


def against_mitsuba(table: pd.DataFrame) -> str:
    """Return the geometric means of the speedups, by the last side's."""
    sides, ratios = speedups(table)
    order = sorted(ratios, key=lambda label: -float(np.mean(ratios[label][sides[-1]])))
    lines = [
        [label, str(len(ratios[label][sides[-1]]))]
        + [f"{np.exp(np.mean(ratios[label][side])):.2f}" for side in sides]
        for label in order
    ]
    return markdown(["", "settings", *sides], lines)


def summary(table: pd.DataFrame) -> str:
    """Return the study in five lines or so, from which a reader's are written."""
    lines = []
    for error in ERRORS[::2]:
        wins = first_in(table, error, "frame_seconds")
        said = ", ".join(f"{name} in {n}" for name, n in wins.most_common(4))
        lines.append(f"First to an error of {error:g}, of {settings(table)} settings: {said}.")
    for kind, rows in means(table, kinds=True).groupby("scene", sort=False):
        others = rows[rows["method"].str.startswith(MITSUBA)]
        said = "; ".join(
            f"within {t:g} s {best_in_time(rows, t)} (Mitsuba: {best_in_time(others, t)})"
            for t in TIMES[1::2]
        )
        lines.append(f"{kind}, means: {said}.")
    sides, ratios = speedups(table)
    for label in ("ray_traced(samples=64)", "ray_traced", "wedges", "mtsm"):
        if label in ratios:
            said = ", ".join(f"{np.exp(np.mean(ratios[label][s])):.1f} ({s})" for s in sides)
            lines.append(f"{label}: times faster than Mitsuba at its error: {said}.")
    return "".join(f"- {line}\n" for line in lines)


def markdown(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"


def facts(table: pd.DataFrame) -> str:
    """Return when, on what and with which versions the table was measured."""
    failed = int(table["error"].notna().sum()) if "error" in table else 0
    good = table[table["time"].notna()]
    versions = sorted(set(good["version"]), key=lambda text: (len(text), text))
    converged = table["reference_converged"].dropna().astype(bool)
    return (
        f"- {len(table)} cases, of which {failed} failed or were left out; "
        f"{good['time'].min():%Y-%m-%d %H:%M} to {good['time'].max():%H:%M} UTC.\n"
        f"- Machine: {'; '.join(sorted(set(good['machine'])))}; "
        f"{', '.join(str(int(n)) for n in sorted(set(good['threads'])))} threads.\n"
        f"- softshadow {'; '.join(versions)}.\n"
        f"- References whose own error is below a tenth of the row's: {converged.mean():.0%} of "
        f"the rows; at most {table['reference_rmse'].max():.1g} (root mean square).\n"
    )


def tables(table: pd.DataFrame) -> str:
    """Return all tables, as the page has them."""
    return "\n".join(
        [
            facts(table),
            "### In short\n",
            summary(table),
            "### Best on each scene\n\nMeans over the five lights (geometric). Least root mean "
            "square error within a time for a frame; then the shortest frame that reaches an "
            "error.\n",
            winners(table),
            "### First to reach an error\n\nA frame of a prepared scene:\n",
            counts(table, "frame_seconds"),
            "Everything made anew for the frame:\n",
            counts(table, "total_seconds"),
            "### Against Mitsuba\n\nHow many times longer Mitsuba takes for a frame with the same "
            "error, geometric mean over the settings (below 1: Mitsuba is faster). Where a method "
            "is better than Mitsuba's best picture, or worse than its worst, the time of that one "
            "counts.\n",
            against_mitsuba(table),
        ]
    )


# ---------------------------------------------------------------------------------------------
# The page and the figure.


def pictures(study: Study, cases: Sequence[Case]) -> dict[str, dict[str, npt.ArrayLike]]:
    """Render what the page shows: a picture of each method on some settings."""
    found: dict[str, dict[str, npt.ArrayLike]] = {}
    for scene, light in SHOWN:
        some = [c for c in cases if (c.scene_name, c.light_name) == (scene, light)]
        chosen = {resolve_measurable(c.method).name: c for c in some if not c.left_out}
        if not chosen:
            continue
        its = made(next(iter(chosen.values())).scene)
        images: dict[str, npt.ArrayLike] = {}
        for case in chosen.values():
            lit_by, camera = resolved(case, its)
            if "reference" not in images:
                truth = ss.render(its.scene, camera, lit_by, ss.RayTraced(samples=1024, seed=1))
                images["reference"] = truth.visibility
            method = resolve_measurable(case.method)
            images[case.label] = rendered(method, its.scene, camera, lit_by).visibility
        found[f"{scene}, {light}"] = images
    return found


def figure(table: pd.DataFrame, path: Path) -> None:
    """Draw error against time by kinds of scenes, of the means over their settings."""
    rows = means(table, kinds=True)
    drawn = ss.plot.pareto(rows, y="rmse")
    drawn.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--short", action="store_true", help="a smoke run; needs --output")
    parser.add_argument("--from-table", action="store_true", help="measure nothing")
    parser.add_argument("--output", type=Path, help="a folder for all that is written")
    arguments = parser.parse_args()
    if arguments.short and arguments.output is None:
        parser.error("--short needs --output")
    study = read_study(HERE / "study.toml")
    cases = shortened(study) if arguments.short else study.cases
    store, options = study.store, dict(study.options)
    parquet, docs = HERE / "study.parquet", DOCS
    if arguments.output is not None:
        docs = arguments.output
        docs.mkdir(parents=True, exist_ok=True)
        store, parquet = docs / "store.parquet", docs / "study.parquet"
        (docs / "study.md").write_text((DOCS / "study.md").read_text("utf-8"), "utf-8")
    if arguments.short:
        options |= {"repeats": 1, "reference": ss.RayTraced(samples=256, seed=1)}
    if not arguments.from_table:
        store.parent.mkdir(exist_ok=True)
        table = measured(study, cases, store, options)
        table.to_parquet(parquet, compression="zstd")
    table = pd.read_parquet(parquet)
    text = tables(table)
    fill(docs / "study.md", BEGIN, END, FIGURE + text)
    figure(table, docs / "study.png")
    title = "The study: speed against error"
    commands = ["python benches/study.py"]
    ss.report(table, docs / "study.html", pictures(study, cases), title, commands)
    sys.stdout.write(text)


if __name__ == "__main__":
    main()
