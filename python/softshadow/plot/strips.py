"""Several images with their signed errors: as a strip, and along one row of pixels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from softshadow import checks, metrics
from softshadow.compare import Comparison
from softshadow.images import auto_exposure
from softshadow.plot.pictures import (
    What,
    draw_difference,
    draw_picture,
    own_figure,
    pixels_of,
)
from softshadow.plot.styles import line_styles
from softshadow.render import Image

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["scanline", "strip"]

REFERENCE = "reference"
"""The label of what the others are compared with."""

_WIDEST = 5
"""Images beside each other."""


def strip(
    images: Mapping[str, Image | npt.ArrayLike] | Comparison,
    what: What = "visibility",
    limit: float | None = None,
    rows: slice | None = None,
    columns: slice | None = None,
) -> Figure:
    """Draw images in a strip, and under each its signed error against the reference.

    Red is where an image is brighter than the reference, blue where it is darker; all errors have
    the same colours, so that they can be compared. Strips of more than five images are folded.

    Parameters
    ----------
    images : Comparison, or mapping of str to Image or array_like
        By label, all of one size. The one labelled ``"reference"`` is what the others are compared
        with, and comes first; without it there are no errors.
    what : {"visibility", "radiance"}
        As in `show`. The error of radiances is the mean of the channels'.
    limit : float, optional
        The error at which the colours saturate. When not given: the 99.5th percentile of an image's
        errors, of the image in the middle, so that one bad image does not hide all others' errors.
    rows, columns : slice, optional
        The part to draw; all when not given.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If there is no image, sizes differ, or `limit` is not positive.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> result = ss.compare(setup.scene, setup.camera, setup.light, ["hard", "pcf"], repeats=1)
    >>> figure = ss.plot.strip(result)
    >>> [ax.get_title() for ax in figure.axes[:3]]
    ['reference', 'hard', 'pcf']
    """
    pixels, mask = _stack(images, what)
    part = (rows or slice(None), columns or slice(None))
    pixels = {label: p[part] for label, p in pixels.items()}
    where = mask[part]
    if not where.size:
        raise ValueError("strip: rows and columns leave no pixel")
    differences = _differences(pixels)
    if limit is None:
        limit = _limit(differences, where)
    elif not checks.number(limit, "limit", "a positive number") > 0:
        raise ValueError(f"limit: expected a positive number, got {limit}")
    exposure = _exposure(pixels)

    folds = -(-len(pixels) // _WIDEST)
    across = -(-len(pixels) // folds)  # folds of about the same length
    layers = 2 if differences else 1
    shape = where.shape
    aspect = min(max(shape[0] / shape[1], 0.25), 4.0)
    side = 2.5
    figure = own_figure((side * across + 0.9, folds * (side * aspect + 0.28) * layers))
    grid = figure.subplots(folds * layers, across, squeeze=False)
    shown: Any = None
    for i, (label, picture) in enumerate(pixels.items()):
        line, column = layers * (i // across), i % across
        draw_picture(grid[line, column], picture, exposure)
        grid[line, column].set_title(label, fontsize="small")
        if label in differences:
            below = grid[line + 1, column]
            shown = draw_difference(below, differences[label], where, limit)
            below.set_xlabel(_numbers(picture, pixels[REFERENCE], where), fontsize="x-small")
    for ax in grid.flat:
        if not ax.images:
            ax.set_axis_off()
    if shown is not None:
        bar = figure.colorbar(
            shown, ax=grid, shrink=0.9 / folds, fraction=0.2 / across, pad=0.01, extend="both"
        )
        bar.set_label("error, signed")
    return figure


def scanline(
    images: Mapping[str, Image | npt.ArrayLike] | Comparison,
    row: int | None = None,
    what: What = "visibility",
    ax: Axes | None = None,
) -> Figure:
    """Draw the values along one row of pixels, a line for each image; black is the reference.

    Parameters
    ----------
    images : Comparison, or mapping of str to Image or array_like
        As in `strip`.
    row : int, optional
        From 0 on top; negative from the bottom. When not given, the row with the most penumbra.
    what : {"visibility", "radiance"}
        As in `show`; of radiance the mean of the channels. Gaps are where nothing was hit.
    ax : matplotlib axes, optional
        Where to draw; a new figure when not given, with the row marked in a picture beside it if
        there is more than one.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If there is no image, sizes differ, or there is no such row.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> result = ss.compare(setup.scene, setup.camera, setup.light, ["hard"], repeats=1)
    >>> len(ss.plot.scanline(result, 12).axes[0].lines)
    2
    """
    pixels, mask = _stack(images, what)
    grey = {k: p.mean(axis=2) if p.ndim == 3 else p for k, p in pixels.items()}
    height = mask.shape[0]
    if row is None:
        at = busiest_row(next(iter(grey.values())), mask)
    else:
        at = checks.integer(row, "row", -height, height - 1) % height
    own = ax is None
    if ax is None and height == 1:
        ax = own_figure((8.0, 3.4)).subplots()
    elif ax is None:
        figure = own_figure((11.0, 3.4))
        ax, beside = figure.subplots(1, 2, width_ratios=[2.6, 1])
        draw_picture(beside, next(iter(pixels.values())), _exposure(pixels))
        beside.axhline(at, color="#D55E00", linewidth=1)
        beside.set_title(f"row {at}", fontsize="small")
    axes = cast("Any", ax)
    styles = line_styles(label for label in grey if label != REFERENCE)
    for label, values in grey.items():
        line = np.where(mask[at], values[at], np.nan)
        if label == REFERENCE:
            axes.plot(line, color="black", linewidth=2.5, alpha=0.75, label=label)
            continue
        colour, marker, dashes = styles[label]
        every = max(1, len(line) // 16)
        axes.plot(
            line, color=colour, marker=marker, markevery=every, markersize=3.5, linewidth=0.9,
            linestyle=dashes, label=label,
        )  # fmt: skip
    axes.set_xlabel(f"column, of row {at}")
    axes.set_ylabel(what)
    axes.grid(True, color="0.92")
    axes.set_axisbelow(True)
    legend = axes.figure.legend if own else axes.legend
    legend(fontsize="x-small", frameon=False, loc="outside right upper" if own else "best")
    return cast("Figure", axes.figure)


def busiest_row(visibility: npt.NDArray[np.float64], mask: npt.NDArray[np.bool_]) -> int:
    """Return the row with the most pixels that are partly lit; the middle one if there are none."""
    partly = ((visibility > 0.02) & (visibility < 0.98) & mask).sum(axis=1)
    return int(np.argmax(partly)) if partly.any() else len(partly) // 2


def _stack(
    images: Mapping[str, Image | npt.ArrayLike] | Comparison, what: What
) -> tuple[dict[str, npt.NDArray[np.float64]], npt.NDArray[np.bool_]]:
    """Return what to draw by label, the reference first, and the pixels that all of them hit."""
    given: dict[str, Any]
    if isinstance(images, Comparison):
        given = {REFERENCE: images.reference, **images.images}
    elif isinstance(images, Mapping):
        given = {str(label): image for label, image in images.items()}
    else:
        got = type(images).__name__
        raise TypeError(f"images: expected a mapping of labels to images, got {got}")
    if not given:
        raise ValueError("images: expected at least one")
    if REFERENCE in given:
        given = {REFERENCE: given[REFERENCE], **given}
    pixels = {label: pixels_of(image, what) for label, image in given.items()}
    shapes = {label: p.shape for label, p in pixels.items()}
    if len(set(shapes.values())) > 1:
        raise ValueError(f"images: expected one size, got {shapes}")
    mask = np.ones(next(iter(shapes.values()))[:2], dtype=np.bool_)
    for image in given.values():
        if isinstance(image, Image):
            mask &= image.mask
    return pixels, mask


def _differences(
    pixels: dict[str, npt.NDArray[np.float64]],
) -> dict[str, npt.NDArray[np.float64]]:
    if REFERENCE not in pixels:
        return {}
    found = {k: p - pixels[REFERENCE] for k, p in pixels.items() if k != REFERENCE}
    return {k: d.mean(axis=2) if d.ndim == 3 else d for k, d in found.items()}


def _limit(differences: dict[str, npt.NDArray[np.float64]], where: npt.NDArray[np.bool_]) -> float:
    """Return the colours' end: that of the image whose errors are in the middle."""
    sizes = [np.abs(d[where]) for d in differences.values()]
    if not sizes or not where.any():
        return 1.0
    found = float(np.median([np.percentile(s, 99.5) for s in sizes]))
    return found or max(float(s.max()) for s in sizes) or 1.0


def _exposure(pixels: dict[str, npt.NDArray[np.float64]]) -> float | None:
    first = next(iter(pixels.values()))
    return auto_exposure(first) if first.ndim == 3 else None


def _numbers(
    picture: npt.NDArray[np.float64],
    reference: npt.NDArray[np.float64],
    where: npt.NDArray[np.bool_],
) -> str:
    if not where.any():
        return ""
    chosen = where if picture.ndim == 2 else np.broadcast_to(where[..., None], picture.shape)
    mae = metrics.mae(picture, reference, chosen)
    return f"MAE {mae:.2g}, bias {metrics.bias(picture, reference, chosen):+.1g}"
