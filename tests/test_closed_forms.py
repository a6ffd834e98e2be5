"""Visibility where the answer is known: half-planes, all or nothing, tangent planes."""

from __future__ import annotations

import math

import numpy as np
import pytest
import softshadow as ss
from closed_forms import (
    ABOVE,
    BOX,
    FLOOR,
    MANY,
    METHODS,
    STRIP,
    N,
    cap_integral,
    lit_floor,
    unit,
)
from scipy.integrate import quad as integrate
from shapes import QUAD, bumpy, quad

# ---------------------------------------------------------------- half-planes

HEIGHT, BLOCKER = 1.0, 0.4


def _scanline(light, method, blocker=BLOCKER):
    """Visibility along x under a blocker that fills x <= 0, from user points without normals."""
    scene = ss.Scene()
    scene.add(quad((-20, 0, blocker), (40, 0, 0), (0, 40, 0)))
    x = np.linspace(-0.6, 0.6, 401)
    points = np.column_stack([x, np.full(401, 0.123), np.zeros(401)])
    normals = np.tile([0, 0, 1.0], (401, 1))
    return points, ss.visibility(scene, points, normals, light, method)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("pattern", ["per_receiver", "fixed"])
def test_a_half_plane_under_a_rectangular_light(pattern, turned):
    a = 0.5
    angle = 0.4 if turned else 0.0
    u = a * np.array([-math.sin(angle), math.cos(angle), 0])
    v = a * np.array([math.cos(angle), math.sin(angle), 0])
    light = ss.RectLight((0, 0, HEIGHT), u, v)
    method = ss.RayTraced(samples=N, pattern=pattern)
    points, seen = _scanline(light, method)
    # From x, the blocker's edge is in front of the light's line at x (1 - HEIGHT / BLOCKER): what
    # lies beyond it is seen.
    line = points[:, 0] * (1 - HEIGHT / BLOCKER)
    if not turned:
        expected = np.clip(0.5 - line / a, 0, 1)
        tolerance = STRIP
    else:
        # The share of a turned square beyond a line: the integral of its trapezoidal width.
        c, s = abs(math.cos(angle)) * a / 2, abs(math.sin(angle)) * a / 2

        def width(t):
            return min(1.0, max(0.0, (c + s - abs(t)) / (2 * s))) / (2 * c)

        whole = integrate(width, -c - s, c + s, points=[s - c, c - s])[0]
        assert whole == pytest.approx(1, abs=1e-9)
        expected = np.array(
            [
                integrate(width, min(max(t, -c - s), c + s), c + s, points=[s - c, c - s])[0]
                for t in line
            ]
        )
        # At most 2 sqrt(N) cells are cut, each right but for a variance of at most a quarter.
        tolerance = 5 * math.sqrt(2 * math.sqrt(N) / 4) / N
    assert ((expected > 0.01) & (expected < 0.99)).sum() > 50
    assert np.abs(seen - expected).max() < tolerance
    assert (seen[expected == 1] == 1).all()
    assert (seen[expected == 0] == 0).all()


def test_a_half_plane_under_a_spherical_light():
    light = ss.SphereLight((0, 0, HEIGHT), 0.3)
    points, seen = _scanline(light, MANY)
    expected = []
    for p in points:
        d = np.array(light.center) - p
        distance = np.linalg.norm(d)
        # The plane through the receiver and the blocker's edge cuts the cap; x > 0 is open.
        normal = unit(np.cross([0.0, 1.0, 0.0], [-p[0], 0, BLOCKER - p[2]]))
        sine = light.radius / distance
        _, angle = cap_integral(d / distance, sine, normal)
        expected.append(angle / (2 * math.pi * (1 - math.sqrt(1 - sine**2))))
    expected = np.array(expected)
    assert ((expected > 0.01) & (expected < 0.99)).sum() > 50
    error = seen - expected
    # The map from the square to the cap bends the line into at most four monotone pieces, which
    # cut at most 4 sqrt(N) cells: a standard deviation of N**-0.75.
    assert np.abs(error).max() < 5 * N**-0.75
    assert np.sqrt((error**2).mean()) < N**-0.75
    assert (seen[expected == 1] == 1).all()
    assert (seen[expected == 0] == 0).all()


@pytest.mark.parametrize("kind", ["rect", "sphere"])
def test_the_packaged_half_plane_has_the_same_closed_form(kind):
    setup = ss.scenes.half_plane(96, 96, kind)
    image = ss.render(setup.scene, setup.camera, setup.light, MANY)
    below = image.mask & (image.mesh_id == 0)
    expected = setup.visibility(image.position[below])
    assert ((expected > 0.05) & (expected < 0.95)).mean() > 0.2
    tolerance = STRIP if kind == "rect" else 5 * N**-0.75
    assert np.abs(image.visibility[below] - expected).max() < tolerance


def test_a_hard_shadow_of_a_half_plane_is_a_step():
    points, seen = _scanline(ss.SphereLight((0.1, 0, HEIGHT), 0.2), "hard")
    # The ray to the centre meets the blocker's edge for x = -0.1 BLOCKER / (1 - BLOCKER).
    step = -0.1 * BLOCKER / (HEIGHT - BLOCKER)
    clear = np.abs(points[:, 0] - step) > 1e-5
    assert np.array_equal(seen[clear], (points[clear, 0] > step).astype(np.float32))


# ---------------------------------------------------------------- all or nothing


def _covered(light, method, *meshes, **options):
    """Visibility on a patch of floor under meshes that hide the light from all of it."""
    scene = ss.Scene()
    scene.add(FLOOR, "floor")
    for mesh in meshes:
        scene.add(mesh, **options)
    camera = ss.Camera((0, -0.8, 0.3), (0, 0, 0), fov_y_deg=20, width=40, height=30)
    image = ss.render(scene, camera, light, method)
    assert (image.mesh_id == 0).all()
    return image


def _sheet(z, tilt):
    return quad((0, 0, z), (3, 0, 3 * tilt), (0, 3, 2 * tilt))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("light", ABOVE)
def test_full_occlusion_is_exactly_zero(light, method):
    image = _covered(ABOVE[light], METHODS[method], _sheet(1.0, 0.1))
    assert (image.visibility == 0).all()
    assert (image.radiance == 0).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("light", ABOVE)
def test_transparent_layers_multiply_exactly(light, method):
    light, method = ABOVE[light], METHODS[method]
    sheet, other = _sheet(0.9, 0.13), _sheet(1.1, -0.07)
    doubled = (sheet[0], np.concatenate([QUAD, QUAD]))
    body = bumpy(8)
    body = (body[0] * [1, 1, 0.3] + [0, 0, 1.1], body[1])
    for meshes, opacity, expected in [
        ([sheet], 0.5, 0.5),
        ([sheet, other], 0.5, 0.25),
        ([doubled], 0.5, 0.25),
        ([body], 0.5, 0.25),
        ([sheet, other, body], 0.5, 0.0625),
        ([sheet], 0.75, 0.25),
        ([sheet], 0.0, 1.0),
    ]:
        seen = _covered(light, method, *meshes, opacity=opacity).visibility
        assert (seen == expected).all(), (len(meshes), opacity, np.unique(seen))


def test_a_transparent_sphere_counts_on_entering_and_on_leaving():
    for method in METHODS.values():
        scene = ss.Scene()
        scene.add(FLOOR)
        scene.add_spheres((0, 0, 1.0), 0.6, opacity=0.5)
        points = [(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
        seen = ss.visibility(scene, points, None, ABOVE["rect"], method)
        assert seen.tolist() == [0.25, 0.5]


@pytest.mark.parametrize("light", ABOVE)
def test_the_packaged_tilted_sheets_have_their_closed_form(light):
    for sheets in (1, 2, 3):
        setup = ss.scenes.tilted_sheet(48, 48, light, opacity=0.5, sheets=sheets)
        image = ss.render(setup.scene, setup.camera, setup.light, METHODS["ray_traced"])
        p = image.position
        inside = (image.mesh_id == 0) & (np.abs(p[..., :2]).max(axis=-1) <= 0.5)
        assert inside.sum() > 500
        assert np.array_equal(image.visibility[inside], setup.visibility(p[inside]))


def test_a_light_with_no_occluder_between_is_seen_whole():
    for light in ABOVE.values():
        for method in METHODS.values():
            image = _covered(light, method, _sheet(2.6, 0.05))
            assert (image.visibility == 1).all()


def test_inside_a_sphere_light_and_behind_a_flat_one_nothing_is_seen():
    scene = ss.Scene()
    scene.add(FLOOR)
    cases = {
        "sphere": [(0, 0, 2.0), (0.1, 0.1, 2.1), (0, 0, 1.71)],
        "disk": [(0, 0, 2.1), (1.0, 0, 2.001), (0, 0, 9.0)],
        "rect": [(0, 0, 2.1), (1.0, 0, 2.001), (0, 0, 9.0)],
    }
    for kind, points in cases.items():
        for normals in (None, [(0.0, 0.0, 1.0)] * 3, [(0.3, 0.0, -1.0)] * 3):
            for method in METHODS.values():
                seen = ss.visibility(scene, points, normals, ABOVE[kind], method)
                assert (seen == 0).all()
        assert (ss.kernels.light_fraction_above(ABOVE[kind], points) == 0).all()
    floor = ss.SphereLight((0, 0, 0.1), 4.0)  # the whole floor is inside
    for method in METHODS.values():
        image = lit_floor(floor, method)
        assert (image.visibility[image.mask] == 0).all()
        assert (image.radiance == 0).all()


# ---------------------------------------------------------------- the tangent plane

# Rectangle: x above offset; the others by elementary geometry.
CUTS = [-0.7, -0.35, -0.1, 0.0, 0.05, 0.3, 0.45]


def _cut(kind, share):
    """A light whose part above the tangent plane ``x > 0`` of a receiver at the origin is known."""
    x = share  # centre of a light of half-width 0.5
    if kind == "rect":
        light = ss.RectLight((x, 0.1, 2), (0, 1, 0), (1, 0, 0))
        return light, min(1.0, max(0.0, 0.5 + x))
    if kind == "disk":
        light = ss.DiskLight((x, 0.1, 2), (0, 0, -1), 0.5)
        t = max(-1.0, min(1.0, x / 0.5))
        return light, 1 - (math.acos(t) - t * math.sqrt(1 - t * t)) / math.pi
    light = ss.SphereLight((x, 0.1, 2), 0.5)
    d = np.array(light.center)
    sine = 0.5 / np.linalg.norm(d)
    _, angle = cap_integral(unit(d), sine, np.array([1.0, 0, 0]))
    return light, angle / (2 * math.pi * (1 - math.sqrt(1 - sine**2)))


def _small_scene(*extra):
    """Far from the rays, so that nothing but `extra` is hit."""
    scene = ss.Scene()
    scene.add(quad((0, 0, -2), (1, 0, 0), (0, 1, 0)))
    for mesh in extra:
        scene.add(mesh)
    return scene


@pytest.mark.parametrize("kind", ABOVE)
@pytest.mark.parametrize("share", CUTS)
def test_a_light_cut_by_the_tangent_plane_is_seen_above_it(kind, share):
    light, expected = _cut(kind, share)
    p, n = [(0.0, 0.0, 0.0)], [(2.0, 0.0, 0.0)]
    assert ss.kernels.light_fraction_above(light, p, n)[0] == pytest.approx(expected, abs=1e-9)
    scene = _small_scene()
    hard = ss.visibility(scene, p, n, light, "hard")[0]
    assert hard == pytest.approx(expected, abs=1e-7)
    traced = ss.visibility(scene, p, n, light, MANY)[0]
    assert abs(traced - expected) < (STRIP if kind == "rect" else 5 * N**-0.75)
    # Without a normal there is no tangent plane.
    assert ss.visibility(scene, p, None, light, "hard")[0] == 1
    assert ss.visibility(scene, p, None, light, MANY)[0] == 1


@pytest.mark.parametrize("share", CUTS)
def test_an_occluder_takes_its_share_of_what_the_tangent_plane_leaves(share):
    light, h = _cut("rect", share)
    # Hides y > 0.05 of the light (from the origin, at half its height).
    half = quad((0, 5.025, 1), (20, 0, 0), (0, 10, 0))
    p, n = [(0.0, 0.0, 0.0)], [(1.0, 0.0, 0.0)]
    left = 0.5 - (0.1 - 0.05)  # y from -0.4 to 0.05 of a light from -0.4 to 0.6
    traced = ss.visibility(_small_scene(half), p, n, light, MANY)[0]
    assert abs(traced - h * left) < BOX
    # The ray to the centre (y = 0.1) is blocked; moved on, the same blocker is passed by.
    assert ss.visibility(_small_scene(half), p, n, light, "hard")[0] == 0
    beside = (half[0] + [0, 0.2, 0], half[1])
    hard = ss.visibility(_small_scene(beside), p, n, light, "hard")[0]
    assert hard == np.float32(ss.kernels.light_fraction_above(light, p, n)[0])


def test_ray_traced_counts_the_fixed_samples_that_are_neither_below_nor_blocked():
    light = ss.RectLight((0.1, 0.1, 2), (0.1, 1, 0.2), (1, 0.2, 0.1))
    half = quad((0, 5.025, 1), (20, 0, 0), (0, 10, 0))
    n = unit((1.0, 0.3, 0.1))
    for seed in range(5):
        points, _, _ = ss.kernels.light_samples(light, (0, 0, 0), 512, seed)
        above = points @ n > 0
        open_ = points[:, 1] / points[:, 2] < 0.025
        method = ss.RayTraced(samples=512, seed=seed, pattern="fixed")
        seen = ss.visibility(_small_scene(half), [(0.0, 0.0, 0.0)], [n], light, method)[0]
        assert seen == np.count_nonzero(above & open_) / 512
        assert 0.1 < seen < 0.9


def test_hard_is_at_most_the_fraction_above_the_tangent_plane():
    scene = _small_scene()
    for kind in ABOVE:
        light, h = _cut(kind, 0.05)
        p = [(0.0, 0.0, 0.0)]
        tilted = ss.visibility(scene, p, [(1.0, 0.0, 0.0)], light, "hard")[0]
        assert 0.5 < h < 1
        assert tilted == np.float32(ss.kernels.light_fraction_above(light, p, [(1.0, 0, 0)])[0])
        sheet = quad((0, 0, 1), (3, 0, 0), (0, 3, 0))
        veiled = _small_scene()
        veiled.add(sheet, opacity=0.75)
        assert ss.visibility(veiled, p, [(1.0, 0, 0)], light, "hard")[0] == 0.25
