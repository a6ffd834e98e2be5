"""Time and error of single sample soft shadows: against hard shadows, by light and tessellation.

    python benches/single_sample.py [--size 512] [--repeats 9] [--samples 256] [--quick]
                                    [--parts speed errors small]

benches/README.md says how to read it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import Any

import numpy as np
import softshadow as ss
import trimesh
from softshadow.scenes import Setup
from tables import table

PARTS = ("speed", "errors", "small")

DIAMETERS = (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
"""Diameters of the light over its distance."""


def ground() -> tuple[Any, Any]:
    """Return a square of two triangles."""
    return [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)], [(0, 1, 2), (0, 2, 3)]


def balls(size: int, count: int) -> tuple[ss.Scene, ss.Camera, tuple[float, float, float]]:
    """Return a ground under analytic spheres, and where its light is."""
    rng = np.random.default_rng(3)
    scene = ss.Scene()
    scene.add(ground(), "ground")
    centers = rng.uniform((-2, -2, 0.1), (2, 2, 1.2), (count, 3))
    scene.add_spheres(centers, rng.uniform(0.03, 0.15, count), name="balls")
    return scene, ss.Camera((0, -4, 3), (0, 0, 0.3), width=size, height=size), (1.0, -1.0, 4.0)


def speed(size: int, repeats: int) -> Iterable[dict[str, Any]]:
    """Time both methods in turn, for lights from a point to 40 % of their distance."""
    bunny = ss.scenes.bunny_on_plane(size, size, "sphere", 0.2)
    scenes: dict[str, tuple[ss.Scene, ss.Camera, Any]] = {
        "bunny": (bunny.scene, bunny.camera, bunny.light.center),
        "20 spheres": balls(size, 20),
        "200 spheres": balls(size, 200),
        "2,000 spheres": balls(size, 2000),
    }
    methods = {"hard": ss.Hard(), "soft": ss.SingleSample()}
    for name, (scene, camera, center) in scenes.items():
        distance = float(np.linalg.norm(np.asarray(center) - (0, 0, 0.3)))
        lights = {d: ss.SphereLight(center, 0.5 * d * distance) for d in DIAMETERS}
        taken: dict[Any, list[tuple[float, float]]] = {(d, m): [] for d in lights for m in methods}
        for round_ in range(repeats + 1):
            for d, light in lights.items():
                for label, method in methods.items():
                    seconds = ss.render(scene, camera, light, method).seconds
                    # The first round builds the tree and warms up.
                    if round_:
                        taken[d, label].append((seconds["shade"], seconds["frame"]))
        for d in lights:
            # Minima: what else the machine does only adds.
            hard, soft = ([min(t[k] for t in taken[d, m]) for k in (0, 1)] for m in methods)
            yield {
                "scene": name,
                "diameter": d,
                "hard ms": 1e3 * hard[0],
                "single ms": 1e3 * soft[0],
                "ratio": soft[0] / hard[0],
                "frame ratio": soft[1] / hard[1],
            }


def error_scenes(size: int) -> dict[str, Setup]:
    """Return the scenes whose errors are measured."""
    k: dict[str, Any] = {"width": size, "height": size}
    return {
        "bunny, light 0.05": ss.scenes.bunny_on_plane(light="sphere", light_size=0.05, **k),
        "bunny, light 0.2": ss.scenes.bunny_on_plane(light="sphere", light_size=0.2, **k),
        "closed solids": ss.scenes.closed_solids(light="sphere", light_size=0.2, detail=3, **k),
        "two cylinders": ss.scenes.two_cylinders(**k),
        "overlapping boards": ss.scenes.overlapping_boards(**k),
        "acute triangle": ss.scenes.acute_triangle(**k),
        "logo, light 0.3": ss.scenes.growing_light(light_size=0.3, **k),
        "landscape": ss.scenes.landscape(**k),
    }


def errors(size: int, samples: int) -> Iterable[dict[str, Any]]:
    """Measure every falloff against the reference, over the pixels that it sees partly lit."""
    methods = {
        "hard": ss.Hard(),
        "light": ss.SingleSample(),
        "linear": ss.SingleSample("linear"),
        "smooth": ss.SingleSample("smooth"),
        "multiply": ss.SingleSample(overlap="multiply"),
        "add": ss.SingleSample(overlap="add"),
    }
    for name, setup in error_scenes(size).items():
        reference = ss.render(setup.scene, setup.camera, setup.light, ss.RayTraced(samples))
        partly = reference.mask & (reference.visibility > 0.002) & (reference.visibility < 0.998)
        for label, method in methods.items():
            image = ss.render(setup.scene, setup.camera, setup.light, method)
            error = image.visibility.astype(np.float64) - reference.visibility
            yield {
                "scene": name,
                "method": label,
                "penumbra": float(partly.sum() / reference.mask.sum()),
                "mae": float(np.abs(error[partly]).mean()),
                "bias": float(error[partly].mean()),
                "mae all": float(np.abs(error[reference.mask]).mean()),
            }


def small(size: int, samples: int) -> Iterable[dict[str, Any]]:
    """Measure how much too dark small and finely tessellated things are (Figure 5).

    All shadow there is on the ground, the sum of what is hidden, over the reference's.
    """
    light = ss.SphereLight((0, 0, 3), 0.5)
    x = np.linspace(-0.8, 0.8, size // 2)
    points = np.stack([*np.meshgrid(x, x), np.zeros((len(x), len(x)))], axis=-1).reshape(-1, 3)
    up = np.broadcast_to((0.0, 0.0, 1.0), points.shape)

    def hidden(scene: ss.Scene, method: ss.Method) -> float:
        seen = ss.visibility(scene, points, up, light, method)
        return float((1 - seen.astype(np.float64)).sum())

    for shape, height in (("sphere", 0.8), ("leg", 0.5)):
        for radius in (0.005, 0.01, 0.02, 0.05, 0.1, 0.2):
            scenes: dict[str, ss.Scene] = {}
            if shape == "sphere":
                scenes["analytic"] = ss.Scene()
                scenes["analytic"].add_spheres([(0, 0, height)], [radius], name="it")
                meshes = [trimesh.creation.icosphere(n, radius) for n in (2, 3, 4)]
            else:
                meshes = [trimesh.creation.cylinder(radius, 0.5, sections=n) for n in (4, 8, 32)]
                meshes.append(meshes[-1].subdivide().subdivide())
            for mesh in meshes:
                mesh.apply_translation((0, 0, height))
                scene = scenes[f"{len(mesh.faces):,} triangles"] = ss.Scene()
                scene.add(mesh, "it")
            for name, scene in scenes.items():
                scene.add(ground(), "ground")
                true = hidden(scene, ss.RayTraced(samples))
                each = {"overlap": "add", "parts": "triangles"}
                yield {
                    "shape": shape,
                    "radius": radius,
                    "as": name,
                    "hard": hidden(scene, ss.Hard()) / true,
                    "minimum": hidden(scene, ss.SingleSample()) / true,
                    "objects added": hidden(scene, ss.SingleSample(overlap="add")) / true,
                    "triangles added": hidden(scene, ss.SingleSample(**each)) / true,
                }


def main() -> None:
    """Run the parts that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--samples", type=int, default=256)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--quick", action="store_true", help="a smoke run at 128²")
    options = parser.parse_args()
    if options.quick:
        options.size, options.repeats, options.samples = 128, 1, 64
    for part in options.parts:
        count = options.repeats if part == "speed" else options.samples
        table(f"single_sample_{part}", globals()[part](options.size, count))


if __name__ == "__main__":
    main()
