"""A time budget for `compare`: what is slow is estimated and left out, instead of waited for."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from softshadow._core import UnsupportedError
from softshadow.arguments import Progress
from softshadow.camera import Camera
from softshadow.methods import Method, RayTraced
from softshadow.render import Image

__all__ = ["Budget", "affordable_reference", "estimated", "in_rounds", "small"]

_SHRINK = 8
"""How much smaller the picture is that an estimate is measured on, a side."""

_SMALLEST = 16
"""Pixels a side below which a picture tells nothing."""

_PROBE_SHARE = 0.2
"""Of what remains: how much the first estimates may take together. What is stopped for it gets
another try, twice as long, when the methods that are cheaper are done."""

_REFERENCE_SHARE = 1 / 3
"""Of the budget: how much the default reference may take before it gets fewer samples."""

_FEWEST_SAMPLES = 256
"""Of the default reference; with fewer, its noise would be among the errors that it measures."""

Render = Callable[[Method, Camera, Progress], Image]
"""Prepares and renders a fresh copy of the scene."""


class OverBudgetError(Exception):
    """A render took longer than it may; raised through its progress argument."""


class Budget:
    """Seconds that are left, and a progress argument that stops a render when they are used.

    Parameters
    ----------
    seconds : float
        From its start on.
    tell : bool or callable
        Is told the used fraction of the budget, where it is a function.
    start : float
        When it began, as of ``time.perf_counter``.
    """

    def __init__(self, seconds: float, tell: Progress, start: float) -> None:
        self._seconds = seconds
        self._tell = tell
        self._start = start

    @property
    def left(self) -> float:
        """Seconds until the budget is used; negative after that."""
        return self._start + self._seconds - time.perf_counter()

    def limit(self, seconds: float) -> Limit:
        """Return a progress argument that raises `OverBudgetError` after so many seconds."""
        return Limit(self, time.perf_counter() + seconds)

    def tell(self) -> None:
        """Tell the used fraction."""
        if callable(self._tell):
            self._tell(min(1.0 - self.left / self._seconds, 1.0))


class Limit:
    """The progress argument of preparing and then rendering, which ends both after a time.

    Attributes
    ----------
    reached : float
        Which part of both was done, each a half.
    """

    def __init__(self, budget: Budget, end: float) -> None:
        self._budget = budget
        self._end = end
        self._half = 0.0
        self._last = 0.0
        self.reached = 0.0

    def __call__(self, fraction: float) -> None:
        if fraction < self._last:  # the render begins
            self._half = 0.5
        self._last = fraction
        self.reached = max(self.reached, self._half + fraction / 2)
        self._budget.tell()
        if time.perf_counter() > self._end:
            raise OverBudgetError


def small(camera: Camera, shrink: int = _SHRINK) -> Camera:
    """Return a camera with the same view and a part of the pixels a side, at least 16."""
    width, height = (
        min(n, max(_SMALLEST, round(n / shrink))) for n in (camera.width, camera.height)
    )
    scale = np.diag([width / camera.width, height / camera.height, 1.0])
    return Camera.from_matrix(scale @ camera.K, camera.camera_to_world, width, height)


@dataclass(frozen=True)
class Estimate:
    """Seconds of preparing and rendering once, from a small picture's.

    Attributes
    ----------
    prepare, frame : float
        Of the small picture.
    few : Camera
        That it was rendered with.
    growth : float
        How many times as long the whole frame takes at most, as far as is known.
    """

    prepare: float
    frame: float
    few: Camera
    growth: float

    @property
    def least(self) -> float:
        """With a frame that does not grow at all."""
        return self.prepare + self.frame

    @property
    def most(self) -> float:
        """With one that grows as far as is known."""
        return self.prepare + self.frame * self.growth

    def __str__(self) -> str:
        return f"up to {_plain(self.most)} s, as {_size(self.few)} took {_plain(self.least)} s"


def estimated(
    method: Method, camera: Camera, render: Render, progress: Progress, shrink: int = _SHRINK
) -> Estimate:
    """Return what a method will take if a frame grows with the pixels, from a small picture."""
    few = small(camera, shrink)
    seconds = render(method, few, progress).seconds
    return Estimate(seconds["prepare"], seconds["frame"], few, _pixels(camera) / _pixels(few))


def closer(
    before: Estimate, method: Method, camera: Camera, render: Render, progress: Progress
) -> Estimate:
    """Return an estimate from a picture of twice the side, which tells how a frame grows.

    What draws textures takes nearly as long for a small picture as for a large one.
    """
    found = estimated(method, camera, render, progress, _SHRINK // 2)
    pixels = _pixels(found.few) / _pixels(before.few)
    if pixels <= 1:
        return found
    # By the same power of the pixels as from the last picture to this one.
    power = math.log(max(found.frame / before.frame, 1.0)) / math.log(pixels)
    return replace(found, growth=found.growth ** min(power, 1.0))


def _plain(seconds: float) -> str:
    """Return two digits of small times, and large ones without an exponent."""
    return f"{seconds:.2g}" if seconds < 99.5 else f"{seconds:.0f}"


def _pixels(camera: Camera) -> int:
    return camera.width * camera.height


def _size(camera: Camera) -> str:
    return f"{camera.width}x{camera.height} pixels"


def affordable_reference(
    method: RayTraced, camera: Camera, render: Render, budget: Budget
) -> RayTraced:
    """Return the default reference with as many samples as a third of the budget has time for.

    The time is that of a small picture; samples are halved down to 256.
    """
    seconds = estimated(method, camera, render, False).most
    while seconds > _REFERENCE_SHARE * budget.left and method.samples > _FEWEST_SAMPLES:
        method = replace(method, samples=method.samples // 2)
        seconds /= 2
    return method


@dataclass
class Outcome:
    """What came of several methods within a budget.

    Attributes
    ----------
    images : dict of str to Image
        Of each method that was rendered, by label.
    seconds : dict of str to list of dict
        Its times, one of `Image.seconds` a round.
    skipped : dict of str to str
        Why the others were not.
    """

    images: dict[str, Image] = field(default_factory=dict)
    seconds: dict[str, list[dict[str, float]]] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)


def in_rounds(
    methods: Mapping[str, Method],
    camera: Camera,
    render: Render,
    repeats: int,
    budget: Budget,
    finish: Callable[[str, Image], None],
    given: bool,
) -> Outcome:
    """Render as many methods as there is time for, the cheapest first, then repeat.

    Every method that fits is rendered once before one is rendered again.

    Parameters
    ----------
    methods : mapping of str to Method
        By label.
    camera : Camera
    render : callable
    repeats : int
        Rounds at most; a method takes part in a further one if there is time for twice its last.
    budget : Budget
    finish : callable
        Is called with a label and its first image; what it takes counts as well.
    given : bool
        Whether the user asked for these methods: one that cannot do the scene is an error then, and
        skipped otherwise.

    Returns
    -------
    Outcome

    Raises
    ------
    UnsupportedError
        Of a given method.
    """
    run = _Run(methods, camera, render, budget, finish, given, Outcome())
    limit = _PROBE_SHARE * budget.left / len(methods)
    slow = [label for label in methods if not run.estimate(label, limit)]
    for label in sorted(run.estimates, key=lambda x: run.estimates[x].most):
        run.first(label)
    # What is stopped wastes less than what it takes in the end, as the limit doubles. Rendering
    # takes longer than the estimate did: over half of what remains would be in vain.
    while slow and 2 * limit < budget.left / 2:
        limit, pending, slow = 2 * limit, sorted(slow, key=lambda x: run.expected[x]), []
        for label in pending:
            soon = run.expected[label] < 2 * limit and limit < budget.left / 2
            if soon and run.estimate(label, limit):
                run.first(label)
            else:
                slow.append(label)
    # What a small picture takes long for may take no longer for a large one.
    over = [label for label in run.estimates if label not in run.outcome.images]
    for label in sorted(over, key=lambda x: run.estimates[x].least):
        if run.estimates[label].least < budget.left / 4:
            run.look_closer(label, budget.left / 2)
            run.first(label)
    run.repeat(repeats)
    return run.outcome


@dataclass
class _Run:
    """What `in_rounds` was given, and what it has found."""

    methods: Mapping[str, Method]
    camera: Camera
    render: Render
    budget: Budget
    finish: Callable[[str, Image], None]
    given: bool
    outcome: Outcome
    estimates: dict[str, Estimate] = field(default_factory=dict)
    expected: dict[str, float] = field(default_factory=dict)  # of estimates that were stopped
    costs: dict[str, float] = field(default_factory=dict)

    def estimate(self, label: str, limit: float) -> bool:
        """Estimate a method's seconds; False if that would take longer than the limit."""
        told = self.budget.limit(limit)
        try:
            found = estimated(self.methods[label], self.camera, self.render, told)
        except OverBudgetError:
            size = _size(small(self.camera))
            reason = f"over the budget: over {_plain(limit)} s for {size} alone"
            self.outcome.skipped[label] = reason
            self.expected[label] = limit / max(told.reached, 0.01)
            return False
        except UnsupportedError as error:
            self._refuse(label, error)
            return True
        self.outcome.skipped.pop(label, None)
        self.estimates[label] = found
        return True

    def look_closer(self, label: str, limit: float) -> None:
        """Estimate a method anew, by how it grows; as before if that would take too long."""
        args = self.methods[label], self.camera, self.render, self.budget.limit(limit)
        with suppress(OverBudgetError):
            self.estimates[label] = closer(self.estimates[label], *args)

    def first(self, label: str) -> None:
        """Render a method for the first time, if there is time for the most that it may take."""
        if label not in self.estimates:  # it cannot do the scene
            return
        left = max(self.budget.left, 0.0)
        if self.estimates[label].most > left:
            reason = f"over the budget: {self.estimates[label]}; {_plain(left)} s were left"
            self.outcome.skipped[label] = reason
            return
        start = time.perf_counter()
        try:
            image = self.render(self.methods[label], self.camera, self.budget.limit(left))
        except OverBudgetError:
            reason = f"over the budget: stopped after {_plain(left)} s; {self.estimates[label]}"
            self.outcome.skipped[label] = reason
            return
        except UnsupportedError as error:
            del self.estimates[label]
            self._refuse(label, error)
            return
        self.costs[label] = time.perf_counter() - start
        self.outcome.skipped.pop(label, None)
        self.outcome.images[label] = image
        self.outcome.seconds[label] = [image.seconds]
        self.finish(label, image)

    def repeat(self, repeats: int) -> None:
        """Time further rounds, in turn, so that a drift of the machine hits all methods."""
        for _ in range(1, repeats):
            for label, seconds in self.outcome.seconds.items():
                if 2 * self.costs[label] > self.budget.left:
                    continue
                start = time.perf_counter()
                told = self.budget.limit(self.budget.left)
                try:
                    image = self.render(self.methods[label], self.camera, told)
                except OverBudgetError:
                    return
                seconds.append(image.seconds)
                self.costs[label] = time.perf_counter() - start

    def _refuse(self, label: str, error: UnsupportedError) -> None:
        if self.given:
            raise error
        self.outcome.skipped[label] = str(error)
