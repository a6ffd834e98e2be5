"""`counted` against `ray_traced` with many samples, where counting is hard, and what it reports.

Its closed forms and the hard cases of all methods are in ``test_hard_cases.py``, its bits at every
SIMD level and number of threads in ``test_roles_and_bits.py``.
"""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from shapes import bumpy, quad

LIGHTS = {
    "rect": ss.RectLight((0.5, -0.3, 2.0), (0.1, 0.8, 0.1), (0.8, -0.1, 0.2)),
    "disk": ss.DiskLight((-0.7, 0.2, 1.8), (0.4, -0.1, -1), 0.4),
    "sphere": ss.SphereLight((0.4, 0.5, 1.9), 0.35),
}
CAMERA = ss.Camera((0.4, -3.0, 1.8), (-0.1, 0.1, 0.35), fov_y_deg=38, width=40, height=30)
GROUND = quad((0, 0, 0), (5, 0, 0), (0, 5, 0))

MANY = 4096
"""Samples of the reference."""

NOISE = 0.5 * (1 / (np.pi / 4 * 1664) + 1 / MANY) ** 0.5
"""Largest deviation of a mean of so many points that are hidden or seen, were they independent:
1664 points are what 1024 asked for are, and a disk has π/4 of them. Points of a lattice and of a
sequence are better than that."""


def _scene(*meshes, ground=GROUND, **options):
    scene = ss.Scene()
    scene.add(ground, "ground")
    for mesh in meshes:
        scene.add(mesh, **options)
    return scene


def _soup():
    """Triangles that share corners and edges by threes and more, needles, duplicates, flat ones."""
    rng = np.random.default_rng(3)
    vertices = rng.uniform((-0.8, -0.8, 0.1), (0.8, 0.8, 1.3), (40, 3))
    vertices[30:] = vertices[20:30] + rng.normal(size=(10, 3)) * 1e-5
    faces = rng.integers(40, size=(70, 3))
    needles = np.column_stack([np.arange(20, 30), np.arange(30, 40), rng.integers(20, size=10)])
    faces = np.concatenate([faces, needles, faces[:15], faces[15:25, ::-1]])
    return _scene((vertices, faces))


def _sheets():
    """Ten times the same sheet, in one plane, and one that shares an edge with it."""
    sheets = [quad((0, 0, 0.6), (1.2, 0, 0), (0, 0.9, 0)) for _ in range(10)]
    return _scene(*sheets, quad((0.6, 0, 0.6), (0, 0.9, 0), (0.3, 0, 0.4)))


def _fin():
    """Three sheets at one edge in one mesh, and a body of which some faces are given twice."""
    vertices, faces = bumpy(8, seed=4)
    body = (
        vertices * 0.3 + [-0.5, 0.2, 0.6],
        np.concatenate([faces, faces[:40], faces[:20, ::-1]]),
    )
    corners = [(0.3, -0.5, 0.4), (0.3, 0.5, 0.4), (0.8, 0, 0.4), (0, 0, 0.9), (0.3, 0, 0)]
    return _scene(body, (np.array(corners), np.array([(0, 1, 2), (0, 1, 3), (0, 1, 4)])))


def _levels():
    """Boxes on the ground and on one another: receivers in the planes of faces all around."""
    import trimesh

    boxes = []
    for x, y, z, side in [(0, 0, 0, 0.8), (0, 0, 0.8, 0.4), (0.6, 0, 0, 0.4), (-0.6, 0.2, 0, 0.4)]:
        box = trimesh.creation.box((side, side, side))
        boxes.append(box.apply_translation((x, y, z + side / 2)))
    return _scene(*boxes)


def _tiles():
    """A ground of many triangles in one plane under a body."""
    x, y = np.meshgrid(np.linspace(-2.5, 2.5, 21), np.linspace(-2.5, 2.5, 21))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    i = (np.arange(20)[:, None] * 21 + np.arange(20)).ravel()
    faces = np.concatenate([np.column_stack(f) for f in ((i, i + 1, i + 22), (i, i + 22, i + 21))])
    body, shape = bumpy(8, seed=4)
    return _scene((body * 0.3 + [0, 0, 0.3], shape), ground=(vertices, faces))


SCENES = {"soup": _soup, "sheets": _sheets, "fin": _fin, "levels": _levels, "tiles": _tiles}


def _assert_near(scene, light, camera=CAMERA, by_rays=0.0):
    """Assert that no pixel is off by five deviations, and all together by less than one."""
    image = ss.render(scene, camera, light, "counted")
    reference = ss.render(scene, camera, light, ss.RayTraced(samples=MANY, seed=1))
    off = (image.visibility - reference.visibility)[image.mask]
    assert np.abs(off).max() < 5 * NOISE
    assert np.sqrt((off**2).mean()) < 0.5 * NOISE
    assert image.by_rays <= by_rays
    seen = reference.radiance[image.mask]
    assert np.abs(image.radiance[image.mask] - seen).mean() < NOISE * seen.mean()
    return reference.visibility[image.mask]


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("name", SCENES)
def test_any_triangles_are_counted(name, light):
    seen = _assert_near(SCENES[name](), LIGHTS[light], by_rays=0.01)
    assert ((seen > 0) & (seen < 1)).mean() > 0.05


@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
def test_a_light_that_the_ground_s_horizon_cuts(kind):
    lights = {
        "rect": ss.RectLight((-2.2, 0, 0.1), (0, 0.8, 0), (0.05, 0, 0.6)),
        "disk": ss.DiskLight((-2.2, 0, 0.1), (1, 0, 0.05), 0.4),
        "sphere": ss.SphereLight((-3.2, 0, 0.1), 0.4),
    }
    scene = _tiles().copy()
    if kind != "sphere":  # the ground cuts these: let it end before
        scene = _scene(
            *[(e.world_vertices(), e.faces) for e in scene.entries[1:]],
            ground=quad((0.5, 0, 0), (5, 0, 0), (0, 5, 0)),
        )
    _assert_near(scene, lights[kind], by_rays=0.02)


@pytest.mark.parametrize("kind", ["rect", "sphere"])
def test_a_light_in_a_bush(kind):
    rng = np.random.default_rng(7)
    leaves = []
    for _ in range(60):
        direction = rng.normal(size=3)
        center = direction / np.linalg.norm(direction) * rng.uniform(0.35, 0.6) + [0, 0, 1.0]
        leaves.append(quad(center, rng.normal(size=3) * 0.07, rng.normal(size=3) * 0.07))
    square = ss.RectLight((0, 0, 1), (0, 0.3, 0), (0.3, 0, 0))
    light = square if kind == "rect" else ss.SphereLight((0, 0, 1), 0.15)
    _assert_near(_scene(*leaves), light, by_rays=0.02)


def test_a_light_that_a_triangle_cuts_or_touches_is_left_to_rays():
    light = ss.RectLight((0, 0, 1.5), (0, 0.6, 0), (0.6, 0, 0))
    cut = _scene(quad((0, 0, 1.5), (0.4, 0, 0), (0, 0.3, 0.3)))
    image = ss.render(cut, CAMERA, light, ss.Counted(rays=64, seed=3))
    assert image.by_rays > 0.9
    same = ss.render(cut, CAMERA, light, ss.RayTraced(samples=64, seed=3, cull=False))
    assert np.array_equal(image.visibility, same.visibility)
    assert np.array_equal(image.radiance, same.radiance)
    # In its plane and beside it, behind it, and above: nothing that it does not see.
    beside = _scene(
        quad((0.5, 0, 1.5), (0.3, 0, 0), (0, 0.6, 0)), quad((0, 0, 1.6), (1, 0, 0), (0, 1, 0))
    )
    _assert_near(beside, light)


@pytest.mark.parametrize("kind", ["translucent", "sphere"])
def test_what_cannot_be_counted_is_left_to_rays_where_it_matters(kind):
    scene = _levels()
    if kind == "sphere":
        scene.add_spheres([(0.7, 0.5, 0.6)], [0.2])
    else:
        scene.add(quad((0.7, 0.5, 0.6), (0.4, 0, 0), (0, 0.4, 0)), opacity=0.5)
    for light in LIGHTS.values():
        image = ss.render(scene, CAMERA, light, "counted")
        assert 0.01 < image.by_rays < 0.7
        reference = ss.render(scene, CAMERA, light, ss.RayTraced(samples=MANY))
        # 256 samples in the worst of cases.
        assert np.abs(image.visibility - reference.visibility).max() < 5 * 0.5 / 16


def test_receivers_on_edges_and_corners():
    scene = _levels()
    box = scene.entries[1]
    corners = np.asarray(box.world_vertices())
    a, b = corners[box.faces[:, 0]], corners[box.faces[:, 1]]
    points = np.concatenate([corners, (a + b) / 2, 0.25 * a + 0.75 * b])
    for normal in ((0, 0, 1.0), (0.6, 0, 0.8), (0, -1.0, 0)):
        normals = np.broadcast_to(normal, points.shape)
        for light in LIGHTS.values():
            seen = ss.visibility(scene, points, normals, light, "counted")
            reference = ss.visibility(scene, points, normals, light, ss.RayTraced(samples=MANY))
            assert np.abs(seen - reference).max() < 5 * NOISE


def test_a_receiver_has_the_same_bits_alone_and_in_company():
    scene, light = _soup(), LIGHTS["rect"]
    points = np.random.default_rng(2).uniform((-1, -1, 0), (1, 1, 0), (50, 3))
    normals = np.broadcast_to((0, 0, 1.0), points.shape)
    prepared = ss.prepare(scene, light, "counted")
    first = prepared.visibility(points, normals)
    # The last may be anything: a receiver's light points depend on its number.
    others = np.concatenate([points[:10], np.add(points[10:], (3, 0, 0))])
    assert np.array_equal(prepared.visibility(others, normals)[:10], first[:10])
    assert np.array_equal(prepared.visibility(points[:10], normals[:10]), first[:10])


def test_more_light_points_are_better_and_seeds_differ():
    scene, light = _soup(), LIGHTS["disk"]
    reference = ss.render(scene, CAMERA, light, ss.RayTraced(samples=MANY)).visibility
    errors = []
    for samples in (256, 1024, 4096):
        images = [ss.render(scene, CAMERA, light, ss.Counted(samples, seed=s)) for s in (0, 1)]
        one, two = (image.visibility for image in images)
        assert not np.array_equal(one, two)
        errors.append(np.sqrt(((one - reference) ** 2).mean()))
    assert errors[1] < 0.8 * errors[0]
    assert errors[2] < 0.9 * errors[1]


def test_a_light_of_no_size_is_a_point():
    scene, light = _soup(), ss.SphereLight((0.4, 0.5, 1.9), 0)
    image = ss.render(scene, CAMERA, light, "counted")
    hard = ss.render(scene, CAMERA, light, "hard")
    assert np.array_equal(image.visibility, hard.visibility)
