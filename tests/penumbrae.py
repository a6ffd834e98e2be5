"""What the tests of penumbra wedges share: scenes over a ground, lights, and what to look at."""

from __future__ import annotations

import numpy as np
import softshadow as ss
import trimesh
from scipy import ndimage
from shapes import quad

GROUND = quad((0, 0, 0), (6, 0, 0), (0, 6, 0))
CAMERA = ss.Camera((0.3, -2.4, 1.9), (0.0, 0.1, 0.15), fov_y_deg=40, width=72, height=64)

CENTER = (0.5, -0.3, 2.0)
"""Of the lights below; an edge through two vertices of a test's scene never meets it by chance."""


def lights(size=0.4, center=CENTER):
    """One light of each shape, facing down, `size` across."""
    return {
        "rect": ss.RectLight(center, (0, size, 0), (size, 0, 0)),
        "turned": ss.RectLight(
            center, (0.6 * size, 0.64 * size, 0.48 * size), (0.8 * size, -0.48 * size, -0.36 * size)
        ),
        "disk": ss.DiskLight(center, (0.1, -0.05, -1), size / 2),
        "sphere": ss.SphereLight(center, size / 2),
    }


def over_ground(*meshes, **options):
    """A ground plane and what is over it."""
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    for mesh in meshes:
        scene.add(mesh, **options)
    return scene


def box(size=(0.5, 0.4, 0.3), center=(0.0, 0.0, 0.5), turn_deg=20.0):
    """A box, turned about the z axis."""
    mesh = trimesh.creation.box(size)
    turn = trimesh.transformations.rotation_matrix(np.radians(turn_deg), (0, 0, 1))
    return mesh.apply_transform(turn).apply_translation(center)


def ball(center=(0.0, 0.0, 0.6), radius=0.3, detail=3):
    """An icosphere."""
    return trimesh.creation.icosphere(detail, radius).apply_translation(center)


def torus(center=(0.0, 0.0, 0.6), sections=48):
    """A ring that lies flat, its hole seen by the light."""
    mesh = trimesh.creation.torus(0.35, 0.1, major_sections=sections, minor_sections=sections // 2)
    return mesh.apply_translation(center)


def alike(values, of):
    """Pixels that are `of`, and all of their eight neighbours, too."""
    return ndimage.minimum_filter((values == of).astype(np.uint8), 3, mode="nearest") == 1


def steps(values, where):
    """Differences between neighbouring pixels that are both in `where`."""
    across = np.abs(np.diff(values, axis=1))[where[:, 1:] & where[:, :-1]]
    down = np.abs(np.diff(values, axis=0))[where[1:] & where[:-1]]
    return np.concatenate([across, down])
