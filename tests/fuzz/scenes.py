"""Cases from a seed: what tends to go wrong in shadows, rather than what scenes look like.

Coplanar and parallel sheets, things that touch, one ulp off, degenerate and duplicate triangles,
slivers, lights flush with walls, in housings and far away, cameras in things and on them, tiny
things on huge grounds.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import softshadow as ss

QUAD = [(0, 1, 2), (0, 2, 3)]
BOX = [(0, 1, 2), (2, 1, 3), (4, 6, 5), (5, 6, 7), (0, 4, 1), (1, 4, 5), (2, 3, 6), (6, 3, 7)]
BOX += [(0, 2, 4), (4, 2, 6), (1, 5, 3), (3, 5, 7)]


@dataclass(frozen=True)
class Item:
    """An entry of a scene: a mesh, spheres or curves, by the arguments that add it."""

    kind: str
    arrays: tuple[Any, ...]
    look: dict[str, Any] = field(default_factory=dict)

    def add_to(self, scene, scale=1.0):
        first, *rest = (np.asarray(a) for a in self.arrays)
        if self.kind == "mesh":
            scene.add((first * scale, rest[0]), **self.look)
        elif self.kind == "spheres":
            scene.add_spheres(first * scale, rest[0] * scale, **self.look)
        else:
            scene.add_curves(first * scale, rest[0], rest[1] * scale, **self.look)


@dataclass(frozen=True)
class Lamp:
    """A light by its class and lengths; ``direction`` is the normal of a disk."""

    kind: str
    lengths: tuple[Any, ...]
    direction: tuple[float, float, float] = (0.0, 0.0, -1.0)

    def light(self, scale=1.0):
        center, *rest = (np.asarray(a, dtype=np.float64) * scale for a in self.lengths)
        if self.kind == "rect":
            return ss.RectLight(center, *rest)
        if self.kind == "disk":
            return ss.DiskLight(center, self.direction, float(rest[0]))
        return ss.SphereLight(center, float(rest[0]))


@dataclass(frozen=True)
class Case:
    """A scene, its lights and a camera; ``tags`` say what is special about it."""

    seed: int
    tags: frozenset[str]
    items: tuple[Item, ...]
    lamps: tuple[Lamp, ...]
    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float]
    fov: float
    size: tuple[int, int] = (24, 18)

    def scene(self, scale=1.0, ghost=None):
        """The scene; entry ``ghost`` casts no shadows."""
        scene = ss.Scene()
        for k, item in enumerate(self.items):
            shown = replace(item, look={**item.look, "casts": False}) if k == ghost else item
            shown.add_to(scene, scale)
        return scene

    def camera(self, scale=1.0):
        eye, target = (np.asarray(p) * scale for p in (self.eye, self.target))
        return ss.Camera(eye, target, self.up, self.fov, *self.size)

    def lights(self, scale=1.0):
        return [lamp.light(scale) for lamp in self.lamps]

    def triangles(self):
        return sum(len(i.arrays[1]) for i in self.items if i.kind == "mesh")


def sheet(z, s, center=(0.0, 0.0)):
    """A square of half side ``s`` at height ``z``, turned upwards."""
    x, y = center
    corners = [(x - s, y - s, z), (x + s, y - s, z), (x + s, y + s, z), (x - s, y + s, z)]
    return np.array(corners, dtype=np.float64)


def box(low, high):
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    return np.array([np.where([k & 1, k & 2, k & 4], high, low) for k in range(8)])


class _Maker:
    def __init__(self, seed):
        self.r = np.random.default_rng([17, seed])
        self.tags: set[str] = set()
        self.items: list[Item] = []
        self.lamps: list[Lamp] = []

    def chance(self, p):
        return self.r.random() < p

    def mesh(self, vertices, faces, **look):
        if self.chance(0.1):
            look["opacity"] = float(self.r.choice([0.0, 0.3, 0.5, 0.9]))
            self.tags.add("transparent")
        self.items.append(Item("mesh", (vertices, np.asarray(faces)), look))

    def ground(self, size=2.0):
        self.mesh(sheet(0.0, size), QUAD)

    def lamp(self, z=4.0):
        r = self.r
        at = np.array([r.uniform(-0.5, 0.5), r.uniform(-0.5, 0.5), z]) * (
            1 if self.chance(0.6) else 0.5
        )
        size = float(r.choice([0.0, 1e-3, 0.1, 0.4, 1.0], p=[0.05, 0.1, 0.25, 0.4, 0.2]))
        kind = str(r.choice(["rect", "disk", "sphere"]))
        if size == 0.0:
            self.tags.add("point light")
            kind = "sphere" if kind == "rect" else kind
        if kind == "rect":
            edges = (0, size, 0), (size, 0, 0)
            if self.chance(0.2):
                edges = (0.1 * size, size, 0), (0.2 * size, 0, 0.1 * size)
            self.lamps.append(Lamp("rect", (tuple(at), *edges)))
        elif kind == "disk":
            tilt = (0, 0, -1) if self.chance(0.6) else (*(r.normal(size=2) * 0.5), -1.0)
            self.lamps.append(Lamp("disk", (tuple(at), size), tilt))
        else:
            self.lamps.append(Lamp("sphere", (tuple(at), size)))

    # Kinds of scenes, each with its lamp.

    def soup(self):
        n = int(self.r.choice([1, 3, 20, 100]))
        points = self.r.normal(size=(3 * n, 3)) * [0.7, 0.7, 0.3] + [0, 0, 0.8]
        if self.chance(0.4):
            points = np.round(points * 4) / 4
            self.tags.add("grid")
        if self.chance(0.3):
            points[::3] = points[1::3] + 1e-4 * self.r.normal(size=(n, 3))
            self.tags.add("slivers")
        faces = np.arange(3 * n).reshape(n, 3)
        if self.chance(0.3):
            extra = [(0, 0, 1), (0, 1, 2), (0, 1, 2)]
            faces = np.concatenate([faces, extra])
            self.tags.add("degenerate")
        self.ground()
        self.mesh(points, faces)
        self.lamp()

    def boxes(self):
        self.ground()
        for _ in range(int(self.r.integers(1, 4))):
            x, y = self.r.uniform(-0.7, 0.7, 2)
            low = float(self.r.choice([0.0, 0.0, 1e-7, -1e-7, 0.3]))
            s, h = self.r.uniform(0.05, 0.4), self.r.uniform(0.05, 1.0)
            if low != 0.3:
                self.tags.add("touching")
            self.mesh(box((x - s, y - s, low), (x + s, y + s, low + h)), BOX)
        self.lamp()

    def sheets(self):
        """Parallel boards over a ground, some of them in one plane or an ulp apart."""
        self.tags.add("parallel")
        self.ground()
        z = float(self.r.choice([0.25, 0.5, 1.0, 1.5]))
        for _ in range(int(self.r.integers(1, 5))):
            self.mesh(sheet(z, self.r.uniform(0.1, 0.8), self.r.uniform(-0.4, 0.4, 2)), QUAD)
            z = float(
                self.r.choice([z, np.nextafter(z, 9), np.float32(z) * (1 + 2.0**-23), z + 0.1])
            )
        self.lamp()

    def slit(self):
        gap = float(self.r.choice([0.2, 0.05, 0.01]))
        self.tags.add("slit")
        self.ground()
        for side in (-1, 1):
            self.mesh(sheet(1.0, 0.5, (side * (0.5 + gap / 2), 0.0)), QUAD)
        self.lamps.append(Lamp("rect", ((0, 0, 2), (0, 0.2, 0), (0.2, 0, 0))))

    def room(self):
        """A closed room with the light flush in its ceiling, or an ulp off."""
        self.tags |= {"closed", "flush"}
        self.mesh(box((-1, -1, 0), (1, 1, 2)), BOX)
        self.mesh(sheet(1.0, 0.3), QUAD)
        z = float(self.r.choice([2.0, np.nextafter(2.0, 0), np.float32(2) * (1 - 2.0**-23), 1.9]))
        if self.chance(0.5):
            self.lamps.append(Lamp("rect", ((0, 0, z), (0, 0.5, 0), (0.5, 0, 0))))
        else:
            self.lamps.append(Lamp("disk", ((0.1, 0, z), 0.3)))

    def housing(self):
        """A lamp with walls next to it."""
        self.tags.add("housing")
        self.ground()
        self.mesh(sheet(0.5, 0.3), QUAD)
        walls = box((-0.5, -0.5, 1.8), (0.5, 0.5, 2.2))
        # Without its bottom, or a single side.
        self.mesh(walls, BOX[2:] if self.chance(0.7) else BOX[4:6])
        self.lamps.append(Lamp("rect", ((0, 0, 2), (0, 0.2, 0), (0.2, 0, 0))))

    def round_things(self):
        self.ground()
        n = int(self.r.integers(1, 5))
        centers = self.r.uniform(-0.8, 0.8, (n, 3)) * [1, 1, 0.4] + [0, 0, 0.8]
        self.tags.add("spheres")
        self.items.append(Item("spheres", (centers, self.r.uniform(0.05, 0.4, n))))
        if self.chance(0.5):
            self.tags.add("curves")
            points = np.cumsum(self.r.normal(size=(12, 3)) * 0.2, axis=0) + np.array([0, 0, 1])
            self.items.append(Item("curves", (points, [0, 5, 12], [0.02])))
        self.lamp()

    def huge_ground(self):
        size = float(10.0 ** self.r.integers(2, 7))
        self.tags.add("huge ground")
        self.ground(size)
        self.mesh(box((-0.3, -0.3, 0), (0.3, 0.3, 0.6)), BOX)
        self.lamp()

    def far_light(self):
        """A disk of the sun's angle, or a sphere, scene sizes away."""
        distance = float(10.0 ** self.r.integers(1, 13))
        self.tags.add("far light")
        self.ground(1.0)
        self.mesh(sheet(0.5, 0.5), QUAD)
        direction = np.array([*(self.r.normal(size=2) * 0.2), 1.0])
        at, radius = tuple(direction * distance), 0.0046 * distance
        if self.chance(0.7):
            self.lamps.append(Lamp("disk", (at, radius), tuple(-direction)))
        else:
            self.lamps.append(Lamp("sphere", (at, radius)))

    def look(self):
        """A camera: mostly from aside, sometimes in things, exactly on them, or at them edge-on."""
        r = self.r
        target = np.array([*r.uniform(-0.3, 0.3, 2), 0.3])
        where = str(r.choice(["aside", "above", "inside", "on"], p=[0.55, 0.2, 0.15, 0.1]))
        eye = np.array([*(r.choice([-1, 1], 2) * r.uniform(1, 2.5, 2)), r.uniform(0.5, 2.5)])
        if where == "above":
            eye = np.array([0.01, 0.02, 3.0])
        elif where == "inside":
            eye = np.array([*r.uniform(-0.6, 0.6, 2), r.uniform(0.1, 0.9)])
        elif where == "on":
            self.tags.add("eye on surface")
            eye[2] = float(r.choice([0.0, 1e-9, -1e-9]))
        if "closed" in self.tags:
            eye = np.array([*r.uniform(-0.9, 0.9, 2), r.uniform(0.2, 1.7)])
        return eye, target


KINDS = {
    "soup": _Maker.soup,
    "boxes": _Maker.boxes,
    "sheets": _Maker.sheets,
    "slit": _Maker.slit,
    "room": _Maker.room,
    "housing": _Maker.housing,
    "round": _Maker.round_things,
    "huge": _Maker.huge_ground,
    "far": _Maker.far_light,
}


def rotation(r):
    """A random rotation."""
    q, _ = np.linalg.qr(r.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def make(seed: int) -> Case:
    """The case of a seed."""
    m = _Maker(seed)
    kind = list(KINDS)[
        int(m.r.choice(len(KINDS), p=[0.16, 0.14, 0.14, 0.08, 0.1, 0.08, 0.12, 0.08, 0.1]))
    ]
    KINDS[kind](m)
    m.tags.add(kind)
    if m.chance(0.3):
        m.lamp()
    if m.chance(0.15):
        k = int(m.r.integers(len(m.items)))
        m.items[k] = replace(m.items[k], look={**m.items[k].look, "receives": False})
        m.tags.add("unshadowed")
    eye, target = m.look()
    case = Case(
        seed,
        frozenset(m.tags),
        tuple(m.items),
        tuple(m.lamps),
        tuple(eye),
        tuple(target),
        (0.0, 0.0, 1.0),
        float(m.r.choice([30.0, 50.0, 100.0])),
    )
    if m.chance(0.25):
        case = moved(case, rotation(m.r) if m.chance(0.7) else np.eye(3), m.r)
    return case


def moved(case: Case, turn, r) -> Case:
    """The case turned, scaled and moved by up to ten thousand times its size."""
    scale = float(r.choice([1.0, 1e-3, 1e3, 3.7]))
    offset = r.normal(size=3) * float(r.choice([0.0, 1.0, 1e4])) * scale

    def point(p):
        return np.asarray(p, dtype=np.float64) @ turn.T * scale + offset

    def item(i):
        first, *rest = i.arrays
        if i.kind == "spheres":
            rest = [np.asarray(rest[0]) * scale]
        elif i.kind == "curves":
            rest = [rest[0], np.asarray(rest[1]) * scale]
        return replace(i, arrays=(point(first), *rest))

    def lamp(x):
        center, *rest = x.lengths
        sizes = tuple(
            np.asarray(v, dtype=np.float64) @ turn.T * scale if np.ndim(v) else v * scale
            for v in rest
        )
        return Lamp(
            x.kind, (point(center), *sizes), tuple(turn @ np.asarray(x.direction, dtype=np.float64))
        )

    return replace(
        case,
        tags=case.tags | {"moved"},
        items=tuple(item(i) for i in case.items),
        lamps=tuple(lamp(x) for x in case.lamps),
        eye=tuple(point(case.eye)),
        target=tuple(point(case.target)),
        up=tuple(turn @ np.asarray(case.up)),
    )
