"""Single sample soft shadows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from softshadow.methods.base import Method

__all__ = ["SingleSample"]


@dataclass(frozen=True)
class SingleSample(Method):
    """Single sample soft shadows (Parker, Shirley and Smits 1998).

    One shadow ray to the light's centre, against occluders that are wrapped in larger outer objects
    with soft edges. Little dearer than hard shadows, continuous in space and time, and with
    penumbrae that grow from zero at a contact; the umbra is too large, and the shadows of small
    things are too dark. See ``docs/methods/single_sample.md``.

    Parameters
    ----------
    falloff : {"light", "linear", "smooth"}
        How visibility falls off from the outer to the inner object: by the area of a disk beyond a
        line, in closed form; linearly; or as ``3 t**2 - 2 t**3`` (the paper).
    overlap : {"minimum", "multiply", "add"}
        How the shadows of different objects combine: the darkest counts (the paper), what they
        leave visible is multiplied, or what they hide is added.
    parts : {"objects", "triangles"}
        What ``"multiply"`` and ``"add"`` take for an object: a connected mesh or a sphere, or every
        triangle (then fine meshes come out too dark). ``"minimum"`` is the same for both.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    falloff: Literal["light", "linear", "smooth"] = "light"
    overlap: Literal["minimum", "multiply", "add"] = "minimum"
    parts: Literal["objects", "triangles"] = "objects"
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "single_sample"
    points: ClassVar[bool] = True
