"""Digests of every picture and kernel's result that the tests make, to compare two builds.

``python -m pytest -p digests --digests before.txt`` in one, ``after.txt`` in the other, then
``python tests/digests.py before.txt after.txt``: bits are kept where no line differs.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import sys
from pathlib import Path

import numpy as np
import softshadow as ss

ARRAYS = (
    "visibility",
    "radiance",
    "mask",
    "position",
    "normal",
    "depth",
    "mesh_id",
    "triangle_id",
)
"""Of an image; its times are not among them."""


def pytest_addoption(parser):
    parser.addoption(
        "--digests", default="digests.txt", help="the file that digests are written to"
    )


def pytest_configure(config):
    path = Path(config.getoption("--digests"))
    path.write_text("")
    config.pluginmanager.register(Recorder(path))


class Recorder:
    """Writes a line for every picture: the test, the picture's number in it, and its digest."""

    def __init__(self, path):
        self.path, self.test, self.lines = path, "", []
        for name in ("render", "visibility"):
            setattr(ss.Prepared, name, self._recording(name, getattr(ss.Prepared, name)))
        for name in ss.kernels.__all__:
            kernel = getattr(ss.kernels, name)
            if not isinstance(kernel, type):
                setattr(ss.kernels, name, self._recording(name, kernel))

    def _recording(self, name, call):
        @functools.wraps(call)
        def recorded(*args, **kwargs):
            result = call(*args, **kwargs)
            digest = hashlib.sha256()
            for array in _arrays(result):
                digest.update(f"{array.dtype} {array.shape}".encode())
                digest.update(np.ascontiguousarray(array).tobytes())
            self.lines.append(f"{name} {digest.hexdigest()[:32]}")
            return result

        return recorded

    def pytest_runtest_setup(self, item):
        self.test, self.lines = item.nodeid, []

    def pytest_runtest_teardown(self, item):
        with self.path.open("a") as file:
            file.writelines(f"{item.nodeid} | {i} {x}\n" for i, x in enumerate(self.lines))
        self.lines = []


def _arrays(result):
    if isinstance(result, np.ndarray):
        return [result]
    if isinstance(result, ss.Image):
        return [np.asarray(getattr(result, name)) for name in ARRAYS]
    if dataclasses.is_dataclass(result):
        values = [getattr(result, field.name) for field in dataclasses.fields(result)]
    else:
        values = result if isinstance(result, (list, tuple)) else []
    return [array for value in values for array in _arrays(value)]


def _read(path):
    lines = (line.rsplit(" ", 1) for line in Path(path).read_text().splitlines())
    return dict(lines)


def main(before, after):
    """Print what two files differ in."""
    a, b = _read(before), _read(after)
    both = a.keys() & b.keys()
    different = sorted(key for key in both if a[key] != b[key])
    print(f"{len(both)} results in both, {len(different)} of them different")
    print("\n".join(different))
    return bool(different)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
