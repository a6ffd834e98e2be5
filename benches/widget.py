"""Pictures a second of `ss.widget` while its light is dragged around the bunny.

    python benches/widget.py [--frames 60] [--methods wedges hard ssoc] [--sizes 320x240 512x512]

benches/README.md says how to read it.
"""

from __future__ import annotations

import argparse
import math
import statistics
import time
from collections.abc import Iterable, Sequence
from typing import Any

import softshadow as ss
from tables import table

PARTS = 3
"""Turns that each case takes, so that drift hits all."""


def answered(moving: Any, angle: float) -> tuple[float, float]:
    """Return the seconds of an answer to the browser, and the processor's, of all threads."""
    drag = {"start": moving.start, "pixels": [90 * math.cos(angle), 60 * math.sin(angle)]}
    began, spent = time.perf_counter(), time.process_time()
    moving._handle_custom_msg({"drag": {**drag, "away": False}}, [])
    seconds = time.perf_counter() - began, time.process_time() - spent
    if moving.error:
        raise SystemExit(moving.error)
    return seconds


def dragging(
    sizes: Sequence[tuple[int, int]], methods: Sequence[str], frames: int
) -> Iterable[dict[str, Any]]:
    """Yield how fast a drag in a circle is drawn, size by size and method by method."""
    cases: dict[tuple[str, str], tuple[Any, list[tuple[float, float]]]] = {}
    for width, height in sizes:
        setup = ss.scenes.bunny_on_plane(width, height)
        for method in methods:
            moving = ss.widget(setup.scene, setup.camera, setup.light, method)
            moving.start = moving.center
            cases[f"{width}x{height}", method] = moving, []
    for part in range(PARTS):
        for moving, taken in cases.values():
            answered(moving, 0)  # finds the caches full of another case
            for i in range(part, frames, PARTS):
                taken.append(answered(moving, 2 * math.pi * i / frames))
    for (size, method), (moving, taken) in cases.items():
        seconds = [both[0] for both in taken]
        middle = statistics.median(seconds)
        yield {
            "size": size,
            "method": method,
            "pictures/s": 1 / middle,
            "fastest": 1 / min(seconds),
            "ms": 1e3 * middle,
            "processor ms": 1e3 * statistics.median(both[1] for both in taken),
            "kB": len(moving.picture) / 1e3,
        }


def main() -> None:
    """Measure, print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--methods", nargs="+", default=["wedges", "hard", "ssoc", "ray_traced"])
    parser.add_argument("--sizes", nargs="+", default=["320x240", "512x512"])
    given = parser.parse_args()
    sizes = [tuple(map(int, size.split("x"))) for size in given.sizes]
    table("widget", dragging(sizes, given.methods, given.frames))


if __name__ == "__main__":
    main()
