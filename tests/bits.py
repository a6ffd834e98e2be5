"""Pictures compared to the bit."""

from __future__ import annotations

import hashlib

import numpy as np
import softshadow as ss


def digest(*arrays):
    """A hash of the arrays' bits."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()


def with_threads(call, *counts):
    """What a call gives with each of these numbers of threads, as a set."""
    found = set()
    for count in counts:
        with ss.threads(count):
            found.add(call())
    return found
