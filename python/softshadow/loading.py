"""Scene files with their cameras and lights, and a camera and a light where there are none."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from softshadow import checks, framing, gltf
from softshadow.camera import MOST_PIXELS, Camera
from softshadow.entries import Mesh
from softshadow.light import DiskLight, Light, RectLight, SphereLight
from softshadow.parts import Model, UpAxis, add_parts, placement, read_model
from softshadow.reading import MAX_BYTES, MAX_CORNERS
from softshadow.scene import Scene

__all__ = ["Setup", "frame", "load", "warn_of"]

_Matrix = npt.NDArray[np.float64]

_PUNCTUAL = "KHR_lights_punctual"


@dataclass(frozen=True, eq=False)
class Setup:
    """What a scene file holds.

    Attributes
    ----------
    scene : Scene
    camera : Camera or None
        None where the file has none; `softshadow.frame` finds one.
    lights : tuple of lights
        Empty where the file has none; `softshadow.frame` finds one.
    """

    scene: Scene
    camera: Camera | None
    lights: tuple[Light, ...]


def load(
    path: str | PathLike[str],
    *,
    up: UpAxis = "z",
    scale: float = 1.0,
    light_radius: float | None = None,
    height: int = 512,
    max_bytes: int = MAX_BYTES,
    max_corners: int = MAX_CORNERS,
) -> Setup:
    """Return a file's scene, camera and lights.

    Understood are Mitsuba 3 XML files (see `softshadow.mitsuba.from_scene`), glTF and GLB files
    (nodes, base colours, alpha, perspective cameras, point lights), and model files as of
    `Scene.load`, which have neither camera nor lights. All else that a file holds is listed in one
    warning.

    Parameters
    ----------
    path : path
    up : {"z", "y"}
        The file's axis that points up; ``"y"`` becomes z, and z becomes -y. Coordinates are kept as
        they are unless it is told: glTF files usually have y up.
    scale : float
        World units of a unit of the file, positive. Lights keep their radiance, so that the picture
        is the same.
    light_radius : float, optional
        Of point lights of glTF files that state none (``extras: {"radius": ...}``), in units of the
        file. They become spheres of their intensity; without a radius they are left out.
    height : int
        Of the image of a glTF file's camera, in pixels; its width follows from the aspect ratio
        (1 where there is none).
    max_bytes, max_corners : int
        As of `Scene.add`.

    Returns
    -------
    Setup

    Raises
    ------
    ValueError, TypeError
        As `Scene.load`, or if Mitsuba cannot load a file.
    ModuleNotFoundError
        If Mitsuba is needed and not installed.

    Warns
    -----
    UserWarning
        Of what was left out, with names.

    Examples
    --------
    >>> import softshadow as ss
    >>> import tempfile, trimesh
    >>> table = trimesh.Scene({"top": trimesh.creation.box((100, 60, 4))})
    >>> _ = table.add_geometry(trimesh.creation.box((4, 4, 70)), node_name="leg")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = table.export(f"{folder}/table.glb")
    ...     setup = ss.load(f"{folder}/table.glb", scale=0.01)
    >>> setup.scene.names, setup.lights
    (('top', 'leg'), ())
    """
    file = Path(path)
    world = placement(up, scale)
    radius = None if light_radius is None else _radius(light_radius, "light_radius")
    rows = checks.integer(height, "height", 1, MOST_PIXELS)
    if file.suffix.lower() == ".xml":
        from softshadow.mitsuba.loading import read_xml

        found, left_out = read_xml(file)
    else:
        model = read_model(file, max_bytes, max_corners)
        scene = Scene()
        add_parts(scene, model, None, np.eye(4), {})
        found, left_out = _with_views(scene, model, radius, rows)
        left_out = model.left_out + left_out
    try:
        result = _placed(found, world, float(scale))
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    warn_of(left_out, str(file))
    return result


def frame(
    scene: Scene,
    fov_y_deg: float = 45.0,
    width: int = 512,
    height: int = 512,
    ground: bool = True,
) -> Setup:
    """Return a copy of a scene on a ground, with a camera and a light that show its shadow.

    These are what the command line shows a model with: a three-quarter view from slightly above, a
    square light above and to the right, and a square four times as wide as the scene below it; z
    points up. `softshadow.framing` has them one by one.

    Parameters
    ----------
    scene : Scene
    fov_y_deg, width, height
        As in `Camera`.
    ground : bool
        Whether the ground is added, as the last entry.

    Returns
    -------
    Setup

    Raises
    ------
    ValueError
        If the scene is empty, or as `Camera`.

    Examples
    --------
    >>> import softshadow as ss
    >>> scene = ss.Scene()
    >>> ball = scene.add_spheres((0, 0, 1), 0.5)
    >>> setup = ss.frame(scene, width=64, height=48)
    >>> setup.scene.names
    ('spheres', 'ground')
    >>> ss.render(setup.scene, setup.camera, setup.lights).visibility.shape
    (1, 48, 64)
    """
    camera, light = framing.frame(scene, fov_y_deg, width, height)
    shown = scene.copy()
    if checks.flag(ground, "ground"):
        framing.add_ground(shown)
    return Setup(shown, camera, (light,))


def warn_of(left_out: list[str], what: str) -> None:
    """Warn the caller of the function that calls this one of all that was left out."""
    if left_out:
        listed = ", ".join(left_out)
        warnings.warn(f"{what}: not understood and left out: {listed}", UserWarning, stacklevel=3)


def _radius(value: Any, what: str) -> float:
    radius = checks.number(value, what, "a positive number")
    if not radius > 0:
        raise ValueError(f"{what}: expected a positive number, got {value}")
    return radius


def _with_views(
    scene: Scene, model: Model, radius: float | None, height: int
) -> tuple[Setup, list[str]]:
    """Return a scene with the first camera and the lights of a glTF file, and what is left out."""
    cameras: list[Camera] = []
    lights: list[Light] = []
    left_out: list[str] = []
    if model.header is None:
        return Setup(scene, None, ()), []
    try:
        for index, matrix in (model.nodes or {}).items():
            node = model.header["nodes"][index]
            if "camera" in node:
                name, camera = _camera(model.header, node["camera"], matrix, height)
                if camera is None or cameras:
                    left_out.append(f"{name} (a second one)" if camera else name)
                else:
                    cameras.append(camera)
            punctual = node.get("extensions", {}).get(_PUNCTUAL)
            if punctual is not None:
                name, light = _light(model.header, punctual["light"], matrix, radius)
                if light is None:
                    left_out.append(name)
                else:
                    lights.append(light)
    except (AttributeError, KeyError, IndexError, TypeError, ValueError) as error:
        told = f"no {error}" if isinstance(error, KeyError) else error
        raise ValueError(f"{model.file}: its cameras or lights cannot be read ({told})") from None
    return Setup(scene, cameras[0] if cameras else None, tuple(lights)), left_out


def _camera(
    header: gltf.Header, index: int, matrix: _Matrix, height: int
) -> tuple[str, Camera | None]:
    """Return a camera's name and itself; None where it is no pinhole."""
    stated = header["cameras"][index]
    name = gltf.called(stated, "camera", index)
    if stated.get("type") != "perspective":
        return f"{name} ({stated.get('type')})", None
    if np.linalg.det(matrix[:3, :3]) < 0:
        return f"{name} (mirrored)", None
    lens = stated["perspective"]
    width = max(1, round(height * lens.get("aspectRatio", 1.0)))
    # It looks along -z, with y up.
    eye, forward, up = matrix[:3, 3], -matrix[:3, 2], matrix[:3, 1]
    reach = max(1.0, float(np.abs(eye).max())) / float(np.linalg.norm(forward))
    fov = math.degrees(lens["yfov"])
    return name, Camera(eye, eye + reach * forward, up, fov, width, height)


def _light(
    header: gltf.Header, index: int, matrix: _Matrix, radius: float | None
) -> tuple[str, Light | None]:
    """Return a light's name and itself; None where it is no point with a radius."""
    stated = header["extensions"][_PUNCTUAL]["lights"][index]
    name = gltf.called(stated, "light", index)
    if stated["type"] != "point":
        return f"{name} ({stated['type']})", None
    own = (stated.get("extras") or {}).get("radius", radius)
    if own is None:
        return f"{name} (a point; light_radius= gives it a size)", None
    size = _radius(own, f"{name}: radius")
    # A sphere's intensity is its radiance times the disk that it is seen as.
    colour = np.array(stated.get("color", (1.0, 1.0, 1.0)), dtype=np.float64)
    radiance = colour * stated.get("intensity", 1.0) / (math.pi * size**2)
    return name, SphereLight(matrix[:3, 3], size, radiance)


def _placed(setup: Setup, world: _Matrix, scale: float) -> Setup:
    """Return a setup with all that is in it moved, turned and scaled."""
    if np.array_equal(world, np.eye(4)):
        return setup
    scene = setup.scene
    for e in scene.entries:
        if isinstance(e, Mesh):
            scene.set_transform(e.name, world @ e.transform)
        else:
            scene.set_spheres(e.name, _point(world, e.centers), scale * e.radii)
    camera = setup.camera
    if camera is not None:
        pose = world @ camera.camera_to_world
        pose[:3, :3] /= scale
        camera = Camera.from_matrix(camera.K, pose, camera.width, camera.height)
    return Setup(scene, camera, tuple(_moved(x, world, scale) for x in setup.lights))


def _point(world: _Matrix, points: npt.ArrayLike) -> _Matrix:
    moved: _Matrix = np.asarray(points) @ world[:3, :3].T + world[:3, 3]
    return moved


def _moved(light: Light, world: _Matrix, scale: float) -> Light:
    center = _point(world, light.center)
    if isinstance(light, RectLight):
        u, v = (world[:3, :3] @ np.array(edge) for edge in (light.edge_u, light.edge_v))
        return RectLight(center, u, v, light.radiance)
    if isinstance(light, DiskLight):
        normal = world[:3, :3] @ np.array(light.normal)
        return DiskLight(center, normal, scale * light.radius, light.radiance)
    return SphereLight(center, scale * light.radius, light.radiance)
