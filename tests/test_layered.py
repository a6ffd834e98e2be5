"""Ray-traced layered shadow maps: `slsm`, `mlsm` and `mtsm`."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from bits import digest, with_threads
from shapes import quad

GROUND = quad((0, 0, 0), (6, 0, 0), (0, 6, 0))
REFERENCE = ss.RayTraced(samples=256, pattern="fixed")
MAPS = {"slsm": ss.Slsm, "mlsm": ss.Mlsm, "mtsm": ss.Mtsm}
LIGHT = ss.RectLight((0, 0, 4), (0, 0.4, 0), (0.4, 0, 0))
UP = (0.0, 0.0, 1.0)


def _render(setup, method):
    return ss.render(setup.scene, setup.camera, setup.light, method)


def _error(setup, method, reference=None):
    """Mean absolute error over the picture, and over its penumbrae."""
    exact = _render(setup, REFERENCE) if reference is None else reference
    return _apart(_render(setup, method), exact)


def _apart(image, exact):
    """The same of an image that is rendered."""
    partly = exact.mask & (exact.visibility > 0.002) & (exact.visibility < 0.998)
    error = np.abs(image.visibility.astype(np.float64) - exact.visibility)
    return error[exact.mask].mean(), error[partly].mean()


def _sheets(*sheets, opacity=0.5):
    """Quads over a ground."""
    scene = ss.Scene()
    scene.add(GROUND, "ground", casts=False)
    for sheet in sheets:
        scene.add(sheet, opacity=opacity)
    return scene


def _grid(half, count=12, z=0.0):
    a = np.linspace(-half, half, count)
    x, y = np.meshgrid(a, a)
    points = np.stack([x, y, 0 * x + z], axis=-1).reshape(-1, 3)
    return points, np.broadcast_to(UP, points.shape)


# ---------------------------------------------------------------- transparent sheets


@pytest.mark.parametrize(
    "light", [LIGHT, ss.DiskLight((0, 0, 4), (0, 0, -1), 0.2), ss.SphereLight((0, 0, 4), 0.2)]
)
def test_crossings_multiply(light):
    low, high = quad((0, 0, 1), (4, 0, 0), (0, 4, 0)), quad((0, 0, 2), (4, 0, 0), (0, 4, 0))
    tilted = quad((0, 0, 1.5), (4, 0, 1.2), (0, 4, 0.5))
    points, normals = _grid(0.5)
    for scene, expected in (
        (_sheets(low, high), 0.25),
        # Faces that are there twice count twice.
        (_sheets(low, low), 0.25),
        (_sheets(low, high, opacity=0.0), 1.0),
        (_sheets(low, high, opacity=1.0), 0.0),
    ):
        for resolution in (64, 512):
            # One crossing per sheet and segment, whatever the texels: products of 0.5.
            seen = ss.visibility(scene, points, normals, light, ss.Mtsm(resolution, 4))
            assert np.abs(seen - expected).max() < 2e-6, (expected, resolution)
    # At a corner of texels of a tilted sheet, rectangles through the middles of the sides may count
    # a sample twice or not at all, so that none is lost in the mean. Points at random, or texels
    # line up with them: from 64 to 2048 texels at most three samples of 256 (measured), any at 1 to
    # 5 % of the points, and 0.00003 in the mean.
    xy = np.random.default_rng(1).uniform(-0.5, 0.5, (10_000, 2))
    points, normals = np.pad(xy, ((0, 0), (0, 1))), np.broadcast_to(UP, (10_000, 3))
    for resolution in (64, 512):
        error = ss.visibility(_sheets(tilted), points, normals, light, ss.Mtsm(resolution, 4)) - 0.5
        assert np.abs(error).max() < 3.5 * 0.5 / 256, resolution
        assert (np.abs(error) > 1e-6).mean() < 0.07
        assert abs(error.mean()) < 1e-4


def test_staggered_sheets_let_half_through_and_subtraction_as_printed_does_not():
    """Every segment meets one of two sheets; where they overlap in the map, it misses the other."""
    left = quad((-2.0, 0, 2), (4.2, 0, 0), (0, 4, 0))
    right = quad((1.95, 0, 1), (4, 0, 0), (0, 4, 0))
    scene = _sheets(left, right)
    points, normals = _grid(0.1, 40)
    light = ss.RectLight((0, 0, 4), (0, 1.0, 0), (1.0, 0, 0))
    traced = ss.visibility(scene, points, normals, light, REFERENCE)
    multiply, subtract = (
        ss.visibility(scene, points, normals, light, ss.Mtsm(512, 4, crossing=c))
        for c in ("multiply", "subtract")
    )
    # Half of the light is lost at an edge, a texel is at most 0.016 (measured: 0.0045).
    assert np.abs(multiply - traced).mean() < 0.008
    # Segments past the first sheet lose 0.25 at the second where they should lose 0.5.
    assert (subtract - traced).max() > 0.05
    assert subtract.mean() > multiply.mean() + 0.005


def test_where_segments_go_the_map_s_own_way_both_modes_agree():
    upper, lower = quad((0, 0, 3.5), (2, 0, 0), (0, 2, 0)), quad((0, 0, 0.5), (8, 0, 0), (0, 8, 0))
    scene = _sheets(upper, lower)
    points = np.array([[1.7, 0.0, 0.0]])
    light = ss.RectLight((1.7, 0, 4), (0, 0.2, 0), (0.2, 0, 0))
    for crossing in ("multiply", "subtract"):
        seen = ss.visibility(scene, points, [UP], light, ss.Mtsm(512, 4, crossing=crossing))
        assert abs(seen[0] - 0.5) < 1e-6


def test_thousands_of_crossings_become_a_few_layers():
    each = 1 - 0.2 ** (1 / 3000)
    vertices, faces = [], []
    for k in range(3000):
        v, f = quad((0, 0, 1 + 0.0002 * k), (3, 0, 0), (0, 3, 0))
        faces.append(np.asarray(f) + 4 * k)
        vertices.append(v)
    scene = ss.Scene()
    scene.add(GROUND, "ground", casts=False)
    scene.add((np.concatenate(vertices), np.concatenate(faces)), opacity=each)
    points, normals = _grid(0.3, 4)
    seen = ss.visibility(scene, points, normals, LIGHT, ss.Mtsm(32, 5))
    # The compression keeps the product; powers and roots in single precision.
    assert np.abs(seen - 0.2).max() < 1e-3


# ---------------------------------------------------------------- against the reference


@pytest.mark.parametrize("name", MAPS)
@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
def test_half_plane(name, kind):
    setup = ss.scenes.half_plane(96, 96, light=kind)
    # A straight edge at one depth, through coarser levels (measured: 0.0010, sphere 0.0072).
    assert _error(setup, MAPS[name](resolution=1024))[1] < 0.008


def test_opaque_scenes_get_the_same_bits_from_several_layers():
    setup = ss.scenes.closed_solids(64, 64, detail=3)
    one, two = (_render(setup, m(256, 4)).visibility for m in (ss.Mlsm, ss.Mtsm))
    assert np.array_equal(one, two)
    # One layer is one layer; triangles answer next to receivers of the others alone.
    single = _render(setup, ss.Slsm(256)).visibility
    assert np.array_equal(single, _render(setup, ss.Mlsm(256, 1, near=0.0)).visibility)


def test_the_light_points_are_those_of_the_reference():
    """Bands in a penumbra lie where the reference has them, and not those of another seed."""
    setup = ss.scenes.half_plane(96, 96, light="rect")
    own, other = (_render(setup, ss.RayTraced(16, seed=s, pattern="fixed")) for s in (3, 4))
    # All levels of the map but the finest are left out (measured: 0.0009 and 0.026).
    found = _render(setup, ss.Mtsm(4096, 1, samples=16, seed=3, detail=1000))
    assert _apart(found, own)[1] < 0.1 * _apart(found, other)[1]


@pytest.mark.parametrize(
    ("name", "scene"), [("slsm", "statue"), ("mtsm", "statue"), ("mtsm", "tree"), ("mtsm", "fur")]
)
def test_dense_scenes(name, scene):
    k = {"width": 128, "height": 128}
    setup = {
        "statue": lambda: ss.scenes.statue(subdivisions=0, **k),
        "tree": lambda: ss.scenes.tree(leaves=20_000, **k),
        "fur": lambda: ss.scenes.fur_ball(triangles=60_000, **k),
    }[scene]()
    image, penumbra = _error(setup, MAPS[name]())
    # The targets, and for one layer what is missing behind it (measured: 0.0024 and 0.0094,
    # 0.0035 and 0.0125, 0.0060 and 0.0176; one layer 0.0074 and 0.0203).
    bounds = {"statue": (0.005, 0.015), "tree": (0.01, 0.03), "fur": (0.01, 0.03)}[scene]
    if name == "slsm":
        bounds = (0.012, 0.03)
    assert image < bounds[0]
    assert penumbra < bounds[1]


def test_layers_and_translucency_of_a_tree():
    setup = ss.scenes.tree(96, 96, leaves=20_000, opacity=0.5)
    reference = _render(setup, REFERENCE)
    found = {k: _error(setup, ss.Mtsm(512, k), reference)[0] for k in (1, 5)}
    opaque = _error(setup, ss.Mlsm(512, 5, opacity="opaque"), reference)[0]
    # Measured: 0.0057 of five layers, 0.0140 of one, 0.0240 if all is opaque.
    assert found[5] < 0.008
    assert found[5] < 0.5 * found[1]
    assert found[5] < 0.3 * opaque


def test_the_error_grows_far_less_than_that_of_filtering_as_the_light_grows():
    """Figure 4 of the paper."""
    errors = {"pcf": [], "mtsm": []}
    for size in (0.1, 0.4, 0.8):
        setup = ss.scenes.closed_solids(96, 96, light_size=size, detail=3)
        reference = _render(setup, REFERENCE)
        for name, found in errors.items():
            found.append(_error(setup, name, reference)[0])
    # Measured: 0.0015, 0.0084, 0.0253 and 0.00001, 0.0003, 0.0007 (0.0004 to 0.0009 of the map
    # alone): more penumbra, and less of it next to receivers.
    assert errors["pcf"][2] > 10 * errors["pcf"][0]
    assert errors["mtsm"][0] < 0.0001
    assert errors["mtsm"][2] < 0.05 * errors["pcf"][2]


def test_four_lights_at_once():
    setup = ss.scenes.closed_solids(96, 96, detail=3)
    lights = [ss.SphereLight((x, y, 3.0), 0.3) for x in (-1, 1) for y in (-1, 1)]
    traced, image = (
        ss.render(setup.scene, setup.camera, lights, m) for m in (REFERENCE, ss.Mtsm(2048))
    )
    for found, expected in zip(image.visibility, traced.visibility, strict=True):
        error = (found - expected)[image.mask]
        # The same light points: what is left is the coarser levels', 0.009 of the 6 to 11 % that
        # are penumbra, so that texels do not matter (measured: 0.0007 to 0.0010, of 512 as well).
        assert np.abs(error).mean() < 0.0015
        assert -0.001 < error.mean() <= 0


# ---------------------------------------------------------------- limits


@pytest.mark.parametrize("kind", ["sphere", "disk"])
def test_a_light_of_radius_zero_tends_to_hard_shadows(kind):
    for size in (0.0, 1e-4):
        s = ss.scenes.closed_solids(96, 96, kind, size, detail=3)
        hard = _render(s, "hard")
        image = _render(s, ss.Mtsm(2048, 4, samples=16))
        # Half a texel is 2 % of a pixel, and edges are some 300 pixels long: six may differ
        # (measured: 2 and 4 of 7,714).
        assert (image.visibility != hard.visibility)[image.mask].sum() <= 6


@pytest.mark.parametrize("scale", [2.0**-20, 2.0**20])
def test_scaled_scenes_give_the_same_bits(scale):
    plain, other = (_scaled(s, 0.0) for s in (1.0, scale))
    assert np.array_equal(plain, other)


@pytest.mark.parametrize(("scale", "move"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e4), (1e-3, 50.0)])
def test_scaled_and_moved_scenes_give_the_same(scale, move):
    plain, other = _scaled(1.0, 0.0), _scaled(scale, move)
    # Rounding may move a sample over a texel's side, in one pixel of a thousand (measured: one of
    # 4,096, with a scale of 1e6).
    assert (plain != other).mean() < 1e-3
    assert np.abs(plain - other).max() <= 1 / 256


def _scaled(scale, move):
    def at(p):
        return np.asarray(p, dtype=np.float64) * scale + move

    scene = ss.Scene()
    for (v, f), name in (
        (GROUND, "ground"),
        (quad((0, 0, 1), (0.7, 0, 0.2), (0, 0.5, 0)), "a"),
        (quad((0.3, 0.1, 0.4), (0.7, 0, 0), (0, 0.5, 0.3)), "b"),
    ):
        scene.add((at(v), f), name)
    light = ss.RectLight(at((0.6, -0.4, 2.5)), (0, 0.4 * scale, 0), (0.4 * scale, 0, 0))
    camera = ss.Camera(at((0.4, -3.2, 2.0)), at((0, 0.1, 0.3)), width=64, height=64)
    return ss.render(scene, camera, light, ss.Mtsm(256)).visibility


def test_what_is_behind_a_flat_light_hides_nothing():
    """Geometry behind the light, cut by its plane, and receivers at its height and above."""
    scene = ss.Scene()
    scene.add(GROUND, "ground", casts=False)
    scene.add(quad((0, 0, 2.5), (1, 0, 0), (0, 1, 0)), "behind")
    scene.add(quad((1.0, 0, 2.0), (0, 0, 1.0), (0, 1, 0)), "across")
    light = ss.RectLight((0, 0, 2), (0, 0.4, 0), (0.4, 0, 0))
    x = np.linspace(-2, 4, 60)
    points = np.concatenate([np.stack([x, 0 * x, h + 0 * x], 1) for h in (0.0, 1.9, 2.0, 2.2)])
    for normals in (None, np.broadcast_to((-0.6, 0, 0.8), points.shape)):
        traced = ss.visibility(scene, points, normals, light, REFERENCE)
        found = ss.visibility(scene, points, normals, light, ss.Mtsm(512, 4))
        fine = ss.visibility(scene, points, normals, light, ss.Mtsm(512, 4, detail=1000))
        # Edges that go along the map's columns and rows: one sample may lie within half a bin.
        assert np.abs(fine - traced).max() <= 1 / 256
        low, grazing, *above = np.split(np.abs(found - traced), 4)
        assert (np.array(above) == 0).all()
        # The coarser levels: a fortieth of the light at an edge (measured: 0.035), and up to half
        # of it where segments graze the upright board, which comes into several of them (0.50).
        assert low.max() < 1.5 / 40
        assert grazing.mean() < 0.04


def test_a_light_inside_a_scene_casts_to_all_sides():
    """A cube's faces, and segments across their borders."""
    scene = ss.Scene()
    points, normals = [], []
    for axis in range(3):
        for sign in (-1, 1):
            u, v = np.roll(np.eye(3), -axis - 1, axis=0)[:2]
            out = sign * np.eye(3)[axis]
            scene.add(quad(2 * out, 4 * u, 4 * v), f"wall {axis} {sign}")
            scene.add(quad(0.8 * out + 0.7 * u, 0.5 * u, 0.7 * v), f"board {axis} {sign}")
            a, b = np.meshgrid(np.linspace(-1.9, 1.9, 30), np.linspace(-1.9, 1.9, 30))
            points.append((2 * out + a[..., None] * u + b[..., None] * v).reshape(-1, 3))
            normals.append(np.broadcast_to(-out, points[-1].shape))
    light = ss.SphereLight((0.05, 0.02, -0.03), 0.1)
    points, normals = np.concatenate(points), np.concatenate(normals)
    reference = ss.visibility(scene, points, normals, light, REFERENCE)
    found = ss.visibility(scene, points, normals, light, ss.Mtsm(512, 4))
    # Of the coarser levels (measured: 0.0004 to 0.0019, and a third if there are none).
    for wall in np.split(np.abs(found - reference), 6):
        assert wall.mean() < 0.003


@pytest.mark.parametrize("resolution", [128, 256])
def test_hair_thinner_than_a_texel_casts_in_the_mean(resolution):
    """Across the texels, so that every row of them meets the hairs at other places."""
    along, across = (
        np.array((-np.sin(0.3), np.cos(0.3), 0)),
        np.array((np.cos(0.3), np.sin(0.3), 0)),
    )
    hairs = [
        quad(a * across + (0, 0, 1), 0.0008 * across, 1.4 * along)
        for a in np.linspace(-0.5, 0.5, 400)
    ]
    vertices = np.concatenate([v for v, _ in hairs])
    faces = np.concatenate([np.asarray(f) + 4 * k for k, (_, f) in enumerate(hairs)])
    scene = _sheets((vertices, faces), opacity=1.0)
    points, normals = _grid(0.2, 16)
    found = ss.visibility(scene, points, normals, LIGHT, ss.Mtsm(resolution, 2))
    traced = ss.visibility(scene, points, normals, LIGHT, REFERENCE)
    # They hide 0.0008 of every 1 / 399. Three standard errors of 65,536 samples.
    seen = 1 - 0.0008 * 399
    spread = np.sqrt(seen * (1 - seen))
    assert abs(traced.mean() - seen) < 3 * spread / 256
    # All that is looked at is 0.4 wide there: three standard errors if texels were independent
    # (measured: 0.023 and 0.001 of 0.046 and 0.023).
    texel = 1.68 / resolution
    assert abs(found.mean() - traced.mean()) < 3 * spread / (0.4 / texel)


def test_a_depth_ratio_of_a_hundred_thousand():
    scene = ss.Scene()
    scene.add(quad((0, 0, -1e5), (4e5, 0, 0), (0, 4e5, 0)), "far")
    scene.add(quad((0, 0, -1.0), (1, 0, 0), (0, 1, 0)), "near")
    light = ss.RectLight((0, 0, 0), (0, 0.5, 0), (0.5, 0, 0))
    a = np.linspace(-1.5e5, 1.5e5, 40)
    points = np.stack([a, 0 * a, 0 * a - 1e5], 1)
    normals = np.broadcast_to(UP, points.shape)
    traced = ss.visibility(scene, points, normals, light, REFERENCE)
    found = ss.visibility(scene, points, normals, light, ss.Mtsm(1024, 2))
    assert ((traced > 0) & (traced < 1)).sum() > 10
    # Half of a texel of the coarser levels, of which 20 are told apart across the light (measured:
    # 4 of 256 samples).
    assert np.abs(found - traced).max() < 1 / 40


@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
@pytest.mark.parametrize("name", MAPS)
def test_random_soups_give_finite_visibilities(name, kind):
    """Open, non-manifold, with degenerate, edge-on and duplicate faces, through the light."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        vertices = rng.normal(size=(40, 3))
        faces = rng.integers(0, 40, size=(60, 3))
        faces[:3] = faces[3:6]
        faces[6] = faces[6, 0]
        vertices[faces[7], 0] = 0.0
        scene = ss.Scene()
        scene.add((vertices, faces), "soup", opacity=0.5 if name == "mtsm" else 1.0)
        center = rng.normal(size=3) * (0.3 if seed % 2 else 3.0)
        light = ss.scenes.light_towards(kind, center, 0.5, (0.1, 0.2, 0.3))
        points = np.concatenate([rng.normal(size=(300, 3)) * 2, vertices, [light.center]])
        for normals in (None, rng.normal(size=points.shape)):
            method = MAPS[name](resolution=64, samples=16)
            seen = ss.visibility(scene, points, normals, light, method)
            assert np.isfinite(seen).all()
            assert seen.min() >= 0
            assert seen.max() <= 1


def test_the_bits_do_not_depend_on_the_number_of_threads():
    def digests():
        setups = [ss.scenes.closed_solids(64, 64, detail=3, opacity=o) for o in (1, 0.5)]
        return tuple(digest(_render(s, ss.Mtsm(samples=64)).visibility) for s in setups)

    found = with_threads(digests, 1, 3)
    assert len(found) == 1
    assert len(set(found.pop())) == 2


def test_the_maps_are_arrays():
    scene = ss.Scene()
    for k in range(3):
        scene.add(quad((0, 0, 1 - k), (2, 0, 0), (0, 2, 0)), f"sheet {k}", opacity=0.5)
    first, *rest = ss.kernels.layered_maps(scene, LIGHT, ss.Mtsm(64, 4))
    depths = first.depths
    assert depths.shape[2] == 4
    # Sheets with something behind them: two of three; the last has a coarse view of its own.
    assert len(rest) == 1
    h, w = np.array(depths.shape[:2]) // 2
    away = np.linalg.norm(first.camera.eye - np.array(LIGHT.center))
    assert np.allclose(depths[h, w, :2], [away + 3, away + 4], rtol=1e-6)
    assert np.isinf(depths[h, w, 2:]).all()
    assert np.allclose(first.visibility[h, w], [0.5, 0.25, 1, 1])
    assert (first.counts[h, w] == [1, 1, 0, 0]).all()
    assert np.array_equal(first.first_depths[h, w], depths[h, w])
    opaque = ss.kernels.layered_maps(scene, LIGHT, ss.Mlsm(64, opacity="opaque"))[0]
    # Two layers are what the scene fills.
    assert opaque.depths.shape[2] == 2
    assert opaque.visibility is None


# ---------------------------------------------------------------- parameters


@pytest.mark.parametrize(
    ("method", "bad"),
    [
        (ss.Slsm, {"resolution": 15}),
        (ss.Slsm, {"samples": 0}),
        (ss.Mlsm, {"resolution": 1 << 15}),
        (ss.Mlsm, {"layers": 0}),
        (ss.Mtsm, {"layers": 65}),
        (ss.Mtsm, {"samples": 65537}),
        (ss.Mtsm, {"bias": -1.0}),
        (ss.Mtsm, {"z_threshold": float("nan")}),
        (ss.Mtsm, {"detail": 0.5}),
        (ss.Mtsm, {"error": 1.5}),
        (ss.Mtsm, {"threshold": -0.1}),
        (ss.Mtsm, {"resets": 65}),
        (ss.Mtsm, {"crossing": "add"}),
        (ss.Mtsm, {"opacity": "clear"}),
    ],
)
def test_parameters_are_checked(method, bad):
    setup = ss.scenes.closed_solids(16, 16, detail=1)
    with pytest.raises(ss.ParameterError, match=f"{method.__name__}.*{next(iter(bad))}"):
        _render(setup, method(**bad))


def test_a_map_that_does_not_fit_into_memory_is_told():
    setup = ss.scenes.closed_solids(16, 16, detail=1)
    with pytest.raises(ss.ParameterError, match="GB, more than there is"):
        _render(setup, ss.Mlsm(16384, 64))


def test_the_agreed_defaults():
    assert ss.Slsm() == ss.Slsm(resolution=1024, samples=256, seed=0)
    assert ss.Mlsm() == ss.Mlsm(resolution=None, layers=None, samples=256, seed=0)
    assert ss.Mtsm() == ss.Mtsm(resolution=None, layers=None, samples=256, seed=0)
    assert set(MAPS) < set(ss.method_names())


@pytest.mark.parametrize("name", ["slsm", "mlsm"])
def test_opaque_maps_tell_what_is_transparent(name):
    clear = ss.scenes.closed_solids(16, 16, detail=1, opacity=0.5)
    with pytest.raises(ss.UnsupportedError, match="opacity"):
        _render(clear, name)
    _render(clear, MAPS[name](opacity="opaque"))


@pytest.mark.parametrize("name", MAPS)
def test_nothing_that_casts_is_all_lit(name):
    scene = ss.Scene()
    scene.add(GROUND, "ground", casts=False)
    for light in (ss.SphereLight((0, 0, 2), 0.2), ss.DiskLight((0, 0, 2), (0, 0, -1), 0.2)):
        seen = ss.visibility(scene, [(0, 0, 0.0)], [UP], light, name)
        assert (seen == 1).all()
