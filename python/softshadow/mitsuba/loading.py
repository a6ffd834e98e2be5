"""Mitsuba's scenes as ours: what its own loaders made of a file or a dictionary is asked for it."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from softshadow._core import ParameterError
from softshadow.camera import Camera
from softshadow.entries import Spheres
from softshadow.light import (
    DiskLight,
    DistantLight,
    Light,
    PolygonLight,
    RectLight,
    SphereLight,
)
from softshadow.loading import Setup, warn_of
from softshadow.mitsuba.bridge import variant_set
from softshadow.scene import Scene

if TYPE_CHECKING:
    from types import ModuleType

__all__ = ["from_dict", "from_scene", "read_xml"]

_Array = npt.NDArray[np.float64]

_DISK_SIDES = 256
"""Of the polygon that stands for a disk: it is off by 7.5e-5 of the radius, less than where
Mitsuba's rays start."""

_ROUNDING = 1e-5
"""How far a transform in single precision may be off that turns and scales: a hundred ulps."""

_CONSTANT = ("UniformSpectrum", "SRGBReflectanceSpectrum", "SRGBEmitterSpectrum")
"""Textures that are one colour."""


def from_scene(scene: Any) -> Setup:
    """Return a loaded Mitsuba scene as ours.

    Understood are the shapes ``ply``, ``obj``, ``serialized`` and other meshes, ``rectangle``,
    ``disk`` (a polygon of 256 sides), ``cube`` and ``sphere``; the materials ``diffuse``,
    ``twosided`` and ``mask``, of one colour and one opacity; area emitters of one radiance on a
    ``rectangle``, ``disk`` or ``sphere``, or on a mesh that is one planar polygon, which are lights
    and no geometry; and the first ``perspective`` sensor. All else is listed in one warning: shapes
    and emitters are left out, other materials are grey, textures have their mean.

    Surfaces are two-sided and shaded by their faces' normals here, whatever Mitsuba's are, and
    lights cast no shadow.

    Parameters
    ----------
    scene : mitsuba.Scene
        Of the variant that is set, one that ends in ``_rgb`` or ``_mono``. Load it with
        ``optimize=False``: Mitsuba's optimization joins meshes, and forgets their names and order.

    Returns
    -------
    softshadow.Setup
        Its numbers have single precision, Mitsuba's.

    Raises
    ------
    ImportError
        If Mitsuba is not installed.
    TypeError
        If it is no scene.
    ValueError
        If the variant is spectral or polarised, or there is a number that is not finite or a shape
        without extent.

    Warns
    -----
    UserWarning
        Of what is not understood, with names.
    """
    with variant_set(None) as mi:
        setup, left_out = _read(mi, scene)
    warn_of(left_out, "Mitsuba's scene")
    return setup


def from_dict(description: dict[str, Any]) -> Setup:
    """Return a scene that is given as Mitsuba's dictionary.

    Parameters
    ----------
    description : dict
        As ``mitsuba.load_dict`` takes it, and `scene_dict` makes it.

    Returns
    -------
    softshadow.Setup
        As of `from_scene`.

    Raises
    ------
    ImportError
        If Mitsuba is not installed.
    ValueError
        As `from_scene`, or if Mitsuba cannot load it.
    """
    with variant_set(None) as mi:
        what = "description"
        setup, left_out = _loaded(mi, lambda: mi.load_dict(description, optimize=False), what)
    warn_of(left_out, what)
    return setup


def read_xml(file: Path) -> tuple[Setup, list[str]]:
    """Return what a file holds, and what of it is not understood.

    Raises
    ------
    ImportError
        If Mitsuba is not installed.
    ValueError
        As `from_scene`, or if Mitsuba cannot load it.
    """
    if not file.is_file():
        raise ValueError(f"{file}: no such file")
    with variant_set(None) as mi:
        return _loaded(mi, lambda: mi.load_file(str(file), optimize=False), str(file))


def _loaded(mi: ModuleType, loader: Callable[[], Any], what: str) -> tuple[Setup, list[str]]:
    try:
        scene = loader()
    except Exception as error:  # Mitsuba raises RuntimeError for all that is wrong with a file
        raise ValueError(f"{what}: Mitsuba cannot load it ({error})") from None
    try:
        return _read(mi, scene)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{what}: {error}") from None


def _read(mi: ModuleType, scene: Any) -> tuple[Setup, list[str]]:
    if not isinstance(scene, mi.Scene):
        raise TypeError(f"scene: expected mitsuba.Scene, got {type(scene).__name__}")
    result, lights, left_out = Scene(), list[Light](), list[str]()
    for shape in scene.shapes():
        kind = _kind(shape)
        what = f"{kind.lower()} {_name(shape)!r}" if shape.id() else f"a {kind.lower()}"
        if shape.emitter() is not None:
            light = _light(mi, shape, kind)
            left_out += [f"{what} with {_kind(shape.emitter())}"] if light is None else []
            lights += [] if light is None else [light]
        elif not _add(mi, result, shape, kind, what, left_out):
            left_out.append(what)
    for emitter in scene.emitters():
        if mi.has_flag(emitter.flags(), mi.EmitterFlags.Surface):
            continue  # told with its shape
        parallel = _parallel(mi, emitter)
        if parallel is None:
            left_out.append(_called(emitter))
        else:
            lights.append(parallel)
    cameras: list[Camera] = []
    for sensor in scene.sensors():
        camera = _camera(mi, sensor)
        if camera is None or cameras:
            left_out.append(_called(sensor) + (" (a second one)" if camera else ""))
        else:
            cameras.append(camera)
    setup = Setup(_spheres_joined(result), cameras[0] if cameras else None, tuple(lights))
    return setup, list(dict.fromkeys(left_out))


def _kind(thing: Any) -> str:
    """Return a Mitsuba object's class, with which all versions begin to print it."""
    return str(thing).partition("[")[0]


def _name(shape: Any) -> str:
    """Return a shape's id; of a mesh of `scene_dict`, whose id is its key, the name it prints."""
    given: str = shape.id()
    if re.fullmatch(r"entry_\d+", given):
        printed = re.search(r'\[\s+name = "(.*)",\s+bbox = ', str(shape), re.DOTALL)
        return printed[1] if printed else given
    return given


def _called(thing: Any) -> str:
    return f"{thing.id()!r} ({_kind(thing)})" if thing.id() else _kind(thing)


def _children(mi: ModuleType, thing: Any) -> dict[str, Any]:
    """Return the objects that one holds, by name."""

    # Mitsuba is imported when it is needed, so that mypy sees no class here.
    class Collect(mi.TraversalCallback):  # type: ignore[misc, name-defined]
        def put(self, name: str, value: Any, *rest: Any) -> None:
            found[name] = value

        put_object = put

        def put_parameter(self, *rest: Any) -> None:
            pass

    found: dict[str, Any] = {}
    thing.traverse(Collect())
    return {name: value for name, value in found.items() if isinstance(value, mi.Object)}


def _matrix(mi: ModuleType, thing: Any) -> _Array:
    return np.array(mi.traverse(thing)["to_world"].matrix, dtype=np.float64).reshape(4, 4)


def _colour(mi: ModuleType, texture: Any) -> _Array | None:
    """Return a texture's colour, linear RGB; None if it has several."""
    if _kind(texture) not in _CONSTANT:
        return None
    single = np.array(mi.traverse(texture)["value"], dtype=np.float32).ravel()
    value = np.array([float(str(x)) for x in single])  # 0.3 in a file stays 0.3
    return np.broadcast_to(value, (3,)) if len(value) in (1, 3) else None


def _look(mi: ModuleType, bsdf: Any, what: str, left_out: list[str]) -> dict[str, Any]:
    """Return a material's albedo and opacity; what is not understood is listed."""
    if bsdf is None:
        return {}
    parts = _children(mi, bsdf)
    kind = _kind(bsdf)

    def colour(name: str) -> _Array:
        found = _colour(mi, parts[name])
        if found is None:
            left_out.append(f"{_kind(parts[name])} of {what} (its mean is taken)")
            found = np.full(3, np.array(parts[name].mean(), dtype=np.float64).mean())
        return found

    if kind == "SmoothDiffuse":
        return {"albedo": colour("reflectance")}
    if kind == "Mask":
        opacity = float(np.clip(colour("opacity").mean(), 0, 1))
        return {**_look(mi, parts["nested_bsdf"], what, left_out), "opacity": opacity}
    if kind == "TwoSided":
        front = _look(mi, parts["brdf_0"], what, left_out)
        back = _look(mi, parts.get("brdf_1"), what, [])
        if back and not np.array_equal(front.get("albedo", 0), back.get("albedo", 0)):
            left_out.append(f"the back's material of {what}")
        return front
    left_out.append(f"{kind} of {what} (it is grey)")
    return {}


def _add(
    mi: ModuleType, scene: Scene, shape: Any, kind: str, what: str, left_out: list[str]
) -> bool:
    """Add a shape that is no light; return whether its kind is understood."""
    parameters = mi.traverse(shape)
    is_mesh = "vertex_positions" in parameters and "faces" in parameters
    if not is_mesh and kind not in ("Rectangle", "Disk", "Sphere"):
        return False
    look = _look(mi, shape.bsdf(), what, left_out)
    if shape.interior_medium() is not None or shape.exterior_medium() is not None:
        left_out.append(f"the medium of {what}")
    name = scene._new_name(None, _name(shape) or kind.lower())
    if kind == "Sphere":
        scene.add_spheres(_matrix(mi, shape)[:3, 3], _sphere_radius(shape), name, **look)
    elif is_mesh:
        vertices = np.array(parameters["vertex_positions"], dtype=np.float64).reshape(-1, 3)
        faces = np.array(parameters["faces"], dtype=np.int64).reshape(-1, 3)
        uv = np.array(parameters["vertex_texcoords"], dtype=np.float64).reshape(-1, 2)
        uv = uv * [1, -1] + [0, 1]  # its origin is at the upper left
        scene.add((vertices, faces), name, uv=uv if len(uv) else None, **look)
    else:
        scene.add(_flat(kind), name, transform=_matrix(mi, shape), **look)
    return True


def _sphere_radius(shape: Any) -> float:
    return float(np.sqrt(np.array(shape.surface_area()).item() / (4 * np.pi)))


def _flat(kind: str) -> tuple[_Array, npt.NDArray[np.int64]]:
    """Return the square [-1, 1]², or a disk of radius 1, that faces up."""
    angle = 2 * np.pi * np.arange(_DISK_SIDES) / _DISK_SIDES
    x, y = np.cos(angle), np.sin(angle)
    if kind == "Rectangle":
        x, y = np.array([-1.0, 1, 1, -1]), np.array([-1.0, -1, 1, 1])
    last = np.arange(2, len(x))
    faces = np.stack([np.zeros_like(last), last - 1, last], axis=1)
    return np.stack([x, y, np.zeros_like(x)], axis=1), faces


def _light(mi: ModuleType, shape: Any, kind: str) -> Light | None:
    """Return the light that an emitting shape is; None where it is none of ours."""
    emitter = shape.emitter()
    if _kind(emitter) != "AreaLight":
        return None
    radiance = _colour(mi, _children(mi, emitter)["radiance"])
    if radiance is None:
        return None
    if kind not in ("Rectangle", "Disk", "Sphere"):
        return _polygon(mi, shape, radiance)
    matrix = _matrix(mi, shape)
    center, u, v = matrix[:3, 3], matrix[:3, 0], matrix[:3, 1]
    if kind == "Sphere":
        inwards = shape.has_flipped_normals()
        return None if inwards else SphereLight(center, _sphere_radius(shape), radiance)
    normal = np.array(shape.sample_position(0.0, [0.5, 0.5]).n, dtype=np.float64).ravel()
    if kind == "Rectangle":  # of [-1, 1]²
        edges = (2 * u, 2 * v) if np.cross(u, v) @ normal > 0 else (2 * v, 2 * u)
        return RectLight(center, *edges, radiance)
    lengths = float(np.linalg.norm(u)), float(np.linalg.norm(v))
    stretched, sheared = abs(lengths[0] - lengths[1]) * lengths[0], abs(float(u @ v))
    if max(stretched, sheared) > _ROUNDING * lengths[0] * lengths[1]:  # an ellipse
        return None
    return DiskLight(center, normal, lengths[0], radiance)


def _polygon(mi: ModuleType, shape: Any, radiance: _Array) -> PolygonLight | None:
    """Return the polygon that an emitting mesh is; None where it is not a planar one."""
    parameters = mi.traverse(shape)
    if "vertex_positions" not in parameters or "faces" not in parameters:
        return None
    vertices = np.array(parameters["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    faces = np.array(parameters["faces"], dtype=np.int64).reshape(-1, 3)
    vertices, places = np.unique(vertices, axis=0, return_inverse=True)
    # Edges of one triangle only are on the outline, and run as the triangle does.
    edges = places.ravel()[faces][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()
    opposite = {(b, a) for a, b in edges}
    after = {a: b for a, b in edges if (a, b) not in opposite}
    if not after:
        return None
    path = [next(iter(after))]
    while (corner := after.get(path[-1], path[0])) != path[0] and len(path) < len(after):
        path.append(corner)
    outline = vertices[path[::-1] if shape.has_flipped_normals() else path]
    if len(path) != len(after):  # a hole, parts, or parts that touch
        return None
    try:
        found = PolygonLight(outline, radiance)
    except ParameterError:  # not planar, or not simple
        return None
    # Triangles on top of each other, or folded, have more area than their outline.
    corners = vertices[places.ravel()[faces]]
    sides = corners[:, 1:] - corners[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=-1).sum()
    first = outline[1:-1] - outline[0], outline[2:] - outline[0]
    own = 0.5 * np.linalg.norm(np.cross(*first).sum(axis=0))
    return found if abs(area - own) <= _ROUNDING * area else None


def _parallel(mi: ModuleType, emitter: Any) -> DistantLight | None:
    """Return a directional emitter as ours; None where it is something else."""
    if _kind(emitter) != "DirectionalEmitter":
        return None
    irradiance = _colour(mi, _children(mi, emitter)["irradiance"])
    # Along z of its own space.
    direction = _matrix(mi, emitter)[:3, 2]
    return None if irradiance is None else DistantLight(direction, 0, irradiance)


def _camera(mi: ModuleType, sensor: Any) -> Camera | None:
    """Return a sensor as ours; None where it is no pinhole."""
    if _kind(sensor) != "PerspectiveCamera":
        return None
    parameters = mi.traverse(sensor)
    film = sensor.film()
    (width, height), crop, offset = (
        np.array(x, dtype=np.int64).ravel()
        for x in (film.size(), film.crop_size(), film.crop_offset())
    )
    matrix = _matrix(mi, sensor)
    if np.linalg.det(matrix[:3, :3]) < 0:
        return None  # mirrored
    fov = np.radians(np.array(parameters["x_fov"], dtype=np.float64).item())
    shift = [
        np.array(parameters[f"principal_point_offset_{axis}"], dtype=np.float64).item()
        for axis in "xy"
    ]
    focal = 0.5 * width / np.tan(0.5 * fov)
    middle = (0.5 - np.array(shift)) * [width, height] - offset
    K = [[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]]
    # Its camera space has x to the left and y up; single precision is not quite rigid.
    eye, forward, up = matrix[:3, 3], matrix[:3, 2], matrix[:3, 1]
    reach = max(1.0, float(np.abs(eye).max()))
    pose = Camera(eye, eye + reach * forward, up).camera_to_world
    return Camera.from_matrix(K, pose, int(crop[0]), int(crop[1]))


def _spheres_joined(scene: Scene) -> Scene:
    """Return a scene in which spheres ``name[0]``, ``name[1]``, ... of one look are one entry.

    `scene_dict` names them so, because Mitsuba's shapes are single spheres.
    """
    groups: dict[str, list[Spheres]] = {}
    for e in scene.entries:
        match = re.fullmatch(r"(.+)\[(\d+)\]", e.name) if isinstance(e, Spheres) else None
        if match is not None and isinstance(e, Spheres):
            group = groups.setdefault(match[1], [])
            if int(match[2]) == len(group) and (not group or _alike(group[0], e)):
                group.append(e)
    joined = Scene()
    for e in scene.entries:
        group = groups.get(e.name.rpartition("[")[0], [])
        if e in group:
            if e is group[0]:
                name = joined._new_name(None, e.name.rpartition("[")[0])
                centers = np.concatenate([x.centers for x in group])
                radii = np.concatenate([x.radii for x in group])
                joined.add_spheres(centers, radii, name, e.albedo, e.opacity)
        elif isinstance(e, Spheres):
            joined.add_spheres(e.centers, e.radii, e.name, e.albedo, e.opacity)
        else:
            joined.add(
                (e.vertices, e.faces), e.name, e.albedo, e.opacity, transform=e.transform, uv=e.uv
            )
    return joined


def _alike(a: Spheres, b: Spheres) -> bool:
    return (a.albedo, a.opacity) == (b.albedo, b.opacity)
