"""Everything crosses a process boundary and can be copied, and makes the same bits afterwards."""

from __future__ import annotations

import concurrent.futures
import copy
import dataclasses
import functools
import multiprocessing
import pickle

import numpy as np
import pytest
import softshadow as ss
from shapes import bumpy, quad

LIGHTS = [
    ss.RectLight((0, 0, 4), (0, 0.5, 0), (0.5, 0, 0), radiance=(1, 2, 3)),
    ss.DiskLight((0, 0, 4), (0, 0.1, -1), 0.3),
    ss.SphereLight((0.5, 0, 4), 0.3, 2.0),
    ss.DistantLight((0.5, 0, -1), 2, (1, 2, 3)),
]
CAMERA = ss.Camera((0, -4, 3), (0, 0, 0.3), width=32, height=24)
MOVED = np.array([[1, 0, 0, 0.4], [0, 0, -1, 0.2], [0, 1, 0, 0.9], [0, 0, 0, 1.0]])
ERRORS = (ss.SceneError, ss.ParameterError, ss.OutOfMemoryError, ss.UnsupportedError)
METHODS = [
    *(
        type(ss.prepare(ss.scenes.half_plane(8, 8).scene, LIGHTS[0], n).method)()
        for n in ss.method_names()
    ),
    ss.RayTraced(samples=16, seed=3),
    ss.Wedges(falloff="smooth", vertex_angle=45.0),
    ss.Accumulation(samples=8, max_size=32, opacity="opaque"),
]


def _scene(spheres=True):
    """Every kind of entry, changed in every way since it was added."""
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), "ground")
    vertices, faces = bumpy(8)
    scene.add((vertices * 0.3, faces), "ball", albedo=(0.2, 0.4, 0.6))
    scene.set_vertices("ball", vertices * 0.4)
    scene.set_transform("ball", MOVED)
    scene.add_curves([(0, 1, 0), (0, 1, 1), (0.1, 1, 1.5)], [0, 3], 0.05, name="hair", sides=5)
    scene.set_look("hair", albedo=0.3)
    if spheres:
        scene.add_spheres([(1.0, 0, 0.5), (-1.0, 0, 0.5)], [0.3, 0.4], "balls")
        scene.set_spheres("balls", [(1.0, 0.2, 0.5)], 0.3)
    scene.add(quad((0, 0, 1), (1, 0, 0), (0, 1, 0)), "gone")
    scene.remove("gone")
    return scene


def _arrays(thing):
    """All arrays that something is made of, or makes."""
    if isinstance(thing, ss.Scene):
        return [*_arrays(ss.render(thing, CAMERA, LIGHTS, "hard")), thing.bounds]
    if isinstance(thing, ss.Prepared):
        points, normals = np.tile([[0.3, 0, 0.0]], (9, 1)), np.tile([[0, 0, 1.0]], (9, 1))
        seen = [thing.visibility(points, normals)] if thing.method.points else []
        return [*_arrays(thing.render(CAMERA)), *seen]
    if isinstance(thing, ss.Comparison):
        table = thing.table.drop(columns=["prepare_seconds", "frame_seconds"])
        images = [*thing.images.values(), thing.reference]
        return [table.to_numpy().astype(str), *(a for image in images for a in _arrays(image))]
    if isinstance(thing, (ss.Bake, list)):
        return [a for item in thing for a in _arrays(item)]
    if isinstance(thing, ss.scenes.Setup):
        return [*_arrays(thing.scene), thing.visibility(np.ones((3, 3)))]
    if isinstance(thing, ss.Camera):
        return [thing.rays(), thing.K]
    values = [getattr(thing, f.name) for f in dataclasses.fields(thing)]
    nested = [v for v in values if dataclasses.is_dataclass(v)]
    arrays = [v for v in values if isinstance(v, np.ndarray)]
    return arrays + [a for item in nested for a in _arrays(item)]


@functools.cache
def _things():
    scene, solid = _scene(), _scene(spheres=False)
    ground = ss.Scene()
    ground.add(quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), "ground")
    ground.add(quad((0, 0, 1), (1, 0, 0), (0, 1, 0)), "board")
    refined = ss.bake(ground, LIGHTS, "ground", ss.Accumulation(samples=4, max_size=32))
    refined.refine()
    uv = {"board": [(0, 0), (0.5, 0), (0.5, 1), (0, 1)]}
    return {
        "scene": scene,
        "mesh": scene["ball"],
        "curves": scene["hair"],
        "spheres": scene["balls"],
        "camera": CAMERA,
        "prepared": ss.prepare(scene, LIGHTS, ss.RayTraced(samples=16)),
        "prepared for one light": ss.prepare(solid, LIGHTS[0], ss.Wedges()),
        "image": ss.render(scene, CAMERA, LIGHTS[0], "hard"),
        "comparison": ss.compare(solid, CAMERA, LIGHTS[0], ["hard", "ssoc"], "hard", repeats=1),
        "bake": ss.bake(ground, LIGHTS[0], method=ss.Accumulation(samples=4, max_size=32)),
        "refined bake": refined,
        "bake at points": ss.bake(ground, LIGHTS[0], "ground", ss.RayTraced(4), max_size=16),
        "bake with uv": ss.bake(ground, LIGHTS[0], "board", "hard", uv=uv, size=16),
        "setup": ss.scenes.half_plane(16, 16),
        "sheets": ss.scenes.tilted_sheet(16, 16),
        "wedges": ss.kernels.wedges(solid, LIGHTS[0]),
        "ssoc maps": ss.kernels.ssoc_maps(solid, LIGHTS[0], ss.Ssoc(32)),
        "layered maps": ss.kernels.layered_maps(solid, LIGHTS[0], ss.Mtsm(32)),
        "ray offset": ss.mitsuba.ray_offset(
            ground, ss.render(ground, CAMERA, LIGHTS[0], "hard"), LIGHTS[0], 4
        ),
    }


NAMES = [
    *("scene", "mesh", "curves", "spheres", "camera", "prepared", "prepared for one light"),
    *("image", "comparison", "bake", "refined bake", "bake at points", "bake with uv", "setup"),
    *("sheets", "wedges", "ssoc maps", "layered maps", "ray offset"),
]
LISTS = ("ssoc maps", "layered maps")


def test_all_things_have_a_name():
    assert list(_things()) == NAMES


def _equal(one, other):
    assert type(one) is type(other)
    here, there = _arrays(one), _arrays(other)
    assert len(here) == len(there)
    for a, b in zip(here, there, strict=True):
        assert a.dtype == b.dtype
        assert np.array_equal(a, b)


@pytest.mark.parametrize("name", NAMES)
def test_copies_have_the_same_bits(name):
    thing = _things()[name]
    for other in (
        pickle.loads(pickle.dumps(thing)),
        pickle.loads(pickle.dumps(thing, protocol=2)),
        copy.deepcopy(thing),
        copy.copy(thing),
    ):
        _equal(thing, other)


def _there(things):
    """What another process makes of things, and the things again."""
    return [(_arrays(thing), thing) for thing in things]


def _raise(kind):
    raise kind(f"of {kind.__name__}")


@pytest.fixture(scope="module")
def pool():
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=context) as executor:
        yield executor


def test_a_spawned_process_makes_the_same_bits_and_sends_them_back(pool):
    things = list(_things().values())
    for thing, (arrays, back) in zip(things, pool.submit(_there, things).result(120), strict=True):
        for a, b in zip(_arrays(thing), arrays, strict=True):
            assert np.array_equal(a, b)
        _equal(thing, back)


@pytest.mark.parametrize("kind", ERRORS)
def test_errors_cross_a_process_boundary(kind, pool):
    with pytest.raises(kind, match=f"^of {kind.__name__}$") as caught:
        pool.submit(_raise, kind).result(120)
    assert type(caught.value) is kind
    for other in (pickle.loads(pickle.dumps(kind("a", 2))), copy.deepcopy(kind("a", 2))):
        assert type(other) is kind
        assert other.args == ("a", 2)
    assert kind is getattr(ss, kind.__name__)
    assert kind.__module__ == "softshadow"


@pytest.mark.parametrize("kind", [ss.UnsupportedError, ss.ParameterError, ss.SceneError])
def test_the_cores_own_errors_cross_it_too(kind, pool):
    with pytest.raises(kind) as caught:
        pool.submit(_fail, kind.__name__).result(120)
    assert type(caught.value) is kind


def _fail(kind):
    if kind == "UnsupportedError":
        ss.render(ss.scenes.tilted_sheet(8, 8).scene, CAMERA, LIGHTS[0], "wedges")
    elif kind == "ParameterError":
        ss.Camera((0, 0, 0), (1, 0, 0), width=0)
    else:
        ss.render(ss.Scene(), CAMERA, LIGHTS[0])


def _values():
    """Value types: what was made alike is equal, has one hash, and is one key."""
    for make in (
        lambda: ss.RectLight((0, 0, 4), (0, 0.5, 0), (0.5, 0, 0), 2),
        lambda: ss.DiskLight((0, 0, 4), (0, 0, -1), 0.5),
        lambda: ss.SphereLight((0, 0, 4), 0.5),
        lambda: ss.Camera((0, -4, 3), (0, 0, 0.3), width=32, height=24),
        lambda: ss.Camera.from_matrix(np.diag([9.0, 9, 1]), np.eye(4), 8, 8),
    ):
        yield make(), make()
    for method in METHODS:
        yield method, dataclasses.replace(method)


def test_values_are_equal_by_what_they_hold():
    pairs = list(_values())
    for one, other in pairs:
        assert one == other
        assert hash(one) == hash(other)
        assert {one: "found"}[other] == "found"
        again = pickle.loads(pickle.dumps(one))
        assert again == one
        assert hash(again) == hash(one)
    firsts = [one for one, _ in pairs]
    for i, one in enumerate(firsts):
        assert [other == one for other in firsts] == [i == k for k in range(len(firsts))]
        assert one != "text"


def test_cameras_differ_by_every_part():
    changes = [{"eye": (0, -4, 3.1)}, {"target": (0, 0, 0)}, {"fov_y_deg": 44}, {"width": 33}]
    given = {"eye": (0, -4, 3), "target": (0, 0, 0.3), "width": 32, "height": 24}
    cameras = [ss.Camera(**given), *(ss.Camera(**{**given, **change}) for change in changes)]
    assert len(set(cameras)) == len(cameras)
    zero = np.eye(4)
    negative = np.where(zero == 0, -0.0, zero)
    both = [ss.Camera.from_matrix(np.diag([9.0, 9, 1]), m, 8, 8) for m in (zero, negative)]
    assert both[0] == both[1]
    assert hash(both[0]) == hash(both[1])


@pytest.mark.parametrize("name", [n for n in NAMES if n not in ("camera", *LISTS)])
def test_what_holds_arrays_equals_itself_only(name):
    thing = _things()[name]
    other = pickle.loads(pickle.dumps(thing))
    assert thing == thing
    assert thing != other
    assert len({thing, other}) == 2


def test_entries_cannot_be_changed_on_the_other_side():
    scene = _scene()
    for name in scene:
        entry = scene[name]
        for other in (
            pickle.loads(pickle.dumps(entry)),
            pickle.loads(pickle.dumps(scene))[name],
            copy.deepcopy(entry),
            copy.copy(entry),
            scene.copy()[name],
        ):
            assert type(other) is type(entry)
            for field in dataclasses.fields(other):
                value = getattr(other, field.name)
                if isinstance(value, np.ndarray):
                    assert np.array_equal(value, getattr(entry, field.name))
                    with pytest.raises(ValueError, match="read-only"):
                        value[...] = 0
                    with pytest.raises(ValueError, match="WRITEABLE"):
                        value.flags.writeable = True
                with pytest.raises(dataclasses.FrozenInstanceError):
                    setattr(other, field.name, value)


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, ss.Scene.copy])
def test_copies_of_a_scene_share_nothing_that_can_change(duplicate):
    scene = _scene()
    before = _arrays(scene)
    other = duplicate(scene)
    other.set_look("ground", albedo=0.1)
    other.set_transform("ball", np.eye(4))
    other.set_spheres("balls", [(0.0, 0, 0.5)], 0.2)
    other.remove("hair")
    other.add(quad((0, 0, 2), (1, 0, 0), (0, 1, 0)))
    for a, b in zip(before, _arrays(scene), strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, lambda b: pickle.loads(pickle.dumps(b))]
)
def test_copies_of_a_bake_are_refined_by_themselves(duplicate):
    bake = _things()["bake"]
    first = _arrays(bake)
    other = duplicate(bake)
    assert (other.samples, other.method) == (4, bake.method)
    other.refine(16)
    assert (other.samples, bake.samples) == (16, 4)
    for a, b in zip(first, _arrays(bake), strict=True):
        assert np.array_equal(a, b)
    again = duplicate(other)
    assert again.samples == 16
    assert again.method == bake.method
    for a, b in zip(_arrays(other), _arrays(again), strict=True):
        assert np.array_equal(a, b)


def test_figures_can_be_pickled():
    figure = ss.plot.show(_things()["image"])
    assert pickle.loads(pickle.dumps(figure))._repr_png_()[:4] == b"\x89PNG"
