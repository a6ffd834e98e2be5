"""`estimate_error`: how wrong a picture is, from a few of its pixels, with an interval."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow.arguments import Bar, Progress, as_points
from softshadow.camera import Camera
from softshadow.judging import SMALL, ErrorEstimate, Judge
from softshadow.light import LightLike, as_lights
from softshadow.render import Image, prepare
from softshadow.scene import Scene
from softshadow.targets import Picture, Points, Target

__all__ = ["ErrorEstimate", "estimate_error", "estimate_error_at"]


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
    if not isinstance(camera, Camera):
        raise TypeError(f"camera: expected softshadow.Camera, got {type(camera).__name__}")
    seen = image.visibility if isinstance(image, Image) else image
    what = (scene, light, confidence, precision, probes, seed, progress)
    mask = image.mask if isinstance(image, Image) else None
    return _estimate(seen, "image", Picture(camera), "the camera", *what, mask)


def estimate_error_at(
    visibility: npt.ArrayLike,
    scene: Scene,
    points: npt.ArrayLike,
    normals: npt.ArrayLike | None,
    light: LightLike,
    *,
    confidence: float = 0.95,
    precision: float = 0.25,
    probes: int = 16384,
    seed: int = 0,
    progress: Progress = False,
) -> ErrorEstimate:
    """Estimate how wrong visibility at points is, as `estimate_error` does for a picture.

    Parameters
    ----------
    visibility : array_like, shape (N,) or (L, N)
        What is judged, from wherever it comes.
    scene : Scene
    points : array_like, shape (N, 3)
        World positions.
    normals : array_like, shape (N, 3), or None
        As of `softshadow.visibility`.
    light : light or sequence of lights
        As many as the visibility has.
    confidence, precision, probes, seed, progress
        As of `estimate_error`.

    Returns
    -------
    ErrorEstimate
        Over all points, each weighing the same; its ``map`` has the shape (N,).

    Raises
    ------
    ValueError
        If shapes do not fit, a visibility is not between 0 and 1, a value is not finite, a
        parameter is out of its range, or the scene is empty.
    TypeError
        If an argument is of the wrong kind.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> points, normals = [(-2, 0, 0), (2, 0, 0)], [(0, 0, 1), (0, 0, 1)]
    >>> error = ss.estimate_error_at([0.5, 1], setup.scene, points, normals, setup.light)
    >>> round(error.rmse, 4), error.probes
    (0.3536, 2)
    """
    p = as_points(points, "points")
    n = None if normals is None else checks.numbers(normals, "normals")
    if n is not None and n.shape != p.shape:
        raise ValueError(f"normals: expected shape {p.shape} as the points, got {n.shape}")
    what = (scene, light, confidence, precision, probes, seed, progress)
    return _estimate(visibility, "visibility", Points(p, n), "the points", *what, None)


def _estimate(
    seen: npt.ArrayLike,
    name: str,
    target: Target,
    of: str,
    scene: Scene,
    light: LightLike,
    confidence: float,
    precision: float,
    probes: int,
    seed: int,
    progress: Progress,
    mask: npt.NDArray[np.bool_] | None,
) -> ErrorEstimate:
    """Check what both estimates are given, and judge."""
    confidence = _within(confidence, "confidence", 0.5, 0.9999)
    precision = _within(precision, "precision", 1e-6, math.inf)
    probes = checks.integer(probes, "probes", 1, 2**32)
    seed = checks.integer(seed, "seed", 0, 2**64 - 1)
    if not isinstance(scene, Scene):
        raise TypeError(f"scene: expected softshadow.Scene, got {type(scene).__name__}")
    lights, single = as_lights(light)
    values = checks.numbers(seen, name)
    shape = target.shape if single else (len(lights), *target.shape)
    if values.shape != shape:
        raise ValueError(
            f"{name}: expected visibility of shape {shape}, as {of} and the lights have, got "
            f"{values.shape}"
        )
    receives = np.array([entry.receives for entry in scene.entries], dtype=np.bool_)

    def enough(mean: float, low: float, high: float) -> bool:
        return high - low <= 2 * precision * max(mean, SMALL)

    bar = Bar(progress, "estimate_error")
    with bar:
        judge = Judge(
            target, lambda m, tell: prepare(scene, lights, m, tell), receives, single, [seed], bar
        )
        if mask is not None and not np.array_equal(mask, judge.mask):
            raise ValueError(f"{name}: it hits other pixels than this camera sees in this scene")
        visibility = values[None] if single else values
        judged = visibility[:, judge.mask]
        if not np.isfinite(judged).all() or judged.min(initial=0) < 0 or judged.max(initial=1) > 1:
            where = "wherever a surface is hit" if judge.mask.ndim == 2 else "everywhere"
            raise ValueError(f"{name}: expected visibility from 0 to 1 {where}")
        return judge.estimate(visibility, confidence, enough, probes)


def _within(value: float, what: str, low: float, high: float) -> float:
    allowed = f"a number from {low:g} to {high:g}" if math.isfinite(high) else "a positive number"
    result = checks.number(value, what, allowed)
    if not low <= result <= high:
        raise ValueError(f"{what}: expected {allowed}, got {checks.shown(value)}")
    return result
