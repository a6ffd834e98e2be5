"""What hard cases are built from: grounds, boards, boxes, and lights of all shapes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from softshadow.camera import Camera
from softshadow.light import Light
from softshadow.scene import Scene
from softshadow.scenes.staging import PLANE_ALBEDO, LightKind, Setup, light_towards, square

__all__ = ["CENTER", "MeshData", "board", "box", "lit", "over_ground", "view"]

MeshData = tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]

CENTER = (0.5, -0.3, 2.0)
"""Of most lights: no edge through two corners of a scene meets it by chance."""


def board(center: npt.ArrayLike, edge_u: npt.ArrayLike, edge_v: npt.ArrayLike) -> MeshData:
    """Return a parallelogram of two triangles; its normal is ``edge_u x edge_v``."""
    c, u, v = (np.asarray(x, dtype=np.float64) for x in (center, edge_u, edge_v))
    corners = np.array([c - u / 2 - v / 2, c + u / 2 - v / 2, c + u / 2 + v / 2, c - u / 2 + v / 2])
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def box(size: npt.ArrayLike, center: npt.ArrayLike, turn_deg: float = 0.0) -> MeshData:
    """Return a box, turned about the z axis."""
    mesh = trimesh.creation.box(size)
    turn = trimesh.transformations.rotation_matrix(np.radians(turn_deg), (0, 0, 1))
    mesh.apply_transform(turn).apply_translation(center)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64)


def over_ground(*meshes: MeshData, half: float = 2.5) -> Scene:
    """Return a scene of a ground, and of meshes over it."""
    scene = Scene()
    scene.add(square(half), name="ground", albedo=PLANE_ALBEDO)
    for mesh in meshes:
        scene.add(mesh, albedo=(0.8, 0.6, 0.4))
    return scene


def view(width: int, height: int) -> Camera:
    """Return the camera of most cases."""
    return Camera((0.3, -2.4, 1.9), (-0.1, 0.1, 0.15), (0, 0, 1), 36.0, width, height)


def lit(
    scene: Scene,
    camera: Camera,
    center: npt.ArrayLike = CENTER,
    size: float = 0.4,
    kinds: tuple[LightKind, ...] = ("rect",),
    aim: npt.ArrayLike | None = None,
) -> Setup:
    """Return a setup with a light of each kind, which faces down or where it is aimed."""
    c = np.asarray(center, dtype=np.float64)
    to = c - [0.0, 0.0, c[2]] if aim is None else aim
    lights: list[Light] = [light_towards(kind, c, size, to) for kind in kinds]
    return Setup(scene, camera, lights[0], more_lights=tuple(lights[1:]))
