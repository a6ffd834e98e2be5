"""`counted` where an error is allowed: what is interpolated, and what must not be lost by it."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from bits import digest, with_threads
from shapes import body_and_leaves, geodesic, quad

SIZE = 128
"""Pixels along a side: 256 groups, of which 64 are counted in full first."""

CAMERA = ss.Camera((0.4, -3.0, 1.8), (0, 0.1, 0.3), fov_y_deg=38, width=SIZE, height=SIZE)
ABOVE = ss.Camera((0, -0.1, 3), (0, 0, 0), fov_y_deg=40, width=SIZE, height=SIZE)
LIGHTS = {
    "rect": ss.RectLight((0.5, -0.3, 2.0), (0.1, 0.8, 0.1), (0.8, -0.1, 0.2)),
    "disk": ss.DiskLight((-0.7, 0.2, 1.8), (0.4, -0.1, -1), 0.4),
    "sphere": ss.SphereLight((0.4, 0.5, 1.9), 0.35),
}
NARROW = ss.RectLight((0.1, 0, 2), (0, 0.1, 0), (0.1, 0, 0))
GROUND = quad((0, 0, 0), (5, 0, 0), (0, 5, 0))


def _wires(angle, radius=0.006):
    """Nine wires over a ground, all in one direction."""
    found = ss.Scene()
    found.add(GROUND, "ground")
    along = np.array([np.cos(angle), np.sin(angle), 0])
    across = np.array([-along[1], along[0], 0])
    middles = across * np.linspace(-0.8, 0.8, 9)[:, None] + [0, 0, 0.1]
    ends = np.stack([middles - 2 * along, middles + 2 * along], 1).reshape(-1, 3)
    found.add_curves(ends, 2 * np.arange(10), radius)
    return found


def _poles():
    """Thirty poles that stand on a ground, each a pixel or two wide."""
    found = ss.Scene()
    found.add(GROUND, "ground")
    feet = np.random.default_rng(5).uniform((-0.9, -0.9, 0), (0.9, 0.9, 0), (30, 3))
    ends = np.stack([feet, np.add(feet, (0, 0, 0.5))], 1).reshape(-1, 3)
    found.add_curves(ends, 2 * np.arange(31), 0.01)
    return found


SCENES = {"bodies": body_and_leaves(), "wires": _wires(0.3), "poles": _poles()}


def _off(image, full):
    return (image.visibility.astype(np.float64) - full.visibility)[full.mask]


def _rms(image, full):
    return float(np.sqrt((_off(image, full) ** 2).mean()))


@pytest.fixture(scope="module")
def counted():
    """Pictures in which every pixel is counted, by scene and light."""
    return {
        (name, light): ss.render(scene, CAMERA, LIGHTS[light], "counted")
        for name, scene in SCENES.items()
        for light in LIGHTS
    }


@pytest.mark.parametrize("error", [0.02, 0.01, 0.004])
@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("name", SCENES)
def test_the_error_that_is_asked_for_is_kept(counted, name, light, error):
    image = ss.render(SCENES[name], CAMERA, LIGHTS[light], ss.Counted(error=error))
    full = counted[name, light]
    assert _rms(image, full) < error  # measured up to 0.68 of it
    assert abs(_off(image, full).mean()) < 0.1 * error
    # What is left of the light is interpolated for irradiance, too.
    off = (image.radiance - full.radiance)[full.mask] / full.radiance[full.mask].max()
    assert np.sqrt((off.astype(np.float64) ** 2).mean()) < error


@pytest.mark.parametrize("light", LIGHTS)
def test_smooth_shadows_are_interpolated(light):
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    vertices, faces = geodesic(6)
    scene.add((vertices * 0.4 + [0, 0, 1.0], faces), "ball")
    full = ss.render(scene, CAMERA, LIGHTS[light], "counted")
    image = ss.render(scene, CAMERA, LIGHTS[light], ss.Counted(error=0.01))
    partly = (full.visibility > 0.01) & (full.visibility < 0.99) & (full.mesh_id == 0)
    assert partly.mean() > 0.05
    # Counted themselves: measured 0.40 to 0.44, with a quarter of the groups as pilots.
    assert (image.visibility == full.visibility)[partly].mean() < 0.5


@pytest.mark.parametrize("degrees", [0, 1, 7, 30, 45, 60, 88, 90])
@pytest.mark.parametrize("error", [0.02, 0.005])
def test_thin_wires_keep_their_shadows(degrees, error):
    scene = _wires(np.radians(degrees))
    full = ss.render(scene, ABOVE, NARROW, "counted")
    image = ss.render(scene, ABOVE, NARROW, ss.Counted(error=error))
    assert _rms(image, full) < 0.5 * error  # measured 0.19
    shadow = (full.visibility < 0.8) & (full.mesh_id == 0)
    assert shadow.mean() > 0.01
    lost = _off(image, full)[shadow[full.mask]]
    assert lost.mean() < 0.0005  # measured 0.0002
    assert (lost > 0.1).mean() < 0.0025  # measured 0.0013


@pytest.mark.parametrize("light", LIGHTS)
def test_contact_shadows_of_poles_stay(counted, light):
    full = counted["poles", light]
    image = ss.render(SCENES["poles"], CAMERA, LIGHTS[light], ss.Counted(error=0.01))
    deep = full.visibility < 0.7
    # Measured 0.0003.
    assert abs((image.visibility - full.visibility)[deep & full.mask].mean()) < 0.001


def test_nothing_bleeds_over_the_border_of_a_surface():
    # Two floors side by side, meshes of their own; a roof leaves one of them dark.
    scene = ss.Scene()
    scene.add(quad((-0.5, 0, 0), (1, 0, 0), (0, 2, 0)), "dark")
    scene.add(quad((0.5, 0, 0), (1, 0, 0), (0, 2, 0)), "lit")
    scene.add(quad((-0.5, 0, 1), (1, 0, 0), (0, 2, 0)), "roof")
    light = ss.RectLight((0, 0, 3), (0, 0.05, 0), (0.05, 0, 0))
    camera = ss.Camera((0, -3, 0.6), (0, 0, 0), fov_y_deg=40, width=SIZE, height=SIZE)
    image = ss.render(scene, camera, light, ss.Counted(error=0.03))
    full = ss.render(scene, camera, light, "counted")
    assert set(np.unique(full.mesh_id)) >= {0, 1}
    settled = np.isin(full.visibility, (0, 1)) & full.mask
    # But where a cell is interpolated over the foot of the penumbra, which is a few pixels wide:
    # measured 0.0215.
    assert (image.visibility != full.visibility)[settled].mean() < 0.025
    inside = settled & (np.abs(full.position[..., 0]) < 0.01)
    assert np.array_equal(image.visibility[inside], full.visibility[inside])


@pytest.mark.parametrize("kind", ["translucent", "sphere"])
def test_what_rays_answer_keeps_the_error(kind):
    scene = body_and_leaves()
    if kind == "sphere":
        scene.add_spheres([(0.7, 0.5, 0.6)], [0.2])
    else:
        scene.add(quad((0.7, 0.5, 0.6), (0.4, 0, 0), (0, 0.4, 0)), opacity=0.5)
    for light in LIGHTS.values():
        full = ss.render(scene, CAMERA, light, "counted")
        image = ss.render(scene, CAMERA, light, ss.Counted(error=0.01))
        assert 0 < image.by_rays < full.by_rays
        assert _rms(image, full) < 0.01


def test_what_is_found_does_not_depend_on_the_number_of_threads():
    def bits():
        image = ss.render(SCENES["bodies"], CAMERA, list(LIGHTS.values()), ss.Counted(error=0.02))
        return digest(image.visibility, image.radiance)

    assert len(with_threads(bits, 1, 2, 3)) == 1


def test_points_are_all_counted(counted):
    full = counted["bodies", "rect"]
    points, normals = full.position[full.mask][:500], full.normal[full.mask][:500]
    same = [
        ss.visibility(SCENES["bodies"], points, normals, LIGHTS["rect"], method)
        for method in (ss.Counted(error=0.02), ss.Counted())
    ]
    assert np.array_equal(*same)


@pytest.mark.parametrize("size", [(1, 1), (7, 5), (9, 64), (64, 9)])
def test_pictures_of_any_size(size):
    camera = ss.Camera((0.4, -3.0, 1.8), (0, 0.1, 0.3), fov_y_deg=38, width=size[0], height=size[1])
    full = ss.render(SCENES["bodies"], camera, LIGHTS["rect"], "counted")
    image = ss.render(SCENES["bodies"], camera, LIGHTS["rect"], ss.Counted(error=0.01))
    assert _rms(image, full) < 0.01


def test_an_empty_picture():
    camera = ss.Camera((0, 0, 5), (0, 1, 9), width=16, height=16)
    image = ss.render(SCENES["bodies"], camera, LIGHTS["rect"], ss.Counted(error=0.01))
    assert not image.mask.any()


@pytest.mark.parametrize("error", [0, -0.1, 1.5, float("nan"), 1e-5])
def test_an_error_out_of_range_is_refused(error):
    with pytest.raises(ss.ParameterError, match="error"):
        ss.Counted(error=error)
