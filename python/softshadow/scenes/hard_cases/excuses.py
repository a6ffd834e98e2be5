"""Why methods are wrong in hard cases: each reason once, for all the cases that it holds in."""

from __future__ import annotations

from softshadow._core import UnsupportedError
from softshadow.scenes.hard_cases.case import Excuse

__all__ = [
    "CENTRE",
    "COARSE",
    "EDGE_ON",
    "FACING",
    "GRAZING",
    "GROWN",
    "INSIDE",
    "LAYERS",
    "NO_OPACITY",
    "NO_SPHERES",
    "ONE_DEPTH",
    "OVERLAP",
    "PASSED",
    "POINTS",
    "SILHOUETTE",
    "TEXELS",
    "by",
]

CENTRE = Excuse("It sees one point of the light, its centre.")
FACING = Excuse("Faces in whose plane the light's centre lies are dark, where half of it is seen.")
GROWN = Excuse(
    "Umbras are too large by half a penumbra, and what is small is as dark as what is large."
)
ONE_DEPTH = Excuse("All that casts on a receiver counts as if it were at one depth.")
EDGE_ON = Excuse("The light's centre sees this edge-on: in its maps it has no texel.")
SILHOUETTE = Excuse("One silhouette, that of the light's centre, stands for all of the light.")
LAYERS = Excuse("What is hidden from the light's centre is in no layer of its map.")
TEXELS = Excuse("What counts here is a texel or two wide in maps of 256.")
COARSE = Excuse("The same 64 light points for all receivers: their steps show.")
GRAZING = Excuse("What is seen under a few degrees spans far more depth than a texel tells.")
INSIDE = Excuse(
    "What reaches into the light comes so near to its eye that no map or silhouette holds it."
)
PASSED = Excuse("What the light's other parts see past a caster, or under it, is missed.")
OVERLAP = Excuse(
    "What two objects leave is multiplied, as if by chance: light leaks where they meet."
)
NO_OPACITY = Excuse("Opaque casters only.", UnsupportedError)
NO_SPHERES = Excuse("No analytic spheres that cast.", UnsupportedError)

POINTS = {
    "hard": CENTRE,
    "shadow_volume": CENTRE,
    "single_sample": GROWN,
}
"""Who is wrong in nearly every penumbra."""


def by(reason: Excuse, *methods: str) -> dict[str, Excuse]:
    """Return an excuse for methods, by their names."""
    return dict.fromkeys(methods, reason)
