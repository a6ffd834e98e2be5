"""Time and error of averaged hard-shadow textures, and of convolved ones.

    python benches/accumulation.py [--repeats 15] [--size 512] [--samples 1024] [--quick]
                                   [--parts speed errors convergence city convolution dense]

benches/README.md says how to read it.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Iterable
from typing import Any

import numpy as np
import softshadow as ss
import trimesh
from tables import table

PARTS = ("speed", "errors", "convergence", "city", "convolution", "dense")


def torus_over_square(triangles: int = 2000) -> tuple[ss.Scene, ss.Light]:
    """Return a torus of that many triangles (40 · 25 · 2 by default) over a square, and a light."""
    scene = ss.Scene()
    square = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    scene.add((square, [(0, 1, 2), (0, 2, 3)]), "square")
    minor = round(np.sqrt(triangles / 2 * 25 / 40))
    torus = trimesh.creation.torus(
        0.5, 0.2, major_sections=triangles // (2 * minor), minor_sections=minor
    )
    torus.apply_translation((0, 0, 0.6))
    scene.add(torus, "torus")
    return scene, ss.RectLight((0.2, -0.3, 2), (0, 0.5, 0), (0.5, 0, 0), radiance=10)


def speed(options: argparse.Namespace) -> Iterable[dict[str, Any]]:
    """Time one 256² texture under 2,000 triangles, cases in turn."""
    scene, light = torus_over_square()
    count = scene.triangle_count - 2
    cases = [
        (texture, samples)
        for samples in (1, 4, 16, 64, 128, 256, 1024)
        for texture in ("radiance", "modulation", "eight_bit")
        if texture != "eight_bit" or samples <= 256
    ]
    seconds: dict[tuple[str, int], list[float]] = {case: [] for case in cases}
    for round_ in range(options.repeats + 1):
        for texture, samples in cases:
            method = ss.Accumulation(samples, texture=texture, max_size=256)
            bake = ss.bake(scene, light, "square", method)
            # The first round builds the tree.
            if round_:
                seconds[texture, samples].append(bake.seconds["textures"])
    for (texture, samples), values in seconds.items():
        best = min(values)
        yield {
            "texture": texture,
            "samples": samples,
            "triangles": count,
            "median ms": 1e3 * statistics.median(values),
            "least ms": 1e3 * best,
            "frames/s": 1 / best,
            "ns per triangle and sample": 1e9 * best / (samples * count),
        }


def errors(options: argparse.Namespace) -> Iterable[dict[str, Any]]:
    """Measure pictures against the reference, by scene and texel size."""
    k: dict[str, Any] = {"width": options.size, "height": options.size}
    scenes = {
        "two cylinders": ss.scenes.two_cylinders(**k),
        "closed solids": ss.scenes.closed_solids(detail=3, **k),
        "overlapping boards": ss.scenes.overlapping_boards(**k),
        "acute triangle": ss.scenes.acute_triangle(**k),
    }
    for name, make in (("bunny", ss.scenes.bunny_on_plane), ("Munich", ss.scenes.city)):
        try:
            scenes[name] = make(**k)
        except FileNotFoundError as error:
            print(error)
    for name, setup in scenes.items():
        world = (setup.scene, setup.camera, setup.light)
        reference = ss.render(*world, ss.RayTraced(options.samples, seed=7))
        partly = reference.mask & (reference.visibility > 0.002) & (reference.visibility < 0.998)
        for samples, size in ((128, 256), (128, 1024), (128, 4096), (16, 1024), (1024, 1024)):
            if size == 4096 and name == "bunny":
                continue
            prepared = ss.prepare(setup.scene, setup.light, ss.Accumulation(samples, max_size=size))
            image = prepared.render(setup.camera)
            again = prepared.render(setup.camera)
            error = image.visibility.astype(np.float64) - reference.visibility
            yield {
                "scene": name,
                "samples": samples,
                "max_size": size,
                "mae penumbra": float(np.abs(error[partly]).mean()),
                "mae": float(np.abs(error[reference.mask]).mean()),
                "bias": float(error[reference.mask].mean()),
                "frame s": image.seconds["frame"],
                "next frame s": again.seconds["frame"],
                "MB": image.bytes / 1e6,
            }


def convergence(options: argparse.Namespace) -> Iterable[dict[str, Any]]:
    """Measure the error of a texture against its number of light points, refined by doubling."""
    scene, light = torus_over_square()
    truth = ss.bake(scene, light, "square", ss.RayTraced(16384, seed=9), max_size=128)[0]
    bake = ss.bake(scene, light, "square", ss.Accumulation(1, max_size=128))
    points = []
    while True:
        error = bake[0].visibility.astype(np.float64) - truth.visibility
        points.append((bake.samples or 0, float(np.sqrt((error**2).mean()))))
        slope = np.polyfit(*np.log(points[2:]).T, 1)[0] if len(points) > 3 else float("nan")
        yield {
            "samples": points[-1][0],
            "rmse": points[-1][1],
            "largest": float(np.abs(error).max()),
            "slope from 4 on": float(slope),
            "seconds in all": bake.seconds["textures"],
        }
        if points[-1][0] >= options.samples:
            return
        bake.refine()


def city(options: argparse.Namespace) -> Iterable[dict[str, Any]]:
    """Time the baking of every polygon of a city."""
    setup = ss.scenes.city()
    for texture, samples, size in (("radiance", 128, 1024), ("modulation", 128, 1024)):
        method = ss.Accumulation(samples, texture=texture, max_size=size)
        start = time.perf_counter()
        polygons, size_ = ss.bake_layout(setup.scene, setup.light, method=method)
        layout = time.perf_counter() - start
        bake = ss.bake(setup.scene, setup.light, method=method)
        yield {
            "texture": texture,
            "samples": samples,
            "polygons": len(polygons),
            "texels": sum(p.size[0] * p.size[1] for p in polygons),
            "MB": size_ / 1e6,
            "layout s": layout,
            "textures s": bake.seconds["textures"],
        }


def convolution(options: argparse.Namespace) -> Iterable[dict[str, Any]]:
    """Measure convolution beside wedges and accumulation (Figure 13 of the wedges' paper)."""
    k: dict[str, Any] = {"width": options.size, "height": options.size}
    scenes = {
        "two cylinders": ss.scenes.two_cylinders(**k),
        "closed solids": ss.scenes.closed_solids(light_size=0.3, detail=3, **k),
        "overlapping boards": ss.scenes.overlapping_boards(**k),
    }
    methods = {
        "hard": ss.Hard(),
        "wedges": ss.Wedges(),
        "accumulation": ss.Accumulation(),
        "convolution, error=1": ss.Convolution(error=1.0),
        "convolution, error=0.2": ss.Convolution(error=0.2),
        "convolution": ss.Convolution(),
        "convolution, error=0.01": ss.Convolution(error=0.01),
        "convolution, max_size=128": ss.Convolution(max_size=128),
        "convolution, max_size=1024": ss.Convolution(max_size=1024),
    }
    for name, setup in scenes.items():
        world = (setup.scene, setup.camera, setup.light)
        reference = ss.render(*world, ss.RayTraced(options.samples, seed=7))
        partly = reference.mask & (reference.visibility > 0.002) & (reference.visibility < 0.998)
        for label, method in methods.items():
            image = ss.render(*world, method)
            error = (image.visibility.astype(np.float64) - reference.visibility)[partly]
            yield {
                "scene": name,
                "method": label,
                "mae penumbra": float(np.abs(error).mean()),
                "bias": float(error.mean()),
                "frame s": image.seconds["frame"],
            }


def dense(options: argparse.Namespace) -> Iterable[dict[str, Any]]:
    """Measure first frames where receivers are many small polygons."""
    size = options.size * 3 // 4
    few = options.quick
    scenes = {
        "tree": lambda: ss.scenes.tree(size, size, leaves=2_000 if few else 40_000),
        "fur": lambda: ss.scenes.fur_ball(size, size, triangles=20_000 if few else 480_000),
    }
    try:
        bunny = ss.scenes.bunny_on_plane(width=options.size, height=options.size)
        scenes = {"demo": lambda: bunny, **scenes}
    except FileNotFoundError as error:
        print(error)
    for name, make in scenes.items():
        setup = make()
        world = (setup.scene, setup.camera, setup.light)
        reference = ss.render(*world, ss.RayTraced(options.samples, seed=7))
        for method in (ss.Accumulation(), ss.Convolution()):
            prepared = ss.prepare(setup.scene, setup.light, method)
            cpu = time.process_time()
            image = prepared.render(setup.camera)
            cpu = time.process_time() - cpu
            again = prepared.render(setup.camera)
            error = image.visibility.astype(np.float64) - reference.visibility
            yield {
                "scene": name,
                "triangles": setup.scene.triangle_count,
                "method": type(method).__name__,
                "rmse": float(np.sqrt((error[reference.mask] ** 2).mean())),
                "frame s": image.seconds["frame"],
                "cpu s": cpu,
                "next frame s": again.seconds["frame"],
                "MB": image.bytes / 1e6,
            }


def main() -> None:
    """Run the parts that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--samples", type=int, default=1024)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--quick", action="store_true", help="a smoke run at 128²")
    options = parser.parse_args()
    if options.quick:
        options.size, options.repeats, options.samples = 128, 1, 64
    for part in options.parts:
        table(f"accumulation_{part}", globals()[part](options))


if __name__ == "__main__":
    main()
