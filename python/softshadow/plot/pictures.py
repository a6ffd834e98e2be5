"""One image, or two and their signed difference; what the other figures draw pictures with."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from softshadow import checks, metrics
from softshadow.extras import needs
from softshadow.images import auto_exposure, to_srgb
from softshadow.render import Image

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

What: TypeAlias = Literal["visibility", "radiance"]
"""Which of an image's arrays to look at."""

__all__ = ["compare", "show"]


def show(
    image: Image | npt.ArrayLike,
    what: What = "visibility",
    ax: Axes | None = None,
    exposure: float | None = None,
) -> Figure:
    """Draw an image.

    Parameters
    ----------
    image : Image or array_like
        An array is drawn by its shape: ``(H, W)`` as visibility, ``(H, W, 3)`` as radiance.
    what : {"visibility", "radiance"}
        Which of an `Image`'s arrays. Visibility is linear grey, black for 0 and white for 1;
        several lights: their mean. Radiance is scaled by `exposure` and sRGB-encoded.
    ax : matplotlib axes, optional
        Where to draw; a new figure when not given.
    exposure : float, optional
        For radiance; `softshadow.images.auto_exposure` when not given.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> image = ss.render(setup.scene, setup.camera, setup.light, "hard")
    >>> figure = ss.plot.show(image, what="radiance")
    >>> len(figure.axes)
    1
    """
    pixels = pixels_of(image, what)
    if ax is None:
        ax = figure_for(pixels.shape, 1).subplots()
    draw_picture(ax, pixels, exposure)
    ax.set_title(what if isinstance(image, Image) else "")
    return cast("Figure", ax.figure)


def compare(
    a: Image | npt.ArrayLike,
    b: Image | npt.ArrayLike,
    what: What = "visibility",
    labels: tuple[str, str] = ("a", "b"),
    limit: float | None = None,
    exposure: float | None = None,
) -> Figure:
    """Draw two images side by side with their signed difference ``a - b``.

    Red is where ``a`` is brighter, blue where it is darker, white where they are equal. The
    difference's title gives the mean absolute, root mean square, largest absolute and mean signed
    error of ``a`` against ``b``, over the pixels where a surface was hit (all pixels, for arrays).

    Parameters
    ----------
    a, b : Image or array_like
        Of the same size; arrays are drawn by their shape, as in `show`.
    what : {"visibility", "radiance"}
        Which of an `Image`'s arrays. The difference of radiances is the mean of the channels'.
    labels : pair of str
        Titles of the two images.
    limit : float, optional
        The difference at which the colours saturate; the largest one, when not given.
    exposure : float, optional
        For radiance, of both images; `softshadow.images.auto_exposure` of `b` when not given.

    Returns
    -------
    matplotlib.figure.Figure
        With three panels and a colour bar.

    Raises
    ------
    ValueError
        If the sizes differ, or `limit` is not positive.
    """
    first, second = pixels_of(a, what), pixels_of(b, what)
    if first.shape != second.shape:
        raise ValueError(f"a has shape {first.shape}, b {second.shape}: they must be equal")
    where = np.ones(first.shape[:2], dtype=np.bool_)
    for image in (a, b):
        if isinstance(image, Image):
            where &= image.mask
    if not where.any():
        raise ValueError("compare: no pixel in which both images hit a surface")
    difference = first - second
    if difference.ndim == 3:
        difference = difference.mean(axis=2)
        where_all = np.broadcast_to(where[..., None], first.shape)
        exposure = auto_exposure(second) if exposure is None else exposure
    else:
        where_all = where
    if limit is None:
        limit = float(np.abs(difference[where]).max()) or 1.0
    elif not limit > 0:
        raise ValueError(f"limit: expected a positive number, got {limit}")

    figure = figure_for(first.shape, 3)
    axes = figure.subplots(1, 3)
    for ax, pixels, label in zip(axes, (first, second), labels, strict=False):
        draw_picture(ax, pixels, exposure)
        ax.set_title(label)
    shown = draw_difference(axes[2], difference, where, limit)
    figure.colorbar(shown, ax=axes[2], shrink=0.8)
    numbers = {
        "mae": metrics.mae(first, second, where_all),
        "rmse": metrics.rmse(first, second, where_all),
        "max": metrics.maximum(first, second, where_all),
        "bias": metrics.bias(first, second, where_all),
    }
    axes[2].set_title(
        f"{labels[0]} − {labels[1]}\n"
        f"MAE {numbers['mae']:.3g}, RMSE {numbers['rmse']:.3g},\n"
        f"max {numbers['max']:.3g}, bias {numbers['bias']:+.2g}",
        fontsize="medium",
    )
    return figure


def pixels_of(image: Image | npt.ArrayLike, what: str) -> npt.NDArray[np.float64]:
    """Return what to draw: (H, W) visibility, or (H, W, 3) linear radiance."""
    if what not in ("visibility", "radiance"):
        raise ValueError(f"what: expected 'visibility' or 'radiance', got {what!r}")
    if isinstance(image, Image):
        values = np.asarray(getattr(image, what), dtype=np.float64)
        if what == "visibility" and values.ndim == 3:
            values = values.mean(axis=0)
        return values
    checks.refuse_masked(image, "image")
    array = np.asarray(image)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"expected an Image or an array of numbers, got {type(image).__name__}")
    values = array.astype(np.float64)
    if values.size == 0 or values.ndim not in (2, 3) or (values.ndim == 3 and values.shape[2] != 3):
        raise ValueError(f"expected an array of shape (H, W) or (H, W, 3), got {values.shape}")
    return values


def figure_for(shape: tuple[int, ...], panels: int) -> Figure:
    """Return a figure whose panels have about the images' aspect ratio."""
    side = 4.0
    aspect = min(max(shape[0] / shape[1], 0.25), 4.0)
    width = side * min(1.0, 1.0 / aspect) + 0.3
    height = side * min(1.0, aspect) + (0.4 if panels == 1 else 1.0)
    extra = 0.0 if panels == 1 else 0.8  # the colour bar
    return own_figure((panels * width + extra, height))


def own_figure(size: tuple[float, float]) -> Figure:
    """Return an empty figure of a size in inches that Jupyter shows and pyplot does not know."""
    with needs("plot", "softshadow.plot"):
        from softshadow.figure import OwnFigure

    return OwnFigure(figsize=size, layout="constrained")


def draw_picture(ax: Axes, pixels: npt.NDArray[np.float64], exposure: float | None) -> None:
    """Draw visibility as linear grey, radiance sRGB-encoded."""
    if pixels.ndim == 3:
        ax.imshow(to_srgb(pixels, exposure), interpolation="nearest")
    else:
        ax.imshow(pixels, cmap="gray", vmin=0.0, vmax=1.0, interpolation="nearest")
    no_ticks(ax)


def draw_difference(
    ax: Axes, difference: npt.NDArray[np.float64], where: npt.NDArray[np.bool_], limit: float
) -> Any:
    """Draw signed errors, red where positive and blue where negative, and return what is shown."""
    shown = ax.imshow(
        np.ma.masked_array(difference, ~where),
        cmap="RdBu_r",
        vmin=-limit,
        vmax=limit,
        interpolation="nearest",
    )
    ax.set_facecolor("0.85")
    no_ticks(ax)
    return shown


def no_ticks(ax: Any) -> None:
    """Take the ticks off a picture's axes."""
    ax.set_xticks([])
    ax.set_yticks([])
