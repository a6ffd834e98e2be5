"""Hard-shadow textures on a parallelogram, and their convolution with a light."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow._core import kernels as _kernels
from softshadow.arguments import Bar, Progress, Vector, as_mesh, as_points, as_vector
from softshadow.light import Light

__all__ = [
    "accumulate",
    "convolve_shadow",
    "receiver_transform",
]

_Floats = npt.NDArray[np.float32]

_Doubles = npt.NDArray[np.float64]

_MOST_TEXELS = 8192


def receiver_transform(
    light_point: Vector, corner: Vector, edge_u: Vector, edge_v: Vector
) -> _Doubles:
    """Return the projective transform of Herf and Heckbert 1996.

    It maps the pyramid from a light point through a parallelogram to the unit box, and lines
    through the light point to lines along z: ``z = 1`` is the parallelogram's plane, ``z = inf``
    the parallel plane through the light point; what casts lies in ``[0, 1]² x [1, inf]``.

    Parameters
    ----------
    light_point : array_like, shape (3,)
    corner, edge_u, edge_v : array_like, shape (3,)
        The parallelogram, ``corner + x edge_u + y edge_v``.

    Returns
    -------
    ndarray, shape (4, 4), float64
        Acts on columns ``(p, 1)``; divide by the last component.

    Raises
    ------
    ValueError
        If the light point lies in the parallelogram's plane, or its edges span no area.
    """
    result: _Doubles = _kernels.receiver_transform(
        as_vector(light_point, "light_point"),
        as_vector(corner, "corner"),
        as_vector(edge_u, "edge_u"),
        as_vector(edge_v, "edge_v"),
    )
    return result


def accumulate(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    light_points: npt.ArrayLike,
    corner: Vector,
    edge_u: Vector,
    edge_v: Vector,
    size: tuple[int, int],
    colours: npt.ArrayLike | None = None,
    progress: Progress = False,
) -> _Floats:
    """Draw a mesh's hard shadows from points of any colour onto a parallelogram and add them up.

    Modulation textures of Herf and Heckbert 1996; a texel adds the colours of the points that it
    sees. A point sees the parallelogram from the side that most of the points are on.

    Parameters
    ----------
    vertices, faces
        As in `mesh_edges`; what is opaque and casts.
    light_points : array_like, shape (N, 3)
        For example those of `light_samples`, or more of them to be added to an earlier result.
    corner, edge_u, edge_v : array_like, shape (3,)
        The parallelogram, ``corner + x edge_u + y edge_v``. The mesh casts from its plane on.
    size : pair of ints
        Texels along u and v, 1 to 8192.
    colours : array_like, shape (N,) or (N, 3), optional
        Of each point, with its intensity; ``1 / N`` when not given, so that the result is a
        visibility.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    ndarray, shape (H, W) or (H, W, 3), float32
        Row 0 is the one farthest along `edge_v`. (H, W) unless `colours` are (N, 3).

    Raises
    ------
    ValueError
        If the mesh is invalid, shapes do not fit, or a value is not finite or out of its range.
    """
    points = as_points(light_points, "light_points")
    n = len(points)
    if n == 0:
        raise ValueError("light_points: expected at least one")
    weights = np.full(n, 1.0 / n) if colours is None else checks.numbers(colours, "colours")
    if weights.shape not in ((n,), (n, 3)):
        raise ValueError(f"colours: expected shape ({n},) or ({n}, 3), got {weights.shape}")
    rgb = np.ascontiguousarray(np.broadcast_to(weights.reshape(n, -1), (n, 3)))
    edges = [as_vector(edge_u, "edge_u"), as_vector(edge_v, "edge_v")]
    width, height = checks.size(size, "size", _MOST_TEXELS)
    with Bar(progress, "accumulate") as report:
        flat: _Floats = _kernels.accumulate(
            *as_mesh(vertices, faces),
            points,
            rgb,
            as_vector(corner, "corner"),
            edges,
            (width, height),
            report,
        )
    image = flat.reshape(height, width, 3)
    return image if weights.ndim == 2 else np.ascontiguousarray(image[..., 0])


def convolve_shadow(
    visibility: npt.ArrayLike,
    light: Light,
    corner: Vector,
    edge_u: Vector,
    edge_v: Vector,
    scale: float,
    progress: Progress = False,
) -> _Floats:
    """Convolve a hard shadow on a parallelogram with the light's image (Soler and Sillion 1998).

    Exact but for texels where light, occluder and parallelogram are parallel. `accumulate` with the
    light's centre as its only point draws such a hard shadow.

    Parameters
    ----------
    visibility : array_like, shape (H, W)
        Of the light's centre, 0 to 1; row 0 is the one farthest along `edge_v`. What is beside the
        picture counts as lit.
    light : RectLight, DiskLight, SphereLight or PolygonLight
    corner, edge_u, edge_v : array_like, shape (3,)
        The parallelogram, ``corner + x edge_u + y edge_v``.
    scale : float
        Size of the light's image over the light's: how high the occluder is over the parallelogram,
        over how deep it is below the light; 0 to 30.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    ndarray, shape (H, W), float32
        Visibility of the light.

    Raises
    ------
    ValueError
        If shapes do not fit, a value is not finite or out of its range, or the light's centre lies
        in the parallelogram's plane.
    """
    hard = checks.numbers(visibility, "visibility")
    if hard.ndim != 2:
        raise ValueError(f"visibility: expected shape (H, W), got {hard.shape}")
    if not ((hard >= 0) & (hard <= 1)).all():
        raise ValueError("visibility: expected finite numbers from 0 to 1")
    with Bar(progress, "convolve_shadow") as report:
        hidden: _Floats = _kernels.convolve_shadow(
            np.ascontiguousarray(1 - hard.astype(np.float32)[::-1]),
            light._core,
            as_vector(corner, "corner"),
            [as_vector(edge_u, "edge_u"), as_vector(edge_v, "edge_v")],
            checks.number(scale, "scale"),
            report,
        )
    return np.ascontiguousarray(1 - np.clip(hidden[::-1], 0, 1))
