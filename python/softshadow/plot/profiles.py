"""One row of a light's maps, seen from the side: layers, and the rays of an occlusion camera."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow.extras import needs
from softshadow.kernels import LayeredMap, OcclusionMaps
from softshadow.plot.pictures import own_figure
from softshadow.plot.styles import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["bent_rays", "layers"]

_Doubles = npt.NDArray[np.float64]

_NAMED = 8
"""Layers in the legend."""

_STEPS = 200
"""Points of a ray: its curve is smooth in a figure."""


def layers(light_map: LayeredMap, row: int, column: int | None = None) -> Figure:
    """Draw the layers of one row of a map, the light on top, and how light fades along one texel.

    Layers are dark to bright from the first to the last.

    Parameters
    ----------
    light_map : LayeredMap
        One of `softshadow.kernels.layered_maps`.
    row : int
        From 0; negative from the end.
    column : int, optional
        The texel whose visibility is drawn against depth, with its layers marked; when not given,
        the one of the row with the most layers, of several the middle one.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    TypeError
        If it is no layered map.
    ValueError
        If there is no such row or column, or the row is empty.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.tilted_sheet(32, 24, opacity=0.5, sheets=2)
    >>> maps = ss.kernels.layered_maps(setup.scene, setup.light, ss.Mtsm(resolution=64))
    >>> figure = ss.plot.layers(maps[0], row=32)
    >>> figure.axes[0].get_ylabel()
    'depth'
    """
    if not isinstance(light_map, LayeredMap):
        raise TypeError(f"light_map: expected a LayeredMap, got {type(light_map).__name__}")
    height, width, _ = light_map.depths.shape
    at = checks.integer(row, "row", -height, height - 1) % height
    depths = light_map.depths[at]
    there = np.isfinite(depths)
    if not there.any():
        raise ValueError(f"row: nothing is in row {at}")
    if column is None:
        counts = there.sum(axis=1)
        fullest = np.flatnonzero(counts == counts.max())
        texel = int(fullest[len(fullest) // 2])
    else:
        texel = checks.integer(column, "column", -width, width - 1) % width
    with needs("plot", "softshadow.plot"):
        from matplotlib import colormaps
    figure = own_figure((11.0, 4.0))
    side, along = figure.subplots(1, 2, width_ratios=[2.4, 1], sharey=True)
    shades = colormaps["viridis"]
    used = int(there.any(axis=0).sum())  # layers without gaps, the first ones
    for i in range(used):
        columns = np.flatnonzero(there[:, i])
        label = f"layer {i + 1}" if i < _NAMED else "_"
        side.plot(
            columns, depths[columns, i], ".", color=shades(0.9 * i / max(used - 1, 1)),
            markersize=3, label=label,
        )  # fmt: skip
    side.axvline(texel, color="0.6", linewidth=1, zorder=0)
    side.set_ylim(*sorted(side.get_ylim(), reverse=True))
    side.set_xlabel(f"column, of row {at}")
    side.set_ylabel("depth")
    side.legend(fontsize="x-small", markerscale=3, frameon=False, ncols=2)
    _fading(along, light_map, at, texel)
    return figure


def bent_rays(
    light_map: OcclusionMaps, radius: float, row: int | None = None, every: int = 8
) -> Figure:
    """Draw rays of an occlusion camera from the side, as one row of its maps bends them.

    A ray that passes a silhouette bends behind it towards the shadow (Mo, Popescu and Wyman 2007,
    Figure 2c): at depth ``z`` it has moved by as much as the penumbra is wide there, so that the
    camera sees all that some of the light sees. Grey dots are the shadow map.

    Parameters
    ----------
    light_map : OcclusionMaps
        One of `softshadow.kernels.ssoc_maps`.
    radius : float
        The light's, across the silhouettes of that row; world units.
    row : int, optional
        From 0; negative from the end; the middle one when not given.
    every : int
        Of so many texels one has a ray.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    TypeError
        If it is no map of an occlusion camera.
    ValueError
        If there is no such row, it is empty, or a number is out of its range.
    """
    if not isinstance(light_map, OcclusionMaps):
        raise TypeError(f"light_map: expected OcclusionMaps, got {type(light_map).__name__}")
    if not checks.number(radius, "radius", "a positive number") > 0:
        raise ValueError(f"radius: expected a positive number, got {radius}")
    height, width = light_map.depth.shape
    at = height // 2 if row is None else checks.integer(row, "row", -height, height - 1) % height
    step = checks.integer(every, "every", 1, width)
    depth = light_map.depth[at].astype(np.float64)
    seen = np.isfinite(depth)
    if not seen.any():
        raise ValueError(f"row: nothing is in row {at}")
    focal, middle = light_map.camera.K[0, 0], light_map.camera.K[0, 2]
    columns = np.arange(width) + 0.5
    figure = own_figure((8.0, 5.0))
    ax: Any = figure.subplots()
    for texel in np.flatnonzero(seen)[::step]:
        z = np.linspace(0.0, depth[texel], _STEPS)[1:]
        place = columns[texel] + _moved(light_map, at, int(texel), focal * radius, z)
        bent = np.abs(place - columns[texel]).max() > 0
        ax.plot(
            (place - middle) / focal * z, z, linewidth=0.9 if bent else 0.5, zorder=2 + bent,
            color=COLOURS[3] if bent else COLOURS[4],
        )  # fmt: skip
    surface = depth[seen]
    ax.plot((columns[seen] - middle) / focal * surface, surface, ".", color="0.4", markersize=3)
    ax.plot([-radius, radius], [0, 0], color=COLOURS[1], linewidth=4, solid_capstyle="butt")
    ax.invert_yaxis()
    ax.set_xlabel("beside the axis, world units")
    ax.set_ylabel("depth")
    ax.set_title("straight rays (light blue) and rays that bend behind a silhouette (orange)")
    return figure


def _moved(m: OcclusionMaps, row: int, column: int, reach: float, z: _Doubles) -> _Doubles:
    """Return how many texels to the side a texel's ray is at each depth.

    With ``x`` the texel's signed distance from the silhouette and ``w`` the penumbra's half-width
    at ``z``, a receiver at ``x'`` is moved by ``(w - x') / 2`` (equation 1). What arrives at ``x``
    is at ``x' = 2 x - w``, once ``w`` is larger than ``x``.
    """
    near = m.outside[row, column].astype(np.float64)
    if near[5] <= 0:
        return np.zeros_like(z)
    x = (column + 0.5 - near[0]) * near[2] + (row + 0.5 - near[1]) * near[3]
    w = np.maximum(reach * (1 / near[4] - 1 / z), 0.0)
    result: _Doubles = np.where((w > x) & (x > 0), x - w, 0.0) * near[2]
    return result


def _fading(ax: Any, m: LayeredMap, row: int, column: int) -> None:
    """Draw a texel's visibility against depth, which falls at every layer's last surface."""
    found = np.isfinite(m.depths[row, column])
    depths = m.depths[row, column][found]
    behind = np.zeros(len(depths)) if m.visibility is None else m.visibility[row, column][found]
    top, bottom = sorted(ax.get_ylim())
    values, places = [1.0], [top]
    for depth, after in zip(depths, behind, strict=True):
        if after > values[-1]:  # behind what ended all light a texel starts from 1 again
            values += [math.nan, 1.0]
            places += [math.nan, places[-1]]
        values += [values[-1], float(after)]
        places += [float(depth)] * 2
    ax.plot([*values, values[-1]], [*places, bottom], color="black", linewidth=1.5)
    ax.plot(behind, depths, "o", color="black", markersize=4)
    ax.set_xlim(-0.05, 1.05)
    ax.set_xlabel("visibility behind a layer")
    ax.set_title(f"texel {column} of row {row}", fontsize="medium")
