"""Memory and time of instances: a forest of one tree, by the number of trees, and in one list.

    python benches/instances.py [--size 512] [--samples 16] [--trees 20 100 1000] [--write]

benches/README.md says how to read it. Every row is measured in a process of its own.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
from typing import Any

import softshadow as ss
from study import DOCS, END, markdown
from tables import fill, table

SIDES = ("instances", "one list")

PAGE, BEGIN = DOCS / "how_to" / "instances.md", "<!-- measured: python benches/instances.py -->"


def shown(row: dict[str, Any]) -> list[str]:
    """Return a row of the page's table."""
    method = {"hard": "`hard`", "ray_traced": "`ray_traced`"}.get(row["method"], "to 0.02")
    return [
        f"{row['trees']:,}",
        f"{row['triangles']:,}",
        row["kept"],
        method,
        *(f"{row[name]:.3g}" for name in ("prepare_cpu", "frame_cpu")),
        *(f"{row[name]:,.0f}" for name in ("method_megabytes", "peak_megabytes")),
    ]


HEAD = ["trees", "triangles", "kept as", "method", "prepare, processor s", "frame, processor s"]
HEAD += ["hierarchy, MB", "peak, MB"]


def spent() -> float:
    """Return the processor seconds of this process so far."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def measure(arguments: argparse.Namespace, trees: int, side: str, method: str) -> dict[str, Any]:
    """Return what a forest takes in this process."""
    size, at = arguments.size, [spent()]
    instances = "always" if side == "instances" else "never"
    setup = ss.scenes.forest(size, size, trees=trees, instances=instances)
    own = {
        "hard": ss.Hard(),
        "ray_traced": ss.RayTraced(samples=arguments.samples),
        "error": ss.RayTraced(error=0.02),
    }[method]
    at.append(spent())
    prepared = ss.prepare(setup.scene, setup.light, own)
    at.append(spent())
    image = prepared.render(setup.camera)
    at.append(spent())
    meshes = {id(m.vertices): len(m.faces) for m in setup.scene.meshes}
    return {
        "trees": trees,
        "triangles": setup.scene.triangle_count,
        "stored": sum(meshes.values()),
        "kept": side,
        "method": method,
        "added_cpu": at[1] - at[0],
        "prepare_cpu": at[2] - at[1],
        "frame_cpu": at[3] - at[2],
        "frame_seconds": image.seconds["frame"],
        "camera_share": image.seconds["receivers"] / image.seconds["frame"],
        "method_megabytes": image.bytes / 1e6,
        "peak_megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--trees", type=int, nargs="+", default=[20, 100, 1000])
    parser.add_argument("--most", type=int, default=20, help="trees that one list is made of")
    parser.add_argument("--write", action="store_true", help="put the table on the page")
    parser.add_argument("--row", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.row:
        trees, side, method = arguments.row
        sys.stdout.write(json.dumps(measure(arguments, int(trees), side, method)))
        return
    rows = []
    for trees in arguments.trees:
        for side in SIDES:
            if side == "one list" and trees > arguments.most:
                continue
            for method in ("hard", "ray_traced", "error"):
                row = ["--row", str(trees), side, method]
                run = [sys.executable, __file__, *sys.argv[1:], *row]
                out = subprocess.run(run, check=True, capture_output=True, text=True).stdout
                rows.append(json.loads(out))
    table("instances", rows)
    if arguments.write:
        fill(PAGE, BEGIN, END, markdown(HEAD, [shown(row) for row in rows]))


if __name__ == "__main__":
    main()
