"""Time `ray_traced` against Mitsuba's `direct` integrator at equal light samples.

    python benches/mitsuba_speed.py [--size 512] [--samples 64 256] [--scenes bunny munich]
                                    [--repeats 5] [--quick]

Every side (softshadow with and without culling, Mitsuba's ``scalar_rgb`` and ``llvm_ad_mono``)
lives in a process of its own that loads the scene once, renders one frame to warm up (Mitsuba
compiles its kernel then) and waits. Frames are then asked for in turn, one of each side per round,
so that a machine that slows down slows all of them. benches/README.md says how to read the tables.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from softshadow.mitsuba import find_llvm

SIDES = ("softshadow", "softshadow cull=False", "mitsuba scalar_rgb", "mitsuba llvm_ad_mono")

# Light samples per camera ray of Mitsuba's `direct`, the fastest of 1, 4, 8, 16 and 64 on the
# bunny: with one, half of the time goes into camera rays; the LLVM kernel unrolls them, so 64 are
# slower.
LIGHT_SAMPLES_PER_RAY = {"mitsuba scalar_rgb": 64, "mitsuba llvm_ad_mono": 8}

# A frame of Mitsuba's that would take longer than this, in seconds, is rendered with fewer samples
# and scaled; what it would take is predicted from this many samples.
LONGEST_FRAME = 15.0
PROBE = 64

# ---------------------------------------------------------------------------------------------
# The worker: answers one JSON line per request.


def peak_megabytes() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024 * 1024 if sys.platform == "darwin" else 1024)


def load_setup(name: str, size: int, quick: bool) -> Any:
    from map_rivals import SCENES, scene
    from softshadow import scenes

    if name in SCENES:
        return scene(name, size, quick)
    if name == "bunny":
        return scenes.bunny_on_plane(size, size)
    if name == "solids":
        return scenes.closed_solids(size, size)
    return scenes.city(name, size, size)


def softshadow_frames(setup: Any, cull: bool) -> Callable[[int], dict[str, Any]]:
    import softshadow as ss

    prepared: dict[int, Any] = {}

    def frame(samples: int) -> dict[str, Any]:
        if samples not in prepared:
            method = ss.RayTraced(samples=samples, cull=cull)
            prepared[samples] = ss.prepare(setup.scene, setup.light, method)
        start = time.perf_counter()
        image = prepared[samples].render(setup.camera)
        seconds = time.perf_counter() - start
        return {
            "seconds": seconds,
            "samples": samples,
            "hits": int(image.mask.sum()),
            "stages": image.seconds,
            "bytes": image.bytes,
        }

    return frame


def first_prepare(setup: Any) -> dict[str, float]:
    """Prepare a fresh scene and return its stages; later ones find the trees built."""
    import softshadow as ss

    seconds: dict[str, float] = ss.prepare(setup.scene, setup.light, "ray_traced").seconds
    return seconds


def mitsuba_frames(setup: Any, side: str) -> Callable[[int], dict[str, Any]]:
    import mitsuba as mi
    import numpy as np
    from softshadow import mitsuba as bridge

    variant = side.split()[1]
    mi.set_variant(variant)
    mi.set_log_level(mi.LogLevel.Error)
    # `volpath`, which knows transparent shadows, takes one light sample per camera ray.
    direct = all(entry.opacity == 1 for entry in setup.scene.entries)
    per_ray = LIGHT_SAMPLES_PER_RAY[side] if direct else 1
    scenes: dict[int, Any] = {}
    load: dict[int, float] = {}

    def frame(samples: int) -> dict[str, Any]:
        group = min(per_ray, samples)
        if group not in scenes:
            description = bridge.scene_dict(setup.scene, setup.camera, setup.light)
            if direct:
                description["integrator"]["emitter_samples"] = group
            mono = "mono" in variant
            description["sensor"]["film"]["pixel_format"] = "luminance" if mono else "rgb"
            start = time.perf_counter()
            scenes[group] = mi.load_dict(description)
            load[group] = time.perf_counter() - start
        rays = max(1, samples // group)
        start = time.perf_counter()
        pixels = np.array(mi.render(scenes[group], spp=rays))
        seconds = time.perf_counter() - start
        found = {"seconds": seconds, "samples": rays * group, "mean": float(pixels.mean())}
        return found | {"load": load[group]}

    return frame


def build_million() -> dict[str, Any]:
    """Build the tree of a bumpy torus of 10⁶ triangles."""
    import numpy as np
    import softshadow as ss

    rings, sides = 1000, 500
    u, v = np.meshgrid(
        np.arange(rings) * 2 * np.pi / rings, np.arange(sides) * 2 * np.pi / sides, indexing="ij"
    )
    tube = 0.3 + 0.02 * np.sin(40 * u) * np.sin(15 * v)
    around = 1 + tube * np.cos(v)
    vertices = np.stack([around * np.cos(u), around * np.sin(u), tube * np.sin(v)], axis=-1)
    i, j = np.meshgrid(np.arange(rings), np.arange(sides), indexing="ij")
    a, b = i * sides + j, (i + 1) % rings * sides + j
    c, d = (i + 1) % rings * sides + (j + 1) % sides, i * sides + (j + 1) % sides
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    scene = ss.Scene()
    start = time.perf_counter()
    scene.add((vertices.reshape(-1, 3), faces), name="torus")
    added = time.perf_counter()
    light = ss.RectLight((0, 0, 4), (0, 1, 0), (1, 0, 0))
    prepared = ss.prepare(scene, light, ss.RayTraced(samples=64))
    return {
        "triangles": len(faces),
        "add": added - start,
        "prepare": time.perf_counter() - added,
        "stages": prepared.seconds,
        "peak": peak_megabytes(),
    }


def work(side: str, scene: str, size: int, quick: bool) -> None:
    # Whatever a library prints to stdout must not end up between the answers.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def answer(value: dict[str, Any]) -> None:
        print(json.dumps(value), file=answers, flush=True)

    if side == "build":
        answer(build_million())
        return
    setup = load_setup(scene, size, quick)
    before = peak_megabytes()
    hello: dict[str, Any] = {"triangles": setup.scene.triangle_count}
    if side.startswith("mitsuba"):
        frame = mitsuba_frames(setup, side)
        hello["threads"] = importlib.import_module("drjit").thread_count()
    else:
        hello["threads"] = importlib.import_module("softshadow").thread_count()
        frame = softshadow_frames(setup, cull=not side.endswith("cull=False"))
        hello["prepare"] = first_prepare(setup)
    answer(hello)
    for line in sys.stdin:
        result = frame(int(line))
        answer({**result, "peak": peak_megabytes(), "loaded": before})


# ---------------------------------------------------------------------------------------------
# The command.


class Worker:
    """A process that renders frames of one scene, one side, on request."""

    def __init__(self, side: str, scene: str, size: int, quick: bool = False) -> None:
        self.side = side
        environment = dict(os.environ)
        llvm = find_llvm()
        if llvm:
            environment["DRJIT_LIBLLVM_PATH"] = llvm
        self.process = subprocess.Popen(
            [sys.executable, __file__, "--worker", side, scene, str(size), str(int(quick))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        self.hello = self._read()

    def _read(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"{self.side}: the process ended with {self.process.wait()}")
        result: dict[str, Any] = json.loads(line)
        return result

    def frame(self, samples: int) -> dict[str, Any]:
        """Render one frame and return its times."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{samples}\n")
        self.process.stdin.flush()
        return self._read()

    def warm_up(self, samples: int) -> int:
        """Return how many samples to ask of a frame: fewer where one would take too long."""
        # The first touch of memory and, for LLVM, the kernel; then a frame to predict from.
        self.frame(PROBE)
        estimate = self.frame(PROBE)["seconds"] * samples / PROBE
        if self.side.startswith("mitsuba") and estimate > LONGEST_FRAME:
            samples = max(PROBE, int(samples * LONGEST_FRAME / estimate) // PROBE * PROBE)
        self.frame(samples)
        return samples

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()


def available_sides() -> list[str]:
    sides = list(SIDES)
    if importlib.util.find_spec("mitsuba") is None:
        print("Mitsuba is not installed: its rows are left out.")
        return sides[:2]
    if find_llvm() is None:
        print("LLVM 19 was not found (set DRJIT_LIBLLVM_PATH): no llvm_ad_mono row.")
        sides.remove("mitsuba llvm_ad_mono")
    return sides


def time_scene(scene: str, arguments: argparse.Namespace) -> list[dict[str, Any]]:
    workers = [Worker(side, scene, arguments.size) for side in available_sides()]
    triangles = workers[0].hello["triangles"]
    print(f"{scene}, {triangles} triangles; prepare, ms: {stages(workers[0].hello['prepare'])}")
    rows = []
    for samples in arguments.samples:
        asked = {worker.side: worker.warm_up(samples) for worker in workers}
        frames: dict[str, list[dict[str, Any]]] = {worker.side: [] for worker in workers}
        for _ in range(arguments.repeats):
            for worker in workers:
                frames[worker.side].append(worker.frame(asked[worker.side]))
        hits = frames[workers[0].side][0]["hits"]
        for worker in workers:
            rows.append(summarise(scene, triangles, samples, hits, frames[worker.side]))
            rows[-1] |= {"side": worker.side, "threads": worker.hello["threads"]}
        ours = rows[-len(workers)]["seconds"]
        for row in rows[-len(workers) :]:
            row["ratio"] = row["seconds"] / ours
            print_row(row)
        print_stages(frames[workers[0].side])
    for worker in workers:
        worker.close()
    return rows


def summarise(
    scene: str, triangles: int, samples: int, hits: int, frames: list[dict[str, Any]]
) -> dict[str, Any]:
    scale = samples / frames[0]["samples"]
    times = [frame["seconds"] * scale for frame in frames]
    seconds = statistics.median(times)
    return {
        "scene": scene,
        "triangles": triangles,
        "side": "",
        "threads": 0,
        "samples": samples,
        "seconds": seconds,
        "fastest": min(times),
        "slowest": max(times),
        "mrays_per_second": hits * samples / seconds / 1e6,
        "peak_megabytes": max(frame["peak"] for frame in frames),
        "loaded_megabytes": frames[0]["loaded"],
        "note": "" if scale == 1 else f"scaled from {frames[0]['samples']} samples",
    }


HEADER = (
    f"{'scene':14} {'samples':>7} {'side':22} {'threads':>7} "
    f"{'seconds':>8} {'(min':>7} {'max)':>7} {'Mrays/s':>8} {'ratio':>6} {'peak MB':>8}"
)


def print_row(row: dict[str, Any]) -> None:
    print(
        f"{row['scene']:14} {row['samples']:7} {row['side']:22} {row['threads']:7} "
        f"{row['seconds']:8.3f} {row['fastest']:7.3f} {row['slowest']:7.3f} "
        f"{row['mrays_per_second']:8.1f} {row['ratio']:6.2f} {row['peak_megabytes']:8.0f}  "
        f"{row['note']}",
        flush=True,
    )


def stages(seconds: dict[str, float]) -> str:
    return ", ".join(f"{name} {1e3 * value:.1f}" for name, value in seconds.items())


def print_stages(frames: list[dict[str, Any]]) -> None:
    names = list(frames[0]["stages"])
    medians = {n: statistics.median(frame["stages"][n] for frame in frames) for n in names}
    size = frames[0]["bytes"] / 1e6
    print(f"{'':22} softshadow's frame, ms: {stages(medians)}; {size:.1f} MB\n", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=512, help="pixels per side")
    parser.add_argument("--samples", type=int, nargs="+", default=[64, 256])
    parser.add_argument("--scenes", nargs="+", default=["bunny", "munich"])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--quick", action="store_true", help="128², 64 samples, 3 repeats, no build"
    )
    parser.add_argument("--worker", nargs=4, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        side, scene, size, quick = arguments.worker
        work(side, scene, int(size), quick == "1")
        return
    if arguments.quick:
        arguments.size, arguments.samples, arguments.repeats = 128, [64], 3
    print(
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, "
        f"{arguments.size}², median of {arguments.repeats}; LLVM: {find_llvm()}\n\n{HEADER}"
    )
    rows = [row for scene in arguments.scenes for row in time_scene(scene, arguments)]
    if not arguments.quick:
        build = Worker("build", "-", 0)
        print(
            "1M triangles: add {add:.2f} s, prepare {prepare:.2f} s, peak {peak:.0f} MB; "
            "prepare, ms: {stages}".format(
                **{**build.hello, "stages": stages(build.hello["stages"])}
            )
        )
        build.close()
    results = Path(__file__).parent / "results"
    results.mkdir(exist_ok=True)
    path = results / "mitsuba_speed.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    print(f"written: {path}")


if __name__ == "__main__":
    main()
