"""The pieces that methods are made of, as functions from arrays to arrays.

Everything here works in world coordinates. Points are rounded to ``float32`` relative to the middle
of the scene (or mesh) at hand, which costs half a unit in the last place of its size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from softshadow._core import kernels as _kernels
from softshadow.camera import Camera
from softshadow.light import Light, Vector, as_vector
from softshadow.methods import Mlsm, Mtsm, Slsm, Ssoc, Wedges
from softshadow.scene import Scene, _curve_arrays

__all__ = [
    "LayeredMap",
    "OcclusionMaps",
    "PenumbraWedges",
    "curve_tubes",
    "layered_maps",
    "light_fraction_above",
    "light_intensity",
    "light_samples",
    "mesh_edges",
    "rasterize",
    "silhouette_edges",
    "silhouette_loops",
    "ssoc_maps",
    "transmittance",
    "unshadowed_irradiance",
    "wedges",
]

_Floats = npt.NDArray[np.float32]
_Doubles = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int32]


def _points(array: npt.ArrayLike, what: str) -> _Doubles:
    result = np.ascontiguousarray(np.asarray(array, dtype=np.float64))
    if result.ndim != 2 or result.shape[1] != 3:
        raise ValueError(f"{what}: expected shape (N, 3), got {result.shape}")
    return result


def _faces(array: npt.ArrayLike) -> npt.NDArray[np.int64]:
    result = np.asarray(array)
    if result.shape == (0,):  # an empty list
        result = result.reshape(0, 3)
    if result.ndim != 2 or result.shape[1] != 3:
        raise ValueError(f"faces: expected shape (F, 3), got {result.shape}")
    if result.size and result.dtype.kind not in "iu":
        raise TypeError(f"faces: expected integers, got dtype {result.dtype}")
    return np.ascontiguousarray(result, dtype=np.int64)


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
    """
    edges, counts = _kernels.mesh_edges(_points(vertices, "vertices"), _faces(faces))
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
    arrays = _curve_arrays("curves", points, offsets, radii)
    vertices, faces = _kernels.curve_tubes("curves", *arrays, sides)
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
        _points(vertices, "vertices"), _faces(faces), as_vector(viewpoint, "viewpoint")
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
    """
    loops: list[_Ints] = _kernels.silhouette_loops(
        _points(vertices, "vertices"), _faces(faces), as_vector(viewpoint, "viewpoint")
    )
    return loops


def rasterize(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    camera: Camera,
    progress: Callable[[float], None] | None = None,
) -> tuple[_Ints, _Floats]:
    """Draw a mesh and return the nearest triangle of every pixel.

    A pixel belongs to a triangle when its centre does; a centre on a shared edge belongs to exactly
    one of the triangles there.

    Parameters
    ----------
    vertices, faces
        As in `mesh_edges`.
    camera : Camera
    progress : callable, optional
        Is told the finished fraction.

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
    """
    ids, depth = _kernels.rasterize(
        _points(vertices, "vertices"), _faces(faces), camera._core, progress
    )
    return ids, depth


def transmittance(
    scene: Scene,
    origins: npt.ArrayLike,
    targets: npt.ArrayLike,
    progress: Callable[[float], None] | None = None,
) -> _Floats:
    """Trace segments against what casts in a scene.

    A surface is crossed where the segment passes through it with its ends strictly on different
    sides; a segment through an edge or a vertex that triangles share crosses one of them. There is
    no epsilon: move an origin off its surface before the call.

    Parameters
    ----------
    scene : Scene
        Its hierarchy is built at the first call and kept with it.
    origins, targets : array_like, shape (N, 3)
        Ends of the segments, world units.
    progress : callable, optional
        Is told the finished fraction.

    Returns
    -------
    ndarray, shape (N,), float32
        Product of ``1 - opacity`` over all crossings: 0 where blocked, 1 where free.

    Raises
    ------
    ValueError
        If the shapes differ or a coordinate is not finite.
    """
    result: _Floats = _kernels.transmittance(
        scene._core, _points(origins, "origins"), _points(targets, "targets"), progress
    )
    return result


def unshadowed_irradiance(light: Light, points: npt.ArrayLike, normals: npt.ArrayLike) -> _Doubles:
    """Return the irradiance from a whole light of radiance 1, without occluders, in closed form.

    Lambert's contour formula; the part of the light under the tangent plane is cut off.

    Parameters
    ----------
    light : RectLight, DiskLight or SphereLight
    points, normals : array_like, shape (N, 3)

    Returns
    -------
    ndarray, shape (N,), float64
    """
    result: _Doubles = _kernels.unshadowed_irradiance(
        light._core, _points(points, "points"), _points(normals, "normals")
    )
    return result


def light_fraction_above(
    light: Light, points: npt.ArrayLike, normals: npt.ArrayLike | None = None
) -> _Doubles:
    """Return the fraction of a light above each point's tangent plane and emitting towards it.

    By area for flat lights, by solid angle for spheres; in closed form.

    Parameters
    ----------
    light : RectLight, DiskLight or SphereLight
    points : array_like, shape (N, 3)
    normals : array_like, shape (N, 3), optional
        None: no tangent plane.

    Returns
    -------
    ndarray, shape (N,), float64
    """
    n = None if normals is None else _points(normals, "normals")
    result: _Doubles = _kernels.light_fraction_above(light._core, _points(points, "points"), n)
    return result


def light_samples(
    light: Light, point: Vector, samples: int = 256, seed: int = 0
) -> tuple[_Doubles, _Floats, _Floats]:
    """Return the light points that ``RayTraced(pattern="fixed")`` uses at a point.

    Uniform in area on flat lights, uniform in the solid angle seen from `point` on spheres. Of
    ``2 n`` samples, ``n`` are those of ``n`` samples with the same seed.

    Parameters
    ----------
    light : RectLight, DiskLight or SphereLight
    point : array_like, shape (3,)
        The receiver.
    samples : int
        1 to 65536; powers of two are stratified best.
    seed : int

    Returns
    -------
    points : ndarray, shape (samples, 3), float64
    weights : ndarray, shape (samples,), float32
        Irradiance from each sample at radiance 1 onto a surface that faces it; 0 where the light
        does not emit towards the point.
    colours : ndarray, shape (samples, 3), float32
        Radiance of each sample.
    """
    points, weights, colours = _kernels.light_samples(
        light._core, as_vector(point, "point"), samples, seed
    )
    return points, weights, colours


@dataclass(frozen=True)
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
    light : RectLight, DiskLight or SphereLight
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
    return PenumbraWedges(**_kernels.wedges(scene._core, light._core, vertex_angle, planes))


def light_intensity(
    scene: Scene,
    camera: Camera,
    light: Light,
    method: Wedges | None = None,
    progress: Callable[[float], None] | None = None,
) -> _Floats:
    """Rasterise penumbra wedges into a light-intensity buffer and return it before it is clamped.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    light : RectLight, DiskLight or SphereLight
    method : Wedges, optional
        Its `overlap` does not matter: everything is added.
    progress : callable, optional
        Is told the finished fraction.

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
    result: _Floats = _kernels.light_intensity(
        scene._core, camera._core, light._core, method or Wedges(), progress
    )
    return result


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
