"""Answers under an error that is stated, judged by probes."""

from __future__ import annotations

import dataclasses
import pickle
import time
import warnings

import numpy as np
import pytest
import softshadow as ss
from bits import digest, with_threads
from shapes import body_and_leaves, quad
from softshadow import _core
from softshadow.methods.base import LEAST_ERROR
from softshadow.render import Prepared
from softshadow.renderers import rendered
from softshadow.targets import Picture, Points

SIZE = 64
RAYS = ss.Auto(error=0.01, engine="ray_traced")
"""The same bits every time."""


@pytest.fixture(scope="module")
def scene():
    return body_and_leaves()


@pytest.fixture
def promising(monkeypatch):
    """Let rays be asked for five times what they should be asked for, at first."""
    monkeypatch.setattr("softshadow.auto._MARGIN", 5.0)


def _light(size):
    return ss.RectLight((0.5, -0.3, 2.0), (0, size, 0), (size, 0, 0))


def _camera(angle=-1.4, size=SIZE):
    eye = (3 * np.cos(angle), 3 * np.sin(angle), 1.8)
    return ss.Camera(eye, (0, 0.1, 0.3), fov_y_deg=38, width=size, height=size)


def _points(count=4000):
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (count, 2)), np.zeros(count)])
    return points, np.tile([0.0, 0.0, 1.0], (count, 1))


def _true(seen, a, b, mask=...):
    """The error without the noise of two references."""
    off = (seen.astype(float) - a) * (seen - b)
    return np.sqrt(max(off[mask].mean(), 0))


# Pictures


@pytest.mark.parametrize("size", [0.1, 0.8])
@pytest.mark.parametrize("error", [0.03, 0.01, 0.004])
def test_what_is_asked_for_is_kept_and_within_the_interval(scene, size, error):
    below = inside = 0
    views, seeds = 3, 3
    for view in range(views):
        camera, light = _camera(2.1 * view), _light(size)
        a, b = (ss.render(scene, camera, light, ss.RayTraced(4096, seed=s)) for s in (91, 92))
        for seed in range(seeds):
            image = ss.render(scene, camera, light, ss.Auto(error=error, seed=seed))
            true = _true(image.visibility, a.visibility, b.visibility, image.mask)
            assert image.error.high <= error
            below += true <= error
            inside += image.error.low <= true <= image.error.high
    # 97.5 of 100 are promised below, 95 inside; two misses of nine below by chance once in 50
    # times, three inside once in 130. `benches/auto.py` has the long study.
    assert below >= views * seeds - 1
    assert inside >= views * seeds - 2


@pytest.mark.parametrize("engine", ["cheapest", "ray_traced", "counted"])
def test_what_was_chosen_is_told(scene, engine):
    image = ss.render(scene, _camera(), _light(0.8), ss.Auto(error=0.01, engine=engine))
    last = image.choice[-1]
    assert (last.high, last.rmse) == (image.error.high, image.error.rmse)
    assert last.why
    assert last.seconds > 0
    assert engine in ("cheapest", last.method.name)
    again = ss.render(scene, _camera(), _light(0.8), last.method)
    assert np.array_equal(again.visibility, image.visibility)
    assert np.array_equal(again.radiance, image.radiance)
    stages = ("look", "choose", "probes")
    assert sum(image.seconds[s] for s in stages) < image.seconds["frame"]
    assert ss.render(scene, _camera(), _light(0.8), RAYS.name).error.high <= 0.01


def test_the_cheaper_one_is_what_takes_less_by_the_clock(scene, monkeypatch):
    slow = {"name": "counted"}

    def answered(target, prepared, tell):
        if prepared.method.name == slow["name"]:
            time.sleep(0.2)
        return prepared.render(target.camera, tell)

    monkeypatch.setattr(Picture, "answer", answered)
    for slower, other in (("counted", "ray_traced"), ("ray_traced", "counted")):
        slow["name"] = slower
        # Pictures of which a block is timed, and such that are timed as a whole.
        for size in (32, 160):
            image = ss.render(scene, _camera(size=size), _light(0.8), ss.Auto(error=0.01))
            assert [step.method.name for step in image.choice] == [other], (slower, size)


def test_it_goes_on_until_the_error_holds(scene, promising):
    image = ss.render(scene, _camera(), _light(0.8), RAYS)
    assert len(image.choice) > 1
    assert image.choice[0].high > 0.01
    assert image.error.high <= 0.01
    errors = [step.method.error for step in image.choice]
    assert errors == sorted(errors, reverse=True)


def test_counted_goes_on_with_more_points_and_rays(scene, monkeypatch):
    few = ss.Counted(samples=1, rays=1, error=1.0)
    monkeypatch.setattr("softshadow.auto._counted", lambda auto: few)
    image = ss.render(scene, _camera(), _light(0.8), ss.Auto(error=0.003, engine="counted"))
    assert image.error.high <= 0.003
    samples = [(step.method.samples, step.method.rays) for step in image.choice]
    assert samples == [(4**i, 4**i) for i in range(len(samples))]
    assert len(samples) > 1


def test_several_lights(scene):
    lights = [_light(0.8), ss.SphereLight((0.4, 0.5, 1.9), 0.35)]
    image = ss.render(scene, _camera(), lights, "auto")
    assert image.visibility.shape == (2, SIZE, SIZE)
    assert image.error.high <= 0.01
    assert len(image.error.lights) == 2


def test_translucent_casters(scene):
    scene = scene.copy()
    for name in list(scene):
        scene.set_look(name, opacity=0.5)
    image = ss.render(scene, _camera(), _light(0.8), "auto")
    a, b = (
        ss.render(scene, _camera(), _light(0.8), ss.RayTraced(4096, seed=s)).visibility
        for s in (91, 92)
    )
    assert image.error.high <= 0.01
    assert _true(image.visibility, a, b, image.mask) <= 0.01


def test_nothing_hit():
    camera = ss.Camera((0, 0, 3), (0, 0, 6), up=(0, 1, 0), width=8, height=8)
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (5, 0, 0), (0, 5, 0)))
    for seconds in (None, 1.0):
        image = ss.render(scene, camera, _light(0.8), ss.Auto(seconds=seconds))
        assert (image.error.high, image.mask.any()) == (0, False)


def test_a_block_that_is_timed_shows_what_the_picture_shows_there(scene):
    camera, light = _camera(size=256), _light(0.8)
    method = ss.RayTraced(64, pattern="fixed")
    whole = ss.render(scene, camera, light, method)
    part, share = Picture(camera).part(whole.visibility[None].astype(float), whole.mask)
    block = ss.render(scene, part.camera, light, method)
    assert block.visibility.shape == (64, 64)
    assert share == pytest.approx(block.mask.sum() / whole.mask.sum(), rel=0.02)
    same = [
        (y, x)
        for y in range(0, 256, 64)
        for x in range(0, 256, 64)
        if np.allclose(whole.position[y : y + 64, x : x + 64], block.position, atol=1e-5)
    ]
    assert len(same) == 1
    partly = (whole.visibility > 0) & (whole.visibility < 1)
    y, x = same[0]
    # What is typical has some of what costs.
    assert partly[y : y + 64, x : x + 64].any()


# Time


@pytest.mark.parametrize("engine", ["cheapest", "ray_traced", "counted"])
def test_time_ends_it_with_an_honest_interval(scene, engine):
    method = ss.Auto(error=0.0005, seconds=1e-3, engine=engine)
    a, b = (ss.render(scene, _camera(), _light(0.8), ss.RayTraced(4096, seed=s)) for s in (91, 92))
    image = ss.render(scene, _camera(), _light(0.8), method)
    assert len(image.choice) == 1
    assert image.choice[0].method == ss.RayTraced(samples=4, error=1.0)
    true = _true(image.visibility, a.visibility, b.visibility, image.mask)
    # Once in 20 times not; the seed is one of the others.
    assert image.error.low <= true <= image.error.high
    assert image.error.low > 0.0005


def test_more_time_is_used_and_kept(scene):
    camera, light = _camera(size=192), _light(0.8)
    errors = []
    for seconds in (0.01, 0.5, 2.0):
        start = time.perf_counter()
        image = ss.render(scene, camera, light, ss.Auto(error=0.0005, seconds=seconds))
        took = time.perf_counter() - start
        # A busy machine: it is stopped within some kernels' steps, and judging is not stopped.
        assert took < 3 * seconds + 1.0
        errors.append(image.error.high)
    assert errors[2] < 0.5 * errors[0]
    assert errors[1] <= errors[0]


def test_a_picture_that_is_stopped_leaves_the_one_before(scene, monkeypatch):
    plain = Picture.answer

    def answered(target, prepared, tell):
        if prepared.method.name == "ray_traced" and prepared.method.samples > 16:
            tell(0.0)
            time.sleep(0.5)
            tell(0.5)
        return plain(target, prepared, tell)

    monkeypatch.setattr(Picture, "answer", answered)
    method = ss.Auto(error=0.001, seconds=0.4, engine="ray_traced")
    image = ss.render(scene, _camera(), _light(0.8), method)
    assert [step.method.samples for step in image.choice] == [4]


# Points


@pytest.mark.parametrize("engine", ["ray_traced", "counted"])
def test_points_keep_the_error(scene, engine):
    points, normals = _points()
    for light in (_light(0.8), [_light(0.8), ss.SphereLight((0.4, 0.5, 1.9), 0.35)]):
        method = ss.Auto(error=0.01, engine=engine)
        seen = ss.visibility(scene, points, normals, light, method)
        a, b = (
            ss.visibility(scene, points, normals, light, ss.RayTraced(4096, seed=s))
            for s in (91, 92)
        )
        assert seen.shape == a.shape
        true = _true(seen, a, b)
        assert true <= 0.01
        found = ss.estimate_error_at(seen, scene, points, normals, light, seed=5)
        # Both are within the estimate's own precision.
        assert found.low <= 1.1 * true
        assert true <= 1.1 * found.high
        assert found.map.shape == (len(points),)


def test_points_without_normals_and_none_at_all(scene):
    points, _ = _points(500)
    points[:, 2] = 0.05
    seen = ss.visibility(scene, points, None, _light(0.4), "auto")
    reference = ss.visibility(scene, points, None, _light(0.4), ss.RayTraced(4096, seed=9))
    assert np.sqrt(np.square(seen - reference).mean()) <= 0.01
    assert ss.visibility(scene, points[:0], None, _light(0.4), "auto").shape == (0,)


def test_points_that_miss_the_error_say_so(scene):
    method = ss.Auto(error=0.0005, seconds=1e-3)
    with pytest.warns(UserWarning, match=r"above the 0.0005 .*: the time was over"):
        ss.visibility(scene, *_points(), _light(0.8), method)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ss.visibility(scene, *_points(), _light(0.8), "auto")


def test_points_that_are_timed_are_spread_over_all():
    points, normals = _points(100_000)
    part, share = Points(points, normals).part(
        np.ones((1, len(points))), np.ones(len(points), bool)
    )
    assert share == pytest.approx(1 / 16, rel=0.01)
    where = [
        np.flatnonzero((points == p).all(axis=1))[0] for p in part.points[:: len(part.points) // 8]
    ]
    assert np.all(np.diff(where) > 10_000)


def test_baked_textures_keep_the_error(scene):
    name = next(iter(scene))
    baked, true = (
        ss.bake(scene, _light(0.8), name, method, max_size=64)[0].visibility
        for method in ("auto", ss.RayTraced(4096, seed=9))
    )
    assert np.sqrt(np.square(baked - true).mean()) <= 0.01


def test_irradiance_keeps_it(scene):
    points, normals = _points(1000)
    found, true = (
        ss.irradiance(scene, points, normals, _light(0.8), method)
        for method in ("auto", ss.RayTraced(4096, seed=9))
    )
    assert np.sqrt(np.square(found - true).mean()) <= 0.01 * true.max()


# Prepared


def test_frames_begin_with_what_held(scene):
    # One engine: by the clock another could be chosen anew.
    prepared = ss.prepare(scene, _light(0.8), RAYS)
    assert isinstance(prepared, Prepared)
    assert prepared.method == RAYS
    first, second = (prepared.render(_camera(angle)) for angle in (-1.4, -1.3))
    assert second.choice[0].why == "it held for the last frame"
    assert second.choice[0].method == first.choice[-1].method
    assert second.seconds["choose"] == 0
    assert second.error.high <= 0.01
    # The same picture has the same bits: nothing has moved the method.
    assert np.array_equal(prepared.render(_camera()).visibility, first.visibility)


def test_a_method_that_probes_moved_is_judged_by_others(scene, promising):
    prepared = ss.prepare(scene, _light(0.8), RAYS)
    first, second = (prepared.render(_camera()) for _ in range(2))
    assert len(first.choice) > 1
    assert [s.method for s in second.choice] == [first.choice[-1].method]
    assert np.array_equal(first.visibility, second.visibility)
    assert first.error.rmse != second.error.rmse


def test_costs_are_measured_anew_when_frames_take_longer(scene, monkeypatch):
    prepared = ss.prepare(scene, _light(0.8), ss.Auto(error=0.01))
    prepared.render(_camera())
    plain = Picture.answer

    def answered(target, prepared, tell):
        time.sleep(1.0)
        return plain(target, prepared, tell)

    monkeypatch.setattr(Picture, "answer", answered)
    assert prepared.render(_camera()).seconds["choose"] == 0
    monkeypatch.setattr(Picture, "answer", plain)
    assert prepared.render(_camera()).seconds["choose"] > 0


def test_rays_that_probes_have_moved_are_let_off_again(scene, promising, monkeypatch):
    prepared = ss.prepare(scene, _light(0.8), RAYS)
    for _ in range(2):
        moved = prepared.render(_camera()).choice[-1].method
    assert prepared.render(_camera()).choice[0].method == moved
    monkeypatch.setattr("softshadow.auto._GENEROUS", 1.0)  # as if that were too much
    prepared.render(_camera())
    assert prepared.render(_camera()).choice[0].method.error == 5.0 * 0.01


@pytest.mark.parametrize("engine", ["ray_traced", "counted"])
def test_frames_under_a_time_begin_with_what_held(scene, engine):
    prepared = ss.prepare(scene, _light(0.8), ss.Auto(error=0.01, seconds=60.0, engine=engine))
    first, second = (prepared.render(_camera(angle)) for angle in (-1.4, -1.3))
    assert [s.method for s in first.choice] == [s.method for s in second.choice]
    assert second.choice[-1].why == "it held for the last frame"
    assert second.seconds["choose"] == 0


def test_it_sees_the_scene_as_it_was(scene):
    scene = scene.copy()
    prepared = ss.prepare(scene, _light(0.8), RAYS)
    before = prepared.render(_camera())
    for name in list(scene)[1:]:
        scene.set_look(name, casts=False)
    after = prepared.render(_camera())
    assert np.array_equal(before.visibility, after.visibility)
    assert after.error.rmse == before.error.rmse
    new = ss.prepare(scene, _light(0.8), RAYS).render(_camera())
    assert new.visibility[new.mask].mean() > before.visibility[before.mask].mean() + 0.01


def test_pickles_prepare_it_again(scene):
    prepared = ss.prepare(scene, _light(0.8), RAYS)
    other = pickle.loads(pickle.dumps(prepared))
    assert other.method == RAYS
    one, two = (p.render(_camera()) for p in (prepared, other))
    assert np.array_equal(one.visibility, two.visibility)
    assert (one.error.low, one.error.high) == (two.error.low, two.error.high)


# The rest


def test_sweeps_take_it(scene, tmp_path):
    method = ss.Auto(error=0.02)
    assert ss.Auto(**method.parameters()) == method
    assert pickle.loads(pickle.dumps(method)) == method
    assert rendered(method, scene, _camera(), _light(0.4)).error.high <= 0.02
    cases = ss.grid({"scene": scene}, _light(0.4), _camera(), [RAYS])
    reference = ss.RayTraced(1024, seed=9)
    table = ss.sweep(cases, tmp_path / "r.parquet", reference=reference, repeats=1)
    row = table.iloc[0]
    assert (row["method"], row["method_error"], row["engine"]) == ("auto", 0.01, "ray_traced")
    assert row["rmse"] <= 0.01


@pytest.mark.parametrize("seconds", [None, 0.3])
def test_progress_is_told_to_the_end(scene, seconds):
    told = []
    method = ss.Auto(error=0.02, seconds=seconds)
    ss.render(scene, _camera(), _light(0.4), method, progress=told.append)
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0, 1)
    told.clear()
    ss.visibility(scene, *_points(), _light(0.4), "auto", progress=told.append)
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0, 1)


def test_an_exception_of_progress_ends_it(scene):
    def stop(fraction):
        if fraction > 0.7:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        ss.render(scene, _camera(), _light(0.4), "auto", progress=stop)


@pytest.mark.parametrize("engine", ["ray_traced", "counted"])
def test_with_an_engine_threads_and_times_change_no_bit(scene, engine):
    method = dataclasses.replace(RAYS, engine=engine)

    def bits():
        image = ss.render(scene, _camera(), _light(0.4), method)
        return digest(image.visibility, image.error.map), image.error.low, image.error.high

    assert len(with_threads(bits, 1, 2)) == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"error": 0}, "error"),
        ({"error": float("nan")}, "error"),
        ({"error": 2}, "error"),
        ({"confidence": 1.0}, "confidence"),
        ({"seed": -1}, "seed"),
        ({"seconds": 0.0}, "seconds"),
        ({"seconds": float("nan")}, "seconds"),
        ({"engine": "wedges"}, "engine"),
    ],
)
def test_bad_parameters_are_refused(change, message):
    with pytest.raises(ss.ParameterError, match=message):
        ss.Auto(**change)


@pytest.mark.parametrize("kind", [ss.RayTraced, ss.Counted])
def test_the_least_error_is_the_core_s(kind):
    name = kind.name
    assert isinstance(_core.Method(name, kind(error=LEAST_ERROR)), _core.Method)
    with pytest.raises(ss.ParameterError, match="error"):
        kind(error=np.nextafter(LEAST_ERROR, 0))


def test_a_camera_and_points_are_checked(scene):
    prepared = ss.prepare(scene, _light(0.4), "auto")
    with pytest.raises(TypeError, match="camera"):
        prepared.render(None)
    with pytest.raises(ValueError, match="normals: expected shape"):
        prepared.visibility(np.zeros((2, 3)), np.ones((3, 3)))
