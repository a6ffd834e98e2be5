"""Model files: read as they are, and refused where a reader would repair or drop something.

`trimesh` reads them. Left to itself it drops vertices that are not finite with their faces, takes
index 0 of an OBJ for the last vertex, and says nothing of a text file that ends too early.
"""

from __future__ import annotations

import bz2
import gzip
import io
import re
import sys
import tarfile
import zipfile
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import numpy.typing as npt
    import trimesh

    from softshadow.gltf import Header

from softshadow import checks
from softshadow.extras import needs

__all__ = ["MAX_BYTES", "MAX_CORNERS", "Loaded", "from_trimesh", "read"]

MAX_BYTES = 2**29
"""Bytes of a file, or of what an archive holds, that are read unless the caller allows more."""

MAX_CORNERS = 4096
"""Corners of a face that are taken unless the caller allows more."""

_ARCHIVES = (".zip", ".gz", ".tgz", ".bz2")


class Loaded(NamedTuple):
    """What `trimesh` made of a file, the JSON of a glTF file, and textures that were left out."""

    mesh: trimesh.Trimesh | trimesh.Scene
    header: Header | None
    textures: list[str]


class _Materials:
    """Hands an OBJ file's materials to `trimesh`, and notes textures, which nobody needs."""

    def __init__(self, file: Path) -> None:
        self.file_name = file.stem  # what `trimesh` calls a mesh without a name
        self.textures: list[str] = []
        self._folder = file.parent

    def get(self, name: str) -> bytes:
        if Path(name).suffix.lower() != ".mtl":
            self.textures.append(name)
            raise FileNotFoundError(name)
        return (self._folder / name).read_bytes()

    __getitem__ = get


def read(
    file: Path, max_bytes: int = MAX_BYTES, max_corners: int = MAX_CORNERS, parts: bool = False
) -> Loaded:
    """Return what a file holds, with nothing repaired or left out.

    Parameters
    ----------
    file : Path
    max_bytes, max_corners : int
        As of `Scene.add`.
    parts : bool
        Whether an OBJ file's objects, groups and materials are told apart, and a glTF file's nodes
        and materials named by their indices.

    Raises
    ------
    ValueError
        If it is too large, ends too early, has faces that are none, or cannot be read.
    """
    max_bytes = checks.integer(max_bytes, "max_bytes", 1, 2**63 - 1)
    max_corners = checks.integer(max_corners, "max_corners", 3, 2**63 - 1)
    if not file.is_file():
        raise ValueError(f"{file}: no such file")
    try:
        size = _contents(file, max_bytes)
    except (OSError, EOFError, zipfile.BadZipFile, tarfile.TarError) as error:
        raise ValueError(f"{file}: cannot be read as an archive ({error})") from error
    if size > max_bytes:
        raise ValueError(
            f"{file}: it holds more than max_bytes={max_bytes} bytes; pass a larger max_bytes to "
            "read it"
        )
    kind = file.suffix.lower()
    source: Path | IO[bytes] = file
    options: dict[str, Any] = {}
    materials, header = _Materials(file), None
    if kind in (".obj", ".ply", ".off", ".stl"):
        data = file.read_bytes()
        try:
            if kind == ".obj":
                source = io.BytesIO(_checked_obj(data, max_corners))
                options = {"file_type": "obj", "skip_materials": True}
                if parts:
                    split = {"split_objects": True, "split_groups": True}
                    options = {"file_type": "obj", "resolver": materials, **split}
            else:
                {".ply": _check_ply, ".off": _check_off, ".stl": _check_stl}[kind](data)
        except _Broken as error:
            raise ValueError(f"{file}: {error}") from None
    import trimesh  # here, since it takes longer to import than all of this package

    try:
        if parts and kind in (".glb", ".gltf"):
            from softshadow import gltf

            header, rest = gltf.read_header(file.read_bytes())
            source = io.BytesIO(gltf.label(header, rest))
            resolver = trimesh.resolvers.FilePathResolver(str(file))
            options = {"file_type": kind[1:], "resolver": resolver}
        mesh = trimesh.load(source, process=False, **options)
        return Loaded(mesh, header, materials.textures)
    except Exception as error:  # trimesh raises whatever its readers raise
        if isinstance(error, ModuleNotFoundError) and "networkx" in str(error):
            with needs("io", str(file)):
                raise
        raise ValueError(f"{file}: cannot be read as a mesh ({error})") from error


def from_trimesh(mesh: object) -> tuple[npt.ArrayLike, npt.ArrayLike] | None:
    """Return the vertices and faces of what `trimesh` made, or None of anything else.

    Raises
    ------
    ValueError
        If it has no triangles.
    """
    trimesh: Any = sys.modules.get("trimesh")
    if trimesh is None:  # then it has made nothing
        return None
    if isinstance(mesh, trimesh.Scene):
        mesh = _flatten(mesh)
    if isinstance(mesh, trimesh.PointCloud):
        raise ValueError(
            f"mesh: a point cloud of {len(mesh.vertices)} points, where triangles are needed"
        )
    return (mesh.vertices, mesh.faces) if isinstance(mesh, trimesh.Trimesh) else None


def _flatten(scene: trimesh.Scene) -> trimesh.Trimesh:
    import trimesh

    parts = [g for g in scene.dump() if isinstance(g, trimesh.Trimesh)]
    if not parts:
        kinds = sorted({type(g).__name__ for g in scene.geometry.values()})
        raise ValueError(f"mesh: the trimesh.Scene has no triangle meshes, only {kinds}")
    return trimesh.util.concatenate(parts)


class _Broken(Exception):
    """What is wrong with a file."""


def _contents(file: Path, most: int) -> int:
    """Return the bytes that a file holds once it is unpacked, counted up to about `most`."""
    kind = file.suffix.lower()
    if kind not in _ARCHIVES:
        return file.stat().st_size
    if kind == ".zip":
        with zipfile.ZipFile(file) as archive:
            return sum(item.file_size for item in archive.infolist())
    total = 0
    with bz2.open(file) if kind == ".bz2" else gzip.open(file) as stream:
        while total <= most and (part := stream.read(1 << 20)):
            total += len(part)
    return total


def _checked_obj(data: bytes, max_corners: int) -> bytes:
    """Return an OBJ file's text with indices from the end made indices from the start."""
    lines = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").split(b"\n")
    counts = {b"v": 0, b"vt": 0, b"vn": 0}
    face, changed = 0, False
    for number, line in enumerate(lines):
        if line[:1] == b"v":
            word = line.split(None, 1)[0]
            if word in counts:
                counts[word] += 1
            continue
        if line[:1] != b"f" or line[1:2] not in (b" ", b"\t"):
            continue
        corners = line.partition(b"#")[0].split()[1:]
        where = f"face {face} (line {number + 1})"
        face += 1
        if not 3 <= len(corners) <= max_corners:
            raise _Broken(
                f"{where} has {len(corners)} corners, allowed are 3 to max_corners={max_corners}"
            )
        if any(c[:1] == b"0" and not int(c.partition(b"/")[0] or b"0") for c in corners):
            raise _Broken(f"{where} refers to vertex 0, where the first is 1")
        if b"-" in line:
            lines[number] = b"f " + b" ".join(_from_start(c, counts, where) for c in corners)
            changed = True
    return b"\n".join(lines) if changed else data


def _from_start(corner: bytes, counts: dict[bytes, int], where: str) -> bytes:
    """Return a corner's indices of vertex, texture and normal, counted from the start."""
    words = []
    for kind, word in zip(counts, corner.split(b"/"), strict=False):
        try:
            index = int(word) if word or kind == b"v" else None
        except ValueError:
            raise _Broken(f"{where} has a corner that is no integer: {corner!r}") from None
        if index is not None and index < 0:
            index += counts[kind] + 1
            if index < 1:
                what = {b"v": "vertex", b"vt": "texture point", b"vn": "normal"}[kind]
                raise _Broken(
                    f"{where} refers to {what} {word.decode()}, where {counts[kind]} are before it"
                )
        words.append(b"" if index is None else str(index).encode())
    return b"/".join(words)


def _lines(text: bytes) -> list[bytes]:
    return [line for line in (x.partition(b"#")[0].strip() for x in text.split(b"\n")) if line]


def _check_ply(data: bytes) -> None:
    end = re.search(rb"end_header\r?\n", data)
    if end is None:
        return  # the reader says what it is
    header = data[: end.start()]
    if b"format ascii" not in header:
        return  # of binary data the reader knows the length
    elements = re.findall(rb"element\s+(\w+)\s+(\d+)", header)
    wanted = sum(int(count) for _, count in elements)
    rows = [x for x in data[end.end() :].split(b"\n") if x.strip()]
    if len(rows) < wanted:
        raise _Broken(f"it ends too early: {wanted} rows are announced, {len(rows)} are there")
    if elements and elements[-1][0] == b"face" and wanted:
        _check_face(rows[wanted - 1].split(), "the last face")


def _check_off(data: bytes) -> None:
    rows = _lines(data)
    if not rows or not rows[0].upper().endswith(b"OFF"):
        return
    counts = [int(x) for x in rows[1].split()[:2]] if len(rows) > 1 else []
    if len(counts) < 2:
        raise _Broken("it ends before the numbers of vertices and faces")
    wanted = 2 + sum(counts)
    if len(rows) < wanted:
        raise _Broken(f"it ends too early: {wanted} rows are announced, {len(rows)} are there")
    if counts[1]:
        _check_face(rows[wanted - 1].split(), "the last face")


def _check_face(row: list[bytes], what: str) -> None:
    if not row[0].isdigit() or len(row) < 1 + int(row[0]):
        raise _Broken(f"it ends too early: {what} has fewer corners than it announces")


def _check_stl(data: bytes) -> None:
    if data.lstrip()[:5].lower() != b"solid" or b"\0" in data[:512]:
        return  # of binary data the reader knows the length
    text = data.lower()
    if len(re.findall(rb"^\s*endsolid", text, re.M)) < len(re.findall(rb"^\s*solid", text, re.M)):
        raise _Broken("it ends too early: a solid has no end")
    facets, vertices = text.count(b"endfacet"), len(re.findall(rb"^\s*vertex", text, re.M))
    if vertices != 3 * facets:
        raise _Broken(f"it has {facets} facets and {vertices} vertices, where each has three")
