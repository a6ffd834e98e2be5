"""Single sample soft shadows where geometry or lights degenerate, and of bad arguments."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from bits import digest, with_threads
from outer_objects import GROUND, LIGHTS, POINT, floor_points, scene_of, solids
from shapes import bumpy, quad


@pytest.mark.parametrize("kind", ["sphere", "disk"])
@pytest.mark.parametrize("overlap", ["minimum", "add"])
def test_a_light_of_size_zero_casts_hard_shadows_to_the_bit(kind, overlap):
    setup = ss.scenes.closed_solids(96, 96, kind, 0.0, detail=3)
    setup.scene.add_spheres([(0.3, 0.2, 1.0)], [0.15], name="above")
    hard, soft = (
        ss.render(setup.scene, setup.camera, setup.light, m)
        for m in ("hard", ss.SingleSample(overlap=overlap))
    )
    assert np.array_equal(hard.visibility, soft.visibility)
    assert 0 < (hard.visibility[hard.mask] == 0).mean() < 1


def test_small_lights_tend_to_hard_shadows():
    hard = ss.render(*_arguments(0.0), "hard").visibility
    errors = [
        np.abs(ss.render(*_arguments(size), "single_sample").visibility - hard).mean()
        for size in (0.1, 0.01, 0.001)
    ]
    # The penumbra's area is proportional to the light's size.
    assert errors[1] < 0.2 * errors[0]
    assert errors[2] < 0.2 * errors[1]


def _arguments(size):
    setup = ss.scenes.closed_solids(128, 128, "sphere", size, detail=3)
    return setup.scene, setup.camera, setup.light


def test_triangles_without_area_have_no_outer_object():
    points, normals = floor_points(81)
    plain = scene_of(GROUND, quad((0, 0, 1), (0.5, 0, 0), (0, 0.5, 0)))
    flat = scene_of(GROUND, quad((0, 0, 1), (0.5, 0, 0), (0, 0.5, 0)))
    needle = np.array([(-1, -1, 1), (0, 0, 1), (1, 1, 1), (0.5, -0.5, 1)], dtype=np.float64)
    flat.add((needle, [[0, 1, 2], [0, 0, 2], [3, 3, 3], [0, 2, 1]]), "no area")
    for light in LIGHTS.values():
        a, b = (ss.visibility(s, points, normals, light, "single_sample") for s in (plain, flat))
        # The frame may be another: by the rounding of coordinates.
        assert np.abs(a - b).max() < 1e-5


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", LIGHTS)
def test_random_soups_give_finite_visibilities(seed, kind):
    """Open, with slivers, degenerate and duplicate faces, through light and receivers."""
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(40, 3))
    vertices[20:30] = vertices[10:20] + rng.normal(size=(10, 3)) * 1e-7
    faces = rng.integers(0, 40, size=(80, 3))
    faces[:3] = faces[3:6]
    faces[6] = faces[6, 0]
    scene = scene_of((vertices, faces))
    scene.add_spheres(rng.normal(size=(5, 3)), rng.uniform(0.01, 1.5, 5), name="balls")
    center = rng.normal(size=3) * (0.3 if seed % 2 else 3.0)
    light = ss.scenes.light_towards(kind, center, 0.5, (0.1, 0.2, 0.3))
    points = np.concatenate([rng.normal(size=(400, 3)) * 2, vertices, [light.center]])
    for normals in (None, rng.normal(size=points.shape)):
        hard = ss.visibility(scene, points, normals, light, "hard")
        for overlap in ("minimum", "multiply", "add"):
            method = ss.SingleSample(overlap=overlap)
            seen = ss.visibility(scene, points, normals, light, method)
            assert np.isfinite(seen).all()
            assert seen.min() >= 0
            assert seen.max() <= 1
            if normals is None:
                assert (seen <= hard).all()


def test_occluders_that_cross_the_light_or_the_receiver():
    """A board through the light's middle, and a post that sticks out of the ground both ways."""
    for light in LIGHTS.values():
        board = quad((0.1, 0.2, 3), (0.2, 0, 2), (0, 0.3, 0))
        scene = scene_of(GROUND, board)
        points, normals = floor_points(81)
        seen = ss.visibility(scene, points, normals, light, "single_sample")
        assert np.isfinite(seen).all()
        # It all but touches the centre: as dark as can be on the side that it hides.
        assert seen.min() < 0.05
        post = quad((0, 0, 0), (0.4, 0, 0), (0, 0.1, 1.5))
        seen = ss.visibility(scene_of(GROUND, post), points, normals, light, "single_sample")
        upper = quad((0, 0.025, 0.375), (0.4, 0, 0), (0, 0.05, 0.75))
        half = ss.visibility(scene_of(GROUND, upper), points, normals, light, "single_sample")
        # What is below the ground casts nothing on it.
        assert np.abs(seen - half).max() < 1e-4


def test_spheres_around_the_light_the_receiver_and_both():
    light = ss.SphereLight((0, 0, 2), 0.2)
    points = np.array([(0.1, 0.2, 0.0), (0.5, -0.3, 0.1)])
    for center, radius, expected in [
        ((0, 0, 2), 0.5, 0.0),  # around the light
        ((0, 0, 0), 0.9, 0.0),  # around the receivers
        ((0, 0, 1), 3.0, 1.0),  # around both: no surface between
        ((0, 0, 6), 1.0, 1.0),  # beyond the light
        ((0, 0, -3), 1.0, 1.0),  # behind the receivers
    ]:
        scene = ss.Scene()
        scene.add_spheres([center], [radius], name="ball")
        scene.add(quad((9, 9, 9), (1, 0, 0), (0, 1, 0)), "far")
        found = ss.visibility(scene, points, None, light, "single_sample")
        assert found.tolist() == [expected, expected], (center, radius)


def test_a_sphere_that_passes_the_light_is_cut_at_its_plane():
    light = ss.SphereLight((0, 0, 2), 0.3)
    heights = np.linspace(1.5, 2.6, 221)
    seen = []
    for z in heights:
        scene = scene_of(GROUND)
        scene.add_spheres([(0.35, 0, z)], [0.3], name="ball")
        found = ss.visibility(scene, [(0.0, 0, 0)], [(0, 0, 1.0)], light, "single_sample")
        seen.append(float(found[0]))
    assert seen[0] < 0.1
    assert seen[-1] == 1
    # The paper's rule would jump by 0.9 where the middle passes the light, at 2. The cut by the
    # light's plane shrinks to a point, and is gone at 2.3; its radius has a vertical slope there.
    steps = np.abs(np.diff(seen))
    assert steps[heights[1:] < 2.29].max() < 0.05
    assert steps.max() < 0.55


@pytest.mark.parametrize("kind", ["disk", "rect"])
def test_receivers_edge_on_to_a_light(kind):
    """In its plane, a hair in front of it and a hair behind it."""
    light = ss.scenes.light_towards(kind, (0, 0, 1), 0.3, (0, 0, 0))
    scene = scene_of(quad((0.6, 0, 1), (0, 0.2, 0), (0, 0, 0.2)), GROUND)
    up = np.array([0.0, 1e-30, 1e-16, 1e-12, 1e-8, 1e-7, 1e-6, 1e-4])
    z = 1 + np.concatenate([up, -up])
    points = np.stack([np.full_like(z, 1.2), np.zeros_like(z), z], axis=1)
    seen = ss.visibility(scene, points, None, light, "single_sample")
    assert np.isfinite(seen).all()
    assert (seen[points[:, 2] >= 1] == 0).all()  # behind
    assert (seen == 0).all()  # the board is in between


@pytest.mark.parametrize(
    ("scale", "move"), [(2.0**-20, 0), (2.0**20, 0), (1e6, 0), (1e-6, 0), (1.0, 1e4), (1e-3, 50)]
)
def test_scaled_and_moved_scenes_give_the_same(scale, move):
    def picture(scale, move):
        def at(p):
            return np.asarray(p, dtype=np.float64) * scale + move

        vertices, faces = bumpy(12, seed=3)
        scene = scene_of((at(GROUND[0]), GROUND[1]), (at(vertices * 0.4 + [0, 0, 0.7]), faces))
        scene.add_spheres(at([(0.9, 0.4, 0.4)]), [0.3 * scale], name="ball")
        light = ss.RectLight(at((0.6, -0.4, 2.5)), (0, 0.4 * scale, 0), (0.4 * scale, 0, 0))
        camera = ss.Camera(at((0.4, -3.2, 2.0)), at((0, 0.1, 0.3)), width=96, height=96)
        return ss.render(scene, camera, light, "single_sample").visibility

    plain, other = picture(1.0, 0.0), picture(scale, move)
    if move == 0 and np.log2(scale) % 1 == 0:
        assert np.array_equal(plain, other)
    else:
        # Rounding moves coordinates by an ulp: 2e-7 of the scene, 1e-5 of a penumbra, and single
        # pixels to another surface.
        assert (np.abs(plain - other) > 1e-3).mean() < 0.002


def test_the_number_of_threads_changes_no_bit():
    def digests():
        setup = solids(64)
        setup.scene.add_spheres([(0.3, 0.2, 1.0)], [0.15], name="above")
        lights = [setup.light, LIGHTS["rect"]]
        methods = ss.SingleSample(), ss.SingleSample(overlap="multiply", parts="triangles")
        images = [ss.render(setup.scene, setup.camera, lights, method) for method in methods]
        return digest(*(image.visibility for image in images))

    assert len(with_threads(digests, 1, 2, 5)) == 1


def test_points_and_pixels_get_the_same():
    setup = solids()
    image = ss.render(setup.scene, setup.camera, setup.light, "single_sample")
    at = image.mask
    normals = np.asarray(image.normal[at], dtype=np.float64)
    found = ss.visibility(setup.scene, image.position[at], normals, setup.light, "single_sample")
    # Normals of an image are single precision: on single pixels of edge-on surfaces it shows.
    assert (np.abs(found - image.visibility[at]) > 1e-3).mean() < 1e-3


# ---------------------------------------------------------------- parameters


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"falloff": "sharp"}, ["falloff", '"light", "linear", "smooth"', '"sharp"']),
        ({"overlap": "max"}, ["overlap", '"minimum", "multiply", "add"', '"max"']),
        ({"parts": "edges"}, ["parts", '"objects", "triangles"', '"edges"']),
        ({"opacity": "half"}, ["opacity", '"opaque"', '"half"']),
    ],
)
def test_bad_parameters_are_named(parameters, words):
    with pytest.raises(ss.ParameterError, match="SingleSample") as error:
        ss.visibility(scene_of(GROUND), [(0, 0, 1)], None, POINT, ss.SingleSample(**parameters))
    assert all(word in str(error.value) for word in words)


def test_bad_arguments_of_the_kernels_are_named():
    scene = scene_of(GROUND)
    with pytest.raises(ValueError, match="normals"):
        ss.kernels.outer_distances(scene, [(0, 0, 1)], [(0, 0, 1), (0, 0, 1)], POINT)
    with pytest.raises(ValueError, match="point 1"):
        ss.kernels.outer_distances(scene, [(0, 0, 1), (0, np.nan, 1)], None, POINT)
    with pytest.raises(ValueError, match="value 1 is not a number"):
        ss.kernels.attenuation([0.5, np.nan])
    with pytest.raises(ValueError, match="falloff"):
        ss.kernels.attenuation([0.5], "cubic")
    clear = scene_of(GROUND)
    clear.add(quad((0, 0, 1), (1, 0, 0), (0, 1, 0)), "sheet", opacity=0.5)
    with pytest.raises(ValueError, match="opacity"):
        ss.kernels.outer_distances(clear, [(0, 0, 1)], None, POINT)
