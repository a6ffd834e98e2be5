"""Sweeps: cases and what they are known by, stores that survive a kill, executors, the command."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import json
import multiprocessing
import os
import pickle
import random
import re
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import softshadow as ss
from softshadow import cli
from softshadow.methods import resolve
from softshadow.sweep import columns, digests, groups, pools, running, work
from softshadow.sweep.references import REFERENCE, SHARE
from softshadow.sweep.store import FORMAT, Store
from softshadow.sweep.study import read_study

HERE = Path(__file__).parent
SIZE = {"width": 24, "height": 16}
CAMERA = ss.Camera((0, -4, 3), (0, 0, 0.3), **SIZE)
LIGHTS = {r: ss.SphereLight((0, 0, 4), float(r)) for r in ("0.2", "0.4", "0.6")}
QUICK = ss.RayTraced(samples=256, seed=7)
"""A reference that is soon made."""

TIMES = {"time", "machine"}


def board(height=1.0):
    """A board over a ground."""
    scene = ss.Scene()
    scene.add(ss.scenes.square(3))
    scene.add(ss.scenes.square(0.5, height), "board")
    return scene


def crowd(count):
    """So many small cases, of two scenes and three lights."""
    methods = [ss.RayTraced(samples=4, seed=i) for i in range(-(-count // 6))]
    scenes = {"low": board(0.8), "high": board(1.2)}
    return ss.grid(scenes, LIGHTS, CAMERA, methods)[:count]


def quick(cases, store, **options):
    return ss.sweep(cases, store, **{"reference": QUICK, "repeats": 1, "progress": False} | options)


def timeless(table):
    """A table without what differs from run to run."""
    names = [n for n in table.columns if n not in TIMES and "_seconds" not in n and n != "threads"]
    return table[names]


@pytest.fixture
def pool():
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(2, mp_context=context) as executor:
        yield executor


# ---------------------------------------------------------------- cases


def test_a_grid_is_a_product_with_names():
    cases = ss.grid(
        scene=[board, board, "models/box.ply"],
        light={"small": LIGHTS["0.2"], "two": (LIGHTS["0.2"], LIGHTS["0.4"])},
        camera=CAMERA,
        method=["hard", ss.RayTraced(samples=4)],
    )
    assert len(cases) == 3 * 2 * 1 * 2
    assert [c.scene_name for c in cases[::4]] == ["board", "board 2", "box"]
    assert [c.light_name for c in cases[:4]] == ["small", "small", "two", "two"]
    assert [c.label for c in cases[:2]] == ["hard", "ray_traced(samples=4)"]
    assert {c.camera_name for c in cases} == {"camera"}
    everything = ss.grid(board)
    assert [c.method.name for c in everything] == list(ss.method_names())
    assert everything[0].light_name == "own"


def test_cases_are_plain():
    case = ss.Case(board, LIGHTS["0.2"], CAMERA, "hard")
    same = ss.Case(board, LIGHTS["0.2"], CAMERA, ss.Hard())
    assert case == same == pickle.loads(pickle.dumps(case))
    assert len({case, same}) == 1
    with pytest.raises(AttributeError):
        case.label = "other"


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"scene": 3}, TypeError),
        ({"scene": board, "light": "sun"}, TypeError),
        ({"scene": board, "camera": "front"}, TypeError),
        ({"scene": board, "method": "unknown"}, ValueError),
        ({"scene": []}, ValueError),
    ],
)
def test_bad_cases_are_refused(arguments, error):
    with pytest.raises(error, match=r"^(scene|light|camera|method): "):
        ss.grid(**arguments)


def _keys(cases, tmp_path, **options):
    s = {"repeats": 1, "threads": None, "alone": True, "reference": QUICK, "images": None}
    store = Store(tmp_path / "keys")
    return running._Plan(store, cases, groups.Settings(**s | options), False).keys


def test_a_case_is_known_by_all_that_it_is_made_of(tmp_path):
    def key(scene=None, light=LIGHTS["0.2"], camera=CAMERA, method="hard", **options):
        case = ss.Case(board() if scene is None else scene, light, camera, method)
        return _keys([case], tmp_path, **options)[0]

    moved, looks, other = board(), board(), board()
    moved.set_transform("board", np.diag([1.0, 1, 1.0000001, 1]))
    looks.set_look("board", opacity=0.5)
    vertices = other["board"].vertices.copy()
    vertices[0, 0] = np.nextafter(vertices[0, 0], 1)
    other.set_vertices("board", vertices)
    keys = [
        key(),
        *map(key, (moved, looks, other)),
        key(light=LIGHTS["0.4"]),
        key(light=(LIGHTS["0.2"],)),
        key(camera=ss.Camera((0, -4, 3), (0, 0, 0.3), width=24, height=17)),
        key(method="ray_traced"),
        key(method=ss.RayTraced(samples=4)),
        key(repeats=2),
        key(threads=1),
        key(reference=ss.Hard()),
    ]
    assert len(set(keys)) == len(keys)
    assert key(scene=board) == key() == key(images=tmp_path)  # how it is made is not what it is


def test_digests_are_the_same_in_every_process_and_tell_kinds_apart():
    code = """
        import softshadow as ss, test_sweep as t
        from softshadow.sweep import digests
        print(digests.digest(t.board(), t.CAMERA, t.LIGHTS["0.2"], t.QUICK))
    """
    here = digests.digest(board(), CAMERA, LIGHTS["0.2"], QUICK)
    assert _program(code).stdout.split() == [here]
    kinds = [None, False, 0, 0.0, "", "0", (), ("",), (("",),), ("a", "b"), ("ab",)]
    assert len({digests.digest(kind) for kind in kinds}) == len(kinds)
    with pytest.raises(TypeError, match="object has no digest"):
        digests.digest(object())


# ---------------------------------------------------------------- tables


@pytest.fixture(scope="module")
def all_methods(tmp_path_factory):
    """The table of every method, and its folder."""
    folder = tmp_path_factory.mktemp("all")
    methods = [resolve(name) for name in ss.method_names()]
    for i, method in enumerate(methods):
        if "resolution" in method.parameters():
            methods[i] = dataclasses.replace(method, resolution=64)
    cases = ss.grid({"board": board}, LIGHTS["0.4"], {"front": CAMERA}, methods)
    return quick(cases, folder / "r.parquet", repeats=2, images=folder / "pictures"), folder


def test_a_row_has_all_that_is_known_of_a_case(all_methods):
    table, folder = all_methods
    assert list(table["method"]) == list(ss.method_names())
    assert table["error"].isna().all()
    assert (table["scene"] == "board").all()
    assert (table["camera"] == "front").all()
    assert table["more_stages"].isna().all(), "a stage that has no columns"
    for name in ("prepare", "frame", "shade"):
        median, least, spread = (table[c] for c in columns.seconds_columns(name))
        assert (least <= median).all()
        assert (median <= least + spread).all()
    assert (table["repeats"] == 2).all()
    assert set(table["threads"]) == {ss.thread_count()}
    assert set(table["version"]) == {ss.__version__}
    assert set(table["machine"]) == {work.machine()}
    row = table.set_index("method").loc["ray_traced"]
    assert (row["samples"], row["seed"], row["pattern"], row["cull"]) == (
        256,
        0,
        "per_receiver",
        True,
    )
    image = ss.render(board(), CAMERA, LIGHTS["0.4"])
    truth = np.mean(
        [
            ss.render(board(), CAMERA, LIGHTS["0.4"], ss.RayTraced(samples=256, seed=s)).visibility
            for s in (7, 8)
        ],
        axis=0,
    )
    expected = ss.metrics.errors(image.visibility, truth, image.mask)
    assert {name: row[name] for name in columns.METRICS} == pytest.approx(expected, abs=1e-6)
    with np.load(row["image"]) as picture:
        assert np.array_equal(picture["visibility"], image.visibility)
        assert np.array_equal(picture["mask"], image.mask)
        assert picture["reference"] == pytest.approx(truth, abs=1e-6)
    assert Path(row["image"]).parent == folder / "pictures"


def test_every_parameter_of_every_method_has_a_column(all_methods):
    table, _ = all_methods
    known = columns.parameter_columns()
    assert len({column for column, _ in known.values()}) == len(known)
    for _, row in table.iterrows():
        values = resolve(row["method"]).parameters()
        values.update({"resolution": 64} if "resolution" in values else {})
        for name, value in values.items():
            cell = row[known[name][0]]
            assert pd.isna(cell) if value is None else cell == value, (row["method"], name)


def test_references_are_made_once_and_are_as_good_as_they_have_to_be(tmp_path):
    cases = ss.grid(board, LIGHTS["0.4"], CAMERA, ["hard", ss.RayTraced(samples=64)])
    store = tmp_path / "r.parquet"
    rough = quick(cases[:1], store, reference=None)
    assert rough["reference_converged"].all()
    halves = "ray_traced(seed=24301), ray_traced(seed=24302)"
    assert rough["reference"][0] == f"2 x 256 samples: {halves}"
    fine = quick(cases, store, reference=None)
    assert fine["reference_converged"].all()
    assert fine["reference_rmse"][1] <= SHARE * fine["rmse"][1]
    assert fine["reference_rmse"][1] < fine["reference_rmse"][0]
    assert fine["reference"][0] == rough["reference"][0], "a row says what it was measured against"
    assert len(list((store / "_references").glob("*.npz"))) == 1
    # The error that it says that it has is the one that it has.
    truth = ss.render(board(), CAMERA, LIGHTS["0.4"], ss.RayTraced(samples=65536, seed=99))
    own = [
        ss.render(board(), CAMERA, LIGHTS["0.4"], ss.RayTraced(samples=256, seed=s)).visibility
        for s in (24301, 24302)
    ]
    rmse = ss.metrics.rmse(np.mean(own, axis=0), truth.visibility, truth.mask)
    assert rough["reference_rmse"][0] == pytest.approx(rmse, rel=0.5)
    single = quick(cases[:1], tmp_path / "s.parquet", reference="hard")
    assert single["rmse"][0] == 0
    assert np.isnan(single["reference_rmse"][0])
    assert not single["reference_converged"][0]


def test_methods_of_a_scene_take_turns(tmp_path, monkeypatch):
    order = []
    real = work.run

    def told(task, source):
        order.append(tuple(m.name for m in task.methods))
        return real(task, source)

    monkeypatch.setattr(pools, "run", told)
    quick(ss.grid(board, LIGHTS["0.4"], CAMERA, ["hard", "wedges"]), tmp_path / "r", repeats=3)
    both = [("ray_traced", "ray_traced")]
    assert order == [("hard",), ("wedges",), *both, *[("hard",), ("wedges",)] * 2]


def test_repeats_of_two_machines_are_not_pooled(tmp_path, monkeypatch):
    machines = iter(["a", "b", "b", "a", "b", "b", "b"])
    real = work.run

    def elsewhere(task, source):
        outcome = real(task, source)
        vars(outcome)["machine"] = next(machines)
        vars(outcome)["seconds"].update(frame=1.0 if outcome.machine == "a" else 2.0)
        return outcome

    monkeypatch.setattr(pools, "run", elsewhere)
    table = quick(ss.grid(board, LIGHTS["0.4"], CAMERA, "hard"), tmp_path / "r", repeats=2)
    # Turns on a, b (a reference) and a: two of one machine.
    assert table["machine"][0] == "a"
    assert table["frame_seconds_spread"][0] == 0


def test_threads_are_set_and_recorded(tmp_path):
    cases = ss.grid(board, LIGHTS["0.4"], CAMERA, "hard")
    before = ss.thread_count()
    assert quick(cases, tmp_path / "r", threads=3)["threads"][0] == 3
    assert ss.thread_count() == before


# ---------------------------------------------------------------- stores


def test_what_is_done_is_not_done_again(tmp_path, monkeypatch):
    cases = ss.grid({"a": board(), "b": board(1.1)}, LIGHTS["0.4"], CAMERA, ["hard", "wedges"])
    store = tmp_path / "r.parquet"
    first = quick(cases, store)
    assert list(first["scene"]) == ["a", "a", "b", "b"]
    changed = board()
    changed.set_look("board", albedo=0.1)
    runs = []
    real = work.run
    monkeypatch.setattr(pools, "run", lambda *a: runs.append(a[0].name) or real(*a))
    assert quick(cases, store).equals(first)
    renamed = quick(ss.grid({"z": board()}, LIGHTS["0.4"], CAMERA, ["wedges"]), store)
    assert renamed["scene"][0] == "z"
    assert renamed["frame_seconds"][0] == first["frame_seconds"][1]
    assert not runs
    again = quick(ss.grid({"a": changed}, LIGHTS["0.4"], CAMERA, ["hard", "wedges"]), store)
    assert len(runs) == 3  # two cases, a reference
    assert set(again["key"]).isdisjoint(first["key"])
    assert len(pd.read_parquet(store)) == 6
    pictured = quick(cases, store, images=tmp_path / "images")
    assert len(runs) == 3 + 4
    assert pictured["image"].map(os.path.exists).all()


def test_other_stores_are_refused_and_kept(tmp_path):
    cases = ss.grid(board, LIGHTS["0.4"], CAMERA, "hard")
    store = tmp_path / "r.parquet"
    first = quick(cases, store)
    left = store / "_turns" / f"{first['key'][0]}-0.json"  # killed just after the part was written
    left.write_text("{}")
    assert quick(cases, store).equals(first)
    assert not left.exists()
    mark = store / "_softshadow.json"
    said = json.loads(mark.read_text())
    assert said["format"] == FORMAT
    mark.write_text(json.dumps(said | {"format": FORMAT + 1}))
    (tmp_path / "file.parquet").write_text("mine")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "a.parquet").write_text("mine")
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "_softshadow.json").write_text("[]")
    everything = sorted(p for p in tmp_path.rglob("*"))
    for name, words in {
        "r.parquet": f"has version {FORMAT + 1} of the format",
        "file.parquet": "is a file",
        "folder": "is no store of a sweep",
        "odd": "is not what a sweep writes",
    }.items():
        with pytest.raises(ValueError, match=rf"^store: .*{words}.* kept"):
            quick(cases, tmp_path / name)
    assert sorted(p for p in tmp_path.rglob("*")) == everything
    (tmp_path / "empty").mkdir()
    quick(cases, tmp_path / "empty")


def test_two_processes_do_not_write_to_one_store(tmp_path):
    code = """
        import sys, test_sweep as t
        t.quick(t.crowd(2), sys.argv[1])
    """
    store = Store(tmp_path / "r")
    with store.writing():
        done = _program(code, store.path)
    assert "another process is writing" in done.stderr
    assert _program(code, store.path).returncode == 0


def test_failures_are_rows(tmp_path, monkeypatch):
    def broken():
        raise RuntimeError("no mesh today")

    away = ss.Camera((0, -4, 3), (0, -8, 9), **SIZE)
    glass = board()
    glass.set_look("board", opacity=0.5)
    cases = [
        ss.Case(broken, LIGHTS["0.4"], CAMERA, "hard"),
        ss.Case("nothing.ply"),
        ss.Case(board, lambda its: 3, CAMERA, "hard", light_name="three"),
        ss.Case(board, LIGHTS["0.4"], away, "hard"),
        ss.Case(glass, LIGHTS["0.4"], CAMERA, "wedges"),
        ss.Case(board, LIGHTS["0.4"], CAMERA, "hard"),
    ]
    table = quick(cases, tmp_path / "r")
    for error, words in zip(
        table["error"][:5],
        ["no mesh today", "nothing.ply", "light: expected", "sees no surface", "opacity"],
        strict=True,
    ):
        assert words in error
    assert pd.isna(table["error"][5])
    assert table["rmse"][:5].isna().all()
    assert len(pd.read_parquet(tmp_path / "r")) == 6
    runs = []
    real = work.run
    monkeypatch.setattr(pools, "run", lambda *a: runs.append(a[0].name) or real(*a))
    quick(cases, tmp_path / "r")
    assert not runs
    again = quick(cases, tmp_path / "r", retry=True)
    assert runs  # the glass, and the camera that sees nothing
    assert timeless(again).equals(timeless(table))


def test_a_reference_that_fails_is_said_in_the_rows(tmp_path):
    glass = board()
    glass.set_look("board", opacity=0.5)
    cases = ss.grid(glass, LIGHTS["0.4"], CAMERA, ["hard", "deep"])
    table = quick(cases, tmp_path / "r", reference="wedges")
    assert table["error"].str.startswith("reference: UnsupportedError: ").all()
    assert (table["frame_seconds"] > 0).all()


def test_a_reader_opens_a_store_that_grows(tmp_path):
    duckdb = pytest.importorskip("duckdb")
    store = tmp_path / "r.parquet"
    seen = []

    def told(fraction):
        if list(store.glob("part-*")):
            table = pd.read_parquet(store)
            count = duckdb.sql(f"select count(*) from '{store}/*.parquet'").fetchall()[0][0]
            seen.append((len(table), count))
            assert table["rmse"].notna().all()

    quick(crowd(8), store, progress=told, repeats=2)
    assert {a for a, _ in seen} == set(range(1, 9))
    assert all(a == b for a, b in seen)


# ---------------------------------------------------------------- kills


def _program(code, *arguments, **options):
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(HERE)},
        capture_output=True,
        text=True,
        timeout=300,
        **options,
    )


SWEEP_A_CROWD = """
import sys
import test_sweep as t
from softshadow.sweep import pools, work

real = work.run
def told(task, source):
    with open(sys.argv[2], "a") as log:
        print("begins", task.name, file=log, flush=True)
        outcome = real(task, source)
        print("ends", task.name, file=log, flush=True)
    return outcome

pools.run = told
t.quick(t.crowd(int(sys.argv[3])), sys.argv[1], repeats=2)
"""


def _killed_three_times(tmp_path, count):
    store, log = tmp_path / "r.parquet", tmp_path / "log"
    dice = random.Random(5)
    for kill in range(4):
        process = subprocess.Popen(
            [sys.executable, "-c", SWEEP_A_CROWD, str(store), str(log), str(count)],
            env={**os.environ, "PYTHONPATH": str(HERE)},
        )
        if kill == 3:
            assert process.wait(600) == 0
            break
        # At a random moment after a random number of further tasks.
        begun = log.read_text().count("ends") if log.exists() else 0
        wanted = begun + dice.randint(count // 6, count // 2)
        while process.poll() is None and (
            not log.exists() or log.read_text().count("ends") < wanted
        ):
            time.sleep(0.002)
        time.sleep(dice.random() * 0.02)
        assert process.poll() is None, "it ended before it was killed"
        process.send_signal(signal.SIGKILL)
        process.wait()
    table = pd.read_parquet(store)
    assert len(table) == count
    assert table["key"].is_unique
    assert table["error"].isna().all()
    ended = [line for line in log.read_text().splitlines() if line.startswith("ends ")]
    # Every repeat once, and at most what was interrupted a second time, at each kill.
    assert len(ended) - len(set(ended)) <= 3
    references = [line for line in ended if line.startswith("ends reference")]
    assert 6 <= len(references) <= 9
    assert 2 * count <= len(ended) - len(references) <= 2 * count + 3
    assert not list((store / "_turns").iterdir())
    expected = quick(crowd(count), tmp_path / "whole.parquet", repeats=2)
    names = [*columns.METRICS, "label", "light", "bytes"]
    found = table.set_index("key").loc[expected["key"]].reset_index()
    pd.testing.assert_frame_equal(found[names], expected[names])


def test_a_sweep_that_is_killed_three_times_loses_nothing(tmp_path):
    _killed_three_times(tmp_path, 60)


@pytest.mark.slow
def test_a_long_sweep_that_is_killed_three_times_loses_nothing(tmp_path):
    _killed_three_times(tmp_path, 500)


# ---------------------------------------------------------------- executors


def test_a_pool_of_processes_makes_the_same_table(tmp_path, pool):
    cases = crowd(12)
    here = quick(cases, tmp_path / "here", repeats=2)
    there = quick(cases, tmp_path / "there", executor=pool, repeats=2)
    pd.testing.assert_frame_equal(timeless(there), timeless(here))


@pytest.mark.parametrize("reached", [True, False])
def test_a_scene_travels_by_a_file_or_to_who_cannot_read_it(tmp_path, monkeypatch, pool, reached):
    sent = []
    real = pools.Pool.submit

    def told(self, task, source, where):
        sent.append(source)
        elsewhere = isinstance(source, str) and not reached
        return real(self, task, "/nowhere" if elsewhere else source, where)

    monkeypatch.setattr(pools.Pool, "submit", told)
    methods = [ss.RayTraced(samples=4, seed=i) for i in range(9)]
    cases = ss.grid(board(), LIGHTS["0.4"], CAMERA, methods)
    table = quick(cases, tmp_path / "r", executor=pool, repeats=2)
    assert table["error"].isna().all()
    travelled = [source for source in sent if not isinstance(source, str)]
    assert len(travelled) < len(sent) / 2
    assert bool(travelled) != reached
    files = {source for source in sent if isinstance(source, str)}
    assert len(files) == 1
    assert not Path(files.pop()).exists()


def test_a_worker_that_crashes_is_a_row_and_the_sweep_goes_on(tmp_path, pool, monkeypatch):
    monkeypatch.setattr(pools, "run", crash_on_ssoc)
    cases = ss.grid(board, LIGHTS["0.4"], CAMERA, ["hard", "ssoc", "wedges", "shadow_volume"])
    table = ss.sweep(cases, tmp_path / "r", pool, QUICK, 2, progress=False)
    assert table["error"][1].startswith("the worker process died")
    assert table["error"].isna().sum() == 3
    assert table["rmse"].notna().sum() == 3


def crash_on_ssoc(task, source):
    if task.methods[0].name == "ssoc":
        os.kill(os.getpid(), signal.SIGKILL)
    return work.run(task, source)


def crash_on_odd_seeds(task, source):
    if getattr(task.methods[0], "seed", 0) in (1, 3, 5):
        os.kill(os.getpid(), signal.SIGKILL)
    return work.run(task, source)


def test_only_cases_that_crash_by_themselves_have_failed(tmp_path, pool, monkeypatch):
    monkeypatch.setattr(pools, "run", crash_on_odd_seeds)
    methods = [ss.RayTraced(samples=4, seed=seed) for seed in range(6)]
    cases = ss.grid(board, LIGHTS["0.4"], CAMERA, methods)
    table = quick(cases, tmp_path / "r", executor=pool, alone=False)
    assert table["error"].notna().tolist() == [False, True] * 3


def kill_a_worker_once(task, source):
    """Run a task; the first of wedges kills its worker."""
    if task.methods[0].name == "wedges":
        try:
            os.close(os.open(os.environ["SWEEP_KILLED"], os.O_CREAT | os.O_EXCL))
            os.kill(os.getpid(), signal.SIGKILL)
        except FileExistsError:
            pass
    return work.run(task, source)


@pytest.mark.parametrize("killed", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_dask_cluster_makes_the_same_table(tmp_path, monkeypatch, killed):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setenv("SWEEP_KILLED", str(tmp_path / "killed"))
    monkeypatch.setenv("PYTHONPATH", str(HERE))
    cases = ss.grid(board, LIGHTS, CAMERA, ["hard", "wedges", ss.RayTraced(samples=4)])
    here = quick(cases, tmp_path / "here", repeats=2)
    if killed:
        monkeypatch.setattr(pools, "run", kill_a_worker_once)
    with (
        distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        there = ss.sweep(cases, tmp_path / "there", client.get_executor(), QUICK, 2, progress=False)
    assert (tmp_path / "killed").exists() == killed
    pd.testing.assert_frame_equal(timeless(there), timeless(here))


@pytest.mark.slow
def test_a_long_sweep_goes_on_when_dask_s_workers_are_killed(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setenv("PYTHONPATH", str(HERE))
    dice = random.Random(6)
    store = tmp_path / "r"
    wanted = [dice.randrange(a, a + 100) for a in (20, 180, 340)]  # rows, at each kill
    with (
        distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):

        def told(fraction):
            if wanted and len(list(store.glob("part-*"))) >= wanted[0]:
                del wanted[0]
                workers = list(client.run(os.getpid).values())
                os.kill(dice.choice(workers), signal.SIGKILL)

        executor = client.get_executor()
        table = quick(crowd(500), store, executor=executor, progress=told, repeats=2)
    assert not wanted
    assert len(pd.read_parquet(store)) == 500
    expected = quick(crowd(500), tmp_path / "here", repeats=2)
    pd.testing.assert_frame_equal(timeless(table), timeless(expected))


def test_other_kinds_of_executors_work(tmp_path):
    with concurrent.futures.ThreadPoolExecutor(3) as executor:
        table = quick(crowd(6), tmp_path / "r", executor=executor)
    assert table["error"].isna().all()
    with pytest.raises(TypeError, match="executor: expected"):
        quick(crowd(1), tmp_path / "s", executor="threads")


def test_arguments_are_checked(tmp_path):
    for cases, error in ((["hard"], TypeError), ([], ValueError)):
        with pytest.raises(error, match=r"^cases: "):
            quick(cases, tmp_path / "r")
    for option in ({"repeats": 0}, {"threads": 0}, {"alone": 1}, {"retry": "no"}):
        with pytest.raises((TypeError, ValueError), match=rf"^{next(iter(option))}: "):
            quick(crowd(1), tmp_path / "r", **option)


# ---------------------------------------------------------------- the command


STUDY = """
store = "study.parquet"
repeats = 1
size = [24, 16]
workers = 0
reference = { name = "ray_traced", samples = 256, seed = 7 }

[scene.plane]
factory = "half_plane"

[scene.box]
path = "box.ply"

[light.small]
kind = "sphere"
size = 0.1

[light.fixed]
kind = "disk"
center = [0, 0, 4]
normal = [0, 0, -1]
radius = 0.3

[[method]]
name = "ray_traced"
samples = [4, 16]
seed = [0, 1]

[[method]]
name = "hard"
"""


@pytest.fixture
def study(tmp_path):
    import trimesh

    trimesh.creation.box().export(tmp_path / "box.ply")
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    return path


def test_the_command_sweeps_a_study(study, capsys):
    assert cli.main(["sweep", str(study)]) == 0
    said = capsys.readouterr()
    store = study.parent / "study.parquet"
    assert said.out == f"{store}: 20 cases, 0 failed\n"
    assert "of 20 cases left" in said.err
    table = pd.read_parquet(store)
    assert set(table["scene"]) == {"plane", "box"}
    assert set(table["light"]) == {"small", "fixed"}
    assert set(table["label"]) == {
        *("hard", "ray_traced(samples=4)", "ray_traced(samples=16)"),
        *("ray_traced(samples=4, seed=1)", "ray_traced(samples=16, seed=1)"),
    }
    pickle.dumps(read_study(study).cases)
    begin = time.monotonic()
    assert cli.main(["sweep", str(study)]) == 0
    assert time.monotonic() - begin < 5


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("repeats", "repeat", "unknown 'repeat'"),
        ('"sphere"', '"cone"', "light.small: unknown kind 'cone'"),
        ("radius = 0.3", "diameter = 0.3", "light.fixed: .*'radius'"),
        ("samples = [4, 16]", "sample = 4", "method ray_traced: unknown 'sample'"),
        ('path = "box.ply"', "", "scene.box: expected a path or a factory"),
        ("[24, 16]", "24", "size: expected"),
        ("workers = 0", "workers = -1", "workers: expected"),
        ("[scene.plane]", "[scene.plane", "study.toml"),
    ],
)
def test_mistakes_in_a_study_are_one_line(study, capsys, before, after, words):
    study.write_text(STUDY.replace(before, after, 1))
    assert cli.main(["sweep", str(study)]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert re.match(rf"error: .*{words}", err), err
    assert not (study.parent / "study.parquet").exists()


def test_the_first_program_of_the_documentation_runs(tmp_path, monkeypatch):
    page = (HERE.parent / "docs" / "sweeps.md").read_text()
    program = re.findall(r"^```python\n(.*?)^```$", page, re.M | re.S)[0]
    small = {"small": lambda its: ss.Camera(its.camera.eye, (0, 0, 0), **SIZE)}
    grid, sweep = ss.grid, ss.sweep
    monkeypatch.setattr(ss, "grid", lambda **axes: grid(**axes, camera=small))
    monkeypatch.setattr(ss, "sweep", lambda *a, **k: sweep(*a, **k, reference=QUICK, repeats=1))
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(program, names)
    assert names["table"]["error"].isna().all()
    assert len(names["table"]) == 16


def test_the_study_of_the_documentation_is_one(tmp_path):
    page = (HERE.parent / "docs" / "sweeps.md").read_text()
    (text,) = re.findall(r"^```toml\n(.*?)^```$", page, re.M | re.S)
    (tmp_path / "study.toml").write_text(text)
    found = read_study(tmp_path / "study.toml")
    assert len(found.cases) == 2 * 2 * 1 * 4
    assert found.options["reference"] == REFERENCE


def _many(study, workers):
    """A study of hundreds of cases, and the process that begins to sweep it."""
    many = STUDY.replace("[0, 1]", str(list(range(40))))
    study.write_text(many.replace("workers = 0", f"workers = {workers}"))
    return subprocess.Popen(
        [sys.executable, "-m", "softshadow", "sweep", str(study)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def _await_parts(process, store, count):
    while process.poll() is None and len(list(store.glob("part-*"))) < count:
        time.sleep(0.01)
    assert process.poll() is None


def _alive(group):
    """The processes of a group, without those that have ended and wait for their parent."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, its = path.read_text().rpartition(")")[2].split()[:3]
        except OSError:  # gone meanwhile
            continue
        if int(its) == group and state != "Z":
            found.append(int(path.parent.name))
    return found


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="there is no /proc here")
def test_workers_end_with_a_command_that_is_killed(study):
    process = _many(study, workers=1)
    _await_parts(process, study.parent / "study.parquet", 3)
    process.kill()
    process.communicate(timeout=30)
    deadline = time.monotonic() + 20
    while left := _alive(process.pid):
        if time.monotonic() > deadline:
            os.killpg(process.pid, signal.SIGKILL)
            pytest.fail(f"{left} stayed")
        time.sleep(0.05)


@pytest.mark.parametrize("workers", [0, 1])
def test_ctrl_c_leaves_a_store_that_goes_on(study, workers):
    store = study.parent / "study.parquet"
    before: dict[Path, int] = {}
    for _ in range(2):
        wanted = len(before) + 5
        process = _many(study, workers)
        _await_parts(process, store, wanted)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        _, err = process.communicate(timeout=30)
        assert process.returncode == 130, err
        assert f"interrupted; the same command goes on with {store}" in err
        assert "Traceback" not in err
        now = {p: p.stat().st_mtime_ns for p in store.glob("part-*")}
        assert wanted <= len(now) < 324
        assert before.items() <= now.items()  # what was done is as it was
        assert len(pd.read_parquet(store)) == len(now)
        before = now
