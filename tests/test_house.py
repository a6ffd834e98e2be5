"""What keeps the core's floors: no loops, methods apart, light shapes asked for by name."""

from __future__ import annotations

import copy
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from types import SimpleNamespace

import pytest
import softshadow as ss
from softshadow import _core
from softshadow.methods import resolve

SRC = Path(__file__).parents[1] / "src"


def _code(file):
    """Return a file's text without comments and without its tests."""
    text = re.split(r"#\[cfg\(test\)\]\s*mod tests \{", file.read_text())[0]
    return re.sub(r"//.*", "", text)


def _modules():
    found = {}
    for file in SRC.rglob("*.rs"):
        path = file.relative_to(SRC).with_suffix("").parts
        path = path[:-1] if path[-1] == "mod" else path
        if path != ("lib",) and path[-1] != "tests":
            found[path] = file
    return found


MODULES = _modules()


def _paths(text):
    """Yield every path that starts with `crate` or `super`, groups in braces taken apart."""
    for start, rest in re.findall(r"\b(crate|(?:super::)*super)::([A-Za-z_0-9:{},\s*]*)", text):
        head, _, group = rest.partition("{")
        head = tuple(name for name in re.sub(r"\s", "", head).split("::") if name)
        names = [name.strip() for name in re.split(r"[,}]", group) if name.strip()] or [""]
        for name in names:
            yield start, head + tuple(part for part in name.split("::") if part)


def _uses(module):
    """Return the modules that one uses, itself, its own parts and what it is a part of apart."""
    file = MODULES[module]
    base = module if file.name == "mod.rs" else module[:-1]
    out = set()
    for start, path in _paths(_code(file)):
        up = start.count("super") - (file.name != "mod.rs")
        full = path if start == "crate" else base[: len(base) - max(up, 0)] + path
        while full and full not in MODULES:
            full = full[:-1]
        related = full[: len(module)] == module or module[: len(full)] == full
        if full and not related:
            out.add(full)
    return out


def test_no_module_reaches_itself_through_what_it_uses():
    uses = {module: _uses(module) for module in MODULES}
    assert len(uses) > 100
    assert sum(map(len, uses.values())) > 500  # paths are found
    try:
        tuple(TopologicalSorter(uses).static_order())
    except CycleError as error:
        loop = " uses ".join("::".join(module) for module in reversed(error.args[1]))
        pytest.fail(loop)


def test_methods_do_not_use_each_other():
    for module in MODULES:
        if module[:1] != ("methods",) or len(module) < 2:
            continue
        others = {used[1] for used in _uses(module) if used[0] == "methods"}
        assert others <= {module[1]}, module


def test_the_ground_knows_nothing_of_what_stands_on_it():
    ground = ["error", "memory", "control", "simd", "frame", "mesh", "camera", "geometry", "raster"]
    order = [*ground, "light", "bvh", "receivers", "sampling", "scene", "method", "far", "casters"]
    order += ["maps", "textures", "adaptive", "methods", "render", "python"]
    floor = {name: i for i, name in enumerate(order)}
    # `simd` hands kernels over to others; `memory` and `error` know each other's types.
    for module in MODULES:
        for used in _uses(module):
            assert floor[used[0]] <= floor[module[0]], f"{module} uses {used}"


def test_every_shape_of_a_light_is_asked_for_by_name():
    """So that the compiler points at every place that a new shape needs."""
    for module, file in MODULES.items():
        text = file.read_text()
        if "light" not in text or "Shape::" not in text:
            continue
        where = "::".join(module)
        assert not re.search(r"let Shape::[^;]*else \{", text), where
        assert not re.search(r"matches!\([^)]*Shape::", text), where
        for match in re.finditer(r"match [^{;]*\bshape \{", text):
            depth, end = 1, match.end()
            while depth:
                depth += {"{": 1, "}": -1}.get(text[end], 0)
                end += 1
            arms = text[match.end() : end]
            assert not re.search(r"^\s*_ (=>|if)", arms, re.M), where


RANGES = {
    "layers": (1, 64),
    "max_size": (1, 8192),
    "quads": (1, 256),
    "rays": (1, 65536),
    "resets": (0, 64),
    "resolution": (16, 16384),
    "samples": (1, 65536),
    "steps": (1, 8),
    "views": (1, 9),
}
"""Of all whole numbers but the seed, as users are told."""


def _with(method, parameter, value):
    """Return a method with a parameter that nothing in Python has checked."""
    changed = copy.copy(method)
    object.__setattr__(changed, parameter, value)
    return changed


@pytest.mark.parametrize("name", ss.method_names())
def test_python_and_the_core_have_the_same_ranges(name):
    method = resolve(name)
    for parameter, (low, high) in RANGES.items():
        if parameter not in method.parameters():
            continue
        ends = {"max_size": (1, 8192), "samples": (1, 256 if name == "accumulation" else high)}
        for value in ends.get(parameter, (low, high)):
            _core.Method(name, _with(method, parameter, value))
            type(method)(**{parameter: value})
        for value in (low - 1, high + 1):
            with pytest.raises(ss.ParameterError, match=parameter):
                _core.Method(name, _with(method, parameter, value))
            with pytest.raises(ss.ParameterError, match=parameter):
                type(method)(**{parameter: value})


def test_the_core_refuses_a_method_that_is_not_in_its_table():
    with pytest.raises(ss.ParameterError, match='unknown name "x"'):
        _core.Method("x", SimpleNamespace())
