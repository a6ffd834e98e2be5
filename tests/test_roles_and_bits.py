"""Who casts and who receives, how lights add up, and what may change the bits of an image."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest
import softshadow as ss
from bits import digest, with_threads
from closed_forms import FLOOR, MANY, METHODS
from fuzz.checks import METHODS as SMALL
from shapes import geodesic

# ---------------------------------------------------------------- who casts, who receives, sums


def _penumbra_scene(**ball):
    scene = ss.Scene()
    scene.add(FLOOR, "floor")
    vertices, faces = geodesic(6)
    scene.add((vertices * 0.3 + [0, 0, 0.6], faces), "ball", **ball)
    return scene


WIDE = ss.RectLight((0.3, 0.2, 2.0), (0, 0.9, 0), (0.9, 0, 0), (1, 0.5, 0.2))
VIEW = ss.Camera((0.4, -2.2, 2.2), (0, 0, 0.1), width=64, height=48)


@pytest.mark.parametrize("method", METHODS)
def test_what_does_not_cast_is_seen_but_hides_nothing(method):
    solid, ghost = (
        ss.render(_penumbra_scene(casts=c), VIEW, WIDE, METHODS[method]) for c in (True, False)
    )
    assert np.array_equal(solid.mesh_id, ghost.mesh_id)
    floor = solid.mesh_id == 0
    assert (ghost.visibility[floor] == 1).all()
    assert (solid.visibility[floor] == 0).any()


@pytest.mark.parametrize("method", METHODS)
def test_what_does_not_receive_is_shaded_as_unshadowed(method):
    scene = _penumbra_scene()
    plain = ss.render(scene, VIEW, WIDE, METHODS[method])
    other = ss.Scene()
    other.add(FLOOR, "floor", receives=False)
    ball = scene.entries[1]
    other.add((ball.vertices, ball.faces), "ball", receives=False)
    image = ss.render(other, VIEW, WIDE, METHODS[method])
    mask = image.mask
    h = ss.kernels.light_fraction_above(WIDE, image.position[mask], image.normal[mask])
    assert np.abs(image.visibility[mask] - h).max() < 1e-6
    e = ss.kernels.unshadowed_irradiance(WIDE, image.position[mask], image.normal[mask])
    expected = e[:, None] * 0.8 / math.pi * np.array(WIDE.radiance)
    # Image normals are single precision: 1e-7 of the largest irradiance.
    assert np.abs(image.radiance[mask] - expected).max() < 1e-6 * expected.max()
    assert (plain.visibility[mask] < image.visibility[mask] - 0.5).any()


def test_several_lights_add_up():
    lights = [
        WIDE,
        ss.SphereLight((-1, 0.5, 1.5), 0.3, 2.0),
        ss.DiskLight((0, 2, 1), (0, -2, -1), 0.4),
    ]
    scene = _penumbra_scene()
    together = ss.render(scene, VIEW, lights, "hard")
    alone = [ss.render(scene, VIEW, light, "hard") for light in lights]
    assert together.visibility.shape == (3, 48, 64)
    for k, image in enumerate(alone):
        assert np.array_equal(together.visibility[k], image.visibility)
    total = np.sum([image.radiance.astype(np.float64) for image in alone], axis=0)
    # Three terms in single precision.
    assert np.abs(together.radiance - total).max() <= 3 * 2.0**-24 * total.max()
    traced = ss.render(scene, VIEW, lights, METHODS["ray_traced"])
    # Every light has the shadows that many samples of it have.
    for k, light in enumerate(lights):
        exact = ss.render(scene, VIEW, light, MANY)
        assert np.abs(traced.visibility[k] - exact.visibility).max() < 0.08
        assert np.abs(traced.visibility[k] - exact.visibility).mean() < 0.003


@pytest.mark.parametrize("name", SMALL)
def test_a_light_has_the_same_bits_alone_and_in_company_in_any_order(name):
    lights = [
        WIDE,
        ss.SphereLight((-1, 0.5, 1.5), 0.3, 2.0),
        ss.DiskLight((0, 2, 1), (0, -2, -1), 0.4),
        WIDE,
    ]
    scene = _penumbra_scene()
    small = ss.Camera((0.4, -2.2, 2.2), (0, 0, 0.1), width=24, height=16)
    alone = [ss.render(scene, small, light, SMALL[name]).visibility for light in lights]
    assert any((v > 0).any() and (v < 1).any() for v in alone)
    for order in ([0, 1, 2, 3], [2, 0, 1], [1, 2]):
        together = ss.render(scene, small, [lights[k] for k in order], SMALL[name])
        for k, seen in zip(order, together.visibility, strict=True):
            assert np.array_equal(seen, alone[k]), (order, k)


def test_errors_of_lights_that_share_samples_are_no_larger_than_those_of_one():
    """The least favourable lights: all in one place, so that no error evens out another."""
    scene = _penumbra_scene()

    def relative(lights, method):
        image, exact = (ss.render(scene, VIEW, lights, m).radiance for m in (method, MANY))
        return np.sqrt(np.mean((image - exact) ** 2) / np.mean(exact**2))

    alone = relative([WIDE], METHODS["ray_traced"])
    # Sums in single precision; the reference shares its samples, too.
    assert relative([WIDE] * 3, METHODS["ray_traced"]) <= alone * (1 + 1e-3)


# ---------------------------------------------------------------- bits


def _digest(image):
    return digest(image.visibility, image.radiance, image.position, image.triangle_id)


@pytest.mark.parametrize("pattern", ["per_receiver", "fixed"])
def test_the_same_seed_gives_the_same_bits_and_another_seed_others(pattern):
    def render(seed):
        method = ss.RayTraced(samples=64, seed=seed, pattern=pattern)
        return ss.render(_penumbra_scene(), VIEW, WIDE, method)

    digests = [_digest(render(seed)) for seed in (0, 0, 1, 2**63, 2**64 - 1, 1)]
    assert digests[0] == digests[1]
    assert digests[2] == digests[5]
    assert len(set(digests)) == 4


def test_the_number_of_threads_changes_no_bit():
    lights = [WIDE, ss.SphereLight((-1, 0.5, 1.5), 0.3)]

    def digests():
        return tuple(
            _digest(ss.render(scene, VIEW, lights, method))
            for scene in (_penumbra_scene(), _penumbra_scene(opacity=0.3))
            for method in ("hard", ss.RayTraced(64), ss.RayTraced(64, cull=False))
        )

    found = with_threads(digests, 1, 2, 7)
    assert len(found) == 1
    assert len(set(found.pop())) == 4  # culling changes nothing


def _run(program, **variables):
    """What a program prints, word by word, with variables of the environment set."""
    return subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, **variables},
        cwd=os.path.dirname(__file__),
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    ).stdout.split()


LEVELS = """
import softshadow as ss
from bits import digest
from fuzz.checks import METHODS
from shapes import geodesic
from closed_forms import FLOOR
print(ss._core.simd_level())
view = ss.Camera((0.4, -2.2, 2.2), (0, 0, 0.1), width=24, height=18)
lights = [
    ss.RectLight((0.3, 0.2, 2.0), (0, 0.9, 0), (0.9, 0, 0)),
    ss.SphereLight((-1, 0.5, 1.5), 0.3),
    ss.DiskLight((0, 2, 1), (0, -2, -1), 0.4),
    ss.DistantLight((-0.4, 0.2, -1), 12),
]
vertices, faces = geodesic(6)
for opacity in (0.3, 1.0):
    scene = ss.Scene()
    scene.add(FLOOR, "floor")
    scene.add((vertices * 0.3 + [0, 0, 0.6], faces), "ball", opacity=opacity)
    for name, method in METHODS.items():
        for light in lights:
            try:
                image = ss.render(scene, view, light, method)
                print(digest(image.visibility, image.radiance))
            except ss.UnsupportedError:
                print("-")
scene.add_spheres([(-0.4, 0.3, 0.5)], [0.2])
for method in ("hard", "ray_traced", "counted", "single_sample"):
    print(digest(ss.render(scene, view, lights[0], METHODS[method]).radiance))
"""


def _levels():
    """The machine's SIMD levels, which the error for a bad one lists."""
    with pytest.raises(subprocess.CalledProcessError) as caught:
        _run("import softshadow", SOFTSHADOW_SIMD="none")
    message = caught.value.stderr.splitlines()[-1]
    known = 'ImportError: SOFTSHADOW_SIMD is "none"; this machine has '
    assert message.startswith(known)
    return message.removeprefix(known).split(", ")


def test_the_simd_level_changes_no_bit():
    best, *pictures = _run(LEVELS, SOFTSHADOW_SIMD="")
    assert len(pictures) == 2 * 4 * len(SMALL) + 4
    assert len(set(pictures)) > 50
    levels = _levels()
    assert levels[0] == "fallback"
    assert levels[-1] == best
    for level in levels[:-1]:
        used, *same = _run(LEVELS, SOFTSHADOW_SIMD=level)
        assert used == level
        assert same == pictures, level
