"""What a sweep can measure beside the methods: other renderers' pictures of the same scenes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow.camera import Camera
from softshadow.light import LightLike
from softshadow.methods import Method, resolve
from softshadow.render import Image, render
from softshadow.scene import Scene

__all__ = ["Measurable", "Rendered", "Renderer", "rendered", "resolve_measurable"]


@dataclass(frozen=True, eq=False)
class Rendered:
    """What a `Renderer` returns; an `softshadow.render.Image` has the same and more.

    Attributes
    ----------
    visibility : ndarray, shape (H, W) or (L, H, W), float32
        As of `softshadow.render.Image`; 1 where nothing was hit.
    mask : ndarray, shape (H, W), bool
        Whether a surface was hit.
    seconds : dict
        Wall-clock seconds by stage, with ``prepare`` and ``frame`` at least.
    bytes : int or None
        Of its own data structures; None where it does not tell.
    """

    visibility: npt.NDArray[np.float32]
    mask: npt.NDArray[np.bool_]
    seconds: dict[str, float]
    bytes: int | None = None


@runtime_checkable
class Renderer(Protocol):
    """A frozen dataclass whose fields are its parameters, and which renders visibilities."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def name(self) -> str:
        """What tables call it."""

    @property
    def version(self) -> str:
        """The programs that render, with their versions."""

    def parameters(self) -> dict[str, Any]:
        """Return the parameters by name."""

    def render(self, scene: Scene, camera: Camera, light: LightLike) -> Rendered:
        """Prepare and render once, by as many threads as `softshadow.thread_count` says."""


Measurable: TypeAlias = "Method | Renderer"
"""What has a row in a sweep's table."""


def resolve_measurable(thing: str | Measurable) -> Measurable:
    """Return the method of a name; a method or a renderer as it is.

    Raises
    ------
    ValueError
        If the name is unknown.
    TypeError
        If it is neither.
    """
    if isinstance(thing, (str, Method)):
        return resolve(thing)
    if isinstance(thing, Renderer) and not isinstance(thing, type):
        return thing
    got = checks.shown(thing)
    raise TypeError(f"method: expected a name, a method object or a renderer, got {got}")


def rendered(thing: Measurable, scene: Scene, camera: Camera, light: LightLike) -> Image | Rendered:
    """Prepare and render once, by a method or by a renderer.

    Parameters
    ----------
    thing : Method or Renderer
    scene, camera, light
        As of `softshadow.render`.

    Returns
    -------
    Image or Rendered
    """
    if isinstance(thing, Method):
        return render(scene, camera, light, thing)
    return thing.render(scene, camera, light)
