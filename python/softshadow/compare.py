"""`compare`: several methods on one scene, their times, their memory and how wrong they are."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field, fields
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from softshadow import checks, metrics
from softshadow._core import UnsupportedError
from softshadow.arguments import Bar, Progress
from softshadow.budget import Budget, affordable_reference, in_rounds
from softshadow.camera import Camera
from softshadow.extras import require
from softshadow.light import LightLike
from softshadow.methods import Method, MethodLike, RayTraced, method_names, resolve
from softshadow.parallel import thread_count
from softshadow.render import Image, prepare
from softshadow.renderers import Measurable
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


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """What `compare` returns; it equals itself only.

    Printed it is its table, with the front marked; notebooks show a strip of pictures, too.

    Attributes
    ----------
    table : pandas.DataFrame
        One row for each method, in the order given: ``method``, ``parameters`` (what differs from
        the class's defaults, such as ``"samples=64, seed=1"``; empty when nothing does),
        ``prepare_seconds``, ``frame_seconds`` (medians over the repeats), ``bytes``, ``threads``
        (how many a call had), the error numbers of `softshadow.metrics.errors`, and ``repeats``,
        of which the times are medians.
    images : dict of str to Image
        By label: the method's name, with the parameters in parentheses if there are any.
    reference : Image
        What the errors are against.
    skipped : dict of str to str
        The methods that were left out, and why: those that cannot do the scene, when `compare`
        chose the methods itself, and those that the budget had no time for, with their estimate.
    reference_method : Method, optional
        What rendered the reference; None where it was given as an image.
    """

    table: pd.DataFrame
    images: dict[str, Image]
    reference: Image
    skipped: dict[str, str] = field(default_factory=dict)
    reference_method: Method | None = None

    def __repr__(self) -> str:
        from softshadow.comparing import table_text

        return table_text(self)

    def _repr_html_(self) -> str:
        from softshadow import showing

        return showing.comparison_html(self)


def compare(
    scene: Scene,
    camera: Camera,
    light: LightLike,
    methods: Sequence[MethodLike] | None = None,
    reference: MethodLike | Image | None = None,
    repeats: int = 3,
    progress: Progress = False,
    budget: float | None = None,
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
        anywhere. When not given: ``ray_traced`` with 1024 samples, and a seed of its own, so that
        its noise is independent of the methods'.
    repeats : int
        How often each method is prepared and rendered, at least 1.
    progress : bool or callable
        ``True`` for a progress bar over all renders, or a function that is told the finished
        fraction.
    budget : float, optional
        Seconds that all of it may take, however many methods there are. Each is first timed on a
        picture of an eighth of the size. The cheapest are rendered first; those that do not fit are
        left out or stopped, with what was measured of them in `Comparison.skipped`. Rounds after
        the first take what time remains. The default reference is not stopped, but gets fewer
        samples, 256 at least, where it would take over a third. When not given: all
        methods, however long they take.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError
        If a method is unknown, listed twice or (when listed) cannot do the scene, the camera sees
        no surface, the reference's size is not the camera's, or the budget is not positive or too
        small for any method.

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
    start = time.perf_counter()
    require("metrics", "compare", "flip_evaluator", "pandas", "skimage.metrics")
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

    if budget is not None and not checks.number(budget, "budget", "a positive number") > 0:
        raise ValueError(f"budget: expected a positive number, got {budget}")
    bar = Bar(progress, "compare")
    with bar as tell:
        study = _Study(scene, camera, light, chosen, methods is not None, repeats)
        if budget is None:
            return _in_order(study, reference, bar)
        return _within(study, reference, Budget(budget, tell or False, start))


@dataclass(frozen=True)
class _Study:
    """What is to be rendered."""

    scene: Scene
    camera: Camera
    light: LightLike
    methods: dict[str, Method]
    given: bool
    repeats: int

    def render(self, method: Method, camera: Camera, progress: Progress) -> Image:
        """Prepare and render a fresh copy of the scene."""
        return prepare(self.scene.copy(), self.light, method, progress).render(camera, progress)


def _in_order(study: _Study, reference: MethodLike | Image | None, bar: Bar) -> Comparison:
    """Render every method with all its repeats, one after the other."""
    rows, images, skipped = [], {}, {}
    steps = _Steps(bar, len(study.methods) * study.repeats + 1)

    def rendered(method: Method) -> Image:
        prepared = prepare(study.scene.copy(), study.light, method, steps.part(0, 0.5))
        image = prepared.render(study.camera, steps.part(0.5, 1))
        steps.advance()
        return image

    if isinstance(reference, Image):
        by, truth = None, reference
        steps.advance()
    else:
        by = resolve(DEFAULT_REFERENCE if reference is None else reference)
        truth = rendered(by)
    _check_reference(truth, study.camera)
    for label, method in study.methods.items():
        try:
            timed = [rendered(method) for _ in range(study.repeats)]
        except UnsupportedError as error:
            if study.given:
                raise
            skipped[label] = str(error)
            steps.advance(study.repeats)
            continue
        images[label] = timed[-1]
        seconds = [image.seconds for image in timed]
        rows.append(_row(method, timed[-1], seconds, _errors(timed[-1], truth)))
    return _comparison(rows, images, truth, skipped, by)


def _within(study: _Study, reference: MethodLike | Image | None, budget: Budget) -> Comparison:
    """Render what there is time for."""
    if isinstance(reference, Image):
        by, truth = None, reference
    else:
        by = DEFAULT_REFERENCE if reference is None else resolve(reference)
        if reference is None:
            by = affordable_reference(DEFAULT_REFERENCE, study.camera, study.render, budget)
        truth = study.render(by, study.camera, budget.limit(math.inf))
    _check_reference(truth, study.camera)
    errors: dict[str, dict[str, float]] = {}
    outcome = in_rounds(
        study.methods,
        study.camera,
        study.render,
        study.repeats,
        budget,
        lambda label, image: errors.update({label: _errors(image, truth)}),
        study.given,
    )
    if not outcome.images:
        first, why = next(iter(outcome.skipped.items()))
        raise ValueError(f"budget: no method was rendered; {first}: {why}")
    done = [label for label in study.methods if label in outcome.images]
    rows = [
        _row(study.methods[label], outcome.images[label], outcome.seconds[label], errors[label])
        for label in done
    ]
    images = {label: outcome.images[label] for label in done}
    return _comparison(rows, images, truth, outcome.skipped, by)


def _comparison(
    rows: list[dict[str, object]],
    images: dict[str, Image],
    truth: Image,
    skipped: dict[str, str],
    by: Method | None,
) -> Comparison:
    import pandas as pd

    return Comparison(pd.DataFrame(rows), images, truth, skipped, by)


def _row(
    method: Method, image: Image, seconds: list[dict[str, float]], errors: dict[str, float]
) -> dict[str, object]:
    return {
        "method": method.name,
        "parameters": parameters_text(method),
        "prepare_seconds": median(x["prepare"] for x in seconds),
        "frame_seconds": median(x["frame"] for x in seconds),
        "bytes": image.bytes,
        "threads": thread_count(),
        **errors,
        "repeats": len(seconds),
    }


def _errors(image: Image, truth: Image) -> dict[str, float]:
    return metrics.errors(image.visibility, truth.visibility, truth.mask)


def _check_reference(image: Image, camera: Camera) -> None:
    size = image.mask.shape
    if size != (camera.height, camera.width):
        raise ValueError(
            f"reference: its size {size[1]}x{size[0]} is not the camera's "
            f"{camera.width}x{camera.height}"
        )
    if not np.any(image.mask):
        raise ValueError("compare: the camera sees no surface, there is nothing to measure")


def parameters_text(method: Measurable) -> str:
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


def label_of(method: Measurable) -> str:
    """Return a method's name, with its parameters in parentheses if there are any."""
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
