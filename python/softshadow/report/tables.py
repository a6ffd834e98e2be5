"""Tables of measured cases from files, and the pictures that they name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from softshadow import fronts
from softshadow.extras import needs

if TYPE_CHECKING:
    import pandas as pd

    from softshadow.compare import Comparison

__all__ = ["one_table", "pictures_of", "read_table"]

_MOST_SETTINGS = 12
"""Settings whose pictures a page shows; a strip is half a megabyte."""

_MOST_IMAGES = 14
"""Images of one setting; those on the front come first."""


def read_table(path: Path) -> pd.DataFrame:
    """Read a table of measured cases.

    Parameters
    ----------
    path : Path
        A folder of Parquet parts, as a sweep writes it, a ``.parquet`` or a ``.csv`` file.

    Raises
    ------
    ValueError
        If it is no such table.
    OSError
        If it is not there, or cannot be read.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder")
    with needs("metrics", "a report"):
        import pandas as pd
    if path.suffix.lower() == ".csv":
        return pd.read_csv(path)
    try:
        table = pd.read_parquet(path)
    except ImportError as error:
        raise ValueError(f"{path}: reading Parquet needs pyarrow: pip install pyarrow") from error
    except OSError:
        raise
    except Exception as error:  # pyarrow's own, of a file that is none
        raise ValueError(f"{path}: cannot be read as Parquet ({error})") from error
    # Parts come in the order of their files' names, which says nothing.
    order = [c for c in ("scene", "light", "camera", "method", "parameters") if c in table.columns]
    if order:
        table = table.sort_values(order, kind="stable", ignore_index=True)
    # Images are named as seen from where the sweep ran; beside the store is the next best place.
    if "image" in table.columns:
        table["image"] = [_found(name, path.parent) for name in table["image"]]
    return table


def one_table(comparisons: dict[str, Comparison]) -> pd.DataFrame:
    """Return the tables of several comparisons as one, with a column ``scene`` first.

    Parameters
    ----------
    comparisons : dict of str to Comparison
        By the scene's name.
    """
    import pandas as pd

    parts = [result.table.assign(scene=name) for name, result in comparisons.items()]
    table: pd.DataFrame = pd.concat(parts, ignore_index=True)
    ordered: pd.DataFrame = table[["scene", *(c for c in table.columns if c != "scene")]]
    return ordered


def pictures_of(table: pd.DataFrame) -> dict[str, Any]:
    """Return the images that a table names in its column ``image``, by setting and label.

    Parameters
    ----------
    table : pandas.DataFrame
        The column has paths of ``.npz`` files with ``visibility`` and ``reference``; those that are
        not there are left out.
    """
    if "image" not in table.columns:
        return {}
    on, labels = fronts.front(table), fronts.labels(table)
    found: dict[str, Any] = {}
    for name, rows in fronts.settings(table).items():
        order = sorted(rows, key=lambda i: not on[i])
        paths = {i: str(table["image"].iloc[i]) for i in order}
        there = [i for i in order if paths[i].endswith(".npz") and Path(paths[i]).is_file()]
        images: dict[str, npt.NDArray[np.float64]] = {}
        for i in there[:_MOST_IMAGES]:
            with np.load(paths[i]) as arrays:
                images["reference"] = _one_light(arrays["reference"])
                images[labels[i]] = _one_light(arrays["visibility"])
        if images and len(found) < _MOST_SETTINGS:
            found[name or "All cases"] = images
    return found


def _one_light(visibility: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    """Return the mean over the lights, as pictures show it."""
    values = visibility.astype(np.float64)
    return values.mean(axis=0) if values.ndim == 3 else values


def _found(name: Any, folder: Path) -> Any:
    if not isinstance(name, str) or Path(name).is_file():
        return name
    return str(folder / name)
