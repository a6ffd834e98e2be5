"""`Auto`: a picture under an error that the user states, by what is cheapest, and judged for it.

The candidates are those that can come as near to the truth as they are asked to: `RayTraced` with
an error, and `Counted`. Both are timed on a small picture, the cheaper renders, and probes judge
the picture (`softshadow.estimate`). As long as the upper end of their interval is above what was
asked, it goes on with more samples. Every picture is judged by probes of its own, which decide
whether to go on, and never what a pixel is.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import ClassVar

from softshadow import checks
from softshadow._core import ParameterError, UnsupportedError, __version__
from softshadow.arguments import Bar, Progress
from softshadow.budget import Budget, OverBudgetError, estimated
from softshadow.camera import Camera
from softshadow.estimate import ErrorEstimate, Judge
from softshadow.light import LightLike
from softshadow.methods import Counted, Method, RayTraced
from softshadow.methods.base import check_parameters
from softshadow.render import Image, render
from softshadow.scene import Scene

__all__ = ["Auto", "Step"]

_MARGIN = 0.8
"""Of the error that is asked for: what `RayTraced` is asked for. It keeps that within a tenth, and
the interval's upper end is a tenth above the estimate."""

_PROBES = 16384
"""Most probes of a picture whose error may be above or below what was asked."""

_MOST_SAMPLES = 65536
_LEAST_ERROR = 1e-4
"""Ends of the candidates' ranges."""


@dataclass(frozen=True)
class Step:
    """A picture that `Auto` made on its way.

    Attributes
    ----------
    method : Method
        What answered all its pixels.
    why : str
        Why this one.
    seconds : float
        Of preparing and rendering.
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
class Auto:
    """A picture with an error below the one that is asked for, judged by probes.

    It is no method, since no other than a judged picture comes of it; `softshadow.sweep` takes it
    as one. See ``docs/how_to/estimate_error.md`` for what its interval means.

    Parameters
    ----------
    error : float
        Root mean square error of visibility over the pixels that hit a surface, 0.0005 to 1.
    confidence : float
        Of the interval whose upper end is to be below `error`, 0.5 to 0.9999.
    seed : int
        Of the light samples and of the probes, 0 to 2**64 - 1.
    seconds : float, optional
        When to stop with the best picture so far, whose interval may then end above `error`. The
        first picture, and what judges it, are not stopped. When not given: no limit.

    Raises
    ------
    TypeError, ValueError
        If a parameter is of another kind or out of its range.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> image = ss.Auto(error=0.02).render(setup.scene, setup.camera, setup.light)
    >>> image.error.high <= 0.02
    True
    >>> len(image.choice)  # pictures that were made until it held
    1
    """

    error: float = 0.01
    confidence: float = 0.95
    seed: int = 0
    seconds: float | None = None

    name: ClassVar[str] = "auto"
    version: ClassVar[str] = __version__

    def __post_init__(self) -> None:
        check_parameters(self)
        for what, low, high in (("error", 5e-4, 1.0), ("confidence", 0.5, 0.9999)):
            if not low <= getattr(self, what) <= high:
                raise ParameterError(
                    f"Auto.{what}: expected a number from {low} to {high}, got "
                    f"{checks.shown(getattr(self, what))}"
                )
        if self.seconds is not None and not self.seconds > 0:
            raise ParameterError(
                f"Auto.seconds: expected a positive number or None, got {self.seconds}"
            )

    def parameters(self) -> dict[str, float | int | None]:
        """Return the parameters by name.

        Returns
        -------
        dict of str to float, int or None
        """
        return {
            "error": self.error,
            "confidence": self.confidence,
            "seed": self.seed,
            "seconds": self.seconds,
        }

    def render(
        self, scene: Scene, camera: Camera, light: LightLike, progress: Progress = False
    ) -> Image:
        """Render until probes say that the error is below what was asked.

        Parameters
        ----------
        scene : Scene
        camera : Camera
        light : light or sequence of lights
        progress : bool or callable
            ``True`` for a progress bar, or a function that is told the finished fraction.

        Returns
        -------
        Image
            Its ``error`` is the estimate, its ``choice`` has a step for each picture that was made.
            ``seconds["frame"]`` is all that it took but ``prepare``, with the stages ``choose``,
            ``look`` and ``probes`` beside those of the picture.

        Raises
        ------
        TypeError
            If an argument is of the wrong kind.
        ValueError
            If the scene is empty.
        """
        if not isinstance(camera, Camera):
            raise TypeError(f"camera: expected softshadow.Camera, got {type(camera).__name__}")
        start = time.perf_counter()
        bar = Bar(progress, "auto")
        with bar:
            judge = Judge(scene, camera, light, self.seed, bar, ends=(0.0, 0.1))
            looked = time.perf_counter()
            method, why = self._cheapest(scene, camera, light)
            chosen = time.perf_counter() - looked
            best = self._until_it_holds(scene, camera, light, method, why, judge, bar, start)
        prepare = best.seconds["prepare"]
        all_of_it = time.perf_counter() - start - prepare
        seconds = {**best.seconds, "frame": all_of_it, "choose": chosen, **judge.seconds}
        return replace(best, seconds=seconds)

    def _cheapest(self, scene: Scene, camera: Camera, light: LightLike) -> tuple[Method, str]:
        """Return the candidate that takes least, by small pictures."""
        traced = RayTraced(samples=_MOST_SAMPLES, error=_MARGIN * self.error, seed=self.seed)
        candidates: tuple[Method, ...] = (traced, Counted(seed=self.seed))
        seconds: list[tuple[float, Method]] = []
        for method in candidates:
            with suppress(UnsupportedError):  # counted refuses very many instances
                taken = estimated(method, camera, lambda m, c, _: render(scene, c, light, m), False)
                seconds.append((taken.likely, method))
        told = ", ".join(f"{method.name} {likely:.2g} s" for likely, method in seconds)
        first = min(seconds, key=lambda taken: taken[0])
        return first[1], f"expected to take least: {told}"

    def _until_it_holds(
        self,
        scene: Scene,
        camera: Camera,
        light: LightLike,
        method: Method,
        why: str,
        judge: Judge,
        bar: Bar,
        start: float,
    ) -> Image:
        budget = None if self.seconds is None else Budget(self.seconds, False, start)
        steps: list[Step] = []
        best: Image | None = None
        known: ErrorEstimate | None = None
        upcoming: tuple[Method, str] | None = (method, why)
        told = 0.1
        while upcoming is not None:
            method, why = upcoming
            begun = time.perf_counter()
            told, part = told + 0.5 * (1.0 - told), (told, told + 0.3 * (1.0 - told))
            tell: Progress = bar.part(*part, f"auto: {method.name}")
            if budget is not None and best is not None:
                tell = budget.limit(budget.left)
            try:
                image = render(scene, camera, light, method, tell)
            except OverBudgetError:
                break
            seconds = time.perf_counter() - begun
            judge.ends = (part[1], told)
            visibility = image.visibility.reshape(-1, *image.mask.shape).astype(float)
            found = judge.estimate(visibility, self.confidence, self._settled, _PROBES)
            steps.append(Step(method, why, seconds, found.rmse, found.low, found.high))
            if known is None or found.high < known.high:
                best, known = image, found
            upcoming = self._next(method, found)
            if budget is not None and budget.left <= 0:
                break
        assert best is not None
        return replace(best, error=known, choice=tuple(steps))

    def _settled(self, _: float, low: float, high: float) -> bool:
        return high <= self.error or low > self.error

    def _next(self, method: Method, found: ErrorEstimate) -> tuple[Method, str] | None:
        """Return what to render after a picture, or None where nothing is to be gained."""
        if found.high <= self.error:
            return None
        why = f"the last picture's error may be {found.high:.2g}"
        if isinstance(method, Counted):
            if method.samples < _MOST_SAMPLES:
                return replace(method, samples=min(4 * method.samples, _MOST_SAMPLES)), why
            traced = RayTraced(samples=_MOST_SAMPLES, error=_MARGIN * self.error, seed=self.seed)
            return traced, f"{why}, and counted has no more samples"
        assert isinstance(method, RayTraced)
        assert method.error is not None
        if method.error <= _LEAST_ERROR:
            return None
        # What it lacks, and a tenth, so that the same does not come once more.
        asked = max(0.9 * method.error * self.error / found.high, _LEAST_ERROR)
        return replace(method, error=asked), why
