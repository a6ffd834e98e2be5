"""Sweeps from the shell, and those of the documentation."""

from __future__ import annotations

import os
import pickle
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
import softshadow as ss
from softshadow import cli
from softshadow.sweep.references import REFERENCE
from softshadow.sweep.study import read_study
from sweeping import QUICK, SIZE

HERE = Path(__file__).parent


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
