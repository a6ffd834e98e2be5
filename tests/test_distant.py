"""Lights at infinity: closed forms, limits of the angle, surfaces along them, every method."""

from __future__ import annotations

import functools
import json
import math

import numpy as np
import pytest
import softshadow as ss
import trimesh
from shapes import bumpy, quad
from small_methods import MAP_NAMES, methods
from softshadow.cli import parse_light

NAMES = tuple(name for name in ss.method_names() if name != "auto")
SMALL = methods(NAMES, resolution=256)
ANY_ANGLE = ("hard", "ray_traced", "counted", "single_sample", "accumulation")
DOWN = np.array((-0.5, -0.3, -0.8))
CAMERA = ss.Camera((0.3, -2.2, 1.6), (0, 0, 0.15), width=48, height=48)


def _scene():
    vertices, faces = bumpy(12, seed=2)
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (2, 0, 0), (0, 2, 0)), "ground")
    scene.add(quad((-0.4, 0.1, 0.45), (0.5, 0, 0), (0, 0.8, 0)), "board")
    scene.add((vertices * 0.25 + [0.4, 0, 0.4], faces), "body")
    return scene


def _cap(direction, angle_deg, count=200_000):
    """Return directions towards a light, uniform in solid angle."""
    t = -np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    e = np.cross(t, np.eye(3)[np.argmin(np.abs(t))])
    e /= np.linalg.norm(e)
    i = np.arange(count) + 0.5
    cos = 1 - i / count * (1 - math.cos(math.radians(angle_deg / 2)))
    turn = i * math.pi * (1 + math.sqrt(5))  # of a sunflower
    sin = np.sqrt(1 - cos**2)[:, None]
    return t * cos[:, None] + sin * (
        np.cos(turn)[:, None] * e + np.sin(turn)[:, None] * np.cross(t, e)
    )


def _far_sphere(direction, angle_deg, distance):
    sine = math.sin(math.radians(angle_deg / 2))
    towards = -np.asarray(direction) / np.linalg.norm(direction)
    radiance = 1 / (math.pi * sine**2)
    return ss.SphereLight(towards * distance, distance * sine, radiance)


# ---------------------------------------------------------------- closed forms


@pytest.mark.parametrize("angle", [0.53, 60, 150, 179.999])
def test_what_is_above_a_plane_and_its_irradiance_are_integrals_over_the_cap(angle):
    rng = np.random.default_rng(1)
    light = ss.DistantLight(DOWN, angle)
    directions = _cap(DOWN, angle)
    sine, cosine = (f(math.radians(angle / 2)) for f in (math.sin, math.cos))
    towards = -DOWN / np.linalg.norm(DOWN)
    across = rng.normal(size=(40, 3))
    across -= (across @ towards)[:, None] * towards
    across /= np.linalg.norm(across, axis=1)[:, None]
    # Heights of the middle from under the plane to over it, in sines of the half-angle.
    height = np.linspace(-1.2, 1.2, 40).clip(-1 / sine, 1 / sine) * sine
    normals = height[:, None] * towards + np.sqrt(1 - height**2)[:, None] * across
    points = rng.normal(size=(40, 3)) * 100
    above = (directions @ normals.T).clip(0)
    part = ss.kernels.light_fraction_above(light, points, normals)
    # Of 200,000 directions; measured: 1.1e-4.
    assert part == pytest.approx((above > 0).mean(axis=0), abs=2e-4)
    # Irradiance over that across the direction: the cap's solid angle over π sin².
    irradiance = ss.kernels.unshadowed_irradiance(light, points, normals)
    assert irradiance == pytest.approx(above.mean(axis=0) * 2 / (1 + cosine), abs=1e-4 * sine)


@pytest.mark.parametrize("angle", [0, 1e-9, 0.53, 60, 179.9])
def test_irradiance_is_that_across_the_direction_whatever_the_angle(angle):
    light = ss.DistantLight(DOWN, angle, (3, 2, 1))
    facing = -DOWN / np.linalg.norm(DOWN)
    lit = ss.irradiance(_apart(), [(0, 0, 0), (1e6, 0, -1e3)], [facing] * 2, light, "hard")
    assert lit == pytest.approx(np.array([[3, 2, 1]] * 2), rel=1e-6)


def _apart():
    """A scene that hides nothing of a light from above."""
    scene = ss.Scene()
    scene.add(quad((0, 0, -9), (0.1, 0, 0), (0, 0.1, 0)))
    return scene


@pytest.mark.parametrize("angle", [0, 0.53, 60, 150])
def test_a_half_plane_hides_the_part_of_the_cap_beyond_its_edge(angle):
    # A board over x > 0 at height 1, wide enough for directions 15 degrees over the horizon.
    scene = ss.Scene()
    scene.add(quad((100, 0, 1), (200, 0, 0), (0, 200, 0)))
    light = ss.DistantLight((0, 0, -1), angle)
    reach = 1.1 * math.tan(math.radians(angle / 2)) + 1e-3
    points = np.stack([np.linspace(-reach, reach, 41), np.zeros(41), np.zeros(41)], axis=1)
    # Seen is what passes the edge on the side of negative x.
    edge = np.stack([-np.ones(41), np.zeros(41), -points[:, 0]], axis=1)
    edge /= np.linalg.norm(edge, axis=1)[:, None]
    known = ss.kernels.light_fraction_above(light, points, edge)
    for method, bound in {
        # Measured, at most: 0.0066, 0.0037 and 0.0323; the last at 150 degrees, of wide texels.
        ss.RayTraced(samples=1024): 0.01,
        ss.Counted(samples=1024): 0.005,
        ss.Mtsm(samples=1024, resolution=512): 0.04,
    }.items():
        seen = ss.visibility(scene, points, None, light, method)
        off = np.abs(seen - known)
        # On the edge itself a parallel light is all or nothing.
        assert off[np.abs(points[:, 0]) > 1e-6].max() < bound, method


# ---------------------------------------------------------------- every method


@functools.cache
def _error(name, kind, angle):
    light = ss.DistantLight(DOWN, angle) if kind == "distant" else _far_sphere(DOWN, angle, 1e4)
    reference = ss.render(_scene(), CAMERA, light, ss.RayTraced(samples=1024))
    image = ss.render(_scene(), CAMERA, light, SMALL[name])
    assert np.isfinite(image.radiance).all()
    off = [
        np.abs(a - b)[reference.mask].mean()
        for a, b in (
            (image.visibility, reference.visibility),
            (image.radiance, reference.radiance),
        )
    ]
    assert 0.5 < reference.visibility[reference.mask].mean() < 0.9
    return off


@pytest.mark.parametrize("angle", [0.53, 10, 60])
@pytest.mark.parametrize("name", NAMES)
def test_every_method_has_its_usual_error(name, angle):
    usual, found = (_error(name, kind, angle) for kind in ("sphere", "distant"))
    # Directions differ by 1e-4 across the scene, and texels fall elsewhere. Measured: at most 1.07
    # times, or 0.0001 more.
    assert found[0] < 1.1 * usual[0] + 0.0002
    assert found[1] < 1.1 * usual[1] + 0.0002


@pytest.mark.parametrize("name", NAMES)
def test_a_parallel_light_has_hard_shadows_and_shines(name):
    light = ss.DistantLight(DOWN, 0, 2)
    image = ss.render(_scene(), CAMERA, light, SMALL[name])
    hard = ss.render(_scene(), CAMERA, light, "hard")
    # Measured: none by rays and silhouettes, up to 0.0023 by maps and textures of so few texels.
    off = np.abs(image.visibility - hard.visibility)[hard.mask].mean()
    assert off < (0.005 if name in (*MAP_NAMES, "accumulation", "convolution") else 1e-6)
    assert image.radiance.max() == pytest.approx(hard.radiance.max(), rel=1e-5)
    assert hard.radiance.max() > 0.3


@pytest.mark.parametrize("angle", [0.53, 60])
def test_it_is_the_limit_of_spheres(angle):
    method = ss.RayTraced(samples=256)
    distant = ss.render(_scene(), CAMERA, ss.DistantLight(DOWN, angle), method)
    # Across the scene the direction to a sphere differs by about 1 / distance. Measured: 0.0004 at
    # 1e3, and no other sample from 1e6 on; radiances to 5e-7.
    for distance, bound in ((1e3, 1e-3), (1e6, 0), (1e12, 0), (1e60, 0)):
        sphere = ss.render(_scene(), CAMERA, _far_sphere(DOWN, angle, distance), method)
        off = np.abs(sphere.visibility - distant.visibility)[distant.mask].mean()
        assert off <= bound, distance
        if bound == 0:
            assert np.allclose(sphere.radiance, distant.radiance, rtol=0, atol=2e-6)


def test_light_samples_are_the_same_directions_for_all_receivers():
    light = ss.DistantLight(DOWN, 5, 4)
    found = [ss.kernels.light_samples(light, p, 64) for p in ((0, 0, 0), (0.4, -0.3, 0.2))]
    for points, weights, colours in found:
        # The directions' mean cosine is what makes the irradiance of a surface across them.
        towards = points / np.linalg.norm(points, axis=1)[:, None]
        assert weights.sum() == pytest.approx(2 / (1 + math.cos(math.radians(2.5))), rel=1e-6)
        inside = math.cos(math.radians(2.5))
        assert (towards @ (-DOWN / np.linalg.norm(DOWN)) > inside - 1e-6).all()
        assert np.array_equal(colours, np.full((64, 3), 4, np.float32))
    # A step of single precision where the points are is 2^17 of 2^40: nothing of a receiver shows.
    assert np.allclose(found[0][0], found[1][0], rtol=0, atol=1)


def test_bits_are_those_of_a_moved_scene_and_of_any_number_of_threads():
    light = ss.DistantLight(DOWN, 8)
    for method in ("ray_traced", "counted", "mtsm", "wedges", "accumulation"):
        ways = []
        for threads, scale in ((1, 1.0), (2, 1.0), (2, 1024.0)):
            scene = ss.Scene()
            for entry in _scene().entries:
                scene.add((entry.vertices * scale, entry.faces), entry.name)
            camera = ss.Camera(scale * CAMERA.eye, (0, 0, 0.15 * scale), width=48, height=48)
            with ss.threads(threads):
                ways.append(ss.render(scene, camera, light, SMALL[method]).visibility)
        assert np.array_equal(ways[0], ways[1]), method
        assert np.array_equal(ways[0], ways[2]), method


# ---------------------------------------------------------------- hard cases


def _corner():
    """A ground, and a wall on it in the plane x = 0.1."""
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (2, 0, 0), (0, 2, 0)), "ground")
    scene.add(quad((0.1, 0, 0.4), (0, 1, 0), (0, 0, 0.8)), "wall")
    return scene


@pytest.mark.parametrize("name", NAMES)
def test_a_wall_along_the_direction_sees_half_of_a_sun_and_nothing_of_a_parallel_light(name):
    camera = ss.Camera((1.3, -2.2, 1.6), (0, 0, 0.15), width=48, height=48)
    for angle, seen in ((0.53, 0.5), (0, 0.0)):
        image = ss.render(_corner(), camera, ss.DistantLight((0, 0.5, -0.8), angle), SMALL[name])
        # Its samples differ from one half by their discrepancy: measured 0.016.
        assert image.visibility[image.mesh_id == 1] == pytest.approx(seen, abs=0.03)
        # It casts no more than a line: measured 0.998, of texels around it.
        assert image.visibility[image.mesh_id == 0].mean() > 0.98


@pytest.mark.parametrize("name", NAMES)
def test_a_light_at_the_horizon_and_below_it(name):
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (2, 0, 0), (0, 2, 0)))
    camera = ss.Camera((0, -2.2, 1.6), (0, 0, 0), width=24, height=24)

    def seen(direction, angle):
        image = ss.render(scene, camera, ss.DistantLight(direction, angle), SMALL[name])
        return image.visibility[image.mask]

    down = math.sin(math.radians(0.5 * 0.53))
    # Whichever side of the ground the middle is on by rounding, a shadow volume has the ground
    # itself, as the middle is hidden where the sun sets by half an ulp.
    at_horizon = seen((1, 0, 0), 0.53)
    halves = 0.5 if name != "shadow_volume" else at_horizon.mean().round(1)
    assert halves in (0, 0.5)
    assert at_horizon == pytest.approx(halves, abs=0.03)
    assert not seen((1, 0, 0), 0).any()
    assert not seen((1, 0, 1.001 * down), 0.53).any()
    assert not seen((0, 0, 1), 60).any()
    assert seen((1, 0, -1.001 * down / math.cos(math.asin(down))), 0.53) == pytest.approx(1)


def test_wide_lights_are_refused_where_a_disk_stands_for_them():
    for name in NAMES:
        for angle in (179.0, 179.999999999):
            light = ss.DistantLight((0, 0, -1), angle)
            if name in ANY_ANGLE:
                image = ss.render(_scene(), CAMERA, light, SMALL[name])
                assert image.visibility[image.mask].mean() > 0.3
                continue
            with pytest.raises(ss.UnsupportedError, match="angle_deg of up to 170"):
                ss.render(_scene(), CAMERA, light, SMALL[name])
        ss.render(_scene(), CAMERA, ss.DistantLight((0, 0, -1), 170), SMALL[name])


@pytest.mark.parametrize(
    "args",
    [((0, 0, 0),), ((0, 0, -1), -1), ((0, 0, -1), 180), ((0, 0, -1), 1e-91), ((0, 0, np.nan),)],
    ids=str,
)
def test_what_it_cannot_be_is_refused(args):
    with pytest.raises(ValueError, match="DistantLight"):
        ss.DistantLight(*args)
    with pytest.raises(ss.ParameterError, match=r"DistantLight\.irradiance"):
        ss.DistantLight((0, 0, -1), irradiance=-1)


def test_kernels_that_need_a_place_refuse_it():
    scene, sun = _scene(), ss.DistantLight(DOWN)
    for kernel in (
        ss.kernels.wedges,
        ss.kernels.ssoc_maps,
        ss.kernels.layered_maps,
        lambda scene, light: ss.kernels.light_intensity(scene, CAMERA, light),
    ):
        with pytest.raises(ss.ParameterError, match="a light with a place"):
            kernel(scene, sun)


def test_a_slanting_light_over_a_ground_without_end():
    house = trimesh.creation.box((1, 1, 1))
    house.apply_translation((0, 0, 0.5))
    camera = ss.Camera((2, -5, 4), (0, 0, 0.3), width=32, height=32)
    pictures = []
    for half in (10, 1e7):
        scene = ss.Scene()
        scene.add(house)
        scene.add(ss.scenes.square(half))
        pictures.append(ss.render(scene, camera, ss.DistantLight(DOWN, 5)).visibility)
        if half > 10:
            with pytest.raises(ss.ParameterError, match="slants over a scene"):
                ss.render(scene, camera, ss.DistantLight(DOWN, 5), SMALL["mtsm"])
    # Other samples: measured 0.0006.
    assert np.abs(pictures[0] - pictures[1]).mean() < 0.002


# ---------------------------------------------------------------- written and read


def test_it_is_read_from_the_command_line():
    assert parse_light("distant:1,0,-2:5") == ss.DistantLight((1, 0, -2), 5)
    assert parse_light("distant:1,0,-2") == ss.DistantLight((1, 0, -2))
    for bad in ("distant:1,0", "distant:1,0,-2:", "distant:1,0,-2:x", "distant:1,0,-2:5:6"):
        with pytest.raises(ValueError, match="as in distant:dx,dy,dz:angle"):
            parse_light(bad)


def test_a_directional_light_of_a_gltf_file_is_one(tmp_path):
    path = tmp_path / "sun.gltf"
    header = json.loads(
        trimesh.Scene(trimesh.creation.box()).export(file_type="gltf")["model.gltf"]
    )
    files = trimesh.Scene(trimesh.creation.box()).export(file_type="gltf")
    sun = {"type": "directional", "intensity": 4, "color": [1, 0.5, 0], "name": "sun"}
    turned = [math.sqrt(0.5), 0, 0, math.sqrt(0.5)]  # by 90 degrees about x: -z becomes y
    header["nodes"].append(
        {"rotation": turned, "extensions": {"KHR_lights_punctual": {"light": 0}}}
    )
    header["scenes"][0]["nodes"].append(len(header["nodes"]) - 1)
    for extras, angle in (({}, 0), ({"angle_deg": 2}, 2)):
        lights = [{**sun, "extras": extras}]
        header["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
        for name, data in files.items():
            (tmp_path / name).write_bytes(data)
        path.write_text(json.dumps(header))
        (light,) = ss.load(path).lights
        assert light.direction == pytest.approx((0, 1, 0))
        assert (light.angle_deg, light.irradiance) == (angle, (4, 2, 0))
        # Its irradiance is that of any unit of length.
        (moved,) = ss.load(path, up="y", scale=10).lights
        assert np.divide(moved.direction, 10) == pytest.approx((0, 0, 1))
        assert (moved.angle_deg, moved.irradiance) == (angle, (4, 2, 0))


def test_mitsuba_renders_the_same_and_gives_a_parallel_one_back():
    pytest.importorskip("mitsuba")
    scene = ss.Scene()
    scene.add(ss.scenes.square(3), albedo=0.5)
    scene.add_spheres((0, 0, 1), 0.3)
    camera = ss.Camera((3, -4, 5), (0, 0, 0.5), width=30, height=20)
    for angle in (0, 0.53, 60):
        light = ss.DistantLight((1, 0.5, -2), angle, (3, 2, 1))
        ours = ss.render(scene, camera, light, ss.RayTraced(samples=4096)).radiance
        theirs = ss.mitsuba.render(scene, camera, light, samples=256)
        if angle == 0:  # without noise
            assert np.abs(ours - theirs.radiance).max() < 1e-5
            description = ss.mitsuba.scene_dict(scene, camera, light)
            (back,) = ss.mitsuba.from_dict(description).lights
            assert back.direction == pytest.approx(np.divide(light.direction, np.sqrt(5.25)))
            assert (back.angle_deg, back.irradiance) == (0, (3, 2, 1))
        else:
            assert ss.mitsuba.z_test(ours, theirs).passed, angle
    with pytest.raises(ValueError, match=r"DistantLight\.angle_deg"):
        ss.mitsuba.scene_dict(scene, camera, ss.DistantLight((0, 0, -1), 171))
