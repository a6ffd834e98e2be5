"""Layered shadow maps: of one layer, of several, and of several that let light through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from softshadow.methods.base import Method

__all__ = ["Mlsm", "Mtsm", "Slsm"]


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
    near: ClassVar[float] = 0.0
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
    near : float
        Texels, 0 to 65536: up to where a receiver sees the light as wide as so many texels of the
        map, the scene's triangles answer and the map does not. 0: the map alone, as the paper
        has it.
    """

    resolution: int | None = None
    layers: int | None = None
    samples: int = 256
    seed: int = 0
    z_threshold: float | None = None
    bias: float = 0.0
    detail: float = 40.0
    near: float = 24.0
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
    resolution, layers, samples, seed, z_threshold, bias, detail, near
        As of `Mlsm`; with ``crossing="subtract"`` the map alone answers.
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

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.tilted_sheet(32, 24, opacity=0.5)
    >>> image = ss.render(setup.scene, setup.camera, setup.light, ss.Mtsm(resolution=64))
    >>> round(float(image.visibility[12, 16]), 3)
    0.5
    """

    resolution: int | None = None
    layers: int | None = None
    samples: int = 256
    seed: int = 0
    z_threshold: float | None = None
    bias: float = 0.0
    detail: float = 40.0
    near: float = 24.0
    error: float = 0.02
    threshold: float = 1 / 512
    resets: int = 4
    crossing: Literal["multiply", "subtract"] = "multiply"
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "mtsm"
    transparent: ClassVar[bool] = True
    points: ClassVar[bool] = True
