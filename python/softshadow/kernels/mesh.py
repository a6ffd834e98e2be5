"""Meshes and curves as arrays: edges, silhouettes, tubes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow._core import kernels as _kernels
from softshadow.arguments import Vector, as_mesh, as_vector
from softshadow.entries import SIDES, curve_arrays

__all__ = [
    "curve_tubes",
    "mesh_edges",
    "silhouette_edges",
    "silhouette_loops",
]

_Doubles = npt.NDArray[np.float64]

_Ints = npt.NDArray[np.int32]


def mesh_edges(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> tuple[_Ints, _Ints]:
    """Find a mesh's edges and how many faces meet at each.

    Parameters
    ----------
    vertices : array_like, shape (V, 3)
        Vertices at exactly equal positions count as one.
    faces : array_like of int, shape (F, 3)

    Returns
    -------
    edges : ndarray, shape (E, 2), int32
        Vertex pairs, the lower index first, sorted; of joined vertices the lowest index is used.
    counts : ndarray, shape (E,), int32
        1 at a boundary, 2 where the mesh is manifold, more elsewhere.

    Raises
    ------
    ValueError
        If the mesh is invalid, as in `Scene.add`.

    Examples
    --------
    >>> import softshadow as ss
    >>> edges, counts = ss.kernels.mesh_edges(*ss.scenes.square(1))
    >>> int(counts[edges.tolist().index([0, 2])])  # the diagonal
    2
    """
    edges, counts = _kernels.mesh_edges(*as_mesh(vertices, faces))
    return edges, counts


def curve_tubes(
    points: npt.ArrayLike, offsets: npt.ArrayLike, radii: npt.ArrayLike, sides: int = 3
) -> tuple[_Doubles, npt.NDArray[np.int64]]:
    """Make curves into closed tubes, as `Scene.add_curves` does.

    Cross-sections are regular polygons, without twist from point to point, mitred at bends and
    closed by caps at both ends. Their perimeter is that of a circle of the curve's radius, so that
    a tube looks as wide as a round one, averaged over the directions around it (Cauchy).

    Parameters
    ----------
    points, offsets, radii, sides
        As in `Scene.add_curves`.

    Returns
    -------
    vertices : ndarray, shape (P * sides, 3), float64
        `sides` around every point, in the points' order.
    faces : ndarray, shape (F, 3), int64
        Outward; a curve of n points has ``2 * sides * (n - 1) + 2 * (sides - 2)``.

    Raises
    ------
    ValueError, TypeError
        As `Scene.add_curves`.
    """
    arrays = curve_arrays("curves", points, offsets, radii)
    n = checks.integer(sides, "curves: sides", *SIDES)
    vertices, faces = _kernels.curve_tubes("curves", *arrays, n)
    return vertices, faces


def silhouette_edges(
    vertices: npt.ArrayLike, faces: npt.ArrayLike, viewpoint: Vector
) -> tuple[_Ints, _Ints]:
    """Find the silhouette edges that a point sees.

    An edge between a face in front of the point and one behind it (Akenine-Möller and Assarsson
    2002, Section 3), an edge with one face, and an edge with more faces of which different numbers
    lie on its two sides as the point sees it. Sides are decided by an exact predicate.

    Parameters
    ----------
    vertices, faces
        As in `mesh_edges`.
    viewpoint : array_like, shape (3,)
        Usually a light's centre.

    Returns
    -------
    edges : ndarray, shape (S, 2), int32
        Vertex pairs, the lower index first.
    windings : ndarray, shape (S,), int32
        Layers of occlusion on the left of the edge less those on its right, as the point sees it
        looking along the edge; 0 where layers that face the point and layers that face away cancel,
        as between two faces wound against each other. At every vertex as much enters as leaves.

    Raises
    ------
    ValueError
        If the mesh is invalid, as in `Scene.add`.
    """
    edges, windings = _kernels.silhouette_edges(
        *as_mesh(vertices, faces), as_vector(viewpoint, "viewpoint")
    )
    return edges, windings


def silhouette_loops(
    vertices: npt.ArrayLike, faces: npt.ArrayLike, viewpoint: Vector
) -> list[_Ints]:
    """Order the silhouette edges that a point sees into closed loops.

    A loop bounds one layer of occlusion, which lies on its left as the point sees it; an edge that
    bounds n layers is in n loops. Layers that face the point and layers that face away have loops
    of their own, unless every edge bounds the same layers of both: then, as for a closed body, a
    loop stands for one of each. Where several edges leave a vertex, a loop takes the one that turns
    most to the left, so that loops touch and do not cross.

    Parameters
    ----------
    vertices, faces
        As in `mesh_edges`.
    viewpoint : array_like, shape (3,)
        Usually a light's centre.

    Returns
    -------
    list of ndarray, shape (n,), int32
        The vertices of each loop, the first not repeated; of joined vertices the lowest index is
        used. Empty if nothing is seen other than edge-on.

    Raises
    ------
    ValueError
        If the mesh is invalid, as in `Scene.add`.

    Examples
    --------
    >>> import softshadow as ss
    >>> [loop.tolist() for loop in ss.kernels.silhouette_loops(*ss.scenes.square(1), (0, 0, 5))]
    [[0, 1, 2, 3]]
    """
    loops: list[_Ints] = _kernels.silhouette_loops(
        *as_mesh(vertices, faces), as_vector(viewpoint, "viewpoint")
    )
    return loops
