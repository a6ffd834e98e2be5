"""The columns of a sweep's table: their names, their order and their Arrow types."""

from __future__ import annotations

import json
from collections.abc import Mapping
from statistics import median
from typing import TYPE_CHECKING, Any

from softshadow.compare import parameters_text
from softshadow.methods.base import kinds_of
from softshadow.methods.table import METHODS
from softshadow.mitsuba import Direct
from softshadow.renderers import Measurable

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["METRICS", "STAGES", "parameter_columns", "row_of", "schema", "seconds_columns"]

METRICS = (
    *("mae", "rmse", "bias", "p99", "max", "ssim", "flip"),
    *("penumbra_mae", "penumbra_rmse", "penumbra_bias", "penumbra_p99", "penumbra_max"),
    "penumbra_share",
)
"""As `softshadow.metrics.errors` names them."""

STAGES = (
    *("prepare", "frame", "geometry", "structures", "adjacency", "silhouettes", "wedges"),
    *("maps", "shadow map", "shadow maps", "deep shadow map", "distortion maps"),
    *("reference image", "receivers", "shade", "textures", "denoise"),
    *("look", "choose", "probes"),
)
"""As ``image.seconds`` names them; what else a method has is in the column ``more_stages``."""

_TEXT = ("scene", "light", "camera", "method", "label", "parameters")
_REFERENCE = ("reference", "reference_rmse", "reference_mae", "reference_converged")
_FLOATS = {"reference_rmse", "reference_mae"}


def seconds_columns(stage: str) -> tuple[str, str, str]:
    """Return the names of a stage's median, minimum and spread (largest less smallest)."""
    name = f"{stage.replace(' ', '_')}_seconds"
    return name, f"{name}_min", f"{name}_spread"


def _taken() -> set[str]:
    """Return all names that are not those of parameters."""
    times = {name for stage in STAGES for name in seconds_columns(stage)}
    return {*_TEXT, *_REFERENCE, *METRICS, *_LAST, *times}


_LAST = (
    *("bytes", "repeats", "threads", "machine", "version", "time", "image", "more_stages"),
    *("key", "error"),
)


def parameter_columns() -> dict[str, tuple[str, type]]:
    """Return the column and the type of every parameter of every method, and of Mitsuba.

    The column has the parameter's name, with ``method_`` before it where the table has a column of
    that name already (``error`` and ``bias``).
    """
    taken = _taken()
    found: dict[str, tuple[str, type]] = {}
    for method in (*METHODS.values(), Direct):
        for name, (kinds, _) in kinds_of(method).items():
            kind = next((k for k in (bool, int, float) if k in kinds), str)
            before = found.get(name, ("", kind))[1]
            column = f"method_{name}" if name in taken else name
            both = {before, kind}
            kind = float if both == {int, float} else kind if len(both) == 1 else str
            found[name] = (column, kind)
    return dict(sorted(found.items()))


def schema(metadata: Mapping[str, str]) -> pa.Schema:
    """Return the Arrow schema that all parts of a store have.

    It is the same for all methods, so that whoever reads the first part knows all columns.
    """
    import pyarrow as pa

    kinds = {bool: pa.bool_(), int: pa.uint64(), float: pa.float64(), str: pa.string()}
    columns = [(name, pa.string()) for name in _TEXT]
    columns += [(column, kinds[kind]) for column, kind in parameter_columns().values()]
    columns += [(name, pa.float64()) for stage in STAGES for name in seconds_columns(stage)]
    columns += [(name, pa.float64()) for name in METRICS]
    columns += [(name, pa.float64() if name in _FLOATS else pa.string()) for name in _REFERENCE]
    special = {
        **dict.fromkeys(("bytes", "repeats", "threads"), pa.uint64()),
        "reference_converged": pa.bool_(),
        "time": pa.timestamp("us", tz="UTC"),
    }
    columns += [(name, pa.string()) for name in _LAST]
    return pa.schema(
        [(name, special.get(name, kind)) for name, kind in columns], metadata=dict(metadata)
    )


def row_of(method: Measurable, timed: list[dict[str, float]]) -> dict[str, Any]:
    """Return a row's cells about the method and its times.

    Parameters
    ----------
    method : Method or Renderer
        Parameters of a renderer that no column has are in ``parameters`` only.
    timed : list of dict
        ``image.seconds`` of each repeat, all of one machine; may be empty.
    """
    columns = parameter_columns()
    cells: dict[str, Any] = {"method": method.name, "parameters": parameters_text(method)}
    for name, value in method.parameters().items():
        if name in columns:
            column, kind = columns[name]
            cells[column] = None if value is None else kind(value)
    more = {}
    for stage in timed[0] if timed else ():
        seconds = [times[stage] for times in timed]
        values = (median(seconds), min(seconds), max(seconds) - min(seconds))
        if stage in STAGES:
            cells.update(zip(seconds_columns(stage), values, strict=True))
        else:
            more[stage] = values
    cells["more_stages"] = json.dumps(more) if more else None
    cells["repeats"] = len(timed)
    return cells
