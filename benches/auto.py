"""Whether ``auto`` keeps the error that it is asked for, whether its interval does, what it costs.

    python benches/auto.py [--size 128] [--views 9] [--seeds 8] [--scenes NAME ...]
                           [--report] [--docs] [--quick]

Scenes of ``dense.toml`` and simple ones, each under lights of three sizes, from several sides,
asked for three errors with several seeds. The true error is the mean of ``(v - a) (v - b)`` over
the pixels, of two references of 2048 samples each: their noise makes no bias. The first side of
each has the rivals, too: methods at several settings, of which the fastest that keeps an error is
the best. A run that was ended goes on where it was; ``--report`` prints what is there, ``--docs``
writes it into ``docs/development/auto.md``. Times are processor time, which other work changes
less.
"""

from __future__ import annotations

import argparse
import csv
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import softshadow as ss
from tables import RESULTS, fill

PAGE = Path(__file__).parents[1] / "docs/development/auto.md"
BEGIN, END = "<!-- python benches/auto.py --docs: from here -->", "<!-- to here -->"

SCENES: dict[str, Callable[[int], ss.scenes.Setup]] = {
    "half_plane": lambda n: ss.scenes.half_plane(n, n),
    "boards": lambda n: ss.scenes.overlapping_boards(n, n),
    "solids": lambda n: ss.scenes.closed_solids(n, n),
    "fork": lambda n: ss.scenes.fork(n, n),
    "bunny": lambda n: ss.scenes.bunny_on_plane(n, n),
    "munich": lambda n: ss.scenes.city("munich", n, n),
    "statue": lambda n: ss.scenes.statue(n, n),
    "scan": lambda n: ss.scenes.statue(n, n, subdivisions=2),
    "tree": lambda n: ss.scenes.tree(n, n),
    "translucent_tree": lambda n: ss.scenes.tree(n, n, opacity=0.5),
    "fur": lambda n: ss.scenes.fur_ball(n, n, triangles=400_000),
    "ribbons": lambda n: ss.scenes.fur_ribbons(n, n),
}

SIZES = (0.25, 1.0, 3.0)
"""Of the scene's own light."""

ERRORS = (0.03, 0.01, 0.003)

REFERENCE = 2048
"""Light samples of each of the two references: 4096 together."""

ROUND = 3
"""Views of each scene before the next scene's come: what is there at any time is of all scenes."""


def rivals() -> list[ss.Method]:
    """Return the settings among which the best single method is sought."""
    found: list[ss.Method] = [ss.RayTraced(n) for n in (4, 16, 64, 256, 1024)]
    found += [ss.RayTraced(65536, error=e) for e in (0.03, 0.02, 0.012, 0.008, 0.005, 0.003, 0.002)]
    found += [ss.Counted(416, error=e) for e in (0.1, 0.03, 0.01)]
    found += [ss.Counted(1664, error=e) for e in (0.03, 0.01, 0.003)]
    return [*found, ss.Counted(416), ss.Counted(), ss.Hard(), ss.Wedges(), ss.Mtsm(samples=16)]


def sized(light: ss.Light, factor: float) -> ss.Light:
    """Return a light that is so many times as wide."""
    if isinstance(light, ss.RectLight):
        u, v = (tuple(factor * x for x in edge) for edge in (light.edge_u, light.edge_v))
        return ss.RectLight(light.center, u, v)
    assert isinstance(light, ss.SphereLight)
    return ss.SphereLight(light.center, factor * light.radius)


def turned(setup: ss.scenes.Setup, angle: float) -> ss.Camera:
    """Return the camera after it went round the scene's middle."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.eye(4)
    turn[:2, :2] = [[c, -s], [s, c]]
    middle = np.append(setup.scene.bounds.mean(axis=0)[:2], 0.0)
    turn[:3, 3] = middle - turn[:3, :3] @ middle
    camera = setup.camera
    return ss.Camera.from_matrix(
        camera.K, turn @ camera.camera_to_world, camera.width, camera.height
    )


def rendered(scene: ss.Scene, camera: ss.Camera, light: ss.Light, method: ss.Method):
    """Return an image, with its processor time, preparing included."""
    start = time.process_time()
    image = ss.render(scene, camera, light, method)
    return image, time.process_time() - start


def of_view(setup: ss.scenes.Setup, light: ss.Light, view: int, seeds: int, key: int):
    """Yield the rows of one scene and light from one side."""
    rng = np.random.default_rng([key, view])
    camera = turned(setup, rng.uniform(0, 2 * np.pi) if view else 0.0)
    a, b = (
        ss.render(setup.scene, camera, light, ss.RayTraced(REFERENCE, seed=1001 + 2 * view + k))
        for k in (0, 1)
    )
    mask = a.mask
    noise = float(np.sqrt(np.square(a.visibility[mask] - b.visibility[mask]).mean()) / 2)

    def true(image: ss.Image) -> float:
        v = image.visibility.astype(float)
        return math.sqrt(max(((v - a.visibility) * (v - b.visibility))[mask].mean(), 0.0))

    for asked in ERRORS:
        for seed in range(seeds):
            # Of its own, or one choice of probes would count three times.
            seed = int(rng.integers(2**62))
            image, cpu = rendered(setup.scene, camera, light, ss.Auto(asked, seed=seed))
            judging = sum(image.seconds[s] for s in ("look", "probes")) / image.seconds["frame"]
            e = image.error
            yield {
                **{"method": "auto", "asked": asked, "true": true(image), "noise": noise},
                **{"rmse": e.rmse, "low": e.low, "high": e.high, "probes": e.probes},
                **{"samples": e.samples, "by": image.choice[-1].method.name},
                **{"pictures": len(image.choice), "cpu": cpu, "judging": judging},
                "choosing": image.seconds["choose"] / image.seconds["frame"],
            }
    for method in rivals() if view == 0 else ():
        try:
            image, _ = rendered(setup.scene, camera, light, method)
            # Once more, with what is built for the scene.
            image, cpu = rendered(setup.scene, camera, light, method)
        except ss.UnsupportedError:
            continue
        yield {"method": str(method), "true": true(image), "noise": noise, "cpu": cpu}


COLUMNS = (
    *("scene", "light", "view", "method", "asked", "true", "noise", "rmse", "low", "high"),
    *("probes", "samples", "by", "pictures", "cpu", "judging", "choosing"),
)


def measure(path: Path, size: int, views: int, seeds: int, scenes: list[str]) -> None:
    """Measure what is not in the file yet, and append it, a view at a time."""
    done = set()
    if path.exists():
        rows = pd.read_csv(path)
        done = set(zip(rows["scene"], rows["light"], rows["view"], strict=True))
    else:
        path.parent.mkdir(exist_ok=True)
        with path.open("w", newline="") as file:
            csv.writer(file).writerow(COLUMNS)
    for first in range(0, views, ROUND):
        for name in scenes:
            todo = [
                (factor, view)
                for factor in SIZES
                for view in range(first, min(first + ROUND, views))
                if (name, factor, view) not in done
            ]
            setup = SCENES[name](size) if todo else None
            for factor, view in todo:
                assert setup is not None
                start = time.perf_counter()
                light = sized(setup.light, factor)
                key = list(SCENES).index(name) * len(SIZES) + SIZES.index(factor)
                rows = list(of_view(setup, light, view, seeds, key))
                with path.open("a", newline="") as file:
                    out = csv.DictWriter(file, COLUMNS)
                    its = {"scene": name, "light": factor, "view": view}
                    out.writerows({**its, **row} for row in rows)
                print(name, factor, view, f"{time.perf_counter() - start:.1f} s", flush=True)


def best_single(table: pd.DataFrame) -> pd.DataFrame:
    """Return the least processor time of a rival that keeps each error, and that of rays alone."""
    its = table[table["method"] != "auto"]
    lines = []
    for (scene, light), rows in its.groupby(["scene", "light"], sort=False):
        for asked in ERRORS:
            good = rows[rows["true"] <= asked]
            rays = good[
                good["method"].str.startswith("RayTraced") & ~good["method"].str.contains("error=0")
            ]
            if not len(good):
                continue
            best = good.loc[good["cpu"].idxmin()]
            lines.append(
                {
                    **{"scene": scene, "light": light, "asked": asked, "best": best["cpu"]},
                    **{"best_is": best["method"], "rays": rays["cpu"].min()},
                }
            )
    return pd.DataFrame(lines)


def markdown(table: pd.DataFrame) -> str:
    head = ["", *map(str, table.columns)]
    lines = [head, ["---"] * len(head)]
    lines += [
        [str(i), *map(shown, row)] for i, row in zip(table.index, table.to_numpy(), strict=True)
    ]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def shown(value: Any) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.3g}"
    return str(value)


def with_marks(table: pd.DataFrame) -> pd.DataFrame:
    rows = table[table["method"] == "auto"].copy()
    rows["kept"] = rows["true"] <= rows["asked"]
    rows["inside"] = (rows["low"] <= rows["true"]) & (rows["true"] <= rows["high"])
    rows["above"] = rows["low"] > rows["true"]
    rows["below"] = rows["high"] < rows["true"]
    rows["promised"] = rows["high"] <= rows["asked"]
    return rows


def report(table: pd.DataFrame, size: int) -> str:
    """Return what was measured, as text."""
    rows = with_marks(table)
    sizes = ", ".join(map(str, SIZES))
    runs = rows.groupby("scene", sort=False).size() // len(ERRORS)
    parts = [
        f"{len(rows)} pictures of {size}×{size} pixels, of {rows['scene'].nunique()} scenes under "
        f"lights of {sizes} times their size, {runs.min()} to {runs.max()} of each scene and "
        f"error. Noise of both references together: {rows['noise'].median():.1e} in the median, "
        f"{rows['noise'].max():.1e} at most.",
        f"Kept: {rows['kept'].mean():.4f}. Inside the interval: {rows['inside'].mean():.4f}; the "
        f"true error is above it in {rows['below'].mean():.4f}, below it in "
        f"{rows['above'].mean():.4f}. Of {len(rows) - rows['promised'].sum()} pictures it was told "
        "that the error may be above what was asked.",
        markdown(
            pd.concat([runs.rename("runs"), shares(rows, "kept"), shares(rows, "inside")], axis=1)
        ),
        "Pictures by each method; means of pictures until it held, probes, and shares of the time:",
    ]
    by = rows.pivot_table("kept", "scene", "by", "size", sort=False).fillna(0).astype(int)
    middle = rows.groupby("scene", sort=False)[["pictures", "probes", "judging", "choosing"]].mean()
    parts.append(markdown(by.join(middle)))
    return "\n\n".join([*parts, *costs(table, rows)])


def shares(rows: pd.DataFrame, what: str) -> pd.DataFrame:
    """Return the share of pictures of which something holds, by scene and error."""
    found = rows.pivot_table(what, "scene", "asked", "mean", sort=False)
    return found.rename(columns=lambda e: f"{what}, {e:g}")


def costs(table: pd.DataFrame, rows: pd.DataFrame) -> list[str]:
    """Return what the first views say of time beside the rivals."""
    best = best_single(table)
    if not len(best):
        return []
    first = rows[rows["view"] == 0].groupby(["scene", "light", "asked"], sort=False)
    cost = first.agg(cpu=("cpu", "median"), judging=("judging", "median")).reset_index()
    both = best.merge(cost, on=["scene", "light", "asked"])
    both["over best"] = both["cpu"] / both["best"]
    both["without judging"] = both["over best"] * (1.0 - both["judging"])
    both["over rays"] = both["cpu"] / both["rays"]
    ratios = ["over best", "without judging", "over rays"]
    middle = both.groupby(["scene", "asked"], sort=False)[ratios].median()
    kinds = both["best_is"].str.split("(").str[0].value_counts()
    return [
        "Processor time, preparing included, over that of the best single setting of those that "
        "keep the error, all of it and without look and probes; and over that of `ray_traced` with "
        "the fewest samples, by factors of four, that keep it; medians over lights:",
        markdown(_flat(middle.unstack("asked"))),
        f"Best single settings: {', '.join(f'{kind} {n}' for kind, n in kinds.items())}.",
    ]


def _flat(table: pd.DataFrame) -> pd.DataFrame:
    table.columns = [f"{what}, {e:g}" for what, e in table.columns]
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--size", type=int, default=128, help="pixels a side")
    parser.add_argument("--views", type=int, default=9)
    parser.add_argument("--seeds", type=int, default=8, help="of each view and error")
    parser.add_argument("--report", action="store_true", help="measure nothing")
    parser.add_argument("--docs", action="store_true", help="write the page as well")
    parser.add_argument("--quick", action="store_true", help="a smoke run")
    options = parser.parse_args()
    name = f"auto_{options.size}.csv"
    if options.quick:
        options.size, options.views, options.seeds = 64, 1, 1
        options.scenes, name = ["half_plane", "solids"], "auto_quick.csv"
    path = RESULTS / name
    if not options.report:
        measure(path, options.size, options.views, options.seeds, options.scenes)
    text = report(pd.read_csv(path), options.size)
    print(text)
    if options.docs:
        fill(PAGE, BEGIN, END, text)


if __name__ == "__main__":
    main()
