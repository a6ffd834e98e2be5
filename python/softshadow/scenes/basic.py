"""Real models on a ground, solids, and scenes with a known answer."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import numpy.typing as npt
import trimesh

from softshadow.camera import Camera
from softshadow.light import RectLight
from softshadow.scene import Scene
from softshadow.scenes.models import city_path, missing, stanford_bunny
from softshadow.scenes.staging import PLANE_ALBEDO, LightKind, Setup, light_towards, square

__all__ = ["bunny_on_plane", "city", "closed_solids", "half_plane", "tilted_sheet"]


def bunny_on_plane(
    width: int = 512, height: int = 512, light: LightKind = "rect", light_size: float = 0.5
) -> Setup:
    """Return the Stanford bunny, one unit tall, standing on a ground plane.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light, 2.3 units from the bunny's feet.
    light_size : float
        Its edge or diameter, world units.

    Returns
    -------
    Setup

    Raises
    ------
    FileNotFoundError
        If the model is not installed.
    """
    scene = Scene()
    scene.add(square(2.5), name="ground", albedo=PLANE_ALBEDO)
    scene.add(stanford_bunny(), name="bunny", albedo=(0.8, 0.75, 0.65))
    camera = Camera((0.4, -3.0, 1.8), (-0.15, 0.1, 0.35), (0, 0, 1), 36.0, width, height)
    return Setup(scene, camera, light_towards(light, (0.9, -0.6, 2.0), light_size, (0, 0, 0.3)))


def city(
    name: str = "munich",
    width: int = 512,
    height: int = 512,
    light: LightKind = "rect",
    light_size: float = 0.3,
) -> Setup:
    """Return a city, two units across, seen obliquely from above.

    Parameters
    ----------
    name : str
        ``"munich"`` or ``"san_francisco"``.
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light, low enough for long shadows.
    light_size : float
        Its edge or diameter, world units.

    Returns
    -------
    Setup

    Raises
    ------
    FileNotFoundError
        If the model is not installed.
    """
    path = city_path(name)
    if path is None:
        raise missing(f"the city {name!r}", "sionna")
    files = sorted(path.glob("*.ply"))
    parts = [trimesh.load(file, process=False) for file in files]
    mesh = trimesh.util.concatenate([p for p in parts if isinstance(p, trimesh.Trimesh)])
    low, high = mesh.bounds
    scale = 2.0 / max(high[0] - low[0], high[1] - low[1])
    middle = 0.5 * (low + high)
    vertices = (np.asarray(mesh.vertices) - [middle[0], middle[1], low[2]]) * scale
    scene = Scene()
    scene.add((vertices, mesh.faces), name=name, albedo=(0.7, 0.68, 0.65))
    camera = Camera((0.1, -1.15, 0.75), (0.0, -0.1, 0.0), (0, 0, 1), 36.0, width, height)
    return Setup(scene, camera, light_towards(light, (-0.9, 0.2, 0.9), light_size, (0, -0.1, 0)))


def closed_solids(
    width: int = 512,
    height: int = 512,
    light: LightKind = "rect",
    light_size: float = 0.6,
    detail: int = 4,
    opacity: float = 1.0,
) -> Setup:
    """Return spheres, a torus and a box, all watertight, standing on a ground plane.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    light_size : float
        Its edge or diameter, world units.
    detail : int
        Subdivisions: the spheres have ``20 · 4**detail`` triangles, the torus ``8 · 4**detail``.
    opacity : float
        Of the solids; the ground is opaque.

    Returns
    -------
    Setup
    """
    make = trimesh.creation
    ring = 2**detail
    torus = make.torus(0.32, 0.09, major_sections=4 * ring, minor_sections=ring)
    torus.apply_transform(trimesh.transformations.rotation_matrix(math.radians(70), (1, 0, 0.3)))
    box = make.box((0.4, 0.4, 0.5))
    box.apply_transform(trimesh.transformations.rotation_matrix(math.radians(25), (0, 0, 1)))
    solids = {
        "ball": (make.icosphere(detail, 0.35), (-0.55, 0.25), (0.8, 0.4, 0.3)),
        "torus": (torus, (0.35, -0.35), (0.4, 0.7, 0.4)),
        "box": (box, (0.55, 0.5), (0.4, 0.5, 0.8)),
        "small ball": (make.icosphere(detail, 0.15), (-0.2, -0.55), (0.8, 0.8, 0.3)),
    }
    scene = Scene()
    scene.add(square(2.5), name="ground", albedo=PLANE_ALBEDO)
    for name, (mesh, (x, y), albedo) in solids.items():
        mesh.apply_translation((x, y, -mesh.bounds[0, 2]))
        scene.add(mesh, name=name, albedo=albedo, opacity=opacity)
    camera = Camera((0.2, -2.9, 2.2), (0.0, 0.0, 0.15), (0, 0, 1), 38.0, width, height)
    return Setup(scene, camera, light_towards(light, (-0.7, -0.5, 2.0), light_size, (0, 0, 0)))


def half_plane(
    width: int = 256,
    height: int = 256,
    light: LightKind = "rect",
    light_size: float = 0.4,
    light_height: float = 1.0,
    blocker_height: float = 0.5,
    turn_deg: float = 0.0,
) -> Setup:
    """Return a half-plane blocker between a light and a receiving plane, with its closed form.

    The receiver is the plane ``z = 0``, the light's centre is at ``(0, 0, light_height)``, and the
    blocker fills ``x <= 0`` at ``z = blocker_height`` (a rectangle large enough to act
    as a half-plane for all that the camera sees). The camera looks at the penumbra from below the
    blocker.

    From a receiver at ``x`` the blocker's edge is seen at ``(1 - k) x`` in the light's plane, with
    ``k = light_height / blocker_height``, whatever ``y``: a flat light that faces down is visible
    beyond that line. Of a square with edge ``a`` that is the fraction
    ``clip(1/2 + (k - 1) x / a, 0, 1)``; turned about the z axis, the square's width across the line
    is the sum of two uniform distributions. Of a disk with radius ``r`` it is
    ``(acos t - t sqrt(1 - t²)) / π`` with ``t = (1 - k) x / r``. A sphere that subtends the
    half-angle ``α`` is cut by the plane through the receiver and the blocker's edge; with ``δ`` the
    angle between that plane and the sphere's centre (positive on the open side),

        hidden(δ) = (acos(sin δ / sin α) - cos α · acos(tan δ / tan α)) / (π (1 - cos α))

    is the part of its solid angle on the far side for ``|δ| < α``.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    light_size : float
        The square's edge or the diameter, world units.
    light_height, blocker_height : float
        Over the receiver, world units; the light is wholly above the blocker.
    turn_deg : float
        Of the square about the z axis; at 0 its edges are parallel to the axes.

    Returns
    -------
    Setup
        With `visibility`.

    Raises
    ------
    ValueError
        If the heights are not in order, or the light is of another shape.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> setup.visibility([(-2, 0, 0), (0, 0, 0), (2, 0, 0)]).tolist()
    [0.0, 0.5, 1.0]
    """
    clearance = light_size / 2 if light == "sphere" else 0.0
    if not 0 < blocker_height < light_height - clearance:
        raise ValueError(
            f"half_plane: expected 0 < blocker_height < light_height - {clearance:g}, got "
            f"{blocker_height:g} and {light_height:g}"
        )
    reach = 4.0 * light_height + 4.0
    scene = Scene()
    scene.add(square(2 * reach), name="receiver", albedo=PLANE_ALBEDO)
    vertices, faces = square(reach, blocker_height)
    scene.add((vertices - [reach, 0, 0], faces), name="blocker", albedo=0.5)
    h = blocker_height
    camera = Camera((0, -1.8 * h, 0.85 * h), (0, -0.6 * h, 0), (0, 0, 1), 45.0, width, height)
    source = light_towards(light, (0, 0, light_height), light_size, (0, 0, 0))
    turn = math.radians(turn_deg)
    if isinstance(source, RectLight):
        c, s = math.cos(turn), math.sin(turn)
        turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        source = RectLight(
            source.center,
            turned @ np.asarray(source.edge_u),
            turned @ np.asarray(source.edge_v),
            source.radiance,
        )

    known = partial(
        _half_plane_visibility,
        light=light,
        light_size=light_size,
        light_height=light_height,
        blocker_height=blocker_height,
        turn=turn,
    )
    return Setup(scene, camera, source, known)


def _half_plane_visibility(
    points: npt.ArrayLike,
    light: LightKind,
    light_size: float,
    light_height: float,
    blocker_height: float,
    turn: float,
) -> npt.NDArray[np.float64]:
    p = np.asarray(points, dtype=np.float64)
    beyond = (light_height / blocker_height - 1) * p[..., 0]
    if light == "rect":
        return _square_beyond_line(beyond / light_size, turn)
    if light == "disk":
        return _disk_beyond_line(2 * beyond / light_size)
    return _half_hidden_sphere(p, light_height, light_size / 2, blocker_height)


def _square_beyond_line(offset: npt.NDArray[np.float64], turn: float) -> npt.NDArray[np.float64]:
    """Return how much of a unit square is left of a line `offset` to the right of its centre."""
    long, short = sorted((abs(math.cos(turn)), abs(math.sin(turn))), reverse=True)
    if short < 1e-9:
        straight: npt.NDArray[np.float64] = np.clip(0.5 + offset / long, 0.0, 1.0)
        return straight

    # The distribution of the sum of two uniform numbers, of widths `long` and `short`.
    def ramp(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        result: npt.NDArray[np.float64] = np.maximum(x, 0.0) ** 2
        return result

    t = offset + 0.5 * (long + short)
    beyond = ramp(t) - ramp(t - short) - ramp(t - long) + ramp(t - long - short)
    result: npt.NDArray[np.float64] = np.clip(beyond / (2 * long * short), 0.0, 1.0)
    return result


def _disk_beyond_line(offset: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return how much of the unit disk is left of a line `offset` to the right of its centre."""
    t = np.clip(-offset, -1.0, 1.0)
    result: npt.NDArray[np.float64] = (np.arccos(t) - t * np.sqrt(1 - t * t)) / np.pi
    return result


def _half_hidden_sphere(
    points: npt.NDArray[np.float64], light_height: float, radius: float, blocker_height: float
) -> npt.NDArray[np.float64]:
    to_center = np.array([0.0, 0.0, light_height]) - points
    distance = np.linalg.norm(to_center, axis=-1)
    sin_alpha = radius / distance
    alpha = np.arcsin(sin_alpha)
    # Normal of the plane through the receiver and the edge (the y axis at the blocker's height),
    # towards x > 0.
    dx, dz = -points[..., 0], blocker_height - points[..., 2]
    sin_delta = (dz * to_center[..., 0] - dx * to_center[..., 2]) / (np.hypot(dx, dz) * distance)
    delta = np.clip(np.arcsin(sin_delta), -alpha, alpha)
    ratio_sin = np.clip(np.sin(delta) / sin_alpha, -1, 1)
    ratio_tan = np.clip(np.tan(delta) / np.tan(alpha), -1, 1)
    hidden = np.arccos(ratio_sin) - np.cos(alpha) * np.arccos(ratio_tan)
    result: npt.NDArray[np.float64] = 1 - hidden / (np.pi * (1 - np.cos(alpha)))
    return np.clip(result, 0.0, 1.0)


def tilted_sheet(
    width: int = 256,
    height: int = 256,
    light: LightKind = "rect",
    light_size: float = 0.4,
    opacity: float = 0.5,
    sheets: int = 1,
) -> Setup:
    """Return tilted translucent sheets that hide the whole light from the middle of a plane.

    Where ``|x|, |y| <= 0.5`` on the plane ``z = 0``, visibility is ``(1 - opacity)**sheets``. The
    camera sees that part of the plane from below the sheets.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    light_size : float
        Its edge or diameter, world units; at most 1.
    opacity : float
        Of each sheet.
    sheets : int
        Stacked, each tilted by 20° and another 5° more than the one below.

    Returns
    -------
    Setup
        With `visibility`.
    """
    scene = Scene()
    scene.add(square(2.0), name="receiver", albedo=PLANE_ALBEDO)
    vertices, faces = square(1.6)
    for i in range(sheets):
        tilt = trimesh.transformations.rotation_matrix(math.radians(20 + 5 * i), (0.6, 0.8, 0))
        name = scene.add((vertices, faces), name=f"sheet {i}", albedo=0.5, opacity=opacity)
        tilt[2, 3] = 1.0 + 0.2 * i
        scene.set_transform(name, tilt)
    camera = Camera((0.0, -1.3, 0.35), (0.0, 0.0, 0.0), (0, 0, 1), 40.0, width, height)
    top = light_towards(light, (0.0, 0.0, 3.0 + 0.2 * sheets), light_size, (0, 0, 0))

    return Setup(scene, camera, top, partial(_everywhere, value=(1.0 - opacity) ** sheets))


def _everywhere(points: npt.ArrayLike, value: float) -> npt.NDArray[np.float64]:
    return np.full(np.asarray(points, dtype=np.float64).shape[:-1], value)
