"""`ss.plot`'s figures of what methods are made of: wedges, buffers, layers, bent rays."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from softshadow import plot


def board(light_radius=0.3):
    """A board at z = 1 under a light at z = 3, over a ground at 0."""
    scene = ss.Scene()
    scene.add(ss.scenes.square(2), "ground")
    scene.add(ss.scenes.square(0.4, z=1), "board")
    return scene, ss.SphereLight((0, 0, 3), light_radius)


def of_board():
    scene, light = board()
    scene.set_look("ground", casts=False)
    return ss.kernels.wedges(scene, light, vertex_angle=180), light


def lines(ax, colour):
    """The segments of a colour, shape (n, 2, 2)."""
    found = [line.get_xydata() for line in ax.lines if line.get_color() == colour]
    return np.array(found)


def test_wedges_are_cut_where_their_planes_say():
    """Tangents to a light of radius 0.3 from an edge 0.4 beside its axis, 2 below and 1 above."""
    figure = plot.wedges(*of_board())
    cut = figure.axes[1]
    distance = np.hypot(0.4, 2)
    axis, half = np.arctan2(0.4, 2), np.arcsin(0.3 / distance)
    for colour, angle in (("#0072B2", axis + half), ("#D55E00", axis - half)):
        corners = lines(cut, colour)
        assert np.abs(corners) == pytest.approx(0.4 + np.tan(angle))


def test_wedges_take_what_is_seen_behind_the_cut():
    seen = np.linspace(0, 1, 12).reshape(3, 4)
    figure = plot.wedges(*of_board(), visibility=seen, extent=(-1, 1, -1, 0.5))
    shown = figure.axes[1].images[0]
    assert np.array_equal(shown.get_array(), seen)
    assert shown.get_extent() == [-1, 1, -1, 0.5]


def test_silhouettes_lie_on_what_they_are_of():
    """The board, seen from above: its edges are where its pixels end."""
    scene, light = board()
    camera = ss.Camera((0, 0, 4), (0, 0, 0), up=(0, 1, 0), width=60, height=40)
    image = ss.render(scene, camera, light, "hard")
    found, _ = of_board()
    segments = plot.silhouettes(image, camera, found.edges).axes[0].collections[0].get_segments()
    rows, columns = np.nonzero(image.mesh_id == 1)
    corners = np.concatenate(segments)
    # Pixels' middles are whole numbers in the picture: the edges are within half a pixel of them.
    assert corners.min(axis=0) == pytest.approx([columns.min() - 0.5, rows.min() - 0.5], abs=0.51)
    assert corners.max(axis=0) == pytest.approx([columns.max() + 0.5, rows.max() + 0.5], abs=0.51)


def test_segments_behind_the_camera_are_left_out():
    camera = ss.Camera((0, 0, 4), (0, 0, 0), up=(0, 1, 0), width=6, height=4)
    edges = [[(0, 0, 0), (1, 0, 0)], [(0, 0, 0), (0, 0, 9)]]
    figure = plot.silhouettes(np.ones((4, 6)), camera, edges)
    assert len(figure.axes[0].collections[0].get_segments()) == 1


def test_light_intensity_shows_both_buffers_and_what_is_left():
    buffer = np.array([[[0.5, 1.0], [-1.0, 0.25], [1.0, 1.5]]])
    figure = plot.light_intensity(buffer)
    panels = [ax for ax in figure.axes if ax.images]
    facing, away, left = (ax.images[0].get_array().tolist() for ax in panels)
    assert (facing, away) == ([[0.5, -1.0, 1.0]], [[1.0, 0.25, 1.5]])
    assert left == [[0.5, 0.0, 1.0]]
    assert "-1.00 to 1.00" in panels[0].get_title()
    below, above = (panels[0].images[0].cmap(panels[0].images[0].norm(v)) for v in (-0.5, 1.5))
    assert below[:3] != above[:3] != (1, 1, 1)


def test_layers_are_the_rows_depths_and_the_texels_steps():
    setup = ss.scenes.tilted_sheet(16, 16, opacity=0.5, sheets=3)
    (first, *_) = ss.kernels.layered_maps(setup.scene, setup.light, ss.Mtsm(resolution=64))
    side, along = plot.layers(first, 32, column=32).axes
    for i in range(3):
        there = np.isfinite(first.depths[32, :, i])
        assert side.lines[i].get_ydata().tolist() == first.depths[32, there, i].tolist()
    assert side.yaxis_inverted()  # the light is on top
    behind = along.lines[1].get_xdata()
    assert behind == pytest.approx([0.5, 0.25, 0.125], abs=1e-6)
    # From full light on, a step down at each sheet.
    assert along.lines[0].get_xdata().tolist() == np.repeat([1, *behind], 2).tolist()


def test_layers_of_opaque_maps_end_all_light():
    setup = ss.scenes.stacked_boards(16, 16)
    (first, *_) = ss.kernels.layered_maps(setup.scene, setup.light, ss.Mlsm(resolution=64))
    along = plot.layers(first, 32).axes[1]
    assert along.lines[0].get_xdata()[0] == 1
    assert not along.lines[1].get_xdata().any()


def test_a_texel_starts_again_behind_what_is_opaque():
    camera = ss.Camera((0, 0, 4), (0, 0, 0), up=(0, 1, 0), width=1, height=1)
    depths = np.array([[[1.0, 2.0, 3.0]]])
    own = ss.kernels.LayeredMap(camera, depths, visibility=np.array([[[0.5, 0, 0.75]]], np.float32))
    fading = plot.layers(own, 0).axes[1].lines[0]
    values, places = np.array(fading.get_xdata()), np.array(fading.get_ydata())
    again = np.flatnonzero(np.isnan(values))[0]
    assert (values[again - 1], values[again + 1]) == (0, 1)
    assert places[again + 1] == 2  # from where it ended
    assert values[-1] == 0.75


def test_rays_bend_by_the_penumbras_width():
    """Beside the board the ray that just passes its edge ends where the umbra does."""
    scene, light = board()
    maps = ss.kernels.ssoc_maps(scene, light, ss.Ssoc(resolution=256))[0]
    ax = plot.bent_rays(maps, light.radius, every=1).axes[0]
    rays = [line.get_xydata() for line in ax.lines if line.get_color() == "#D55E00"]
    ends = np.sort(np.abs([ray[-1, 0] for ray in rays]))
    # By similar triangles, of the paper's half-width f r (1 / z_near - 1 / z): the penumbra on the
    # ground is 0.3 wide on average around 0.6, where the light's centre sees the edge; rays are
    # evenly spread over it. A texel is 0.0069 there, and a ray moves by two.
    texel = 3 / maps.camera.K[0, 0]
    assert ends[0] == pytest.approx(0.6 - 0.15, abs=2 * texel)
    assert ends[-1] == pytest.approx(0.6 + 0.15, abs=2 * texel)
    straight = [line for line in ax.lines if line.get_color() == "#56B4E9"]
    assert len(rays) + len(straight) == np.isfinite(maps.depth[128]).sum()


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: plot.wedges(*of_board(), height=2), ValueError, "does not reach z = 2"),
        (lambda: plot.wedges(*of_board(), visibility=[[1]]), ValueError, "both or none"),
        (lambda: plot.light_intensity(np.ones((2, 2))), ValueError, r"got \(2, 2\)"),
        (lambda: plot.layers(np.ones((2, 2)), 0), TypeError, "got ndarray"),
        (lambda: plot.bent_rays(np.ones((2, 2)), 1), TypeError, "got ndarray"),
    ],
)
def test_what_cannot_be_drawn_is_an_error_that_says_why(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_sizes_that_do_not_fit_are_errors():
    camera = ss.Camera((0, 0, 4), (0, 0, 0), up=(0, 1, 0), width=6, height=4)
    with pytest.raises(ValueError, match="is not the camera's"):
        plot.silhouettes(np.ones((4, 4)), camera, np.zeros((1, 2, 3)))
    with pytest.raises(ValueError, match="shape"):
        plot.silhouettes(np.ones((4, 6)), camera, np.zeros((2, 3)))
    setup = ss.scenes.stacked_boards(16, 16)
    (first, *_) = ss.kernels.layered_maps(setup.scene, setup.light, ss.Mlsm(resolution=64))
    with pytest.raises(ValueError, match="row"):
        plot.layers(first, 64)
    with pytest.raises(ValueError, match="radius"):
        plot.bent_rays(ss.kernels.ssoc_maps(*board(), ss.Ssoc(resolution=64))[0], 0)
