"""Model and scene files: their parts, looks and places, cameras and lights, and what is wrong."""

from __future__ import annotations

import json
import math
import pickle
import warnings

import numpy as np
import pytest
import softshadow as ss
import trimesh
from gltf_files import glb
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

BOX = trimesh.creation.box()
WEDGE = np.array([(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3)], dtype=float)
SIDES = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
"""A tetrahedron that is no mirror image of itself, its faces outwards."""


def _shift(*by):
    return trimesh.transformations.translation_matrix(by)


def _gltf(tmp_path, change=lambda header: None, kind="glb", scene=None, name="room"):
    """Write a file by `trimesh`, with its JSON changed."""
    if scene is None:
        scene = trimesh.Scene()
        scene.add_geometry(BOX, node_name="table", geom_name="box", transform=_shift(1, 2, 3))
    path = tmp_path / f"{name}.{kind}"
    if kind == "gltf":
        files = trimesh.exchange.gltf.export_gltf(scene)
        header = json.loads(files["model.gltf"])
        for file, data in files.items():
            (tmp_path / file).write_bytes(data)
        change(header)
        path.write_text(json.dumps(header))
        return path
    path.write_bytes(glb(scene, change))
    return path


def _obj(tmp_path, text, materials=None):
    if materials is not None:
        (tmp_path / "m.mtl").write_text(materials)
    path = tmp_path / "m.obj"
    path.write_text(text)
    return path


# ---------------------------------------------------------------- parts


@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_nodes_keep_name_look_place_and_texture_coordinates(tmp_path, kind):
    uv = np.linspace(0, 1, 2 * len(BOX.vertices)).reshape(-1, 2)
    glass = PBRMaterial(baseColorFactor=[1.0, 0.0, 0.0, 0.0], alphaMode="BLEND")
    pane = trimesh.Trimesh(BOX.vertices, BOX.faces, process=False)
    pane.visual = TextureVisuals(uv=uv, material=glass)
    scene = trimesh.Scene()
    scene.add_geometry(pane, node_name="pane", geom_name="pane", transform=_shift(1, 2, 3))
    scene.add_geometry(
        trimesh.creation.icosphere(1),
        node_name="knob",
        parent_node_name="pane",
        transform=_shift(0, 0, 1),
    )

    def exact(header):  # trimesh rounds to eight bits
        colour = header["materials"][0]["pbrMetallicRoughness"]
        colour["baseColorFactor"] = [0.123, 0.5, 0.25, 0.3]

    loaded = ss.Scene.load(_gltf(tmp_path, exact, kind, scene))
    assert sorted(loaded.names) == ["knob", "pane"]
    found = loaded["pane"]
    assert found.albedo == (0.123, 0.5, 0.25)
    assert found.opacity == 0.3
    assert np.array_equal(found.transform, _shift(1, 2, 3))
    assert np.array_equal(found.vertices, BOX.vertices)
    assert np.abs(found.uv - uv).max() < 1e-7  # single precision
    assert np.array_equal(loaded["knob"].transform, _shift(1, 2, 4))  # nested
    assert loaded["knob"].albedo == (0.8, 0.8, 0.8)
    assert loaded["knob"].opacity == 1
    for copy in (loaded.copy(), pickle.loads(pickle.dumps(loaded))):
        assert np.array_equal(copy["pane"].uv, found.uv)
        assert not copy["pane"].uv.flags.writeable
    joined = ss.Scene.load(tmp_path / f"room.{kind}", parts=False)
    assert joined.names == ("room",)
    assert joined.triangle_count == loaded.triangle_count
    assert np.abs(joined.bounds - loaded.bounds).max() < 1e-6


@pytest.mark.parametrize(
    ("mode", "opacity"),
    [({}, 1.0), ({"alphaMode": "BLEND"}, 0.4), ({"alphaMode": "MASK"}, 0.0),
     ({"alphaMode": "MASK", "alphaCutoff": 0.3}, 1.0)],
)  # fmt: skip
def test_alpha_counts_as_its_mode_says(tmp_path, mode, opacity):
    def change(header):
        look = {"baseColorFactor": [0.1, 0.2, 0.3, 0.4]}
        header["materials"] = [{"pbrMetallicRoughness": look, **mode}]
        header["meshes"][0]["primitives"][0]["material"] = 0

    scene = ss.Scene.load(_gltf(tmp_path, change))
    assert (scene["table"].albedo, scene["table"].opacity) == ((0.1, 0.2, 0.3), opacity)
    scene = ss.Scene.load(tmp_path / "room.glb", opacity=0.7, albedo=0.9, casts=False)
    assert (scene["table"].albedo, scene["table"].opacity) == ((0.9, 0.9, 0.9), 0.7)
    assert not scene["table"].casts


def test_an_obj_s_objects_groups_and_materials_are_parts(tmp_path):
    path = _obj(
        tmp_path,
        "mtllib m.mtl\no sail\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 0.5\n"
        "usemtl red\nf -4/-3 -3/-2 -2/-1\no hull\ng left\nusemtl blue\nf 1 2 4\ng right\nf 2 3 4\n",
        "newmtl red\nKd 0.8 0.123 0.1\nd 0.5\nmap_Kd no.png\n"
        "newmtl blue\nKd 0.1 0.1 0.777\nTr 0.25\n",
    )
    scene = ss.Scene.load(path)  # the texture is missing, and nobody needs it
    assert scene.names == ("sail", "hull_left", "hull_right")
    assert (scene["sail"].albedo, scene["sail"].opacity) == ((0.8, 0.123, 0.1), 0.5)
    assert scene["sail"].uv.tolist() == [[0, 0], [1, 0], [0, 0.5]]
    for name in ("hull_left", "hull_right"):
        assert (scene[name].albedo, scene[name].opacity) == ((0.1, 0.1, 0.777), 0.75)
    with pytest.warns(UserWarning, match=r"m\.obj: not understood and left out: texture 'no.png'"):
        assert ss.load(path).scene.names == scene.names


def test_an_obj_without_its_materials_and_without_names_is_called_as_the_file(tmp_path):
    scene = ss.Scene.load(_obj(tmp_path, "mtllib no.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"))
    assert scene.names == ("m",)
    assert scene["m"].albedo == (0.8, 0.8, 0.8)


def test_colours_of_vertices_are_left_out_and_told(tmp_path):
    mesh = trimesh.Trimesh(WEDGE, SIDES, vertex_colors=np.full((4, 4), 99, dtype=np.uint8))
    mesh.export(tmp_path / "scan.ply")
    with pytest.warns(UserWarning, match=r"left out: scan\.ply \(its vertex colours\)"):
        assert ss.load(tmp_path / "scan.ply").scene.names == ("scan",)


def test_lines_and_points_are_left_out_and_told(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.load_path([(0, 0, 0), (1, 0, 0), (1, 1, 1)]), geom_name="wire")
    scene.add_geometry(trimesh.PointCloud(WEDGE), geom_name="dots")
    for mesh in (None, BOX):
        if mesh is not None:
            scene.add_geometry(mesh, node_name="box", geom_name="box")
        path = _gltf(tmp_path, scene=scene)
        told = r"mesh '\w+' \(its points, lines or fans\), mesh '\w+' \(its points"
        if mesh is None:
            with pytest.raises(ValueError, match=rf"has no triangle meshes, only {told}"):
                ss.load(path)
        else:
            with pytest.warns(UserWarning, match=f"left out: {told}"):
                assert ss.load(path).scene.names == ("box",)


def test_names_may_be_missing_or_the_same_and_a_mesh_in_several_nodes(tmp_path):
    def change(header):
        table = next(i for i, n in enumerate(header["nodes"]) if n.get("name") == "table")
        mesh = header["nodes"][table]["mesh"]
        header["meshes"][mesh].pop("name", None)
        header["nodes"] += [{"mesh": mesh, "translation": [i, 0, 0]} for i in (5, 9)]
        header["nodes"] += [{"mesh": mesh, "name": "table", "scale": [2, 2, 2]}]
        header["scenes"] = [
            {"nodes": [table, *range(len(header["nodes"]) - 3, len(header["nodes"]))]}
        ]

    scene = ss.Scene.load(_gltf(tmp_path, change))
    assert scene.names == ("table", "room", "room_2", "table_2")
    assert [e.transform[0, 3] for e in scene.entries[1:3]] == [5, 9]
    assert np.array_equal(scene["room"].vertices, scene["table"].vertices)
    with pytest.raises(ValueError, match=r"name: .*room\.glb has 4 parts"):
        ss.Scene.load(tmp_path / "room.glb", name="all")
    assert ss.Scene.load(tmp_path / "room.glb", name="all", parts=False).names == ("all",)


def test_millimetres_and_y_up(tmp_path):
    path = _gltf(tmp_path)
    scene = ss.Scene.load(path, up="y", scale=0.001, transform=_shift(0, 0, 10))
    # (1, 2, 3) ± 0.5: y becomes z, z becomes -y.
    expected = [[0.0005, -0.0035, 10.0015], [0.0015, -0.0025, 10.0025]]
    assert np.abs(scene.bounds - expected).max() < 4e-15  # two ulps of 10
    joined = ss.Scene.load(path, up="y", scale=0.001, transform=_shift(0, 0, 10), parts=False)
    assert np.abs(joined.bounds - expected).max() < 1e-9  # single precision
    for options, message in (
        ({"up": "x"}, "up: expected 'y' or 'z', got 'x'"),
        ({"scale": 0}, "scale: expected a positive number, got 0"),
        ({"scale": math.nan}, "scale: expected a positive number, got nan"),
        ({"transform": np.eye(3)}, r"transform: expected shape \(4, 4\)"),
    ):
        with pytest.raises(ValueError, match=message):
            ss.Scene.load(path, **options)
    with pytest.raises(TypeError, match="parts: expected True or False"):
        ss.Scene.load(path, parts="all")


def test_mirrored_nodes_look_as_their_mirrored_vertices_do(tmp_path):
    mesh = trimesh.Trimesh(WEDGE, SIDES, process=False)
    mirror = np.diag([-1.0, 1, 1, 1])
    scene = trimesh.Scene()
    scene.add_geometry(mesh, node_name="wedge", transform=mirror)
    mirrored = ss.Scene.load(_gltf(tmp_path, scene=scene))
    by_hand = ss.Scene()
    by_hand.add((WEDGE * [-1, 1, 1], SIDES[:, ::-1]), "wedge")
    camera = ss.Camera((-2, -6, 4), (0, 0, 0.5), width=48, height=36)
    light = ss.RectLight((-3, 2, 5), (0, 1, 0), (1, 0, 0))
    for found in (mirrored, by_hand):
        found.add(ss.scenes.square(5, -0.1), "ground")
    for method in ("wedges", "counted", "ssoc", ss.RayTraced(samples=64)):
        a, b = (ss.render(s, camera, light, method) for s in (mirrored, by_hand))
        assert np.array_equal(a.visibility, b.visibility), method
        assert np.array_equal(a.normal, b.normal), method


# ---------------------------------------------------------------- what is wrong


def _cyclic(header):
    table = next(i for i, n in enumerate(header["nodes"]) if "mesh" in n)
    header["nodes"][table]["children"] = [table]


def _two_parents(header):
    header["nodes"] += [{"children": [0]}, {"children": [0]}]
    header["scenes"] = [{"nodes": [len(header["nodes"]) - 2, len(header["nodes"]) - 1]}]


def _only_a_cycle(header):
    header.pop("scenes")
    header["nodes"] = [{"children": [1], "mesh": 0}, {"children": [0]}]


def _of_table(**what):
    def change(header):
        node = next(n for n in header["nodes"] if "mesh" in n)
        node.pop("matrix", None)
        node.update(what)

    return change


def _of_colour(factor):
    def change(header):
        header["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": factor}}]
        header["meshes"][0]["primitives"][0]["material"] = 0

    return change


def _no_nodes(header):
    header["scenes"][0]["nodes"] = []


def _no_such_node(header):
    header["scenes"][0]["nodes"] = [99]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_cyclic, "node 'table' has two parents, or is its own ancestor"),
        (_two_parents, "has two parents"),
        (_only_a_cycle, "its nodes are a cycle"),
        (_no_such_node, "refers to node 99"),
        (_of_table(scale=[0, 0, 0]), 'mesh "table": .*singular'),
        (_of_table(scale=[1, 0, 1]), 'mesh "table": .*singular'),
        (_of_table(translation=[0, math.nan, 0]), "mesh 'table': its transform is not finite"),
        (_of_table(mesh=77), "node 'table' refers to mesh 77"),
        (_no_nodes, "it has no triangle meshes"),
        (_of_colour("red"), "its nodes or materials cannot be read"),
        (_of_colour([0.1, 0.2]), "its nodes or materials cannot be read"),
        (_of_colour([-1, 0, 0, 1]), "mesh 'table': albedo"),
        (lambda header: header.update(meshes=5), "cannot be read as a mesh"),
        (lambda header: header.update(nodes="many"), "cannot be read as a mesh"),
    ],
)
@pytest.mark.parametrize("load", [ss.Scene.load, ss.load])
def test_what_is_wrong_with_a_file_is_an_error_that_names_it(tmp_path, change, message, load):
    with pytest.raises(ValueError, match=rf"room\.gl(b|tf): .*{message}"):
        load(_gltf(tmp_path, change))


@pytest.mark.parametrize("suffix", ["glb", "gltf", "obj", "ply", "xml"])
def test_an_empty_file_is_an_error_that_names_it(tmp_path, suffix):
    if suffix == "xml":
        pytest.importorskip("mitsuba")
    path = tmp_path / f"nothing.{suffix}"
    path.write_bytes(b"")
    with pytest.raises(ValueError, match=rf"nothing\.{suffix}: "):
        ss.load(path)
    with pytest.raises(ValueError, match=rf"missing\.{suffix}: no such file"):
        ss.load(tmp_path / f"missing.{suffix}")


# ---------------------------------------------------------------- cameras and lights of glTF


def _lit(**light):
    """A change that adds a light, placed by a nested node."""

    def change(header):
        header["extensions"] = {"KHR_lights_punctual": {"lights": [light]}}
        header["nodes"] += [
            {"translation": [0, 0, 4], "children": [len(header["nodes"]) + 1]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [1, 0, 0]},
        ]
        header["scenes"][0]["nodes"].append(len(header["nodes"]) - 2)

    return change


def test_a_point_light_is_a_sphere_of_its_intensity(tmp_path):
    path = _gltf(tmp_path, _lit(type="point", color=[1, 0.5, 0], intensity=20, name="bulb"))
    (light,) = ss.load(path, light_radius=0.1).lights
    assert light.center == (1, 0, 4)
    assert light.radius == 0.1
    # What it does to a surface that faces it is intensity over distance squared: at 10 that is
    # 0.2; a sphere is seen under a smaller angle by (r / d)² of it.
    seen = ss.kernels.unshadowed_irradiance(light, [(11, 0, 4)], [(-1, 0, 0)]) * light.radiance[0]
    assert seen == pytest.approx(0.2, rel=2e-4)
    assert light.radiance[1] == pytest.approx(light.radiance[0] / 2)
    assert light.radiance[2] == 0
    moved = ss.load(path, light_radius=0.1, up="y", scale=2).lights[0]
    assert moved == ss.SphereLight((2, -8, 0), 0.2, light.radiance)
    with pytest.warns(UserWarning, match=r"left out: light 'bulb' \(a point; light_radius="):
        assert ss.load(path).lights == ()
    with pytest.raises(ValueError, match="light_radius: expected a positive number, got 0"):
        ss.load(path, light_radius=0)


def test_a_light_may_state_its_radius(tmp_path):
    path = _gltf(tmp_path, _lit(type="point", extras={"radius": 0.5}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert ss.load(path).lights[0].radius == 0.5
    path = _gltf(tmp_path, _lit(type="point", extras={"radius": -1}))
    with pytest.raises(ValueError, match=r"room\.glb: .*light 0: radius: expected a positive"):
        ss.load(path)


def test_a_light_inside_of_geometry_is_loaded_and_hidden(tmp_path):
    path = _gltf(tmp_path, _lit(type="point", extras={"radius": 0.2}))
    setup = ss.load(path)
    setup.scene.set_transform("table", _shift(1, 0, 4))  # around the light
    points = [(5, 0, 4), (1, 0, 4.45)]
    seen = ss.visibility(setup.scene, points, None, setup.lights[0])
    assert seen.tolist() == [0, 1]


def test_a_camera_sees_what_the_file_says(tmp_path):
    eye = trimesh.transformations.rotation_matrix(math.radians(-90), (1, 0, 0), (0, 0, 0))
    eye = _shift(1, 8, 3) @ eye  # looks along -z turned to -y, at the table from above

    def change(header):
        lens = {"yfov": math.radians(30), "aspectRatio": 1.5, "znear": 0.1}
        header["cameras"] = [{"type": "perspective", "perspective": lens, "name": "main"}]
        header["cameras"] += [{"type": "orthographic", "orthographic": {}, "name": "plan"}]
        header["nodes"] += [
            {"matrix": eye.T.ravel().tolist(), "camera": 0, "children": [len(header["nodes"]) + 2]},
            {"camera": 1},
            {"camera": 0, "name": "below a camera"},
        ]
        header["scenes"][0]["nodes"] += [len(header["nodes"]) - 3, len(header["nodes"]) - 2]

    path = _gltf(tmp_path, change)
    with pytest.warns(UserWarning, match="left out: ") as told:
        setup = ss.load(path, height=40)
    assert len(told) == 1
    assert "camera 'plan' (orthographic)" in str(told[0].message)
    assert "camera 'main' (a second one)" in str(told[0].message)
    camera = setup.camera
    assert (camera.width, camera.height) == (60, 40)
    assert camera.fov_y_deg == pytest.approx(30)
    assert camera.eye.tolist() == [1, 8, 3]
    assert camera.rays()[20, 30] == pytest.approx([0, -1, 0], abs=0.01)  # half a pixel
    assert camera.camera_to_world[:3, 1] == pytest.approx([0, 0, 1], abs=1e-12)  # down is +z
    with pytest.warns(UserWarning, match="left out"):
        turned = ss.load(path, height=40, up="y", scale=0.5)
    a = ss.render(setup.scene, camera, ss.SphereLight((1, 9, 5), 0.3), "hard")
    b = ss.render(turned.scene, turned.camera, ss.SphereLight((0.5, -2.5, 4.5), 0.15), "hard")
    assert np.array_equal(a.mask, b.mask)
    assert np.abs(a.depth[a.mask] - 2 * b.depth[b.mask]).max() < 1e-5  # single precision at 7


def test_what_a_file_has_beyond_that_is_listed_once_with_names(tmp_path):
    def change(header):
        _lit(type="spot", name="torch")(header)
        colour = {"baseColorTexture": {"index": 0}}
        header["textures"], header["images"] = [{"source": 0}], [{"uri": "missing.png"}]
        header["materials"] = [
            {
                "name": "oak",
                "pbrMetallicRoughness": colour,
                "emissiveFactor": [0, 1, 0],
                "extensions": {"KHR_materials_transmission": {}, "KHR_materials_unlit": {}},
            }
        ]
        header["meshes"][0]["primitives"][0]["material"] = 0
        header["animations"] = [{"name": "spin"}]
        header["extensionsRequired"] = ["KHR_lights_punctual", "ACME_fog"]

    for kind in ("glb", "gltf"):
        with pytest.warns(UserWarning, match=r"room\.gl\w+: not understood and left out") as told:
            setup = ss.load(_gltf(tmp_path, change, kind))
        assert len(told) == 1
        for part in (
            *("material 'oak' (its texture)", "material 'oak' (its emission)"),
            "material 'oak' (KHR_materials_transmission)",
            *("animation 'spin'", "extension ACME_fog", "light 'torch' (spot)"),
        ):
            assert part in str(told[0].message)
        assert setup.scene.names == ("table",)
        assert setup.camera is None
        assert setup.lights == ()


def test_cameras_and_lights_that_are_broken_are_errors(tmp_path):
    def change(header):
        header["nodes"][-1]["camera"] = 5

    with pytest.raises(ValueError, match=r"room\.glb: its cameras or lights cannot be read"):
        ss.load(_gltf(tmp_path, change))


# ---------------------------------------------------------------- other packages' meshes


class PolyData:
    """What PyVista's class has."""

    def __init__(self, points, faces):
        self.points, self.faces = points, faces
        self.is_all_triangles = bool((np.asarray(faces)[::4] == 3).all() and len(faces) % 4 == 0)

    def triangulate(self):
        return PolyData(self.points, [3, 0, 1, 2, 3, 0, 2, 3])


def test_meshes_of_pyvista_and_open3d_are_taken_by_their_attributes():
    vertices, faces = ss.scenes.square(1)
    scene = ss.Scene()
    scene.add(PolyData(vertices, np.insert(faces, 0, 3, axis=1).ravel()), "triangles")
    scene.add(PolyData(vertices, [4, 0, 1, 2, 3]), "quad")

    class TriangleMesh:
        """What Open3D's class has."""

        def __init__(self):
            self.vertices, self.triangles = vertices, faces.astype(np.int32)

    scene.add(TriangleMesh(), "open3d")
    for name in scene:
        assert np.array_equal(scene[name].vertices, vertices)
        assert np.array_equal(scene[name].faces, faces)
    with pytest.raises(TypeError, match=r"pyvista\.PolyData, open3d\.geometry\.TriangleMesh"):
        scene.add(object())
    with pytest.raises(ValueError, match=r"expected uv of shape \(4, 2\), got \(3, 2\)"):
        scene.add((vertices, faces), uv=np.zeros((3, 2)))
