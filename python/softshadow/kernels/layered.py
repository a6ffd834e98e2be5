"""Layered shadow maps as arrays, and tracing points through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow._core import kernels as _kernels
from softshadow.arguments import Bar, Progress, as_points
from softshadow.camera import Camera
from softshadow.light import Light
from softshadow.methods import Mlsm, Mtsm, Slsm
from softshadow.scene import Scene

__all__ = [
    "LayeredMap",
    "layered_maps",
    "trace_layered_maps",
]

_Floats = npt.NDArray[np.float32]

_Doubles = npt.NDArray[np.float64]

_Ints = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class LayeredMap:
    """One view of a layered shadow map; H by W texels of L layers, the nearest first.

    `layered_maps` returns them with all fields; `trace_layered_maps` takes them, and maps of one's
    own that have a camera and depths.

    Attributes
    ----------
    camera : Camera
        The view, from behind the light; one focal length, no skew.
    depths : ndarray, shape (H, W, L), float64
        Depth along the view's axis of a layer's last surface, world units; inf where there is none.
        The inverse of what the map keeps in single precision.
    first_depths : ndarray, shape (H, W, L), float64, optional
        Depth of the first surface that a layer stands for; None: of its only one.
    visibility : ndarray, shape (H, W, L), float32, optional
        Of the texel's own ray behind a layer, 0 to 1, from 1 at the light or behind what is opaque.
        None: all is opaque, and the other arrays of what lets light through are None, too.
    counts : ndarray, shape (H, W, L), int32, optional
        Surfaces that a layer stands for, 0 where there is none; None: one.
    transmittance : ndarray, shape (H, W, L), float32, optional
        Of each of these surfaces, 0 to 1. None: ``(v_i / v_(i-1)) ** (1 / count)``.
    slopes : ndarray, shape (H, W, L, 2), float32, optional
        Change of a layer's inverse depth from texel to texel, along a row and along a column, 1 /
        world units; eight bits of each count. None: surfaces that face the view.
    group : int
        Of the views of one group a receiver looks into the one that it is most central in, as seen
        from the light; it looks into every group.
    origin : array_like, shape (3,), optional
        What single precision is relative to, world units: of the scene that a map was drawn from.
        None, as `unit`: the light's centre, and what holds the light and the map.
    unit : float, optional
        World units that are 1 in it, a power of two.
    """

    camera: Camera
    depths: _Doubles
    first_depths: _Doubles | None = None
    visibility: _Floats | None = None
    counts: _Ints | None = None
    transmittance: _Floats | None = None
    slopes: _Floats | None = None
    group: int = 0
    origin: npt.ArrayLike | None = None
    unit: float | None = None


def layered_maps(
    scene: Scene,
    light: Light,
    method: Slsm | Mlsm | Mtsm | None = None,
    progress: Progress = False,
) -> list[LayeredMap]:
    """Build layered shadow maps (Xie, Tabellion and Pearce 2007, Sections 4.2 and 5.1).

    `softshadow.visibility` with that method traces points through them; so does
    `trace_layered_maps`.

    Parameters
    ----------
    scene : Scene
    light : RectLight, DiskLight, SphereLight or PolygonLight
    method : Slsm, Mlsm or Mtsm, optional
        For resolution, layers and compression; ``Mtsm()`` by default.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    list of LayeredMap
        One of a flat light, and of a sphere that a single view holds; otherwise the faces of a cube
        that something casts into. Coarser ones of what has nothing behind it come last. Empty if
        nothing casts.

    Raises
    ------
    ValueError
        If the scene is empty, has spheres that cast, or transparent meshes that the method does not
        take; if a parameter is out of its range, or a map does not fit into memory.
    """
    chosen = method or Mtsm()
    with Bar(progress, "layered_maps") as report:
        found = _kernels.layered_maps(scene._core, light._core, chosen, chosen.name, report)
    return [
        LayeredMap(
            Camera.from_matrix(m["K"], m["camera_to_world"], *reversed(m["depths"].shape[:2])),
            m["depths"],
            m.get("first_depths"),
            m.get("visibility"),
            m.get("counts"),
            m.get("transmittance"),
            m["slopes"],
            m["group"],
            np.array(m["origin"]),
            m["unit"],
        )
        for m in found
    ]


def trace_layered_maps(
    maps: Sequence[LayeredMap],
    light: Light,
    points: npt.ArrayLike,
    normals: npt.ArrayLike | None = None,
    method: Slsm | Mlsm | Mtsm | None = None,
    progress: Progress = False,
) -> _Floats:
    """Trace points to a light through layered shadow maps (Xie et al. 2007, Sections 4.3 and 5.2).

    Of maps from `layered_maps` it is what `softshadow.visibility` returns with the same method and
    ``near=0``, for there are no triangles here: to the last bit but for the rounding of the
    cameras' positions to float64 world coordinates.

    Parameters
    ----------
    maps : sequence of LayeredMap
        All of one `origin` and `unit`. A flat light's map is traced fastest if it is drawn along
        the light's normal; seen otherwise, occluders count up to the middle of the light's depths.
        Without maps, all that is above a tangent plane is seen.
    light : RectLight, DiskLight, SphereLight or PolygonLight
        All of it must lie in front of the cameras.
    points : array_like, shape (N, 3)
        World units.
    normals : array_like, shape (N, 3), optional
        Of any length; None: no tangent plane.
    method : Slsm, Mlsm or Mtsm, optional
        For samples, seed, z_threshold, bias, detail, threshold and crossing; ``Mtsm()`` by default.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    ndarray, shape (N,), float32
        Visibility, 0 to 1.

    Raises
    ------
    ValueError
        If a shape differs from what the camera asks for; if depths decrease from layer to layer or
        are not positive, a visibility rises but from `threshold` or less, or a number is out of its
        range or not finite; if a camera has two focal lengths or is not behind the light; if a
        point or normal is not finite, or a parameter is out of its range.
    TypeError
        If an array has the wrong kind of numbers.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> maps = ss.kernels.layered_maps(setup.scene, setup.light, ss.Slsm(resolution=128))
    >>> points, normals = [(-0.9, 0, 0), (0.9, 0, 0)], [(0, 0, 1), (0, 0, 1)]
    >>> ss.kernels.trace_layered_maps(maps, setup.light, points, normals, ss.Slsm()).tolist()
    [0.0, 1.0]
    """
    chosen = method or Mtsm()
    frames = {_frame(m) for m in maps}
    if len(frames) > 1:
        raise ValueError(f"maps: expected one origin and unit, got {len(frames)} different ones")
    with Bar(progress, "trace_layered_maps") as report:
        result: _Floats = _kernels.trace_layered_maps(
            [_flat_arrays(m, f"maps[{i}]") for i, m in enumerate(maps)],
            light._core,
            as_points(points, "points"),
            None if normals is None else as_points(normals, "normals"),
            chosen,
            chosen.name,
            frames.pop() if frames else None,
            report,
        )
    return result


def _frame(m: LayeredMap) -> tuple[tuple[float, ...], float] | None:
    """Return a map's origin and unit, or None if it has neither."""
    if m.origin is None and m.unit is None:
        return None
    if m.origin is None or m.unit is None:
        raise ValueError("maps: origin and unit must be given together")
    return tuple(_numbers(m.origin, "origin", np.float64, (3,)).tolist()), checks.number(
        m.unit, "maps: unit"
    )


def _flat_arrays(m: LayeredMap, name: str) -> dict[str, Any]:
    """Return a map's arrays as the kernel takes them, their shapes and kinds checked."""
    checks.refuse_masked(m.depths, f"{name}: depths")
    depths = np.asarray(m.depths)
    size = (m.camera.height, m.camera.width)
    if depths.ndim != 3 or depths.shape[:2] != size or not 1 <= depths.shape[2] <= 64:
        raise ValueError(
            f"{name}: depths: expected shape ({size[0]}, {size[1]}, L) with L 1 to 64, as the "
            f"camera's height and width, got {depths.shape}"
        )
    shape = depths.shape
    kinds: dict[str, tuple[Any, tuple[int, ...]]] = {
        "depths": (np.float64, shape),
        "first_depths": (np.float64, shape),
        "visibility": (np.float32, shape),
        "counts": (np.int64, shape),
        "transmittance": (np.float32, shape),
        "slopes": (np.float64, (*shape, 2)),
    }
    group = checks.integer(m.group, f"{name}: group", -(2**63), 2**63 - 1)
    out: dict[str, Any] = {"name": name, "camera": m.camera._core, "group": group}
    out["layers"] = shape[2]
    for key, (dtype, expected) in kinds.items():
        array = getattr(m, key)
        if array is not None and m.visibility is None and key not in ("depths", "slopes"):
            raise ValueError(f"{name}: {key}: given without visibility, which says what is seen")
        given = array is not None
        out[key] = _numbers(array, f"{name}: {key}", dtype, expected).ravel() if given else None
    return out


def _numbers(
    array: npt.ArrayLike, what: str, dtype: type[np.generic], shape: tuple[int, ...]
) -> npt.NDArray[Any]:
    """Return an array of a dtype; fractions do not become integers."""
    checks.refuse_masked(array, what)
    result = np.asarray(array)
    allowed = "iu" if np.issubdtype(dtype, np.integer) else "iuf"
    if result.dtype.kind not in allowed:
        kind = "integers" if allowed == "iu" else "real numbers"
        raise TypeError(f"{what}: expected {kind}, got dtype {result.dtype}")
    if result.shape != shape:
        raise ValueError(f"{what}: expected shape {shape}, got {result.shape}")
    return np.ascontiguousarray(result, dtype=dtype)
