"""What a light sends to points, with nothing or with a scene in between."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from softshadow._core import kernels as _kernels
from softshadow.arguments import Bar, Progress, Vector, as_points, as_vector
from softshadow.light import Light
from softshadow.methods import RayTraced
from softshadow.scene import Scene

__all__ = [
    "light_fraction_above",
    "light_samples",
    "transmittance",
    "unshadowed_irradiance",
]

_Floats = npt.NDArray[np.float32]

_Doubles = npt.NDArray[np.float64]


def unshadowed_irradiance(light: Light, points: npt.ArrayLike, normals: npt.ArrayLike) -> _Doubles:
    """Return the irradiance from a whole light of radiance 1, without occluders, in closed form.

    Lambert's contour formula; the part of the light under the tangent plane is cut off. Of a
    `DistantLight` it is that of an irradiance of 1 across its direction.

    Parameters
    ----------
    light : RectLight, DiskLight, SphereLight, PolygonLight or DistantLight
    points, normals : array_like, shape (N, 3)

    Returns
    -------
    ndarray, shape (N,), float64

    Examples
    --------
    >>> import softshadow as ss
    >>> light = ss.SphereLight((0, 0, 4), 1)  # of which a surface below sees π (1 / 4)²
    >>> irradiance = ss.kernels.unshadowed_irradiance(light, [(0, 0, 0)], [(0, 0, 1)])
    >>> round(float(irradiance[0]), 6)
    0.19635
    """
    result: _Doubles = _kernels.unshadowed_irradiance(
        light._core, as_points(points, "points"), as_points(normals, "normals")
    )
    return result


def light_fraction_above(
    light: Light, points: npt.ArrayLike, normals: npt.ArrayLike | None = None
) -> _Doubles:
    """Return the fraction of a light above each point's tangent plane and emitting towards it.

    By area for flat lights, by solid angle for spheres and distant lights; in closed form.

    Parameters
    ----------
    light : RectLight, DiskLight, SphereLight, PolygonLight or DistantLight
    points : array_like, shape (N, 3)
    normals : array_like, shape (N, 3), optional
        None: no tangent plane.

    Returns
    -------
    ndarray, shape (N,), float64

    Examples
    --------
    >>> import softshadow as ss
    >>> light = ss.DiskLight((0, 0, 4), (0, 0, -1), 1)
    >>> ss.kernels.light_fraction_above(light, [(0, 0, 0)] * 2, [(0, 0, 1), (1, 0, 0)]).tolist()
    [1.0, 0.5]
    """
    n = None if normals is None else as_points(normals, "normals")
    result: _Doubles = _kernels.light_fraction_above(light._core, as_points(points, "points"), n)
    return result


def light_samples(
    light: Light, point: Vector, samples: int = 256, seed: int = 0
) -> tuple[_Doubles, _Floats, _Floats]:
    """Return the light points that ``RayTraced(pattern="fixed")`` uses at a point.

    Uniform in area on flat lights, uniform in the solid angle seen from `point` on spheres and
    distant lights; points of the latter are 2**40 world units away, in single precision. Of
    ``2 n`` samples, ``n`` are those of ``n`` samples with the same seed.

    Parameters
    ----------
    light : RectLight, DiskLight, SphereLight, PolygonLight or DistantLight
    point : array_like, shape (3,)
        The receiver.
    samples : int
        1 to 65536; powers of two are stratified best.
    seed : int

    Returns
    -------
    points : ndarray, shape (samples, 3), float64
    weights : ndarray, shape (samples,), float32
        Irradiance from each sample at radiance 1 onto a surface that faces it; 0 where the light
        does not emit towards the point.
    colours : ndarray, shape (samples, 3), float32
        Radiance of each sample; of a `DistantLight` its irradiance.

    Examples
    --------
    >>> import softshadow as ss
    >>> light = ss.SphereLight((0, 0, 4), 0.5)
    >>> points, weights, colours = ss.kernels.light_samples(light, (0, 0, 0), samples=16)
    >>> points.shape, weights.shape, colours.shape
    ((16, 3), (16,), (16, 3))
    """
    checked = RayTraced(samples=samples, seed=seed)
    points, weights, colours = _kernels.light_samples(
        light._core, as_vector(point, "point"), checked.samples, checked.seed
    )
    return points, weights, colours


def transmittance(
    scene: Scene,
    origins: npt.ArrayLike,
    targets: npt.ArrayLike,
    progress: Progress = False,
) -> _Floats:
    """Trace segments against what casts in a scene.

    A surface is crossed where the segment passes through it with its ends strictly on different
    sides; a segment through an edge or a vertex that triangles share crosses one of them. There is
    no epsilon: move an origin off its surface before the call.

    Parameters
    ----------
    scene : Scene
        Its hierarchy is built at the first call and kept with it.
    origins, targets : array_like, shape (N, 3)
        Ends of the segments, world units.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    ndarray, shape (N,), float32
        Product of ``1 - opacity`` over all crossings: 0 where blocked, 1 where free.

    Raises
    ------
    ValueError
        If the shapes differ or a coordinate is not finite.

    Examples
    --------
    >>> import softshadow as ss
    >>> scene = ss.Scene()
    >>> sheet = scene.add(ss.scenes.square(1), opacity=0.75)
    >>> below, above = [(0.5, 0, -1), (2, 0, -1)], [(0.5, 0, 1), (2, 0, 1)]
    >>> ss.kernels.transmittance(scene, below, above).tolist()
    [0.25, 1.0]
    """
    with Bar(progress, "transmittance") as report:
        result: _Floats = _kernels.transmittance(
            scene._core, as_points(origins, "origins"), as_points(targets, "targets"), report
        )
    return result
