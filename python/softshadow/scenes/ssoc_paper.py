"""The scenes of "The Soft Shadow Occlusion Camera", as near as models allow.

Mo, Popescu and Wyman, Pacific Graphics 2007: a bunny, models with a sphere, an aircraft, two
teapots (Figures 10 to 12), and a fork, at which the method fails (Figure 13). Their models are
known from the pictures and their numbers of triangles. All are z-up, near unit size and near the
origin. Lights are given by the radius of the paper's spheres, which are 0, 0.1 and 0.3 there.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from softshadow.camera import Camera
from softshadow.scene import Scene
from softshadow.scenes.models import stanford_bunny
from softshadow.scenes.staging import (
    PLANE_ALBEDO,
    LightKind,
    Setup,
    light_towards,
    square,
    with_normals_outwards,
)
from softshadow.scenes.wedges_paper import teapot, tube

__all__ = ["aircraft", "bunny_and_sphere", "fork", "two_teapots"]

_LIGHT = (0.9, -0.7, 2.6)

# More than twice the size of what casts from its middle.
_FAR_LIGHT = (1.2, -0.9, 3.3)


def aircraft(
    width: int = 512,
    height: int = 512,
    light: LightKind = "sphere",
    radius: float = 0.1,
    close: bool = False,
) -> Setup:
    """Return an aircraft of about 4,500 triangles over a ground plane (Figure 10).

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    radius : float
        Half its edge or diameter, world units.
    close : bool
        Look closely at a part of the shadow, with the light at more than twice the size of what
        casts: penumbrae of a radius of 0.1 then cover more than 15 % of the picture.

    Returns
    -------
    Setup
    """
    t = np.linspace(0.0, 1.0, 33)
    # A pointed nose, a body, and a narrower tail.
    thick = 0.075 * np.minimum(1.0, 3.0 * t) ** 0.6 * (1.0 - 0.55 * np.clip(2 * t - 1, 0, 1))
    body = tube(np.column_stack([1.2 * t - 0.6, 0 * t, 0 * t]), np.maximum(thick, 1e-3), 64)
    body.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 0, 1)))
    wings = [
        _blade([(0.0, -0.1), (0.62, 0.18), (0.62, 0.3), (0.0, 0.34)], 0.02),
        _blade([(0.0, 0.4), (0.26, 0.5), (0.26, 0.58), (0.0, 0.58)], 0.014),
    ]
    sides = [w for wing in wings for w in (wing, wing.copy().apply_scale((-1, 1, 1)))]
    fin = _blade([(0.02, 0.36), (0.3, 0.54), (0.3, 0.6), (0.02, 0.6)], 0.016)
    fin.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (0, 1, 0)))
    plane = trimesh.util.concatenate([body, *sides, fin])
    plane.apply_transform(trimesh.transformations.rotation_matrix(np.radians(8), (1, 0.4, 0)))
    plane.apply_translation((0, 0, 0.5))
    scene = _over_ground()
    scene.add(plane, name="aircraft", albedo=(0.6, 0.65, 0.7))
    close_up = ((-0.22, -0.16, 0.0), 7.7) if close else None
    return _staged(scene, width, height, light, radius, close_up)


def bunny_and_sphere(
    width: int = 512,
    height: int = 512,
    light: LightKind = "sphere",
    radius: float = 0.1,
    close: bool = False,
) -> Setup:
    """Return the Stanford bunny beside a sphere that floats (Figure 11's models with spheres).

    Parameters
    ----------
    width, height, light, radius, close
        As of `aircraft`.

    Returns
    -------
    Setup

    Raises
    ------
    FileNotFoundError
        If the model is not installed.
    """
    vertices, faces = stanford_bunny()
    scene = _over_ground()
    scene.add((0.8 * vertices - [0.2, 0, 0], faces), name="bunny", albedo=(0.8, 0.75, 0.7))
    ball = trimesh.creation.icosphere(4, 0.16).apply_translation((0.45, -0.25, 0.65))
    scene.add(ball, name="sphere", albedo=(0.5, 0.6, 0.8))
    close_up = ((-0.77, 0.18, 0.0), 9.8) if close else None
    return _staged(scene, width, height, light, radius, close_up)


def two_teapots(
    width: int = 512,
    height: int = 512,
    light: LightKind = "sphere",
    radius: float = 0.1,
    close: bool = False,
) -> Setup:
    """Return two teapots, one shading the other (Table 1: 13,000 triangles).

    Parameters
    ----------
    width, height, light, radius, close
        As of `aircraft`.

    Returns
    -------
    Setup
    """
    scene = _over_ground()
    for name, x, y, turn in [("near", 0.32, -0.25, 200.0), ("far", -0.28, 0.2, 30.0)]:
        pot = teapot(64).apply_scale(1.25)
        turned = trimesh.transformations.rotation_matrix(np.radians(turn), (0, 0, 1))
        pot.apply_transform(turned).apply_translation((x, y, 0))
        scene.add(pot, name=name, albedo=(0.5, 0.7, 0.5))
    close_up = ((-0.25, -0.3, 0.0), 3.7) if close else None
    return _staged(scene, width, height, light, radius, close_up)


def fork(
    width: int = 512, height: int = 512, light: LightKind = "sphere", radius: float = 0.1
) -> Setup:
    """Return a fork over a ground plane: penumbrae of its tines meet in the maps (Figure 13).

    Parameters
    ----------
    width, height, light, radius
        As of `aircraft`.

    Returns
    -------
    Setup
    """
    parts = []
    for k in range(4):
        x = 0.06 * (k - 1.5)
        parts.append(
            _blade([(x - 0.012, 0.1), (x + 0.012, 0.1), (x + 0.008, 0.6), (x, 0.6)], 0.024)
        )
    parts.append(_blade([(-0.105, -0.04), (0.105, -0.04), (0.102, 0.1), (-0.102, 0.1)], 0.024))
    parts.append(_blade([(-0.03, -0.6), (0.03, -0.6), (0.02, -0.04), (-0.02, -0.04)], 0.024))
    scene = _over_ground()
    tines = trimesh.util.concatenate(parts).apply_translation((0, 0, 0.35))
    scene.add(tines, name="fork", albedo=(0.7, 0.7, 0.75))
    return _staged(scene, width, height, light, radius)


def _blade(outline: npt.ArrayLike, thick: float) -> trimesh.Trimesh:
    """Return a convex outline in the plane z = 0, as thick as that."""
    flat = np.asarray(outline, dtype=np.float64)
    n = len(flat)
    low, high = (np.column_stack([flat, np.full(n, z)]) for z in (-thick / 2, thick / 2))
    fan = np.array([[0, i, i + 1] for i in range(1, n - 1)])
    side = np.arange(n)
    after = (side + 1) % n
    walls = [
        np.column_stack([side, after, after + n]),
        np.column_stack([side, after + n, side + n]),
    ]
    mesh = trimesh.Trimesh(
        np.vstack([low, high]), np.vstack([fan[:, ::-1], fan + n, *walls]), process=False
    )
    return with_normals_outwards(mesh)


def _over_ground() -> Scene:
    scene = Scene()
    scene.add(square(2.5), name="ground", albedo=PLANE_ALBEDO)
    return scene


def _staged(
    scene: Scene,
    width: int,
    height: int,
    light: LightKind,
    radius: float,
    close_up: tuple[tuple[float, float, float], float] | None = None,
) -> Setup:
    """Return a scene with the camera and the light that all of them share, or a close view.

    `close_up` is where that looks, and its field of view in degrees.
    """
    target, fov_deg = close_up or ((-0.15, 0.1, 0.2), 38.0)
    center = _FAR_LIGHT if close_up else _LIGHT
    camera = Camera((-0.2, -2.2, 2.0), target, (0, 0, 1), fov_deg, width, height)
    return Setup(scene, camera, light_towards(light, center, 2 * radius, (0, 0, 0.4)))
