"""What holds for all tests: how many threads a test has."""

from __future__ import annotations

import os

# Workers of pytest-xdist share the machine's threads. Set before the package or numpy is imported,
# and for the processes that tests start; two at least, so that threads meet.
_WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
if _WORKERS > 1:
    _EACH = max(2, (os.cpu_count() or 1) // _WORKERS)
    os.environ.setdefault("RAYON_NUM_THREADS", str(_EACH))
    for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(_name, "1")
