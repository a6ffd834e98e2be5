"""`ss.compare`: what its table says is what the methods and the metrics say."""

from __future__ import annotations

import dataclasses
import importlib
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
import softshadow as ss
import trimesh
from softshadow import budget
from softshadow.compare import DEFAULT_REFERENCE

LIGHT = ss.RectLight(center=(0.5, 0, 3), edge_u=(0, 1, 0), edge_v=(1, 0, 0))
FEW = ss.RayTraced(samples=16)
MODULE = importlib.import_module("softshadow.compare")  # the function has the same name


@pytest.fixture(scope="module")
def scene():
    """A box that floats over a ground plane."""
    scene = ss.Scene()
    scene.add(([(-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0)], [(0, 1, 2), (0, 2, 3)]), "ground")
    scene.add(trimesh.creation.box((1, 1, 0.5)).apply_translation((0, 0, 1)), "box")
    return scene


@pytest.fixture(scope="module")
def camera():
    return ss.Camera(eye=(0, -5, 4), target=(0, 0, 0.3), width=32, height=24)


@pytest.fixture(scope="module")
def result(scene, camera):
    methods = ["hard", ss.RayTraced(samples=8, seed=3), "ray_traced"]
    return ss.compare(scene, camera, LIGHT, methods, reference=FEW, repeats=2)


def test_the_table_has_a_row_for_each_method_in_order(result):
    assert result.table["method"].tolist() == ["hard", "ray_traced", "ray_traced"]
    assert result.table["parameters"].tolist() == ["", "samples=8, seed=3", ""]
    assert list(result.table.columns[:6]) == [
        *("method", "parameters", "prepare_seconds", "frame_seconds", "bytes", "threads")
    ]
    assert result.table["threads"].tolist() == [ss.thread_count()] * 3
    assert list(result.images) == ["hard", "ray_traced(samples=8, seed=3)", "ray_traced"]


def test_the_errors_are_those_of_the_images_against_the_reference(result):
    assert result.reference.mask.any()
    for (_, row), image in zip(result.table.iterrows(), result.images.values(), strict=True):
        expected = ss.metrics.errors(
            image.visibility, result.reference.visibility, result.reference.mask
        )
        assert {name: row[name] for name in expected} == pytest.approx(expected)


def test_the_images_are_those_that_render_gives(result, scene, camera):
    again = ss.render(scene, camera, LIGHT, ss.RayTraced(samples=8, seed=3))
    image = result.images["ray_traced(samples=8, seed=3)"]
    assert np.array_equal(image.visibility, again.visibility)
    truth = ss.render(scene, camera, LIGHT, FEW)
    assert np.array_equal(result.reference.visibility, truth.visibility)


def test_a_hard_shadow_is_wrong_in_the_penumbra(result):
    hard, _, soft = (row for _, row in result.table.iterrows())
    assert hard["penumbra_mae"] > 2 * soft["penumbra_mae"]
    assert hard["penumbra_share"] == soft["penumbra_share"] > 0


def test_times_are_medians_of_fresh_preparations(monkeypatch, scene, camera):
    frames = iter([5.0, 0.125, 0.25, 0.5])  # the reference, then three repeats
    prepared = []

    def fake(*arguments):
        real = ss.prepare(*arguments)
        prepared.append(real)

        class Timed:
            def render(self, camera, progress):
                seconds = {"prepare": 8.0, "frame": next(frames)}
                return dataclasses.replace(real.render(camera), seconds=seconds)

        return Timed()

    monkeypatch.setattr(MODULE, "prepare", fake)
    table = ss.compare(scene, camera, LIGHT, ["hard"], reference=FEW, repeats=3).table
    assert table["frame_seconds"].tolist() == [0.25]
    assert table["prepare_seconds"].tolist() == [8.0]
    assert len(prepared) == 4


def test_times_and_bytes_are_measured(result):
    assert (result.table["frame_seconds"] > 0).all()
    assert (result.table["prepare_seconds"] >= 0).all()
    assert (result.table["bytes"] >= 0).all()


def test_the_default_reference_does_not_share_the_methods_samples():
    assert DEFAULT_REFERENCE.samples == 1024
    assert DEFAULT_REFERENCE.seed != ss.RayTraced().seed


def test_a_given_image_is_the_reference_as_it_is(result, scene, camera):
    black = dataclasses.replace(
        result.reference, visibility=np.zeros_like(result.reference.visibility)
    )
    table = ss.compare(scene, camera, LIGHT, ["hard"], reference=black, repeats=1).table
    lit = result.images["hard"].visibility[result.reference.mask].mean(dtype=np.float64)
    assert table["bias"][0] == pytest.approx(lit)
    assert math.isnan(table["penumbra_mae"][0])


def test_several_lights_weigh_the_same(scene, camera):
    other = ss.SphereLight(center=(-2, 0, 3), radius=0.3)
    both = ss.compare(scene, camera, [LIGHT, other], ["hard"], reference=FEW, repeats=1)
    image, truth = both.images["hard"], both.reference
    assert image.visibility.shape == truth.visibility.shape == (2, 24, 32)
    each = [ss.metrics.mae(image.visibility[i], truth.visibility[i], truth.mask) for i in range(2)]
    assert each[0] != each[1]
    assert both.table["mae"][0] == pytest.approx(sum(each) / 2)


def test_without_methods_all_are_compared_or_said_to_be_skipped(scene, camera):
    result = ss.compare(scene, camera, LIGHT, reference=FEW, repeats=1)
    assert {*result.table["method"], *result.skipped} == set(ss.method_names())
    assert "hard" not in result.skipped


def test_a_method_that_cannot_do_the_scene_is_skipped_unless_asked_for(monkeypatch, scene, camera):
    real = MODULE.prepare

    def picky(scene, light, method, *rest):
        if method.name == "hard":
            raise ss.UnsupportedError("hard: not today")
        return real(scene, light, method, *rest)

    monkeypatch.setattr(MODULE, "prepare", picky)
    monkeypatch.setattr(MODULE, "method_names", lambda: ("hard", "ray_traced"))
    result = ss.compare(scene, camera, LIGHT, reference=FEW, repeats=1)
    assert result.skipped == {"hard": "hard: not today"}
    assert result.table["method"].tolist() == ["ray_traced"]
    with pytest.raises(ss.UnsupportedError, match="not today"):
        ss.compare(scene, camera, LIGHT, ["hard"], reference=FEW, repeats=1)


def test_progress_ends_at_one_and_never_goes_back(scene, camera):
    seen: list[float] = []
    ss.compare(scene, camera, LIGHT, ["hard", FEW], FEW, repeats=2, progress=seen.append)
    assert seen == sorted(seen)
    assert {k / 5 for k in range(6)} <= set(seen)
    assert seen[-1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"repeats": 0}, ValueError, "repeats"),
        ({"methods": []}, ValueError, "at least one"),
        ({"methods": "hard"}, TypeError, "list"),
        ({"methods": ["hard", ss.Hard()]}, ValueError, "listed twice"),
        ({"methods": ["magic"]}, ValueError, "unknown name 'magic'"),
        ({"reference": "magic"}, ValueError, "unknown name 'magic'"),
    ],
)
def test_bad_arguments_are_errors_that_say_why(scene, camera, arguments, error, message):
    given = {"methods": ["hard"], "reference": FEW, "repeats": 1} | arguments
    with pytest.raises(error, match=message):
        ss.compare(scene, camera, LIGHT, **given)


def test_a_reference_of_another_size_is_an_error(scene, camera, result):
    small = ss.Camera(eye=(0, -5, 4), target=(0, 0, 0.3), width=8, height=8)
    with pytest.raises(ValueError, match="32x24 is not the camera's 8x8"):
        ss.compare(scene, small, LIGHT, ["hard"], reference=result.reference)


def test_a_camera_that_sees_nothing_is_an_error(scene):
    away = ss.Camera(eye=(0, 0, 9), target=(0, 0.1, 10), width=8, height=8)
    with pytest.raises(ValueError, match="sees no surface"):
        ss.compare(scene, away, LIGHT, ["hard"], reference=FEW)


def test_a_budget_with_time_for_all_is_the_same_but_for_the_times(result, scene, camera):
    methods = ["hard", ss.RayTraced(samples=8, seed=3), "ray_traced"]
    within = ss.compare(scene, camera, LIGHT, methods, reference=FEW, repeats=2, budget=300)
    assert within.skipped == {}
    assert list(within.images) == list(result.images)
    same = [c for c in result.table if not c.endswith("_seconds")]
    assert within.table[same].equals(result.table[same])
    assert within.table["repeats"].tolist() == [2, 2, 2]
    assert within.reference_method == result.reference_method == FEW


BIG = ss.Camera(eye=(0, -5, 4), target=(0, 0, 0.3), width=128, height=96)


class Clock:
    """Time that passes only where a method renders: seconds by the method's name.

    Those of `flat` take as long for small pictures as for large ones.
    """

    def __init__(self, monkeypatch, seconds, flat=()):
        self.now = 0.0
        self.rendered = []
        real = MODULE.prepare

        def slow(scene, light, method, progress=False):
            prepared = real(scene, light, method)
            clock = self

            class Slow:
                def render(self, camera, progress):
                    image = prepared.render(camera)
                    pixels = camera.width * camera.height
                    share = 1.0 if method.name in flat else pixels / (BIG.width * BIG.height)
                    frame = seconds[method.name] * share
                    for part in range(1, 1001):
                        clock.now += frame / 1000
                        if progress:
                            progress(part / 1000)
                    clock.rendered.append((method.name, pixels))
                    return dataclasses.replace(image, seconds={"prepare": 0.0, "frame": frame})

            return Slow()

        monkeypatch.setattr(MODULE, "prepare", slow)
        for module in (MODULE, budget):
            monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda: self.now))


def test_a_budget_leaves_out_what_is_slow_with_its_estimate(monkeypatch, scene):
    clock = Clock(monkeypatch, {"ray_traced": 1.0, "hard": 2.0, "wedges": 50.0})
    monkeypatch.setattr(MODULE, "method_names", lambda: ("wedges", "hard", "ray_traced"))
    result = ss.compare(scene, BIG, LIGHT, reference=FEW, repeats=1, budget=40)
    assert result.table["method"].tolist() == ["hard", "ray_traced"]
    assert list(result.skipped) == ["wedges"]
    assert "up to 50 s, as 32x24 pixels took 3.1 s" in result.skipped["wedges"]
    whole = [name for name, pixels in clock.rendered if pixels == 128 * 96]
    assert whole == ["ray_traced", "ray_traced", "hard"]  # the reference; then the cheapest first
    assert clock.now < 40


def test_what_takes_as_long_for_a_small_picture_is_looked_at_closer(monkeypatch, scene):
    """By the pixels it would take 144 s; two small pictures tell that it takes 3."""
    clock = Clock(monkeypatch, {"ray_traced": 1.0, "hard": 1.0, "wedges": 3.0}, flat=("wedges",))
    result = ss.compare(scene, BIG, LIGHT, ["hard", "wedges"], FEW, repeats=1, budget=40)
    assert result.table["method"].tolist() == ["hard", "wedges"]
    assert not result.skipped
    wedges = [pixels for name, pixels in clock.rendered if name == "wedges"]
    assert wedges == [16 * 16, 32 * 24, 128 * 96]


def test_what_takes_longer_than_it_should_is_stopped(monkeypatch, scene):
    clock = Clock(monkeypatch, {"ray_traced": 1.0, "hard": 1.0, "wedges": 30.0})
    plain = budget.estimated

    def short(method, *rest):
        return dataclasses.replace(plain(method, *rest), growth=1.0)

    monkeypatch.setattr(budget, "estimated", short)
    result = ss.compare(scene, BIG, LIGHT, ["hard", "wedges"], FEW, repeats=1, budget=20)
    assert result.table["method"].tolist() == ["hard"]
    assert re.search(r"stopped after 1\d s; up to 0.6\d s", result.skipped["wedges"])
    assert clock.now < 21


def test_what_is_too_slow_even_to_estimate_is_stopped(monkeypatch, scene):
    clock = Clock(monkeypatch, {"ray_traced": 0.1, "hard": 0.1, "wedges": 4000.0})
    result = ss.compare(scene, BIG, LIGHT, ["hard", "wedges"], FEW, repeats=3, budget=20)
    assert result.table["method"].tolist() == ["hard"]
    assert result.table["repeats"].tolist() == [3]
    assert "s for 16x16 pixels alone" in result.skipped["wedges"]
    assert ("wedges", 256) not in clock.rendered


def test_rounds_after_the_first_take_what_time_remains(monkeypatch, scene):
    clock = Clock(monkeypatch, {"ray_traced": 1.0, "hard": 8.0})
    methods = ["hard", ss.RayTraced(samples=4)]
    result = ss.compare(scene, BIG, LIGHT, methods, FEW, repeats=5, budget=25)
    assert result.table["repeats"].tolist() == [1, 5]
    assert clock.now < 25


def test_the_default_reference_gets_fewer_samples_where_it_would_take_long(monkeypatch, scene):
    Clock(monkeypatch, {"ray_traced": 8.0, "hard": 0.1})
    few = ss.compare(scene, BIG, LIGHT, ["hard"], repeats=1, budget=20).reference_method
    assert few == dataclasses.replace(DEFAULT_REFERENCE, samples=512)
    many = ss.compare(scene, BIG, LIGHT, ["hard"], repeats=1, budget=90).reference_method
    assert many == DEFAULT_REFERENCE


def test_a_budget_skips_what_cannot_do_the_scene_unless_asked_for(scene, camera):
    scene = scene.copy()
    scene.set_look("box", opacity=0.5)
    result = ss.compare(scene, camera, LIGHT, reference=FEW, repeats=1, budget=100)
    assert {*result.table["method"], *result.skipped} == set(ss.method_names())
    assert "budget" not in result.skipped["wedges"]
    with pytest.raises(ss.UnsupportedError, match="wedges"):
        ss.compare(scene, camera, LIGHT, ["wedges"], reference=FEW, repeats=1, budget=100)


def test_a_budget_s_progress_ends_at_one_and_never_goes_back(scene, camera):
    seen: list[float] = []
    ss.compare(scene, camera, LIGHT, ["hard"], FEW, repeats=2, progress=seen.append, budget=60)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_the_small_picture_has_the_same_view():
    camera = ss.Camera(eye=(0, -5, 4), target=(0, 0, 0.3), width=512, height=384)
    few = budget.small(camera)
    assert (few.width, few.height) == (64, 48)
    assert np.allclose(few.K[:2] * 8, camera.K[:2])
    assert np.array_equal(few.camera_to_world, camera.camera_to_world)


@pytest.mark.parametrize("growth", [1.0, 2.0, 4.0, 9.0])
def test_how_a_frame_grows_is_told_by_two_small_pictures(growth):
    camera = ss.Camera(eye=(0, -5, 4), target=(0, 0, 0.3), width=512, height=512)
    sides = []

    def render(_method, few, _progress):
        sides.append(few.width)
        frame = 1.0 if len(sides) == 1 else growth
        return SimpleNamespace(seconds={"prepare": 1.0, "frame": frame})

    first = budget.estimated(ss.Hard(), camera, render, False)
    assert (first.least, first.most) == (2.0, 65.0)
    found = budget.closer(first, ss.Hard(), camera, render, False)
    assert sides == [64, 128]
    # A frame, and twice four times the pixels; no more than the pixels grow by.
    assert found.least == 1.0 + growth
    assert found.most == pytest.approx(1.0 + growth * min(growth**2, 16.0))


@pytest.mark.parametrize("seconds", [0, -1, math.nan, 1e-9])
def test_a_budget_for_nothing_is_an_error(scene, camera, seconds):
    with pytest.raises(ValueError, match="budget"):
        ss.compare(scene, camera, LIGHT, ["hard"], reference=FEW, budget=seconds)
