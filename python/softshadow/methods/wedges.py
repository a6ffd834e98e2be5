"""Shadow volumes, and penumbra wedges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from softshadow.methods.base import Method

__all__ = ["ShadowVolume", "Wedges"]


@dataclass(frozen=True)
class ShadowVolume(Method):
    """Hard shadows by shadow volumes: layers between light and surface, counted along view rays.

    The case of a light of radius zero of `Wedges`: visibility of the light's centre. See
    ``docs/methods/shadow_volume.md``.

    Parameters
    ----------
    counting : {"zpass", "zfail"}
        Whether layers are counted from the eye, starting with those over it, or from behind the
        surface, the volumes closed by caps. Both are right for a viewer in shadow.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    cull : bool
        Skip what cannot reach a tile of the image; ``False`` measures what that gains.
    """

    counting: Literal["zpass", "zfail"] = "zpass"
    opacity: Literal["opaque"] | None = None
    cull: bool = True

    name: ClassVar[str] = "shadow_volume"


@dataclass(frozen=True)
class Wedges(Method):
    """Penumbra wedges (Akenine-Möller and Assarsson 2002).

    Every silhouette edge that the light's centre sees becomes a wedge in which the light fades.
    Exact where all of the light sees the same silhouette; see ``docs/methods/wedges.md`` for where
    it is wrong.

    Parameters
    ----------
    falloff : {"light", "line", "linear", "smooth"}
        How the light fades across a wedge. ``"light"``: by the area of the light that the edge,
        with its ends, cuts off, in closed form. The others are the paper's interpolation between
        front, back and side planes (its equations 1 to 3), then taken as the area of the light that
        a line at that offset cuts off, as it is, or as ``3 s**2 - 2 s**3``.
    quads : int, optional
        Draw every wedge as this many quads of constant intensity (the paper's Figure 15), 1 to 256,
        instead of a falloff: cheap, with steps.
    overlap : {"multiply", "add", "minimum"}
        How the shadows of different objects (connected meshes) combine: what they leave visible is
        multiplied, what they hide is added (the paper), or the darkest counts. Overlapping shadows
        of one object are added.
    buffer : {"float", "integer"}
        Whether the light-intensity buffer holds numbers, or the paper's integers: every wedge's
        share is rounded to 1/255 (of n lights, to n/255).
    counting : {"zpass", "zfail"}
        As of `ShadowVolume`.
    vertex_angle : float
        Degrees, 1 to 180: where neighbouring silhouette edges turn by more, further wedges are set
        around their vertex (the paper's Figure 7). Not used by ``falloff="light"``.
    planes : {"tangent", "paper"}
        Whether front and back planes touch the light, or go through the paper's points ``c ± r n``
        of a sphere, which are a little inside it. Not used by ``falloff="light"``.
    opacity : {"opaque"}, optional
        As of `ShadowVolume`.
    cull : bool
        Skip what cannot reach a tile of the image or a group of its pixels; ``False`` measures what
        that gains.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> paper = ss.Wedges(falloff="smooth", overlap="add", buffer="integer", planes="paper")
    >>> ss.render(setup.scene, setup.camera, setup.light, paper).visibility.shape
    (24, 32)
    """

    falloff: Literal["light", "line", "linear", "smooth"] = "light"
    quads: int | None = None
    overlap: Literal["multiply", "add", "minimum"] = "multiply"
    buffer: Literal["float", "integer"] = "float"
    counting: Literal["zpass", "zfail"] = "zpass"
    vertex_angle: float = 30.0
    planes: Literal["tangent", "paper"] = "tangent"
    opacity: Literal["opaque"] | None = None
    cull: bool = True

    name: ClassVar[str] = "wedges"
