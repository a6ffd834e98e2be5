"""Radiance of `ray_traced` against Mitsuba, pixel by pixel, and the bridge itself.

Everything runs in ``scalar_rgb``: the LLVM variants need an LLVM library that fits the machine.
benches/mitsuba_agreement.py is the long version, with pictures.
"""

from __future__ import annotations

import os
import sys

import fresh
import numpy as np
import pytest
import softshadow as ss
from softshadow import scenes

if not os.environ.get("CI"):
    pytest.importorskip("mitsuba", reason="the optional extra")

import mitsuba as mi

SEEDS = 4
"""Renders of ours that its own variance is taken from."""


def build(model: str, size: int, light: str = "rect", **options) -> scenes.Setup:
    """Return a setup; without CI in the environment, skip where its model is not installed."""
    try:
        if model == "bunny":
            return scenes.bunny_on_plane(size, size, light=light, **options)
        if model == "solids":
            return scenes.closed_solids(size, size, light=light, **options)
        return scenes.city(model, size, size, light=light, **options)
    except FileNotFoundError as error:
        if os.environ.get("CI"):
            raise
        pytest.skip(str(error))


def ours(setup: scenes.Setup, samples: int) -> tuple[ss.Image, np.ndarray, np.ndarray]:
    """Return one image, the mean radiance over the seeds and the variance of that mean."""
    images = [
        ss.render(setup.scene, setup.camera, setup.light, ss.RayTraced(samples=samples, seed=seed))
        for seed in range(SEEDS)
    ]
    radiance = np.array([image.radiance for image in images], dtype=np.float64)
    return images[0], radiance.mean(axis=0), radiance.var(axis=0, ddof=1) / SEEDS


def test_importing_the_bridge_does_not_import_mitsuba():
    code = "import sys, softshadow.mitsuba; sys.exit('mitsuba' in sys.modules)"
    assert fresh.run(code).returncode == 0


def test_missing_mitsuba_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    setup = scenes.half_plane(8, 8)
    with pytest.raises(ImportError, match=r'pip install "softshadow\[mitsuba\]"'):
        ss.mitsuba.scene_dict(setup.scene, setup.camera, setup.light)


def test_scene_dict_has_all_that_is_documented():
    mi.set_variant("scalar_rgb")
    setup = scenes.closed_solids(32, 24, detail=1)
    setup.scene.add_spheres([[0, 0, 1], [0, 0, 2]], 0.1)
    description = ss.mitsuba.scene_dict(setup.scene, setup.camera, setup.light, samples=9)
    meshes = len(setup.scene.meshes)
    assert set(description) == {
        *("type", "integrator", "sensor", "light", f"entry_{meshes}_0", f"entry_{meshes}_1"),
        *(f"entry_{i}" for i in range(meshes)),
    }
    assert description["integrator"] == {
        **{"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
        "hide_emitters": True,
    }
    assert description["sensor"]["fov_axis"] == "y"
    assert description["sensor"]["sampler"] == {"type": "independent", "sample_count": 9}
    assert mi.render(mi.load_dict(description)).shape == (24, 32, 4)


def test_opacity_below_one_takes_volpath():
    setup = scenes.tilted_sheet(8, 8)
    description = ss.mitsuba.scene_dict(setup.scene, setup.camera, setup.light)
    assert description["integrator"]["type"] == "volpath"


@pytest.mark.parametrize("shift", [(0, 0), (5, -3)], ids=["centred", "shifted principal point"])
def test_sensor_sees_along_our_rays(shift):
    mi.set_variant("scalar_rgb")
    setup = scenes.closed_solids(48, 40, detail=1)
    K = setup.camera.K.copy()
    K[:2, 2] += shift
    camera = ss.Camera.from_matrix(K, setup.camera.camera_to_world, 48, 40)
    description = ss.mitsuba.scene_dict(setup.scene, camera, setup.light)
    sensor = mi.load_dict(description).sensors()[0]
    expected = camera.rays()
    for y, x in [(0, 0), (0, 47), (39, 0), (39, 47), (17, 31)]:
        ray, _ = sensor.sample_ray(0, 0, [(x + 0.5) / 48, (y + 0.5) / 40], [0, 0])
        # Measured: 1.7e-7; directions are in single precision.
        assert np.abs(np.array(ray.d) - expected[y, x]).max() < 1e-6


@pytest.mark.parametrize("flag", ["casts", "receives"])
def test_flags_that_mitsuba_lacks_are_errors(flag):
    setup = scenes.half_plane(8, 8)
    setup.scene.add(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), name="card", **{flag: False})
    with pytest.raises(ValueError, match=f"mesh 'card': Mitsuba cannot express {flag}=False"):
        ss.mitsuba.scene_dict(setup.scene, setup.camera, setup.light)


@pytest.mark.parametrize(("entry", "value"), [((0, 1), 0.5), ((0, 0), 99.0)], ids=["skew", "fx"])
def test_pinhole_matrices_that_mitsuba_lacks_are_errors(entry, value):
    setup = scenes.half_plane(8, 8)
    K = setup.camera.K.copy()
    K[entry] = value
    camera = ss.Camera.from_matrix(K, setup.camera.camera_to_world, 8, 8)
    with pytest.raises(ValueError, match="one focal length and no skew"):
        ss.mitsuba.scene_dict(setup.scene, camera, setup.light)


def test_lights_without_size_and_empty_scenes_are_errors():
    setup = scenes.half_plane(8, 8)
    with pytest.raises(ValueError, match=r"SphereLight\.radius: Mitsuba's area lights need a size"):
        ss.mitsuba.scene_dict(setup.scene, setup.camera, ss.SphereLight((0, 0, 1), 0.0))
    with pytest.raises(ValueError, match="no meshes"):
        ss.mitsuba.scene_dict(ss.Scene(), setup.camera, setup.light)
    with pytest.raises(ValueError, match="at least 2"):
        ss.mitsuba.render(setup.scene, setup.camera, setup.light, samples=1)


def test_render_restores_the_variant():
    mi.set_variant("scalar_spectral")
    setup = scenes.half_plane(4, 4)
    ss.mitsuba.render(setup.scene, setup.camera, setup.light, samples=2, variant="scalar_rgb")
    assert mi.variant() == "scalar_spectral"
    with pytest.raises(ValueError, match="ends in _rgb or _mono, got 'scalar_spectral'"):
        ss.mitsuba.render(setup.scene, setup.camera, setup.light)
    mi.set_variant("scalar_rgb")


def test_film_and_centre_rays_agree_where_the_picture_is_smooth():
    setup = scenes.tilted_sheet(24, 24, sheets=0)
    film, centre = (
        ss.mitsuba.render(setup.scene, setup.camera, setup.light, 256, centre_rays=flag)
        for flag in (False, True)
    )
    inner = np.zeros_like(film.mask)
    inner[12:] = True
    # A footprint's mean differs from its centre by the curvature of the picture, within the noise.
    test = ss.mitsuba.z_test(film.radiance, centre, film.variance, inner)
    assert test.passed
    assert abs(test.mean_z) < 4


def test_z_test_accepts_its_own_mean_and_rejects_a_bias():
    generator = np.random.default_rng(7)
    samples = generator.normal(1.0, 0.1, (32, 64, 64, 1)).repeat(3, axis=-1)
    mean, variance = samples.mean(axis=0), samples.var(axis=0, ddof=1) / 32
    mask = np.ones((64, 64), dtype=bool)
    truth = np.ones((64, 64, 3))
    noisy = ss.mitsuba.MitsubaImage(mean, variance, mask, truth.astype(np.float32), 32, 32, 0.0)
    test = ss.mitsuba.z_test(truth, noisy)
    assert test.passed
    assert abs(test.mean_z) < 3
    assert test.pixels == 64 * 64
    # One pixel off by 12 standard errors fails alone; all pixels off by one are seen in the mean.
    spot = truth.copy()
    spot[3, 4] += 12 * 0.1 / np.sqrt(32)
    test = ss.mitsuba.z_test(spot, noisy)
    assert test.failures == 1
    assert np.unravel_index(test.z.argmax(), test.z.shape) == (3, 4)
    assert ss.mitsuba.z_test(truth + 0.1 / np.sqrt(32), noisy).mean_z > 50


def test_sidak_makes_the_joint_level():
    assert ss.mitsuba.sidak(0.05, 1) == pytest.approx(0.05)
    each = ss.mitsuba.sidak(0.05, 10_000)
    assert 1 - (1 - each) ** 10_000 == pytest.approx(0.05)


LIGHTS = {
    "parallelogram": ss.RectLight((0.2, 0.1, 1), (0.6, 0, 0), (0.3, -0.5, 0.2), (3, 2, 1)),
    "disk": ss.DiskLight((0, 0, 1), (0.3, 0, -1), 0.4, (3, 2, 1)),
    "sphere": ss.SphereLight((0.1, 0, 1), 0.3, (3, 2, 1)),
}


@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
def test_unshadowed_light_is_the_closed_form(light):
    """Emitting side, size and radiance of every light, and that the camera does not see it."""
    setup = scenes.tilted_sheet(40, 40, sheets=0)
    camera = ss.Camera((0.3, -0.8, 2.2), (0, 0, 0), width=40, height=40)
    closed = ss.render(setup.scene, camera, light, "hard").radiance
    theirs = ss.mitsuba.render(setup.scene, camera, light, samples=512)
    test = ss.mitsuba.z_test(closed, theirs)
    assert test.passed
    assert abs(test.mean_z) < 4


def test_several_lights_are_summed():
    setup = scenes.tilted_sheet(16, 16, sheets=0)
    lights = list(LIGHTS.values())
    closed = ss.render(setup.scene, setup.camera, lights, "hard").radiance
    theirs = ss.mitsuba.render(setup.scene, setup.camera, lights, samples=256)
    assert ss.mitsuba.z_test(closed, theirs).passed


LARGEST = 0.04
"""Largest deviation of an unmasked pixel, over the largest unshadowed radiance of the picture, our
receivers where they are. Measured: 0.019 (bunny), 0.029 (Munich), 0.022 (solids), 0.016 (opacity).
It is Mitsuba's noise: at 1024 samples the standard error of a half-lit pixel is 0.016 of its
unshadowed radiance, and the largest of 8000 is four of them, on receivers that get half of the
largest. With 4096 samples (benches/mitsuba_agreement.py) it halves."""

CONTACT = 0.05
"""Share of pixels in contact. Measured: 0.033 (Munich, whose houses are 100 ray offsets high),
0.008 and less elsewhere."""

EDGE = 0.005
"""Share of pixels that see another face. Measured: at most one pixel."""


def agreement(setup: scenes.Setup, samples: int) -> None:
    """Assert that no pixel fails the z-test, and nor does the mean of all.

    Our receivers are compared as Mitsuba sees them, lifted by its ray offset. Masked are contact
    pixels, where that makes a difference of more than 2 % (see `softshadow.mitsuba.RayOffset`),
    pixels on an edge of which single precision sees the other face, and, with opacities, pixels
    whose first surface lets Mitsuba's camera see what is behind.
    """
    image, radiance, variance = ours(setup, samples=256)
    theirs = ss.mitsuba.render(setup.scene, setup.camera, setup.light, samples)
    full = ss.mitsuba.unshadowed(setup.scene, setup.camera, setup.light)
    offset = ss.mitsuba.ray_offset(setup.scene, image, setup.light)
    edge = (image.mask != theirs.mask) | (np.abs(image.normal - theirs.normal).max(axis=-1) > 1e-3)
    opaque = [i for i, entry in enumerate(setup.scene.entries) if entry.opacity == 1]
    mask = image.mask & np.isin(image.mesh_id, opaque) & ~offset.contact & ~edge
    lifted = offset.lift(radiance, full)
    test = ss.mitsuba.z_test(lifted, theirs, variance, mask, unshadowed=full)
    raw = np.abs(radiance - theirs.radiance)[mask].max() / full.max()
    figures = (
        f"{test.failures} of {test.pixels} pixels fail, largest z {np.abs(test.z).max():.2f}, "
        f"mean z {test.mean_z:.2f}, largest deviation {raw:.4f} of the maximum, "
        f"{np.count_nonzero(offset.contact)} in contact, {np.count_nonzero(edge)} on edges"
    )
    print(figures)
    assert test.passed, figures
    assert abs(test.mean_z) < 4, figures
    assert np.count_nonzero(offset.contact) < CONTACT * image.mask.sum(), figures
    assert np.count_nonzero(edge) < EDGE * image.mask.sum(), figures
    assert raw < LARGEST, figures


# Every light on the solids, and one or two on each model; the other pairs take as long again.
PAIRS = [
    *(("solids", light) for light in ("rect", "disk", "sphere")),
    *(("bunny", "rect"), ("munich", "rect"), ("munich", "sphere")),
    *(
        pytest.param(*pair, marks=pytest.mark.slow)
        for pair in (("bunny", "disk"), ("bunny", "sphere"), ("munich", "disk"))
    ),
]


@pytest.mark.parametrize(("model", "light"), PAIRS)
def test_radiance_agrees_with_mitsuba(model, light):
    agreement(build(model, 96, light), samples=1024)


@pytest.mark.parametrize("light", ["rect", "sphere"])
def test_transparent_shadows_agree_with_volpath(light):
    agreement(build("solids", 40, light, opacity=0.5, detail=3), samples=512)
