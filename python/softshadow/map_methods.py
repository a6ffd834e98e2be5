"""The methods on shadow maps: traced (layered, multi-view) and filtered ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from softshadow.method import Method

__all__ = ["DeepShadow", "Mlsm", "Mtsm", "Mvsm", "Pcf", "Slsm"]


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


@dataclass(frozen=True)
class Slsm(Method):
    """Ray-traced single-layer shadow maps (Xie, Tabellion and Pearce 2007, Section 4).

    One shadow map, drawn from behind the light; segments from a receiver to points of the light are
    traced through it. What the first surface hides from the light's centre is missing and lets
    light through; see ``docs/methods/mtsm.md``.

    Parameters
    ----------
    resolution : int, optional
        Texels along the longer side of each map, 16 to 16384. ``None``: from the number of
        triangles, 1024 or 2048.
    samples : int
        Light samples per receiver, 1 to 65536.
    seed : int
        Of the light samples, 0 to 2**64 - 1.
    z_threshold : float, optional
        Thickness of surfaces to either side, world units. By default none: a texel's piece of a
        surface has its triangle's slope, and covers without gaps.
    bias : float
        How far above a receiver's tangent plane occluders have to be, world units, beside what the
        texels' slopes ask for.
    detail : float
        Texels that are told apart across a light which a receiver sees through the whole of a
        map, 1 to 65536; where it sees it through a part, as many times the cube root of the part.
        Where there are more, coarser levels of the map answer.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    resolution: int | None = 1024
    samples: int = 256
    seed: int = 0
    z_threshold: float | None = None
    bias: float = 0.0
    detail: float = 40.0
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "slsm"
    points: ClassVar[bool] = True
    # What the kernel asks of all three and users of `Mtsm` choose.
    layers: ClassVar[int] = 1
    error: ClassVar[float] = 0.0
    threshold: ClassVar[float] = 0.0
    resets: ClassVar[int] = 0
    crossing: ClassVar[str] = "multiply"


@dataclass(frozen=True)
class Mlsm(Method):
    """Ray-traced multilayer shadow maps (Xie, Tabellion and Pearce 2007, Section 4).

    As `Slsm`, with a few surfaces of every texel: of the nearest, twice as many, those that are
    farthest behind one another. See ``docs/methods/mtsm.md``.

    Parameters
    ----------
    resolution : int, optional
        Texels along the longer side of each map, 16 to 16384. ``None``: from the number of
        triangles, 1024 or 2048.
    layers : int, optional
        Surfaces kept of a texel, 1 to 64. ``None``: from the scene's depth complexity, 1 to 8.
    samples, seed, z_threshold, bias, detail, opacity
        As of `Slsm`.
    """

    resolution: int | None = None
    layers: int | None = None
    samples: int = 256
    seed: int = 0
    z_threshold: float | None = None
    bias: float = 0.0
    detail: float = 40.0
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "mlsm"
    points: ClassVar[bool] = True
    error: ClassVar[float] = 0.0
    threshold: ClassVar[float] = 0.0
    resets: ClassVar[int] = 0
    crossing: ClassVar[str] = "multiply"


@dataclass(frozen=True)
class Mtsm(Method):
    """Ray-traced multilayer transparent shadow maps (Xie, Tabellion and Pearce 2007, Section 5).

    As `Mlsm`, and layers may let light through: where a texel's ray crosses more surfaces than
    there are layers, runs of them become one layer that knows how many it stands for. Of an opaque
    scene it is the same to the last bit. See ``docs/methods/mtsm.md``.

    Parameters
    ----------
    resolution, layers, samples, seed, z_threshold, bias, detail
        As of `Mlsm`.
    error : float
        Largest error of a texel's visibility that making crossings one layer may cause, 0 to 1;
        more where they are too many for `layers`.
    threshold : float
        Transmittance, 0 to 1, at and below which a light sample counts as hidden.
    resets : int
        How often a texel's visibility starts from 1 again behind what is opaque, 0 to 64.
    crossing : {"multiply", "subtract"}
        Whether a crossing multiplies a segment's transmittance, or subtracts what it takes from the
        texel's own ray (the paper's equation 3 as printed: too light where a segment has not
        crossed the layers before).
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light.
    """

    resolution: int | None = None
    layers: int | None = None
    samples: int = 256
    seed: int = 0
    z_threshold: float | None = None
    bias: float = 0.0
    detail: float = 40.0
    error: float = 0.02
    threshold: float = 1 / 512
    resets: int = 4
    crossing: Literal["multiply", "subtract"] = "multiply"
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "mtsm"
    transparent: ClassVar[bool] = True
    points: ClassVar[bool] = True
