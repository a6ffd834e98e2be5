"""A light's maps as pictures: occlusion cameras and layered maps from `softshadow.kernels`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow.kernels import LayeredMap, OcclusionMaps
from softshadow.plot.pictures import no_ticks, own_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["light_map"]

_COLUMNS = 4
_DEPTHS = "viridis"
"""Colours of depths: from dark to bright for every eye; grey is where there is nothing."""


def light_map(light_map: OcclusionMaps | LayeredMap, layers: int = 4) -> Figure:
    """Draw one view of a light's maps.

    Of an occlusion camera (`softshadow.kernels.ssoc_maps`): its depths, and of both sides of the
    silhouettes how far away the nearest silhouette is and the depths that it lies between. Of a
    layered map (`softshadow.kernels.layered_maps`): how many layers each texel has, the depths of
    the first ones, and the visibility behind them where something lets light through.

    Parameters
    ----------
    light_map : OcclusionMaps or LayeredMap
        One of the list that the kernel returns.
    layers : int
        How many layers to draw, at most, the nearest first.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    TypeError
        If it is none of these maps.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> maps = ss.kernels.layered_maps(setup.scene, setup.light, ss.Slsm(resolution=64))
    >>> [ax.get_title() for ax in ss.plot.light_map(maps[0]).axes[:2]]
    ['layers', 'depth of layer 1']
    """
    layers = checks.integer(layers, "layers", 1, 64)
    if isinstance(light_map, OcclusionMaps):
        panels = _occlusion_panels(light_map)
    elif isinstance(light_map, LayeredMap):
        panels = _layered_panels(light_map, layers)
    else:
        got = type(light_map).__name__
        raise TypeError(f"light_map: expected OcclusionMaps or a LayeredMap, got {got}")
    columns = min(len(panels), _COLUMNS)
    lines = -(-len(panels) // columns)
    figure = own_figure((3.3 * columns, 3.1 * lines))
    grid = list(figure.subplots(lines, columns, squeeze=False).flat)
    for ax, (title, values, options) in zip(grid, panels, strict=False):
        shown = ax.imshow(np.ma.masked_invalid(values), interpolation="nearest", **options)
        ax.set_facecolor("0.85")
        ax.set_title(title, fontsize="small")
        no_ticks(ax)
        figure.colorbar(shown, ax=ax, shrink=0.7)
    for ax in grid[len(panels) :]:
        ax.set_axis_off()
    return figure


_Panel = tuple[str, npt.NDArray[np.float64], dict[str, Any]]


def _occlusion_panels(m: OcclusionMaps) -> list[_Panel]:
    panels: list[_Panel] = [("depth", _finite(m.depth), {"cmap": _DEPTHS})]
    rows, columns = np.indices(m.depth.shape)
    for name, channels in (("inside", m.inside), ("outside", m.outside)):
        values = channels.astype(np.float64)
        near = values[..., 5] > 0  # z_far: all 0 where no silhouette is near enough
        # Channels 0 and 1 are the silhouette's column and row; a texel's middle is at + 0.5.
        away = np.hypot(values[..., 0] - columns - 0.5, values[..., 1] - rows - 0.5)
        panels.append(
            (f"{name}: texels to silhouette", np.where(near, away, np.nan), {"cmap": "cividis"})
        )
        for i, what in ((4, "z_near"), (5, "z_far")):
            panels.append(
                (
                    f"{name}: {what}",
                    np.where(near, _finite(values[..., i]), np.nan),
                    {"cmap": _DEPTHS},
                )
            )
    return panels


def _layered_panels(m: LayeredMap, layers: int) -> list[_Panel]:
    depths = _finite(np.asarray(m.depths))
    counts = np.isfinite(depths).sum(axis=2).astype(np.float64)
    panels: list[_Panel] = [("layers", counts, {"cmap": "cividis", "vmin": 0})]
    used = max(int(counts.max()), 1)
    for i in range(min(layers, used)):
        panels.append((f"depth of layer {i + 1}", depths[..., i], {"cmap": _DEPTHS}))
    visibility = m.visibility
    if visibility is not None:
        for i in range(min(layers, used)):
            values = np.where(np.isfinite(depths[..., i]), visibility[..., i], np.nan)
            shades = {"cmap": "gray", "vmin": 0.0, "vmax": 1.0}
            panels.append((f"visibility behind layer {i + 1}", values, shades))
    return panels


def _finite(values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Return float64 with NaN where there is nothing."""
    found = np.asarray(values, dtype=np.float64)
    return np.where(np.isfinite(found), found, np.nan)
