"""Render the Stanford bunny's soft shadows with the methods, and say how fast and how wrong.

python examples/demo.py [FOLDER] [--size N] [--budget SECONDS]
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from pathlib import Path

import softshadow as ss
from softshadow import images
from softshadow.comparing import table_text, write_pictures


def main() -> None:
    """Write pictures, a table and a page about them into a folder, and print where."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", default="demo", type=Path)
    parser.add_argument("--size", type=int, default=512, help="pixels a side")
    parser.add_argument(
        "--budget", type=float, default=40.0, help="seconds for all renders; 0: all methods"
    )
    options = parser.parse_args()
    folder: Path = options.folder
    folder.mkdir(parents=True, exist_ok=True)

    start = time.perf_counter()
    setup = ss.scenes.bunny_on_plane(width=options.size, height=options.size)
    print(f"{setup.scene} under {setup.light}")
    # Against 1024 independent samples, whose noise is a tenth of the smallest error in the table.
    result = ss.compare(setup.scene, setup.camera, setup.light, budget=options.budget or None)
    for label, image in {**result.images, "reference": result.reference}.items():
        images.write(folder / f"{label}_visibility.png", image.visibility)
        images.write(folder / f"{label}_radiance.png", image.radiance)
    text = table_text(result)
    (folder / "table.txt").write_text(text + "\n", encoding="utf-8")
    print(text)
    write_pictures(result, folder, "bunny")
    command = shlex.join(["python", *sys.argv])
    page = ss.report(
        result, folder / "report.html", title="The Stanford bunny", commands=["make demo", command]
    )
    print(f"pictures and table in {folder.resolve()}, {time.perf_counter() - start:.1f} s")
    print(f"the page: {page.resolve()}")


if __name__ == "__main__":
    main()
