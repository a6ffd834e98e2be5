"""Scenes of Mitsuba's: files, dictionaries and loaded scenes as ours, and ours there and back."""

from __future__ import annotations

import os
import struct
import warnings
import zlib

import numpy as np
import pytest
import softshadow as ss
import trimesh
from softshadow import cli
from softshadow.mitsuba import bridge

if not os.environ.get("CI"):
    pytest.importorskip("mitsuba", reason="the optional extra")

import mitsuba as mi

SINGLE = 1e-6
"""Relative, of coordinates: Mitsuba has them in single precision, and computes with them."""

WHITE = (
    '<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="{}"/></bsdf></bsdf>'
)

ROOM = f"""<scene version="3.0.0">
<integrator type="volpath">
  <integer name="max_depth" value="2"/><integer name="rr_depth" value="1000"/>
  <boolean name="hide_emitters" value="true"/>
</integrator>
<sensor type="perspective" id="eye">
  <float name="fov" value="40"/><string name="fov_axis" value="x"/>
  <float name="principal_point_offset_x" value="0.05"/>
  <transform name="to_world">
    <lookat origin="0.3, -4.5, 3" target="0, 0, 0.2" up="0, 0, 1"/>
  </transform>
  <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/></film>
</sensor>
<bsdf type="mask" id="veil">
  <float name="opacity" value="0.4"/>{WHITE.format("0.2, 0.6, 0.9")}
</bsdf>
<shape type="rectangle" id="floor">
  <transform name="to_world"><scale value="3"/></transform>{WHITE.format("0.7, 0.6, 0.5")}
</shape>
<shape type="cube" id="crate">
  <transform name="to_world">
    <scale x="-0.3" y="0.2" z="0.25"/><rotate z="1" angle="30"/>
    <translate x="-0.6" y="0.1" z="0.3"/>
  </transform>{WHITE.format("0.5")}
</shape>
<shape type="ply" id="wedge">
  <string name="filename" value="wedge.ply"/><boolean name="face_normals" value="true"/>
  <transform name="to_world"><scale value="0.7"/><translate x="0.4" y="0.1" z="0.05"/></transform>
  {WHITE.format("0.3, 0.7, 0.3")}
</shape>
<shape type="sphere" id="ball">
  <point name="center" x="0.2" y="-0.6" z="0.35"/><float name="radius" value="0.2"/>
  {WHITE.format("0.8, 0.2, 0.2")}
</shape>
<shape type="disk" id="pane">
  <transform name="to_world"><scale value="0.5"/><translate x="-0.4" y="-0.7" z="0.9"/></transform>
  <ref id="veil"/>
</shape>
<shape type="rectangle" id="ceiling lamp">
  <boolean name="flip_normals" value="true"/>
  <transform name="to_world"><scale x="0.4" y="-0.3"/><translate x="0.7" z="2.5"/></transform>
  <emitter type="area"><rgb name="radiance" value="6, 5, 4"/></emitter>
</shape>
<shape type="disk" id="spot">
  <transform name="to_world"><scale value="0.3"/>
    <lookat origin="-1.5, -0.5, 2.2" target="0, 0, 0" up="0, 1, 0"/></transform>
  <emitter type="area"><rgb name="radiance" value="9, 9, 12"/></emitter>
</shape>
</scene>"""


@pytest.fixture
def room(tmp_path):
    """A scene file: four kinds of shapes, a mask, two area lights, a sensor."""
    mi.set_variant("scalar_rgb")
    wedge = trimesh.Trimesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
                            [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])  # fmt: skip
    wedge.export(tmp_path / "wedge.ply")
    path = tmp_path / "room.xml"
    path.write_text(ROOM)
    return path


def _quiet(load, *arguments, **options):
    """Load where nothing is left out."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        return load(*arguments, **options)


def test_a_scene_file_renders_as_mitsuba_renders_it(room):
    """All of it at once: shapes, places, colours, opacity, both lights."""
    setup = _quiet(ss.load, room)
    assert setup.scene.names == ("floor", "crate", "wedge", "ball", "pane")
    seeds = 4
    images = [
        ss.render(setup.scene, setup.camera, setup.lights, ss.RayTraced(samples=256, seed=seed))
        for seed in range(seeds)
    ]
    image, radiance = images[0], np.array([i.radiance for i in images], dtype=float)
    samples = 384
    loaded = mi.load_file(str(room))
    mean, variance, hit = bridge._centre_rays_scalar(mi, loaded, samples, 0, setup.camera)
    normal = bridge._centre_normals(mi, loaded, setup.camera)
    theirs = ss.mitsuba.MitsubaImage(mean, variance, hit, normal, samples, samples, 0.0)
    edge = (image.mask != hit) | (np.abs(image.normal - normal).max(axis=-1) > 1e-3)
    assert edge.sum() < 4  # measured: 0
    offsets = [ss.mitsuba.ray_offset(setup.scene, image, light) for light in setup.lights]
    contact = np.any([offset.contact for offset in offsets], axis=0)
    opaque = [i for i, entry in enumerate(setup.scene.entries) if entry.opacity == 1]
    mask = image.mask & np.isin(image.mesh_id, opaque) & ~edge & ~contact
    assert mask.sum() > 0.7 * mask.size  # measured: 0.77; the rest is the pane, and no surface
    full = ss.mitsuba.unshadowed(setup.scene, setup.camera, setup.lights)
    test = ss.mitsuba.z_test(
        radiance.mean(axis=0), theirs, radiance.var(axis=0, ddof=1) / seeds, mask, unshadowed=full
    )
    assert test.passed
    assert abs(test.mean_z) < 4


def _serialized(vertices, faces):
    """Mitsuba's own format, of one mesh in single precision."""
    content = struct.pack("<I", 0x1000) + b"wedge\0" + struct.pack("<QQ", len(vertices), len(faces))
    content += np.array(vertices, dtype="<f4").tobytes() + np.array(faces, dtype="<u4").tobytes()
    data = struct.pack("<HH", 0x041C, 4) + zlib.compress(content)
    return data + struct.pack("<QI", 0, 1)


def test_all_kinds_of_mesh_files_are_the_same_mesh(room):
    expected = ss.load(room).scene["wedge"]
    corners = expected.world_vertices()[expected.faces]
    mesh = trimesh.load(room.parent / "wedge.ply", process=False)
    mesh.export(room.parent / "wedge.obj")
    (room.parent / "wedge.serialized").write_bytes(_serialized(mesh.vertices, mesh.faces))
    for kind in ("obj", "serialized"):
        text = ROOM.replace('type="ply"', f'type="{kind}"').replace("wedge.ply", f"wedge.{kind}")
        room.write_text(text)
        found = _quiet(ss.load, room).scene["wedge"]
        assert np.array_equal(found.world_vertices()[found.faces], corners)


def test_the_command_renders_a_scene_file(room, tmp_path):
    out = tmp_path / "out.npy"
    assert cli.main(["render", str(room), "--samples", "4", "-o", str(out)]) == 0
    setup = ss.load(room)
    image = ss.render(setup.scene, setup.camera, setup.lights, ss.RayTraced(samples=4))
    assert np.array_equal(np.load(out), image.visibility)


def test_the_sensor_sees_along_our_rays(room):
    camera = ss.load(room).camera
    sensor = mi.load_file(str(room)).sensors()[0]
    expected = camera.rays()
    assert expected.shape == (24, 32, 3)
    for y, x in [(0, 0), (0, 31), (23, 0), (23, 31), (11, 17)]:
        ray, _ = sensor.sample_ray(0, 0, [(x + 0.5) / 32, (y + 0.5) / 24], [0, 0])
        assert np.abs(np.array(ray.d) - expected[y, x]).max() < SINGLE


def test_a_cropped_film_is_a_part_of_the_picture(room):
    whole = ss.load(room).camera.rays()
    crop = {"crop_width": 10, "crop_height": 8, "crop_offset_x": 5, "crop_offset_y": 3}
    for name, value in crop.items():
        text = room.read_text().replace(
            "</film>", f'<integer name="{name}" value="{value}"/></film>'
        )
        room.write_text(text)
    assert np.abs(ss.load(room).camera.rays() - whole[3:11, 5:15]).max() < 1e-15


def test_lights_are_where_the_file_has_them_and_emit_to_their_side(room):
    lamp, spot = ss.load(room).lights
    assert lamp.center == pytest.approx((0.7, 0, 2.5), rel=SINGLE)
    normal = np.cross(lamp.edge_u, lamp.edge_v)
    assert normal == pytest.approx((0, 0, -0.48), abs=SINGLE)  # flipped, and its area
    assert lamp.radiance == (6, 5, 4)
    towards = -np.array([-1.5, -0.5, 2.2])
    assert spot.normal == pytest.approx(towards / np.linalg.norm(towards), abs=SINGLE)
    assert spot.radius == pytest.approx(0.3, rel=SINGLE)


def test_up_and_scale_leave_the_picture_as_it_is(room):
    a, b = ss.load(room), ss.load(room, up="y", scale=0.25)
    first, second = (ss.render(s.scene, s.camera, s.lights, "hard") for s in (a, b))
    # Hard shadows' edges are one pixel wide, and the ball's outline.
    differ = np.abs(first.radiance - second.radiance).max(axis=-1) > 1e-5 * first.radiance.max()
    assert differ.sum() <= 3


# ---------------------------------------------------------------- there and back


LIGHTS = (
    ss.RectLight((0.2, 0.1, 3), (0.6, 0, 0), (0.3, -0.5, 0.2), (3, 2, 1)),
    ss.DiskLight((0, 1, 2), (0.3, 0, -1), 0.4, 5),
    ss.SphereLight((0.1, 0, 4), 0.3, (0.1, 0.2, 0.3)),
    ss.PolygonLight([(0, 0, 2), (0, 1, 2.5), (0.5, 0.4, 2.2), (1, 0, 2)], (3, 2, 1)),
)


def _ours():
    scene = ss.Scene()
    scene.add(ss.scenes.square(3), "the ground", albedo=(0.1, 0.2, 0.3))
    turn = trimesh.transformations.rotation_matrix(0.7, (1, 2, 3), (0.1, 0.2, 0.3))
    scene.add(trimesh.creation.box(), "box.1", opacity=0.3, transform=turn)
    scene.add_spheres([(0, 0, 1), (1, 0, 1), (0, 1, 1)], [0.1, 0.2, 0.3], "balls", albedo=0.5)
    scene.add_spheres((2, 0, 1), 0.4, "ball", opacity=0.6)
    scene.add_curves([(0, 0, 0), (0, 0, 1), (0.3, 0, 1.5)], [0, 3], 0.02, name="hair")
    camera = ss.Camera((3, -4, 5), (0, 0, 0.5), fov_y_deg=40, width=30, height=20)
    return scene, camera


def _same(setup, scene, camera, lights):
    assert setup.scene.names == scene.names
    for a, b in zip(setup.scene.entries, scene.entries, strict=True):
        assert a.albedo == b.albedo
        assert a.opacity == b.opacity
        if isinstance(b, ss.Spheres):
            assert np.allclose(a.centers, b.centers, rtol=0, atol=SINGLE)
            assert np.allclose(a.radii, b.radii, rtol=SINGLE)
        else:
            assert np.array_equal(a.faces, b.faces)
            assert np.allclose(a.world_vertices(), b.world_vertices(), rtol=0, atol=5 * SINGLE)
    assert np.allclose(setup.camera.K, camera.K, rtol=SINGLE, atol=30 * SINGLE)
    assert np.allclose(setup.camera.camera_to_world, camera.camera_to_world, atol=5 * SINGLE)
    assert (setup.camera.width, setup.camera.height) == (camera.width, camera.height)
    for a, b in zip(setup.lights, lights, strict=True):
        assert type(a) is type(b)
        assert a.radiance == b.radiance
        for name in ("center", "edge_u", "edge_v", "radius"):
            if hasattr(b, name):
                assert getattr(a, name) == pytest.approx(getattr(b, name), abs=SINGLE)
        if isinstance(b, ss.DiskLight):
            unit = np.array(b.normal) / np.linalg.norm(b.normal)
            assert a.normal == pytest.approx(unit, abs=SINGLE)
        if isinstance(b, ss.PolygonLight):
            first = int(np.abs(np.array(a.vertices) - b.vertices[0]).sum(axis=1).argmin())
            turned = np.roll(a.vertices, -first, axis=0)
            assert np.allclose(turned, b.vertices, rtol=0, atol=SINGLE)


@pytest.mark.parametrize("lights", [LIGHTS, *((x,) for x in LIGHTS)], ids=len)
def test_our_scene_to_mitsuba_and_back_is_the_same(lights):
    mi.set_variant("scalar_rgb")
    scene, camera = _ours()
    given = lights if len(lights) > 1 else lights[0]
    description = ss.mitsuba.scene_dict(scene, camera, given)
    _same(_quiet(ss.mitsuba.from_dict, description), scene, camera, lights)
    loaded = mi.load_dict(description, optimize=False)
    _same(_quiet(ss.mitsuba.from_scene, loaded), scene, camera, lights)
    again = ss.mitsuba.from_dict(description)
    back = ss.mitsuba.from_dict(ss.mitsuba.scene_dict(again.scene, again.camera, again.lights))
    for a, b in zip(again.scene.entries, back.scene.entries, strict=True):
        if isinstance(a, ss.Mesh):  # single precision is kept as it is
            assert np.array_equal(a.vertices, b.vertices)


# ---------------------------------------------------------------- what is not understood


def _file(tmp_path, *things):
    mi.set_variant("scalar_rgb")
    path = tmp_path / "odd.xml"
    path.write_text('<scene version="3.0.0">' + "".join(things) + "</scene>")
    return path


CUBE = '<shape type="cube" id="box"><transform name="to_world">{}</transform>{}</shape>'
GLOW = '<emitter type="area"><rgb name="radiance" value="1"/></emitter>'


def _glowing_sheet(tmp_path, name, corners, **transform):
    faces = [(0, 1, 2), (0, 2, 3)]
    trimesh.Trimesh(corners, faces, process=False).export(tmp_path / f"{name}.ply")
    file = f'<string name="filename" value="{name}.ply"/>'
    return f'<shape type="ply" id="{name}">{file}{GLOW}</shape>'


def test_a_planar_mesh_that_emits_is_a_polygon(tmp_path):
    corners = [(0, 0, 1), (1, 0, 1), (0.3, 0.3, 1), (0, 1, 1)]
    path = _file(tmp_path, _glowing_sheet(tmp_path, "sheet", corners))
    (light,) = _quiet(ss.load, path).lights
    assert isinstance(light, ss.PolygonLight)
    assert light.center[:2] == pytest.approx((0.325, 0.325), abs=0.12)
    seen = ss.kernels.light_fraction_above(light, [(0, 0, 2), (0, 0, 0)])
    assert seen.tolist() == [1, 0]  # as the triangles: upwards


def test_what_is_not_understood_is_listed_once_with_names(tmp_path):
    checks = '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf>'
    ellipse = '<transform name="to_world"><scale x="2"/></transform>'
    path = _file(
        tmp_path,
        CUBE.format("", checks),
        '<shape type="cube" id="metal"><bsdf type="conductor"/></shape>',
        '<shape type="cylinder" id="pipe"/>',
        f'<shape type="cube" id="neon">{GLOW}</shape>',
        _glowing_sheet(tmp_path, "folded", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0.2)]),
        _glowing_sheet(tmp_path, "crossed", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (3, 2, 0)]),
        f'<shape type="disk" id="oval">{ellipse}{GLOW}</shape>',
        f'<shape type="sphere" id="dome"><boolean name="flip_normals" value="true"/>{GLOW}</shape>',
        '<emitter type="constant" id="sky"/>',
        '<emitter type="directional" id="sun"/>',
        '<sensor type="orthographic" id="plan"/>',
        '<sensor type="thinlens" id="lens"><float name="aperture_radius" value="1"/></sensor>',
    )
    with pytest.warns(UserWarning, match=r"odd\.xml: not understood and left out: ") as told:
        setup = ss.load(path)
    assert len(told) == 1
    for part in (
        *("Checkerboard of cube 'box' (its mean is taken)", "SmoothConductor of cube 'metal'"),
        *(
            "cylinder 'pipe'",
            "cube 'neon' with AreaLight",
            "plymesh 'folded' with AreaLight",
            "plymesh 'crossed' with AreaLight",
            "disk 'oval' with AreaLight",
        ),
        *("sphere 'dome' with AreaLight", "'sky' (ConstantBackgroundEmitter)"),
        *("'plan' (OrthographicCamera)", "'lens' (ThinLensCamera)"),
    ):
        assert part in str(told[0].message)
    assert setup.scene.names == ("box", "metal")
    assert setup.scene["box"].albedo == pytest.approx((0.3, 0.3, 0.3))  # of 0.4 and 0.2
    assert setup.camera is None
    assert setup.lights == (ss.DistantLight((0, 0, 1), 0),)
    with pytest.warns(UserWarning, match=r"Mitsuba's scene: not understood and left out"):
        ss.mitsuba.from_scene(mi.load_file(str(path), optimize=False))


def test_names_may_be_missing_or_numbered(tmp_path):
    path = _file(tmp_path, *(['<shape type="cube"/>'] * 2), '<shape type="sphere" id="b[1]"/>')
    assert ss.load(path).scene.names == ("cube", "cube_2", "b[1]")


@pytest.mark.parametrize(
    ("things", "message"),
    [
        ('<shape type="ply"><string name="filename" value="no.ply"/></shape>', "no.ply"),
        (
            CUBE.format(
                "",
                '<bsdf type="diffuse"><texture type="bitmap" name="reflectance">'
                '<string name="filename" value="no.png"/></texture></bsdf>',
            ),
            "no.png",
        ),
        ('<bsdf type="twosided" id="a"><ref id="a"/></bsdf>', "circular reference"),
        ("<shape", "Error parsing start element"),
        ('<shape type="teapot"/>', "teapot"),
        (CUBE.format('<scale value="0"/>', ""), 'mesh "box": .*no extent'),
        (CUBE.format('<translate x="nan"/>', ""), 'mesh "box": vertex 0 is not finite'),
        (
            '<shape type="rectangle" id="r"><transform name="to_world"><scale value="0"/>'
            "</transform></shape>",
            'mesh "r": .*singular',
        ),
        (
            f'<shape type="rectangle" id="r"><transform name="to_world"><scale value="0"/>'
            f"</transform>{GLOW}</shape>",
            "no probability mass",
        ),
    ],
)
def test_what_is_wrong_with_a_file_is_an_error_that_names_it(tmp_path, things, message):
    with pytest.raises(ValueError, match=rf"odd\.xml: (?s:.*){message}"):
        ss.load(_file(tmp_path, things))


def test_other_kinds_of_things_are_errors():
    mi.set_variant("scalar_rgb")
    with pytest.raises(TypeError, match=r"scene: expected mitsuba\.Scene, got int"):
        ss.mitsuba.from_scene(5)
    with pytest.raises(TypeError, match=r"description: scene: expected mitsuba\.Scene, got Mesh"):
        ss.mitsuba.from_dict({"type": "cube"})
    with pytest.raises(ValueError, match="description: Mitsuba cannot load it"):
        ss.mitsuba.from_dict({"type": "nonsense"})
