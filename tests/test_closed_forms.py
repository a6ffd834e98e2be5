"""Irradiance and visibility where the answer is known.

`ray_traced` is held to what its sampler guarantees. With ``N = 2**m`` samples on a flat light the
samples are a (0, m, 2)-net: every elementary interval of area ``1 / N`` of the light's square holds
exactly one. So the share of samples on one side of a line parallel to an edge of the light is
right to ``1 / N``, that in a corner's rectangle to ``(m / 2 + 3 / 2) / N`` (Niederreiter 1992,
Theorem 4.14), and along any other curve only those of ``sqrt(N)`` by ``sqrt(N)`` cells that it cuts
are uncertain.
"""

from __future__ import annotations

import hashlib
import itertools
import math
import os
import subprocess
import sys

import numpy as np
import pytest
import softshadow as ss
from scipy.integrate import quad as integrate
from shapes import QUAD, bumpy, geodesic, quad

N = 4096
MANY = ss.RayTraced(samples=N)
# One sample, and the light points' and origins' four ulps, which move a shadow's edge far less.
STRIP = 1 / N + 1e-5
BOX = (math.log2(N) / 2 + 1.5) / N + 1e-5


def _unit(v):
    v = np.asarray(v, dtype=np.float64)
    return v / np.linalg.norm(v)


def _frame(n):
    """Two unit vectors that complete `n`."""
    a = _unit(np.cross(n, np.eye(3)[np.argmin(np.abs(n))]))
    return a, np.cross(n, a)


# ---------------------------------------------------------------- independent integrals


def _rect_integral(light, p, n, weight):
    """Integral of `weight` over the part of a rectangle above the tangent plane, by quadrature.

    The inner integral runs along v between the edges and the tangent plane; the outer one is broken
    where the plane's line leaves through an edge, so that every piece is smooth.
    """
    c, u, v = (np.array(x) for x in (light.center, light.edge_u, light.edge_v))
    x, w = np.polynomial.legendre.leggauss(24)

    def height(s, t):
        return n @ (c + s * u + t * v - p)

    slope, g = n @ v, n @ u

    def inner(s):
        low, high = -0.5, 0.5
        h0 = height(s, 0.0)
        if slope == 0:
            return 0.0 if h0 <= 0 else float(np.sum(w / 2 * _at(s, x / 2)))
        cut = -h0 / slope
        low, high = (max(low, cut), high) if slope > 0 else (low, min(high, cut))
        if high <= low:
            return 0.0
        return float(np.sum(w * (high - low) / 2 * _at(s, (high + low + x * (high - low)) / 2)))

    def _at(s, t):
        return weight(c + s * u + np.multiply.outer(t, v))

    breaks = [-0.5, 0.5]
    if g != 0:
        breaks += [b for t in (-0.5, 0.5) if abs(b := -height(0.0, t) / g) < 0.5]
    breaks = np.sort(breaks)
    parts = itertools.pairwise(breaks)
    return sum(integrate(inner, a, b, epsabs=1e-12, epsrel=1e-10)[0] for a, b in parts)


def _disk_integral(light, p, n, weight):
    """The same for a disk: chords parallel to the tangent plane's line, from rim to rim."""
    c, m = np.array(light.center), _unit(light.normal)
    across = n - (n @ m) * m
    slope = np.linalg.norm(across)
    e1 = across / slope if slope > 1e-12 else _frame(m)[0]
    e2 = np.cross(m, e1)
    x, w = np.polynomial.legendre.leggauss(40)
    r = light.radius

    def chord(angle):
        half = r * math.cos(angle)
        q = c + r * math.sin(angle) * e1 + np.multiply.outer(x * half, e2)
        return float(np.sum(w * half * weight(q))) * r * math.cos(angle)

    height = n @ (c - p)
    if abs(height) >= slope * r:
        start = -math.pi / 2 if height > 0 else math.pi / 2
    else:
        start = -math.asin(height / (slope * r))
    return integrate(chord, start, math.pi / 2, epsabs=1e-13, epsrel=1e-10)[0]


def _cap_integral(direction, sine, n):
    """Irradiance and solid angle of a cap of directions above the tangent plane (radiance 1).

    Around the cap's axis a circle of directions at angle θ is above the plane for |φ| < φ₀.
    """
    cos_n = float(n @ direction)
    sin_n = math.sqrt(max(0.0, 1 - cos_n**2))

    def arc(theta):
        a, b = cos_n * math.cos(theta), sin_n * math.sin(theta)
        return math.acos(min(1.0, max(-1.0, -a / b))) if b > 0 else (math.pi if a > 0 else 0.0)

    def light(theta):
        phi = arc(theta)
        a, b = cos_n * math.cos(theta), sin_n * math.sin(theta)
        return 2 * (a * phi + b * math.sin(phi)) * math.sin(theta)

    alpha = math.asin(sine)
    tangent = abs(math.pi / 2 - math.acos(max(-1.0, min(1.0, cos_n))))
    kinks = sorted({0.0, min(tangent, alpha), alpha})
    parts = list(itertools.pairwise(kinks))
    options = {"epsabs": 1e-13, "epsrel": 1e-10, "limit": 200}
    total = sum(integrate(light, a, b, **options)[0] for a, b in parts)
    angle = sum(integrate(lambda t: 2 * arc(t) * math.sin(t), a, b, **options)[0] for a, b in parts)
    return total, angle


def irradiance_and_fraction(light, p, n):
    """Irradiance of radiance 1 and the fraction above the tangent plane, by quadrature."""
    if isinstance(light, ss.SphereLight):
        d = np.array(light.center) - p
        distance = np.linalg.norm(d)
        sine = light.radius / distance
        total, angle = _cap_integral(d / distance, sine, n)
        return total, angle / (2 * math.pi * (1 - math.sqrt(1 - sine**2)))
    if isinstance(light, ss.RectLight):
        m = np.cross(light.edge_u, light.edge_v)
        area, integral = np.linalg.norm(m), _rect_integral
        m, scale = m / area, area
    else:
        m, area, integral, scale = _unit(light.normal), math.pi * light.radius**2, _disk_integral, 1

    def weight(q):
        r = q - p
        return (r @ n) * -(r @ m) / np.sum(r * r, axis=-1) ** 2

    total = integral(light, p, n, weight) * scale
    return total, integral(light, p, n, lambda q: np.ones(q.shape[:-1])) * scale / area


# ---------------------------------------------------------------- unoccluded irradiance

FLOOR = quad((0, 0, 0), (2, 0, 0), (0, 2, 0))[0], QUAD
LOOK = ss.Camera((0.2, -2.5, 2.0), (0, 0, 0), width=9, height=7)

OVERHEAD = {
    "rect": ss.RectLight((0.3, 0.2, 1.2), (0.2, 0.9, 0.1), (0.8, -0.1, 0.3), (1, 2, 0.5)),
    "disk": ss.DiskLight((-0.4, 0.1, 0.9), (0.3, 0.1, -1), 0.5, (1, 2, 0.5)),
    "disk, level": ss.DiskLight((0.1, 0.1, 1.1), (0, 0, -3), 0.7, (1, 2, 0.5)),
    "sphere": ss.SphereLight((0.3, -0.2, 1.0), 0.6, (1, 2, 0.5)),
    "small sphere": ss.SphereLight((0.3, -0.2, 1.5), 1e-3, (1, 2, 0.5)),
}
# Their lower part is below the floor's plane, beside the floor.
SUNKEN = {
    "rect": ss.RectLight((0.4, 1.6, 0.15), (1.2, 0.1, 0.2), (0.1, -0.2, 0.9), (1, 2, 0.5)),
    "disk": ss.DiskLight((-1.6, 0.3, 0.1), (1, 0.1, -0.2), 0.45, (1, 2, 0.5)),
    "sphere": ss.SphereLight((0.5, 1.9, 0.2), 0.5, (1, 2, 0.5)),
}
ALBEDO = np.array([0.9, 0.5, 0.25])


def _lit_floor(light, method, casts=True):
    scene = ss.Scene()
    scene.add(FLOOR, albedo=ALBEDO, casts=casts)
    image = ss.render(scene, LOOK, light, method)
    assert image.mask.sum() >= 20
    return image


def _expected(image, light):
    up = np.array([0, 0, 1.0])
    pairs = [irradiance_and_fraction(light, p, up) for p in image.position[image.mask]]
    return np.array(pairs).T


@pytest.mark.parametrize("name", [*OVERHEAD, *(f"{k}, sunken" for k in SUNKEN)])
def test_the_radiance_of_an_unoccluded_light_is_its_integral(name):
    sunken = name.endswith(", sunken")
    light = SUNKEN[name[:-8]] if sunken else OVERHEAD[name]
    image = _lit_floor(light, "hard")
    irradiance, fraction = _expected(image, light)
    assert (fraction < 1 - 1e-3).any() == sunken
    assert irradiance.min() > 0
    expected = irradiance[:, None] * ALBEDO / math.pi * np.array(light.radiance)
    got = image.radiance[image.mask]
    # Single precision, and a fraction that is divided by itself.
    assert np.abs(got / expected - 1).max() < 2e-6
    assert np.abs(image.visibility[image.mask] - fraction).max() < 1e-6


def _random_case(kind, rng):
    """A light anywhere, of up to 0.8 of its distance in half-size, and a point with any normal."""
    c, p, n = rng.normal(size=3), rng.normal(size=3), _unit(rng.normal(size=3))
    reach = rng.uniform(0.05, 0.8) * np.linalg.norm(c - p)
    if kind == "sphere":
        return ss.SphereLight(c, reach), p, n
    if kind == "disk on the axis":
        return ss.DiskLight(c, p - c, reach), p, n
    m = rng.normal(size=3)
    m *= np.sign(m @ (p - c))
    if kind == "disk":
        return ss.DiskLight(c, m, reach), p, n
    a, b = _frame(_unit(m))
    u, v = reach * a, reach * (b + rng.uniform(-0.5, 0.5) * a)
    return ss.RectLight(c, u, v), p, n


@pytest.mark.parametrize("kind", ["rect", "disk", "disk on the axis", "sphere"])
def test_irradiance_and_fraction_of_lights_anywhere(kind):
    rng = np.random.default_rng(11)
    wrong, cut = [], 0
    for _ in range(250):
        light, p, n = _random_case(kind, rng)
        expected = irradiance_and_fraction(light, p, n)
        cut += 0 < expected[1] < 1
        got = (
            ss.kernels.unshadowed_irradiance(light, [p], [n])[0],
            ss.kernels.light_fraction_above(light, [p], [n])[0],
        )
        # The quadrature's own error, at a light this near: 1e-7 of the largest irradiance.
        if not np.allclose(got, expected, rtol=1e-6, atol=1e-6):
            wrong.append((light, p.tolist(), n.tolist(), got, expected))
    assert cut > 40
    assert not wrong, f"{len(wrong)} of 250, the first: {wrong[0]}"


@pytest.mark.parametrize("name", OVERHEAD)
def test_textbook_irradiance_on_the_axis(name):
    """Below the middle of a light: textbook configuration factors (Howell's catalogue)."""
    p, n, h = [(0.0, 0.0, 0.0)], [(0.0, 0.0, 1.0)], 1.7
    if name == "rect":
        a, b = 0.45, 0.3  # half edges
        x, y = a / h, b / h
        corner = x / math.hypot(1, x) * math.atan(y / math.hypot(1, x))
        corner += y / math.hypot(1, y) * math.atan(x / math.hypot(1, y))
        expected, light = 2 * corner, ss.RectLight((0, 0, h), (0, 2 * b, 0), (2 * a, 0, 0))
    elif name.startswith("disk"):
        r = 0.6 if name == "disk" else 60.0
        expected, light = math.pi * r**2 / (r**2 + h**2), ss.DiskLight((0, 0, h), (0, 0, -1), r)
    else:
        r = 0.6 if name == "sphere" else 1e-6
        expected, light = math.pi * (r / h) ** 2, ss.SphereLight((0, 0, h), r)
    assert ss.kernels.unshadowed_irradiance(light, p, n)[0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", [*OVERHEAD, *(f"{k}, sunken" for k in SUNKEN)])
def test_the_ray_traced_radiance_of_an_unoccluded_light_converges_to_its_integral(name):
    light = SUNKEN[name[:-8]] if name.endswith(", sunken") else OVERHEAD[name]
    image = _lit_floor(light, MANY)
    irradiance, fraction = _expected(image, light)
    expected = irradiance[:, None] * ALBEDO / math.pi * np.array(light.radiance)
    relative = np.abs(image.radiance[image.mask] / expected - 1)
    # A scrambled net's variance is at most e times plain sampling's (Owen 1997); a sample's
    # standard deviation is found from the very weights at one floor point, over its mean.
    worst = 0.0
    for p in image.position[image.mask]:
        points, weights, _ = ss.kernels.light_samples(light, p, 1024)
        cosine = np.maximum((points - p)[:, 2] / np.linalg.norm(points - p, axis=1), 0)
        values = weights * cosine
        worst = max(worst, values.std() / values.mean())
    assert relative.max() < 4 * math.sqrt(math.e) * worst / math.sqrt(N) + 1e-5
    # On average over receivers, whose patterns are scrambled apart, far better than one of them.
    assert abs((image.radiance[image.mask] / expected).mean() - 1) < 2 * worst / math.sqrt(N)
    # The fraction above: only cells that the tangent plane's line cuts, at most 4 sqrt(N), can be
    # wrong; they are independent, each with a variance of at most a quarter.
    assert np.abs(image.visibility[image.mask] - fraction).max() < 5 * N**-0.75


def test_a_floor_that_does_not_cast_lets_hard_shadows_through_from_below():
    light = ss.SphereLight((0.5, 1.9, -0.2), 0.5)
    blocked, free = (_lit_floor(light, "hard", casts).visibility for casts in (True, False))
    image = _lit_floor(light, "hard")
    _, fraction = _expected(image, light)
    assert 0 < fraction.max() < 0.5
    # The centre is below the floor's plane: the ray to it passes under the floor's border or not.
    assert (blocked[image.mask] == 0).all()
    assert np.abs(free[image.mask] - fraction).max() < 1e-6


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
        normal = _unit(np.cross([0.0, 1.0, 0.0], [-p[0], 0, BLOCKER - p[2]]))
        sine = light.radius / distance
        _, angle = _cap_integral(d / distance, sine, normal)
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

ABOVE = {
    "rect": ss.RectLight((0, 0, 2), (0, 0.6, 0), (0.6, 0, 0)),
    "disk": ss.DiskLight((0, 0, 2), (0, 0, -1), 0.3),
    "sphere": ss.SphereLight((0, 0, 2), 0.3),
}
METHODS = {"hard": "hard", "ray_traced": ss.RayTraced(samples=256)}


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
        image = _lit_floor(floor, method)
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
    _, angle = _cap_integral(_unit(d), sine, np.array([1.0, 0, 0]))
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
    n = _unit((1.0, 0.3, 0.1))
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


# ---------------------------------------------------------------- who casts, who receives, sums


def _penumbra_scene(**ball):
    scene = ss.Scene()
    scene.add(FLOOR, "floor")
    vertices, faces = geodesic(6)
    scene.add((vertices * 0.3 + [0, 0, 0.6], faces), "ball", **ball)
    return scene


WIDE = ss.RectLight((0.3, 0.2, 2.0), (0, 0.9, 0), (0.9, 0, 0), (1, 0.5, 0.2))
VIEW = ss.Camera((0.4, -2.2, 2.2), (0, 0, 0.1), width=64, height=48)


@pytest.mark.parametrize("method", METHODS)
def test_what_does_not_cast_is_seen_but_hides_nothing(method):
    solid, ghost = (
        ss.render(_penumbra_scene(casts=c), VIEW, WIDE, METHODS[method]) for c in (True, False)
    )
    assert np.array_equal(solid.mesh_id, ghost.mesh_id)
    floor = solid.mesh_id == 0
    assert (ghost.visibility[floor] == 1).all()
    assert (solid.visibility[floor] == 0).any()


@pytest.mark.parametrize("method", METHODS)
def test_what_does_not_receive_is_shaded_as_unshadowed(method):
    scene = _penumbra_scene()
    plain = ss.render(scene, VIEW, WIDE, METHODS[method])
    other = ss.Scene()
    other.add(FLOOR, "floor", receives=False)
    ball = scene.entries[1]
    other.add((ball.vertices, ball.faces), "ball", receives=False)
    image = ss.render(other, VIEW, WIDE, METHODS[method])
    mask = image.mask
    h = ss.kernels.light_fraction_above(WIDE, image.position[mask], image.normal[mask])
    assert np.abs(image.visibility[mask] - h).max() < 1e-6
    e = ss.kernels.unshadowed_irradiance(WIDE, image.position[mask], image.normal[mask])
    expected = e[:, None] * 0.8 / math.pi * np.array(WIDE.radiance)
    # Image normals are single precision: 1e-7 of the largest irradiance.
    assert np.abs(image.radiance[mask] - expected).max() < 1e-6 * expected.max()
    assert (plain.visibility[mask] < image.visibility[mask] - 0.5).any()


def test_several_lights_add_up():
    lights = [
        WIDE,
        ss.SphereLight((-1, 0.5, 1.5), 0.3, 2.0),
        ss.DiskLight((0, 2, 1), (0, -2, -1), 0.4),
    ]
    scene = _penumbra_scene()
    together = ss.render(scene, VIEW, lights, "hard")
    alone = [ss.render(scene, VIEW, light, "hard") for light in lights]
    assert together.visibility.shape == (3, 48, 64)
    for k, image in enumerate(alone):
        assert np.array_equal(together.visibility[k], image.visibility)
    total = np.sum([image.radiance.astype(np.float64) for image in alone], axis=0)
    # Three terms in single precision.
    assert np.abs(together.radiance - total).max() <= 3 * 2.0**-24 * total.max()
    traced = ss.render(scene, VIEW, lights, METHODS["ray_traced"])
    first = ss.render(scene, VIEW, lights[0], METHODS["ray_traced"])
    assert np.array_equal(traced.visibility[0], first.visibility)
    # The other lights have their own samples, and the same shadows.
    for k, light in enumerate(lights):
        exact = ss.render(scene, VIEW, light, MANY)
        assert np.abs(traced.visibility[k] - exact.visibility).max() < 0.08
        assert np.abs(traced.visibility[k] - exact.visibility).mean() < 0.003


# ---------------------------------------------------------------- bits


def _digest(image):
    h = hashlib.sha256()
    for array in (image.visibility, image.radiance, image.position, image.triangle_id):
        h.update(np.ascontiguousarray(array).tobytes())
    return h.hexdigest()


@pytest.mark.parametrize("pattern", ["per_receiver", "fixed"])
def test_the_same_seed_gives_the_same_bits_and_another_seed_others(pattern):
    def render(seed):
        method = ss.RayTraced(samples=64, seed=seed, pattern=pattern)
        return ss.render(_penumbra_scene(), VIEW, WIDE, method)

    digests = [_digest(render(seed)) for seed in (0, 0, 1, 2**63, 2**64 - 1, 1)]
    assert digests[0] == digests[1]
    assert digests[2] == digests[5]
    assert len(set(digests)) == 4


PROGRAM = """
import softshadow as ss
from test_closed_forms import VIEW, WIDE, _digest, _penumbra_scene
lights = [WIDE, ss.SphereLight((-1, 0.5, 1.5), 0.3)]
for scene in (_penumbra_scene(), _penumbra_scene(opacity=0.3)):
    for method in ("hard", ss.RayTraced(64), ss.RayTraced(64, cull=False)):
        print(_digest(ss.render(scene, VIEW, lights, method)))
"""


def test_the_number_of_threads_changes_no_bit():
    def run(threads):
        environment = {**os.environ, "RAYON_NUM_THREADS": str(threads)}
        return subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env=environment,
            cwd=os.path.dirname(__file__),
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        ).stdout.split()

    one, two, many = run(1), run(2), run(7)
    assert len(one) == 6
    assert len(set(one)) == 4  # culling changes nothing
    assert one == two == many
