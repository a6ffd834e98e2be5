"""`estimate_error`: how wrong a picture is, from a few of its pixels, with an interval.

A rough look at all pixels, by few light samples, says where to ask; the reference answers there
twice, with light samples of its own, so that an estimate of the squared error has no bias however
noisy it is: ``(v - a) (v - b)``. The look decides where probes are and nothing else, and what the
probes say decides only when there are enough.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow.arguments import Bar, Progress
from softshadow.camera import Camera
from softshadow.kernels import light_fraction_above
from softshadow.light import LightLike, as_lights
from softshadow.methods import RayTraced
from softshadow.probing import Strata, interval, neighbourhood
from softshadow.render import Image, prepare
from softshadow.scene import Scene

__all__ = ["ErrorEstimate", "Judge", "estimate_error"]

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

_SMALL = 1e-3
"""An error below which none is told apart as precisely as a part of itself: a visibility of a
thousandth is what a picture of eight bits does not show, and takes a hundred thousand samples."""

_NOISE = 0.1
"""Up to which part of the mean squared error the probes' own noise is; with more, they get more
samples. Noise makes no bias, and what it makes unsure is in the interval; but where it is most of
what is seen, the lower end was too high in a tenth of the runs (pictures by ``counted``)."""


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """What `estimate_error` returns; it equals itself only.

    Attributes
    ----------
    rmse : float
        Root mean square error of visibility over the pixels that hit a surface, as estimated; with
        several lights over them all, each weighing the same. 0 where nothing was hit.
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
    map : ndarray, shape (H, W), float32
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


def estimate_error(
    image: Image | npt.ArrayLike,
    scene: Scene,
    camera: Camera,
    light: LightLike,
    *,
    confidence: float = 0.95,
    precision: float = 0.25,
    probes: int = 16384,
    seed: int = 0,
    progress: Progress = False,
) -> ErrorEstimate:
    """Estimate how wrong a picture's visibility is, with an interval, from a few of its pixels.

    The reference is `RayTraced`; it answers at some hundreds of pixels, with as many samples as
    make its own noise not matter. That takes a small part of the time of a reference picture. The
    interval is that of Fay and Feuer (1997, "Confidence intervals for directly standardized rates:
    a method based on the gamma distribution", Statistics in Medicine 16) over strata of pixels; see
    ``docs/how_to/estimate_error.md`` for what it means and what it does not.

    Parameters
    ----------
    image : Image or array_like, shape (H, W) or (L, H, W)
        The picture, or its visibility alone, from wherever it comes.
    scene : Scene
    camera : Camera
        What the picture was made with.
    light : light or sequence of lights
        As many as the picture has.
    confidence : float
        Probability with which the interval holds the true error, 0.5 to 0.9999.
    precision : float
        Probes are added, twice as many each time, until the interval is no wider than twice this
        part of the estimate, or of 0.001 where that is more; above 0.
    probes : int
        About how many there are at most, from 1 on. The first round has 512, or a hundredth of the
        pixels where that is more.
    seed : int
        Of the choice of probes and of the reference's samples, 0 to 2**64 - 1. The same seed gives
        the same estimate.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    ErrorEstimate

    Raises
    ------
    ValueError
        If the picture's shape is not that of the camera and the lights, a visibility is not finite
        or not between 0 and 1, a parameter is out of its range, or the scene is empty.
    TypeError
        If an argument is of the wrong kind.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> image = ss.render(setup.scene, setup.camera, setup.light, "hard")
    >>> error = ss.estimate_error(image, setup.scene, setup.camera, setup.light)
    >>> error.low <= error.rmse <= error.high
    True
    """
    confidence = _within(confidence, "confidence", 0.5, 0.9999)
    precision = _within(precision, "precision", 1e-6, math.inf)
    probes = checks.integer(probes, "probes", 1, 2**32)
    seed = checks.integer(seed, "seed", 0, 2**64 - 1)
    if not isinstance(camera, Camera):
        raise TypeError(f"camera: expected softshadow.Camera, got {type(camera).__name__}")
    lights, single = as_lights(light)
    visibility = _visibility(image, camera, None if single else len(lights))
    bar = Bar(progress, "estimate_error")
    with bar:
        judge = Judge(scene, camera, light, seed, bar)
        if isinstance(image, Image) and not np.array_equal(image.mask, judge.look.mask):
            raise ValueError("image: it hits other pixels than this camera sees in this scene")

        def enough(mean: float, low: float, high: float) -> bool:
            return high - low <= 2 * precision * max(mean, _SMALL)

        return judge.estimate(visibility, confidence, enough, probes)


def _within(value: float, what: str, low: float, high: float) -> float:
    allowed = f"a number from {low:g} to {high:g}" if math.isfinite(high) else "a positive number"
    result = checks.number(value, what, allowed)
    if not low <= result <= high:
        raise ValueError(f"{what}: expected {allowed}, got {checks.shown(value)}")
    return result


def _visibility(image: Image | npt.ArrayLike, camera: Camera, lights: int | None) -> _Doubles:
    """Return a picture's visibility as (L, H, W)."""
    values = checks.numbers(image.visibility if isinstance(image, Image) else image, "image")
    shape = (
        (camera.height, camera.width) if lights is None else (lights, camera.height, camera.width)
    )
    if values.shape != shape:
        raise ValueError(
            f"image: expected visibility of shape {shape}, as the camera and the lights have, got "
            f"{values.shape}"
        )
    return values.reshape(-1, camera.height, camera.width)


class Judge:
    """The reference for one view, with the rough look; judges any number of pictures of it.

    Attributes
    ----------
    look : Image
    lights : list of lights
    single : bool
        Whether one light was given by itself.
    ends : tuple of float
        Which part of the bar the probes are that come next.
    seconds : dict
        As of `ErrorEstimate`, of all pictures so far.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        light: LightLike,
        seed: int,
        bar: Bar,
        ends: tuple[float, float] = (0.0, 0.3),
    ) -> None:
        start = time.perf_counter()
        # Seeds far from those that methods have by default: their samples are not these.
        self._seeds = np.random.SeedSequence([seed, 0x9E3779B9])
        self._scene, self._light, self._bar = scene, light, bar
        self.lights, self.single = as_lights(light)
        method = RayTraced(samples=_LOOK_SAMPLES, seed=self._seed())
        middle = 0.7 * ends[0] + 0.3 * ends[1]
        prepared = prepare(scene, self.lights, method, bar.part(ends[0], middle, "estimate: look"))
        self.look: Image = prepared.render(camera, bar.part(middle, ends[1], "estimate: look"))
        mask = self.look.mask
        self._points, self._normals = self.look.position[mask], self.look.normal[mask]
        receives = np.array([entry.receives for entry in scene.entries])
        self._shaded = receives[self.look.mesh_id[mask]]
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
    ) -> ErrorEstimate:
        """Ask at more and more pixels until an error and its interval are known well enough.

        Parameters
        ----------
        visibility : ndarray, shape (L, H, W), float64
        confidence : float
        enough : callable
            Is told the error and the ends of its interval.
        probes : int
            Most of them.
        """
        start = time.perf_counter()
        mask = self.look.mask
        seen = visibility[:, mask]
        if not np.isfinite(seen).all() or (seen.size and (seen.min() < 0 or seen.max() > 1)):
            raise ValueError("image: expected visibility from 0 to 1 wherever a surface is hit")
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
            ends = (math.sqrt(max(x, 0.0)) for x in found.interval(None, confidence))
            if found.noisy and found.samples < _SAMPLES[1]:
                found.ask_again()
            elif total < min(probes, pixels) and not enough(*ends):
                total *= 2
                found.ask(total)
            else:
                break
        self.seconds["probes"] += time.perf_counter() - start
        return found.estimate(confidence, self)

    def _suspicion(self, visibility: _Doubles) -> _Doubles:
        """Return how far each pixel, or those around it, are off the look."""
        mask = self.look.mask
        squares = np.square(visibility - self.look.visibility).mean(axis=0)
        around = neighbourhood(squares, mask)
        result: _Doubles = np.sqrt(np.maximum(squares, around))[mask]
        return result

    def answers(self, places: _Places, samples: int) -> _Doubles:
        """Return two independent answers of the reference, shape (2, L, N)."""
        points, normals = self._points[places], self._normals[places]
        shaded = self._shaded[places]
        first, last = self.ends
        middle, end = 0.75 * first + 0.25 * last, 0.5 * (first + last)
        self.ends = end, last  # there may be more
        both = np.empty((2, len(self.lights), len(places)))
        for half, part in enumerate(((first, middle), (middle, end))):
            method = RayTraced(samples=samples, seed=self._seed())
            prepared = prepare(self._scene, self.lights, method)
            tell = self._bar.part(*part, "estimate: probes")
            both[half][:, shaded] = prepared.visibility(points[shaded], normals[shaded], tell)
        for row, light in enumerate(self.lights):
            plain = light_fraction_above(light, points[~shaded], normals[~shaded])
            both[:, row, ~shaded] = plain
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
        return bool(own > _NOISE * max(mean, _SMALL**2 * self.strata.sizes.sum()))

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
        means = np.array([(x if light is None else x[light]).mean() for x in self._squares])
        errors = np.zeros(judge.look.mask.shape, np.float32)
        errors[judge.look.mask] = np.sqrt(np.maximum(means, 0.0))[self.strata.of]
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
