"""The cases of one scene, light and camera: what is to be done next, and what becomes a row.

Methods take turns: each renders once, then each renders again, so that a machine that slows down
slows all of them. The first pictures say how good the reference has to be. A case that has all its
repeats, and a reference, is a row at once.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from softshadow import metrics
from softshadow.camera import Camera
from softshadow.light import LightLike
from softshadow.renderers import Measurable
from softshadow.sweep.columns import row_of
from softshadow.sweep.references import Reference
from softshadow.sweep.store import Store
from softshadow.sweep.work import Outcome, Task, machine_to_itself

__all__ = ["Group", "OpenCase", "Settings", "Step"]


@dataclass(frozen=True)
class Settings:
    """What holds for all cases of a sweep.

    Attributes
    ----------
    repeats : int
    threads : int or None
    alone : bool
    reference : Method or Renderer
    images : Path or None
        The folder of the pictures.
    repeat_seconds : float or None
    reference_seconds : float or None
    """

    repeats: int
    threads: int | None
    alone: bool
    reference: Measurable
    images: Path | None
    repeat_seconds: float | None = None
    reference_seconds: float | None = None


@dataclass(eq=False)
class OpenCase:
    """A case that has no row yet.

    Attributes
    ----------
    key : str
    method : Method or Renderer
    names : dict
        ``scene``, ``light``, ``camera`` and ``label``, as the table has them.
    turns : dict
        What is known of each repeat, by its number.
    started : int
        The number of the next repeat.
    flying : int
        Repeats that are under way.
    """

    key: str
    method: Measurable
    names: dict[str, str]
    turns: dict[int, dict[str, Any]] = field(default_factory=dict)
    started: int = 0
    flying: int = 0

    def pooled(self) -> list[dict[str, Any]]:
        """Return the repeats of the one machine that did the most; others are not mixed in."""
        kinds = Counter(_where(turn) for turn in self.turns.values())
        if not kinds:
            return []
        best = kinds.most_common(1)[0][0]
        return [turn for _, turn in sorted(self.turns.items()) if _where(turn) == best]


def _where(turn: dict[str, Any]) -> tuple[Any, ...]:
    return turn["machine"], turn["threads"], turn["version"]


@dataclass(frozen=True)
class Step:
    """What is to be done next: a repeat of a case, or without a case a reference.

    Attributes
    ----------
    task : Task
    case : OpenCase or None
    number : int
        Of the repeat.
    host : str or None
        Where repeats of the case ran before.
    """

    task: Task
    case: OpenCase | None = None
    number: int = 0
    host: str | None = None


class Group:
    """The open cases of one scene, light and camera.

    Parameters
    ----------
    store : Store
    scene : str
        The digest of its entries.
    light, camera
        As of `render`.
    reference : Reference
    cases : list of OpenCase
        Not empty.
    settings : Settings
    """

    def __init__(
        self,
        store: Store,
        scene: str,
        light: LightLike,
        camera: Camera,
        reference: Reference,
        cases: list[OpenCase],
        settings: Settings,
    ) -> None:
        self.scene = scene
        self._store = store
        self._light, self._camera = light, camera
        self._reference = reference
        self._settings = settings
        self._open = list(cases)
        self._judged: float | None = None
        for case in self._open:
            if not store.picture(case.key).exists():  # killed between a picture and its times
                case.turns.clear()
            case.started = max(case.turns, default=-1) + 1

    @property
    def finished(self) -> bool:
        """Whether all its cases are rows."""
        return not self._open

    @property
    def left(self) -> int:
        """How many cases are not rows."""
        return len(self._open)

    @property
    def turns_left(self) -> int:
        """How many repeats are not done; a case that waits for its row counts as one."""
        return sum(max(1, self._wanted(case) - len(case.pooled())) for case in self._open)

    def next(self) -> Step | None:
        """Return what can be done now, if there is anything."""
        first = [case for case in self._open if not case.turns]
        if waiting := [case for case in first if not case.flying]:
            return self._turn(waiting[0])
        if first or not self._open or self._reference.flying:
            return None
        if not self._settled():
            self._reference.flying = True
            methods = self._reference.next()
            name = f"reference {self._open[0].key} {getattr(methods[0], 'samples', 0)}"
            return Step(self._task(name, methods, pictures=True))
        self._finish()
        wanting = [case for case in self._open if self._done(case) < self._wanted(case)]
        return self._turn(min(wanting, key=self._done)) if wanting else None

    def take(self, step: Step, outcome: Outcome) -> None:
        """Keep what became of a step."""
        case = step.case
        if case is None:
            self._reference.flying = False
            self._judged = None
            with machine_to_itself(self._settings.alone):
                self._reference.take(step.task.methods, outcome)
        else:
            case.flying -= 1
            if case not in self._open:  # failed meanwhile
                return
            if outcome.error is not None:
                self._write(case, outcome.error, outcome)
                return
            self._keep(case, step.number, outcome)
        pictured = bool(self._open) and all(c.turns for c in self._open)
        if pictured and not self._reference.flying and self._settled():
            self._finish()

    def _keep(self, case: OpenCase, number: int, outcome: Outcome) -> None:
        if outcome.pictures and not case.turns:
            path = self._store.picture(case.key)
            assert outcome.mask is not None
            self._store.save(path, visibility=outcome.pictures[0], mask=outcome.mask)
        names = ("seconds", "bytes", "machine", "threads", "version", "time", "host")
        turn = {name: getattr(outcome, name) for name in names}
        self._store.add_turn(case.key, number, turn)
        case.turns[number] = turn

    def _done(self, case: OpenCase) -> int:
        return len(case.pooled()) + case.flying

    def _wanted(self, case: OpenCase) -> int:
        """Return how many repeats a case is to have, as far as its times tell already."""
        most, limit = self._settings.repeats, self._settings.repeat_seconds
        turns = case.pooled()
        taken = sum(turn["seconds"]["prepare"] + turn["seconds"]["frame"] for turn in turns)
        return most if not turns or limit is None or taken < limit else min(most, len(turns))

    def _turn(self, case: OpenCase) -> Step:
        number = case.started
        case.started += 1
        case.flying += 1
        task = self._task(f"{case.key} {number}", (case.method,), pictures=not case.turns)
        host = case.pooled()[-1]["host"] if case.turns else None
        return Step(task, case, number, host)

    def _task(self, name: str, methods: tuple[Measurable, ...], pictures: bool) -> Task:
        s = self._settings
        return Task(
            name, self.scene, self._light, self._camera, methods, pictures, s.threads, s.alone
        )

    # ------------------------------------------------------------ rows

    def _settled(self) -> bool:
        """Whether the reference is as good as it has to be, or cannot be made better."""
        reference = self._reference
        if reference.error is not None or reference.exhausted():
            return True
        return reference.made and reference.good_for(self._smallest())

    def _smallest(self) -> float:
        """Return the smallest error of the open cases against the reference as it is."""
        if self._judged is None:
            truth, mask = self._reference.arrays()
            if not mask.any():
                return math.inf  # an error of each case, later
            with machine_to_itself(self._settings.alone):
                pictures = (self._picture(case) for case in self._open)
                self._judged = min(metrics.rmse(picture, truth, mask) for picture in pictures)
        return self._judged

    def _finish(self) -> None:
        """Write the rows of all cases that have their repeats."""
        for case in list(self._open):
            if len(case.pooled()) >= self._wanted(case) and not case.flying:
                self._write(case, self._reference.error)

    def _write(self, case: OpenCase, error: str | None, failed: Outcome | None = None) -> None:
        turns = case.pooled()[: self._settings.repeats]
        row: dict[str, Any] = {**case.names, **row_of(case.method, [t["seconds"] for t in turns])}
        if error is None:
            try:
                with machine_to_itself(self._settings.alone):
                    row.update(self._errors(case))
            except Exception as problem:
                error = f"{type(problem).__name__}: {problem}"
        last = turns[-1] if turns else vars(failed) if failed is not None else {}
        row.update({name: last.get(name) or None for name in ("machine", "threads", "version")})
        row["time"] = datetime.fromisoformat(last["time"]) if last.get("time") else None
        told = [turn["bytes"] for turn in turns if turn["bytes"] is not None]
        row["bytes"] = max(told, default=None)
        row.update(key=case.key, error=error)
        self._store.write(case.key, row)
        self._open.remove(case)

    def _errors(self, case: OpenCase) -> dict[str, Any]:
        visibility = self._picture(case)
        truth, mask = self._reference.arrays()
        if not mask.any():
            raise ValueError("the camera sees no surface, there is nothing to measure")
        found: dict[str, Any] = dict(metrics.errors(visibility, truth, mask))
        found.update(self._reference.cells)
        found["reference_converged"] = self._reference.good_for(found["rmse"])
        if self._settings.images is not None:
            path = self._settings.images / f"{case.key}.npz"
            self._store.save(path, visibility=visibility, reference=truth, mask=mask)
            found["image"] = str(path)
        return found

    def _picture(self, case: OpenCase) -> npt.NDArray[np.float32]:
        with np.load(self._store.picture(case.key)) as arrays:
            visibility: npt.NDArray[np.float32] = arrays["visibility"]
        return visibility
