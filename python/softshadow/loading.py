"""Scene files with their cameras and lights, and a camera and a light where there are none."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softshadow import checks, framing
from softshadow.camera import MOST_PIXELS, Camera
from softshadow.entries import Mesh
from softshadow.light import (
    DiskLight,
    DistantLight,
    Light,
    PolygonLight,
    RectLight,
    SphereLight,
)
from softshadow.reading import MAX_BYTES, MAX_CORNERS
from softshadow.scene import Scene

if TYPE_CHECKING:
    from softshadow.parts import UpAxis

__all__ = ["Setup", "frame", "load", "warn_of"]

_Matrix = npt.NDArray[np.float64]


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
    (nodes, base colours, alpha, perspective cameras, point and directional lights), and model files
    as of `Scene.load`, which have neither camera nor lights. All else that a file holds is listed
    in one warning.

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
    softshadow.Setup

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
    from softshadow.parts import add_parts, placement, read_model
    from softshadow.views import as_radius, views_of

    file = Path(path)
    world = placement(up, scale)
    radius = None if light_radius is None else as_radius(light_radius, "light_radius")
    rows = checks.integer(height, "height", 1, MOST_PIXELS)
    if file.suffix.lower() == ".xml":
        from softshadow.mitsuba.loading import read_xml

        found, left_out = read_xml(file)
    else:
        model = read_model(file, max_bytes, max_corners)
        scene = Scene()
        add_parts(scene, model, None, np.eye(4), {})
        camera, lights, left_out = views_of(model, radius, rows)
        found = Setup(scene, camera, lights)
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
    softshadow.Setup

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
    if isinstance(light, PolygonLight):
        return PolygonLight(_point(world, light.vertices), light.radiance)
    if isinstance(light, DistantLight):
        return DistantLight(
            world[:3, :3] @ np.array(light.direction), light.angle_deg, light.irradiance
        )
    center = _point(world, light.center)
    if isinstance(light, RectLight):
        u, v = (world[:3, :3] @ np.array(edge) for edge in (light.edge_u, light.edge_v))
        return RectLight(center, u, v, light.radiance)
    if isinstance(light, DiskLight):
        normal = world[:3, :3] @ np.array(light.normal)
        return DiskLight(center, normal, scale * light.radius, light.radiance)
    return SphereLight(center, scale * light.radius, light.radiance)
