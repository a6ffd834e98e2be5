"""Cases whose layout is hard: contact, overlaps, extreme sizes, awkward cameras."""

from __future__ import annotations

import numpy as np

from softshadow.camera import Camera
from softshadow.light import RectLight
from softshadow.scene import Scene
from softshadow.scenes.hard_cases.stage import board, box, lit, over_ground, view
from softshadow.scenes.map_artifacts import oblique_board, stacked_boards
from softshadow.scenes.staging import PLANE_ALBEDO, Setup, square
from softshadow.scenes.wedges_paper import overlapping_boards

__all__ = [
    "behind_the_camera",
    "contact",
    "crossing_penumbrae",
    "eye_on_a_board",
    "fused_boards",
    "huge_ground",
    "oblique_board",
    "stacked_boards",
    "tiny_and_far",
    "waves",
]


def contact(width: int, height: int) -> Setup:
    """Return a box that stands on the ground, and one that leans through it."""
    standing = box((0.4, 0.35, 0.3), (-0.3, 0.0, 0.15), 20.0)
    sunk, faces = box((0.3, 0.3, 0.8), (0.0, 0.0, 0.0))
    lean = np.array([[0.9, 0, 0.436], [0, 1, 0], [-0.436, 0, 0.9]])
    leaning = sunk @ lean.T + (0.45, 0.1, 0.1), faces
    return lit(over_ground(standing, leaning), view(width, height), (0.9, -0.9, 1.6), 0.4)


def crossing_penumbrae(width: int, height: int) -> Setup:
    """Return two boards whose penumbrae cross, and all but coincide at one end."""
    return overlapping_boards(width, height, "sphere", 0.5)


def fused_boards(width: int, height: int) -> Setup:
    """Return two boards that hide a half of the light each, which together is all of it."""
    lower = board((-0.6, 0.1, 0.5), (1.2, 0, 0), (0, 0.9, 0))
    upper = board((0.6, 0.1, 1.0), (1.2, 0, 0), (0, 0.9, 0))
    camera = Camera((0.0, -2.0, 0.62), (0.0, 0.3, 0.0), (0, 0, 1), 44.0, width, height)
    return lit(over_ground(lower, upper), camera, (0, 0, 2.4), 1.0)


def behind_the_camera(width: int, height: int) -> Setup:
    """Return a box behind the camera, whose shadow alone is seen."""
    caster = box((0.6, 0.5, 0.4), (0.0, -1.9, 1.3), 20.0)
    camera = Camera((0.0, -0.9, 1.0), (0.0, 0.5, 0.0), (0, 0, 1), 60.0, width, height)
    return lit(over_ground(caster), camera, (0.1, -3.6, 2.8), 0.5, ("disk",), (0, -1.9, 1.3))


def eye_on_a_board(width: int, height: int) -> Setup:
    """Return a board on which the eye lies, in the plane of the shadow's side."""
    tile = board((0.0, -0.6, 0.75), (1.0, 0, 0), (0, 0.8, 0))
    block = box((0.4, 0.3, 0.5), (0.1, 0.5, 0.25), 20.0)
    eye = (0.1, -0.2, 0.75)  # on the edge that looks at the block
    camera = Camera(eye, (0.0, 0.45, 0.1), (0, 0, 1), 80.0, width, height)
    return lit(over_ground(tile, block), camera, (0.1, -0.9, 3.0), 0.4)


def huge_ground(width: int, height: int) -> Setup:
    """Return a box of one unit on a ground of a hundred thousand."""
    scene = Scene()
    scene.add(square(1e5), name="ground", albedo=PLANE_ALBEDO)
    scene.add(box((1, 1, 1), (0, 0, 0.7)), albedo=(0.8, 0.6, 0.4))
    camera = Camera((-1, -4.5, 4), (-0.2, 0, 0.3), (0, 0, 1), 30.0, width, height)
    return lit(scene, camera, (0.7, 0, 4), 0.8, ("sphere",))


def tiny_and_far(width: int, height: int) -> Setup:
    """Return a scene of a millionth of a unit, ten thousand of its sizes from the origin."""
    scale, move = 1e-6, np.array([1e-2, -0.8e-2, 0.6e-2])
    scene = Scene()
    meshes = [
        board((0, 0, 0), (5, 0, 0), (0, 5, 0)),
        box((0.4, 0.3, 0.3), (-0.3, 0.0, 0.5), 20.0),
        box((0.3, 0.3, 0.5), (0.35, 0.1, 0.25), 35.0),
    ]
    for vertices, faces in meshes:
        scene.add((scale * vertices + move, faces))

    def at(p: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = scale * np.array(p) + move
        return float(x), float(y), float(z)

    camera = Camera(at((0.3, -2.4, 1.9)), at((-0.1, 0.1, 0.15)), (0, 0, 1), 36.0, width, height)
    light = RectLight(at((0.5, -0.3, 2.0)), (0, 0.4 * scale, 0), (0.4 * scale, 0, 0))
    return Setup(scene, camera, light)


def waves(width: int, height: int) -> Setup:
    """Return a slab's edge before a ground of waves, as the light sees it."""
    x = np.linspace(-3, 3, 240)
    z = 0.06 * np.sin(12 * x)
    left, right = (np.column_stack([x, np.full_like(x, y), z]) for y in (-1.5, 1.5))
    i, n = np.arange(len(x) - 1), len(x)
    faces = np.concatenate(
        [np.column_stack([i, i + 1, n + i + 1]), np.column_stack([i, n + i + 1, n + i])]
    )
    scene = Scene()
    scene.add((np.concatenate([left, right]), faces), name="waves", albedo=PLANE_ALBEDO)
    scene.add(board((-0.9, 0, 1.3), (1.8, 0, 0), (0, 1.6, 0)), name="slab", albedo=0.6)
    camera = Camera((-2.2, -3, 1), (-0.3, 0, 0.2), (0, 0, 1), 40.0, width, height)
    return lit(scene, camera, (0.0, 0.1, 3.2), 0.7, ("sphere",))
