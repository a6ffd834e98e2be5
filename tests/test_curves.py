"""Curves: the tubes that stand for them, what every method sees of them, and bad input."""

from __future__ import annotations

import re

import numpy as np
import pytest
import softshadow as ss
from shapes import is_closed, quad

GROUND = quad((0, 0, 0), (4, 0, 0), (0, 4, 0))
LIGHT = ss.SphereLight((0.1, -0.2, 3.0), 0.3)
CAMERA = ss.Camera((0.3, -2.4, 1.9), (0.0, 0.0, 0.3), fov_y_deg=40, width=64, height=64)
NAN, INF = float("nan"), float("inf")


def _bristles(n, points=5, seed=0, length=0.4):
    """`n` wavy curves that stand on the ground, one after the other."""
    rng = np.random.default_rng(seed)
    roots = np.column_stack([rng.uniform(-0.6, 0.6, (n, 2)), np.full(n, 0.02)])
    steps = np.array([0, 0, 1]) + rng.normal(0, 0.3, (n, points - 1, 3))
    steps *= length / (points - 1) / np.linalg.norm(steps, axis=2, keepdims=True)
    curves = roots[:, None] + np.concatenate([np.zeros((n, 1, 3)), steps.cumsum(axis=1)], axis=1)
    return curves.reshape(-1, 3), np.arange(n + 1) * points


def _scene(points, offsets, radii, **options):
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    scene.add_curves(points, offsets, radii, name="hair", **options)
    return scene


def _same(a, b):
    return np.array_equal(a.visibility, b.visibility) and np.array_equal(a.position, b.position)


@pytest.mark.parametrize("sides", [3, 4, 9])
def test_tubes_are_closed_outward_and_have_the_perimeter_of_a_round_tube(sides):
    points, offsets = _bristles(40)
    vertices, faces = ss.kernels.curve_tubes(points, offsets, 0.003, sides)
    assert vertices.shape == (200 * sides, 3)
    assert faces.shape == (40 * (2 * sides * 4 + 2 * (sides - 2)), 3)
    assert is_closed(faces)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    assert (volumes.reshape(40, -1).sum(axis=1) > 0).all()
    # The ends' cross-sections are perpendicular to the curve, a regular polygon around its point.
    ring = vertices[:sides] - points[0]
    assert np.abs(ring @ (points[1] - points[0])).max() < 1e-15
    edges = np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1)
    assert np.allclose(edges, 2 * np.pi * 0.003 / sides, rtol=1e-10)


def test_one_radius_a_curve_and_one_a_point():
    points, offsets = _bristles(3)
    per_curve = np.array([0.001, 0.002, 0.003])
    tubes, _ = ss.kernels.curve_tubes(points, offsets, per_curve)
    for same in (np.repeat(per_curve, 5), per_curve.tolist()):
        assert np.array_equal(ss.kernels.curve_tubes(points, offsets, same)[0], tubes)
    alone = ss.kernels.curve_tubes(points[5:10], [0, 5], 0.002)[0]
    assert np.array_equal(tubes[15:30], alone)
    # A taper moves no other ring than its own.
    taper = np.repeat(per_curve, 5)
    taper[14] = 0.0005
    differs = (ss.kernels.curve_tubes(points, offsets, taper)[0] != tubes).any(axis=1)
    assert np.array_equal(np.flatnonzero(differs), [42, 43, 44])


def test_a_straight_hair_hides_what_a_long_slat_of_its_width_hides():
    """Visibility under a hair across a square light, in closed form.

    Seen from below the middle of a hair at half the height of a square light of edge `a`, which it
    crosses parallel to an edge, the hair hides twice its width over `a`. Averaged over turns about
    its axis that width is its diameter; each turn is within 10 % (three sides).
    """
    light = ss.RectLight((0, 0, 2), (0, 0.8, 0), (0.8, 0, 0))
    radius, hidden = 0.01, []
    for turn in np.linspace(0, 2 * np.pi / 3, 24, endpoint=False):
        scene = ss.Scene()
        scene.add_curves([(-3, 0, 0), (3, 0, 0)], [0, 2], radius, name="hair")
        rotation = np.eye(4)
        rotation[1:3, 1:3] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        rotation[2, 3] = 1.0
        scene.set_transform("hair", rotation)
        seen = ss.visibility(scene, [(0, 0, 0)], [(0, 0, 1)], light, ss.RayTraced(4096))
        hidden.append(1 - seen[0])
    expected = 2 * (2 * radius) / 0.8
    # Edges of the hair are parallel to the light's: right to one of 4096 samples each.
    assert abs(np.mean(hidden) - expected) < 2 / 4096
    assert max(hidden) < 1.06 * expected
    assert min(hidden) > 0.90 * expected


def test_a_hair_s_surface_is_crossed_twice():
    points, offsets = [(-1, 0, 1), (1, 0, 1)], [0, 2]
    for opacity in (0.0, 0.3, 1.0):
        scene = ss.Scene()
        scene.add_curves(points, offsets, 0.05, opacity)
        through = ss.kernels.transmittance(scene, [(0.1, 0, 0)], [(0.1, 0.001, 2)])
        assert through[0] == pytest.approx((1 - opacity) ** 2, abs=1e-6)


def test_curves_move_as_meshes_do():
    points, offsets = _bristles(60)
    scene = _scene(points, offsets, 0.01)
    first = ss.render(scene, CAMERA, LIGHT, ss.RayTraced(16))
    bent = points + np.array([0.5, 0.2, 0.0]) * points[:, 2:] ** 2
    scene.set_vertices("hair", bent)
    moved = ss.render(scene, CAMERA, LIGHT, ss.RayTraced(16))
    assert not _same(moved, first)
    assert _same(moved, ss.render(_scene(bent, offsets, 0.01), CAMERA, LIGHT, ss.RayTraced(16)))
    assert _same(moved, ss.render(scene.copy(), CAMERA, LIGHT, ss.RayTraced(16)))
    lift = np.eye(4)
    lift[2, 3] = 0.25
    scene.set_transform("hair", lift)
    lifted = ss.render(scene, CAMERA, LIGHT, ss.RayTraced(16))
    other = ss.render(scene.copy(), CAMERA, LIGHT, ss.RayTraced(16))
    assert _same(lifted, other)
    assert not _same(lifted, moved)
    entry = scene.entries[1]
    assert isinstance(entry, ss.Curves)
    assert entry in scene.meshes
    assert np.array_equal(entry.points, bent)
    assert (scene.bounds[1] == [2, 2, entry.world_vertices()[:, 2].max()]).all()


def test_a_caller_s_arrays_stay_its_own():
    points, offsets = _bristles(20)
    radii = np.full(20, 0.01)
    scene = _scene(points, offsets, radii)
    before = ss.render(scene, CAMERA, LIGHT, "hard")
    points += 1
    radii *= 2
    assert _same(ss.render(scene.copy(), CAMERA, LIGHT, "hard"), before)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_curves_of_any_size_cast_the_same_shadow(scale):
    points, offsets = _bristles(60)
    expected = ss.render(_scene(points, offsets, 0.01), CAMERA, LIGHT, ss.RayTraced(16))
    scene = ss.Scene()
    scene.add((np.asarray(GROUND[0]) * scale, GROUND[1]))
    scene.add_curves(points * scale, offsets, 0.01 * scale)
    eye, target = np.array([(0.3, -2.4, 1.9), (0.0, 0.0, 0.3)]) * scale
    camera = ss.Camera(eye, target, fov_y_deg=40, width=64, height=64)
    light = ss.SphereLight(np.multiply(LIGHT.center, scale), LIGHT.radius * scale)
    got = ss.render(scene, camera, light, ss.RayTraced(16))
    # Rounding moves an edge's pixel now and then.
    assert (got.visibility != expected.visibility).mean() < 0.01
    assert np.abs(got.visibility - expected.visibility).mean() < 1e-3


def test_a_million_triangles_are_closed_and_finite():
    points, offsets = _bristles(40_000)
    vertices, faces = ss.kernels.curve_tubes(points, offsets, 0.001)
    assert len(faces) == 40_000 * 26
    assert is_closed(faces)
    assert np.isfinite(vertices).all()


P = np.array([(0, 0, 0), (0, 0, 1), (1, 0, 0), (1, 0, 1), (1, 1, 1.0)])


def _changed(index, value):
    points = P.copy()
    points[index] = value
    return points


@pytest.mark.parametrize(
    ("points", "offsets", "radii", "words"),
    [
        (_changed(3, (1, NAN, 0)), [0, 2, 5], 1, ['curves "c"', "point 3", "not finite", "NaN"]),
        (_changed(0, (INF, 0, 0)), [0, 2, 5], 1, ['curves "c"', "point 0", "not finite", "inf"]),
        (P[:, :2], [0, 2, 5], 1, ["curves 'c'", "(P, 3)", "(5, 2)"]),
        (P.ravel(), [0, 2, 5], 1, ["(P, 3)", "(15,)"]),
        (P, [], 1, ['curves "c"', "at least one curve", "0"]),
        (P, [0], 1, ["at least one curve", "1"]),
        (np.zeros((0, 3)), [0, 0], 1, ["curve 0", "2 points or more", "0 to 0"]),
        (P, [[0, 2, 5]], 1, ["(C + 1,)", "(1, 3)"]),
        (P, [1, 3, 5], 1, ["start with 0", "5 points", "1 and 5"]),
        (P, [0, 2, 4], 1, ["end with the 5 points", "0 and 4"]),
        (P, [0, 2, 6], 1, ["end with the 5 points", "0 and 6"]),
        (P, [0, 3, 2, 5], 1, ["curve 1", "2 points or more", "3 to 2"]),
        (P, [0, 3, 3, 5], 1, ["curve 1", "2 points or more", "3 to 3"]),
        (P, [0, 4, 5], 1, ["curve 1", "2 points or more", "4 to 5"]),
        (P, [0, -(2**63), 5], 1, ["curve 0", "2 points or more"]),
        (P, [0, 2**63 - 1, 5], 1, ["curve 1", "2 points or more"]),
        (P, [0, 2, 5], 0, ["radius 0", "positive", "0"]),
        (P, [0, 2, 5], [1, -2], ["radius 1", "positive", "-2"]),
        (P, [0, 2, 5], [1, 1, NAN, 1, 1], ["radius 2", "finite", "NaN"]),
        (P, [0, 2, 5], INF, ["radius 0", "finite", "inf"]),
        (P, [0, 2, 5], [1, 1, 1], ["one radius", "2 curves", "5 points", "got 3"]),
        (P, [0, 2, 5], [], ["one radius", "got 0"]),
        (P, [0, 2, 5], np.ones((2, 1)), ["radii", "(2, 1)"]),
        (_changed(3, P[2]), [0, 2, 5], 1, ["points 2 and 3 of curve 1", "[1.0, 0.0, 0.0]"]),
        (1.7e308 * P, [0, 2, 5], 1e308, ["tube around point", "overflows"]),
    ],
)
def test_bad_curves_are_errors_that_say_what_and_where(points, offsets, radii, words):
    scene = ss.Scene()
    with pytest.raises(ValueError, match="(?s)" + ".*".join(re.escape(w) for w in words)):
        scene.add_curves(points, offsets, radii, name="c")
    assert scene.names == ()
    scene.add_curves(P, [0, 2, 5], 0.1, name="c")  # the name is still free


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ({"sides": 2}, ValueError, ["sides", "3 to 64", "2"]),
        ({"sides": 65}, ValueError, ["sides", "65"]),
        ({"opacity": 1.5}, ValueError, ["opacity", "1.5"]),
        ({"albedo": -1}, ValueError, ["curves 'c'", "albedo", "-1"]),
        ({"offsets": [0, 2.0, 5]}, TypeError, ["offsets", "integers", "float64"]),
        ({"radii": "thin"}, TypeError, ["numbers"]),
        ({"points": "many"}, TypeError, ["numbers"]),
    ],
)
def test_bad_options_of_curves_are_errors(options, kind, words):
    arguments = {"points": P, "offsets": [0, 2, 5], "radii": 0.1, "name": "c"} | options
    with pytest.raises(kind, match="(?s)" + ".*".join(re.escape(w) for w in words)):
        ss.Scene().add_curves(**arguments)


def test_bad_new_points_are_errors_and_change_nothing():
    scene = ss.Scene()
    scene.add_curves(P, [0, 2, 5], 0.1, name="c")
    vertices = scene.entries[0].vertices
    for points, words in [
        (P[:4], ['curves "c"', "5 points", "4"]),
        (_changed(1, (0, 0, NAN)), ['curves "c"', "point 1", "not finite"]),
        (_changed(1, P[0]), ['curves "c"', "points 0 and 1 of curve 0"]),
    ]:
        with pytest.raises(ValueError, match="(?s)" + ".*".join(re.escape(w) for w in words)):
            scene.set_vertices("c", points)
        assert np.array_equal(scene.entries[0].vertices, vertices)
        assert np.array_equal(scene.entries[0].points, P)


def test_folds_and_curves_thicker_than_long_are_normal_input():
    zigzag = np.array([(0, 0, 0), (1, 0, 0), (0, 0, 0), (1, 1e-9, 0), (1, 1e-3, 0.5)])
    scene = _scene(np.array([0, 0, 0.5]) + zigzag, [0, 5], 0.3)
    image = ss.render(scene, CAMERA, LIGHT, ss.RayTraced(16))
    assert np.isfinite(image.radiance).all()
    assert (image.visibility[image.mask] == 0).any()
