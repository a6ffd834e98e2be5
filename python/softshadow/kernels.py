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

from softshadow import checks
from softshadow._core import kernels as _kernels
from softshadow.camera import Camera
from softshadow.light import Light, Vector, as_vector
from softshadow.light import as_points as _points
from softshadow.light_maps import (
    LayeredMap,
    OcclusionMaps,
    layered_maps,
    ssoc_maps,
    trace_layered_maps,
)
from softshadow.methods import RayTraced, SingleSample, Wedges
from softshadow.scene import SIDES, Scene, as_faces, curve_arrays

__all__ = [
    "LayeredMap",
    "OcclusionMaps",
    "PenumbraWedges",
    "accumulate",
    "attenuation",
    "convolve_shadow",
    "curve_tubes",
    "layered_maps",
    "light_fraction_above",
    "light_intensity",
    "light_samples",
    "mesh_edges",
    "outer_distances",
    "rasterize",
    "receiver_transform",
    "silhouette_edges",
    "silhouette_loops",
    "ssoc_maps",
    "trace_layered_maps",
    "transmittance",
    "unshadowed_irradiance",
    "wedges",
]

_Floats = npt.NDArray[np.float32]
_Doubles = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int32]

_MOST_TEXELS = 8192


def _mesh(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> tuple[_Doubles, npt.NDArray[np.int64]]:
    v = _points(vertices, "vertices")
    return v, as_faces(faces, "faces", len(v))


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
    edges, counts = _kernels.mesh_edges(*_mesh(vertices, faces))
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
        *_mesh(vertices, faces), as_vector(viewpoint, "viewpoint")
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
        *_mesh(vertices, faces), as_vector(viewpoint, "viewpoint")
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
    ids, depth = _kernels.rasterize(*_mesh(vertices, faces), camera._core, progress)
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
    checked = RayTraced(samples=samples, seed=seed)
    points, weights, colours = _kernels.light_samples(
        light._core, as_vector(point, "point"), checked.samples, checked.seed
    )
    return points, weights, colours


def receiver_transform(
    light_point: Vector, corner: Vector, edge_u: Vector, edge_v: Vector
) -> _Doubles:
    """Return the projective transform of Herf and Heckbert 1996.

    It maps the pyramid from a light point through a parallelogram to the unit box, and lines
    through the light point to lines along z: ``z = 1`` is the parallelogram's plane, ``z = inf``
    the parallel plane through the light point; what casts lies in ``[0, 1]² x [1, inf]``.

    Parameters
    ----------
    light_point : array_like, shape (3,)
    corner, edge_u, edge_v : array_like, shape (3,)
        The parallelogram, ``corner + x edge_u + y edge_v``.

    Returns
    -------
    ndarray, shape (4, 4), float64
        Acts on columns ``(p, 1)``; divide by the last component.

    Raises
    ------
    ValueError
        If the light point lies in the parallelogram's plane, or its edges span no area.
    """
    result: _Doubles = _kernels.receiver_transform(
        as_vector(light_point, "light_point"),
        as_vector(corner, "corner"),
        as_vector(edge_u, "edge_u"),
        as_vector(edge_v, "edge_v"),
    )
    return result


def accumulate(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    light_points: npt.ArrayLike,
    corner: Vector,
    edge_u: Vector,
    edge_v: Vector,
    size: tuple[int, int],
    colours: npt.ArrayLike | None = None,
    progress: Callable[[float], None] | None = None,
) -> _Floats:
    """Draw a mesh's hard shadows from points of any colour onto a parallelogram and add them up.

    Modulation textures of Herf and Heckbert 1996; a texel adds the colours of the points that it
    sees. A point sees the parallelogram from the side that most of the points are on.

    Parameters
    ----------
    vertices, faces
        As in `mesh_edges`; what is opaque and casts.
    light_points : array_like, shape (N, 3)
        For example those of `light_samples`, or more of them to be added to an earlier result.
    corner, edge_u, edge_v : array_like, shape (3,)
        The parallelogram, ``corner + x edge_u + y edge_v``. The mesh casts from its plane on.
    size : pair of ints
        Texels along u and v, 1 to 8192.
    colours : array_like, shape (N,) or (N, 3), optional
        Of each point, with its intensity; ``1 / N`` when not given, so that the result is a
        visibility.
    progress : callable, optional
        Is told the finished fraction.

    Returns
    -------
    ndarray, shape (H, W) or (H, W, 3), float32
        Row 0 is the one farthest along `edge_v`. (H, W) unless `colours` are (N, 3).

    Raises
    ------
    ValueError
        If the mesh is invalid, shapes do not fit, or a value is not finite or out of its range.
    """
    points = _points(light_points, "light_points")
    n = len(points)
    if n == 0:
        raise ValueError("light_points: expected at least one")
    weights = np.full(n, 1.0 / n) if colours is None else checks.numbers(colours, "colours")
    if weights.shape not in ((n,), (n, 3)):
        raise ValueError(f"colours: expected shape ({n},) or ({n}, 3), got {weights.shape}")
    rgb = np.ascontiguousarray(np.broadcast_to(weights.reshape(n, -1), (n, 3)))
    edges = [as_vector(edge_u, "edge_u"), as_vector(edge_v, "edge_v")]
    width, height = checks.size(size, "size", _MOST_TEXELS)
    flat: _Floats = _kernels.accumulate(
        *_mesh(vertices, faces),
        points,
        rgb,
        as_vector(corner, "corner"),
        edges,
        (width, height),
        progress,
    )
    image = flat.reshape(height, width, 3)
    return image if weights.ndim == 2 else np.ascontiguousarray(image[..., 0])


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


def convolve_shadow(
    visibility: npt.ArrayLike,
    light: Light,
    corner: Vector,
    edge_u: Vector,
    edge_v: Vector,
    scale: float,
    progress: Callable[[float], None] | None = None,
) -> _Floats:
    """Convolve a hard shadow on a parallelogram with the light's image (Soler and Sillion 1998).

    Exact but for texels where light, occluder and parallelogram are parallel. `accumulate` with the
    light's centre as its only point draws such a hard shadow.

    Parameters
    ----------
    visibility : array_like, shape (H, W)
        Of the light's centre, 0 to 1; row 0 is the one farthest along `edge_v`. What is beside the
        picture counts as lit.
    light : RectLight, DiskLight or SphereLight
    corner, edge_u, edge_v : array_like, shape (3,)
        The parallelogram, ``corner + x edge_u + y edge_v``.
    scale : float
        Size of the light's image over the light's: how high the occluder is over the parallelogram,
        over how deep it is below the light; 0 to 30.
    progress : callable, optional
        Is told the finished fraction.

    Returns
    -------
    ndarray, shape (H, W), float32
        Visibility of the light.

    Raises
    ------
    ValueError
        If shapes do not fit, a value is not finite or out of its range, or the light's centre lies
        in the parallelogram's plane.
    """
    hard = checks.numbers(visibility, "visibility")
    if hard.ndim != 2:
        raise ValueError(f"visibility: expected shape (H, W), got {hard.shape}")
    if not ((hard >= 0) & (hard <= 1)).all():
        raise ValueError("visibility: expected finite numbers from 0 to 1")
    hidden: _Floats = _kernels.convolve_shadow(
        np.ascontiguousarray(1 - hard.astype(np.float32)[::-1]),
        light._core,
        as_vector(corner, "corner"),
        [as_vector(edge_u, "edge_u"), as_vector(edge_v, "edge_v")],
        checks.number(scale, "scale"),
        progress,
    )
    return np.ascontiguousarray(1 - np.clip(hidden[::-1], 0, 1))


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
    checked = Wedges(vertex_angle=vertex_angle, planes=planes)
    found = _kernels.wedges(scene._core, light._core, checked.vertex_angle, checked.planes)
    return PenumbraWedges(**found)


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


def outer_distances(
    scene: Scene,
    points: npt.ArrayLike,
    normals: npt.ArrayLike | None,
    light: Light,
    method: SingleSample | None = None,
    progress: Callable[[float], None] | None = None,
) -> _Floats:
    """Return ``tau`` of single sample soft shadows (Parker, Shirley and Smits 1998) at points.

    That is how far the shadow ray to the light's centre passes from the nearest occluder, 1 where
    the outer object of that ends: ``d A / (a D)`` for an occluder's point at distance `a` along the
    ray and `d` off it, a light of diameter `D` at distance `A`. `attenuation` turns it into
    visibility.

    Parameters
    ----------
    scene : Scene
    points : array_like, shape (N, 3)
        World units.
    normals : array_like, shape (N, 3), or None
        None: no tangent plane.
    light : RectLight, DiskLight or SphereLight
        Of a size of zero: `tau` is 0 or 1.
    method : SingleSample, optional
        For its opacity.
    progress : callable, optional
        Is told the finished fraction.

    Returns
    -------
    ndarray, shape (N,), float32
        0 where the ray is blocked, or all of the light is below the tangent plane or faces away; 1
        where nothing is near.

    Raises
    ------
    ValueError
        If the scene is empty or has transparent occluders (unless the method's `opacity` allows
        them), a coordinate is not finite, a normal is zero, or the shapes differ.
    """
    n = None if normals is None else _points(normals, "normals")
    result: _Floats = _kernels.outer_distances(
        scene._core, _points(points, "points"), n, light._core, method or SingleSample(), progress
    )
    return result


def attenuation(
    tau: npt.ArrayLike, falloff: Literal["light", "linear", "smooth"] = "light"
) -> _Doubles:
    """Return the visibility at distances `tau` from inner objects, as `SingleSample` has it.

    Parameters
    ----------
    tau : array_like
        Below 0 counts as 0, above 1 as 1.
    falloff : {"light", "linear", "smooth"}
        The part of a disk beyond a line, `tau` itself, or ``3 tau**2 - 2 tau**3``.

    Returns
    -------
    ndarray, float64
        In the shape of `tau`.

    Raises
    ------
    ValueError
        If a value is not a number, or the falloff is unknown.
    """
    t = checks.numbers(tau, "tau")
    result: _Doubles = _kernels.attenuation(np.ascontiguousarray(t.ravel()), falloff)
    return result.reshape(t.shape)
