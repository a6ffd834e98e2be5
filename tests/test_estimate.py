"""How wrong a picture is, from a few of its pixels."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
import softshadow as ss
from bits import with_threads
from scipy import stats
from shapes import quad
from softshadow.probing import Strata, gamma_quantile, interval, neighbourhood

SIZE = 64
CAMERA = ss.Camera((0, -0.1, 3), (0, 0, 0), fov_y_deg=40, width=SIZE, height=SIZE)
LIGHT = ss.RectLight((0, 0, 2), (0, 0.3, 0), (0.3, 0, 0))


def _ground(**look):
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (3, 0, 0), (0, 3, 0)), "ground", **look)
    return scene


def _boards():
    scene = _ground()
    scene.add(quad((0.1, 0, 0.4), (0.3, 0.1, 0), (-0.1, 0.3, 0.05)), "board")
    scene.add(quad((-0.4, 0.3, 0.2), (0.1, 0.1, 0), (-0.1, 0.2, 0)), "low board")
    return scene


def _rmse(visibility, reference):
    return ss.metrics.rmse(visibility, reference.visibility, reference.mask)


# What the interval is made of


@pytest.mark.parametrize("shape", [1e-3, 0.1, 1, 7.5, 300, 499])
@pytest.mark.parametrize("part", [0.025, 0.5, 0.975])
def test_gamma_quantiles_are_those_of_scipy(shape, part):
    theirs = stats.gamma.ppf(part, shape, scale=2)
    assert gamma_quantile(part, 2 * shape, 4 * shape) == pytest.approx(theirs, rel=1e-8, abs=1e-12)


@pytest.mark.parametrize("shape", [501, 1e5, 1e9])
def test_gamma_quantiles_of_large_shapes_are_near(shape):
    for part in (0.025, 0.5, 0.975):
        theirs = stats.gamma.ppf(part, shape, scale=2)
        assert gamma_quantile(part, 2 * shape, 4 * shape) == pytest.approx(theirs, rel=1e-5)


def _of_counts(wrong, asked, pixels):
    values = np.zeros(asked)
    values[:wrong] = 1
    return interval([pixels], [values], [np.zeros(asked)], 0.95)


def test_counts_of_rare_pixels_have_the_upper_end_of_their_exact_interval():
    # Garwood's interval of a Poisson count, which Fay and Feuer's is for equal weights.
    for wrong in (1, 3, 20):
        mean, low, high = _of_counts(wrong, 100_000, 10**9)
        assert mean == pytest.approx(wrong / 1e5)
        # The lower end is no nearer than a normal distribution's.
        assert low <= stats.chi2.ppf(0.025, 2 * wrong) / 2e5
        # The count's variance is that of a binomial one: 20 / 100,000 less.
        assert high == pytest.approx(stats.chi2.ppf(0.975, 2 * wrong + 2) / 2e5, rel=1e-3)


def test_a_stratum_where_nothing_is_found_has_the_rule_of_three():
    # Errors of 1 are found where there is suspicion, and might be where there is none.
    values = [np.zeros(1000), np.ones(16)]
    _, _, high = interval([99_984, 16], values, [np.zeros(1000), np.zeros(16)], 0.95)
    # 3.69 / 1000, a two-sided interval's rule of three, and what is known: shape and scale differ.
    assert 0.0036 < high < 0.0045


def test_all_that_was_asked_leaves_no_doubt():
    mean, low, high = _of_counts(3, 100, 100)
    assert low == mean == high == 0.03


def test_neighbourhoods_end_at_the_mask():
    rng = np.random.default_rng(0)
    values, mask = rng.uniform(size=(9, 12)), rng.uniform(size=(9, 12)) < 0.7
    found = neighbourhood(values, mask)
    for y, x in np.ndindex(9, 12):
        around = np.s_[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3]
        expected = values[around][mask[around]].mean() if mask[y, x] else 0
        assert found[y, x] == pytest.approx(expected, rel=1e-12)


def test_more_probes_are_the_same_and_more():
    suspicion = np.r_[np.zeros(5000), np.geomspace(1e-6, 1, 3000)]
    strata = Strata(suspicion, np.random.default_rng(0))
    few, many = (strata.drawn(strata.counts(n)) for n in (512, 1024))
    for a, b in zip(few, many, strict=True):
        assert np.array_equal(a, b[: len(a)])
    assert sum(map(len, strata.drawn(strata.counts(10**6)))) == 8000


# What it holds


@pytest.mark.parametrize("method", ["hard", "pcf", ss.RayTraced(samples=16), "counted"])
def test_the_interval_holds_the_true_error(method):
    scene = _boards()
    image = ss.render(scene, CAMERA, LIGHT, method)
    # The mean of two independent references' products has no bias of their noise.
    a, b = (ss.render(scene, CAMERA, LIGHT, ss.RayTraced(samples=4096, seed=s)) for s in (5, 6))
    seen = image.visibility.astype(np.float64)
    true = np.sqrt(((seen - a.visibility) * (seen - b.visibility))[a.mask].mean())
    runs, precision = 40, 0.5 if method == "counted" else 0.25
    found = [
        ss.estimate_error(image, scene, CAMERA, LIGHT, seed=s, precision=precision)
        for s in range(runs)
    ]
    inside = sum(e.low <= true <= e.high for e in found)
    # 95 of 100 promised: fewer than 34 of 40 by chance once in 10,000 times.
    assert inside >= 34
    # Estimates of the mean square have no bias: within four deviations of their mean.
    squares = np.array([e.rmse**2 for e in found])
    assert abs(squares.mean() - true**2) < 4 * squares.std() / np.sqrt(runs)
    assert all(e.high - e.low <= 2 * precision * max(e.rmse, 1e-3) * (1 + 1e-9) for e in found)


def test_the_map_shows_where():
    scene = _boards()
    image = ss.render(scene, CAMERA, LIGHT, "hard")
    found = ss.estimate_error(image, scene, CAMERA, LIGHT)
    reference = ss.render(scene, CAMERA, LIGHT, ss.RayTraced(samples=1024))
    assert np.sqrt(np.mean(found.map[image.mask] ** 2)) == pytest.approx(found.rmse, rel=1e-5)
    off = np.abs(image.visibility - reference.visibility)
    assert found.map[off > 0.2].min() > 10 * np.median(found.map[off == 0])


def test_several_lights_weigh_the_same():
    scene = _boards()
    lights = [LIGHT, ss.SphereLight((1, 0.5, 2), 0.3)]
    image = ss.render(scene, CAMERA, lights, "hard")
    reference = ss.render(scene, CAMERA, lights, ss.RayTraced(samples=1024, seed=3))
    found = ss.estimate_error(image, scene, CAMERA, lights, precision=0.1)
    assert found.rmse == pytest.approx(_rmse(image.visibility, reference), rel=0.2)
    assert len(found.lights) == 2
    for light, seen, true in zip(found.lights, image.visibility, reference.visibility, strict=True):
        assert light.low <= ss.metrics.rmse(seen, true, image.mask) <= light.high
    mean = np.mean([light.rmse**2 for light in found.lights])
    assert found.rmse**2 == pytest.approx(mean, rel=1e-9)


# At points


def _points(count=3000):
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (count, 2)), np.zeros(count)])
    return points, np.tile([0.0, 0.0, 1.0], (count, 1))


@pytest.mark.parametrize("method", ["hard", ss.RayTraced(samples=16)])
def test_the_interval_holds_the_true_error_at_points(method):
    scene, (points, normals) = _boards(), _points()
    seen = ss.visibility(scene, points, normals, LIGHT, method).astype(np.float64)
    a, b = (
        ss.visibility(scene, points, normals, LIGHT, ss.RayTraced(samples=4096, seed=s))
        for s in (5, 6)
    )
    true = np.sqrt(((seen - a) * (seen - b)).mean())
    found = [ss.estimate_error_at(seen, scene, points, normals, LIGHT, seed=s) for s in range(40)]
    # 95 of 100 promised: fewer than 34 of 40 by chance once in 10,000 times.
    assert sum(e.low <= true <= e.high for e in found) >= 34
    squares = np.array([e.rmse**2 for e in found])
    assert abs(squares.mean() - true**2) < 4 * squares.std() / np.sqrt(len(found))


def test_one_wrong_point_is_found():
    scene, (points, normals) = _ground(), _points()
    seen = np.ones(len(points))
    assert ss.estimate_error_at(seen, scene, points, normals, LIGHT).high == 0
    seen[1234] = 0
    found = ss.estimate_error_at(seen, scene, points, normals, LIGHT)
    assert found.rmse == pytest.approx(len(points) ** -0.5, rel=1e-6)
    assert found.map[1234] == 1
    assert found.map.sum() == 1


def test_points_in_any_number_with_several_lights_and_without_normals():
    scene, (points, normals) = _boards(), _points(2)
    lights = [LIGHT, ss.SphereLight((1, 0.5, 2), 0.3)]
    seen = ss.visibility(scene, points, normals, lights, ss.RayTraced(4096))
    found = ss.estimate_error_at(seen, scene, points, normals, lights)
    assert (found.probes, len(found.lights)) == (2, 2)
    assert found.high < 0.01
    points[:, 2] = 0.01
    seen = ss.visibility(scene, points, None, LIGHT, ss.RayTraced(4096))
    assert ss.estimate_error_at(seen, scene, points, None, LIGHT).high < 0.01
    none = ss.estimate_error_at(np.zeros(0), scene, points[:0], None, LIGHT)
    assert (none.rmse, none.high, none.probes, none.map.shape) == (0, 0, 0, (0,))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"visibility": np.zeros(3)}, ValueError, "visibility: expected .* as the points"),
        ({"visibility": np.full(4, 2.0)}, ValueError, "from 0 to 1 everywhere"),
        ({"points": np.zeros((4, 2))}, ValueError, "points"),
        ({"points": np.full((4, 3), np.nan)}, ValueError, "points"),
        ({"normals": np.zeros((3, 3))}, ValueError, "normals: expected shape"),
        ({"scene": None}, TypeError, "scene"),
        ({"confidence": 1}, ValueError, "confidence"),
    ],
)
def test_bad_points_are_refused(change, error, message):
    given = {"visibility": np.ones(4), "scene": _ground(), "points": np.zeros((4, 3))}
    given |= {"normals": np.tile([0.0, 0, 1], (4, 1)), "light": LIGHT}
    with pytest.raises(error, match=message):
        ss.estimate_error_at(**(given | change))


# Hard cases


@pytest.mark.parametrize("answer", [0, 1])
def test_one_wrong_pixel_is_found(answer):
    # A roof hides all light, or nothing does.
    scene = _ground()
    if answer == 0:
        scene.add(quad((0, 0, 1.9), (2, 0, 0), (0, 2, 0)), "roof")
    camera = ss.Camera((0, -0.1, 1.5), (0, 0, 0), fov_y_deg=40, width=SIZE, height=SIZE)
    visibility = np.full((SIZE, SIZE), float(answer))
    assert ss.estimate_error(visibility, scene, camera, LIGHT).high == 0
    visibility[20, 30] = 1 - answer
    for seed in range(5):
        found = ss.estimate_error(visibility, scene, camera, LIGHT, seed=seed)
        assert found.rmse == pytest.approx(1 / SIZE, rel=1e-6)
        assert found.low <= found.rmse <= found.high


def test_the_shadow_of_a_thin_wire_is_missed_by_no_interval():
    scene = _ground()
    scene.add_curves([[-2, 0.1, 0.2], [2, -0.1, 0.2]], [0, 2], 0.01)
    reference = ss.render(scene, CAMERA, LIGHT, ss.RayTraced(samples=4096))
    # Of a picture without it.
    lit = np.where(reference.mesh_id == 0, 1.0, reference.visibility)
    true = _rmse(lit, reference)
    assert true > 0.04
    found = [ss.estimate_error(lit, scene, CAMERA, LIGHT, seed=s) for s in range(20)]
    # Two misses of 20 are what 95 of 100 have once in four times, four misses once in 60.
    assert sum(e.low <= true <= e.high for e in found) >= 17


@pytest.mark.parametrize("answer", [0.0, 1.0])
def test_a_scene_without_penumbrae_has_no_error_or_a_known_one(answer):
    scene = _ground()
    if answer == 0:
        scene.add(quad((0, 0, 1.9), (2, 0, 0), (0, 2, 0)), "roof")
    camera = ss.Camera((0, -0.1, 1.5), (0, 0, 0), fov_y_deg=40, width=SIZE, height=SIZE)
    image = ss.render(scene, camera, LIGHT, "hard")
    assert np.all(image.visibility == answer)
    right = ss.estimate_error(image, scene, camera, LIGHT)
    assert (right.rmse, right.low, right.high) == (0, 0, 0)
    # The rule of three, which rounds 2.996 and an exponential.
    assert right.unseen == pytest.approx(3.0 / right.probes, rel=0.01)
    wrong = ss.estimate_error(1 - image.visibility, scene, camera, LIGHT)
    assert (wrong.rmse, wrong.low, wrong.high) == (1, 1, 1)


def test_a_light_that_nothing_sees():
    light = ss.RectLight((0, 0, 2), (0.3, 0, 0), (0, 0.3, 0))  # emits upwards
    scene = _boards()
    image = ss.render(scene, CAMERA, light, "wedges")
    assert ss.estimate_error(image, scene, CAMERA, light).high == 0


def test_nothing_hit_is_nothing_wrong():
    camera = ss.Camera((0, 0, 3), (0, 0, 6), up=(0, 1, 0), width=8, height=8)
    image = ss.render(_ground(), camera, LIGHT, "hard")
    found = ss.estimate_error(image, _ground(), camera, LIGHT)
    assert (found.rmse, found.high, found.probes, found.unseen) == (0, 0, 0, 0)
    assert found.map.shape == (8, 8)


def test_two_pixels_are_both_asked():
    scene = _boards()
    camera = ss.Camera((0, -0.1, 3), (0.12, 0, 0), fov_y_deg=10, width=2, height=1)
    reference = ss.render(scene, camera, LIGHT, ss.RayTraced(samples=4096))
    found = ss.estimate_error(reference.visibility * 0 + 0.5, scene, camera, LIGHT)
    true = _rmse(np.full((1, 2), 0.5), reference)
    assert (found.probes, found.unseen) == (2, 0)
    # All are known but for the reference's own noise: 512 samples' 0.003 a pixel.
    assert found.rmse == pytest.approx(true, abs=0.005)
    assert found.low <= found.rmse <= found.high <= found.rmse + 0.02


def test_what_does_not_receive_is_not_shadowed():
    scene = _ground(receives=False)
    scene.add(quad((0.1, 0, 0.4), (0.3, 0.1, 0), (-0.1, 0.3, 0.05)), "board")
    image = ss.render(scene, CAMERA, LIGHT, ss.RayTraced(samples=1024, seed=4))
    assert ss.estimate_error(image, scene, CAMERA, LIGHT).high < 1e-3
    shadowed = _boards()
    shadowed.remove("low board")
    image = ss.render(shadowed, CAMERA, LIGHT, ss.RayTraced(samples=1024))
    assert ss.estimate_error(image.visibility, scene, CAMERA, LIGHT).low > 0.05


# What it is given


def test_the_same_seed_gives_the_same_estimate_by_any_threads():
    scene = _boards()
    image = ss.render(scene, CAMERA, LIGHT, "wedges")

    def found():
        e = ss.estimate_error(image, scene, CAMERA, LIGHT, seed=3)
        return e.rmse, e.low, e.high, e.probes

    assert len(with_threads(found, 1, 2, 3)) == 1
    assert ss.estimate_error(image, scene, CAMERA, LIGHT, seed=4).rmse != found()[0]


def test_a_picture_is_its_visibility():
    scene = _boards()
    image = ss.render(scene, CAMERA, LIGHT, "wedges")
    whole, array = (ss.estimate_error(x, scene, CAMERA, LIGHT) for x in (image, image.visibility))
    assert (whole.rmse, whole.high) == (array.rmse, array.high)
    for other in (copy.deepcopy(whole), pickle.loads(pickle.dumps(whole))):
        assert (other.rmse, other.probes) == (whole.rmse, whole.probes)


def test_progress_is_told_to_the_end():
    told = []
    image = ss.render(_boards(), CAMERA, LIGHT, "hard")
    ss.estimate_error(image, _boards(), CAMERA, LIGHT, precision=0.05, progress=told.append)
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0, 1)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"image": np.zeros((4, 4))}, ValueError, "shape"),
        ({"image": np.full((SIZE, SIZE), np.nan)}, ValueError, "from 0 to 1"),
        ({"image": np.full((SIZE, SIZE), 1.5)}, ValueError, "from 0 to 1"),
        ({"image": "hard"}, TypeError, "image"),
        ({"light": [LIGHT, LIGHT]}, ValueError, "shape"),
        ({"camera": None}, TypeError, "camera"),
        ({"scene": None}, TypeError, "scene"),
        ({"confidence": 1}, ValueError, "confidence"),
        ({"precision": 0}, ValueError, "precision"),
        ({"probes": 0}, ValueError, "probes"),
        ({"seed": -1}, ValueError, "seed"),
    ],
)
def test_bad_input_is_refused(change, error, message):
    given = {"image": np.ones((SIZE, SIZE)), "scene": _ground(), "camera": CAMERA, "light": LIGHT}
    with pytest.raises(error, match=message):
        ss.estimate_error(**(given | change))


def test_an_image_of_another_camera_is_refused():
    image = ss.render(_ground(), CAMERA, LIGHT, "hard")
    away = ss.Camera((0, -6, 3), (0, 0, 1.5), fov_y_deg=60, width=SIZE, height=SIZE)
    with pytest.raises(ValueError, match="other pixels"):
        ss.estimate_error(image, _ground(), away, LIGHT)
