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
    """Wide tilted sheets, which are at that depth for all receivers."""
    points = np.random.default_rng(2).uniform((-0.2, -0.2, 0), (0.2, 0.2, 0), (200, 3))
    normals = np.tile((0.0, 0.0, 1.0), (200, 1))
    for opacity, expected in [(1.0, 0.0), (0.5, 0.25)]:
        scene = ss.Scene()
        scene.add(quad((0, 0, 0), (6, 0, 0), (0, 6, 0)), "ground", casts=False)
        # From 0.02 above the receivers on.
        scene.add(quad((0, 0, 0.6), (6, 0, 3), (0, 6, 1)), opacity=opacity)
        scene.add(quad((0, 0, 0.3), (6, 0, -1.2), (0, 6, 0.6)), opacity=opacity)
        method = ss.Mtsm(128, 4, near=near)
        error = ss.visibility(scene, points, normals, LIGHTS[kind], method) - expected
        # Nothing shines through. A transparent sheet may be missing, or there twice, in a strip of
        # half a texel, of a light that is `near` texels wide (measured: 0.091 with 1 texel, 0.006
        # with 3, and none).
        assert np.abs(error).max() <= (0.0 if opacity == 1 else 0.25 / near)
        assert abs(error.mean()) < 0.001


def test_both_sides_of_a_leaf_in_contact_with_another():
    scene = ss.Scene()
    scene.add(quad((0, 0, 1), (0.2, 0, 0), (0, 0.2, 0)), "leaf")
    # It touches the other along its border, and rises by a hundredth of a texel of the map.
    scene.add(quad((0.05, 0, 1.00005), (0.1, 0, 0.0001), (0, 0.2, 0)), "upper")
    scene.add(quad((0, 0, 0), (2, 0, 0), (0, 2, 0)), "ground")
    x = np.linspace(-0.095, 0.095, 39)
    points = np.stack([x, 0 * x, 0 * x + 1], axis=-1)
    for light in LIGHTS.values():
        up, down = (
            ss.visibility(scene, points, np.tile((0.0, 0.0, side), (39, 1)), light, ss.Mtsm(128))
            for side in (1.0, -1.0)
        )
        assert (down == 0).all()
        covered = x > 0.0
        assert (up[~covered & (x < -0.001)] == 1).all()
        assert (up[covered & (x > 0.001)] == 0).all()


def test_leaves_and_hair_are_as_dark_as_rays_find_them():
    """What a map cannot tell: penumbrae of what is a few texels away."""
    # Root mean square errors over what casts: with the map alone, and at most by default
    # (measured: 0.048 and 0.0041, 0.035 and 0.0145, 0.053 and 0.0061).
    for setup, alone, default in (
        (ss.scenes.tree(64, 64, leaves=20_000), 0.04, 0.007),
        (ss.scenes.fur_ribbons(64, 64, triangles=30_000), 0.03, 0.018),
        (ss.scenes.tree(64, 64, leaves=20_000, opacity=0.5), 0.04, 0.009),
    ):
        view = (setup.scene, setup.camera, setup.light)
        exact = ss.render(*view, REFERENCE)
        above = exact.mask & (exact.mesh_id != 0)
        errors = []
        for method in (ss.Mtsm(1024, near=0.0), ss.Mtsm(1024)):
            seen = ss.render(*view, method).visibility.astype(np.float64)
            errors.append(np.sqrt(((seen - exact.visibility)[above] ** 2).mean()))
        assert errors[0] > alone
        assert errors[1] < default
