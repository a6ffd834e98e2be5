"""Meshes and a scene that several tests share: closed bodies whose geometry is known exactly."""

from __future__ import annotations

import numpy as np
import softshadow as ss

QUAD = np.array([[0, 1, 2], [0, 2, 3]])


def quad(center, edge_u, edge_v):
    """A parallelogram of two triangles; its normal is ``edge_u x edge_v``."""
    c, u, v = (np.asarray(x, dtype=np.float64) for x in (center, edge_u, edge_v))
    return np.array(
        [c - u / 2 - v / 2, c + u / 2 - v / 2, c + u / 2 + v / 2, c - u / 2 + v / 2]
    ), QUAD


def geodesic(n):
    """A unit sphere of ``20 n**2`` outward triangles without seams: ``(vertices, faces)``."""
    golden = (1 + 5**0.5) / 2
    corners = np.array([(0, s, t * golden) for s in (-1, 1) for t in (-1, 1)], dtype=np.float64)
    corners = np.concatenate([np.roll(corners, k, axis=1) for k in range(3)])
    near = np.isclose(np.linalg.norm(corners[:, None] - corners[None], axis=-1), 2.0)
    base = [
        (a, b, c)
        for a in range(12)
        for b in range(a + 1, 12)
        for c in range(b + 1, 12)
        if near[a, b] and near[b, c] and near[a, c]
    ]
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    keep = i + j <= n
    i, j = i[keep], j[keep]
    place = np.full((n + 2, n + 2), -1)
    place[i, j] = np.arange(len(i))
    up = np.stack([place[i, j], place[i + 1, j], place[i, j + 1]], axis=1)[i + j < n]
    down = np.stack([place[i + 1, j], place[i + 1, j + 1], place[i, j + 1]], axis=1)[i + j < n - 1]
    local = np.concatenate([up, down])
    weights = np.stack([n - i - j, i, j], axis=1) / n
    points, faces = [], []
    for number, (a, b, c) in enumerate(base):
        if np.dot(np.cross(corners[b] - corners[a], corners[c] - corners[a]), corners[a]) < 0:
            b, c = c, b
        points.append(weights @ corners[[a, b, c]])
        faces.append(local + number * len(i))
    points = np.concatenate(points)
    # Points on the icosahedron's edges come from two or more faces, apart by rounding only.
    rim = np.flatnonzero(np.tile((weights == 0).any(axis=1), len(base)))
    keys = np.round(points[rim] * 1e9).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    one = np.arange(len(points))
    one[rim] = rim[first][inverse.ravel()]
    used, faces = np.unique(one[np.concatenate(faces)], return_inverse=True)
    vertices = points[used]
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces.reshape(-1, 3)


def bumpy(n, seed=0, height=0.15):
    """A closed body of ``20 n**2`` triangles, star-shaped around the origin; radius 0.7 to 1.3."""
    vertices, faces = geodesic(n)
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(12, 3))
    waves *= rng.uniform(2, 7, size=(12, 1)) / np.linalg.norm(waves, axis=1, keepdims=True)
    noise = np.sin(vertices @ waves.T + rng.uniform(0, 2 * np.pi, 12)).sum(axis=1)
    return vertices * (1 + height * noise / np.abs(noise).max())[:, None], faces


def on_grid(vertices, bits):
    """Vertices on the multiples of ``2**-bits``: sums and multiples of few are exact."""
    return np.round(vertices * 2.0**bits) / 2.0**bits


def is_closed(faces):
    """Whether every directed edge is matched by exactly one in the other direction."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    size = int(faces.max()) + 1
    forward = np.sort(pairs[:, 0] * size + pairs[:, 1])
    backward = np.sort(pairs[:, 1] * size + pairs[:, 0])
    return bool((np.diff(forward) > 0).all() and np.array_equal(forward, backward))


def body_and_leaves():
    """A body over a ground, and leaves whose shadows change from pixel to pixel, as a scene."""
    found = ss.Scene()
    found.add(quad((0, 0, 0), (5, 0, 0), (0, 5, 0)), "ground")
    vertices, faces = bumpy(16, seed=4)
    found.add((vertices * 0.35 + [-0.5, 0, 0.6], faces), "body")
    rng = np.random.default_rng(1)
    for leaf in range(60):
        center = rng.uniform((0.1, -0.4, 0.3), (0.9, 0.4, 1.0))
        found.add(quad(center, *rng.normal(size=(2, 3)) * 0.04), f"leaf {leaf}")
    return found
