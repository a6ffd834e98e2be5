"""Layered shadow maps: transparency."""

from __future__ import annotations

import pytest
import softshadow as ss

LIGHT = ss.RectLight((0, 0, 3), (0, 0.6, 0), (0.6, 0, 0))


def _sheet(z, x0=-4.0, tilt=0.0):
    corners = [(x0, -4, z - tilt), (4, -4, z + tilt), (4, 4, z + tilt), (x0, 4, z - tilt)]
    return corners, [(0, 1, 2), (0, 2, 3)]


@pytest.mark.parametrize(
    ("sheets", "expected"),
    [
        ([_sheet(1), _sheet(1.5)], 0.25),
        ([_sheet(1, tilt=0.8)], 0.5),
        ([_sheet(1), _sheet(1)], 0.25),
        # Every segment misses the first of two staggered sheets.
        ([_sheet(1.5, x0=1.2), _sheet(1)], 0.5),
    ],
)
def test_sheets_of_half_opacity(sheets, expected):
    scene = ss.Scene()
    scene.add(_sheet(0), casts=False)
    for sheet in sheets:
        scene.add(sheet, opacity=0.5)
    seen = ss.visibility(scene, [(0.3, 0.2, 0.0)], [(0, 0, 1.0)], LIGHT, "mtsm")
    # Powers of two are exact, and so are their sums.
    assert seen[0] == expected
