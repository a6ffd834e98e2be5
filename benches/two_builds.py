"""Times two builds of the package against each other, frame by frame in turns.

``python benches/two_builds.py BEFORE/.venv/bin/python AFTER/.venv/bin/python --repeats 15``

``--dense`` adds `hard` and `ray_traced` with 4 to 256 samples on scenes of many triangles, such as
``--only "tree 0" "tree 16"``.

Each build renders in a process of its own. A row has the least processor and wall time of a frame
with either, and the median of the ratios of frames that followed each other, which a busy machine
changes least.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time

SIZE = 512
"""Pixels along a picture's sides."""


DENSE_SIZE = 384
"""The same of dense scenes."""

DENSE_SAMPLES = (0, 4, 16, 64, 256)
"""Samples of `ray_traced`; none is `hard`, whose frames are mostly what a camera sees."""


def _dense():
    """Return what makes a scene of many triangles, by name."""
    import softshadow as ss

    size = {"width": DENSE_SIZE, "height": DENSE_SIZE}
    return {
        "tree": lambda: ss.scenes.tree(**size),
        "glass": lambda: ss.scenes.tree(opacity=0.5, **size),
        "fur": lambda: ss.scenes.fur_ball(**size),
        "statue": lambda: ss.scenes.statue(**size),
        "bunny": lambda: ss.scenes.bunny_on_plane(**size),
        "large": lambda: ss.scenes.bunny_on_plane(light_size=1.0, **size),
        "city": lambda: ss.scenes.city(light_size=0.4, **size),
        "scan": lambda: ss.scenes.statue(subdivisions=2, **size),
    }


def _cases():
    """Return scene, light and method by name; a ground, and a body of 28,800 triangles over it."""
    import numpy as np
    import softshadow as ss

    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 121), np.linspace(0, np.pi, 121))
    r = 0.8 * (1 + 0.15 * np.sin(6 * u) * np.sin(v) ** 2 * np.sin(5 * v))
    x = np.stack([r * np.cos(u) * np.sin(v), r * np.sin(u) * np.sin(v), r * np.cos(v) + 1.1], -1)
    ground = (np.array([[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0.0]]), [[0, 1, 2], [0, 2, 3]])

    def scene(mesh, opacity):
        out = ss.Scene()
        out.add(ground, "ground")
        out.add(mesh, "body", opacity=opacity)
        return out

    solid, translucent = (scene((x.reshape(-1, 3), _grid_faces(121)), o) for o in (1.0, 0.5))
    coarse = scene((x[::10, ::10].reshape(-1, 3), _grid_faces(13)), 1.0)
    rect = ss.RectLight((1, 0.5, 4), (0, 0.6, 0), (0.6, 0, 0))
    ball = ss.SphereLight((1, 0.5, 4), 0.3)
    textures = ("accumulation", "convolution")
    cases = {n: (solid, rect, n) for n in ss.method_names() if n not in textures}
    for name in ("ray_traced", "wedges", "ssoc", "mtsm", "single_sample"):
        cases[f"{name} ball"] = (solid, ball, name)
    for name in ("ray_traced", "mtsm", "deep"):
        cases[f"{name} translucent"] = (translucent, rect, name)
    cases["accumulation"] = (coarse, rect, ss.Accumulation(max_size=256))
    cases["convolution"] = (coarse, rect, ss.Convolution(max_size=256))
    cases["accumulation dense"] = (solid, rect, ss.Accumulation(max_size=256))
    cases["convolution dense"] = (solid, rect, ss.Convolution(max_size=256))
    return cases


def _grid_faces(n):
    import numpy as np

    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]
    return np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ([a, d, c], [a, c, b])])


def work():
    """Answer every name of a case on standard input with a frame's wall and processor seconds."""
    import softshadow as ss

    cases, dense, ready, setups = _cases(), _dense(), {}, {}
    cameras = dict.fromkeys(cases, ss.Camera((0.5, -5, 3.5), (0, 0, 0.7), width=SIZE, height=SIZE))
    print(*cases, sep="|", flush=True)
    print(*(f"{name} {n}" for name in dense for n in DENSE_SAMPLES), sep="|", flush=True)
    for line in sys.stdin:
        name = line.strip()
        if name not in cases:
            which, samples = name.split()
            if which not in setups:
                setups = {which: dense[which]()}
            setup = setups[which]
            method = ss.RayTraced(int(samples)) if int(samples) else ss.Hard()
            cases[name] = (setup.scene, setup.light, method)
            cameras[name] = setup.camera
        # Textures are kept after the first picture, which is the one to time.
        textures = name.split()[0] in ("accumulation", "convolution")
        if name not in ready or textures:
            ready = {name: ss.prepare(*cases[name])}
            if not textures:
                ready[name].render(cameras[name])
        wall, cpu = time.perf_counter(), time.process_time()
        ready[name].render(cameras[name])
        print(time.perf_counter() - wall, time.process_time() - cpu, flush=True)


def main():
    """Print a row a case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("before", help="the Python that has the one build")
    parser.add_argument("after", help="the Python that has the other")
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--only", nargs="*", help="names of cases")
    parser.add_argument("--dense", action="store_true", help="dense scenes, too")
    options = parser.parse_args()
    sides = [
        subprocess.Popen(
            [python, __file__, "--work"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for python in (options.before, options.after)
    ]
    names, dense = (
        next(iter([side.stdout.readline().strip().split("|") for side in sides])) for _ in range(2)
    )

    def frame(side, name):
        side.stdin.write(name + "\n")
        side.stdin.flush()
        return [float(x) for x in side.stdout.readline().split()]

    print(f"{'case':24} {'wall ms':>19} {'ratio':>6} {'cpu ms':>19} {'ratio':>6} {'median':>6}")
    for name in options.only or (names + dense if options.dense else names):
        times = [[], []]
        for turn in range(options.repeats):
            for k in (0, 1) if turn % 2 else (1, 0):
                times[k].append(frame(sides[k], name))
        row = f"{name:24}"
        for what in (0, 1):
            before, after = (min(t[what] for t in side) * 1e3 for side in times)
            row += f" {before:9.1f} {after:9.1f} {after / before:6.3f}"
        ratios = [b[1] / a[1] for a, b in zip(*times, strict=True)]
        print(f"{row} {statistics.median(ratios):6.3f}", flush=True)


if __name__ == "__main__":
    work() if sys.argv[1:] == ["--work"] else main()
