"""Where a sweep keeps what it has measured: a folder of Parquet parts, one a case.

::

    results.parquet/
        part-<key>.parquet     a finished case: one row
        _softshadow.json       says that the folder is a sweep's, and the format's version
        _turns/                repeats of cases that are not finished, and their pictures
        _references/           what errors are measured against

A part is written under another name and renamed, so that whoever reads the folder sees whole parts
only. Readers of Parquet folders skip names that begin with an underscore.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softshadow.extras import needs
from softshadow.sweep import columns

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["FORMAT", "Store"]

FORMAT = 1
"""The version of what is in a store. Change it with what old stores would be misread for."""

_MARK = "_softshadow.json"
_WHAT = "softshadow sweep"


class Store:
    """A folder of a sweep's results; made where there is none.

    Parameters
    ----------
    path : path

    Raises
    ------
    ValueError
        If there is something that is no sweep's store, or one of another version of the format.
        It is left as it is.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        with needs("sweep", "a sweep"):
            import pandas
            import pyarrow.parquet

            del pandas
        self._parquet = pyarrow.parquet
        self._arrow = pyarrow
        self.path = Path(path)
        self._check()
        for folder in (self.path, self.path / "_turns", self.path / "_references"):
            folder.mkdir(parents=True, exist_ok=True)
        mark = self.path / _MARK
        if not mark.exists():
            text = json.dumps({"what": _WHAT, "format": FORMAT}) + "\n"
            self._replace(mark, text.encode())
        self._schema = columns.schema({_WHAT: str(FORMAT)})

    def _check(self) -> None:
        if not self.path.exists():
            return
        if not self.path.is_dir():
            raise ValueError(f"store: {self.path} is a file, and no store of a sweep; it was kept")
        mark = self.path / _MARK
        if not mark.exists():
            # A sweep that was killed at once may have left its empty folders.
            if any(p.name not in ("_turns", "_references", "_lock") for p in self._listed()):
                raise ValueError(
                    f"store: {self.path} has other files and is no store of a sweep; it was kept"
                )
            return
        try:
            found = json.loads(mark.read_text())
            ours, version = found["what"] == _WHAT, found["format"]
        except (ValueError, TypeError, KeyError):
            ours, version = False, None
        if not ours:
            raise ValueError(f"store: {mark} is not what a sweep writes; the store was kept")
        if version != FORMAT:
            raise ValueError(
                f"store: {self.path} has version {version} of the format, this softshadow writes "
                f"version {FORMAT}; it was kept, choose another path"
            )

    def _listed(self) -> list[Path]:
        return [p for p in self.path.iterdir() if not p.name.startswith("_new-")]

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Let no other process write within a ``with`` block.

        The lock is the process's, and gone with it however it ends.

        Raises
        ------
        ValueError
            If another process writes.
        """
        try:
            import fcntl
        except ImportError:  # no such locks here: the user sees to it
            yield
            return
        with open(self.path / "_lock", "a") as stream:
            try:
                fcntl.lockf(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise ValueError(
                    f"store: another process is writing to {self.path}; wait for it or end it"
                ) from None
            for left in self.path.rglob("_new-*"):  # of a sweep that was killed
                left.unlink(missing_ok=True)
            yield

    def part(self, key: str) -> Path:
        """Return the path of a case's part."""
        return self.path / f"part-{key}.parquet"

    def finished(self) -> set[str]:
        """Return the keys of all cases that have a part."""
        return {p.stem.removeprefix("part-") for p in self.path.glob("part-*.parquet")}

    def failed(self, keys: set[str]) -> set[str]:
        """Return those of finished cases that failed."""
        table = self._read(sorted(keys))
        errors = table.column("error").to_pylist()
        return {k for k, e in zip(table.column("key").to_pylist(), errors, strict=True) if e}

    def write(self, key: str, row: dict[str, Any]) -> None:
        """Write a case's part, whole or not at all, and forget its repeats."""
        known = set(self._schema.names)
        if unknown := set(row) - known:
            raise KeyError(f"columns: {sorted(unknown)} are not in the table")
        cells = {name: [row.get(name)] for name in self._schema.names}
        table = self._arrow.table(cells, schema=self._schema)
        sink = self._arrow.BufferOutputStream()
        self._parquet.write_table(table, sink)
        self._replace(self.part(key), sink.getvalue().to_pybytes())
        self.forget(key)

    def table(self, keys: Sequence[str]) -> pd.DataFrame:
        """Return the rows of cases, in this order."""
        frame: pd.DataFrame = self._read(list(dict.fromkeys(keys))).to_pandas()
        rows = {key: i for i, key in enumerate(frame["key"])}
        ordered: pd.DataFrame = frame.iloc[[rows[key] for key in keys]].reset_index(drop=True)
        return ordered

    def _read(self, keys: list[str]) -> Any:
        parts = [self._parquet.read_table(self.part(k), partitioning=None) for k in keys]
        if not parts:
            return self._schema.empty_table()
        # Parts of a version with other methods have other parameters.
        return self._arrow.concat_tables(parts, promote_options="default")

    # ------------------------------------------------------------ repeats and pictures

    def add_turn(self, key: str, number: int, turn: dict[str, Any]) -> None:
        """Keep a repeat's times."""
        self._replace(self.path / "_turns" / f"{key}-{number}.json", json.dumps(turn).encode())

    def turns(self) -> dict[str, dict[int, dict[str, Any]]]:
        """Return what was kept of cases that are not finished: by key, then by number."""
        found: dict[str, dict[int, dict[str, Any]]] = {}
        for path in (self.path / "_turns").glob("*.json"):
            key, _, number = path.stem.rpartition("-")
            found.setdefault(key, {})[int(number)] = json.loads(path.read_bytes())
        return found

    def forget(self, key: str) -> None:
        """Remove the repeats and the picture of a case."""
        for path in (self.path / "_turns").glob(f"{key}[-.]*"):
            path.unlink(missing_ok=True)

    def tidy(self, keys: set[str]) -> None:
        """Remove what is left of cases whose sweep was killed just after it wrote their parts."""
        for path in (self.path / "_turns").iterdir():
            if path.stem.partition("-")[0] in keys:
                path.unlink(missing_ok=True)

    def picture(self, key: str) -> Path:
        """Return where the picture of a case that is not finished is."""
        return self.path / "_turns" / f"{key}.npz"

    def reference(self, key: str) -> Path:
        """Return where a reference is."""
        return self.path / "_references" / f"{key}.npz"

    def save(self, path: Path, **arrays: Any) -> None:
        """Write arrays to an ``.npz`` file, whole or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.with_name(f"_new-{os.getpid()}-{path.name}")
        try:
            with open(new, "wb") as stream:
                np.savez(stream, **arrays)
                _to_disk(stream.fileno())
            os.replace(new, path)
        finally:
            new.unlink(missing_ok=True)

    def _replace(self, path: Path, content: bytes) -> None:
        new = path.with_name(f"_new-{os.getpid()}-{path.name}")
        try:
            with open(new, "wb") as stream:
                stream.write(content)
                stream.flush()
                _to_disk(stream.fileno())
            os.replace(new, path)
        finally:
            new.unlink(missing_ok=True)


def _to_disk(descriptor: int) -> None:
    with suppress(OSError):  # some file systems cannot
        os.fsync(descriptor)
