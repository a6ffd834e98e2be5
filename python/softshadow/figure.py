"""A figure for notebooks; apart from `softshadow.plot`, which does not import matplotlib."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure

__all__ = ["OwnFigure"]


class OwnFigure(Figure):
    """A figure that Jupyter can show although pyplot does not know it."""

    def _repr_png_(self) -> bytes:
        buffer = BytesIO()
        self.savefig(buffer, format="png", bbox_inches="tight")
        return buffer.getvalue()
