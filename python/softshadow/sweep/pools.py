"""What differs between executors: this process, process pools, Dask, and all others."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from softshadow.extras import needs
from softshadow.sweep.work import Entries, Task, run

if TYPE_CHECKING:
    from collections.abc import Iterable
    from concurrent.futures import Executor, Future

__all__ = ["Pool", "cluster", "processes"]


class Pool:
    """An executor, and another like it where its processes have died.

    Parameters
    ----------
    executor : Executor or None
        None: this process.
    """

    def __init__(self, executor: Executor | None) -> None:
        from concurrent.futures import BrokenExecutor, CancelledError

        if executor is not None and not callable(getattr(executor, "submit", None)):
            raise TypeError(f"executor: expected one of concurrent.futures' kind, got {executor!r}")
        self.broken: type[Exception] = BrokenExecutor
        self.cancelled: type[Exception] = CancelledError
        self._executor = executor
        self._ours: Executor | None = None
        self._client = getattr(executor, "_client", None) if executor is not None else None

    @property
    def here(self) -> bool:
        """Whether it is this process."""
        return self._executor is None

    @property
    def width(self) -> int:
        """How many steps may be under way: as many as there are workers."""
        if self._executor is None:
            return 1
        if self._client is not None:
            return max(1, len(self._client.nthreads()))
        return int(getattr(self._executor, "_max_workers", None) or os.cpu_count() or 1)

    def submit(self, task: Task, source: Entries | str, where: str | None) -> Future[Any]:
        """Begin a task; in this process, do it.

        Parameters
        ----------
        task, source
            As of `run`.
        where : str or None
            The address of one of Dask's workers or of its machine; kept to while that is there.
        """
        from concurrent.futures import Future

        future: Future[Any] = Future()
        if self._executor is None:
            future.set_result(run(task, source))
            return future
        try:
            if self._client is None:
                return self._executor.submit(run, task, source)
            options: dict[str, Any] = {"pure": False}
            if where is not None:
                options.update(workers=[where], allow_other_workers=True)
            return self._executor.submit(run, task, source, **options)
        except self.broken as error:
            future.set_exception(error)
            return future

    def some(self, futures: Iterable[Future[Any]]) -> set[Future[Any]]:
        """Wait for one or more of those under way."""
        from concurrent.futures import FIRST_COMPLETED, wait

        done: set[Future[Any]] = wait(set(futures), return_when=FIRST_COMPLETED).done
        return done

    def renew(self, error: Exception) -> None:
        """Put a new pool of processes in the place of one that broke.

        Raises
        ------
        RuntimeError
            If the executor is of a kind that cannot be made anew.
        """
        from concurrent.futures import ProcessPoolExecutor

        old = self._executor
        if not isinstance(old, ProcessPoolExecutor):
            raise RuntimeError(f"executor: {type(old).__name__} broke; sweep again") from error
        self.close()
        settings: Any = old  # the standard library has no public names for them
        self._ours = self._executor = ProcessPoolExecutor(
            settings._max_workers,
            mp_context=settings._mp_context,
            initializer=settings._initializer,
            initargs=settings._initargs,
        )

    def close(self) -> None:
        """End the processes that this pool has started; the user's own stay."""
        if self._ours is not None:
            _end(self._ours)
            self._ours = None


@contextmanager
def processes(count: int) -> Iterator[Executor | None]:
    """Return a pool of new processes, which end with a ``with`` block, however it ends.

    Ctrl-C, which a terminal sends to all of them, is left to the process that has the pool.

    Parameters
    ----------
    count : int
        0: no pool, for this process.
    """
    if count == 0:
        yield None
        return
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(count, context, _begin)
    try:
        yield executor
    finally:
        _end(executor)


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Return an executor of a Dask cluster that runs already, for a ``with`` block.

    Parameters
    ----------
    address : str
        Of its scheduler, such as ``tcp://10.0.0.1:8786``.
    """
    with needs("cluster", "a Dask cluster"):
        from distributed import Client
    with Client(address) as client:
        yield client.get_executor()


def _begin() -> None:
    """Make a worker deaf to Ctrl-C, and end it with the process that has the pool.

    It would otherwise stay when that one is killed, which a pool's processes do not notice.
    """
    import multiprocessing

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def _end(executor: Any) -> None:
    """End a pool's processes now, whatever they do."""
    alive = list((executor._processes or {}).values())
    manager = executor._executor_manager_thread
    executor.shutdown(wait=False, cancel_futures=True)
    for process in alive:
        process.terminate()
    for process in alive:
        process.join()
    if manager is not None:  # or its last steps meet the interpreter's, which CPython 3.10 prints
        manager.join(10)
