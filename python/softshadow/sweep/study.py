"""A sweep as a TOML file: what ``softshadow sweep study.toml`` reads.

::

    store = "results.parquet"       # beside the file, as all paths in it
    repeats = 3
    size = [512, 512]               # of cameras that the scenes bring, or that none is given for

    [scene.bunny]
    path = "bunny.ply"              # or factory = "half_plane", of softshadow.scenes,
                                    # or "package.module:function", with arguments = {...}
    [light.small]
    kind = "sphere"                 # rect, disk, sphere
    size = 0.1                      # where the scene's own light is, turned as it is; or a
                                    # light's arguments: center = [0, 0, 4], radius = 0.1
    [camera.front]
    eye = [0, -4, 2]                # a camera's arguments
    target = [0, 0, 0]

    [[method]]
    name = "ray_traced"
    samples = [16, 64, 256]         # lists multiply

    [[method]]
    name = "mitsuba"                # softshadow.mitsuba.Direct
    variant = ["scalar_rgb", "llvm_ad_mono"]
    left_out = { bunny = "why" }    # not measured on these scenes; a row says so
"""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any

from softshadow import light as lights
from softshadow.camera import Camera
from softshadow.extras import needs
from softshadow.light import as_lights
from softshadow.methods import Method, resolve
from softshadow.mitsuba import Direct
from softshadow.renderers import Measurable
from softshadow.sweep.cases import Case, Made, grid

__all__ = ["Study", "read_study", "resized"]

_OPTIONS = ("repeats", "repeat_seconds", "reference_seconds", "threads", "alone")
_KEYS = ("store", *_OPTIONS, "workers", "images", "reference", "size")
_TABLES = ("scene", "light", "camera", "method")

_MITSUBA = "mitsuba"
"""What a study calls `softshadow.mitsuba.Direct`."""


@dataclass(frozen=True)
class Study:
    """What a study's file says.

    Attributes
    ----------
    cases : list of Case
    store : Path
    workers : int
        Processes that measure; 0 is the calling one.
    options : dict
        The other arguments of `sweep`.
    """

    cases: list[Case]
    store: Path
    workers: int
    options: dict[str, Any]


def read_study(path: str | os.PathLike[str]) -> Study:
    """Return what a study's file says; nothing is made or measured yet.

    Parameters
    ----------
    path : path
        A TOML file. Factories that it names are called when it is swept: do not sweep files of
        people whom you would not let run programs.

    Returns
    -------
    Study

    Raises
    ------
    ValueError
        If it is no TOML, or something in it is unknown or missing; the message says which.
    OSError
        If it cannot be read.
    """
    file = Path(path)
    try:
        return _study(_toml(file.read_bytes()), file.parent)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{file}: {error}") from None


def _toml(content: bytes) -> dict[str, Any]:
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        with needs("sweep", "a study"):
            import tomli as tomllib
    result: dict[str, Any] = tomllib.loads(content.decode())
    return result


def _study(text: dict[str, Any], folder: Path) -> Study:
    _known(text, (*_KEYS, *_TABLES), "study")
    size = text.get("size")
    if size is not None and not (isinstance(size, list) and len(size) == 2):
        raise ValueError(f"size: expected [width, height], got {size!r}")
    options: dict[str, Any] = {name: text[name] for name in _OPTIONS if name in text}
    if "images" in text:
        options["images"] = folder / text["images"]
    if "reference" in text:
        found = _methods(text["reference"], "reference")
        if len(found) != 1 or not isinstance(found[0], Method):
            raise ValueError("reference: expected one method")
        options["reference"] = found[0]
    workers = text.get("workers", 1)
    if not isinstance(workers, int) or isinstance(workers, bool) or workers < 0:
        raise ValueError(f"workers: expected a number of processes, got {workers!r}")
    scenes = {name: _scene(what, name, folder) for name, what in _table(text, "scene").items()}
    if not scenes:
        raise ValueError("study: expected a [scene.NAME] at least")
    given = {name: _light(what, name) for name, what in _table(text, "light").items()}
    cameras = {name: _camera(what, name, size) for name, what in _table(text, "camera").items()}
    own = None if size is None else partial(resized, size=tuple(size))
    methods: list[Measurable] = []
    left_out: dict[tuple[Any, str], str] = {}
    for what in text.get("method", []):
        rest = dict(what) if isinstance(what, dict) else what
        reasons = _left_out(rest, scenes)
        some = _methods(rest, "method")
        methods += some
        left_out.update({(m, scene): why for m in some for scene, why in reasons.items()})
    cases = grid(scenes, given or None, cameras or {"own": own}, methods or None)
    cases = [replace(c, left_out=left_out.get((c.method, c.scene_name), "")) for c in cases]
    return Study(cases, folder / text.get("store", "results.parquet"), workers, options)


def _known(given: Mapping[str, Any], allowed: tuple[str, ...], what: str) -> None:
    for name in given:
        if name not in allowed:
            raise ValueError(f"{what}: unknown {name!r}; expected one of {', '.join(allowed)}")


def _table(text: dict[str, Any], what: str) -> dict[str, Any]:
    table = text.get(what, {})
    if not isinstance(table, dict) or not all(isinstance(v, dict) for v in table.values()):
        raise ValueError(f"{what}: expected tables, as in [{what}.NAME]")
    return table


def _scene(what: dict[str, Any], name: str, folder: Path) -> Any:
    _known(what, ("path", "factory", "arguments"), f"scene.{name}")
    if ("path" in what) == ("factory" in what):
        raise ValueError(f"scene.{name}: expected a path or a factory")
    if "path" in what:
        return str(folder / what["path"])
    module, _, function = str(what["factory"]).rpartition(":")
    return partial(_called, module or "softshadow.scenes", function, what.get("arguments", {}))


def _called(module: str, function: str, arguments: dict[str, Any]) -> Any:
    """Call a function by its name, so that what holds this can be pickled."""
    return getattr(import_module(module), function)(**arguments)


def _light(what: dict[str, Any], name: str) -> Any:
    rest = dict(what)
    kind = rest.pop("kind", None)
    made_by = getattr(lights, f"{str(kind).title()}Light", None)
    if made_by is None:
        raise ValueError(f"light.{name}: unknown kind {kind!r}")
    if "size" in rest:
        _known(rest, ("size",), f"light.{name}")
        return partial(_sized, kind=kind, size=float(rest["size"]))
    return _made_of(made_by, rest, f"light.{name}")


def _sized(its: Made, kind: Any, size: float) -> Any:
    """Return a light where a scene's own is, which faces the scene's middle."""
    from softshadow.scenes import light_towards

    own = as_lights(its.light)[0][0]
    if not hasattr(own, "center"):
        raise ValueError(f"light: {type(own).__name__} has no place for a light of a size")
    return light_towards(kind, own.center, size, its.scene.bounds.mean(axis=0))


def _camera(what: dict[str, Any], name: str, size: list[int] | None) -> Camera:
    its = dict(what)
    if size is not None:
        its.setdefault("width", size[0])
        its.setdefault("height", size[1])
    camera: Camera = _made_of(Camera, its, f"camera.{name}")
    return camera


def _made_of(kind: Any, arguments: dict[str, Any], what: str) -> Any:
    try:
        inspect.signature(kind).bind(**arguments)
    except TypeError as error:
        raise ValueError(f"{what}: {error}") from None
    return kind(**arguments)


def resized(its: Made, size: tuple[int, int]) -> Camera:
    """Return a scene's own camera with another size, the height of its view kept."""
    own, (width, height) = its.camera, size
    K = own.K.copy()
    K[0, 0] *= height / own.height
    K[1] *= height / own.height
    K[0, 2] = width / 2
    return Camera.from_matrix(K, own.camera_to_world, width, height)


def _left_out(method: Any, scenes: Mapping[str, Any]) -> dict[str, str]:
    """Take from a method's table the scenes on which it is not to be measured, with reasons."""
    reasons = method.pop("left_out", {}) if isinstance(method, dict) else {}
    if not isinstance(reasons, dict) or not all(isinstance(v, str) for v in reasons.values()):
        raise ValueError(f'method: left_out: expected {{ scene = "why" }}, got {reasons!r}')
    _known(reasons, tuple(scenes), "method: left_out")
    return reasons


def _methods(what: Any, where: str) -> list[Measurable]:
    """Return a method for every combination of the parameters that are lists."""
    if isinstance(what, str):
        return [resolve(what)]
    if not isinstance(what, dict) or "name" not in what:
        raise ValueError(f"{where}: expected a name and parameters, got {what!r}")
    rest = dict(what)
    name = rest.pop("name")
    base: Any = Direct() if name == _MITSUBA else resolve(name)
    _known(rest, tuple(base.parameters()), f"{where} {name}")
    lists = [value if isinstance(value, list) else [value] for value in rest.values()]
    return [replace(base, **dict(zip(rest, values, strict=True))) for values in product(*lists)]
