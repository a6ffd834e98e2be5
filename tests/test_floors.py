"""The core's modules use only what stands below them; methods do not use each other."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

SRC = Path(__file__).parents[1] / "src"

# From the ground up, as docs/architecture.md draws them.
FLOORS = [
    "error simd",
    "memory frame",
    "control",
    "light",
    "mesh camera",
    "geometry",
    "raster",
    "bvh sampling receivers",
    "scene",
    "method",
    "far",
    "casters textures",
    "maps",
    "methods",
    "render",
    "python",
]
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms.split()}


def _uses(path):
    """Whatever a module or its files name of the crate, without comments and tests."""
    files = [path] if path.is_file() else sorted(path.rglob("*.rs"))
    text = "\n".join(f.read_text().split("#[cfg(test)]")[0] for f in files if f.stem != "tests")
    text = re.sub(r"//.*", "", text)
    groups = re.findall(r"\bcrate::\{(.*?)\};", text, re.S)
    inside = [name for group in groups for name in re.findall(r"(?:^|,)\s*(\w+)", group)]
    return {*re.findall(r"\bcrate::(\w+)", text), *inside}


def _modules(folder):
    return {p.stem: p for p in sorted(folder.iterdir()) if p.stem not in ("lib", "mod")}


def test_every_module_has_a_floor():
    assert _modules(SRC).keys() == FLOOR.keys()


@pytest.mark.parametrize("room", FLOOR)
def test_modules_use_what_is_below_them(room):
    used = _uses(_modules(SRC)[room]) & FLOOR.keys() - {room}
    assert not [other for other in used if FLOOR[other] >= FLOOR[room]]


@pytest.mark.parametrize("method", _modules(SRC / "methods"))
def test_methods_do_not_use_each_other(method):
    path = _modules(SRC / "methods")[method]
    files = [path] if path.is_file() else sorted(path.rglob("*.rs"))
    others = _modules(SRC / "methods").keys() - {method}
    for file in files:
        # Paths from the crate, and from the folder of methods above a method's own.
        text = re.sub(r"//.*", "", file.read_text())
        named = set(re.findall(r"\bmethods::(\w+)", text))
        up = r"super::" if path.is_file() or file == path / "mod.rs" else r"super::super::"
        named |= set(re.findall(rf"(?<!super::)\b{up}(\w+)", text))
        assert not named & others, file
