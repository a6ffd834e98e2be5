"""Averaged hard-shadow textures against the reference, closed forms, Mitsuba and themselves."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from shapes import bumpy, quad
from softshadow import kernels

GROUND = quad((0, 0, 0), (2, 0, 0), (0, 2, 0))
UP = (0.0, 0.0, 1.0)


def _lights():
    return {
        "rect": ss.RectLight((0.2, -0.3, 1.8), (0, 0.6, 0.1), (0.5, 0, 0)),
        "disk": ss.DiskLight((0.2, -0.3, 1.8), (-0.1, 0.2, -1), 0.3),
        "sphere": ss.SphereLight((0.2, -0.3, 1.8), 0.3),
    }


def _scene(opacity=1.0):
    """A bumpy body over a square, and a tilted sheet that goes through the square."""
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    vertices, faces = bumpy(16, seed=4)
    scene.add((vertices * 0.35 + [0.1, 0.0, 0.6], faces), "body", opacity=opacity)
    scene.add(quad((-0.5, 0.5, 0.1), (0.4, 0, 0), (0, 0.2, 0.5)), "sheet", opacity=opacity)
    return scene


def _bake_both(scene, light, samples=128, max_size=128, receivers="ground", **options):
    """The same textures by accumulation and by the reference with the same light points."""
    drawn = ss.bake(
        scene, light, receivers, ss.Accumulation(samples, seed=3, max_size=max_size, **options)
    )
    traced = ss.bake(
        scene,
        light,
        receivers,
        ss.RayTraced(samples, seed=3, pattern="fixed"),
        max_size=max_size,
    )
    return drawn, traced


# ---------------------------------------------------------------- the reference


@pytest.mark.parametrize("kind", ["rect", "disk"])
@pytest.mark.parametrize("opacity", [1.0, 0.5])
def test_at_texels_centres_it_is_the_reference_with_the_same_points(kind, opacity):
    """But where an edge of a hard shadow passes within rounding of a texel's centre."""
    drawn, traced = _bake_both(_scene(opacity), _lights()[kind])
    a, b = drawn[0], traced[0]
    assert a.visibility.shape == (128, 128)
    partly = (b.visibility > 0) & (b.visibility < 1)
    assert partly.mean() > 0.15
    # Corners are rounded to 2**-25 of the frame there and nowhere here. Per light point about 1000
    # of 16384 texels have an edge pass through them; a millionth of a texel decides for 1e-6 of
    # these. Measured: at most 3 texels of a picture, each by one light point.
    different = a.visibility != b.visibility
    error = np.abs(a.visibility - b.visibility)
    if opacity == 1.0:
        assert different.sum() <= 8
        assert error.max() <= 1.001 / 128
    else:
        # Products and sums in another order: an ulp of each of 128 terms.
        assert (error > 1e-5).sum() <= 8
        assert error.max() <= 1.001 / 128


@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
def test_its_radiance_converges_to_the_references(kind):
    setup = ss.scenes.closed_solids(96, 96, kind, 0.5, detail=3)
    image = ss.render(setup.scene, setup.camera, setup.light, ss.Accumulation(256))
    truth = ss.render(setup.scene, setup.camera, setup.light, ss.RayTraced(1024, seed=5))
    lit = image.mask
    error = (image.visibility.astype(np.float64) - truth.visibility)[lit]
    # Measured: 0.0022 to 0.0029 (texels' interpolation and 256 points), no bias beyond 2e-4.
    assert np.abs(error).mean() < 0.005
    assert abs(error.mean()) < 5e-4
    scale = truth.radiance.max()
    radiance = (image.radiance.astype(np.float64) - truth.radiance)[lit] / scale
    assert np.abs(radiance).mean() < 0.002
    assert abs(radiance.mean()) < 2e-4


def test_a_sphere_close_to_its_receiver_is_weighted_by_solid_angle():
    """Unoccluded, the sum of weights is the solid angle and the irradiance the closed form."""
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    light = ss.SphereLight((0.1, 0.2, 0.6), 0.4)
    texture = ss.bake(scene, light, None, ss.Accumulation(1024, max_size=32))[0]
    assert (texture.visibility == 1).all()
    positions = texture.polygon.texel_positions().reshape(-1, 3)
    normals = np.broadcast_to(UP, positions.shape)
    exact = kernels.unshadowed_irradiance(light, positions, normals).reshape(32, 32)
    found = texture.radiance[..., 0] * np.pi / 0.8
    # 1024 stratified points of an integrand with a kink at the horizon: measured 0.4 %.
    assert np.abs(found / exact - 1).max() < 0.01


def _half_plane(kind="rect"):
    """The half-plane of `scenes.half_plane` over a strip that holds its penumbra, 1 long."""
    setup = ss.scenes.half_plane(light=kind)
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (1, 0, 0), (0, 0.25, 0)), "strip")
    blocker = setup.scene.entries[1]
    scene.add((blocker.vertices, blocker.faces), "blocker")
    return scene, setup.light, setup.visibility


@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
def test_half_plane(kind):
    scene, light, visibility = _half_plane(kind)
    texture = ss.bake(scene, light, "strip", ss.Accumulation(1024, texel=1 / 128))[0]
    expected = visibility(texture.polygon.texel_positions())
    assert texture.visibility.shape == (32, 128)
    assert ((expected > 0.01) & (expected < 0.99)).mean() > 0.3
    # A line passes through about 32 of the 1024 cells that have a point each: 0.6 % if each is a
    # coin toss, three times that for the worst of hundreds of lines. Measured: 0.001 (along the
    # light's side), 0.006 and 0.006.
    assert np.abs(texture.visibility - expected).max() < 0.018


@pytest.mark.parametrize("kind", ["rect", "sphere"])
def test_radiance_agrees_with_mitsuba(kind):
    """The mean of four seeds; masked as in test_mitsuba.py."""
    pytest.importorskip("mitsuba", reason="the optional extra")
    setup = ss.scenes.closed_solids(64, 64, kind, 0.5, detail=3)
    world = (setup.scene, setup.camera, setup.light)
    images = [ss.render(*world, ss.Accumulation(256, seed=seed)) for seed in range(4)]
    theirs = ss.mitsuba.render(*world, samples=512)
    full = ss.mitsuba.unshadowed(*world)
    offset = ss.mitsuba.ray_offset(setup.scene, images[0], setup.light)
    edge = np.abs(images[0].normal - theirs.normal).max(axis=-1) > 1e-3
    mask = images[0].mask & theirs.mask & ~offset.contact & ~edge
    radiance = np.array([image.radiance for image in images], dtype=np.float64)
    lifted = offset.lift(radiance.mean(axis=0), full)
    variance = radiance.var(axis=0, ddof=1) / 4
    test = ss.mitsuba.z_test(lifted, theirs, variance, mask, unshadowed=full)
    # Measured: at most one pixel, on a shadow's edge that texels blur; mean z -0.8 and -0.5, and a
    # deviation as large as Mitsuba's own (0.0021 and 0.0016 of the largest radiance).
    assert test.pixels > 3000
    assert test.failures <= 3
    assert abs(test.mean_z) < 4
    deviation = (lifted - theirs.radiance)[mask]
    expected = np.sqrt(theirs.variance[mask].mean())
    assert np.sqrt(np.mean(deviation**2)) < 1.2 * expected


# ---------------------------------------------------------------- levels and convergence


def test_n_points_make_n_plus_one_levels_whose_steps_fade():
    scene, light, _ = _half_plane()
    steps = {}
    for n in (16, 64, 256):
        texture = ss.bake(scene, light, "strip", ss.Accumulation(n, texel=1 / 1024))[0]
        levels = texture.visibility * n
        assert np.abs(levels - np.rint(levels)).max() < 1e-4
        # An edge parallel to the light's side meets one point after the other; a texel is 1/410 of
        # the penumbra, and can skip some of 256.
        row = np.rint(levels[levels.shape[0] // 2])
        assert row.min() == 0
        assert row.max() == n
        if n <= 64:
            assert len(np.unique(row)) == n + 1
        # Over a hundredth of the penumbra, which is 0.4 long.
        steps[n] = np.abs(row[4:] - row[:-4]).max() / n
    assert steps[16] >= 1 / 16
    # Two points may lie as near as that: what is left of a step is little more than the slope.
    assert steps[64] <= 2 / 64
    assert steps[256] <= 0.02


def test_the_error_falls_with_the_points():
    """Slope of the root mean square error against n: -1/2 for random points, better stratified."""
    scene, light = _scene(), _lights()["rect"]
    bake = ss.bake(scene, light, "ground", ss.Accumulation(4, max_size=64))
    truth = ss.bake(scene, light, "ground", ss.RayTraced(8192, seed=9), max_size=64)[0].visibility
    counts, errors = [], []
    while True:
        counts.append(bake.samples)
        errors.append(np.sqrt(np.mean((bake[0].visibility - truth) ** 2)))
        if bake.samples == 1024:
            break
        bake.refine()
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    # Measured: -0.75. Stratified points before a straight edge have -0.75 (Mitchell 1996).
    assert -0.9 < slope < -0.6
    assert errors[-1] < 0.003


@pytest.mark.parametrize("kind", ["rect", "sphere"])
@pytest.mark.parametrize("opacity", [1.0, 0.5])
def test_refining_keeps_what_was_drawn(kind, opacity):
    scene, light = _scene(opacity), _lights()[kind]
    receivers = ["ground", "sheet"]
    bake = ss.bake(scene, light, receivers, ss.Accumulation(16, max_size=64))
    bake.refine()
    bake.refine(96)
    whole = ss.bake(scene, light, receivers, ss.Accumulation(96, max_size=64))
    assert bake.samples == whole.samples == 96
    for a, b in zip(bake, whole, strict=True):
        assert np.array_equal(a.visibility, b.visibility)
        assert np.array_equal(a.radiance, b.radiance)
    with pytest.raises(ValueError, match="96 are drawn already"):
        bake.refine(64)


# ---------------------------------------------------------------- what textures hold


def test_eight_bits_are_added_and_saturate():
    scene, light = _scene(), _lights()["rect"]
    exact = ss.bake(scene, light, "ground", ss.Accumulation(64, texture="modulation", max_size=64))
    bits = ss.bake(scene, light, "ground", ss.Accumulation(64, texture="eight_bit", max_size=64))
    levels, seen = bits[0].modulation, np.rint(exact[0].visibility * 64).astype(int)
    assert levels.dtype == np.uint8
    assert np.array_equal(levels, np.minimum(4 * seen, 255))
    # An ambient level of 64 leaves 192 = 3 · 64.
    dim = ss.Accumulation(64, texture="eight_bit", ambient=0.25, max_size=64)
    assert np.array_equal(
        ss.bake(scene, light, "ground", dim)[0].modulation, np.minimum(64 + 3 * seen, 255)
    )
    with pytest.raises(ValueError, match="samples must divide 192"):
        ss.bake(scene, light, "ground", ss.Accumulation(128, texture="eight_bit", ambient=0.25))
    with pytest.raises(ValueError, match="samples must divide 256"):
        bits.refine(100)


def test_ambient_light_is_in_textures_and_not_in_pictures():
    scene, light = _scene(), _lights()["disk"]
    bake = {
        (texture, ambient): ss.bake(
            scene,
            light,
            "ground",
            ss.Accumulation(32, texture=texture, ambient=ambient, max_size=32),
        )[0]
        for texture in ("radiance", "modulation")
        for ambient in (0.0, 0.25)
    }
    plain, lit = bake["radiance", 0.0], bake["radiance", 0.25]
    assert np.array_equal(plain.visibility, lit.visibility)
    # Radiance from everywhere, times the albedo.
    assert np.allclose(lit.radiance - plain.radiance, 0.25 * 0.8, atol=1e-6)
    grey = bake["modulation", 0.25].modulation
    assert np.allclose(grey, 0.25 + 0.75 * plain.visibility, atol=1e-6)
    camera = ss.Camera((0, -3, 2), (0, 0, 0), width=64, height=64)
    images = [
        ss.render(scene, camera, light, ss.Accumulation(32, ambient=a, max_size=64)).visibility
        for a in (0.0, 0.5)
    ]
    assert np.array_equal(*images)


@pytest.mark.parametrize("texture", ["modulation", "eight_bit"])
def test_pictures_of_modulation_textures_use_the_closed_form(texture):
    setup = ss.scenes.closed_solids(96, 96, "rect", 0.4, detail=2)
    images = [
        ss.render(setup.scene, setup.camera, setup.light, ss.Accumulation(128, texture=t))
        for t in ("radiance", texture)
    ]
    levels = 1 / 128 if texture == "eight_bit" else 0
    assert np.abs(images[0].visibility - images[1].visibility).max() <= levels
    # The light is small against its distance: cosines and distances vary little over it.
    scale = images[0].radiance.max()
    assert np.abs(images[0].radiance - images[1].radiance).mean() < 0.005 * scale


# ---------------------------------------------------------------- pictures


def test_interpolation_does_not_darken_the_foot_of_what_stands_on_a_receiver():
    """A box that stands on the ground, lit from above: beside it the ground sees all the light."""
    import trimesh

    scene = ss.Scene()
    scene.add(GROUND, "ground")
    box = trimesh.creation.box((0.5, 0.5, 0.4))
    box.apply_transform(trimesh.transformations.rotation_matrix(0.4, (0, 0, 1)))
    box.apply_translation((0, 0, 0.2))
    scene.add(box, "box")
    light = ss.RectLight((-2, -3, 3), (0, 0.2, 0), (0.2, 0, 0))
    camera = ss.Camera((-1, -2.5, 2), (0, 0, 0.1), fov_y_deg=24, width=192, height=192)
    for size in (64, 256):
        image = ss.render(scene, camera, light, ss.Accumulation(64, max_size=size))
        truth = ss.render(scene, camera, light, ss.RayTraced(64, pattern="fixed"))
        whole = truth.mask & (truth.visibility == 1)
        # Penumbrae are blurred by a texel, but only from where they are: near the foot, on the lit
        # side, a box of texels has no shadow at all.
        near = whole & (image.mesh_id == 0)
        p = image.position
        turned = [np.cos(0.4) * p[..., 0] + np.sin(0.4) * p[..., 1]]
        turned.append(np.cos(0.4) * p[..., 1] - np.sin(0.4) * p[..., 0])
        beside = near & (turned[1] < -0.2) & (np.abs(turned[0]) < 0.2) & (turned[1] > -0.3)
        assert beside.sum() > 100
        assert (image.visibility[beside] == 1).all()


def test_nearest_texels_are_the_baked_ones():
    scene, light = _scene(), _lights()["rect"]
    method = ss.Accumulation(32, max_size=32, interpolation="nearest")
    texture = ss.bake(scene, light, "ground", method)[0]
    camera = ss.Camera((0.2, -1.5, 2.2), (0, 0, 0), width=96, height=96)
    image = ss.render(scene, camera, light, method)
    ground = image.mask & (image.mesh_id == 0)
    corner, (u, v) = texture.polygon.corner, texture.polygon.edges
    p = image.position[ground] - corner
    place = np.column_stack([p @ u / (u @ u), p @ v / (v @ v)]) * 32
    inside = np.abs(place - np.rint(place)).min(axis=1) > 1e-3
    columns, rows = np.floor(place[inside]).astype(int).T
    assert np.array_equal(image.visibility[ground][inside], texture.visibility[31 - rows, columns])


def test_a_frame_draws_what_it_shows_and_keeps_it():
    setup = ss.scenes.closed_solids(64, 64, "rect", 0.4, detail=3)
    prepared = ss.prepare(setup.scene, setup.light, ss.Accumulation(32))
    first = prepared.render(setup.camera)
    again = prepared.render(setup.camera)
    assert np.array_equal(first.visibility, again.visibility)
    assert first.bytes == again.bytes
    assert again.seconds["shade"] < first.seconds["shade"]
    # All that drawing took so far: nothing but a lock in the second frame.
    assert 0 < first.seconds["textures"] <= first.seconds["shade"]
    spent = again.seconds["textures"] - first.seconds["textures"]
    assert 0 <= spent < first.seconds["textures"]


def test_several_lights_have_textures_of_their_own():
    scene = _scene()
    lights = list(_lights().values())
    camera = ss.Camera((0.2, -1.5, 2.2), (0, 0, 0), width=64, height=64)
    method = ss.Accumulation(32, max_size=64)
    together = ss.render(scene, camera, lights, method)
    for light, seen in zip(lights, together.visibility, strict=True):
        assert np.array_equal(seen, ss.render(scene, camera, light, method).visibility)
    baked = ss.bake(scene, lights, "ground", method)[0]
    assert baked.visibility.shape == (3, 64, 64)
    parts = [ss.bake(scene, light, "ground", method)[0].radiance for light in lights]
    assert np.allclose(baked.radiance, sum(parts), rtol=1e-6)


# ---------------------------------------------------------------- hard cases


def test_a_receiver_edge_on_to_the_light_and_points_in_its_plane():
    """The light's plane holds the receiver's: no point of it is over the receiver."""
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    scene.add(quad((0.3, 0, 0.2), (0.2, 0, 0), (0, 0.2, 0)), "sheet")
    beside = ss.RectLight((3, 0, 0), (0, 1, 0), (1, 0, 0))
    upright = ss.RectLight((3, 0, 0), (0, 0, 1), (0, 1, 0))  # emits towards -x, half of it above
    for light, expected in ((beside, 0.0), (upright, 0.5)):
        texture = ss.bake(scene, light, "ground", ss.Accumulation(64, max_size=32), side="front")[0]
        assert np.isfinite(texture.radiance).all()
        assert texture.visibility.max() == expected
        reference = ss.bake(
            scene, light, "ground", ss.RayTraced(64, pattern="fixed"), max_size=32, side="front"
        )[0]
        assert np.abs(texture.visibility - reference.visibility).max() < 2 / 64


def test_occluders_through_the_receiver_and_through_the_lights_plane():
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    # From below the ground to above the light, beside it and through it.
    scene.add(quad((0.3, 0.1, 0.8), (0.1, 0.3, 0), (0, 0.2, 4.0)), "post")
    scene.add(quad((-0.4, 0.2, 1.0), (0.3, 0, 1.9), (0, 0.3, 0)), "ramp")
    light = ss.RectLight((0, 0, 1.5), (0, 0.5, 0.1), (0.5, 0, 0.05))
    drawn, traced = _bake_both(scene, light, 64, 64)
    different = np.abs(drawn[0].visibility - traced[0].visibility) > 0
    # Measured: none.
    assert different.sum() <= 4
    assert ((traced[0].visibility > 0) & (traced[0].visibility < 1)).mean() > 0.2


def test_a_light_whose_plane_cuts_the_receiver_lights_one_side():
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    light = ss.RectLight((0, 0, 0.5), (0, 0.4, 0), (0, 0, 0.4))  # emits towards +x
    texture = ss.bake(scene, light, "ground", ss.Accumulation(64, max_size=64))[0]
    x = texture.polygon.texel_positions()[..., 0]
    assert (texture.visibility[x > 0] == 1).all()
    assert (texture.visibility[x < 0] == 0).all()
    assert (texture.radiance[x < 0] == 0).all()


def test_slivers_cast_and_receive():
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    thin = np.array([[-0.9, -0.9, 0.4], [0.9, 0.9, 0.4], [0.9, 0.9 + 1e-5, 0.4], [0, 0, 0.4]])
    scene.add((thin, [[0, 1, 2], [0, 1, 3], [1, 1, 2]]), "sliver")
    light = _lights()["rect"]
    drawn, traced = _bake_both(scene, light, 32, 64, receivers=None)
    for a, b in zip(drawn, traced, strict=True):
        assert np.isfinite(a.radiance).all()
        assert a.visibility.min() >= 0
        assert a.visibility.max() <= 1
        if a.receiver == "ground":
            assert (a.visibility != b.visibility).sum() <= 4


@pytest.mark.parametrize(
    "light",
    [ss.DiskLight((0.2, -0.3, 1.8), (0, 0, -1), 0.0), ss.SphereLight((0.2, -0.3, 1.8), 0.0)],
)
def test_a_light_of_size_zero_is_hard(light):
    scene = _scene()
    texture = ss.bake(scene, light, "ground", ss.Accumulation(8, max_size=64))[0]
    hard = ss.bake(scene, light, "ground", "hard", max_size=64)[0]
    assert set(np.unique(texture.visibility)) == {0.0, 1.0}
    assert (texture.visibility != hard.visibility).sum() <= 2
    assert (texture.radiance == 0).all()


@pytest.mark.parametrize("scale", [2.0**-20, 2.0**20, 1e-6, 1e6])
@pytest.mark.parametrize("kind", ["rect", "sphere"])
def test_scaled_scenes_give_the_same_textures(kind, scale):
    def textures(scale):
        scene = ss.Scene()
        for entry in _scene().entries:
            scene.add((entry.vertices * scale, entry.faces), entry.name)
        c = np.array((0.2, -0.3, 1.8)) * scale
        light = (
            ss.RectLight(c, (0, 0.6 * scale, 0.1 * scale), (0.5 * scale, 0, 0))
            if kind == "rect"
            else ss.SphereLight(c, 0.3 * scale)
        )
        return ss.bake(scene, light, "ground", ss.Accumulation(64, max_size=64))[0]

    plain, other = textures(1.0), textures(scale)
    if np.log2(scale) % 1 == 0:
        assert np.array_equal(plain.visibility, other.visibility)
        assert np.array_equal(plain.radiance, other.radiance)
    else:
        # Rounded corners and light points: an edge may pass on another side of a texel's centre.
        assert (np.abs(plain.visibility - other.visibility) > 1e-3).mean() < 0.002


def test_random_soups_give_finite_values_in_range():
    for seed in range(8):
        rng = np.random.default_rng(seed)
        vertices = rng.normal(size=(40, 3))
        faces = rng.integers(0, 40, size=(60, 3))
        faces[:3] = faces[3:6]
        scene = ss.Scene()
        scene.add((vertices, faces), "soup", opacity=1.0 if seed % 3 else 0.5)
        center = rng.normal(size=3) * (0.3 if seed % 2 else 3.0)
        kind = ("rect", "disk", "sphere")[seed % 3]
        light = ss.scenes.light_towards(kind, center, 0.5, (0.1, 0.2, 0.3))
        camera = ss.Camera((4, 3, 2), (0, 0, 0), width=48, height=48)
        image = ss.render(scene, camera, light, ss.Accumulation(16, max_size=64))
        assert np.isfinite(image.radiance).all()
        assert image.visibility.min() >= 0
        assert image.visibility.max() <= 1


# ---------------------------------------------------------------- errors and bits


def test_what_it_cannot_do_is_an_error():
    scene, light = _scene(), _lights()["rect"]
    for options in (
        {"samples": 0},
        {"samples": 70000},
        {"max_size": 100},
        {"max_size": 16384},
        {"texel": 0.0},
        {"texel": float("nan")},
        {"ambient": -0.1},
        {"ambient": 1.5, "texture": "modulation"},
        {"texture": "other"},
        {"interpolation": "cubic"},
        {"memory_limit": 0.0},
        {"opacity": "half"},
    ):
        with pytest.raises(ss.ParameterError, match="Accumulation"):
            ss.prepare(scene, light, ss.Accumulation(**options))
    with pytest.raises(ValueError, match="needs a camera"):
        ss.visibility(scene, [(0, 0, 1)], None, light, "accumulation")
    with pytest.raises(ss.ParameterError, match=r"textures take 0\.0"):
        ss.bake(scene, light, method=ss.Accumulation(memory_limit=1e4))
    scene.add_spheres((0, 0, 0.5), 0.1, "ball")
    with pytest.raises(ss.UnsupportedError, match="add_spheres"):
        ss.prepare(scene, light, "accumulation")


def test_opaque_makes_transparent_occluders_block():
    light = _lights()["rect"]
    method = ss.Accumulation(32, max_size=64, opacity="opaque")
    clear, solid = (
        ss.bake(_scene(opacity), light, "ground", method)[0].visibility for opacity in (0.5, 1.0)
    )
    assert np.array_equal(clear, solid)


# ---------------------------------------------------------------- kernels


def test_the_transform_maps_the_pyramid_to_the_unit_box():
    a, b = np.array((0.3, -0.2, 1.9)), np.array((-0.2, 0.1, 0.3))
    ex, ey = np.array((0.5, 0.1, -0.2)), np.array((0.2, 0.7, 0.1))
    m = kernels.receiver_transform(a, b, ex, ey)
    for x, y in ((0, 0), (1, 0), (0.3, 0.8), (1, 1)):
        for w in (1.0, 0.5, 0.1):
            h = m @ [*(a + (b + x * ex + y * ey - a) * w), 1.0]
            assert np.allclose(h[:3] / h[3], (x, y, 1 / w), atol=1e-12)
    # The light point itself is at infinity.
    assert abs((m @ [*a, 1.0])[3]) < 1e-15
    with pytest.raises(ValueError, match="plane"):
        kernels.receiver_transform((3, 1, 0), (0, 0, 0), (1, 0, 0), (0, 1, 0))
    with pytest.raises(ValueError, match="no area"):
        kernels.receiver_transform((0, 0, 1), (0, 0, 0), (1, 0, 0), (2, 0, 0))


def test_points_with_colours_add_up_and_refine():
    vertices, faces = bumpy(16, seed=4)
    vertices = vertices * 0.35 + [0.1, 0.0, 0.6]
    light = _lights()["rect"]
    points, _, _ = kernels.light_samples(light, (0, 0, 0), 64, seed=3)
    place = ((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    whole = kernels.accumulate(vertices, faces, points, *place, (64, 64))
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    scene.add((vertices, faces), "body")
    baked = ss.bake(scene, light, "ground", ss.Accumulation(64, seed=3, max_size=64))[0]
    assert (np.abs(whole - baked.visibility) > 1e-5).sum() <= 4
    # Each half in its own colour.
    colours = np.zeros((64, 3))
    colours[:32, 0], colours[32:, 2] = 1 / 64, 1 / 64
    rgb = kernels.accumulate(vertices, faces, points, *place, (64, 64), colours)
    assert np.allclose(rgb.sum(axis=-1), whole, atol=1e-6)
    assert (rgb[..., 1] == 0).all()
    assert not np.array_equal(rgb[..., 0], rgb[..., 2])


# ---------------------------------------------------------------- small polygons


def _only_texel(corners):
    """Where the one texel is that a triangle of 2² texels has on it."""
    sides = np.roll(corners, -1, axis=1) - corners
    out, into = (
        x / np.linalg.norm(x, axis=2, keepdims=True) for x in (sides, np.roll(sides, 1, 1))
    )
    # A quarter along both edges from the corner that is nearest to a right one.
    best = np.abs((out * into).sum(axis=2)).argmin(axis=1)
    each = np.arange(len(corners))
    pick = [corners[each, (best + k) % 3] for k in range(3)]
    return pick[0] + 0.25 * (pick[1] - pick[0]) + 0.25 * (pick[2] - pick[0])


@pytest.mark.parametrize("opacity", [1.0, 0.5])
@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
def test_texels_of_small_polygons_are_the_reference_at_their_centres(kind, opacity):
    """They are traced, not drawn; with texels this large every triangle has one."""
    scene, light = _scene(opacity), _lights()[kind]
    camera = ss.Camera((0.3, -1.6, 1.5), (0.1, 0, 0.5), fov_y_deg=40, width=64, height=64)
    image = ss.render(scene, camera, light, ss.Accumulation(64, seed=3, texel=10.0))
    body = image.mask & (image.mesh_id == 1)
    faces, first = np.unique(image.triangle_id[body], return_index=True)
    assert len(faces) > 500
    mesh = scene.entries[1]
    points = _only_texel(mesh.vertices[mesh.faces[faces]])
    normals = image.normal[body][first]
    # Spheres: from other points, so against many.
    method = ss.RayTraced(4096 if kind == "sphere" else 64, seed=3, pattern="fixed")
    expected = np.ravel(ss.visibility(scene, points, normals, light, method))
    error = np.abs(image.visibility[body][first] - expected)
    assert ((expected > 0.05) & (expected < 0.95)).sum() > 50
    if kind == "sphere":
        # 64 stratified points: measured at most 0.07, 0.008 in the mean.
        assert error.mean() < 0.015
        assert error.max() < 0.15
    else:
        # An edge of a hard shadow within rounding of a texel's centre is one light point of 64.
        assert (error > 1e-5).sum() <= 2
        assert error.max() <= 1.001 / 64


def test_a_picture_does_not_depend_on_those_before():
    """Neither what is drawn nor the texels that are found one by one."""
    scene, light = _scene(), _lights()["rect"]
    views = [ss.Camera((x, -1.6, 1.5), (0.1, 0, 0.5), width=48, height=48) for x in (0.3, -0.4)]
    for method in (ss.Accumulation(32), ss.Convolution(max_size=128)):
        prepared = ss.prepare(scene, light, method)
        prepared.render(views[0])
        again = prepared.render(views[1]).visibility
        assert np.array_equal(again, ss.render(scene, views[1], light, method).visibility)
