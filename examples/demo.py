"""Render the Stanford bunny's soft shadows with every method, and say how fast and how wrong.

python examples/demo.py [FOLDER] [--size N]
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import softshadow as ss
from softshadow import images

# The noise of 1024 samples is a tenth of the smallest error that the table is to show; another
# seed than the methods' own keeps it independent of theirs.
REFERENCE = ss.RayTraced(samples=1024, seed=0x5EED)


def main() -> None:
    """Write pictures and a table into a folder and print where."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", default="demo", type=Path)
    parser.add_argument("--size", type=int, default=512, help="pixels a side")
    options = parser.parse_args()
    folder: Path = options.folder
    folder.mkdir(parents=True, exist_ok=True)

    start = time.perf_counter()
    setup = ss.scenes.bunny_on_plane(width=options.size, height=options.size)
    print(f"{setup.scene} under {setup.light}")
    result = ss.compare(setup.scene, setup.camera, setup.light, reference=REFERENCE, repeats=3)
    for label, image in {**result.images, "reference": result.reference}.items():
        images.write(folder / f"{label}_visibility.png", image.visibility)
        images.write(folder / f"{label}_radiance.png", image.radiance)
        if label != "reference":
            figure = ss.plot.compare(image, result.reference, labels=(label, "reference"))
            figure.savefig(folder / f"{label}_difference.png", dpi=110, bbox_inches="tight")
    result.table.to_csv(folder / "table.csv", index=False)
    columns = ["method", "prepare_seconds", "frame_seconds", "bytes", "mae", "rmse"]
    columns += ["penumbra_mae", "penumbra_rmse", "max", "ssim", "flip"]
    text = result.table[columns].to_string(index=False, float_format=lambda x: f"{x:.5g}")
    (folder / "table.txt").write_text(text + "\n", encoding="utf-8")
    print(text)
    for label, reason in result.skipped.items():
        print(f"{label}: left out ({reason})")
    print(f"pictures and table in {folder.resolve()}, {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
