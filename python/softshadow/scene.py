"""The scene: meshes, curves and spheres by name, how they look, whether they cast and receive."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from softshadow import _core, checks
from softshadow.arguments import RGB
from softshadow.entries import (
    SIDES,
    Curves,
    Faces,
    Look,
    Mesh,
    MeshLike,
    Spheres,
    Vertices,
    as_look,
    as_matrix,
    as_uv,
    as_vertices,
    curve_arrays,
    kind_of,
    mesh_arrays,
    mesh_of,
    sphere_arrays,
)
from softshadow.listing import Listing, SharedMeshes
from softshadow.reading import MAX_BYTES, MAX_CORNERS

if TYPE_CHECKING:
    from softshadow.parts import UpAxis

__all__ = ["Scene", "mesh_of", "scene_of"]


class Scene(Listing):
    """Meshes, curves and spheres that cast and receive shadows.

    What `render` builds for a scene (adjacency, bounding volume hierarchy) is kept with it, and
    rebuilt or refitted where it changes. Scenes can be pickled; ``copy.copy``, ``copy.deepcopy``
    and `copy` make independent ones. A scene equals itself only, since it can change.

    A mesh that is added again, with the same vertices and faces to the last bit, is stored once:
    the entries are *instances* of it, each with its own look and place. Where more than 4,194,304
    triangles are repeated so, ``hard`` and ``ray_traced`` leave them where they are stored, and
    trace them by a hierarchy of two levels, with the same bits; the other methods need all
    triangles in one list, and refuse.

    Parameters
    ----------
    instances : {"auto", "always", "never"}
        ``"always"``: two levels also where fewer triangles are repeated, for the methods that can.
        ``"never"``: all triangles in one list, however much memory that takes.

    Raises
    ------
    ValueError
        If `instances` is none of these.
    TypeError
        If it is no text.

    Examples
    --------
    >>> import softshadow as ss
    >>> scene = ss.Scene()
    >>> scene.add(ss.scenes.square(2), name="ground")
    'ground'
    >>> scene.add_spheres([(0, 0, 1)], 0.25)
    'spheres'
    >>> scene.names
    ('ground', 'spheres')
    >>> scene["ground"].albedo
    (0.8, 0.8, 0.8)
    >>> scene.bounds.tolist()
    [[-2.0, -2.0, 0.0], [2.0, 2.0, 1.25]]
    """

    def __init__(self, instances: str = "auto") -> None:
        super().__init__()
        self._core = _core.Scene(checks.name_of(instances, "instances"))
        self._instances = instances
        self._shared = SharedMeshes()

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        name: str | None = None,
        albedo: RGB | None = None,
        opacity: float | None = None,
        casts: bool = True,
        receives: bool = True,
        transform: npt.ArrayLike | None = None,
        *,
        parts: bool = True,
        up: UpAxis = "z",
        scale: float = 1.0,
        max_bytes: int = MAX_BYTES,
        max_corners: int = MAX_CORNERS,
    ) -> Scene:
        """Return a scene with one file's meshes.

        Every node of a file and every group becomes an entry of its name, with the base colour,
        opacity, transform and texture coordinates that the file states. What has no name has the
        file's, and names that are taken are numbered. `softshadow.load` reads lights and cameras,
        too, and tells what it leaves out.

        Parameters
        ----------
        path : path
        name : str, optional
            Of the only entry.
        albedo, opacity, casts, receives : optional
            As of `add`, for all entries. Colours of files are taken as linear.
        transform : array_like, shape (4, 4), optional
            Applied to all entries, after `up` and `scale`.
        parts : bool
            False: one entry with all meshes, joined as by `add`, without the file's looks.
        up : {"z", "y"}
            The file's axis that points up; ``"y"`` becomes z, and z becomes -y.
        scale : float
            World units of a unit of the file, positive: 0.001 for millimetres in metres.
        max_bytes, max_corners : int
            As of `add`.

        Returns
        -------
        Scene

        Raises
        ------
        ValueError
            As `add`; if nodes of a file have two parents or are their own ancestors, a transform is
            singular (a scale of 0), or `name` is given for several entries.
        """
        from softshadow.parts import add_parts, placement, read_model

        scene, world = cls(), placement(up, scale, transform)
        look: dict[str, Any] = {"casts": casts, "receives": receives}
        look |= {k: v for k, v in (("albedo", albedo), ("opacity", opacity)) if v is not None}
        limits: dict[str, Any] = {"max_bytes": max_bytes, "max_corners": max_corners}
        if checks.flag(parts, "parts"):
            add_parts(scene, read_model(Path(path), **limits), name, world, look)
        else:
            scene.add(path, name, transform=world, **look, **limits)
        return scene

    @property
    def instances(self) -> str:
        """When meshes that entries share stay instances: ``auto``, ``always`` or ``never``."""
        return self._instances

    def add(
        self,
        mesh: MeshLike,
        name: str | None = None,
        albedo: RGB = 0.8,
        opacity: float = 1.0,
        casts: bool = True,
        receives: bool = True,
        transform: npt.ArrayLike | None = None,
        *,
        uv: npt.ArrayLike | None = None,
        max_bytes: int = MAX_BYTES,
        max_corners: int = MAX_CORNERS,
    ) -> str:
        """Add a mesh. Its arrays are copied: what is done to them later does not matter.

        Vertices at the same position are joined (exactly equal coordinates only, so files that
        repeat a vertex for every face have their neighbourhoods back); nothing else is repaired.

        Parameters
        ----------
        mesh : trimesh.Trimesh, trimesh.Scene, path, pair of arrays, Mesh, or of another package
            A pair is ``(vertices (V, 3) float, faces (F, 3) int)``. A ``trimesh.Scene`` (and a file
            that holds one) is joined to one mesh, its transforms applied; `load` keeps the parts.
            ``pyvista.PolyData`` (polygons are triangulated) and ``open3d.geometry.TriangleMesh``
            are taken, too. An entry, such as ``scene["tree"]``, gives its mesh alone; of the
            same scene it is the fastest way to add an instance.
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
        transform : array_like, shape (4, 4), optional
            As of `set_transform`.
        uv : array_like, shape (V, 2), optional
            Texture coordinates of the vertices, kept for who asks the entry for them.
        max_bytes : int
            Of a path: a file that is larger, or an archive that holds more, is an error before it
            is read. By default 512 MiB.
        max_corners : int
            Of an OBJ file: most corners of a face.

        Returns
        -------
        str
            The name.

        Raises
        ------
        ValueError
            If the mesh is empty, has no extent, has coordinates that are not finite or face indices
            out of range, is a point cloud, or an option is out of range. Of files as of arrays:
            nothing is dropped or repaired on the way.
        TypeError
            If `mesh` is of another type.

        Examples
        --------
        >>> import softshadow as ss
        >>> scene = ss.Scene()
        >>> scene.add(([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]), "leaf", opacity=0.5)
        'leaf'
        >>> scene.triangle_count
        1
        """
        is_path = isinstance(mesh, (str, PathLike))
        vertices, faces = mesh_arrays(mesh, max_bytes, max_corners)
        base = self._new_name(name, Path(mesh).stem if is_path else "mesh")  # type: ignore[arg-type]
        look = as_look(f"mesh {base!r}", albedo, opacity, casts, receives)
        coordinates = None if uv is None else as_uv(uv, f"mesh {base!r}", len(vertices))
        vertices, faces = self._add_mesh(base, vertices, faces, look)
        try:
            placed = np.eye(4) if transform is None else self._place(base, transform)
        except (TypeError, ValueError):
            self._core.remove(base)
            raise
        shape = vertices, faces, checks.frozen(placed)
        self._entries[base] = entry = Mesh(base, *(*shape, *look), uv=coordinates)
        self._shared.note(entry)
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

        Examples
        --------
        >>> import softshadow as ss
        >>> scene = ss.Scene()
        >>> scene.add_spheres([(0, 0, 1), (1, 0, 1)], [0.25, 0.5], albedo=(0.8, 0.2, 0.2))
        'spheres'
        """
        base = self._new_name(name, "spheres")
        c, r = sphere_arrays(f"spheres {base!r}", centers, radii)
        look = as_look(f"spheres {base!r}", albedo, opacity, casts, receives)
        self._core.add_spheres(base, c, r, *look)
        self._entries[base] = Spheres(base, checks.frozen(c), checks.frozen(r), *look)
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

        Examples
        --------
        >>> import softshadow as ss
        >>> scene = ss.Scene()
        >>> scene.add_curves([(0, 0, 0), (0, 0, 1), (1, 0, 0), (1, 0, 1)], [0, 2, 4], 0.01)
        'curves'
        >>> scene["curves"].sides
        3
        """
        base = self._new_name(name, "curves")
        p, o, r = curve_arrays(f"curves {base!r}", points, offsets, radii)
        n = checks.integer(sides, f"curves {base!r}: sides", *SIDES)
        look = as_look(f"curves {base!r}", albedo, opacity, casts, receives)
        vertices, faces = _core.kernels.curve_tubes(f'curves "{base}"', p, o, r, n)
        shape = *self._add_mesh(base, vertices, faces, look), checks.frozen(np.eye(4))
        curves = checks.frozen(p), checks.frozen(o), checks.frozen(r)
        self._entries[base] = entry = Curves(base, *(*shape, *look, *curves, n))
        self._shared.note(entry)
        return base

    def _add_mesh(
        self, name: str, vertices: Vertices, faces: Faces, look: Look
    ) -> tuple[Vertices, Faces]:
        """Add a mesh to the core, or an instance of one; return its arrays, which are kept."""
        like = self._shared.find(vertices, faces)
        if like is not None:
            self._core.add_instance(name, like.name, *look)
            return like.vertices, like.faces
        self._core.add_mesh(name, vertices, faces, *look)
        return checks.frozen(vertices), checks.frozen(faces)

    def copy(self) -> Scene:
        """Return an independent scene with the same entries, of which nothing is built yet.

        Returns
        -------
        Scene
        """
        return scene_of(self.entries, self.instances)

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

        Examples
        --------
        >>> import softshadow as ss
        >>> scene = ss.Scene()
        >>> board = scene.add(ss.scenes.square(1))
        >>> scene.set_transform(board, [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]])
        >>> scene.bounds[:, 2].tolist()
        [5.0, 5.0]
        """
        entry = mesh_of(self, name)
        placed = checks.frozen(self._place(name, matrix))
        self._entries[name] = replace(entry, transform=placed)

    def _place(self, name: str, matrix: npt.ArrayLike) -> npt.NDArray[np.float64]:
        m = as_matrix(matrix, f"mesh {name!r}: transform")
        self._core.set_transform(name, m)
        return m

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

        Examples
        --------
        >>> import softshadow as ss
        >>> scene = ss.Scene()
        >>> vertices, faces = ss.scenes.square(1)
        >>> board = scene.add((vertices, faces))
        >>> scene.set_vertices(board, 2 * vertices)
        >>> scene.bounds[:, 0].tolist()
        [-2.0, 2.0]
        """
        entry = mesh_of(self, name)
        v = as_vertices(vertices, f"mesh {name!r}")
        if isinstance(entry, Curves):
            what, count = f'curves "{name}"', len(entry.points)
            if len(v) != count:
                raise ValueError(f"{what}: expected {count} points as before, got {len(v)}")
            tubes, _ = _core.kernels.curve_tubes(what, v, entry.offsets, entry.radii, entry.sides)
            self._core.set_vertices(name, tubes)
            entry = replace(entry, points=checks.frozen(v))
            v = tubes
        else:
            self._core.set_vertices(name, v)
        self._shared.forget(name)
        self._entries[name] = replace(entry, vertices=checks.frozen(v))

    def set_spheres(
        self, name: str, centers: npt.ArrayLike, radii: npt.ArrayLike | None = None
    ) -> None:
        """Put other spheres in the place of an entry's; how they look is kept.

        Parameters
        ----------
        name : str
            As returned by `add_spheres`.
        centers : array_like, shape (N, 3) or (3,)
            World units; as many as wanted.
        radii : array_like, shape (N,) or a number, optional
            World units, positive; as before when not given.

        Raises
        ------
        ValueError
            If there are no spheres of that name; as `add_spheres`.
        """
        entry = self._entry(name)
        if not isinstance(entry, Spheres):
            raise ValueError(f"mesh {name!r}: expected the name of spheres")
        what = f"spheres {name!r}"
        c, r = sphere_arrays(what, centers, entry.radii if radii is None else radii)
        self._core.set_spheres(name, c, r)
        self._entries[name] = replace(entry, centers=checks.frozen(c), radii=checks.frozen(r))

    def set_look(
        self,
        name: str,
        *,
        albedo: RGB | None = None,
        opacity: float | None = None,
        casts: bool | None = None,
        receives: bool | None = None,
    ) -> None:
        """Change how an entry looks and what it takes part in; what is not given is kept.

        Parameters
        ----------
        name : str
            As returned by `add`, `add_spheres` or `add_curves`.
        albedo, opacity, casts, receives
            As in `add`.

        Raises
        ------
        ValueError
            If there is no such entry, or a value is out of its range.

        Examples
        --------
        >>> import softshadow as ss
        >>> scene = ss.Scene()
        >>> board = scene.add(ss.scenes.square(1))
        >>> scene.set_look(board, opacity=0.25, casts=False)
        >>> scene[board].opacity, scene[board].casts
        (0.25, False)
        """
        e = self._entry(name)
        look = as_look(
            f"{kind_of(e)} {name!r}",
            e.albedo if albedo is None else albedo,
            e.opacity if opacity is None else opacity,
            e.casts if casts is None else casts,
            e.receives if receives is None else receives,
        )
        self._core.set_look(name, *look)
        names = ("albedo", "opacity", "casts", "receives")
        self._entries[name] = replace(e, **dict(zip(names, look, strict=True)))  # type: ignore[arg-type]

    def remove(self, name: str) -> None:
        """Take an entry out of the scene; those after it move up in ``mesh_id``.

        Parameters
        ----------
        name : str
            As returned by `add`, `add_spheres` or `add_curves`.

        Raises
        ------
        ValueError
            If there is no such entry.
        """
        self._entry(name)
        self._core.remove(name)
        self._shared.forget(name)
        del self._entries[name]

    def __copy__(self) -> Scene:
        return self.copy()

    def __deepcopy__(self, memo: dict[int, Any]) -> Scene:
        return self.copy()

    def __reduce__(self) -> tuple[Any, ...]:
        return scene_of, (self.entries, self.instances)

    def _new_name(self, name: str | None, base: str) -> str:
        """Return the name that was given, or a free one; the core refuses one that is taken."""
        if name is not None:
            return checks.name_of(name, "name")
        free, number = base, 1
        while free in self._entries:
            number += 1
            free = f"{base}_{number}"
        return free

    def __repr__(self) -> str:
        return f"Scene({', '.join(self._entries)}; {self.triangle_count} triangles)"

    def _repr_html_(self) -> str:
        from softshadow import showing

        return showing.scene_html(self)


def scene_of(entries: tuple[Mesh | Spheres, ...], instances: str = "auto") -> Scene:
    """Return a scene of its own with these entries."""
    scene = Scene(instances)
    # The first entry with some arrays, which the others are instances of.
    first: dict[tuple[int, int], Mesh] = {}
    for e in entries:
        look = (e.name, e.albedo, e.opacity, e.casts, e.receives)
        if isinstance(e, Curves):
            curves = (e.points, e.offsets, e.radii, e.opacity)
            scene.add_curves(*curves, e.name, e.albedo, e.casts, e.receives, e.sides)
        elif isinstance(e, Mesh):
            arrays = id(e.vertices), id(e.faces)
            scene.add(first.get(arrays, e), *look, uv=e.uv)
            first.setdefault(arrays, mesh_of(scene, e.name))
        else:
            scene.add_spheres(e.centers, e.radii, *look)
        if isinstance(e, Mesh) and not np.array_equal(e.transform, np.eye(4)):
            scene.set_transform(e.name, e.transform)
    return scene
