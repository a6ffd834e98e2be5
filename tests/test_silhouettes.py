"""Silhouette loops of meshes whose outline is known."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import softshadow as ss

SHEET = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
SHEET_FACES = [(0, 1, 2), (0, 2, 3)]


def _rotated(loop):
    """A loop's vertices from its lowest on."""
    return np.roll(loop, -int(np.argmin(loop))).tolist()


def _directed(loops):
    """How often loops use each directed edge."""
    ends = [np.stack([loop, np.roll(loop, -1)], axis=1) for loop in loops]
    edges, counts = np.unique(np.concatenate(ends), axis=0, return_counts=True)
    return {tuple(e): int(n) for e, n in zip(edges.tolist(), counts, strict=True)}


def _one_sided(faces, size):
    """By how much triangles use a directed edge more often than its reverse, where they do."""
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2).astype(np.int64)
    edges, counts = np.unique(ends @ (size, 1), return_counts=True)
    a, b = edges // size, edges % size
    place = np.minimum(np.searchsorted(edges, b * size + a), len(edges) - 1)
    layers = counts - np.where(edges[place] == b * size + a, counts[place], 0)
    more = layers > 0
    pairs = zip(a[more].tolist(), b[more].tolist(), strict=True)
    return dict(zip(pairs, layers[more].tolist(), strict=True))


def test_a_cube_has_one_loop_counter_clockwise():
    corners = np.array([(i & 1, i >> 1 & 1, i >> 2) for i in range(8)], dtype=np.float64)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    (square,) = ss.kernels.silhouette_loops(corners, faces, (0.5, 0.5, 5))
    assert _rotated(square) == [4, 5, 7, 6]
    (hexagon,) = ss.kernels.silhouette_loops(corners, faces, (5, 6, 7))
    assert _rotated(hexagon) == [1, 3, 2, 6, 4, 5]
    # Inside out, the layers change places and the outline stays.
    turned = [t[::-1] for t in faces]
    (same,) = ss.kernels.silhouette_loops(corners, turned, (0.5, 0.5, 5))
    assert _rotated(same) == [4, 5, 7, 6]


def test_an_open_sheet_is_on_the_left_of_its_boundary_from_both_sides():
    (above,) = ss.kernels.silhouette_loops(SHEET, SHEET_FACES, (0.5, 0.5, 1))
    (below,) = ss.kernels.silhouette_loops(SHEET, SHEET_FACES, (0.5, 0.5, -1))
    assert _rotated(above) == [0, 1, 2, 3]
    assert _rotated(below) == [0, 3, 2, 1]
    assert ss.kernels.silhouette_loops(SHEET, SHEET_FACES, (5, 0.5, 0)) == []


def test_a_doubled_sheet_has_its_loop_twice():
    one, two = ss.kernels.silhouette_loops(SHEET, SHEET_FACES * 2, (0.5, 0.5, 1))
    assert _rotated(one) == _rotated(two) == [0, 1, 2, 3]


def test_three_sheets_at_one_edge_each_add_their_layer():
    # Two sheets to the right of the edge from 0 to 1 as the point above sees it, one to its left.
    vertices = [(0, 0, 0), (0, 1, 0), (1, 0, -1), (1, 0, -2), (-1, 0, -1)]
    faces = [(0, 2, 1), (0, 3, 1), (0, 1, 4)]
    loops = ss.kernels.silhouette_loops(vertices, faces, (0, 0.5, 9))
    used = _directed(loops)
    assert used == {(1, 0): 1, (0, 2): 1, (2, 1): 1, (0, 3): 1, (3, 1): 1, (1, 4): 1, (4, 0): 1}
    # All of them face the point, so what lies on the left counts once a sheet.
    edges, windings = ss.kernels.silhouette_edges(vertices, faces, (0, 0.5, 9))
    assert windings[(edges == (0, 1)).all(axis=1)].tolist() == [-1]


@pytest.mark.parametrize("viewpoint", [(0.9, -0.7, 1.9), (0.1, 0.2, -3.0), (0.3, 0.1, 0.5)])
def test_the_bunnys_loops_close_and_use_every_edge_once_a_layer(viewpoint):
    if ss.scenes.stanford_bunny_path() is None:
        pytest.skip("the bunny comes with pymeshfix")
    bunny = ss.scenes.bunny_on_plane().scene.entries[1]
    vertices, faces = np.asarray(bunny.vertices), np.asarray(bunny.faces)
    # Faces that the viewpoint is in front of; it is not near the plane of any.
    front = np.linalg.det(vertices[faces] - viewpoint) < 0
    # Its holes make front and back layers differ, so that both have loops. A face that faces away
    # runs clockwise as the viewpoint sees it.
    expected = Counter()
    for kind in (faces[front], faces[~front, ::-1]):
        expected += Counter(_one_sided(kind, len(vertices)))
    loops = ss.kernels.silhouette_loops(vertices, faces, viewpoint)
    assert _directed(loops) == expected
    edges, _ = ss.kernels.silhouette_edges(vertices, faces, viewpoint)
    assert {tuple(e) for e in edges.tolist()} == {(min(e), max(e)) for e in expected}
