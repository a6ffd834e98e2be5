"""Irradiance and radiance of lights that nothing hides, against integrals by quadrature."""

from __future__ import annotations

import math

import numpy as np
import pytest
import softshadow as ss
from closed_forms import ALBEDO, MANY, N, frame, irradiance_and_fraction, lit_floor, unit

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


def _expected(image, light):
    up = np.array([0, 0, 1.0])
    pairs = [irradiance_and_fraction(light, p, up) for p in image.position[image.mask]]
    return np.array(pairs).T


@pytest.mark.parametrize("name", [*OVERHEAD, *(f"{k}, sunken" for k in SUNKEN)])
def test_the_radiance_of_an_unoccluded_light_is_its_integral(name):
    sunken = name.endswith(", sunken")
    light = SUNKEN[name[:-8]] if sunken else OVERHEAD[name]
    image = lit_floor(light, "hard")
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
    c, p, n = rng.normal(size=3), rng.normal(size=3), unit(rng.normal(size=3))
    reach = rng.uniform(0.05, 0.8) * np.linalg.norm(c - p)
    if kind == "sphere":
        return ss.SphereLight(c, reach), p, n
    if kind == "disk on the axis":
        return ss.DiskLight(c, p - c, reach), p, n
    m = rng.normal(size=3)
    m *= np.sign(m @ (p - c))
    if kind == "disk":
        return ss.DiskLight(c, m, reach), p, n
    a, b = frame(unit(m))
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
    image = lit_floor(light, MANY)
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
    blocked, free = (lit_floor(light, "hard", casts).visibility for casts in (True, False))
    image = lit_floor(light, "hard")
    _, fraction = _expected(image, light)
    assert 0 < fraction.max() < 0.5
    # The centre is below the floor's plane: the ray to it passes under the floor's border or not.
    assert (blocked[image.mask] == 0).all()
    assert np.abs(free[image.mask] - fraction).max() < 1e-6


@pytest.mark.parametrize("method", ["hard", "ssoc", "single_sample"])
def test_irradiance_at_points_is_what_a_picture_has_there(method):
    setup = ss.scenes.closed_solids(48, 48, detail=2)
    lights = [setup.light, OVERHEAD["disk"], SUNKEN["rect"]]
    image = ss.render(setup.scene, setup.camera, lights, method)
    hit = image.mask & np.isin(image.mesh_id, range(len(setup.scene.meshes)))
    points, normals = image.position[hit], image.normal[hit]
    got = ss.irradiance(setup.scene, points, normals, lights, method)
    assert got.shape == (hit.sum(), 3)
    assert got.dtype == np.float32
    albedo = np.array([entry.albedo for entry in setup.scene.entries])[image.mesh_id[hit]]
    off = np.abs(got * albedo / math.pi - image.radiance[hit]) / image.radiance.max()
    # Normals and the picture are in single precision. Measured: 1.2e-7
    assert off.max() < 1e-6


def test_irradiance_needs_normals_and_a_method_that_answers_at_points():
    setup = ss.scenes.half_plane(8, 8)
    with pytest.raises(ValueError, match="normals: irradiance needs them"):
        ss.irradiance(setup.scene, [(0, 0, 0)], None, setup.light)
    with pytest.raises(ValueError, match="'wedges' needs a camera"):
        ss.irradiance(setup.scene, [(0, 0, 0)], [(0, 0, 1)], setup.light, "wedges")
    bright = ss.SphereLight((0, 0, 2), 1.9, 3e38)
    with pytest.raises(ss.ParameterError, match="irradiance: it overflows"):
        ss.irradiance(setup.scene, [(3, 0, 0)], [(0, 0, 1)], [bright] * 30, "hard")
