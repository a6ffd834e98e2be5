"""The scene: meshes, curves and spheres by name, how they look, whether they cast and receive."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import trimesh

from softshadow import _core
from softshadow.light import RGB, as_rgb

MeshLike: TypeAlias = (
    "trimesh.Trimesh | trimesh.Scene | tuple[npt.ArrayLike, npt.ArrayLike] | str | PathLike[str]"
)
"""What `Scene.add` takes."""


@dataclass
class Mesh:
    """One entry of a scene: a triangle mesh.

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
    """

    name: str
    vertices: npt.NDArray[np.float64]
    faces: npt.NDArray[np.int64]
    transform: npt.NDArray[np.float64]
    albedo: tuple[float, float, float]
    opacity: float
    casts: bool
    receives: bool

    def world_vertices(self) -> npt.NDArray[np.float64]:
        """Return the vertices in world space, shape (V, 3)."""
        rotated: npt.NDArray[np.float64] = self.vertices @ self.transform[:3, :3].T
        return rotated + self.transform[:3, 3]


@dataclass
class Curves(Mesh):
    """One entry of a scene: curves such as hair, and the mesh of tubes that stands for them.

    Attributes
    ----------
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


@dataclass
class Spheres:
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
    albedo: tuple[float, float, float]
    opacity: float
    casts: bool
    receives: bool


def _read(path: str | PathLike[str]) -> trimesh.Trimesh | trimesh.Scene:
    file = Path(path)
    if not file.is_file():
        raise ValueError(f"{file}: no such file")
    try:
        return trimesh.load(file)
    except Exception as error:  # trimesh raises whatever its readers raise
        raise ValueError(f"{file}: cannot be read as a mesh ({error})") from error


class Scene:
    """Meshes, curves and spheres that cast and receive shadows.

    What `render` builds for a scene (adjacency, bounding volume hierarchy) is kept with it, and
    rebuilt or refitted where it changes.
    """

    def __init__(self) -> None:
        self._core = _core.Scene()
        self._entries: dict[str, Mesh | Spheres] = {}

    @classmethod
    def load(cls, path: str | PathLike[str], **options: Any) -> Scene:
        """Return a scene with one file's meshes; `options` go to `add`."""
        scene = cls()
        scene.add(path, **options)
        return scene

    @property
    def entries(self) -> tuple[Mesh | Spheres, ...]:
        """All entries; an image's ``mesh_id`` indexes this."""
        return tuple(self._entries.values())

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
        low, high = [], []
        for entry in self._entries.values():
            if isinstance(entry, Mesh):
                points = entry.world_vertices()[np.unique(entry.faces)]
                low.append(points.min(axis=0))
                high.append(points.max(axis=0))
            else:
                low.append((entry.centers - entry.radii[:, None]).min(axis=0))
                high.append((entry.centers + entry.radii[:, None]).max(axis=0))
        return np.array([np.min(low, axis=0), np.max(high, axis=0)])

    def add(
        self,
        mesh: MeshLike,
        name: str | None = None,
        albedo: RGB = 0.8,
        opacity: float = 1.0,
        casts: bool = True,
        receives: bool = True,
    ) -> str:
        """Add a mesh.

        Vertices at the same position are joined (exactly equal coordinates only, so files that
        repeat a vertex for every face have their neighbourhoods back); nothing else is repaired.

        Parameters
        ----------
        mesh : trimesh.Trimesh, trimesh.Scene, path, or pair of arrays
            A pair is ``(vertices (V, 3) float, faces (F, 3) int)``. A ``trimesh.Scene`` (and a file
            that holds one) is joined to one mesh, its transforms applied.
        name : str, optional
            Must be new; chosen when not given.
        albedo : float or array_like of shape (3,)
            Diffuse reflectance, linear RGB.
        opacity : float
            1 is opaque; below 1, each crossing multiplies transmittance by ``1 - opacity``.
        casts : bool
            False: never an occluder.
        receives : bool
            False: shaded as unshadowed.

        Returns
        -------
        str
            The name.

        Raises
        ------
        ValueError
            If the mesh is empty, has no extent, has coordinates that are not finite or face indices
            out of range, is a point cloud, or an option is out of range.
        TypeError
            If `mesh` is of another type.
        """
        vertices, faces = _arrays(mesh)
        base = name
        if base is None:
            is_path = isinstance(mesh, (str, PathLike))
            base = self._free_name(Path(mesh).stem if is_path else "mesh")  # type: ignore[arg-type]
        rgb = as_rgb(albedo, f"mesh {base!r}: albedo")
        self._core.add_mesh(base, vertices, faces, rgb, float(opacity), bool(casts), bool(receives))
        self._entries[base] = Mesh(
            base, vertices, faces, np.eye(4), rgb, float(opacity), bool(casts), bool(receives)
        )
        return base

    def add_spheres(
        self,
        centers: npt.ArrayLike,
        radii: npt.ArrayLike,
        name: str | None = None,
        albedo: RGB = 0.8,
        opacity: float = 1.0,
        casts: bool = True,
        receives: bool = True,
    ) -> str:
        """Add analytic spheres.

        Parameters
        ----------
        centers : array_like, shape (N, 3) or (3,)
            World units.
        radii : array_like, shape (N,) or a number
            World units, positive.
        name, albedo, opacity, casts, receives
            As in `add`. A ray through a sphere crosses its surface twice.

        Returns
        -------
        str
            The name.

        Raises
        ------
        ValueError
            If shapes do not fit or a value is not finite or not positive.
        """
        c = np.ascontiguousarray(np.atleast_2d(np.asarray(centers, dtype=np.float64)))
        r = np.asarray(radii, dtype=np.float64)
        if c.ndim != 2 or c.shape[1] != 3:
            raise ValueError(f"spheres: expected centers of shape (N, 3), got {c.shape}")
        if r.shape not in ((), (len(c),)):
            raise ValueError(f"spheres: expected {len(c)} radii, got shape {r.shape}")
        r = np.ascontiguousarray(np.broadcast_to(r, (len(c),)))
        base = self._free_name("spheres") if name is None else name
        rgb = as_rgb(albedo, f"spheres {base!r}: albedo")
        self._core.add_spheres(base, c, r, rgb, float(opacity), bool(casts), bool(receives))
        self._entries[base] = Spheres(base, c, r, rgb, float(opacity), bool(casts), bool(receives))
        return base

    def add_curves(
        self,
        points: npt.ArrayLike,
        offsets: npt.ArrayLike,
        radii: npt.ArrayLike,
        opacity: float = 1.0,
        name: str | None = None,
        albedo: RGB = 0.8,
        casts: bool = True,
        receives: bool = True,
        sides: int = 3,
    ) -> str:
        """Add curves, such as hair or grass, given as polylines.

        Each becomes a closed tube of few flat sides (`softshadow.kernels.curve_tubes`), as wide on
        average as a round one, so that every method sees the same body from everywhere. It is a
        mesh like others to `set_transform`; `set_vertices` moves the curves' points.

        Parameters
        ----------
        points : array_like, shape (P, 3)
            World units; one curve after the other. Neighbours on a curve must differ.
        offsets : array_like of int, shape (C + 1,)
            Where curves start in `points`: curve ``c`` has the points ``offsets[c]`` to
            ``offsets[c + 1] - 1``, two or more. The first is 0, the last is ``P``.
        radii : array_like, a number or shape (C,) or (P,)
            Of all, of each curve, or at each point; world units, positive.
        opacity : float
            Of a tube's surface, which a ray through a hair crosses twice, as that of any closed
            body: ``1 - sqrt(1 - o)`` makes a hair that hides ``o`` of the light.
        name, albedo, casts, receives
            As in `add`.
        sides : int
            Flat sides of each tube, 3 to 64.

        Returns
        -------
        str
            The name.

        Raises
        ------
        ValueError
            If shapes do not fit, a curve has fewer than two points or equal neighbours, a value is
            not finite, a radius is not positive, or an option is out of range.
        TypeError
            If offsets are not integers.
        """
        base = self._free_name("curves") if name is None else name
        p, o, r = _curve_arrays(f"curves {base!r}", points, offsets, radii)
        rgb = as_rgb(albedo, f"curves {base!r}: albedo")
        vertices, faces = _core.kernels.curve_tubes(f'curves "{base}"', p, o, r, sides)
        self._core.add_mesh(base, vertices, faces, rgb, float(opacity), bool(casts), bool(receives))
        self._entries[base] = Curves(
            base,
            *(vertices, faces, np.eye(4), rgb, float(opacity), bool(casts), bool(receives)),
            *(p, o, r, int(sides)),
        )
        return base

    def copy(self) -> Scene:
        """Return an independent scene with the same entries, of which nothing is built yet."""
        other = Scene()
        for e in self._entries.values():
            look = (e.name, e.albedo, e.opacity, e.casts, e.receives)
            if isinstance(e, Curves):
                curves = (e.points, e.offsets, e.radii, e.opacity)
                other.add_curves(*curves, e.name, e.albedo, e.casts, e.receives, e.sides)
            elif isinstance(e, Mesh):
                other.add((e.vertices, e.faces), *look)
            else:
                other.add_spheres(e.centers, e.radii, *look)
            if isinstance(e, Mesh) and not np.array_equal(e.transform, np.eye(4)):
                other.set_transform(e.name, e.transform)
        return other

    def set_transform(self, name: str, matrix: npt.ArrayLike) -> None:
        """Place a mesh or curves; its adjacency and the tree's topology are kept.

        Parameters
        ----------
        name : str
            As returned by `add`.
        matrix : array_like, shape (4, 4)
            Object to world; affine, with a last row of ``0 0 0 1``.

        Raises
        ------
        ValueError
            If there is no such mesh, or the matrix is not finite, not affine or singular.
        """
        m = np.ascontiguousarray(np.asarray(matrix, dtype=np.float64))
        if m.shape != (4, 4):
            raise ValueError(f"mesh {name!r}: transform: expected shape (4, 4), got {m.shape}")
        self._core.set_transform(name, m)
        self._mesh(name).transform = m

    def set_vertices(self, name: str, vertices: npt.ArrayLike) -> None:
        """Move a mesh's vertices, keeping its faces, or the points of curves, keeping their radii.

        Parameters
        ----------
        name : str
            As returned by `add` or `add_curves`.
        vertices : array_like, shape (V, 3)
            Object space; as many as before. Vertices that were joined must stay equal. For curves
            their points, shape (P, 3), from which their tubes are made anew.

        Raises
        ------
        ValueError
            If there is no such mesh, the count differs, a coordinate is not finite, or joined
            vertices are torn apart; for curves as `add_curves`.
        """
        v = _as_vertices(vertices)
        entry = self._entries.get(name)
        if isinstance(entry, Curves):
            what = f'curves "{name}"'
            if v.shape != entry.points.shape:
                count, got = len(entry.points), len(v)
                raise ValueError(f"{what}: expected {count} points as before, got {got}")
            tubes, _ = _core.kernels.curve_tubes(what, v, entry.offsets, entry.radii, entry.sides)
            self._core.set_vertices(name, tubes)
            entry.points, entry.vertices = v, tubes
            return
        self._core.set_vertices(name, v)
        self._mesh(name).vertices = v

    def _mesh(self, name: str) -> Mesh:
        entry = self._entries.get(name)
        if not isinstance(entry, Mesh):
            raise ValueError(f"scene: no mesh named {name!r}; it has {list(self._entries)}")
        return entry

    def _free_name(self, base: str) -> str:
        if base not in self._entries:
            return base
        number = 2
        while f"{base}_{number}" in self._entries:
            number += 1
        return f"{base}_{number}"

    def __repr__(self) -> str:
        return f"Scene({', '.join(self._entries)}; {self.triangle_count} triangles)"


def _as_vertices(vertices: npt.ArrayLike) -> npt.NDArray[np.float64]:
    try:
        v = np.array(vertices, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise TypeError(f"mesh: vertices must be numbers ({error})") from None
    if v.ndim != 2 or v.shape[1] != 3:
        raise ValueError(f"mesh: expected vertices of shape (V, 3), got {v.shape}")
    return v


def _curve_arrays(
    what: str, points: npt.ArrayLike, offsets: npt.ArrayLike, radii: npt.ArrayLike
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Return private, contiguous copies of the arrays of curves; the core checks their values."""
    try:
        p = np.array(points, dtype=np.float64, order="C")
        r = np.atleast_1d(np.array(radii, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise TypeError(f"{what}: points and radii must be numbers ({error})") from None
    o = np.asarray(offsets)
    if p.ndim != 2 or p.shape[1] != 3:
        raise ValueError(f"{what}: expected points of shape (P, 3), got {p.shape}")
    if o.ndim != 1:
        raise ValueError(f"{what}: expected offsets of shape (C + 1,), got {o.shape}")
    if o.dtype.kind not in "iu" and o.size:
        raise TypeError(f"{what}: offsets must be integers, got dtype {o.dtype}")
    if r.ndim != 1:
        raise ValueError(f"{what}: expected radii of shape (), (C,) or (P,), got {r.shape}")
    return p, np.array(o, dtype=np.int64), r


def _arrays(mesh: MeshLike) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Return contiguous, private copies of a mesh's vertices and faces."""
    if isinstance(mesh, (str, PathLike)):
        try:
            return _arrays(_read(mesh))
        except ValueError as error:
            if str(error).startswith(str(mesh)):
                raise
            raise ValueError(f"{mesh}: {error}") from None
    if isinstance(mesh, trimesh.Scene):
        mesh = _flatten(mesh)
    if isinstance(mesh, trimesh.PointCloud):
        raise ValueError(
            f"mesh: a point cloud of {len(mesh.vertices)} points, where triangles are needed"
        )
    if isinstance(mesh, trimesh.Trimesh):
        vertices, faces = mesh.vertices, mesh.faces
    elif isinstance(mesh, tuple) and len(mesh) == 2:
        vertices, faces = mesh
    else:
        raise TypeError(
            "mesh: expected trimesh.Trimesh, trimesh.Scene, a path or a pair "
            f"(vertices, faces), got {type(mesh).__name__}"
        )
    f = np.asarray(faces)
    if f.size == 0:
        f = f.reshape(0, 3)
    if f.ndim != 2 or f.shape[1] != 3:
        raise ValueError(f"mesh: expected faces of shape (F, 3), got {f.shape}")
    if f.dtype.kind not in "iu" and f.size:
        raise TypeError(f"mesh: faces must be integers, got dtype {f.dtype}")
    return _as_vertices(vertices), np.array(f, dtype=np.int64, order="C")


def _flatten(scene: trimesh.Scene) -> trimesh.Trimesh:
    parts = [g for g in scene.dump() if isinstance(g, trimesh.Trimesh)]
    if not parts:
        kinds = sorted({type(g).__name__ for g in scene.geometry.values()})
        raise ValueError(f"mesh: the trimesh.Scene has no triangle meshes, only {kinds}")
    return trimesh.util.concatenate(parts)
