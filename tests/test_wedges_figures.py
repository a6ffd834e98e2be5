"""Penumbra wedges against the reference: the paper's figures, closed forms, smoothness."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import softshadow as ss
from penumbrae import CAMERA, alike, ball, box, lights, over_ground, steps, torus
from shapes import bumpy
from softshadow import metrics

REFERENCE = ss.RayTraced(1024, seed=7)
"""Its own mean error in a penumbra is about 0.0015."""

FIGURES = {
    # Mean error and RMSE over the penumbra, then the mean error over the whole mask; the bounds are
    # a quarter above what was measured:
    "two_cylinders": (0.0042, 0.0066, 0.0004),  # 0.00333, 0.00528, 0.00031
    "growing_light": (0.0030, 0.0083, 0.00053),  # 0.00236, 0.00666, 0.00042
    "acute_triangle": (0.0018, 0.0022, 0.0003),  # 0.00138, 0.00175, 0.00023
    # Shadows of both boards where each hides the same part of the light: 0.148 at worst.
    "overlapping_boards": (0.0074, 0.0274, 0.00075),  # 0.00592, 0.02192, 0.00060
    # At worst 0.146, on the logo itself, where its shadow and its own tangent plane cut the light.
    "landscape": (0.0031, 0.0088, 0.00067),  # 0.00242, 0.00703, 0.00053
    "two_lights": (0.0024, 0.0034, 0.00016),  # 0.00188, 0.00267, 0.00012
}


@functools.cache
def _setup(name):
    return getattr(ss.scenes, name)(128, 128)


@functools.cache
def _image(name, method):
    setup = _setup(name)
    return ss.render(setup.scene, setup.camera, setup.lights, method)


def _errors(name, method, reference):
    image = _image(name, method)
    # Of (L, H, W), all lights together.
    mask = np.broadcast_to(image.mask, image.visibility.shape)
    return metrics.errors(image.visibility, reference.visibility, mask)


@pytest.mark.parametrize("name", FIGURES)
def test_the_figures_of_the_paper(name):
    reference = _image(name, REFERENCE)
    error = _errors(name, "wedges", reference)
    mae, rmse, whole = FIGURES[name]
    assert error["penumbra_mae"] < mae
    assert error["penumbra_rmse"] < rmse
    assert error["mae"] < whole
    hard = _errors(name, "hard", reference)
    assert error["penumbra_mae"] < hard["penumbra_mae"] / 20


ACCUMULATED = {
    # Mean difference from accumulation's 1024 points over their penumbra, a quarter above what was
    # measured:
    "two_cylinders": 0.0046,  # 0.00368
    "growing_light": 0.0035,  # 0.00279
    "acute_triangle": 0.0028,  # 0.00224
    "overlapping_boards": 0.0080,  # 0.00642
    "landscape": 0.0039,  # 0.00312
    "two_lights": 0.0029,  # 0.00230
}


# 1024 points on its logo's many triangles take as long as the others together.
LONG = pytest.param("landscape", marks=pytest.mark.slow)


@pytest.mark.parametrize("name", [LONG if n == "landscape" else n for n in ACCUMULATED])
def test_the_figures_of_the_paper_beside_accumulation(name):
    many, few = (_image(name, ss.Accumulation(samples=n)) for n in (1024, 128))
    assert _errors(name, "wedges", many)["penumbra_mae"] < ACCUMULATED[name]
    # The paper finds its pictures "remarkably similar" to 128 points; they are nearer to the truth
    # than those: 0.0014 to 0.0059 against 0.0074 to 0.0144.
    reference = _image(name, REFERENCE)
    mask = np.broadcast_to(few.mask, few.visibility.shape)
    points = metrics.errors(few.visibility, reference.visibility, mask)
    assert _errors(name, "wedges", reference)["penumbra_mae"] < points["penumbra_mae"]


CLOSED = {
    "ball": lambda: over_ground(ball((0, 0, 0.6), 0.35)),
    "box": lambda: over_ground(box((0.6, 0.5, 0.4), (0, 0, 0.6))),
    "torus": lambda: over_ground(torus((0, 0, 0.7))),
    "body": lambda: over_ground(_body()),
    "several": lambda: over_ground(
        ball((-0.5, 0.3, 0.5), 0.2), box((0.3, 0.3, 0.3), (0.4, 0.2, 0.5)), torus((0, -0.3, 0.8))
    ),
}


def _body():
    vertices, faces = bumpy(12, seed=4)
    return vertices * 0.35 + [0, 0, 0.7], faces


@pytest.mark.parametrize("kind", lights())
@pytest.mark.parametrize("name", CLOSED)
def test_closed_occluders_under_lights_of_a_fifth_of_their_distance(name, kind):
    # Light and occluders are 1.4 to 1.6 apart.
    light = lights(0.28)[kind]
    camera = ss.Camera((0.2, -1.4, 1.6), (-0.12, 0.1, 0.15), fov_y_deg=40, width=72, height=64)
    scene = CLOSED[name]()
    reference = ss.render(scene, camera, light, REFERENCE)
    wedges, hard = (
        metrics.errors(
            ss.render(scene, camera, light, m).visibility, reference.visibility, reference.mask
        )
        for m in ("wedges", "hard")
    )
    assert wedges["penumbra_mae"] < 0.05
    assert wedges["penumbra_mae"] < hard["penumbra_mae"] / 5
    # Measured: 0.0021 to 0.0045, of which about 0.0015 are the reference's noise.
    assert wedges["penumbra_mae"] < 0.0056


def test_those_scenes_have_penumbrae_of_15_percent():
    camera = ss.Camera((0.2, -1.4, 1.6), (-0.12, 0.1, 0.15), fov_y_deg=40, width=72, height=64)
    shares = {}
    for name, build in CLOSED.items():
        image = ss.render(build(), camera, lights(0.28)["rect"], REFERENCE)
        shares[name] = metrics.penumbra_mask(image.visibility, where=image.mask).sum() / (
            image.mask.sum()
        )
    assert sum(share > 0.15 for share in shares.values()) >= 3, shares


@pytest.mark.parametrize(("kind", "turn"), [("disk", 0), ("rect", 0), ("rect", 30), ("rect", 45)])
@pytest.mark.parametrize("size", [0.1, 0.4, 1.0])
def test_a_half_plane_is_exact(kind, turn, size):
    setup = ss.scenes.half_plane(96, 96, kind, size, turn_deg=turn)
    image = ss.render(setup.scene, setup.camera, setup.light, "wedges")
    on_receiver = image.mask & (image.mesh_id == 0)
    expected = setup.visibility(image.position[on_receiver])
    assert ((expected > 0) & (expected < 1)).sum() > 100
    error = np.abs(image.visibility[on_receiver] - expected)
    # The area is found in single precision, and the edge reaches over 160 widths of the smallest
    # light: 160 times the rounding of 1, 2e-5, was measured at most.
    assert error.max() < 4e-5


@pytest.mark.parametrize("size", [0.1, 0.4])
def test_a_half_plane_under_a_sphere_is_nearly_exact(size):
    setup = ss.scenes.half_plane(96, 96, "sphere", size)
    image = ss.render(setup.scene, setup.camera, setup.light, "wedges")
    on_receiver = image.mask & (image.mesh_id == 0)
    error = image.visibility[on_receiver] - setup.visibility(image.position[on_receiver])
    # The outline's disk is not its solid angle: they differ by the square of the sphere's angle.
    assert np.abs(error).max() < 0.25 * (size / 2) ** 2


@pytest.mark.parametrize(
    ("falloff", "kind", "turn", "bound"),
    [
        # With perfect planes, mean errors over the penumbra: linear 0.038 | 0 | 0.083, smooth
        # 0.025 | 0.063 | 0.021 for disk, square and turned square.
        ("line", "disk", 0, 0.001),
        ("line", "rect", 0, 0.005),
        ("line", "rect", 45, 0.001),
        ("linear", "disk", 0, 0.043),
        # A square's corners are where wedges around the blocker's corners touch it, so that side
        # planes and the direction of interpolation lean: 0.0042.
        ("linear", "rect", 0, 0.005),
        ("linear", "rect", 45, 0.09),
        ("smooth", "disk", 0, 0.028),
        ("smooth", "rect", 0, 0.069),
        ("smooth", "rect", 45, 0.024),
    ],
)
def test_the_papers_falloffs_at_a_half_plane(falloff, kind, turn, bound):
    setup = ss.scenes.half_plane(96, 96, kind, 0.2, turn_deg=turn)
    method = ss.Wedges(falloff=falloff)
    image = ss.render(setup.scene, setup.camera, setup.light, method)
    on_receiver = image.mask & (image.mesh_id == 0)
    expected = setup.visibility(image.position[on_receiver])
    partly = (expected > 1e-9) & (expected < 1 - 1e-9)
    error = np.abs(image.visibility[on_receiver] - expected)[partly].mean()
    assert error < bound
    assert error > 0.75 * bound or bound < 0.01


def test_the_umbra_shrinks_and_vanishes_as_the_light_grows():
    umbra, expected, errors = [], [], []
    camera = ss.Camera((0.0, -1.9, 1.0), (0, 0, 0), fov_y_deg=34, width=96, height=80)
    for size in (0.05, 0.4, 0.8, 1.6, 2.4):
        scene = over_ground(ball((0, 0, 0.6), 0.25))
        light = ss.SphereLight((0, 0, 2.5), size / 2)
        image = ss.render(scene, camera, light, "wedges")
        reference = ss.render(scene, camera, light, REFERENCE)
        ground = image.mask & (image.mesh_id == 0)
        umbra.append((image.visibility[ground] < 0.01).sum())
        expected.append((reference.visibility[ground] < 0.01).sum())
        partly = metrics.penumbra_mask(reference.visibility, where=ground)
        errors.append(np.abs(image.visibility - reference.visibility)[partly].mean())
    assert (np.diff(umbra) < 0).sum() >= 3
    assert umbra[-1] == 0
    # A larger light sees another outline of the ball than its centre, which a single silhouette
    # takes for a little smaller: 586, 394, 224, 18, 0 pixels for 586, 401, 236, 41, 0.
    assert np.allclose(umbra, expected, rtol=0.05, atol=25), (umbra, expected)
    assert max(errors) < 0.02, errors


def test_the_error_of_a_single_silhouette_grows_with_the_light():
    # A tall box: what the centre of a large light sees of it is not what its rim sees.
    scene = over_ground(box((0.4, 0.4, 0.8), (0, 0, 0.45)))
    errors = []
    for size in (0.2, 0.6, 1.8):
        light = lights(size)["disk"]
        image, reference = (ss.render(scene, CAMERA, light, m) for m in ("wedges", REFERENCE))
        ground = image.mask & (image.mesh_id == 0)
        partly = metrics.penumbra_mask(reference.visibility, where=ground)
        errors.append(np.abs(image.visibility - reference.visibility)[partly].mean())
    # Measured: 0.004, 0.012, 0.052.
    assert errors[0] < errors[1] < errors[2]
    assert errors[2] < 0.08


@pytest.mark.parametrize("falloff", ["light", "line"])
def test_the_penumbra_is_as_wide_as_the_distance_to_the_occluder_and_none_at_contact(falloff):
    # A wall along y whose top edge is at height z over the ground: across its shadow's edge the
    # penumbra of a square of edge a at height H is a z / (H - z) wide, 0.9 of it from 5 to 95 %.
    size, tall = 0.3, 2.0
    light = ss.RectLight((0, 0, tall), (0, size, 0), (size, 0, 0))
    for z in (0.0, 0.1, 0.2, 0.4, 0.8):
        sheet = box((1.0, 4.0, 1e-4), (-0.5, 0.0, z), 0)
        scene = over_ground(sheet)
        camera = ss.Camera((0.6, -0.01, 0.03), (0, 0, 0), fov_y_deg=60, width=201, height=201)
        if z > 0:
            camera = ss.Camera((0.9 * z, 0, 0.3 * z), (0, 0, 0), (0, 1, 0), 0.8, 401, 5)
        image = ss.render(scene, camera, light, ss.Wedges(falloff=falloff))
        ground = image.mask & (image.mesh_id == 0)
        if z == 0:
            partly = metrics.penumbra_mask(image.visibility, where=ground)
            # Half the sheet's thickness is above the ground.
            assert np.abs(image.position[partly][:, 0]).max(initial=0) < 1e-4
            continue
        row = ground[2] & (np.abs(image.position[2][:, 0]) < 0.5 * z)
        width = metrics.penumbra_width(
            image.visibility[2][row].astype(float), image.position[2][row][:, 0]
        )
        assert width == pytest.approx(0.9 * size * z / (tall - z), rel=0.02)


@pytest.mark.parametrize("kind", lights())
@pytest.mark.parametrize("name", ["ball", "torus"])
def test_no_seams_on_smooth_silhouettes(name, kind):
    scene = CLOSED[name]()
    camera = ss.Camera((0.0, -1.9, 1.4), (-0.1, 0.1, 0.0), fov_y_deg=40, width=128, height=112)
    light = lights(0.4)[kind]
    image = ss.render(scene, camera, light, "wedges")
    reference = ss.render(scene, camera, light, ss.RayTraced(1024, pattern="fixed"))
    ground = image.mask & (image.mesh_id == 0)
    largest = steps(image.visibility, ground).max()
    # Far from the camera a penumbra is only 5 pixels wide. Measured: 0.165 to 0.242; the
    # reference's own steps, with its noise, are 0.170 to 0.248.
    assert largest < 0.26
    assert largest < steps(reference.visibility, ground).max() + 0.01


@pytest.mark.parametrize("kind", lights())
@pytest.mark.parametrize("name", CLOSED)
def test_no_stray_pixels(name, kind):
    scene, light = CLOSED[name](), lights(0.3)[kind]
    reference = ss.render(scene, CAMERA, light, REFERENCE)
    image = ss.render(scene, CAMERA, light, "wedges")
    seen = np.where(reference.mask, reference.visibility, 1.0)
    lit, umbra = (alike(seen, value) & image.mask for value in (1.0, 0.0))
    assert lit.sum() > 500
    assert umbra.sum() > 20
    # Measured: exactly 0 for both. Where the shadows of several objects make an umbra together, it
    # is the product of what each leaves, in up to 4 pixels: 0.015.
    assert (1 - image.visibility[lit]).max() < 1e-6
    assert image.visibility[umbra].max() < (0.02 if name == "several" else 1e-6)


def _lit_and_umbra(method):
    scene, light = over_ground(torus()), lights()["sphere"]
    reference, image = (ss.render(scene, CAMERA, light, m) for m in (REFERENCE, method))
    seen = np.where(reference.mask, reference.visibility, 1.0)
    lit, umbra = (image.visibility[alike(seen, value) & image.mask] for value in (1.0, 0.0))
    return (1 - lit).max(), umbra.max()


def test_no_stray_pixels_between_tangent_planes():
    # Cusps of the silhouette, narrower than the penumbra, are too dark within it, not outside.
    dark, leak = _lit_and_umbra(ss.Wedges(falloff="line"))
    assert dark < 1e-3
    assert leak < 1e-3


@pytest.mark.xfail(
    strict=True, reason="wedges of edges seen nearly end-on leave gaps between the paper's planes"
)
def test_no_stray_pixels_between_the_papers_planes():
    dark, leak = _lit_and_umbra(ss.Wedges(falloff="line", planes="paper"))
    assert max(dark, leak) < 0.02


@pytest.mark.parametrize("counting", ["zpass", "zfail"])
def test_no_stray_pixels_of_fans(counting):
    dark, leak = _lit_and_umbra(ss.Wedges(quads=64, counting=counting))
    assert max(dark, leak) < 0.02
