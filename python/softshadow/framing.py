"""A camera, a light and a ground plane for a scene that comes with none; z points up."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from softshadow.camera import Camera
from softshadow.light import RectLight
from softshadow.scene import Scene

__all__ = ["add_ground", "camera_for", "frame", "light_for"]

_VIEW = (-60.0, 30.0)
"""Azimuth (from +x towards +y) and elevation of the camera, degrees: a three-quarter view."""

_LIGHT = (-12.0, 42.0)
"""Azimuth and elevation of the light, degrees: from the right of the camera, so that the sides that
are seen are lit and the shadow falls to the left, where it is seen, too."""

_LIGHT_DISTANCE = 5.0
"""In radii of the bounding sphere: near enough for a penumbra that is seen to widen."""

_LIGHT_SIZE = 1.0 / 5.0
"""Edge of the square light over its distance."""

_MARGIN = 1.4
"""How much larger than the bounding sphere the view is: the shadow lies outside of it."""

_AIM = 0.4
"""How far from the scene's middle towards the shadow the camera looks, in radii; with the margin
the bounding sphere just stays in the view."""

_GROUND_SIZE = 4.0
"""Side of the ground over the largest side of the scene's bounds."""

_GROUND_GAP = 1e-4
"""How far the ground is below the scene, over the same: a model's own floor (a city's, a flat
card) would otherwise flicker through it. A tenth of a pixel in a picture 1000 pixels wide."""


def frame(
    scene: Scene, fov_y_deg: float = 45.0, width: int = 512, height: int = 512
) -> tuple[Camera, RectLight]:
    """Return a camera and a light that show a scene and its shadow.

    Call it before a ground is added: the bounds decide.

    Parameters
    ----------
    scene : Scene
    fov_y_deg, width, height
        As in `Camera`.

    Returns
    -------
    camera : Camera
        A three-quarter view, slightly from above; the bounding sphere fits in with a margin.
    light : RectLight
        A square above, to the right, turned to the scene's middle; its edge is a fifth
        of its distance.

    Raises
    ------
    ValueError
        If the scene is empty.
    """
    return camera_for(scene, fov_y_deg, width, height), light_for(scene)


def camera_for(
    scene: Scene, fov_y_deg: float = 45.0, width: int = 512, height: int = 512
) -> Camera:
    """Return the camera of `frame`.

    Parameters
    ----------
    scene : Scene
    fov_y_deg, width, height
        As in `Camera`.

    Returns
    -------
    Camera

    Raises
    ------
    ValueError
        If the scene is empty.
    """
    center, radius = _bounding_sphere(scene)
    half = math.radians(fov_y_deg) / 2
    narrow = min(half, math.atan(math.tan(half) * width / height)) if height > 0 else half
    distance = _MARGIN * radius / math.sin(narrow) if 0 < narrow < math.pi / 2 else radius
    target = center - _AIM * radius * _direction(_LIGHT[0], 0.0)
    eye = target + distance * _direction(*_VIEW)
    return Camera(eye, target, fov_y_deg=fov_y_deg, width=width, height=height)


def light_for(scene: Scene) -> RectLight:
    """Return the light of `frame`.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    RectLight

    Raises
    ------
    ValueError
        If the scene is empty.
    """
    center, radius = _bounding_sphere(scene)
    towards = _direction(*_LIGHT)
    distance = _LIGHT_DISTANCE * radius
    level = np.cross(towards, (0.0, 0.0, 1.0))
    level /= np.linalg.norm(level)
    edge = _LIGHT_SIZE * distance
    # level × (level × towards) = -towards: it emits at the scene.
    return RectLight(center + distance * towards, edge * level, edge * np.cross(level, towards))


def add_ground(scene: Scene, name: str | None = None) -> str:
    """Add a horizontal square below a scene.

    Its side is four times the largest side of the scene's bounds, its middle is below theirs.

    Parameters
    ----------
    scene : Scene
    name : str, optional
        Must be new; ``"ground"``, numbered where that is taken, when not given.

    Returns
    -------
    str
        Its name.

    Raises
    ------
    ValueError
        If the scene is empty or has that name.
    """
    low, high = scene.bounds
    size = float((high - low).max())
    half = _GROUND_SIZE * size / 2
    x, y = (low + high)[:2] / 2
    z = low[2] - _GROUND_GAP * size
    corners = [
        (x - half, y - half, z),
        (x + half, y - half, z),
        (x + half, y + half, z),
        (x - half, y + half, z),
    ]
    free = scene._new_name(None, "ground") if name is None else name
    return scene.add((corners, [(0, 1, 2), (0, 2, 3)]), free)


def _bounding_sphere(scene: Scene) -> tuple[npt.NDArray[np.float64], float]:
    low, high = scene.bounds
    return (low + high) / 2, float(np.linalg.norm(high - low)) / 2


def _direction(azimuth_deg: float, elevation_deg: float) -> npt.NDArray[np.float64]:
    a, e = math.radians(azimuth_deg), math.radians(elevation_deg)
    return np.array([math.cos(a) * math.cos(e), math.sin(a) * math.cos(e), math.sin(e)])
