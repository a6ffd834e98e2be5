"""Time and error of `counted` where an error is allowed, beside `ray_traced` with the same.

    RAYON_NUM_THREADS=1 python benches/counted.py [--scenes NAME ...] [--size 256] [--repeats 5]

Prints processor seconds of a frame, the least of some turns, and the RMSE of visibility over all
pixels that show a surface: against 4096 samples of `ray_traced`, and against `counted` of every
pixel. The table of ``docs/methods/counted.md`` is its output.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import softshadow as ss
from softshadow.scenes import Setup
from tables import table

ERRORS = (0.02, 0.01, 0.005)

SCENES: dict[str, Callable[[int], Setup]] = {
    "bunny": lambda size: ss.scenes.bunny_on_plane(size, size, light_size=1.0),
    "munich": lambda size: ss.scenes.city("munich", size, size),
    "statue": lambda size: ss.scenes.statue(size, size),
    "scan": lambda size: ss.scenes.statue(size, size, subdivisions=2),
}


def methods() -> dict[str, ss.Method]:
    """Return what is compared, by its label."""
    found: dict[str, ss.Method] = {"counted": ss.Counted()}
    found |= {f"counted {error}": ss.Counted(error=error) for error in ERRORS}
    found |= {f"ray_traced {e}": ss.RayTraced(samples=4096, error=e) for e in ERRORS}
    return found | {"ray_traced, 256": ss.RayTraced(samples=256)}


def rows(names: list[str], size: int, repeats: int) -> Iterator[dict[str, Any]]:
    """Yield a row a scene and method."""
    for name in names:
        setup = SCENES[name](size)
        many = ss.RayTraced(samples=4096, seed=24301)
        reference = ss.render(setup.scene, setup.camera, setup.light, many)
        ready = {k: ss.prepare(setup.scene, setup.light, m) for k, m in methods().items()}
        images = {label: one.render(setup.camera) for label, one in ready.items()}
        seconds = dict.fromkeys(ready, np.inf)
        for _ in range(repeats):
            for label, one in ready.items():
                before = time.process_time()
                one.render(setup.camera)
                seconds[label] = min(seconds[label], time.process_time() - before)
        for label, image in images.items():
            off = [
                (image.visibility.astype(np.float64) - other.visibility)[image.mask]
                for other in (reference, images["counted"])
            ]
            yield {
                "scene": name,
                "method": label,
                "cpu s": seconds[label],
                "rmse": float(np.sqrt((off[0] ** 2).mean())),
                "to counted": float(np.sqrt((off[1] ** 2).mean())),
            }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    table("counted", rows(options.scenes, options.size, options.repeats))


if __name__ == "__main__":
    main()
