"""The soft shadow occlusion camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from softshadow.methods.base import Method

__all__ = ["Ssoc"]


@dataclass(frozen=True)
class Ssoc(Method):
    """The soft shadow occlusion camera (Mo, Popescu and Wyman 2007).

    A shadow map from the light's centre and two distortion maps beside it, which say for every
    texel which silhouette edge is nearest: a receiver's place in that edge's penumbra is how far it
    has to be moved in the map to be seen. Fast, and for lights that are small against their
    distance; see ``docs/methods/ssoc.md`` for where it is wrong.

    Parameters
    ----------
    resolution : int
        Texels along the longer side of each map, 16 to 16384.
    steps : int
        Distortions tried for a receiver, 1 to 8, so that penumbrae that overlap combine; 1 is the
        paper's naive lookup.
    falloff : {"light", "linear", "smooth"}
        How visibility falls off across a penumbra: by the area of the light beyond a line, in
        closed form; linearly; or as ``3 s**2 - 2 s**3`` (the paper).
    interpolate : bool
        Interpolate the lookups from the four texels around a receiver, as the paper; ``False``
        takes the one that it lies in.
    thin : bool
        Look for light past the other side of occluders that are thinner than the penumbra (not in
        the paper's method; a wider search, as its Section 6 suggests).
    distorted : bool
        Compare distorted receivers with what the camera's distorted rays see (the reference image
        of the paper's Section 4), instead of with what the shadow map has at the distorted place.
        Removes false umbrae where what lies behind an edge varies quickly in depth, and takes most
        of the guessing out of points without normals; costs a ray for every texel near an edge.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    resolution: int = 1024
    steps: int = 3
    falloff: Literal["light", "linear", "smooth"] = "light"
    interpolate: bool = True
    thin: bool = True
    distorted: bool = False
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "ssoc"
    points: ClassVar[bool] = True
