"""Mitsuba in sweeps, cases that are left out, limits of time, and the study in its short form."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import softshadow as ss
from softshadow.mitsuba import Direct, find_llvm
from softshadow.renderers import Rendered
from softshadow.sweep import groups, running
from softshadow.sweep.store import Store
from softshadow.sweep.study import read_study

BENCHES = Path(__file__).parents[1] / "benches"
CAMERA = ss.Camera((0, -4, 3), (0, 0, 0.3), width=24, height=16)
LIGHT = ss.SphereLight((0, 0, 4), 0.4)
QUICK = ss.RayTraced(samples=256, seed=7)

needs_mitsuba = pytest.mark.skipif(
    not os.environ.get("CI") and find_spec("mitsuba") is None,
    reason="the optional extra",
)
"""With CI in the environment it has to be there."""

needs_llvm = pytest.mark.skipif(find_llvm() is None, reason="no LLVM 19 is installed")


def board(height=1.0, opacity=1.0):
    scene = ss.Scene()
    scene.add(ss.scenes.square(3))
    scene.add(ss.scenes.square(0.5, height), "board", opacity=opacity)
    return scene


def quick(cases, store, **options):
    return ss.sweep(cases, store, **{"reference": QUICK, "repeats": 1, "progress": False} | options)


@dataclasses.dataclass(frozen=True)
class Painter:
    """A renderer that paints a grey, for as long as it says."""

    grey: float = 0.5
    seconds: float = 0.25

    name = "painter"
    version = "Painter 3"

    def parameters(self):
        return dataclasses.asdict(self)

    def render(self, scene, camera, light):
        shape = (camera.height, camera.width)
        times = {"prepare": 0.0, "frame": self.seconds}
        return Rendered(np.full(shape, self.grey, np.float32), np.ones(shape, bool), times)


# ---------------------------------------------------------------- renderers in sweeps


def test_a_sweep_measures_any_renderer_beside_the_methods(tmp_path):
    cases = ss.grid(board, LIGHT, CAMERA, ["hard", Painter(0.25)])
    table = quick(cases, tmp_path / "r").set_index("method")
    row = table.loc["painter"]
    assert row["label"] == "painter(grey=0.25)"
    assert (row["frame_seconds"], row["version"]) == (0.25, f"{ss.__version__}, Painter 3")
    assert pd.isna(row["bytes"])
    assert table.loc["hard", "version"] == ss.__version__
    truth = ss.render(board(), CAMERA, LIGHT, ss.RayTraced(1024))
    expected = np.abs(truth.visibility - 0.25)[truth.mask].mean()
    assert row["mae"] == pytest.approx(expected, abs=0.002)  # the reference's noise, far above it


@pytest.mark.parametrize("thing", [3, Direct, object()])
def test_what_renders_nothing_is_refused(thing):
    with pytest.raises(TypeError, match="method: expected a name, a method object or a renderer"):
        ss.Case(board, method=thing)


def _keys(cases, tmp_path, **options):
    s = {"repeats": 1, "threads": None, "alone": True, "reference": QUICK, "images": None}
    store = Store(tmp_path / "keys")
    return running._Plan(store, cases, groups.Settings(**s | options), False).keys


def test_keys_have_a_renderer_s_parameters_and_those_of_methods_stay(tmp_path):
    ours = Direct(), Direct(samples=4), Direct(denoise=True), Direct("scalar_rgb"), Direct(seed=1)
    keys = _keys(ss.grid(board, LIGHT, CAMERA, [*ours, "hard"]), tmp_path)
    assert len(set(keys)) == len(keys)
    # Of the version whose reference first had `error`: stores from then on are gone on with.
    assert keys[-1] == "d9745d0da5b3fc6f79980bb925789574"
    limits = ({"repeat_seconds": 2.0}, {"reference_seconds": 2.0}, {"repeat_seconds": 1.0})
    more = [_keys(ss.grid(board, LIGHT, CAMERA, "hard"), tmp_path, **x)[0] for x in limits]
    assert len({keys[-1], *more}) == 4


def test_what_is_left_out_is_a_row_that_says_why(tmp_path):
    case = ss.Case(board, LIGHT, CAMERA, "hard")
    table = quick([case, dataclasses.replace(case, left_out="too slow")], tmp_path / "r")
    assert table["error"].fillna("").tolist() == ["", "left out: too slow"]
    assert table["frame_seconds"].notna().tolist() == [True, False]


def test_slow_cases_are_repeated_as_long_as_there_is_time(tmp_path):
    cases = ss.grid(board, LIGHT, CAMERA, [Painter(seconds=s) for s in (0.25, 0.5, 2.0)])
    table = quick(cases, tmp_path / "r", repeats=4, repeat_seconds=0.75)
    assert table["repeats"].tolist() == [3, 2, 1]


def test_a_reference_stops_where_a_better_one_would_take_too_long(tmp_path):
    cases = ss.grid(board, LIGHT, CAMERA, ss.RayTraced(samples=1024))
    short = quick(cases, tmp_path / "short", reference_seconds=0.0)
    assert short["reference"].str.startswith("2 x 256 samples").all()
    assert not short["reference_converged"].any()
    limit = ss.RayTraced(samples=1024, seed=7)
    longer = quick(cases, tmp_path / "long", reference_seconds=600.0, reference=limit)
    assert longer["reference"].str.startswith("2 x 1024 samples").all()


# ---------------------------------------------------------------- Mitsuba


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        ({"variant": "cuda_ad_rgb"}, ValueError, "variant: expected one of"),
        ({"samples": 0}, ValueError, "samples: expected"),
        ({"sampler": "sobol"}, ValueError, "sampler: expected one of"),
        ({"denoise": 1}, TypeError, "denoise"),
        ({"seed": 2**32}, ValueError, "seed"),
    ],
)
def test_parameters_of_mitsuba_are_checked(arguments, error, said):
    with pytest.raises(error, match=f"Direct.{said}"):
        Direct(**arguments)


@needs_mitsuba
@pytest.mark.parametrize("opacity", [1.0, 0.5])
def test_mitsuba_s_visibility_is_ours(opacity, monkeypatch):
    """Also ray by ray, as a scalar variant does where there is no LLVM."""
    monkeypatch.setattr("softshadow.mitsuba.direct.find_llvm", lambda: None)
    scene = board(opacity=opacity)
    image = Direct("scalar_rgb", samples=64).render(scene, CAMERA, LIGHT)
    truth = ss.render(scene, CAMERA, LIGHT, ss.RayTraced(1024))
    assert np.array_equal(image.mask, truth.mask)
    # A stratified sample of 64 is off by 64**-0.75 = 0.04 of what the board takes at most.
    assert np.abs(image.visibility - truth.visibility).max() < 0.045 * opacity
    assert image.visibility.min() < 1 - 0.4 * opacity
    assert set(image.seconds) == {"prepare", "frame", "shade"}


@needs_mitsuba
@needs_llvm
def test_vectorised_scalar_and_denoised_mitsuba_in_a_sweep(tmp_path):
    pytest.importorskip("mitsuba_oidn", reason="the optional extra")
    sides = [Direct(samples=16), Direct("scalar_rgb", 16), Direct(samples=16, denoise=True)]
    sides += [Direct(samples=16, sampler="independent")]
    table = quick(ss.grid(board, LIGHT, CAMERA, sides), tmp_path / "r", threads=1)
    assert table["error"].isna().all()
    assert table["method"].tolist() == [
        "mitsuba llvm_ad_mono",
        "mitsuba scalar_rgb",
        "mitsuba llvm_ad_mono denoised",
        "mitsuba llvm_ad_mono independent",
    ]
    assert (table["threads"] == 1).all()
    mono, scalar, denoised, independent = table["rmse"]
    assert mono == pytest.approx(scalar)  # the same samples
    assert independent > 1.5 * mono  # stratified samples of 16 are worth many more
    assert denoised != mono
    assert table["denoise_seconds"].notna().tolist() == [False, False, True, False]
    row = table.iloc[2]
    assert row["frame_seconds"] == pytest.approx(row["shade_seconds"] + row["denoise_seconds"])
    assert "Open Image Denoise" in row["version"]
    assert "Mitsuba" in table["version"][0]


@needs_mitsuba
@needs_llvm
def test_mitsuba_does_not_see_its_light_and_takes_several():
    eye = ss.Camera((0, 0, 6), (0, 0, 0), up=(0, 1, 0), width=24, height=16)  # looks past the light
    lights = [ss.RectLight((0, 0, 4), (0, 1, 0), (1, 0, 0)), ss.SphereLight((1, 0, 4), 0.3)]
    image = Direct(samples=16).render(board(), eye, lights)
    truth = ss.render(board(), eye, lights, ss.RayTraced(256))
    assert image.visibility.shape == truth.visibility.shape
    assert np.sqrt(np.mean((image.visibility - truth.visibility) ** 2)) < 0.02  # measured: 0.006


@needs_mitsuba
@needs_llvm
@pytest.mark.parametrize("sampler", ["multijitter", "independent"])
def test_a_film_has_the_picture_of_shadow_rays_and_a_time_of_its_own(sampler, monkeypatch):
    monkeypatch.setattr(Direct, "_film_seconds", lambda *_: (1.0, 7.0))
    rays, film = (
        Direct(samples=4, sampler=sampler, film=film).render(board(), CAMERA, LIGHT)
        for film in (False, True)
    )
    assert np.array_equal(rays.visibility, film.visibility)
    assert film.seconds["frame"] == 7.0 > rays.seconds["frame"]
    monkeypatch.undo()
    method = Direct(samples=4, sampler=sampler, film=True)
    assert method.name.endswith(" film")
    assert 0 < method.render(board(), CAMERA, LIGHT).seconds["frame"] < 7.0


@needs_mitsuba
@needs_llvm
def test_a_number_of_samples_that_the_sampler_cannot_have_is_an_error():
    with pytest.raises(ValueError, match="multijitter cannot have 7 samples, but 8"):
        Direct(samples=7).render(board(), CAMERA, LIGHT)


def test_missing_llvm_says_what_to_install(monkeypatch):
    monkeypatch.setattr("softshadow.mitsuba.direct.find_llvm", lambda: None)
    with pytest.raises(ModuleNotFoundError, match="llvm_ad_mono needs LLVM 19"):
        Direct().render(board(), CAMERA, LIGHT)


# ---------------------------------------------------------------- studies


def _study(tmp_path, text):
    path = tmp_path / "study.toml"
    path.write_text(text)
    return read_study(path)


SCENE = """
[scene.plane]
factory = "half_plane"
[scene.boards]
factory = "stacked_boards"
"""


def test_a_study_has_mitsuba_and_leaves_out_what_it_says(tmp_path):
    study = _study(
        tmp_path,
        "repeat_seconds = 2.0\nreference_seconds = 60.0\n"
        + SCENE
        + """
        [[method]]
        name = "hard"
        [[method]]
        name = "mitsuba"
        variant = ["scalar_rgb", "llvm_ad_mono"]
        samples = [4, 16]
        left_out = { boards = "a reason" }
        """,
    )
    assert study.options["repeat_seconds"] == 2
    assert study.options["reference_seconds"] == 60
    assert len(study.cases) == 2 * (1 + 4)
    mitsuba = [case for case in study.cases if isinstance(case.method, Direct)]
    assert {case.method.variant for case in mitsuba} == {"scalar_rgb", "llvm_ad_mono"}
    for case in study.cases:
        out = case.scene_name == "boards" and isinstance(case.method, Direct)
        assert case.left_out == ("a reason" if out else "")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[method]]\nname = "mitsuba"\nspp = 4', "method mitsuba: unknown 'spp'"),
        ('[[method]]\nname = "hard"\nleft_out = "tree"', "left_out: expected"),
        ('[[method]]\nname = "hard"\nleft_out = { tree = "slow" }', "left_out: unknown 'tree'"),
    ],
)
def test_a_study_s_errors_say_what_is_wrong(tmp_path, text, said):
    with pytest.raises(ValueError, match=said):
        _study(tmp_path, SCENE + text)


def test_a_reference_cannot_be_mitsuba(tmp_path):
    with pytest.raises(ValueError, match="reference: expected one method"):
        _study(tmp_path, 'reference = { name = "mitsuba" }' + SCENE)


def test_the_study_is_read_and_has_all_methods():
    study = read_study(BENCHES / "study.toml")
    names = {case.method.name.partition(" ")[0] for case in study.cases}
    # `auto` is one of two others, whichever takes less: `benches/auto.py` measures it.
    assert names == {*ss.method_names(), "mitsuba"} - {"auto"}
    assert len({case.scene_name for case in study.cases}) >= 8
    assert len({case.light_name for case in study.cases}) == 5


@needs_mitsuba
@needs_llvm
def test_the_study_s_short_form_writes_all_that_it_should(tmp_path):
    pytest.importorskip("mitsuba_oidn", reason="the optional extra")
    command = [sys.executable, BENCHES / "study.py", "--short", "--output", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    table = pd.read_parquet(tmp_path / "study.parquet")
    assert "error" not in table or table["error"].isna().all()
    assert set(table["scene"]) == {"boards", "fork"}
    for heading in ("Best on each scene", "First to reach an error", "Against Mitsuba"):
        assert heading in done.stdout
        assert heading in (tmp_path / "study.md").read_text()
    assert (tmp_path / "study.png").stat().st_size > 10_000
    page = (tmp_path / "study.html").read_text()
    assert page.count("<tr") > len(table)
