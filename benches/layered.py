"""Error, time and construction of ray-traced layered shadow maps, beside their rivals.

    python benches/layered.py [--size 512] [--samples 256] [--repeats 3] [--quick]
                              [--parts table1 figure4 table2 table3 light resolution]

Tables 1 to 3 and Figure 4 of Xie, Tabellion and Pearce 2007, and how the time of a query grows with
the light and the map; benches/README.md says how to read it.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Iterable
from typing import Any

import softshadow as ss
from map_rivals import RADII, measured, scenes
from softshadow.scenes import Setup
from tables import table

PARTS = ("table1", "figure4", "table2", "table3", "light", "resolution")

Rows = Iterable[dict[str, Any]]


def methods(setup: Setup, samples: int) -> dict[str, ss.Method]:
    """Return what is compared on a scene."""
    translucent = any(e.opacity < 1 for e in setup.scene.entries)
    opacity: dict[str, Any] = {"opacity": "opaque"} if translucent else {}
    return {
        "slsm": ss.Slsm(samples=samples, **opacity),
        "mlsm": ss.Mlsm(samples=samples, **opacity),
        "mtsm": ss.Mtsm(samples=samples),
        "mtsm, 5 layers": ss.Mtsm(1024, 5, samples=samples),
        "mtsm, detail 64": ss.Mtsm(samples=samples, detail=64),
        "pcf": ss.Pcf(**opacity),
        "deep": ss.DeepShadow(),
        "mvsm": ss.Mvsm(samples=samples, **opacity),
    }


def taking_turns(setup: Setup, chosen: dict[str, ss.Method], repeats: int) -> Rows:
    """Yield the medians of preparing and shading."""
    times: dict[str, list[dict[str, float]]] = {label: [] for label in chosen}
    for _ in range(repeats):
        for label, method in chosen.items():
            image = ss.render(setup.scene, setup.camera, setup.light, method)
            times[label].append(image.seconds)
    for label, found in times.items():
        yield {
            "method": label,
            "prepare": statistics.median(s["prepare"] for s in found),
            "shade": statistics.median(s["shade"] for s in found),
        }


def table1(options: argparse.Namespace) -> Rows:
    """Table 1: the difference from the reference with the same light points."""
    for name, setup in scenes(options.size, options.quick).items():
        for row in measured(setup, methods(setup, options.samples), options.samples):
            yield {"scene": name} | row


def figure4(options: argparse.Namespace) -> Rows:
    """Figure 4: error against the light's radius, on the statue."""
    for radius in RADII:
        setup = scenes(options.size, options.quick, light_size=2 * radius)["statue"]
        for row in measured(setup, methods(setup, options.samples), options.samples):
            yield {"radius": radius} | row


def table2(options: argparse.Namespace) -> Rows:
    """Table 2: seconds, and how many times faster than every ray (`cull=False`)."""
    for name, setup in scenes(options.size, options.quick).items():
        chosen = methods(setup, options.samples)
        chosen["ray_traced"] = ss.RayTraced(options.samples)
        chosen["ray_traced, cull=False"] = ss.RayTraced(options.samples, cull=False)
        rows = list(taking_turns(setup, chosen, options.repeats))
        for row in rows:
            yield {"scene": name} | row | {"faster": rows[-1]["shade"] / row["shade"]}


def table3(options: argparse.Namespace) -> Rows:
    """Table 3: seconds to build maps of one layer, and of several."""
    for name, setup in scenes(options.size, options.quick).items():
        chosen = {f"{k} layers": ss.Mtsm(1024, k, samples=16) for k in (1, 2, 5, 8)}
        rows = list(taking_turns(setup, dict(chosen), options.repeats))
        for row in rows:
            yield {
                "scene": name,
                "map": row["method"],
                "prepare": row["prepare"],
                "of one layer's": row["prepare"] / rows[0]["prepare"],
            }


def light(options: argparse.Namespace) -> Rows:
    """Seconds of shading against the light's radius, on the statue."""
    for radius in RADII:
        setup = scenes(options.size, options.quick, light_size=2 * radius)["statue"]
        for row in taking_turns(setup, {"mtsm": ss.Mtsm()}, options.repeats):
            yield {"radius": radius} | row


def resolution(options: argparse.Namespace) -> Rows:
    """Seconds of shading against the map's resolution."""
    for name, setup in scenes(options.size, options.quick).items():
        chosen: dict[str, ss.Method] = {str(r): ss.Mtsm(r) for r in (512, 1024, 2048)}
        for row in taking_turns(setup, chosen, options.repeats):
            yield {"scene": name, "resolution": row["method"]} | row | {"method": "mtsm"}


def main() -> None:
    """Run the parts that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--samples", type=int, default=256)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--quick", action="store_true", help="a smoke run at 128²")
    options = parser.parse_args()
    if options.quick:
        options.size, options.samples, options.repeats = 128, 64, 1
    for part in options.parts:
        table(f"layered_{part}", globals()[part](options))


if __name__ == "__main__":
    main()
