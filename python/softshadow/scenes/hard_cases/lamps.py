"""Cases whose light is hard: in a wall's plane, in a housing, pierced, far away, too large."""

from __future__ import annotations

import numpy as np
import trimesh

from softshadow.camera import Camera
from softshadow.light import DiskLight, Light, RectLight, SphereLight
from softshadow.scene import Scene
from softshadow.scenes.hard_cases.stage import (
    CENTER,
    MeshData,
    board,
    box,
    lit,
    over_ground,
    view,
)
from softshadow.scenes.staging import LightKind, Setup

__all__ = [
    "caster_at_the_light",
    "closed_housing",
    "flush_lamp",
    "flush_lamp_in_a_roof",
    "grazing_light",
    "lamp_in_a_room",
    "large_light",
    "open_housing",
    "pierced_light",
    "sun",
    "terminator",
    "wall_by_the_light",
]


def _room(width: int, height: int, axis: tuple[float, float, float], angle: float) -> Setup:
    """Return a room with a table and lamps in its ceiling, turned as a whole.

    The ceiling is in pieces, so that rounding tilts each its own way.
    """
    turn = trimesh.transformations.rotation_matrix(angle, axis)[:3, :3]
    meshes = [board((0, 0, 0), (2, 0, 0), (0, 2, 0)), board((0, 0, 1), (0.6, 0, 0), (0, 0.6, 0))]
    meshes += [board((x, y, 2), (1, 0, 0), (0, 1, 0)) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
    meshes += [
        board((x, y, 1), (2 * y, 2 * x, 0), (0, 0, 2))
        for x, y in [(1, 0), (0, 1), (-1, 0), (0, -1)]
    ]
    scene = Scene()
    for vertices, faces in meshes:
        scene.add((vertices @ turn.T, faces))
    # Behind the ceiling by half of what single precision keeps of its height.
    center = turn @ (0, 0, 2 + 1e-7)
    rect = RectLight(center, turn @ (0, 0.5, 0), turn @ (0.5, 0, 0))
    disk = DiskLight(center, turn @ (0, 0, -1), 0.25)
    eye, target, up = turn @ (0.3, -0.8, 0.5), turn @ (0, 0, 0), turn @ (0, 0, 1)
    camera = Camera(eye, target, up, 90.0, width, height)
    return Setup(scene, camera, rect, more_lights=(disk,))


def flush_lamp(width: int, height: int) -> Setup:
    """Return a room with lamps in the plane of its ceiling."""
    return _room(width, height, (0, 0, 1), 0.0)


def flush_lamp_in_a_roof(width: int, height: int) -> Setup:
    """Return the room of `flush_lamp`, turned so that no coordinate of a plane is round."""
    return _room(width, height, (1, 0.4, 0.2), 0.7)


def _by_the_light(width: int, height: int, mesh: MeshData, kinds: tuple[LightKind, ...]) -> Setup:
    scene = over_ground(mesh, half=2.0)
    camera = Camera((0, -1.8, 1.2), (0, 0.5, 0), (0, 0, 1), 60.0, width, height)
    return lit(scene, camera, (0, 0, 2), 0.2, kinds)


def wall_by_the_light(width: int, height: int) -> Setup:
    """Return a wall beside a light, as high above it as below."""
    return _by_the_light(width, height, board((0, 0.2, 2), (1, 0, 0), (0, 0, 1)), ("disk",))


def open_housing(width: int, height: int) -> Setup:
    """Return lights in a box that is open below."""
    vertices, faces = box((1.0, 0.4, 1.0), (0, 0, 2))
    above = vertices[faces][..., 2].max(axis=1) > 1.5
    return _by_the_light(width, height, (vertices, faces[above]), ("rect", "sphere"))


def closed_housing(width: int, height: int) -> Setup:
    """Return a light in a closed box."""
    return _by_the_light(width, height, box((1.0, 0.4, 1.0), (0, 0, 2)), ("sphere",))


def pierced_light(width: int, height: int) -> Setup:
    """Return a board through the middle of the lights."""
    x, y, z = CENTER
    wall = board((x, y, z - 0.3), (0.03, 0.9, 0), (0, 0, 1.2))
    return lit(over_ground(wall), view(width, height), kinds=("disk", "sphere"))


def caster_at_the_light(width: int, height: int) -> Setup:
    """Return a triangle with one corner within a tenth of the lights' centre."""
    corners = np.array(CENTER) + np.array([(0, 0, -0.1), (0.15, -0.1, -1.2), (-0.2, 0.25, -1.2)])
    triangle = corners, np.array([[0, 1, 2]])
    return lit(over_ground(triangle), view(width, height))


def large_light(width: int, height: int) -> Setup:
    """Return casters that are far smaller than the lights, and have no umbra on the ground."""
    post = box((0.12, 0.12, 0.5), (-0.3, 0.0, 0.25), 20.0)
    tile = box((0.3, 0.3, 0.04), (0.3, 0.1, 0.35), 35.0)
    camera = Camera((0.3, -2.4, 1.9), (0.0, 0.05, 0.15), (0, 0, 1), 24.0, width, height)
    return lit(over_ground(post, tile), camera, size=1.6, kinds=("rect", "sphere"))


def grazing_light(width: int, height: int) -> Setup:
    """Return a board over a ground that the lights see under a few degrees."""
    tile = board((0, 0, 0.4), (0.3, 0, 0), (0, 0.3, 0))
    camera = Camera((-0.4, -3.6, 2.4), (-0.4, 0, 0), (0, 0, 1), 50.0, width, height)
    center, aim = (2.5, 0.3, 0.7), (0.0, 0.3, 0.075)
    return lit(over_ground(tile, half=3.0), camera, center, 0.4, ("disk", "sphere"), aim)


def terminator(width: int, height: int) -> Setup:
    """Return a lying cylinder, on which a light sets, under a rod."""
    lying = trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0))
    round_ = trimesh.creation.cylinder(0.4, 1.4, sections=48).apply_transform(lying)
    round_.apply_translation((0, 0, 0.4))
    rod = box((0.1, 1.2, 0.05), (0.1, 0.0, 1.0), 25.0)
    meshes = (np.asarray(round_.vertices), np.asarray(round_.faces, dtype=np.int64)), rod
    camera = Camera((0.3, -1.1, 2.5), (0, 0, 0.35), (0, 0, 1), 38.0, width, height)
    center, aim = (0.3, 2.2, 1.2), (0, 0, 0.4)
    return lit(over_ground(*meshes), camera, center, 0.6, ("sphere",), aim)


def lamp_in_a_room(width: int, height: int) -> Setup:
    """Return a light in the middle of a room, with boards on all sides of it."""
    scene = Scene()
    for axis in range(3):
        for sign in (-1, 1):
            u, v = np.roll(np.eye(3), -axis - 1, axis=0)[:2]
            out = sign * np.eye(3)[axis]
            scene.add(board(2 * out, 4 * u, 4 * v), name=f"wall {axis} {sign}")
            scene.add(board(0.8 * out, 0.5 * u, 0.7 * v), name=f"board {axis} {sign}")
    camera = Camera((-1.9, -1.85, -1.8), (0.9, 0.8, 0.7), (0, 0, 1), 100.0, width, height)
    return Setup(scene, camera, SphereLight((0.05, 0.02, -0.03), 0.1, 20.0))


def sun(width: int, height: int) -> Setup:
    """Return lights a million times as far as the scene is large."""
    distance, sine = 1e6, 0.05
    to = np.array([0.5, 0.3, 0.8]) / np.linalg.norm([0.5, 0.3, 0.8])
    across = np.cross(to, (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across)
    radius = sine * distance
    center = distance * to
    rect = RectLight(center, 2 * radius * np.cross(to, across), 2 * radius * across, 100.0)
    more: tuple[Light, ...] = (
        DiskLight(center, -to - 0.8 * across, radius, 100.0),
        SphereLight(center, radius, 100.0),
    )
    body = trimesh.creation.torus(0.22, 0.09, major_sections=48, minor_sections=16)
    body.apply_transform(trimesh.transformations.rotation_matrix(1.1, (1, 0.4, 0)))
    body.apply_translation((0.4, 0, 0.35))
    ring = np.asarray(body.vertices), np.asarray(body.faces, dtype=np.int64)
    sheet = board((-0.3, 0.1, 0.45), (0.5, 0, 0), (0, 0.6, 0))
    camera = Camera((0.0, -2.2, 1.6), (-0.15, -0.1, 0.1), (0, 0, 1), 42.0, width, height)
    return Setup(over_ground(sheet, ring), camera, rect, more_lights=more)
