"""Interrupted calls stop working, not only answer."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path

import pytest
import softshadow as ss
from shapes import bumpy, quad

TASKS = Path("/proc/self/task")
pytestmark = pytest.mark.skipif(not TASKS.exists(), reason="needs the threads' names of Linux")

# Seconds of all threads' processor time after the interrupt, which other processes do not add to:
# what the design allows the answer, on two cores, and what freeing the maps takes. Before, up
# to 9.9 s at a resolution of 4096.
MOST = 0.2 * (os.cpu_count() or 1) + 0.2


class Stop(Exception):
    pass


def _working() -> bool:
    """Whether a call's thread is still there; those of its pool, which have numbers, stay."""

    def name(task: Path) -> str:
        try:
            return (task / "comm").read_text()
        except OSError:  # it has just ended
            return ""

    return any(name(task).strip() == "softshadow" for task in TASKS.iterdir())


def _after_interrupt(call, seconds: float) -> float:
    """Processor time that a call takes after it was interrupted."""
    start = time.process_time()

    def interrupt(_):
        if time.process_time() - start > seconds:
            raise Stop

    with contextlib.suppress(Stop):
        call(interrupt)
    before = time.process_time()
    deadline = time.monotonic() + 60
    while _working() and time.monotonic() < deadline:
        time.sleep(0.002)
    assert not _working()
    return time.process_time() - before


METHODS = {
    "slsm": ss.Slsm(resolution=1536),
    "mtsm": ss.Mtsm(resolution=1024, layers=4),
    "mvsm": ss.Mvsm(resolution=1024),
    "deep": ss.DeepShadow(resolution=1536),
    "ssoc": ss.Ssoc(resolution=2048),
    "distorted ssoc": ss.Ssoc(resolution=1024, distorted=True),
    "convolution": ss.Convolution(max_size=256),
    "accumulation": ss.Accumulation(max_size=512, samples=256),
}


@pytest.mark.parametrize("name", METHODS)
def test_work_ends_soon_after_an_interrupt(name):
    """At two places of the work, found by the processor time that all of it takes."""
    scene = ss.Scene()
    scene.add(bumpy(20), opacity=0.5 if name in ("mtsm", "deep") else 1)
    scene.add(quad((0, 0, -1), (4, 0, 0), (0, 4, 0)))
    light = ss.SphereLight((0.5, -1, 4), 0.3)
    camera = ss.Camera((0, -5, 2), (0, 0, 0), width=48, height=48)

    def call(progress):
        return ss.render(scene, camera, light, METHODS[name], progress=progress)

    start = time.process_time()
    call(None)
    whole = time.process_time() - start
    for part in (0.3, 0.7):
        assert _after_interrupt(call, part * whole) < MOST, part
