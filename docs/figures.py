"""Draw the pictures of `docs/concepts.md` and how-to pages: `python docs/figures.py` at the root.

They are committed; run this when a picture should change. It needs `softshadow[plot]` and the
packages of `requirements-models.txt`.
"""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import softshadow as ss
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from softshadow.plot.styles import COLOURS

FOLDER = Path(__file__).parent / "images"
BLUE, ORANGE = COLOURS[:2]
SOFT = ss.RayTraced(samples=1024)

Points = npt.NDArray[np.float64]


def bare(ax: Axes, title: str = "") -> None:
    """Take ticks off, and put a title on."""
    ax.set_xticks([])
    ax.set_yticks([])
    ax.set_title(title, fontsize="medium")


def visibility() -> Figure:
    """Draw a cut through a light, a board and a ground, and the visibility along the ground."""
    light_at, half, board_at, edge, reach = 3.0, 0.5, 1.0, 0.7, 2.0
    scene = ss.Scene()
    scene.add(ss.scenes.square(9), name="ground")
    board = [(-edge, -9, board_at), (edge, -9, board_at), (edge, 9, board_at), (-edge, 9, board_at)]
    scene.add((board, [(0, 1, 2), (0, 2, 3)]), name="board")
    light = ss.RectLight((0, 0, light_at), (0, 2 * half, 0), (2 * half, 0, 0))
    x = np.linspace(-reach, reach, 801)
    points = np.stack([x, 0 * x, 0 * x], axis=-1)
    seen = ss.visibility(scene, points, np.broadcast_to((0, 0, 1), points.shape), light, SOFT)

    figure = Figure(figsize=(7, 5.4), layout="constrained")
    cut, graph = figure.subplots(2, 1, sharex=True, height_ratios=[2.6, 1])
    # Where lines from the light's ends through the board's ends meet the ground.
    widening = board_at / (light_at - board_at)
    dark, lit = edge + (edge - half) * widening, edge + (edge + half) * widening
    for side in (-1, 1):
        for at, end in ((dark, half), (lit, -half)):
            line = [side * end, side * at]
            cut.plot(line, [light_at, 0], color="0.6", linewidth=0.8, linestyle="--")
        penumbra = [side * edge, side * dark, side * lit]
        cut.fill(penumbra, [board_at, 0, 0], color="0.75", linewidth=0)
        cut.annotate("penumbra", (side * 1.55, 0.55), ha="center")
        middle = (np.mean(penumbra), 0.25)
        cut.annotate("", middle, (side * 1.4, 0.52), arrowprops={"arrowstyle": "-"})
    umbra = [-edge, edge, dark, -dark]
    cut.fill(umbra, [board_at, board_at, 0, 0], color="0.45", linewidth=0)
    cut.plot([-half, half], [light_at] * 2, color=ORANGE, linewidth=6, solid_capstyle="butt")
    cut.plot([-edge, edge], [board_at] * 2, color="black", linewidth=4, solid_capstyle="butt")
    cut.plot([-reach, reach], [0, 0], color="black", linewidth=2)
    cut.annotate("light", (half + 0.05, light_at - 0.04))
    cut.annotate("caster", (edge + 0.06, board_at - 0.04))
    cut.annotate("receiver", (-reach, 0.08))
    cut.annotate("umbra", (0, 0.4), ha="center", color="white")
    cut.set_axis_off()
    graph.plot(x, seen, color=BLUE)
    graph.set_ylabel("visibility")
    graph.set_xlabel("along the receiver")
    graph.grid(color="0.9")
    return figure


def lights() -> Figure:
    """Draw the same solids under the three shapes, small and large."""
    figure = Figure(figsize=(8, 4.3), layout="constrained")
    for row, size in zip(figure.subplots(2, 3), (0.2, 1.2), strict=True):
        for ax, kind in zip(row, ("rect", "disk", "sphere"), strict=True):
            setup = ss.scenes.closed_solids(320, 240, light=kind, light_size=size)
            image = ss.render(setup.scene, setup.camera, setup.light, SOFT)
            ss.plot.show(image, "radiance", ax=ax)
            bare(ax, f"{kind}, {size} wide")
    return figure


def roles() -> Figure:
    """Draw a ball under a board: what casts, and what receives."""
    camera = ss.Camera((0, -6, 3.4), (0, 0, 0.65), fov_y_deg=32, width=320, height=240)
    light = ss.DiskLight((0.6, -0.4, 4.5), (-0.6, 0.4, -4.5), 0.5)
    figure = Figure(figsize=(8, 2.4), layout="constrained")
    cases = {
        "all cast and receive": {},
        "board: casts=False": {"board": {"casts": False}},
        "ball: receives=False": {"ball": {"receives": False}},
    }
    for ax, (title, looks) in zip(figure.subplots(1, 3), cases.items(), strict=True):
        scene = ss.Scene()
        scene.add(ss.scenes.square(6), name="ground")
        scene.add_spheres((0, 0, 0.6), 0.6, name="ball")
        vertices, faces = ss.scenes.square(0.45, z=2.0)
        scene.add((vertices + np.array([0.1, 0, 0]), faces), name="board")
        for name, look in looks.items():
            scene.set_look(name, **look)
        ss.plot.show(ss.render(scene, camera, light, SOFT), "radiance", ax=ax)
        bare(ax, title)
    return figure


def on_image(camera: ss.Camera, points: Points) -> Points:
    """Return where points are on a camera's image, in pixels."""
    local = (points - camera.eye) @ camera.camera_to_world[:3, :3]
    local[..., :2] /= local[..., 2:]
    local[..., 2] = 1
    return (local @ camera.K.T)[..., :2] - 0.5


def silhouettes() -> Figure:
    """Draw a bunny as its light sees it, with silhouettes from two points of the light."""
    setup = ss.scenes.bunny_on_plane(light_size=2.0)
    bunny = next(mesh for mesh in setup.scene.meshes if len(mesh.faces) > 2)
    vertices, light = bunny.world_vertices(), setup.light
    assert isinstance(light, ss.RectLight)
    middle = np.asarray(light.center)
    camera = ss.Camera(middle, vertices.mean(axis=0), fov_y_deg=32, width=480, height=440)
    image = ss.render(setup.scene, camera, light, "hard")
    facing = np.einsum("ijk,ijk->ij", image.normal, -camera.rays())
    figure = Figure(figsize=(5.4, 5), layout="constrained")
    ax = figure.subplots()
    ax.imshow(0.35 + 0.6 * facing, cmap="gray", vmin=0, vmax=1)
    corner = middle + (np.asarray(light.edge_u) + np.asarray(light.edge_v)) / 2
    for label, point, colour in (("middle", middle, COLOURS[3]), ("corner", corner, BLUE)):
        edges, _ = ss.kernels.silhouette_edges(vertices, bunny.faces, point)
        lines = on_image(camera, vertices[edges])
        label = f"{len(edges)} edges, from the light's {label}"
        ax.add_collection(LineCollection(list(lines), colors=colour, linewidths=0.9, label=label))
    ax.legend(loc="lower left", fontsize="small")
    bare(ax)
    return figure


def maps() -> Figure:
    """Draw what a light's layered map holds of a bunny."""
    setup = ss.scenes.bunny_on_plane()
    found = ss.kernels.layered_maps(setup.scene, setup.light, ss.Mlsm(resolution=512))
    return ss.plot.light_map(found[0], layers=2)


def meeting(first: Points, second: Points) -> Points:
    """Return where two planes meet the ground, x and y."""
    found: Points = np.linalg.solve(np.array([first[:2], second[:2]]), [first[3], second[3]])
    return found


def wedge_footprints() -> Figure:
    """Draw a board's shadow from above, and where each of its edges' wedges meets the ground."""
    scene = ss.Scene()
    scene.add(ss.scenes.square(4), name="ground", casts=False)
    turn = math.radians(20)
    spin = [[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]]
    vertices, faces = ss.scenes.square(0.5, z=1.0)
    scene.add((vertices @ np.transpose(spin), faces), name="board", receives=False)
    light = ss.SphereLight((0, 0, 3), 0.3)
    reach, pixels = 1.2, 480
    x = (np.arange(pixels) + 0.5) / pixels * 2 * reach - reach
    points = np.stack([*np.meshgrid(x, -x), np.zeros((pixels, pixels))], axis=-1).reshape(-1, 3)
    seen = ss.visibility(scene, points, np.broadcast_to((0, 0, 1), points.shape), light, SOFT)
    figure = Figure(figsize=(4.8, 4.8), layout="constrained")
    ax = figure.subplots()
    extent = (-reach, reach, -reach, reach)
    ax.imshow(seen.reshape(pixels, pixels), cmap="gray", vmin=0, vmax=1, extent=extent)
    found = ss.kernels.wedges(scene, light)
    for front, back, sides in zip(found.front, found.back, found.sides, strict=True):
        limits = ((front, sides[0]), (front, sides[1]), (back, sides[1]), (back, sides[0]))
        ring = np.array([meeting(plane, side) for plane, side in limits])
        ax.fill(*ring.T, facecolor="none", edgecolor=ORANGE, linewidth=1.2)
    outline = np.array([*found.edges[:, 0], found.edges[0, 0]])
    ax.plot(*outline[:, :2].T, color=BLUE, linewidth=1.2, linestyle="--")
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-reach, reach)
    bare(ax)
    return figure


def errors() -> Figure:
    """Draw three methods' pictures with their signed errors."""
    setup = ss.scenes.bunny_on_plane(320, 320)
    result = ss.compare(
        setup.scene, setup.camera, setup.light, ["hard", "pcf", "wedges"], repeats=1
    )
    return ss.plot.strip(result)


def forest() -> Figure:
    """Draw a forest of instances and its visibility."""
    setup = ss.scenes.forest(370, 264)
    image = ss.render(setup.scene, setup.camera, setup.light, ss.RayTraced(samples=64))
    figure = Figure(figsize=(7, 2.7), layout="constrained")
    left, right = figure.subplots(1, 2)
    bright = image.radiance / np.percentile(image.radiance[image.mask], 99)
    left.imshow(np.where(image.mask[..., None], np.clip(bright, 0, 1) ** (1 / 2.2), 1))
    right.imshow(np.where(image.mask, image.visibility, 1), cmap="gray", vmin=0, vmax=1)
    bare(left, f"radiance: {setup.scene.triangle_count:,} triangles")
    bare(right, "visibility")
    return figure


def main() -> None:
    """Write all pictures."""
    FOLDER.mkdir(exist_ok=True)
    mpl.rcParams["font.size"] = 9
    for draw in (visibility, lights, roles, silhouettes, maps, wedge_footprints, errors, forest):
        path = FOLDER / f"{draw.__name__}.png"
        draw().savefig(path, dpi=110)
        print(path, path.stat().st_size)


if __name__ == "__main__":
    main()
