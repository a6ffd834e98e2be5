"""What judges a picture: the reference, at a few of its pixels, with an interval.

A rough look at all pixels, by few light samples, says where to ask; the reference answers there
twice, with light samples of its own, so that an estimate of the squared error has no bias however
noisy it is: ``(v - a) (v - b)``. The look decides where probes are and nothing else, and what the
probes say decides only when there are enough.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from softshadow.arguments import Bar, Progress
from softshadow.kernels import light_fraction_above
from softshadow.methods import RayTraced
from softshadow.probing import Strata, interval, neighbourhood
from softshadow.render import Prepared
from softshadow.targets import Target

__all__ = ["SMALL", "ErrorEstimate", "Judge"]

_Doubles = npt.NDArray[np.float64]
_Places = npt.NDArray[np.int64]

_LOOK_SAMPLES = 16
"""Of the rough look. With 4, probes tell a tenth more or less than with 16; with none, and the
picture's own slopes instead, twice as much, and single wrong pixels are not found."""

_FIRST = 512
"""Probes of the first round, or a hundredth of the pixels where that is more. With 256 the interval
of what few pixels make is too narrow (``benches/estimate.py``)."""

_SHARE = 0.01

_SAMPLES = (256, 16384)
"""Light samples of each of a probe's two halves: at first, and at most."""

SMALL = 1e-3
"""An error below which none is told apart as precisely as a part of itself: a visibility of a
thousandth is what a picture of eight bits does not show, and takes a hundred thousand samples."""

_NOISE = 0.1
"""Up to which part of the mean squared error the probes' own noise is; with more, they get more
samples. Noise makes no bias, and what it makes unsure is in the interval; but where it is most of
what is seen, the lower end was too high in a tenth of the runs (pictures by ``counted``)."""


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """How wrong a picture or points are, as `estimate_error` finds it; it equals itself only.

    Attributes
    ----------
    rmse : float
        Root mean square error of visibility over the pixels that hit a surface, or over all points,
        as estimated; with several lights over them all, each weighing the same. 0 where nothing
        was hit.
    low, high : float
        Ends of the interval in which the true error lies with probability `confidence`, over the
        random choice of probes.
    confidence : float
        As it was asked for.
    probes : int
        Pixels that the reference answered.
    samples : int
        Light samples that it took for each and every light.
    unseen : float
        At the same confidence, the largest share of the pixels that could be wrong without the
        rough look having noticed any and without a probe having fallen on one.
    map : ndarray, shape (H, W) or (N,), float32
        Root mean square error of the pixels that are as suspicious as each: where the picture is
        wrong, as far as the probes tell. 0 where nothing was hit.
    lights : tuple of ErrorEstimate
        Of several lights given as a sequence, each by itself, from the same probes; else empty.
    seconds : dict
        Wall-clock seconds: ``look``, ``probes``.
    """

    rmse: float
    low: float
    high: float
    confidence: float
    probes: int
    samples: int
    unseen: float
    map: npt.NDArray[np.float32] = field(repr=False)
    lights: tuple[ErrorEstimate, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict, repr=False)


class Judge:
    """The reference for one target, with the rough look; judges any number of answers there.

    Parameters
    ----------
    target : Picture or Points
    reference : callable
        Prepares it: is told a `RayTraced` and a progress argument.
    receives : ndarray, shape (entries,), bool
        Which of the scene's entries receive.
    single : bool
        Whether one light was given by itself.
    seed : sequence of int
        Of the look, the choice of probes and the reference's samples.
    bar : Bar
        Of all that is done for the target.
    ends : tuple of float
        Which part of the bar the look is.
    late : callable, optional
        Whether there is no more time: the first probes are asked all the same.

    Attributes
    ----------
    look : ndarray, shape (L, H, W) or (L, N), float64
        Visibility by few samples.
    mask : ndarray, shape (H, W) or (N,), bool
    ends : tuple of float
        Which part of the bar the probes are that come next.
    seconds : dict
        As of `ErrorEstimate`, of all answers so far.
    """

    def __init__(
        self,
        target: Target,
        reference: Callable[[RayTraced, Progress], Prepared],
        receives: npt.NDArray[np.bool_],
        single: bool,
        seed: Sequence[int],
        bar: Bar,
        ends: tuple[float, float] = (0.0, 0.3),
        late: Callable[[], bool] = lambda: False,
    ) -> None:
        start = time.perf_counter()
        # Seeds far from those that methods have by default: their samples are not these.
        self._seeds = np.random.SeedSequence([*seed, 0x9E3779B9])
        self._reference, self._bar, self.single, self.late = reference, bar, single, late
        method = RayTraced(samples=_LOOK_SAMPLES, seed=self._seed())
        middle = 0.7 * ends[0] + 0.3 * ends[1]
        prepared = reference(method, bar.part(ends[0], middle, "estimate: look"))
        self._lights = prepared.lights
        answer = target.answer(prepared, bar.part(middle, ends[1], "estimate: look"))
        self.look: _Doubles = target.visibility(answer)
        self._receivers = target.receivers(answer, receives)
        self.mask = self._receivers.mask
        self.ends = ends[1], 1.0
        self.seconds = {"look": time.perf_counter() - start, "probes": 0.0}

    def _seed(self) -> int:
        return int(self._seeds.spawn(1)[0].generate_state(1, np.uint64)[0])

    def estimate(
        self,
        visibility: _Doubles,
        confidence: float,
        enough: Callable[[float, float, float], bool],
        probes: int,
        roughly: bool = False,
    ) -> ErrorEstimate:
        """Ask at more and more pixels until an error and its interval are known well enough.

        Parameters
        ----------
        visibility : ndarray, shape (L, H, W) or (L, N), float64
        confidence : float
        enough : callable
            Is told the error and the ends of its interval.
        probes : int
            Most of them.
        roughly : bool
            Whether it is enough to know that much, even if most of it is the probes' own noise; the
            lower end is 0 then.
        """
        start = time.perf_counter()
        mask = self.mask
        seen = visibility[:, mask]
        pixels = seen.shape[1]
        if not pixels:
            empty = np.zeros(mask.shape, np.float32)
            return ErrorEstimate(0.0, 0.0, 0.0, confidence, 0, 0, 0.0, empty, (), self.seconds)
        rng = np.random.default_rng(self._seeds.spawn(1)[0])
        strata = Strata(self._suspicion(visibility), rng)
        found = _Answers(self, seen, strata)
        total = min(probes, max(_FIRST, math.ceil(_SHARE * pixels)))
        found.ask(total)
        while True:
            done = enough(*(math.sqrt(max(x, 0.0)) for x in found.interval(None, confidence)))
            if self.late():
                break
            again = found.noise > 0.5 and not done if roughly else found.noisy
            if again and found.samples < _SAMPLES[1]:
                found.ask_again()
            elif total < min(probes, pixels) and not done:
                total *= 2
                found.ask(total)
            else:
                break
        self.seconds["probes"] += time.perf_counter() - start
        return found.estimate(confidence, self)

    def _suspicion(self, visibility: _Doubles) -> _Doubles:
        """Return how far each pixel, or those around it, are off the look."""
        squares = np.square(visibility - self.look).mean(axis=0)
        if self.mask.ndim == 2:  # points have no neighbours
            squares = np.maximum(squares, neighbourhood(squares, self.mask))
        result: _Doubles = np.sqrt(squares)[self.mask]
        return result

    def answers(self, places: _Places, samples: int) -> _Doubles:
        """Return two independent answers of the reference, shape (2, L, N)."""
        its = self._receivers
        shaded = its.shaded[places]
        points = its.points[places]
        normals = None if its.normals is None else its.normals[places]
        first, last = self.ends
        middle, end = 0.75 * first + 0.25 * last, 0.5 * (first + last)
        self.ends = end, last  # there may be more
        both = np.empty((2, len(self._lights), len(places)))
        for half, part in enumerate(((first, middle), (middle, end))):
            method = RayTraced(samples=samples, seed=self._seed())
            prepared = self._reference(method, False)
            tell = self._bar.part(*part, "estimate: probes")
            turned = None if normals is None else normals[shaded]
            both[half][:, shaded] = np.atleast_2d(prepared.visibility(points[shaded], turned, tell))
        if normals is not None:  # of what receives no shadows
            for row, light in enumerate(self._lights):
                both[:, row, ~shaded] = light_fraction_above(
                    light, points[~shaded], normals[~shaded]
                )
        return both


class _Answers:
    """What the reference has said so far of one picture."""

    def __init__(self, judge: Judge, seen: _Doubles, strata: Strata) -> None:
        self._judge, self._seen, self.strata = judge, seen, strata
        self._counts = np.zeros_like(strata.sizes)
        self.samples = _SAMPLES[0]
        lights = len(seen)
        # Of each stratum, (L, n): unbiased squared errors, and the variance of their noise.
        self._squares = [np.empty((lights, 0)) for _ in strata.sizes]
        self._noise = [np.empty((lights, 0)) for _ in strata.sizes]
        self._own = [np.empty((lights, 0)) for _ in strata.sizes]

    def ask(self, total: int) -> None:
        """Ask at about so many pixels in all; what was asked before stays."""
        counts = self.strata.counts(total)
        self._ask(self._counts, counts)
        self._counts = counts

    def ask_again(self) -> None:
        """Ask at the same pixels with four times the samples."""
        self.samples *= 4
        self._ask(np.zeros_like(self._counts), self._counts)

    def _ask(self, first: _Places, counts: _Places) -> None:
        drawn = [d[n:] for d, n in zip(self.strata.drawn(counts), first, strict=True)]
        places = np.concatenate(drawn)
        if not len(places):
            return
        a, b = self._judge.answers(places, self.samples)
        v = self._seen[:, places]
        squares, apart = (v - a) * (v - b), np.square(a - b)
        noise = np.maximum(squares, 0.0) * apart + 0.25 * np.square(apart)
        ends = np.cumsum([len(d) for d in drawn])[:-1]
        for kept, new in (
            (self._squares, squares),
            (self._noise, noise),
            (self._own, 0.25 * apart),
        ):
            for s, part in enumerate(np.split(new, ends, axis=1)):
                kept[s] = np.concatenate([kept[s][:, : first[s]], part], axis=1)

    @property
    def noisy(self) -> bool:
        """Whether the reference's own squared error is more than a small part of what it judges."""
        own, mean = (
            sum(n * x.mean() for n, x in zip(self.strata.sizes, values, strict=True))
            for values in (self._own, self._squares)
        )
        return bool(own > _NOISE * max(mean, SMALL**2 * self.strata.sizes.sum()))

    @property
    def noise(self) -> float:
        """Which part of the estimate's variance is the reference's noise, about."""
        all_ = np.square(self.strata.sizes) / self._counts
        own, every = (
            float(sum(n * x for n, x in zip(all_, parts, strict=True)))
            for parts in (
                [x.mean() for x in self._noise],
                [x.mean(axis=0).var() for x in self._squares],
            )
        )
        return own / every if every > 0 else 0.0

    def interval(self, light: int | None, confidence: float) -> tuple[float, float, float]:
        """Return the mean squared error of a light, or of all, and its interval."""
        if light is not None:
            values, noise = ([x[light] for x in kept] for kept in (self._squares, self._noise))
        else:
            values = [x.mean(axis=0) for x in self._squares]
            # Lights share samples, so that their noise may go together.
            noise = [np.square(np.sqrt(x).mean(axis=0)) for x in self._noise]
        mean, low, high = interval(self.strata.sizes, values, noise, confidence)
        return mean, min(low, 1.0), min(high, 1.0)  # nothing is off by more

    def estimate(self, confidence: float, judge: Judge) -> ErrorEstimate:
        several = () if judge.single else range(len(self._seen))
        lights = tuple(self._of(light, confidence, judge, ()) for light in several)
        return self._of(None, confidence, judge, lights)

    def _of(
        self,
        light: int | None,
        confidence: float,
        judge: Judge,
        lights: tuple[ErrorEstimate, ...],
    ) -> ErrorEstimate:
        mean, low, high = (math.sqrt(max(x, 0.0)) for x in self.interval(light, confidence))
        if self.noisy and self.samples < _SAMPLES[1]:
            low = 0.0  # of noise, more of the lower ends than promised are too high
        means = np.array([(x if light is None else x[light]).mean() for x in self._squares])
        errors = np.zeros(judge.mask.shape, np.float32)
        errors[judge.mask] = np.sqrt(np.maximum(means, 0.0))[self.strata.of]
        probes, samples = int(self._counts.sum()), 2 * self.samples
        unseen = self._unseen(confidence)
        return ErrorEstimate(
            *(mean, low, high, confidence, probes, samples, unseen, errors, lights),
            seconds=dict(judge.seconds),
        )

    def _unseen(self, confidence: float) -> float:
        """Return the share of pixels of which no probe is likely to have found one."""
        size, count = int(self.strata.sizes[0]), int(self._counts[0])
        if not self.strata.calm or count == size:
            return 0.0
        share = size / float(self.strata.sizes.sum())
        return share * float(1.0 - (1.0 - confidence) ** (1.0 / count))
