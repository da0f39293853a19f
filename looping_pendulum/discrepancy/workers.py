"""Map a function over independent items in this process and in worker processes beside it.

The results are the same for any number of processes. A worker process is started early and takes items as soon as it is ready.
If it dies, its item is done by another.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from importlib import import_module
from typing import Any, Self

from threadpoolctl import threadpool_limits

from looping_pendulum.jobs import core_count
from looping_pendulum.jobs.processes import process_pool

MAX_PROCESSES = 2
"""Largest number of processes, this one included, that is used without being asked for: each needs some 300 MiB."""

IMPORTED_EARLY = ("looping_pendulum.discrepancy.evidence.explain",)
"""Modules that a worker imports while it waits; by name, since they stand above this one and start workers themselves."""

WAITED_FOR, BEGUN, WARM_UP, IMPORTS = range(4)
"""Priorities of batches, the most urgent first."""


def default_process_count() -> int:
    """Return the number of processors that this process may use, but at most `MAX_PROCESSES`."""
    return min(core_count(), MAX_PROCESSES)


class Workers:
    """A pool of this process and ``count`` - 1 worker processes. Without worker processes, this one does all items in order."""

    def __init__(self, count: int = 1) -> None:
        self._condition = threading.Condition()
        self._batches: dict[int, Batch] = {}
        """Priority -> the batch with items that worker processes may take."""
        self._closed = False
        self._pools = contextlib.ExitStack()
        self._threads: list[threading.Thread] = []
        with contextlib.suppress(OSError):  # where no process can be started, this one does everything
            for _ in range(1, count):
                # a pool of its own for each process, since an executor chooses itself which of its processes gets an item
                executor = self._pools.enter_context(process_pool(1, _start_worker))
                started = executor.submit(int)  # the process starts now
                self._threads.append(threading.Thread(target=self._feed, args=(executor, started), daemon=True))
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Self:
        """Return the pool, whose processes were started by the constructor."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the worker processes."""
        with self._condition:
            self._closed = True
            self._condition.notify_all()
        # A thread may be waiting for an answer: only the end of its process lets it go on.
        self._pools.close()
        for thread in self._threads:
            thread.join()

    def prepare(self, function: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any]) -> None:
        """Let idle worker processes call ``function(shared, item)`` for each item, so that its equations are compiled."""
        self._offer(WARM_UP, Batch(function, shared, items))

    def import_when_idle(self, modules: Sequence[str]) -> None:
        """Let idle worker processes import what will be needed at the end, as matplotlib for the report."""
        self._offer(IMPORTS, Batch(_import, None, modules))

    def begin(self, function: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any]) -> Batch:
        """Let idle worker processes begin with ``function(shared, item)`` for each item; `finish` returns the results."""
        return self._offer(BEGUN, Batch(function, shared, items))

    def _offer(self, priority: int, batch: Batch) -> Batch:
        """Let worker processes take items of a batch, in place of the former one of the same priority."""
        with self._condition:
            self._batches[priority] = batch
            self._condition.notify_all()
        return batch

    def map(self, function: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any]) -> list[Any]:
        """Return ``function(shared, item)`` for every item, in the order of ``items``.

        Parameters
        ----------
        function
            A function of a module whose result depends on nothing but its arguments. They and the result can be pickled.

        Raises
        ------
        Exception
            What the function raised for the first item, in the order of ``items``, for which it raised anything.
        """
        return self.finish(Batch(function, shared, items))

    def map_together(self, function: Callable[[Any, Sequence[Any]], list[Any]], shared: Any, items: Sequence[Any]) -> list[Any]:
        """Return what ``function(shared, items)`` returns for each item, of which every process takes an equal share at once.

        The result for an item may not depend on the others of its share.
        """
        count = max(1, min(1 + len(self._threads), len(items)))
        found: list[Any] = [None] * len(items)
        for i, results in enumerate(self.map(function, shared, [items[i::count] for i in range(count)])):
            found[i::count] = results
        return found

    def finish(self, batch: Batch) -> list[Any]:
        """Return what `map` returns, of a batch that may have been begun."""
        self._offer(WAITED_FOR, batch)
        try:
            while (taken := self._take_item(batch)) is not None:
                i = taken[1]
                self._store_answer(batch, i, _call(batch.function, batch.shared, batch.items[i]))
        finally:
            with self._condition:
                # Also after an exception here: worker processes must not go on with a batch that nobody waits for
                self._batches = {priority: one for priority, one in self._batches.items() if one is not batch}
        # In the order of the items, so that the exception does not depend on which process was faster
        for succeeded, value in (batch.answers[i] for i in range(len(batch.items))):
            if not succeeded:
                raise value
        return [batch.answers[i][1] for i in range(len(batch.items))]

    def _take_item(self, own: Batch | None = None) -> tuple[Batch, int] | None:
        """Wait for an item of this process's ``own`` batch or, for a worker process, of the most urgent one, and take it.

        None: all of its own are done, or the pool has been closed. Items that a worker process has are waited for, too, because
        that of one which dies comes back.
        """
        with self._condition:
            while not (self._closed if own is None else len(own.answers) == len(own.items)):
                for batch in [own] if own else [batch for _, batch in sorted(self._batches.items())]:
                    if batch.waiting:
                        return batch, batch.waiting.pop(0)
                self._condition.wait()
            return None

    def _store_answer(self, batch: Batch, i: int, answer: tuple[bool, Any] | None) -> None:
        """Keep the answer to an item; without one (None) the item goes back to be done by another worker."""
        with self._condition:
            if answer is None:
                # To the front: the caller waits for all items, and this one has lost time already
                batch.waiting.insert(0, i)
            else:
                batch.answers[i] = answer
            self._condition.notify_all()

    def _feed(self, executor: Executor, started: Future[Any]) -> None:
        """Hand items to a worker process, as long as it lives: the main function of its thread."""
        # A worker process that cannot start, or dies, leaves its items to the others
        with contextlib.suppress(Exception):
            started.result()
            known: Batch | None = None
            while (taken := self._take_item()) is not None:
                batch, i = taken
                answer = None
                try:
                    # function and shared argument are sent once for a batch
                    sent = None if batch is known else (batch.function, batch.shared)
                    answer = executor.submit(_call_in_worker, sent, batch.items[i]).result()
                    known = batch
                finally:  # what cannot be pickled is done by this process, and so is all that follows
                    self._store_answer(batch, i, answer)


SERIAL = Workers()
"""Pool without worker processes."""


class Batch:
    """Items of one call of a method of `Workers`, and the answers so far."""

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any]) -> None:
        self.function, self.shared, self.items = function, shared, items
        self.waiting = list(range(len(items)))
        """Numbers of the items that no worker has taken."""
        self.answers: dict[int, tuple[bool, Any]] = {}
        """Number of an item -> whether the function returned, and its result or the exception that it raised."""


def _start_worker() -> None:
    """Prepare this worker process: it prints nothing, and imports what it will need."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    for module in IMPORTED_EARLY:
        import_module(module)
    one_blas_thread()


def one_blas_thread() -> threadpool_limits:
    """Let NumPy and SciPy do linear algebra in one thread, from now on or inside this context.

    With matrices this small a second thread only waits for a processor that another process needs.
    """
    return threadpool_limits(1, user_api="blas")


def _import(_: None, module: str) -> None:
    import_module(module)


_batch: tuple[Callable[[Any, Any], Any], Any]
"""Function and shared argument of the batch that this process, if it is a worker, was sent last."""


def _call_in_worker(batch: tuple[Callable[[Any, Any], Any], Any] | None, item: Any) -> tuple[bool, Any]:
    """Do the same as `_call`, for an item of a new batch or (None) of the batch before."""
    global _batch
    if batch is not None:
        _batch = batch
    return _call(*_batch, item)


def _call(function: Callable[[Any, Any], Any], shared: Any, item: Any) -> tuple[bool, Any]:
    """Return whether the function returned, and its result or the exception that it raised."""
    try:
        return True, function(shared, item)
    except Exception as error:
        return False, error
