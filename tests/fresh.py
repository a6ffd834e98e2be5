"""Programs in processes that have imported the package and done nothing else.

The import takes longer than most programs, so that one process makes it and is forked for each of
them.
"""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
import textwrap

HERE = os.path.dirname(__file__)

_SERVER = """
import gc, json, os, signal, sys, tempfile
import softshadow

gc.freeze()  # children copy less
for line in sys.stdin:
    task = json.loads(line)
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if child == 0:
            os.dup2(out.fileno(), 1)
            os.dup2(err.fileno(), 2)
            signal.alarm(task["seconds"])
            os.environ.update(task["environment"])
            sys.argv = ["-c", *task["arguments"]]
            exec(compile(task["program"], "<program>", "exec"), {"__name__": "__main__"})
            sys.exit()
        _, status = os.waitpid(child, 0)
        texts = []
        for stream in (out, err):
            stream.seek(0)
            texts.append(stream.read().decode())
    print(json.dumps([os.waitstatus_to_exitcode(status), *texts]), flush=True)
"""


@functools.cache
def _server() -> subprocess.Popen[str]:
    """The process that is forked; it ends with this one, which closes its input."""
    return subprocess.Popen(
        [sys.executable, "-c", _SERVER],
        env={**os.environ, "PYTHONPATH": HERE, "OPENBLAS_NUM_THREADS": "1"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def run(program, *arguments, seconds=120, **environment) -> subprocess.CompletedProcess[str]:
    """What a program printed and how it ended; after so many seconds it is killed."""
    program, arguments = textwrap.dedent(program), [str(a) for a in arguments]
    if not hasattr(os, "fork"):
        return subprocess.run(
            [sys.executable, "-c", program, *arguments],
            env={**os.environ, "PYTHONPATH": HERE, **environment},
            capture_output=True,
            text=True,
            timeout=seconds,
        )
    server = _server()
    assert server.stdin is not None
    assert server.stdout is not None
    task = {"program": program, "arguments": arguments, "seconds": seconds}
    server.stdin.write(json.dumps(task | {"environment": environment}) + "\n")
    server.stdin.flush()
    code, out, err = json.loads(server.stdout.readline())
    return subprocess.CompletedProcess(arguments, code, out, err)
