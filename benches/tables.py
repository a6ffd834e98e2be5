"""What the benchmarks share: tables, frames in turn, errors against the reference."""

from __future__ import annotations

import csv
import statistics
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import softshadow as ss
from softshadow.scenes import Setup

RESULTS = Path(__file__).parent / "results"

FRAMES = 2
"""Frames that are counted of a turn."""


def table(name: str, rows: Iterable[dict[str, Any]]) -> None:
    """Print rows as they come and write them to ``results/<name>.csv``, with how many threads."""
    done: list[dict[str, Any]] = []
    print(f"\n{name} ({ss.thread_count()} threads)", flush=True)
    for row in ({**row, "threads": ss.thread_count()} for row in rows):
        if not done:
            print(" | ".join(row))
        cells = [f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()]
        print(" | ".join(cells), flush=True)
        done.append(row)
    RESULTS.mkdir(exist_ok=True)
    with (RESULTS / f"{name}.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(done[0]))
        writer.writeheader()
        writer.writerows(done)


def dynamic_frame(setup: Setup, method: ss.Method, stages: Sequence[str]) -> dict[str, float]:
    """Return one frame's milliseconds by stage, with everything rebuilt but the adjacency.

    `stages` are those of preparing that a frame pays again.
    """
    seconds = ss.render(setup.scene, setup.camera, setup.light, method).seconds
    found = {name: seconds.get(name, 0.0) for name in stages}
    found |= {name: seconds[name] for name in ("receivers", "shade")}
    found["rest"] = seconds["frame"] - seconds["receivers"] - seconds["shade"]
    found["total"] = seconds["frame"] + sum(found[name] for name in stages)
    return {name: 1e3 * value for name, value in found.items()}


def in_turn(
    cases: Sequence[tuple[dict[str, Any], Callable[[], dict[str, float]]]], repeats: int
) -> Iterable[dict[str, Any]]:
    """Time cases in turn, round after round, and yield the medians of their stages.

    A turn renders a few frames one after the other, as an animation would; the first, which finds
    the caches full of another case and may build adjacency, is not counted.
    """
    frames: list[list[dict[str, float]]] = [[] for _ in cases]
    for _ in range(repeats):
        for case, (_, frame) in zip(frames, cases, strict=True):
            frame()
            case.extend(frame() for _ in range(FRAMES))
    for (labels, _), case in zip(cases, frames, strict=True):
        medians = {name: statistics.median(f[name] for f in case) for name in case[0]}
        yield labels | medians | {"fps": 1e3 / medians["total"]}


def against_reference(
    scenes: dict[str, Setup], methods: dict[str, ss.Method], samples: int
) -> Iterable[dict[str, Any]]:
    """Yield errors over the pixels that the reference sees partly lit."""
    for name, setup in scenes.items():
        reference = ss.render(setup.scene, setup.camera, setup.light, ss.RayTraced(samples))
        partly = reference.mask & (reference.visibility > 0.002) & (reference.visibility < 0.998)
        for label, method in methods.items():
            image = ss.render(setup.scene, setup.camera, setup.light, method)
            everywhere = image.visibility.astype(np.float64) - reference.visibility
            error = everywhere[partly]
            yield {
                "scene": name,
                "method": label,
                "penumbra": float(partly.sum() / reference.mask.sum()),
                "mae": float(np.abs(error).mean()),
                "rmse": float(np.sqrt((error**2).mean())),
                "bias": float(error.mean()),
                "mae all": float(np.abs(everywhere[reference.mask]).mean()),
                "ms": 1e3 * image.seconds["shade"],
            }


def fill(page: Path, begin: str, end: str, text: str) -> None:
    """Put a text between two marks of a page, each of which it has once."""
    head, rest = page.read_text(encoding="utf-8").split(begin)
    _, tail = rest.split(end)
    page.write_text(f"{head}{begin}\n\n{text.strip()}\n\n{end}{tail}", encoding="utf-8")
