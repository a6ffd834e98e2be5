"""`bake`: light and shadow as textures on the things that receive them.

Planar receivers have a texture for each of their polygons, by `Accumulation` or any method that
answers at points; meshes with texture coordinates have one each, by the latter.

Texture coordinates have their origin at the lower left, arrays their first row on top: the texel in
row ``r`` and column ``c`` of an (H, W) texture has its centre at
``u = (c + 1/2) / W, v = 1 - (r + 1/2) / H``.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from softshadow import _core, images, kernels
from softshadow.camera import Camera
from softshadow.light import Light
from softshadow.methods import Accumulation, Method, MethodLike, resolve
from softshadow.render import LightLike, Prepared, Progress, _Bar, _lights
from softshadow.scene import Mesh, Scene

__all__ = ["Bake", "BakedTexture", "Polygon", "bake", "bake_layout"]

Side: TypeAlias = Literal["light", "front", "back"]
"""Which side of a polygon is baked."""

_POINT_BYTES = 200
"""Bytes that a texel takes while a method answers at its point: positions, normals, results, and
their copies."""


@dataclass(frozen=True)
class Polygon:
    """A receiver polygon: connected triangles of a mesh in one plane, and their texture's place.

    Attributes
    ----------
    receiver : str
        Name of the scene's entry.
    faces : ndarray, shape (K,), int32
        Its triangles in the mesh.
    uv : ndarray, shape (K, 3, 2), float32
        Texture coordinates of their corners, 0 to 1.
    corner : ndarray, shape (3,), float64
        World position of ``u = v = 0``.
    edges : ndarray, shape (2, 3), float64
        World vectors along which u and v go from 0 to 1.
    normal : ndarray, shape (3,), float64
        Unit normal, towards the side that is baked.
    size : tuple of 2 ints
        Texels along u and along v.
    """

    receiver: str
    faces: npt.NDArray[np.int32]
    uv: npt.NDArray[np.float32]
    corner: npt.NDArray[np.float64]
    edges: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float64]
    size: tuple[int, int]

    def texel_positions(self) -> npt.NDArray[np.float64]:
        """Return the world positions of all texels' centres, shape (H, W, 3)."""
        width, height = self.size
        u = (np.arange(width) + 0.5) / width
        v = 1 - (np.arange(height) + 0.5) / height
        along_u = u[None, :, None] * self.edges[0]
        along_v = v[:, None, None] * self.edges[1]
        positions: npt.NDArray[np.float64] = self.corner + along_u + along_v
        return positions


@dataclass(frozen=True)
class BakedTexture:
    """A texture with its place on a receiver. H by W texels.

    Attributes
    ----------
    receiver : str
        Name of the scene's entry.
    faces : ndarray, shape (K,), int32
        The triangles of its mesh that it covers.
    uv : ndarray, shape (K, 3, 2), float32
        Texture coordinates of their corners.
    visibility : ndarray, shape (H, W) or (L, H, W), float32
        Fraction of the light that is seen; (L, H, W) when the lights are a sequence.
    radiance : ndarray, shape (H, W, 3), float32
        Diffuse direct light, linear RGB, the lights summed, with the ambient term.
    modulation : ndarray, shape (H, W) or (L, H, W), float32 or uint8
        What a modulation texture holds: ``ambient + (1 - ambient) visibility``, or the levels of
        ``Accumulation(texture="eight_bit")``.
    mask : ndarray, shape (H, W), bool
        Whether the texel's centre is on the receiver.
    polygon : Polygon or None
        Where the texture lies, if its receiver is planar.
    """

    receiver: str
    faces: npt.NDArray[np.int32]
    uv: npt.NDArray[np.float32]
    visibility: npt.NDArray[np.float32]
    radiance: npt.NDArray[np.float32]
    modulation: npt.NDArray[np.float32] | npt.NDArray[np.uint8]
    mask: npt.NDArray[np.bool_]
    polygon: Polygon | None

    def save(
        self,
        path: str | os.PathLike[str],
        what: Literal["radiance", "modulation", "visibility"] = "radiance",
        exposure: float | None = None,
    ) -> None:
        """Write one of the arrays as ``.png``, ``.exr`` or ``.npy``; see `softshadow.images.write`.

        Several lights' modulation or visibility, and levels as floats, are written as ``.npy``.
        """
        if what not in ("radiance", "modulation", "visibility"):
            raise ValueError(f"what: expected radiance, modulation or visibility, got {what!r}")
        array = getattr(self, what)
        if array.dtype == np.uint8 and Path(path).suffix.lower() == ".png":
            array = array / np.float32(255)
        images.write(path, array, exposure)


class Bake(Sequence[BakedTexture]):
    """What `bake` returns: a sequence of textures, which `Accumulation` can refine.

    Attributes
    ----------
    method : Method
    samples : int or None
        Light points drawn so far, by `Accumulation`.
    seconds : dict
        Wall-clock seconds: ``prepare``, and ``textures`` for all that was drawn so far.
    bytes : int
        Of all textures' sums (accumulation) or of the points (other methods).
    """

    def __init__(self, job: _Job, method: Method) -> None:
        self._job = job
        self.method = method
        self.seconds = job.seconds
        self.bytes = job.bytes
        self._known: dict[int, BakedTexture] = {}

    @property
    def samples(self) -> int | None:
        """Light points drawn so far, by `Accumulation`."""
        return self._job.samples

    def __len__(self) -> int:
        return len(self._job)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        i = range(len(self))[index]
        if i not in self._known:
            self._known[i] = self._job.texture(i)
        return self._known[i]

    def __iter__(self) -> Iterator[BakedTexture]:
        return (self[i] for i in range(len(self)))

    def of(self, receiver: str) -> list[BakedTexture]:
        """Return the textures of one receiver."""
        found = [self[i] for i in range(len(self)) if self._job.receiver(i) == receiver]
        if not found:
            raise ValueError(f"bake: no textures of {receiver!r}")
        return found

    def refine(self, samples: int | None = None, progress: Progress = False) -> None:
        """Draw more light points; what was drawn stays.

        Twice as many as before keep the stratification: of ``2 n`` points, ``n`` are those of
        ``n``. The result is that of a bake with `samples` from the start, to the bit.

        Parameters
        ----------
        samples : int, optional
            Points in all; twice as many as before when not given.
        progress : bool or callable

        Raises
        ------
        ValueError
            If the method is not `Accumulation`, the points are fewer than there are, or eight bits
            cannot be divided among so many.
        """
        self._job.refine(samples, progress)
        self._known.clear()

    def save(
        self,
        folder: str | os.PathLike[str],
        suffix: str = ".png",
        what: Literal["radiance", "modulation", "visibility"] = "radiance",
        exposure: float | None = None,
    ) -> list[Path]:
        """Write every texture as ``<receiver>_<number><suffix>`` into an existing folder.

        For PNGs of radiance all textures are exposed alike: by `exposure`, or by the one that suits
        the brightest of them.
        """
        if what == "radiance" and exposure is None and suffix.lower() == ".png":
            exposure = min((images.auto_exposure(t.radiance) for t in self), default=1.0)
        written = []
        digits = len(str(max(len(self) - 1, 0)))
        for i, texture in enumerate(self):
            path = Path(folder) / f"{_file_name(texture.receiver)}_{i:0{digits}d}{suffix}"
            texture.save(path, what, exposure)
            written.append(path)
        return written


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name) or "receiver"


class _Job:
    """Something that textures come from."""

    samples: int | None = None
    bytes: int = 0

    def __init__(self) -> None:
        self.seconds = {"prepare": 0.0, "textures": 0.0}

    def __len__(self) -> int:
        raise NotImplementedError

    def receiver(self, i: int) -> str:
        raise NotImplementedError

    def texture(self, i: int) -> BakedTexture:
        raise NotImplementedError

    def refine(self, samples: int | None, progress: Progress) -> None:
        raise ValueError("refine: only accumulation can be refined")


def _polygons(
    scene: Scene,
    lights: Sequence[Light],
    receivers: Sequence[str],
    method: Accumulation,
    side: Side,
    progress: Progress,
) -> tuple[_core.Textures, list[Polygon]]:
    if side not in ("light", "front", "back"):
        raise ValueError(f"side: expected 'light', 'front' or 'back', got {side!r}")
    entries = [scene.names.index(name) for name in receivers]
    with _Bar(progress, "bake: layout") as report:
        core = _core.textures(scene._core, [x._core for x in lights], method, entries, side, report)
    out = []
    for i in range(len(core)):
        raw = core.polygon(i)
        out.append(
            Polygon(
                receiver=scene.names[raw["entry"]],
                faces=raw["faces"],
                uv=raw["uv"],
                corner=np.array(raw["corner"]),
                edges=np.array(raw["edges"]),
                normal=np.array(raw["normal"]),
                size=(raw["size"][0], raw["size"][1]),
            )
        )
    return core, out


def _radiance(
    irradiance: Sequence[npt.NDArray[np.floating[Any]]],
    lights: Sequence[Light],
    entry: Mesh,
    ambient: float,
) -> npt.NDArray[np.float32]:
    albedo = np.asarray(entry.albedo, dtype=np.float64)
    total = np.full((*irradiance[0].shape, 3), ambient, dtype=np.float64)
    for e, light in zip(irradiance, lights, strict=True):
        total += e[..., None] / np.pi * np.asarray(light.radiance, dtype=np.float64)
    return (total * albedo).astype(np.float32)


def _unshadowed(
    light: Light,
    positions: npt.NDArray[np.float64],
    normals: npt.NDArray[np.float64],
    visibility: npt.NDArray[np.float32],
) -> npt.NDArray[np.float64]:
    """Return the closed form of the unshadowed irradiance, times visibility over its part."""
    p, n = positions.reshape(-1, 3), np.ascontiguousarray(normals.reshape(-1, 3))
    part = kernels.light_fraction_above(light, p, n)
    whole = kernels.unshadowed_irradiance(light, p, n)
    ratio = np.divide(visibility.reshape(-1), part, out=np.zeros_like(part), where=part > 0)
    return (whole * ratio).reshape(visibility.shape)


class _Accumulated(_Job):
    def __init__(
        self,
        scene: Scene,
        light: LightLike,
        receivers: Sequence[str],
        method: Accumulation,
        side: Side,
        progress: Progress,
    ) -> None:
        super().__init__()
        self.lights, self.single = _lights(light)
        self.scene, self.method = scene, method
        self.core, self.polygons = _polygons(scene, self.lights, receivers, method, side, progress)
        self.bytes = self.core.bytes
        self.samples = 0
        self._draw(method.samples, progress)

    def __len__(self) -> int:
        return len(self.polygons)

    def receiver(self, i: int) -> str:
        return self.polygons[i].receiver

    def _draw(self, samples: int, progress: Progress) -> None:
        with _Bar(progress, "bake") as report:
            self.seconds["textures"] += self.core.refine(samples, report)
        self.samples = samples

    def refine(self, samples: int | None, progress: Progress) -> None:
        assert self.samples is not None
        wanted = 2 * self.samples if samples is None else int(samples)
        if wanted < self.samples:
            raise ValueError(f"samples: {self.samples} are drawn already, got {wanted}")
        # Checks the number.
        replace(self.method, samples=wanted)._to_core()
        self._draw(wanted, progress)

    def texture(self, i: int) -> BakedTexture:
        polygon, method = self.polygons[i], self.method
        raw = self.core.arrays(i)
        seen = np.stack([r["visibility"] for r in raw])
        if method.texture == "eight_bit":
            modulation = np.stack([r["levels"] for r in raw])
        else:
            # Of a radiance texture, ambient is no level.
            level = method.ambient if method.texture == "modulation" else 0.0
            modulation = (level + (1 - level) * seen.astype(np.float64)).astype(np.float32)
        if method.texture == "radiance":
            irradiance = [r["irradiance"] for r in raw]
        else:
            positions = polygon.texel_positions()
            normals = np.broadcast_to(polygon.normal, positions.shape)
            irradiance = [
                _unshadowed(light, positions, normals, v)
                for light, v in zip(self.lights, seen, strict=True)
            ]
        entry = self.scene._mesh(polygon.receiver)
        ambient = method.ambient if method.texture == "radiance" else 0.0
        return BakedTexture(
            receiver=polygon.receiver,
            faces=polygon.faces,
            uv=polygon.uv,
            visibility=seen[0] if self.single else seen,
            radiance=_radiance(irradiance, self.lights, entry, ambient),
            modulation=modulation[0] if self.single else modulation,
            mask=self.core.mask(i),
            polygon=polygon,
        )


@dataclass(frozen=True)
class _Chart:
    """Texels of a receiver with the points that they stand for; all (H, W)."""

    receiver: str
    faces: npt.NDArray[np.int32]
    uv: npt.NDArray[np.float32]
    positions: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float64]
    mask: npt.NDArray[np.bool_]
    known: npt.NDArray[np.bool_]
    """Which texels have a point."""
    source: npt.NDArray[np.int64] | None
    """Flat index of the texel that each one repeats, if some repeat others."""
    polygon: Polygon | None


class _AtPoints(_Job):
    def __init__(
        self,
        scene: Scene,
        light: LightLike,
        charts: Sequence[_Chart],
        method: Method,
        progress: Progress,
    ) -> None:
        super().__init__()
        self.lights, self.single = _lights(light)
        self.scene, self.charts = scene, charts
        prepared = Prepared(scene, self.lights, method, progress)
        self.seconds["prepare"] = prepared.seconds["prepare"]
        points = [c.positions[c.known] for c in charts]
        normals = [c.normals[c.known] for c in charts]
        self.bytes = _POINT_BYTES * sum(len(p) for p in points)
        start = time.perf_counter()
        seen = prepared.visibility(np.concatenate(points), np.concatenate(normals), progress)
        ends = np.cumsum([len(p) for p in points])[:-1]
        self.seen = np.split(seen, ends, axis=1)
        self.seconds["textures"] = time.perf_counter() - start

    def __len__(self) -> int:
        return len(self.charts)

    def receiver(self, i: int) -> str:
        return self.charts[i].receiver

    def texture(self, i: int) -> BakedTexture:
        chart = self.charts[i]
        seen = np.zeros((len(self.lights), *chart.mask.shape), dtype=np.float32)
        seen[:, chart.known] = self.seen[i]
        irradiance = np.zeros(seen.shape)
        for k, light in enumerate(self.lights):
            irradiance[k][chart.known] = _unshadowed(
                light, chart.positions[chart.known], chart.normals[chart.known], self.seen[i][k]
            )
        radiance = _radiance(list(irradiance), self.lights, self.scene._mesh(chart.receiver), 0.0)
        if chart.source is not None:
            seen = seen.reshape(len(seen), -1)[:, chart.source.ravel()].reshape(seen.shape)
            radiance = radiance.reshape(-1, 3)[chart.source.ravel()].reshape(radiance.shape)
        visibility = seen[0] if self.single else seen
        return BakedTexture(
            receiver=chart.receiver,
            faces=chart.faces,
            uv=chart.uv,
            visibility=visibility,
            radiance=radiance,
            modulation=visibility.copy(),
            mask=chart.mask,
            polygon=chart.polygon,
        )


def _planar_chart(polygon: Polygon, mask: npt.NDArray[np.bool_]) -> _Chart:
    positions = polygon.texel_positions()
    return _Chart(
        receiver=polygon.receiver,
        faces=polygon.faces,
        uv=polygon.uv,
        positions=positions,
        normals=np.broadcast_to(polygon.normal, positions.shape),
        mask=mask,
        # Every texel of the parallelogram, as accumulation has them.
        known=np.ones_like(mask),
        source=None,
        polygon=polygon,
    )


def _unwrapped_chart(
    entry: Mesh, uv: npt.NDArray[np.float64], size: tuple[int, int], padding: int
) -> _Chart:
    """Find the texels that a mesh's triangles cover in its texture, and the points there."""
    width, height = size
    flat = uv.reshape(-1, 2) * [1, -1] + [0, 1]
    # Texels are the pixels of a view of the plane z = 1, in which nothing is nearer.
    plane = np.column_stack([flat * [width, height], np.ones(len(flat))])
    view = Camera.from_matrix(np.eye(3), np.eye(4), width, height)
    corners = np.arange(len(plane)).reshape(-1, 3)
    triangle, _ = kernels.rasterize(plane, corners, view)
    mask = triangle >= 0
    vertices = entry.world_vertices()[entry.faces]
    sides = vertices[:, 1:] - vertices[:, :1]
    cross = np.cross(sides[:, 0], sides[:, 1])
    length = np.linalg.norm(cross, axis=1)
    # A triangle without area has no side to shade.
    mask &= length[np.where(mask, triangle, 0)] > 0
    if not mask.any():
        raise ValueError(
            f"uv of {entry.name!r}: its triangles cover no texel of {width} x {height}"
        )
    rows, columns = np.nonzero(mask)
    face = triangle[mask]
    a, b, c = np.moveaxis(plane.reshape(-1, 3, 3)[face, :, :2], 1, 0)
    centre = np.column_stack([columns, rows]) + 0.5
    e, f, d = b - a, c - a, centre - a
    area = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
    s = (d[:, 0] * f[:, 1] - d[:, 1] * f[:, 0]) / area
    t = (e[:, 0] * d[:, 1] - e[:, 1] * d[:, 0]) / area
    # Rounding may put a centre on an edge beyond it.
    s = np.clip(s, 0, 1)
    t = np.clip(t, 0, 1 - s)
    positions = np.zeros((height, width, 3))
    sides = sides[face]
    positions[mask] = vertices[face, 0] + s[:, None] * sides[:, 0] + t[:, None] * sides[:, 1]
    normals = np.zeros((height, width, 3))
    normals[mask] = cross[face] / length[face, None]
    source = None
    if padding and not mask.all():
        distance, nearest = ndimage.distance_transform_edt(~mask, return_indices=True)
        own = np.indices(mask.shape)
        place = np.where(distance <= padding, nearest, own)
        source = place[0] * width + place[1]
    return _Chart(
        receiver=entry.name,
        faces=np.arange(len(entry.faces), dtype=np.int32),
        uv=uv.astype(np.float32),
        positions=positions,
        normals=normals,
        mask=mask,
        known=mask,
        source=source,
        polygon=None,
    )


def _names(scene: Scene, receivers: str | Sequence[str] | None) -> list[str]:
    if not isinstance(scene, Scene):
        raise TypeError(f"scene: expected softshadow.Scene, got {type(scene).__name__}")
    if receivers is None:
        names = [m.name for m in scene.meshes if m.receives]
        if not names:
            raise ValueError("scene: it has no mesh that receives")
        return names
    names = [receivers] if isinstance(receivers, str) else list(receivers)
    if not names:
        raise ValueError("receivers: expected at least one name")
    for name in names:
        if not scene._mesh(name).receives:
            raise ValueError(f"receivers: mesh {name!r} does not receive (receives=False)")
    return names


def _corner_uv(entry: Mesh, uv: npt.ArrayLike) -> npt.NDArray[np.float64]:
    array = np.asarray(uv, dtype=np.float64)
    if array.shape == (len(entry.vertices), 2):
        array = array[entry.faces]
    if array.shape != (len(entry.faces), 3, 2):
        raise ValueError(
            f"uv of {entry.name!r}: expected shape ({len(entry.vertices)}, 2), one a vertex, or "
            f"({len(entry.faces)}, 3, 2), got {np.shape(uv)}"
        )
    if not np.isfinite(array).all() or array.min() < 0 or array.max() > 1:
        raise ValueError(f"uv of {entry.name!r}: expected numbers from 0 to 1")
    return array


def _layout_method(method: Method, texel: float | None, max_size: int | None) -> Accumulation:
    layout = method if isinstance(method, Accumulation) else Accumulation(samples=1)
    if texel is not None:
        layout = replace(layout, texel=texel)
    return layout if max_size is None else replace(layout, max_size=max_size)


def bake_layout(
    scene: Scene,
    light: LightLike,
    receivers: str | Sequence[str] | None = None,
    method: MethodLike = "accumulation",
    *,
    texel: float | None = None,
    max_size: int | None = None,
    side: Side = "light",
) -> tuple[list[Polygon], int]:
    """Return what `bake` would draw on planar receivers, and its memory, without drawing it.

    Parameters
    ----------
    scene, light, receivers, method, texel, max_size, side
        As in `bake`.

    Returns
    -------
    polygons : list of Polygon
    bytes : int
        Of all textures' sums.

    Raises
    ------
    ValueError
        As `bake`; also if the textures take more than the method's `memory_limit`.
    """
    names = _names(scene, receivers)
    lights, _ = _lights(light)
    layout = _layout_method(resolve(method), texel, max_size)
    core, polygons = _polygons(scene, lights, names, layout, side, False)
    return polygons, core.bytes


def bake(
    scene: Scene,
    light: LightLike,
    receivers: str | Sequence[str] | None = None,
    method: MethodLike = "accumulation",
    *,
    uv: Mapping[str, npt.ArrayLike] | None = None,
    size: int | tuple[int, int] = 512,
    padding: int = 2,
    texel: float | None = None,
    max_size: int | None = None,
    side: Side = "light",
    progress: Progress = False,
) -> Bake:
    """Bake light and shadow into textures.

    Without texture coordinates, every connected set of coplanar triangles of a receiver has a
    texture over the parallelogram around it (Herf and Heckbert 1996). `Accumulation` draws hard
    shadows into it and averages them; other methods answer at the texels' centres.

    Parameters
    ----------
    scene : Scene
    light : light or sequence of lights
    receivers : str or sequence of str, optional
        Names of meshes; all that receive when not given.
    method : str or method
        `Accumulation`, or a method that needs no camera.
    uv : mapping of str to array_like, optional
        Texture coordinates, 0 to 1, of receivers that have their own: shape (V, 2), one a vertex,
        or (F, 3, 2), one a corner of a face. Their textures come from methods that answer at
        points; where triangles overlap in the texture, the first counts.
    size : int or pair of ints
        Width and height of textures with texture coordinates.
    padding : int
        Texels around those that triangles cover that repeat the nearest, so that interpolation
        does not reach what is empty.
    texel, max_size
        Texel size in world units and most texels along a side of planar receivers; those of
        `Accumulation` when not given.
    side : {"light", "front", "back"}
        Which side of planar receivers: the one that more of the lights' centres are on, or the one
        that is wound counterclockwise, or the other. Meshes with `uv` have their front baked.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    Bake

    Raises
    ------
    ValueError
        If a name is unknown or not of a mesh that receives, texture coordinates do not fit, the
        method needs a camera, or the textures take more memory than `Accumulation.memory_limit`.
    """
    chosen = resolve(method)
    names = _names(scene, receivers)
    lights, single = _lights(light)
    own = dict(uv or {})
    for name in own:
        if name not in names:
            raise ValueError(f"uv: {name!r} is not among the receivers {names}")
    layout = _layout_method(chosen, texel, max_size)
    if isinstance(chosen, Accumulation):
        if own:
            raise ValueError(
                "uv: accumulation bakes planar polygons with a layout of their own; bake meshes "
                "with texture coordinates by a method that answers at points, such as ray_traced"
            )
        given: LightLike = lights[0] if single else lights
        return Bake(_Accumulated(scene, given, names, layout, side, progress), layout)
    if not chosen.points:
        raise ValueError(f"method {chosen.name!r} needs a camera and cannot bake")
    width, height = (size, size) if isinstance(size, int) else size
    if not (1 <= width <= 65536 and 1 <= height <= 65536):
        raise ValueError(f"size: expected 1 to 65536 texels a side, got {width} x {height}")
    if padding < 0:
        raise ValueError(f"padding: expected 0 or more, got {padding}")
    unwrapped = {name: _corner_uv(scene._mesh(name), own[name]) for name in own}
    planar = [name for name in names if name not in own]
    core, polygons = (
        _polygons(scene, lights, planar, layout, side, progress) if planar else (None, [])
    )
    texels = sum(p.size[0] * p.size[1] for p in polygons) + len(own) * width * height
    if _POINT_BYTES * texels > layout.memory_limit:
        raise ValueError(
            f"bake: {texels} texels take {_POINT_BYTES * texels / 1e9:.2f} GB, more than "
            f"{layout.memory_limit / 1e9:.2f} GB; a larger texel or a smaller size takes less"
        )
    charts = [_planar_chart(p, core.mask(i)) for i, p in enumerate(polygons) if core is not None]
    for name, corners in unwrapped.items():
        charts.append(_unwrapped_chart(scene._mesh(name), corners, (width, height), padding))
    return Bake(_AtPoints(scene, lights[0] if single else lights, charts, chosen, progress), chosen)
