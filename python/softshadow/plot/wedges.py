"""Penumbra wedges as pictures: silhouettes, planes and light-intensity buffers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow.camera import Camera
from softshadow.extras import needs
from softshadow.kernels import PenumbraWedges, light_samples
from softshadow.light import PlacedLight
from softshadow.plot.pictures import draw_picture, no_ticks, own_figure, pixels_of
from softshadow.plot.styles import COLOURS
from softshadow.render import Image

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["light_intensity", "silhouettes", "wedges"]

_Doubles = npt.NDArray[np.float64]

LIT, UMBRA = COLOURS[0], COLOURS[3]
"""Of front planes, beyond which all is lit, and of back planes, behind which nothing is."""


def wedges(
    found: PenumbraWedges,
    light: PlacedLight,
    height: float = 0.0,
    visibility: npt.ArrayLike | None = None,
    extent: tuple[float, float, float, float] | None = None,
) -> Figure:
    """Draw penumbra wedges in space, and where a horizontal plane cuts them.

    Blue are the front planes, the limit of what is lit; orange the back planes, the limit of the
    umbra; black the silhouette edges.

    Parameters
    ----------
    found : PenumbraWedges
        Of `softshadow.kernels.wedges`; few of them, or the picture is full.
    light : RectLight, DiskLight, SphereLight or PolygonLight
        That the wedges were built for.
    height : float
        Where the plane is, z in world units, below all edges.
    visibility : array_like, shape (H, W), optional
        On that plane, row 0 at the largest y: drawn behind the cut.
    extent : tuple of 4 floats, optional
        What `visibility` covers: least and largest x, least and largest y.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If there is no wedge, a wedge does not reach the plane, or one of `visibility` and `extent`
        is given without the other.

    Examples
    --------
    >>> import softshadow as ss
    >>> scene = ss.Scene()
    >>> scene.add(ss.scenes.square(0.5, z=1))
    'mesh'
    >>> light = ss.SphereLight((0, 0, 3), 0.2)
    >>> figure = ss.plot.wedges(ss.kernels.wedges(scene, light), light)
    >>> [ax.get_title() for ax in figure.axes]
    ['wedges', 'cut at z = 0']
    """
    if (visibility is None) != (extent is None):
        raise ValueError("visibility and extent: expected both or none")
    if len(found.edges) == 0:
        raise ValueError("wedges: there is none")
    fronts = _feet(found, found.front, light, height)
    backs = _feet(found, found.back, light, height)
    figure = own_figure((10.0, 4.8))
    with needs("plot", "softshadow.plot"):
        import mpl_toolkits.mplot3d  # noqa: F401  (registers the projection)
    space = figure.add_subplot(1, 2, 1, projection="3d")
    _draw_space(space, found.edges, (fronts, backs), light)
    cut = figure.add_subplot(1, 2, 2)
    if visibility is not None:
        shown = pixels_of(visibility, "visibility")
        cut.imshow(shown, cmap="gray", vmin=0, vmax=1, extent=extent)
    named = (
        ("front planes: lit outside", fronts, LIT),
        ("back planes: umbra inside", backs, UMBRA),
    )
    for label, feet, colour in named:
        _lines(cut, feet, colour, label)
    over = "black" if visibility is None else "0.5"
    _lines(cut, found.edges, over, "silhouette, from above")
    cut.set_aspect("equal")
    cut.set_title(f"cut at z = {height:g}")
    cut.set_xlabel("x")
    cut.set_ylabel("y")
    figure.legend(loc="outside lower center", ncols=3, fontsize="small", frameon=False)
    return figure


def silhouettes(
    image: Image | npt.ArrayLike, camera: Camera, edges: npt.ArrayLike, ax: Axes | None = None
) -> Figure:
    """Draw an image with line segments of its scene over it, such as the edges of wedges.

    Parameters
    ----------
    image : Image or array_like, shape (H, W) or (H, W, 3)
        As in `show`; of an `Image` its radiance.
    camera : Camera
        Of the image.
    edges : array_like, shape (N, 2, 3)
        World coordinates of both ends, as in `softshadow.kernels.PenumbraWedges`. What a surface
        hides is drawn, too; segments that reach behind the camera are left out.
    ax : matplotlib axes, optional
        Where to draw; a new figure when not given.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If the edges' shape is another, or the image's size is not the camera's.
    """
    pixels = pixels_of(image, "radiance")
    if pixels.shape[:2] != (camera.height, camera.width):
        got = pixels.shape[:2]
        raise ValueError(
            f"image: its shape {got} is not the camera's {camera.height, camera.width}"
        )
    ends = checks.numbers(edges, "edges")
    if ends.ndim != 3 or ends.shape[1:] != (2, 3):
        raise ValueError(f"edges: expected shape (N, 2, 3), got {ends.shape}")
    view = np.linalg.inv(camera.camera_to_world)
    projected = (ends @ view[:3, :3].T + view[:3, 3]) @ camera.K.T
    ahead = projected[(projected[..., 2] > 0).all(axis=1)]
    # A pixel's middle is at + 0.5 for cameras, and at a whole number in pictures.
    lines = ahead[..., :2] / ahead[..., 2:] - 0.5
    if ax is None:
        ax = own_figure((6.0, 0.3 + 5.7 * pixels.shape[0] / pixels.shape[1])).subplots()
    with needs("plot", "softshadow.plot"):
        from matplotlib.collections import LineCollection
    draw_picture(ax, pixels, None)
    ax.add_collection(LineCollection(list(lines), colors=UMBRA, linewidths=1.2), autolim=False)
    return cast("Figure", ax.figure)


def light_intensity(buffer: npt.ArrayLike) -> Figure:
    """Draw a light-intensity buffer before it is clamped, and what it becomes.

    Values from 0 to 1 are from black to white; orange is what is below 0, where shadows were
    subtracted more than once, blue what is above 1.

    Parameters
    ----------
    buffer : array_like, shape (H, W, 2)
        Of `softshadow.kernels.light_intensity`: layers that face the light, and that face away.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If the shape is another.
    """
    values = checks.numbers(buffer, "buffer")
    if values.ndim != 3 or values.shape[2] != 2:
        raise ValueError(f"buffer: expected shape (H, W, 2), got {values.shape}")
    aspect = values.shape[0] / values.shape[1]
    figure = own_figure((11.0, 0.6 + 3.2 * aspect))
    axes = figure.subplots(1, 3)
    with needs("plot", "softshadow.plot"):
        from matplotlib import colormaps

    grey = colormaps["gray"].with_extremes(under=COLOURS[3], over=COLOURS[0])
    for ax, values_of, title in zip(
        axes, np.moveaxis(values, 2, 0), ("layers that face the light", "layers that face away"),
        strict=False,
    ):  # fmt: skip
        # A rounding below 0 or above 1 is neither.
        shown = ax.imshow(values_of, cmap=grey, vmin=-1e-4, vmax=1 + 1e-4, interpolation="nearest")
        low, high = values_of.min(), values_of.max()
        ax.set_title(f"{title}\n{low:.2f} to {high:.2f}", fontsize="medium")
        no_ticks(ax)
    figure.colorbar(shown, ax=axes[:2], shrink=0.8, extend="both", label="light intensity")
    draw_picture(axes[2], np.clip(values, 0, 1).min(axis=2), None)
    axes[2].set_title("clamped, the smaller:\nvisibility", fontsize="medium")
    return figure


def _lines(ax: Any, ends: _Doubles, colour: str, label: str) -> None:
    """Draw segments from above, with one entry in the legend."""
    for i, line in enumerate(ends):
        ax.plot(*line[:, :2].T, color=colour, linewidth=1.4, label=label if i == 0 else "_")


def _feet(found: PenumbraWedges, planes: _Doubles, light: PlacedLight, height: float) -> _Doubles:
    """Return where the lines of planes and side planes from an edge's ends meet z = height.

    Shape (W, 2, 3): of the ends of each edge.
    """
    along = np.cross(planes[:, None, :3], found.sides[..., :3])
    away = found.edges - np.asarray(light.center)
    along *= np.sign(np.sum(along * away, axis=-1, keepdims=True))
    drop = height - found.edges[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = drop / along[..., 2]
    if not (np.isfinite(steps) & (steps > 0)).all():
        raise ValueError(f"height: a wedge does not reach z = {height:g}")
    result: _Doubles = found.edges + steps[..., None] * along
    return result


def _draw_space(
    ax: Any, edges: _Doubles, feet: tuple[_Doubles, _Doubles], light: PlacedLight
) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    for lower, colour in zip(feet, (LIT, UMBRA), strict=True):
        quads = np.concatenate([edges, lower[:, ::-1]], axis=1)
        ax.add_collection3d(
            Poly3DCollection(list(quads), facecolor=colour, edgecolor=colour, alpha=0.25)
        )
    ax.add_collection3d(Line3DCollection(list(edges), colors="black", linewidths=2))
    points = light_samples(light, edges.mean(axis=(0, 1)), 128)[0]
    ax.scatter(*points.T, s=3, color=COLOURS[1])
    whole = np.concatenate([edges.reshape(-1, 3), points, *(f.reshape(-1, 3) for f in feet)])
    low, high = whole.min(axis=0), whole.max(axis=0)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    ax.set_box_aspect(np.maximum(high - low, 1e-9))
    ax.locator_params(nbins=4)
    ax.tick_params(labelsize="x-small")
    ax.set(xlabel="x", ylabel="y", zlabel="z", title="wedges")
    ax.view_init(elev=18, azim=-60)
