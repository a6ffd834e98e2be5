"""The methods: one frozen dataclass each, holding its parameters, and a table of their names."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Literal, TypeAlias

from softshadow import _core


@dataclass(frozen=True)
class Method:
    """What all methods share; not itself a method."""

    name: ClassVar[str]
    """The name that ``method=`` takes."""
    transparent: ClassVar[bool] = False
    """Whether opacities below 1 are honoured."""
    points: ClassVar[bool] = False
    """Whether it answers at a user's own points, without a camera."""
    needs_area: ClassVar[bool] = False
    """Whether a light of size zero is an error."""

    def parameters(self) -> dict[str, Any]:
        """Return the parameters by name."""
        return asdict(self)

    def _to_core(self) -> _core.Method:
        raise TypeError(f"{type(self).__name__} cannot be rendered")


@dataclass(frozen=True)
class Hard(Method):
    """Hard shadows: one shadow ray to the light's centre.

    Visibility is the transmittance along that ray, capped by the part of the light above the
    receiver's tangent plane.
    """

    name: ClassVar[str] = "hard"
    transparent: ClassVar[bool] = True
    points: ClassVar[bool] = True

    def _to_core(self) -> _core.Method:
        return _core.Method.hard()


@dataclass(frozen=True)
class RayTraced(Method):
    """The reference: stratified light samples traced against a bounding volume hierarchy.

    Parameters
    ----------
    samples : int
        Light samples per receiver, 1 to 65536. Powers of two are stratified best.
    seed : int
        Of the light samples, 0 to 2**64 - 1. Same seed, same bits.
    pattern : {"per_receiver", "fixed"}
        Whether every receiver has its own scrambling of the light samples (noise), or all share
        the same light points (banding, and the light points that the shadow-map methods use).
    cull : bool
        Settle groups of light samples that no silhouette edge separates with one ray. The result
        is the same to the last bit; ``False`` traces every sample, to measure what it gains.
    """

    samples: int = 256
    seed: int = 0
    pattern: Literal["per_receiver", "fixed"] = "per_receiver"
    cull: bool = True

    name: ClassVar[str] = "ray_traced"
    transparent: ClassVar[bool] = True
    points: ClassVar[bool] = True

    def _to_core(self) -> _core.Method:
        return _core.Method.ray_traced(self.samples, self.seed, self.pattern, self.cull)


_METHODS: dict[str, type[Method]] = {m.name: m for m in (Hard, RayTraced)}

MethodLike: TypeAlias = "str | Method"
"""A method's name, or a configured method."""


def method_names() -> tuple[str, ...]:
    """Return the names that ``method=`` takes."""
    return tuple(_METHODS)


def resolve(method: MethodLike) -> Method:
    """Return the method object for a name or a configured method.

    Raises
    ------
    ValueError
        If the name is unknown.
    TypeError
        If `method` is neither a string nor a method.
    """
    if isinstance(method, str):
        try:
            return _METHODS[method]()
        except KeyError:
            names = ", ".join(_METHODS)
            raise ValueError(f"method: unknown name {method!r}; expected one of {names}") from None
    if isinstance(method, Method):
        return method
    raise TypeError(f"method: expected a name or a method object, got {type(method).__name__}")
