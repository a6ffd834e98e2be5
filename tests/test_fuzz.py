"""A few of the fuzzer's cases; its brute force against closed forms, its checks against faults."""

from __future__ import annotations

import math
from dataclasses import replace

import fresh
import numpy as np
import pytest
import softshadow as ss
from fuzz import brute, checks
from fuzz.scenes import BOX, KINDS, QUAD, Case, Item, Lamp, box, make, sheet
from fuzz.smaller import program, smallest

SEEDS = range(10)
COUNT = 40_000
# Six standard deviations of as many samples.
CLOSE = 6 * 0.5 / math.sqrt(COUNT)

LIGHTS = [
    ss.RectLight((0, 0, 2), (0, 0.5, 0), (0.5, 0, 0)),
    ss.DiskLight((0, 0, 2), (0, 0, -1), 0.25),
    ss.SphereLight((0, 0, 2), 0.25),
]


@pytest.mark.parametrize("seed", SEEDS)
def test_random_cases_hold(seed):
    assert not checks.Run(make(seed)).all()


def test_seeds_draw_every_kind_and_each_of_them_the_same_case():
    assert {k for s in range(60) for k in make(s).tags} >= set(KINDS)
    assert program(make(3), "hard") == program(make(3), "hard")


def test_bits_do_not_depend_on_threads_in_other_processes():
    """The driver's way: its two processes agree on what they see, and it counts what it ran."""
    driver = "import sys; from fuzz.__main__ import main; sys.exit(main())"
    options = "--seconds", 60, "--seed", 4, "--count", 1
    done = fresh.run(driver, *options, seconds=300)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith("1 cases from 4, 0 failures\n")


# ---------------------------------------------------------------- brute force and closed forms


def _seen(scene, light, p=(0.0, 0.0, 0.0), n=(0.0, 0.0, 1.0)):
    random = np.random.default_rng(1)
    args = brute.Brute(scene), light, np.array([p]), np.array([n], dtype=float), COUNT, random
    value, doubt = brute.visibility(*args, [1e-6])
    assert doubt[0] < 1e-2
    return value[0]


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("x", [-0.1, -0.05, 0.0, 0.0625, 0.2])
def test_a_half_plane_hides_its_part_of_the_light(light, x):
    """Its edge at half height is seen on the light at twice ``x``."""
    scene = ss.Scene()
    scene.add((sheet(1.0, 5.0, (x + 5.0, 0.0)), QUAD))
    if isinstance(light, ss.RectLight):
        part = min(max((2 * x + 0.25) / 0.5, 0), 1)
    else:
        # The sphere's outline, at the sine of its half-angle, is a little wider than the disk.
        sin = 0.25 / 2
        radius = 2 * (sin / math.sqrt(1 - sin * sin) if isinstance(light, ss.SphereLight) else sin)
        t = min(max(2 * x / radius, -1), 1)
        part = 1 - (math.acos(t) - t * math.sqrt(1 - t * t)) / math.pi
    # A cap's solid angle is not its gnomonic image's area: off by its half-angle squared.
    slack = 0.25**2 / 4 if isinstance(light, ss.SphereLight) else 0.0
    assert abs(_seen(scene, light) - part) < CLOSE + slack


@pytest.mark.parametrize("opacity", [1.0, 0.25])
def test_a_ball_before_the_light_hides_the_square_of_its_radius(opacity):
    """Crossed twice; a cone's solid angle goes with 1 - cos of its half-angle."""
    scene = ss.Scene()
    scene.add_spheres((0, 0, 1), 0.05, opacity=opacity)
    cap = lambda sin: 1 - math.sqrt(1 - sin * sin)  # noqa: E731
    tangent = math.tan(math.asin(0.05))
    hidden = [4 * tangent**2 / 0.25**2, cap(0.05) / cap(0.125)]
    for light, part in zip(LIGHTS[1:], hidden, strict=True):
        expected = 1 - part * (1 - (1 - opacity) ** 2)
        assert abs(_seen(scene, light) - expected) < CLOSE


@pytest.mark.parametrize("light", LIGHTS)
def test_tangent_planes_and_backs_hide_their_part(light):
    scene = ss.Scene()
    scene.add((sheet(-1.0, 0.1), QUAD))
    assert abs(_seen(scene, light, n=(1.0, 0.0, 0.0)) - 0.5) < CLOSE
    above = _seen(scene, light, p=(0.0, 0.0, 3.0), n=(0.0, 0.0, -1.0))
    assert above == (1.0 if isinstance(light, ss.SphereLight) else 0.0)
    for p, n in [((0.3, 0.1, 0), (0.8, 0.1, 0.05)), ((0.1, 0, 1.5), (0.9, 0.2, -0.1))]:
        n = np.array(n) / np.linalg.norm(n)
        exact = ss.kernels.light_fraction_above(light, [p], [n])[0]
        assert abs(_seen(scene, light, p, n) - exact) < CLOSE


def test_a_box_around_the_receiver_hides_all_and_what_is_unsure_is_said():
    scene = ss.Scene()
    scene.add((box((-1, -1, -0.5), (1, 1, 1)), BOX))
    for light in LIGHTS:
        assert _seen(scene, light) == 0
    edge = ss.Scene()
    edge.add((sheet(1.0, 5.0, (5.0, 0.0)), QUAD))
    points, normals = np.array([[0, 0, 0], [0.1, 0, 0]]), np.array([[0, 0, 1.0]] * 2)
    _, sure = brute.hard(brute.Brute(edge), LIGHTS[0], points, normals, [1e-6] * 2)
    assert sure.tolist() == [False, True]


# ---------------------------------------------------------------- checks find faults


def _plain():
    items = (Item("mesh", (sheet(0.0, 2.0), QUAD)), Item("mesh", (sheet(0.5, 0.6), QUAD)))
    lamps = (Lamp("rect", ((0, 1.2, 2), (0, 0.6, 0), (0.6, 0, 0))),)
    return Case(0, frozenset(), items, lamps, (0.1, -2.5, 2.5), (0, -0.5, 0), (0, 0, 1), 30.0)


def test_a_bias_of_a_twentieth_is_found(monkeypatch):
    assert not checks.Run(_plain()).all()
    real = ss.visibility
    monkeypatch.setattr(ss, "visibility", lambda *a: np.clip(real(*a) * 0.95, 0, 1))
    assert {f.check for f in checks.Run(_plain()).all()} == {"unbiased"}


def test_shadows_that_are_lost_and_numbers_out_of_range_are_found():
    run = checks.Run(_plain())
    run.all()
    good = run.images["wedges"]
    for visibility, check in [
        (np.ones_like(good.visibility), "lost_shadow"),
        (np.zeros_like(good.visibility), "lost_shadow"),
        (good.visibility - 1e-7, "in_range"),
        (good.visibility * np.float32("nan"), "in_range"),
    ]:
        run = checks.Run(_plain())
        run.images = {"wedges": replace(good, visibility=visibility)}
        getattr(checks, check)(run)
        assert [f.check for f in run.failures] == [check]


def test_what_is_known_names_what_there_is():
    names = {c.__name__ for c in checks.CHECKS}
    tags = {t for s in range(300) for t in make(s).tags}
    for known in checks.KNOWN:
        assert set(known.checks) <= names
        assert set(known.methods) <= set(checks.METHODS)
        assert set(known.tags) <= tags


def test_a_failing_case_is_made_as_small_as_it_can_be(monkeypatch):
    def fault(run):
        if any(
            len(i.arrays[1]) and i.kind == "mesh" and i.arrays[0][0][2] == 0.5
            for i in run.case.items
        ):
            run.fail("fault", "hard", "found")

    monkeypatch.setattr(checks, "CHECKS", [fault])
    less = smallest(_plain(), checks.Failure("fault", "hard", 0, ""))
    assert len(less.items) == 1
    assert len(less.items[0].arrays[1]) == 1
    assert "ss.RectLight" in program(less, "hard")
