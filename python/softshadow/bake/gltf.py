"""Baked textures with their triangles as a binary glTF 2.0 file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import trimesh
from trimesh.exchange.gltf import export_glb
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from softshadow import images
from softshadow.bake.textures import BakedTexture
from softshadow.entries import Mesh

__all__ = ["Up", "write_glb"]

Up: TypeAlias = Literal["y", "z"]
"""The axis of a scene that points up."""

_UNLIT = "KHR_materials_unlit"
"""glTF's extension for colours that are shown as they are, without lights."""

_CLAMP = 33071
"""glTF's CLAMP_TO_EDGE: what is beyond a texture's border is not its other side."""

_FROM_Z_UP = np.array([(1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)], dtype=np.float64)
"""Turns z, the scene's up, into glTF's, which is y."""


def write_glb(
    path: Path, pieces: Iterable[tuple[str, Mesh, BakedTexture]], exposure: float, up: Up
) -> None:
    """Write textures with the triangles that they lie on, by name; a mesh and a material each."""
    from PIL import Image as Pixels

    scene = trimesh.Scene()
    for name, entry, texture in pieces:
        levels = np.rint(255 * images.to_srgb(texture.radiance, exposure)).astype(np.uint8)
        material = PBRMaterial(
            name=name,
            baseColorTexture=Pixels.fromarray(levels),
            metallicFactor=0.0,
            roughnessFactor=1.0,
        )
        mesh = _textured(entry, texture, material)
        scene.add_geometry(
            mesh, node_name=name, geom_name=name, transform=_FROM_Z_UP if up == "z" else None
        )
    path.write_bytes(export_glb(scene, include_normals=False, tree_postprocessor=_as_baked))


def _textured(entry: Mesh, texture: BakedTexture, material: PBRMaterial) -> trimesh.Trimesh:
    """Return a texture's triangles, wound counterclockwise as seen from the side it is of."""
    corners = entry.world_vertices()[entry.faces[texture.faces]]
    uv = texture.uv.astype(np.float64)
    if texture.polygon is not None:
        sides = corners[:, 1:] - corners[:, :1]
        away = np.cross(sides[:, 0], sides[:, 1]) @ texture.polygon.normal < 0
        corners[away], uv[away] = corners[away, ::-1], uv[away, ::-1]
    every = np.concatenate([corners, uv], axis=2).reshape(-1, 5)
    # A vertex for each place in the texture: a seam has two at the same place in the world.
    unique, faces = np.unique(every, axis=0, return_inverse=True)
    visual = TextureVisuals(uv=unique[:, 3:], material=material)
    return trimesh.Trimesh(unique[:, :3], faces.reshape(-1, 3), visual=visual, process=False)


def _as_baked(tree: dict[str, Any]) -> None:
    """Say in a glTF tree that light is in the textures already, and that they do not repeat."""
    tree["extensionsUsed"] = [*tree.get("extensionsUsed", []), _UNLIT]
    for material in tree["materials"]:
        material["extensions"] = {_UNLIT: {}}
    tree["samplers"] = [{"wrapS": _CLAMP, "wrapT": _CLAMP}]
    for texture in tree["textures"]:
        texture["sampler"] = 0
