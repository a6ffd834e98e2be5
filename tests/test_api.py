"""The public surface: names, shapes, types, progress, Ctrl-C and the interpreter lock."""

from __future__ import annotations

import dataclasses
import os
import signal
import threading
import time

import numpy as np
import pytest
import softshadow as ss
import trimesh
import typed
from clocks import Stopwatch
from shapes import bumpy, geodesic, quad

LIGHT = ss.RectLight((0.3, 0.2, 2.5), (0, 0.8, 0), (0.8, 0, 0))
LIGHTS = [LIGHT, ss.SphereLight((-1, 0, 2), 0.3), ss.DiskLight((1, 0, 2), (0, 0, -1), 0.3)]
CAMERA = ss.Camera((0.4, -3.2, 2.0), (0, 0, 0.3), width=40, height=30)


def _scene(n=8):
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (6, 0, 0), (0, 6, 0)), "ground")
    vertices, faces = bumpy(n)
    scene.add((vertices * 0.4 + [0, 0, 0.6], faces), "body")
    return scene


@pytest.fixture(scope="module")
def scene():
    return _scene()


def test_the_names_of_the_contract_exist():
    for name in (
        *("Scene", "Camera", "RectLight", "DiskLight", "SphereLight", "Image", "Hard", "RayTraced"),
        *("render", "visibility", "prepare", "method_names", "compare", "kernels", "metrics"),
        *("plot", "scenes", "mitsuba", "SceneError", "ParameterError", "UnsupportedError"),
    ):
        assert hasattr(ss, name), name
        assert name in ss.__all__
    assert all(hasattr(ss, name) for name in ss.__all__)
    for name in ss.kernels.__all__:
        assert callable(getattr(ss.kernels, name))
    for error in (ss.SceneError, ss.ParameterError, ss.UnsupportedError):
        assert issubclass(error, ValueError)


def test_method_names_are_those_that_render_takes(scene):
    names = ss.method_names()
    assert isinstance(names, tuple)
    assert {"hard", "ray_traced"} <= set(names)
    for name in names:
        assert ss.render(scene, CAMERA, LIGHT, name).visibility.shape == (30, 40)


def test_methods_are_values_with_the_agreed_defaults():
    assert ss.RayTraced() == ss.RayTraced(samples=256, seed=0, pattern="per_receiver", cull=True)
    assert ss.Hard().parameters() == {}
    assert ss.RayTraced(8).parameters()["samples"] == 8
    assert hash(ss.RayTraced(8)) != hash(ss.RayTraced(9))
    with pytest.raises(dataclasses.FrozenInstanceError):
        ss.RayTraced().samples = 3


@pytest.mark.parametrize("method", ["hard", ss.RayTraced(16)])
@pytest.mark.parametrize("several", [False, True])
def test_an_image_has_the_agreed_arrays(scene, method, several):
    image = ss.render(scene, CAMERA, LIGHTS if several else LIGHT, method)
    shape = (30, 40)
    expected = {
        "visibility": ((3, *shape) if several else shape, np.float32),
        "radiance": ((*shape, 3), np.float32),
        "mask": (shape, np.bool_),
        "position": ((*shape, 3), np.float64),
        "normal": ((*shape, 3), np.float32),
        "depth": (shape, np.float32),
        "mesh_id": (shape, np.int32),
        "triangle_id": (shape, np.int32),
    }
    for name, (size, dtype) in expected.items():
        array = getattr(image, name)
        assert (array.shape, array.dtype) == (size, dtype), name
        assert array.flags.c_contiguous
    assert 0 < image.mask.mean() < 1
    assert image.visibility.min() >= 0
    assert image.visibility.max() <= 1
    assert (image.visibility[..., ~image.mask] == 1).all()
    assert {"prepare", "frame"} <= set(image.seconds)
    assert all(isinstance(s, float) and s >= 0 for s in image.seconds.values())
    assert image.seconds["frame"] > 0
    assert isinstance(image.bytes, int)
    assert image.bytes > 720 * 36  # three single-precision corners a triangle, at least


def test_a_sequence_of_one_light_keeps_its_axis(scene):
    assert ss.render(scene, CAMERA, [LIGHT], "hard").visibility.shape == (1, 30, 40)
    assert ss.visibility(scene, [(0, 0, 0)], None, (LIGHT,), "hard").shape == (1, 1)


@pytest.mark.parametrize("method", ["hard", ss.RayTraced(16)])
def test_visibility_at_points_has_a_value_a_point_and_light(scene, method):
    points = np.random.default_rng(0).uniform(-1, 1, (70, 3))
    normals = np.tile([0, 0, 2.0], (70, 1))
    one = ss.visibility(scene, points, normals, LIGHT, method)
    assert (one.shape, one.dtype) == ((70,), np.float32)
    several = ss.visibility(scene, points, normals, LIGHTS, method)
    assert several.shape == (3, 70)
    assert np.array_equal(several[0], one)
    assert ss.visibility(scene, np.zeros((0, 3)), None, LIGHT, method).shape == (0,)
    assert ss.visibility(scene, np.zeros((0, 3)), None, LIGHTS, method).shape == (3, 0)
    # Layout and type of the arrays do not matter, nor does the length of a normal.
    for same in (np.asfortranarray(points), points[::1].tolist(), np.repeat(points, 2, 0)[::2]):
        assert np.array_equal(ss.visibility(scene, same, 0.1 * normals, LIGHT, method), one)


def test_hard_visibility_at_an_image_s_points_is_the_image_s():
    scene = _scene()
    image = ss.render(scene, CAMERA, LIGHT, "hard")
    mask = image.mask
    seen = ss.visibility(scene, image.position[mask], image.normal[mask], LIGHT, "hard")
    # Normals are rounded to single precision, which shows in the part above the tangent plane.
    assert np.abs(seen - image.visibility[mask]).max() < 1e-5


def test_preparing_once_gives_the_same_images_and_keeps_what_it_built(scene):
    prepared = ss.prepare(scene, LIGHT, ss.RayTraced(16))
    assert prepared.seconds["prepare"] >= 0
    once, again = prepared.render(CAMERA), ss.render(scene, CAMERA, LIGHT, ss.RayTraced(16))
    for name in ("visibility", "radiance", "position", "triangle_id"):
        assert np.array_equal(getattr(once, name), getattr(again, name))
    points = np.array([(0.0, 0, 0), (1, 1, 0)])
    assert np.array_equal(
        prepared.visibility(points), ss.visibility(scene, points, None, LIGHT, ss.RayTraced(16))
    )


def test_what_is_built_for_a_scene_is_kept_with_it():
    scene = _scene(100)
    first, *later = (ss.prepare(scene, LIGHT, "ray_traced").seconds["prepare"] for _ in range(4))
    # Building takes some 0.1 s for 200,000 triangles, finding it again microseconds, but where
    # another process has its turn.
    assert min(later) < 0.1 * first


def test_all_kinds_of_meshes_are_taken(tmp_path):
    vertices, faces = geodesic(3)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    group = trimesh.Scene()
    move = np.eye(4)
    move[:3, 3] = [0, 0, 0.5]
    group.add_geometry(mesh, transform=move)
    mesh.export(tmp_path / "ball.ply")
    bounds = []
    for given in (
        mesh,
        group,
        (vertices.tolist(), faces.tolist()),
        (vertices, faces.astype(np.uint8)),
    ):
        scene = ss.Scene()
        assert scene.add(given) == "mesh"
        bounds.append(scene.bounds)
        assert scene.triangle_count == len(faces)
    assert np.abs(bounds[1] - bounds[0] - [0, 0, 0.5]).max() < 1e-15
    for path in (tmp_path / "ball.ply", str(tmp_path / "ball.ply")):
        scene = ss.Scene.load(path, albedo=(0.1, 0.2, 0.3), opacity=0.5)
        assert scene.names == ("ball",)
        assert scene.entries[0].albedo == (0.1, 0.2, 0.3)
        assert scene.entries[0].opacity == 0.5
    # What a caller does to its arrays later is its own affair.
    scene = ss.Scene()
    scene.add((vertices, faces))
    before = ss.render(scene, CAMERA, LIGHT, "hard")
    vertices *= 2
    assert np.array_equal(ss.render(scene, CAMERA, LIGHT, "hard").depth, before.depth)


# ---------------------------------------------------------------- long calls

SLOW = ss.RayTraced(samples=1024, cull=False)
LARGE = ss.Camera((0.4, -3.2, 2.0), (0, 0, 0.3), width=2048, height=2048)
"""Some 20 s of work together; each test stops it after a fraction of a second."""


class _Enough(Exception):
    pass


def _stopping(after):
    """A progress callback that records what it is told and raises after so many calls."""
    told = []

    def callback(fraction):
        told.append(fraction)
        if len(told) == after:
            raise _Enough

    return told, callback


def test_progress_is_told_growing_fractions_and_its_exception_stops_the_work(scene):
    told, callback = _stopping(8)
    watch = Stopwatch()
    with pytest.raises(_Enough):
        ss.prepare(scene, LIGHT, SLOW).render(LARGE, callback)
    assert watch.longest() < 5
    assert len(told) == 8
    assert told == sorted(told)
    assert 0 <= told[0] < told[-1] < 1


def test_progress_never_goes_back_with_several_lights():
    scene = _scene(16)
    told = []
    camera = ss.Camera((0.4, -3.2, 2.0), (0, 0, 0.3), width=320, height=240)
    prepared = ss.prepare(scene, LIGHTS * 2, ss.RayTraced(samples=256, cull=False))
    prepared.render(camera, told.append)
    assert len(told) >= 4
    assert all(0 <= f <= 1 for f in told)
    assert told == sorted(told)


def test_progress_of_visibility_and_kernels(scene):
    points = np.random.default_rng(0).uniform(-1, 1, (1_000_000, 3))
    calls = {
        "visibility": lambda p: ss.visibility(scene, points, None, LIGHT, SLOW, p),
        "rasterize": lambda p: ss.kernels.rasterize(
            *bumpy(200), ss.Camera((0, -3, 1), (0, 0, 0), width=4096, height=4096), p
        ),
        "transmittance": lambda p: ss.kernels.transmittance(
            _scene(150), np.tile(points, (4, 1)), np.tile(-points, (4, 1)), p
        ),
    }
    for call in calls.values():
        told, callback = _stopping(2)
        with pytest.raises(_Enough):
            call(callback)
        assert all(0 <= f <= 1 for f in told)


def test_a_progress_bar_can_be_asked_for(scene, capsys):
    ss.render(scene, CAMERA, LIGHT, "hard", progress=True)
    assert "hard" in capsys.readouterr().err


def _seconds_to_interrupt(call, after=0.5):
    """Seconds from a SIGINT to its answer, sent after so many that all threads worked.

    Of the thread that works longest: what one waits on an idle machine, and on a busy one no more.
    """
    sent, start, over = [], Stopwatch(), threading.Event()

    def send():
        while start.seconds() < after and not over.wait(0.005):
            pass
        sent.append(Stopwatch())
        os.kill(os.getpid(), signal.SIGINT)

    sender = threading.Thread(target=send)
    sender.start()
    try:
        call()
        took = start.seconds()
        over.set()
        sender.join()
        pytest.fail(f"the call took only {took:.2f} s")
    except KeyboardInterrupt:
        return sent[0].longest() if sent else pytest.fail("interrupted from elsewhere")
    finally:
        over.set()
        sender.join()


BELOW = ss.Camera((0.4, -2.5, 0.8), (0, 0, 0.1), width=40, height=30)


def _points(n):
    rng = np.random.default_rng(1)
    return rng.uniform((-2, -2, 0), (2, 2, 0.1), (n, 3))


BUSY = {
    "render": lambda: ss.prepare(_scene(64), LIGHT, SLOW).render(LARGE),
    "render, most samples": lambda: ss.render(
        _scene(64), CAMERA, LIGHT, ss.RayTraced(samples=65536, cull=False)
    ),
    "render, most samples and veils": lambda: ss.render(
        _veils(4), BELOW, LIGHT, ss.RayTraced(samples=65536, cull=False)
    ),
    "visibility": lambda: ss.visibility(_scene(64), _points(500_000), None, LIGHT, SLOW),
    "transparent": lambda: ss.visibility(_veils(), _points(200_000), None, LIGHT, SLOW),
}


def _veils(count=40):
    scene = _scene(16)
    for k in range(count):
        scene.add(quad((0, 0, 1 + 0.02 * k), (6, 0, 0), (0, 6, 0)), opacity=0.01)
    return scene


@pytest.mark.parametrize("what", BUSY)
def test_ctrl_c_is_answered_within_a_fifth_of_a_second(what):
    assert _seconds_to_interrupt(BUSY[what]) < 0.25


@pytest.fixture(scope="module")
def million():
    return bumpy(224)


@pytest.mark.parametrize("after", [0.1, 0.3, 0.6])
def test_ctrl_c_is_answered_while_a_large_mesh_is_prepared(million, after):
    scene = ss.Scene()
    scene.add(million)

    def build():
        for _ in range(3):  # fast machines need more than one
            scene.set_vertices("mesh", million[0][::-1].copy())
            ss.prepare(scene, LIGHT)
            scene.set_vertices("mesh", million[0])
            ss.prepare(scene, LIGHT)

    assert _seconds_to_interrupt(build, after) < 0.25


def test_ctrl_c_is_answered_while_the_distorted_image_is_found():
    scene, light = _scene(64), ss.SphereLight((0.3, 0.2, 2.5), 0.4)

    def build(resolution=4096):
        return ss.prepare(scene, light, ss.Ssoc(resolution=resolution, distorted=True))

    build(64)  # with the adjacency and the ray hierarchy that later calls find
    start, watch = time.perf_counter(), Stopwatch()
    image = build().render(CAMERA)
    took, worked = time.perf_counter() - start, watch.seconds()
    # The last stage of preparing, and more than half of it: into its middle.
    after = worked * (1 - 0.5 * image.seconds["reference image"] / took)
    assert _seconds_to_interrupt(build, after) < 0.25


def test_an_interrupted_scene_still_works():
    scene = _scene(64)
    before = ss.render(scene, CAMERA, LIGHT, "hard")
    _seconds_to_interrupt(lambda: ss.prepare(scene, LIGHT, SLOW).render(LARGE), 0.3)
    assert np.array_equal(ss.render(scene, CAMERA, LIGHT, "hard").visibility, before.visibility)


def test_other_threads_run_meanwhile(scene):
    """A kernel keeps the interpreter lock for none of its time: another thread's loop goes on."""
    # A held lock leaves a gap of the whole call, 0.6 s, each time; other processes now and then.
    for _ in range(5):
        gap, count = _longest_gap(scene)
        if gap < 0.3 and count > 30:
            return
    pytest.fail(f"{count} beats, one after {gap:.2f} s")


def _longest_gap(scene):
    """The longest time that another thread does not run in during a call, and how often it runs."""
    beats, stop = [], threading.Event()

    def beat():
        while not stop.is_set():
            beats.append(time.perf_counter())
            time.sleep(0.002)

    thread = threading.Thread(target=beat)
    thread.start()
    start = time.perf_counter()
    told, callback = _stopping(12)  # called every 0.05 s
    try:
        with pytest.raises(_Enough):
            ss.prepare(scene, LIGHT, SLOW).render(LARGE, callback)
    finally:
        end = time.perf_counter()
        stop.set()
        thread.join()
    assert told
    during = [b for b in beats if start <= b <= end]
    return np.diff([start, *during, end]).max(), len(during)


def test_threads_can_share_a_scene():
    scene = _scene(16)
    expected = ss.render(scene, CAMERA, LIGHT, ss.RayTraced(64)).visibility
    results = []
    threads = [
        threading.Thread(
            target=lambda: results.append(
                ss.render(scene, CAMERA, LIGHT, ss.RayTraced(64)).visibility
            )
        )
        for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 8
    assert all(np.array_equal(r, expected) for r in results)


def test_what_a_type_checker_sees_is_so(tmp_path):
    """Linters check the types of what runs here."""
    height, brightness = typed.lights()
    assert height == 4 - 1 + 4 + 0
    assert brightness == pytest.approx(6 + 2 + 0.5 + 0.5 + 2 + 0.53)
    assert typed.pictures().dtype == np.float32
    assert typed.maps().shape == (4,)
    trimesh.creation.box().export(tmp_path / "box.glb")
    assert typed.files(str(tmp_path / "box.glb")) == ()
    assert len(typed.sweeps(str(tmp_path / "results.parquet"))) == 1
