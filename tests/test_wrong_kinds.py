"""No input is changed silently: what is not of the right kind or in its range is an error.

It says what is wrong, what is allowed and what was given, where the thing is made.
"""

from __future__ import annotations

import dataclasses
import fractions
import re

import numpy as np
import pytest
import softshadow as ss
from small_methods import methods
from softshadow.methods import resolve

NAN, INF = float("nan"), float("inf")
V = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1.0)])
F = np.array([(0, 1, 2), (0, 1, 3)])
ABOVE = V + np.array([0, 0, 9])
LIGHT = ss.SphereLight((0, 0, 5), 0.5)
CAMERA = ss.Camera((0, -4, 2), (0, 0, 0), width=16, height=12)


def _scene():
    scene = ss.Scene()
    scene.add((V, F), "m")
    scene.add_spheres([(2, 0, 0), (3, 0, 0)], 0.3, "s")
    return scene


def _mesh():
    scene = _scene()
    scene.remove("s")
    return scene


def _hidden(array):
    """The array with its last value masked."""
    mask = np.zeros(np.shape(array), dtype=bool)
    mask.flat[-1] = True
    return np.ma.array(array, mask=mask)


WRONG_ARRAYS = {
    "masked": _hidden,
    "masked rows": lambda a: [_hidden(row) for row in a] if np.ndim(a) > 1 else _hidden(a),
    "complex": lambda a: np.asarray(a) + 0j,
    "imaginary": lambda a: np.asarray(a) + 1j,
    "text": lambda a: np.asarray(a, dtype=float).astype(str),
    "flags": lambda a: np.asarray(a) > 0,
    "objects": lambda a: np.array([str(x) for x in np.ravel(a)], dtype=object).reshape(np.shape(a)),
    "none": lambda a: np.full(np.shape(a), None),
    "dates": lambda a: np.asarray(a, dtype=float).astype("m8[s]"),
    "ragged": lambda a: [*np.asarray(a).tolist(), [1, 2, 3, 4, 5, 6]],
    "a word": lambda a: "red",
    "a dict": lambda a: {"x": a},
    "a generator": lambda a: (x for x in a),
}

UP = np.tile([[0, 0, 1.0]], (4, 1))
ARRAYS = {
    "vertices": (V, lambda a: ss.Scene().add((a, F))),
    "transform": (np.eye(4), lambda a: _scene().set_transform("m", a)),
    "transform, added": (np.eye(4), lambda a: _scene().add((V, F), transform=a)),
    "new vertices": (V, lambda a: _scene().set_vertices("m", a)),
    "centers": (V, lambda a: ss.Scene().add_spheres(a, 1)),
    "radii": (np.ones(4), lambda a: ss.Scene().add_spheres(V, a)),
    "new centers": (V[:2], lambda a: _scene().set_spheres("s", a)),
    "new radii": (np.ones(2), lambda a: _scene().set_spheres("s", V[:2], a)),
    "points": (V, lambda a: ss.Scene().add_curves(a, [0, 4], 0.1)),
    "radii, curves": (np.ones(4), lambda a: ss.Scene().add_curves(V, [0, 4], a)),
    "albedo": (np.ones(3), lambda a: ss.Scene().add((V, F), albedo=a)),
    "albedo, look": (np.ones(3), lambda a: _scene().set_look("s", albedo=a)),
    "RectLight.center": (V[1], lambda a: ss.RectLight(a, V[1], V[2])),
    "RectLight.edge_u": (V[1], lambda a: ss.RectLight(V[0], a, V[2])),
    "RectLight.edge_v": (V[2], lambda a: ss.RectLight(V[0], V[1], a)),
    "DiskLight.normal": (V[1], lambda a: ss.DiskLight(V[0], a, 1)),
    "SphereLight.center": (V[1], lambda a: ss.SphereLight(a, 1)),
    "SphereLight.radiance": (np.ones(3), lambda a: ss.SphereLight(V[1], 1, a)),
    "Camera.eye": (V[1], lambda a: ss.Camera(a, (9, 9, 9))),
    "Camera.target": (V[1], lambda a: ss.Camera((9, 9, 9), a)),
    "Camera.up": (V[1], lambda a: ss.Camera((9, 9, 9), (0, 0, 0), a)),
    "Camera.K": (np.eye(3), lambda a: ss.Camera.from_matrix(a, np.eye(4), 4, 4)),
    "Camera.camera_to_world": (np.eye(4), lambda a: ss.Camera.from_matrix(np.eye(3), a, 4, 4)),
    "points, visibility": (V, lambda a: ss.visibility(_scene(), a, None, LIGHT, "hard")),
    "normals": (UP, lambda a: ss.visibility(_scene(), V, a, LIGHT, "hard")),
    "vertices, kernel": (V, lambda a: ss.kernels.mesh_edges(a, F)),
    "viewpoint": (V[3], lambda a: ss.kernels.silhouette_edges(V, F, a)),
    "origins": (V, lambda a: ss.kernels.transmittance(_scene(), a, V + 1)),
    "targets": (V, lambda a: ss.kernels.transmittance(_scene(), V + 1, a)),
    "points, kernel": (V, lambda a: ss.kernels.unshadowed_irradiance(LIGHT, a, UP)),
    "normals, kernel": (UP, lambda a: ss.kernels.light_fraction_above(LIGHT, V, a)),
    "point": (V[1], lambda a: ss.kernels.light_samples(LIGHT, a)),
    "tau": (V[1], ss.kernels.attenuation),
    "corner": (V[0], lambda a: ss.kernels.receiver_transform((0, 0, 9), a, V[1], V[2])),
    "light_points": (
        ABOVE,
        lambda a: ss.kernels.accumulate(V, F, a, V[0], V[1], V[2], (4, 4)),
    ),
    "colours": (
        np.ones(4),
        lambda a: ss.kernels.accumulate(V, F, ABOVE, V[0], V[1], V[2], (4, 4), a),
    ),
    "visibility, kernel": (
        np.ones((4, 4)),
        lambda a: ss.kernels.convolve_shadow(a, LIGHT, V[0], V[1], V[2], 0.5),
    ),
    "uv": (
        np.full((4, 2), 0.5) * V[:, :2],
        lambda a: ss.bake(_scene(), LIGHT, "m", "hard", uv={"m": a}, size=8),
    ),
    "radiance": (np.ones((4, 4, 3)), ss.images.to_srgb),
}


@pytest.mark.parametrize("kind", WRONG_ARRAYS)
@pytest.mark.parametrize("what", ARRAYS)
def test_arrays_of_the_wrong_kind_are_errors_that_say_for_what(what, kind):
    good, call = ARRAYS[what]
    call(good)
    bad = WRONG_ARRAYS[kind](good)
    with pytest.raises((TypeError, ValueError), match="expected") as error:
        call(bad)
    message = str(error.value)
    word = what.partition(",")[0].rpartition(" ")[2]
    assert word in message or (word == "vertices" and "points" in message), message
    if kind != "ragged":
        assert isinstance(error.value, TypeError), message


@pytest.mark.parametrize(
    "same",
    [
        lambda a: a.tolist(),
        lambda a: np.ma.array(a),  # nothing is hidden
        lambda a: a.astype(np.float32),
        lambda a: a.astype(np.longdouble),
        lambda a: a.astype(">f8"),
        lambda a: a.astype(np.int16),
        np.asfortranarray,
        lambda a: np.repeat(a, 2, axis=0)[::2],
        lambda a: [[fractions.Fraction(x).numerator for x in row] for row in a],
    ],
)
def test_arrays_of_other_kinds_of_numbers_are_the_same_numbers(same):
    scene, other = ss.Scene(), ss.Scene()
    scene.add((V, F))
    other.add((same(V), F))
    images = [ss.render(s, CAMERA, LIGHT, "hard") for s in (scene, other)]
    assert np.array_equal(images[0].depth, images[1].depth)


NO_FLAGS = ["no", "", "True", 0, 1, 1.0, None, NAN, [True], np.array([True])]
NO_NUMBERS = ["0.5", None, True, np.True_, 1j, [0.5], (0.5,), np.array([0.5]), b"1", np.ma.masked]
NO_INTEGERS = [*NO_NUMBERS, 16.5, 16.0, NAN, INF, np.float32(16)]


@pytest.mark.parametrize("value", NO_FLAGS, ids=repr)
@pytest.mark.parametrize("option", ["casts", "receives"])
def test_flags_are_flags(value, option):
    calls = [lambda: ss.Scene().add((V, F), "m", **{option: value})]
    if value is not None:  # leaves what is
        calls.append(lambda: _scene().set_look("m", **{option: value}))
    for call in calls:
        with pytest.raises(TypeError, match=f"{option}: expected True or False, got"):
            call()
    scene = ss.Scene()
    scene.add((V, F), "m", casts=np.False_)
    assert scene["m"].casts is False


@pytest.mark.parametrize("value", NO_NUMBERS, ids=repr)
def test_numbers_are_numbers(value):
    calls = {
        "opacity": lambda: ss.Scene().add((V, F), opacity=value),
        "DiskLight.radius": lambda: ss.DiskLight(V[0], V[1], value),
        "SphereLight.radius": lambda: ss.SphereLight(V[0], value),
        "Camera.fov_y_deg": lambda: ss.Camera((0, 1, 1), V[0], fov_y_deg=value),
        "scale": lambda: ss.kernels.convolve_shadow(
            np.ones((4, 4)), LIGHT, V[0], V[1], V[2], value
        ),
    }
    for what, call in calls.items():
        with pytest.raises(TypeError, match=f"{re.escape(what)}: expected .*, got"):
            call()


@pytest.mark.parametrize("value", NO_INTEGERS, ids=repr)
def test_whole_numbers_are_whole(value):
    calls = {
        "Camera.width": lambda: ss.Camera((0, 1, 1), V[0], width=value),
        "Camera.height": lambda: ss.Camera((0, 1, 1), V[0], height=value),
        "Camera.width ": lambda: ss.Camera.from_matrix(np.eye(3), np.eye(4), value, 4),
        "RayTraced.samples": lambda: ss.RayTraced(samples=value),
        "RayTraced.seed": lambda: ss.kernels.light_samples(LIGHT, V[0], seed=value),
        "curves 'curves': sides": lambda: ss.Scene().add_curves(V, [0, 4], 0.1, sides=value),
        "curves: sides": lambda: ss.kernels.curve_tubes(V, [0, 4], 0.1, value),
        "repeats": lambda: ss.compare(_scene(), CAMERA, LIGHT, ["hard"], repeats=value),
        "padding": lambda: ss.bake(_scene(), LIGHT, "m", "hard", padding=value),
    }
    for what, call in calls.items():
        pattern = f"{re.escape(what.strip())}: expected an integer from [0-9]+ to [0-9]+"
        with pytest.raises(TypeError, match=f"{pattern}.*, got"):
            call()


def test_a_camera_is_as_large_as_its_matrix_says():
    for width in (np.int64(33), np.uint8(33), 33):
        camera = ss.Camera((0, 1, 1), V[0], width=width, height=np.int32(20))
        assert (camera.width, camera.height) == (33, 20)
        assert type(camera.width) is int
        assert camera.K[0, 2] == 16.5


@pytest.mark.parametrize("faces", ["masked", "text", "flags", "complex", "fractions"])
def test_faces_are_integers(faces):
    wrong = {
        "masked": _hidden(F),
        "text": F.astype(str),
        "flags": F > 0,
        "complex": F + 0j,
        "fractions": F + 0.5,
    }[faces]
    for call in (
        lambda: ss.Scene().add((V, wrong)),
        lambda: ss.kernels.mesh_edges(V, wrong),
        lambda: ss.kernels.rasterize(V, wrong, CAMERA),
    ):
        with pytest.raises(TypeError, match="faces: expected integers"):
            call()


@pytest.mark.parametrize("index", [2**63, 2**64 - 1, 2**64, 10**30, -(2**63) - 1])
def test_face_indices_that_do_not_fit_are_told_as_they_are(index):
    lists = [(0, 1, 2), (0, 1, index)]
    arrays = [lists] if not 0 <= index < 2**64 else [lists, np.array(lists, dtype=np.uint64)]
    for faces in arrays:
        for call in (lambda f: ss.Scene().add((V, f)), lambda f: ss.kernels.mesh_edges(V, f)):
            with pytest.raises(ValueError, match=f"faces: row 1 holds {index}, .*0 to 3"):
                call(faces)


def test_names_are_text():
    for name in (5, b"m", ("m",), 1.5, True):
        with pytest.raises(TypeError, match="name: expected text, got"):
            ss.Scene().add((V, F), name)
    for name in (5, None, ["m"]):
        for call in (
            lambda s, n: s[n],
            lambda s, n: s.remove(n),
            lambda s, n: s.set_look(n, albedo=1),
            lambda s, n: s.set_transform(n, np.eye(4)),
        ):
            with pytest.raises(ValueError, match="it has \\['m', 's'\\]"):
                call(_scene(), name)


# ---------------------------------------------------------------- methods

WRONG = [
    *(16.5, NAN, INF, -INF, -1, -0.5, 2**64, -(2**70), 10**400, 1e300, 1e-320),
    *("x", "", b"x", None, True, np.True_, [1], (), {}, 1j, np.ma.masked, np.array([1, 2])),
    *(np.float32(0.3), np.int64(16), np.uint64(2**64 - 1), np.str_("light"), np.array(3)),
]


@pytest.mark.parametrize("name", ss.method_names())
def test_parameters_are_checked_when_a_method_is_made(name):
    """Whatever a method takes, it can be rendered with; whatever it does not take, it says why."""
    kind = type(resolve(name))
    for field in dataclasses.fields(kind):
        for value in WRONG:
            try:
                method = kind(**{field.name: value})
            except (TypeError, ss.ParameterError) as error:
                message = str(error)
                assert kind.__name__ in message
                assert field.name in message
                assert re.search("got|expected", message)
                assert re.search("expected|must", message), message
                with pytest.raises((TypeError, ss.ParameterError)):
                    dataclasses.replace(resolve(name), **{field.name: value})
                continue
            kept = getattr(method, field.name)
            assert type(kept) in (bool, int, float, str, type(None)), (field.name, value)
            assert kept == value, (field.name, value)
            assert not isinstance(value, (bool, np.bool_)) or isinstance(kept, bool)
            if name != "auto":  # which has no kernel
                method._to_core()
            assert hash(method) == hash(dataclasses.replace(method))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ss.Slsm(resolution=7), "Slsm.resolution: expected an integer from 16 to 16384"),
        (lambda: ss.RayTraced(samples=16.5), "RayTraced.samples: .* 1 to 65536, got 16.5"),
        (lambda: ss.RayTraced(seed=-1), f"RayTraced.seed: .* 0 to {2**64 - 1}, got -1"),
        (lambda: ss.RayTraced(seed=2**64), f"RayTraced.seed: .* got {2**64}"),
        (lambda: ss.Scene().add((V, F), "m", "red"), "mesh 'm': albedo: .*3 linear RGB.*'red'"),
        (lambda: ss.Camera((0, 1, 1), V[0], width=NAN), "Camera.width: .* 1 to 65536, got nan"),
        (lambda: ss.Camera((0, 1, 1), V[0], width=32.9), "Camera.width: .*, got 32.9"),
        (
            lambda: ss.Camera.from_matrix(np.eye(3), np.diag([1, 1, -1, 1.0]), 4, 4),
            "Camera: the pose must be a rotation; it is mirrored",
        ),
        (lambda: ss.compare(_scene(), CAMERA, LIGHT, ["hard"], repeats=0), "repeats: .* from 1"),
        (lambda: ss.bake(_scene(), LIGHT, "m", "hard", size=0), "size: .* 1 to 65536, got 0"),
        (lambda: ss.bake(_scene(), LIGHT, "m", "hard", size="8"), "size: .* 1 to 65536 .* got '8'"),
        (lambda: ss.bake(_scene(), LIGHT, "m", "hard", size=(8, 8.5)), "size: .*, got 8.5"),
        (lambda: ss.bake(_scene(), LIGHT, "m", max_size=7.5), "max_size: .* 1 to 8192, got 7.5"),
        (lambda: ss.bake(_mesh(), LIGHT, "m").refine(1e3), "samples: .* 1 to 65536, got 1000.0"),
    ],
)
def test_messages_say_what_is_wrong_where_and_what_is_allowed(make, message):
    with pytest.raises((TypeError, ValueError), match=message):
        make()


# ---------------------------------------------------------------- sizes


@pytest.mark.parametrize("size", [1e300, 1e-320, 1e200, 1e-200, 1e160, 1e-160])
def test_directions_have_any_length(size):
    assert ss.DiskLight((0, 0, 3), (0, 0, -size), 0.5)
    for at in ((0.2, 0, 0), (0.4, 0.3, 0.1)):
        n = np.array([[0.6, 0.0, 0.8]])
        expected = ss.kernels.unshadowed_irradiance(LIGHT, [at], n)
        found = ss.kernels.unshadowed_irradiance(LIGHT, [at], n * size)
        assert np.abs(found / expected - 1).max() < 1e-3  # 1e-320 has three digits
        part = ss.kernels.light_fraction_above(LIGHT, [at], n * size)
        assert part == 1
        seen = ss.visibility(_scene(), [at], n * size, LIGHT, "hard")
        assert np.isfinite(seen).all()
    camera = ss.Camera((0, -4, 2), (0, 0, 0), up=(0, 0, size), width=16, height=12)
    assert np.abs(camera.camera_to_world - CAMERA.camera_to_world).max() < 1e-12
    near = ss.Camera((0, 0, 0), (size, 0, 0), width=16, height=12)
    assert near.camera_to_world[0, 2] == 1


def test_lights_that_are_too_large_or_small_say_so():
    for size in (1e300, 1e-300, 1e151):
        for make, allowed in (
            (lambda s: ss.RectLight((0, 0, 1), (s, 0, 0), (0, 1, 0)), "1e-75 to 1e75"),
            (lambda s: ss.RectLight((0, 0, 1), (1, 0, 0), (0, s, 0)), "1e-75 to 1e75"),
            (lambda s: ss.SphereLight((0, 0, 1), s), "1e-150 to 1e150"),
            (lambda s: ss.DiskLight((0, 0, 1), (0, 0, 1), s), "1e-150 to 1e150"),
        ):
            with pytest.raises(ss.ParameterError, match=allowed):
                make(size)
    with pytest.raises(ss.ParameterError, match="1e-75 to 1e75"):
        ss.RectLight((0, 0, 1), (1e100, 0, 0), (0, 1, 0))
    with pytest.raises(ValueError, match="too far apart"):
        ss.Camera((1e308, 0, 0), (-1e308, 0, 0))


# ---------------------------------------------------------------- single precision

MOST = float(np.finfo(np.float32).max)


@pytest.mark.parametrize("value", [1e39, MOST * (1 + 1e-7), 1e308, 1e-46, 1e-39, 5e-324])
@pytest.mark.parametrize("channel", [None, 0, 1, 2])
def test_what_single_precision_cannot_hold_is_an_error(value, channel):
    rgb = value if channel is None else np.eye(3)[channel] * value
    calls = {
        "RectLight.radiance": lambda: ss.RectLight((0, 0, 1), (1, 0, 0), (0, 1, 0), rgb),
        "DiskLight.radiance": lambda: ss.DiskLight((0, 0, 1), (0, 0, 1), 1, rgb),
        "SphereLight.radiance": lambda: ss.SphereLight((0, 0, 1), 1, rgb),
        "albedo": lambda: ss.Scene().add((V, F), albedo=rgb),
        "albedo ": lambda: ss.Scene().add_spheres(V, 1, albedo=rgb),
        "albedo  ": lambda: _scene().set_look("m", albedo=rgb),
    }
    for what, call in calls.items():
        with pytest.raises(ss.ParameterError, match=f"{what.strip()}: .*single precision"):
            call()


@pytest.mark.parametrize("value", [1.0 + 1e-9, -1e-300, 1 + 1e-16 * 3])
def test_opacities_are_checked_before_they_are_rounded(value):
    for call in (
        lambda: ss.Scene().add((V, F), opacity=value),
        lambda: ss.Scene().add_spheres(V, 1, opacity=value),
        lambda: _scene().set_look("m", opacity=value),
    ):
        with pytest.raises(ValueError, match="opacity must be between 0 and 1"):
            call()


# Radiance is the same arithmetic whatever a map's size.
SMALL = methods(ss.method_names(), resolution=128, max_size=64)


@pytest.mark.parametrize("method", SMALL.values(), ids=SMALL)
def test_radiance_is_finite_up_to_the_largest_and_an_error_beyond(method):
    ground = ss.Scene()
    ground.add(([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], [(0, 1, 2), (0, 2, 3)]), "g")
    ground.add(([(-9, -9, -3), (9, -9, -3), (9, 9, -3)], [(0, 1, 2)]), "below")
    if method.name in ("wedges", "shadow_volume", "ssoc", "convolution"):
        ground.remove("below")
    camera = ss.Camera((0, -3, 2), (0, 0, 0), width=16, height=12)

    def light(radiance):
        return ss.RectLight((0, 0, 0.5), (0, 3, 0), (3, 0, 0), radiance)

    one = ss.render(ground, camera, light(1), method).radiance
    most = ss.render(ground, camera, light(1e38), method).radiance
    assert np.isfinite(most).all()
    assert np.allclose(most / np.float32(1e38), one, rtol=1e-5)
    with pytest.raises(ss.ParameterError, match=r"radiance: at pixel \(.*overflows.*lower"):
        ss.render(ground, camera, [light(3e38)] * 4, method)
    ground.set_look("g", albedo=1e20)
    with pytest.raises(ss.ParameterError, match="radiance: at pixel"):
        ss.render(ground, camera, light((1, 1, 1e30)), method)


def test_baked_radiance_is_finite_or_an_error():
    scene = _mesh()
    scene.set_look("m", albedo=1e20)
    light = ss.RectLight((0.2, 0.2, 3), (0, 3, 0), (3, 0, 0), 1e30)
    for method in ("accumulation", "ray_traced"):
        baked = ss.bake(scene, light, "m", method, max_size=8)
        with pytest.raises(ss.ParameterError, match=r"radiance: .*single precision"):
            [t.radiance for t in baked]
