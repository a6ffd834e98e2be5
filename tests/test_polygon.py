"""Polygon lights: outlines of any form, against sums of rectangles, closed forms and Mitsuba."""

from __future__ import annotations

import math
import os
import pickle

import numpy as np
import pytest
import softshadow as ss
from bits import digest, with_threads
from penumbrae import over_ground, torus
from shapes import QUAD, quad
from softshadow import cli
from softshadow.loading import Setup, _placed

DOWN = [(0, 0, 1)]
"""A normal of the ground, to which the lights below shine."""

PLANS = {
    # A square without a quarter, whose reflex corner is its middle.
    "l": [(0, 0), (0, 1), (0.5, 1), (0.5, 0.5), (1, 0.5), (1, 0)],
    # Its centroid, at a height of 5/12, is not on it.
    "u": [(0, 0), (0, 1), (0.25, 1), (0.25, 0.25), (0.75, 0.25), (0.75, 1), (1, 1), (1, 0)],
    "triangle": [(0, 0), (0.4, 1), (1, 0.3)],
}
PARTS = {
    "l": [((0, 0), (0.5, 1)), ((0.5, 0), (1, 0.5))],
    "u": [((0, 0), (0.25, 1)), ((0.25, 0), (0.75, 0.25)), ((0.75, 0), (1, 1))],
}
"""Rectangles that make up two of them: lower and upper corners."""


def light_of(plan, size=0.6, center=(0.3, -0.2, 2.0), **options):
    """A plan's middle of its square over a place, facing down."""
    x, y, z = center
    return ss.PolygonLight([(x + size * (a - 0.5), y + size * (b - 0.5), z) for a, b in plan], **options)


def parts_of(name, size=0.6, center=(0.3, -0.2, 2.0)):
    """The rectangles of a plan as lights, and their parts of its area."""
    low, high = (np.array([part[i] for part in PARTS[name]]) for i in (0, 1))
    place = np.array(center)
    lights = [
        ss.RectLight(place + size * np.append(m - 0.5, 0), (0, size * d[1], 0), (size * d[0], 0, 0))
        for m, d in zip((low + high) / 2, high - low, strict=True)
    ]
    areas = (high - low).prod(axis=1)
    return lights, areas / areas.sum()


def board():
    """A board over a ground: one silhouette from wherever it is seen."""
    return over_ground(quad((0.1, -0.1, 0.8), (0.5, 0.2, 0.1), (-0.1, 0.4, 0.05)))


CAMERA = ss.Camera((0.2, -2.2, 1.6), (0.0, 0.1, 0.0), fov_y_deg=40, width=64, height=48)

# ---------------------------------------------------------------- what is no polygon

SQUARE = [(0, 0, 2), (1, 0, 2), (1, 1, 2), (0, 1, 2)]


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        (SQUARE[:2], "expected 3 to 1024, got 2"),
        (np.zeros((1025, 3)), "expected 3 to 1024, got 1025"),
        ([*SQUARE[:3], (0, math.inf, 2)], "vertex 3: expected finite numbers"),
        ([*SQUARE[:3], (0, 1, 2.1)], r"one plane; vertex \d is 2\.\d+e-2 off it"),
        ([(0, 0, 2), (1, 0, 2), (2, 0, 2)], "no area"),
        ([(1, 2, 3)] * 3, "all vertices are at"),
        ([*SQUARE, SQUARE[0]], "vertices 4 and 0 are one point"),
        ([SQUARE[0], (2, 0, 2), *SQUARE[1:]], "turns back on itself at vertex 1"),
        ([(0, 0, 2), (1, 0, 2), (0, 1, 2), (3, 2, 2)], "from vertex 1 to 2 .* from vertex 3 to 0"),
        ([*SQUARE[:3], (0.5, 0, 2), SQUARE[3]], "meets itself"),
    ],
)
def test_what_is_no_polygon_is_refused_by_its_vertex(vertices, message):
    with pytest.raises(ss.ParameterError, match=message):
        ss.PolygonLight(vertices)


@pytest.mark.parametrize("vertices", ["abc", [(0, 0), (1, 0), (1, 1)], [1, 2, 3], None])
def test_what_has_no_vertices_is_refused(vertices):
    with pytest.raises((TypeError, ValueError), match=r"PolygonLight\.vertices"):
        ss.PolygonLight(vertices)


def test_a_regular_polygon_of_many_corners_slanted_and_far_away_is_one():
    angle = 2 * np.pi * np.arange(1024) / 1024
    u, v = np.array((0.6, 0.64, 0.48)), np.array((0.8, -0.48, -0.36))
    corners = np.outer(np.cos(angle), u) + np.outer(np.sin(angle), v) + 1e5
    light = ss.PolygonLight(corners)
    assert light.center == pytest.approx((1e5, 1e5, 1e5), abs=1e-9)
    # In single precision the corners of a tilted outline are off a plane by their rounding.
    ss.PolygonLight(np.float32(corners - 1e5))


# ---------------------------------------------------------------- without casters


@pytest.mark.parametrize("name", PARTS)
def test_irradiance_and_fraction_are_those_of_its_rectangles(name):
    rng = np.random.default_rng(3)
    points = rng.uniform((-1, -1, 0), (1, 1, 1.9), (500, 3))
    normals = rng.normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    light, (parts, areas) = light_of(PLANS[name]), parts_of(name)
    found = ss.kernels.light_fraction_above(light, points, normals)
    expected = sum(
        a * ss.kernels.light_fraction_above(part, points, normals)
        for a, part in zip(areas, parts, strict=True)
    )
    # Each is a sum of some ten products and arcs in double precision.
    assert found == pytest.approx(expected, abs=1e-13)
    assert ((found > 0) & (found < 1)).sum() > 50
    found = ss.kernels.unshadowed_irradiance(light, points, normals)
    expected = sum(ss.kernels.unshadowed_irradiance(part, points, normals) for part in parts)
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-13)


def test_a_tangent_plane_through_a_reflex_corner_cuts_the_light_exactly():
    """Receivers on walls whose planes go through the L's reflex corner, in seven directions."""
    light = light_of(PLANS["l"], 1.0, (0.0, 0.0, 1.0))
    angle = np.radians([0, 45, 90, 135, 180, 225, 270, 315])
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros(8)], axis=1)
    points = np.zeros((8, 3))
    # Quarters of the square above the plane, by its direction; the one at 45 degrees is missing.
    quarters = np.array([1, 1, 1, 1.5, 2, 2, 2, 1.5]) / 3
    exact = ss.kernels.light_fraction_above(light, points, normals)
    assert exact == pytest.approx(quarters, abs=1e-15)
    scene = ss.Scene()
    scene.add(quad((5, 5, 0), (1, 0, 0), (0, 1, 0)))
    for method in (ss.RayTraced(samples=4096), ss.Counted(samples=4096), "hard", ss.Mtsm()):
        seen = ss.visibility(scene, points, normals, light, method)
        if method == "hard":
            continue
        # Along a line some 64 of 4096 samples are uncertain.
        assert seen == pytest.approx(quarters, abs=0.016)


def test_samples_are_uniform_over_the_outline():
    points, _, _ = ss.kernels.light_samples(light_of(PLANS["u"], 1.0, (0.5, 0.5, 1)), (0.5, 0.5, 0), 4096)
    x, y = points[:, 0], points[:, 1]
    inside = (y <= 0.25 + 1e-6) | (x <= 0.25 + 1e-6) | (x >= 0.75 - 1e-6)
    assert inside.all()
    # Of the 16 squares of a quarter's side 10 are the light's. Strips across hold their part to a sample, parts
    # of them are bounded by a line in the square that only some 64 cells meet.
    counts, _, _ = np.histogram2d(x, y, bins=4, range=((0, 1), (0, 1)))
    light = counts[counts > 0]
    assert len(light) == 10
    assert light / 4096 == pytest.approx(0.1, abs=0.016)


# ---------------------------------------------------------------- with casters


SAMPLED = {
    "ray_traced": ss.RayTraced(samples=4096, pattern="fixed"),
    "counted": ss.Counted(samples=4096),
    "accumulation": ss.Accumulation(samples=1024),
    "slsm": ss.Slsm(resolution=1024, samples=1024),
    "mlsm": ss.Mlsm(samples=1024),
    "mtsm": ss.Mtsm(samples=1024),
    "mvsm": ss.Mvsm(samples=1024),
    "wedges": ss.Wedges(),
}
# Largest and mean difference. Measured: see the test.
APART = {
    "ray_traced": (0.02, 0.001),
    "counted": (0.02, 0.001),
    "accumulation": (0.2, 0.01),
    "slsm": (0.2, 0.01),
    "mlsm": (0.2, 0.01),
    "mtsm": (0.2, 0.01),
    "mvsm": (0.2, 0.01),
    "wedges": (2e-4, 1e-5),
}


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("method", SAMPLED)
def test_visibility_is_that_of_its_rectangles(method, name):
    scene, (parts, areas) = board(), parts_of(name)
    seen = ss.render(scene, CAMERA, [light_of(PLANS[name]), *parts], SAMPLED[method]).visibility
    differ = np.abs(seen[0] - np.tensordot(areas, seen[1:], 1))
    print(method, name, differ.max(), differ.mean())
    assert ((seen[0] > 0) & (seen[0] < 1)).sum() > 100
    most, mean = APART[method]
    assert differ.max() < most
    assert differ.mean() < mean
