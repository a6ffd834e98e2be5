"""Area lights: rectangle, disk, sphere, polygon, with a constant radiance, and distant ones.

Flat lights emit on one side; a sphere emits outwards. Sizes are world units, always; a distant
light has a direction and an angle instead, as the sun has. Whatever they
are made from, lights hold plain floats and tuples of floats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, TypeAlias

import numpy.typing as npt

from softshadow import _core
from softshadow.arguments import RGB, Triple, Vector, as_points, as_rgb, as_vector
from softshadow.checks import number


class _Light:
    """What the lights share: they are rebuilt on the other side of a process boundary."""

    def __reduce__(self) -> tuple[Any, ...]:
        kept = tuple(getattr(self, f.name) for f in fields(self) if f.init)  # type: ignore[arg-type]
        return type(self), kept

    def _store(self, **values: object) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)


@dataclass(frozen=True, init=False)
class RectLight(_Light):
    """A parallelogram that emits towards ``edge_u × edge_v``.

    Parameters
    ----------
    center : array_like, shape (3,)
        Its middle, in world units.
    edge_u, edge_v : array_like, shape (3,)
        The full edge vectors (not half), in world units; they need not be perpendicular.
    radiance : float or array_like of shape (3,)
        Emitted radiance, linear RGB: 0, or 1.2e-38 to 3.4e38 (kernels work in single precision).

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or no number, or the edges span no area.

    Examples
    --------
    >>> import softshadow as ss
    >>> light = ss.RectLight(center=(0, 0, 4), edge_u=(0, 1, 0), edge_v=(1, 0, 0), radiance=10)
    >>> light.radiance  # it emits towards edge_u × edge_v, here downwards
    (10.0, 10.0, 10.0)
    """

    center: Triple
    edge_u: Triple
    edge_v: Triple
    radiance: Triple
    _core: _core.Light = field(init=False, repr=False, compare=False)

    def __init__(self, center: Vector, edge_u: Vector, edge_v: Vector, radiance: RGB = 1.0) -> None:
        middle = as_vector(center, "RectLight.center")
        u, v = as_vector(edge_u, "RectLight.edge_u"), as_vector(edge_v, "RectLight.edge_v")
        rgb = as_rgb(radiance, "RectLight.radiance")
        core = _core.Light.rect(middle, u, v, rgb)
        self._store(center=middle, edge_u=u, edge_v=v, radiance=rgb, _core=core)


@dataclass(frozen=True, init=False)
class DiskLight(_Light):
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
        Emitted radiance, linear RGB: 0, or 1.2e-38 to 3.4e38 (kernels work in single precision).

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or no number, the normal is zero or the radius is negative.

    Examples
    --------
    >>> import softshadow as ss
    >>> ss.DiskLight(center=(0, 0, 4), normal=(0, 0, -1), radius=0.5)
    DiskLight(center=(0.0, 0.0, 4.0), normal=(0.0, 0.0, -1.0), radius=0.5, radiance=(1.0, 1.0, 1.0))
    """

    center: Triple
    normal: Triple
    radius: float
    radiance: Triple
    _core: _core.Light = field(init=False, repr=False, compare=False)

    def __init__(self, center: Vector, normal: Vector, radius: float, radiance: RGB = 1.0) -> None:
        middle = as_vector(center, "DiskLight.center")
        n = as_vector(normal, "DiskLight.normal")
        r = number(radius, "DiskLight.radius", "a finite number >= 0")
        rgb = as_rgb(radiance, "DiskLight.radiance")
        core = _core.Light.disk(middle, n, r, rgb)
        self._store(center=middle, normal=n, radius=r, radiance=rgb, _core=core)


@dataclass(frozen=True, init=False)
class SphereLight(_Light):
    """A sphere that emits outwards.

    Parameters
    ----------
    center : array_like, shape (3,)
        Its middle, in world units.
    radius : float
        In world units. Zero makes a point, for methods that allow it; its unshadowed irradiance
        is zero.
    radiance : float or array_like of shape (3,)
        Emitted radiance, linear RGB: 0, or 1.2e-38 to 3.4e38 (kernels work in single precision).

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or no number, or the radius is negative.

    Examples
    --------
    >>> import softshadow as ss
    >>> ss.SphereLight(center=(0, 0, 4), radius=0.5) == ss.SphereLight([0, 0, 4], 0.5, (1, 1, 1))
    True
    """

    center: Triple
    radius: float
    radiance: Triple
    _core: _core.Light = field(init=False, repr=False, compare=False)

    def __init__(self, center: Vector, radius: float, radiance: RGB = 1.0) -> None:
        middle = as_vector(center, "SphereLight.center")
        r = number(radius, "SphereLight.radius", "a finite number >= 0")
        rgb = as_rgb(radiance, "SphereLight.radiance")
        core = _core.Light.sphere(middle, r, rgb)
        self._store(center=middle, radius=r, radiance=rgb, _core=core)


@dataclass(frozen=True, init=False)
class PolygonLight(_Light):
    """A planar polygon, convex or not, that emits to the side that sees it run counter-clockwise.

    Its middle, to which shadow rays of `Hard` go and from which `Wedges` sees silhouettes, is its
    centroid, which need not be on it. Methods that sample the light and `Wedges` take its outline
    as it is; `Ssoc`, `SingleSample`, `Convolution` and the views of `Mvsm` a rectangle in its
    place, with its centroid, its area and its second moments up to a factor.

    Parameters
    ----------
    vertices : array_like, shape (V, 3)
        Its corners in order, in world units: 3 to 1024 of them, in one plane but for rounding (up
        to a millionth of the polygon's extent). The outline closes by itself, has no holes, and no
        two of its edges meet but neighbours at their corner; corners may lie on a line.
    radiance : float or array_like of shape (3,)
        Emitted radiance, linear RGB: 0, or 1.2e-38 to 3.4e38 (kernels work in single precision).

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or no number, there are too few or too many vertices, one of them
        is off the plane, the outline meets itself, or it spans no area; the message names the
        vertices.

    Examples
    --------
    >>> import softshadow as ss
    >>> corners = [(0, 0, 4), (0, 1, 4), (0.5, 1, 4), (0.5, 0.5, 4), (1, 0.5, 4), (1, 0, 4)]
    >>> light = ss.PolygonLight(corners, radiance=10)  # an L that emits downwards
    >>> len(light.vertices)
    6
    """

    vertices: tuple[Triple, ...]
    radiance: Triple
    _core: _core.Light = field(init=False, repr=False, compare=False)

    def __init__(self, vertices: npt.ArrayLike, radiance: RGB = 1.0) -> None:
        corners = as_points(vertices, "PolygonLight.vertices")
        rgb = as_rgb(radiance, "PolygonLight.radiance")
        core = _core.Light.polygon(corners, rgb)
        rows = tuple((x, y, z) for x, y, z in corners.tolist())
        self._store(vertices=rows, radiance=rgb, _core=core)

    @property
    def center(self) -> Triple:
        """The centroid, in world units."""
        x, y, z = self._core.center
        return x, y, z


@dataclass(frozen=True, init=False)
class DistantLight(_Light):
    """A disk at infinity, such as the sun: the same from everywhere.

    Visibility is the fraction of its directions, uniform in solid angle, that nothing blocks.

    Parameters
    ----------
    direction : array_like, shape (3,)
        In which its light travels; any length but zero.
    angle_deg : float
        The whole angle that its disk spans, in degrees: 0, or 1e-90 to less than 180. The sun's is
        0.53. Zero makes a parallel light, for methods that allow it.
    irradiance : float or array_like of shape (3,)
        What it casts on a surface across its direction, whatever its angle, linear RGB: 0, or
        1.2e-38 to 3.4e38 (kernels work in single precision). Its radiance is
        ``irradiance / (pi * sin(angle_deg / 2)**2)``.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or no number, the direction is zero or the angle out of its range.

    Examples
    --------
    >>> import softshadow as ss
    >>> sun = ss.DistantLight(direction=(0.5, 0, -1), irradiance=3)
    >>> sun.angle_deg, sun.irradiance
    (0.53, (3.0, 3.0, 3.0))
    """

    direction: Triple
    angle_deg: float
    irradiance: Triple
    _core: _core.Light = field(init=False, repr=False, compare=False)

    def __init__(self, direction: Vector, angle_deg: float = 0.53, irradiance: RGB = 1.0) -> None:
        d = as_vector(direction, "DistantLight.direction")
        angle = number(angle_deg, "DistantLight.angle_deg", "a number from 0 to less than 180")
        rgb = as_rgb(irradiance, "DistantLight.irradiance")
        core = _core.Light.distant(d, angle, rgb)
        self._store(direction=d, angle_deg=angle, irradiance=rgb, _core=core)


PlacedLight: TypeAlias = "RectLight | DiskLight | SphereLight | PolygonLight"
"""Any light that is somewhere."""

Light: TypeAlias = "PlacedLight | DistantLight"
"""Any of the light shapes."""

LightLike: TypeAlias = "Light | Sequence[Light]"
"""One light, or several."""


def as_lights(light: LightLike) -> tuple[list[Light], bool]:
    """Return lights as a list, and whether one was given by itself.

    Raises
    ------
    TypeError
        If it is neither a light nor a sequence of lights.
    """
    if isinstance(light, _Light):
        return [light], True
    if not isinstance(light, Sequence) or not len(light):
        raise TypeError(f"light: expected a light or a sequence of lights, got {light!r}")
    for item in light:
        if not isinstance(item, _Light):
            raise TypeError(f"light: expected lights in the sequence, got {type(item).__name__}")
    return list(light), False


def strength(light: Light) -> Triple:
    """Return what closed forms are multiplied by: radiance, of a distant light irradiance."""
    return light.irradiance if isinstance(light, DistantLight) else light.radiance
