"""Means over a picture from a few of its pixels: which to ask, and how sure what they say is.

Pixels are divided into strata by how suspicious each is, some of each stratum are drawn at random
(Cochran 1977, "Sampling Techniques", chapter 5), and a mean that is zero nearly everywhere gets the
interval that Fay and Feuer have for weighted sums of counts (1997, "Confidence intervals for
directly standardized rates: a method based on the gamma distribution"): a gamma distribution with
the estimate's mean and variance for the lower end, and for the upper end the same after one more
observation as large as a further one might be. With nothing found, that is the rule of three.

Assumes that what is asked is zero or more, up to noise. What was tried instead is in
``docs/development/estimate.md``.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

__all__ = ["Strata", "gamma_quantile", "interval", "neighbourhood"]

_Doubles = npt.NDArray[np.float64]
_Places = npt.NDArray[np.int64]

_LEAST = 16
"""Pixels of a stratum that are asked at least: fewer tell nothing of its spread."""

_CALM_SHARE = 1 / 3
"""Of all that are asked: how many at least lie in the stratum without any suspicion. They find what
nobody suspected; it has most pixels of most pictures, and would get none by its spread."""

_OCTAVES = 12
"""Strata of a factor of two in suspicion below 1; the last has all that is below 1 / 4096."""

_SIDE = 5
"""Pixels a side of a neighbourhood."""


def neighbourhood(values: _Doubles, mask: npt.NDArray[np.bool_]) -> _Doubles:
    """Return the mean over the pixels of the mask within 5 by 5 around each.

    Parameters
    ----------
    values : ndarray, shape (H, W), float64
    mask : ndarray, shape (H, W), bool

    Returns
    -------
    ndarray, shape (H, W), float64
        0 outside of the mask.
    """
    sums, counts = (_sums(np.where(mask, x, 0.0)) for x in (values, np.ones(mask.shape)))
    result: _Doubles = np.where(mask, sums / np.maximum(counts, 1.0), 0.0)
    return result


def _sums(values: _Doubles) -> _Doubles:
    """Return sums over 5 by 5 pixels; no differences of sums, which would leave rounding at 0."""
    for axis, length in enumerate(values.shape):
        padded = np.pad(values, [(_SIDE // 2,) * 2 if i == axis else (0, 0) for i in (0, 1)])
        values = sum(
            (padded.take(range(k, k + length), axis) for k in range(_SIDE)),
            np.zeros_like(values),
        )
    return values


class Strata:
    """A picture's pixels, by how suspicious they are, and the order in which they are asked.

    Parameters
    ----------
    suspicion : ndarray, shape (N,), float64
        How large an error each pixel is suspected of, 0 to 1.
    rng : numpy.random.Generator

    Attributes
    ----------
    of : ndarray, shape (N,), int64
        Each pixel's stratum; 0 is the one without suspicion, if there is any such pixel.
    sizes : ndarray, shape (S,), int64
    calm : bool
        Whether stratum 0 is that of pixels without suspicion.
    """

    def __init__(self, suspicion: _Doubles, rng: np.random.Generator) -> None:
        octave = np.full(len(suspicion), -_OCTAVES - 1)
        some = suspicion > 0
        octave[some] = np.clip(np.floor(np.log2(suspicion[some])), -_OCTAVES, 0)
        _, of = np.unique(octave, return_inverse=True)
        self.of: _Places = of.astype(np.int64)
        self.sizes: _Places = np.bincount(self.of).astype(np.int64)
        self._orders = [rng.permutation(np.flatnonzero(self.of == s)) for s in self._all]
        self.calm = not some.all()
        spread = np.array([np.square(suspicion[order]).mean() for order in self._orders])
        self._shares = self.sizes * spread

    @property
    def _all(self) -> range:
        return range(len(self.sizes))

    def counts(self, total: int) -> _Places:
        """Return how many pixels of each stratum are asked, of about so many in all.

        By size and spread (Neyman's allocation), the spread being what the suspicion makes of it;
        what small strata leave goes to the one without suspicion. More in all are never fewer in a
        stratum.
        """
        if total >= self.sizes.sum():
            return self.sizes
        shares = self._shares / (self._shares.sum() or 1.0)
        counts = np.minimum(np.maximum(np.ceil(total * shares), _LEAST), self.sizes)
        if self.calm:
            least = max(math.ceil(total * _CALM_SHARE), total - int(counts[1:].sum()))
            counts[0] = min(max(counts[0], least), self.sizes[0])
        result: _Places = counts.astype(np.int64)
        return result

    def drawn(self, counts: _Places) -> list[_Places]:
        """Return the pixels of each stratum that are asked; the first of more are the same."""
        return [order[:count] for order, count in zip(self._orders, counts, strict=True)]


def interval(
    sizes: npt.ArrayLike,
    values: list[_Doubles],
    noise: list[_Doubles],
    confidence: float,
) -> tuple[float, float, float]:
    """Return the mean over all pixels, and its confidence interval.

    Parameters
    ----------
    sizes : array_like, shape (S,)
        How many pixels each stratum has.
    values : list of ndarray
        Of each stratum: what those that were asked said, unbiased, one at least.
    noise : list of ndarray
        The variance of each value when the same pixel is asked again.
    confidence : float
        Between 0 and 1.

    Returns
    -------
    mean, low, high : float
        The mean may be a little below 0, where noise is all there is; the ends never are.
    """
    all_ = np.asarray(sizes, dtype=np.float64)
    asked = np.array([len(x) for x in values], dtype=np.float64)
    weights = all_ / all_.sum()
    left = 1.0 - asked / all_  # the share that was not asked
    means = np.array([x.mean() for x in values])
    spread = np.array([x.var(ddof=1) if len(x) > 1 else 0.0 for x in values])
    again = np.array([x.mean() for x in noise])
    variance = float((weights**2 / asked * (left * spread + (1.0 - left) * again)).sum())
    mean = float((weights * means).sum())
    # What one more might say: the most that was found here, or where there is more suspicion.
    most = np.array([max(float(x.max()), 0.0) for x in values])
    most = np.maximum(most, np.append(most[1:], 0.0))
    further = float((weights / asked * left * most).max())
    tail = (1.0 - confidence) / 2.0
    low = gamma_quantile(tail, max(mean, 0.0), variance)
    high = gamma_quantile(1.0 - tail, max(mean, 0.0) + further, variance + further**2)
    # Noise has no such skew: both ends are no nearer than those of a normal distribution.
    plain = _normal_quantile(1.0 - tail) * math.sqrt(variance)
    return mean, max(min(low, mean - plain), 0.0), max(high, mean + plain, 0.0)


def gamma_quantile(part: float, mean: float, variance: float) -> float:
    """Return the value below which a gamma distribution has a part of its weight.

    Parameters
    ----------
    part : float
        Between 0 and 1.
    mean, variance : float
        Not negative.

    Returns
    -------
    float
        To nine digits up to shapes of 500; beyond, by Wilson and Hilferty's cube, to five.
    """
    if mean <= 0.0 or variance <= 0.0:
        return mean
    shape, scale = mean * mean / variance, variance / mean
    if shape < 1e-12:
        return 0.0
    third = 1.0 / (9.0 * shape)
    if shape > 500.0:
        cube = 1.0 - third + _normal_quantile(part) * math.sqrt(third)
        return float(mean * cube**3)
    low, high = 0.0, shape + 1.0
    while _gamma_below(shape, high) < part:
        high *= 2.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        if middle in (low, high) or high - low < 1e-10 * high:
            break
        if _gamma_below(shape, middle) < part:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high) * scale


def _gamma_below(shape: float, x: float) -> float:
    """Return the regularised lower incomplete gamma function, by its series of positive terms."""
    if x <= 0.0:
        return 0.0
    term = math.exp(shape * math.log(x) - x - math.lgamma(shape + 1.0))
    total, k = term, shape
    # Terms grow until k passes x and then fall faster and faster: some thousands at most.
    while term > 1e-16 * total:
        k += 1.0
        term *= x / k
        total += term
        if term == 0.0:
            break
    return min(total, 1.0)


def _normal_quantile(part: float) -> float:
    from statistics import NormalDist  # takes as long to import as a tenth of the package

    return NormalDist().inv_cdf(part)
