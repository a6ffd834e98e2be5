"""Area lights: rectangle, disk and sphere, with a constant emitted radiance.

Flat lights emit on one side; a sphere emits outwards. Sizes are world units, always.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, TypeAlias

from softshadow import _core
from softshadow.arguments import RGB, Vector, as_rgb, as_vector
from softshadow.checks import number


class _Light:
    """What the lights share: they are rebuilt on the other side of a process boundary."""

    def __reduce__(self) -> tuple[Any, ...]:
        kept = tuple(getattr(self, f.name) for f in fields(self) if f.init)  # type: ignore[arg-type]
        return type(self), kept

    def _store(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _check(self, vectors: tuple[str, ...]) -> None:
        """Store the fields as floats and tuples of floats, which cannot be changed."""
        kind = type(self).__name__
        for name in vectors:
            self._store(name, as_vector(getattr(self, name), f"{kind}.{name}"))
        if hasattr(self, "radius"):
            self._store("radius", number(self.radius, f"{kind}.radius", "a finite number >= 0"))
        radiance = getattr(self, "radiance")  # noqa: B009 (a field of every light, not of this)
        self._store("radiance", as_rgb(radiance, f"{kind}.radiance"))


@dataclass(frozen=True)
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
    """

    center: Vector
    edge_u: Vector
    edge_v: Vector
    radiance: RGB = 1.0
    _core: _core.Light = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Validate the fields and store them as tuples of floats."""
        self._check(("center", "edge_u", "edge_v"))
        core = _core.Light.rect(self.center, self.edge_u, self.edge_v, self.radiance)
        self._store("_core", core)


@dataclass(frozen=True)
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
    """

    center: Vector
    normal: Vector
    radius: float
    radiance: RGB = 1.0
    _core: _core.Light = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Validate the fields and store them as tuples of floats."""
        self._check(("center", "normal"))
        core = _core.Light.disk(self.center, self.normal, self.radius, self.radiance)
        self._store("_core", core)


@dataclass(frozen=True)
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
    """

    center: Vector
    radius: float
    radiance: RGB = 1.0
    _core: _core.Light = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Validate the fields and store them as tuples of floats."""
        self._check(("center",))
        core = _core.Light.sphere(self.center, self.radius, self.radiance)
        self._store("_core", core)


Light: TypeAlias = "RectLight | DiskLight | SphereLight"
"""Any of the three light shapes."""

LightLike: TypeAlias = "Light | Sequence[Light]"
"""One light, or several."""


def as_lights(light: LightLike) -> tuple[list[Light], bool]:
    """Return lights as a list, and whether one was given by itself.

    Raises
    ------
    TypeError
        If it is neither a light nor a sequence of lights.
    """
    if isinstance(light, (RectLight, DiskLight, SphereLight)):
        return [light], True
    if not isinstance(light, Sequence) or not len(light):
        raise TypeError(f"light: expected a light or a sequence of lights, got {light!r}")
    for item in light:
        if not isinstance(item, (RectLight, DiskLight, SphereLight)):
            raise TypeError(f"light: expected lights in the sequence, got {type(item).__name__}")
    return list(light), False
