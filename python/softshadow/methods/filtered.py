"""Filtered shadow maps: percentage-closer soft shadows, and deep shadow maps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from softshadow.methods.base import Method

__all__ = ["DeepShadow", "Pcf"]


@dataclass(frozen=True)
class Pcf(Method):
    """Percentage-closer soft shadows, the *Antz* method (in Xie, Tabellion and Pearce 2007).

    A shadow map filtered as widely as the light is seen past what it holds: a first pass over the
    region that can hide the light finds the blockers' depth, a second one counts in the region that
    follows from it. Fast, and wrong by more the larger the light; see ``docs/methods/pcf.md``.

    Parameters
    ----------
    resolution : int
        Texels along the longer side of each map, 16 to 16384.
    layers : int
        Depths kept a texel, 1 to 64; each layer is filtered at its own blockers' depth.
    samples : int
        Light samples per receiver in each pass, 1 to 65536.
    seed : int
        Of the light samples, 0 to 2**64 - 1.
    estimate : {"nearest", "mean"}
        Which depth stands for all blockers: the one nearest to the light (the paper), or the mean
        of their inverse depths.
    bias : float, optional
        How far above a receiver's tangent plane blockers have to be, world units; without a normal,
        how much nearer to the light. By default a texel's width at the receiver.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    resolution: int = 1024
    layers: int = 1
    samples: int = 64
    seed: int = 0
    estimate: Literal["nearest", "mean"] = "nearest"
    bias: float | None = None
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "pcf"
    points: ClassVar[bool] = True


@dataclass(frozen=True)
class DeepShadow(Method):
    """Deep shadow maps (Lokovic and Veach 2000), filtered as `Pcf` filters depths.

    Every texel holds how the light fades with depth along its ray: for fur, and for what is
    translucent. See ``docs/methods/deep.md``.

    Parameters
    ----------
    resolution : int
        Texels along the longer side of each map, 16 to 16384.
    layers : int
        Vertices kept of a texel's fading, 1 to 64.
    samples : int
        Light samples per receiver in each pass, 1 to 65536.
    seed : int
        Of the light samples, 0 to 2**64 - 1.
    error : float
        Largest error of a texel's visibility that leaving vertices out may make, 0 to 1; more where
        they are too many for `layers`.
    estimate, bias
        As of `Pcf`.
    """

    resolution: int = 1024
    layers: int = 8
    samples: int = 64
    seed: int = 0
    error: float = 0.02
    estimate: Literal["nearest", "mean"] = "nearest"
    bias: float | None = None

    name: ClassVar[str] = "deep"
    transparent: ClassVar[bool] = True
    points: ClassVar[bool] = True
