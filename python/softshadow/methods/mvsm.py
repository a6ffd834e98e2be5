"""Multi-view shadow maps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from softshadow.methods.base import Method

__all__ = ["Mvsm"]


@dataclass(frozen=True)
class Mvsm(Method):
    """Ray-traced multi-view shadow maps (Agrawala, Ramamoorthi, Heirich and Moll 2000).

    Shadow maps from the light's centre and its corners; what of a ray one of them does not see is
    followed through the next. See ``docs/methods/mvsm.md``.

    Parameters
    ----------
    resolution : int
        Texels along the longer side of each map, 16 to 16384.
    views : int
        Points of the light that maps are drawn from, 1 to 9: its centre, four corners, and the
        middles of its sides.
    samples : int
        Light samples per receiver, 1 to 65536.
    seed : int
        Of the light samples, 0 to 2**64 - 1.
    gap : float, optional
        Largest difference of depth between neighbouring texels that counts as one surface, world
        units. By default two texels' width.
    bias : float, optional
        How far off their receiver rays start, world units. By default three texels' width.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    resolution: int = 1024
    views: int = 5
    samples: int = 256
    seed: int = 0
    gap: float | None = None
    bias: float | None = None
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "mvsm"
    points: ClassVar[bool] = True
