"""`ss.plot`: what the figures hold, without a display."""

from __future__ import annotations

import io

import fresh
import numpy as np
import pandas as pd
import pytest
import softshadow as ss
from imageio.v3 import imread
from matplotlib.figure import Figure
from softshadow import images, plot
from softshadow.figure import MOST_BYTES, with_palette
from softshadow.plot import styles
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


def test_jupyter_gets_few_bytes_and_files_all_dots():
    noise = np.random.default_rng(0).random((512, 512))
    figure = plot.strip({"a": noise, "b": noise.T, "c": 1 - noise})
    file = io.BytesIO()
    figure.savefig(file, format="png")
    assert len(figure._repr_png_()) <= MOST_BYTES < len(file.getvalue())
    few = plot.show(np.ones((4, 4)))._repr_png_()
    assert imread(io.BytesIO(few)).shape[2] == 4  # as matplotlib writes it


def test_a_palette_keeps_rare_colours():
    """The colour bar's, beside pictures of many greys; measured: 9 levels of 255."""
    rng = np.random.default_rng(0)
    figure = plot.compare(rng.random((300, 300)), rng.random((300, 300)))
    png = figure._drawn(figure.dpi)
    whole, few = (imread(io.BytesIO(p), mode="RGB").astype(int) for p in (png, with_palette(png)))
    assert np.abs(few - whole).max() < 16


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


def measured(**columns):
    """A table of measured cases: three methods, one at three settings, and Mitsuba."""
    rows = [
        ("hard", "", 0.01, 0.3),
        ("wedges", "", 0.02, 0.02),
        ("pcf", "", 0.05, 0.06),
        ("ray_traced", "samples=16", 0.1, 0.03),
        ("ray_traced", "samples=64", 0.2, 0.01),
        ("mitsuba_llvm", "samples=16", 0.3, 0.03),
        ("mitsuba_llvm", "samples=64", 0.9, 0.015),
    ]
    names = ["method", "parameters", "frame_seconds", "penumbra_mae"]
    return pd.DataFrame(rows, columns=names).assign(**columns)


def texts(figure, panel=0):
    return [text.get_text() for text in figure.axes[panel].texts]


def legend(figure):
    return [text.get_text() for text in figure.legends[-1].get_texts()]


def test_pareto_names_the_front_and_counts_mitsuba_s_samples():
    figure = plot.pareto(measured())
    axes = figure.axes[0]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert sorted(texts(figure)) == ["16", "64", "hard", "ray_traced(samples=64)", "wedges"]
    assert legend(figure) == ["hard", "wedges", "pcf", "ray_traced", "mitsuba_llvm"]
    curves = [line for line in axes.lines if line.get_linestyle() == "--"]
    assert len(curves) == 1
    assert curves[0].get_xydata().tolist() == [[0.3, 0.03], [0.9, 0.015]]
    assert curves[0].get_color() == "#000000"


def test_pareto_leaves_out_failures_and_what_is_no_number():
    table = measured(error=["no memory", *[None] * 6])
    table.loc[1, "penumbra_mae"] = np.nan
    table.loc[2, "penumbra_mae"] = 0.0  # has no place on a logarithmic axis
    figure = plot.pareto(table)
    assert legend(figure) == ["ray_traced", "mitsuba_llvm"]


def test_pareto_has_a_panel_for_each_setting():
    table = pd.concat([measured(scene="a", threads=2), measured(scene="b", threads=2)])
    figure = plot.pareto(table.reset_index(drop=True))
    assert [axes.get_title() for axes in figure.axes] == ["a", "b"]
    with pytest.raises(ValueError, match="2 settings"):
        plot.pareto(table, ax=Figure().subplots())


def test_every_method_has_a_colour_and_mark_of_its_own():
    names = [*ss.method_names(), "mitsuba_llvm", "mitsuba_scalar"]
    found = {styles.style(name, names[-2:]) for name in names}
    assert len(found) == len(names)


def test_matrix_has_a_median_for_each_pair_in_the_table_s_order():
    rows = [("b", "pcf", 0.1, None), ("b", "hard", 0.4, None), ("a", "hard", 0.2, None)]
    rows += [("b", "pcf", 0.3, None), ("b", "pcf", 9.0, "failed"), ("a", "pcf", np.nan, None)]
    table = pd.DataFrame(rows, columns=["scene", "method", "mae", "error"])
    axes = plot.matrix(table, "mae").axes[0]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["pcf", "hard"]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["b", "a"]
    shown = axes.images[0]
    assert shown.get_array().filled(-1).tolist() == [[0.2, 0.4], [-1, 0.2]]
    assert shown.get_clim() == (0, 0.4)
    assert [text.get_text() for text in axes.texts] == ["0.2", "0.4", "0.2"]
    assert plot.matrix(table, "mae", limit=1).axes[0].images[0].get_clim() == (0, 1)


def test_versus_draws_a_line_of_medians_for_each_method():
    table = pd.DataFrame(
        {
            "method": ["pcf"] * 4 + ["hard"],
            "light radius": [2, 1, 2, 2, 1],
            "penumbra_mae": [0.3, 0.1, 0.5, 0.4, 0.2],
        }
    )
    axes = plot.versus(table, "light radius").axes[0]
    lines = {line.get_label(): line.get_xydata().tolist() for line in axes.lines}
    assert lines["pcf"] == [[1, 0.1], [2, 0.4]]
    assert lines["hard"] == [[1, 0.2]]
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "linear")


def test_versus_takes_texts_in_the_table_s_order_and_wide_ranges_as_logarithms():
    table = measured(shape=["rect", "rect", "disk", "disk", "sphere", "sphere", "rect"])
    axes = plot.versus(table, "shape", "frame_seconds").axes[0]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["rect", "disk", "sphere"]
    assert axes.get_yscale() == "log"


def test_versus_draws_settings_of_a_method_apart_and_plain_numbers_on_logarithms():
    labels = ["hard", *(f"ray_traced(samples={n})" for n in (4, 16, 64, 256)), "pcf"]
    rows = [(label, x, 0.01 * x * (i + 1)) for i, label in enumerate(labels) for x in (0.1, 1, 4)]
    figure = plot.versus(pd.DataFrame(rows, columns=["label", "x", "mae"]), "x", "mae", by="label")
    axes = figure.axes[0]
    drawn_as = {(x.get_color(), x.get_marker(), x.get_linestyle()) for x in axes.lines}
    assert len(drawn_as) == len(labels)
    assert len({x.get_color() for x in axes.lines if "ray_traced" in x.get_label()}) == 1
    assert axes.get_xscale() == "log"
    figure.draw_without_rendering()
    ticks = axes.get_xticklabels(which="both")
    texts = {tick.get_text() for tick in ticks}
    assert {"0.1", "0.2", "0.5", "1", "2"} <= texts
    assert not any("10^" in text for text in texts)


def test_strip_has_the_reference_first_and_one_scale_for_all_errors():
    images = {"a": [[0.5, 1.0]], "reference": [[1.0, 0.75]], "b": [[1.0, 0.5]]}
    figure = plot.strip(images)
    assert [axes.get_title() for axes in figure.axes[:3]] == ["reference", "a", "b"]
    assert drawn(figure, 4).tolist() == [[-0.5, 0.25]]
    assert drawn(figure, 5).tolist() == [[0.0, -0.25]]
    limits = {figure.axes[i].images[0].get_clim() for i in (4, 5)}
    assert len(limits) == 1
    assert 0.25 < limits.pop()[1] <= 0.5
    assert "MAE 0.38" in figure.axes[4].get_xlabel()


def test_strip_of_many_is_folded_and_of_none_has_no_errors():
    many = {str(i): np.full((2, 2), 0.5) for i in range(7)}
    assert sum(len(axes.images) for axes in plot.strip(many).axes) == 7
    with_errors = plot.strip({**many, "reference": np.ones((2, 2))})
    assert sum(len(axes.images) for axes in with_errors.axes[:20]) == 15


def test_strip_draws_the_part_that_is_asked_for():
    image = np.arange(12).reshape(3, 4) / 12
    figure = plot.strip({"a": image}, rows=slice(1, 3), columns=slice(0, 2))
    assert np.array_equal(drawn(figure), image[1:3, 0:2])


def test_scanline_draws_one_row_and_leaves_gaps():
    image = picture([[0.0, 0.0], [0.25, 0.5]], mask=[[True, True], [True, False]])
    figure = plot.scanline({"wedges": image, "reference": np.ones((2, 2))}, -1)
    reference, wedges = figure.axes[0].lines
    assert reference.get_color() == "black"
    assert wedges.get_ydata()[0] == 0.25
    assert np.isnan(wedges.get_ydata()[1])
    assert "row 1" in figure.axes[0].get_xlabel()


def test_scanline_finds_the_row_with_the_most_penumbra():
    image = np.array([[0, 1, 0.5], [0.3, 0.4, 0.5], [1, 1, 1]])
    assert "row 1" in plot.scanline({"reference": image}).axes[0].get_xlabel()


def test_scanline_of_a_single_row_has_no_picture_beside_it():
    assert len(plot.scanline({"reference": np.array([[0, 0.5, 1]])}).axes) == 1
    assert len(plot.scanline({"reference": np.array([[0, 0.5, 1]] * 2)}).axes) == 2


def test_light_map_draws_an_occlusion_camera():
    setup = ss.scenes.stacked_boards(16, 16)
    maps = ss.kernels.ssoc_maps(setup.scene, setup.light, ss.Ssoc(resolution=64))
    figure = plot.light_map(maps[0])
    panels = {axes.get_title(): axes for axes in figure.axes if axes.images}
    assert len(panels) >= 7
    near = maps[0].inside[..., 5] > 0
    away = panels["inside: texels to silhouette"].images[0].get_array()
    assert np.array_equal(~np.ma.getmaskarray(away), near)
    assert 0 < away.max() < 64


def test_light_map_draws_layers_and_what_they_let_through():
    setup = ss.scenes.stacked_boards(16, 16)
    maps = ss.kernels.layered_maps(setup.scene, setup.light, ss.Mtsm(resolution=32))
    figure = plot.light_map(maps[0], layers=1)
    titles = [axes.get_title() for axes in figure.axes if axes.images]
    assert titles[:2] == ["layers", "depth of layer 1"]
    depths = drawn(figure, 1)
    assert np.ma.max(depths) == maps[0].depths[..., 0][np.isfinite(maps[0].depths[..., 0])].max()


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: plot.pareto(measured(), y="p99"), ValueError, "no column 'p99'"),
        (lambda: plot.pareto([1]), TypeError, "got list"),
        (lambda: plot.pareto(measured(error="lost")), ValueError, "no row with a positive"),
        (lambda: plot.versus(measured(), "radius"), ValueError, "no column 'radius'"),
        (lambda: plot.strip({}), ValueError, "at least one"),
        (lambda: plot.strip([[1.0]]), TypeError, "mapping"),
        (lambda: plot.strip({"a": [[1.0]], "b": [[1.0, 1.0]]}), ValueError, "one size"),
        (lambda: plot.strip({"a": [[1.0]]}, limit=0), ValueError, "limit"),
        (lambda: plot.strip({"a": [[1.0]]}, rows=slice(1, 1)), ValueError, "no pixel"),
        (lambda: plot.scanline({"a": [[1.0]]}, 1), ValueError, "row"),
        (lambda: plot.matrix(measured(), x="moon", y="method"), ValueError, "no column 'moon'"),
        (lambda: plot.matrix(measured(), "moon", y="method"), ValueError, "no column 'moon'"),
        (lambda: plot.matrix(measured(), y="method", limit=0), ValueError, "limit"),
        (lambda: plot.light_map(np.ones((2, 2))), TypeError, "got ndarray"),
    ],
)
def test_what_a_figure_cannot_be_made_of_is_an_error_that_says_why(call, error, message):
    with pytest.raises(error, match=message):
        call()
