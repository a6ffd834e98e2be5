"""What a sweep measures against: one picture for each scene, light and camera, as good as needed.

A reference is the mean of two pictures with the same number of samples and seeds of their own. With
independent errors of the same variance in both, the mean is as far from the truth, as a root of the
mean square, as half of what the two differ by. The samples grow until that is a tenth of the
smallest error that the reference judges: the error of a case is then off by half a percent.
"""

from __future__ import annotations

import json
import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from softshadow import metrics
from softshadow.compare import DEFAULT_REFERENCE, label_of
from softshadow.methods import RayTraced
from softshadow.renderers import Measurable
from softshadow.sweep.store import Store
from softshadow.sweep.work import Outcome

__all__ = ["REFERENCE", "SHARE", "Reference"]

REFERENCE = RayTraced(samples=16384, seed=DEFAULT_REFERENCE.seed)
"""When none is given. Its samples are the most that a half has; its seed is not the methods' own,
as that of `softshadow.compare.DEFAULT_REFERENCE`."""

SHARE = 0.1
"""Of the smallest error that a reference judges: how large its own may be."""

_FIRST = 256
"""Samples of the halves to begin with."""

_GROWTH = 4
"""Half the error each time, where it falls with the root of the samples; most fall faster."""


class Reference:
    """A reference, and how it is made better.

    Parameters
    ----------
    store : Store
    key : str
        What it is known by; a reference that the store has is read.
    method : Method or Renderer
        With ``samples`` and ``seed``: two halves, with up to as many samples each. Without: one
        picture, whose own error nobody knows.
    seconds : float or None
        A better one is made only where that is likely to take less.
    """

    def __init__(
        self, store: Store, key: str, method: Measurable, seconds: float | None = None
    ) -> None:
        self._seconds = seconds
        self._store = store
        self._path = store.reference(key)
        self._method = method
        names = {f.name for f in fields(method)}
        self._halves = {"samples", "seed"} <= names
        self._most = int(getattr(method, "samples", 0)) if self._halves else 0
        self._about: dict[str, Any] | None = None
        self.flying = False
        self.error: str | None = None
        if self._path.exists():
            with np.load(self._path) as arrays:
                self._about = json.loads(str(arrays["about"]))

    @property
    def made(self) -> bool:
        """Whether there is one, however good."""
        return self._about is not None

    @property
    def cells(self) -> dict[str, Any]:
        """What a row says of it, whether it is good enough apart."""
        if self._about is None:
            return {}
        return {
            name: self._about[name] for name in ("reference", "reference_rmse", "reference_mae")
        }

    def arrays(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
        """Return the visibility and the mask."""
        with np.load(self._path) as arrays:
            return arrays["visibility"], arrays["mask"]

    def good_for(self, smallest: float) -> bool:
        """Return whether its own error is small beside the smallest that it judges."""
        if self._about is None:
            return False
        own = self._about["reference_rmse"]
        return bool(own <= SHARE * smallest)  # of NaN: no

    def exhausted(self) -> bool:
        """Return whether it cannot be made better."""
        if self._about is None:
            return False
        if self._about["samples"] >= self._most:
            return True
        # Its time grows with its samples; there are two halves.
        grown = 2 * _GROWTH * float(self._about.get("seconds", 0.0))
        return self._seconds is not None and grown > self._seconds

    def next(self) -> tuple[Measurable, ...]:
        """Return the methods whose pictures make the next, better one."""
        if not self._halves:
            return (self._method,)
        before = 0 if self._about is None else self._about["samples"]
        samples = min(self._most, before * _GROWTH or _FIRST)
        seed = int(getattr(self._method, "seed", 0))
        seeds = (seed, (seed + 1) % 2**64)
        sampled: Any = self._method  # one of those with both parameters
        return tuple(replace(sampled, samples=samples, seed=s) for s in seeds)

    def take(self, methods: tuple[Measurable, ...], outcome: Outcome) -> None:
        """Keep what the methods' pictures make."""
        if outcome.error is not None or outcome.mask is None:
            self.error = f"reference: {outcome.error}"
            return
        mask = outcome.mask
        own: dict[str, float] = dict.fromkeys(("rmse", "mae"), math.nan)
        if self._halves:
            a, b = outcome.pictures
            visibility = np.mean([a, b], axis=0, dtype=np.float64).astype(np.float32)
            if mask.any():
                own = {"rmse": metrics.rmse(a, b, mask) / 2, "mae": metrics.mae(a, b, mask) / 2}
        else:
            visibility = outcome.pictures[0]
        names = ", ".join(map(label_of, methods))
        samples = int(getattr(methods[0], "samples", 0)) if self._halves else 0
        self._about = {
            "reference": f"2 x {samples} samples: {names}" if self._halves else names,
            "reference_rmse": own["rmse"],
            "reference_mae": own["mae"],
            "samples": samples,
            "seconds": outcome.seconds["prepare"] + outcome.seconds["frame"],
        }
        about = json.dumps(self._about)
        self._store.save(self._path, visibility=visibility, mask=mask, about=about)
