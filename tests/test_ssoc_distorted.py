"""The occlusion camera's reference image, through its distorted rays (the paper's Figure 9)."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import softshadow as ss
from shapes import quad

REFERENCE = ss.RayTraced(samples=256, seed=5)
PLAIN, DISTORTED = ss.Ssoc(), ss.Ssoc(distorted=True)


def _curtain(x, z):
    """A sheet over a profile in x and z, 3 deep."""
    left, right = ([(a, y, b) for a, b in zip(x, z, strict=True)] for y in (-1.5, 1.5))
    n = len(left)
    i = np.arange(n - 1)
    faces = [np.stack(f, axis=1) for f in ((i, i + 1, n + i + 1), (i, n + i + 1, n + i))]
    return np.array(left + right), np.concatenate(faces)


def _bowl():
    angle = np.linspace(-np.pi / 2, 0, 64)
    return [-3, *(1.2 * np.cos(angle) - 0.8)], [0, *(1.2 * np.sin(angle) + 1.2)]


@functools.cache
def _behind_a_slab(profile):
    """A slab's edge before a surface that varies quickly in depth, as the light sees it."""
    if profile == "waves":
        setup = ss.scenes.hard["waves"].make(160, 160)
        return setup, ss.render(setup.scene, setup.camera, setup.light, REFERENCE)
    scene = ss.Scene()
    scene.add(_curtain(*_bowl()), profile)
    scene.add(quad((-0.9, 0, 1.3), (1.8, 0, 0), (0, 1.6, 0)), "slab")
    camera = ss.Camera((-2.2, -3, 1), (-0.3, 0, 0.2), fov_y_deg=40, width=160, height=160)
    setup = ss.scenes.Setup(scene, camera, ss.SphereLight((0.0, 0.1, 3.2), 0.35))
    return setup, ss.render(scene, camera, setup.light, REFERENCE)


def _false_umbra(found, reference):
    """How many points are black that see over a tenth of the light, and the penumbra's error."""
    partly = (reference > 0.002) & (reference < 0.998)
    return ((found == 0) & (reference > 0.1)).sum(), np.abs(found - reference)[partly].mean()


# Measured, plain and distorted: no black pixels of the bowl; 546 and none of the waves; errors of
# 0.0086, 0.0527 and 0.0073. The plane of what is seen is enough in the hollow, not among waves.
@pytest.mark.parametrize(
    ("profile", "method", "black", "error"),
    [
        ("bowl", PLAIN, 0, 0.009),
        ("bowl", DISTORTED, 0, 0.009),
        ("waves", PLAIN, 560, 0.054),
        ("waves", DISTORTED, 0, 0.0077),
    ],
)
def test_there_is_no_false_umbra_in_a_hollow_or_with_distorted_rays(profile, method, black, error):
    setup, reference = _behind_a_slab(profile)
    seen = reference.visibility[reference.mask].astype(np.float64)
    image = ss.render(setup.scene, setup.camera, setup.light, method)
    found = _false_umbra(image.visibility[reference.mask], seen)
    assert found[0] <= black
    assert found[1] <= error


# Measured: none; 809 and none; 0.0086, 0.0859 and 0.0074.
@pytest.mark.parametrize(
    ("profile", "method", "black", "error"),
    [
        ("bowl", PLAIN, 0, 0.009),
        ("bowl", DISTORTED, 0, 0.009),
        ("waves", PLAIN, 830, 0.088),
        ("waves", DISTORTED, 0, 0.0078),
    ],
)
def test_points_without_normals_hide_themselves_little(profile, method, black, error):
    """They have no tangent plane that tells what is their own surface."""
    setup, reference = _behind_a_slab(profile)
    points = reference.position[reference.mask]
    seen = reference.visibility[reference.mask].astype(np.float64)
    found = _false_umbra(ss.visibility(setup.scene, points, None, setup.light, method), seen)
    assert found[0] <= black
    assert found[1] <= error


SCENES = {
    "closed solids": lambda: ss.scenes.closed_solids(160, 160, "sphere", 0.2, detail=3),
    "two cylinders": lambda: ss.scenes.two_cylinders(160, 160),
    "overlapping boards": lambda: ss.scenes.overlapping_boards(160, 160),
    "landscape": lambda: ss.scenes.landscape(160, 160),
}


@pytest.mark.parametrize("name", SCENES)
def test_elsewhere_the_error_hardly_grows(name):
    setup = SCENES[name]()
    plain, distorted, reference = (
        ss.render(setup.scene, setup.camera, setup.light, m).visibility.astype(np.float64)
        for m in (PLAIN, DISTORTED, REFERENCE)
    )
    partly = (reference > 0.002) & (reference < 0.998)
    error = [np.abs(v - reference)[partly].mean() for v in (plain, distorted)]
    # Measured: 0.998 to 1.000 times as large.
    assert error[1] <= 1.002 * error[0]


@pytest.mark.parametrize(("kind", "tolerance"), [("rect", 1e-6), ("disk", 1e-6), ("sphere", 0.006)])
def test_a_plane_behind_an_edge_gets_the_same(kind, tolerance):
    """Only the receiver lies behind the silhouette: closed forms hold, as in test_ssoc.py."""
    setup = ss.scenes.half_plane(128, 128, light=kind, light_size=0.2)
    plain, distorted = (
        ss.render(setup.scene, setup.camera, setup.light, m) for m in (PLAIN, DISTORTED)
    )
    assert np.array_equal(plain.visibility, distorted.visibility)
    at = plain.mask & (plain.mesh_id == 0)
    expected = setup.visibility(plain.position[at])
    assert np.abs(distorted.visibility[at] - expected).max() < tolerance


@pytest.mark.parametrize("size", [0.0, 1e-4])
def test_a_small_light_has_no_use_for_it(size):
    setup = ss.scenes.closed_solids(128, 128, "sphere", size, detail=3)
    plain, distorted = (
        ss.render(setup.scene, setup.camera, setup.light, m).visibility for m in (PLAIN, DISTORTED)
    )
    assert np.array_equal(plain, distorted)


@pytest.mark.parametrize("seed", range(4))
def test_random_soups_give_finite_visibilities(seed):
    rng = np.random.default_rng(seed)
    scene = ss.Scene()
    scene.add((rng.normal(size=(40, 3)), rng.integers(0, 40, size=(60, 3))), "soup")
    light = ss.SphereLight(rng.normal(size=3) * (0.3 if seed % 2 else 3.0), 0.5)
    points = np.concatenate([rng.normal(size=(500, 3)) * 2, [light.center]])
    for normals in (None, rng.normal(size=points.shape)):
        method = ss.Ssoc(resolution=64, distorted=True)
        seen = ss.visibility(scene, points, normals, light, method)
        assert np.isfinite(seen).all()
        assert seen.min() >= 0
        assert seen.max() <= 1


def test_it_is_true_or_false():
    setup = ss.scenes.closed_solids(16, 16, detail=1)
    for bad in ("yes", 1, None):
        with pytest.raises(TypeError, match="distorted"):
            ss.render(setup.scene, setup.camera, setup.light, ss.Ssoc(distorted=bad))
