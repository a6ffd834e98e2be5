"""Layered maps as arrays: what a scene's become again, and maps that are made by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import softshadow as ss
from shapes import quad

trace, draw = ss.kernels.trace_layered_maps, ss.kernels.layered_maps
NAN, INF = np.nan, np.inf
EYE, HALF, SIDE = 5.0, 2.0, 32
"""Height of the eye of maps made by hand, half of what they hold of the plane z = 0, texels."""
LIGHT = ss.RectLight((0, 0, 4), (0, 0.4, 0), (0.4, 0, 0))
ALONE = {"near": 0.0}
"""The maps, and no triangles in their place."""
FINE = {"detail": 1000.0}
"""Only the map itself, none of its coarser levels, which hold one of four texels."""


def _looking_down(side=SIDE):
    """Right is x, down is -y, forward is -z."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = EYE
    focal = 0.5 * side * EYE / HALF
    k = [[focal, 0, side / 2], [0, focal, side / 2], [0, 0, 1]]
    return ss.Camera.from_matrix(k, pose, side, side)


def _map(*layers, side=SIDE, **arrays):
    """A map of layers, each a height or an array of them."""
    heights = [np.broadcast_to(np.asarray(h, dtype=np.float64), (side, side)) for h in layers]
    depths = EYE - np.stack(heights, axis=-1)
    given = {name: np.broadcast_to(np.asarray(a), depths.shape) for name, a in arrays.items()}
    return ss.kernels.LayeredMap(_looking_down(side), depths, **given)


def _points(half=0.5, count=9):
    a = np.linspace(-half, half, count)
    x, y = np.meshgrid(a, a)
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    return points, np.broadcast_to((0.0, 0.0, 1.0), points.shape)


# ---------------------------------------------------------------- from a scene and back


@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
@pytest.mark.parametrize(
    ("method", "opacity"),
    [
        (ss.Slsm(200), 1.0),
        (ss.Mlsm(256, 3, **ALONE), 1.0),
        (ss.Mtsm(256, **ALONE), 0.5),
        (ss.Mtsm(100, 2, samples=100, seed=4, crossing="subtract", bias=0.01), 0.7),
    ],
)
def test_a_scene_s_maps_answer_as_the_scene_does(kind, method, opacity):
    setup = ss.scenes.closed_solids(64, 64, kind, 0.4, detail=3, opacity=opacity)
    image = ss.render(setup.scene, setup.camera, setup.light, "hard")
    points = image.position[image.mask]
    maps = draw(setup.scene, setup.light, method)
    for normals in (image.normal[image.mask], None):
        found = trace(maps, setup.light, points, normals, method)
        expected = ss.visibility(setup.scene, points, normals, setup.light, method)
        assert expected.min() < 0.5
        assert np.array_equal(found, expected)


@pytest.mark.parametrize("move", [0.0, 1e4])
def test_also_of_a_cube_s_faces_and_far_from_the_origin(move):
    scene = ss.Scene()
    for axis in np.eye(3):
        u, v = np.roll(axis, 1), np.roll(axis, 2)
        for sign in (-1, 1):
            scene.add(quad(move + sign * axis + 0.1 * u, 0.7 * u, 0.7 * v), opacity=0.5)
    light = ss.SphereLight((move, move, move), 0.2)
    rng = np.random.default_rng(0)
    points = move + rng.normal(size=(2000, 3)) * 2
    maps = draw(scene, light, ss.Mtsm(128))
    assert len(maps) > 3
    found = trace(maps, light, points)
    expected = ss.visibility(scene, points, None, light, "mtsm")
    assert expected.std() > 0.1
    # Another resolution; what is compared is that faces and groups are told apart.
    assert np.abs(found - expected).mean() < 0.03
    same = ss.visibility(scene, points, None, light, ss.Mtsm(128, **ALONE))
    assert np.array_equal(found, same)


def test_another_light_than_the_one_a_map_was_drawn_for():
    """A square within the sphere, oblique to the view: its points have different depths there."""
    setup = ss.scenes.closed_solids(64, 64, "sphere", 0.4, detail=3)
    center = np.asarray(setup.light.center)
    square = ss.RectLight(center, (0.2, 0, 0.05), (0, -0.2, 0.02))
    image = ss.render(setup.scene, setup.camera, square, ss.RayTraced(pattern="fixed"))
    maps = draw(setup.scene, setup.light, ss.Mtsm(1024))
    found = trace(maps, square, image.position[image.mask], image.normal[image.mask])
    error = np.abs(found - image.visibility[image.mask])
    assert (image.visibility[image.mask] < 1).mean() > 0.1
    # The sphere that it was drawn for, larger, is off by twice as much (measured: 0.0005, 0.0010).
    assert error.mean() < 0.001


# ---------------------------------------------------------------- by hand


def test_nothing_and_layers_that_fill_all():
    points, normals = _points()
    for maps, expected in (
        ([], 1.0),
        ([_map(INF * -1)], 1.0),
        ([_map(2.0)], 0.0),
        ([_map(2.0, visibility=0.5)], 0.5),
        ([_map(2.0, 1.0, visibility=[0.5, 0.25])], 0.25),
        ([_map(1.0, visibility=0.25, counts=2, first_depths=EYE - 2.0)], 0.25),
        # A group for each: both are looked into.
        (
            [_map(2.0, visibility=0.5), dataclasses.replace(_map(1.0, visibility=0.5), group=1)],
            0.25,
        ),
        # Transmittances win over visibilities; behind what is opaque these start again.
        ([_map(2.0, 1.0, visibility=[0.5, 0.25], transmittance=[0.25, 1.0])], 0.25),
        ([_map(2.0, 1.0, visibility=[0.0, 0.5])], 0.0),
    ):
        for n in (normals, None):
            # Products of powers of two; a sample under the tangent plane there is none.
            assert (trace(maps, LIGHT, points, n) == expected).all(), (maps, expected)


def test_receivers_between_layers_see_those_above_them_only():
    points, _ = _points()
    maps = [_map(3.0, 2.0, 1.0, visibility=[0.5, 0.25, 0.125])]
    for height, expected in ((3.5, 1.0), (2.5, 0.5), (1.5, 0.25), (0.5, 0.125)):
        assert (trace(maps, LIGHT, points + np.array((0, 0, height))) == expected).all()


def test_an_opaque_half_is_the_board_that_it_stands_for():
    heights = np.full((SIDE, SIDE), -INF)
    heights[:, : SIDE // 2] = 1.0
    scene = ss.Scene()
    scene.add(quad((-2.0, 0, 1.0), (4, 0, 0), (0, 9, 0)))
    points, normals = _points()
    board = ss.visibility(scene, points, normals, LIGHT, ss.RayTraced(pattern="fixed"))
    found = trace([_map(heights)], LIGHT, points, normals, ss.Mtsm(**FINE))
    assert 0 < board.mean() < 1
    # A column of samples, of 256 one, lies within half a bin's width of the edge.
    assert np.abs(found - board).max() <= 1 / 256 + 1e-6


def test_staggered_halves_count_once_for_every_segment():
    """One layer a texel; a segment that leaves the map's own ray may meet none, one or both."""
    left = np.arange(SIDE) < SIDE // 2
    heights = np.broadcast_to(np.where(left, 2.0, 1.0), (SIDE, SIDE))
    layers = [_map(heights, visibility=0.5)]
    points = np.array([[x, 0.0, 0.0] for x in np.linspace(-0.3, 0.3, 13)])
    found = trace(layers, LIGHT, points, None, ss.Mtsm(**FINE))
    expected = [_brute_force(layers[0], LIGHT, p).mean() for p in points]
    # Texels reach as far as their own ray does: the edges at x = 0 are both there. Up to a column
    # of samples at each of them.
    assert np.abs(found - expected).max() <= 2 * 0.5 / 256 + 1e-6
    assert np.ptp(found) > 0.1


def _brute_force(layers, light, point, samples=256):
    """Transmittance of every light sample's segment, height by height, layer by layer."""
    q, _, _ = ss.kernels.light_samples(light, point, samples)
    out = np.ones(samples)
    camera, depths = layers.camera, layers.depths
    visibility = np.zeros_like(depths) if layers.visibility is None else layers.visibility
    before = np.concatenate([np.ones_like(depths[..., :1]), visibility[..., :-1]], axis=-1)
    through = np.divide(visibility, before, out=np.zeros_like(depths), where=before > 0)
    for depth in np.unique(depths[np.isfinite(depths)]):
        at = point + (q - point) * ((EYE - depth - point[2]) / (q[:, 2:] - point[2]))
        seen = (at - camera.eye) @ camera.camera_to_world[:3, :3] @ camera.K.T / depth
        # All that is looked at here lies within the map.
        column, row = seen[:, :2].astype(int).T
        factors = np.where(depths == depth, through, 1.0).prod(axis=-1)
        out *= factors[row, column]
    return out


@pytest.mark.parametrize("opaque", [True, False])
def test_random_texels_against_every_segment(opaque):
    rng = np.random.default_rng(0)
    shape = (SIDE, SIDE)
    # Layers at different heights, some not there: those behind move up.
    heights = np.sort(rng.choice([0.5, 1.0, 1.5, 2.0, 2.5], (*shape, 3)), axis=-1)[..., ::-1]
    heights = np.where(rng.uniform(size=(*shape, 1)) < 0.4, heights, -INF)
    arrays = {} if opaque else {"visibility": np.cumprod(np.full((*shape, 3), 0.7), axis=-1)}
    layers = _map(*np.moveaxis(heights, -1, 0), **arrays)
    if not opaque:
        layers = dataclasses.replace(layers, visibility=layers.visibility.astype(np.float32))
    points, normals = _points(0.4, 7)
    light = ss.RectLight((0, 0, 4), (0, 1.0, 0), (1.0, 0, 0))
    found = trace([layers], light, points, normals, ss.Mtsm(**FINE))
    expected = np.array([_brute_force(layers, light, p).mean() for p in points])
    error = found - expected
    # A texel's sides are rounded to bins that hold one sample each: of the 49 sides that cross the
    # light on the five heights, a quarter puts its sample on the wrong one, if all neighbours
    # differ and all err to one side. They do not (measured: mean 1.0 and 0.5 of 256).
    assert np.abs(error).max() < 12 / 256
    assert np.abs(error).mean() < 2 / 256


@pytest.mark.parametrize("kind", ["rect", "disk", "sphere"])
@pytest.mark.parametrize("opaque", [True, False])
def test_any_map_that_is_allowed_gives_visibilities(kind, opaque):
    """Depths and slopes of all sizes, gaps, and surfaces before, in and behind the light."""
    for seed in range(8):
        rng = np.random.default_rng(seed)
        shape = (SIDE, SIDE, 4)
        wide = 10.0 ** rng.uniform(-12, 12, shape) if seed % 2 else rng.uniform(0.2, 6, shape)
        depths = np.sort(np.where(rng.uniform(size=shape) < 0.7, wide, INF), axis=-1)
        slopes = rng.normal(size=(*shape, 2)) * 10.0 ** rng.uniform(-8, 8, (*shape, 2))
        arrays = {"slopes": np.where(np.isfinite(depths)[..., None], slopes, 0)}
        if not opaque:
            seen = np.cumprod(rng.uniform(size=shape) ** 0.2, axis=-1, dtype=np.float32)
            counts = 2 ** rng.integers(0, 31, shape)
            arrays |= {"visibility": seen, "counts": np.where(np.isfinite(depths), counts, 0)}
        layers = ss.kernels.LayeredMap(_looking_down(), depths, **arrays)
        light = ss.scenes.light_towards(kind, (0, 0, 4), 0.5, (0.1, 0.2, 0.3))
        points = np.concatenate([rng.normal(size=(300, 3)) * 3, [layers.camera.eye, light.center]])
        for normals in (None, rng.normal(size=points.shape)):
            method = ss.Mtsm(samples=48, threshold=0.0, z_threshold=0.1 if seed > 3 else None)
            found = trace([layers], light, points, normals, method)
            assert np.isfinite(found).all()
            assert found.min() >= 0
            assert found.max() <= 1


# ---------------------------------------------------------------- bad input


def _with(**arrays):
    return lambda: [dataclasses.replace(_map(2.0, 1.0, visibility=[0.5, 0.25]), **arrays)]


def _full(*values):
    return np.broadcast_to(np.array(values), (SIDE, SIDE, len(values)))


def _one(value, at=1):
    """A good array of depths but for one number."""
    depths = np.array(_full(3.0, 4.0))
    depths[3, 5, at] = value
    return depths


@pytest.mark.parametrize(
    ("error", "words", "maps"),
    [
        (ValueError, "expected shape .32, 32, L.", _with(depths=np.ones((4, 4, 2)))),
        (ValueError, "expected shape .32, 32, L.", _with(depths=np.ones((SIDE, SIDE)))),
        (ValueError, "L 1 to 64", _with(depths=np.ones((SIDE, SIDE, 65)))),
        (ValueError, "L 1 to 64", _with(depths=np.ones((SIDE, SIDE, 0)))),
        (TypeError, "depths: expected real", _with(depths=np.ones((SIDE, SIDE, 2), complex))),
        (TypeError, "counts: expected integers", _with(counts=np.ones((SIDE, SIDE, 2)))),
        (ValueError, r"maps\[0\]: texel .3, 5., layer 1: depths", _with(depths=_one(2.5))),
        (ValueError, "texel .3, 5., layer 1: depths", _with(depths=_one(NAN))),
        (ValueError, "texel .3, 5., layer 0: depths", _with(depths=_one(0.0, 0))),
        (ValueError, "texel .3, 5., layer 0: depths", _with(depths=_one(-1.0, 0))),
        (ValueError, "layer 1: depths", _with(depths=_one(INF, 0))),
        (ValueError, "within single precision", _with(depths=_one(1e-60, 0))),
        (ValueError, "visibility must be 0 to 1", _with(visibility=_full(1.5, 0.5))),
        (ValueError, "visibility must be 0 to 1", _with(visibility=_full(NAN, 0.5))),
        (ValueError, "must not increase", _with(visibility=_full(0.5, 0.7))),
        (ValueError, "visibility: expected shape", _with(visibility=_full(0.5))),
        (ValueError, "counts must be 1", _with(counts=_full(1, 0))),
        (ValueError, "counts must be 1", _with(counts=_full(1, -7))),
        (ValueError, "transmittance must be 0 to 1", _with(transmittance=_full(2.0, 0.5))),
        (ValueError, "first_depths must be from", _with(first_depths=_full(3.0, 2.0))),
        (ValueError, "first_depths must be from", _with(first_depths=_full(3.5, 4.0))),
        (ValueError, "slopes must be", _with(slopes=np.full((SIDE, SIDE, 2, 2), INF))),
        (ValueError, "slopes must be", _with(slopes=np.full((SIDE, SIDE, 2, 2), 3e38))),
        (ValueError, "slopes: expected shape", _with(slopes=np.zeros((SIDE, SIDE, 2)))),
        (
            ValueError,
            "counts: given without visibility",
            _with(visibility=None, counts=_full(1, 1)),
        ),
        (ValueError, "together", _with(unit=1.0)),
        (ValueError, "power of two", _with(origin=(0, 0, 0), unit=3.0)),
        (ValueError, "finite", _with(origin=(0, NAN, 0), unit=1.0)),
        (ValueError, "one origin", lambda: [*_with(origin=(0, 0, 0), unit=1.0)(), _map(1.0)]),
    ],
)
def test_maps_are_checked(error, words, maps):
    points, normals = _points()
    with pytest.raises(error, match=words):
        trace(maps(), LIGHT, points, normals)


def test_cameras_points_and_parameters_are_checked():
    points, normals = _points()
    good = _map(1.0)
    wide = ss.Camera.from_matrix(
        good.camera.K * [[2], [1], [1]], good.camera.camera_to_world, SIDE, SIDE
    )
    for call, words in (
        (
            lambda: trace([dataclasses.replace(good, camera=wide)], LIGHT, points),
            "one focal length",
        ),
        (lambda: trace([good], ss.SphereLight((0, 0, 4.9), 0.2), points), "in front of it"),
        (lambda: trace([good], ss.RectLight((0, 0, 5), (0, 1, 0), (1, 0, 0)), points), "in front"),
        (lambda: trace([good], LIGHT, points[:, :2]), "points: expected shape"),
        (lambda: trace([good], LIGHT, points * NAN), "points: point 0 is not finite"),
        (lambda: trace([good], LIGHT, points, normals[:3]), "normals: expected 81"),
        (lambda: trace([good], LIGHT, points, 0 * normals), "normal 0 is zero"),
        (
            lambda: trace([good], LIGHT, points, normals, ss.Mtsm(samples=0)),
            r"samples: expected an integer from 1",
        ),
    ):
        with pytest.raises(ValueError, match=words):
            call()
    assert trace([good], LIGHT, np.zeros((0, 3))).shape == (0,)
