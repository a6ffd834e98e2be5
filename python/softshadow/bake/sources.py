"""Where baked textures come from: receiver polygons by `Accumulation`, or points of charts.

`softshadow.bake` chooses; a job draws a texture when it is asked for.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from softshadow import _core, kernels
from softshadow.arguments import Bar, Progress
from softshadow.bake.textures import BakedTexture, Polygon, Side
from softshadow.camera import Camera
from softshadow.entries import Mesh, Spheres
from softshadow.extras import needs
from softshadow.light import Light, LightLike, as_lights, strength
from softshadow.methods import Accumulation, Method
from softshadow.render import prepare, shadowed_irradiance
from softshadow.scene import Scene, mesh_of, scene_of

__all__ = [
    "POINT_BYTES",
    "Accumulated",
    "AtPoints",
    "Job",
    "planar_chart",
    "receiver_polygons",
    "unwrapped_chart",
]

POINT_BYTES = 200
"""Bytes that a texel takes while a method answers at its point: positions, normals, results, and
their copies."""


class Job:
    """Something that textures come from."""

    samples: int | None = None
    bytes: int = 0
    entries: dict[str, Mesh]
    """What textures lie on, by name, as it was when the job began."""

    def __init__(self) -> None:
        self.seconds = {"prepare": 0.0, "textures": 0.0}

    def __len__(self) -> int:
        raise NotImplementedError

    def receiver(self, i: int) -> str:
        """Return the name of what texture `i` lies on."""
        raise NotImplementedError

    def texture(self, i: int) -> BakedTexture:
        """Draw texture `i`."""
        raise NotImplementedError

    def refine(self, samples: int | None, progress: Progress) -> None:
        """Raise the number of light points, keeping what was drawn."""
        raise ValueError("refine: only accumulation can be refined")


def receiver_polygons(
    scene: Scene,
    lights: Sequence[Light],
    receivers: Sequence[str],
    method: Accumulation,
    side: Side,
    progress: Progress,
) -> tuple[_core.Textures, list[Polygon]]:
    """Return the textures of planar receivers, undrawn, and where they lie."""
    if side not in ("light", "front", "back"):
        raise ValueError(f"side: expected 'light', 'front' or 'back', got {side!r}")
    entries = [scene.names.index(name) for name in receivers]
    with Bar(progress, "bake: layout") as report:
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
        total += e[..., None] / np.pi * np.asarray(strength(light), dtype=np.float64)
    with np.errstate(over="ignore"):  # found at once
        radiance = (total * albedo).astype(np.float32)
    if not np.all(np.isfinite(radiance)):
        raise _core.ParameterError(
            f"radiance: of {entry.name!r} it overflows single precision, "
            f"{np.finfo(np.float32).max:.3e}; lower the lights' radiance, ambient or the albedo"
        )
    return radiance


class Accumulated(Job):
    """Textures of planar receivers by averaged hard shadows."""

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
        self.lights, self.single = as_lights(light)
        # As they are now: the scene may change before a texture is asked for.
        self.entries, self.method = {name: mesh_of(scene, name) for name in receivers}, method
        self.made_of = (scene.entries, light, tuple(receivers), method, side)
        bar = Bar(progress, "bake")
        with bar:
            self.core, self.polygons = receiver_polygons(
                scene, self.lights, receivers, method, side, bar.part(0, 0.1, "bake: layout")
            )
            self.bytes = self.core.bytes
            self.samples = 0
            self._draw(method.samples, bar.part(0.1, 1, "bake"))

    def __reduce__(self) -> tuple[Any, ...]:
        return _draw_again, (*self.made_of, self.samples)

    def __len__(self) -> int:
        return len(self.polygons)

    def receiver(self, i: int) -> str:
        """Return the name of what texture `i` lies on."""
        return self.polygons[i].receiver

    def _draw(self, samples: int, progress: Progress) -> None:
        with Bar(progress, "bake") as report:
            self.seconds["textures"] += self.core.refine(samples, report)
        self.samples = samples

    def refine(self, samples: int | None, progress: Progress) -> None:
        """Draw up to `samples` light points, twice as many as before by default."""
        assert self.samples is not None
        wanted = 2 * self.samples if samples is None else samples
        wanted = replace(self.method, samples=wanted).samples  # checks it
        if wanted < self.samples:
            raise ValueError(f"samples: {self.samples} are drawn already, got {wanted}")
        self._draw(wanted, progress)

    def texture(self, i: int) -> BakedTexture:
        """Draw texture `i`."""
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
                shadowed_irradiance(light, positions, normals, v)
                for light, v in zip(self.lights, seen, strict=True)
            ]
        entry = self.entries[polygon.receiver]
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


def _draw_again(
    entries: tuple[Mesh | Spheres, ...],
    light: LightLike,
    receivers: tuple[str, ...],
    method: Accumulation,
    side: Side,
    samples: int,
) -> Accumulated:
    """Return the textures on the other side of a process boundary, with as many light points."""
    drawn = replace(method, samples=samples)
    job = Accumulated(scene_of(entries), light, receivers, drawn, side, False)
    job.method, job.made_of = method, (entries, light, receivers, method, side)
    return job


@dataclass(frozen=True, eq=False)
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


class AtPoints(Job):
    """Textures of charts by a method that answers at points."""

    def __init__(
        self,
        scene: Scene,
        light: LightLike,
        charts: Sequence[_Chart],
        method: Method,
        progress: Progress,
    ) -> None:
        super().__init__()
        self.lights, self.single = as_lights(light)
        # As they are now: the scene may change before a texture is asked for.
        self.entries = {c.receiver: mesh_of(scene, c.receiver) for c in charts}
        self.charts = charts
        points = [c.positions[c.known] for c in charts]
        normals = [c.normals[c.known] for c in charts]
        self.bytes = POINT_BYTES * sum(len(p) for p in points)
        bar = Bar(progress, "bake")
        with bar:
            prepared = prepare(scene, self.lights, method, bar.part(0, 0.3, "bake: prepare"))
            self.seconds["prepare"] = prepared.seconds["prepare"]
            start = time.perf_counter()
            every = np.concatenate(points), np.concatenate(normals)
            seen = prepared.visibility(*every, bar.part(0.3, 1, "bake"))
        ends = np.cumsum([len(p) for p in points])[:-1]
        self.seen = np.split(seen, ends, axis=1)
        self.seconds["textures"] = time.perf_counter() - start

    def __len__(self) -> int:
        return len(self.charts)

    def receiver(self, i: int) -> str:
        """Return the name of what texture `i` lies on."""
        return self.charts[i].receiver

    def texture(self, i: int) -> BakedTexture:
        """Draw texture `i`."""
        chart = self.charts[i]
        seen = np.zeros((len(self.lights), *chart.mask.shape), dtype=np.float32)
        seen[:, chart.known] = self.seen[i]
        irradiance = np.zeros(seen.shape)
        for k, light in enumerate(self.lights):
            irradiance[k][chart.known] = shadowed_irradiance(
                light, chart.positions[chart.known], chart.normals[chart.known], self.seen[i][k]
            )
        radiance = _radiance(list(irradiance), self.lights, self.entries[chart.receiver], 0.0)
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


def planar_chart(polygon: Polygon, mask: npt.NDArray[np.bool_]) -> _Chart:
    """Return the chart of a polygon whose texels `mask` covers."""
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


def unwrapped_chart(
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
        with needs("bake", "padding texture coordinates' textures"):
            from scipy import ndimage

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
