"""Cases with a closed form: a half-plane, an eclipse, a closed housing."""

from __future__ import annotations

import functools

import numpy as np
import numpy.typing as npt

from softshadow.camera import Camera
from softshadow.light import SphereLight
from softshadow.render import Image
from softshadow.scene import Scene
from softshadow.scenes.basic import half_plane
from softshadow.scenes.staging import PLANE_ALBEDO, LightKind, Setup, light_towards, square

__all__ = ["eclipse", "eclipse_visibility", "edge", "edge_visibility", "nothing"]

_Array = npt.NDArray[np.float64]

_KINDS: tuple[LightKind, ...] = ("rect", "disk", "sphere")


def edge(width: int, height: int) -> Setup:
    """Return a half-plane under lights of all shapes."""
    first, *others = (half_plane(width, height, kind) for kind in _KINDS)
    lights = tuple(setup.light for setup in others)
    return Setup(first.scene, first.camera, first.light, more_lights=lights)


def edge_visibility(image: Image) -> _Array:
    """Return the closed form of `edge` on the receiver."""
    known = [half_plane(1, 1, kind).visibility for kind in _KINDS]
    seen = np.stack([f(image.position) for f in known if f is not None])
    return np.where(image.mesh_id == 0, seen, np.nan)


_LIGHT, _LIGHT_RADIUS = np.array([0.0, 0.0, 2.0]), 0.25
_BALLS = np.array([[-0.25, 0.0, 1.0], [0.3, 0.1, 0.9]])
_RADII = np.array([0.2, 0.08])


def eclipse(width: int, height: int) -> Setup:
    """Return two analytic balls before a sphere light: one covers it, one is smaller than it."""
    scene = Scene()
    scene.add(square(2.0), name="ground", albedo=PLANE_ALBEDO)
    scene.add_spheres(_BALLS, _RADII, name="balls", albedo=(0.8, 0.6, 0.4))
    camera = Camera((0.0, -1.7, 1.3), (0.0, 0.05, 0.2), (0, 0, 1), 46.0, width, height)
    light = light_towards("sphere", _LIGHT, 2 * _LIGHT_RADIUS, (0, 0, 0))
    assert isinstance(light, SphereLight)
    return Setup(scene, camera, light)


def eclipse_visibility(image: Image) -> _Array:
    """Return the closed form of `eclipse` on the ground: caps of directions that overlap.

    No point of the ground sees the balls' caps overlap each other.
    """
    p = image.position
    to_light = _LIGHT - p
    distance = np.linalg.norm(to_light, axis=-1)
    alpha = np.arcsin(_LIGHT_RADIUS / distance)
    seen = np.ones(distance.shape)
    for center, radius in zip(_BALLS, _RADII, strict=True):
        to_ball = center - p
        away = np.linalg.norm(to_ball, axis=-1)
        # The sine's, which is exact for small angles, of vectors that are nearly parallel.
        cross = np.linalg.norm(np.cross(to_light, to_ball), axis=-1)
        between = np.arctan2(cross, np.einsum("...i,...i", to_light, to_ball))
        beta = np.arcsin(np.minimum(radius / away, 1.0))
        seen -= _overlap(alpha, beta, between) / (2 * np.pi * (1 - np.cos(alpha)))
    return np.where(image.mesh_id == 0, seen, np.nan)[None]


def _overlap(a: _Array, b: _Array, d: _Array) -> _Array:
    """Return the solid angle of the lens of two caps of half-angles a and b, d apart.

    Mazonka, "Solid Angle of Conical Surfaces, Polyhedral Cones, and Intersecting Spherical Caps",
    arXiv:1205.1396, 2012.
    """
    less = 2 * np.pi * (1 - np.cos(np.minimum(a, b)))
    c = np.clip(d, np.abs(a - b), a + b)  # elsewhere one is in the other, or they do not meet

    def angle(top: _Array, bottom: _Array) -> _Array:
        return np.arccos(np.clip(top / np.maximum(bottom, 1e-300), -1.0, 1.0))

    at_lens = angle(np.cos(c) - np.cos(a) * np.cos(b), np.sin(a) * np.sin(b))
    at_a = angle(np.cos(b) - np.cos(c) * np.cos(a), np.sin(c) * np.sin(a))
    at_b = angle(np.cos(a) - np.cos(c) * np.cos(b), np.sin(c) * np.sin(b))
    lens = 2 * (np.pi - at_lens - at_a * np.cos(a) - at_b * np.cos(b))
    return np.where(d >= a + b, 0.0, np.where(d <= np.abs(a - b), less, lens))


def _everywhere(image: Image, value: float) -> _Array:
    return np.full(image.visibility.shape, value)


nothing = functools.partial(_everywhere, value=0.0)
"""The closed form of what is shut off from all light."""
