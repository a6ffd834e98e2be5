"""A forest: one tree, stored once, that stands in many places."""

from __future__ import annotations

import math

import numpy as np

from softshadow.camera import Camera
from softshadow.entries import Mesh
from softshadow.scene import Scene
from softshadow.scenes.dense import tree
from softshadow.scenes.staging import PLANE_ALBEDO, LightKind, Setup, light_towards, square

__all__ = ["forest"]

_SIDE = 4.0
"""Of the square that the trees stand on, world units."""

_CROWDED = 0.9
"""Height of a tree over the distance of neighbours: crowns touch, and the ground shows between."""


def forest(
    width: int = 512,
    height: int = 512,
    light: LightKind = "sphere",
    light_size: float = 0.5,
    trees: int = 1000,
    leaves: int = 50_000,
    opacity: float = 1.0,
    seed: int = 0,
    instances: str = "auto",
) -> Setup:
    """Return a forest of instances of one tree, turned, mirrored and of different sizes.

    With the defaults the tree has 168,524 triangles and the forest 1.7e8, most of which
    `softshadow.Hard` and `softshadow.RayTraced` alone can take.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    light : {"rect", "disk", "sphere"}
        Shape of the light.
    light_size : float
        Its edge or diameter, world units; the forest is four units wide.
    trees : int
        How many.
    leaves : int
        Of a tree; two triangles each.
    opacity : float
        Of the leaves; 1 is opaque. The wood is opaque.
    seed : int
        Of the tree and of where it stands.
    instances : {"auto", "always", "never"}
        As of `softshadow.Scene`.

    Returns
    -------
    Setup
    """
    rng = np.random.default_rng(seed)
    model = tree(leaves=leaves, opacity=opacity, seed=seed).scene
    scene = Scene(instances)
    scene.add(square(0.6 * _SIDE), name="ground", albedo=PLANE_ALBEDO)
    side = math.ceil(math.sqrt(trees))
    step = _SIDE / side
    places = rng.permutation(side * side)[:trees]
    spread = rng.uniform(-0.35, 0.35, (trees, 2))
    turns = rng.uniform(0, 2 * math.pi, trees)
    sizes = rng.uniform(0.75, 1.25, trees) * step / _CROWDED
    mirrors = rng.choice((-1.0, 1.0), trees)
    for i in range(trees):
        x, y = (np.array(divmod(places[i], side)) + 0.5 + spread[i]) * step - _SIDE / 2
        c, s = sizes[i] * math.cos(turns[i]), sizes[i] * math.sin(turns[i])
        placed = [
            [mirrors[i] * c, -s, 0, x],
            [mirrors[i] * s, c, 0, y],
            [0, 0, sizes[i], 0],
            [0, 0, 0, 1],
        ]
        for part in ("wood", "leaves"):
            its = model[part]
            assert isinstance(its, Mesh)
            shape = scene[f"{part} 1"] if i else its
            look = its.albedo, its.opacity
            scene.add(shape, f"{part} {i + 1}", *look, transform=placed)
    camera = Camera((0.2, -2.6, 0.75), (0.0, -0.9, 0.0), (0, 0, 1), 38.0, width, height)
    return Setup(scene, camera, light_towards(light, (-2.5, -1.2, 3.0), light_size, (0, 0, 0)))
