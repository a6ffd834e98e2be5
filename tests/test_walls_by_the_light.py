"""Walls close to a light: a lamp in its housing, open below or closed, and a single wall beside it.

Maps see such walls nearly edge-on and from their ends, and what is between light and receiver has
no one depth.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest
import softshadow as ss
import trimesh
from shapes import quad
from softshadow.methods import resolve

CAMERA = ss.Camera((0, -1.8, 1.2), (0, 0.5, 0), fov_y_deg=60, width=40, height=40)
LIGHTS = {
    "rect": ss.RectLight((0, 0, 2), (0, 0.2, 0), (0.2, 0, 0)),
    "disk": ss.DiskLight((0, 0, 2), (0, 0, -1), 0.1),
    "sphere": ss.SphereLight((0, 0, 2), 0.1),
}


def _scene(kind):
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), "ground")
    if kind == "wall":
        scene.add(quad((0, 0.2, 2), (1, 0, 0), (0, 0, 1)), "wall")
        return scene
    box = trimesh.creation.box(bounds=[(-0.5, -0.2, 1.5), (0.5, 0.2, 2.5)])
    closed = kind == "closed"
    faces = box.faces if closed else box.faces[box.face_normals[:, 2] > -0.5]
    scene.add((box.vertices, faces), "housing")
    return scene


@functools.cache
def _image(kind, light, method):
    return ss.render(_scene(kind), CAMERA, LIGHTS[light], method)


def _error(kind, light, method):
    """Signed errors of the pixels that show something; positive where light leaks in."""
    reference = _image(kind, light, ss.RayTraced(samples=1024))
    return (_image(kind, light, method).visibility - reference.visibility)[reference.mask]


# Mean and largest error that were measured in the three scenes, and a little more. What remains in
# layered maps is a line of receivers that see the wall edge-on, by the coarser levels' planes; with
# `detail=1000` it is gone.
LIMITS = {
    "wedges": (0.004, 0.03),
    "ssoc": (0.006, 0.05),
    "mvsm": (0.006, 0.05),
    "slsm": (0.013, 0.1),
    "mlsm": (0.013, 0.1),
    "mtsm": (0.013, 0.1),
}


# Maps of half the usual size, whose errors are as large: 0.004 and 0.019.
METHODS = {name: resolve(name) for name in LIMITS} | {"mvsm": ss.Mvsm(resolution=512)}
USUAL = pytest.param(ss.Mvsm(), id="mvsm of the usual size", marks=pytest.mark.slow)


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("kind", ["wall", "open", "closed"])
@pytest.mark.parametrize("method", [*(pytest.param(m, id=n) for n, m in METHODS.items()), USUAL])
def test_walls_next_to_the_light_let_little_of_it_through(method, kind, light):
    error = np.abs(_error(kind, light, method))
    mean, most = LIMITS[method.name]
    assert error.mean() < mean
    assert error.max() < most


@pytest.mark.parametrize("light", LIGHTS)
def test_a_closed_housing_leaks_nowhere_with_all_texels_told_apart(light):
    for method in (ss.Slsm(detail=1000), ss.Mtsm(detail=1000)):
        error = _error("closed", light, method)
        assert error.min() >= 0
        assert error.max() < 0.02


def test_filtered_maps_let_light_through_beside_walls_as_their_page_says():
    # All blockers count as if at one depth, the nearest to the light: of a wall that is the light's
    # own, where the wall hides only what is beyond it.
    nearest, mean = (_error("wall", "rect", ss.Pcf(estimate=e)) for e in ("nearest", "mean"))
    assert 0.4 < nearest.max() < 0.6
    assert nearest.min() > -0.05
    assert 0.03 < np.abs(nearest).mean() < 0.07
    assert np.abs(mean).mean() < 0.6 * np.abs(nearest).mean()
    housed = _error("open", "rect", "pcf")
    assert 0.1 < np.abs(housed).mean() < 0.16
    # What is closed is dark, in filtered maps too.
    for method in ("pcf", "deep"):
        assert (
            not _image("closed", "rect", method)
            .visibility[_image("closed", "rect", method).mask]
            .any()
        )
