"""Sweeps that are killed, and sweeps in other processes and on clusters."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
import softshadow as ss
from softshadow.sweep import columns, pools, work
from sweeping import CAMERA, LIGHTS, QUICK, board, crowd, quick, timeless

HERE = Path(__file__).parent


@pytest.fixture
def pool():
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(2, mp_context=context) as executor:
        yield executor


# ---------------------------------------------------------------- kills


SWEEP_A_CROWD = """
import sys
import sweeping as t
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
