"""What runs where a case is measured: in this process, in another, or on another machine.

A task names its scene by a digest, and comes with the path of a file that has the scene, which a
process of the same machine reads once. One that cannot read it says so, and is sent the scene.
"""

from __future__ import annotations

import os
import pickle
import platform
import sys
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime, timezone
from functools import cache
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from softshadow import parallel
from softshadow._core import __version__
from softshadow.camera import Camera
from softshadow.entries import Mesh, Spheres
from softshadow.light import LightLike
from softshadow.machine import processor
from softshadow.methods import Method
from softshadow.renderers import Measurable, rendered
from softshadow.scene import scene_of

__all__ = ["Entries", "Outcome", "Task", "machine", "machine_to_itself", "run"]

Entries: TypeAlias = "tuple[Mesh | Spheres, ...]"

_MOST_SCENES = 4
"""That a process keeps; the cases of one scene come one after the other."""

_scenes: OrderedDict[str, Entries] = OrderedDict()
_scenes_lock = threading.Lock()
_machine_lock = threading.Lock()


@dataclass(frozen=True)
class Task:
    """Pictures of one scene by one or more methods.

    Attributes
    ----------
    name : str
        No two tasks of a sweep have the same.
    scene : str
        The digest of its entries.
    light, camera
        As of `render`.
    methods : tuple of Method or Renderer
        A picture each.
    pictures : bool
        Whether the pictures are wanted, or the times only.
    threads : int or None
    alone : bool
        Whether nothing else that a sweep runs may run on the machine meanwhile.
    """

    name: str
    scene: str
    light: LightLike
    camera: Camera
    methods: tuple[Measurable, ...]
    pictures: bool
    threads: int | None
    alone: bool


@dataclass(frozen=True)
class Outcome:
    """What became of a task.

    Attributes
    ----------
    missing : bool
        The process does not know the scene: send the task with it.
    error : str or None
        What went wrong.
    seconds : dict
        Of the last picture, by stage.
    bytes : int or None
    threads : int
    machine, version, time : str
        The version is this package's and, of a renderer, its own as well. The time is the end's,
        UTC, as ISO 8601 has it.
    worker, host : str or None
        Where Dask finds the process, and its machine.
    pictures : tuple of ndarray, shape (H, W) or (L, H, W)
        Visibilities.
    mask : ndarray, shape (H, W), or None
    """

    missing: bool = False
    error: str | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    bytes: int | None = 0
    threads: int = 0
    machine: str = ""
    version: str = ""
    time: str = ""
    worker: str | None = None
    host: str | None = None
    pictures: tuple[npt.NDArray[np.float32], ...] = ()
    mask: npt.NDArray[np.bool_] | None = None


def run(task: Task, source: Entries | str) -> Outcome:
    """Do a task; what goes wrong is an outcome, too.

    Parameters
    ----------
    task : Task
    source : tuple of entries, or str
        The scene's, or the path of a file that has them pickled. It is the sweeping process that
        wrote it, and nobody else can.
    """
    try:
        known = _scene(task.scene, source)
        if known is None:
            return Outcome(missing=True, worker=_dask_worker())
        with machine_to_itself(task.alone), parallel.threads(task.threads):
            return _rendered(task, known)
    except (KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except BaseException as error:  # a panic of the core is no Exception
        return Outcome(error=f"{type(error).__name__}: {error}", **_where())


def _scene(name: str, source: Entries | str) -> Entries | None:
    """Return the entries of a scene, and keep them; None where they cannot be read."""
    with _scenes_lock:
        if name not in _scenes:
            if isinstance(source, str):
                try:
                    with open(source, "rb") as stream:
                        _scenes[name] = pickle.load(stream)
                except OSError:  # this is another machine
                    return None
            else:
                _scenes[name] = source
        _scenes.move_to_end(name)
        while len(_scenes) > _MOST_SCENES:
            _scenes.popitem(last=False)
        return _scenes[name]


def _rendered(task: Task, entries: Entries) -> Outcome:
    """Prepare and render a fresh scene for each method, as `compare` does."""
    pictures = []
    for method in task.methods:
        image = rendered(method, scene_of(entries), task.camera, task.light)
        pictures.append(image.visibility)
    return Outcome(
        seconds=image.seconds,
        bytes=image.bytes,
        pictures=tuple(pictures) if task.pictures else (),
        mask=image.mask if task.pictures else None,
        **_where(method),
    )


def _where(method: Measurable | None = None) -> dict[str, Any]:
    its = "" if method is None or isinstance(method, Method) else f", {method.version}"
    return {
        "threads": parallel.thread_count(),
        "machine": machine(),
        "version": f"{__version__}{its}",
        "time": datetime.now(timezone.utc).isoformat(),
        "host": (_dask_worker() or "").rpartition("://")[2].rpartition(":")[0] or None,
    }


@cache
def machine() -> str:
    """Return what rows call this machine: its name, processor and number of cores."""
    return f"{platform.node()}: {processor()}, {os.cpu_count()} cores"


def _dask_worker() -> str | None:
    """Return the address of Dask's worker that this runs in, if it does."""
    module = sys.modules.get("distributed")
    if module is None:
        return None
    try:
        return str(module.get_worker().address)
    except ValueError:  # no worker runs this
        return None


@contextmanager
def machine_to_itself(wanted: bool) -> Iterator[None]:
    """Keep all else that sweeps of this user run off the machine, for a ``with`` block.

    The lock is on a file in the folder for temporary files; the system takes it from a process that
    ends, however it ends.

    Parameters
    ----------
    wanted : bool
        False: do not wait for others.
    """
    if not wanted:
        yield
        return
    with _machine_lock:
        try:
            import fcntl
        except ImportError:  # within the process, then
            yield
            return
        path = os.path.join(tempfile.gettempdir(), f"softshadow-sweep-{os.getuid()}.lock")
        with open(path, "a") as stream:
            fcntl.lockf(stream, fcntl.LOCK_EX)
            yield
