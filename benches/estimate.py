"""Measures how often `softshadow.estimate_error` holds the true error, and what it takes.

``python benches/estimate.py --size 160 --views 3 --seeds 4``

Scenes under lights of three sizes are seen from several sides; every picture of each is judged with
several seeds, and the interval is held against the mean of ``(v - a) (v - b)`` over all pixels, of
two references with 2048 samples each. *wrong 3* is `ray_traced` with three pixels turned over.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import pandas as pd
import softshadow as ss
from tables import RESULTS, table

LIGHTS = (0.1, 0.4, 1.2)
"""Widths of the lights; the scenes are near unit size."""

SCENES = {
    "solids": lambda n, light: ss.scenes.closed_solids(n, n, light_size=light),
    "bunny": lambda n, light: ss.scenes.bunny_on_plane(n, n, light_size=light),
    "tree": lambda n, light: ss.scenes.tree(n, n, light_size=light, leaves=20_000),
}

METHODS = {
    "hard": ss.Hard(),
    "wedges": ss.Wedges(),
    "mtsm": ss.Mtsm(),
    "counted": ss.Counted(),
    "16 samples": ss.RayTraced(samples=16),
    "error 0.03": ss.RayTraced(samples=4096, error=0.03),
    "error 0.01": ss.RayTraced(samples=4096, error=0.01),
    "error 0.004": ss.RayTraced(samples=4096, error=0.004),
}


def turned(camera: ss.Camera, angle: float) -> ss.Camera:
    """Return a camera that went round the scene's vertical axis."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.eye(4)
    turn[:2, :2] = [[c, -s], [s, c]]
    return ss.Camera.from_matrix(
        camera.K, turn @ camera.camera_to_world, camera.width, camera.height
    )


def pictures(setup: ss.scenes.Setup, camera: ss.Camera, rng: np.random.Generator):
    """Yield the visibilities that are judged, by name."""
    for name, method in METHODS.items():
        yield name, ss.render(setup.scene, camera, setup.light, method).visibility
    image = ss.render(setup.scene, camera, setup.light, ss.RayTraced(samples=64))
    wrong = rng.choice(np.argwhere(image.mask), 3, replace=False)
    image.visibility[tuple(wrong.T)] = np.round(1 - image.visibility[tuple(wrong.T)])
    yield "wrong 3", image.visibility


def seen_from(size: int, views: int, scenes: list[str], rng: np.random.Generator):
    """Yield every scene under every light from some sides, with two references."""
    for scene in scenes:
        for width in LIGHTS:
            setup = SCENES[scene](size, width)
            for view in range(views):
                camera = turned(setup.camera, rng.uniform(0, 2 * np.pi))
                references = [
                    ss.render(setup.scene, camera, setup.light, ss.RayTraced(2048, seed=seed))
                    for seed in (1001, 1002)
                ]
                yield {"scene": scene, "light": width, "view": view}, setup, camera, references


def true_error(visibility, references) -> float:
    """Return the root mean square error without the references' noise."""
    a, b = references
    off = (visibility.astype(float) - a.visibility) * (visibility - b.visibility)
    return max(off[a.mask].mean(), 0.0) ** 0.5


def of_estimates(size: int, views: int, seeds: int, scenes: list[str]):
    """Yield a row an estimate."""
    rng = np.random.default_rng(0)
    for case, setup, camera, references in seen_from(size, views, scenes, rng):
        for picture, seen in pictures(setup, camera, rng):
            true = true_error(seen, references)
            for seed in range(seeds):
                start = time.perf_counter()
                e = ss.estimate_error(seen, setup.scene, camera, setup.light, seed=seed)
                seconds = time.perf_counter() - start
                yield {
                    **{**case, "picture": picture, "seed": seed, "true": true, "rmse": e.rmse},
                    **{"low": e.low, "high": e.high, "probes": e.probes, "samples": e.samples},
                    "seconds": seconds,
                }


def summary(rows: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Return coverage, width and cost by some columns."""
    known = rows.assign(
        inside=(rows.low <= rows.true) & (rows.true <= rows.high),
        below=rows.high < rows.true,
        above=rows.low > rows.true,
        high_over_true=rows.high / rows.true,
        low_over_true=rows.low / rows.true,
    )
    groups = known.groupby(by, sort=False)
    shares = groups[["inside", "above", "below"]].mean()
    middle = groups[["true", "low_over_true", "high_over_true", "probes", "samples", "seconds"]]
    return shares.join(middle.median()).assign(runs=groups.size())


def report(rows: pd.DataFrame, *by: list[str]) -> None:
    """Print coverage by some columns, and of all."""
    for columns in by:
        print(summary(rows, columns).to_string(float_format="{:.4g}".format), "\n")
    print(f"inside: {summary(rows.assign(all='all'), ['all']).inside.iloc[0]:.3f} of {len(rows)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--size", type=int, default=160, help="pixels a side")
    parser.add_argument("--views", type=int, default=3)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--quick", action="store_true", help="a smoke run")
    options = parser.parse_args()
    if options.quick:
        options.size, options.views, options.seeds = 64, 1, 1
    chosen = options.size, options.views, options.seeds, options.scenes
    table("estimate", of_estimates(*chosen))
    report(pd.read_csv(RESULTS / "estimate.csv"), ["picture"], ["scene", "light"])


if __name__ == "__main__":
    main()
