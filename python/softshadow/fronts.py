"""Which rows of a table of measured cases nobody beats in both time and error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["front"]

SETTING = ("scene", "light", "camera", "machine", "threads")
"""Columns that say what was rendered and where: rows are compared where all of them agree."""


def front(
    table: pd.DataFrame, x: str = "frame_seconds", y: str = "penumbra_mae"
) -> npt.NDArray[np.bool_]:
    """Say which rows are on the front: no other row is as good in both columns, and better in one.

    Rows are compared with those of the same scene, light, camera, machine and threads, as far as
    the table has these columns. Rows that are equal in both columns are on the front together. Rows
    that failed (a text in the column ``error``) or have no finite number are not on it, and beat
    nobody.

    Parameters
    ----------
    table : pandas.DataFrame
        One row a case: `Comparison.table`, or any table with such columns.
    x, y : str
        Columns of which less is better; of ``ssim`` more is better, of a bias its size counts.
        ``total_seconds`` is ``prepare_seconds`` and ``frame_seconds`` together.

    Returns
    -------
    ndarray, shape (rows,), bool

    Raises
    ------
    ValueError
        If the table has no such column.

    Examples
    --------
    >>> import pandas as pd
    >>> import softshadow as ss
    >>> table = pd.DataFrame({"frame_seconds": [1, 2, 3], "penumbra_mae": [0.2, 0.3, 0.1]})
    >>> ss.front(table).tolist()
    [True, False, True]
    """
    first, second = badness(table, x), badness(table, y)
    on = np.zeros(len(table), dtype=np.bool_)
    usable = np.isfinite(first) & np.isfinite(second) & ~failed(table)
    for rows in settings(table).values():
        chosen = rows[usable[rows]]
        on[chosen] = _non_dominated(first[chosen], second[chosen])
    return on


def _non_dominated(x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Return which of finite points no other point dominates."""
    on = np.zeros(len(x), dtype=np.bool_)
    best, best_x = np.inf, np.inf
    for i in np.lexsort((y, x)):  # by x, then by y
        # As good as the last one in y is on the front only where it is the same point.
        if y[i] < best or (y[i] == best and x[i] == best_x):
            on[i] = True
            best, best_x = y[i], x[i]
    return on


def badness(table: pd.DataFrame, name: str) -> npt.NDArray[np.float64]:
    """Return a column as float64 of which less is better, shape (rows,); NaN where it is no number.

    Raises
    ------
    ValueError
        If the table has no such column.
    """
    values = numbers(table, name)
    if name.endswith("ssim"):
        return 1.0 - values
    return np.abs(values) if name.endswith("bias") else values


def numbers(table: pd.DataFrame, name: str) -> npt.NDArray[np.float64]:
    """Return a column as float64, shape (rows,); NaN where it is no number.

    Raises
    ------
    ValueError
        If the table has no such column.
    """
    import pandas as pd

    if name == "total_seconds" and name not in table.columns:
        return numbers(table, "prepare_seconds") + numbers(table, "frame_seconds")
    check_column(table, name)
    return np.asarray(pd.to_numeric(table[name], errors="coerce"), dtype=np.float64)


def check_column(table: pd.DataFrame, name: str) -> None:
    """Refuse a name that is none of the table's columns.

    Raises
    ------
    ValueError
        Which lists the columns.
    """
    if name not in table.columns:
        have = ", ".join(map(str, table.columns))
        raise ValueError(f"table: no column {name!r}; it has {have}")


def failed(table: pd.DataFrame) -> npt.NDArray[np.bool_]:
    """Return which rows have a message in their column ``error``, shape (rows,)."""
    if "error" not in table.columns:
        return np.zeros(len(table), dtype=np.bool_)
    given = table["error"].notna() & (table["error"].astype(str) != "")
    return np.asarray(given, dtype=np.bool_)


def settings(table: pd.DataFrame) -> dict[str, npt.NDArray[np.int64]]:
    """Return the rows of each setting (scene, light, ...), in the table's order.

    The key is what differs between the settings, such as ``"bunny, sphere"``; empty if nothing
    does.
    """
    columns = [name for name in SETTING if name in table.columns]
    # What is missing (a failed case may not know its threads) tells nothing apart.
    shown = [name for name in columns if table[name].nunique() > 1]
    texts = {name: [str(value) for value in table[name]] for name in shown}
    found: dict[str, list[int]] = {}
    for i in range(len(table)):
        found.setdefault(", ".join(texts[name][i] for name in shown), []).append(i)
    return {key: np.array(rows, dtype=np.int64) for key, rows in found.items()}


def labels(table: pd.DataFrame) -> list[str]:
    """Return each row's method, with its parameters in parentheses if it has any."""
    check_column(table, "method")
    names = table["method"].astype(str).tolist()
    if "parameters" not in table.columns:
        return names
    given = table["parameters"].fillna("").astype(str)
    return [f"{m}({p})" if p else m for m, p in zip(names, given, strict=True)]
