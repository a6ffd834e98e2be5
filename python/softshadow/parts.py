"""The parts of model files: every node or group with its name, look and place."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from softshadow import checks, gltf
from softshadow.entries import as_matrix
from softshadow.reading import MAX_BYTES, MAX_CORNERS, Loaded, from_trimesh, read

if TYPE_CHECKING:
    import trimesh

    from softshadow.scene import Scene

__all__ = ["Model", "Part", "UpAxis", "add_parts", "placement", "read_model"]

UpAxis: TypeAlias = Literal["y", "z"]
"""Which axis of a file points up."""

_Matrix: TypeAlias = "npt.NDArray[np.float64]"


class Part(NamedTuple):
    """A mesh of a file; what the file does not say is None."""

    name: str | None
    vertices: npt.ArrayLike
    faces: npt.ArrayLike
    transform: _Matrix
    albedo: tuple[float, float, float] | None = None
    opacity: float | None = None
    uv: npt.ArrayLike | None = None


class Model(NamedTuple):
    """What a file holds, and what of it no scene can have.

    `nodes` has the world transforms of a glTF file's nodes by index, `header` its JSON.
    """

    file: Path
    parts: list[Part]
    left_out: list[str]
    header: gltf.Header | None = None
    nodes: dict[int, _Matrix] | None = None


def placement(up: str, scale: float, transform: npt.ArrayLike | None = None) -> _Matrix:
    """Return the matrix, shape (4, 4), from a file's coordinates to a world with z up.

    The transform comes last.

    Raises
    ------
    ValueError, TypeError
        If `up` is neither ``"y"`` nor ``"z"``, the scale is not positive, or the transform has
        another shape.
    """
    if up not in ("y", "z"):
        raise ValueError(f"up: expected 'y' or 'z', got {checks.shown(up)}")
    factor = checks.number(scale, "scale", "a positive number")
    if not factor > 0:
        raise ValueError(f"scale: expected a positive number, got {scale}")
    matrix = np.diag([factor, factor, factor, 1.0])
    if up == "y":
        matrix[1:3, 1:3] = [[0.0, -factor], [factor, 0.0]]  # y to z, and z towards the viewer
    return matrix if transform is None else as_matrix(transform, "transform") @ matrix


def read_model(file: Path, max_bytes: int = MAX_BYTES, max_corners: int = MAX_CORNERS) -> Model:
    """Return a file's parts, in its own order and coordinates.

    Options are those of `Scene.add`.

    Raises
    ------
    ValueError
        As `softshadow.reading.read`, or if it has no triangles.
    """
    loaded = read(file, max_bytes, max_corners, parts=True)
    left_out = [f"texture {name!r}" for name in loaded.textures]
    try:
        model = _model(file, loaded, left_out)
    except (AttributeError, KeyError, IndexError, TypeError, ValueError) as error:
        told = f"no {error}" if isinstance(error, KeyError) else error
        raise ValueError(f"{file}: its nodes or materials cannot be read ({told})") from None
    if not model.parts:
        only = f", only {', '.join(model.left_out)}" if model.left_out else ""
        raise ValueError(f"{file}: it has no triangle meshes{only}")
    return model


def _model(file: Path, loaded: Loaded, left_out: list[str]) -> Model:
    header = loaded.header
    found: list[Part] = []
    for node, transform, mesh in _placed(loaded.mesh, file.suffix.lower(), header is not None):
        arrays = None if type(mesh).__name__ == "PointCloud" else from_trimesh(mesh)
        if arrays is None:
            if header is None:  # or `gltf.left_out` tells
                left_out.append(f"{node or file.name} ({type(mesh).__name__})")
            continue
        material = getattr(mesh.visual, "material", None)
        name = node if header is None else gltf.part_name(header, node)
        look = _look(material) if header is None else gltf.look(header, material)
        uv = getattr(mesh.visual, "uv", None)
        if uv is not None and np.shape(uv) != (len(mesh.vertices), 2):
            uv = None
        if header is None and getattr(mesh.visual, "kind", None) in ("vertex", "face"):
            left_out.append(f"{node or file.name} (its {mesh.visual.kind} colours)")
        found.append(Part(name, *arrays, transform, *look, uv))
    if header is None:
        return Model(file, found, left_out)
    nodes = {i: loaded.mesh.graph.get(str(i))[0] for i in gltf.used_nodes(header)}
    return Model(file, found, gltf.left_out(header), header, nodes)


def add_parts(
    scene: Scene, model: Model, name: str | None, world: _Matrix, look: dict[str, Any]
) -> None:
    """Add a file's parts to a scene, placed in the world; `look` goes before what they state.

    Raises
    ------
    ValueError
        As `Scene.add`, or if several parts are to have one name.
    """
    if name is not None and len(model.parts) > 1:
        raise ValueError(
            f"name: {model.file} has {len(model.parts)} parts, which have names of their own; "
            "parts=False joins them"
        )
    for part in model.parts:
        stated = {k: v for k in ("albedo", "opacity") if (v := getattr(part, k)) is not None}
        called = name or scene._new_name(None, part.name or model.file.stem)
        if not np.all(np.isfinite(part.transform)):  # a product would spread what is not
            raise ValueError(f"{model.file}: mesh {called!r}: its transform is not finite")
        arrays, placed = (part.vertices, part.faces), world @ part.transform
        try:
            scene.add(arrays, called, transform=placed, uv=part.uv, **{**stated, **look})
        except ValueError as error:
            raise ValueError(f"{model.file}: {error}") from None


def _placed(
    mesh: trimesh.Trimesh | trimesh.Scene, kind: str, labelled: bool
) -> Iterator[tuple[str | None, _Matrix, Any]]:
    """Yield the nodes that have geometry, in the file's order, with their world transforms."""
    if not hasattr(mesh, "graph"):
        yield None, np.eye(4), mesh
        return
    nodes = list(mesh.graph.nodes_geometry)
    if labelled:
        nodes.sort(key=lambda node: int(node.partition("_")[0]))
    elif kind == ".obj":
        nodes.reverse()  # `trimesh` begins at the end
    names = dict(zip(nodes, nodes, strict=True))
    if kind == ".obj":  # objects and groups of several materials are named after these, too
        materials = (getattr(mesh.geometry[mesh.graph[n][1]].visual, "material", 0) for n in nodes)
        ends = [f"_{getattr(material, 'name', None)}" for material in materials]
        if all(node.endswith(end) for node, end in zip(nodes, ends, strict=True)):
            names = {n: n.removesuffix(end) for n, end in zip(nodes, ends, strict=True)}
    for node in nodes:
        transform, geometry = mesh.graph[node]
        yield names[node], np.asarray(transform, dtype=np.float64), mesh.geometry[geometry]


def _look(material: Any) -> tuple[tuple[float, float, float] | None, float | None]:
    """Return the colour and the opacity that a material of `trimesh` states."""
    stated = getattr(material, "kwargs", None)
    if not isinstance(stated, dict):
        return None, None
    # As they stand in an OBJ's material file; `trimesh` rounds its own colours to eight bits.
    albedo = opacity = None
    kd = np.atleast_1d(stated.get("kd", ()))
    if kd.shape in ((1,), (3,)):
        r, g, b = (float(x) for x in np.broadcast_to(kd, (3,)))
        albedo = r, g, b
    for key, sign in (("d", 1.0), ("tr", -1.0)):
        number = " ".join(map(str, stated.get(key, ())))
        if re.fullmatch(r"[-+.\deE]+", number):
            opacity = float(number) if sign > 0 else 1.0 - float(number)
            break
    return albedo, opacity
