"""Where LLVM is, which Mitsuba's vectorised variants compile their kernels with."""

from __future__ import annotations

import glob
import os

__all__ = ["find_llvm"]

_PLACES = (
    "/usr/lib/*/libLLVM-19.so*",
    "/usr/lib/*/libLLVM.so.19*",
    "/usr/lib/llvm-19/lib/libLLVM*.so*",
    "/usr/lib64/libLLVM*19*.so*",
    "/opt/homebrew/opt/llvm@19/lib/libLLVM.dylib",
)


def find_llvm() -> str | None:
    """Return the path of LLVM 19's library: older ones abort the process where there is AVX-512.

    Returns
    -------
    str or None
        What the environment's ``DRJIT_LIBLLVM_PATH`` names comes first; None where there is none.
    """
    if os.environ.get("DRJIT_LIBLLVM_PATH"):
        return os.environ["DRJIT_LIBLLVM_PATH"]
    found = sorted(path for pattern in _PLACES for path in glob.glob(pattern))
    return found[0] if found else None
