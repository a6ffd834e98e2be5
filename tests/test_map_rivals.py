"""The rivals of ray-traced layered maps: `pcf` and `deep`, which filter a map, and `mvsm`."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
import trimesh
from bits import digest, with_threads
from clocks import Stopwatch
from shapes import bumpy, quad

GROUND = quad((0, 0, 0), (6, 0, 0), (0, 6, 0))
REFERENCE = ss.RayTraced(samples=256, seed=5)
RIVALS = {"pcf": ss.Pcf(), "deep": ss.DeepShadow(), "mvsm": ss.Mvsm()}
COARSE = {name: type(method)(resolution=256) for name, method in RIVALS.items()}
"""For what does not depend on it: maps of 1024² take most of a test's time."""
FILTERS = {"pcf": ss.Pcf, "deep": ss.DeepShadow}


def _render(setup, method):
    return ss.render(setup.scene, setup.camera, setup.light, method)


def _error(setup, method, reference=None):
    """Mean absolute error over the picture."""
    exact = _render(setup, REFERENCE) if reference is None else reference
    found = _render(setup, method)
    return np.abs(found.visibility.astype(np.float64) - exact.visibility)[exact.mask].mean()


# ---------------------------------------------------------------- closed forms


@pytest.mark.parametrize("sheets", [1, 2])
@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
def test_deep_shadows_of_translucent_sheets(kind, sheets):
    setup = ss.scenes.tilted_sheet(64, 64, light=kind, opacity=0.5, sheets=sheets)
    image = _render(setup, ss.DeepShadow())
    at = image.position[..., :2]
    under = image.mask & (image.mesh_id == 0) & (np.abs(at).max(axis=2) < 0.5)
    assert under.sum() > 500
    # Products of 0.5 in single precision.
    assert np.abs(image.visibility[under] - 0.5**sheets).max() < 1e-6


def test_a_medium_of_many_layers_fades_the_light_of_what_is_in_it():
    """Fifty sheets that together let 20 % through, compressed to few layers."""
    scene = ss.Scene()
    each = 0.2 ** (1 / 50)
    for k in range(50):
        scene.add(quad((0, 0, 1 + 0.01 * k), (3, 0, 0), (0, 3, 0)), opacity=1 - each)
    scene.add(GROUND, "ground")
    light = ss.RectLight((0, 0, 4), (0, 0.2, 0), (0.2, 0, 0))
    heights = np.array([0.5, 1.005, 1.105, 1.255, 1.405, 1.495, 1.6])
    points = np.column_stack([0.1 + 0 * heights, 0 * heights, heights])
    above = np.array([(1 + 0.01 * np.arange(50) > h).sum() for h in heights])
    expected = each**above
    for layers, error in ((2, 0.06), (4, 0.03), (8, 0.02)):
        # The compression keeps its error within the bound while layers last.
        method = ss.DeepShadow(256, layers, error=0.02, bias=0.0)
        seen = ss.visibility(scene, points, None, light, method)
        assert np.abs(seen - expected).max() < error + 0.02, layers


@pytest.mark.parametrize("name", FILTERS)
def test_a_flat_occluder_parallel_to_the_light_is_filtered_exactly(name):
    """At one depth the filter's samples are the rays to the light."""
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    scene.add(quad((0, 0, 1), (0.5, 0.1, 0), (-0.1, 0.5, 0)), "board")
    light = ss.RectLight((0, 0, 3), (0, 0.5, 0), (0.5, 0, 0))
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.8, 0.8, (2000, 2)), np.zeros(2000)])
    up = np.broadcast_to((0.0, 0.0, 1.0), points.shape)
    method = FILTERS[name](samples=256, resolution=2048)
    seen = ss.visibility(scene, points, up, light, method)
    traced = ss.visibility(scene, points, up, light, ss.RayTraced(256))
    # The same light points: only rays within a texel of an edge of the board may differ.
    assert (np.abs(seen - traced) > 0.02).mean() < 0.01
    assert np.abs(seen - traced).mean() < 0.002


# ---------------------------------------------------------------- against the reference


def test_the_filter_s_error_grows_with_the_light_and_that_of_traced_maps_hardly_does():
    """Figure 4 of the paper, on closed bodies over a ground."""
    errors = {"pcf": [], "mvsm": []}
    for size in (0.1, 0.4, 0.8):
        setup = ss.scenes.closed_solids(96, 96, light_size=size, detail=3)
        reference = _render(setup, ss.RayTraced(256, pattern="fixed"))
        for name, found in errors.items():
            found.append(_error(setup, RIVALS[name], reference))
    # Measured: 0.0015, 0.0084, 0.0253 and 0.0010, 0.0013, 0.0019.
    growth = {name: e[2] / e[0] for name, e in errors.items()}
    assert errors["pcf"][0] < errors["pcf"][1] < errors["pcf"][2]
    assert growth["pcf"] > 10
    assert growth["mvsm"] < 3


@pytest.mark.parametrize("name", RIVALS)
def test_all_are_better_than_hard_shadows(name):
    setup = ss.scenes.closed_solids(128, 128, light_size=0.4, detail=3)
    reference = _render(setup, REFERENCE)
    hard = _error(setup, "hard", reference)
    # Measured: 0.43, 0.43 and 0.08.
    assert _error(setup, RIVALS[name], reference) < (0.12 if name == "mvsm" else 0.6) * hard


def test_the_mean_of_the_blockers_depths_is_nearer_than_the_nearest():
    setup = ss.scenes.closed_solids(128, 128, light_size=0.6, detail=3)
    reference = _render(setup, REFERENCE)
    nearest, mean = (_error(setup, ss.Pcf(estimate=e), reference) for e in ("nearest", "mean"))
    # Measured: 0.0168 and 0.0092.
    assert mean < 0.7 * nearest


def _two_boards():
    """A board close to the ground under one that hides it from the light's centre."""
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    scene.add(quad((0, 0, 1.2), (0.6, 0, 0), (0, 0.6, 0)), "upper")
    scene.add(quad((0, 0, 0.3), (0.6, 0, 0), (0, 0.6, 0)), "lower")
    light = ss.RectLight((0, 0, 2.4), (0, 1.0, 0), (1.0, 0, 0))
    camera = ss.Camera((0, -2.4, 2.2), (0, 0, 0.2), width=96, height=96)
    return ss.scenes.Setup(scene, camera, light)


def test_layers_and_views_see_what_the_nearest_surface_hides():
    setup = _two_boards()
    reference = _render(setup, REFERENCE)
    # Measured: 0.0068 and 0.0040; 0.0042 and 0.0014.
    assert _error(setup, ss.Pcf(layers=4), reference) < 0.7 * _error(setup, ss.Pcf(), reference)
    one, five = (_error(setup, ss.Mvsm(views=v), reference) for v in (1, 5))
    assert five < 0.45 * one


def test_translucent_leaves_let_light_through_deep_shadow_maps():
    setup = ss.scenes.tree(96, 96, leaves=20_000, opacity=0.4)
    reference = _render(setup, REFERENCE)
    opaque = _error(setup, ss.Pcf(opacity="opaque"), reference)
    # Measured: 0.032 and 0.022.
    assert _error(setup, ss.DeepShadow(), reference) < 0.8 * opaque


# ---------------------------------------------------------------- leaks and acne


@pytest.mark.parametrize("name", RIVALS)
@pytest.mark.parametrize("resolution", [64, 512])
def test_a_convex_body_has_no_shadow_on_its_lit_side(name, resolution):
    scene = ss.Scene()
    scene.add(GROUND, "ground")
    scene.add(trimesh.creation.box((0.8, 0.8, 0.6)).apply_translation((0, 0, 0.3)), "box")
    light = ss.SphereLight((1.5, -1.4, 2.0), 0.2)
    camera = ss.Camera((2.5, -3.0, 2.0), (0, 0, 0.3), width=96, height=96)
    method = type(RIVALS[name])(resolution=resolution)
    image = ss.render(scene, camera, light, method)
    box = image.mask & (image.mesh_id == 1)
    h = ss.kernels.light_fraction_above(light, image.position[box], image.normal[box])
    lit = image.visibility[box][h == 1]
    assert len(lit) > 500
    assert (lit == 1).all()


# ---------------------------------------------------------------- walls by the light


def test_filtered_maps_let_light_through_beside_walls_as_their_page_says():
    """All blockers count as if at one depth, the nearest to the light: of a wall, the light's own.

    Where the wall hides only what is beyond it.
    """
    answer = ss.scenes.hard["wall_by_the_light"].answer(40, 40)
    setup = answer.setup
    nearest, mean = (
        (image.visibility - answer.image.visibility)[answer.where]
        for image in (
            ss.render(setup.scene, setup.camera, setup.lights, ss.Pcf(estimate=e))
            for e in ("nearest", "mean")
        )
    )
    assert 0.4 < nearest.max() < 0.6
    assert nearest.min() > -0.05
    assert np.abs(mean).mean() < 0.6 * np.abs(nearest).mean()


# ---------------------------------------------------------------- limits


@pytest.mark.parametrize("kind", ["sphere", "disk"])
@pytest.mark.parametrize("name", RIVALS)
def test_a_light_of_radius_zero_tends_to_hard_shadows(name, kind):
    for size in (0.0, 1e-4):
        s = ss.scenes.closed_solids(96, 96, kind, size, detail=3)
        hard = _render(s, "hard")
        image = _render(s, type(RIVALS[name])(resolution=1024, samples=16))
        # A texel's staircase along the edges, and `mvsm`'s start (measured: at most 0.0008).
        assert np.abs(image.visibility - hard.visibility)[image.mask].mean() < 0.0012


@pytest.mark.parametrize("name", RIVALS)
def test_a_light_inside_a_scene_casts_to_all_sides(name):
    scene = ss.Scene()
    points, normals = [], []
    for axis in range(3):
        for sign in (-1, 1):
            u, v = np.roll(np.eye(3), -axis - 1, axis=0)[:2]
            out = sign * np.eye(3)[axis]
            scene.add(quad(2 * out, 4 * u, 4 * v), f"wall {axis} {sign}")
            scene.add(quad(0.8 * out, 0.5 * u, 0.7 * v), f"board {axis} {sign}")
            a, b = np.meshgrid(np.linspace(-1.9, 1.9, 30), np.linspace(-1.9, 1.9, 30))
            points.append((2 * out + a[..., None] * u + b[..., None] * v).reshape(-1, 3))
            normals.append(np.broadcast_to(-out, points[-1].shape))
    light = ss.SphereLight((0.05, 0.02, -0.03), 0.1)
    points, normals = np.concatenate(points), np.concatenate(normals)
    reference = ss.visibility(scene, points, normals, light, REFERENCE)
    found = ss.visibility(scene, points, normals, light, COARSE[name])
    for wall in np.split(np.abs(found - reference), 6):
        # A texel's staircase and the samples' noise (measured: 0.0052 at most).
        assert wall.mean() < 0.008


@pytest.mark.parametrize("name", RIVALS)
@pytest.mark.parametrize(("scale", "move"), [(2.0**-20, 0), (2.0**20, 0), (1.0, 1e4), (1e-3, 50)])
def test_scaled_and_moved_scenes_give_the_same(name, scale, move):
    def picture(scale, move):
        def at(p):
            return np.asarray(p, dtype=np.float64) * scale + move

        scene = ss.Scene()
        scene.add((at(GROUND[0]), GROUND[1]), "ground")
        vertices, faces = bumpy(12, seed=3)
        scene.add((at(vertices * 0.4 + [0, 0, 0.7]), faces), "body")
        light = ss.RectLight(at((0.6, -0.4, 2.5)), (0, 0.4 * scale, 0), (0.4 * scale, 0, 0))
        camera = ss.Camera(at((0.4, -3.2, 2.0)), at((0, 0.1, 0.3)), width=64, height=64)
        return ss.render(scene, camera, light, COARSE[name]).visibility

    plain, other = picture(1.0, 0.0), picture(scale, move)
    if move == 0:
        assert np.array_equal(plain, other)
    else:
        # Rounding moves single samples at edges (measured: at most 1e-6 in the mean).
        assert np.abs(plain - other).mean() < 1e-4


@pytest.mark.parametrize("name", RIVALS)
@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
def test_random_soups_give_finite_visibilities(name, kind):
    """Open, non-manifold, with degenerate and duplicate faces, around and through the light."""
    method = type(RIVALS[name])(resolution=64, samples=16)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        vertices = rng.normal(size=(40, 3))
        faces = rng.integers(0, 40, size=(60, 3))
        faces[:3] = faces[3:6]
        faces[6] = faces[6, 0]
        scene = ss.Scene()
        scene.add((vertices, faces), "soup", opacity=0.5 if method.transparent else 1.0)
        center = rng.normal(size=3) * (0.3 if seed % 2 else 3.0)
        light = ss.scenes.light_towards(kind, center, 0.5, (0.1, 0.2, 0.3))
        points = np.concatenate([rng.normal(size=(300, 3)) * 2, vertices, [light.center]])
        for normals in (None, rng.normal(size=points.shape)):
            seen = ss.visibility(scene, points, normals, light, method)
            assert np.isfinite(seen).all()
            assert seen.min() >= 0
            assert seen.max() <= 1


def test_the_bits_do_not_depend_on_the_number_of_threads():
    def digests():
        setup = ss.scenes.closed_solids(64, 64, detail=3)
        methods = ss.Pcf(128), ss.DeepShadow(128), ss.Mvsm(128, samples=64)
        return tuple(digest(_render(setup, method).visibility) for method in methods)

    found = with_threads(digests, 1, 3)
    assert len(found) == 1
    assert len(set(found.pop())) == 3


# ---------------------------------------------------------------- parameters


@pytest.mark.parametrize(
    ("method", "bad"),
    [
        (ss.Pcf, {"resolution": 15}),
        (ss.Pcf, {"resolution": 1 << 15}),
        (ss.Pcf, {"layers": 0}),
        (ss.Pcf, {"layers": 65}),
        (ss.Pcf, {"samples": 0}),
        (ss.Pcf, {"samples": 65537}),
        (ss.Pcf, {"bias": -1.0}),
        (ss.Pcf, {"bias": float("nan")}),
        (ss.Pcf, {"estimate": "farthest"}),
        (ss.Pcf, {"opacity": "clear"}),
        (ss.DeepShadow, {"layers": 0}),
        (ss.DeepShadow, {"error": -0.1}),
        (ss.DeepShadow, {"error": float("nan")}),
        (ss.DeepShadow, {"estimate": ""}),
        (ss.Mvsm, {"resolution": 0}),
        (ss.Mvsm, {"views": 0}),
        (ss.Mvsm, {"views": 10}),
        (ss.Mvsm, {"samples": -1}),
        (ss.Mvsm, {"gap": -1.0}),
        (ss.Mvsm, {"bias": float("inf")}),
    ],
)
def test_parameters_are_checked(method, bad):
    setup = ss.scenes.closed_solids(16, 16, detail=1)
    name = next(iter(bad))
    with pytest.raises(ss.ParameterError, match=f"{method.__name__}.*{name}"):
        _render(setup, method(**bad))


def test_the_agreed_defaults():
    assert ss.Pcf() == ss.Pcf(resolution=1024, layers=1, samples=64, seed=0)
    assert ss.Mvsm() == ss.Mvsm(resolution=1024, views=5, samples=256, seed=0)
    assert ss.DeepShadow.name == "deep"


@pytest.mark.parametrize("name", RIVALS)
def test_seeds_change_the_samples_and_what_is_transparent_is_told(name):
    setup = ss.scenes.closed_solids(48, 48, detail=2)
    one, same, other = (
        _render(setup, type(RIVALS[name])(128, seed=s)).visibility for s in (0, 0, 1)
    )
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)
    clear = ss.scenes.closed_solids(16, 16, detail=1, opacity=0.5)
    if RIVALS[name].transparent:
        _render(clear, COARSE[name])
        return
    with pytest.raises(ss.UnsupportedError, match="opacity"):
        _render(clear, RIVALS[name])
    _render(clear, type(RIVALS[name])(opacity="opaque"))


@pytest.mark.parametrize("name", RIVALS)
def test_nothing_that_casts_is_all_lit(name):
    scene = ss.Scene()
    scene.add(GROUND, "ground", casts=False)
    for light in (ss.SphereLight((0, 0, 2), 0.2), ss.DiskLight((0, 0, 2), (0, 0, -1), 0.2)):
        seen = ss.visibility(scene, [(0, 0, 0.0)], [(0, 0, 1.0)], light, name)
        assert (seen == 1).all()


@pytest.mark.parametrize("method", [ss.Pcf(64, samples=65536), ss.Mvsm(64, samples=65536)])
def test_progress_is_told_and_can_stop_the_work(method):
    class EnoughError(Exception):
        pass

    told = []

    def callback(fraction):
        told.append(fraction)
        if len(told) == 4:
            raise EnoughError

    setup = ss.scenes.closed_solids(256, 256, detail=2)
    prepared = ss.prepare(setup.scene, setup.light, method)  # which has fractions of its own
    watch = Stopwatch()
    with pytest.raises(EnoughError):
        prepared.render(setup.camera, callback)
    # Told every 0.05 s; then what is being done ends within 0.2 s.
    assert watch.longest() < 2
    assert told == sorted(told)
