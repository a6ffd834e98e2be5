"""Hard shadows convolved with the light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from softshadow.methods.base import Method

__all__ = ["Convolution"]


@dataclass(frozen=True)
class Convolution(Method):
    """Hard-shadow textures convolved with the light's image (Soler and Sillion 1998).

    Exact, to a texel, where the light, what casts and the receiver lie in parallel planes; see
    ``docs/methods/convolution.md`` for where it is wrong. Receivers are polygons, as of
    `Accumulation`.

    Parameters
    ----------
    error : float
        The hard shadow is split by the depth of what casts it until no part puts visibility before
        a straight edge off by more than this; above 0, at most 1. With 1 every receiver takes the
        average depth of all that casts on it.
    texel : float, optional
        World size of a texel; by default the scene's largest extent over `max_size`.
    max_size : int
        Most texels along a side, a power of two up to 8192.
    interpolation : {"linear", "nearest"}
        Whether pictures interpolate between the four texels around a pixel.
    memory_limit : float
        Bytes that textures may take; more is an error before any is taken.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    error: float = 0.05
    texel: float | None = None
    max_size: int = 512
    interpolation: Literal["linear", "nearest"] = "linear"
    memory_limit: float = 4e9
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "convolution"
