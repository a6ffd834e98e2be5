"""A hard case: a scene, what is hard about it, the answer, and how far each method may be off."""

from __future__ import annotations

import csv
import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import resources

import numpy as np
import numpy.typing as npt

from softshadow.kernels import light_fraction_above
from softshadow.methods import RayTraced
from softshadow.render import Image, render
from softshadow.scenes.staging import Setup

__all__ = ["MARGIN", "REFERENCE", "RIGHT", "ROUNDING", "SIZE", "Answer", "Excuse", "HardCase"]

SIZE = (64, 48)
"""Width and height, pixels, for which ``measured.csv`` holds."""

REFERENCE = RayTraced(samples=2048, seed=19)
"""Its own error is about 1 % of a shadow where all is penumbra, and less elsewhere."""

RIGHT = 0.1
"""An error up to which a method is right: a tenth of the shadow."""

MARGIN = 1.25
"""Bounds are that many times what was measured, in both directions.

The same inputs give the same bits on every machine, so that nothing but a change of the package
moves an error. With other seeds errors change by up to 1.26, so that less is no change of a
method's quality; but by 2.24 of `accumulation`, whose receivers share 64 light points, and 1.42 of
`mvsm`, by single pixels (``python benches/hard.py --seeds 3``).
"""

ROUNDING = 1e-6
"""What sums in single precision may be off where a method is exact."""


@dataclass(frozen=True)
class Excuse:
    """Why a method need not be right in a hard case.

    Attributes
    ----------
    reason : str
        A sentence.
    raises : type of Exception, optional
        It refuses the scene by this error; when not given, it is wrong, by more than ``RIGHT``.
    """

    reason: str
    raises: type[Exception] | None = None


@dataclass(frozen=True, eq=False)
class Answer:
    """What a hard case's picture should be.

    Attributes
    ----------
    setup : Setup
        Scene, camera and lights.
    image : Image
        What the camera sees; `visibility` is right where `where` is true.
    where : ndarray, shape (L, H, W), bool
        Pixels that count, for each light: all that show something, and of a closed form those for
        which it holds.
    unshadowed : ndarray, shape (L, H, W), float64
        Visibility if nothing cast a shadow: the part of each light above the tangent plane.
    """

    setup: Setup
    image: Image
    where: npt.NDArray[np.bool_]
    unshadowed: npt.NDArray[np.float64]

    def error(self, image: Image) -> float:
        """Return how much of the shadow is wrong.

        The root of the mean squared error of visibility over that of a picture without shadows:
        0 is exact, and 1 is as wrong as if nothing cast.

        Parameters
        ----------
        image : Image
            Of `setup`, all its lights.

        Returns
        -------
        float
        """
        right = self.image.visibility.astype(np.float64)
        off = (image.visibility - right)[self.where]
        shadow = (self.unshadowed - right)[self.where]
        return math.sqrt(float(off @ off) / float(shadow @ shadow))


@dataclass(frozen=True, eq=False)
class HardCase:
    """A scene in which methods go wrong.

    Attributes
    ----------
    name : str
        Its name in `softshadow.scenes.hard`.
    why : str
        What is hard about it: a sentence.
    make : callable
        Returns the `Setup`: scene, camera and lights, for a width and a height in pixels.
    closed_form : callable, optional
        The exact visibility, shape (L, H, W), of an image of the setup; NaN where it is not known.
        When not given, the answer is that of ``ray_traced``.
    excuses : mapping of str to Excuse
        The methods that are wrong here, by name, and why.
    """

    name: str
    why: str
    make: Callable[[int, int], Setup]
    closed_form: Callable[[Image], npt.NDArray[np.float64]] | None = None
    excuses: Mapping[str, Excuse] = field(default_factory=dict)

    @property
    def measured(self) -> dict[str, float]:
        """The errors of all methods that answer, by name, at the size ``SIZE``."""
        return _measured().get(self.name, {})

    def tolerance(self, method: str) -> float:
        """Return the largest error that a method may have, at the size ``SIZE``.

        Parameters
        ----------
        method : str
            Its name.

        Returns
        -------
        float
            In the measure of `Answer.error`; NaN where nothing was measured.
        """
        error = self.measured.get(method)
        return math.nan if error is None else max(MARGIN * error, ROUNDING)

    def answer(self, width: int = SIZE[0], height: int = SIZE[1]) -> Answer:
        """Return what the picture should be.

        Parameters
        ----------
        width, height : int
            Pixels.

        Returns
        -------
        Answer
        """
        setup = self.make(width, height)
        image = render(setup.scene, setup.camera, setup.lights, REFERENCE)
        entries = setup.scene.entries
        receives = np.array([e.receives for e in entries] + [False])[image.mesh_id]
        where = np.broadcast_to(receives, image.visibility.shape)
        above = np.ones(image.visibility.shape)
        p, n = image.position[receives], image.normal[receives].astype(np.float64)
        for k, light in enumerate(setup.lights):
            above[k][receives] = light_fraction_above(light, p, n)
        if self.closed_form is None:
            return Answer(setup, image, where, above)
        exact = self.closed_form(image)
        where = where & np.isfinite(exact)
        right = np.where(where, exact, above).astype(np.float32)
        return Answer(setup, replace(image, visibility=right), where, above)


@functools.cache
def _measured() -> dict[str, dict[str, float]]:
    """Return the errors of ``measured.csv``, by scene and method."""
    text = (resources.files(__package__) / "measured.csv").read_text(encoding="utf-8")
    found: dict[str, dict[str, float]] = {}
    for row in csv.DictReader(text.splitlines()):
        scene = row.pop("scene")
        found[scene] = {method: float(value) for method, value in row.items() if value}
    return found
