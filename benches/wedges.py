"""Time and error of penumbra wedges: speed by light, stages, what each optimisation gains, errors.

    python benches/wedges.py [--size 512] [--repeats 9] [--samples 1024] [--quick]
                             [--parts speed prepare receivers gains errors fans]

Frames are dynamic: for each, silhouettes and wedges are built again and nothing is kept but the
meshes' adjacency, as when the light or an object moves. benches/README.md says how to read it.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import softshadow as ss
from softshadow.scenes import Setup
from tables import against_reference, dynamic_frame, in_turn, table

PARTS = ("speed", "prepare", "receivers", "gains", "errors", "fans")


def frame(setup: Setup, method: ss.Method) -> Callable[[], dict[str, float]]:
    """Return what renders a frame with its silhouettes and wedges."""
    return lambda: dynamic_frame(setup, method, ("silhouettes", "wedges"))


def silhouette_edges(setup: Setup) -> int:
    """Return how many silhouette edges the light's centre sees."""
    count = 0
    for entry in setup.scene.entries:
        if isinstance(entry, ss.Mesh) and entry.casts:
            edges, _ = ss.kernels.silhouette_edges(entry.vertices, entry.faces, setup.light.center)
            count += len(edges)
    return count


def speed(size: int, repeats: int) -> Iterable[dict[str, Any]]:
    """Time a frame for lights from a point to large ones."""
    makers: dict[str, tuple[Callable[..., Setup], tuple[float, ...]]] = {
        "logo and spheres": (
            lambda **k: ss.scenes.growing_light(dense=True, **k),
            (0.0, 0.1, 0.3, 0.6, 1.2),
        ),
        "bunny": (ss.scenes.bunny_on_plane, (0.0, 0.1, 0.25, 0.5, 1.0)),
    }
    for name, (make, sizes) in makers.items():
        cases = []
        for light_size in sizes:
            setup = make(width=size, height=size, light="sphere", light_size=light_size)
            labels = {"scene": name, "edges": silhouette_edges(setup), "light": light_size}
            cases.append((labels, frame(setup, ss.Wedges())))
        yield from in_turn(cases, repeats)


def prepare(size: int, repeats: int) -> Iterable[dict[str, Any]]:
    """Time silhouettes and wedges alone, one after the other, as the mesh stays in the caches."""
    stages = ("silhouettes", "wedges")
    for name, make in (("bunny", ss.scenes.bunny_on_plane), ("statue", ss.scenes.statue)):
        setup = make(width=size, height=size, light="sphere", light_size=0.25)
        found: dict[str, list[float]] = {stage: [] for stage in stages}
        for _ in range(10 * repeats):
            seconds = ss.prepare(setup.scene, setup.light, "wedges").seconds
            for stage in stages:
                found[stage].append(1e3 * seconds[stage])
        labels = {"scene": name, "edges": silhouette_edges(setup)}
        yield labels | {stage: statistics.median(values) for stage, values in found.items()}


def receivers(size: int, repeats: int) -> Iterable[dict[str, Any]]:
    """Time the shading of landscapes of more and more triangles: the wedges stay the same."""
    cases = []
    for triangles in (2, 1_000, 10_000, 100_352, 1_000_000):
        setup = ss.scenes.landscape(width=size, height=size, triangles=triangles)
        cases.append(({"receiver triangles": triangles}, frame(setup, ss.Wedges())))
    yield from in_turn(cases, repeats)


def gains(size: int, repeats: int) -> Iterable[dict[str, Any]]:
    """Time variants of the method that leave something out."""
    variants = {
        "default": ss.Wedges(),
        "no culling by tiles and groups": ss.Wedges(cull=False),
        "counted from behind (Z-fail)": ss.Wedges(counting="zfail"),
        "objects added": ss.Wedges(overlap="add"),
        "integer buffer": ss.Wedges(buffer="integer"),
        "interpolated, 30 degrees": ss.Wedges("smooth"),
        "interpolated, no extra wedges": ss.Wedges("smooth", vertex_angle=180.0),
        "fan of 8 quads": ss.Wedges(quads=8),
        "shadow volume": ss.ShadowVolume(),
        "shadow volume, no culling": ss.ShadowVolume(cull=False),
        "hard (ray traced)": ss.Hard(),
    }
    setup = ss.scenes.growing_light(width=size, height=size, dense=True)
    cases = [({"method": name}, frame(setup, method)) for name, method in variants.items()]
    yield from in_turn(cases, repeats)


def error_scenes(size: int) -> dict[str, Setup]:
    """Return the scenes whose errors are measured."""
    k: dict[str, Any] = {"width": size, "height": size}
    scenes = {
        "two cylinders": ss.scenes.two_cylinders(**k),
        "acute triangle": ss.scenes.acute_triangle(**k),
        "overlapping boards": ss.scenes.overlapping_boards(**k),
        "landscape": ss.scenes.landscape(**k),
        "two lights, left": replace(ss.scenes.two_lights(**k), more_lights=()),
        "closed solids": ss.scenes.closed_solids(light_size=0.4, **k),
    }
    for light_size in (0.1, 0.3, 0.6, 1.2):
        scenes[f"logo, light {light_size}"] = ss.scenes.growing_light(light_size=light_size, **k)
    for light_size in (0.1, 0.25, 0.5):
        scenes[f"bunny, light {light_size}"] = ss.scenes.bunny_on_plane(light_size=light_size, **k)
    return scenes


def errors(size: int, samples: int) -> Iterable[dict[str, Any]]:
    """Measure each falloff and way to combine against the reference."""
    methods = {
        "hard": ss.Hard(),
        "light": ss.Wedges(),
        "light, added": ss.Wedges(overlap="add"),
        "light, minimum": ss.Wedges(overlap="minimum"),
        "line": ss.Wedges("line"),
        "linear": ss.Wedges("linear"),
        "smooth": ss.Wedges("smooth"),
        "line, no extra wedges": ss.Wedges("line", vertex_angle=180.0),
        # The paper's own comparison (Section 7, Figures 7 and 13).
        "accumulation, 128 points": ss.Accumulation(samples=128),
    }
    yield from against_reference(error_scenes(size), methods, samples)


def fans(size: int, samples: int) -> Iterable[dict[str, Any]]:
    """Measure fans of more and more quads against the reference (Figure 15)."""
    scenes = {"closed solids": ss.scenes.closed_solids(width=size, height=size, light_size=0.4)}
    methods: dict[str, ss.Method] = {f"{n} quads": ss.Wedges(quads=n) for n in (1, 2, 4, 8, 16, 32)}
    methods["linear"] = ss.Wedges("linear")
    yield from against_reference(scenes, methods, samples)


def main() -> None:
    """Run the parts that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--samples", type=int, default=1024)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--quick", action="store_true", help="a smoke run at 128²")
    options = parser.parse_args()
    if options.quick:
        options.size, options.repeats, options.samples = 128, 1, 64
    for part in options.parts:
        if part in ("errors", "fans"):
            table(f"wedges_{part}", globals()[part](options.size, options.samples))
        else:
            table(f"wedges_{part}", globals()[part](options.size, options.repeats))


if __name__ == "__main__":
    main()
