"""Scenes for tests, the demo and benchmarks: real models from packages, and known answers.

All are z-up, near unit size and near the origin, so that single-precision peers can be compared.
The models are not part of softshadow; they come with packages that ``pip install`` brings:

- the Stanford bunny (99,785 triangles, open at the bottom) with ``pymeshfix``,
- Munich (38,936 triangles) and San Francisco (268,041 triangles) with ``sionna-rt``.

The figures of two papers (``wedges_paper``, ``ssoc_paper``) are built from scratch, and so are
scenes in which shadow maps go wrong (``map_artifacts``), a tree and balls of fur; those and a
statue (``dense``) have the triangles that the methods are for. `hard` has the cases in which
methods go wrong, with their answers and what each may be off (``hard_cases``).
"""

from softshadow.scenes.basic import bunny_on_plane, city, closed_solids, half_plane, tilted_sheet
from softshadow.scenes.dense import fur_ball, fur_ribbons, statue, tree
from softshadow.scenes.forest import forest
from softshadow.scenes.hard_cases import Answer, Excuse, HardCase, HardCases, hard
from softshadow.scenes.map_artifacts import ball, oblique_board, stacked_boards, standing_cylinder
from softshadow.scenes.models import city_path, stanford_bunny_path
from softshadow.scenes.ssoc_paper import aircraft, bunny_and_sphere, fork, two_teapots
from softshadow.scenes.staging import Setup, light_towards, square
from softshadow.scenes.wedges_paper import (
    acute_triangle,
    growing_light,
    landscape,
    overlapping_boards,
    two_cylinders,
    two_lights,
)

__all__ = [
    "Answer",
    "Excuse",
    "HardCase",
    "HardCases",
    "Setup",
    "acute_triangle",
    "aircraft",
    "ball",
    "bunny_and_sphere",
    "bunny_on_plane",
    "city",
    "city_path",
    "closed_solids",
    "forest",
    "fork",
    "fur_ball",
    "fur_ribbons",
    "growing_light",
    "half_plane",
    "hard",
    "landscape",
    "light_towards",
    "oblique_board",
    "overlapping_boards",
    "square",
    "stacked_boards",
    "standing_cylinder",
    "stanford_bunny_path",
    "statue",
    "tilted_sheet",
    "tree",
    "two_cylinders",
    "two_lights",
    "two_teapots",
]
