"""`ray_traced` gives the same bits with and without culling.

Culling decides by silhouettes; each case here is one where the silhouettes are hard to tell.
"""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
import trimesh
from shapes import bumpy, geodesic, quad

RECT = ss.RectLight((0.5, -0.3, 2.0), (0.1, 0.8, 0.1), (0.8, -0.1, 0.2))
LIGHTS = {
    "rect": RECT,
    "disk": ss.DiskLight((-0.7, 0.2, 1.8), (0.4, -0.1, -1), 0.4),
    "sphere": ss.SphereLight((0.4, 0.5, 1.9), 0.35),
}
CAMERA = ss.Camera((0.4, -3.0, 1.8), (-0.1, 0.1, 0.35), fov_y_deg=38, width=112, height=96)
GROUND = quad((0, 0, 0), (5, 0, 0), (0, 5, 0))


def _with_ground(*meshes, **options):
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    for mesh in meshes:
        scene.add(mesh, **options)
    return scene


def _body(n=16):
    vertices, faces = bumpy(n, seed=4)
    return vertices * 0.45 + [0, 0, 0.7], faces


def _open_sheets():
    rng = np.random.default_rng(1)
    sheets = []
    for _ in range(12):
        c = rng.uniform((-0.8, -0.8, 0.2), (0.8, 0.8, 1.2))
        sheets.append(quad(c, rng.normal(size=3) * 0.5, rng.normal(size=3) * 0.5))
    return _with_ground(*sheets)


def _inconsistent_winding():
    vertices, faces = _body()
    turned = np.random.default_rng(2).random(len(faces)) < 0.3
    faces = faces.copy()
    faces[turned] = faces[turned][:, ::-1]
    return _with_ground((vertices, faces))


def _non_manifold():
    vertices, faces = _body(8)
    extra = np.random.default_rng(3).integers(len(vertices), size=(150, 3))
    return _with_ground(
        (vertices, np.concatenate([faces, extra, faces[:40], faces[:20, [0, 2, 1]]]))
    )


def _slivers():
    """Zero-area and needle-like faces among the others, and vertices in the middle of edges."""
    vertices, faces = _body(8)
    a, b = faces[:100, 0], faces[:100, 1]
    middle = np.arange(100) + len(vertices)
    points = np.concatenate([vertices, (vertices[a] + vertices[b]) / 2])
    flat = np.column_stack([a, b, middle])
    return _with_ground((points, np.concatenate([faces, flat, np.column_stack([a, a, b])])))


def _light_touches(light):
    """An occluder around the light, one that touches its border, one that cuts it."""
    box = trimesh.creation.box((0.5, 0.5, 0.5)).apply_translation(light.center)
    touching = quad(np.add(light.center, (0.4, 0, 0)), (0.8, 0, 0), (0, 1, 0))
    scene = _with_ground(_body(8), touching)
    return scene, _with_ground(_body(8), box)


def _levels():
    """Many small solids that stand exactly on the ground and on each other."""
    rng = np.random.default_rng(5)
    boxes = []
    for _ in range(30):
        x, y = rng.integers(-4, 5, 2) * 0.25
        height = rng.integers(1, 5) * 0.125
        boxes.append(
            trimesh.creation.box((0.25, 0.25, height)).apply_translation((x, y, height / 2))
        )
    return _with_ground(*boxes)


def _spheres():
    scene = _with_ground(_body(8))
    scene.add_spheres([(0.7, 0.5, 0.3), (-0.8, -0.3, 0.4)], [0.3, 0.25])
    return scene


def _transparent():
    scene = _with_ground(_body(8), opacity=0.4)
    vertices, faces = geodesic(6)
    scene.add((vertices * 0.25 + [0.8, -0.2, 0.3], faces))
    scene.add(quad((-0.5, -0.5, 1.0), (0.7, 0, 0.2), (0, 0.8, 0)), opacity=0.7)
    return scene


SCENES = {
    "bunny": lambda: ss.scenes.bunny_on_plane().scene,
    "open sheets": _open_sheets,
    "inconsistent winding": _inconsistent_winding,
    "non-manifold edges": _non_manifold,
    "slivers": _slivers,
    "contact": _levels,
    "spheres": _spheres,
    "transparent": _transparent,
}


def _assert_same(scene, camera, light, samples=64, **options):
    with_culling, without = (
        ss.render(scene, camera, light, ss.RayTraced(samples, cull=c, **options))
        for c in (True, False)
    )
    different = np.argwhere(with_culling.visibility != without.visibility)
    assert not len(different), (
        f"{len(different)} pixels, at {different[0]}: "
        f"{with_culling.visibility[tuple(different[0])]} with culling, "
        f"{without.visibility[tuple(different[0])]} without"
    )
    assert np.array_equal(with_culling.radiance, without.radiance)
    return without.visibility[without.mask]


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("name", SCENES)
def test_culling_changes_no_bit_of_an_image(name, light):
    seen = _assert_same(SCENES[name](), CAMERA, LIGHTS[light])
    assert ((seen > 0) & (seen < 1)).mean() > 0.01


@pytest.mark.parametrize("light", ["rect", "disk", "sphere"])
def test_culling_changes_no_bit_in_a_city(light):
    setup = ss.scenes.city("munich", 112, 96, light)
    seen = _assert_same(setup.scene, setup.camera, setup.light)
    assert ((seen > 0) & (seen < 1)).mean() > 0.03


@pytest.mark.parametrize("samples", [1, 7, 16, 100, 1024])
@pytest.mark.parametrize("pattern", ["per_receiver", "fixed"])
def test_culling_changes_no_bit_for_any_number_of_samples(samples, pattern):
    camera = ss.Camera((0.4, -3.0, 1.8), (-0.1, 0.1, 0.35), fov_y_deg=38, width=48, height=40)
    _assert_same(SCENES["non-manifold edges"](), camera, RECT, samples, pattern=pattern, seed=3)


@pytest.mark.parametrize("light", LIGHTS)
def test_culling_changes_no_bit_where_occluders_touch_the_light(light):
    for scene in _light_touches(LIGHTS[light]):
        seen = _assert_same(scene, CAMERA, LIGHTS[light])
        assert (seen < 1).any()


@pytest.mark.parametrize("size", [1e-3, 0.05, 3.0, 30.0])
def test_culling_changes_no_bit_under_lights_of_any_size(size):
    scene = SCENES["non-manifold edges"]()
    for light in (
        ss.RectLight((0.5, -0.3, 2.0), (0, size, 0), (size, 0, 0)),
        ss.DiskLight((0.5, -0.3, 2.0), (0, 0.2, -1), size),
        ss.SphereLight((0.5, -0.3, 2.0 + size), size),
    ):
        _assert_same(scene, CAMERA, light, 16)


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("normals", [True, False])
def test_culling_changes_no_bit_at_points_on_the_vertices_edges_and_faces_themselves(
    light, normals
):
    vertices, faces = _body(12)
    for opacity in (1.0, 0.5):
        scene = _with_ground((vertices, faces), opacity=opacity)
        corners = vertices[faces]
        points = np.concatenate([vertices, corners[:, :2].mean(axis=1), corners.mean(axis=1)])
        n = points - [0, 0, 0.7] if normals else None
        one, two = (
            ss.visibility(scene, points, n, LIGHTS[light], ss.RayTraced(32, cull=c))
            for c in (True, False)
        )
        assert np.array_equal(one, two), np.flatnonzero(one != two)
        assert ((one > 0) & (one < 1)).any()


def test_culling_changes_no_bit_at_points_scattered_through_space():
    rng = np.random.default_rng(9)
    points = rng.uniform((-1.5, -1.5, -0.5), (1.5, 1.5, 3), (4000, 3))
    for light in LIGHTS.values():
        for name in ("non-manifold edges", "open sheets"):
            scene = SCENES[name]()
            one, two = (
                ss.visibility(scene, points, None, light, ss.RayTraced(32, cull=c))
                for c in (True, False)
            )
            assert np.array_equal(one, two), np.flatnonzero(one != two)


def test_a_single_triangle_seen_edge_on_changes_no_bit():
    triangle = np.array([(0, 0, 0.5), (0, 1, 0.5), (0, 0.5, 1.5)]), np.array([[0, 1, 2]])
    scene = _with_ground(triangle)
    points = np.column_stack([np.zeros(200), np.linspace(-1, 2, 200), np.zeros(200)])
    for light in (
        ss.RectLight((0, 0.5, 2), (0, 0.5, 0), (0.5, 0, 0)),
        ss.SphereLight((0, 0.5, 2), 0.3),
    ):
        one, two = (
            ss.visibility(scene, points, None, light, ss.RayTraced(256, cull=c))
            for c in (True, False)
        )
        assert np.array_equal(one, two)
