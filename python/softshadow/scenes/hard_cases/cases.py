"""The hard cases: their names, what is hard, and who is excused."""

from __future__ import annotations

from softshadow.scenes.hard_cases import closed, lamps, meshes, places
from softshadow.scenes.hard_cases.case import HardCase
from softshadow.scenes.hard_cases.excuses import (
    COARSE,
    EDGE_ON,
    FACING,
    GRAZING,
    INSIDE,
    LAYERS,
    NO_OPACITY,
    NO_SPHERES,
    ONE_DEPTH,
    OVERLAP,
    PASSED,
    POINTS,
    SILHOUETTE,
    TEXELS,
    by,
)

__all__ = ["CASES"]

_FILTERED = ("deep", "pcf")
_LAYERED = ("mlsm", "mtsm", "slsm")
_MAPS = ("convolution", *_FILTERED, *_LAYERED, "mvsm")
# `mlsm` and `mtsm` have triangles next to receivers.
_MAPS_ALONE = ("convolution", *_FILTERED, "slsm", "mvsm")
_EDGES = ("ssoc", "wedges")

_ANSWERS = (
    HardCase(
        "half_plane",
        "An edge without end, under lights of all shapes: what is wrong here is wrong everywhere.",
        closed.edge,
        closed.edge_visibility,
        POINTS,
    ),
    HardCase(
        "eclipse",
        "Balls within the cone to a sphere light: one hides all of it, one is smaller than it.",
        closed.eclipse,
        closed.eclipse_visibility,
        POINTS | by(NO_SPHERES, *_MAPS, *_EDGES, "accumulation", "shadow_volume"),
    ),
    HardCase(
        "closed_housing",
        "A lamp in a closed box: all is dark, and no ray may pass a corner.",
        lamps.closed_housing,
        closed.nothing,
    ),
)
"""Those with a closed form."""

_LAMPS = (
    HardCase(
        "open_housing",
        "Lamps in a box that is open below: walls beside the light have no one depth.",
        lamps.open_housing,
        excuses=POINTS | by(ONE_DEPTH, *_FILTERED, "convolution"),
    ),
    HardCase(
        "wall_by_the_light",
        "A wall beside the light, as high above it as below.",
        lamps.wall_by_the_light,
        excuses=POINTS | by(ONE_DEPTH, *_FILTERED, "convolution"),
    ),
    HardCase(
        "flush_lamp",
        "Lamps in a ceiling's plane, behind it by less than rounding: it hides none of them.",
        lamps.flush_lamp,
        excuses=POINTS,
    ),
    HardCase(
        "flush_lamp_in_a_roof",
        "The same room turned, so that rounding tilts every piece of the ceiling its own way.",
        lamps.flush_lamp_in_a_roof,
        excuses=POINTS,
    ),
    HardCase(
        "pierced_light",
        "A board through the middle of the light: every point sees a part of it.",
        lamps.pierced_light,
        excuses=POINTS | by(INSIDE, *_MAPS, *_EDGES),
    ),
    HardCase(
        "caster_at_the_light",
        "A triangle whose corner is inside the light.",
        lamps.caster_at_the_light,
        excuses=POINTS | by(INSIDE, *_MAPS, *_EDGES) | by(COARSE, "accumulation"),
    ),
    HardCase(
        "lamp_in_a_room",
        "A light in the middle of what casts, which is on all sides of it.",
        lamps.lamp_in_a_room,
        excuses=POINTS,
    ),
    HardCase(
        "large_light",
        "A light far larger than what casts: there is no umbra.",
        lamps.large_light,
        excuses=POINTS
        | by(COARSE, "accumulation")
        | by(PASSED, "convolution")
        | by(ONE_DEPTH, *_FILTERED)
        | by(SILHOUETTE, "ssoc"),
    ),
    HardCase(
        "sun",
        "Lights a million times as far away as the scene is large.",
        lamps.sun,
        excuses=POINTS | by(TEXELS, "ssoc"),
    ),
    HardCase(
        "grazing_light",
        "Lights that a ground sees under a few degrees: it must not shadow itself.",
        lamps.grazing_light,
        excuses=POINTS
        | by(COARSE, "accumulation")
        | by(GRAZING, "convolution", "mvsm", "ssoc")
        | by(ONE_DEPTH, *_FILTERED),
    ),
    HardCase(
        "terminator",
        "A light that sets on a curved surface: its tangent planes cut it, and a rod does, too.",
        lamps.terminator,
        excuses=POINTS,
    ),
)
"""Those whose light is hard."""

_PLACES = (
    HardCase(
        "contact",
        "A box on the ground, and one stuck into it: shadows begin where they touch.",
        places.contact,
        excuses=POINTS | by(ONE_DEPTH, *_FILTERED, "convolution") | by(TEXELS, "mvsm"),
    ),
    HardCase(
        "crossing_penumbrae",
        "Two boards whose penumbrae cross, and all but coincide at one end.",
        places.crossing_penumbrae,
        excuses=POINTS,
    ),
    HardCase(
        "fused_boards",
        "Two boards at two heights that hide a half of the light each: together all of it.",
        places.fused_boards,
        excuses=POINTS,
    ),
    HardCase(
        "stacked_boards",
        "Boards over one another: what the light's centre does not see hides its rim.",
        places.stacked_boards,
        excuses=POINTS
        | by(PASSED, "convolution")
        | by(LAYERS, *_FILTERED, "slsm")
        | by(SILHOUETTE, *_EDGES),
    ),
    HardCase(
        "oblique_board",
        "A board that the light sees under ten degrees: texels next to each other are far apart.",
        places.oblique_board,
        excuses=POINTS
        | by(ONE_DEPTH, *_FILTERED, "convolution")
        | by(GRAZING, "mvsm")
        | by(SILHOUETTE, "ssoc"),
    ),
    HardCase(
        "waves",
        "A slab's edge before a wavy ground: what lies behind the edge varies quickly in depth.",
        places.waves,
        excuses=POINTS,
    ),
    HardCase(
        "behind_the_camera",
        "What casts is behind the camera.",
        places.behind_the_camera,
        excuses=POINTS,
    ),
    HardCase(
        "eye_on_a_board",
        "The eye lies on the edge of what casts, in the side of its shadow.",
        places.eye_on_a_board,
        excuses=POINTS,
    ),
    HardCase(
        "huge_ground",
        "A ground a hundred thousand times as wide as what stands on it.",
        places.huge_ground,
        excuses=POINTS,
    ),
    HardCase(
        "tiny_and_far",
        "A scene of a millionth of a unit, ten thousand of its sizes from the origin.",
        places.tiny_and_far,
        excuses=POINTS | by(ONE_DEPTH, *_FILTERED),
    ),
)
"""Those whose layout is hard."""

_MESHES = (
    HardCase(
        "fork",
        "Tines so close that their penumbrae meet in the maps.",
        meshes.fork,
        excuses=POINTS | by(ONE_DEPTH, "convolution") | by(TEXELS, "mvsm"),
    ),
    HardCase(
        "pinhole",
        "A hole and a slit, both narrower than the penumbra.",
        meshes.pinhole,
        excuses=POINTS | by(OVERLAP, "wedges"),
    ),
    HardCase(
        "fence",
        "Boards without thickness in planes through the light's centre, which sees none of them.",
        meshes.fence,
        excuses=POINTS
        | by(FACING, "shadow_volume")
        | by(EDGE_ON, *_MAPS_ALONE)
        | by(SILHOUETTE, *_EDGES),
    ),
    HardCase(
        "edge_on_triangle",
        "One such triangle, in the air.",
        meshes.edge_on_triangle,
        excuses=POINTS
        | by(FACING, "shadow_volume")
        | by(COARSE, "accumulation")
        | by(EDGE_ON, *_MAPS_ALONE)
        | by(SILHOUETTE, *_EDGES),
    ),
    HardCase(
        "aimed_box",
        "A box whose upright edges point at the light's centre, which sees none of its sides.",
        meshes.aimed_box,
        excuses=POINTS
        | by(FACING, "shadow_volume")
        | by(ONE_DEPTH, *_FILTERED, "convolution")
        | by(LAYERS, "slsm")
        | by(SILHOUETTE, *_EDGES),
    ),
    HardCase(
        "needles",
        "Triangles 10² to 10⁷ times as long as they are wide.",
        meshes.needles,
        excuses=POINTS | by(COARSE, "accumulation") | by(TEXELS, *_MAPS_ALONE, "ssoc"),
    ),
    HardCase(
        "hair",
        "Bristles thinner than a pixel.",
        meshes.hair,
        excuses=POINTS
        | by(ONE_DEPTH, *_FILTERED, "convolution")
        | by(TEXELS, "slsm", "mvsm")
        | by(SILHOUETTE, *_EDGES),
    ),
    HardCase(
        "open_bowl",
        "Half a shell and a sheet: meshes that enclose nothing, seen from both sides.",
        meshes.open_bowl,
        excuses=POINTS,
    ),
    HardCase(
        "fin",
        "Three sheets that meet at one edge.",
        meshes.fin,
        excuses=POINTS,
    ),
    HardCase(
        "turned_faces",
        "Faces that are wound against each other, and one that is given twice.",
        meshes.turned_faces,
        excuses=POINTS,
    ),
    HardCase(
        "degenerate_mesh",
        "Loose triangles with corners of their own, and others without area.",
        meshes.degenerate_mesh,
        excuses=POINTS | by(ONE_DEPTH, *_FILTERED),
    ),
    HardCase(
        "coplanar_boards",
        "Ten boards in one plane, on one another, and one in the ground's own plane.",
        meshes.coplanar_boards,
        excuses=POINTS,
    ),
    HardCase(
        "panes",
        "Translucent panes, whose shadows multiply.",
        meshes.panes,
        excuses=POINTS
        | by(NO_OPACITY, *_EDGES, "convolution", "mlsm", "mvsm", "pcf", "slsm")
        | by(NO_OPACITY, "shadow_volume", "single_sample"),
    ),
)
"""Those whose meshes are hard."""

CASES: tuple[HardCase, ...] = (*_ANSWERS, *_LAMPS, *_PLACES, *_MESHES)
