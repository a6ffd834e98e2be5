"""Scenes far larger than what is lit: a ground without end does not change what stands on it."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from penumbrae import box
from shapes import quad
from small_methods import AT_POINTS, methods

OWN = {
    "auto": {"error": 0.002},  # its error is what differs
    "ray_traced": {"samples": 64},
    "ssoc": {"resolution": 256},
    "mlsm": {"layers": 4},
    "mtsm": {"layers": 4},
}
METHODS = methods(ss.method_names(), OWN, resolution=128, samples=16)
# What a ground's size may change, mean over a picture. Textures are as coarse as their polygons
# are large: on a ground of 10 coarser than where they are fitted to the box's shadow. Maps of a
# sphere light look towards the middle of the scene, and their texels are turned with it.
# Measured: 0.0027, 0.0008 and 0.0051.
MEAN = {"accumulation": 5e-3, "convolution": 3e-3, "ssoc": 6e-3}


def _tilt(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _light(kind, center, turn, size=0.8):
    if kind == "sphere":
        return ss.SphereLight(center, size / 2)
    return ss.RectLight(center, turn @ (0, size, 0), turn @ (size, 0, 0))


def _ground(size, thickness=0.0):
    if thickness:
        mesh = box(size=(2 * size, 2 * size, thickness), center=(0, 0, -thickness / 2), turn_deg=0)
        return np.asarray(mesh.vertices), np.asarray(mesh.faces)
    return quad((0, 0, 0), (2 * size, 0, 0), (0, 2 * size, 0))


def _scene(size, kind="rect", at=(0.0, 0.0), angle=0.0, thickness=0.0, standing=True):
    """A box on a ground of half size `size`, with a light and a camera near it, all turned."""
    turn, move = _tilt(angle), np.array([*at, 0.0])
    scene = ss.Scene()
    vertices, faces = _ground(size, thickness)
    scene.add((vertices @ turn.T, faces), "ground")
    if standing:
        body = box(size=(1, 1, 1), center=(0, 0, 0.7), turn_deg=0)
        scene.add(((np.asarray(body.vertices) + move) @ turn.T, np.asarray(body.faces)), "box")
    light = _light(kind, turn @ np.add(move, (0.7, 0, 4)), turn)
    eye, target = turn @ np.add(move, (-1, -4, 4)), turn @ np.add(move, (-0.3, 0, 0))
    camera = ss.Camera(eye, target, turn @ (0, 0, 1), width=32, height=32)
    grid = np.linspace(-2, 2, 9)
    points = np.array([(x, y, 0) for x in grid for y in grid]) + move
    normals = np.tile(turn @ (0, 0, 1), (len(points), 1))
    return scene, camera, light, points @ turn.T, normals


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("kind", ["rect", "sphere"])
@pytest.mark.parametrize("size", [1e4, 1e6, 1e9])
def test_nothing_stands_on_the_ground(size, kind, name):
    scene, camera, light, points, normals = _scene(size, kind, standing=False)
    image = ss.render(scene, camera, light, METHODS[name])
    assert image.mask.all()
    assert np.all(image.visibility == 1)
    if name in AT_POINTS:
        assert np.all(ss.visibility(scene, points, normals, light, METHODS[name]) == 1)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize(("kind", "size"), [("sphere", 1e4), ("rect", 1e8), ("sphere", 1e8)])
@pytest.mark.parametrize("where", ["middle", "off"])
def test_a_box_casts_as_on_a_small_ground(where, kind, size, name):
    at = (0.0, 0.0) if where == "middle" else (0.3 * size, -0.2 * size)
    scene, camera, light, points, normals = _scene(size, kind, at)
    near = _scene(10.0, kind)
    method = METHODS[name]
    image, expected = ss.render(scene, camera, light, method), ss.render(*near[:3], method)
    error = np.abs(image.visibility - expected.visibility)
    assert error.mean() <= MEAN.get(name, 5e-4), (error.mean(), error.max())
    if name in AT_POINTS:
        found = ss.visibility(scene, points, normals, light, method)
        error = np.abs(found - ss.visibility(near[0], *near[3:], near[2], method))
        assert error.mean() <= MEAN.get(name, 5e-4), error.mean()


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("thickness", [4.0, 1e7])
def test_a_box_casts_on_a_slab(thickness, name):
    size = 1e6 if thickness == 4.0 else 1e8
    scene, camera, light, points, normals = _scene(size, thickness=thickness)
    thin = _scene(size)
    method = METHODS[name]
    image, expected = ss.render(scene, camera, light, method), ss.render(*thin[:3], method)
    # Only the top of the slab is seen.
    error = np.abs(image.visibility - expected.visibility)
    assert error.mean() <= 1e-3, (error.mean(), error.max())
    if name in AT_POINTS:
        found = ss.visibility(scene, points, normals, light, method)
        error = np.abs(found - ss.visibility(thin[0], *thin[3:], thin[2], method))
        assert error.mean() <= 1e-3, error.mean()


@pytest.mark.parametrize("name", METHODS)
def test_a_tilted_ground(name):
    # Rounding moves the ground by up to 6e-8 of its size: by a thousandth of the box.
    scene, camera, light, points, normals = _scene(1e4, angle=0.4)
    near = _scene(10.0, angle=0.4)
    method = METHODS[name]
    image, expected = ss.render(scene, camera, light, method), ss.render(*near[:3], method)
    error = np.abs(image.visibility - expected.visibility)
    assert error.mean() <= 2 * MEAN.get(name, 5e-4), (error.mean(), error.max())
    if name in AT_POINTS:
        found = ss.visibility(scene, points, normals, light, method)
        error = np.abs(found - ss.visibility(near[0], *near[3:], near[2], method))
        assert error.mean() <= 2e-3, error.mean()


def test_what_single_precision_cannot_hold_is_an_error():
    scene, camera, light, *_ = _scene(1e8, angle=0.4)
    with pytest.raises(ss.SceneError, match=r"mesh \"ground\".*moves its surface"):
        ss.render(scene, camera, light, "ray_traced")

    scene = ss.Scene()
    scene.add(box(size=(1, 1, 1), center=(0, 0, 0)), "near")
    scene.add(box(size=(1, 1, 1), center=(1e9, 0.3, 0.1)), "far")
    with pytest.raises(ss.SceneError, match=r"mesh .*moves its vertices"):
        ss.render(scene, camera, light, "ray_traced")


def test_a_lamp_far_from_all_that_is_small_is_an_error():
    scene, camera, *_ = _scene(1e9)
    lamp = ss.SphereLight((5e8, 0.3, 4), 0.2)
    with pytest.raises(ss.ParameterError, match="light"):
        ss.render(scene, camera, lamp, "hard")


def test_a_light_too_small_for_its_scene_is_an_error():
    scene, camera, light, *_ = _scene(1e13, standing=False)
    with pytest.raises(ss.ParameterError, match="light"):
        ss.render(scene, camera, light, "ray_traced")


def test_slivers_and_specks_are_no_core():
    """Normal input: triangles without area, and one of a millionth of the scene."""
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), "ground")
    specks = np.array([(0, 0, 1), (1e-13, 0, 1), (0, 1e-13, 1), (1, 1, 1), (1, 1, 1 + 1e-6)])
    scene.add((specks, [(0, 1, 2), (3, 3, 3), (3, 4, 3), (0, 0, 4)]), "specks")
    camera = ss.Camera((0.4, -3, 2), (0, 0, 0), width=32, height=32)
    light = ss.SphereLight((0.3, 0.2, 3), 0.3)
    for method in ("hard", "ray_traced", "wedges", "slsm"):
        image = ss.render(scene, camera, light, method)
        assert image.visibility[image.mask].mean() > 0.99
