"""A scene scaled or moved gives the same picture, and moved parts the same as new ones."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from shapes import bumpy, quad

METHODS = {"hard": "hard", "ray_traced": ss.RayTraced(samples=64)}
SIZE = 96
BODY = bumpy(20, seed=6)


def _world(scale=1.0, move=(0.0, 0.0, 0.0), kind="rect", transform=None):
    """A body and a sphere over a ground, a light and a camera, all scaled and then moved."""

    def at(p):
        return np.asarray(p, dtype=np.float64) * scale + np.asarray(move)

    vertices, faces = BODY
    ground, two = quad((0, 0, 0), (6, 0, 0), (0, 6, 0))
    scene = ss.Scene()
    scene.add((at(ground), two), "ground")
    scene.add((at(vertices * 0.5 + [0.1, 0, 0.7]), faces), "body")
    scene.add_spheres(at((-1.0, 0.7, 0.4)), 0.4 * scale, "ball")
    if kind == "rect":
        light = ss.RectLight(
            at((0.6, -0.4, 2.5)), (0, 0.7 * scale, 0), (0.7 * scale, 0, 0.1 * scale)
        )
    elif kind == "disk":
        light = ss.DiskLight(at((0.6, -0.4, 2.5)), (-0.2, 0.1, -1), 0.4 * scale)
    else:
        light = ss.SphereLight(at((0.6, -0.4, 2.5)), 0.4 * scale)
    camera = ss.Camera(at((0.4, -3.2, 2.0)), at((0, 0.1, 0.3)), width=SIZE, height=SIZE)
    return scene, camera, light


@pytest.fixture(scope="module")
def pictures():
    """The unscaled pictures."""
    return {
        (kind, method): ss.render(*_world(kind=kind), METHODS[method])
        for kind in ("rect", "disk", "sphere")
        for method in METHODS
    }


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
@pytest.mark.parametrize("power", [-20, -7, 1, 20])
def test_scaled_by_a_power_of_two_the_bits_are_the_same(pictures, power, kind, method):
    plain = pictures[kind, method]
    image = ss.render(*_world(2.0**power, kind=kind), METHODS[method])
    assert np.array_equal(image.visibility, plain.visibility)
    assert np.array_equal(image.triangle_id, plain.triangle_id)
    assert np.array_equal(image.normal, plain.normal)
    assert np.array_equal(image.position, plain.position * 2.0**power)
    assert np.array_equal(image.depth, plain.depth * np.float32(2.0**power))
    # Irradiance knows no unit.
    assert np.array_equal(image.radiance, plain.radiance)


def _compare(image, plain, method):
    """Shares of pixels with another surface, another visibility, and the largest radiance error.

    Vertices are rounded to 2**-25 of the frame's unit, here 4. The body's edges are 0.02 at least,
    so its normals turn by up to 2 * 4 * 2**-25 / 0.02 = 1.2e-5, and the part of a light of angular
    size 0.2 over a tangent plane changes by 6e-5.
    """
    other_surface = (image.triangle_id != plain.triangle_id) | (image.mesh_id != plain.mesh_id)
    different = np.abs(image.visibility - plain.visibility) > 6e-5
    both = ~other_surface & ~different
    error = np.abs(image.radiance - plain.radiance)[both].max() / plain.radiance.max()
    return other_surface.mean(), different.mean(), error


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
@pytest.mark.parametrize("power", [-6, -3, 2, 6])
def test_scaled_by_a_power_of_ten_all_but_a_handful_of_pixels_are_the_same(
    pictures, power, kind, method
):
    plain = pictures[kind, method]
    image = ss.render(*_world(10.0**power, kind=kind), METHODS[method])
    surface, seen, error = _compare(image, plain, method)
    # Vertices are rounded to single precision elsewhere: 6e-8 of the scene. A pixel is 1e-2 of it,
    # so 1e-5 of the pixels next to an edge change their surface; a sample of 64, whose shadow's
    # edge moves as little, changes in 64 times as many penumbra pixels. Measured: 0 or 1 of 9,216.
    assert surface <= 1 / SIZE**2
    assert seen <= (4 if method == "ray_traced" else 1) / SIZE**2
    assert error < 1.2e-5  # the normals' turn


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_moved_by_ten_thousand_times_its_size_all_but_a_handful_of_pixels_are_the_same(
    pictures, scale, kind, method
):
    plain = pictures[kind, method]
    move = 6e4 * scale * np.array([1.0, -0.8, 0.6])
    image = ss.render(*_world(scale, move, kind), METHODS[method])
    surface, seen, error = _compare(image, plain, method)
    # Moved coordinates lose 4 of 16 digits, far less than single precision does.
    assert surface <= 1 / SIZE**2
    assert seen <= (4 if method == "ray_traced" else 1) / SIZE**2
    assert error < 1.2e-5  # the normals' turn
    p = image.position[image.mask]
    expected = plain.position[plain.mask] * scale + move
    assert np.abs(p - expected).max() < 1e-6 * 6 * scale


# ---------------------------------------------------------------- moved parts


def _equal(one, two):
    for name in ("visibility", "radiance", "mask", "position", "normal", "depth", "triangle_id"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name


def _spin(angle, move=(0.0, 0.0, 0.0)):
    c, s = np.cos(angle), np.sin(angle)
    m = np.eye(4)
    m[:2, :2] = [[c, -s], [s, c]]
    m[:3, 3] = move
    return m


@pytest.mark.parametrize("opacity", [1.0, 0.5])
@pytest.mark.parametrize("method", METHODS)
def test_a_mesh_placed_by_its_transform_gives_the_picture_of_a_fresh_scene(method, opacity):
    vertices, faces = BODY
    _, camera, light = _world()
    ground = quad((0, 0, 0), (6, 0, 0), (0, 6, 0))

    def fresh(matrix):
        scene = ss.Scene()
        scene.add(ground, "ground")
        scene.add((vertices, faces), "body", opacity=opacity)
        scene.set_transform("body", matrix)
        return scene

    moving = fresh(np.eye(4))
    ss.render(moving, camera, light, METHODS[method])
    # Small steps keep the tree's topology; the last goes far enough for a new one.
    for step, move in enumerate([(0, 0, 0.5), (0.2, 0.1, 1.1), (0.3, 0.1, 1.1), (-9.0, 30.0, 2.0)]):
        matrix = _spin(0.7 * step, move) @ np.diag([0.5, 0.45, 0.5, 1])
        moving.set_transform("body", matrix)
        image = ss.render(moving, camera, light, METHODS[method])
        _equal(image, ss.render(fresh(matrix), camera, light, METHODS[method]))
    assert image.mask.any()


@pytest.mark.parametrize("method", METHODS)
def test_moved_vertices_give_the_picture_of_a_fresh_scene(method):
    vertices, faces = BODY
    _, camera, light = _world()
    ground = quad((0, 0, 0), (6, 0, 0), (0, 6, 0))

    def fresh(points):
        scene = ss.Scene()
        scene.add(ground, "ground")
        scene.add((points, faces), "body")
        return scene

    points = vertices * 0.5 + [0, 0, 0.7]
    moving = fresh(points)
    ss.render(moving, camera, light, METHODS[method])
    rng = np.random.default_rng(4)
    for strength in (0.01, 0.2, 2.0):  # the last leaves nothing of the body's order
        points = points + strength * rng.normal(size=points.shape) * [1, 1, 0.1]
        moving.set_vertices("body", points)
        image = ss.render(moving, camera, light, METHODS[method])
        _equal(image, ss.render(fresh(points), camera, light, METHODS[method]))
        assert (image.mesh_id == 1).any()


@pytest.mark.parametrize("method", METHODS)
def test_baked_vertices_and_a_transform_agree(method):
    vertices, faces = BODY
    _, camera, light = _world()
    ground = quad((0, 0, 0), (6, 0, 0), (0, 6, 0))
    matrix = _spin(0.4, (0.1, 0, 0.8)) @ np.diag([0.5, 0.5, 0.6, 1])
    placed, baked = ss.Scene(), ss.Scene()
    for scene in (placed, baked):
        scene.add(ground)
    placed.set_transform(placed.add((vertices, faces)), matrix)
    baked.add((vertices @ matrix[:3, :3].T + matrix[:3, 3], faces))
    one, two = (ss.render(s, camera, light, METHODS[method]) for s in (placed, baked))
    # The two sums round in another order, which single precision mostly hides.
    surface, seen, error = _compare(one, two, method)
    assert surface <= 1 / SIZE**2
    assert seen <= 4 / SIZE**2
    assert error < 1.2e-5  # the normals' turn


def test_what_was_prepared_sees_the_scene_as_it_was():
    scene, camera, light = _world()
    prepared = ss.prepare(scene, light, METHODS["hard"])
    before = prepared.render(camera)
    scene.set_transform("body", _spin(0, (0, 0, 50.0)))
    _equal(prepared.render(camera), before)
    after = ss.render(scene, camera, light, "hard")
    assert not np.array_equal(after.visibility, before.visibility)


def test_a_transform_that_is_undone_gives_the_first_picture_again():
    scene, camera, light = _world()
    first = ss.render(scene, camera, light, METHODS["ray_traced"])
    scene.set_transform("body", _spin(1.0, (3, 1, 2.0)))
    ss.render(scene, camera, light, "hard")
    scene.set_transform("body", np.eye(4))
    _equal(ss.render(scene, camera, light, METHODS["ray_traced"]), first)
