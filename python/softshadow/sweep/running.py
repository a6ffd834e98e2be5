"""`sweep`: measures cases by an executor, and returns their table."""

from __future__ import annotations

import os
import pickle
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from softshadow import checks
from softshadow.arguments import Bar, Progress
from softshadow.camera import Camera
from softshadow.extras import require
from softshadow.light import LightLike
from softshadow.renderers import Measurable, resolve_measurable
from softshadow.sweep.cases import Case, Made, made, resolved
from softshadow.sweep.columns import row_of
from softshadow.sweep.digests import digest
from softshadow.sweep.groups import Group, OpenCase, Settings, Step
from softshadow.sweep.pools import Pool
from softshadow.sweep.references import REFERENCE, SHARE, Reference
from softshadow.sweep.store import FORMAT, Store
from softshadow.sweep.work import Entries, Outcome

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import pandas as pd

__all__ = ["sweep"]


def sweep(
    cases: Iterable[Case],
    store: str | os.PathLike[str] = "results.parquet",
    executor: Executor | None = None,
    reference: str | Measurable | None = None,
    repeats: int = 3,
    images: str | os.PathLike[str] | None = None,
    progress: Progress = True,
    *,
    threads: int | None = None,
    alone: bool = True,
    repeat_seconds: float | None = None,
    reference_seconds: float | None = None,
    retry: bool = False,
) -> pd.DataFrame:
    """Measure cases, keep each in a store as soon as it is known, and return their table.

    A case that the store has already is not measured again: a sweep that was killed goes on where
    it was. A case is known by its contents (the scene's geometry and looks, light, camera, method
    with its parameters, `repeats`, `threads`, `reference`), not by its names.

    Methods of one scene, light and camera take turns; each turn prepares and renders a fresh copy
    of the scene, as `compare` does. Errors are against a reference for each scene, light and
    camera, which is made once and kept in the store.

    Parameters
    ----------
    cases : iterable of Case
        As `grid` makes them.
    store : path
        A folder of Parquet files, made where there is none.
    executor : concurrent.futures.Executor, optional
        Where cases are measured: a process pool, Dask's ``Client.get_executor()``, anything with
        that interface. In this process, when not given.
    reference : str, method or renderer, optional
        With samples and seed: two pictures with seeds of their own and at most so many samples
        each, which grow until their mean's own error is a tenth of the smallest that it judges.
        Without: one picture. `RayTraced` with up to 16384 samples, when not given.
    repeats : int
        How often each case is rendered, at least 1.
    images : path, optional
        A folder for an ``.npz`` file of each case: ``visibility``, ``reference`` and ``mask``. A
        case of the store that has none is measured again.
    progress : bool or callable
        ``True`` for a progress bar that says what remains, or a function that is told the finished
        fraction.
    threads : int, optional
        That each case has, as of `set_threads`. When not given, what a process has where the case
        is measured; the table says how many.
    alone : bool
        Whether a case has its machine to itself: nothing else of any sweep of this user runs there
        meanwhile, whatever the number of workers. False: times are of a busy machine.
    repeat_seconds : float, optional
        A case is repeated only while preparing and rendering it has taken less than that in all:
        slow ones have fewer repeats, one at least, and their rows say how many.
    reference_seconds : float, optional
        A better reference is made only where that is likely to take less than so long; rows of
        errors that it is too coarse for have ``reference_converged`` false.
    retry : bool
        Whether cases that failed before are measured again.

    Returns
    -------
    pandas.DataFrame
        One row a case, in the order given: ``scene``, ``light``, ``camera``, ``method``, ``label``,
        ``parameters`` (as in `compare`) and each parameter (``method_error`` and ``method_bias``
        for those two); for every stage, as for ``prepare`` and ``frame``, ``prepare_seconds`` (the
        median over the repeats), ``prepare_seconds_min`` and ``prepare_seconds_spread`` (largest
        less smallest); the numbers of `metrics.errors`; ``reference`` and its own
        ``reference_rmse`` and ``reference_mae``, and ``reference_converged``, whether that is below
        a tenth of the case's ``rmse``; ``bytes``, ``repeats``, ``threads``, ``machine``,
        ``version``, ``time`` (UTC), ``image``, ``key``; and ``error``, the message where a case
        failed.

    Raises
    ------
    ValueError
        If the store is none of a sweep's or of another version of the format, if another process
        writes to it, or there are no cases.
    TypeError
        If a case is no `Case`.

    Examples
    --------
    >>> import tempfile
    >>> import softshadow as ss
    >>> scenes = {"plane": lambda: ss.scenes.half_plane(16, 12)}
    >>> cases = ss.grid(scene=scenes, method=["hard", ss.RayTraced(samples=16)])
    >>> store = tempfile.mkdtemp() + "/results.parquet"
    >>> table = ss.sweep(cases, store, repeats=1, progress=False)
    >>> table["label"].tolist()
    ['hard', 'ray_traced(samples=16)']
    >>> bool(table["rmse"][0] > table["rmse"][1])
    True
    """
    require("sweep", "a sweep", "flip_evaluator", "pyarrow", "skimage.metrics")
    asked = list(cases)
    for case in asked:
        if not isinstance(case, Case):
            raise TypeError(f"cases: expected softshadow.Case, got {checks.shown(case)}")
    if not asked:
        raise ValueError("cases: expected at least one")
    settings = Settings(
        repeats=checks.integer(repeats, "repeats", 1, 1_000_000),
        threads=None if threads is None else checks.integer(threads, "threads", 1, 1024),
        alone=checks.flag(alone, "alone"),
        reference=REFERENCE if reference is None else resolve_measurable(reference),
        images=None if images is None else Path(images),
        repeat_seconds=_seconds(repeat_seconds, "repeat_seconds"),
        reference_seconds=_seconds(reference_seconds, "reference_seconds"),
    )
    bar = Bar(progress, "sweep")
    kept = Store(store)
    with kept.writing(), bar:
        plan = _Plan(kept, asked, settings, checks.flag(retry, "retry"))
        _Driver(plan, Pool(executor), bar).run()
    table = kept.table(plan.keys)
    for name, attribute in _NAMES.items():  # a case may have had another name when it was measured
        table[name] = [getattr(case, attribute) for case in asked]
    return table


def _seconds(value: float | None, what: str) -> float | None:
    return None if value is None else checks.number(value, what, "seconds")


_NAMES = {"scene": "scene_name", "light": "light_name", "camera": "camera_name", "label": "label"}


@dataclass
class _Scene:
    """What a case's source made, or why it made nothing."""

    its: Made | None
    digest: str
    entries: Entries = ()
    error: str | None = None


@dataclass
class _Plan:
    """Which cases there are, and which are to be measured."""

    store: Store
    asked: list[Case]
    settings: Settings
    retry: bool
    keys: list[str] = field(default_factory=list)
    groups: dict[str, Group] = field(default_factory=dict)
    entries: dict[str, Entries] = field(default_factory=dict)

    def __post_init__(self) -> None:
        scenes: dict[int | str, _Scene] = {}
        open_cases: dict[str, tuple[tuple[str, LightLike, Camera], list[OpenCase]]] = {}
        finished, turns = self.store.finished(), self.store.turns()
        known: set[str] = set()
        done: set[str] = set()
        for case in self.asked:
            source = case.scene if isinstance(case.scene, str) else id(case.scene)
            if source not in scenes:
                scenes[source] = _made(case)
            scene = scenes[source]
            s = self.settings
            method = resolve_measurable(case.method)
            names = {name: getattr(case, attribute) for name, attribute in _NAMES.items()}
            error = f"left out: {case.left_out}" if case.left_out else scene.error
            where: tuple[str, LightLike, Camera] | None = None
            if scene.its is not None and not case.left_out:
                try:
                    where = (scene.digest, *resolved(case, scene.its))
                except Exception as problem:
                    error = f"{type(problem).__name__}: {problem}"
            what = where if where is not None else ("failed", error, *names.values())
            rules: tuple[object, ...] = (s.repeats, s.threads, s.reference, SHARE)
            for name in ("repeat_seconds", "reference_seconds"):
                limit = getattr(s, name)
                rules += () if limit is None else (name, limit)
            key = digest("case", FORMAT, what, method, rules)
            self.keys.append(key)
            if key in known:
                continue
            known.add(key)
            if key in finished and self._stays(key):
                done.add(key)
                continue
            opened = OpenCase(key, method, names, turns.get(key, {}))
            if where is None:
                self._cannot(opened, str(error))
                continue
            group = digest("reference", where, s.reference)
            open_cases.setdefault(group, (where, []))[1].append(opened)
            self.entries[scene.digest] = scene.entries
        self.store.tidy(done)
        for group, (place, cases) in open_cases.items():
            reference = Reference(
                self.store, group, self.settings.reference, self.settings.reference_seconds
            )
            self.groups[group] = Group(self.store, *place, reference, cases, self.settings)

    def _stays(self, key: str) -> bool:
        """Whether a finished case need not be measured again."""
        images = self.settings.images
        pictured = images is None or (images / f"{key}.npz").exists()
        if pictured and not self.retry:
            return True
        failed = bool(self.store.failed({key}))
        return not self.retry if failed else pictured

    def _cannot(self, case: OpenCase, error: str) -> None:
        """Write the row of a case whose scene, light or camera cannot be made."""
        row = {**case.names, **row_of(case.method, []), "key": case.key, "error": error}
        self.store.write(case.key, row)


def _made(case: Case) -> _Scene:
    try:
        its = made(case.scene)
    except Exception as problem:
        return _Scene(None, "", error=f"{type(problem).__name__}: {problem}")
    entries = its.scene.entries
    return _Scene(its, digest("scene", entries), entries)


class _Driver:
    """Hands steps to a pool and what comes back to their groups.

    The cases of the first group come first; those after it run beside them only where the first
    has nothing to do for a worker.
    """

    def __init__(self, plan: _Plan, pool: Pool, bar: Bar) -> None:
        self._groups = [group for group in plan.groups.values() if not group.finished]
        self._entries = plan.entries
        self._pool = pool
        self._bar = bar
        self._all = len(set(plan.keys))
        self._turns = self._all * plan.settings.repeats
        self._flight: dict[Any, tuple[Group, Step]] = {}
        self._suspects: deque[tuple[Group, Step]] = deque()
        self._suspect: Step | None = None
        self._folder: TemporaryDirectory[str] | None = None

    def run(self) -> None:
        """Return when all cases are rows."""
        self._say()
        with self._leaving():
            while True:
                self._fill()
                if not self._flight:
                    break
                done = self._pool.some(self._flight)
                for future in sorted(done, key=self._died):  # what came back is kept
                    if future in self._flight:  # not lost with a pool that broke
                        self._take(future)
                self._groups = [group for group in self._groups if not group.finished]
                self._say()

    @contextmanager
    def _leaving(self) -> Iterator[None]:
        """However it ends, nothing is left behind that runs."""
        try:
            yield
        finally:
            for future in self._flight:
                future.cancel()
            self._pool.close()
            if self._folder is not None:
                self._folder.cleanup()

    def _fill(self) -> None:
        """Give each worker something to do; what may have killed one runs by itself."""
        if self._suspect is not None:
            return
        if self._suspects:
            if not self._flight:
                group, self._suspect = self._suspects.popleft()
                self._submit(group, self._suspect)
            return
        for group in self._groups:
            while len(self._flight) < self._pool.width:
                step = group.next()
                if step is None:
                    break
                self._submit(group, step)

    def _submit(self, group: Group, step: Step) -> None:
        source = self._entries[group.scene] if self._pool.here else self._file(group.scene)
        self._flight[self._pool.submit(step.task, source, step.host)] = (group, step)

    def _file(self, scene: str) -> str:
        """Return the path of a scene's file, which only this user can write."""
        if self._folder is None:
            self._folder = TemporaryDirectory(prefix="softshadow-sweep-")
        path = Path(self._folder.name) / f"{scene}.pickle"
        if not path.exists():
            path.write_bytes(pickle.dumps(self._entries[scene]))
        return str(path)

    def _died(self, future: Any) -> bool:
        """Whether a step ended with its worker process."""
        return not future.cancelled() and isinstance(future.exception(), self._pool.broken)

    def _take(self, future: Any) -> None:
        group, step = self._flight.pop(future)
        try:
            outcome = future.result()
        except self._pool.broken as error:
            self._lost(group, step, error)
            return
        except self._pool.cancelled as error:  # by a cluster that is gone, say: no fault of a case
            raise RuntimeError("executor: it has dropped its work; sweep again") from error
        except Exception as error:
            outcome = Outcome(error=f"{type(error).__name__}: {error}")
        if outcome.missing:
            source = self._entries[group.scene]
            future = self._pool.submit(step.task, source, outcome.worker)
            self._flight[future] = (group, step)
            return
        self._suspect = None
        group.take(step, outcome)

    def _lost(self, group: Group, step: Step, error: Exception) -> None:
        """Find out whose fault it is that a worker process died, where it may be several's."""
        others = list(self._flight.values())
        self._flight.clear()
        self._suspect = None
        self._pool.renew(error)
        if others:
            self._suspects.extend([(group, step), *others])
        else:
            group.take(step, Outcome(error=f"the worker process died: {error}"))

    def _say(self) -> None:
        left = sum(group.left for group in self._groups)
        done = 1 - sum(group.turns_left for group in self._groups) / self._turns
        report = self._bar.part(0, 1, f"sweep: {left} of {self._all} cases left")
        if callable(report) and done < 1:
            report(done)
