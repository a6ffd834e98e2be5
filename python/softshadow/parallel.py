"""How many threads kernels have, in this process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from softshadow import _core, checks

__all__ = ["set_threads", "thread_count", "threads"]

_MOST = 1024


def set_threads(count: int | None) -> None:
    """Set how many threads every call has, in this process and in those forked from it later.

    Calls that are running keep theirs; calls made at the same time by several Python threads have
    as many each. Results are the same to the bit whatever the number.

    Parameters
    ----------
    count : int or None
        1 to 1024. ``None``: the environment variable ``RAYON_NUM_THREADS``, or where it is not set
        as many as the machine gives this process, which is how a process begins.

    Raises
    ------
    ValueError, TypeError
        If it is out of its range, or no integer.

    Examples
    --------
    >>> import softshadow as ss
    >>> ss.set_threads(2)
    >>> ss.thread_count()
    2
    >>> ss.set_threads(None)
    """
    _core.set_threads(
        0 if count is None else checks.integer(count, "threads", 1, _MOST, " or None")
    )


def thread_count() -> int:
    """Return how many threads a call has.

    Returns
    -------
    int
    """
    return _core.thread_count()


@contextmanager
def threads(count: int | None) -> Iterator[None]:
    """Set how many threads calls have within a ``with`` block; see `set_threads`.

    Parameters
    ----------
    count : int or None
        As of `set_threads`. It is the process's: other Python threads see it as well.

    Returns
    -------
    context manager
        Which sets the number that was before when it ends.

    Raises
    ------
    ValueError, TypeError
        As `set_threads`.

    Examples
    --------
    >>> import softshadow as ss
    >>> with ss.threads(1):
    ...     ss.thread_count()
    1
    """
    number = 0 if count is None else checks.integer(count, "threads", 1, _MOST, " or None")
    before = _core.set_threads(number)
    try:
        yield
    finally:
        _core.set_threads(before)
