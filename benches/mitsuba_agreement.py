"""Compare the radiance of `ray_traced` with Mitsuba's on every model and light, with pictures.

    python benches/mitsuba_agreement.py [--size 192] [--samples 4096] [--variant scalar_rgb]
                                        [--models bunny munich san_francisco solids]
                                        [--lights rect disk sphere]

The long version of tests/test_mitsuba.py. benches/README.md says how to read the table.
"""

from __future__ import annotations

import argparse
import csv
import os
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import softshadow as ss
from softshadow import scenes
from softshadow.mitsuba import find_llvm

SEEDS = 4

RESULTS = Path(__file__).parent / "results"


def setup_of(model: str, light: Any, size: int) -> scenes.Setup:
    if model == "bunny":
        return scenes.bunny_on_plane(size, size, light=light)
    if model == "solids":
        return scenes.closed_solids(size, size, light=light)
    return scenes.city(model, size, size, light=light)


def signed(values: np.ndarray, scale: float) -> np.ndarray:
    """Return blue for negative, white for zero and red for positive values, saturating at scale."""
    x = np.clip(values / scale, -1, 1)[..., None]
    red, blue = np.array([0.7, 0.1, 0.1]), np.array([0.1, 0.2, 0.7])
    return np.where(x > 0, 1 - x * (1 - red), 1 + x * (1 - blue))


def picture(path: Path, panels: list[np.ndarray]) -> None:
    joined = np.concatenate([np.broadcast_to(p, (*p.shape[:2], 3)) for p in panels], axis=1)
    imageio.imwrite(path, (np.clip(joined, 0, 1) * 255 + 0.5).astype(np.uint8))


def compare(model: str, light: str, arguments: argparse.Namespace) -> dict[str, Any]:
    setup = setup_of(model, light, arguments.size)
    images = [
        ss.render(setup.scene, setup.camera, setup.light, ss.RayTraced(samples=1024, seed=seed))
        for seed in range(SEEDS)
    ]
    radiance = np.array([image.radiance for image in images], dtype=np.float64)
    mean, variance = radiance.mean(axis=0), radiance.var(axis=0, ddof=1) / SEEDS
    image = images[0]
    theirs = ss.mitsuba.render(
        setup.scene, setup.camera, setup.light, arguments.samples, arguments.variant
    )
    full = ss.mitsuba.unshadowed(setup.scene, setup.camera, setup.light)
    offset = ss.mitsuba.ray_offset(setup.scene, image, setup.light)
    edge = (image.mask != theirs.mask) | (np.abs(image.normal - theirs.normal).max(axis=-1) > 1e-3)
    mask = image.mask & ~offset.contact & ~edge
    as_is = ss.mitsuba.z_test(mean, theirs, variance, mask, unshadowed=full)
    lifted = offset.lift(mean, full)
    test = ss.mitsuba.z_test(lifted, theirs, variance, mask, unshadowed=full)
    maximum = full.max()
    difference = (mean - theirs.radiance).mean(axis=-1) / maximum
    scale = 1 / max(np.percentile(mean, 99), 1e-30)
    picture(
        RESULTS / f"mitsuba_{model}_{light}.png",
        [
            image.visibility[..., None],
            (np.clip(mean * scale, 0, 1)) ** (1 / 2.2),
            (np.clip(theirs.radiance * scale, 0, 1)) ** (1 / 2.2),
            signed(np.where(image.mask, difference, 0), 0.02),
            np.where((image.mask & ~mask)[..., None], [1.0, 0.0, 1.0], signed(test.z, 5)),
        ],
    )
    return {
        "model": model,
        "light": light,
        "pixels": test.pixels,
        "contact": int(offset.contact.sum()),
        "edge": int(edge.sum()),
        "failures": test.failures,
        "largest": as_is.largest / maximum,
        "largest_masked": float(np.abs(difference[image.mask]).max()),
        "rms": float(np.sqrt(np.mean(difference[mask] ** 2))),
        "rms_expected": float(np.sqrt(np.mean((theirs.variance + variance)[mask])) / maximum),
        "mean": as_is.mean / maximum,
        "mean_z": as_is.mean_z,
        "mean_lifted": test.mean / maximum,
        "mean_z_lifted": test.mean_z,
        "z_rms": float(np.sqrt(np.mean(test.z[mask] ** 2))),
        "seconds": theirs.seconds,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=192, help="pixels per side")
    parser.add_argument("--samples", type=int, default=4096, help="light samples of Mitsuba's")
    parser.add_argument("--variant", default="scalar_rgb", help="for example llvm_ad_rgb")
    parser.add_argument(
        "--models", nargs="+", default=["bunny", "munich", "san_francisco", "solids"]
    )
    parser.add_argument("--lights", nargs="+", default=["rect", "disk", "sphere"])
    arguments = parser.parse_args()
    llvm = find_llvm()
    if llvm:
        os.environ["DRJIT_LIBLLVM_PATH"] = llvm
    RESULTS.mkdir(exist_ok=True)
    rows = []
    for model in arguments.models:
        for light in arguments.lights:
            row = compare(model, light, arguments)
            if not rows:
                print(" ".join(f"{name:>15}" for name in row))
            rows.append(row)
            cells = (f"{v:15.6f}" if isinstance(v, float) else f"{v:>15}" for v in row.values())
            print(" ".join(cells), flush=True)
    with (RESULTS / "mitsuba_agreement.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    print(f"written: {RESULTS}/mitsuba_agreement.csv and mitsuba_<model>_<light>.png")


if __name__ == "__main__":
    main()
