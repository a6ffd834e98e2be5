"""Scenes in which shadow maps go wrong, each in a way of its own, after Xie et al. 2007, Section 6.

Small, z-up, near unit size and near the origin.
"""

from __future__ import annotations

import math

import trimesh

from softshadow.camera import Camera
from softshadow.scene import Scene
from softshadow.scenes.staging import PLANE_ALBEDO, LightKind, Setup, light_towards, square

__all__ = ["ball", "oblique_board", "stacked_boards", "standing_cylinder"]


def oblique_board(
    width: int = 512,
    height: int = 512,
    light: LightKind = "rect",
    light_size: float = 0.8,
    turn_deg: float = 80.0,
) -> Setup:
    """Return a board over a ground plane that the light sees nearly from its edge (Figure 3a, 3b).

    Neighbouring texels of a map see it at depths far apart: where they are taken as apart, light
    leaks through.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light, above the board.
    light_size : float
        Its edge or diameter, world units.
    turn_deg : float
        Angle between the board and the horizontal, degrees.

    Returns
    -------
    Setup
    """
    scene = _over_ground()
    turn = trimesh.transformations.rotation_matrix(math.radians(turn_deg), (0, 1, 0))
    board = trimesh.Trimesh(*square(0.4)).apply_transform(turn).apply_translation((0, 0, 0.6))
    scene.add(board, name="board", albedo=(0.8, 0.75, 0.65))
    return _staged(scene, width, height, light, light_size)


def standing_cylinder(
    width: int = 512,
    height: int = 512,
    light: LightKind = "rect",
    light_size: float = 0.8,
    sections: int = 64,
) -> Setup:
    """Return a cylinder that stands on a ground plane: its shadow begins where it touches.

    Its axis is the z axis, its radius 0.25, its height 0.5.

    Parameters
    ----------
    width, height, light, light_size
        As of `oblique_board`.
    sections : int
        Its sides.

    Returns
    -------
    Setup
    """
    scene = _over_ground()
    mesh = trimesh.creation.cylinder(0.25, 0.5, sections=sections)
    scene.add(mesh.apply_translation((0, 0, 0.25)), name="cylinder", albedo=(0.4, 0.5, 0.8))
    return _staged(scene, width, height, light, light_size)


def ball(
    width: int = 512,
    height: int = 512,
    light: LightKind = "rect",
    light_size: float = 0.8,
    detail: int = 4,
) -> Setup:
    """Return a ball over a ground plane: a curved surface must not shadow its own lit side.

    Parameters
    ----------
    width, height, light, light_size
        As of `oblique_board`.
    detail : int
        Subdivisions: the ball has ``20 · 4**detail`` triangles.

    Returns
    -------
    Setup
    """
    scene = _over_ground()
    mesh = trimesh.creation.icosphere(detail, 0.4).apply_translation((0, 0, 0.45))
    scene.add(mesh, name="ball", albedo=(0.8, 0.4, 0.3))
    return _staged(scene, width, height, light, light_size)


def stacked_boards(
    width: int = 512,
    height: int = 512,
    light: LightKind = "rect",
    light_size: float = 1.6,
    boards: int = 5,
) -> Setup:
    """Return boards one under the other, the lowest the widest and close to the ground (Figure 3c).

    Seen from the light's centre, the upper ones hide most of the lowest: a map with fewer layers
    than boards has a hole there, through which the light's rim shines on the ground.

    Parameters
    ----------
    width, height, light, light_size
        As of `oblique_board`.
    boards : int
        How many, at least 1.

    Returns
    -------
    Setup
    """
    scene = _over_ground()
    for k in range(boards):
        lowest = k == boards - 1
        high = 0.15 if lowest else 1.4 - 0.7 * k / max(1, boards - 2)
        scene.add(square(0.5 if lowest else 0.25, high), name=f"board {k}", albedo=0.6)
    return _staged(scene, width, height, light, light_size)


def _over_ground() -> Scene:
    scene = Scene()
    scene.add(square(2.5), name="ground", albedo=PLANE_ALBEDO)
    return scene


def _staged(scene: Scene, width: int, height: int, light: LightKind, size: float) -> Setup:
    """Return a scene with the camera and the light, straight above, that all of them share."""
    camera = Camera((0.3, -2.8, 1.6), (0.0, 0.0, 0.2), (0, 0, 1), 34.0, width, height)
    return Setup(scene, camera, light_towards(light, (0.05, 0.03, 2.4), size, (0.05, 0.03, 0)))
