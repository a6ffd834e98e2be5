"""What the tests of single sample soft shadows share: lights, meshes and points."""

from __future__ import annotations

import numpy as np
import softshadow as ss
from shapes import quad

GROUND = quad((0, 0, 0), (8, 0, 0), (0, 8, 0))
LIGHTS = {
    "sphere": ss.SphereLight((0.1, 0.2, 3), 0.3),
    "disk": ss.DiskLight((0.1, 0.2, 3), (0.1, 0, -1), 0.3),
    "rect": ss.RectLight((0.1, 0.2, 3), (0, 0.5, 0), (0.6, 0.1, 0)),
}
POINT = ss.SphereLight((0.1, 0.2, 3), 0.0)


def grid(center, u, v, n):
    """A parallelogram of ``2 n**2`` triangles."""
    c, u, v = (np.asarray(x, dtype=np.float64) for x in (center, u, v))
    a = np.linspace(-0.5, 0.5, n + 1)
    vertices = c + a[:, None, None] * u + a[None, :, None] * v
    i = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (x.ravel() for x in (i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]))
    return vertices.reshape(-1, 3), np.concatenate(
        [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    )


def floor_points(n=201, half=2.0):
    """Points of a square grid on the ground, and their normals."""
    x = np.linspace(-half, half, n)
    x, y = np.meshgrid(x, x)
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    return points, np.broadcast_to((0.0, 0.0, 1.0), points.shape)


def scene_of(*meshes):
    scene = ss.Scene()
    for i, mesh in enumerate(meshes):
        scene.add(mesh, f"mesh {i}")
    return scene


def solids(size=160):
    return ss.scenes.closed_solids(size, size, "sphere", 0.4, detail=3)
