"""Single sample soft shadows against the paper's formulas, closed forms, and themselves."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from outer_objects import GROUND, LIGHTS, POINT, floor_points, grid, scene_of, solids
from shapes import bumpy, geodesic, quad

# ---------------------------------------------------------------- the paper's formulas


def _sphere_visibility(points, light, center, radius):
    """The paper's appendix, with the Bernstein interpolant."""
    ray = np.asarray(light.center) - points
    distance = np.linalg.norm(ray, axis=1)
    v = ray / distance[:, None]
    t0 = ((center - points) * v).sum(axis=1)
    d = np.linalg.norm(t0[:, None] * v - center + points, axis=1)
    tau = np.clip((d - radius) / (2 * light.radius * t0 / distance), 0, 1)
    tau[t0 <= 0] = 1
    return 3 * tau**2 - 2 * tau**3


def test_spheres_are_those_of_the_papers_appendix():
    light, center, radius = ss.SphereLight((0.3, -0.2, 3), 0.2), np.array([0, 0, 0.7]), 0.5
    scene = scene_of(GROUND)
    scene.add_spheres([center], [radius], name="ball")
    points, normals = floor_points()
    found = ss.visibility(scene, points, normals, light, ss.SingleSample("smooth"))
    expected = _sphere_visibility(points, light, center, radius)
    assert ((expected > 0.01) & (expected < 0.99)).mean() > 0.02
    # Rays start 5e-7 of the scene's half size above the ground, here 2e-6, a hundred-thousandth of
    # the penumbra.
    assert np.abs(found - expected).max() < 2e-5


@pytest.mark.parametrize(
    ("light", "width"),
    [
        (ss.DiskLight((0, 0, 3), (0, 0, -1), 0.4), lambda g: 0.8),
        (
            ss.RectLight((0, 0, 3), (0, 0.6, 0), (0.8, 0, 0)),
            lambda g: 0.8 * abs(g[0]) + 0.6 * abs(g[1]),
        ),
        (
            ss.RectLight((0, 0, 3), (0.1, 0.5, 0), (0.7, 0.2, 0)),
            lambda g: abs(0.7 * g[0] + 0.2 * g[1]) + abs(0.1 * g[0] + 0.5 * g[1]),
        ),
    ],
    ids=["disk", "rectangle", "parallelogram"],
)
@pytest.mark.parametrize("turn", [0, 25, 45, 90])
def test_a_straight_edge_has_the_lights_width_across_it(light, width, turn):
    angle = np.radians(turn)
    g = np.array([np.cos(angle), np.sin(angle), 0.0])
    along = np.array([-g[1], g[0], 0.0])
    # All of the plane z = 1 on one side of a line through (0, 0, 1).
    sheet = grid(np.array([0, 0, 1.0]) - 3 * g, 6 * g, 20 * along, 5)
    scene = scene_of(sheet, quad((0, 0, 0), (20, 0, 0), (0, 20, 0)))
    x = np.linspace(-1, 1, 401)
    points = x[:, None] * g
    normals = np.broadcast_to((0.0, 0.0, 1.0), points.shape)
    tau = ss.kernels.outer_distances(scene, points, normals, light)
    # From (x, 0), the line is projected to -2 x at the light's height.
    expected = np.clip(2 * x / width(g), 0, 1)
    assert np.abs(tau - expected).max() < 1e-5
    seen = ss.visibility(scene, points, normals, light, "single_sample")
    assert np.abs(seen - ss.kernels.attenuation(expected)).max() < 1e-5


def test_the_falloffs():
    tau = np.linspace(0, 1, 101)
    smooth, linear, light = (ss.kernels.attenuation(tau, f) for f in ("smooth", "linear", "light"))
    assert np.allclose(smooth, 3 * tau**2 - 2 * tau**3, atol=1e-15)
    assert np.array_equal(linear, tau)
    x = 2 * tau - 1
    area = 1 - (np.arccos(x) - x * np.sqrt(1 - x * x)) / np.pi
    assert np.allclose(light, area, atol=1e-14)
    assert ss.kernels.attenuation([[-1.0, 2.0]], "light").tolist() == [[0.0, 1.0]]


def test_a_triangles_sides_are_offset_by_the_reciprocal_cosine():
    """``b / cos`` in the triangle's plane, to first order in the light's size."""
    triangle = (
        np.array([(0.0, 0.0, 1.0), (1.0, 0.0, 1.6), (0.0, 1.0, 0.7)]),
        np.array([[0, 1, 2]]),
    )
    light = ss.SphereLight((0.2, 0.4, 40.0), 0.02)
    scene = scene_of(triangle, GROUND)
    corners = triangle[0]
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal /= np.linalg.norm(normal)
    for i in range(3):
        a, b = corners[i], corners[(i + 1) % 3]
        e = (b - a) / np.linalg.norm(b - a)
        out = np.cross(e, normal)
        # Points of the side, and points on the ground whose rays pass at a part of the offset.
        sides = a + np.linspace(0.3, 0.7, 9)[:, None] * (b - a)
        for part in (0.25, 0.5, 0.9):
            at = sides
            # The offset at a height z: the ray's distance from the ground there and the light's.
            for _ in range(3):
                v = np.asarray(light.center) - at
                whole = np.linalg.norm(v, axis=1) * 40.0 / v[:, 2]
                v /= np.linalg.norm(v, axis=1)[:, None]
                behind = at[:, 2] / v[:, 2]
                cross = np.linalg.norm(np.cross(v, e), axis=1)
                offset = 0.04 * behind / whole * cross / np.abs(v @ normal)
                at = sides + part * offset[:, None] * out
            points = at - v * behind[:, None]
            points[:, 2] = 0
            up = np.broadcast_to((0.0, 0.0, 1.0), points.shape)
            tau = ss.kernels.outer_distances(scene, points, up, light)
            # The offset is a thousandth of the triangle; rays start 2e-6 above the ground, and
            # coordinates of 20 are off by 1e-6.
            assert np.abs(tau - part).max() < 0.01


# ---------------------------------------------------------------- meshes are their outlines


@pytest.mark.parametrize("kind", LIGHTS)
def test_finer_triangles_change_nothing(kind):
    points, normals = floor_points()
    found = []
    for n in (1, 7, 40):
        sheet = grid((0, 0, 1), (0.7, 0.1, 0.2), (0, 0.9, -0.1), n)
        scene = scene_of(sheet, grid((0, 0, 0), (8, 0, 0), (0, 8, 0), n))
        found.append(ss.visibility(scene, points, normals, LIGHTS[kind], "single_sample"))
        for overlap in ("multiply", "add"):
            method = ss.SingleSample(overlap=overlap)
            other = ss.visibility(scene, points, normals, LIGHTS[kind], method)
            # One object: the same, but for the narrowing of cones that the minimum allows.
            assert np.abs(other - found[-1]).max() < 1e-5
    partly = (found[0] > 0.01) & (found[0] < 0.99)
    assert partly.sum() > 2000
    # Corners of the grid are off the sheet by an ulp of 4, a hundred-thousandth of the light.
    for other in found[1:]:
        assert np.abs(other - found[0]).max() < 1e-5


@pytest.mark.parametrize("kind", LIGHTS)
def test_visibility_is_continuous_in_space(kind):
    """No step anywhere, and half of the largest difference at half of the distance."""
    body, faces = bumpy(10, seed=3)
    sheet = grid((0.4, 0, 1.3), (0.7, 0.1, 0.2), (0, 0.9, -0.1), 12)
    scene = scene_of((body * 0.3 + [-0.4, 0, 0.6], faces), sheet, GROUND)
    line = np.linspace(-1.7, 1.7, 8001)[:, None] * np.array([1.0, 0.13, 0]) + [0, -0.05, 0]
    normals = np.broadcast_to((0.0, 0.0, 1.0), line.shape)
    seen = ss.visibility(scene, line, normals, LIGHTS[kind], "single_sample")
    one, two, four = (np.abs(np.diff(seen[::k])).max() for k in (1, 2, 4))
    assert seen.min() == 0
    assert seen.max() == 1
    # Slopes are bounded: largest steps of 0.002 to 0.006 a step of 0.0004.
    assert one < 0.01
    assert 1.6 < two / one < 2.1
    assert 1.6 < four / two < 2.1


def test_visibility_is_continuous_in_time():
    """An animated light over bodies in their own shadow: no popping, at terminators too."""
    body, faces = bumpy(10, seed=3)
    scene = scene_of(GROUND, (body * 0.4 + [0, 0, 0.7], faces))
    scene.add_spheres([(1, 0.5, 0.5), (-1, 0.3, 0.3)], [0.3, 0.3], name="balls")
    camera = ss.Camera((0.4, -3.2, 2.0), (0, 0.1, 0.3), width=128, height=128)

    def step(steps):
        angles = 0.35 + 0.3 / steps * np.arange(9)
        frames = [
            ss.render(scene, camera, light, "single_sample").visibility
            for light in (
                ss.SphereLight((2.2 * np.cos(a), 0.4, 2.2 * np.sin(a)), 0.3) for a in angles
            )
        ]
        return np.abs(np.diff(frames, axis=0)).max()

    coarse, fine, finest = step(10), step(20), step(40)
    # Measured 0.22, 0.12 and 0.06: the light's 0.066 a step is a tenth of its diameter.
    assert coarse < 0.3
    assert fine < 0.7 * coarse
    assert finest < 0.7 * fine


def test_a_penumbra_begins_at_the_contact_and_widens_linearly():
    """A wall's vertical edge: its shadow's edge runs along -x from its foot."""
    wall = quad((0, 1, 0.5), (0, 2, 0), (0, 0, 1))
    scene = scene_of(wall, GROUND)
    light = ss.SphereLight((40.0, 0, 20.0), 2.0)
    widths = {}
    for r in (0.02, 0.1, 0.2, 0.4, 0.8):
        y = np.linspace(-0.2 * r, 0.02 * r, 4001)
        points = np.stack([np.full_like(y, -r), y, np.zeros_like(y)], axis=1)
        up = np.broadcast_to((0.0, 0.0, 1.0), points.shape)
        tau = ss.kernels.outer_distances(scene, points, up, light)
        assert tau[-1] == 0
        assert tau[0] == 1
        widths[r] = (y[1] - y[0]) * ((tau > 0) & (tau < 1)).sum()
    # b = a D / A with the edge at r cos(elevation) along the ray, to the step of the points; across
    # the ray the ray's nearest point on the edge is above the foot by as much as it is along.
    expected = 4.0 / np.hypot(40.0, 20.0) * np.hypot(1, 0.5)
    for r, width in widths.items():
        assert width / r == pytest.approx(expected, rel=0.04)
    # At the foot itself nothing is left of it.
    at = np.array([[-1e-4, -0.001, 0], [-1e-4, 0.001, 0]])
    found = ss.visibility(scene, at, [(0, 0, 1)] * 2, light, "single_sample")
    assert found.tolist() == [1, 0]


# ---------------------------------------------------------------- never darker than it may be


def test_it_is_dark_where_the_centre_is_hidden_and_nowhere_else():
    setup = solids()
    image = ss.render(setup.scene, setup.camera, setup.light, "hard")
    points, normals = image.position[image.mask], image.normal[image.mask]
    # Off the surface, without a tangent plane.
    points = points + 0.01 * normals
    hard = ss.visibility(setup.scene, points, None, setup.light, "hard")
    found = ss.visibility(setup.scene, points, None, setup.light, "single_sample")
    assert 0.05 < (hard == 0).mean() < 0.95
    assert np.array_equal(found == 0, hard == 0)
    assert (found <= hard).all()


@pytest.mark.parametrize("kind", LIGHTS)
def test_a_convex_body_does_not_shade_itself(kind):
    """Visibility is `h` everywhere: no neighbour counts, and nothing jumps at the terminator."""
    vertices, faces = geodesic(24)
    vertices = (
        vertices * [0.5, 0.8, 0.6] @ np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    )
    scene = scene_of((vertices, faces))
    scene.add_spheres([(1.4, 0.3, 0)], [0.4], name="ball", casts=True)
    camera = ss.Camera((1.0, -3.0, 2.0), (0.4, 0, 0), width=160, height=160)
    light = LIGHTS[kind]
    image = ss.render(scene, camera, light, "single_sample")
    at = image.mask
    h = ss.kernels.light_fraction_above(light, image.position[at], image.normal[at])
    assert ((h > 0.01) & (h < 0.99)).sum() > 200
    ball = image.mesh_id[at] == 1
    for body in (ball, ~ball):
        # Where the other body is not in the way. Image normals are single precision.
        free = body & (np.abs(image.visibility[at] - h) < 1e-5)
        assert free.sum() > 0.97 * body.sum()
    alone = scene_of((vertices, faces))
    image = ss.render(alone, camera, light, "single_sample")
    at = image.mask
    h = ss.kernels.light_fraction_above(light, image.position[at], image.normal[at])
    assert np.abs(image.visibility[at] - h).max() < 1e-5


@pytest.mark.parametrize("kind", LIGHTS)
def test_a_tilted_floor_of_many_triangles_does_not_shade_itself(kind):
    """Also under a light that all but sets: the corners are off the plane by rounding."""
    floor = grid((0.1, 0.2, 0.3), (1.7, 0.3, 0.4), (-0.35, 1.9, 0.2), 120)
    scene = scene_of(floor)
    u, v = floor[0][-1] - floor[0][120], floor[0][120] - floor[0][0]
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    camera = ss.Camera(
        np.array([0.1, 0.2, 0.3]) + 3 * normal, (0.1, 0.2, 0.3), up=u, width=128, height=128
    )
    for height in (2.0, 0.3, 0.05, 0.0, -0.1):
        center = np.array([0.1, 0.2, 0.3]) + 2.5 * u / np.linalg.norm(u) + height * normal
        light = ss.scenes.light_towards(kind, center, 0.3, (0.1, 0.2, 0.3))
        image = ss.render(scene, camera, light, "single_sample")
        at = image.mask
        h = ss.kernels.light_fraction_above(light, image.position[at], image.normal[at])
        # The facets' normals are off by 1e-5; what then rises above a facet's plane may count by
        # the square of its part of the strip.
        assert np.abs(image.visibility[at] - h).max() < 1e-3


# ---------------------------------------------------------------- Figure 5


def _darkness(scene, light, method, n=81, half=0.8):
    points, normals = floor_points(n, half)
    seen = ss.visibility(scene, points, normals, light, method)
    return float((1 - seen.astype(np.float64)).mean())


def test_small_objects_are_too_dark_and_tessellation_alone_is_not():
    """Figure 5: what is small against the light casts an umbra that it should not have."""
    light = ss.SphereLight((0, 0, 3), 0.5)
    vertices, faces = geodesic(12)
    excess = []
    for radius in (0.02, 0.05, 0.2):
        round_, fine = scene_of(GROUND), scene_of(GROUND)
        round_.add_spheres([(0, 0, 0.8)], [radius], name="ball")
        fine.add((vertices * radius + [0, 0, 0.8], faces), "ball")
        true = _darkness(round_, light, ss.RayTraced(64))
        one, twin = (_darkness(s, light, "single_sample") for s in (round_, fine))
        # 2,880 triangles are the sphere that they stand for, but that the paper's appendix measures
        # at its middle and they at their outline (measured: at most 2.4 %).
        assert twin == pytest.approx(one, rel=0.03)
        excess.append(one / true)
        # Counted one by one, triangles add up: the twin is darker the finer it is.
        each = ss.SingleSample(overlap="add", parts="triangles")
        assert _darkness(fine, light, each) > 1.15 * twin
    # The shadow is (R + b/2)² in place of R², with b = 0.27 here.
    assert excess[0] > 20
    assert excess[0] > excess[1] > excess[2]
    assert excess[2] < 4


def test_thin_legs_are_too_dark():
    light = ss.SphereLight((0.4, 0, 3), 0.4)
    leg = grid((0, 0, 0.5), (0.02, 0, 0), (0, 0, 1.0), 8)
    scene = scene_of(GROUND, leg)
    points, normals = floor_points(161, 0.8)
    true = ss.visibility(scene, points, normals, light, ss.RayTraced(64))
    found = ss.visibility(scene, points, normals, light, "single_sample")
    # Near the contact both are right; away from it the true shadow is all penumbra.
    assert (1 - found).sum() > 2 * (1 - true).sum()


# ---------------------------------------------------------------- objects


def test_objects_combine_three_ways():
    light = ss.SphereLight((0, 0, 3), 0.3)
    left = quad((-0.6, 0, 1), (1, 0, 0), (0, 4, 0))
    right = quad((0.6, 0, 1.2), (1, 0, 0), (0, 4, 0))
    points, normals = floor_points(81, 0.5)

    def seen(scene, **parameters):
        return ss.visibility(scene, points, normals, light, ss.SingleSample(**parameters))

    alone = [seen(scene_of(s, GROUND)).astype(np.float64) for s in (left, right)]
    both = scene_of(left, right, GROUND)
    joined = scene_of(
        (np.concatenate([left[0], right[0]]), np.concatenate([left[1], right[1] + 4])), GROUND
    )
    a, b = alone
    assert ((a < 0.9) & (b < 0.9)).sum() > 500
    for scene in (both, joined):
        assert np.abs(seen(scene) - np.minimum(a, b)).max() < 1e-5
        assert np.abs(seen(scene, overlap="multiply") - a * b).max() < 1e-5
        assert np.abs(seen(scene, overlap="add") - np.maximum(0, a + b - 1)).max() < 1e-5


def test_transparent_occluders_are_an_error_unless_they_count_as_opaque():
    sheet = quad((0, 0, 1), (1, 0, 0), (0, 1, 0))
    points, normals = floor_points(41)
    clear, solid = scene_of(GROUND), scene_of(GROUND)
    clear.add(sheet, "sheet", opacity=0.5)
    clear.add_spheres([(1, 1, 1)], [0.2], name="ball", opacity=0.25)
    solid.add(sheet, "sheet")
    solid.add_spheres([(1, 1, 1)], [0.2], name="ball")
    with pytest.raises(ValueError, match=r"single_sample.*opacity of 0\.5"):
        ss.visibility(clear, points, normals, POINT, "single_sample")
    for light in (LIGHTS["sphere"], POINT):
        for overlap in ("minimum", "add"):
            plain = ss.visibility(solid, points, normals, light, ss.SingleSample(overlap=overlap))
            method = ss.SingleSample(overlap=overlap, opacity="opaque")
            assert np.array_equal(plain, ss.visibility(clear, points, normals, light, method))
    ball = scene_of(GROUND)
    ball.add_spheres([(1, 1, 1)], [0.2], name="ball", opacity=0.25)
    with pytest.raises(ValueError, match=r"opacity of 0\.25"):
        ss.visibility(ball, points, normals, POINT, "single_sample")
