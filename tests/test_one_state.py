"""What can be changed changes `render`, `copy`, `compare` and `bounds` alike, or raises."""

from __future__ import annotations

import copy
import dataclasses
import pickle

import numpy as np
import pytest
import softshadow as ss
from shapes import quad

LIGHT = ss.RectLight((0, 0, 4), (0, 0.5, 0), (0.5, 0, 0))
CAMERA = ss.Camera((0, -4, 3), (0, 0, 0.3), width=24, height=16)
TRIANGLES = np.array([(-0.5, -0.5, 1), (0.5, -0.5, 1), (0.5, 0.5, 1), (-0.5, 0.5, 1.0)])
FACES = np.array([(0, 1, 2), (0, 2, 3)])
CENTERS, RADII = np.array([(1.0, 0, 0.5), (-1.0, 0, 0.5)]), np.array([0.3, 0.4])
STRANDS, OFFSETS = np.array([(0, 1, 0), (0, 1, 1), (0.1, 1, 1.5)]), np.array([0, 3])
MOVED = np.array([[1, 0, 0, 0.4], [0, 1, 0, 0.2], [0, 0, 1, 0.5], [0, 0, 0, 1.0]])


def _scene():
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), "ground")
    scene.add((TRIANGLES.copy(), FACES.copy()), "board")
    scene.add_spheres(CENTERS.copy(), RADII.copy(), "balls")
    scene.add_curves(STRANDS.copy(), OFFSETS.copy(), 0.05, name="hair")
    return scene


def _pictures(scene):
    """The picture by every way to it; all the same."""
    light = LIGHT
    images = {
        "render": ss.render(scene, CAMERA, light, "hard"),
        "copy": ss.render(scene.copy(), CAMERA, light, "hard"),
        "compare": ss.compare(scene, CAMERA, light, ["hard"], "hard", repeats=1).images["hard"],
        "pickle": ss.render(pickle.loads(pickle.dumps(scene)), CAMERA, light, "hard"),
        "deepcopy": ss.render(copy.deepcopy(scene), CAMERA, light, "hard"),
        "copy.copy": ss.render(copy.copy(scene), CAMERA, light, "hard"),
    }
    first = images["render"]
    for way, image in images.items():
        for name in ("visibility", "radiance", "depth", "mesh_id", "triangle_id"):
            assert np.array_equal(getattr(image, name), getattr(first, name)), (way, name)
    if "ground" not in scene:
        return first
    # All that is seen lies within the bounds, and what bounds them is there.
    low, high = scene.bounds
    seen = first.position[first.mask]
    slack = 1e-6 * (high - low).max()
    assert (seen >= low - slack).all()
    assert (seen <= high + slack).all()
    return first


def test_callers_arrays_are_copied_at_the_door():
    vertices, faces, matrix = TRIANGLES.copy(), FACES.copy(), MOVED.copy()
    centers, radii = CENTERS.copy(), RADII.copy()
    points, offsets, widths = STRANDS.copy(), OFFSETS.copy(), np.array([0.05])
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), "ground")
    scene.add((vertices, faces), "board", transform=matrix)
    scene.add_spheres(centers, radii, "balls")
    scene.add_curves(points, offsets, widths, name="hair")
    before, bounds = _pictures(scene), scene.bounds
    for array in (vertices, matrix, centers, radii, points, widths):
        array += 0.5
    faces[:], offsets[:] = 0, 7
    assert np.array_equal(scene.bounds, bounds)
    assert np.array_equal(_pictures(scene).radiance, before.radiance)
    vertices, matrix = TRIANGLES + 0.25, MOVED.copy()
    centers, points = CENTERS + 0.1, STRANDS + 0.1
    scene.set_vertices("board", vertices)
    scene.set_transform("board", matrix)
    scene.set_spheres("balls", centers, radii)
    scene.set_vertices("hair", points)
    before, bounds = _pictures(scene), scene.bounds
    for array in (vertices, matrix, centers, radii, points):
        array += 0.5
    assert np.array_equal(scene.bounds, bounds)
    assert np.array_equal(_pictures(scene).radiance, before.radiance)


def _arrays(thing):
    return [
        getattr(thing, f.name)
        for f in dataclasses.fields(thing)
        if isinstance(getattr(thing, f.name), np.ndarray)
    ]


def test_entries_cannot_be_changed():
    scene = _scene()
    for entry in (*scene.entries, scene["balls"], *scene.meshes):
        for field in dataclasses.fields(entry):
            with pytest.raises(dataclasses.FrozenInstanceError):
                setattr(entry, field.name, getattr(entry, field.name))
        for array in _arrays(entry):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0
            with pytest.raises(ValueError, match="WRITEABLE"):
                array.setflags(write=True)
            with pytest.raises(ValueError, match="read-only"):
                array += 1
    with pytest.raises(TypeError):
        scene.entries[0] = scene.entries[1]
    with pytest.raises(AttributeError):
        scene.entries = ()
    with pytest.raises(AttributeError):
        scene.names = ()


def test_cameras_cannot_be_changed():
    before = CAMERA.K.copy(), CAMERA.camera_to_world.copy()
    for name in ("width", "height", "K", "camera_to_world", "eye", "fov_y_deg", "heigth"):
        with pytest.raises(AttributeError):
            setattr(CAMERA, name, 10)
    for array in (CAMERA.K, CAMERA.camera_to_world):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 5
    CAMERA.eye[:] = 0  # a copy
    assert np.array_equal(CAMERA.K, before[0])
    assert np.array_equal(CAMERA.camera_to_world, before[1])
    K, pose = before
    made = ss.Camera.from_matrix(K, pose, 24, 16)
    K[0, 0], pose[0, 3] = 1, 1
    assert np.array_equal(made.K, CAMERA.K)
    assert np.array_equal(made.eye, CAMERA.eye)
    for other in (pickle.loads(pickle.dumps(CAMERA)), copy.deepcopy(CAMERA), copy.copy(CAMERA)):
        assert np.array_equal(other.rays(), CAMERA.rays())


@pytest.mark.parametrize(
    "make",
    [
        lambda a, b: ss.RectLight(a, (0, 0.5, 0), (0.5, 0, 0), b),
        lambda a, b: ss.DiskLight(a, (0, 0, -1), 0.5, b),
        lambda a, b: ss.SphereLight(a, 0.5, b),
    ],
)
def test_lights_cannot_be_changed(make):
    center, colour = np.array([0, 0, 4.0]), np.array([1, 2, 3.0])
    light = make(center, colour)
    center[0] = colour[0] = 9
    assert light.center == (0, 0, 4)
    assert light.radiance == (1, 2, 3)
    with pytest.raises(TypeError):
        light.center[0] = 5
    with pytest.raises(dataclasses.FrozenInstanceError):
        light.radiance = 2
    for other in (pickle.loads(pickle.dumps(light)), copy.deepcopy(light)):
        assert other == light
        pictures = [ss.render(_scene(), CAMERA, x, "hard").radiance for x in (light, other)]
        assert np.array_equal(*pictures)


@pytest.mark.parametrize("name", ss.method_names())
def test_methods_cannot_be_changed(name):
    method = getattr(ss, type(ss.prepare(_ground(), LIGHT, name).method).__name__)()
    for field in dataclasses.fields(method):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(method, field.name, 1)
    assert pickle.loads(pickle.dumps(method)) == method
    assert copy.deepcopy(method) == method


def _ground():
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), "ground")
    scene.add((TRIANGLES, FACES), "board")
    return scene


def test_setters_change_every_way_to_the_picture():
    def fresh(**changes):
        scene = ss.Scene()
        scene.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), "ground", **changes.get("ground", {}))
        scene.add((TRIANGLES, FACES), "board", **changes.get("board", {}))
        balls = {"centers": CENTERS, "radii": RADII, **changes.get("balls", {})}
        scene.add_spheres(**balls, name="balls")
        scene.add_curves(STRANDS, OFFSETS, 0.2, name="hair", **changes.get("hair", {}))
        return scene

    steps = [
        (
            lambda s: s.set_look("board", albedo=(0.1, 0.2, 0.3)),
            {"board": {"albedo": (0.1, 0.2, 0.3)}},
        ),
        (lambda s: s.set_look("board", opacity=0.25), {"board": {"opacity": 0.25}}),
        (lambda s: s.set_look("board", casts=False), {"board": {"casts": False}}),
        (lambda s: s.set_look("ground", receives=False), {"ground": {"receives": False}}),
        (lambda s: s.set_look("hair", albedo=0.1), {"hair": {"albedo": 0.1}}),
        (lambda s: s.set_look("balls", opacity=0.5), {"balls": {"opacity": 0.5}}),
        (lambda s: s.set_transform("board", MOVED), {"board": {"transform": MOVED}}),
        (
            lambda s: s.set_spheres("balls", CENTERS[:1] + 0.3, 0.2),
            {"balls": {"centers": CENTERS[:1] + 0.3, "radii": 0.2}},
        ),
        (lambda s: s.set_spheres("balls", CENTERS + 0.3), {"balls": {"centers": CENTERS + 0.3}}),
    ]
    original = _pictures(fresh())
    for change, expected in steps:
        scene = fresh()
        ss.render(scene, CAMERA, LIGHT, "hard")  # so that something is kept
        change(scene)
        picture, wanted = _pictures(scene), _pictures(fresh(**expected))
        assert np.array_equal(picture.radiance, wanted.radiance)
        assert np.array_equal(picture.visibility, wanted.visibility)
        assert not np.array_equal(picture.radiance, original.radiance)
        change(scene)  # once more, nothing happens
        assert np.array_equal(_pictures(scene).radiance, wanted.radiance)


def test_looks_change_one_after_the_other():
    """Of what is kept, nothing is kept that has changed since."""
    scene, steps = (
        _ground(),
        [
            {"albedo": 0.5},
            {"casts": False},
            {"albedo": 0.2},
            {"casts": True, "opacity": 0.5},
            {"receives": False},
            {"opacity": 1.0},
            {"opacity": 0.0},
            {"opacity": 0.75},
        ],
    )
    look = {"albedo": 0.8, "opacity": 1.0, "casts": True, "receives": True}
    for step in steps:
        look |= step
        scene.set_look("board", **step)
        other = ss.Scene()
        other.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), "ground")
        other.add((TRIANGLES, FACES), "board", **look)
        for method in ("hard", ss.RayTraced(16), ss.Mtsm(resolution=64, samples=16)):
            images = [ss.render(s, CAMERA, LIGHT, method) for s in (scene, other)]
            assert np.array_equal(images[0].radiance, images[1].radiance), (step, method)
            assert np.array_equal(images[0].visibility, images[1].visibility), (step, method)


def test_entries_can_be_removed():
    scene = _scene()
    _pictures(scene)
    scene.remove("board")
    assert scene.names == ("ground", "balls", "hair")
    assert "board" not in scene
    assert list(scene) == ["ground", "balls", "hair"]
    image = _pictures(scene)
    assert set(np.unique(image.mesh_id)) <= {-1, 0, 1, 2}
    scene.add((TRIANGLES, FACES), "board")
    assert scene.names[-1] == "board"
    for name in scene.names:
        scene.remove(name)
    with pytest.raises(ValueError, match="no meshes"):
        ss.render(scene, CAMERA, LIGHT)


def test_a_change_that_fails_changes_nothing():
    scene = _scene()
    before = _pictures(scene)
    for call in (
        lambda: scene.set_look("board", opacity=2),
        lambda: scene.set_look("board", albedo="red"),
        lambda: scene.set_look("board", casts="no", albedo=0.1),
        lambda: scene.set_look("nobody", albedo=0.1),
        lambda: scene.set_spheres("balls", CENTERS, -1),
        lambda: scene.set_spheres("balls", CENTERS, [1, 2, 3]),
        lambda: scene.set_spheres("board", CENTERS, 1),
        lambda: scene.set_spheres("nobody", CENTERS, 1),
        lambda: scene.remove("nobody"),
        lambda: scene["nobody"],
        lambda: scene.add((TRIANGLES, FACES), "new", transform=np.zeros((4, 4))),
        lambda: scene.add((TRIANGLES, FACES), "new", transform=np.eye(3)),
    ):
        with pytest.raises((ValueError, TypeError)):
            call()
    assert scene.names == ("ground", "board", "balls", "hair")
    assert np.array_equal(_pictures(scene).radiance, before.radiance)


@pytest.mark.parametrize("name", ["hard", "ray_traced", "accumulation"])
def test_what_is_prepared_keeps_the_scene_as_it_was(name):
    scene = _ground()
    prepared = ss.prepare(scene, LIGHT, name)
    before = prepared.render(CAMERA)
    scene.set_look("board", casts=False, albedo=0.1)
    scene.set_transform("board", MOVED)
    scene.remove("ground")
    after = prepared.render(CAMERA)
    assert np.array_equal(before.radiance, after.radiance)
    assert np.array_equal(before.visibility, after.visibility)
    for attribute in ("method", "lights", "seconds"):
        with pytest.raises(AttributeError):
            setattr(prepared, attribute, None)
    assert isinstance(prepared.lights, tuple)


@pytest.mark.parametrize("method", ["accumulation", ss.RayTraced(4)])
def test_a_bake_keeps_the_scene_as_it_was(method):
    scenes = _ground(), _ground()
    bakes = [ss.bake(s, LIGHT, "ground", method, max_size=16) for s in scenes]
    scenes[0].set_look("ground", albedo=0.1)
    scenes[0].remove("board")
    for one, other in zip(*bakes, strict=True):
        assert np.array_equal(one.radiance, other.radiance)
    with pytest.raises(AttributeError):
        bakes[0].method = "hard"
