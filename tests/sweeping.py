"""Small sweeps for tests: cases that are soon measured, against a reference that is soon made."""

from __future__ import annotations

import softshadow as ss

SIZE = {"width": 24, "height": 16}
CAMERA = ss.Camera((0, -4, 3), (0, 0, 0.3), **SIZE)
LIGHTS = {r: ss.SphereLight((0, 0, 4), float(r)) for r in ("0.2", "0.4", "0.6")}
QUICK = ss.RayTraced(samples=256, seed=7)
"""A reference that is soon made."""

TIMES = {"time", "machine"}


def board(height=1.0):
    """A board over a ground."""
    scene = ss.Scene()
    scene.add(ss.scenes.square(3))
    scene.add(ss.scenes.square(0.5, height), "board")
    return scene


def crowd(count):
    """So many small cases, of two scenes and three lights."""
    methods = [ss.RayTraced(samples=4, seed=i) for i in range(-(-count // 6))]
    scenes = {"low": board(0.8), "high": board(1.2)}
    return ss.grid(scenes, LIGHTS, CAMERA, methods)[:count]


def quick(cases, store, **options):
    return ss.sweep(cases, store, **{"reference": QUICK, "repeats": 1, "progress": False} | options)


def timeless(table):
    """A table without what differs from run to run."""
    names = [n for n in table.columns if n not in TIMES and "_seconds" not in n and n != "threads"]
    return table[names]
