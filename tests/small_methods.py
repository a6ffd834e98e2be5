"""Methods with settings under which a picture of some dozen pixels takes milliseconds."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import softshadow as ss
from softshadow.methods import resolve

MAP_NAMES = ("ssoc", "slsm", "mlsm", "mtsm", "mvsm", "pcf", "deep")
"""Those that look at the scene from the light, at a ``resolution``; all of them take points."""
AT_POINTS = ("hard", "ray_traced", "counted", "single_sample", *MAP_NAMES)


def methods(
    names: Iterable[str], own: Mapping[str, Mapping[str, Any]] | None = None, **settings: Any
) -> dict[str, ss.Method]:
    """Methods by name, each with those of the settings that it has, and with what is its own."""
    out = {}
    for name in names:
        default = resolve(name)
        has = {field.name for field in dataclasses.fields(default)}
        chosen = {key: value for key, value in settings.items() if key in has}
        out[name] = dataclasses.replace(default, **chosen | dict((own or {}).get(name, {})))
    return out
