"""Error, time and construction of ray-traced layered shadow maps, beside their rivals.

    python benches/layered.py [--size 512] [--samples 256] [--repeats 3] [--quick]
                              [--parts table1 figure4 table2 table3 light resolution quality near]
                              [--scenes statue tree ...] [--methods mtsm pcf ...]

Tables 1 to 3 and Figure 4 of Xie, Tabellion and Pearce 2007, how the time of a query grows with the
light and the map, and what their Section 6 is about; benches/README.md says how to read it.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import statistics
import time
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import softshadow as ss
from map_rivals import RADII, measured, parsed, scene, scenes, wanted
from mitsuba_speed import Worker, available_sides
from softshadow.scenes import Setup
from tables import table

PARTS = ("table1", "figure4", "table2", "table3", "light", "resolution", "quality", "near")

Rows = Iterable[dict[str, Any]]

CONVERGED = 4096
"""Samples of a reference whose own noise no longer counts: (4096)^(-3/4) is 0.002 at worst."""


def methods(setup: Setup, samples: int) -> dict[str, ss.Method]:
    """Return what is compared on a scene."""
    translucent = any(e.opacity < 1 for e in setup.scene.entries)
    opacity: dict[str, Any] = {"opacity": "opaque"} if translucent else {}
    return {
        "slsm": ss.Slsm(samples=samples, **opacity),
        "mlsm": ss.Mlsm(samples=samples, **opacity),
        "mtsm": ss.Mtsm(samples=samples),
        "mtsm, map alone": ss.Mtsm(samples=samples, near=0),
        "mtsm, map alone, 5 layers": ss.Mtsm(1024, 5, samples=samples, near=0),
        "mtsm, map alone, detail 64": ss.Mtsm(samples=samples, detail=64, near=0),
        "pcf": ss.Pcf(**opacity),
        "deep": ss.DeepShadow(),
        "mvsm": ss.Mvsm(samples=samples, **opacity),
    }


def taking_turns(
    setup: Setup, chosen: dict[str, ss.Method], repeats: int, peers: Sequence[Peer] = ()
) -> Rows:
    """Yield the medians of preparing, shading and whole frames."""
    times: dict[str, list[dict[str, float]]] = {label: [] for label in chosen}
    times |= {peer.label: [] for peer in peers}
    for _ in range(repeats):
        for label, method in chosen.items():
            image = ss.render(setup.scene, setup.camera, setup.light, method)
            times[label].append(image.seconds)
        for peer in peers:
            times[peer.label].append(peer.seconds())
    for label, found in times.items():
        stages = ("prepare", "shade", "frame")
        yield {"method": label} | {s: statistics.median(f[s] for f in found) for s in stages}


class Peer:
    """Mitsuba, in a process of its own, on one of the scenes."""

    def __init__(self, side: str, scene: str, options: argparse.Namespace) -> None:
        self.label = side
        self.worker = Worker(side, scene, options.size, options.quick)
        self.samples = self.worker.warm_up(options.samples)
        # What is missing is scaled up.
        self.scale = options.samples / self.samples
        if self.scale > 1:
            print(f"({side} on the {scene}: scaled from {self.samples} samples)", flush=True)

    def seconds(self) -> dict[str, float]:
        """Render a frame; its stages are one."""
        found = self.worker.frame(self.samples)
        frame = found["seconds"] * self.scale
        return {"prepare": found["load"], "shade": math.nan, "frame": frame}


def table1(options: argparse.Namespace) -> Rows:
    """Table 1: the difference from the reference, with the same light points and converged."""
    # What the samples alone are off by.
    same: dict[str, ss.Method] = {"ray_traced": ss.RayTraced(options.samples, pattern="fixed")}
    for name, setup in scenes(options):
        chosen = same | wanted(methods(setup, options.samples), options)
        for row in measured(setup, chosen, options.samples, CONVERGED):
            yield {"scene": name} | row


def figure4(options: argparse.Namespace) -> Rows:
    """Figure 4: error against the light's radius, on the statue."""
    for radius in RADII:
        setup = scene("statue", options.size, options.quick, light_size=2 * radius)
        for row in measured(
            setup, wanted(methods(setup, options.samples), options), options.samples
        ):
            yield {"radius": radius} | row


def table2(options: argparse.Namespace) -> Rows:
    """Table 2: seconds, and how many times faster than every ray (`cull=False`) and Mitsuba."""
    # Its fastest variant that there is.
    sides = [side for side in available_sides() if side.startswith("mitsuba")][-1:]
    for name, setup in scenes(options):
        chosen = wanted(methods(setup, options.samples), options)
        chosen["ray_traced"] = ss.RayTraced(options.samples)
        chosen["ray_traced, cull=False"] = ss.RayTraced(options.samples, cull=False)
        peers = [Peer(side, name, options) for side in sides]
        rows = list(taking_turns(setup, chosen, options.repeats, peers))
        for peer in peers:
            peer.worker.close()
        every = next(row for row in rows if row["method"] == "ray_traced, cull=False")
        mitsuba = rows[-1]["frame"] if peers else math.nan
        for row in rows:
            yield (
                {"scene": name}
                | row
                | {
                    "every ray's shade / shade": every["shade"] / row["shade"],
                    "Mitsuba's frame / frame": mitsuba / row["frame"],
                }
            )


def table3(options: argparse.Namespace) -> Rows:
    """Table 3: seconds to build maps of one layer, and of several."""
    for name, setup in scenes(options):
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
        setup = scene("statue", options.size, options.quick, light_size=2 * radius)
        for row in taking_turns(setup, {"mtsm": ss.Mtsm()}, options.repeats):
            yield {"radius": radius} | row


def resolution(options: argparse.Namespace) -> Rows:
    """Seconds of shading against the map's resolution."""
    for name, setup in scenes(options):
        chosen: dict[str, ss.Method] = {str(r): ss.Mtsm(r) for r in (512, 1024, 2048)}
        for row in taking_turns(setup, chosen, options.repeats):
            yield {"scene": name, "resolution": row["method"]} | row | {"method": "mtsm"}


def quality(options: argparse.Namespace) -> Rows:
    """Section 6: where maps go wrong, and what each parameter does about it."""
    size = {"width": options.size, "height": options.size}
    for name, (setup, where, cases) in {
        "oblique board": (
            ss.scenes.oblique_board(**size),
            lambda image: image.mesh_id == 0,
            [("near", n, {}) for n in (0.0, 24.0)]
            + [("z_threshold", z, {}) for z in (None, 0.005, 0.02, 0.08)]
            + [("z_threshold, depths only", z, {}) for z in (0.0, 0.005, 0.02, 0.08)],
        ),
        "contact": (
            ss.scenes.standing_cylinder(**size),
            # Up to 0.05 from where it stands.
            lambda image: (
                (image.mesh_id == 0) & (np.linalg.norm(image.position[..., :2], axis=-1) < 0.3)
            ),
            [("near", n, {}) for n in (0.0, 24.0)]
            + [("resolution", r, {}) for r in (256, 1024, 4096)]
            + [("detail", d, {}) for d in (64.0, 1000.0)]
            + [("bias", b, {}) for b in (0.01, 0.05)],
        ),
        "self-shadowing": (
            ss.scenes.ball(**size),
            lambda image: image.mesh_id == 1,
            [("resolution", r, {}) for r in (256, 1024, 4096)]
            + [("detail", 64.0, {"resolution": 4096})]
            + [("z_threshold", z, {}) for z in (0.01, 0.05)]
            + [("bias", b, {"z_threshold": 0.05}) for b in (0.01, 0.05)],
        ),
        "missing layer": (
            ss.scenes.stacked_boards(**size),
            lambda image: image.mesh_id == 0,
            [("layers", k, {}) for k in (1, 2, 3, 4, 5)],
        ),
    }.items():
        view = (setup.scene, setup.camera, setup.light)
        exact = ss.render(*view, ss.RayTraced(options.samples, pattern="fixed"))
        looked_at = exact.mask & where(exact)
        for parameter, value, others in cases:
            # The map alone: what its parameters do.
            given = {"resolution": 1024, "layers": 5, "near": 0.0} | others
            given |= {parameter.split(",")[0]: value}
            method = ss.Mtsm(samples=options.samples, **given)
            if "depths only" in parameter:
                seen = depths_only(setup, exact, method)
            else:
                seen = ss.render(*view, method).visibility
            error = (seen.astype(np.float64) - exact.visibility)[looked_at]
            yield {
                "scene": name,
                "parameter": parameter,
                "value": value,
                "beside": ", ".join(f"{k}={v}" for k, v in others.items()),
                "mean": float(np.abs(error).mean()),
                "bias": float(error.mean()),
                "largest": float(np.abs(error).max()),
            }


def near(options: argparse.Namespace) -> Rows:
    """Error next to casters, and processor time, by how far triangles answer."""
    for name, setup in scenes(options):
        view = (setup.scene, setup.camera, setup.light)
        # Of another seed than what is compared with it.
        exact = ss.render(*view, ss.RayTraced(4 * options.samples, seed=77))
        above = exact.mask & (exact.mesh_id != 0)
        where = {"picture": exact.mask, "ground": exact.mask & ~above, "on what casts": above}
        compared: dict[str, ss.Method] = {"ray_traced": ss.RayTraced(options.samples)}
        compared |= {f"mtsm, near {n}": ss.Mtsm(near=n) for n in (0, 8, 16, 24, 32)}
        for label, method in compared.items():
            prepared = ss.prepare(setup.scene, setup.light, method)
            seconds = []
            for _ in range(options.repeats):
                start = time.process_time()
                image = prepared.render(setup.camera)
                seconds.append(time.process_time() - start)
            error = image.visibility.astype(np.float64) - exact.visibility
            found = {w: float(np.sqrt((error[m] ** 2).mean())) for w, m in where.items()}
            yield {"scene": name, "method": label} | found | {"seconds": min(seconds)}


def depths_only(setup: Setup, image: ss.Image, method: ss.Mtsm) -> npt.NDArray[np.float32]:
    """Return the visibility from maps without slopes, as the paper has them."""
    maps = ss.kernels.layered_maps(setup.scene, setup.light, method)
    flat = [dataclasses.replace(m, slopes=None) for m in maps]
    points, normals = image.position[image.mask], image.normal[image.mask]
    seen = np.ones_like(image.visibility)
    seen[image.mask] = ss.kernels.trace_layered_maps(flat, setup.light, points, normals, method)
    return seen


def main() -> None:
    """Run the parts that were asked for."""
    options = parsed(__doc__, PARTS)
    for part in options.parts:
        table(f"layered_{part}", globals()[part](options))


if __name__ == "__main__":
    main()
