"""Triangles in place of layered maps next to receivers, and where the map takes over."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from shapes import quad

REFERENCE = ss.RayTraced(samples=256, pattern="fixed")
ALL_THE_WAY = 65536.0
"""Of `near`: up to the light."""

LIGHTS = {
    "rect": ss.RectLight((0.1, 0, 3), (0, 0.8, 0), (0.8, 0, 0)),
    "disk": ss.DiskLight((0.1, 0, 3), (0, 0.2, -1), 0.5),
    "sphere": ss.SphereLight((0.1, 0, 3), 0.5),
}


def _soup(opacity, count=150):
    """Triangles of all sizes in a box, over a ground that casts as well."""
    rng = np.random.default_rng(5)
    centers = rng.uniform((-0.7, -0.7, 0.0), (0.7, 0.7, 1.2), (count, 3))
    size = 10 ** rng.uniform(-2, -0.3, count)
    corners = centers[:, None] + size[:, None, None] * rng.uniform(-1, 1, (count, 3, 3))
    scene = ss.Scene()
    scene.add(quad((0, 0, -0.3), (6, 0, 0), (0, 6, 0)), "ground")
    scene.add((corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)), opacity=opacity)
    # Half of the receivers on the triangles, on either side.
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals *= rng.choice([-1, 1], (count, 1)) / np.linalg.norm(normals, axis=1, keepdims=True)
    ground = rng.uniform((-1, -1, -0.3), (1, 1, -0.3), (count, 3))
    points = np.concatenate([corners.mean(axis=1), ground])
    return scene, points, np.concatenate([normals, np.tile((0.0, 0.0, 1.0), (count, 1))])


@pytest.mark.parametrize("opacity", [1.0, 0.4])
@pytest.mark.parametrize("kind", LIGHTS)
def test_triangles_all_the_way_to_the_light_are_rays(kind, opacity):
    scene, points, normals = _soup(opacity)
    method = ss.Mtsm(64, 2, near=ALL_THE_WAY, threshold=0.0)
    for n in (normals, None):
        # Without a normal a receiver on a triangle is on either side of it.
        free = slice(None) if n is not None else slice(len(points) // 2, None)
        at = points[free] + (0.0 if n is not None else 0.01)
        seen = ss.visibility(scene, at, n, LIGHTS[kind], method)
        traced = ss.visibility(scene, at, n, LIGHTS[kind], REFERENCE)
        assert 0.2 < traced.mean() < 0.9
        # A sample on an edge to rounding (measured: none).
        assert np.abs(seen - traced).max() < 1.5 / 256
        assert (np.abs(seen - traced) > 1e-5).mean() < 0.01


@pytest.mark.parametrize("kind", LIGHTS)
@pytest.mark.parametrize("near", [1.0, 3.0, 24.0, 200.0])
def test_no_surface_is_lost_or_counted_twice_where_the_map_takes_over(kind, near):
    """Wide tilted sheets, which cross the depth where it does for all receivers."""
    for opacity, expected in [(1.0, 0.0), (0.5, 0.25)]:
        scene = ss.Scene()
        scene.add(quad((0, 0, 0), (6, 0, 0), (0, 6, 0)), "ground", casts=False)
        # Above all receivers, from 0.02 on.
        scene.add(quad((0, 0, 0.6), (6, 0, 3), (0, 6, 1)), opacity=opacity)
        scene.add(quad((0, 0, 0.3), (6, 0, -1.2), (0, 6, 0.6)), opacity=opacity)
        rng = np.random.default_rng(2)
        points = np.pad(rng.uniform(-0.2, 0.2, (200, 2)), ((0, 0), (0, 1)))
        seen = ss.visibility(
            scene, points, np.tile((0.0, 0.0, 1.0), (200, 1)), LIGHTS[kind], ss.Mtsm(128, 4, near=near)
        )
        # A transparent surface is cut by depths of texels' middles on one side and exactly on the
        # other.
        print(kind, near, opacity, np.abs(seen - expected).max(), (seen - expected).mean())


def test_leaves_and_hair_are_dark_and_lit_where_they_are():
    """What a map cannot tell: leaves are a few texels wide."""
    for setup in (
        ss.scenes.tree(96, 96, leaves=40_000),
        ss.scenes.fur_ribbons(96, 96, triangles=60_000),
        ss.scenes.tree(96, 96, leaves=40_000, opacity=0.5),
    ):
        view = (setup.scene, setup.camera, setup.light)
        exact = ss.render(*view, REFERENCE)
        above = exact.mask & (exact.mesh_id != 0)
        without, default = (
            ss.render(*view, m).visibility[above] - exact.visibility[above]
            for m in (ss.Mtsm(1024, near=0.0), ss.Mtsm(1024))
        )
        print(np.sqrt((without**2).mean()), np.sqrt((default**2).mean()))
