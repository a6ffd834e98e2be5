"""`ss.metrics` against hand-computed numbers and the libraries it calls."""

from __future__ import annotations

import math

import flip_evaluator
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.metrics import structural_similarity
from softshadow import metrics

NAN = math.nan


@pytest.fixture
def pictures():
    """A soft edge and a shifted, noisy copy of it, 24 x 32."""
    rng = np.random.default_rng(7)
    edge = np.clip(np.linspace(-0.5, 1.5, 32), 0, 1)[None, :].repeat(24, axis=0)
    noisy = np.clip(np.roll(edge, 1, axis=1) + 0.05 * rng.standard_normal(edge.shape), 0, 1)
    return noisy.astype(np.float32), edge.astype(np.float32)


def test_pointwise_errors_of_a_worked_example():
    image, reference = [[0.5, 0.0], [1.0, 1.0]], [[0.0, 0.25], [1.0, 0.0]]
    # differences 0.5, -0.25, 0, 1
    assert metrics.mae(image, reference) == 1.75 / 4
    assert metrics.rmse(image, reference) == pytest.approx(math.sqrt(1.3125 / 4), abs=1e-15)
    assert metrics.bias(image, reference) == 1.25 / 4
    assert metrics.maximum(image, reference) == 1.0
    # sorted 0, 0.25, 0.5, 1; rank 0.99 * 3 = 2.97
    assert metrics.percentile99(image, reference) == pytest.approx(0.985, abs=1e-12)


def test_bias_is_positive_when_the_image_is_too_bright():
    assert metrics.bias(np.full((2, 2), 0.75), np.full((2, 2), 0.5)) == 0.25


def test_sums_are_in_float64():
    # A float32 running sum of 2^25 ones stalls at 2^24; of many 0.1 it drifts in the third digit.
    image = np.full(3_000_000, 0.1, dtype=np.float32)
    assert metrics.mae(image, np.zeros_like(image)) == pytest.approx(float(np.float32(0.1)), 1e-12)


def test_where_selects_the_pixels_that_count():
    image, reference = np.array([[1.0, 0.0], [0.5, NAN]]), np.zeros((2, 2))
    where = np.array([[True, False], [True, False]])
    assert metrics.mae(image, reference, where) == 0.75
    assert metrics.maximum(image, reference, [[False, True], [True, False]]) == 0.5


def test_where_of_one_image_applies_to_every_light():
    image = np.array([[[1.0, 0.2]], [[0.5, 0.2]]])
    assert metrics.mae(image, np.zeros((2, 1, 2)), np.array([[True, False]])) == 0.75


def test_ssim_is_the_library_s(pictures):
    image, reference = (x.astype(np.float64) for x in pictures)
    direct = structural_similarity(image, reference, data_range=1.0)
    assert 0.1 < direct < 0.99
    assert metrics.ssim(image, reference) == pytest.approx(direct, abs=1e-12)


def test_flip_is_the_library_s(pictures):
    image, reference = pictures
    rgb = [np.ascontiguousarray(np.stack([x] * 3, axis=-1)) for x in (reference, image)]
    _, direct, _ = flip_evaluator.evaluate(rgb[0], rgb[1], "LDR", applyMagma=False)
    assert 0.01 < direct < 1.0
    assert metrics.flip(image, reference) == pytest.approx(direct, rel=1e-5)


@pytest.mark.parametrize(("function", "equal"), [(metrics.ssim, 1.0), (metrics.flip, 0.0)])
def test_equal_images_score_perfectly(function, equal, pictures):
    assert function(pictures[1], pictures[1]) == pytest.approx(equal, abs=1e-7)


@pytest.mark.parametrize("function", [metrics.ssim, metrics.flip])
def test_a_full_mask_changes_nothing_and_background_does_not_matter(function, pictures):
    image, reference = pictures
    everything = np.ones(image.shape, dtype=bool)
    assert function(image, reference, everything) == pytest.approx(function(image, reference))
    left = everything.copy()
    left[:, 20:] = False
    inside = function(image, reference, left)
    spoiled = image.copy()
    spoiled[:, 20:] = np.nan
    assert function(spoiled, reference, left) == inside


@pytest.mark.parametrize("function", [metrics.ssim, metrics.flip])
def test_several_lights_give_the_mean_over_them(function, pictures):
    image, reference = pictures
    stacked = function(np.stack([image, reference]), np.stack([reference, reference]))
    alone = (function(image, reference) + function(reference, reference)) / 2
    assert stacked == pytest.approx(alone, abs=1e-6)


def test_flip_clips_what_a_display_clips():
    over, lit = np.full((8, 8), 1.5), np.ones((8, 8))
    assert metrics.flip(over, lit) == pytest.approx(0.0, abs=1e-7)


def test_sampled_zero_and_one_are_not_penumbra():
    step = 1 / 65536  # the finest sampled reference
    reference = np.array([0.0, step, 0.5, 1 - step, 1.0], dtype=np.float32)
    assert metrics.penumbra_mask(reference).tolist() == [False, True, True, True, False]


def test_float32_rounding_of_a_lit_pixel_is_not_penumbra():
    reference = np.array([1e-7, 1 - 1.2e-7], dtype=np.float32)
    assert not metrics.penumbra_mask(reference).any()
    assert metrics.penumbra_mask(reference, tolerance=0.0).all()


def test_penumbra_mask_is_false_outside_where():
    where = np.array([True, False])
    assert metrics.penumbra_mask([0.5, NAN], where=where).tolist() == [True, False]


def test_confusion_counts_a_worked_example():
    reference = np.array([0.0, 0.0, 0.3, 0.5, 1.0, 1.0])
    image = np.array([0.0, 0.2, 0.0, 0.5, 1.0, 0.0])
    table = metrics.confusion(image, reference)
    assert table.index.name == "reference"
    assert table.columns.name == "image"
    assert table.loc["umbra"].to_dict() == {"umbra": 1, "penumbra": 1, "lit": 0}
    assert table.loc["penumbra"].to_dict() == {"umbra": 1, "penumbra": 1, "lit": 0}
    assert table.loc["lit"].to_dict() == {"umbra": 1, "penumbra": 0, "lit": 1}


def test_confusion_tolerance_moves_the_classes():
    table = metrics.confusion([0.05, 0.95, 0.5], [0.0, 1.0, 0.5], tolerance=0.1)
    assert np.array_equal(table.to_numpy(), np.eye(3, dtype=int))


def test_confusion_leaves_out_what_where_leaves_out():
    table = metrics.confusion([0.0, NAN], [0.0, 1.0], where=np.array([True, False]))
    assert table.to_numpy().sum() == 1


@pytest.mark.parametrize("flipped", [False, True])
def test_penumbra_width_of_a_linear_ramp_is_nine_tenths_of_it(flipped):
    ramp = np.clip(np.arange(-5, 26) / 20, 0, 1)  # 20 pixels from 0 to 1
    values = ramp[::-1] if flipped else ramp
    assert metrics.penumbra_width(values) == pytest.approx(18.0, abs=1e-12)
    assert metrics.penumbra_width(values, positions=0.5 * np.arange(31)) == pytest.approx(9.0)
    assert metrics.penumbra_width(values, positions=-0.5 * np.arange(31)) == pytest.approx(9.0)


def test_penumbra_width_interpolates_inside_one_step():
    assert metrics.penumbra_width([0.0, 0.0, 1.0, 1.0]) == pytest.approx(0.9, abs=1e-12)
    # leaves 0.05 at 0.1, reaches 0.95 at 1 + 0.45 / 0.5 = 1.9
    assert metrics.penumbra_width([0.0, 0.5, 1.0]) == pytest.approx(1.8, abs=1e-12)


def test_penumbra_width_takes_the_outermost_crossings():
    # Dips back to 0 and to 0.5: leaves 0.05 first at 0.1, reaches 0.95 last at 5 + 0.9.
    values = [0.0, 0.5, 0.0, 0.5, 1.0, 0.5, 1.0]
    assert metrics.penumbra_width(values) == pytest.approx(5.9 - 0.1, abs=1e-12)


def test_penumbra_width_takes_other_levels():
    assert metrics.penumbra_width([0.0, 0.5, 1.0], low=0.0, high=1.0) == 2.0
    assert metrics.penumbra_width([0.0, 0.5, 1.0], low=0.25, high=0.75) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "values",
    [[0.0, 0.0, 0.0], [1.0, 1.0], [0.0, 0.4, 0.8], [0.2, 0.6, 1.0], [1.0, 0.0, 1.0]],
    ids=["umbra", "lit", "never lit", "never dark", "two penumbrae"],
)
def test_penumbra_width_without_a_whole_penumbra_is_nan(values):
    assert math.isnan(metrics.penumbra_width(values))


def test_penumbra_width_bridges_pixels_outside_where():
    where = np.array([True, False, True])
    assert metrics.penumbra_width([0.0, NAN, 1.0], where=where) == pytest.approx(1.8)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=30), st.booleans())
def test_penumbra_width_is_between_nothing_and_the_scanline(middle, flipped):
    values = [0.0, *middle, 1.0]
    width = metrics.penumbra_width(values[::-1] if flipped else values)
    assert 0.0 <= width <= len(values) - 1
    # It climbs by 0.9 on its way, and nowhere steeper than its steepest step.
    steepest = max(np.diff(values))
    assert width >= 0.9 / steepest - 1e-9


def test_errors_have_every_number_over_image_and_penumbra(pictures):
    image, reference = pictures
    result = metrics.errors(image, reference)
    penumbra = (reference > 0) & (reference < 1)
    assert list(result) == [
        *("mae", "rmse", "bias", "p99", "max", "ssim", "flip"),
        *("penumbra_mae", "penumbra_rmse", "penumbra_bias", "penumbra_p99", "penumbra_max"),
        "penumbra_share",
    ]
    assert result["mae"] == metrics.mae(image, reference)
    assert result["p99"] == metrics.percentile99(image, reference)
    assert result["ssim"] == metrics.ssim(image, reference)
    assert result["flip"] == metrics.flip(image, reference)
    assert result["penumbra_rmse"] == metrics.rmse(image, reference, penumbra)
    assert result["penumbra_max"] == metrics.maximum(image, reference, penumbra)
    assert result["penumbra_share"] == pytest.approx(penumbra.mean())
    assert all(type(x) is float for x in result.values())


def test_errors_mask_is_the_whole_of_the_share():
    reference = np.array([[0.5, 0.0, 0.0, 0.0]])
    mask = np.array([[True, True, False, False]])
    assert metrics.errors(reference, reference, mask)["penumbra_share"] == 0.5
    assert metrics.errors(reference, reference)["penumbra_share"] == 0.25


def test_errors_without_penumbra_are_nan_there_and_numbers_elsewhere():
    result = metrics.errors(np.full((8, 8), 0.5), np.ones((8, 8)))
    assert result["mae"] == 0.5
    assert result["penumbra_share"] == 0.0
    nans = {name for name, value in result.items() if math.isnan(value)}
    assert nans == {f"penumbra_{x}" for x in ("mae", "rmse", "bias", "p99", "max")}


def test_errors_of_an_image_too_small_for_ssim_are_nan_there_only():
    result = metrics.errors(np.full((3, 9), 0.5), np.full((3, 9), 0.25))
    assert math.isnan(result["ssim"])
    assert result["mae"] == 0.25
    assert result["flip"] > 0


@pytest.mark.parametrize(
    "function",
    [
        *(metrics.mae, metrics.rmse, metrics.bias, metrics.percentile99, metrics.maximum),
        *(metrics.ssim, metrics.flip, metrics.confusion, metrics.errors),
    ],
)
class TestBadInput:
    def test_different_shapes_are_named(self, function):
        with pytest.raises(ValueError, match=r"\(8, 8\).*\(8, 9\)"):
            function(np.ones((8, 8)), np.ones((8, 9)))

    def test_the_first_nan_is_located(self, function):
        image = np.ones((8, 8))
        image[3, 4] = np.nan
        with pytest.raises(ValueError, match=r"image: 1 values are not finite.*\(3, 4\)"):
            function(image, np.ones((8, 8)))
        with pytest.raises(ValueError, match="reference: 1 values"):
            function(np.ones((8, 8)), image)

    def test_an_empty_mask_is_an_error(self, function):
        name = "mask" if function is metrics.errors else "where"
        with pytest.raises(ValueError, match="no pixel"):
            function(np.ones((8, 8)), np.ones((8, 8)), **{name: np.zeros((8, 8), dtype=bool)})

    def test_a_mask_that_does_not_fit_is_an_error(self, function):
        name = "mask" if function is metrics.errors else "where"
        with pytest.raises(ValueError, match="does not fit"):
            function(np.ones((8, 8)), np.ones((8, 8)), **{name: np.ones((3, 8), dtype=bool)})
        with pytest.raises(ValueError, match="expected booleans"):
            function(np.ones((8, 8)), np.ones((8, 8)), **{name: np.ones((8, 8))})

    def test_something_else_than_an_array_is_an_error(self, function):
        with pytest.raises(ValueError, match=r"image\.visibility"):
            function(object(), np.ones((8, 8)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"values": np.ones((2, 2))}, "one scanline"),
        ({"values": [0.0, NAN, 1.0]}, "values: 1 values are not finite"),
        ({"values": [0.0, 1.0], "positions": [0.0]}, "positions: expected shape"),
        ({"values": [0.0, 0.5, 1.0], "positions": [0.0, 2.0, 1.0]}, "strictly"),
        ({"values": [0.0, 1.0], "low": 0.9, "high": 0.1}, "low < high"),
        ({"values": [1.0]}, "at least 2 pixels"),
    ],
)
def test_penumbra_width_says_what_is_wrong(arguments, message):
    with pytest.raises(ValueError, match=message):
        metrics.penumbra_width(**arguments)


@pytest.mark.parametrize("tolerance", [-0.1, 0.5, NAN])
def test_a_tolerance_out_of_range_is_an_error(tolerance):
    with pytest.raises(ValueError, match="tolerance"):
        metrics.penumbra_mask([0.5], tolerance)


def test_ssim_needs_a_window():
    with pytest.raises(ValueError, match="7 x 7"):
        metrics.ssim(np.ones((6, 20)), np.ones((6, 20)))
    border = np.zeros((8, 8), dtype=bool)
    border[0] = True
    with pytest.raises(ValueError, match="border"):
        metrics.ssim(np.ones((8, 8)), np.ones((8, 8)), border)
