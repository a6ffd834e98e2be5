"""Polygon lights: outlines of any form, against sums of rectangles, closed forms and Mitsuba."""

from __future__ import annotations

import importlib.util
import math
import os
import pickle

import numpy as np
import pytest
import softshadow as ss
from bits import digest, with_threads
from penumbrae import over_ground, torus
from shapes import quad
from softshadow import cli
from softshadow.loading import Setup, _placed


def _has_mitsuba():
    return importlib.util.find_spec("mitsuba") is not None


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
    return ss.PolygonLight(
        [(x + size * (a - 0.5), y + size * (b - 0.5), z) for a, b in plan], **options
    )


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
    points, _, _ = ss.kernels.light_samples(
        light_of(PLANS["u"], 1.0, (0.5, 0.5, 1)), (0.5, 0.5, 0), 4096
    )
    x, y = points[:, 0], points[:, 1]
    inside = (y <= 0.25 + 1e-6) | (x <= 0.25 + 1e-6) | (x >= 0.75 - 1e-6)
    assert inside.all()
    # Of the 16 squares of a quarter's side 10 are the light's. Strips across hold their part to a
    # sample, and a line that bounds a part of one meets some 64 cells of the square.
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
# Largest and mean difference of visibility: what the samples of each light are off. Measured, the
# worse of both plans: 0.0031 and 9.2e-5 (ray_traced), 0.0103 and 1.4e-4 (counted), 0.0066 and
# 1.9e-4 (accumulation), 0.0078 and 2.8e-4 (maps of one view), 0.0098 and 2.7e-4 (mvsm). Of one
# silhouette wedges measure the area in closed form: 2.5e-6 and 1.1e-8.
APART = {
    "ray_traced": (0.005, 2e-4),
    "counted": (0.015, 3e-4),
    "accumulation": (0.01, 4e-4),
    "slsm": (0.012, 5e-4),
    "mlsm": (0.012, 5e-4),
    "mtsm": (0.012, 5e-4),
    "mvsm": (0.015, 5e-4),
    "wedges": (1e-5, 1e-7),
}


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("method", SAMPLED)
def test_visibility_is_that_of_its_rectangles(method, name):
    scene, (parts, areas) = board(), parts_of(name)
    seen = ss.render(scene, CAMERA, [light_of(PLANS[name]), *parts], SAMPLED[method]).visibility
    differ = np.abs(seen[0] - np.tensordot(areas, seen[1:], 1))
    assert ((seen[0] > 0) & (seen[0] < 1)).sum() > 100
    most, mean = APART[method]
    assert differ.max() < most
    assert differ.mean() < mean


SMALL = {
    "convolution": ss.Convolution(),
    "deep": ss.DeepShadow(resolution=256),
    "hard": ss.Hard(),
    "line": ss.Wedges(falloff="line"),
    "mvsm": ss.Mvsm(resolution=256),
    "pcf": ss.Pcf(resolution=256),
    "ray_traced": ss.RayTraced(samples=256),
    "shadow_volume": ss.ShadowVolume(),
    "single_sample": ss.SingleSample(),
    "ssoc": ss.Ssoc(resolution=256),
}


@pytest.mark.parametrize("method", [*SMALL, *(m for m in SAMPLED if m not in SMALL)])
def test_a_polygon_that_is_a_rectangle_gives_what_the_rectangle_gives(method):
    rect = ss.RectLight((0.3, -0.2, 2.0), (0, 0.7, 0), (0.5, 0, 0))
    c, u, v = (np.array(x) for x in (rect.center, rect.edge_u, rect.edge_v))
    corners = [c - u / 2 - v / 2, c + u / 2 - v / 2, c + u / 2 + v / 2, c - u / 2 + v / 2]
    scene = over_ground(torus())
    settings = (SMALL | SAMPLED)[method]
    seen = ss.render(scene, CAMERA, [rect, ss.PolygonLight(corners)], settings).visibility
    differ = np.abs(seen[1] - seen[0])
    # Samples and rectangles are the same to the bit here; wedges sum over sides: measured 3e-7.
    assert differ.max() < (2e-6 if method == "wedges" else 1e-6)


def stand_in(light):
    """The rectangle that some methods take for a polygon."""
    corners = np.array(light.vertices)
    first, z = corners[0, :2], corners[0, 2]
    a, b = corners[:, :2] - first, np.roll(corners[:, :2], -1, axis=0) - first
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = cross.sum() / 2
    middle = ((a + b) * cross[:, None]).sum(axis=0) / (6 * area)
    second = np.einsum("ni,nj,n->ij", a, a, cross) + np.einsum("ni,nj,n->ij", b, b, cross)
    second += np.einsum("ni,nj,n->ij", a + b, a + b, cross)
    second = second / 24 - area * np.outer(middle, middle)
    moments, axes = np.linalg.eigh(second / area)
    sides = np.sqrt(abs(area) / np.prod(np.sqrt(moments))) * np.sqrt(moments)
    u, v = (np.append(axis * side, 0) for axis, side in zip(axes.T, sides, strict=True))
    if np.cross(u, v)[2] > 0:
        u, v = v, u
    return ss.RectLight(np.append(first + middle, z), u, v)


@pytest.mark.parametrize("method", ["ssoc", "single_sample", "convolution"])
@pytest.mark.parametrize("name", ["u", "triangle"])
def test_a_rectangle_of_its_area_stands_in_where_a_method_takes_no_outline(method, name):
    light = light_of(PLANS[name])
    rect = stand_in(light)
    area = np.linalg.norm(np.cross(rect.edge_u, rect.edge_v))
    assert area == pytest.approx({"u": 0.625, "triangle": 0.44}[name] * 0.36)
    assert rect.center == pytest.approx(light.center)
    seen = ss.render(over_ground(torus()), CAMERA, [light, rect], method).visibility
    # Both see the same but for rounding, where all of both lights is above the horizon.
    ground = ss.render(over_ground(torus()), CAMERA, light, method).mesh_id == 0
    differ = np.abs(seen[0] - seen[1])[ground]
    # Measured: 1.8e-7.
    assert differ.max() < 1e-6


# Mean error over the penumbra. Measured: ssoc 0.0745 (u) and 0.0239 (triangle), under the
# rectangles themselves 0.0085 and 0.0085; convolution 0.0717 and 0.0222, and 0.0057 and 0.0056.
STANDS_IN_WRONG = {
    ("ssoc", "u"): (0.04, 0.1),
    ("ssoc", "triangle"): (0.015, 0.035),
    ("convolution", "u"): (0.04, 0.1),
    ("convolution", "triangle"): (0.015, 0.035),
}


@pytest.mark.parametrize(("method", "name"), STANDS_IN_WRONG)
def test_a_rectangle_is_wrong_for_an_outline_that_is_none(method, name):
    light, scene = light_of(PLANS[name]), over_ground(torus())
    low, high = STANDS_IN_WRONG[method, name]
    errors = []
    for one in (light, stand_in(light)):
        exact = ss.render(scene, CAMERA, one, ss.RayTraced(samples=1024)).visibility
        penumbra = (exact > 0) & (exact < 1)
        differ = np.abs(ss.render(scene, CAMERA, one, method).visibility - exact)
        errors.append(differ[penumbra].mean())
    assert low < errors[0] < high
    assert errors[1] < 0.012


# ---------------------------------------------------------------- closed forms and references


def test_wedges_of_a_half_plane_leave_what_is_beyond_a_line():
    """A board without end whose edge some pixels see pass through the light's centroid."""
    plan, size, height = np.array(PLANS["l"]), 0.5, 2.0
    light = light_of(plan, size, (0.02, 0.1, height))
    # Looking straight down: pixels' centres are at odd multiples of 1/32.
    camera = ss.Camera(
        (0, 0, 4), (0, 0, 0), fov_y_deg=math.degrees(2 * math.atan(0.25)), width=32, height=32
    )
    ground = quad((0, 0, 0), (4, 0, 0), (0, 4, 0))

    def covered(t):
        """Part of the L below a coordinate of its plan."""
        return np.clip(t, 0, 0.5) / 0.75 + np.clip(t - 0.5, 0, 0.5) / 1.5

    for shift in (0.0, light.center[0] - 9 / 32):
        scene = ss.Scene()
        scene.add(ground)
        # At half the light's height: its edge is midway between a receiver and where it is seen.
        scene.add(quad((5 + shift / 2, 0, height / 2), (10, 0, 0), (0, 60, 0)))
        image = ss.render(scene, camera, light, "wedges")
        on_ground = image.mesh_id == 0
        seen_at = shift - image.position[..., 0]
        expected = covered((seen_at - 0.02) / size + 0.5)
        differ = np.abs(image.visibility - expected)[on_ground]
        assert ((expected > 0) & (expected < 1) & on_ground).sum() > 100
        if shift:
            assert np.abs(seen_at - light.center[0])[on_ground].min() < 1e-12
        # Coordinates on the light in single precision: measured 1.1e-6. On the wrong side of the
        # centroid it would be a tenth.
        assert differ.max() < 3e-6, shift


def test_wedges_are_as_near_to_the_reference_as_under_a_rectangle():
    """One silhouette for all of the light is as wrong whatever the light's outline."""
    scene = over_ground(torus())
    errors = {}
    for name, light in {
        "rect": ss.RectLight((0.3, -0.2, 2.0), (0, 0.4, 0), (0.4, 0, 0)),
        "l": light_of(PLANS["l"], 0.4),
        "triangle": light_of(PLANS["triangle"], 0.4),
        "u": light_of(PLANS["u"], 0.4),
    }.items():
        exact = ss.render(scene, CAMERA, light, ss.RayTraced(samples=1024)).visibility
        seen = ss.render(scene, CAMERA, light, "wedges").visibility
        penumbra = (exact > 0) & (exact < 1)
        assert penumbra.sum() > 100
        errors[name] = float(np.abs(seen - exact)[penumbra].mean())
    # Measured: 0.0028 (rect), 0.0030 (l), 0.0025 (triangle), 0.0033 (u, which reaches farthest from
    # the centroid that sees the silhouette), of which sampling is 0.0015.
    assert max(errors.values()) < 1.3 * errors["rect"] < 0.004


@pytest.mark.skipif(not os.environ.get("CI") and not _has_mitsuba(), reason="the optional extra")
@pytest.mark.parametrize("name", ["l", "u"])
def test_radiance_agrees_with_mitsuba(name):
    scene = over_ground(torus())
    light = light_of(PLANS[name], 0.6)
    camera = ss.Camera((0.2, -2.2, 1.6), (0.0, 0.1, 0.0), fov_y_deg=40, width=48, height=36)
    image = ss.render(scene, camera, light, ss.RayTraced(samples=1024))
    theirs = ss.mitsuba.render(scene, camera, light, samples=512)
    full = ss.mitsuba.unshadowed(scene, camera, light)
    offset = ss.mitsuba.ray_offset(scene, image, light)
    mask = image.mask & ~offset.contact & (np.abs(image.normal - theirs.normal).max(axis=-1) < 1e-3)
    lifted = offset.lift(image.radiance, full)
    test = ss.mitsuba.z_test(lifted, theirs, mask=mask, unshadowed=full)
    assert mask.mean() > 0.9
    assert test.passed
    assert abs(test.mean_z) < 4


# ---------------------------------------------------------------- hard cases


def _ceiling():
    """A ground, and a ceiling that the light lies in."""
    return over_ground(quad((0, 0, 2), (3, 0, 0), (0, 3, 0)))


@pytest.mark.parametrize(
    "method", ["hard", "ray_traced", "counted", "wedges", "mtsm", "accumulation", "pcf"]
)
def test_a_light_set_into_a_ceiling_lights_the_ground(method):
    light = light_of(PLANS["u"], 0.6, (0.3, -0.2, 2.0))
    image = ss.render(_ceiling(), CAMERA, light, method)
    assert np.all(image.visibility[image.mesh_id == 0] == 1)


@pytest.mark.parametrize(
    "method", [ss.RayTraced(), ss.Counted(), ss.Mtsm(), "hard", "ssoc", "single_sample"]
)
def test_nothing_arrives_in_the_lights_plane_and_behind_it(method):
    light = light_of(PLANS["l"], 1.0, (0.5, 0.5, 1.0))
    # In the plane: outside, at a corner, at the reflex corner, on it; and behind it.
    points = [(2, 2, 1), (1, 0, 1), (0.5, 0.5, 1), (0.2, 0.2, 1), (0.2, 0.2, 1.5)]
    scene = over_ground(torus())
    for normals in (None, [(0, 0, -1)] * 5, [(1, 0, 0)] * 5):
        seen = ss.visibility(scene, points, normals, light, method)
        assert np.array_equal(seen, np.zeros(5, dtype=np.float32))
    assert not ss.kernels.unshadowed_irradiance(light, points, [(1, 0, 0)] * 5).any()


@pytest.mark.parametrize(
    "method", [ss.RayTraced(samples=64), ss.Wedges(), ss.Counted(), ss.Mtsm(samples=64)]
)
def test_bits_do_not_depend_on_threads_or_a_scale_of_two(method):
    def picture(scale=1.0):
        scene = ss.Scene()
        for vertices, faces in (
            quad((0, 0, 0), (6, 0, 0), (0, 6, 0)),
            quad((0.1, -0.1, 0.8), (0.5, 0.2, 0.1), (-0.1, 0.4, 0.05)),
        ):
            scene.add((vertices * scale, faces))
        light = ss.PolygonLight(np.array(light_of(PLANS["u"]).vertices) * scale)
        camera = ss.Camera(
            np.array((0.2, -2.2, 1.6)) * scale,
            np.array((0.0, 0.1, 0.0)) * scale,
            fov_y_deg=40,
            width=32,
            height=24,
        )
        return digest(ss.render(scene, camera, light, method).visibility)

    assert len(with_threads(picture, 1, 2)) == 1
    assert picture(2.0**20) == picture(2.0**-30) == picture()


@pytest.mark.parametrize("seed", range(6))
def test_what_is_not_traced_changes_no_bit(seed):
    """Edges are known in all of the square around a polygon, also beside the polygon."""
    rng = np.random.default_rng(seed)
    angle, reach = np.sort(rng.uniform(0, 2 * np.pi, 7)), rng.uniform(0.1, 0.7, 7)
    towards = np.append(rng.normal(size=2) * 0.4, -1)
    e = np.cross(towards, (1, 0.2, 0.1))
    e, f = (v / np.linalg.norm(v) for v in (e, np.cross(towards, e)))
    around = np.outer(reach * np.cos(angle), e) + np.outer(reach * np.sin(angle), f)
    light = ss.PolygonLight(rng.uniform((-0.4, -0.4, 1.2), (0.4, 0.4, 2)) + around)
    boards = [quad(p, *rng.normal(size=(2, 3)) * 0.2) for p in rng.uniform(0.2, 0.9, (5, 3)) - 0.2]
    scene = over_ground(*boards)
    one, all_of_it = (
        ss.render(scene, CAMERA, light, ss.RayTraced(samples=64, cull=cull))
        for cull in (True, False)
    )
    assert ((one.visibility > 0) & (one.visibility < 1)).any()
    assert np.array_equal(one.visibility, all_of_it.visibility)
    assert np.array_equal(one.radiance, all_of_it.radiance)


# ---------------------------------------------------------------- there and back


def test_the_command_takes_a_polygon():
    light = cli.parse_light("polygon:0,0,2;0,1,2;1,0,2")
    assert light == ss.PolygonLight([(0, 0, 2), (0, 1, 2), (1, 0, 2)])
    with pytest.raises(ValueError, match="expected 3 numbers as in polygon:"):
        cli.parse_light("polygon:0,0,2;0,1;1,0,2")
    with pytest.raises(ValueError, match="expected 3 to 1024, got 2"):
        cli.parse_light("polygon:0,0,2;0,1,2")


def test_a_polygon_is_copied_turned_and_resized_as_a_light():
    light = light_of(PLANS["l"], radiance=(1, 2, 3))
    assert pickle.loads(pickle.dumps(light)) == light
    assert hash(light) == hash(light_of(PLANS["l"], radiance=(1, 2, 3)))
    world = np.array([(2, 0, 0, 1), (0, 0, -2, 0), (0, 2, 0, 0), (0, 0, 0, 1.0)])
    moved = _placed(Setup(ss.Scene(), None, (light,)), world, 2.0).lights[0]
    assert np.allclose(moved.vertices, np.array(light.vertices) @ world[:3, :3].T + world[:3, 3])
    assert moved.radiance == light.radiance
    assert moved.center == pytest.approx(world[:3, :3] @ light.center + world[:3, 3])
