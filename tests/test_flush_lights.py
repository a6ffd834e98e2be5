"""A flat light in the plane of a ceiling, a wall or a tilted roof: that hides none of it.

At points; pictures of such rooms are among the hard cases (`test_hard_cases.py`).
"""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from shapes import quad
from small_methods import MAP_NAMES, methods
from trimesh.transformations import rotation_matrix

# What is dark or lit as a whole is so in small maps, too.
POINT_METHODS = methods(("hard", *MAP_NAMES), resolution=128)
ULP = 2.0**-52
# Off the ceiling, into the room where positive: an ulp of the light's height, and half of what is
# kept of it in `f32`.
OFFSETS = (0.0, 2 * ULP, -2 * ULP, 1e-7, -1e-7)
POSES = {
    "ceiling": (0.0, (0, 0, 1)),
    "wall": (np.pi / 2, (1, 0, 0)),
    "roof": (0.7, (1, 0.4, 0.2)),
    "slope": (0.3, (0, 1, 1)),
}
UNDER, BESIDE = (0.05, 0.02, 0.0), (0.9, -0.8, 0.0)
WALL = (0.98, 0.3, 1.5)
"""Above the table, from where the lamp is seen at a slant: `ssoc` lost all of it."""


def _rect(center, turn):
    return ss.RectLight(turn(center), turn((0, 0.5, 0)), turn((0.5, 0, 0)))


def _disk(center, turn):
    return ss.DiskLight(turn(center), turn((0, 0, -1)), 0.25)


SHAPES = {"rect": _rect, "disk": _disk}


def _room(pose, walls, pieces):
    rotation = rotation_matrix(*POSES[pose])[:3, :3]

    def turn(p):
        return np.asarray(p, dtype=np.float64) @ rotation.T

    scene = ss.Scene()

    def add(name, vertices, faces):
        scene.add((turn(vertices), faces), name)

    add("floor", *quad((0, 0, 0), (2, 0, 0), (0, 2, 0)))
    add("table", *quad((0, 0, 1), (0.6, 0, 0), (0, 0.6, 0)))
    # In pieces, so that rounding tilts each its own way.
    for i in range(pieces):
        for j in range(pieces):
            side = 2 / pieces
            center = ((i + 0.5) * side - 1, (j + 0.5) * side - 1, 2)
            add(f"ceiling {i} {j}", *quad(center, (side, 0, 0), (0, side, 0)))
    if walls:
        for i, (x, y) in enumerate([(1, 0), (0, 1), (-1, 0), (0, -1)]):
            add(f"wall {i}", *quad((x, y, 1), (2 * y, 2 * x, 0), (0, 0, 2)))
    return scene, turn


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("method", POINT_METHODS)
def test_points_under_the_table_are_dark_and_others_lit(method, pose, shape):
    for walls, pieces in [(False, 1), (True, 3)]:
        scene, turn = _room(pose, walls, pieces)
        points, normals = turn([UNDER, BESIDE, WALL]), turn([(0, 0, 1), (0, 0, 1), (-1, 0, 0)])
        for offset in OFFSETS:
            light = SHAPES[shape]((0, 0, 2 - offset), turn)
            seen = ss.visibility(scene, points, normals, light, POINT_METHODS[method])
            assert seen.tolist() == [0, 1, 1], (walls, pieces, offset)


@pytest.mark.parametrize("method", ["ray_traced", *POINT_METHODS.values()])
def test_a_ceiling_clearly_before_the_light_hides_all_of_it(method):
    scene, turn = _room("ceiling", True, 1)
    light = _rect((0, 0, 2 + 1e-5), turn)
    points = [UNDER, BESIDE]
    assert ss.visibility(scene, points, [(0, 0, 1)] * 2, light, method).tolist() == [0, 0]
