"""A process that may have little memory: an answer or a ``MemoryError``, never the end of it."""

from __future__ import annotations

import os

import fresh
import pytest
import softshadow as ss

PROGRAM = """
import resource, sys
import numpy as np, softshadow as ss

n, method, extra = 300, sys.argv[1], int(sys.argv[2])
x = np.linspace(-1, 1, n + 1)
x, y = np.meshgrid(x, x)
v = np.stack([x, y, 0.1 * np.sin(9 * x) * np.cos(7 * y)], -1).reshape(-1, 3)
i = np.arange(n * (n + 1)).reshape(n, n + 1)[:, :-1].ravel()
f = np.concatenate([np.stack([i, i + 1, i + n + 2], 1), np.stack([i, i + n + 2, i + n + 1], 1)])
camera = ss.Camera((0, -2, 2), (0, 0, 0), width=64, height=64)
pages = int(open("/proc/self/statm").read().split()[0])
limit = pages * resource.getpagesize() + extra * 2**20
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
try:
    scene = ss.Scene()
    for k in range(4):
        scene.add((v + [0, 0, k], f), name=str(k))
    image = ss.render(scene, camera, ss.SphereLight((0, 0, 9), 0.5), method)
    assert 0 <= image.visibility.min() <= image.visibility.max() <= 1
    print("image")
except MemoryError as error:
    print("MemoryError", error)
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="reads the process' own size")
@pytest.mark.parametrize("method", ["ray_traced", "wedges", "mtsm"])
@pytest.mark.parametrize("extra", [5, 60, 200, 500])
def test_little_address_space_is_an_answer_or_a_memory_error(method, extra):
    # Telling the stack of a panic takes memory, too.
    done = fresh.run(PROGRAM, method, extra, RUST_BACKTRACE="1")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(("image", "MemoryError"))


def test_too_much_is_both_a_parameter_error_and_a_memory_error():
    scene = ss.Scene()
    scene.add(([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]))
    huge = ss.Camera((0, 0, 3), (0, 0, 0), up=(0, 1, 0), width=60000, height=60000)
    with pytest.raises(MemoryError, match=r"60000 x 60000 takes \d+\.\d GB, more than there is"):
        ss.render(scene, huge, ss.SphereLight((0, 0, 9), 0.5), "hard")
    assert issubclass(ss.OutOfMemoryError, (ss.ParameterError,))
    assert issubclass(ss.OutOfMemoryError, MemoryError)
