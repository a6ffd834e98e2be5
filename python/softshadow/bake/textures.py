"""The textures that `softshadow.bake` makes, and where they lie on receivers."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from softshadow import images

__all__ = ["BakedTexture", "Polygon", "Side"]

Side: TypeAlias = Literal["light", "front", "back"]
"""Which side of a polygon is baked."""


@dataclass(frozen=True, eq=False)
class Polygon:
    """A receiver polygon: connected triangles of a mesh in one plane, and their texture's place.

    Attributes
    ----------
    receiver : str
        Name of the scene's entry.
    faces : ndarray, shape (K,), int32
        Its triangles in the mesh.
    uv : ndarray, shape (K, 3, 2), float32
        Texture coordinates of their corners, 0 to 1.
    corner : ndarray, shape (3,), float64
        World position of ``u = v = 0``.
    edges : ndarray, shape (2, 3), float64
        World vectors along which u and v go from 0 to 1.
    normal : ndarray, shape (3,), float64
        Unit normal, towards the side that is baked.
    size : tuple of 2 ints
        Texels along u and along v.
    """

    receiver: str
    faces: npt.NDArray[np.int32]
    uv: npt.NDArray[np.float32]
    corner: npt.NDArray[np.float64]
    edges: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float64]
    size: tuple[int, int]

    def texel_positions(self) -> npt.NDArray[np.float64]:
        """Return the world positions of all texels' centres.

        Returns
        -------
        ndarray, shape (H, W, 3), float64
        """
        width, height = self.size
        u = (np.arange(width) + 0.5) / width
        v = 1 - (np.arange(height) + 0.5) / height
        along_u = u[None, :, None] * self.edges[0]
        along_v = v[:, None, None] * self.edges[1]
        positions: npt.NDArray[np.float64] = self.corner + along_u + along_v
        return positions


@dataclass(frozen=True, eq=False)
class BakedTexture:
    """A texture with its place on a receiver. H by W texels.

    Attributes
    ----------
    receiver : str
        Name of the scene's entry.
    faces : ndarray, shape (K,), int32
        The triangles of its mesh that it covers.
    uv : ndarray, shape (K, 3, 2), float32
        Texture coordinates of their corners.
    visibility : ndarray, shape (H, W) or (L, H, W), float32
        Fraction of the light that is seen; (L, H, W) when the lights are a sequence.
    radiance : ndarray, shape (H, W, 3), float32
        Diffuse direct light, linear RGB, the lights summed, with the ambient term.
    modulation : ndarray, shape (H, W) or (L, H, W), float32 or uint8
        What a modulation texture holds: ``ambient + (1 - ambient) visibility``, or the levels of
        ``Accumulation(texture="eight_bit")``.
    mask : ndarray, shape (H, W), bool
        Whether the texel's centre is on the receiver.
    polygon : Polygon or None
        Where the texture lies, if its receiver is planar.
    """

    receiver: str
    faces: npt.NDArray[np.int32]
    uv: npt.NDArray[np.float32]
    visibility: npt.NDArray[np.float32]
    radiance: npt.NDArray[np.float32]
    modulation: npt.NDArray[np.float32] | npt.NDArray[np.uint8]
    mask: npt.NDArray[np.bool_]
    polygon: Polygon | None

    def save(
        self,
        path: str | os.PathLike[str],
        what: Literal["radiance", "modulation", "visibility"] = "radiance",
        exposure: float | None = None,
    ) -> None:
        """Write one of the arrays as ``.png``, ``.exr`` or ``.npy``; see `softshadow.images.write`.

        Several lights' modulation or visibility, and levels as floats, are written as ``.npy``.

        Parameters
        ----------
        path : path
        what : {"radiance", "modulation", "visibility"}
            Which array.
        exposure : float, optional
            Of radiance in a PNG.

        Raises
        ------
        ValueError, OSError
            If `what` is none of these, or as `softshadow.images.write`.
        """
        if what not in ("radiance", "modulation", "visibility"):
            raise ValueError(f"what: expected radiance, modulation or visibility, got {what!r}")
        array = getattr(self, what)
        if array.dtype == np.uint8 and Path(path).suffix.lower() == ".png":
            array = array / np.float32(255)
        images.write(path, array, exposure)
