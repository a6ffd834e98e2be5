"""Runs cases for some time and prints every failure with its seed and what is left of it when made
smaller.

``make fuzz SECONDS=3600 SEED=0``. Cases run in a process of their own, so that one that aborts or
hangs is a failure with a seed, too; another process with a single thread gives the bits to compare
with.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time

import softshadow as ss

from fuzz.checks import Failure, Run, digest
from fuzz.scenes import make
from fuzz.smaller import program, smallest

# Seconds after which a case hangs.
PATIENCE = 600.0

# Forks have what this process has imported, which takes longer than a case.
PROCESSES = multiprocessing.get_context("fork" if hasattr(os, "fork") else "spawn")


class Worker:
    """A process that answers seeds."""

    def __init__(self, threads: int) -> None:
        self._threads = threads
        self._start()

    def _start(self) -> None:
        self._pipe, theirs = PROCESSES.Pipe()
        self._process = PROCESSES.Process(target=work, args=(theirs, self._threads), daemon=True)
        self._process.start()
        theirs.close()

    def send(self, seed: int) -> None:
        self._pipe.send(seed)

    def answer(self) -> tuple[dict, str]:
        """What the process says of the seed, or what became of it."""
        try:
            if self._pipe.poll(PATIENCE):
                return self._pipe.recv(), ""
            what = f"no answer within {PATIENCE:.0f} s"
        except EOFError:
            self._process.join()
            what = f"the process ended: {self._process.exitcode}"
        self.end()
        self._start()
        return {}, what

    def end(self) -> None:
        self._process.kill()
        self._process.join()
        self._pipe.close()


def work(pipe, threads: int) -> None:
    """Answers seeds: the bits of all methods and, with more than one thread, what fails."""
    ss.set_threads(threads)
    while True:
        case = make(pipe.recv())
        out: dict = {"bits": digest(case)}
        if threads > 1:
            run = Run(case)
            run.all()
            out["failures"] = [(f.check, f.method, f.what) for f in run.failures]
        pipe.send(out)


def main() -> int:
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=0, help="the first of the cases")
    parser.add_argument("--count", type=int, default=sys.maxsize, help="cases at most")
    options = parser.parse_args()
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
