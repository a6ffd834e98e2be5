"""Figures for notebooks, pages and colleagues: pictures, strips, profiles, maps and studies.

`show` and `compare` draw one image or two; `strip` and `scanline` several images with their signed
errors; `pareto`, `versus` and `matrix` a table of measured cases, as `softshadow.compare` makes it.
What `softshadow.kernels` returns is drawn by `light_map`, `layers` and `bent_rays` (a light's
maps), `wedges`, `silhouettes` and `light_intensity`.

The figures belong to the caller, not to pyplot: nothing opens a window, nothing needs a display,
and a notebook shows a returned figure once. Save one with ``figure.savefig("shadow.png")``. To draw
into a figure of your own (and show it in a window), pass its ``ax``.
"""

from softshadow.plot.maps import light_map
from softshadow.plot.matrices import matrix
from softshadow.plot.pictures import compare, show
from softshadow.plot.profiles import bent_rays, layers
from softshadow.plot.strips import scanline, strip
from softshadow.plot.studies import pareto, versus
from softshadow.plot.wedges import light_intensity, silhouettes, wedges

__all__ = [
    "bent_rays",
    "compare",
    "layers",
    "light_intensity",
    "light_map",
    "matrix",
    "pareto",
    "scanline",
    "show",
    "silhouettes",
    "strip",
    "versus",
    "wedges",
]
