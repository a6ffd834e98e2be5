"""What callers pass in, as what is stored: one function a kind that changes no value silently.

Every message says what the value is for, what is allowed and what it was. A value of the wrong kind
(text, a flag or a complex number where a number is wanted, a fraction where a whole number is) is a
``TypeError``; one of the right kind that is not allowed is a ``ParameterError`` (a ``ValueError``).
"""

from __future__ import annotations

import math
import operator
from numbers import Real
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from softshadow._core import ParameterError

__all__ = [
    "LEAST_SINGLE",
    "MOST_SINGLE",
    "flag",
    "frozen",
    "indices",
    "integer",
    "name_of",
    "number",
    "numbers",
    "points",
    "refuse_masked",
    "shown",
    "single",
    "size",
]

MOST_SINGLE = float(np.finfo(np.float32).max)
"""The largest number that kernels can keep where they store single precision."""

LEAST_SINGLE = float(np.finfo(np.float32).tiny)
"""The smallest one above 0 that they keep with all its digits."""


def shown(value: object) -> str:
    """Return a value for a message, cut to a line."""
    try:
        text = repr(value)
    except Exception:  # a user's class may raise whatever it likes, also here
        text = f"a {type(value).__name__}"
    text = " ".join(text.split())
    return text if len(text) <= 80 else f"{text[:70]}... ({type(value).__name__})"


def flag(value: object, what: str) -> bool:
    """Return a truth value; numbers and text are none."""
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    raise TypeError(f"{what}: expected True or False, got {shown(value)}")


def name_of(value: object, what: str) -> str:
    """Return text."""
    if isinstance(value, str):
        return str(value)
    raise TypeError(f"{what}: expected text, got {shown(value)}")


def integer(value: Any, what: str, low: int, high: int, otherwise: str = "") -> int:
    """Return a whole number from `low` to `high`; fractions, flags and text are none."""
    allowed = f"an integer from {low} to {high}{otherwise}"
    flag_given = isinstance(value, (bool, np.bool_))
    try:
        result = None if flag_given or _is_masked(value) else operator.index(value)
    except TypeError:
        result = None
    if result is None:
        raise TypeError(f"{what}: expected {allowed}, got {shown(value)}")
    if not low <= result <= high:
        raise ParameterError(f"{what}: expected {allowed}, got {shown(result)}")
    return result


def size(value: Any, what: str, most: int) -> tuple[int, int]:
    """Return a width and a height, given as one whole number or two."""
    if isinstance(value, (int, np.integer)):
        value = (value, value)
    if not isinstance(value, (tuple, list, np.ndarray)) or len(value) != 2:
        raise TypeError(
            f"{what}: expected 1 to {most} texels a side, an integer or two, got {shown(value)}"
        )
    width, height = (integer(x, f"{what}: texels a side", 1, most) for x in value)
    return width, height


def number(value: Any, what: str, allowed: str = "a finite number", finite: bool = True) -> float:
    """Return a real number as a float; flags and text are none.

    Parameters
    ----------
    value : number, or array without axes
    what : str
        What it is for.
    allowed : str
        For the message.
    finite : bool
        Whether NaN and infinity are errors here; otherwise they are for the caller.
    """
    if isinstance(value, np.ndarray) and value.shape == () and not _is_masked(value):
        value = value[()]
    if not isinstance(value, Real) or isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{what}: expected {allowed}, got {shown(value)}")
    try:
        result = float(value)
    except OverflowError:
        raise ParameterError(f"{what}: expected {allowed}, got {shown(value)}") from None
    if finite and not math.isfinite(result):
        raise ParameterError(f"{what}: expected {allowed}, got {shown(value)}")
    return result


def _is_masked(value: object) -> bool:
    """Whether an array hides values; plain arrays need no look into `numpy.ma`, a slow import."""
    plain = type(value) is np.ndarray or not isinstance(value, np.ndarray)
    return not plain and bool(np.ma.is_masked(value))


def _holds_masked(value: object) -> bool:
    """Whether hidden data of a masked array would be taken for numbers."""
    if isinstance(value, (list, tuple)):
        return any(map(_holds_masked, value))
    return _is_masked(value)


def numbers(value: npt.ArrayLike, what: str, allowed: str = "real numbers") -> npt.NDArray[Any]:
    """Return a contiguous copy as float64, of any shape; its values may be NaN or infinite.

    Refuses what would lose something on the way: hidden values of masked arrays, imaginary parts,
    text, flags, dates, rows of different lengths.
    """
    array = _array(value, what, allowed)
    if array.dtype.kind not in "iuf" and array.size:
        got = shown(value) if array.dtype.kind in "USO" else f"dtype {array.dtype}"
        raise TypeError(f"{what}: expected {allowed}, got {got}")
    with np.errstate(over="ignore"):  # an infinity from a wider float is found as such
        return np.array(array, dtype=np.float64, order="C")


def indices(
    value: npt.ArrayLike, what: str, allowed: str = "integers below 2**63"
) -> npt.NDArray[np.int64]:
    """Return a contiguous copy as int64, of any shape; fractions and flags are no integers."""
    array = _array(value, what, "integers")
    dtype = array.dtype
    if dtype.kind == "f" and isinstance(value, (list, tuple)):
        array = np.asarray(value, dtype=object)  # large whole numbers may have become fractions
    # NumPy keeps whole numbers that are too large for it as Python's own.
    whole = array.dtype.kind in "iu" or (
        array.dtype.kind == "O" and all(type(x) is int for x in array.flat)
    )
    if not whole and array.size:
        got = shown(value) if dtype.kind in "USO" else f"dtype {dtype}"
        raise TypeError(f"{what}: expected integers, got {got}")
    if array.dtype.kind in "uO" and array.size:
        lost = np.argwhere((array > np.iinfo(np.int64).max) | (array < np.iinfo(np.int64).min))
        if len(lost):
            at = tuple(int(i) for i in lost[0])
            raise ParameterError(f"{what}: row {at[0]} holds {array[at]}, allowed are {allowed}")
    return np.array(array, dtype=np.int64, order="C")


def refuse_masked(value: object, what: str, allowed: str = "an array of numbers") -> None:
    """Raise where hidden values of a masked array would be taken for numbers."""
    if _holds_masked(value):
        raise TypeError(
            f"{what}: expected {allowed}, got a masked array with hidden values; fill them or "
            "leave them out"
        )


def _array(value: npt.ArrayLike, what: str, allowed: str) -> npt.NDArray[Any]:
    refuse_masked(value, what, allowed)
    try:
        return np.asarray(value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{what}: expected {allowed} ({error})") from None


def points(value: npt.ArrayLike, what: str) -> npt.NDArray[np.float64]:
    """Return rows of three numbers, which may be NaN or infinite."""
    result = numbers(value, what)
    if result.ndim != 2 or result.shape[1] != 3:
        raise ParameterError(f"{what}: expected shape (N, 3), got {result.shape}")
    return result


def single(value: npt.ArrayLike, what: str, allowed: str) -> npt.NDArray[np.float64]:
    """Return non-negative numbers that single precision can hold, as float64.

    What is larger would become infinite, and what is smaller than any normal number but 0 would
    lose its digits or become 0.
    """
    array = numbers(value, what, allowed)
    if not np.all(np.isfinite(array)) or np.any(array < 0):
        raise ParameterError(f"{what}: expected finite values >= 0, got {array.tolist()}")
    with np.errstate(over="ignore"):  # what rounds to infinity is found as such
        rounded = array.astype(np.float32)
    lost = ~np.isfinite(rounded) | ((array > 0) & (array < LEAST_SINGLE))
    if np.any(lost):
        raise ParameterError(
            f"{what}: expected values that single precision holds, 0 or {LEAST_SINGLE:.3g} to "
            f"{MOST_SINGLE:.3g}, got {array.tolist()}"
        )
    return array


_T = TypeVar("_T", bound=np.generic)


def frozen(array: npt.NDArray[_T]) -> npt.NDArray[_T]:
    """Return a copy that nobody can make writable again: its memory is that of ``bytes``."""
    result: npt.NDArray[_T] = np.ndarray(array.shape, array.dtype, buffer=array.tobytes())
    return result
