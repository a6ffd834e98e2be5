"""Section 6 of Xie, Tabellion and Pearce 2007: where layered maps go wrong, and what parameters do.

``benches/layered.py --parts quality`` prints the same for more values and larger pictures.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
import softshadow as ss
from shapes import quad

REFERENCE = ss.RayTraced(samples=256, pattern="fixed")
SIZE = {"width": 128, "height": 128}


def _seen(setup, method, image=None):
    """Visibility of a picture; of maps without slopes if the receivers are given."""
    if image is None:
        return ss.render(setup.scene, setup.camera, setup.light, method).visibility
    maps = ss.kernels.layered_maps(setup.scene, setup.light, method)
    flat = [dataclasses.replace(m, slopes=None) for m in maps]
    points, normals = image.position[image.mask], image.normal[image.mask]
    seen = np.ones_like(image.visibility)
    seen[image.mask] = ss.kernels.trace_layered_maps(flat, setup.light, points, normals, method)
    return seen


def _errors(setup, exact, where, method, depths_only=False):
    """Mean absolute error, bias and largest error over some receivers."""
    seen = _seen(setup, method, exact if depths_only else None)
    error = (seen.astype(np.float64) - exact.visibility)[exact.mask & where]
    return np.abs(error).mean(), error.mean(), np.abs(error).max()


def _traced(setup):
    return ss.render(setup.scene, setup.camera, setup.light, REFERENCE)


@pytest.mark.parametrize("light", ["rect", "disk", "sphere"])
@pytest.mark.parametrize("name", ["ball", "oblique_board", "stacked_boards", "standing_cylinder"])
def test_the_scenes_have_penumbrae(name, light):
    setup = getattr(ss.scenes, name)(64, 64, light)
    image = ss.render(setup.scene, setup.camera, setup.light, ss.RayTraced(16))
    seen = image.visibility[image.mask]
    assert ((seen > 0) & (seen < 1)).mean() > 0.1
    assert (seen == 1).any()


def test_oblique_surfaces_leak_without_slopes_and_a_thickness_trades_leaks_for_umbra():
    """Figure 3a and 3b: a board that the light sees under 10 degrees."""
    setup = ss.scenes.oblique_board(**SIZE)
    exact = _traced(setup)
    ground = exact.mesh_id == 0
    mean, bias, _ = _errors(setup, exact, ground, ss.Mtsm(1024, 5))
    # Of the coarser levels (measured: 0.0016, and 0.0002 without them).
    assert mean < 0.002
    assert _errors(setup, exact, ground, ss.Mtsm(1024, 5, detail=1000))[0] < 0.0005
    # Measured: 0.0137, 0.0036 and 0.0074, biases 0.0120, -0.0007 and -0.0074; 0.0013 with slopes.
    leaking, middle, thick = (
        _errors(setup, exact, ground, ss.Mtsm(1024, 5, z_threshold=z), depths_only=True)
        for z in (0.0, 0.02, 0.08)
    )
    assert middle[0] > 2 * mean
    assert leaking[0] > 1.5 * middle[0] < 1.5 * thick[0]
    assert leaking[1] > 8 * abs(bias)
    assert thick[1] < -0.0071


def test_contact_shadows_begin_at_the_contact():
    setup = ss.scenes.standing_cylinder(**SIZE)
    exact = _traced(setup)
    near = (exact.mesh_id == 0) & (np.linalg.norm(exact.position[..., :2], axis=-1) < 0.3)
    assert near.sum() > 100
    # Up to 0.05 from the cylinder, all of it penumbra (measured: 0.0034 at 1024): texels
    # count, and then the levels that are coarser than them.
    rough, plain, fine = (
        _errors(setup, exact, near, ss.Mtsm(r, 5, detail=d))
        for r, d in ((256, 40), (1024, 40), (1024, 1000))
    )
    assert rough[0] < 0.006
    assert plain[0] < 0.005
    assert fine[0] < 0.003
    # None comes loose: nowhere a fifth of the light too much.
    assert max(rough[2], plain[2], fine[2]) < 0.05


@pytest.mark.parametrize(
    ("fine", "size"), [(2048, 64), pytest.param(4096, 128, marks=pytest.mark.slow)]
)
def test_a_curved_surface_does_not_shadow_its_lit_side(fine, size):
    setup = ss.scenes.ball(size, size)
    exact = _traced(setup)
    ball = exact.mesh_id == 1
    for options in ({"resolution": 256}, {}, {"resolution": fine, "detail": 1000}):
        method = ss.Mtsm(**{"resolution": 1024, "layers": 5} | options)
        # A convex body.
        assert _errors(setup, exact, ball, method)[2] == 0, options
    # Texels far smaller than triangles, which coarser levels answer for, darken a little where the
    # light sets (measured: 0.00002; largest 6/256).
    mean, bias, largest = _errors(setup, exact, ball, ss.Mtsm(fine, 5))
    assert mean < 0.00004
    assert bias == -mean
    assert largest <= 12 / 256


def test_a_missing_layer_lets_light_through():
    """Figure 3c: what is behind the last layer is not there."""
    setup = ss.scenes.stacked_boards(**SIZE)
    exact = _traced(setup)
    ground = exact.mesh_id == 0
    errors = [_errors(setup, exact, ground, ss.Mtsm(1024, k)) for k in range(1, 7)]
    # Measured: 0.0709, 0.0236, 0.0043, 0.0024 and, of the coarser levels only, 0.0022: the boards
    # that are kept are those farthest behind one another.
    means = [e[0] for e in errors]
    assert all(b < 0.7 * a for a, b in itertools.pairwise(means[:4]))
    assert means[4] < 0.003
    # A sixth layer is of use in coarser levels only.
    assert errors[5][0] <= errors[4][0]
    assert all(bias > 0 for _, bias, _ in errors[:3])
    assert errors[1][2] > 0.5 > 10 * errors[4][2]


def test_coarser_levels_cost_accuracy():
    setup = ss.scenes.closed_solids(96, 96, light_size=0.5, detail=3)
    exact = _traced(setup)
    partly = (exact.visibility > 0.002) & (exact.visibility < 0.998)
    coarse, default, fine = (
        _errors(setup, exact, partly, ss.Mtsm(1024, 5, detail=d))[0] for d in (10, 40, 1000)
    )
    # Measured: 0.0041, 0.0022 and 0.0019.
    assert fine < default < 0.6 * coarse
    assert default < 0.003
    assert coarse < 0.006


def test_a_thickness_darkens_and_a_bias_brightens():
    """Both only add or remove what hides samples, so that this holds sample by sample."""
    setup = ss.scenes.closed_solids(64, 64, detail=3)
    plain, thick, lifted = (
        _seen(setup, ss.Mtsm(256, 4, near=0.0, **k))
        for k in ({}, {"z_threshold": 0.02}, {"bias": 0.05})
    )
    assert (thick <= plain).all()
    assert (lifted >= plain).all()
    # Measured: 0.0024 darker, of 0.02 on either side of edges, and 0.0006 brighter.
    assert thick.mean() < plain.mean() - 0.001
    assert lifted.mean() > plain.mean() + 0.0003


@pytest.mark.parametrize("resolution", [64, 500, 512, 520, 600, 1024])
def test_an_oblique_ground_does_not_shadow_itself(resolution):
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (6, 0, 0), (0, 6, 0)), "ground")
    scene.add(quad((0, 0, 0.4), (0.3, 0, 0), (0, 0.3, 0)), "board")
    light = ss.DiskLight((2.5, 0.3, 0.7), (-1, 0, -0.25), 0.3)
    x, y = np.meshgrid(np.linspace(-2.5, 2.5, 80), np.linspace(-2.5, 2.5, 80))
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    normals = np.broadcast_to((0.0, 0.0, 1.0), points.shape)
    lit = ss.visibility(scene, points, normals, light, REFERENCE) == 1
    assert lit.sum() > 6000
    found = ss.visibility(scene, points, normals, light, ss.Mtsm(resolution, 4))
    assert found[lit].min() >= 1 - 2 / 256
    for point, seen in zip(points[lit], found[lit], strict=True):
        # No more samples than those whose segments pass the board's edge closely. A texel that is
        # told apart has 1/18 of the light: 0.019 at the board, which is at 4/7 of the way (one of
        # 64 is smaller). Pieces are right to a quarter of it (measured: 0.003, two points).
        if seen < 1:
            on_light, _, _ = ss.kernels.light_samples(light, point, 256)
            crossing = point + (on_light - point) * (0.4 / on_light[:, 2:])
            past = np.abs(crossing[:, :2]).max(axis=-1) - 0.15
            assert 256 * (1 - seen) <= (past < 0.019 / 4).sum()
    # Four of the lit points have such segments.
    assert (found[lit] < 1).sum() <= 4


def test_a_closed_housing_leaks_nowhere_with_all_texels_told_apart():
    """With the usual `detail` a line of receivers that see a wall edge-on is wrong."""
    answer = ss.scenes.hard["closed_housing"].answer(40, 40)
    setup = answer.setup
    for method in (ss.Slsm(512, detail=1000), ss.Mtsm(512, detail=1000)):
        seen = ss.render(setup.scene, setup.camera, setup.lights, method).visibility
        assert seen[answer.where].max() < 0.02
