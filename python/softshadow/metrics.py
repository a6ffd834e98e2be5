"""How wrong a picture is: error numbers against a reference, and the widths of penumbrae.

All functions take arrays of the same shape: ``(H, W)``, or ``(L, H, W)`` for several lights;
``where`` selects pixels and may have fewer axes, as NumPy broadcasts. Sums are in float64. The
pointwise ones (`mae` to `maximum`) take any shape, so radiance works too; the others are about
visibility.

Arrays that do not fit together, values that are not finite where they are looked at, and a `where`
that selects nothing raise ``ValueError``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow.extras import needs

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pandas as pd

__all__ = [
    "PENUMBRA_TOLERANCE",
    "bias",
    "confusion",
    "errors",
    "flip",
    "mae",
    "maximum",
    "penumbra_mask",
    "penumbra_width",
    "percentile99",
    "rmse",
    "ssim",
]

PENUMBRA_TOLERANCE = 1e-6
"""How near to 0 or 1 a visibility counts as umbra or lit.

Above the rounding of a float32 sum of sample weights (a few times 6e-8), which can leave a fully
lit pixel at 0.9999999; below the smallest step of a sampled reference (1/65536 = 1.5e-5), whose
pixels with a single blocked sample are penumbra. Much larger, and the penumbra's faint rim, where
methods differ most, is not looked at.
"""

_SSIM_WINDOW = 7
"""Side of skimage's default window: images must be as large, and half of it is lost at borders."""


def mae(
    image: npt.ArrayLike, reference: npt.ArrayLike, where: npt.ArrayLike | None = None
) -> float:
    """Return the mean absolute error.

    Parameters
    ----------
    image, reference : array_like, same shape
    where : array_like of bool, optional
        The pixels that count; all, when not given.

    Returns
    -------
    float

    Examples
    --------
    >>> import softshadow as ss
    >>> ss.metrics.mae([[0.0, 1.0]], [[0.5, 1.0]])
    0.25
    """
    return float(np.mean(np.abs(_difference(image, reference, where))))


def rmse(
    image: npt.ArrayLike, reference: npt.ArrayLike, where: npt.ArrayLike | None = None
) -> float:
    """Return the root of the mean squared error.

    Parameters
    ----------
    image, reference : array_like, same shape
    where : array_like of bool, optional
        The pixels that count; all, when not given.

    Returns
    -------
    float

    Examples
    --------
    >>> import softshadow as ss
    >>> ss.metrics.rmse([[0.0, 1.0]], [[0.5, 1.0]], where=[[True, False]])
    0.5
    """
    return float(np.sqrt(np.mean(np.square(_difference(image, reference, where)))))


def bias(
    image: npt.ArrayLike, reference: npt.ArrayLike, where: npt.ArrayLike | None = None
) -> float:
    """Return the mean of ``image - reference``: positive when too bright.

    Noise averages out of it; what remains is what more samples would not mend.

    Parameters
    ----------
    image, reference : array_like, same shape
    where : array_like of bool, optional
        The pixels that count; all, when not given.

    Returns
    -------
    float
    """
    return float(np.mean(_difference(image, reference, where)))


def percentile99(
    image: npt.ArrayLike, reference: npt.ArrayLike, where: npt.ArrayLike | None = None
) -> float:
    """Return the 99th percentile of the absolute error.

    Between two pixels it interpolates linearly, as ``numpy.percentile`` does.

    Parameters
    ----------
    image, reference : array_like, same shape
    where : array_like of bool, optional
        The pixels that count; all, when not given.

    Returns
    -------
    float
    """
    return float(np.percentile(np.abs(_difference(image, reference, where)), 99.0))


def maximum(
    image: npt.ArrayLike, reference: npt.ArrayLike, where: npt.ArrayLike | None = None
) -> float:
    """Return the largest absolute error.

    Parameters
    ----------
    image, reference : array_like, same shape
    where : array_like of bool, optional
        The pixels that count; all, when not given.

    Returns
    -------
    float
    """
    return float(np.max(np.abs(_difference(image, reference, where))))


def ssim(
    image: npt.ArrayLike, reference: npt.ArrayLike, where: npt.ArrayLike | None = None
) -> float:
    """Return the structural similarity of two visibilities; 1 means equal.

    It is ``skimage.metrics.structural_similarity`` with ``data_range=1``. With `where`, pixels
    outside of it are taken as lit in both, as `render` fills pixels where nothing was hit, and the
    mean is over the pixels of `where` that are at least 3 pixels from the border (skimage's mean
    leaves the border out, too). Several lights: the mean over them.

    Parameters
    ----------
    image, reference : array_like, shape (H, W) or (L, H, W)
        At least 7 by 7 pixels.
    where : array_like of bool, optional
        The pixels that count; all, when not given.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        If the image is too small, or `where` selects nothing but border.
    """
    with needs("metrics", "ssim"):
        from skimage.metrics import structural_similarity

    margin = _SSIM_WINDOW // 2
    values = []
    for a, b, chosen in _layers(image, reference, where):
        if min(a.shape) < _SSIM_WINDOW:
            raise ValueError(
                f"ssim: needs at least {_SSIM_WINDOW} x {_SSIM_WINDOW} pixels, got {a.shape}"
            )
        _, similarity = structural_similarity(a, b, data_range=1.0, full=True)
        inner = np.s_[margin:-margin, margin:-margin]
        values.append(similarity[inner][chosen[inner]])
    kept = np.concatenate(values)
    if not len(kept):
        raise ValueError(f"ssim: where selects only pixels within {margin} of the border")
    return float(np.mean(kept, dtype=np.float64))


def flip(
    image: npt.ArrayLike, reference: npt.ArrayLike, where: npt.ArrayLike | None = None
) -> float:
    """Return the mean LDR-FLIP error of two visibilities, 0 (equal) to 1.

    The visibilities are taken as sRGB grey levels, which is how `softshadow.images.write` and
    `softshadow.plot.show` display them, clipped to 0 to 1 as a display does; viewing distance is
    FLIP's default, 67 pixels per degree. With `where`, pixels outside of it are taken as lit in
    both, and the mean is over `where`. Several lights: the mean over them.

    Parameters
    ----------
    image, reference : array_like, shape (H, W) or (L, H, W)
    where : array_like of bool, optional
        The pixels that count; all, when not given.

    Returns
    -------
    float
    """
    with needs("metrics", "flip"):
        import flip_evaluator

    values = []
    for a, b, chosen in _layers(image, reference, where):
        test, truth = (
            np.repeat(np.clip(x, 0.0, 1.0).astype(np.float32)[..., None], 3, axis=2) for x in (a, b)
        )
        error, _, _ = flip_evaluator.evaluate(truth, test, "LDR", applyMagma=False)
        values.append(error[..., 0][chosen])
    return float(np.mean(np.concatenate(values), dtype=np.float64))


def penumbra_mask(
    reference: npt.ArrayLike,
    tolerance: float = PENUMBRA_TOLERANCE,
    where: npt.ArrayLike | None = None,
) -> npt.NDArray[np.bool_]:
    """Return the pixels that the reference sees partly lit.

    With the default tolerance a sampled value of exactly 0 or 1 is not penumbra and every other
    one is (`PENUMBRA_TOLERANCE`). The mask of a sampled reference thus misses the rim where less
    than about one sample's share of the light is blocked or seen. Pixels whose tangent plane cuts
    the light count, too: they are partly lit.

    Parameters
    ----------
    reference : array_like, any shape
        Visibility.
    tolerance : float
        ``tolerance < visibility < 1 - tolerance`` is penumbra; 0 to 0.5.
    where : array_like of bool, optional
        False outside of it.

    Returns
    -------
    ndarray of bool, shape of `reference`

    Examples
    --------
    >>> import softshadow as ss
    >>> ss.metrics.penumbra_mask([0.0, 0.25, 1.0]).tolist()
    [False, True, False]
    """
    values = _array(reference, "reference")
    chosen = _where(where, values.shape)
    _finite(values, chosen, "reference")
    partly: npt.NDArray[np.bool_] = np.equal(_classes(values, tolerance, chosen), 1)
    return partly


def confusion(
    image: npt.ArrayLike,
    reference: npt.ArrayLike,
    tolerance: float = PENUMBRA_TOLERANCE,
    where: npt.ArrayLike | None = None,
) -> pd.DataFrame:
    """Return how many pixels of each kind the image takes for which kind.

    Parameters
    ----------
    image, reference : array_like, same shape
        Visibility.
    tolerance : float
        Up to it is umbra, from ``1 - tolerance`` on is lit, between is penumbra; 0 to 0.5.
    where : array_like of bool, optional
        The pixels that count; all, when not given.

    Returns
    -------
    pandas.DataFrame, 3 by 3, int
        Rows (axis named ``reference``) and columns (axis named ``image``) are ``umbra``,
        ``penumbra``, ``lit``; the diagonal is agreement.
    """
    with needs("metrics", "confusion"):
        import pandas as pd

    a, b, chosen = _pair(image, reference, where)
    kinds = ["umbra", "penumbra", "lit"]
    cell = 3 * _classes(b, tolerance, chosen)[chosen] + _classes(a, tolerance, chosen)[chosen]
    table: pd.DataFrame = pd.DataFrame(
        np.bincount(cell, minlength=9).reshape(3, 3),
        index=pd.Index(kinds, name="reference"),
        columns=pd.Index(kinds, name="image"),
    )
    return table


def penumbra_width(
    values: npt.ArrayLike,
    positions: npt.ArrayLike | None = None,
    low: float = 0.05,
    high: float = 0.95,
    where: npt.ArrayLike | None = None,
) -> float:
    """Return the width of the one penumbra that a scanline crosses.

    It is the distance from where visibility leaves `low` to where it reaches `high`, linearly
    interpolated between pixels; the scanline may run from umbra to lit or back. Where it crosses a
    level several times (noise, banding) the outermost crossing counts: the last one before the
    umbra and before the light, so noise widens and never narrows.

    Parameters
    ----------
    values : array_like, shape (N,)
        Visibility along the scanline.
    positions : array_like, shape (N,), optional
        Where the values are, increasing or decreasing; pixel numbers when not given. The width is
        in their unit.
    low, high : float
        Levels of visibility, ``0 <= low < high <= 1``; absolute, not relative to the scanline.
    where : array_like of bool, shape (N,), optional
        Pixels outside of it are left out, and bridged linearly.

    Returns
    -------
    float
        NaN when the scanline does not run from one level to the other: unless one of its ends is
        at or below `low` and the other at or above `high`, there is no whole penumbra to measure.
        Cut a scanline through several penumbrae into pieces.

    Raises
    ------
    ValueError
        If an argument's shape or range does not fit, or fewer than two pixels are left.

    Examples
    --------
    >>> import softshadow as ss
    >>> ss.metrics.penumbra_width([0.0, 0.0, 0.5, 1.0, 1.0], low=0.0, high=1.0)
    2.0
    """
    v = _array(values, "values")
    if v.ndim != 1:
        raise ValueError(f"values: expected one scanline of shape (N,), got shape {v.shape}")
    x = np.arange(len(v), dtype=np.float64) if positions is None else _array(positions, "positions")
    if x.shape != v.shape:
        raise ValueError(f"positions: expected shape {v.shape} as the values, got {x.shape}")
    if not 0.0 <= low < high <= 1.0:
        raise ValueError(f"penumbra_width: expected 0 <= low < high <= 1, got {low} and {high}")
    chosen = _where(where, v.shape)
    _finite(v, chosen, "values")
    _finite(x, chosen, "positions")
    v, x = v[chosen], x[chosen]
    if len(v) < 2:
        raise ValueError(f"penumbra_width: needs at least 2 pixels, got {len(v)}")
    steps = np.diff(x)
    if not (np.all(steps > 0) or np.all(steps < 0)):
        raise ValueError("positions: expected strictly increasing or strictly decreasing numbers")
    if v[0] > v[-1]:
        v, x = v[::-1], x[::-1]
    if v[0] > low or v[-1] < high:
        return math.nan
    leaves = int(np.argmax(v > low))
    arrives = len(v) - int(np.argmax(v[::-1] < high))
    return abs(_crossing(x, v, arrives, high) - _crossing(x, v, leaves, low))


def errors(
    image: npt.ArrayLike, reference: npt.ArrayLike, mask: npt.ArrayLike | None = None
) -> dict[str, float]:
    """Return all error numbers of a visibility, over the image and over the penumbra.

    Parameters
    ----------
    image, reference : array_like, shape (H, W) or (L, H, W)
        Visibility.
    mask : array_like of bool, optional
        The pixels that count; all, when not given. Usually ``image.mask``: background flatters.

    Returns
    -------
    dict
        ``mae``, ``rmse``, ``bias``, ``p99``, ``max``, ``ssim``, ``flip`` over the mask (``ssim`` is
        NaN where it is not defined: images below 7 pixels, masks along the border only);
        ``penumbra_mae``, ``penumbra_rmse``, ``penumbra_bias``, ``penumbra_p99``, ``penumbra_max``
        over the reference's penumbra in the mask (`penumbra_mask`; NaN when it has none); and
        ``penumbra_share``, the penumbra's share of the mask's pixels.

    Raises
    ------
    ValueError
        If shapes do not fit, a value in the mask is not finite, or the mask is empty.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> hard, soft = (
    ...     ss.render(setup.scene, setup.camera, setup.light, m) for m in ("hard", "ray_traced")
    ... )
    >>> errors = ss.metrics.errors(hard.visibility, soft.visibility, soft.mask)
    >>> errors["penumbra_mae"] > errors["mae"] > 0
    True
    """
    a, b, chosen = _pair(image, reference, mask)
    pointwise = {"mae": mae, "rmse": rmse, "bias": bias, "p99": percentile99, "max": maximum}
    result = {name: function(a, b, chosen) for name, function in pointwise.items()}
    result["ssim"] = _ssim_or_nan(a, b, chosen)
    result["flip"] = flip(a, b, chosen)
    penumbra = penumbra_mask(b, where=chosen)
    some = bool(penumbra.any())
    for name, function in pointwise.items():
        result[f"penumbra_{name}"] = function(a, b, penumbra) if some else math.nan
    result["penumbra_share"] = float(penumbra.sum() / chosen.sum())
    return result


def _ssim_or_nan(
    a: npt.NDArray[np.float64], b: npt.NDArray[np.float64], chosen: npt.NDArray[np.bool_]
) -> float:
    margin = _SSIM_WINDOW // 2
    inner = chosen[..., margin:-margin, margin:-margin]
    return ssim(a, b, chosen) if inner.any() else math.nan


def _array(values: npt.ArrayLike, what: str) -> npt.NDArray[np.float64]:
    checks.refuse_masked(values, what)
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise ValueError(
            f"{what}: expected an array of numbers (such as image.visibility), "
            f"got {type(values).__name__}"
        )
    return array.astype(np.float64, copy=False)


def _where(where: npt.ArrayLike | None, shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
    if where is None:
        chosen = np.ones(shape, dtype=np.bool_)
    else:
        checks.refuse_masked(where, "where", "booleans")
        mask = np.asarray(where)
        if mask.dtype.kind != "b":
            raise ValueError(f"where: expected booleans, got dtype {mask.dtype}")
        try:
            chosen = np.broadcast_to(mask, shape)
        except ValueError:
            raise ValueError(
                f"where: shape {mask.shape} does not fit the image's shape {shape}"
            ) from None
    if not chosen.any():
        raise ValueError(f"where: no pixel of {shape} is selected")
    return chosen


def _finite(values: npt.NDArray[np.float64], chosen: npt.NDArray[np.bool_], what: str) -> None:
    wrong = chosen & ~np.isfinite(values)
    if wrong.any():
        first = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise ValueError(
            f"{what}: {int(wrong.sum())} values are not finite, the first at index {first}"
        )


def _pair(
    image: npt.ArrayLike, reference: npt.ArrayLike, where: npt.ArrayLike | None
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    a, b = _array(image, "image"), _array(reference, "reference")
    if a.shape != b.shape:
        raise ValueError(f"image has shape {a.shape}, reference {b.shape}: they must be equal")
    chosen = _where(where, a.shape)
    _finite(a, chosen, "image")
    _finite(b, chosen, "reference")
    return a, b, chosen


def _difference(
    image: npt.ArrayLike, reference: npt.ArrayLike, where: npt.ArrayLike | None
) -> npt.NDArray[np.float64]:
    a, b, chosen = _pair(image, reference, where)
    return a[chosen] - b[chosen]


def _layers(
    image: npt.ArrayLike, reference: npt.ArrayLike, where: npt.ArrayLike | None
) -> Iterator[tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.bool_]]]:
    """Yield 2-D images one light at a time, lit outside `where`."""
    a, b, chosen = _pair(image, reference, where)
    if a.ndim not in (2, 3):
        raise ValueError(f"image: expected shape (H, W) or (L, H, W), got {a.shape}")
    shape = (-1, *a.shape[-2:])
    for x, y, w in zip(a.reshape(shape), b.reshape(shape), chosen.reshape(shape), strict=True):
        yield np.where(w, x, 1.0), np.where(w, y, 1.0), w


def _classes(
    values: npt.NDArray[np.float64], tolerance: float, chosen: npt.NDArray[np.bool_]
) -> npt.NDArray[np.int64]:
    """Return 0 for umbra, 1 for penumbra and 2 for lit; 0 outside `chosen`."""
    if not 0.0 <= tolerance < 0.5:
        raise ValueError(f"tolerance: expected 0 <= tolerance < 0.5, got {tolerance}")
    v = np.where(chosen, values, 0.0)
    return (v > tolerance).astype(np.int64) + (v >= 1.0 - tolerance)


def _crossing(
    x: npt.NDArray[np.float64], v: npt.NDArray[np.float64], after: int, level: float
) -> float:
    """Return where the line from pixel ``after - 1`` to `after` has the level."""
    share = (level - v[after - 1]) / (v[after] - v[after - 1])
    return float(x[after - 1] + share * (x[after] - x[after - 1]))
