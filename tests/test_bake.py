"""Textures of receivers: layout, texture coordinates, files."""

from __future__ import annotations

import json

import imageio.v3 as imageio
import numpy as np
import pytest
import softshadow as ss
import trimesh
from shapes import quad
from softshadow import kernels

LIGHT = ss.RectLight((0.2, -0.3, 2.0), (0, 0.5, 0), (0.5, 0, 0), radiance=(3, 2, 1))
TRACED = ss.RayTraced(64, pattern="fixed")


@pytest.fixture(scope="module")
def scene():
    """A ground of two triangles, a tilted triangle over it, and a cylinder to unwrap."""
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (2, 0, 0), (0, 1, 0)), "ground", albedo=(0.2, 0.5, 0.8))
    scene.add(([(0, 0, 0.4), (0.4, 0, 0.5), (0, 0.3, 0.4)], [(0, 1, 2)]), "sail")
    scene.add(_cylinder()[0], "pipe")
    scene.add(quad((5, 5, 0), (1, 0, 0), (0, 1, 0)), "aside", receives=False)
    return scene


def _cylinder(n=12):
    """An open cylinder and its unwrapping, u around and v along."""
    angle = np.linspace(0, 2 * np.pi, n + 1)
    around = np.column_stack([0.15 * np.cos(angle) - 0.6, 0.15 * np.sin(angle)])
    ring = [np.column_stack([around, np.full(n + 1, z)]) for z in (0.1, 0.6)]
    i = np.arange(n)
    faces = np.concatenate(
        [
            np.column_stack([i, i + 1, i + n + 2]),
            np.column_stack([i, i + n + 2, i + n + 1]),
        ]
    )
    u = np.linspace(0.05, 0.95, n + 1)
    uv = np.concatenate([np.column_stack([u, np.full(n + 1, v)]) for v in (0.1, 0.9)])
    return (np.concatenate(ring), faces), uv


@pytest.mark.parametrize("method", [ss.Accumulation(64, max_size=64), TRACED])
def test_texels_lie_where_their_texture_coordinates_say(scene, method):
    bake = ss.bake(scene, LIGHT, ["ground", "sail"], method, max_size=64)
    for texture in bake:
        entry = next(m for m in scene.meshes if m.name == texture.receiver)
        corners = entry.world_vertices()[entry.faces[texture.faces]]
        polygon = texture.polygon
        placed = polygon.corner + texture.uv.astype(float) @ polygon.edges
        assert np.allclose(placed, corners, atol=1e-6)
        positions = polygon.texel_positions()
        height, width = texture.visibility.shape
        assert positions.shape == (height, width, 3)
        # The top row is at high v.
        assert np.allclose(
            positions[0, 0], polygon.corner + polygon.edges.T @ (0.5 / width, 1 - 0.5 / height)
        )
        normals = np.broadcast_to(polygon.normal, positions.shape).reshape(-1, 3)
        points = positions.reshape(-1, 3)
        expected = ss.visibility(scene, points, normals, LIGHT, TRACED).reshape(height, width)
        assert (texture.visibility != expected).sum() <= 4
        # Radiance is albedo / pi times the irradiance that is left, near to visibility times all.
        whole = kernels.unshadowed_irradiance(LIGHT, points, normals).reshape(height, width)
        near = whole[..., None] * np.array(entry.albedo) / np.pi * (3, 2, 1)
        lit = expected == 1
        assert np.allclose(texture.radiance[lit], near[lit], rtol=0.01)
    sail = bake.of("sail")
    assert len(sail) == 1
    # Half of its parallelogram.
    assert abs(sail[0].mask.mean() - 0.5) < 0.1
    assert bake.of("ground")[0].mask.all()


def test_the_layout_is_what_is_baked_and_memory_is_known_before(scene):
    method = ss.Accumulation(8, max_size=128)
    polygons, size = ss.bake_layout(scene, LIGHT, method=method)
    assert {p.receiver for p in polygons} == {"ground", "sail", "pipe"}
    bake = ss.bake(scene, LIGHT, method=method)
    assert [t.visibility.shape[::-1] for t in bake] == [p.size for p in polygons]
    assert bake.bytes == size
    with pytest.raises(ValueError, match="memory_limit"):
        ss.bake_layout(scene, LIGHT, method=ss.Accumulation(memory_limit=size))
    ground = next(p for p in polygons if p.receiver == "ground")
    # 2 by 1 of an extent that "aside" makes 6.5: texels of 6.5 / 128.
    assert sorted(ground.size) == [32, 64]


def test_sides(scene):
    for side, sign in (("front", 1), ("back", -1), ("light", 1)):
        texture = ss.bake(scene, LIGHT, "ground", ss.Accumulation(16, max_size=32), side=side)[0]
        assert texture.polygon.normal[2] == sign
        assert (texture.visibility.max() > 0) == (sign > 0)


def test_a_mesh_with_texture_coordinates(scene):
    (vertices, faces), uv = _cylinder()
    for coordinates in (uv, uv[faces]):
        texture = ss.bake(
            scene, LIGHT, "pipe", TRACED, uv={"pipe": coordinates}, size=(96, 64), padding=0
        )[0]
        assert texture.visibility.shape == (64, 96)
        assert abs(texture.mask.mean() - 0.9 * 0.8) < 0.02
    # Every texel's point, from its texture coordinates around and along.
    rows, columns = np.nonzero(texture.mask)
    u, v = (columns + 0.5) / 96, 1 - (rows + 0.5) / 64
    part = (u - 0.05) / 0.9 * 12
    side = np.minimum(part.astype(int), 11)
    t = (part - side)[:, None]
    z = 0.1 + (v - 0.1) / 0.8 * 0.5
    points = vertices[side] * (1 - t) + vertices[side + 1] * t
    points[:, 2] = z
    along = vertices[side + 1] - vertices[side]
    normals = np.column_stack([along[:, 1], -along[:, 0], np.zeros(len(side))])
    expected = ss.visibility(scene, points, normals, LIGHT, TRACED)
    different = np.abs(texture.visibility[rows, columns] - expected) > 0
    # Texels on the border between two facets belong to either; a ray may pass an edge on either
    # side (measured: 0.4 %).
    assert different.mean() < 0.01
    padded = ss.bake(scene, LIGHT, "pipe", TRACED, uv={"pipe": uv}, size=(96, 64), padding=3)[0]
    assert np.array_equal(padded.visibility[texture.mask], texture.visibility[texture.mask])
    beside = ~texture.mask & np.roll(texture.mask, 1, axis=1)
    row, column = np.argwhere(beside)[10]
    assert padded.radiance[row, column].tolist() == padded.radiance[row, column - 1].tolist()
    assert (padded.radiance[0, 0] == 0).all()


def test_a_receiver_with_and_one_without_texture_coordinates(scene):
    _, uv = _cylinder()
    bake = ss.bake(scene, LIGHT, ["ground", "pipe"], "hard", uv={"pipe": uv}, size=32, max_size=32)
    assert [t.receiver for t in bake] == ["ground", "pipe"]
    assert bake[1].polygon is None
    assert bake[-1] is bake[1]
    assert [t.receiver for t in bake[:1]] == ["ground"]


def test_files(scene, tmp_path):
    bake = ss.bake(scene, LIGHT, ["ground", "sail"], ss.Accumulation(16, max_size=32))
    names = bake.save(tmp_path, ".png")
    assert [n.name for n in names] == ["ground_0.png", "sail_1.png"]
    picture = imageio.imread(names[0])
    assert picture.shape == bake[0].radiance.shape
    assert picture.max() > 128
    bake.save(tmp_path, ".exr")
    import OpenEXR

    with OpenEXR.File(str(tmp_path / "ground_0.exr")) as file:
        assert np.array_equal(file.channels()["RGB"].pixels, bake[0].radiance)
    bits = ss.bake(scene, LIGHT, "ground", ss.Accumulation(16, texture="eight_bit", max_size=32))[0]
    bits.save(tmp_path / "bits.png", "modulation")
    assert np.array_equal(imageio.imread(tmp_path / "bits.png"), bits.modulation)
    with pytest.raises(ValueError, match="what"):
        bits.save(tmp_path / "bits.png", "other")
    with pytest.raises(FileNotFoundError):
        bake.save(tmp_path / "missing")


def test_progress_is_told(scene):
    told = []
    ss.bake(scene, LIGHT, "ground", ss.Accumulation(4096, max_size=512), progress=told.append)
    assert all(0 <= t <= 1 for t in told)


def test_bad_input(scene):
    cases = [
        (dict(receivers="nothing"), "no mesh named 'nothing'"),
        (dict(receivers="aside"), "does not receive"),
        (dict(receivers=[]), "at least one"),
        (dict(method="wedges"), "needs a camera"),
        (dict(side="left"), "side"),
        (dict(method="hard", uv={"sky": [[0, 0]]}), "not among the receivers"),
        (dict(method="hard", uv={"sail": [[0, 0]]}), r"expected shape \(3, 2\)"),
        (dict(method="hard", uv={"sail": [[0, 0], [1, 0], [0, 2]]}), "from 0 to 1"),
        (dict(method="hard", uv={"sail": [[0, 0], [1, 0], [0, np.nan]]}), "from 0 to 1"),
        (dict(method="hard", uv={"sail": [[0, 0], [1e-4, 0], [0, 1e-4]]}), "cover no texel"),
        (dict(method="hard", uv={"sail": [[0, 0], [1, 0], [0, 1]]}, size=0), "size"),
        (dict(method="hard", padding=-1), "padding"),
        (dict(uv={"sail": [[0, 0], [1, 0], [0, 1]]}), "layout of their own"),
        (dict(method="hard", max_size=100), "max_size"),
    ]
    for options, message in cases:
        with pytest.raises(ValueError, match=message):
            ss.bake(scene, LIGHT, **options)
    with pytest.raises(TypeError):
        ss.bake("scene", LIGHT)
    bake = ss.bake(scene, LIGHT, "ground", "hard", max_size=16)
    with pytest.raises(ValueError, match="only accumulation"):
        bake.refine()
    with pytest.raises(ValueError, match="no textures"):
        bake.of("sail")
    with pytest.raises(IndexError):
        bake[1]


def _written(bake, path, **options):
    """A GLB as trimesh and its JSON have it."""
    bake.to_glb(path, **options)
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    return trimesh.load(path, process=False), json.loads(data[20 : 20 + length])


def _levels(texture, exposure):
    return np.rint(255 * ss.images.to_srgb(texture.radiance, exposure)).astype(np.uint8)


def test_a_glb_has_the_textures_bits_and_triangles(scene, tmp_path):
    bake = ss.bake(scene, LIGHT, ["ground", "sail"], ss.Accumulation(16, max_size=32))
    read, tree = _written(bake, tmp_path / "baked.glb", exposure=2.0)
    assert list(read.geometry) == ["ground_0", "sail_1"]
    for texture, mesh in zip(bake, read.geometry.values(), strict=True):
        bits = np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"))
        assert np.array_equal(bits, _levels(texture, 2.0))
        entry = scene[texture.receiver]
        assert np.allclose(
            sorted(mesh.triangles.reshape(-1, 9).tolist()),
            sorted(entry.world_vertices()[entry.faces].reshape(-1, 9).tolist()),
            atol=1e-6,
        )
    # No viewer adds light to it, and no border shows the other side.
    assert tree["extensionsUsed"] == ["KHR_materials_unlit"]
    assert all(m["extensions"] == {"KHR_materials_unlit": {}} for m in tree["materials"])
    assert tree["samplers"] == [{"wrapS": 33071, "wrapT": 33071}]
    assert [t["sampler"] for t in tree["textures"]] == [0, 0]


@pytest.mark.parametrize("receiver", ["ground", "sail", "pipe"])
def test_a_glb_has_every_texel_where_it_was_baked(scene, receiver, tmp_path):
    """The radiance in the middle of triangles, looked up where viewers look it up."""
    unwrapped = {"pipe": _cylinder()[1]} if receiver == "pipe" else None
    bake = ss.bake(scene, LIGHT, receiver, TRACED, uv=unwrapped, size=256, max_size=256)
    read, _ = _written(bake, tmp_path / "baked.glb")
    mesh = read.geometry[f"{receiver}_0"]
    shades = np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"))
    height, width = shades.shape[:2]
    middles, uv = mesh.triangles_center, mesh.visual.uv[mesh.faces].mean(axis=1)
    # trimesh has v from below, as the arrays; glTF's own runs from above.
    texel = shades[
        np.floor((1 - uv[:, 1]) * height).astype(int), np.floor(uv[:, 0] * width).astype(int)
    ]
    normals = np.cross(*np.moveaxis(mesh.triangles[:, 1:] - mesh.triangles[:, :1], 1, 0))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    seen = ss.visibility(scene, middles, normals, LIGHT, TRACED)
    whole = kernels.unshadowed_irradiance(LIGHT, middles, normals)
    part = np.maximum(kernels.light_fraction_above(LIGHT, middles, normals), 1e-9)
    arriving = (whole * seen / part)[:, None] / np.pi * np.array(LIGHT.radiance)
    radiance = arriving * np.array(scene[receiver].albedo)
    exposure = ss.images.auto_exposure(bake[0].radiance)
    expected = 255 * ss.images.to_srgb(radiance[None], exposure)[0]
    # Half a texel is 1 / 256 of a side, over which nothing here changes by more.
    assert np.abs(texel - expected).max() < 6
    assert expected.max() > 100


def test_a_glb_stands_upright_and_shows_the_side_that_was_baked(scene, tmp_path):
    file = tmp_path / "baked.glb"
    method = ss.Accumulation(4, max_size=16)
    for up, axis in (("z", (0, 1, 0)), ("y", (0, 0, 1))):
        read, _ = _written(ss.bake(scene, LIGHT, "ground", method), file, up=up)
        transform, name = read.graph["ground_0"]
        assert transform[:3, :3] @ (0, 0, 1) == pytest.approx(axis)
        assert np.linalg.det(transform) == pytest.approx(1)
        assert read.geometry[name].face_normals == pytest.approx(np.array([(0, 0, 1)] * 2))
    read, _ = _written(ss.bake(scene, LIGHT, "ground", method, side="back"), file)
    assert read.geometry["ground_0"].face_normals == pytest.approx(np.array([(0, 0, -1)] * 2))


def test_what_a_glb_cannot_be_is_an_error(scene, tmp_path):
    bake = ss.bake(scene, LIGHT, "ground", ss.Accumulation(4, max_size=16))
    for path, options, error, message in [
        ("a.gltf", {}, ValueError, "expected one of .glb"),
        ("missing/a.glb", {}, FileNotFoundError, "there is no folder"),
        ("a.glb", dict(up="x"), ValueError, "up: expected 'y' or 'z'"),
        ("a.glb", dict(exposure=0), ValueError, "exposure"),
    ]:
        with pytest.raises(error, match=message):
            bake.to_glb(tmp_path / path, **options)
    assert not list(tmp_path.iterdir())
