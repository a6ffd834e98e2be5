"""Cases whose meshes are hard: slivers, open and broken ones, sheets in one plane, hair."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
import trimesh

from softshadow.camera import Camera
from softshadow.scene import Scene
from softshadow.scenes.hard_cases.stage import (
    CENTER,
    MeshData,
    board,
    box,
    lit,
    over_ground,
    view,
)
from softshadow.scenes.ssoc_paper import fork as fork_of_the_paper
from softshadow.scenes.staging import Setup

__all__ = [
    "aimed_box",
    "coplanar_boards",
    "degenerate_mesh",
    "edge_on_triangle",
    "fence",
    "fin",
    "fork",
    "hair",
    "needles",
    "open_bowl",
    "panes",
    "pinhole",
    "turned_faces",
]

_CENTER = np.array(CENTER)


def fork(width: int, height: int) -> Setup:
    """Return the fork of the occlusion camera's paper, from near."""
    camera = Camera((-0.9, -1.3, 1.2), (-0.25, 0.3, 0.05), (0, 0, 1), 34.0, width, height)
    return dataclasses.replace(fork_of_the_paper(width, height), camera=camera)


def needles(width: int, height: int) -> Setup:
    """Return triangles that are 10² to 10⁷ times as long as they are wide."""
    rng = np.random.default_rng(0)
    corners: list[npt.NDArray[np.float64]] = []
    for thin in 10.0 ** np.repeat(np.arange(-2.0, -8.0, -1.0), [8, 4, 2, 2, 2, 2]):
        a = rng.uniform((-0.6, -0.6, 0.2), (0.6, 0.6, 0.9))
        along = rng.normal(size=3) * 0.5
        corners += [a, a + along, a + along + rng.normal(size=3) * 2 * thin]
    faces = np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    return lit(
        over_ground((np.array(corners), faces)), view(width, height), kinds=("rect", "sphere")
    )


def open_bowl(width: int, height: int) -> Setup:
    """Return half a shell that is open below, and a sheet that is open all around."""
    shell = trimesh.creation.icosphere(3, 0.35)
    upper = shell.triangles_center[:, 2] > 0.05
    moved = shell.vertices + np.array([-0.3, 0.0, 0.5])
    bowl = np.asarray(moved), np.asarray(shell.faces, dtype=np.int64)[upper]
    sheet = board((0.45, 0, 0.5), (0.6, 0.1, 0.2), (0, 0.5, 0.1))
    return lit(over_ground(bowl, sheet), view(width, height), kinds=("disk",))


def aimed_box(width: int, height: int) -> Setup:
    """Return a box whose upright edges all point at the lights' centre."""
    vertices, faces = box((0.3, 0.3, 0.4), (0.0, 0.0, 0.5))
    for corner in vertices:
        if corner[2] < 0.5:
            top = np.array([corner[0], corner[1], 0.7])
            corner[:] = _CENTER + (top - _CENTER) * (CENTER[2] - 0.3) / (CENTER[2] - 0.7)
    return lit(over_ground((vertices, faces)), view(width, height), kinds=("rect", "sphere"))


def edge_on_triangle(width: int, height: int) -> Setup:
    """Return a triangle in whose plane the lights' centre lies."""
    corners = _CENTER + np.array([(0, 0, -1.2), (0.3, 0, -1.6), (-0.4, 0, -1.7)])
    triangle = corners, np.array([[0, 1, 2]])
    return lit(over_ground(triangle), view(width, height), kinds=("rect", "sphere"))


def fence(width: int, height: int) -> Setup:
    """Return boards without thickness, all of them in planes through the light's centre."""
    pickets = []
    for x in np.linspace(-0.75, 0.75, 7):
        low, high = np.array([x, -0.3, 0.0]), np.array([x, 0.3, 0.0])
        at = [_CENTER + s * (p - _CENTER) for s, p in ((0.95, low), (0.95, high))]
        at += [_CENTER + 0.7 * (p - _CENTER) for p in (high, low)]
        pickets.append((np.array(at), np.array([[0, 1, 2], [0, 2, 3]])))
    camera = Camera((0.2, -2.2, 1.9), (-0.05, 0.0, 0.1), (0, 0, 1), 44.0, width, height)
    return lit(over_ground(*pickets), camera, kinds=("rect", "sphere"))


def coplanar_boards(width: int, height: int) -> Setup:
    """Return ten boards in one plane, on and beside one another, and one in the ground's plane."""
    rng = np.random.default_rng(5)
    boards = [board((-0.4, -0.5, 0.0), (0.3, 0, 0), (0, 0.2, 0))]
    for _ in range(10):
        x, y = rng.uniform(-0.35, 0.35, 2)
        turn = rng.uniform(0, np.pi)
        along = np.array([np.cos(turn), np.sin(turn), 0.0])
        across = np.array([-along[1], along[0], 0.0])
        boards.append(board((x, y, 0.5), 0.55 * along, 0.2 * across))
    return lit(over_ground(*boards), view(width, height))


def fin(width: int, height: int) -> Setup:
    """Return three sheets that meet at one edge."""
    vertices = [(-0.4, 0, 0.5), (0.4, 0, 0.5), (0, 0.4, 0.8), (0, -0.4, 0.8), (0, 0.1, 1.1)]
    sheets = np.array(vertices, dtype=np.float64), np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    return lit(over_ground(sheets), view(width, height), kinds=("rect", "sphere"))


def turned_faces(width: int, height: int) -> Setup:
    """Return a box with every third face turned inside out, and one with a face given twice."""
    vertices, faces = box((0.4, 0.3, 0.3), (-0.35, 0.0, 0.5), 20.0)
    faces[::3] = faces[::3, ::-1]
    more, twice = box((0.4, 0.3, 0.3), (0.35, 0.0, 0.5), 20.0)
    twice = np.append(twice, twice[:1], axis=0)
    return lit(
        over_ground((vertices, faces), (more, twice)), view(width, height), kinds=("sphere",)
    )


def degenerate_mesh(width: int, height: int) -> Setup:
    """Return a box of loose triangles, with others that have no area: points, lines, repeats."""
    vertices, faces = box((0.5, 0.4, 0.3), (0.0, 0.0, 0.5), 20.0)
    loose = vertices[faces].reshape(-1, 3)  # every triangle has corners of its own
    line = np.array([(-1.0, -1.0, 1.0), (0.0, 0.0, 0.75), (1.0, 1.0, 0.5)])
    flat = [[0, 1, 2], [1, 2, 0], [0, 0, 1], [2, 2, 2], [0, 1, 0]]
    mesh = (
        np.concatenate([loose, line]),
        np.concatenate([np.arange(len(loose)).reshape(-1, 3), np.array(flat) + len(loose)]),
    )
    return lit(over_ground(mesh), view(width, height), kinds=("disk",))


def pinhole(width: int, height: int) -> Setup:
    """Return a board with a square hole and a slit, both narrower than the penumbra."""
    gap, z = 0.06, 0.6
    pieces = [
        board((-0.46, 0, z), (0.6, 0, 0), (0, 1.2, 0)),
        board((0.0, 0, z), (0.2, 0, 0), (0, 1.2, 0)),
        board((0.46, 0, z), (0.6, 0, 0), (0, 1.2, 0)),
        board((-0.13, -0.3 - gap / 4, z), (gap, 0, 0), (0, 0.6 - gap / 2, 0)),
        board((-0.13, 0.3 + gap / 4, z), (gap, 0, 0), (0, 0.6 - gap / 2, 0)),
    ]
    camera = Camera((0.0, -0.75, 0.5), (0.0, 0.05, 0.0), (0, 0, 1), 45.0, width, height)
    return lit(over_ground(*pieces), camera, (0.05, -0.1, 2.0), 0.3)


def hair(width: int, height: int) -> Setup:
    """Return sixty bristles that stand on the ground."""
    rng = np.random.default_rng(0)
    count, points, length = 60, 5, 0.4
    roots = np.column_stack([rng.uniform(-0.6, 0.6, (count, 2)), np.full(count, 0.02)])
    steps = np.array([0, 0, 1]) + rng.normal(0, 0.3, (count, points - 1, 3))
    steps *= length / (points - 1) / np.linalg.norm(steps, axis=2, keepdims=True)
    strands = np.concatenate([np.zeros((count, 1, 3)), steps.cumsum(axis=1)], axis=1)
    strands += roots[:, None]
    scene = over_ground()
    offsets = np.arange(count + 1) * points
    scene.add_curves(strands.reshape(-1, 3), offsets, 0.01, name="hair", albedo=(0.7, 0.5, 0.3))
    return lit(scene, view(width, height), (0.1, -0.2, 3.0), 0.6, ("sphere",))


def panes(width: int, height: int) -> Setup:
    """Return three translucent panes whose shadows overlap."""
    scene: Scene = over_ground()
    for i, (x, y, z) in enumerate([(-0.35, 0.1, 0.4), (0.0, -0.1, 0.6), (0.3, 0.15, 0.9)]):
        pane: MeshData = board((x, y, z), (0.6, 0, 0.1 * (i - 1)), (0, 0.7, 0.1))
        scene.add(pane, name=f"pane {i}", albedo=(0.4, 0.6, 0.8), opacity=0.5)
    return lit(scene, view(width, height), kinds=("rect", "sphere"))
