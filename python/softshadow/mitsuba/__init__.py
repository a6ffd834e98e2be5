"""Mitsuba 3 as an outside reference: the same scene as its dictionary, and its radiance as arrays.

Mitsuba is an optional extra (``pip install softshadow[mitsuba]``); importing this module does not
import it.

The same radiance comes out of `softshadow.render` and of Mitsuba's ``direct`` integrator, up to
its noise and these differences:

- Its pixels are footprints, ours are single rays through the pixels' centres. `render` therefore
  does not use Mitsuba's film: it hands its integrator one ray through every pixel's centre, as
  often as the sample count asks for. The integrator, the light sampling, the intersections and the
  shading are Mitsuba's; only the ray through the pixel is ours. (Of the alternatives, a film of
  sub-pixels of which the central one is kept wastes all other rays, and a reconstruction filter
  cannot shrink the footprint that rays are spread over.) ``centre_rays=False`` renders the film.
- Its shadow rays start ``8.9e-5 · (1 + max|p|)`` off the surface and stop 0.09 % short of the
  light, in single precision. Keep scenes that are to be compared near unit size and near the
  origin; what lies closer together than that is lit differently.
- A mesh with an opacity below 1 is a ``mask`` there: seen from the camera, the surface behind it
  shines through, where here its own surface is shaded as if opaque. Compare pixels whose first
  surface is opaque.
"""

from softshadow.mitsuba.agreement import RayOffset, ZTest, ray_offset, sidak, unshadowed, z_test
from softshadow.mitsuba.bridge import render, scene_dict
from softshadow.mitsuba.direct import Direct
from softshadow.mitsuba.image import MitsubaImage
from softshadow.mitsuba.llvm import find_llvm
from softshadow.mitsuba.loading import from_dict, from_scene

__all__ = [
    "Direct",
    "MitsubaImage",
    "RayOffset",
    "ZTest",
    "find_llvm",
    "from_dict",
    "from_scene",
    "ray_offset",
    "render",
    "scene_dict",
    "sidak",
    "unshadowed",
    "z_test",
]
