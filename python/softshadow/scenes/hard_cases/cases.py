"""The hard cases: their names, what is hard, and who is excused."""

from __future__ import annotations

from softshadow.scenes.hard_cases import closed, lamps, meshes, places
from softshadow.scenes.hard_cases.case import HardCase

__all__ = ["CASES"]

CASES: tuple[HardCase, ...] = (
    HardCase(
        "half_plane",
        "An edge without end over a plane, under lights of all shapes: all that is wrong here is wrong "
        "everywhere.",
        closed.edge,
        closed.edge_visibility,
    ),
    HardCase(
        "eclipse",
        "Analytic balls wholly within the cone to a sphere light: one hides all of it, one is smaller.",
        closed.eclipse,
        closed.eclipse_visibility,
    ),
    HardCase("closed_housing", "A closed box around the lights: all is dark.", lamps.closed_housing, closed.nothing),
    HardCase("open_housing", "x.", lamps.open_housing),
    HardCase("wall_by_the_light", "x.", lamps.wall_by_the_light),
    HardCase("flush_lamp", "x.", lamps.flush_lamp),
    HardCase("flush_lamp_in_a_roof", "x.", lamps.flush_lamp_in_a_roof),
    HardCase("pierced_light", "x.", lamps.pierced_light),
    HardCase("caster_at_the_light", "x.", lamps.caster_at_the_light),
    HardCase("lamp_in_a_room", "x.", lamps.lamp_in_a_room),
    HardCase("large_light", "x.", lamps.large_light),
    HardCase("sun", "x.", lamps.sun),
    HardCase("grazing_light", "x.", lamps.grazing_light),
    HardCase("terminator", "x.", lamps.terminator),
    HardCase("contact", "x.", places.contact),
    HardCase("crossing_penumbrae", "x.", places.crossing_penumbrae),
    HardCase("fused_boards", "x.", places.fused_boards),
    HardCase("behind_the_camera", "x.", places.behind_the_camera),
    HardCase("eye_on_a_board", "x.", places.eye_on_a_board),
    HardCase("huge_ground", "x.", places.huge_ground),
    HardCase("tiny_and_far", "x.", places.tiny_and_far),
    HardCase("waves", "x.", places.waves),
    HardCase("oblique_board", "x.", places.oblique_board),
    HardCase("stacked_boards", "x.", places.stacked_boards),
    HardCase("fork", "x.", meshes.fork),
    HardCase("fence", "x.", meshes.fence),
    HardCase("needles", "x.", meshes.needles),
    HardCase("aimed_box", "x.", meshes.aimed_box),
    HardCase("edge_on_triangle", "x.", meshes.edge_on_triangle),
    HardCase("open_bowl", "x.", meshes.open_bowl),
    HardCase("fin", "x.", meshes.fin),
    HardCase("turned_faces", "x.", meshes.turned_faces),
    HardCase("degenerate_mesh", "x.", meshes.degenerate_mesh),
    HardCase("coplanar_boards", "x.", meshes.coplanar_boards),
    HardCase("pinhole", "x.", meshes.pinhole),
    HardCase("hair", "x.", meshes.hair),
    HardCase("panes", "x.", meshes.panes),
)
