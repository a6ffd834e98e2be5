"""Sweeps: cases and what they are known by, rows, references, stores."""

from __future__ import annotations

import dataclasses
import json
import os
import pickle
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import softshadow as ss
from softshadow.methods import resolve
from softshadow.sweep import columns, digests, groups, pools, running, work
from softshadow.sweep.references import SHARE
from softshadow.sweep.store import FORMAT, Store
from sweeping import CAMERA, LIGHTS, QUICK, SIZE, board, crowd, quick, timeless

HERE = Path(__file__).parent


def _program(code, *arguments, **options):
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(HERE)},
        capture_output=True,
        text=True,
        timeout=300,
        **options,
    )


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
    mapped, entry = ss.Scene(), board()["board"]
    mapped.add((entry.vertices, entry.faces), "board", uv=entry.vertices[:, :2])
    plain = ss.Scene()
    plain.add((entry.vertices, entry.faces), "board")
    assert key(scene=mapped) == key(scene=plain)  # no picture has them


def test_digests_are_the_same_in_every_process_and_tell_kinds_apart():
    code = """
        import softshadow as ss, sweeping as t
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
        import sys, sweeping as t
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


def test_arguments_are_checked(tmp_path):
    for cases, error in ((["hard"], TypeError), ([], ValueError)):
        with pytest.raises(error, match=r"^cases: "):
            quick(cases, tmp_path / "r")
    for option in ({"repeats": 0}, {"threads": 0}, {"alone": 1}, {"retry": "no"}):
        with pytest.raises((TypeError, ValueError), match=rf"^{next(iter(option))}: "):
            quick(crowd(1), tmp_path / "r", **option)
