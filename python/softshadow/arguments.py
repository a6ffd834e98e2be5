"""What several functions take as arguments, and how it is turned into what is stored.

Every conversion copies, and its errors begin with what the value is for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from softshadow import checks

if TYPE_CHECKING:
    from types import TracebackType

__all__ = [
    "RGB",
    "Bar",
    "Progress",
    "Triple",
    "Vector",
    "as_faces",
    "as_mesh",
    "as_points",
    "as_rgb",
    "as_vector",
]

RGB: TypeAlias = "float | tuple[float, float, float] | npt.ArrayLike"
"""A colour: one number for grey, or three linear RGB values."""

Vector: TypeAlias = "tuple[float, float, float] | npt.ArrayLike"
"""A point or direction: three finite numbers."""

Triple: TypeAlias = "tuple[float, float, float]"
"""A point, a direction or a colour as it is stored."""

Progress: TypeAlias = "bool | Callable[[float], None]"
"""``True`` for a progress bar, or a function that is told the finished fraction (0 to 1)."""

as_points = checks.points


def as_rgb(value: RGB, what: str) -> Triple:
    """Return `value` as three non-negative floats that single precision holds.

    Raises
    ------
    ValueError, TypeError
        Otherwise; the message begins with `what`.
    """
    array = checks.single(value, what, "a number or 3 linear RGB values")
    if array.shape not in ((), (3,)):
        raise ValueError(f"{what}: expected a number or 3 RGB values, got shape {array.shape}")
    r, g, b = (float(x) for x in np.broadcast_to(array, (3,)))
    return r, g, b


def as_vector(value: Vector, what: str) -> Triple:
    """Return `value` as three finite floats.

    Raises
    ------
    ValueError, TypeError
        Otherwise; the message begins with `what`.
    """
    array = checks.numbers(value, what, "3 numbers")
    if array.shape != (3,):
        raise ValueError(f"{what}: expected 3 numbers, got shape {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{what}: expected finite numbers, got {array.tolist()}")
    x, y, z = (float(x) for x in array)
    return x, y, z


def as_faces(faces: npt.ArrayLike, what: str, vertices: int) -> npt.NDArray[np.int64]:
    """Return a private, contiguous copy of faces; the core checks what they refer to."""
    last = max(vertices - 1, 0)
    f = checks.indices(faces, what, f"vertices 0 to {last} ({vertices} vertices)")
    if f.size == 0:
        f = f.reshape(0, 3)
    if f.ndim != 2 or f.shape[1] != 3:
        raise ValueError(f"{what}: expected shape (F, 3), got {f.shape}")
    return f


def as_mesh(
    vertices: npt.ArrayLike, faces: npt.ArrayLike
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Return private, contiguous copies of a mesh's vertices and faces."""
    v = as_points(vertices, "vertices")
    return v, as_faces(faces, "faces", len(v))


class Bar:
    """A progress argument as the callback that the kernels take; one for every call of a user's.

    Within a ``with`` block the callback is told 0, what the kernels say, and 1 at the end, never
    less than before. A bar is closed and gone when the block ends, however it ends.

    Parameters
    ----------
    progress : bool or callable, or None
        ``True`` for a progress bar, or a function that is told the finished fraction.
    what : str
        What is being done, beside the bar.

    Raises
    ------
    TypeError
        If `progress` is anything else.
    """

    def __init__(self, progress: Progress | None, what: str) -> None:
        self._call: Callable[[float], object] | None = None
        self._bar: Any = None
        self._shown = False
        if callable(progress):
            self._call = progress
        elif isinstance(progress, (bool, np.bool_)):
            self._shown = bool(progress)
        elif progress is not None:
            got = checks.shown(progress)
            raise TypeError(f"progress: expected True, False or a function, got {got}")
        self._what = what
        self._told = 0.0

    def __enter__(self) -> Callable[[float], None] | None:
        if self._shown:
            from tqdm.auto import tqdm

            layout = "{l_bar}{bar}| {elapsed}"
            self._bar = tqdm(total=1.0, desc=self._what, bar_format=layout, leave=False)
        elif self._call is None:
            return None
        self._report(0.0)
        return self._report

    def part(self, start: float, end: float, what: str) -> Progress:
        """Return the progress argument of a call that does a part of the work.

        Parameters
        ----------
        start, end : float
            Which part, as fractions of the whole.
        what : str
            What is being done, beside the bar.
        """
        if self._bar is not None:
            self._bar.set_description(what)
        elif self._call is None:
            return False
        # Of a fraction of 1, rounding might make a little less or more than the end.
        return lambda x: self._report(end if x >= 1 else start + (end - start) * x)

    def _report(self, fraction: float) -> None:
        self._told = float(min(max(self._told, fraction), 1.0))
        if self._bar is not None:
            self._bar.update(self._told - self._bar.n)
        elif self._call is not None:
            self._call(self._told)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if kind is None and self._told < 1.0:
                self._report(1.0)
        finally:
            if self._bar is not None:
                self._bar.close()
