"""How near a shadow ray passes occluders, and what that leaves of the light."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow._core import kernels as _kernels
from softshadow.arguments import Bar, Progress, as_points
from softshadow.light import Light
from softshadow.methods import SingleSample
from softshadow.scene import Scene

__all__ = [
    "attenuation",
    "outer_distances",
]

_Floats = npt.NDArray[np.float32]

_Doubles = npt.NDArray[np.float64]


def outer_distances(
    scene: Scene,
    points: npt.ArrayLike,
    normals: npt.ArrayLike | None,
    light: Light,
    method: SingleSample | None = None,
    progress: Progress = False,
) -> _Floats:
    """Return ``tau`` of single sample soft shadows (Parker, Shirley and Smits 1998) at points.

    That is how far the shadow ray to the light's centre passes from the nearest occluder, 1 where
    the outer object of that ends: ``d A / (a D)`` for an occluder's point at distance ``a`` along
    the ray and ``d`` off it, a light of diameter ``D`` at distance ``A``. `attenuation` turns it
    into visibility.

    Parameters
    ----------
    scene : Scene
    points : array_like, shape (N, 3)
        World units.
    normals : array_like, shape (N, 3), or None
        None: no tangent plane.
    light : RectLight, DiskLight, SphereLight, PolygonLight or DistantLight
        Of a size of zero: `tau` is 0 or 1.
    method : SingleSample, optional
        For its opacity.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    ndarray, shape (N,), float32
        0 where the ray is blocked, or all of the light is below the tangent plane or faces away; 1
        where nothing is near.

    Raises
    ------
    ValueError
        If the scene is empty or has transparent occluders (unless the method's `opacity` allows
        them), a coordinate is not finite, a normal is zero, or the shapes differ.
    """
    n = None if normals is None else as_points(normals, "normals")
    with Bar(progress, "outer_distances") as report:
        result: _Floats = _kernels.outer_distances(
            scene._core,
            as_points(points, "points"),
            n,
            light._core,
            method or SingleSample(),
            report,
        )
    return result


def attenuation(
    tau: npt.ArrayLike, falloff: Literal["light", "linear", "smooth"] = "light"
) -> _Doubles:
    """Return the visibility at distances `tau` from inner objects, as `SingleSample` has it.

    Parameters
    ----------
    tau : array_like
        Below 0 counts as 0, above 1 as 1.
    falloff : {"light", "linear", "smooth"}
        The part of a disk beyond a line, `tau` itself, or ``3 tau**2 - 2 tau**3``.

    Returns
    -------
    ndarray, float64
        In the shape of `tau`.

    Raises
    ------
    ValueError
        If a value is not a number, or the falloff is unknown.
    """
    t = checks.numbers(tau, "tau")
    result: _Doubles = _kernels.attenuation(np.ascontiguousarray(t.ravel()), falloff)
    return result.reshape(t.shape)
