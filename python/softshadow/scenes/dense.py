"""Scenes of many small triangles: a statue, a tree with leaves, and balls of fur.

They stand for the scenes that ray-traced shadow maps were made for (Xie, Tabellion and Pearce
2007: a figure of 316k triangles, a palm tree of 310k, a fur ball of 4.6M). All are z-up, near unit
size and near the origin.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import trimesh

from softshadow.camera import Camera
from softshadow.extras import require
from softshadow.kernels import curve_tubes
from softshadow.scene import Scene
from softshadow.scenes.models import stanford_bunny
from softshadow.scenes.staging import PLANE_ALBEDO, LightKind, Setup, light_towards, square

__all__ = ["fur_ball", "fur_ribbons", "statue", "tree"]

_Array = npt.NDArray[np.float64]

_HAIR_SEGMENTS = 4
_HAIR_TRIANGLES = 6 * _HAIR_SEGMENTS + 2
"""Of a tube with three sides and two caps."""

_BALL_CENTER, _SKIN_RADIUS = (0.0, 0.0, 0.5), 0.34
_FUR_ALBEDO = (0.75, 0.5, 0.3)


def fur_ball(
    width: int = 512,
    height: int = 512,
    light: LightKind = "rect",
    light_size: float = 0.6,
    triangles: int = 1_040_000,
    opacity: float = 1.0,
    seed: int = 0,
) -> Setup:
    """Return a ball of fur over a ground plane.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    light_size : float
        Its edge or diameter, world units; the ball is one unit across.
    triangles : int
        Of the fur, rounded up to whole hairs of 26. Fewer hairs are thicker, so that the fur stays
        about as dense.
    opacity : float
        Of the hairs' surface, which a ray through a hair crosses twice.
    seed : int
        Of the hairs.

    Returns
    -------
    Setup
    """
    count = max(1, math.ceil(triangles / _HAIR_TRIANGLES))
    strands, radii = _hairs(np.random.default_rng(seed), count)
    scene = _skin()
    scene.add_curves(
        strands.reshape(-1, 3),
        np.arange(count + 1) * (_HAIR_SEGMENTS + 1),
        np.tile(radii, count),
        opacity,
        name="fur",
        albedo=_FUR_ALBEDO,
    )
    return _lit_fur(scene, width, height, light, light_size)


def fur_ribbons(
    width: int = 512,
    height: int = 512,
    light: LightKind = "rect",
    light_size: float = 0.6,
    triangles: int = 480_000,
    opacity: float = 1.0,
    seed: int = 0,
) -> Setup:
    """Return a ball of flat hair over a ground plane: ribbons, two triangles a segment.

    The hairs of `fur_ball`, as wide as its tubes and turned at random around their own directions.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    light_size : float
        Its edge or diameter, world units; the ball is one unit across.
    triangles : int
        Of the fur, rounded up to whole hairs of 8. Fewer hairs are wider, so that the fur stays
        about as dense.
    opacity : float
        Of the ribbons.
    seed : int
        Of the hairs.

    Returns
    -------
    Setup
    """
    rng = np.random.default_rng(seed)
    count = max(1, math.ceil(triangles / (2 * _HAIR_SEGMENTS)))
    strands, radii = _hairs(rng, count)
    along = strands[:, -1] - strands[:, 0]
    side = _unit(np.cross(along, rng.normal(size=along.shape)))[:, None] * radii[:, None]
    vertices = np.stack([strands - side, strands + side], axis=2).reshape(-1, 3)
    # A hair's points come in pairs, left and right.
    quad = np.array([[0, 1, 3], [0, 3, 2]])
    first = 2 * np.arange(count * (_HAIR_SEGMENTS + 1)).reshape(count, -1)[:, :-1]
    faces = (first[..., None, None] + quad).reshape(-1, 3)
    scene = _skin()
    scene.add((vertices, faces), name="fur", albedo=_FUR_ALBEDO, opacity=opacity)
    return _lit_fur(scene, width, height, light, light_size)


def tree(
    width: int = 512,
    height: int = 512,
    light: LightKind = "rect",
    light_size: float = 0.4,
    leaves: int = 150_000,
    opacity: float = 1.0,
    seed: int = 0,
) -> Setup:
    """Return a tree over a ground plane: wood of tubes, leaves of one quad each.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    light_size : float
        Its edge or diameter, world units; the tree is one unit tall.
    leaves : int
        Two triangles each. Fewer leaves are larger, with the same area together.
    opacity : float
        Of the leaves; 1 is opaque. The wood is opaque.
    seed : int
        Of the branches and leaves.

    Returns
    -------
    Setup
    """
    rng = np.random.default_rng(seed)
    up = np.array([[0.0, 0.0, 1.0]])
    wood = [_strands(rng, 0 * up, up, np.array([0.62]), 12, (0.0, 0.0, 0.1), 0.05)]
    thick = [np.linspace(0.03, 0.008, 13)[None]]
    # Boughs, branches, twigs: how many on each of the level before, from where on, length, radius.
    for each, start, length, base in [
        (22, 0.4, 0.36, 0.009),
        (9, 0.25, 0.16, 0.0035),
        (7, 0.2, 0.09, 0.0014),
    ]:
        parents = np.repeat(np.arange(len(wood[-1])), each)
        at = rng.uniform(start, 1.0, len(parents))
        roots, along = _along(wood[-1], parents, at)
        out = _unit(0.55 * along + _unit(rng.normal(size=along.shape)))
        lengths = length * rng.uniform(0.6, 1.0, len(parents)) * (1.25 - 0.5 * at)
        wood.append(_strands(rng, roots, out, lengths, 6, (0.0, 0.0, 0.06), 0.12))
        thick.append(np.tile(np.linspace(base, 0.3 * base, 7), (len(parents), 1)))
    holders = rng.integers(0, len(wood[-1]), leaves)
    stems, along = _along(wood[-1], holders, rng.uniform(0.2, 1.0, leaves))
    scene = Scene()
    scene.add(square(2.5), name="ground", albedo=PLANE_ALBEDO)
    vertices, faces = _tubes(wood, thick)
    # A trunk that leans has a rim below the ground.
    vertices[:, 2] = np.maximum(vertices[:, 2], 0.0)
    scene.add((vertices, faces), name="wood", albedo=(0.35, 0.25, 0.18))
    foliage = _leaves(rng, stems, along, 0.014 * math.sqrt(150_000 / leaves))
    scene.add(foliage, name="leaves", albedo=(0.35, 0.55, 0.2), opacity=opacity)
    camera = Camera((0.3, -2.7, 1.6), (0.2, 0.0, 0.36), (0, 0, 1), 28.0, width, height)
    return Setup(scene, camera, light_towards(light, (-1.0, -0.7, 2.2), light_size, (0, 0, 0.5)))


def statue(
    width: int = 512,
    height: int = 512,
    light: LightKind = "rect",
    light_size: float = 0.6,
    subdivisions: int = 1,
    relief: float = 0.004,
    seed: int = 0,
    close: bool = False,
) -> Setup:
    """Return the Stanford bunny as a rough stone on a plinth, on a ground plane.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    light_size : float
        Its edge or diameter, world units; the statue is 1.2 units tall.
    subdivisions : int
        Each splits every triangle in four: 99,785, 399,140 (the default), 1,596,560 triangles.
    relief : float
        Height of the stone's roughness, world units.
    seed : int
        Of the roughness.
    close : bool
        Look closely at a part of the shadow, with the light at more than twice the statue's height:
        penumbrae of a light of 0.2 then cover more than 15 % of the picture.

    Returns
    -------
    Setup

    Raises
    ------
    FileNotFoundError
        If the model is not installed.
    """
    # Without, trimesh sums normals in another order.
    require("scenes", "the statue", "scipy.sparse")
    vertices, faces = stanford_bunny()
    for _ in range(subdivisions):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    rng = np.random.default_rng(seed)
    waves = _unit(rng.normal(size=(24, 3))) * rng.uniform(25, 160, (24, 1))
    phases = rng.uniform(0, 2 * math.pi, 24)
    rough = np.zeros(len(vertices))
    for wave, phase in zip(waves, phases, strict=True):
        rough += np.sin(vertices @ wave + phase)
    high = 0.2
    stone = vertices + (relief / 4) * rough[:, None] * mesh.vertex_normals + [0, 0, high]
    # The bunny is open below: it stands a little within the plinth.
    plinth = trimesh.creation.box((1.15, 0.95, high + 0.01))
    plinth.apply_translation((0, 0, 0.5 * (high + 0.01)))
    scene = Scene()
    scene.add(square(2.5), name="ground", albedo=PLANE_ALBEDO)
    scene.add(plinth, name="plinth", albedo=(0.5, 0.5, 0.52))
    scene.add((stone, faces), name="statue", albedo=(0.8, 0.77, 0.7))
    target, fov_deg = ((0.62, 0.26, 0.0), 8.6) if close else ((0.05, 0.1, 0.42), 38.0)
    center = (-1.25, -0.9, 3.0) if close else (-1.0, -0.7, 2.4)
    camera = Camera((0.5, -3.1, 2.0), target, (0, 0, 1), fov_deg, width, height)
    return Setup(scene, camera, light_towards(light, center, light_size, (0, 0, 0.5)))


def _hairs(rng: np.random.Generator, count: int) -> tuple[_Array, _Array]:
    """Grow hairs, shape (count, segments + 1, 3), and return the radii of their points, too."""
    normals = _sphere_points(count)
    length = 0.15 * rng.uniform(0.7, 1.0, count)
    # Combed to one side, and wilder than that.
    combed = np.cross(normals, (0.3, 0.2, 1.0))
    out = _unit(normals + 0.5 * combed + 0.25 * rng.normal(size=(count, 3)))
    roots = _BALL_CENTER + _SKIN_RADIUS * normals
    strands = _strands(rng, roots, out, length, _HAIR_SEGMENTS, (0.0, 0.0, -0.12), 0.1)
    thick = 0.0011 * math.sqrt(40_000 / count)
    return strands, thick * np.linspace(1.0, 0.3, _HAIR_SEGMENTS + 1)


def _skin() -> Scene:
    """Return what hairs grow on, over a ground plane."""
    scene = Scene()
    scene.add(square(2.5), name="ground", albedo=PLANE_ALBEDO)
    skin = trimesh.creation.icosphere(4, _SKIN_RADIUS).apply_translation(_BALL_CENTER)
    scene.add(skin, name="skin", albedo=(0.5, 0.35, 0.25))
    return scene


def _lit_fur(scene: Scene, width: int, height: int, light: LightKind, light_size: float) -> Setup:
    """Return a ball of fur with its camera and light."""
    camera = Camera((0.3, -2.6, 1.7), (0.05, 0.0, 0.3), (0, 0, 1), 36.0, width, height)
    return Setup(scene, camera, light_towards(light, (-0.8, -0.6, 2.1), light_size, _BALL_CENTER))


def _unit(v: npt.ArrayLike) -> _Array:
    """Return the vectors in the last axis at length one."""
    a = np.asarray(v, dtype=np.float64)
    result: _Array = a / np.linalg.norm(a, axis=-1, keepdims=True)
    return result


def _sphere_points(count: int) -> _Array:
    """Return `count` points spread evenly over the unit sphere, along a spiral."""
    i = np.arange(count) + 0.5
    z = 1 - 2 * i / count
    angle = math.pi * (1 + math.sqrt(5)) * i
    ring = np.sqrt(1 - z * z)
    return np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])


def _strands(
    rng: np.random.Generator,
    roots: _Array,
    directions: _Array,
    lengths: _Array,
    segments: int,
    bend: tuple[float, float, float],
    wander: float,
) -> _Array:
    """Grow polylines, shape (n, segments + 1, 3), that `bend` pulls and that wander at random."""
    points, along = [roots], directions
    for _ in range(segments):
        along = _unit(along + bend + wander * rng.normal(size=along.shape))
        points.append(points[-1] + (lengths / segments)[:, None] * along)
    return np.stack(points, axis=1)


def _along(strands: _Array, which: npt.NDArray[np.int64], at: _Array) -> tuple[_Array, _Array]:
    """Return the points at the fractions `at` of some strands, and their directions there."""
    segments = strands.shape[1] - 1
    place = np.minimum(at * segments, segments - 1e-9)
    i = place.astype(np.int64)
    low, high = strands[which, i], strands[which, i + 1]
    return low + (place - i)[:, None] * (high - low), _unit(high - low)


def _tubes(strands: list[_Array], radii: list[_Array]) -> tuple[_Array, npt.NDArray[np.int64]]:
    """Return the tubes of all levels of a tree as one mesh; thinner ones have fewer sides."""
    vertices, faces, first = [], [], 0
    for level, (points, radius) in enumerate(zip(strands, radii, strict=True)):
        n, m, _ = points.shape
        sides = (16, 8, 5, 3)[min(level, 3)]
        v, f = curve_tubes(points.reshape(-1, 3), np.arange(n + 1) * m, radius.ravel(), sides)
        vertices.append(v)
        faces.append(f + first)
        first += len(v)
    return np.concatenate(vertices), np.concatenate(faces)


def _leaves(
    rng: np.random.Generator, stems: _Array, along: _Array, size: float
) -> tuple[_Array, npt.NDArray[np.int64]]:
    """Return a kite-shaped quad for every leaf, `size` long, that leaves its stem."""
    n = len(stems)
    out = _unit(0.5 * along + _unit(rng.normal(size=(n, 3))) + (0, 0, -0.2))
    side = _unit(np.cross(out, np.array([0, 0, 1.5]) + rng.normal(size=(n, 3))))
    long = (size * rng.uniform(0.7, 1.2, n))[:, None]
    middle = stems + 0.45 * long * out
    corners = [stems, middle + 0.25 * long * side, stems + long * out, middle - 0.25 * long * side]
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    faces = (4 * np.arange(n)[:, None, None] + quad).reshape(-1, 3)
    return np.stack(corners, axis=1).reshape(-1, 3), faces
