"""What a camera sees of a mesh."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from softshadow._core import kernels as _kernels
from softshadow.arguments import Bar, Progress, as_mesh
from softshadow.camera import Camera

__all__ = [
    "rasterize",
]

_Floats = npt.NDArray[np.float32]

_Ints = npt.NDArray[np.int32]


def rasterize(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    camera: Camera,
    progress: Progress = False,
) -> tuple[_Ints, _Floats]:
    """Draw a mesh and return the nearest triangle of every pixel.

    A pixel belongs to a triangle when its centre does; a centre on a shared edge belongs to exactly
    one of the triangles there.

    Parameters
    ----------
    vertices, faces
        As in `mesh_edges`.
    camera : Camera
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    triangle_id : ndarray, shape (H, W), int32
        -1 where nothing was hit.
    depth : ndarray, shape (H, W), float32
        Along the viewing axis, world units; inf where nothing was hit.

    Raises
    ------
    ValueError
        If the mesh is invalid, as in `Scene.add`.

    Examples
    --------
    >>> import softshadow as ss
    >>> camera = ss.Camera((0, 0, 5), (0, 0, 0), up=(0, 1, 0), width=32, height=24)
    >>> triangle_id, depth = ss.kernels.rasterize(*ss.scenes.square(1), camera)
    >>> int(triangle_id[0, 0]), float(depth[0, 0]), float(depth[12, 16])
    (-1, inf, 5.0)
    """
    with Bar(progress, "rasterize") as report:
        ids, depth = _kernels.rasterize(*as_mesh(vertices, faces), camera._core, report)
    return ids, depth
