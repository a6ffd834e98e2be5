"""Time and error of the soft shadow occlusion camera: the paper's Table 1 and Figures 10 to 13.

    python benches/ssoc.py [--repeats 9] [--samples 1024] [--quick] [--parts speed errors crowded]

Frames are dynamic: silhouettes, maps and lookups are done again for each, and nothing is kept but
the meshes' adjacency. benches/README.md says how to read it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import softshadow as ss
import trimesh
from softshadow.scenes import Setup
from tables import against_reference, dynamic_frame, in_turn, table

PARTS = ("speed", "errors", "crowded")

STAGES = ("silhouettes", "shadow map", "distortion maps", "reference image")

SCENES: dict[str, Callable[..., Setup]] = {
    "aircraft": ss.scenes.aircraft,
    "two teapots": ss.scenes.two_teapots,
    "bunny and sphere": ss.scenes.bunny_and_sphere,
    "statue": lambda width, height, radius=0.1, **options: ss.scenes.statue(
        width=width, height=height, light="sphere", light_size=2 * radius, **options
    ),
}
"""The paper's scenes, as near as models allow."""


def bunny_and_fine_sphere(width: int, height: int) -> Setup:
    """Return as many triangles as the paper's largest scene has, its dragon and sphere: 270,000."""
    setup = ss.scenes.bunny_and_sphere(width=width, height=height)
    scene = ss.Scene()
    for mesh in setup.scene.entries:
        assert isinstance(mesh, ss.Mesh)
        if mesh.name != "sphere":
            scene.add((mesh.vertices, mesh.faces), name=mesh.name, albedo=mesh.albedo)
    ball = trimesh.creation.uv_sphere(0.16, count=(207, 207))
    scene.add(ball.apply_translation((0.45, -0.25, 0.65)), name="sphere")
    return replace(setup, scene=scene)


def triangles(setup: Setup) -> int:
    """Return how many triangles a scene has."""
    return sum(len(e.faces) for e in setup.scene.entries if isinstance(e, ss.Mesh))


def frame(setup: Setup, method: ss.Method) -> Callable[[], dict[str, float]]:
    """Return what renders a frame with its silhouettes and maps."""
    return lambda: dynamic_frame(setup, method, STAGES)


def speed(options: argparse.Namespace) -> Iterable[dict[str, Any]]:
    """Time a frame by stage, image and maps of 512² and 1024² (Table 1)."""
    cases = []
    more = {
        "bunny and fine sphere": bunny_and_fine_sphere,
        "statue, not subdivided": partial(SCENES["statue"], subdivisions=0),
    }
    for name, make in (SCENES | more).items():
        for size in options.sizes:
            setup = make(width=size, height=size)
            for distorted in (False, True):
                labels = {"scene": name, "triangles": triangles(setup), "size": size}
                labels["distorted"] = distorted
                method = ss.Ssoc(resolution=size, distorted=distorted)
                cases.append((labels, frame(setup, method)))
    yield from in_turn(cases, options.repeats)


def by_radius(size: int, makers: dict[str, Callable[..., Setup]]) -> dict[str, Setup]:
    """Return scenes under lights of the paper's radii (Figure 10)."""
    return {
        f"{name}, radius {radius}": make(width=size, height=size, radius=radius)
        for name, make in makers.items()
        for radius in (0.1, 0.3)
    }


def errors(options: argparse.Namespace) -> Iterable[dict[str, Any]]:
    """Measure the method and its parameters against the reference, by scene and radius."""
    methods = {
        "hard": ss.Hard(),
        "ssoc": ss.Ssoc(),
        "one step": ss.Ssoc(steps=1),
        "eight steps": ss.Ssoc(steps=8),
        "thin=False": ss.Ssoc(thin=False),
        "distorted": ss.Ssoc(distorted=True),
        "smooth": ss.Ssoc(falloff="smooth"),
        "512 texels": ss.Ssoc(resolution=512),
        "pcf": ss.Pcf(),
    }
    scenes = by_radius(options.size, SCENES)
    close = {
        f"{name}, close": make(width=options.size, height=options.size, close=True)
        for name, make in SCENES.items()
    }
    yield from against_reference(scenes | close, methods, options.samples)


def crowded(options: argparse.Namespace) -> Iterable[dict[str, Any]]:
    """Measure what helps where penumbrae crowd in the map (Section 6, Figure 13)."""
    methods = {
        "hard": ss.Hard(),
        "one step, thin=False": ss.Ssoc(steps=1, thin=False),
        "thin=False": ss.Ssoc(thin=False),
        "ssoc": ss.Ssoc(),
        "eight steps": ss.Ssoc(steps=8),
        "2048 texels": ss.Ssoc(resolution=2048),
    }
    scenes = by_radius(options.size, {"fork": ss.scenes.fork})
    yield from against_reference(scenes, methods, options.samples)


def main() -> None:
    """Run the parts that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--samples", type=int, default=1024)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--quick", action="store_true", help="a smoke run at 128²")
    options = parser.parse_args()
    options.size, options.sizes = 512, (512, 1024)
    if options.quick:
        options.size, options.sizes, options.repeats, options.samples = 128, (128,), 1, 64
    for part in options.parts:
        table(f"ssoc_{part}", globals()[part](options))


if __name__ == "__main__":
    main()
