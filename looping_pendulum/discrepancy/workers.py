"""Map a function over independent items in this process and in worker processes beside it.

The results are the same for any number of processes. A worker process is started early and takes items as soon as it is ready.
If it dies, its items are done by this process.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import queue
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from pickle import PicklingError
from typing import Any, Self

from threadpoolctl import threadpool_limits

from looping_pendulum.processes import core_count, process_pool

MAX_PROCESSES = 2
"""Largest number of processes, this one included, that is used without being asked for: each needs some 300 MiB."""
IMPORTED_EARLY = "looping_pendulum.discrepancy.evidence.explain"
"""Module that a worker imports while it waits; by name, since it stands above this one and starts workers itself."""
WAITED_FOR, BEGUN, IMPORTS, END = 0, 1, 2, -1
"""Priorities of items, the smallest first."""

Function = Callable[[Any, Any], Any]
"""Function of a shared argument and an item whose result depends on nothing else. All three can be pickled."""


def default_process_count() -> int:
    """Return the number of processors that this process may use, but at most `MAX_PROCESSES`."""
    return min(core_count(), MAX_PROCESSES)


class Item:
    """One call of a function: this process makes it unless a worker process has begun with it."""

    def __init__(self, function: Function, shared: Any, item: Any) -> None:
        self.function, self.shared, self.item = function, shared, item
        self.future: Future[Any] = Future()
        """Result of a worker process; cancelled if this process makes the call."""
        self._here: Future[Any] | None = None

    def make_here(self) -> None:
        """Call the function in this process, unless a worker process has begun with it."""
        if self.future.cancel():
            self._here = self._called()

    def result(self) -> Any:
        """Return the result of the call, or raise what it raised."""
        try:
            return (self._here or self.future).result()
        # The worker process has died, or cannot be sent these arguments
        except (BrokenProcessPool, PicklingError):
            return self._called().result()

    def _called(self) -> Future[Any]:
        """Call the function in this process, and return its result, or what it raised."""
        future: Future[Any] = Future()
        try:
            future.set_result(self.function(self.shared, self.item))
        except Exception as error:
            future.set_exception(error)
        return future


class Workers:
    """A pool of this process and ``count`` - 1 worker processes. Without worker processes, this one does all items in order."""

    def __init__(self, count: int = 1) -> None:
        self._count = count
        self._waiting: queue.PriorityQueue[tuple[int, int, Item | None]] = queue.PriorityQueue()
        self._order = itertools.count()
        self._at_end = contextlib.ExitStack()
        self._threads: list[threading.Thread] = []
        if count > 1:
            with contextlib.suppress(OSError):  # where no process can be started, this one does everything
                pool = self._at_end.enter_context(process_pool(count - 1, _start_worker))
                # A thread for each process gives it one item at a time: what has been handed over cannot be taken back
                self._threads = [threading.Thread(target=self._feed, args=(pool,), daemon=True) for _ in range(count - 1)]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Self:
        """Return the pool, whose processes were started by the constructor."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the worker processes."""
        for number in range(len(self._threads)):
            self._waiting.put((END, number, None))
        # A thread may be waiting for an answer: only the end of its process lets it go on
        self._at_end.close()
        for thread in self._threads:
            thread.join()

    def import_when_idle(self, modules: Sequence[str]) -> None:
        """Let idle worker processes import what will be needed at the end, as matplotlib for the report."""
        self._offer(IMPORTS, _import, None, modules)

    def begin(self, function: Function, shared: Any, items: Sequence[Any]) -> list[Item]:
        """Let idle worker processes begin with ``function(shared, item)`` for each item; `finish` returns the results."""
        return self._offer(BEGUN, function, shared, items)

    def _offer(self, priority: int, function: Function, shared: Any, items: Sequence[Any]) -> list[Item]:
        """Let worker processes take items."""
        offered = [Item(function, shared, item) for item in items]
        if self._threads:
            for item in offered:
                self._waiting.put((priority, next(self._order), item))
        return offered

    def map(self, function: Function, shared: Any, items: Sequence[Any]) -> list[Any]:
        """Return ``function(shared, item)`` for every item, in the order of ``items``.

        Raises
        ------
        Exception
            What the function raised for the first item, in the order of ``items``, for which it raised anything.
        """
        return self.finish(self._offer(WAITED_FOR, function, shared, items))

    def map_in_shares(
        self, function: Callable[..., Any], shared: tuple[Any, ...], items: Sequence[tuple[Any, ...]]
    ) -> list[Any]:
        """Return ``function(*shared, *item)`` for every item, of which each process takes an equal share at once.

        What items have in common is sent to a process once then.
        """
        count = max(1, min(self._count, len(items)))
        found: list[Any] = [None] * len(items)
        for i, results in enumerate(self.map(_do_share, (function, shared), [items[i::count] for i in range(count)])):
            found[i::count] = results
        return found

    def finish(self, items: Sequence[Item]) -> list[Any]:
        """Return what `map` returns, of items that may have been begun."""
        try:
            for item in items:
                item.make_here()
            return [item.result() for item in items]
        finally:
            # After an interrupt, too: worker processes must not go on with items that nobody waits for
            for item in items:
                item.future.cancel()

    def _feed(self, pool: Executor) -> None:
        """Hand items to a worker process, one at a time: the main function of its thread."""
        while (item := self._waiting.get()[2]) is not None:
            if item.future.set_running_or_notify_cancel():
                try:
                    item.future.set_result(pool.submit(item.function, item.shared, item.item).result())
                # What the function has raised, or what became of the process
                except Exception as error:
                    item.future.set_exception(error)


SERIAL = Workers()
"""Pool without worker processes."""


def _do_share(call: tuple[Callable[..., Any], tuple[Any, ...]], items: Sequence[tuple[Any, ...]]) -> list[Any]:
    function, shared = call
    return [function(*shared, *item) for item in items]


def _start_worker() -> None:
    """Prepare this worker process: it prints nothing, imports what it will need, and does linear algebra in one thread."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    # First the import: only libraries that are loaded can be told their number of threads
    import_module(IMPORTED_EARLY)
    one_blas_thread()


def one_blas_thread() -> threadpool_limits:
    """Let NumPy and SciPy do linear algebra in one thread, from now on or inside this context.

    With matrices this small a second thread only waits for a processor that another process needs.
    """
    return threadpool_limits(1, user_api="blas")


def _import(_: None, module: str) -> None:
    import_module(module)
