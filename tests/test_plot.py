"""`ss.plot`: what the figures hold, without a display."""

from __future__ import annotations

import fresh
import numpy as np
import pytest
from matplotlib.figure import Figure
from softshadow import images, plot
from softshadow.render import Image


def picture(visibility, mask=None):
    """An Image with that visibility, and a radiance of a tenth of it."""
    v = np.asarray(visibility, dtype=np.float32)
    size = v.shape[-2:]
    total = v.reshape(-1, *size).sum(axis=0)
    return Image(
        visibility=v,
        radiance=np.stack([total / 10] * 3, axis=-1),
        mask=np.ones(size, dtype=bool) if mask is None else np.asarray(mask),
        position=np.zeros((*size, 3)),
        normal=np.zeros((*size, 3), dtype=np.float32),
        depth=np.ones(size, dtype=np.float32),
        mesh_id=np.zeros(size, dtype=np.int32),
        triangle_id=np.zeros(size, dtype=np.int32),
        seconds={"prepare": 0.0, "frame": 0.0},
        bytes=0,
    )


def drawn(figure, panel=0):
    """The array that a panel shows."""
    return figure.axes[panel].images[0].get_array()


def test_show_draws_visibility_from_black_to_white():
    figure = plot.show(picture([[0.25, 0.5], [0.25, 0.5]]))
    shown = figure.axes[0].images[0]
    assert np.array_equal(shown.get_array(), [[0.25, 0.5], [0.25, 0.5]])
    assert shown.get_clim() == (0.0, 1.0)
    assert figure.axes[0].get_title() == "visibility"


def test_show_draws_several_lights_as_their_mean():
    assert drawn(plot.show(picture([[[0.0, 1.0]], [[1.0, 1.0]]]))).tolist() == [[0.5, 1.0]]


def test_show_draws_radiance_srgb_encoded_with_the_exposure():
    image = picture([[1.0, 0.5]])
    shown = drawn(plot.show(image, "radiance", exposure=2.0))
    assert np.allclose(shown, images.to_srgb(image.radiance, 2.0))
    automatic = drawn(plot.show(image, "radiance"))
    assert automatic.max() == pytest.approx(1.0, abs=0.01)


def test_show_draws_arrays_by_their_shape():
    assert drawn(plot.show(np.ones((2, 3)))).shape == (2, 3)
    assert drawn(plot.show(np.ones((2, 3, 3)))).shape == (2, 3, 3)


def test_show_draws_into_the_given_axes():
    own = Figure()
    left, right = own.subplots(1, 2)
    assert plot.show(np.ones((2, 2)), ax=right) is own
    assert not left.images
    assert len(right.images) == 1


def test_compare_shows_the_signed_difference_with_a_symmetric_map():
    figure = plot.compare(picture([[1.0, 0.25]]), picture([[0.5, 0.5]]), labels=("fast", "true"))
    assert [figure.axes[i].get_title() for i in (0, 1)] == ["fast", "true"]
    difference = figure.axes[2].images[0]
    assert difference.get_array().tolist() == [[0.5, -0.25]]
    assert difference.get_clim() == (-0.5, 0.5)


def test_compare_titles_the_difference_with_its_numbers():
    title = plot.compare([[1.0, 0.25]], [[0.5, 0.5]]).axes[2].get_title()
    # differences 0.5, -0.25: mean 0.125, mean square 0.15625
    for number in ("MAE 0.375", "RMSE 0.395", "max 0.5", "bias +0.12"):
        assert number in title


def test_compare_leaves_out_pixels_where_nothing_was_hit():
    a = picture([[1.0, 1.0]], mask=[[True, False]])
    b = picture([[0.75, 0.0]], mask=[[True, True]])
    figure = plot.compare(a, b)
    assert "MAE 0.25," in figure.axes[2].get_title()
    assert drawn(figure, 2).mask.tolist() == [[False, True]]
    assert figure.axes[2].images[0].get_clim() == (-0.25, 0.25)


def test_compare_of_equal_images_has_a_colour_range_and_zero_errors():
    figure = plot.compare(np.ones((2, 2)), np.ones((2, 2)))
    assert figure.axes[2].images[0].get_clim() == (-1.0, 1.0)
    assert "MAE 0," in figure.axes[2].get_title()


def test_compare_shows_two_radiances_with_the_same_exposure():
    dim, bright = picture([[0.5, 0.5]]), picture([[1.0, 1.0]])
    figure = plot.compare(dim, bright, what="radiance")
    assert np.allclose(drawn(figure, 1), 1.0)
    assert np.allclose(drawn(figure, 0), images.to_srgb([[[0.5] * 3] * 2], 1.0))
    assert np.allclose(drawn(figure, 2), -0.05)


def test_compare_takes_the_limit_of_the_colours():
    figure = plot.compare(np.ones((2, 2)), np.zeros((2, 2)), limit=0.1)
    assert figure.axes[2].images[0].get_clim() == (-0.1, 0.1)


def test_figures_can_be_saved_and_shown_by_jupyter(tmp_path):
    figure = plot.compare(np.ones((4, 4)), np.zeros((4, 4)))
    figure.savefig(tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 1000
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_drawing_neither_imports_pyplot_nor_chooses_a_backend():
    code = (
        "import io, sys, numpy, softshadow as ss\n"
        "figure = ss.plot.compare(numpy.ones((2, 2)), numpy.ones((2, 2)))\n"
        "figure.savefig(io.BytesIO(), format='png')\n"
        "print('matplotlib.pyplot' in sys.modules)"
    )
    done = fresh.run(code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["False"]


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: plot.show(np.ones(3)), ValueError, r"got \(3,\)"),
        (lambda: plot.show(np.ones((2, 2, 2))), ValueError, r"got \(2, 2, 2\)"),
        (lambda: plot.show("picture.png"), TypeError, "got str"),
        (lambda: plot.show(picture([[1.0]]), "depth"), ValueError, "'visibility' or 'radiance'"),
        (lambda: plot.compare(np.ones((2, 2)), np.ones((2, 3))), ValueError, "must be equal"),
        (lambda: plot.compare([[1.0]], [[1.0]], limit=0.0), ValueError, "limit"),
        (
            lambda: plot.compare(picture([[1.0]], [[False]]), picture([[1.0]])),
            ValueError,
            "hit a surface",
        ),
    ],
)
def test_what_cannot_be_drawn_is_an_error_that_says_why(call, error, message):
    with pytest.raises(error, match=message):
        call()
