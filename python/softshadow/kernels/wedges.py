"""Penumbra wedges as arrays, and what they leave of a light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from softshadow._core import kernels as _kernels
from softshadow.arguments import Bar, Progress
from softshadow.camera import Camera
from softshadow.light import Light
from softshadow.methods import Wedges
from softshadow.scene import Scene

__all__ = [
    "PenumbraWedges",
    "light_intensity",
    "wedges",
]

_Floats = npt.NDArray[np.float32]

_Doubles = npt.NDArray[np.float64]

_Ints = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class PenumbraWedges:
    """Penumbra wedges as arrays; W wedges, world coordinates, planes as ``a x + b y + c z = d``.

    Attributes
    ----------
    edges : ndarray, shape (W, 2, 3), float64
        Both ends of the silhouette edge, what is occluded on its left as the light's centre sees
        it; equal for a wedge around a vertex.
    front : ndarray, shape (W, 4), float64
        The lit limit: all of the light is on its outer side. Unit normal, out of the shadow.
    back : ndarray, shape (W, 4), float64
        The umbra's limit: all of the light is on its inner side.
    sides : ndarray, shape (W, 2, 4), float64
        The planes shared with the wedges before and after; normals along the loop.
    directions : ndarray, shape (W, 2, 3), float64
        Unit directions of interpolation in the side planes.
    layers : ndarray, shape (W, 2), int32
        Layers facing the light and facing away that the wedge bounds.
    objects : ndarray, shape (W,), int32
        A number of the connected object that the wedge belongs to.
    """

    edges: _Doubles
    front: _Doubles
    back: _Doubles
    sides: _Doubles
    directions: _Doubles
    layers: _Ints
    objects: _Ints


def wedges(
    scene: Scene,
    light: Light,
    vertex_angle: float = 30.0,
    planes: Literal["tangent", "paper"] = "tangent",
) -> PenumbraWedges:
    """Build the penumbra wedges of everything that casts (Akenine-Möller and Assarsson 2002).

    Wedges follow each other around closed loops. An edge whose line meets the light has none.

    Parameters
    ----------
    scene : Scene
        Opacities do not matter.
    light : RectLight, DiskLight, SphereLight or PolygonLight
    vertex_angle : float
        Degrees, 1 to 180: where neighbouring edges turn by more, further wedges are set between.
    planes : {"tangent", "paper"}
        Whether front and back planes touch the light, or go through ``c ± r n`` of a sphere.

    Returns
    -------
    PenumbraWedges

    Raises
    ------
    ValueError
        If the scene is empty, has spheres that cast, or a parameter is out of its range.
    """
    checked = Wedges(vertex_angle=vertex_angle, planes=planes)
    found = _kernels.wedges(scene._core, light._core, checked.vertex_angle, checked.planes)
    return PenumbraWedges(**found)


def light_intensity(
    scene: Scene,
    camera: Camera,
    light: Light,
    method: Wedges | None = None,
    progress: Progress = False,
) -> _Floats:
    """Rasterise penumbra wedges into a light-intensity buffer and return it before it is clamped.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    light : RectLight, DiskLight, SphereLight or PolygonLight
    method : Wedges, optional
        Its `overlap` does not matter: everything is added.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    ndarray, shape (H, W, 2), float32
        1 less the layers that cover the light, those that face it and those that face away; what
        `Wedges` clamps to 0 to 1 and takes the smaller of. 1 where nothing was hit.

    Raises
    ------
    ValueError
        As `render` with that method.
    """
    with Bar(progress, "light_intensity") as report:
        result: _Floats = _kernels.light_intensity(
            scene._core, camera._core, light._core, method or Wedges(), report
        )
    return result
