"""The pieces that methods are made of, as functions from arrays to arrays.

Everything here works in world coordinates. Points are rounded to ``float32`` relative to the middle
of the scene (or mesh) at hand, which costs half a unit in the last place of its size.
"""

from softshadow.kernels.layered import LayeredMap, layered_maps, trace_layered_maps
from softshadow.kernels.light import (
    light_fraction_above,
    light_samples,
    transmittance,
    unshadowed_irradiance,
)
from softshadow.kernels.mesh import curve_tubes, mesh_edges, silhouette_edges, silhouette_loops
from softshadow.kernels.raster import rasterize
from softshadow.kernels.single_sample import attenuation, outer_distances
from softshadow.kernels.ssoc import OcclusionMaps, ssoc_maps
from softshadow.kernels.textures import accumulate, convolve_shadow, receiver_transform
from softshadow.kernels.wedges import PenumbraWedges, light_intensity, wedges

__all__ = [
    "LayeredMap",
    "OcclusionMaps",
    "PenumbraWedges",
    "accumulate",
    "attenuation",
    "convolve_shadow",
    "curve_tubes",
    "layered_maps",
    "light_fraction_above",
    "light_intensity",
    "light_samples",
    "mesh_edges",
    "outer_distances",
    "rasterize",
    "receiver_transform",
    "silhouette_edges",
    "silhouette_loops",
    "ssoc_maps",
    "trace_layered_maps",
    "transmittance",
    "unshadowed_irradiance",
    "wedges",
]
