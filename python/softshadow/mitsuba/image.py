"""What Mitsuba renders, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["MitsubaImage"]


@dataclass(frozen=True, eq=False)
class MitsubaImage:
    """What `render` returns; arrays are indexed ``[y, x]``, row 0 on top.

    Attributes
    ----------
    radiance : ndarray, shape (H, W, 3), float64
        Mean over the samples, linear RGB. The monochromatic variants repeat one channel.
    variance : ndarray, shape (H, W, 3), float64
        Estimated variance of that mean (not of a single sample), from `batches` independent means.
    mask : ndarray, shape (H, W), bool
        Whether a surface was hit.
    normal : ndarray, shape (H, W, 3), float32
        Geometric unit normals at the pixels' centres, turned to the camera; 0 where nothing was
        hit. On edges, single precision may see the other face.
    samples : int
        Light samples per pixel.
    batches : int
        Independent means that `variance` was estimated from; it has ``batches - 1`` degrees of
        freedom.
    seconds : float
        Wall-clock time of sampling, without loading the scene.
    """

    radiance: npt.NDArray[np.float64]
    variance: npt.NDArray[np.float64]
    mask: npt.NDArray[np.bool_]
    normal: npt.NDArray[np.float32]
    samples: int
    batches: int
    seconds: float
