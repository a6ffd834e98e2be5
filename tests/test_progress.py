"""One bar or one callback a call: told 0 and 1, stopped by the callback's exception, left clean."""

from __future__ import annotations

import os
import signal
import threading

import numpy as np
import pytest
import softshadow as ss
import tqdm.auto
from shapes import bumpy, quad

LIGHT = ss.RectLight((0, 0, 4), (0, 0.5, 0), (0.5, 0, 0))
CAMERA = ss.Camera((0, -4, 3), (0, 0, 0.3), width=32, height=24)
POINTS, NORMALS = np.tile([[0.3, 0, 0.0]], (5, 1)), np.tile([[0, 0, 1.0]], (5, 1))
MESH = bumpy(4)
UV = {"board": [(0, 0), (0.5, 0), (0.5, 1), (0, 1)]}
CORNERS = (-2, -2, 0), (4, 0, 0), (0, 4, 0)


def _scene():
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), "ground")
    scene.add(quad((0, 0, 1), (1, 0, 0), (0, 1, 0)), "board")
    return scene


def _bake(method):
    return lambda p: ss.bake(_scene(), LIGHT, "ground", method, max_size=16, progress=p)


CALLS = {
    "prepare": lambda p: ss.prepare(_scene(), LIGHT, "hard", p),
    "frame": lambda p: ss.prepare(_scene(), LIGHT, "hard").render(CAMERA, p),
    "render": lambda p: ss.render(_scene(), CAMERA, LIGHT, "ray_traced", p),
    "visibility": lambda p: ss.visibility(_scene(), POINTS, NORMALS, LIGHT, "hard", p),
    "compare": lambda p: ss.compare(_scene(), CAMERA, LIGHT, ["hard"], "hard", 2, p),
    "bake": _bake("accumulation"),
    "bake points": _bake("hard"),
    "bake uv": lambda p: ss.bake(_scene(), LIGHT, method="hard", uv=UV, size=8, progress=p),
    "refine": lambda p: ss.bake(_scene(), LIGHT, "ground", max_size=16).refine(progress=p),
    "transmittance": lambda p: ss.kernels.transmittance(_scene(), POINTS, POINTS + 1, p),
    "rasterize": lambda p: ss.kernels.rasterize(*MESH, CAMERA, p),
    "accumulate": lambda p: ss.kernels.accumulate(*MESH, [(0, 0, 9)], *CORNERS, (8, 8), progress=p),
    "convolve_shadow": lambda p: ss.kernels.convolve_shadow(
        np.eye(8), LIGHT, *CORNERS, 0.5, progress=p
    ),
    "light_intensity": lambda p: ss.kernels.light_intensity(_scene(), CAMERA, LIGHT, progress=p),
    "outer_distances": lambda p: ss.kernels.outer_distances(
        _scene(), POINTS, NORMALS, LIGHT, progress=p
    ),
    "ssoc_maps": lambda p: ss.kernels.ssoc_maps(_scene(), LIGHT, ss.Ssoc(32), p),
    "layered_maps": lambda p: ss.kernels.layered_maps(_scene(), LIGHT, ss.Slsm(32), p),
    "trace_layered_maps": lambda p: ss.kernels.trace_layered_maps(
        [], LIGHT, POINTS, NORMALS, progress=p
    ),
}


class _Mine(Exception):
    pass


@pytest.mark.parametrize("name", CALLS)
def test_quick_calls_tell_the_beginning_and_the_end(name):
    told = []
    CALLS[name](told.append)
    assert told[0] == 0
    assert told[-1] == 1
    assert told == sorted(told)
    assert all(type(x) is float for x in told)


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("when", ["beginning", "end"])
def test_the_callbacks_exception_is_what_the_caller_gets(name, when):
    error = _Mine("enough")

    def callback(fraction):
        if (fraction == 0) if when == "beginning" else (fraction == 1):
            raise error

    with pytest.raises(_Mine) as caught:
        CALLS[name](callback)
    assert caught.value is error
    CALLS[name](False)  # and the next call works


@pytest.fixture
def bars(monkeypatch):
    """All bars that were made."""
    made = []

    class Bar(tqdm.auto.tqdm):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            made.append(self)
            self.closed = 0

        def close(self):
            self.closed += 1
            super().close()

    monkeypatch.setattr(tqdm.auto, "tqdm", Bar)
    return made


def _screen(text):
    """What a terminal shows after some text: a carriage return goes back to the line's start."""
    lines = []
    for line in text.split("\n"):
        shown = ""
        for part in line.split("\r"):
            shown = part + shown[len(part) :]
        lines.append(shown.rstrip())
    return "\n".join(lines)


@pytest.mark.parametrize("name", CALLS)
def test_one_bar_a_call_which_is_gone_at_the_end(name, bars, capsys):
    CALLS[name](True)
    assert len(bars) == 1
    assert bars[0].closed
    assert bars[0].n == 1
    said = capsys.readouterr()
    assert "%|" in said.err
    assert not _screen(said.err).strip()
    assert not said.out


def test_a_bar_is_gone_after_an_error(bars, capsys):
    with pytest.raises(ss.UnsupportedError):
        ss.render(ss.scenes.tilted_sheet(8, 8).scene, CAMERA, LIGHT, "wedges", progress=True)
    assert len(bars) == 1
    assert bars[0].closed
    assert not _screen(capsys.readouterr().err).strip()


def test_a_bar_is_gone_after_an_interrupt(bars, capsys):
    scene = ss.Scene()
    scene.add(bumpy(20))
    large = ss.Camera((0, -4, 3), (0, 0, 0.3), width=2048, height=2048)
    slow = ss.RayTraced(samples=4096, cull=False)
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        ss.render(scene, large, LIGHT, slow, progress=True)
    timer.join()
    assert len(bars) == 1
    assert bars[0].closed
    assert not _screen(capsys.readouterr().err).strip()


@pytest.mark.parametrize("progress", [False, None, np.False_])
def test_silence_is_kept(progress, bars, capsys):
    CALLS["render"](progress)
    assert not bars
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("progress", ["yes", 1, 0.5, [True]])
def test_other_things_are_no_progress(progress):
    for call in CALLS.values():
        with pytest.raises(TypeError, match="progress: expected"):
            call(progress)
