"""What a scene's entries hold: meshes, curves and spheres, checked."""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow.arguments import RGB, Triple, as_faces, as_rgb
from softshadow.reading import MAX_BYTES, MAX_CORNERS, from_trimesh, read

if TYPE_CHECKING:
    import trimesh
    from typing_extensions import Self

    from softshadow.scene import Scene

__all__ = [
    "SIDES",
    "Curves",
    "Faces",
    "Look",
    "Mesh",
    "MeshLike",
    "Spheres",
    "Vertices",
    "as_look",
    "as_matrix",
    "as_uv",
    "as_vertices",
    "bounds_of",
    "curve_arrays",
    "kind_of",
    "mesh_arrays",
    "mesh_of",
    "sphere_arrays",
]

MeshLike: TypeAlias = (
    "trimesh.Trimesh | trimesh.Scene | tuple[npt.ArrayLike, npt.ArrayLike] | str | PathLike[str]"
    " | PolyData | TriangleMesh | Mesh"
)
"""What `Scene.add` takes."""


class PolyData(Protocol):
    """A mesh of PyVista, which is known by its attributes."""

    @property
    def points(self) -> Any:
        """Positions, shape (V, 3)."""

    @property
    def is_all_triangles(self) -> Any:
        """Whether no face has more than three corners."""

    @property
    def faces(self) -> Any:
        """Of every face the number of its corners, and these."""

    def triangulate(self) -> Any:
        """Return the same surface made of triangles."""


class TriangleMesh(Protocol):
    """A mesh of Open3D, which is known by its attributes."""

    @property
    def vertices(self) -> Any:
        """Positions, shape (V, 3)."""

    @property
    def triangles(self) -> Any:
        """Vertices of faces, shape (F, 3)."""


SIDES = (3, 64)
"""Flat sides that a curve's tube may have."""

Vertices: TypeAlias = "npt.NDArray[np.float64]"
"""Positions, shape (V, 3)."""

Faces: TypeAlias = "npt.NDArray[np.int64]"
"""Vertices of faces, shape (F, 3)."""

Look: TypeAlias = "tuple[Triple, float, bool, bool]"
"""Albedo, opacity, whether it casts, whether it receives."""


class _Entry:
    """What entries share: they cannot be changed, also after a process boundary."""

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            kept = _frozen_once(value) if isinstance(value, np.ndarray) else value
            object.__setattr__(self, name, kept)


_FROZEN: dict[int, tuple[weakref.ref[Any], npt.NDArray[Any]]] = {}
"""Arrays that are being unpickled, by their ids, and what is kept of each."""


def _frozen_once(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return a frozen copy, the same for entries that share the array, as instances do."""
    key = id(array)
    source, kept = _FROZEN.get(key, (None, None))
    if source is None or kept is None or source() is not array:
        kept = checks.frozen(array)
        _FROZEN[key] = weakref.ref(array, lambda _: _FROZEN.pop(key, None)), kept
    return kept


@dataclass(frozen=True, eq=False)
class Mesh(_Entry):
    """One entry of a scene: a triangle mesh, as it was when the scene was asked for it.

    Its fields and arrays cannot be changed: `Scene.set_vertices`, `Scene.set_transform` and
    `Scene.set_look` change what is in the scene.

    Attributes
    ----------
    name : str
    vertices : ndarray, shape (V, 3), float64
        Object space.
    faces : ndarray, shape (F, 3), int64
    transform : ndarray, shape (4, 4), float64
        Object to world.
    albedo : tuple of 3 floats
    opacity : float
    casts, receives : bool
    uv : ndarray, shape (V, 2), float64, or None
        Texture coordinates of the vertices, where there are any; the origin is at the lower left.
    """

    name: str
    vertices: npt.NDArray[np.float64]
    faces: npt.NDArray[np.int64]
    transform: npt.NDArray[np.float64]
    albedo: Triple
    opacity: float
    casts: bool
    receives: bool
    # Changes no picture, and so no digest of a scene.
    uv: npt.NDArray[np.float64] | None = field(default=None, kw_only=True, compare=False)

    def world_vertices(self) -> npt.NDArray[np.float64]:
        """Return the vertices in world space.

        Returns
        -------
        ndarray, shape (V, 3), float64
        """
        rotated: npt.NDArray[np.float64] = self.vertices @ self.transform[:3, :3].T
        return rotated + self.transform[:3, 3]


@dataclass(frozen=True, eq=False)
class Curves(Mesh):
    """One entry of a scene: curves such as hair, and the mesh of tubes that stands for them.

    Attributes
    ----------
    name, vertices, faces, transform, albedo, opacity, casts, receives, uv
        As of `Mesh`; the vertices and faces are those of the tubes, which have no ``uv``.
    points : ndarray, shape (P, 3), float64
        Object space.
    offsets : ndarray, shape (C + 1,), int64
        Curve ``c`` has the points ``offsets[c]`` to ``offsets[c + 1] - 1``.
    radii : ndarray, shape (1,), (C,) or (P,), float64
    sides : int
        Flat sides of each tube.
    """

    points: npt.NDArray[np.float64]
    offsets: npt.NDArray[np.int64]
    radii: npt.NDArray[np.float64]
    sides: int


@dataclass(frozen=True, eq=False)
class Spheres(_Entry):
    """One entry of a scene: analytic spheres, exact outlines without triangles.

    Attributes
    ----------
    name : str
    centers : ndarray, shape (N, 3), float64
        World space.
    radii : ndarray, shape (N,), float64
    albedo : tuple of 3 floats
    opacity : float
    casts, receives : bool
    """

    name: str
    centers: npt.NDArray[np.float64]
    radii: npt.NDArray[np.float64]
    albedo: Triple
    opacity: float
    casts: bool
    receives: bool


def bounds_of(entry: Mesh | Spheres) -> npt.NDArray[np.float64]:
    """Return an entry's world bounding box, shape (2, 3): lower and upper corner.

    Vertices that no face has do not count.
    """
    if isinstance(entry, Spheres):
        reach = entry.radii[:, None]
        low, high = entry.centers - reach, entry.centers + reach
    else:
        used = np.zeros(len(entry.vertices), dtype=np.bool_)
        used[entry.faces] = True
        low = high = entry.world_vertices()[used]
    return np.array([low.min(axis=0), high.max(axis=0)])


def kind_of(entry: Mesh | Spheres) -> str:
    """Return what messages call an entry."""
    return "mesh" if isinstance(entry, Mesh) else "spheres"


def as_look(what: str, albedo: RGB, opacity: float, casts: bool, receives: bool) -> Look:
    """Return how an entry looks, checked."""
    rgb = as_rgb(albedo, f"{what}: albedo")
    o = checks.number(opacity, f"{what}: opacity", "a number between 0 and 1", finite=False)
    if not 0 <= o <= 1:  # here, since the core would see it rounded to single precision
        got = "NaN" if math.isnan(o) else opacity
        entry = what.replace("'", '"')  # as the core has it
        raise ValueError(f"{entry}: opacity must be between 0 and 1, got {got}")
    flags = checks.flag(casts, f"{what}: casts"), checks.flag(receives, f"{what}: receives")
    return rgb, o, *flags


def as_vertices(vertices: npt.ArrayLike, what: str = "mesh") -> npt.NDArray[np.float64]:
    """Return a private, contiguous copy of vertices; the core checks their values."""
    v = checks.numbers(vertices, f"{what}: vertices", "numbers")
    if v.ndim != 2 or v.shape[1] != 3:
        raise ValueError(f"{what}: expected vertices of shape (V, 3), got {v.shape}")
    return v


def mesh_arrays(
    mesh: MeshLike, max_bytes: int = MAX_BYTES, max_corners: int = MAX_CORNERS
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Return contiguous, private copies of a mesh's vertices and faces."""
    if isinstance(mesh, (str, PathLike)):
        try:
            return mesh_arrays(read(Path(mesh), max_bytes, max_corners).mesh)
        except ValueError as error:
            if str(error).startswith(str(mesh)):
                raise
            raise ValueError(f"{mesh}: {error}") from None
    if isinstance(mesh, Mesh):  # it cannot be changed
        return mesh.vertices, mesh.faces
    arrays = from_trimesh(mesh) or _from_attributes(mesh)
    if arrays is not None:
        vertices, faces = arrays
    elif isinstance(mesh, tuple) and len(mesh) == 2:
        vertices, faces = mesh
    else:
        raise TypeError(
            "mesh: expected trimesh.Trimesh, trimesh.Scene, pyvista.PolyData, "
            "open3d.geometry.TriangleMesh, a path or a pair (vertices, faces), "
            f"got {type(mesh).__name__}"
        )
    v = as_vertices(vertices)
    return v, as_faces(faces, "mesh: faces", len(v))


def _from_attributes(mesh: Any) -> tuple[npt.ArrayLike, npt.ArrayLike] | None:
    """Return the arrays of a mesh of PyVista or Open3D, or None of anything else."""
    if all(hasattr(mesh, name) for name in ("points", "faces", "is_all_triangles", "triangulate")):
        every = mesh.is_all_triangles
        if not (every() if callable(every) else every):  # a method in older versions
            mesh = mesh.triangulate()
        return np.asarray(mesh.points), np.asarray(mesh.faces).reshape(-1, 4)[:, 1:]
    if hasattr(mesh, "vertices") and hasattr(mesh, "triangles"):
        return np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    return None


def as_matrix(matrix: npt.ArrayLike, what: str) -> npt.NDArray[np.float64]:
    """Return a copy of a matrix; the core checks its values."""
    m = checks.numbers(matrix, what)
    if m.shape != (4, 4):
        raise ValueError(f"{what}: expected shape (4, 4), got {m.shape}")
    return m


def as_uv(uv: npt.ArrayLike, what: str, vertices: int) -> npt.NDArray[np.float64]:
    """Return a copy of texture coordinates that cannot be changed."""
    array = checks.numbers(uv, f"{what}: uv", "numbers")
    if array.shape != (vertices, 2):
        raise ValueError(f"{what}: expected uv of shape ({vertices}, 2), got {array.shape}")
    return checks.frozen(array)


def mesh_of(scene: Scene, name: str) -> Mesh:
    """Return a scene's entry that is a mesh, curves included.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    entry = scene[name] if isinstance(name, str) and name in scene else None
    if not isinstance(entry, Mesh):
        raise ValueError(f"scene: no mesh named {name!r}; it has {list(scene)}")
    return entry


def sphere_arrays(
    what: str, centers: npt.ArrayLike, radii: npt.ArrayLike
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return private, contiguous copies; the core checks their values."""
    c = np.atleast_2d(checks.numbers(centers, f"{what}: centers"))
    r = checks.numbers(radii, f"{what}: radii")
    if c.ndim != 2 or c.shape[1] != 3:
        raise ValueError(f"{what}: expected centers of shape (N, 3), got {c.shape}")
    if r.shape not in ((), (len(c),)):
        raise ValueError(f"{what}: expected {len(c)} radii, got shape {r.shape}")
    return c, np.array(np.broadcast_to(r, (len(c),)))


def curve_arrays(
    what: str, points: npt.ArrayLike, offsets: npt.ArrayLike, radii: npt.ArrayLike
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Return private, contiguous copies of the arrays of curves; the core checks their values."""
    p = checks.numbers(points, f"{what}: points", "numbers")
    r = np.atleast_1d(checks.numbers(radii, f"{what}: radii", "numbers"))
    o = checks.indices(offsets, f"{what}: offsets")
    if p.ndim != 2 or p.shape[1] != 3:
        raise ValueError(f"{what}: expected points of shape (P, 3), got {p.shape}")
    if o.ndim != 1:
        raise ValueError(f"{what}: expected offsets of shape (C + 1,), got {o.shape}")
    if r.ndim != 1:
        raise ValueError(f"{what}: expected radii of shape (), (C,) or (P,), got {r.shape}")
    return p, o, r
