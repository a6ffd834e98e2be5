"""Writing images, and reading back what was written with somebody else's reader."""

from __future__ import annotations

import imageio.v3 as imageio
import numpy as np
import OpenEXR
import pytest
from softshadow import images

GREY = np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4)


def test_png_visibility_is_linear_and_rounded(tmp_path):
    images.write(tmp_path / "v.png", [[0.0, 0.5, 1.0, 1 / 255]])
    assert imageio.imread(tmp_path / "v.png").tolist() == [[0, 128, 255, 1]]


def test_png_of_a_mask_is_black_and_white(tmp_path):
    images.write(tmp_path / "m.png", np.array([[True, False]]))
    assert imageio.imread(tmp_path / "m.png").tolist() == [[255, 0]]


def test_png_radiance_is_srgb_encoded_with_the_exposure(tmp_path):
    # 0.5 -> 0.735357 (IEC 61966-2-1) -> 187.5; 0.001 -> 0.01292 -> 3.3; 2 is clipped.
    images.write(tmp_path / "r.png", [[[0.25, 0.0005, 1.0]]], exposure=2.0)
    assert imageio.imread(tmp_path / "r.png").tolist() == [[[188, 3, 255]]]


def test_srgb_is_continuous_where_its_two_pieces_meet():
    below, above = images.to_srgb([[[0.0031308, 0.0031309, 0.0]]], exposure=1.0)[0, 0, :2]
    assert above > below
    assert above - below < 1e-5


def test_auto_exposure_makes_the_99th_percentile_of_lit_pixels_white():
    radiance = np.zeros((20, 10, 3))
    radiance[:10, :, 1] = 0.04  # half is black and does not count
    radiance[0, 0] = 1000.0  # neither does one pixel in a hundred
    # 100 lit values, 99 of them 0.04; rank 0.99 * 99 = 98.01, a hundredth of the way to 1000
    assert images.auto_exposure(radiance) == pytest.approx(1 / (0.04 + 0.01 * 999.96))
    radiance[0, 0] = 0.04
    assert images.auto_exposure(radiance) == pytest.approx(25.0)
    assert images.to_srgb(radiance)[5, 5, 1] == pytest.approx(1.0)


def test_auto_exposure_of_a_black_image_is_one():
    assert images.auto_exposure(np.zeros((2, 2, 3))) == 1.0


def test_exr_grey_is_lossless_and_really_exr(tmp_path):
    values = GREY.copy()
    values[0, 0], values[0, 1] = np.inf, 1e-30
    images.write(tmp_path / "v.exr", values)
    assert (tmp_path / "v.exr").read_bytes()[:4] == b"\x76\x2f\x31\x01"
    channels = OpenEXR.File(str(tmp_path / "v.exr")).channels()
    assert list(channels) == ["Y"]
    assert channels["Y"].pixels.dtype == np.float32
    assert np.array_equal(channels["Y"].pixels, values)


def test_exr_colour_is_linear_rgb(tmp_path):
    colour = np.random.default_rng(0).random((5, 7, 3)).astype(np.float32) * 40
    images.write(tmp_path / "r.exr", colour)
    channels = OpenEXR.File(str(tmp_path / "r.exr")).channels()
    assert np.array_equal(channels["RGB"].pixels, colour)


def test_npy_keeps_dtype_and_any_shape(tmp_path):
    several = np.arange(24, dtype=np.float64).reshape(2, 3, 4)
    images.write(tmp_path / "v.npy", several)
    back = np.load(tmp_path / "v.npy")
    assert back.dtype == np.float64
    assert np.array_equal(back, several)


def test_an_upper_case_suffix_is_fine_and_kept(tmp_path):
    images.write(tmp_path / "V.NPY", GREY)
    images.write(tmp_path / "V.PNG", GREY)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["V.NPY", "V.PNG"]
    assert imageio.imread(tmp_path / "V.PNG", extension=".png").shape == (3, 4)


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("a.jpg", GREY, r"unknown file type '\.jpg'; expected one of \.png, \.exr, \.npy"),
        ("a", GREY, "unknown file type ''"),
        ("a.png", GREY * 2, "values from 0 to 1, got 0 to 2"),
        ("a.png", np.full((2, 2), np.nan), "not finite"),
        ("a.png", np.zeros((2, 3, 4)), r"\(H, W\) or \(H, W, 3\), got \(2, 3, 4\)"),
        ("a.exr", np.zeros(3), r"got \(3,\)"),
        ("a.exr", np.zeros((0, 3)), r"got \(0, 3\)"),
        ("a.npy", "text", "array of numbers"),
    ],
)
def test_what_cannot_be_written_is_an_error_of_one_line(tmp_path, name, array, message):
    with pytest.raises(ValueError, match=message) as caught:
        images.write(tmp_path / name, array)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", images.SUFFIXES)
def test_a_missing_folder_is_an_error_that_names_it(tmp_path, suffix):
    with pytest.raises(FileNotFoundError, match=r"there is no folder .*nowhere"):
        images.write(tmp_path / "nowhere" / f"a{suffix}", GREY)


def test_a_folder_is_not_written_over(tmp_path):
    (tmp_path / "a.png").mkdir()
    with pytest.raises(IsADirectoryError, match="is a folder"):
        images.write(tmp_path / "a.png", GREY)


@pytest.mark.parametrize("exposure", [0.0, -1.0, np.nan])
def test_an_exposure_that_is_not_positive_is_an_error(exposure):
    with pytest.raises(ValueError, match="exposure"):
        images.to_srgb(np.ones((1, 1, 3)), exposure)
