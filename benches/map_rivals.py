"""Error and time of filtered and multi-view shadow maps on dense scenes: the paper's rivals.

    python benches/map_rivals.py [--size 512] [--samples 256] [--repeats 3] [--quick]
                                 [--parts errors growth times] [--scenes statue tree ...]

Tables 1 and 2 and Figure 4 of Xie, Tabellion and Pearce 2007 for what they compare with;
benches/README.md says how to read it.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import softshadow as ss
from softshadow.scenes import Setup
from tables import table

PARTS = ("errors", "growth", "times")

RADII = (0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0)
"""Half edges of the light in Figure 4's part, world units: the scenes are one unit across."""


SCENES = ("statue", "tree", "translucent tree", "fur ball", "ribbons", "city")


def scene(name: str, size: int, quick: bool, **options: Any) -> Setup:
    """Return one of the scenes; a small one for a smoke run."""
    k: dict[str, Any] = {"width": size, "height": size} | options
    if name == "statue":
        return ss.scenes.statue(**k | ({"subdivisions": 0} if quick else {}))
    if name == "fur ball":
        return ss.scenes.fur_ball(**k | ({"triangles": 50_000} if quick else {}))
    if name == "ribbons":
        return ss.scenes.fur_ribbons(**k | ({"triangles": 50_000} if quick else {}))
    if name == "city":
        # It is two units across, with narrow streets: its light is smaller.
        return ss.scenes.city(**{"light_size": 0.4} | k)
    opacity = 0.5 if name == "translucent tree" else 1.0
    return ss.scenes.tree(opacity=opacity, **k | ({"leaves": 10_000} if quick else {}))


def scenes(options: argparse.Namespace) -> Iterable[tuple[str, Setup]]:
    """Yield the scenes, each made when it is wanted."""
    for name in options.scenes:
        yield name, scene(name, options.size, options.quick)


def methods(setup: Setup, samples: int) -> dict[str, ss.Method]:
    """Return what is compared on a scene: deep shadow maps where something is translucent."""
    translucent = any(e.opacity < 1 for e in setup.scene.entries)
    opacity = {"opacity": "opaque"} if translucent else {}
    return {
        "hard": ss.Hard(),
        "pcf": ss.Pcf(**opacity),
        "pcf, mean depth": ss.Pcf(estimate="mean", **opacity),
        "pcf, 5 layers": ss.Pcf(layers=5, **opacity),
        "deep": ss.DeepShadow(),
        "mvsm": ss.Mvsm(samples=samples, **opacity),
        "mvsm, 1 view": ss.Mvsm(views=1, samples=samples, **opacity),
        "mtsm": ss.Mtsm(samples=samples),
    }


def wanted(chosen: dict[str, ss.Method], options: argparse.Namespace) -> dict[str, ss.Method]:
    """Return the methods that were asked for."""
    return {k: m for k, m in chosen.items() if options.methods is None or k in options.methods}


def measured(
    setup: Setup, chosen: dict[str, ss.Method], samples: int, converged: int = 0
) -> Iterable[dict[str, Any]]:
    """Yield errors against the reference with the light points that `mvsm` uses.

    With `converged`, also against that many samples, other ones at each receiver.
    """
    view = (setup.scene, setup.camera, setup.light)
    exact = ss.render(*view, ss.RayTraced(samples, pattern="fixed"))
    truth = ss.render(*view, ss.RayTraced(converged)) if converged else None
    partly = exact.mask & (exact.visibility > 0.002) & (exact.visibility < 0.998)
    for label, method in chosen.items():
        image = ss.render(*view, method)
        error = np.abs(image.visibility.astype(np.float64) - exact.visibility)
        row = {
            "method": label,
            "penumbra": float(partly.sum() / exact.mask.sum()),
            "mean": float(error[exact.mask].mean()),
            "deviation": float(error[exact.mask].std()),
            "mean in penumbra": float(error[partly].mean()),
        }
        if truth is not None:
            error = np.abs(image.visibility.astype(np.float64) - truth.visibility)
            row[f"mean, {converged} samples"] = float(error[exact.mask].mean())
            row["in penumbra"] = float(error[partly].mean())
        yield row


def errors(options: argparse.Namespace) -> Iterable[dict[str, Any]]:
    """Table 1: mean and standard deviation of the difference from the reference."""
    for name, setup in scenes(options):
        for row in measured(
            setup, wanted(methods(setup, options.samples), options), options.samples
        ):
            yield {"scene": name} | row


def growth(options: argparse.Namespace) -> Iterable[dict[str, Any]]:
    """Figure 4: error against the light's radius, on the statue."""
    for radius in RADII:
        setup = scene("statue", options.size, options.quick, light_size=2 * radius)
        for row in measured(
            setup, wanted(methods(setup, options.samples), options), options.samples
        ):
            yield {"radius": radius} | row


def times(options: argparse.Namespace) -> Iterable[dict[str, Any]]:
    """Table 2: seconds of shading, and of preparing; the cases of a scene take turns."""
    for name, setup in scenes(options):
        chosen = wanted(methods(setup, options.samples), options)
        chosen["ray_traced"] = ss.RayTraced(options.samples)
        chosen["ray_traced, cull=False"] = ss.RayTraced(options.samples, cull=False)
        shade: dict[str, list[float]] = {label: [] for label in chosen}
        prepare: dict[str, list[float]] = {label: [] for label in chosen}
        for _ in range(options.repeats):
            for label, method in chosen.items():
                image = ss.render(setup.scene, setup.camera, setup.light, method)
                shade[label].append(image.seconds["shade"])
                prepare[label].append(image.seconds["prepare"])
        for label in chosen:
            yield {
                "scene": name,
                "method": label,
                "shade": statistics.median(shade[label]),
                "prepare": statistics.median(prepare[label]),
            }


def parsed(description: str | None, parts: Sequence[str]) -> argparse.Namespace:
    """Read the command line of a benchmark on these scenes."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--samples", type=int, default=256)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--parts", nargs="+", choices=parts, default=parts)
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=SCENES)
    parser.add_argument("--methods", nargs="+", help="labels of the rows to compare; all of them")
    parser.add_argument("--quick", action="store_true", help="a smoke run at 128²")
    options = parser.parse_args()
    if options.quick:
        options.size, options.samples, options.repeats = 128, 64, 1
    return options


def main() -> None:
    """Run the parts that were asked for."""
    options = parsed(__doc__, PARTS)
    for part in options.parts:
        table(f"map_rivals_{part}", globals()[part](options))


if __name__ == "__main__":
    main()
