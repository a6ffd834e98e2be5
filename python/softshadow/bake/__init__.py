"""Light and shadow as textures on the things that receive them.

Planar receivers have a texture for each of their polygons, by `Accumulation` or any method that
answers at points; meshes with texture coordinates have one each, by the latter.

Texture coordinates have their origin at the lower left, arrays their first row on top: the texel in
row ``r`` and column ``c`` of an (H, W) texture has its centre at
``u = (c + 1/2) / W, v = 1 - (r + 1/2) / H``.
"""

from softshadow.bake.baking import Bake, bake, bake_layout
from softshadow.bake.textures import BakedTexture, Polygon

__all__ = ["Bake", "BakedTexture", "Polygon", "bake", "bake_layout"]
