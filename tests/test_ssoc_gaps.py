"""Gaps, and lights that all but touch what casts, in the soft shadow occlusion camera."""

from __future__ import annotations

import time

import numpy as np
import pytest
import softshadow as ss
from shapes import quad

LIGHTS = {
    "rect": ss.RectLight((0, 0, 1), (0, 0.2, 0), (0.2, 0, 0)),
    "disk": ss.DiskLight((0, 0, 1), (0, 0, -1), 0.1),
    "sphere": ss.SphereLight((0, 0, 1), 0.1),
}


def _slit(gap, heights=(0.5, 0.5), turn=0.0):
    """Two boards with a gap, where a texel of a map of 1024 is about 0.002."""
    scene = ss.Scene()
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)])
    scene.add(quad((0, 0, 0), (2, 0, 0), (0, 2, 0)))
    for side, height in zip((-1, 1), heights, strict=True):
        board, faces = quad((side * (gap / 2 + 0.4), 0, height), (0.8, 0, 0), (0, 1.6, 0))
        scene.add((board @ rotation.T, faces))
    x = np.linspace(-0.12, 0.12, 41)
    points = np.stack([x, np.full_like(x, 0.013), np.zeros_like(x)], axis=1) @ rotation.T
    return scene, points, np.tile((0.0, 0.0, 1.0), (41, 1))


@pytest.mark.parametrize("turn", [0.0, 0.4])
@pytest.mark.parametrize("kind", LIGHTS)
@pytest.mark.parametrize("gap", [0.2, 0.1, 0.05, 0.03, 0.02, 0.01])
def test_what_the_two_sides_of_a_slit_hide_adds_up(gap, kind, turn):
    """Under a square light a slit at half height lets its width over 0.1 through."""
    scene, points, normals = _slit(gap, turn=turn)
    found = ss.visibility(scene, points, normals, LIGHTS[kind], "ssoc")
    reference = ss.visibility(scene, points, normals, LIGHTS[kind], ss.RayTraced(4096, seed=3))
    # A half-plane's own: a sphere is taken for a disk (0.006), and the reference's noise (0.004).
    assert np.abs(found - reference).max() < 0.012
    if kind == "rect" and turn == 0:
        assert found[20] == pytest.approx(min(gap / 0.1, 1), abs=1e-3)


def test_a_square_hole_lets_through_what_one_of_its_two_slits_does():
    """0.36 is right; as the page says, it is 0.6, what the nearest pair of edges lets through.

    Two edges that face each other find each other in turn, and end the search before the others.
    """
    gap, scene = 0.06, ss.Scene()
    scene.add(quad((0, 0, 0), (2, 0, 0), (0, 2, 0)))
    for side in (-1, 1):
        scene.add(quad((side * (gap / 2 + 0.4), 0, 0.5), (0.8, 0, 0), (0, 1.6, 0)))
        scene.add(quad((0, side * (gap / 2 + 0.4), 0.5), (gap, 0, 0), (0, 0.8, 0)))
    found = ss.visibility(scene, [(0.003, 0.004, 0)], [(0, 0, 1)], LIGHTS["rect"], ss.Ssoc(steps=8))
    assert found[0] == pytest.approx(0.6, abs=0.01)


def test_a_slit_of_less_than_two_texels_is_as_wrong_as_the_page_says():
    """The map's texels show it or do not: one edge is found, or none."""
    scene, points, normals = _slit(0.0015)
    found = ss.visibility(scene, points, normals, LIGHTS["rect"], "ssoc")
    assert np.abs(found - 0.015).max() < 0.55
    finer = ss.visibility(scene, points, normals, LIGHTS["rect"], ss.Ssoc(resolution=8192))
    assert finer[20] == pytest.approx(0.015, abs=0.005)


def test_a_step_alone_knows_one_side():
    scene, points, normals = _slit(0.05)
    found = ss.visibility(scene, points, normals, LIGHTS["rect"], ss.Ssoc(steps=1))
    assert found[20] == pytest.approx(0.75, abs=1e-3)


@pytest.mark.parametrize("off", [1e-2, 1e-4, -1e-4, 1e-6, -1e-6])
def test_a_light_that_all_but_touches_what_casts_takes_as_long_as_the_map_is_wide(off):
    """Penumbrae of millions of texels: it took 7 s for a radius of 100 and maps of 16²."""
    s = 0.5
    corners = np.array([(x, y, z) for x in (-s, s) for y in (-s, s) for z in (-s, s)])
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
    faces += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    scene = ss.Scene()
    scene.add((corners, faces))
    camera = ss.Camera((3, 2, 2), (0, 0, 0), width=16, height=16)
    for radius in (1, 100, 1e4, 1e6):
        light = ss.SphereLight((s + off, s, s - off), radius)
        start = time.process_time()
        image = ss.render(scene, camera, light, ss.Ssoc(resolution=16))
        # Fifty times what it takes.
        assert time.process_time() - start < 0.5
        assert np.isfinite(image.visibility).all()
