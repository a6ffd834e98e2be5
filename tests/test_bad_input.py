"""Bad input is an error at the call that says what, where and what is allowed.

Degenerate input is normal input.
"""

from __future__ import annotations

import re

import fresh
import numpy as np
import pytest
import softshadow as ss
import trimesh
from shapes import bumpy, geodesic, quad

NAN, INF = float("nan"), float("inf")
V = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1.0)])
F = np.array([(0, 1, 2), (0, 1, 3)])
LIGHT = ss.SphereLight((0, 0, 5), 0.5)
CAMERA = ss.Camera((0, -4, 2), (0, 0, 0), width=16, height=12)


def _moved(index, value):
    vertices = V.copy()
    vertices[index] = value
    return vertices


def _raises(message, kind=ValueError):
    """The error whose message holds all of the words, in their order."""
    words = [message] if isinstance(message, str) else message
    return pytest.raises(kind, match="(?s)" + ".*".join(re.escape(w) for w in words))


# ---------------------------------------------------------------- meshes


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        ((_moved(2, (1, NAN, 0)), F), ['mesh "m"', "vertex 2", "not finite", "[1.0, NaN, 0.0]"]),
        ((_moved(3, (INF, 0, 0)), F), ['mesh "m"', "vertex 3", "not finite", "inf"]),
        ((_moved(0, (0, 0, -INF)), F), ['mesh "m"', "vertex 0", "not finite", "-inf"]),
        ((V, [(0, 1, 2), (0, 4, 1)]), ['mesh "m"', "face 1", "vertex 4", "0 to 3"]),
        ((V, [(0, 1, -1)]), ['mesh "m"', "face 0", "vertex -1", "0 to 3"]),
        ((V, np.array([(0, 2**40, 1)])), ['mesh "m"', "face 0", f"vertex {2**40}", "0 to 3"]),
        ((V, []), ['mesh "m"', "no faces", "4 vertices"]),
        ((V, np.zeros((0, 3), dtype=int)), ['mesh "m"', "no faces"]),
        ((np.zeros((0, 3)), [(0, 1, 2)]), ['mesh "m"', "face 0", "vertex 0", "0 vertices"]),
        ((np.ones((5, 3)) * 3, F), ['mesh "m"', "no extent", "2 faces", "[3.0, 3.0, 3.0]"]),
        ((V, [(1, 1, 1)]), ['mesh "m"', "no extent", "[1.0, 0.0, 0.0]"]),
        (trimesh.Trimesh(), ['mesh "m"', "no faces"]),
        ((V[:, :2], F), ["mesh", "(V, 3)", "(4, 2)"]),
        ((V.ravel(), F), ["mesh", "(V, 3)", "(12,)"]),
        ((V, F[:, :2]), ["mesh", "(F, 3)", "(2, 2)"]),
        ((V, F.ravel()), ["mesh", "(F, 3)", "(6,)"]),
        ((V, np.array([[0, 1, 2, 3]])), ["mesh", "(F, 3)", "(1, 4)"]),
        (trimesh.PointCloud(V), ["point cloud", "4 points", "triangles"]),
        (trimesh.Scene(), ["trimesh.Scene", "no triangle meshes"]),
        (trimesh.Scene(trimesh.PointCloud(V)), ["no triangle meshes", "PointCloud"]),
    ],
)
def test_bad_meshes_are_errors_that_say_what_and_where(mesh, words):
    scene = ss.Scene()
    with _raises(words):
        scene.add(mesh, name="m")
    assert scene.names == ()
    with _raises("no meshes"):
        ss.render(scene, CAMERA, LIGHT)
    scene.add((V, F), name="m")  # the name is still free
    ss.render(scene, CAMERA, LIGHT, "hard")


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        (None, ["mesh", "NoneType"]),
        (5, ["mesh", "int"]),
        ([V, F], ["mesh", "pair", "list"]),
        ((V, F, F), ["mesh", "pair", "tuple"]),
        ((V, F.astype(float)), ["mesh", "faces", "integers", "float64"]),
        ((V, F > 0), ["mesh", "faces", "integers", "bool"]),
        ((V, [("a", "b", "c")]), ["mesh", "faces", "integers"]),
        (([("a", "b", "c")], F), ["mesh", "vertices", "numbers"]),
        (("vertices", F), ["mesh", "vertices", "numbers"]),
    ],
)
def test_meshes_of_the_wrong_type_are_type_errors(mesh, words):
    with _raises(words, TypeError):
        ss.Scene().add(mesh)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"opacity": 1.5}, ['mesh "m"', "opacity", "between 0 and 1", "1.5"]),
        ({"opacity": -0.1}, ['mesh "m"', "opacity", "-0.1"]),
        ({"opacity": NAN}, ['mesh "m"', "opacity", "NaN"]),
        ({"albedo": -1}, ["mesh 'm'", "albedo", ">= 0", "-1"]),
        ({"albedo": (1, 2)}, ["mesh 'm'", "albedo", "3 RGB values", "(2,)"]),
        ({"albedo": (1, 2, NAN)}, ["mesh 'm'", "albedo", "finite", "nan"]),
    ],
)
def test_bad_looks_are_errors(options, words):
    with _raises(words):
        ss.Scene().add((V, F), name="m", **options)


def test_a_name_is_taken_once():
    scene = ss.Scene()
    scene.add((V, F), name="m")
    for add in (lambda: scene.add((V, F), name="m"), lambda: scene.add_spheres((0, 0, 0), 1, "m")):
        with _raises(['"m"', "another entry of that name"]):
            add()
    assert scene.names == ("m",)
    assert len({scene.add((V, F)), scene.add((V, F)), scene.add((V, F))}) == 3


@pytest.mark.parametrize(
    ("centers", "radii", "words"),
    [
        ((0, 0, NAN), 1, ['spheres "s"', "center 0", "not finite"]),
        ([(0, 0, 0), (INF, 0, 0)], 1, ['spheres "s"', "center 1", "not finite"]),
        ([(0, 0, 0), (1, 0, 0)], [1, 0], ['spheres "s"', "radius 1", "positive", "0"]),
        ((0, 0, 0), -2, ['spheres "s"', "radius 0", "positive", "-2"]),
        ((0, 0, 0), NAN, ['spheres "s"', "radius 0", "finite", "NaN"]),
        ([(0, 0, 0), (1, 0, 0)], [1, 2, 3], ["2 radii", "(3,)"]),
        ([(0, 0), (1, 0)], 1, ["(N, 3)", "(2, 2)"]),
        (np.zeros((0, 3)), 1, ['spheres "s"']),
    ],
)
def test_bad_spheres_are_errors(centers, radii, words):
    with _raises(words):
        ss.Scene().add_spheres(centers, radii, name="s")


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.eye(3), ["'m'", "(4, 4)", "(3, 3)"]),
        (np.diag([1, 1, 0, 1.0]), ["m", "transform", "singular"]),
        (np.diag([1, 1, NAN, 1]), ["m", "transform", "finite"]),
        (np.diag([1, 1, 1, 2.0]), ["transform", "0 0 0 1"]),
        (np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1.0]]), ["transform"]),
        (np.diag([1e308, 1e308, 1e308, 1]) @ np.eye(4), ["m"]),
    ],
)
def test_bad_transforms_are_errors_and_change_nothing(matrix, words):
    scene = ss.Scene()
    scene.add((V * 100, F), name="m")
    before = ss.render(scene, CAMERA, LIGHT, "hard")
    with _raises(words):
        scene.set_transform("m", matrix)
        ss.render(scene, CAMERA, LIGHT, "hard")  # where only the world coordinates overflow
    scene.set_transform("m", np.eye(4))
    assert np.array_equal(ss.render(scene, CAMERA, LIGHT, "hard").depth, before.depth)


def test_bad_new_vertices_are_errors_and_change_nothing():
    scene = ss.Scene()
    welded = np.concatenate([V, V[:1]])  # vertex 4 is vertex 0
    scene.add((welded, F), name="m")
    before = ss.render(scene, CAMERA, LIGHT, "hard")
    torn = welded.copy()
    torn[4, 0] = 0.5
    for vertices, words in [
        (V, ['mesh "m"', "5 vertices", "4"]),
        (np.where(welded == 1, NAN, welded), ['mesh "m"', "vertex 1", "not finite"]),
        (welded * 0, ['mesh "m"', "no extent"]),
        (torn, ['mesh "m"', "vertices 0 and 4", "equal"]),
        (welded[:, :2], ["(V, 3)"]),
    ]:
        with _raises(words):
            scene.set_vertices("m", vertices)
        assert np.array_equal(scene.entries[0].vertices, welded)
    assert np.array_equal(ss.render(scene, CAMERA, LIGHT, "hard").depth, before.depth)
    scene.add_spheres((0, 0, 3), 1, "s")
    for name in ("nobody", "s"):
        with _raises(name):
            scene.set_vertices(name, welded)
        with _raises(name):
            scene.set_transform(name, np.eye(4))


# ---------------------------------------------------------------- files


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("broken.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n"),
        ("noise.stl", bytes(range(256)) * 3),
        ("empty.obj", b""),
        ("text.unknown", b"no mesh"),
        ("points.ply", trimesh.PointCloud(V).export(file_type="ply")),
    ],
)
def test_a_file_that_is_no_mesh_is_an_error_that_names_it(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with _raises(name):
        ss.Scene().add(tmp_path / name)


def test_a_path_without_a_file_is_an_error_that_names_it(tmp_path):
    for path in (tmp_path / "missing.ply", str(tmp_path / "missing.ply"), tmp_path):
        with _raises([str(path), "no such file"]):
            ss.Scene.load(path)
    with _raises("no such file"):
        ss.Scene.load("")


def test_a_file_with_a_bad_face_names_the_mesh(tmp_path):
    lines = ["ply", "format ascii 1.0", "element vertex 3", "property float x", "property float y"]
    lines += ["property float z", "element face 1", "property list uchar int vertex_indices"]
    lines += ["end_header", "0 0 0", "1 0 0", "0 1 0", "3 0 1 7"]
    (tmp_path / "bad.ply").write_text("\n".join(lines) + "\n")
    with _raises("bad"):
        ss.Scene().add(tmp_path / "bad.ply")


# ---------------------------------------------------------------- lights and cameras


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ss.RectLight((0, 0, NAN), (1, 0, 0), (0, 1, 0)), ["RectLight.center", "finite"]),
        (lambda: ss.RectLight((0, 0, 1), (1, 0), (0, 1, 0)), ["RectLight.edge_u", "3 numbers"]),
        (lambda: ss.RectLight((0, 0, 1), (1, 0, 0), (INF, 1, 0)), ["RectLight.edge_v", "inf"]),
        (lambda: ss.RectLight((0, 0, 1), (1, 0, 0), (2, 0, 0)), ["RectLight", "no area"]),
        (lambda: ss.RectLight((0, 0, 1), (1, 0, 0), (0, 0, 0)), ["RectLight", "no area"]),
        (lambda: ss.RectLight((0, 0, 1), (1, 0, 0), (0, 1, 0), -1), ["RectLight.radiance", ">= 0"]),
        (lambda: ss.RectLight((0, 0, 1), (1, 0, 0), (0, 1, 0), (1, 1)), ["RectLight.radiance"]),
        (lambda: ss.DiskLight((0, 0, 1), (0, 0, 0), 1), ["DiskLight", "normal", "zero"]),
        (lambda: ss.DiskLight((0, 0, 1), (0, 0, 1), -1), ["DiskLight", "radius", "-1"]),
        (lambda: ss.DiskLight((0, 0, 1), (0, 0, 1), NAN), ["DiskLight", "finite"]),
        (lambda: ss.SphereLight((0, 0, 1), -0.5), ["SphereLight", "radius", "-0.5"]),
        (lambda: ss.DistantLight((0, 0, 1), 180), ["DistantLight", "angle_deg", "180"]),
        (lambda: ss.SphereLight((0, 0, 1), INF), ["SphereLight", "finite"]),
        (lambda: ss.SphereLight((0, 0, 1), 1, NAN), ["SphereLight.radiance", "finite", "nan"]),
        (lambda: ss.Camera((0, 0, 0), (0, 0, 0)), ["Camera", "same point"]),
        (lambda: ss.Camera((0, 0, NAN), (0, 0, 0)), ["Camera.eye", "finite"]),
        (lambda: ss.Camera((0, 0, 1), (0, 0, 0), (0, 0, 1)), ["Camera.up", "parallel"]),
        (lambda: ss.Camera((0, 1, 1), (0, 0, 0), (0, 0, 0)), ["Camera.up", "zero"]),
        (lambda: ss.Camera((0, 1, 1), (0, 0, 0), fov_y_deg=0), ["Camera.fov_y_deg", "0"]),
        (lambda: ss.Camera((0, 1, 1), (0, 0, 0), fov_y_deg=180), ["Camera.fov_y_deg", "180"]),
        (lambda: ss.Camera((0, 1, 1), (0, 0, 0), fov_y_deg=NAN), ["Camera.fov_y_deg", "nan"]),
        (lambda: ss.Camera((0, 1, 1), (0, 0, 0), width=0), ["Camera", "width", "1 to 65536", "0"]),
        (lambda: ss.Camera((0, 1, 1), (0, 0, 0), height=-3), ["Camera", "height", "-3"]),
        (lambda: ss.Camera((0, 1, 1), (0, 0, 0), width=65537), ["Camera", "width", "65537"]),
        (lambda: ss.Camera.from_matrix(np.eye(2), np.eye(4), 4, 4), ["Camera.K", "(3, 3)"]),
        (lambda: ss.Camera.from_matrix(np.eye(3), np.eye(3), 4, 4), ["camera_to_world", "(4, 4)"]),
        (lambda: ss.Camera.from_matrix(-np.eye(3), np.eye(4), 4, 4), ["Camera", "K"]),
        (
            lambda: ss.Camera.from_matrix(np.eye(3), np.diag([2, 2, 2, 1.0]), 4, 4),
            ["pose", "rotation"],
        ),
        (lambda: ss.Camera.from_matrix(np.eye(3), np.diag([1, 1, -1, 1.0]), 4, 4), ["rotation"]),
        (lambda: ss.Camera.from_matrix(np.eye(3) * NAN, np.eye(4), 4, 4), ["Camera", "finite"]),
    ],
)
def test_bad_lights_and_cameras_are_errors_at_construction(make, words):
    with _raises(words):
        make()


# ---------------------------------------------------------------- methods and points


@pytest.fixture(scope="module")
def scene():
    scene = ss.Scene()
    scene.add((V, F), "m")
    return scene


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ("wedge", ["method", "'wedge'", "hard", "ray_traced"]),
        ("", ["method", "''"]),
        (lambda: ss.RayTraced(samples=0), ["RayTraced", "samples", "1 to 65536", "0"]),
        (lambda: ss.RayTraced(samples=65537), ["RayTraced", "samples", "65537"]),
        (
            lambda: ss.RayTraced(pattern="random"),
            ["RayTraced", "pattern", "per_receiver", "random"],
        ),
    ],
)
def test_bad_methods_are_errors(scene, method, words):
    with _raises(words):
        ss.render(scene, CAMERA, LIGHT, method() if callable(method) else method)


@pytest.mark.parametrize("seed", [-1, 2**64])
def test_seeds_out_of_range_are_errors(scene, seed):
    with pytest.raises((ValueError, OverflowError)):
        ss.render(scene, CAMERA, LIGHT, ss.RayTraced(seed=seed))


def test_things_of_the_wrong_type_are_type_errors(scene):
    for words, call in [
        ("scene", lambda: ss.render(V, CAMERA, LIGHT)),
        ("camera", lambda: ss.render(scene, "front", LIGHT)),
        ("light", lambda: ss.render(scene, CAMERA, "sun")),
        ("light", lambda: ss.render(scene, CAMERA, [])),
        ("light", lambda: ss.render(scene, CAMERA, [LIGHT, 3])),
        ("method", lambda: ss.render(scene, CAMERA, LIGHT, 3)),
        ("method", lambda: ss.render(scene, CAMERA, LIGHT, ss.RayTraced)),
        ("faces", lambda: ss.kernels.rasterize(V, F.astype(float), CAMERA)),
    ]:
        with _raises(words, TypeError):
            call()


@pytest.mark.parametrize(
    ("points", "normals", "words"),
    [
        ([(0, 0, 0), (0, NAN, 0)], None, ["points", "point 1", "not finite"]),
        ([(0, 0, 0), (0, 0, INF)], None, ["points", "point 1", "not finite"]),
        ([(0, 0, 0)], [(0, 0, NAN)], ["normals", "normal 0", "not finite"]),
        ([(0, 0, 0), (1, 1, 1)], [(0, 0, 1), (0, 0, 0)], ["normals", "normal 1", "zero"]),
        ([(0, 0, 0)], [(0, 0, 1), (0, 0, 1)], ["normals", "(1, 3)", "(2, 3)"]),
        ([(0, 0)], None, ["points", "(N, 3)", "(1, 2)"]),
        ((0, 0, 0), None, ["points", "(N, 3)", "(3,)"]),
    ],
)
def test_bad_points_are_errors(scene, points, normals, words):
    for method in ("hard", "ray_traced"):
        with _raises(words):
            ss.visibility(scene, points, normals, LIGHT, method)


BAD = _moved(1, (NAN, 0, 0))


@pytest.mark.parametrize(
    ("words", "call"),
    [
        (["vertex 1", "not finite"], lambda scene: ss.kernels.rasterize(BAD, F, CAMERA)),
        (["face 0", "vertex 9"], lambda scene: ss.kernels.mesh_edges(V, [(0, 1, 9)])),
        (
            ["face 0", "vertex -2"],
            lambda scene: ss.kernels.silhouette_edges(V, [(0, 1, -2)], (0, 0, 9)),
        ),
        (["no faces"], lambda scene: ss.kernels.rasterize(V, np.zeros((0, 3), int), CAMERA)),
        (["no faces"], lambda scene: ss.kernels.rasterize(V, [], CAMERA)),
        (["viewpoint", "finite"], lambda scene: ss.kernels.silhouette_edges(V, F, (0, 0, NAN))),
        (["viewpoint", "finite"], lambda scene: ss.kernels.silhouette_loops(V, F, (0, 0, INF))),
        (["origins", "point 1"], lambda scene: ss.kernels.transmittance(scene, BAD, V)),
        (["targets", "point 1"], lambda scene: ss.kernels.transmittance(scene, V, BAD)),
        (["targets", "4", "3"], lambda scene: ss.kernels.transmittance(scene, V, V[:3])),
        (["points", "point 1"], lambda scene: ss.kernels.light_fraction_above(LIGHT, BAD)),
        (["normals", "normal 1"], lambda scene: ss.kernels.unshadowed_irradiance(LIGHT, V, BAD)),
        (
            ["samples", "1 to 65536", "0"],
            lambda scene: ss.kernels.light_samples(LIGHT, (0, 0, 0), 0),
        ),
        (["point", "finite"], lambda scene: ss.kernels.light_samples(LIGHT, (0, 0, INF))),
        (["faces"], lambda scene: ss.kernels.mesh_edges(V, F[0])),
        (["faces"], lambda scene: ss.kernels.mesh_edges(V, F[:, :2])),
    ],
)
def test_kernels_check_what_they_get(scene, words, call):
    with _raises(words):
        call(scene)


def test_an_image_too_big_for_memory_is_an_error():
    """In a process that may have 3 GB; the image's arrays would take 300."""
    program = """
        import resource
        import softshadow as ss
        scene = ss.Scene()
        scene.add_spheres((0, 0, 0), 1)
        camera = ss.Camera((0, -4, 2), (0, 0, 0), width=65536, height=65536)
        resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
        try:
            ss.render(scene, camera, ss.SphereLight((0, 0, 5), 0.5), "hard")
        except (ValueError, MemoryError) as error:
            print("refused:", error)
    """
    done = fresh.run(program, seconds=60)
    assert done.returncode == 0, (done.returncode, done.stderr[-300:])
    assert done.stdout.startswith("refused:")
    assert "65536" in done.stdout


# ---------------------------------------------------------------- degenerate input works


def _render_all(scene, camera=CAMERA, light=LIGHT):
    for method in ("hard", ss.RayTraced(16), ss.RayTraced(16, cull=False)):
        image = ss.render(scene, camera, light, method)
        assert np.isfinite(image.radiance).all()
        assert np.isfinite(image.position).all()
        assert (image.visibility >= 0).all()
        assert (image.visibility <= 1).all()
        length = np.linalg.norm(image.normal[image.mask], axis=-1)
        assert np.abs(length - 1).max(initial=0) < 1e-6
    return image


def test_zero_area_triangles_and_duplicate_faces_change_no_bit():
    vertices, faces = geodesic(5)
    plain, worse = ss.Scene(), ss.Scene()
    plain.add((vertices, faces))
    a, b = faces[:50, 0], faces[:50, 1]
    flat = np.concatenate([np.column_stack([a, a, b]), np.column_stack([b, b, b])])
    worse.add((vertices, np.concatenate([faces, flat, faces])))
    ground = quad((0, 0, -1), (6, 0, 0), (0, 6, 0))
    plain.add(ground)
    worse.add(ground)
    one, two = _render_all(plain), _render_all(worse)
    assert np.array_equal(one.visibility, two.visibility)
    assert np.array_equal(one.triangle_id, two.triangle_id)
    assert np.array_equal(one.radiance, two.radiance)


def test_a_mesh_of_zero_area_triangles_only_is_not_seen_and_casts_nothing():
    scene = ss.Scene()
    scene.add((V, [(0, 1, 1), (0, 0, 2)]), "lines")
    scene.add(quad((0, 0, -1), (6, 0, 0), (0, 6, 0)))
    image = _render_all(scene)
    assert set(np.unique(image.mesh_id)) == {-1, 1}
    assert (image.visibility == 1).all()


def test_open_and_non_manifold_meshes_work():
    vertices, faces = bumpy(6)
    rng = np.random.default_rng(0)
    extra = rng.integers(len(vertices), size=(60, 3))
    scene = ss.Scene()
    scene.add((vertices, np.concatenate([faces[rng.random(len(faces)) < 0.7], extra])))
    image = _render_all(scene)
    assert (image.visibility[image.mask] < 1).any()


def test_unused_vertices_do_not_matter_however_far_away():
    scene, other = ss.Scene(), ss.Scene()
    scene.add((V, F))
    other.add((np.concatenate([V, [(1e30, 0, 0), (0, -1e300, 5)]]), F))
    one, two = _render_all(scene), _render_all(other)
    assert np.array_equal(one.visibility, two.visibility)
    assert np.array_equal(one.depth, two.depth)


def test_a_camera_inside_an_object_sees_it_from_inside():
    scene = ss.Scene()
    scene.add(trimesh.creation.box((4, 4, 4)))
    scene.add((geodesic(4)[0] * 0.3, geodesic(4)[1]))
    image = _render_all(scene, ss.Camera((1, -1, 0.5), (0, 0, 0), width=16, height=12))
    assert image.mask.all()
    assert (image.visibility == 0).all()  # the light is outside
    image = _render_all(
        scene,
        ss.Camera((1, -1, 0.5), (0, 0, 0), width=16, height=12),
        ss.SphereLight((0, 1, 1), 0.1),
    )
    assert (image.visibility == 1).any()


def test_lights_of_size_zero_are_points():
    scene = ss.Scene()
    scene.add(quad((0, 0, -1), (6, 0, 0), (0, 6, 0)))
    scene.add((geodesic(4)[0] * 0.5, geodesic(4)[1]))
    for light in (ss.SphereLight((0.5, 0, 3), 0), ss.DiskLight((0.5, 0, 3), (0, 0, -1), 0)):
        image = _render_all(scene, light=light)
        assert set(np.unique(image.visibility)) == {0, 1}
        hard = ss.render(scene, CAMERA, light, "hard")
        assert np.array_equal(hard.visibility, image.visibility)


def test_a_scene_far_smaller_than_its_offset_is_refused_or_right():
    """Ten ulps wide in f64: its shape is gone, but nothing breaks."""
    scene = ss.Scene()
    scene.add((V * 1e-14 + 1.0, F))
    camera = ss.Camera((1, 0.5, 1), (1, 1, 1), width=8, height=8)
    _render_all(scene, camera, ss.SphereLight((1, 1, 2), 0.1))
    scene = ss.Scene()
    scene.add((V * 1e-20, F))
    scene.set_transform(
        "mesh", np.array([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 1.0]])
    )
    with _raises("one world point"):
        ss.render(scene, camera, LIGHT)
