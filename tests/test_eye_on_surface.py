"""An eye on what casts sees the shadows that it sees from a hair's breadth beside it."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from penumbrae import box
from shapes import quad

LIGHT = np.array((0.1, -0.2, 3.0))
COUNTED = {
    "shadow_volume": ss.ShadowVolume(),
    "zfail": ss.ShadowVolume(counting="zfail"),
    "wedges": ss.Wedges(),
    "wedges, zfail": ss.Wedges(counting="zfail"),
}


def _rotation(rng):
    q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return q * np.sign(np.linalg.det(q))


def _eyes(mesh, light):
    """Points on a mesh, in the planes of its triangles and of the shadow's sides."""
    vertices, faces = mesh
    for a, b, c in vertices[faces[[0, len(faces) // 2, -1]]]:
        yield "face", 0.2 * a + 0.3 * b + 0.5 * c
        yield "edge", 0.3 * a + 0.7 * b
        yield "middle of an edge", 0.5 * a + 0.5 * b
        yield "vertex", a
        yield "plane", 2 * a - 0.5 * b - 0.5 * c
        yield "line of an edge", 1.8 * a - 0.8 * b
        for part in (0.8, 1.2):
            yield "side", light + part * (0.3 * a + 0.7 * b - light)


@pytest.mark.parametrize("name", ["shadow_volume", "zfail"])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("caster", ["box", "board"])
def test_hard_shadows_are_those_of_rays(caster, turned, name):
    rng = np.random.default_rng(3)
    turn = _rotation(rng) if turned else np.eye(3)
    light = turn @ LIGHT
    point = ss.SphereLight(light, 0.0)
    high = box(turn_deg=20.0) if caster == "box" else quad((0, 0, 0.75), (1, 0, 0), (0, 1, 0))
    high = (high.vertices, high.faces) if caster == "box" else high
    meshes = [(np.asarray(v) @ turn.T, f) for v, f in (quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), high)]
    scene = ss.Scene()
    for mesh in meshes:
        scene.add(mesh)
    for mesh in meshes:
        for where, eye in _eyes(mesh, light):
            for nudge in (0.0, 1e-12, -1e-9):
                target = turn @ rng.uniform((-0.7, -0.7, 0), (0.7, 0.7, 0.5))
                at = eye + nudge * rng.normal(size=3)
                up = rng.normal(size=3)
                camera = ss.Camera(at, target, up, fov_y_deg=75, width=32, height=32)
                rays = ss.render(scene, camera, point, "hard")
                image = ss.render(scene, camera, point, COUNTED[name])
                wrong = np.abs(image.visibility - rays.visibility)[rays.mask] > 0.5
                # Both decide exactly, but shadow borders and surfaces seen edge-on each in its own
                # way: one pixel in a hundred. A wrong count of layers is wrong over whole surfaces.
                assert wrong.sum() <= max(0.02 * wrong.size, 2), (where, nudge, wrong.mean())


@pytest.mark.parametrize("name", COUNTED)
@pytest.mark.parametrize("height", [0.0, 1e-15, -1e-15, 1e-9, -1e-9, 1e-7])
def test_along_the_ground(height, name):
    """The ground is seen edge-on or not at all; the box is lit from above and dark below."""
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)))
    scene.add(box(turn_deg=20.0))
    light = ss.RectLight(LIGHT, (0, 0.4, 0), (0.4, 0, 0))
    for eye, target in [((0.3, -1.5, height), (0, 0, height)), ((1.2, 0.9, height), (0, 0, 0.6))]:
        camera = ss.Camera(eye, target, width=48, height=48)
        traced = ss.render(scene, camera, light, ss.RayTraced(samples=64))
        image = ss.render(scene, camera, light, COUNTED[name])
        seen = traced.mask & (traced.position[..., 2] > 1e-3)
        assert seen.sum() > 100
        # No penumbra falls on the box: what differs is noise at the border of its own shadow.
        error = np.abs(image.visibility - traced.visibility)[seen]
        assert error.mean() < 0.01, error.mean()
