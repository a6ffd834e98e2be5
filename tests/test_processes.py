"""Processes of every kind work after use in the parent, and threads can be limited."""

from __future__ import annotations

import concurrent.futures
import contextlib
import multiprocessing
import os
import pickle
import re
import signal
import threading
import time

import fresh
import numpy as np
import pytest
import softshadow as ss
from shapes import bumpy, quad
from small_methods import methods

LIGHT = ss.RectLight((0, 0, 4), (0, 0.5, 0), (0.5, 0, 0))
CAMERA = ss.Camera((0, -4, 3), (0, 0, 0.3), width=48, height=32)
METHOD = ss.RayTraced(samples=16)
SAME_BITS = {"auto": {"engine": "ray_traced"}}
METHODS = methods(ss.method_names(), SAME_BITS, resolution=256, max_size=128)
PATIENCE = 60
"""Seconds after which a child hangs; it needs two."""


def _scene(size=12):
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), "ground")
    vertices, faces = bumpy(size)
    scene.add((vertices * 0.4 + [0, 0, 0.8], faces), "ball")
    return scene


def _picture(scene=None):
    return ss.render(scene or _scene(), CAMERA, LIGHT, METHOD).visibility


def _everything(scene, prepared):
    """Whatever uses threads, with what the parent made and with what is new."""
    points, normals = np.tile([[0.3, 0, 0.0]], (500, 1)), np.tile([[0, 0, 1.0]], (500, 1))
    mesh = bumpy(12)
    out = [
        prepared.render(CAMERA).radiance,
        prepared.visibility(points, normals),
        _picture(scene),
        _picture(scene.copy()),
        _picture(),
        ss.kernels.transmittance(scene, points + 1e-3, points + 4.0),
        ss.kernels.unshadowed_irradiance(LIGHT, points, normals),
        ss.kernels.light_fraction_above(LIGHT, points, normals),
        ss.kernels.mesh_edges(*mesh)[0],
        ss.kernels.silhouette_edges(*mesh, (0, 0, 9))[0],
        ss.kernels.rasterize(*mesh, CAMERA)[1],
        ss.kernels.curve_tubes([(0, 0, 0), (0, 0, 1)], [0, 2], 0.1)[0],
        ss.kernels.accumulate(*mesh, [(0, 0, 9)], (-2, -2, -1), (4, 0, 0), (0, 4, 0), (16, 16)),
        ss.bake(scene, LIGHT, "ground", max_size=16)[0].radiance,
        *(ss.render(_small(), CAMERA, LIGHT, m).visibility for m in METHODS.values()),
    ]
    return [np.asarray(a) for a in out]


def _small():
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)))
    scene.add(quad((0, 0, 1), (1, 0, 0), (0, 1, 0)))
    return scene


def _forked(work, patience=PATIENCE):
    """What `work` returns in a forked child; fails where the child hangs."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        try:
            answer = work()
        except BaseException as error:
            answer = error
        with os.fdopen(write, "wb") as stream:
            pickle.dump(answer, stream)
        os._exit(0)
    os.close(write)
    timer = threading.Timer(patience, os.kill, (child, signal.SIGKILL))
    timer.start()
    try:
        with os.fdopen(read, "rb") as stream:
            data = stream.read()
    finally:
        timer.cancel()
        os.waitpid(child, 0)
    assert data, f"the child hung for {patience} s"
    answer = pickle.loads(data)
    if isinstance(answer, BaseException):
        raise answer
    return answer


needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
pytestmark = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")


@needs_fork
def test_a_forked_child_can_use_everything_and_has_the_same_bits():
    scene = _scene()
    prepared = ss.prepare(scene, LIGHT, METHOD)
    here = _everything(scene, prepared)
    for _ in range(2):
        there = _forked(lambda: _everything(scene, prepared))
        for a, b in zip(here, there, strict=True):
            assert np.array_equal(a, b)
    assert np.array_equal(_picture(scene), here[2])  # and the parent goes on


@needs_fork
def test_a_grandchild_works_and_a_child_has_threads_of_its_own():
    expected = _picture()

    def child():
        names = _forked(lambda: (_picture(), _names_of_threads()))
        return names, _picture(), _names_of_threads()

    (grand, its), own, names = _forked(child)
    assert np.array_equal(grand, expected)
    assert np.array_equal(own, expected)
    for found in (its, names):
        # Those of the pool; the kernel's own thread may still be on its way to its end.
        pool = [name for name in found if re.fullmatch(r"softshadow \d+", name)]
        assert len(pool) == ss.thread_count()


def _names_of_threads():
    tasks = "/proc/self/task"
    if not os.path.isdir(tasks):
        pytest.skip("no /proc here")
    names = []
    for task in os.listdir(tasks):
        with open(f"{tasks}/{task}/comm") as stream:
            names.append(stream.read().strip())
    return names


@needs_fork
def test_no_kernel_runs_on_threads_that_do_not_survive_a_fork():
    code = """
        import os
        import test_processes as t
        def others():
            folder = "/proc/self/task/"
            tasks = {i: open(f"{folder}{i}/comm").read() for i in os.listdir(folder)}
            return {i for i, name in tasks.items() if not name.startswith("softshadow")}
        before = others()
        scene = t._scene()
        t._everything(scene, t.ss.prepare(scene, t.LIGHT, t.METHOD))
        assert others() <= before, others() - before
    """
    done = fresh.run(code)
    assert done.returncode == 0, done.stderr


@needs_fork
def test_a_fork_while_another_thread_renders_is_an_error_or_works():
    """The scene that is in use says what to do; another, and a copy, work."""
    scene = _scene(60)
    prepared = ss.prepare(scene, LIGHT, METHOD)
    expected = _picture()
    started = threading.Event()

    large = ss.Camera((0, -4, 3), (0, 0, 0.3), width=1024, height=1024)
    slow = ss.prepare(scene, LIGHT, ss.RayTraced(samples=1024, cull=False))
    stop = threading.Event()

    def busy():
        class _Enough(Exception):
            pass

        def progress(fraction):
            if fraction > 0:  # 0 is told before the kernel starts
                started.set()
            if stop.is_set():
                raise _Enough

        with contextlib.suppress(_Enough):
            slow.render(large, progress)

    thread = threading.Thread(target=busy)
    thread.start()
    try:
        assert started.wait(30)

        def child():
            messages = []
            for call in (lambda: _picture(scene), lambda: prepared.render(CAMERA)):
                try:
                    call()
                except ss.SceneError as error:
                    messages.append(str(error))
            return messages, _picture(), _picture(scene.copy()).shape

        messages, fresh, copied = _forked(child)
    finally:
        stop.set()
        thread.join()
    assert len(messages) == 2
    for message in messages:
        assert "forked" in message
        assert "anew" in message
        assert "spawn" in message
    assert np.array_equal(fresh, expected)
    assert copied == expected.shape
    assert _picture(scene).shape == expected.shape


def _task(scene, camera, light, method):
    return ss.render(scene, camera, light, method).visibility


KINDS = [k for k in ("fork", "spawn", "forkserver") if k in multiprocessing.get_all_start_methods()]
if "forkserver" in KINDS:  # its children need not import the package each
    multiprocessing.get_context("forkserver").set_forkserver_preload(["softshadow"])


@pytest.mark.parametrize("kind", KINDS)
def test_pools_of_processes_work_after_use_in_the_parent(kind):
    """All that describes a picture crosses to the other side, and comes out with the same bits."""
    scene = _scene()
    expected = _picture(scene)
    context = multiprocessing.get_context(kind)
    with concurrent.futures.ProcessPoolExecutor(2, mp_context=context) as pool:
        tasks = [pool.submit(_task, scene, CAMERA, LIGHT, METHOD) for _ in range(4)]
        try:
            found = [t.result(timeout=PATIENCE) for t in tasks]
        except concurrent.futures.TimeoutError:
            for process in pool._processes.values():
                process.kill()
            raise
    for picture in found:
        assert np.array_equal(picture, expected)


@pytest.mark.parametrize("kind", KINDS)
def test_processes_work_after_use_in_the_parent(kind):
    _picture()
    context = multiprocessing.get_context(kind)
    process = context.Process(target=_picture)
    process.start()
    process.join(PATIENCE)
    alive = process.is_alive()
    if alive:
        process.kill()
    assert not alive
    assert process.exitcode == 0


@pytest.mark.parametrize("backend", ["loky", "multiprocessing", "threading"])
def test_joblib_works_after_use_in_the_parent(backend):
    joblib = pytest.importorskip("joblib")
    scene = _scene()
    expected = _picture(scene)
    call = joblib.delayed(_task)
    tasks = [call(scene, CAMERA, LIGHT, METHOD) for _ in range(4)]
    found = joblib.Parallel(n_jobs=2, backend=backend, timeout=PATIENCE)(tasks)
    for picture in found:
        assert np.array_equal(picture, expected)


# ---------------------------------------------------------------- threads


def test_threads_can_be_set():
    default = ss.thread_count()
    expected = _picture()
    try:
        for count in (1, 3):
            ss.set_threads(count)
            assert ss.thread_count() == count
            assert np.array_equal(_picture(), expected)
            names = _names_of_threads()
            # Those of another number end by themselves, soon.
            deadline = time.monotonic() + 10
            while time.monotonic() < deadline:
                names = [n for n in _names_of_threads() if n.startswith("softshadow")]
                if len(names) == count:
                    break
                time.sleep(0.01)
            assert len(names) == count
        with ss.threads(2):
            assert ss.thread_count() == 2
            with ss.threads(None):
                assert ss.thread_count() == default
            assert ss.thread_count() == 2
        assert ss.thread_count() == 3
        with pytest.raises(KeyError), ss.threads(2):
            raise KeyError
        assert ss.thread_count() == 3
    finally:
        ss.set_threads(None)
    assert ss.thread_count() == default


@pytest.mark.parametrize("count", [0, -1, 1025, 2**64, 1.5, "2", True, float("nan")])
def test_numbers_of_threads_are_checked(count):
    for call in (ss.set_threads, lambda n: ss.threads(n).__enter__()):
        with pytest.raises((ValueError, TypeError), match=r"threads: .*1 to 1024 or None"):
            call(count)


def test_the_environment_says_how_many_threads():
    code = "import softshadow as ss; print(ss.thread_count())"
    assert fresh.run(code, RAYON_NUM_THREADS="3").stdout.split() == ["3"]
    for unset in ("0", "", "many"):  # as rayon has it
        number = fresh.run(code, RAYON_NUM_THREADS=unset).stdout.split()
        assert number == [str(len(os.sched_getaffinity(0)))]


def test_calls_of_several_threads_run_beside_each_other():
    expected = _picture()
    scene = _scene()
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        tasks = [pool.submit(_picture, scene) for _ in range(16)]
        for task in tasks:
            assert np.array_equal(task.result(timeout=PATIENCE), expected)


def test_a_callback_may_render():
    """A call within a call: neither waits for the other."""
    inner = []

    def told(fraction):
        inner.append(_picture())

    points = np.tile([[0.3, 0, 0.0]], (400_000, 1))
    method = ss.RayTraced(256, cull=False)
    done = threading.Event()

    def call():
        ss.visibility(_scene(), points, None, LIGHT, method, told)
        done.set()

    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    assert done.wait(PATIENCE)
    assert inner
