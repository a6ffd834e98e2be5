"""The soft shadow occlusion camera at sharp corners of silhouettes."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from shapes import quad

HEIGHT = 0.7
CENTER = np.array([0.013, -0.007, 2.5])
GROUND = quad((0, 0, 0), (18, 0, 0), (0, 18, 0))
TURNS = (0.0, 13.0, 71.0, 128.0)
ANGLES = (5, 15, 30, 60, 90, 120)

LIGHTS = {
    "rect": ss.RectLight(CENTER, (0, 0.2, 0), (0.2, 0, 0)),
    "disk": ss.DiskLight(CENTER, (0, 0, -1), 0.1),
}


def _outline(degrees, kind, turn):
    """A corner of so many degrees at the origin: a triangle, or a notch in a square."""
    half = np.radians(degrees) / 2
    x, y = 0.5 * np.cos(half), 0.5 * np.sin(half)
    if kind == "convex":
        points = [(0, 0), (x, -y), (x, y)]
    else:
        points = [(0, 0), (x, y), (x, 0.8), (-0.8, 0.8), (-0.8, -0.8), (x, -0.8), (x, -y)]
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    return np.array(points) @ np.array([(c, s), (-s, c)])


def _scene(outline):
    scene = ss.Scene()
    n = len(outline)
    faces = np.array([(0, i, i + 1) for i in range(1, n - 1)])
    scene.add((np.column_stack([outline, np.full(n, HEIGHT)]), faces), "sheet")
    scene.add(GROUND, "ground")
    return scene


def _even_odd(outline, points):
    """Whether points are in a polygon."""
    x, y = points.T
    within = np.zeros(len(points), dtype=bool)
    for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        if y0 != y1:
            crosses = (y0 > y) != (y1 > y)
            within ^= crosses & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))
    return within


def _distance(outline, points):
    """Distance from a polygon's border."""
    found = np.full(len(points), np.inf)
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        found = np.minimum(found, np.linalg.norm(points - a - t[:, None] * (b - a), axis=1))
    return found


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("kind", ["convex", "reflex"])
def test_every_texel_is_on_the_right_side_of_a_corner(kind, degrees):
    """The nearer of both maps' silhouette points is in the map of the side that the texel is on."""
    for turn in TURNS:
        outline = _outline(degrees, kind, turn)
        light = LIGHTS["disk"]
        view = ss.kernels.ssoc_maps(_scene(outline), light, ss.Ssoc(resolution=384))[0]
        height, width = view.depth.shape
        rows, columns = np.mgrid[:height, :width] + 0.5
        texels = np.column_stack([columns.ravel(), rows.ravel()])
        local = np.column_stack([outline, np.full(len(outline), HEIGHT)]) - view.camera.eye
        projected = local @ view.camera.camera_to_world[:3, :3] @ view.camera.K.T
        projected = projected[:, :2] / projected[:, 2:]

        def away(values, texels=texels):
            known = values[..., 4].ravel() > 0
            apart = np.linalg.norm(values[..., :2].reshape(-1, 2) - texels, axis=1)
            return np.where(known, apart, np.inf)

        inside, outside = away(view.inside), away(view.outside)
        known = np.isfinite(np.minimum(inside, outside))
        # Silhouette points are single precision of up to 384 texels: the border has no side.
        distance = _distance(projected, texels)
        known &= distance > 1e-3
        within = _even_odd(projected, texels)
        assert known.sum() > 5000
        own, other = np.where(within, inside, outside), np.where(within, outside, inside)
        assert (own < other)[known].all()
        assert np.abs(own - distance)[known].max() < 1e-3


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("kind", ["convex", "reflex"])
def test_a_corner_hides_what_both_of_its_lines_cut_off(kind, degrees, light):
    """Not the distance from it: a sharp corner's penumbra is exact."""
    # Twice the half-width of the penumbra around the shadow of the corner.
    width = 0.1 * HEIGHT / (CENTER[2] - HEIGHT)
    place = (np.arange(60) + 0.5) / 30 - 1
    x, y = np.meshgrid(2 * width * place, 2 * width * place)
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    points[:, :2] -= CENTER[:2] * HEIGHT / (CENTER[2] - HEIGHT)
    up = np.broadcast_to((0.0, 0.0, 1.0), points.shape)
    for turn in TURNS:
        scene = _scene(_outline(degrees, kind, turn))
        reference = ss.visibility(scene, points, up, LIGHTS[light], ss.RayTraced(1024, seed=3))
        found = ss.visibility(scene, points, up, LIGHTS[light], "ssoc")
        partly = (reference > 0.002) & (reference < 0.998)
        assert partly.sum() > 100
        error = np.abs(found - reference)[partly]
        # Measured: 0.0014 to 0.0019, at angles at which it is the noise of 1024 stratified samples;
        # single points whose texels' centres are on an edge by rounding are farther off.
        assert error.mean() < 0.0025
        assert (error > 0.03).mean() < 0.002


def test_corners_under_a_centred_light_are_alike():
    """Texels' centres lie on the lines that part the corners' fans, and belong to one of them."""
    scene = ss.Scene()
    scene.add(ss.scenes.square(2), "ground")
    scene.add(ss.scenes.square(0.4, z=1), "board")
    light = ss.SphereLight((0, 0, 3), 0.3)
    maps = ss.kernels.ssoc_maps(scene, light, ss.Ssoc(resolution=256))[0]
    near = maps.outside[..., 5] > 0
    assert np.array_equal(near, near[::-1])
    assert np.array_equal(near, near[:, ::-1])
    x = np.linspace(-0.8, 0.8, 201)
    points = np.stack([*np.meshgrid(x, x), np.zeros((201, 201))], axis=-1).reshape(-1, 3)
    normals = np.broadcast_to((0.0, 0.0, 1.0), points.shape)
    seen = ss.visibility(scene, points, normals, light, ss.Ssoc(resolution=256)).reshape(201, 201)
    # A texel without its edge was lit: up to 0.2 lighter than at the other corners.
    assert np.abs(seen - seen[::-1]).max() < 0.01
    assert np.abs(seen - seen[:, ::-1]).max() < 0.01
