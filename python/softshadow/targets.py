"""What visibility is wanted for: the pixels of a camera, or points of a user's own.

Both have receivers, a mask or a list of them, and can name a small part of themselves that is
typical of the whole, on which methods are timed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from softshadow.arguments import Progress
from softshadow.camera import Camera
from softshadow.render import Image, Prepared

__all__ = ["Answer", "Picture", "Points", "Receivers", "Target"]

_Doubles: TypeAlias = npt.NDArray[np.float64]

_BLOCKS = 4
"""A side: a picture is timed on one of its sixteen blocks, points on a sixteenth of them."""

_SMALLEST = 64
"""Pixels a side of a block, at least: what a frame takes whatever its size, some milliseconds,
would be counted as often as there are blocks."""

_SHORTEST = 256
"""Points of a run, at least, for the same reason."""

_RUNS = 8
"""Of consecutive points that a part of many has: neighbours in a list often are so in space."""

Answer: TypeAlias = "Image | npt.NDArray[np.float32]"


@dataclass(frozen=True, eq=False)
class Receivers:
    """Where visibility is wanted.

    Attributes
    ----------
    mask : ndarray, shape (H, W) or (N,), bool
        Which pixels hit a surface; all points.
    points : ndarray, shape (M, 3), float64
        World positions of those of the mask.
    normals : ndarray, shape (M, 3), or None
    shaded : ndarray, shape (M,), bool
        Whether what is hit receives shadows.
    """

    mask: npt.NDArray[np.bool_]
    points: _Doubles
    normals: npt.NDArray[np.float64] | npt.NDArray[np.float32] | None
    shaded: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Picture:
    """The pixels of a camera."""

    camera: Camera

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one light's visibility."""
        return self.camera.height, self.camera.width

    def answer(self, prepared: Prepared, tell: Progress) -> Image:
        """Return a method's image."""
        return prepared.render(self.camera, tell)

    def visibility(self, answer: Answer) -> _Doubles:
        """Return an answer's visibility, shape (L, H, W)."""
        assert isinstance(answer, Image)
        return _by_light(answer.visibility, 2)

    def receivers(self, answer: Answer, receives: npt.NDArray[np.bool_]) -> Receivers:
        """Return the receivers, by any image and by which of the scene's entries receive."""
        assert isinstance(answer, Image)
        mask = answer.mask
        shaded = receives[answer.mesh_id[mask]]
        return Receivers(mask, answer.position[mask], answer.normal[mask], shaded)

    def part(self, look: _Doubles, mask: npt.NDArray[np.bool_]) -> tuple[Picture, float]:
        """Return the block that is most like the whole, and which part of the receivers it has.

        Alike in how much of it is neither lit nor in an umbra, as a rough look (L, H, W) tells.
        """
        height, width = self.shape
        if min(height, width) < 2 * _SMALLEST or not mask.any():
            return self, 1.0
        h, w = (max(n // _BLOCKS, _SMALLEST) for n in (height, width))
        partly = np.where(mask, (look * (1.0 - look)).mean(axis=0), 0.0)
        mean, share = partly.mean(), mask.mean()
        places = [(y, x) for y in range(0, height - h + 1, h) for x in range(0, width - w + 1, w)]

        def unlike(place: tuple[int, int]) -> float:
            block = np.s_[place[0] : place[0] + h, place[1] : place[1] + w]
            of_mean = abs(partly[block].mean() - mean) / max(mean, 1e-6)
            return float(of_mean + abs(mask[block].mean() - share) / share)

        y, x = min(places, key=unlike)
        block_mask = mask[y : y + h, x : x + w]
        if not block_mask.any():
            return self, 1.0
        moved = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, 1.0]])
        camera = Camera.from_matrix(moved @ self.camera.K, self.camera.camera_to_world, w, h)
        return Picture(camera), float(block_mask.sum() / mask.sum())


@dataclass(frozen=True, eq=False)
class Points:
    """A user's own points, with normals or without."""

    points: _Doubles
    normals: _Doubles | None

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one light's visibility."""
        return (len(self.points),)

    def answer(self, prepared: Prepared, tell: Progress) -> npt.NDArray[np.float32]:
        """Return a method's visibility."""
        return prepared.visibility(self.points, self.normals, tell)

    def visibility(self, answer: Answer) -> _Doubles:
        """Return an answer's visibility, shape (L, N)."""
        assert not isinstance(answer, Image)
        return _by_light(answer, 1)

    def receivers(self, answer: Answer, receives: npt.NDArray[np.bool_]) -> Receivers:
        """Return the points; all of them receive."""
        every = np.ones(self.shape, dtype=np.bool_)
        return Receivers(every, self.points, self.normals, every)

    def part(self, look: _Doubles, mask: npt.NDArray[np.bool_]) -> tuple[Points, float]:
        """Return a sixteenth of the points, in some runs, and which part of them that is."""
        count = len(self.points)
        run = count // (_BLOCKS**2 * _RUNS)
        if run < _SHORTEST:
            return self, 1.0
        starts = np.arange(_RUNS) * (count // _RUNS)
        chosen = (starts[:, None] + np.arange(run)).ravel()
        normals = None if self.normals is None else self.normals[chosen]
        return Points(self.points[chosen], normals), len(chosen) / count


Target: TypeAlias = "Picture | Points"


def _by_light(seen: npt.NDArray[np.float32], axes: int) -> _Doubles:
    """Return visibility with an axis for the lights, also that of one given by itself."""
    return (seen[None] if seen.ndim == axes else seen).astype(np.float64)
