"""The figures of "Approximate Soft Shadows on Arbitrary Surfaces using Penumbra Wedges" as scenes.

Akenine-Möller and Assarsson, Eurographics Workshop on Rendering 2002. Their models are known from
the pictures only; these have what each figure is about. All are z-up, near unit size and near the
origin.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import trimesh

from softshadow.camera import Camera
from softshadow.extras import needs
from softshadow.scene import Scene
from softshadow.scenes.staging import (
    PLANE_ALBEDO,
    LightKind,
    Setup,
    light_towards,
    square,
    with_normals_outwards,
)

__all__ = [
    "acute_triangle",
    "growing_light",
    "landscape",
    "overlapping_boards",
    "teapot",
    "tube",
    "two_cylinders",
    "two_lights",
]


def two_cylinders(
    width: int = 512,
    height: int = 512,
    light: LightKind = "sphere",
    light_size: float = 0.4,
    sections: int = 64,
) -> Setup:
    """Return two cylinders on a ground plane, the right one shading the left (Figure 13).

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light, on the right.
    light_size : float
        Its edge or diameter, world units.
    sections : int
        Sides of each cylinder.

    Returns
    -------
    Setup
    """
    scene = Scene()
    scene.add(square(2.5), name="ground", albedo=PLANE_ALBEDO)
    for name, x, radius, tall in [("left", -0.45, 0.22, 0.55), ("right", 0.35, 0.18, 0.8)]:
        cylinder = trimesh.creation.cylinder(radius, tall, sections=sections)
        cylinder.apply_translation((x, 0.1, tall / 2))
        scene.add(cylinder, name=name, albedo=(0.8, 0.75, 0.65))
    camera = Camera((-0.3, -2.6, 1.7), (-0.3, 0.05, 0.2), (0, 0, 1), 38.0, width, height)
    return Setup(scene, camera, light_towards(light, (1.6, -0.2, 1.9), light_size, (0, 0, 0.3)))


def growing_light(
    width: int = 512,
    height: int = 512,
    light: LightKind = "sphere",
    light_size: float = 0.3,
    dense: bool = False,
) -> Setup:
    """Return a logo and spheres that cast on teapots and a ground plane (Figure 12).

    Only the logo and the spheres cast, as in the paper.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    light_size : float
        Its edge or diameter, world units: what grows in the figure.
    dense : bool
        Whether the light's centre sees about 2,000 silhouette edges, or about 350.

    Returns
    -------
    Setup
    """
    scene = Scene()
    scene.add(square(2.5), name="ground", albedo=PLANE_ALBEDO, casts=False)
    for i, (x, y, turn) in enumerate(
        [(-0.45, 0.3, 30.0), (0.5, 0.35, 150.0), (0.05, -0.45, 265.0)]
    ):
        pot = teapot(48 if dense else 24)
        pot.apply_transform(trimesh.transformations.rotation_matrix(math.radians(turn), (0, 0, 1)))
        pot.apply_translation((x, y, 0))
        scene.add(pot, name=f"teapot {i}", albedo=(0.5, 0.7, 0.5), casts=False)
    logo = _logo(720 if dense else 90)
    logo.apply_transform(trimesh.transformations.rotation_matrix(math.radians(15), (1, 0, 0)))
    logo.apply_translation((0, 0, 0.85))
    scene.add(logo, name="logo", albedo=(0.8, 0.4, 0.3))
    for i, (x, y, z) in enumerate([(-0.7, -0.25, 0.55), (0.75, -0.1, 0.7), (0.1, 0.75, 0.6)]):
        ball = trimesh.creation.icosphere(5 if dense else 3, 0.11)
        ball.apply_translation((x, y, z))
        scene.add(ball, name=f"ball {i}", albedo=(0.8, 0.8, 0.3))
    camera = Camera((0.2, -2.9, 2.1), (0.0, 0.0, 0.3), (0, 0, 1), 36.0, width, height)
    return Setup(scene, camera, light_towards(light, (-0.3, -0.4, 2.6), light_size, (0, 0, 0.5)))


def acute_triangle(
    width: int = 512,
    height: int = 512,
    light: LightKind = "sphere",
    light_size: float = 0.4,
    angle_deg: float = 15.0,
) -> Setup:
    """Return a triangle with an acute angle over a ground plane (Figure 7).

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    light_size : float
        Its edge or diameter, world units.
    angle_deg : float
        The acute angle, at the corner on the left; 0 to 90.

    Returns
    -------
    Setup
    """
    half = 1.2 * math.tan(math.radians(angle_deg / 2))
    vertices = np.array([[-0.7, 0, 0.6], [0.5, -half, 0.6], [0.5, half, 0.6]])
    scene = Scene()
    scene.add(square(2.5), name="ground", albedo=PLANE_ALBEDO)
    scene.add((vertices, [[0, 1, 2]]), name="triangle", albedo=(0.8, 0.4, 0.3))
    camera = Camera((0.0, -2.0, 2.0), (-0.05, 0.2, 0.1), (0, 0, 1), 32.0, width, height)
    return Setup(scene, camera, light_towards(light, (0, -0.5, 1.8), light_size, (0, 0, 0.6)))


def overlapping_boards(
    width: int = 512,
    height: int = 512,
    light: LightKind = "sphere",
    light_size: float = 0.4,
) -> Setup:
    """Return two boards whose shadows overlap on a ground plane (Figure 11).

    Seen from the light they cross, one above the other, so that penumbrae fall on penumbrae; and at
    one end their sides nearly coincide, so that one penumbra hides what the other does.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    light_size : float
        Its edge or diameter, world units.

    Returns
    -------
    Setup
    """
    scene = Scene()
    scene.add(square(2.5), name="ground", albedo=PLANE_ALBEDO)
    lower = trimesh.creation.box((0.9, 0.3, 0.05))
    lower.apply_translation((0.0, 0.1, 0.5))
    upper = trimesh.creation.box((0.25, 0.8, 0.05))
    upper.apply_translation((0.26, 0.0, 0.8))
    scene.add(lower, name="lower", albedo=(0.8, 0.4, 0.3))
    scene.add(upper, name="upper", albedo=(0.4, 0.5, 0.8))
    camera = Camera((-0.9, -2.2, 1.9), (0.15, 0.15, 0.1), (0, 0, 1), 42.0, width, height)
    return Setup(scene, camera, light_towards(light, (-0.1, -0.2, 2.4), light_size, (0, 0, 0.6)))


def landscape(
    width: int = 512,
    height: int = 512,
    light: LightKind = "sphere",
    light_size: float = 0.3,
    triangles: int = 100_352,
    casts: bool = False,
    seed: int = 0,
) -> Setup:
    """Return a logo above a fractal landscape (Figure 14).

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    light_size : float
        Its edge or diameter, world units.
    triangles : int
        Of the landscape; rounded to ``2 n**2``. Its shape does not depend on it but for details.
    casts : bool
        Whether the landscape casts, too; it does not in the paper.
    seed : int
        Of the landscape.

    Returns
    -------
    Setup
    """
    scene = Scene()
    ground = _fractal(max(1, round(math.sqrt(triangles / 2))), seed)
    scene.add(ground, name="landscape", albedo=(0.55, 0.65, 0.45), casts=casts)
    logo = _logo(180)
    logo.apply_transform(trimesh.transformations.rotation_matrix(math.radians(25), (1, 0, 0)))
    logo.apply_translation((0, 0, 0.8))
    scene.add(logo, name="logo", albedo=(0.8, 0.4, 0.3))
    camera = Camera((0.5, -2.4, 1.9), (0.0, 0.05, 0.2), (0, 0, 1), 38.0, width, height)
    return Setup(scene, camera, light_towards(light, (-0.4, -0.5, 2.4), light_size, (0, 0, 0.4)))


def two_lights(
    width: int = 512,
    height: int = 512,
    light: LightKind = "sphere",
    light_size: float = 0.3,
) -> Setup:
    """Return a box and a ball under two lights (Figure 16).

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of both lights.
    light_size : float
        Their edge or diameter, world units.

    Returns
    -------
    Setup
        With two `Setup.lights`.
    """
    scene = Scene()
    scene.add(square(2.5), name="ground", albedo=PLANE_ALBEDO)
    box = trimesh.creation.box((0.35, 0.35, 0.5))
    box.apply_transform(trimesh.transformations.rotation_matrix(math.radians(30), (0, 0, 1)))
    box.apply_translation((-0.3, 0.15, 0.25))
    ball = trimesh.creation.icosphere(4, 0.2)
    ball.apply_translation((0.35, -0.1, 0.35))
    scene.add(box, name="box", albedo=(0.4, 0.5, 0.8))
    scene.add(ball, name="ball", albedo=(0.8, 0.4, 0.3))
    camera = Camera((0.2, -2.7, 2.0), (0.0, 0.05, 0.15), (0, 0, 1), 30.0, width, height)
    left = light_towards(light, (-1.3, -0.5, 1.9), light_size, (0, 0, 0.2))
    right = light_towards(light, (1.2, -0.4, 2.2), light_size, (0, 0, 0.2))
    return Setup(scene, camera, left, more_lights=(right,))


def _prism(
    left: npt.NDArray[np.float64], right: npt.NDArray[np.float64], thickness: float
) -> trimesh.Trimesh:
    """Return the closed prism over the strip between two polylines of the xy plane."""
    n = len(left)
    outline = np.concatenate([left, right[::-1]])
    low, high = (np.column_stack([outline, np.full(2 * n, z)]) for z in (0.0, thickness))
    i = np.arange(n - 1)
    opposite = 2 * n - 1 - i
    strip = np.concatenate(
        [np.column_stack([i, opposite - 1, opposite]), np.column_stack([i, i + 1, opposite - 1])]
    )
    j = np.arange(2 * n)
    k = (j + 1) % (2 * n)
    sides = np.concatenate(
        [np.column_stack([j, k + 2 * n, k]), np.column_stack([j, j + 2 * n, k + 2 * n])]
    )
    faces = np.concatenate([strip, strip[:, ::-1] + 2 * n, sides])
    mesh = trimesh.Trimesh(np.concatenate([low, high]), faces, process=False)
    return with_normals_outwards(mesh)


def _logo(segments: int) -> trimesh.Trimesh:
    """Return an extruded stroke in the shape of an "@", around the origin, 1 across."""
    turns = 2 * math.pi * 1.85
    t = np.linspace(0.0, 1.0, segments + 1)
    angle = turns * t
    # One turn around the letter, then out to the circle around it.
    out = np.clip((angle - 2 * math.pi * 0.85) / (2 * math.pi * 0.3), 0.0, 1.0)
    radius = 0.17 + 0.27 * out * out * (3 - 2 * out)
    middle = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    along = np.gradient(middle, axis=0)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    across *= 0.05 / np.linalg.norm(across, axis=1, keepdims=True)
    mesh = _prism(middle + across, middle - across, 0.08)
    mesh.apply_translation((0, 0, -0.04))
    return mesh


def tube(
    path: npt.NDArray[np.float64], radii: npt.NDArray[np.float64], sections: int
) -> trimesh.Trimesh:
    """Return the surface around a path in the xz plane; open at both ends."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, (0.0, 1.0, 0.0))
    turn = np.linspace(0, 2 * math.pi, sections, endpoint=False)
    ring = np.cos(turn)[:, None] * across[:, None] + np.sin(turn)[:, None] * np.array([0, 1.0, 0])
    vertices = (path[:, None] + radii[:, None, None] * ring).reshape(-1, 3)
    i, j = (x.ravel() for x in np.mgrid[: len(path) - 1, :sections])
    k = (j + 1) % sections
    a, b, c, d = i * sections + j, i * sections + k, (i + 1) * sections + k, (i + 1) * sections + j
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return trimesh.Trimesh(vertices, faces, process=False)


def teapot(sections: int) -> trimesh.Trimesh:
    """Return something like a teapot on z = 0: a body with a lid and a knob, spout and handle."""
    radii = [0, 0.14, 0.2, 0.24, 0.22, 0.16, 0.17, 0.1, 0.03, 0.02, 0.04, 0.03, 0]
    heights = [0, 0, 0.04, 0.12, 0.2, 0.26, 0.28, 0.32, 0.33, 0.35, 0.37, 0.39, 0.4]
    profile = np.column_stack([radii, heights])
    body = trimesh.creation.revolve(profile, sections=sections)
    t = np.linspace(0, 1, max(4, sections // 3))
    spout = np.column_stack([0.2 + 0.2 * t, 0 * t, 0.12 + 0.16 * t * t * (3 - 2 * t)])
    swing = math.pi * t
    handle = np.column_stack([-0.2 - 0.14 * np.sin(swing), 0 * t, 0.16 + 0.08 * np.cos(swing)])
    parts = [body, tube(spout, 0.055 - 0.03 * t, sections // 2)]
    parts.append(tube(handle, np.full(len(t), 0.02), sections // 2))
    joined: trimesh.Trimesh = trimesh.util.concatenate(parts)
    return joined


def _fractal(cells: int, seed: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Return a landscape over [-1.5, 1.5]²: octaves of noise, each half as wide and high."""
    with needs("scenes", "landscape"):
        from scipy import ndimage

    rng = np.random.default_rng(seed)
    grid = np.linspace(0.0, 1.0, cells + 1)
    heights = np.zeros((cells + 1, cells + 1))
    for octave in range(2, 8):
        count = 2**octave
        noise = rng.uniform(-1, 1, size=(count + 1, count + 1))
        places = np.meshgrid(grid * count, grid * count, indexing="ij")
        heights += 0.5**octave * ndimage.map_coordinates(noise, places, order=3, mode="nearest")
    x, y = np.meshgrid(3 * grid - 1.5, 3 * grid - 1.5, indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), 0.7 * heights.ravel()])
    i, j = (k.ravel() for k in np.mgrid[:cells, :cells])
    a, b = i * (cells + 1) + j, (i + 1) * (cells + 1) + j
    faces = np.concatenate(
        [np.column_stack([a, b, b + 1]), np.column_stack([a, b + 1, a + 1])]
    ).astype(np.int64)
    return vertices, faces
