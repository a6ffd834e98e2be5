"""`Auto`: an answer under an error that the user states, by what is cheapest, and judged for it.

The candidates are those that can come as near to the truth as they are asked to: `RayTraced` with
an error, and `Counted`. Both are timed on a small part, the cheaper answers, and probes judge the
answer (`softshadow.judging`). As long as the upper end of their interval is above what was asked,
it goes on with more samples. Every answer is judged by probes of its own, which decide whether to
go on, and never what a pixel is. What held for one frame begins the next.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from softshadow._core import UnsupportedError
from softshadow.arguments import Bar, Progress
from softshadow.budget import Budget, OverBudgetError
from softshadow.camera import Camera
from softshadow.judging import ErrorEstimate, Judge
from softshadow.light import LightLike
from softshadow.methods import Auto, Counted, Method, RayTraced
from softshadow.methods.base import LEAST_ERROR, RANGES
from softshadow.render import Image, Prepared
from softshadow.scene import Scene, scene_of
from softshadow.targets import Answer, Picture, Points, Target

__all__ = ["PreparedAuto", "Step"]

_MARGIN = 0.8
"""Of the error that is asked for: what `RayTraced` is asked for. It keeps that within a tenth, and
the interval's upper end is a tenth above the estimate."""

_PROBES = 16384
"""Most probes of an answer whose error may be above or below what was asked."""

_MOST_SAMPLES = RANGES["samples"][1]

_GRID = 416
"""Light points of the smallest grid of `Counted`; it has room for this times a square."""

_COUNTED_ERROR = 0.008
"""What `Counted` keeps by its smallest grid, with the share of the error that interpolation may
have. Measured on solids, a scan and a city: 0.0018 to 0.0023, asked for 0.01."""

_SAFE = 0.7
"""Of the time that is left: what an answer is expected to take that is to end in time."""

_GENEROUS = 0.6
"""Of the error that is asked for: below it, rays that probes have moved do more than they need."""

_PATIENCE = 2.0
"""How many times as long as when it was chosen a method may take before costs are measured anew."""


@dataclass(frozen=True)
class Step:
    """An answer that ``auto`` made on its way.

    Attributes
    ----------
    method : Method
        What answered all its receivers.
    why : str
        Why this one.
    seconds : float
        Of preparing and answering.
    rmse, low, high : float
        The error and its interval, as probes found them.
    """

    method: Method
    why: str
    seconds: float
    rmse: float
    low: float
    high: float


@dataclass(frozen=True)
class _Held:
    """What held for a frame, and begins the next."""

    method: Method
    pace: float  # seconds a receiver
    judged: int  # answers that probes judged on the way to it


class PreparedAuto(Prepared):
    """What `softshadow.prepare` returns for ``auto``.

    Frames begin with the method that held for the last one. Probes judge them all the same, with
    seeds of their own wherever earlier probes have moved the method, and costs are measured anew
    when a frame takes twice as long.
    """

    def __init__(
        self, scene: Scene, light: LightLike, method: Auto, progress: Progress = False
    ) -> None:
        super().__init__(scene, light, _rays(method, _MARGIN * method.error), progress)
        self._method = self._auto = method
        self._scene = scene
        self._held: _Held | None = None
        self._kept: Prepared | None = None

    def render(self, camera: Camera, progress: Progress = False) -> Image:
        """Render until probes say that the error is below what was asked.

        Parameters
        ----------
        camera : Camera
        progress : bool or callable
            As of `Prepared.render`.

        Returns
        -------
        Image
            Its ``error`` is the estimate, its ``choice`` has a step for each picture that was made.
            ``seconds["frame"]`` is all that it took but ``prepare``, with the stages ``choose``,
            ``look`` and ``probes`` beside those of the picture.

        Raises
        ------
        TypeError
            If `camera` is no camera.
        """
        if not isinstance(camera, Camera):
            raise TypeError(f"camera: expected softshadow.Camera, got {type(camera).__name__}")
        run = _Run(self, Picture(camera), progress)
        image, error = run.answer()
        assert isinstance(image, Image)
        seconds = {**image.seconds, **self.seconds, **run.seconds}
        return replace(image, seconds=seconds, error=error, choice=tuple(run.steps))

    def visibility(
        self,
        points: npt.ArrayLike,
        normals: npt.ArrayLike | None = None,
        progress: Progress = False,
    ) -> npt.NDArray[np.float32]:
        """Return visibility at points until probes say that the error is below what was asked.

        Parameters
        ----------
        points, normals, progress
            As of `Prepared.visibility`.

        Returns
        -------
        ndarray, shape (N,) or (L, N), float32
            (L, N) when the lights are a sequence.

        Raises
        ------
        ValueError
            If shapes do not fit, or a value is not finite.

        Warns
        -----
        UserWarning
            If the error may be above what was asked: the time was over, or samples were.
        """
        run = _Run(self, Points(*self._points(points, normals)), progress)
        seen, error = run.answer()
        assert not isinstance(seen, Image)
        if error.high > self._auto.error:
            warnings.warn(
                f"auto: the error at the points may be {error.high:.2g}, above the "
                f"{self._auto.error:g} that was asked for: {run.ended}",
                stacklevel=2,
            )
        return seen

    def _with(self, method: Method, tell: Progress = False) -> Prepared:
        """Prepare a method for the scene as it was, or return what is prepared already."""
        kept = self._kept
        if kept is not None and kept.method == method:
            return kept
        light: LightLike = self.lights[0] if self._single else self.lights
        while True:
            if not self._is_as_it_was():
                copy = scene_of(self._entries, self._instances)
                self._scene, self._entries = copy, copy.entries  # which nobody else changes
            prepared = Prepared(self._scene, light, method, tell)
            if self._is_as_it_was():  # also while it was prepared
                return prepared

    def _is_as_it_was(self) -> bool:
        now, then = self._scene.entries, self._entries
        return len(now) == len(then) and all(a is b for a, b in zip(now, then, strict=True))


class _Run:
    """One call: what is wanted, what is there so far, and the time that is left."""

    def __init__(self, owner: PreparedAuto, target: Target, progress: Progress) -> None:
        self.owner, self.target, self.auto = owner, target, owner._auto
        self._start = time.perf_counter()
        self._budget = Budget(self.auto.seconds or math.inf, False, self._start)
        self._bar = Bar(progress, "auto")
        self._told = 0.1  # how far the bar is
        self._judging = 0.0  # seconds that judging an answer takes
        self._choosing = 0.0
        self.steps: list[Step] = []
        # Answers that costs were measured on, where these are no small part of all.
        self._ready: dict[Method, tuple[Answer, float]] = {}
        self.ended = "it held"
        self._best: tuple[Answer, ErrorEstimate] | None = None

    @property
    def seconds(self) -> dict[str, float]:
        """The stages of a frame that are not the answer's own."""
        every = time.perf_counter() - self._start
        return {"frame": every, "choose": self._choosing, **self._judge.seconds}

    @property
    def _left(self) -> float:
        """Seconds for an answer, so that there are some to judge it."""
        return self._budget.left - 1.5 * self._judging

    def answer(self) -> tuple[Answer, ErrorEstimate]:
        """Answer until the error holds, or nothing is to be gained."""
        with self._bar:
            pilot = None
            begun = time.perf_counter()
            if self.auto.seconds is not None:
                few = RayTraced(samples=4, error=1.0, seed=self.auto.seed)
                pilot = few, self.target.answer(self.owner._with(few), False)
            took = time.perf_counter() - begun
            held = self.owner._held
            receives = np.array([e.receives for e in self.owner._entries], dtype=np.bool_)
            self._judge = Judge(
                self.target,
                self.owner._with,
                receives,
                self.owner._single,
                [self.auto.seed, held.judged] if held and held.judged else [self.auto.seed],
                self._bar,
                (0.0, self._told),
                lambda: self._budget.left <= 0,
            )
            if pilot is not None:
                self._add(*pilot, "there is an answer whatever the time", took)
            self._go_on(held)
            self._hold(held)
        assert self._best is not None
        return self._best

    def _go_on(self, held: _Held | None) -> None:
        """Answer until the error holds or the time is over."""
        upcoming = self._first(held) if self._wanting() else None
        while upcoming is not None:
            method, why = upcoming
            begun = time.perf_counter()
            end = self._told + 0.3 * (1.0 - self._told)
            tell = self._bar.part(self._told, end, f"auto: {method.name}")
            limit = self._budget.limit(self._left) if self.steps else None
            try:
                prepared = self.owner._with(method, _both(limit, False))
                if method in self._ready:
                    answer, seconds = self._ready[method]
                else:
                    answer = self.target.answer(prepared, _both(limit, tell))
                    seconds = time.perf_counter() - begun
            except OverBudgetError:
                self.ended = "the time was over"
                return
            self.owner._kept = prepared
            self._told = end
            self._add(method, answer, why, seconds)
            upcoming = self._next() if self._wanting() else None

    def _wanting(self) -> bool:
        """Whether the error does not hold yet, and there is time."""
        if self._best is not None and self._best[1].high <= self.auto.error:
            return False
        if self._best is not None and self._left <= 0:
            self.ended = "the time was over"
            return False
        return True

    def _add(self, method: Method, answer: Answer, why: str, seconds: float) -> None:
        """Judge an answer, and keep it if it is the best."""
        begun = time.perf_counter()
        end = self._told + 0.3 * (1.0 - self._told)
        self._judge.ends, self._told = (self._told, end), end
        seen = self.target.visibility(answer)
        found = self._judge.estimate(seen, self.auto.confidence, self._settled, _PROBES, True)
        self._judging = time.perf_counter() - begun
        self.steps.append(Step(method, why, seconds, found.rmse, found.low, found.high))
        if self._best is None or found.high < self._best[1].high:
            self._best = answer, found

    def _settled(self, _: float, low: float, high: float) -> bool:
        return high <= self.auto.error or low > self.auto.error

    # What answers

    def _first(self, held: _Held | None) -> tuple[Method, str] | None:
        """Return the method that answers first, and why; None where there is no time for any."""
        rays, counted = _rays(self.auto, _MARGIN * self.auto.error), _counted(self.auto)
        if not self._judge.mask.any():
            return rays, "there is nothing to see"
        if held is not None:
            expected = held.pace * self._judge.mask.sum()
            return self._affordable(held.method, expected), "it held for the last frame"
        engines: dict[str, Method] = {"ray_traced": rays, "counted": counted}
        if self.auto.engine == "counted":
            return counted, "it was asked for"
        begun = time.perf_counter()
        costs = {"ray_traced": self._cost(rays, math.inf)}
        target = rays
        while costs["ray_traced"] > _SAFE * self._left > 0 and _error(rays) < 1.0:
            # There is no time for that: how far does it reach?
            rays = engines["ray_traced"] = _rays(self.auto, min(3.0 * _error(rays), 1.0))
            costs["ray_traced"] = self._cost(rays, math.inf)
        if self.auto.engine == "cheapest":
            most = costs["ray_traced"] if rays == target else math.inf
            cost = self._cost(counted, most)
            if rays == target or cost < _SAFE * self._left:
                costs["counted"] = cost
                if rays != target:
                    costs["ray_traced"] = math.inf  # would miss
        self._choosing = time.perf_counter() - begun
        first = min(costs, key=lambda name: costs[name])
        told = ", ".join(f"{name} {cost:.2g} s" for name, cost in costs.items() if cost < math.inf)
        chosen = engines[first]
        if self._best is not None and chosen == rays and _error(rays) > self._best[1].rmse:
            self.ended = "the time was over"
            return None
        if self.auto.engine != "cheapest":
            return chosen, "it was asked for"
        return chosen, f"expected to take least: {told}"

    def _cost(self, method: Method, most: float) -> float:
        """Return the seconds that a method is expected to take, or infinity if over the most."""
        part, share = self.target.part(self._judge.look, self._judge.mask)
        begun = time.perf_counter()
        if self.auto.seconds is not None:
            most = min(most, max(self._left, 0.0))
        try:
            prepared = self.owner._with(method, _both(self._budget.limit(most), False))
            prepare = time.perf_counter() - begun
            # A small part has what does not grow with its size, too: some milliseconds.
            limit = self._budget.limit(1.2 * share * most + 0.005)
            answer = part.answer(prepared, _both(limit, False))
        except (OverBudgetError, UnsupportedError):
            return math.inf
        seconds = time.perf_counter() - begun
        if part is self.target:
            self._ready[method] = answer, seconds
        return prepare + (seconds - prepare) / share

    def _affordable(self, method: Method, expected: float) -> Method:
        """Return a method that is likely to end in time: itself, or rays under a larger error."""
        allowed = _SAFE * self._left
        if expected <= allowed or not isinstance(method, RayTraced) or allowed <= 0:
            return method
        # Time falls with the error by its first power, at least.
        return _rays(self.auto, min(_error(method) * expected / allowed, 1.0))

    def _next(self) -> tuple[Method, str] | None:
        """Return what answers after the last step, or None where nothing is to be gained."""
        last = self.steps[-1]
        why = f"the last answer's error may be {last.high:.2g}"
        if isinstance(last.method, Counted):
            finer = _finer(last.method)
            if finer != last.method:
                return finer, why
            if self.auto.engine == "counted":
                self.ended = "counted has no more samples"
                return None
            return _rays(self.auto, _MARGIN * self.auto.error), why
        assert isinstance(last.method, RayTraced)
        own = _error(last.method)
        # What it lacks, and a tenth, so that the same does not come once more.
        asked = _rays(self.auto, 0.9 * own * self.auto.error / last.high)
        chosen = self._affordable(asked, last.seconds * own / _error(asked))
        if _error(chosen) > 0.95 * own:
            self.ended = "rays have no more samples" if chosen == asked else "the time was over"
            return None
        return chosen, why

    # What is left for the next frame

    def _hold(self, held: _Held | None) -> None:
        """Leave the method that held for the next frame, or nothing, so that it measures."""
        last, receivers = self.steps[-1], int(self._judge.mask.sum())
        tried = len(self.steps) - (self.auto.seconds is not None)  # without the first answer
        if tried == 0 or not receivers or last.high > self.auto.error:
            return  # this frame says nothing about the next
        pace, judged = last.seconds / receivers, 0
        if held is not None:
            # Rays that probes have moved are let off again where that is too much.
            generous = held.judged > 0 and last.high < _GENEROUS * self.auto.error
            if pace > _PATIENCE * held.pace or generous:
                self.owner._held = None
                return
            if tried == 1:
                return
            judged = held.judged
        if tried > 1:
            judged += len(self.steps)
        self.owner._held = _Held(last.method, pace, judged)


def _rays(auto: Auto, error: float) -> RayTraced:
    return RayTraced(samples=_MOST_SAMPLES, error=max(error, LEAST_ERROR), seed=auto.seed)


def _error(method: Method) -> float:
    """Return the error that rays are asked for."""
    assert isinstance(method, RayTraced)
    assert method.error is not None
    return method.error


def _counted(auto: Auto) -> Counted:
    """Return counting with as many light points as the error needs, and rays where it needs them.

    Interpolation may have half of the error. An error by rays falls with their number by a power of
    0.57, from 0.0095 by 256 where all is a penumbra (fur, ``benches/dense.py``); one by light
    points with their number by 0.7.
    """
    side = math.ceil(max(_COUNTED_ERROR / auto.error, 1.0) ** 0.7)
    rays = 2 ** round(math.log2(256 * (0.0095 / auto.error) ** 1.75))
    return Counted(
        samples=min(_GRID * side * side, _MOST_SAMPLES),
        rays=min(max(rays, 16), RANGES["rays"][1]),
        seed=auto.seed,
        error=max(0.5 * auto.error, LEAST_ERROR),
    )


def _finer(method: Counted) -> Counted:
    """Return counting with four times the samples and half of the error, as far as there are."""
    assert method.error is not None
    return replace(
        method,
        samples=min(4 * method.samples, _MOST_SAMPLES),
        rays=min(4 * method.rays, RANGES["rays"][1]),
        error=max(0.5 * method.error, LEAST_ERROR),
    )


def _both(limit: Callable[[float], None] | None, tell: Progress) -> Progress:
    """Return a progress argument that obeys a limit, and tells a bar."""
    if limit is None:
        return tell

    def told(fraction: float) -> None:
        limit(fraction)
        if callable(tell):
            tell(fraction)

    return told
