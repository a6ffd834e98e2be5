"""Pictures as files, and the two ways from numbers to grey levels and colours.

*Visibility* is written linearly: 0 is black, 1 is white, and a grey level of 128 in a file means
half of the light. *Radiance* has no natural white: it is scaled by an exposure and then encoded
with the sRGB transfer function.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow.extras import require

__all__ = ["auto_exposure", "check_path", "to_srgb", "write"]

_AUTO_PERCENTILE = 99.0
"""Which of the lit pixels `auto_exposure` makes white. Not 100: one pixel that touches the light
would leave everything else black."""

SUFFIXES = (".png", ".exr", ".npy")
"""The file types that `write` knows."""


def auto_exposure(radiance: npt.ArrayLike) -> float:
    """Return the factor that makes the brightest hundredth of the lit pixels white.

    Parameters
    ----------
    radiance : array_like, shape (H, W, 3)
        Linear RGB.

    Returns
    -------
    float
        One over the 99th percentile of the largest channel, over pixels that are not black; 1 for
        a black image.
    """
    brightest = checks.numbers(radiance, "radiance").max(axis=-1)
    lit = brightest[np.isfinite(brightest) & (brightest > 0)]
    return 1.0 / float(np.percentile(lit, _AUTO_PERCENTILE)) if lit.size else 1.0


def to_srgb(radiance: npt.ArrayLike, exposure: float | None = None) -> npt.NDArray[np.float64]:
    """Return display values of linear radiance: scaled, clipped to 0 to 1, sRGB-encoded.

    Parameters
    ----------
    radiance : array_like, shape (H, W, 3)
        Linear RGB.
    exposure : float, optional
        Factor before encoding; `auto_exposure` when not given. Give the same number to two images
        that are to be compared by eye.

    Returns
    -------
    ndarray, shape (H, W, 3), float64

    Raises
    ------
    ValueError
        If the shape is another, or the exposure is not positive.

    Examples
    --------
    >>> import softshadow as ss
    >>> ss.images.to_srgb([[(0, 0.5, 1)]], exposure=1).round(3).tolist()
    [[[0.0, 0.735, 1.0]]]
    """
    linear = checks.numbers(radiance, "radiance")
    if linear.ndim != 3 or linear.shape[2] != 3:
        raise ValueError(f"radiance: expected shape (H, W, 3), got {linear.shape}")
    if exposure is None:
        exposure = auto_exposure(linear)
    elif not checks.number(exposure, "exposure", "a positive number") > 0:
        raise ValueError(f"exposure: expected a positive number, got {exposure}")
    v = np.clip(linear * exposure, 0.0, 1.0)
    # IEC 61966-2-1: linear near black, where the power's slope would be infinite.
    return np.where(
        v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 0.0031308) ** (1 / 2.4) - 0.055
    )


def check_path(path: str | os.PathLike[str], suffixes: tuple[str, ...] = SUFFIXES) -> Path:
    """Return `path` as a ``Path`` that can be written to.

    Parameters
    ----------
    path : path
    suffixes : tuple of str
        The file types that are allowed; those of `write` when not given.

    Returns
    -------
    Path

    Raises
    ------
    ValueError
        If the suffix is none of these.
    OSError
        If the folder does not exist or the file cannot be written.
    ModuleNotFoundError
        If the extra ``io`` is not installed and the suffix needs it.
    """
    file = Path(path)
    if file.suffix.lower() not in suffixes:
        raise ValueError(
            f"{file}: unknown file type {file.suffix!r}; expected one of {', '.join(suffixes)}"
        )
    if not file.parent.is_dir():
        raise FileNotFoundError(f"{file}: there is no folder {file.parent}")
    if file.is_dir():
        raise IsADirectoryError(f"{file}: is a folder")
    if not os.access(file if file.exists() else file.parent, os.W_OK):
        raise PermissionError(f"{file}: no permission to write")
    writers = {".png": ["imageio.v3"], ".exr": ["OpenEXR"], ".glb": ["PIL"]}
    require("io", f"writing a {file.suffix} file", *writers.get(file.suffix.lower(), []))
    return file


def write(
    path: str | os.PathLike[str], array: npt.ArrayLike, exposure: float | None = None
) -> None:
    """Write an image; the suffix says how.

    ============ ===============================================================================
    ``.png``     8 bits. ``(H, W)``: visibility (0 to 1), linear grey, ``round(255 v)``.
                 ``(H, W, 3)``: radiance, scaled by `exposure` and sRGB-encoded.
    ``.exr``     float32, lossless (ZIP): ``(H, W)`` as channel Y, ``(H, W, 3)`` as R, G, B; linear,
                 no exposure. Integers and float64 are rounded to float32.
    ``.npy``     The array as it is, of any shape.
    ============ ===============================================================================

    Parameters
    ----------
    path : path
    array : array_like, shape (H, W) or (H, W, 3)
    exposure : float, optional
        For radiance as PNG: factor before encoding; `auto_exposure` when not given.

    Raises
    ------
    ValueError
        If the file type is unknown, or the array's shape or values do not fit it.
    OSError
        If the file cannot be written.
    """
    file = check_path(path)
    checks.refuse_masked(array, str(file))
    a = np.asarray(array)
    if a.dtype.kind not in "fiub":
        raise ValueError(f"{file}: expected an array of numbers, got {type(array).__name__}")
    suffix = file.suffix.lower()
    if suffix == ".npy":
        with file.open("wb") as stream:
            np.save(stream, a)
        return
    if a.size == 0 or a.ndim not in (2, 3) or (a.ndim == 3 and a.shape[2] != 3):
        raise ValueError(f"{file}: expected shape (H, W) or (H, W, 3), got {a.shape}")
    if suffix == ".png":
        import imageio.v3 as imageio

        imageio.imwrite(file, _eight_bits(file, a, exposure), extension=".png")
    else:
        _write_exr(file, a)


def _eight_bits(
    file: Path, a: npt.NDArray[np.generic], exposure: float | None
) -> npt.NDArray[np.uint8]:
    values = a.astype(np.float64)
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{file}: some values are not finite; .exr and .npy can hold them")
    if values.ndim == 3:
        display = to_srgb(values, exposure)
    else:
        low, high = float(values.min()), float(values.max())
        if low < 0.0 or high > 1.0:
            raise ValueError(
                f"{file}: expected values from 0 to 1, got {low:g} to {high:g}; "
                ".exr and .npy can hold them"
            )
        display = values
    return np.rint(display * 255.0).astype(np.uint8)


def _write_exr(file: Path, a: npt.NDArray[np.generic]) -> None:
    # imageio is not used: without an EXR plugin it writes a TIFF file under the name .exr.
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    pixels = np.ascontiguousarray(a, dtype=np.float32)
    try:
        OpenEXR.File(header, {"Y" if a.ndim == 2 else "RGB": pixels}).write(str(file))
    except RuntimeError as error:
        raise OSError(f"{file}: cannot be written ({error})") from error
