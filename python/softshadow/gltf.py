"""glTF files: what `trimesh` does not hand on, their nodes' names and colours as they stand.

`trimesh` reads meshes and places them. It is given the same file with nodes and materials named by
their indices, so that what it returns can be told apart, and without images, which nobody needs
here and which may be missing.
"""

from __future__ import annotations

import json
import struct
from typing import Any, TypeAlias

__all__ = ["Header", "label", "left_out", "look", "part_name", "read_header", "used_nodes"]

Header: TypeAlias = "dict[str, Any]"
"""A file's JSON."""

_MAGIC = b"glTF"
_JSON = 0x4E4F534A
"""Of a binary file's first chunk."""

_TRIANGLES = (4, 5)
"""Modes of primitives that `trimesh` makes triangles of: triangles and strips."""

_UNDERSTOOD = {"KHR_lights_punctual", "KHR_materials_unlit", "KHR_mesh_quantization"}
"""Extensions that a file may require."""


def read_header(data: bytes) -> tuple[Header, bytes | None]:
    """Return a file's JSON, and what follows it in a binary file (None in a text file).

    Raises
    ------
    ValueError
        If it is no JSON, or nodes do not make up trees.
    """
    text, rest = data, None
    if data[:4] == _MAGIC:
        if len(data) < 20:
            raise ValueError("it ends within its header")
        length, kind = struct.unpack_from("<II", data, 12)
        if kind != _JSON or 20 + length > len(data):
            raise ValueError("it ends too early, or does not begin with its JSON")
        text, rest = data[20 : 20 + length], data[20 + length :]
    try:
        header = json.loads(text)
    except RecursionError:
        raise ValueError("its JSON is nested too deeply") from None
    if not isinstance(header, dict):
        raise ValueError("its JSON is no object")
    _check_trees(header)
    return header, rest


def label(header: Header, rest: bytes | None) -> bytes:
    """Return a file whose nodes and materials are named by their indices, without images."""
    plain = {k: v for k, v in header.items() if k not in ("images", "textures", "cameras")}
    nodes = header.get("nodes", [])
    plain["nodes"] = [
        {**{k: v for k, v in node.items() if k not in ("camera", "extras")}, "name": str(i)}
        for i, node in enumerate(nodes)
    ]
    plain["scene"], plain["scenes"] = 0, [{"nodes": _roots(header)}]
    # `trimesh` has UVs of what has a material only, so that all get one.
    count = len(header.get("materials", []))
    plain["materials"] = [{"name": str(i)} for i in range(count + 1)]
    plain["meshes"] = [
        {**mesh, "primitives": [{"material": count, **p} for p in mesh["primitives"]]}
        for mesh in header.get("meshes", [])
    ]
    text = json.dumps(plain).encode()
    if rest is None:
        return text
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIIII", _MAGIC, 2, 20 + len(text) + len(rest), len(text), _JSON)
    return head + text + rest


def used_nodes(header: Header) -> list[int]:
    """Return the nodes of the scene that is shown, in the file's order."""
    nodes, found, left = header.get("nodes", []), [], list(_roots(header))
    while left:
        found.append(left.pop())
        left.extend(nodes[found[-1]].get("children", []))
    return sorted(found)


def part_name(header: Header, node: str | None) -> str | None:
    """Return what a labelled node is called: by its own name, or its mesh's."""
    named = header["nodes"][int(str(node).partition("_")[0])]
    name = named.get("name") or header["meshes"][named["mesh"]].get("name")
    return name if isinstance(name, str) else None


def look(header: Header, material: Any) -> tuple[tuple[float, float, float] | None, float | None]:
    """Return base colour and opacity of a labelled material."""
    index = int(material.name)
    if index >= len(header.get("materials", [])):
        return None, None
    stated = header["materials"][index]
    factor = stated.get("pbrMetallicRoughness", {}).get("baseColorFactor", [1, 1, 1, 1])
    r, g, b, alpha = (float(x) for x in factor)
    mode = stated.get("alphaMode", "OPAQUE")
    if mode == "MASK":
        alpha = float(alpha >= stated.get("alphaCutoff", 0.5))
    return (r, g, b), alpha if mode in ("BLEND", "MASK") else 1.0


def left_out(header: Header) -> list[str]:
    """Return what is in a file, and in no scene of ours; lights and cameras are told elsewhere."""
    found = []
    nodes = header.get("nodes", [])
    shown = used_nodes(header)
    meshes = {nodes[i]["mesh"] for i in shown if "mesh" in nodes[i]}
    used = set()
    for index in sorted(meshes):
        mesh = header["meshes"][index]
        name = called(mesh, "mesh", index)
        for primitive in mesh["primitives"]:
            used.add(primitive.get("material"))
            if primitive.get("mode", 4) not in _TRIANGLES:
                found.append(f"{name} (its points, lines or fans)")
            if primitive.get("targets"):
                found.append(f"{name} (its morph targets)")
            if "COLOR_0" in primitive.get("attributes", {}):
                found.append(f"{name} (its vertex colours)")
    for index, material in enumerate(header.get("materials", [])):
        if index not in used:
            continue
        name = called(material, "material", index)
        if "baseColorTexture" in material.get("pbrMetallicRoughness", {}):
            found.append(f"{name} (its texture)")
        if any(material.get("emissiveFactor", ())):
            found.append(f"{name} (its emission)")
        found += [f"{name} ({x})" for x in material.get("extensions", {}) if x not in _UNDERSTOOD]
    for index in shown:
        name = called(nodes[index], "node", index)
        if "skin" in nodes[index]:
            found.append(f"{name} (its skin)")
        if "EXT_mesh_gpu_instancing" in nodes[index].get("extensions", {}):
            found.append(f"{name} (its GPU instances)")
    found += [called(a, "animation", i) for i, a in enumerate(header.get("animations", []))]
    required = set(header.get("extensionsRequired", ())) - _UNDERSTOOD
    return list(dict.fromkeys(found)) + [f"extension {name}" for name in sorted(required)]


def called(thing: dict[str, Any], kind: str, index: int) -> str:
    """Return how a thing of a file is named in messages."""
    name = thing.get("name")
    return f"{kind} {name!r}" if name else f"{kind} {index}"


def _roots(header: Header) -> list[int]:
    """Return the topmost nodes of the scene that is shown; without scenes, of all."""
    scenes = header.get("scenes")
    if scenes:
        roots: list[int] = scenes[header.get("scene", 0)].get("nodes", [])
        return roots
    nodes = header.get("nodes", [])
    below = {child for node in nodes for child in node.get("children", [])}
    return [i for i in range(len(nodes)) if i not in below]


def _check_trees(header: Header) -> None:
    """Refuse nodes that are reached twice, by two parents or by themselves, and lost meshes."""
    nodes = header.get("nodes", [])
    seen: set[int] = set()
    left = list(_roots(header))
    if nodes and not left and not header.get("scenes"):
        raise ValueError("its nodes are a cycle: each is the child of another")
    while left:
        index = left.pop()
        if not isinstance(index, int) or not 0 <= index < len(nodes):
            raise ValueError(f"it refers to node {index}, where {len(nodes)} are there")
        if index in seen:
            name = called(nodes[index], "node", index)
            raise ValueError(f"{name} has two parents, or is its own ancestor")
        seen.add(index)
        mesh, meshes = nodes[index].get("mesh"), len(header.get("meshes", []))
        if mesh is not None and not 0 <= mesh < meshes:
            name = called(nodes[index], "node", index)
            raise ValueError(f"{name} refers to mesh {mesh}, where {meshes} are there")
        left.extend(nodes[index].get("children", []))
