"""The maps of shadow-map methods as arrays; `softshadow.kernels` has them too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from softshadow._core import kernels as _kernels
from softshadow.camera import Camera
from softshadow.light import Light
from softshadow.methods import Mlsm, Mtsm, Slsm, Ssoc
from softshadow.scene import Scene

__all__ = ["LayeredMap", "OcclusionMaps", "layered_maps", "ssoc_maps"]

_Floats = npt.NDArray[np.float32]
_Ints = npt.NDArray[np.int32]


@dataclass(frozen=True)
class OcclusionMaps:
    """One view of a soft shadow occlusion camera; H by W texels.

    Attributes
    ----------
    camera : Camera
        The view, from the light's centre.
    depth : ndarray, shape (H, W), float32
        The shadow map: depth along the view's axis of the nearest surface that casts, world units;
        inf where there is none.
    inside, outside : ndarray, shape (H, W, 6), float32
        The distortion maps of the dark and of the lit side of silhouettes. Channels: column and row
        of the nearest silhouette point, in texels; the silhouette's unit normal there, in the
        image, to the lit side; ``z_near`` of the edge and ``z_far`` of what lies behind it, world
        units.
        All 0 where no silhouette is near enough to matter.
    """

    camera: Camera
    depth: _Floats
    inside: _Floats
    outside: _Floats


def ssoc_maps(
    scene: Scene,
    light: Light,
    method: Ssoc | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[OcclusionMaps]:
    """Build the maps of the soft shadow occlusion camera (Mo, Popescu and Wyman 2007).

    `softshadow.visibility` with ``method="ssoc"`` looks points up in them.

    Parameters
    ----------
    scene : Scene
        Opacities do not matter.
    light : RectLight, DiskLight or SphereLight
        A light of size zero has no distortion maps: they are all 0.
    method : Ssoc, optional
        For its resolution.
    progress : callable, optional
        Is told the finished fraction.

    Returns
    -------
    list of OcclusionMaps
        One where a single view holds all that casts, otherwise the faces of a cube that something
        casts into; coarser faces that hold only what has nothing behind it come last. Empty if
        nothing casts.

    Raises
    ------
    ValueError
        If the scene is empty, has spheres that cast, or a map does not fit into memory.
    """
    found = _kernels.ssoc_maps(scene._core, light._core, method or Ssoc(), progress)
    return [
        OcclusionMaps(
            Camera.from_matrix(m["K"], m["camera_to_world"], *reversed(m["depth"].shape)),
            m["depth"],
            m["inside"],
            m["outside"],
        )
        for m in found
    ]


@dataclass(frozen=True)
class LayeredMap:
    """One view of a layered shadow map; H by W texels of L layers, the nearest first.

    Attributes
    ----------
    camera : Camera
        The view, from behind the light.
    depths : ndarray, shape (H, W, L), float32
        Depth along the view's axis of a layer's last surface, world units; inf where there is none.
    first_depths : ndarray, shape (H, W, L), float32, or None
        Depth of the first surface that a layer stands for; None, as the rest, if all is opaque.
    visibility : ndarray, shape (H, W, L), float32, or None
        Of the texel's own ray behind a layer, 0 to 1, from 1 at the light or behind what is opaque.
    counts : ndarray, shape (H, W, L), int32, or None
        Surfaces that a layer stands for.
    """

    camera: Camera
    depths: _Floats
    first_depths: _Floats | None
    visibility: _Floats | None
    counts: _Ints | None


def layered_maps(
    scene: Scene,
    light: Light,
    method: Slsm | Mlsm | Mtsm | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[LayeredMap]:
    """Build layered shadow maps (Xie, Tabellion and Pearce 2007, Sections 4.2 and 5.1).

    `softshadow.visibility` with that method traces points through them.

    Parameters
    ----------
    scene : Scene
    light : RectLight, DiskLight or SphereLight
    method : Slsm, Mlsm or Mtsm, optional
        For resolution, layers and compression; ``Mtsm()`` by default.
    progress : callable, optional
        Is told the finished fraction.

    Returns
    -------
    list of LayeredMap
        One of a flat light, and of a sphere that a single view holds; otherwise the faces of a cube
        that something casts into. Coarser ones of what has nothing behind it come last. Empty if
        nothing casts.

    Raises
    ------
    ValueError
        If the scene is empty, has spheres that cast, or transparent meshes that the method does not
        take; if a parameter is out of its range, or a map does not fit into memory.
    """
    chosen = method or Mtsm()
    found = _kernels.layered_maps(scene._core, light._core, chosen, chosen.name, progress)
    return [
        LayeredMap(
            Camera.from_matrix(m["K"], m["camera_to_world"], *reversed(m["depths"].shape[:2])),
            m["depths"],
            m.get("first_depths"),
            m.get("visibility"),
            m.get("counts"),
        )
        for m in found
    ]
