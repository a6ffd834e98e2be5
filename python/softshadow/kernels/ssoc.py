"""The maps of the soft shadow occlusion camera as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from softshadow._core import kernels as _kernels
from softshadow.arguments import Bar, Progress
from softshadow.camera import Camera
from softshadow.light import Light
from softshadow.methods import Ssoc
from softshadow.scene import Scene

__all__ = [
    "OcclusionMaps",
    "ssoc_maps",
]

_Floats = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
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
    progress: Progress = False,
) -> list[OcclusionMaps]:
    """Build the maps of the soft shadow occlusion camera (Mo, Popescu and Wyman 2007).

    `softshadow.visibility` with ``method="ssoc"`` looks points up in them.

    Parameters
    ----------
    scene : Scene
        Opacities do not matter.
    light : RectLight, DiskLight, SphereLight or PolygonLight
        A light of size zero has no distortion maps: they are all 0.
    method : Ssoc, optional
        For its resolution.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

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
    with Bar(progress, "ssoc_maps") as report:
        found = _kernels.ssoc_maps(scene._core, light._core, method or Ssoc(), report)
    return [
        OcclusionMaps(
            Camera.from_matrix(m["K"], m["camera_to_world"], *reversed(m["depth"].shape)),
            m["depth"],
            m["inside"],
            m["outside"],
        )
        for m in found
    ]
