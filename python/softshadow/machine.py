"""What a measurement was made on, in words."""

from __future__ import annotations

import os
import platform
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from softshadow import _core
from softshadow.parallel import thread_count

__all__ = ["machine_facts", "processor"]


def machine_facts() -> dict[str, str]:
    """Return what this machine and this process are: processor, system, versions, time."""
    return {
        "processor": f"{processor()}, {os.cpu_count()} hardware threads",
        "threads a call": f"{thread_count()}",
        "vectors": _core.simd_level(),
        "system": platform.platform(terse=True),
        "softshadow": _core.__version__,
        "Python, NumPy": f"{platform.python_version()}, {np.__version__}",
        "written": datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
    }


def processor() -> str:
    """Return the processor's name as the system tells it; Linux tells it in a file only."""
    file = Path("/proc/cpuinfo")
    if file.exists():
        for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine() or "unknown"
