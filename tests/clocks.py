"""How long a process works, by clocks that other processes on the machine do not push on."""

from __future__ import annotations

import time
from pathlib import Path

TASKS = Path("/proc/self/task")


class Stopwatch:
    """Processor time of this process from now on."""

    def __init__(self) -> None:
        self._whole, self._threads = time.process_time(), _threads()

    def seconds(self) -> float:
        """Of all threads together."""
        return time.process_time() - self._whole

    def longest(self) -> float:
        """Of the thread that worked longest: as long as one waits for it on an idle machine.

        Threads that ended meanwhile count as one. Without Linux's counters, that of all together.
        """
        now = _threads()
        each = [seconds - self._threads.get(name, 0.0) for name, seconds in now.items()]
        return max([self.seconds() - sum(each), *each])


def _threads() -> dict[str, float]:
    """Processor time of each thread there is, by its number."""
    found = {}
    for task in TASKS.iterdir() if TASKS.exists() else ():
        try:
            found[task.name] = int((task / "schedstat").read_text().split()[0]) * 1e-9
        except OSError:  # it has just ended, or the kernel does not count
            continue
    return found
