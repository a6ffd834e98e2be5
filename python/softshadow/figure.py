"""A figure for notebooks; apart from `softshadow.plot`, which does not import matplotlib."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure

__all__ = ["OwnFigure", "with_palette"]

MOST_BYTES = 150_000
"""Of a picture that a notebook keeps. What has more gets a palette, and then fewer dots an inch."""

_FEWER_DOTS = (70, 50, 35)


class OwnFigure(Figure):
    """A figure that Jupyter can show although pyplot does not know it, in few bytes."""

    def _repr_png_(self) -> bytes:
        whole = self._drawn(self.dpi)
        if len(whole) <= MOST_BYTES:
            return whole
        for dots in (self.dpi, *_FEWER_DOTS):
            png = with_palette(self._drawn(dots))
            if len(png) <= MOST_BYTES:
                break
        return png

    def _drawn(self, dots: float) -> bytes:
        buffer = BytesIO()
        self.savefig(buffer, format="png", dpi=dots, bbox_inches="tight")
        return buffer.getvalue()


def with_palette(png: bytes) -> bytes:
    """Return a PNG with 256 colours, of which one is within a few levels of every colour.

    Parameters
    ----------
    png : bytes
    """
    from PIL import Image  # matplotlib needs it, too

    picture = Image.open(BytesIO(png)).convert("RGB")
    buffer = BytesIO()
    few = picture.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    few.save(buffer, "png", optimize=True)
    return buffer.getvalue()
