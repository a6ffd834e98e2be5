"""`compare`: several methods on one scene, their times, their memory and how wrong they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field, fields
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from softshadow import checks, metrics
from softshadow._core import UnsupportedError
from softshadow.arguments import Bar, Progress
from softshadow.camera import Camera
from softshadow.extras import needs
from softshadow.light import LightLike
from softshadow.methods import Method, MethodLike, RayTraced, method_names, resolve
from softshadow.parallel import thread_count
from softshadow.render import Image, prepare
from softshadow.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["DEFAULT_REFERENCE", "Comparison", "compare", "label_of", "parameters_text"]

DEFAULT_REFERENCE = RayTraced(samples=1024, seed=0x5EED)
"""What `compare` measures against.

Its seed is not the methods' default, 0: with the same seed the reference would share light samples
with the ``ray_traced`` row, which would then look better than it is. Its own noise, at most
0.5/sqrt(1024) = 0.016 in a pixel (stratification makes it less), is the floor of the errors.
"""


@dataclass(frozen=True, eq=False)
class Comparison:
    """What `compare` returns; it equals itself only.

    Attributes
    ----------
    table : pandas.DataFrame
        One row for each method, in the order given: ``method``, ``parameters`` (what differs from
        the class's defaults, such as ``"samples=64, seed=1"``; empty when nothing does),
        ``prepare_seconds``, ``frame_seconds`` (medians over the repeats), ``bytes``, ``threads``
        (how many a call had), and the error numbers of `softshadow.metrics.errors`.
    images : dict of str to Image
        By label: the method's name, with the parameters in parentheses if there are any.
    reference : Image
        What the errors are against.
    skipped : dict of str to str
        The methods that cannot do the scene and were left out, and why; only when `compare` chose
        the methods itself.
    """

    table: pd.DataFrame
    images: dict[str, Image]
    reference: Image
    skipped: dict[str, str] = field(default_factory=dict)


def compare(
    scene: Scene,
    camera: Camera,
    light: LightLike,
    methods: Sequence[MethodLike] | None = None,
    reference: MethodLike | Image | None = None,
    repeats: int = 3,
    progress: Progress = False,
) -> Comparison:
    """Render a scene with several methods and measure their time, memory and error.

    Each repeat prepares and renders a fresh copy of the scene, so that ``prepare_seconds`` has all
    that a static scene pays once (adjacency, bounding volume hierarchy, the method's own
    structures); the table has the medians.

    Errors are over the pixels in which the reference hit a surface; with several lights, over the
    stacked ``(L, H, W)`` visibilities, so each light weighs the same.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    light : light or sequence of lights
    methods : sequence of str or method, optional
        Names or configured objects. When not given: every method with its defaults, except those
        that cannot do this scene, which `Comparison.skipped` then lists.
    reference : str, method or Image, optional
        A method to render the reference with, or an image of the same camera and lights, from
        anywhere. When not given, `DEFAULT_REFERENCE`: ``ray_traced`` with 1024 samples, and a seed
        of its own, so that its noise is independent of the methods'.
    repeats : int
        How often each method is prepared and rendered, at least 1.
    progress : bool or callable
        ``True`` for a progress bar over all renders, or a function that is told the finished
        fraction.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError
        If a method is unknown, listed twice or (when listed) cannot do the scene, the camera sees
        no surface, or the reference's size is not the camera's.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> methods = ["hard", ss.RayTraced(samples=16)]
    >>> result = ss.compare(setup.scene, setup.camera, setup.light, methods, repeats=1)
    >>> list(result.images)
    ['hard', 'ray_traced(samples=16)']
    >>> bool(result.table["mae"][0] > result.table["mae"][1])
    True
    """
    with needs("metrics", "compare"):  # all of them now, rather than after the last picture
        import flip_evaluator  # noqa: F401
        import pandas as pd
        import skimage.metrics  # noqa: F401

    repeats = checks.integer(repeats, "repeats", 1, 1_000_000)
    if isinstance(methods, (str, Method)):
        raise TypeError("methods: expected a sequence of methods; put a single one in a list")
    chosen = {
        label_of(method): method
        for method in map(resolve, method_names() if methods is None else methods)
    }
    if methods is not None and len(chosen) < len(methods):
        raise ValueError(
            f"methods: one is listed twice in {[label_of(resolve(m)) for m in methods]}"
        )
    if not chosen:
        raise ValueError("methods: expected at least one")

    rows, images, skipped = [], {}, {}
    bar = Bar(progress, "compare")
    with bar:
        steps = _Steps(bar, len(chosen) * repeats + 1)
        truth = _reference(scene, camera, light, reference, steps)
        steps.advance()
        for label, method in chosen.items():
            try:
                timed = []
                for _ in range(repeats):
                    timed.append(_rendered(scene.copy(), camera, light, method, steps))
                    steps.advance()
            except UnsupportedError as error:
                if methods is not None:
                    raise
                skipped[label] = str(error)
                steps.advance(repeats)
                continue
            images[label] = timed[-1]
            rows.append(_row(method, timed, truth))
    return Comparison(pd.DataFrame(rows), images, truth, skipped)


def _row(method: Method, timed: list[Image], truth: Image) -> dict[str, object]:
    image = timed[-1]
    return {
        "method": method.name,
        "parameters": parameters_text(method),
        "prepare_seconds": median(x.seconds["prepare"] for x in timed),
        "frame_seconds": median(x.seconds["frame"] for x in timed),
        "bytes": max(x.bytes for x in timed),
        "threads": thread_count(),
        **metrics.errors(image.visibility, truth.visibility, truth.mask),
    }


def _rendered(
    scene: Scene, camera: Camera, light: LightLike, method: MethodLike, steps: _Steps
) -> Image:
    prepared = prepare(scene, light, method, steps.part(0, 0.5))
    return prepared.render(camera, steps.part(0.5, 1))


def _reference(
    scene: Scene,
    camera: Camera,
    light: LightLike,
    reference: MethodLike | Image | None,
    steps: _Steps,
) -> Image:
    if isinstance(reference, Image):
        image = reference
        size = image.mask.shape
        if size != (camera.height, camera.width):
            raise ValueError(
                f"reference: its size {size[1]}x{size[0]} is not the camera's "
                f"{camera.width}x{camera.height}"
            )
    else:
        method = DEFAULT_REFERENCE if reference is None else reference
        image = _rendered(scene, camera, light, method, steps)
    if not np.any(image.mask):
        raise ValueError("compare: the camera sees no surface, there is nothing to measure")
    return image


def parameters_text(method: Method) -> str:
    """Return what differs from the defaults of the method's class, as in a call."""
    changed = []
    for item in fields(method):
        value = getattr(method, item.name)
        default = item.default
        if default is MISSING and item.default_factory is not MISSING:
            default = item.default_factory()
        if value != default:
            changed.append(f"{item.name}={value!r}")
    return ", ".join(changed)


def label_of(method: Method) -> str:
    """Return the method's name, with what differs from its defaults in parentheses."""
    parameters = parameters_text(method)
    return f"{method.name}({parameters})" if parameters else method.name


class _Steps:
    """Counts renders, each a part of the whole bar."""

    def __init__(self, bar: Bar, total: int) -> None:
        self._bar = bar
        self._total = total
        self._done = 0

    def part(self, start: float, end: float) -> Progress:
        """Return the progress argument of a part of the render that comes next."""
        first, last = ((self._done + x) / self._total for x in (start, end))
        return self._bar.part(first, last, "compare")

    def advance(self, steps: int = 1) -> None:
        self._done += steps
