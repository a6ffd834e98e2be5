"""Shadow volumes are hard shadows, and what all of `wedges` tends to for a small light."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from penumbrae import CAMERA, CENTER, ball, box, lights, over_ground, torus
from scipy import ndimage
from shapes import bumpy, quad

POINT = ss.SphereLight(CENTER, 0.0)

SETTINGS = {
    "light": ss.Wedges(),
    "line": ss.Wedges(falloff="line"),
    "linear": ss.Wedges(falloff="linear"),
    "smooth": ss.Wedges(falloff="smooth"),
    "add": ss.Wedges(overlap="add"),
    "minimum": ss.Wedges(overlap="minimum"),
    "integer": ss.Wedges(buffer="integer"),
    "zfail": ss.Wedges(counting="zfail"),
    "line, zfail": ss.Wedges(falloff="line", counting="zfail"),
    "no extra wedges": ss.Wedges(falloff="line", vertex_angle=180),
    "many extra wedges": ss.Wedges(falloff="line", vertex_angle=5),
    "paper planes": ss.Wedges(falloff="linear", planes="paper"),
    "fan": ss.Wedges(quads=8),
}


def _body(n=12):
    vertices, faces = bumpy(n, seed=4)
    return vertices * 0.35 + [0, 0, 0.7], faces


def _boxes():
    """Boxes that stand on the ground and on each other."""
    rng = np.random.default_rng(5)
    boxes = []
    for _ in range(12):
        x, y = rng.integers(-3, 4, 2) * 0.25
        tall = rng.integers(1, 5) * 0.125
        boxes.append(box((0.25, 0.25, tall), (x, y, tall / 2), 0))
    return boxes


SCENES = {
    "body": lambda: over_ground(_body()),
    "ball and torus": lambda: over_ground(ball((-0.4, 0.2, 0.5)), torus((0.3, -0.2, 0.7))),
    "boxes": lambda: over_ground(*_boxes()),
    "sheets": lambda: over_ground(
        quad((0, 0, 0.5), (0.7, 0, 0.2), (0, 0.5, 0.1)),
        quad((0.2, 0, 0.8), (0.3, 0, 0), (0, 0, 0.4)),
    ),
}

VIEWS = {
    "lit": CAMERA,
    # In the shadow that body, ball and boxes cast on the ground, looking up and around.
    "in shadow": ss.Camera((-0.17, 0.1, 0.05), (-0.1, 1.0, 0.3), fov_y_deg=90, width=72, height=64),
    "from above": ss.Camera((0.4, -0.2, 2.6), (0, 0.1, 0), fov_y_deg=40, width=72, height=64),
}


def _crossed(visibility, mask):
    """Pixels with an edge of the shadow, or of the mask, between them and a neighbour."""
    values = np.where(mask, visibility, 2.0)
    return ndimage.maximum_filter(values, 3) != ndimage.minimum_filter(values, 3)


def _assert_hard(scene, camera, light=POINT, most=3):
    expected = ss.render(scene, camera, light, "hard")
    crossed = _crossed(expected.visibility, expected.mask)
    for counting in ("zpass", "zfail"):
        image = ss.render(scene, camera, light, ss.ShadowVolume(counting))
        different = image.visibility != expected.visibility
        assert not (different & ~crossed).any(), (counting, np.argwhere(different & ~crossed)[:5])
        # Both look at the same receivers; those within rounding of the shadow's edge may differ.
        assert different.sum() <= most, counting
    return expected


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("name", SCENES)
def test_a_shadow_volume_is_the_hard_shadow(name, view):
    image = _assert_hard(SCENES[name](), VIEWS[view])
    if view != "in shadow":
        assert 0.02 < (image.visibility[image.mask] == 0).mean() < 0.9


@pytest.mark.parametrize("name", SCENES)
def test_a_shadow_volume_is_the_limit_of_small_lights(name):
    scene = SCENES[name]()
    light = ss.SphereLight(CENTER, 1e-5)
    reference = ss.render(scene, CAMERA, light, ss.RayTraced(64))
    image = ss.render(scene, CAMERA, POINT, "shadow_volume")
    crossed = _crossed(reference.visibility, reference.mask)
    assert np.array_equal(image.visibility[~crossed], reference.visibility[~crossed])


def test_the_viewer_may_be_inside_an_occluder():
    # Not 1 wide: the light would lie in the plane of a side.
    scene = over_ground(box((0.9, 1, 1), (0, 0, 0.5), 0), ball((1.0, 0.5, 0.4)))
    inside = ss.Camera((0.1, 0.05, 0.6), (1.0, 0.5, 0.3), fov_y_deg=80, width=64, height=64)
    image = _assert_hard(scene, inside)
    assert (image.visibility[image.mask] == 0).all()
    # A box without a lid: the light falls in.
    lidless = box((0.9, 1, 1), (0, 0, 0.5), 0)
    lidless.update_faces(lidless.face_normals[:, 2] < 0.5)
    image = _assert_hard(over_ground(lidless, ball((1.0, 0.5, 0.4))), inside)
    assert 0.1 < (image.visibility[image.mask] == 0).mean() < 0.95


@pytest.mark.parametrize("counting", ["zpass", "zfail"])
def test_the_viewer_is_in_the_dark_or_in_a_box_with_the_light(counting):
    sealed = over_ground(box((0.6, 0.6, 0.6), CENTER))
    for method in (
        ss.ShadowVolume(counting),
        ss.Wedges(counting=counting),
        ss.Wedges(falloff="line", counting=counting),
        ss.Wedges(quads=16, counting=counting),
    ):
        for light in (POINT, *lights(0.2).values()):
            image = ss.render(sealed, CAMERA, light, method)
            ground = image.mask & (image.mesh_id == 0)
            assert ground.any()
            assert (image.visibility[ground] == 0).all()


@pytest.mark.parametrize("z", [0.5, 1.25, 2.0, 3.5])
def test_the_eye_lies_exactly_in_the_plane_of_a_quad(z):
    # The light at (0, 0, 2) and the box's upper edges at x = ±1/4, z = 1/2 span the planes
    # |x| = (2 - z) / 6, and all numbers are dyadic but the last step's sixth.
    light = ss.SphereLight((0, 0, 2), 0)
    scene = over_ground(box((0.5, 0.5, 0.25), (0, 0, 0.375), 0))
    eye = ((2 - z) / 6, -3, z)
    camera = ss.Camera(eye, (0, 0, 0.3), fov_y_deg=40, width=64, height=64)
    _assert_hard(scene, camera, light, most=40)


@pytest.mark.parametrize("distance", [1e-2, 1e-3, 1e-4, 1e-5])
def test_an_edge_may_span_nearly_half_a_turn(distance):
    # Quads that ended at a distance, however far, would end within the scene.
    wall = quad((0, 0.5, 0.5), (1, 0, 0), (0, 0, 0.5))
    light = ss.SphereLight((0.01, 0.5 - distance, 0.75 - distance / 2), 0)
    camera = ss.Camera((0.3, -2.4, 1.9), (0, 0.1, 0.15), fov_y_deg=60, width=80, height=64)
    image = _assert_hard(over_ground(wall), camera, light)
    assert (image.visibility == 0).sum() > 700


@pytest.mark.parametrize("setting", SETTINGS)
@pytest.mark.parametrize("kind", ["disk", "sphere"])
def test_without_size_every_setting_is_the_shadow_volume_to_the_bit(setting, kind):
    light = POINT if kind == "sphere" else ss.DiskLight(CENTER, (0.1, 0, -1), 0)
    for name in ("body", "sheets"):
        scene = SCENES[name]()
        method = SETTINGS[setting]
        volume = ss.ShadowVolume(method.counting)
        for view in VIEWS.values():
            one, two = (ss.render(scene, view, light, m).visibility for m in (method, volume))
            assert np.array_equal(one, two)


@pytest.mark.parametrize("setting", SETTINGS)
@pytest.mark.parametrize("kind", lights())
def test_every_setting_tends_to_the_shadow_volume(setting, kind):
    scene = over_ground(_body(8))
    volume = ss.render(scene, CAMERA, POINT, "shadow_volume")
    apart = []
    for size in (0.2, 0.02, 0.002, 2e-4):
        image = ss.render(scene, CAMERA, lights(size)[kind], SETTINGS[setting])
        apart.append(np.abs(image.visibility - volume.visibility)[image.mask].mean())
    # Penumbrae are as wide as the light, and so is what differs: a tenth for a tenth of the size,
    # until the penumbra is narrower than a pixel and a few single pixels decide.
    assert apart[1] < 0.3 * apart[0]
    assert apart[2] < 0.3 * apart[1]
    assert apart[3] < 4e-4


def test_a_penumbra_narrower_than_a_pixel_touches_only_pixels_at_the_edge():
    scene = SCENES["ball and torus"]()
    volume = ss.render(scene, CAMERA, POINT, "shadow_volume")
    crossed = _crossed(volume.visibility, volume.mask)
    for light in lights(1e-3).values():
        for setting in ("light", "line", "fan"):
            image = ss.render(scene, CAMERA, light, SETTINGS[setting])
            away = np.abs(image.visibility - volume.visibility)[~crossed & (volume.mesh_id == 0)]
            assert away.max() == 0, setting
