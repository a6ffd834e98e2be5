"""Penumbra wedges at every setting where silhouettes are hard, and at any scale.

How right the usual setting is there, `test_hard_cases.py` tells.
"""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from penumbrae import CAMERA, CENTER, GROUND, ball, box, lights, over_ground
from shapes import quad
from softshadow.scenes.hard_cases.case import SIZE

C = np.array(CENTER)

EVERY = [
    ss.ShadowVolume(),
    ss.Wedges(),
    ss.Wedges(counting="zfail"),
    ss.Wedges(falloff="line"),
    ss.Wedges(falloff="linear", planes="paper", counting="zfail"),
    ss.Wedges(falloff="smooth", overlap="add", vertex_angle=5),
    ss.Wedges(quads=7, overlap="minimum"),
    ss.Wedges(buffer="integer"),
]


def _at(x, y, z):
    """A point as the light's centre sees it."""
    return C + np.array([x, y, z])


def _triangle(*corners):
    return np.array(corners, dtype=np.float64), np.array([[0, 1, 2]])


TOUCHING = {
    "cuts the light": lambda: quad(C, (0.8, 0, 0), (0, 0.8, 0)),
    "around the light": lambda: box((0.6, 0.6, 0.6), CENTER),
    "beside the light": lambda: quad(_at(0.4, 0, 0), (0.8, 0, 0), (0, 1, 0)),
    "edge through the centre": lambda: _triangle(_at(-1, 0, 0), _at(1, 0, 0), _at(0, 0.2, -1)),
    "corner at the centre": lambda: _triangle(C, _at(1, 0, -0.5), _at(0, 0.2, -1)),
}


def _numbers_from_0_to_1(scene, camera, lights):
    """Visibilities by every setting, which are that; and whether both ways to count agree."""
    seen = [ss.render(scene, camera, lights, method).visibility for method in EVERY]
    for values in seen:
        assert np.isfinite(values).all()
        assert values.min() >= 0
        assert values.max() <= 1
    volumes = ss.render(scene, camera, lights, ss.ShadowVolume(counting="zfail")).visibility
    return seen, np.array_equal(seen[1], seen[2]) and np.array_equal(seen[0], volumes)


@pytest.mark.parametrize("name", TOUCHING)
def test_a_light_that_touches_an_occluder_gets_numbers_from_0_to_1(name):
    scene = over_ground(TOUCHING[name]())
    seen, agree = _numbers_from_0_to_1(scene, CAMERA, [*lights().values()])
    assert agree
    if name == "around the light":
        ground = ss.render(scene, CAMERA, lights()["disk"], "hard").mesh_id == 0
        assert (seen[1][:, ground] == 0).all()


@pytest.mark.parametrize("name", ss.scenes.hard)
def test_every_setting_gives_numbers_from_0_to_1_in_all_hard_cases(name):
    case = ss.scenes.hard[name]
    setup = case.make(*SIZE)
    if "wedges" in case.measured:
        _, agree = _numbers_from_0_to_1(setup.scene, setup.camera, setup.lights)
        # As the page of `shadow_volume` says: a light's centre in the middle of a face.
        assert agree == (name != "pierced_light")


@pytest.mark.parametrize("name", ["fin", "turned_faces", "degenerate_mesh"])
def test_shadow_volumes_of_surfaces_without_one_winding_are_right(name):
    setup = ss.scenes.hard[name].make(*SIZE)
    light = ss.SphereLight(setup.light.center, 0)
    expected = ss.render(setup.scene, setup.camera, light, "hard").visibility
    for counting in ("zpass", "zfail"):
        image = ss.render(setup.scene, setup.camera, light, ss.ShadowVolume(counting))
        assert (image.visibility != expected).sum() <= 2


def test_duplicate_faces_change_nothing():
    plain = box()
    twice = plain.vertices, np.concatenate([plain.faces, plain.faces])
    for light in lights().values():
        for method in EVERY:
            one, two = (
                ss.render(over_ground(mesh), CAMERA, light, method) for mesh in (plain, twice)
            )
            assert np.array_equal(one.visibility, two.visibility)


def test_collinear_neighbours_are_one_edge():
    # On coordinates that halve exactly, the subdivided box has the same edges in pieces.
    plain = box((0.5, 0.375, 0.25), (0, 0, 0.5), 0)
    pieces = plain.subdivide().subdivide()
    for light in lights().values():
        for method, bound in ((ss.ShadowVolume(), 0), (ss.Wedges(), 2e-6)):
            one, two = (
                ss.render(over_ground(mesh), CAMERA, light, method) for mesh in (plain, pieces)
            )
            error = np.abs(one.visibility - two.visibility)[one.mesh_id == 0]
            # Areas of the pieces add up to the edge's but for the rounding of each.
            assert error.max() <= bound
        # Between planes, a piece has side planes of its own, along the light's central ray.
        one, two = (
            ss.render(over_ground(mesh), CAMERA, light, ss.Wedges(falloff="line"))
            for mesh in (plain, pieces)
        )
        assert np.abs(one.visibility - two.visibility)[one.mesh_id == 0].mean() < 5e-4


def _moved(scale, shift):
    """The same scene, camera and light, in other units and elsewhere."""
    shift = np.asarray(shift, dtype=np.float64)
    scene = ss.Scene()
    for vertices, faces in (GROUND, (ball().vertices, ball().faces), (box().vertices, box().faces)):
        scene.add((vertices * scale + shift, faces))
    eye, target = (np.array(p) * scale + shift for p in ((0.3, -2.4, 1.9), (0.0, 0.1, 0.15)))
    camera = ss.Camera(eye, target, fov_y_deg=40, width=72, height=64)
    center = C * scale + shift
    return (
        scene,
        camera,
        [
            ss.RectLight(center, (0, 0.4 * scale, 0), (0.4 * scale, 0, 0)),
            ss.SphereLight(center, 0.2 * scale),
        ],
    )


@pytest.mark.parametrize("method", [ss.ShadowVolume(), ss.Wedges(), ss.Wedges(falloff="line")])
@pytest.mark.parametrize(
    ("scale", "shift", "bound"),
    [
        (2.0**20, (0, 0, 0), 0),
        (2.0**-20, (0, 0, 0), 0),
        (1e6, (0, 0, 0), 1e-4),
        (1e-6, (0, 0, 0), 1e-4),
        (1.0, (6e4, -6e4, 6e4), 1e-4),
        (1e6, (6e10, 0, -6e10), 1e-4),
    ],
)
def test_scale_and_place_of_the_scene_do_not_matter(method, scale, shift, bound):
    scene, camera, sources = _moved(1.0, (0, 0, 0))
    here = ss.render(scene, camera, sources, method)
    scene, camera, sources = _moved(scale, shift)
    there = ss.render(scene, camera, sources, method)
    both = here.mask & there.mask & (here.mesh_id == there.mesh_id)
    assert both.sum() >= here.mask.sum() - 3
    error = np.abs(here.visibility - there.visibility)[:, both]
    if bound == 0:
        assert error.max() == 0
    # Rounded otherwise, single pixels at an edge of a hard shadow or of a face may differ.
    assert (error > bound).sum() <= 6


soups = st.integers(0, 2**32 - 1)


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(seed=soups, count=st.integers(1, 30), grid=st.booleans(), kind=st.sampled_from([*lights()]))
def test_random_triangles_give_numbers_from_0_to_1(seed, count, grid, kind):
    rng = np.random.default_rng(seed)
    # Few vertices, so that triangles share edges, repeat and degenerate.
    vertices = rng.uniform((-1, -1, 0), (1, 1, 2.2), (3 + count, 3))
    if grid:
        vertices = np.round(vertices * 4) / 4
    faces = rng.integers(len(vertices), size=(count, 3))
    camera = ss.Camera((0.3, -2.4, 1.9), (0, 0.1, 0.15), fov_y_deg=50, width=24, height=24)
    try:
        scene = over_ground((vertices, faces))
    except ss.SceneError:
        return
    light = lights(0.4)[kind]
    for method in EVERY:
        values = ss.render(scene, camera, light, method).visibility
        assert np.isfinite(values).all()
        assert ((values >= 0) & (values <= 1)).all()
    corners = vertices[faces] - light.center
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    heights, sizes = (corners[:, 0] * normals).sum(axis=1), np.linalg.norm(normals, axis=1)
    if (np.abs(heights) <= 1e-8 * sizes)[sizes > 0].any():
        return  # "zfail" is wrong about a face in whose plane the light's centre lies: their pages
    ends = [
        ss.render(scene, camera, light, m(counting=c)).visibility
        for m in (ss.ShadowVolume, ss.Wedges)
        for c in ("zpass", "zfail")
    ]
    assert np.array_equal(ends[0], ends[1])
    assert np.array_equal(ends[2], ends[3])
