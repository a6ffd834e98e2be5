"""Averaged hard-shadow textures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from softshadow.methods.base import Method

__all__ = ["Accumulation"]


@dataclass(frozen=True)
class Accumulation(Method):
    """Averaged hard-shadow textures (Herf and Heckbert 1996).

    Every receiver polygon (coplanar connected triangles of a mesh) has a texture: the mean of the
    hard shadows from points of the light, drawn by flattening the occluders onto the polygon. At
    texels' centres that is `RayTraced` with ``pattern="fixed"`` and the same samples and seed;
    pictures interpolate between them. See ``docs/methods/accumulation.md``, and `bake` for the
    textures themselves.

    Parameters
    ----------
    samples : int
        Light points, 1 to 65536: a texture has ``samples + 1`` levels. Powers of two are stratified
        best.
    seed : int
        Of the light points, 0 to 2**64 - 1.
    texture : {"radiance", "modulation", "eight_bit"}
        Whether textures hold the irradiance from every light point, with its own cosines and
        distance; only the fraction of points that is seen, the unshadowed light coming from its
        closed form; or that fraction in eight bits, drawn by adding ``(256 - a) / samples`` for
        every point seen (`samples` must divide ``256 - a``, ``a = round(256 ambient)``).
    ambient : float
        What textures hold without any light: a level of modulation, 0 to 1, or of a radiance
        texture the radiance that comes from everywhere. Only in the textures of `bake`, not in
        pictures.
    texel : float, optional
        World size of a texel; by default the scene's largest extent over `max_size`. Textures have
        powers of two as sides, so texels are up to twice as small.
    max_size : int
        Most texels along a side, a power of two up to 8192 (the paper: 256).
    interpolation : {"linear", "nearest"}
        Whether pictures interpolate between the four texels around a pixel.
    memory_limit : float
        Bytes that textures may take; more is an error before any is taken.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light. Without, each crossing
        multiplies transmittance.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> method = ss.Accumulation(samples=16, max_size=64)
    >>> ss.render(setup.scene, setup.camera, setup.light, method).visibility.shape
    (24, 32)
    """

    samples: int = 128
    seed: int = 0
    texture: Literal["radiance", "modulation", "eight_bit"] = "radiance"
    ambient: float = 0.0
    texel: float | None = None
    max_size: int = 1024
    interpolation: Literal["linear", "nearest"] = "linear"
    memory_limit: float = 4e9
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "accumulation"
    transparent: ClassVar[bool] = True
