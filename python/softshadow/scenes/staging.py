"""What scenes are made of: `Setup`, a light that faces a point, a square.

All scenes build on it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt
import trimesh

from softshadow.camera import Camera
from softshadow.extras import needs
from softshadow.light import DiskLight, Light, RectLight, SphereLight
from softshadow.scene import Scene

LightKind: TypeAlias = Literal["rect", "disk", "sphere"]
"""The light's shape."""

PLANE_ALBEDO = (0.7, 0.7, 0.7)
"""Of grounds and receiving planes."""


@dataclass(frozen=True, eq=False)
class Setup:
    """What is needed to render.

    Attributes
    ----------
    scene : Scene
    camera : Camera
    light : RectLight, DiskLight, SphereLight or PolygonLight
        The light, or the first of several.
    visibility : callable, optional
        Where a closed form is known: from world positions, shape (..., 3), on the receiving plane
        to visibility, shape (...), float64.
    more_lights : tuple of lights
        The lights after the first.
    """

    scene: Scene
    camera: Camera
    light: Light
    visibility: Callable[[npt.ArrayLike], npt.NDArray[np.float64]] | None = None
    more_lights: tuple[Light, ...] = ()

    @property
    def lights(self) -> tuple[Light, ...]:
        """All lights, a sequence that `render` takes."""
        return (self.light, *self.more_lights)


def light_towards(kind: LightKind, center: npt.ArrayLike, size: float, aim: npt.ArrayLike) -> Light:
    """Return a light of width `size` at `center` that faces `aim`.

    Its radiance makes a white surface at `aim` that faces it reflect a radiance of about 1.

    Parameters
    ----------
    kind : {"rect", "disk", "sphere"}
    center : array_like, shape (3,)
        World position.
    size : float
        Edge or diameter, world units.
    aim : array_like, shape (3,)
        World position that it faces.

    Returns
    -------
    RectLight, DiskLight, SphereLight or PolygonLight

    Raises
    ------
    ValueError
        If `kind` is none of these.
    """
    c = np.asarray(center, dtype=np.float64)
    n = np.asarray(aim, dtype=np.float64) - c
    distance = float(np.linalg.norm(n))
    n /= distance
    area = size**2 if kind == "rect" else math.pi * size**2 / 4
    # A light without area has no irradiance at any radiance.
    radiance = math.pi * distance**2 / area if area > 0 else 1.0
    if kind == "sphere":
        return SphereLight(c, size / 2, radiance)
    if kind == "disk":
        return DiskLight(c, n, size / 2, radiance)
    if kind == "rect":
        u = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
        u *= size / np.linalg.norm(u)
        return RectLight(c, u, np.cross(n, u), radiance)
    raise ValueError(f"light: expected 'rect', 'disk' or 'sphere', got {kind!r}")


def square(half: float, z: float = 0.0) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Return a square with edge ``2 · half`` around the z axis, facing up.

    Parameters
    ----------
    half : float
        Half the edge, world units.
    z : float
        Its height, world units.

    Returns
    -------
    vertices : ndarray, shape (4, 3), float64
    faces : ndarray, shape (2, 3), int64
    """
    h = half
    vertices = np.array([[-h, -h, z], [h, -h, z], [h, h, z], [-h, h, z]])
    return vertices, np.array([[0, 1, 2], [0, 2, 3]])


def with_normals_outwards(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Turn a closed mesh's faces outwards, and return it."""
    with needs("scenes", "this scene"):
        mesh.fix_normals()
    return mesh
