"""Convolved hard shadows against closed forms, the reference and the other textures."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from shapes import bumpy, quad

REFERENCE = ss.RayTraced(samples=256, seed=5)


def _parallel(kind, blocker, light_size=0.4, height=0.5):
    """A strip under a blocker and a light, all horizontal, and a camera that sees the strip."""
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (2, 0, 0), (0, 2, 0)), "ground")
    scene.add(blocker, "blocker")
    light = {
        "rect": ss.RectLight((0, 0, 1), (0, light_size, 0), (light_size, 0, 0)),
        "disk": ss.DiskLight((0, 0, 1), (0, 0, -1), light_size / 2),
    }[kind]
    # From below the blocker.
    camera = ss.Camera((0, -0.9, 0.42), (0, 0.1, 0), fov_y_deg=60, width=128, height=128)
    return scene, camera, light


def _ground_error(setup, method):
    images = [ss.render(*setup, m) for m in (method, ss.RayTraced(4096, seed=5))]
    ground = images[0].mask & (images[0].mesh_id == 0)
    partly = ground & (images[1].visibility > 0.01) & (images[1].visibility < 0.99)
    assert partly.sum() > 1000
    return np.abs(images[0].visibility.astype(np.float64) - images[1].visibility)[partly]


SHEETS = {
    "half-plane": quad((-2, 0, 0.5), (4, 0, 0), (0, 6, 0)),
    "turned square": quad((0, 0.1, 0.5), (0.3, 0.2, 0), (-0.2, 0.3, 0)),
    "gear": (
        np.array(
            [(0, 0, 0.5)]
            + [
                (r * np.cos(a), 0.1 + r * np.sin(a), 0.5)
                for r, a in zip([0.3, 0.12] * 7, np.arange(14) * np.pi / 7, strict=True)
            ]
        ),
        np.array([(0, 1 + i, 1 + (i + 1) % 14) for i in range(14)]),
    ),
}


@pytest.mark.parametrize("kind", ["rect", "disk"])
@pytest.mark.parametrize("blocker", SHEETS)
def test_parallel_set_ups_are_exact_but_for_texels(kind, blocker):
    """The penumbra is 0.4 long: 26, 51 and 102 texels; errors fall as texels do."""
    setup = _parallel(kind, SHEETS[blocker])
    errors = {
        size: _ground_error(setup, ss.Convolution(texel=2 / size, max_size=1024)).mean()
        for size in (128, 512)
    }
    # A hard shadow's edge is known to an eighth of a texel; the kernel's tent and the interpolation
    # blur the ends and corners of penumbrae over a texel. Measured: at most 0.0026 and 0.0007, the
    # latter mostly the reference's noise.
    assert errors[128] < 0.005
    assert errors[512] < 0.0015


def test_it_tends_to_the_closed_form_of_a_half_plane():
    setup = ss.scenes.half_plane(128, 128)
    # Cut to what is near: texels are of the size of the receiver.
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (2, 0, 0), (0, 2, 0)), "receiver")
    blocker = setup.scene.entries[1]
    scene.add((blocker.vertices, blocker.faces), "blocker")
    image = ss.render(
        scene, setup.camera, setup.light, ss.Convolution(max_size=1024, texel=1 / 512)
    )
    ground = image.mask & (image.mesh_id == 0) & (np.abs(image.position[..., :2]).max(-1) < 0.9)
    expected = setup.visibility(image.position[ground])
    assert ((expected > 0.01) & (expected < 0.99)).sum() > 3000
    # A kink of the ramp is blurred over a texel or two of 200 (measured: 0.0013).
    assert np.abs(image.visibility[ground] - expected).max() < 0.005


def test_splitting_by_depth_reduces_the_error():
    """Two cylinders (Figure 13): measured 0.047 with one depth, 0.024 split."""
    setup = ss.scenes.two_cylinders(160, 160)
    world = (setup.scene, setup.camera, setup.light)
    truth = ss.render(*world, REFERENCE)
    partly = truth.mask & (truth.visibility > 0.002) & (truth.visibility < 0.998)

    def error(method):
        return np.abs(ss.render(*world, method).visibility - truth.visibility)[partly].mean()

    one, split, hard = error(ss.Convolution(error=1.0)), error(ss.Convolution()), error("hard")
    assert split < 0.7 * one
    assert split < 0.04
    assert one < 0.4 * hard


@pytest.mark.parametrize(
    "make",
    [
        lambda: ss.scenes.closed_solids(128, 128, "sphere", 0.3, detail=3),
        lambda: ss.scenes.closed_solids(128, 128, "rect", 0.3, detail=3),
        lambda: ss.scenes.overlapping_boards(128, 128),
    ],
)
def test_it_is_much_closer_to_the_reference_than_hard_shadows(make):
    setup = make()
    world = (setup.scene, setup.camera, setup.light)
    truth = ss.render(*world, REFERENCE)
    partly = truth.mask & (truth.visibility > 0.002) & (truth.visibility < 0.998)
    errors = [
        np.abs(ss.render(*world, m).visibility - truth.visibility)[partly].mean()
        for m in ("convolution", "hard")
    ]
    # Measured: 0.018 to 0.030 against 0.19 to 0.21.
    assert errors[0] < 0.05
    assert errors[0] < errors[1] / 4


@pytest.mark.parametrize("kind", ["disk", "sphere"])
def test_a_light_of_size_zero_is_hard(kind):
    setup = ss.scenes.closed_solids(96, 96, kind, 0.0, detail=2)
    world = (setup.scene, setup.camera, setup.light)
    soft, hard = (ss.render(*world, m).visibility for m in (ss.Convolution(max_size=1024), "hard"))
    # A hard edge is a texel wide (measured: 0.003).
    assert np.abs(soft - hard).mean() < 0.008


@pytest.mark.parametrize("scale", [2.0**-20, 2.0**20, 1e-6, 1e6])
def test_scaled_scenes_give_the_same(scale):
    def picture(scale):
        scene = ss.Scene()
        vertices, faces = quad((0, 0, 0), (2, 0, 0), (0, 2, 0))
        scene.add((vertices * scale, faces), "ground")
        vertices, faces = bumpy(10, seed=4)
        scene.add(((vertices * 0.35 + [0.1, 0.0, 0.6]) * scale, faces), "body")
        light = ss.RectLight(
            np.array((0.2, -0.3, 1.8)) * scale, (0, 0.4 * scale, 0), (0.4 * scale, 0, 0)
        )
        eye, target = np.array((0.4, -2.0, 1.6)) * scale, np.array((0, 0, 0.2)) * scale
        camera = ss.Camera(eye, target, width=64, height=64)
        return ss.render(scene, camera, light, ss.Convolution(max_size=128)).visibility

    plain, other = picture(1.0), picture(scale)
    if np.log2(scale) % 1 == 0:
        assert np.array_equal(plain, other)
    else:
        # Rounding moves single texels of the hard shadows, and steps of the depths' logarithm.
        assert (np.abs(plain - other) > 0.02).mean() < 0.01


def test_edge_on_receivers_and_occluders_through_planes_give_values_in_range():
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (2, 0, 0), (0, 2, 0)), "ground")
    scene.add(quad((0.3, 0.1, 0.8), (0.1, 0.3, 0), (0, 0.2, 4.0)), "post")
    scene.add(quad((-0.4, 0.2, 1.0), (0.3, 0, 1.9), (0, 0.3, 0)), "ramp")
    scene.add(([(0, 0, 0.4), (0.9, 0.9, 0.4), (0.9, 0.9 + 1e-5, 0.4)], [(0, 1, 2)]), "sliver")
    camera = ss.Camera((1, -2.5, 2), (0, 0, 0.3), width=96, height=96)
    lights = [
        ss.RectLight((0, 0, 1.5), (0, 0.5, 0.1), (0.5, 0, 0.05)),
        ss.RectLight((3, 0, 0), (0, 1, 0), (1, 0, 0)),
        ss.RectLight((3, 0, 0), (0, 0, 1), (0, 1, 0)),
        ss.SphereLight((0.2, 0.1, 0.1), 0.3),
        ss.DiskLight((0, 0, 1.2), (0.3, 0, -1), 0.5),
    ]
    image = ss.render(scene, camera, lights, ss.Convolution(max_size=128))
    assert np.isfinite(image.radiance).all()
    assert image.visibility.min() >= 0
    assert image.visibility.max() <= 1
    # In the plane of a light nothing is seen of it, and never more than is over a surface.
    assert image.visibility[1][image.mesh_id == 0].max() == 0
    at = image.mask
    for light, seen in zip(lights, image.visibility, strict=True):
        h = ss.kernels.light_fraction_above(light, image.position[at], image.normal[at])
        assert (seen[at] <= h + 1e-6).all()


def test_random_soups_give_finite_values_in_range():
    for seed in range(4):
        rng = np.random.default_rng(seed)
        vertices = rng.normal(size=(30, 3))
        faces = rng.integers(0, 30, size=(40, 3))
        scene = ss.Scene()
        scene.add((vertices, faces), "soup")
        center = rng.normal(size=3) * (0.3 if seed % 2 else 3.0)
        kind = ("rect", "disk", "sphere")[seed % 3]
        light = ss.scenes.light_towards(kind, center, 0.5, (0.1, 0.2, 0.3))
        camera = ss.Camera((4, 3, 2), (0, 0, 0), width=48, height=48)
        image = ss.render(scene, camera, light, ss.Convolution(max_size=32))
        assert np.isfinite(image.radiance).all()
        assert image.visibility.min() >= 0
        assert image.visibility.max() <= 1


def test_what_it_cannot_do_is_an_error():
    setup = ss.scenes.tilted_sheet(8, 8)
    with pytest.raises(ss.UnsupportedError, match="opacity"):
        ss.prepare(setup.scene, setup.light, "convolution")
    ss.prepare(setup.scene, setup.light, ss.Convolution(opacity="opaque"))
    for options in (
        {"error": 0.0},
        {"error": 1.5},
        {"error": float("nan")},
        {"max_size": 100},
        {"texel": -1.0},
        {"interpolation": "cubic"},
        {"memory_limit": -1.0},
    ):
        with pytest.raises(ss.ParameterError, match="Convolution"):
            ss.prepare(setup.scene, setup.light, ss.Convolution(**options))
    plain = ss.scenes.half_plane(8, 8)
    with pytest.raises(ValueError, match="needs a camera"):
        ss.visibility(plain.scene, [(0, 0, 1)], None, plain.light, "convolution")


@pytest.mark.parametrize("kind", ["rect", "disk"])
def test_the_kernel_convolves_a_hard_shadow_as_accumulation_draws_the_soft_one(kind):
    """Parallel: the mean of hard shadows is the centre's, convolved."""
    _, _, light = _parallel(kind, SHEETS["gear"])
    vertices, faces = SHEETS["gear"]
    place = ((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    size = (256, 256)

    def drawn(points):
        return ss.kernels.accumulate(vertices, faces, points, *place, size)

    points, _, _ = ss.kernels.light_samples(light, (0, 0, 0.0), samples=1024)
    soft = drawn(points).astype(np.float64)
    # Half of the way down: the light's image is as large as the light.
    found = ss.kernels.convolve_shadow(drawn([light.center]), light, *place, 1.0)
    partly = (soft > 0.01) & (soft < 0.99)
    assert partly.sum() > 3000
    # Of both: a texel's part of the penumbra's 51, the tent and the samples' noise.
    assert np.abs(found - soft)[partly].mean() < 0.005
    assert np.abs(found - soft)[~partly].max() < 0.02
    # No size, no blur but the transform's rounding; rows and columns stay where they are.
    point = ss.DiskLight(light.center, (0, 0, -1), 0.0)
    hard = drawn([light.center])
    assert np.abs(ss.kernels.convolve_shadow(hard, point, *place, 1.0) - hard).max() < 2e-6
    for bad in (hard[0], hard * 2, hard * np.nan):
        with pytest.raises(ValueError, match="visibility"):
            ss.kernels.convolve_shadow(bad, light, *place, 1.0)
    with pytest.raises(ValueError, match="scale"):
        ss.kernels.convolve_shadow(hard, light, *place, -1.0)


def _square(z, s):
    return quad((0, 0, z), (2 * s, 0, 0), (0, 2 * s, 0))


def _rotation(axis, angle):
    axis = np.array(axis, float) / np.linalg.norm(axis)
    k = np.cross(np.eye(3), -axis)
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def _under_a_board(boards, turn, max_size=64):
    """What the ground's middle sees of a light 4 above it, past boards, all of it turned."""
    scene = ss.Scene()
    for vertices, faces in [_square(0, 2), *boards]:
        scene.add((vertices @ turn.T, faces))
    light = ss.RectLight(turn @ (0, 0, 4), turn @ (0, 0.4, 0), turn @ (0.4, 0, 0))
    lowest = min(board[0][:, 2].min() for board in boards)
    # Four pixels about the middle, from between the ground and the board; the texels around them
    # are in the umbra, too.
    camera = ss.Camera(
        turn @ (0, 0, 0.8 * lowest),
        turn @ (0, 0, 0),
        turn @ (0, 1, 0),
        fov_y_deg=1,
        width=2,
        height=2,
    )
    image = ss.render(scene, camera, light, ss.Convolution(max_size=max_size))
    assert image.mask.all()
    assert (image.mesh_id == 0).all()
    return image.visibility


HEIGHTS = [2.0**-k for k in range(-1, 6)] + [0.1, 0.3, 0.25 * (1 + 2**-23), 1.1, 2.9, 3.9, 3.9999]
TURNS = {
    "level": np.eye(3),
    "turned": _rotation((1, 2, 3), 1.1),
    "upright": _rotation((1, 0, 0), np.pi / 2),
}


@pytest.mark.parametrize("turn", TURNS)
def test_a_flat_board_casts_an_umbra_at_every_height(turn):
    """A parallel sheet lies exactly on every bound that its height goes into.

    Of 98 boards 39 had no shadow. Below the middle, boards as large as the light's image and its
    margin of texels hide all light.
    """
    for height in HEIGHTS:
        for size in (0.25, 0.5, 1, 1.5, 2, 3, 8):
            seen = _under_a_board([_square(height, size)], TURNS[turn])
            # What the sum of a kernel's weights, of as many as 2^18 roundings, lets through.
            assert seen.max() < 1e-3, (height, size, seen)


def test_boards_on_the_bound_between_two_windows_are_drawn_once():
    """The first window's scales end where the light's image is as wide as the receiver."""
    # Light 0.4 on a ground of 4: half of it 0.05 edges, so a scale of 10, 10/11 of the height.
    for height in np.nextafter(40 / 11, [0, 40 / 11, 4]):
        for size in (0.25, 1, 3):
            for boards in ([_square(height, size)], [_square(height, size), _square(1, 0.5)]):
                assert _under_a_board(boards, np.eye(3)).max() < 2e-3, (height, size)
    # Half of the light's image is hidden by a half-plane, at any scale.
    half = quad((5, 0, 40 / 11), (10, 0, 0), (0, 20, 0))
    for height in 40 / 11 * (1 + np.linspace(-1e-3, 1e-3, 9)):
        half[0][:, 2] = height
        assert np.abs(_under_a_board([half], np.eye(3)) - 0.5).max() < 0.02, height


def test_flat_boards_in_one_plane_and_above_each_other():
    """As many bounds as boards: coplanar ones, stacked ones, and one that leans."""
    lean = _square(1, 1)
    lean[0][:, 2] += 0.3 * lean[0][:, 0]
    left, right = quad((-1, 0, 1), (2, 0, 0), (0, 4, 0)), quad((1, 0, 1), (2, 0, 0), (0, 4, 0))
    for boards in (
        [left, right],
        [_square(1, 1), _square(1, 1)],
        [_square(1, 1), _square(0.5, 1)],
        [_square(1, 0.5), _square(1 + 2**-20, 1)],
        [_square(2, 0.5), _square(1, 1)],
        [lean],
        [lean, _square(1.5, 2)],
    ):
        for turn in TURNS.values():
            assert _under_a_board(boards, turn).max() < 2e-3, boards


# ---------------------------------------------------------------- small polygons


def _domed_ground(n):
    """A ground of ``2 n**2`` triangles, none of which rises over the plane of another."""
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1))
    # Of a sphere of radius 100: far more than rounding, far less than what a penumbra shows.
    z = -(x**2 + y**2) / 200
    i = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]
    faces = [np.stack(t, -1).reshape(-1, 3) for t in ([a, b, c], [a, c, d])]
    return np.stack([x, y, z], -1).reshape(-1, 3), np.concatenate(faces)


@pytest.mark.parametrize("kind", ["rect", "disk"])
@pytest.mark.parametrize("blocker", SHEETS)
def test_small_polygons_are_as_exact_as_large_ones(kind, blocker):
    """A parallel set-up over a ground of 5,000 triangles, whose texels are found one by one."""
    _, camera, light = _parallel(kind, SHEETS[blocker])
    scene = ss.Scene()
    scene.add(_domed_ground(50), "ground")
    scene.add(SHEETS[blocker], "blocker")
    error = _ground_error((scene, camera, light), ss.Convolution(texel=1 / 200))
    # Measured: at most 0.0017 and 0.006, no more than with pictures of whole windows.
    assert error.mean() < 0.003
    assert np.quantile(error, 0.99) < 0.01


@pytest.mark.parametrize("size", [0.0, 1e-6])
def test_small_polygons_under_a_light_without_extent(size):
    """Its image is a point: what is hidden is all or nothing, but within a texel of an edge."""
    _, camera, _ = _parallel("rect", SHEETS["half-plane"])
    light = ss.SphereLight((0, 0, 1), size)
    scene = ss.Scene()
    scene.add(_domed_ground(20), "ground")
    scene.add(SHEETS["turned square"], "blocker")
    images = [ss.render(scene, camera, light, m) for m in (ss.Convolution(texel=1 / 50), "hard")]
    ground = images[0].mask & (images[0].mesh_id == 0)
    seen = images[0].visibility[ground]
    assert ((seen > 0.001) & (seen < 0.999)).mean() < 0.1
    assert np.abs(seen - images[1].visibility[ground]).mean() < 0.02
