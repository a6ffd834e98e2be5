"""A picture in a notebook whose light is moved with the pointer.

It stands on anywidget, so it works where Jupyter widgets do. The browser asks for one picture at a
time: of what happens while one is drawn, only the last state is asked for next, so that a slow
method makes fewer pictures and not late ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from softshadow import checks
from softshadow.camera import Camera
from softshadow.compare import label_of
from softshadow.light import (
    DiskLight,
    DistantLight,
    PlacedLight,
    PolygonLight,
    RectLight,
    SphereLight,
)
from softshadow.methods import Method, MethodLike, method_names, resolve
from softshadow.scene import Scene

if TYPE_CHECKING:
    from softshadow.widget.moving import ShadowWidget

__all__ = ["widget"]


def widget(
    scene: Scene,
    camera: Camera,
    light: PlacedLight,
    method: MethodLike = "wedges",
    methods: Sequence[MethodLike] | None = None,
    what: Literal["radiance", "visibility"] = "radiance",
) -> ShadowWidget:
    """Show a scene in a notebook, and redraw it as its light is dragged.

    Dragging on the picture moves the light with the pointer, parallel to the picture; dragging with
    the Shift key held moves it away from you and back. Below are the light's width, the method and
    what is drawn. A larger light keeps its power, so that the picture stays about as bright. What a
    method cannot do is said below the picture.

    Parameters
    ----------
    scene : Scene
        It is not copied: call the widget's ``redraw`` after a change.
    camera : Camera
        Its size is that of the picture.
    light : RectLight, DiskLight, SphereLight or PolygonLight
        Where it starts; flat lights keep their direction, rectangles and polygons their
        proportions.
    method : str or method
        The method at the start.
    methods : sequence of str or method, optional
        What can be chosen. When not given: every method with its defaults.
    what : {"radiance", "visibility"}
        What is drawn at the start: the light that arrives, exposed as suits the first picture, or
        the part of the light that is seen, as linear grey.

    Returns
    -------
    ShadowWidget
        Its ``center``, ``width``, ``method`` and ``what`` can be read and set, and it is redrawn
        then; ``light`` is the light as it is now, for `render`, and ``image`` the last image.

    Raises
    ------
    ValueError
        If the light has no size to change, a method is unknown or listed twice, or the method
        cannot do the scene.
    TypeError
        If an argument is of another kind.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.stacked_boards(32, 24)
    >>> moving = ss.widget(setup.scene, setup.camera, setup.light)
    >>> moving.method = "hard"
    >>> moving.image.visibility.shape
    (24, 32)
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"scene: expected softshadow.Scene, got {type(scene).__name__}")
    if not isinstance(camera, Camera):
        raise TypeError(f"camera: expected softshadow.Camera, got {type(camera).__name__}")
    if isinstance(light, DistantLight):
        raise TypeError("light: expected one with a place to move, got a DistantLight")
    if not isinstance(light, (RectLight, DiskLight, SphereLight, PolygonLight)):
        raise TypeError(f"light: expected one light, got {checks.shown(light)}")
    if what not in ("radiance", "visibility"):
        raise ValueError(f"what: expected 'radiance' or 'visibility', got {what!r}")
    if isinstance(methods, (str, Method)):
        raise TypeError("methods: expected a sequence of methods; put a single one in a list")
    first = resolve(method)
    listed = [resolve(m) for m in (method_names() if methods is None else methods)]
    if len({label_of(m) for m in listed}) < len(listed):
        raise ValueError(f"methods: one is listed twice in {[label_of(m) for m in listed]}")
    if first not in listed:
        listed.insert(0, first)

    from softshadow.widget.moving import ShadowWidget

    choices = {label_of(m): m for m in listed}
    return ShadowWidget(scene, camera, light, choices, label_of(first), what)
