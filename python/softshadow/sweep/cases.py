"""`Case`, what a sweep measures once, and `grid`, which makes cases from a product."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from os import PathLike, fspath
from pathlib import Path
from typing import Any, TypeAlias

from softshadow import framing
from softshadow.camera import Camera
from softshadow.checks import shown
from softshadow.compare import label_of
from softshadow.light import LightLike, as_lights
from softshadow.renderers import Measurable, resolve_measurable
from softshadow.scene import Scene

__all__ = ["Case", "Made", "grid", "made", "resolved"]

SceneSource: TypeAlias = Any
"""A scene, a model file, a setup as `softshadow.scenes` makes them, or what makes one of these."""

Chosen: TypeAlias = "Callable[[Made], Any]"
"""A light or a camera that depends on the scene: a function of a `Made`."""


@dataclass(frozen=True)
class Made:
    """A scene that a case's source made, with the light and camera that belong to it.

    Attributes
    ----------
    scene : Scene
    light : light or tuple of lights
    camera : Camera
    """

    scene: Scene
    light: LightLike
    camera: Camera


@dataclass(frozen=True)
class Case:
    """What a sweep measures once: a method on a scene, seen by a camera, under a light.

    It is a description: nothing is read or made before it is swept. It cannot be changed, can be
    pickled where its parts can, and is hashable.

    Parameters
    ----------
    scene : Scene, path, setup or callable
        A setup is what `softshadow.scenes` make; a callable is called without arguments and returns
        a scene, a path or a setup. Where it is made from a path, a ground is added, as the command
        ``softshadow render`` does.
    light : light, tuple of lights or callable, optional
        A tuple is several lights at once. A callable is given what the scene's source made, which
        has ``scene``, ``light`` and ``camera``. None: the setup's own, or `framing.light_for`.
    camera : Camera or callable, optional
        As the light; without a setup `framing.camera_for`.
    method : str, method or renderer
        A renderer, such as `softshadow.mitsuba.Direct`, is measured as a method is.
    scene_name, light_name, camera_name, label : str
        What the table calls them. Not given: a function's or file's name, a light's kind, the
        method with its parameters.
    left_out : str
        Why it is not to be measured; its row is a failure that says so.

    Raises
    ------
    TypeError, ValueError
        If a part is of another type, or the method is unknown.

    Examples
    --------
    >>> import softshadow as ss
    >>> case = ss.Case(ss.scenes.half_plane, method=ss.RayTraced(samples=16))
    >>> case.scene_name, case.light_name, case.label
    ('half_plane', 'own', 'ray_traced(samples=16)')
    """

    scene: SceneSource
    light: LightLike | Chosen | None = None
    camera: Camera | Chosen | None = None
    method: str | Measurable = "ray_traced"
    scene_name: str = ""
    light_name: str = ""
    camera_name: str = ""
    label: str = ""
    left_out: str = ""

    def __post_init__(self) -> None:
        if isinstance(self.scene, PathLike):
            self._store("scene", fspath(self.scene))
        if not (_is_source(self.scene) or callable(self.scene)):
            raise TypeError(
                "scene: expected a Scene, a path, a setup or a function that makes one, "
                f"got {shown(self.scene)}"
            )
        if not (self.light is None or callable(self.light)):
            lights, single = as_lights(self.light)
            self._store("light", lights[0] if single else tuple(lights))
        if not (self.camera is None or callable(self.camera) or isinstance(self.camera, Camera)):
            raise TypeError(f"camera: expected softshadow.Camera, got {shown(self.camera)}")
        self._store("method", resolve_measurable(self.method))
        for name, thing in (
            ("scene_name", self.scene),
            ("light_name", self.light),
            ("camera_name", self.camera),
        ):
            if not getattr(self, name):
                self._store(name, _name_of(thing))
        if not self.label:
            self._store("label", label_of(resolve_measurable(self.method)))

    def _store(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)


def _is_source(thing: object) -> bool:
    setup = all(hasattr(thing, name) for name in ("scene", "camera", "lights"))
    return isinstance(thing, (Scene, str)) or setup


def _name_of(thing: Any) -> str:
    """Return what names an object: a function's name, a file's, a kind."""
    if thing is None:
        return "own"
    if isinstance(thing, (str, PathLike)):
        return Path(thing).stem
    if isinstance(thing, tuple):
        return " + ".join(map(_name_of, thing))
    if callable(thing):
        function = getattr(thing, "func", thing)  # of functools.partial
        return str(getattr(function, "__name__", type(thing).__name__)).strip("<>")
    return type(thing).__name__.removesuffix("Light").lower()


def grid(scene: Any, light: Any = None, camera: Any = None, method: Any = None) -> list[Case]:
    """Return a case for every combination of scenes, lights, cameras and methods.

    Each is one thing, a list, or a dictionary whose keys name the things. A tuple of lights is one
    thing: several lights at once. What has no name is named by what it is, and numbered where
    several are named alike.

    Parameters
    ----------
    scene, light, camera
        As of `Case`, or lists or dictionaries of these.
    method : str, method, renderer, or list or dictionary of them, optional
        All methods with their defaults, when not given.

    Returns
    -------
    list of Case
        The methods of one scene, light and camera are neighbours.

    Raises
    ------
    TypeError, ValueError
        As `Case`, or if a list is empty.

    Examples
    --------
    >>> import softshadow as ss
    >>> lights = {"small": ss.SphereLight((0, 0, 4), 0.1), "large": ss.SphereLight((0, 0, 4), 0.5)}
    >>> methods = ["hard", ss.RayTraced(samples=16)]
    >>> cases = ss.grid(scene=[ss.scenes.half_plane], light=lights, method=methods)
    >>> len(cases), cases[-1].light_name, cases[-1].label
    (4, 'large', 'ray_traced(samples=16)')
    """
    if method is None:
        from softshadow.methods import method_names

        method = list(method_names())
    axes = [_axis(scene, "scene"), _axis(light, "light"), _axis(camera, "camera")]
    methods = _axis(method, "method", named=False)
    return [
        Case(s, li, c, m, sn, ln, cn, mn)
        for (sn, s), (ln, li), (cn, c), (mn, m) in product(*axes, methods)
    ]


def _axis(things: Any, what: str, named: bool = True) -> list[tuple[str, Any]]:
    """Return names and things; methods name themselves."""
    if isinstance(things, Mapping):
        named_things = [(str(key), thing) for key, thing in things.items()]
    else:
        each = things if isinstance(things, list) else [things]
        names = [_name_of(thing) if named else "" for thing in each]
        named_things = list(zip(_numbered(names), each, strict=True))
    if not named_things:
        raise ValueError(f"{what}: expected at least one")
    return named_things


def _numbered(names: Sequence[str]) -> list[str]:
    seen: dict[str, int] = {}
    result = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        result.append(f"{name} {seen[name]}" if name and seen[name] > 1 else name)
    return result


def made(source: SceneSource) -> Made:
    """Return the scene of a case's source, and the light and camera that belong to it.

    Raises
    ------
    TypeError
        If a function made something else; otherwise whatever the source raises.
    """
    thing = source if _is_source(source) else source()
    if not (_is_source(thing) or isinstance(thing, PathLike)):
        raise TypeError(f"scene: expected a Scene, a path or a setup, its source made {thing!r}")
    if isinstance(thing, (str, PathLike)):
        scene = Scene.load(thing)
        camera, light = framing.frame(scene)
        framing.add_ground(scene)
        return Made(scene, light, camera)
    if isinstance(thing, Scene):
        camera, light = framing.frame(thing)
        return Made(thing, light, camera)
    lights = tuple(thing.lights)
    return Made(thing.scene, lights[0] if len(lights) == 1 else lights, thing.camera)


def resolved(case: Case, its: Made) -> tuple[LightLike, Camera]:
    """Return a case's light and camera, in the scene that its source made.

    Raises
    ------
    TypeError
        If a function made no light or no camera; otherwise whatever it raises.
    """
    light = its.light if case.light is None else case.light
    camera = its.camera if case.camera is None else case.camera
    if callable(light):
        light = light(its)
    if callable(camera):
        camera = camera(its)
    lights, single = as_lights(light)
    if not isinstance(camera, Camera):
        raise TypeError(f"camera: expected softshadow.Camera, got {shown(camera)}")
    return lights[0] if single else tuple(lights), camera
