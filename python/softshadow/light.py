"""Area lights: rectangle, disk and sphere, with a constant emitted radiance.

Flat lights emit on one side; a sphere emits outwards. Sizes are world units, always.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from softshadow import _core

RGB: TypeAlias = "float | tuple[float, float, float] | npt.ArrayLike"
"""A colour: one number for grey, or three linear RGB values."""

Vector: TypeAlias = "tuple[float, float, float] | npt.ArrayLike"
"""A point or direction: three finite numbers."""


def as_rgb(value: RGB, what: str) -> tuple[float, float, float]:
    """Return `value` as three non-negative finite floats, or raise ``ValueError`` naming `what`."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape not in ((), (3,)):
        raise ValueError(f"{what}: expected a number or 3 RGB values, got shape {array.shape}")
    if not np.all(np.isfinite(array)) or np.any(array < 0):
        raise ValueError(f"{what}: expected finite values >= 0, got {array.tolist()}")
    r, g, b = (float(x) for x in np.broadcast_to(array, (3,)))
    return r, g, b


def as_vector(value: Vector, what: str) -> tuple[float, float, float]:
    """Return `value` as three finite floats, or raise ``ValueError`` naming `what`."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,):
        raise ValueError(f"{what}: expected 3 numbers, got shape {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{what}: expected finite numbers, got {array.tolist()}")
    x, y, z = (float(x) for x in array)
    return x, y, z


def as_points(array: npt.ArrayLike, what: str) -> npt.NDArray[np.float64]:
    """Return rows of three numbers, or raise ``ValueError`` naming `what`."""
    result = np.ascontiguousarray(array, dtype=np.float64)
    if result.ndim != 2 or result.shape[1] != 3:
        raise ValueError(f"{what}: expected shape (N, 3), got {result.shape}")
    return result


@dataclass(frozen=True)
class RectLight:
    """A parallelogram that emits towards ``edge_u × edge_v``.

    Parameters
    ----------
    center : array_like, shape (3,)
        Its middle, in world units.
    edge_u, edge_v : array_like, shape (3,)
        The full edge vectors (not half), in world units; they need not be perpendicular.
    radiance : float or array_like of shape (3,)
        Emitted radiance, linear RGB.

    Raises
    ------
    ValueError
        If a number is not finite, or the edges span no area.
    """

    center: Vector
    edge_u: Vector
    edge_v: Vector
    radiance: RGB = 1.0
    _core: _core.Light = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Validate the fields and store them as tuples of floats."""
        for name in ("center", "edge_u", "edge_v"):
            object.__setattr__(self, name, as_vector(getattr(self, name), f"RectLight.{name}"))
        object.__setattr__(self, "radiance", as_rgb(self.radiance, "RectLight.radiance"))
        core = _core.Light.rect(self.center, self.edge_u, self.edge_v, self.radiance)
        object.__setattr__(self, "_core", core)


@dataclass(frozen=True)
class DiskLight:
    """A disk that emits towards `normal`.

    Parameters
    ----------
    center : array_like, shape (3,)
        Its middle, in world units.
    normal : array_like, shape (3,)
        The emitting side; any length but zero.
    radius : float
        In world units. Zero makes a point with a hemisphere, for methods that allow it; its
        unshadowed irradiance is zero.
    radiance : float or array_like of shape (3,)
        Emitted radiance, linear RGB.

    Raises
    ------
    ValueError
        If a number is not finite, the normal is zero or the radius is negative.
    """

    center: Vector
    normal: Vector
    radius: float
    radiance: RGB = 1.0
    _core: _core.Light = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Validate the fields and store them as tuples of floats."""
        for name in ("center", "normal"):
            object.__setattr__(self, name, as_vector(getattr(self, name), f"DiskLight.{name}"))
        object.__setattr__(self, "radius", float(self.radius))
        object.__setattr__(self, "radiance", as_rgb(self.radiance, "DiskLight.radiance"))
        core = _core.Light.disk(self.center, self.normal, self.radius, self.radiance)
        object.__setattr__(self, "_core", core)


@dataclass(frozen=True)
class SphereLight:
    """A sphere that emits outwards.

    Parameters
    ----------
    center : array_like, shape (3,)
        Its middle, in world units.
    radius : float
        In world units. Zero makes a point, for methods that allow it; its unshadowed irradiance
        is zero.
    radiance : float or array_like of shape (3,)
        Emitted radiance, linear RGB.

    Raises
    ------
    ValueError
        If a number is not finite or the radius is negative.
    """

    center: Vector
    radius: float
    radiance: RGB = 1.0
    _core: _core.Light = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Validate the fields and store them as tuples of floats."""
        object.__setattr__(self, "center", as_vector(self.center, "SphereLight.center"))
        object.__setattr__(self, "radius", float(self.radius))
        object.__setattr__(self, "radiance", as_rgb(self.radiance, "SphereLight.radiance"))
        core = _core.Light.sphere(self.center, self.radius, self.radiance)
        object.__setattr__(self, "_core", core)


Light: TypeAlias = "RectLight | DiskLight | SphereLight"
"""Any of the three light shapes."""
