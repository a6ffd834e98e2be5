"""Error of every method against the distance of a light that keeps its angle, to infinity.

    python benches/distant.py [--scenes NAME ...] [--lights sphere disk] [--angle 0.53] [--size 128]

Prints the mean absolute error of visibility over all pixels that show a surface, against
`ray_traced` under the same light: a row a method, a column a distance in scene sizes (the largest
extent), the last one a `DistantLight`. The tables of ``docs/distant_lights.md`` are its output.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import softshadow as ss
from softshadow.light import Light
from softshadow.scenes import Setup
from tables import table

DISTANCES = (1e1, 1e2, 1e3, 1e6, 1e9, 1e12, math.inf)
"""In scene sizes."""

TOWARDS = np.array((0.5, 0.3, 0.8)) / np.linalg.norm((0.5, 0.3, 0.8))
"""Direction to the light: some 54 degrees high."""

SCENES: dict[str, Callable[[int], Setup]] = {
    "bunny": lambda size: ss.scenes.bunny_on_plane(size, size),
    "munich": lambda size: ss.scenes.city("munich", size, size),
}


def light_at(scene: ss.Scene, kind: str, angle_deg: float, distance: float) -> Light:
    """Return a light in `TOWARDS` of so many degrees, at a distance in scene sizes."""
    if math.isinf(distance):
        return ss.DistantLight(-TOWARDS, angle_deg)
    low, high = scene.bounds
    away = distance * float((high - low).max())
    center, half = 0.5 * (low + high) + away * TOWARDS, math.radians(0.5 * angle_deg)
    if kind == "sphere":
        return ss.SphereLight(center, away * math.sin(half))
    return ss.DiskLight(center, -TOWARDS, away * math.tan(half))


def rows(scenes: list[str], kinds: list[str], angle: float, size: int) -> Iterator[dict[str, Any]]:
    """Yield a row a scene, light and method."""
    for name in scenes:
        setup = SCENES[name](size)
        for kind in kinds:
            lights = {d: light_at(setup.scene, kind, angle, d) for d in DISTANCES}
            many = ss.RayTraced(samples=4096, seed=24301)
            right = {d: ss.render(setup.scene, setup.camera, x, many) for d, x in lights.items()}
            for method in ss.method_names():
                if method == "auto":
                    continue
                row: dict[str, Any] = {"scene": name, "light": kind, "method": method}
                for distance, light in lights.items():
                    image = ss.render(setup.scene, setup.camera, light, method)
                    off = np.abs(image.visibility - right[distance].visibility)
                    row[f"{distance:g}"] = float(off[image.mask].mean())
                yield row


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--lights", nargs="+", choices=("sphere", "disk"), default=["sphere"])
    parser.add_argument("--angle", type=float, default=0.53)
    parser.add_argument("--size", type=int, default=128)
    options = parser.parse_args()
    table("distant", rows(options.scenes, options.lights, options.angle, options.size))


if __name__ == "__main__":
    main()
