"""Random and degenerate scenes thrown at the public functions.

Vertices lie on a small grid of integers, so that coincident vertices, zero-area, duplicate and
coplanar faces, edges seen end-on, lights in the plane of a face and receivers on a surface are
common, not rare. Whatever the input: an answer in range, or an error that says what is wrong; never
a panic (a RuntimeError), NaN or hang, and the same bits with culling as without.
"""

from __future__ import annotations

from datetime import timedelta
from fractions import Fraction

import numpy as np
import softshadow as ss
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st


def examples(count):
    """Reproducible, and a hang is a deadline missed by far: the slowest example takes 0.1 s."""
    return settings(
        max_examples=count,
        deadline=timedelta(seconds=5),
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
        derandomize=True,
        database=None,
    )


coordinate = st.integers(-2, 2)
point = st.tuples(coordinate, coordinate, coordinate)
# Half steps and odd numbers too, for lights and receivers beside the grid.
loose = st.one_of(point, st.tuples(*[st.sampled_from([-1.5, -0.3, 0.0, 0.25, 0.5, 1.0, 2.7])] * 3))


@st.composite
def meshes(draw):
    vertices = draw(st.lists(point, min_size=2, max_size=7))
    index = st.integers(0, len(vertices) - 1)
    faces = draw(st.lists(st.tuples(index, index, index), min_size=1, max_size=10))
    used = {vertices[i] for face in faces for i in face}
    assume(len(used) > 1)
    return np.array(vertices, dtype=np.float64), np.array(faces)


@st.composite
def scenes(draw):
    scene = ss.Scene()
    for vertices, faces in draw(st.lists(meshes(), min_size=1, max_size=3)):
        opacity = draw(st.sampled_from([1.0, 1.0, 0.5, 0.0]))
        casts, receives = draw(st.sampled_from([True, True, False])), draw(st.booleans())
        scene.add((vertices, faces), opacity=opacity, casts=casts, receives=receives)
    if draw(st.integers(0, 4)) == 0:
        radius = draw(st.sampled_from([0.25, 1.0, 3.0]))
        scene.add_spheres(draw(loose), radius, opacity=draw(st.sampled_from([1.0, 0.5])))
    return scene


@st.composite
def lights(draw):
    kind, center = draw(st.sampled_from(["rect", "disk", "sphere"])), draw(loose)
    if kind == "sphere":
        return ss.SphereLight(center, draw(st.sampled_from([0.0, 1e-6, 0.25, 1.0, 2.0, 50.0])))
    if kind == "disk":
        normal = draw(loose.filter(any))
        return ss.DiskLight(center, normal, draw(st.sampled_from([0.0, 1e-6, 0.5, 1.0, 50.0])))
    u, v = draw(loose), draw(loose)
    size = draw(st.sampled_from([1e-6, 0.5, 1.0, 30.0]))
    assume(np.linalg.norm(np.cross(u, v)) > 0)
    return ss.RectLight(center, size * np.array(u), size * np.array(v))


@st.composite
def cameras(draw):
    eye, target = draw(loose), draw(loose)
    away = np.subtract(target, eye).astype(float)
    assume(np.linalg.norm(away) > 0)
    up = draw(point.filter(any))
    assume(np.linalg.norm(np.cross(away, up)) > 1e-6)
    fov = draw(st.sampled_from([1.0, 40.0, 90.0, 175.0]))
    width, height = draw(st.integers(1, 20)), draw(st.integers(1, 12))
    return ss.Camera(eye, target, up, fov, width, height)


def _check_image(image, scene):
    mask = image.mask
    for array in (image.visibility, image.radiance, image.position, image.normal):
        assert np.isfinite(array).all()
    assert (image.visibility >= 0).all()
    assert (image.visibility <= 1).all()
    assert (image.visibility[~mask] == 1).all()
    assert (image.radiance >= 0).all()
    assert (image.depth[mask] > 0).all()
    assert np.isinf(image.depth[~mask]).all()
    length = np.linalg.norm(image.normal[mask], axis=-1)
    assert np.abs(length - 1).max(initial=0) < 1e-6
    assert ((image.mesh_id >= 0) == mask).all()
    assert ((image.triangle_id >= 0) == mask).all()
    for number, entry in enumerate(scene.entries):
        parts = len(entry.faces) if isinstance(entry, ss.Mesh) else len(entry.radii)
        ids = image.triangle_id[image.mesh_id == number]
        assert (ids < parts).all()
    assert (image.mesh_id < len(scene.entries)).all()


@examples(250)
@given(scenes(), cameras(), lights(), st.sampled_from([1, 3, 16, 40]), st.integers(0, 3))
def test_images_of_anything_are_in_range_and_culling_changes_no_bit(
    scene, camera, light, samples, seed
):
    _check_image(ss.render(scene, camera, light, "hard"), scene)
    one, two = (
        ss.render(scene, camera, light, ss.RayTraced(samples, seed, cull=cull))
        for cull in (True, False)
    )
    _check_image(one, scene)
    assert np.array_equal(one.visibility, two.visibility)
    assert np.array_equal(one.radiance, two.radiance)


@examples(250)
@given(
    scenes(),
    st.lists(loose, min_size=1, max_size=40),
    st.none() | loose.filter(any),
    lights(),
    st.sampled_from(["per_receiver", "fixed"]),
)
def test_visibility_at_any_points_is_in_range_and_culling_changes_no_bit(
    scene, points, normal, light, pattern
):
    normals = None if normal is None else [normal] * len(points)
    hard = ss.visibility(scene, points, normals, light, "hard")
    h = ss.kernels.light_fraction_above(light, points, normals)
    assert ((h >= 0) & (h <= 1)).all()
    assert ((hard >= 0) & (hard <= h + 1e-6)).all()
    one, two = (
        ss.visibility(scene, points, normals, light, ss.RayTraced(24, pattern=pattern, cull=cull))
        for cull in (True, False)
    )
    assert ((one >= 0) & (one <= 1)).all()
    assert np.array_equal(one, two)
    assert (one[h == 0] == 0).all()


@examples(150)
@given(meshes(), cameras())
def test_the_rasteriser_answers_for_any_mesh(mesh, camera):
    vertices, faces = mesh
    ids, depth = ss.kernels.rasterize(vertices, faces, camera)
    assert ids.min() >= -1
    assert ids.max() < len(faces)
    assert not np.isnan(depth).any()
    assert ((ids >= 0) == np.isfinite(depth)).all()
    assert (depth > 0).all()
    corners = vertices[faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    # Integers are exact, and so is that a triangle without area has none: it covers no pixel...
    seen = np.unique(ids[ids >= 0])
    assert (area[seen] > 0).all()
    # ... and no pixel is nearer or farther than the triangle that it shows.
    z = (corners - camera.eye) @ camera.camera_to_world[:3, 2]
    for t in seen:
        d = depth[ids == t]
        assert (d <= z[t].max() * (1 + 1e-6) + 1e-9).all()
        assert (d >= z[t].min() * (1 - 1e-6) - 1e-9).all()


@examples(150)
@given(scenes(), st.lists(st.tuples(loose, loose), min_size=1, max_size=40))
def test_segments_through_anything_keep_a_product_of_transmittances(scene, segments):
    origins, targets = np.array(segments, dtype=np.float64).transpose(1, 0, 2)
    through = ss.kernels.transmittance(scene, origins, targets)
    assert ((through >= 0) & (through <= 1)).all()
    # Opacities here are 0, 0.5 and 1.
    powers = np.log2(through[through > 0])
    assert (powers == np.round(powers)).all()
    # Nothing depends on the direction of travel but the choice between triangles at an edge; and
    # a segment of no length crosses nothing.
    assert (ss.kernels.transmittance(scene, origins, origins) == 1).all()


@examples(150)
@given(meshes(), loose)
def test_edges_and_silhouettes_of_anything_are_consistent(mesh, viewpoint):
    vertices, faces = mesh
    edges, counts = ss.kernels.mesh_edges(vertices, faces)
    assert (edges[:, 0] < edges[:, 1]).all()
    assert len(np.unique(edges, axis=0)) == len(edges)
    # Every index stands for the first vertex at its position; faces that repeat one have no edges.
    first = [next(i for i, w in enumerate(vertices) if (w == v).all()) for v in vertices]
    expected = {}
    for face in np.array(first)[faces].tolist():
        if len(set(face)) == 3:
            for k in range(3):
                side = tuple(sorted((face[k], face[k - 1])))
                expected[side] = expected.get(side, 0) + 1
    assert {tuple(e) for e in edges.tolist()} == set(expected)
    for edge, count in zip(edges.tolist(), counts, strict=True):
        assert count == expected[tuple(edge)]
    found, windings = ss.kernels.silhouette_edges(vertices, faces, viewpoint)
    known = {tuple(e) for e in edges.tolist()}
    assert all(tuple(e) in known for e in found.tolist())
    # As much enters every vertex as leaves it.
    balance = np.zeros(len(vertices), dtype=int)
    np.add.at(balance, found[:, 0], windings)
    np.add.at(balance, found[:, 1], -windings)
    assert (balance == 0).all()


def _layers(vertices, faces, viewpoint):
    """For every directed edge, the layers of each kind on its left: a dict of front, back."""
    first = [next(i for i, w in enumerate(vertices) if (w == v).all()) for v in vertices]
    layers = {}
    exact = [[Fraction(float(x)) for x in p] for p in [*vertices, viewpoint]]
    for face in np.array(first)[faces].tolist():
        a, b, c = ([x - y for x, y in zip(exact[v], exact[-1], strict=True)] for v in face)
        volume = (
            a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
        )
        if len(set(face)) < 3 or volume == 0:
            continue
        # A face that faces away runs clockwise as the viewpoint sees it.
        kind, order = (0, face) if volume < 0 else (1, face[::-1])
        for k in range(3):
            for sign, edge in ((1, (order[k - 1], order[k])), (-1, (order[k], order[k - 1]))):
                layers.setdefault(edge, [0, 0])[kind] += sign
    return {edge: tuple(n) for edge, n in layers.items() if any(n)}


@examples(300)
@given(meshes(), loose)
@example(
    (np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0)]), [(0, 1, 2), (0, 1, 3)]), (0, 0, 1)
)
def test_loops_use_every_silhouette_edge_once_a_layer(mesh, viewpoint):
    vertices, faces = mesh
    expected = _layers(vertices, faces, viewpoint)
    edges, windings = ss.kernels.silhouette_edges(vertices, faces, viewpoint)
    pairs = [tuple(e) for e in edges.tolist()]
    assert pairs == sorted(e for e in expected if e[0] < e[1])
    assert windings.tolist() == [sum(expected[e]) for e in pairs]
    one_kind = all(front == back for front, back in expected.values())
    wanted = {
        edge: max(front, 0) + (0 if one_kind else max(back, 0))
        for edge, (front, back) in expected.items()
        if front > 0 or back > 0
    }
    used = {}
    for loop in ss.kernels.silhouette_loops(vertices, faces, viewpoint):
        assert loop.dtype == np.int32
        for edge in zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True):
            used[edge] = used.get(edge, 0) + 1
    assert used == wanted


@examples(150)
@given(lights(), st.lists(loose, min_size=1, max_size=10), loose.filter(any), st.integers(1, 40))
def test_lights_answer_anywhere(light, points, normal, samples):
    normals = [normal] * len(points)
    h = ss.kernels.light_fraction_above(light, points, normals)
    e = ss.kernels.unshadowed_irradiance(light, points, normals)
    assert ((h >= 0) & (h <= 1)).all()
    assert ((e >= 0) & (e <= np.pi * (1 + 1e-9))).all()
    assert (e[h == 0] == 0).all()
    for p in points[:2]:
        where, weights, colours = ss.kernels.light_samples(light, p, samples)
        assert where.shape == colours.shape == (samples, 3)
        assert np.isfinite(where).all()
        assert np.isfinite(weights).all()
        assert (weights >= 0).all()


@examples(100)
@given(
    st.lists(st.floats(-1e300, 1e300), min_size=9, max_size=9),
    st.floats(-1e300, 1e300),
    st.floats(0, 1e300),
    st.floats(1e-300, 1e300),
)
@example([0, 0, 0, 1e-300, 0, 0, 0, 1e-300, 0], 1.0, 0.5, 1.0)
@example([1e300, 0, 0, -1e300, 0, 0, 0, 1e300, 0], 1.0, 0.5, 1.0)
@example([0.0, 0, 0, 1, 0, 0, 0, 1, 0], 1e300, 1.0, 1e300)
@example([0.0, 0, 0, 1e-40, 0, 0, 0, 1e-40, 0], 1.0, 1e30, 1.0)
def test_numbers_of_any_size_give_an_answer_in_range_or_an_error(numbers, height, radius, reach):
    """Coordinates from the smallest to nearly the largest, all in one scene."""
    vertices = np.array(numbers).reshape(3, 3)
    try:
        scene = ss.Scene()
        scene.add((vertices, [(0, 1, 2)]))
        camera = ss.Camera((reach, 0.5, 0.25), (0, 0, 0), width=4, height=4)
        flat = ss.DiskLight((0.5, 0.25, height), (0.1, 0, -1), radius)
        for light in (flat, ss.SphereLight((0.5, 0.25, height), radius)):
            for method in ("hard", ss.RayTraced(4), ss.RayTraced(4, cull=False)):
                image = ss.render(scene, camera, light, method)
                assert ((image.visibility >= 0) & (image.visibility <= 1)).all()
                seen = ss.visibility(scene, [(0.0, 0, 0), numbers[:3]], None, light, method)
                assert ((seen >= 0) & (seen <= 1)).all()
    except ValueError as error:
        assert str(error)  # noqa: PT017
