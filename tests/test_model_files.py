"""Files are refused for what arrays are refused for; nothing is dropped or repaired silently."""

from __future__ import annotations

import bz2
import gzip
import struct
import zipfile

import numpy as np
import pytest
import softshadow as ss
import trimesh
from clocks import Stopwatch

BALL = trimesh.creation.icosphere(1)
V, F = np.array(BALL.vertices), np.array(BALL.faces)
N = len(F)


def _spoilt(value):
    vertices = V.astype(object)
    vertices[5, 0] = value
    return vertices.tolist()


def _rows(rows):
    return "".join(" ".join(map(str, row)) + "\n" for row in rows)


def _obj(vertices, faces):
    ones = [[i + 1 for i in f] for f in faces]
    return (_rows(["v", *v] for v in vertices) + _rows(["f", *f] for f in ones)).encode()


def _ply_header(kind, vertices, faces):
    axes = "".join(f"property float {a}\n" for a in "xyz")
    return (
        f"ply\nformat {kind} 1.0\nelement vertex {len(vertices)}\n{axes}element face {len(faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()


def _ply(vertices, faces):
    rows = _rows(vertices) + _rows([len(f), *f] for f in faces)
    return _ply_header("ascii", vertices, faces) + rows.encode()


def _binary_ply(vertices, faces):
    data = _ply_header("binary_little_endian", vertices, faces)
    data += np.array(vertices, dtype="<f4").tobytes()
    return data + b"".join(struct.pack("<B3i", 3, *map(int, f)) for f in faces)


def _off(vertices, faces):
    rows = _rows(vertices) + _rows([len(f), *f] for f in faces)
    return f"OFF\n{len(vertices)} {len(faces)} 0\n{rows}".encode()


def _stl(vertices, faces):
    facet = "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n"
    corners = ("".join("vertex {} {} {}\n".format(*vertices[i]) for i in f) for f in faces)
    return ("solid x\n" + "".join(map(facet.format, corners)) + "endsolid x\n").encode()


def _binary_stl(vertices, faces):
    data = bytes(80) + struct.pack("<I", len(faces))
    for f in faces:
        triangle = np.array([vertices[i] for i in f], dtype="<f4")
        data += bytes(12) + triangle.tobytes() + bytes(2)
    return data


def _glb(vertices, faces):
    data = trimesh.Trimesh(V, F, process=False).export(file_type="glb")
    data = data.replace(V.astype("<f4").tobytes(), np.array(vertices, dtype="<f4").tobytes())
    return data.replace(F.astype("<u4").tobytes(), np.array(faces).astype("<u4").tobytes())


WRITERS = {
    "obj": _obj,
    "ply": _ply,
    "binary.ply": _binary_ply,
    "off": _off,
    "stl": _stl,
    "binary.stl": _binary_stl,
    "glb": _glb,
}
INDEXED = ["obj", "ply", "binary.ply", "off", "glb"]


def _load(tmp_path, suffix, data, **options):
    path = tmp_path / f"m.{suffix}"
    path.write_bytes(data)
    return ss.Scene.load(path, **options)


@pytest.mark.parametrize("suffix", WRITERS)
def test_good_files_come_whole(tmp_path, suffix):
    scene = _load(tmp_path, suffix, WRITERS[suffix](V.tolist(), F.tolist()))
    assert scene.triangle_count == N
    assert np.abs(scene.bounds - BALL.bounds).max() < 1e-6
    mesh = scene.meshes[0]
    assert np.allclose(mesh.vertices[mesh.faces], V[F], atol=1e-6)
    # Joined: a closed surface again, which the silhouette's loops show.
    loops = ss.kernels.silhouette_loops(mesh.vertices, mesh.faces, (9, 7, 5))
    assert len(loops) == 1


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("suffix", WRITERS)
def test_vertices_that_are_not_finite_are_an_error(tmp_path, suffix, value):
    vertices = _spoilt(value if "binary" not in suffix and suffix != "glb" else float(value))
    with pytest.raises(ValueError, match=r"m.*vertex \d+ is not finite"):
        _load(tmp_path, suffix, WRITERS[suffix](vertices, F.tolist()))


@pytest.mark.parametrize("index", [9999, -1, -100, len(V)])
@pytest.mark.parametrize("suffix", INDEXED)
def test_faces_of_vertices_that_do_not_exist_are_an_error(tmp_path, suffix, index):
    faces = [*F[:-1].tolist(), [0, 1, index]]
    if suffix == "glb" and index < 0:
        pytest.skip("its indices have no sign")
    if suffix == "obj" and index < 0:
        index -= 1  # as -1 is the last vertex there, -1 of ours is 0
        faces[-1][2] = -1 if index == -2 else -len(V) - 2
    with pytest.raises(ValueError, match=r"(vertex|index|out of bounds)"):
        _load(tmp_path, suffix, WRITERS[suffix](V.tolist(), faces))


def test_an_obj_counts_from_one_and_from_the_end(tmp_path):
    data = _obj(V.tolist(), F[:-1].tolist())
    last = F[-1] - len(V)
    scene = _load(tmp_path, "obj", data + "f {} {} {}\n".format(*last).encode())
    assert np.array_equal(scene.meshes[0].vertices[scene.meshes[0].faces], V[F])
    slashed = "f {}/1 {}//1 {}/1/1\n".format(*last).encode()
    scene = _load(tmp_path, "obj", data + slashed)
    assert np.array_equal(scene.meshes[0].vertices[scene.meshes[0].faces], V[F])
    # Of those that came before it, not of all.
    early = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 7 7 7\nv 8 7 7\nv 7 8 8\nf -3 -2 -1\n"
    mesh = _load(tmp_path, "obj", early).meshes[0]
    assert sorted(map(tuple, mesh.vertices[mesh.faces[0]])) == [(0, 0, 0), (0, 1, 0), (1, 0, 0)]
    for face, words in (
        (b"f 0 1 2\n", "vertex 0, where the first is 1"),
        (b"f 0/1 1/1 2/1\n", "vertex 0, where the first is 1"),
        (b"f 1 2\n", "2 corners"),
        (b"f 1\n", "1 corners"),
        (b"f\t1 2\n", "2 corners"),
        (b"f -1 -2 -99\n", "vertex -99"),
    ):
        with pytest.raises(ValueError, match=rf"m\.obj: face {N - 1} \(line \d+\) .*{words}"):
            _load(tmp_path, "obj", data + face)


@pytest.mark.parametrize("suffix", ["obj", "ply", "binary.ply", "off"])
def test_faces_that_repeat_a_corner_are_kept(tmp_path, suffix):
    """Degenerate, as arrays may be."""
    faces = [*F.tolist(), [1, 1, 2]]
    assert _load(tmp_path, suffix, WRITERS[suffix](V.tolist(), faces)).triangle_count == N + 1


@pytest.mark.parametrize("cut", [15, 20, 60, 200, 1000])
@pytest.mark.parametrize("suffix", ["ply", "binary.ply", "off", "stl", "binary.stl", "glb"])
def test_files_that_end_too_early_are_an_error(tmp_path, suffix, cut):
    data = WRITERS[suffix](V.tolist(), F.tolist())
    with pytest.raises(ValueError, match="m"):
        _load(tmp_path, suffix, data[:-cut])


@pytest.mark.parametrize("suffix", ["obj", "ply", "off", "stl", "glb", "gltf"])
def test_empty_files_are_an_error_that_names_them(tmp_path, suffix):
    with pytest.raises(ValueError, match=rf"m\.{suffix}"):
        _load(tmp_path, suffix, b"")


# ---------------------------------------------------------------- limits


def test_faces_of_many_corners_are_a_limit_that_can_be_raised(tmp_path):
    corners = 900_000
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    ring = _rows(["v", x, y, 0] for x, y in zip(np.cos(angle), np.sin(angle), strict=True))
    data = (ring + "f " + " ".join(map(str, range(1, corners + 1))) + "\n").encode()
    watch = Stopwatch()
    with pytest.raises(ValueError, match=r"face 0 .*has 900000 corners, .*max_corners=4096"):
        _load(tmp_path, "obj", data)
    assert watch.seconds() < 10  # 1 s
    few = b"".join(b"v %d %d 0\n" % (i, i * i) for i in range(20)) + b"f "
    few += b" ".join(b"%d" % i for i in range(1, 21)) + b"\n"
    with pytest.raises(ValueError, match="max_corners=19"):
        _load(tmp_path, "obj", few, max_corners=19)
    assert _load(tmp_path, "obj", few, max_corners=20).triangle_count == 18


@pytest.mark.parametrize("kind", ["zip", "gz", "bz2"])
def test_archives_are_measured_before_they_are_read(tmp_path, kind):
    zeros = bytes(50_000_000)
    name = {"zip": "m.zip", "gz": "m.tar.gz", "bz2": "m.bz2"}[kind]
    path = tmp_path / name
    if kind == "zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("m.obj", zeros)
    else:
        path.write_bytes((gzip if kind == "gz" else bz2).compress(zeros))
    with pytest.raises(ValueError, match=f"{name}: it holds more than max_bytes=10000000"):
        ss.Scene.load(path, max_bytes=10_000_000)


def test_files_have_a_limit_that_can_be_raised(tmp_path):
    data = _obj(V.tolist(), F.tolist())
    with pytest.raises(ValueError, match="max_bytes=100 bytes; pass a larger max_bytes"):
        _load(tmp_path, "obj", data, max_bytes=100)
    assert _load(tmp_path, "obj", data, max_bytes=len(data)).triangle_count == N
    with pytest.raises(TypeError, match="max_bytes: expected an integer"):
        _load(tmp_path, "obj", data, max_bytes=1e9)


def test_archives_that_are_small_enough_are_read(tmp_path):
    path = tmp_path / "m.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("m.obj", _obj(V.tolist(), F.tolist()))
    assert ss.Scene.load(path).triangle_count == N
    path.write_bytes(b"no archive")
    with pytest.raises(ValueError, match=r"m\.zip: cannot be read"):
        ss.Scene.load(path)
