"""glTF files by `trimesh`, with their JSON changed."""

from __future__ import annotations

import json
import struct


def glb(scene, change):
    """Return a scene as a binary file, its JSON changed by a function."""
    data = scene.export(file_type="glb")
    size = int.from_bytes(data[12:16], "little")
    header, binary = json.loads(data[20 : 20 + size]), data[20 + size :]
    change(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII", b"glTF", 2, 20 + len(text) + len(binary), len(text))
    return head + b"JSON" + text + binary
