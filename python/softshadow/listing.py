"""What can be read of a scene's entries, and which of its meshes are stored once."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from softshadow.entries import Mesh, Spheres, bounds_of

__all__ = ["Listing", "SharedMeshes"]


class Listing:
    """Entries by name, in the order in which they were added."""

    def __init__(self) -> None:
        self._entries: dict[str, Mesh | Spheres] = {}

    @property
    def entries(self) -> tuple[Mesh | Spheres, ...]:
        """All entries, which cannot be changed; an image's ``mesh_id`` indexes this."""
        return tuple(self._entries.values())

    def __getitem__(self, name: str) -> Mesh | Spheres:
        """Return the entry of that name, which cannot be changed.

        Raises
        ------
        ValueError
            If there is none.
        """
        return self._entry(name)

    def __contains__(self, name: object) -> bool:
        return name in self._entries

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    @property
    def names(self) -> tuple[str, ...]:
        """The entries' names, in the order of ``mesh_id``."""
        return tuple(self._entries)

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """The entries that are triangle meshes, curves included."""
        return tuple(e for e in self._entries.values() if isinstance(e, Mesh))

    @property
    def triangle_count(self) -> int:
        """Triangles of all meshes together."""
        return sum(len(m.faces) for m in self.meshes)

    @property
    def bounds(self) -> npt.NDArray[np.float64]:
        """World bounding box, shape (2, 3): lower and upper corner.

        Raises
        ------
        ValueError
            If the scene is empty.
        """
        if not self._entries:
            raise ValueError("scene: it has no meshes or spheres")
        boxes = np.array([bounds_of(entry) for entry in self._entries.values()])
        return np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])

    def _entry(self, name: str) -> Mesh | Spheres:
        entry = self._entries.get(name) if isinstance(name, str) else None
        if entry is None:
            raise ValueError(f"scene: nothing named {name!r}; it has {list(self._entries)}")
        return entry


class SharedMeshes:
    """Meshes of a scene by their contents, so that one that is added again is found.

    Only meshes as they were added: vertices that were moved later keep the connectivity of those
    before them, which the same vertices need not have.
    """

    def __init__(self) -> None:
        self._by_contents: dict[tuple[int, ...], dict[str, Mesh]] = {}
        self._contents: dict[str, tuple[int, ...]] = {}
        self._by_arrays: dict[tuple[int, int], dict[str, Mesh]] = {}

    def find(self, vertices: npt.NDArray[np.float64], faces: npt.NDArray[np.int64]) -> Mesh | None:
        """Return an entry with the same vertices and faces, to the last bit."""
        same = self._by_arrays.get((id(vertices), id(faces)))
        if same:
            return next(iter(same.values()))
        for entry in self._by_contents.get(_contents(vertices, faces), {}).values():
            if _equal(entry.vertices, vertices) and _equal(entry.faces, faces):
                return entry
        return None

    def note(self, entry: Mesh) -> None:
        """Take a mesh in that was added."""
        arrays = (id(entry.vertices), id(entry.faces))
        same = self._by_arrays.setdefault(arrays, {})
        known = next(iter(same.values()), None)
        key = self._contents[known.name] if known else _contents(entry.vertices, entry.faces)
        same[entry.name] = entry
        self._contents[entry.name] = key
        self._by_contents.setdefault(key, {})[entry.name] = entry

    def forget(self, name: str) -> None:
        """Leave a mesh out that is no longer what was added."""
        key = self._contents.pop(name, None)
        if key is None:
            return
        entry = self._by_contents[key].pop(name)
        arrays = (id(entry.vertices), id(entry.faces))
        self._by_arrays[arrays].pop(name)
        if not self._by_arrays[arrays]:
            del self._by_arrays[arrays]
        if not self._by_contents[key]:
            del self._by_contents[key]


def _contents(vertices: npt.NDArray[np.float64], faces: npt.NDArray[np.int64]) -> tuple[int, ...]:
    """Return what equal arrays have in common, and few others."""
    sums = (zlib.crc32(np.ascontiguousarray(array).data) for array in (vertices, faces))
    return (len(vertices), len(faces), *sums)


def _equal(a: npt.NDArray[np.generic], b: npt.NDArray[np.generic]) -> bool:
    """Return whether two arrays have the same bits: 0 and -0 differ."""
    return a is b or (a.shape == b.shape and np.array_equal(a.view(np.int64), b.view(np.int64)))
