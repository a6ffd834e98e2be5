"""Runs cases for some time and prints every failure with its seed and what is left of it when made
smaller.

``make fuzz SECONDS=3600 SEED=0``. Cases run in a process of their own, so that one that aborts or
hangs is a failure with a seed, too; another process with a single thread gives the bits to compare
with.
"""

from __future__ import annotations

import argparse
import json
import os
import queue
import subprocess
import sys
import threading
import time

from fuzz.checks import Failure, Run, digest
from fuzz.scenes import make
from fuzz.smaller import program, smallest

# Seconds after which a case hangs.
PATIENCE = 600.0


class Worker:
    """A process that answers a line for every seed."""

    def __init__(self, threads: int) -> None:
        self._threads = threads
        self._start()

    def _start(self) -> None:
        environment = {**os.environ, "RAYON_NUM_THREADS": str(self._threads)}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "fuzz", "--worker", str(self._threads)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, args=(self._process, self._lines), daemon=True).start()

    @staticmethod
    def _read(process, lines) -> None:
        for line in process.stdout:
            lines.put(line)
        lines.put("")

    def send(self, seed: int) -> None:
        self._process.stdin.write(f"{seed}\n")
        self._process.stdin.flush()

    def answer(self) -> tuple[dict, str]:
        """What the process says of the seed, or what became of it."""
        try:
            line = self._lines.get(timeout=PATIENCE)
        except queue.Empty:
            line, what = "", f"no answer within {PATIENCE:.0f} s"
        else:
            what = f"the process ended: {self._process.wait()}" if not line else ""
        if line:
            return json.loads(line), ""
        self.end()
        self._start()
        return {}, what

    def end(self) -> None:
        self._process.kill()
        self._process.wait()


def work(threads: int) -> None:
    """Answers seeds: the bits of all methods and, with more than one thread, what fails."""
    for line in sys.stdin:
        case = make(int(line))
        out: dict = {"bits": digest(case)}
        if threads > 1:
            run = Run(case)
            run.all()
            out["failures"] = [(f.check, f.method, f.what) for f in run.failures]
        print(json.dumps(out), flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=0, help="the first of the cases")
    parser.add_argument("--count", type=int, default=sys.maxsize, help="cases at most")
    parser.add_argument("--worker", type=int, default=0, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        work(options.worker)
        return 0
    many, single = Worker(max(2, os.cpu_count() or 2)), Worker(1)
    end, seed, failed = time.monotonic() + options.seconds, options.seed, 0
    try:
        while time.monotonic() < end and seed < options.seed + options.count:
            many.send(seed)
            single.send(seed)
            (one, broken), (other, broken_too) = many.answer(), single.answer()
            failures = [Failure(c, m, seed, w) for c, m, w in one.get("failures", [])]
            failures += [Failure("answers", "", seed, w) for w in {broken, broken_too} if w]
            for name, bits in one.get("bits", {}).items():
                if other and other["bits"][name] != bits:
                    failures.append(Failure("threads", name, seed, "one thread gives other bits"))
            for failure in failures:
                failed += 1
                print(failure, "|", *sorted(make(seed).tags), flush=True)
            # One of a seed's is enough to look into; a process that ended would end this one.
            if failures and failures[0].check != "threads" and not broken:
                less = smallest(make(seed), failures[0])
                print(program(less, failures[0].method), flush=True)
            seed += 1
    finally:
        many.end()
        single.end()
    print(f"{seed - options.seed} cases from {options.seed}, {failed} failures")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
