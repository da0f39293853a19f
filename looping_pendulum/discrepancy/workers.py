"""Map a function over independent items in this process and in worker processes beside it.

The results are the same for any number of processes. A worker process calls what it is sent until its input ends. It is started
early and takes items as soon as it is ready. If it dies, its item is done by this process.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import sys
import threading
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, Self

from looping_pendulum.processes import start_process

MAX_PROCESSES = 2
"""Largest number of processes, this one included, that is used without being asked for: each needs some 300 MiB."""

IMPORTED_EARLY = ("looping_pendulum.discrepancy.unlisted.discovery",)
"""Modules that a worker imports while it waits; by name, since they stand above this one and start workers themselves."""

ProgressCallback = Callable[[str], None]
"""Function that is called with a description of each step that begins."""


def default_process_count() -> int:
    """Return the number of processors that this process may use, but at most `MAX_PROCESSES`."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(count, MAX_PROCESSES)


class Workers:
    """A pool of this process and ``count`` - 1 worker processes. Without worker processes, this one does all items in order."""

    def __init__(self, count: int = 1) -> None:
        self._condition = threading.Condition()
        self._batch: _Batch | None = None
        self._warm_up_batch: _Batch | None = None
        self._closed = False
        self._worker_of_label: dict[str, int] = {}
        """Label of an item -> number of the worker that has its equations compiled; 0 is this process."""
        self._processes: list[_WorkerProcess] = []
        with contextlib.suppress(OSError):  # where no process can be started, this one does everything
            self._processes += (_WorkerProcess() for _ in range(count - 1))
        self._threads = [
            threading.Thread(target=self._feed, args=(i, p), daemon=True) for i, p in enumerate(self._processes, start=1)
        ]
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
        for process in self._processes:
            process.kill()
        for thread in self._threads:
            thread.join()
        for process in self._processes:
            process.close()

    def prepare(self, function: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any], labels: Sequence[str]) -> None:
        """Let idle worker processes call ``function(shared, item)`` for each item, so that its equations are compiled there."""
        with self._condition:
            self._warm_up_batch = _Batch(function, shared, items, labels)
            self._condition.notify_all()

    def map(
        self,
        function: Callable[[Any, Any], Any],
        shared: Any,
        items: Sequence[Any],
        labels: Sequence[str] = (),
        report_progress: ProgressCallback = lambda label: None,
    ) -> list[Any]:
        """Return ``function(shared, item)`` for every item, in the order of ``items``.

        Parameters
        ----------
        function
            A function of a module whose result depends on nothing but its arguments. They and the result can be pickled.
        labels
            Name of each item, for reports. A worker is given items with labels that it has worked on before, if there are any.
        report_progress
            Called with the label of each item that this process begins.

        Raises
        ------
        Exception
            What the function raised for the first item, in the order of ``items``, for which it raised anything.
        """
        batch = _Batch(function, shared, items, labels or [""] * len(items))
        with self._condition:
            self._batch = batch
            self._condition.notify_all()
        try:
            while (i := self._take_item(batch, 0)) is not None:
                report_progress(batch.labels[i])
                self._store_answer(batch, i, _call(function, shared, items[i]))
        finally:
            with self._condition:
                self._batch = None
        for succeeded, value in (batch.answers[i] for i in range(len(items))):
            if not succeeded:
                raise value
        return [batch.answers[i][1] for i in range(len(items))]

    def _take_item(self, batch: _Batch, worker: int) -> int | None:
        """Return the number of the next item for a worker, preferably one with a label it knows.

        None: all are done or, for a worker process, all are taken. This process (worker 0) waits instead, because the item of a
        worker process that dies comes back.
        """
        with self._condition:
            while not batch.waiting:
                if worker or len(batch.answers) == len(batch.items):
                    return None
                self._condition.wait()
            owners = [self._worker_of_label.get(batch.labels[i]) for i in batch.waiting]
            # its own labels first, then those that nobody has, then any
            place = next((k for wanted in (worker, None) for k, owner in enumerate(owners) if owner == wanted), 0)
            i = batch.waiting.pop(place)
            if batch.labels[i]:
                self._worker_of_label.setdefault(batch.labels[i], worker)
            return i

    def _store_answer(self, batch: _Batch, i: int, answer: tuple[bool, Any] | None) -> None:
        """Keep the answer to an item; without one (None) the item goes back to be done by another worker."""
        with self._condition:
            if answer is None:
                batch.waiting.insert(0, i)
            else:
                batch.answers[i] = answer
            self._condition.notify_all()

    def _wait_for_batch(self) -> _Batch | None:
        """Wait for a batch with items to do, and return it; None if the pool has been closed."""
        with self._condition:
            while not self._closed:
                for batch in (self._batch, self._warm_up_batch):
                    if batch is not None and batch.waiting:
                        return batch
                self._condition.wait()
            return None

    def _feed(self, worker: int, process: _WorkerProcess) -> None:
        """Hand items to a worker process, as long as it lives: the main function of its thread."""
        answer = process.read()
        known: _Batch | None = None
        while answer is not None:
            batch = self._wait_for_batch()
            if batch is None:
                return
            i = self._take_item(batch, worker)
            if i is None:
                continue
            # function and shared argument are sent once for a batch
            header = (batch.function, batch.shared) if batch is not known else None
            known = batch
            try:
                process.write((header, batch.items[i]))
                answer = process.read()
            except Exception:  # what cannot be pickled is done by this process, and so is all that follows
                answer = None
            self._store_answer(batch, i, answer)


SERIAL = Workers()
"""Pool without worker processes."""


class _Batch:
    """Items of one call of `Workers.map` or `Workers.prepare`, and the answers so far."""

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any], labels: Sequence[str]) -> None:
        self.function, self.shared, self.items, self.labels = function, shared, items, labels
        self.waiting = list(range(len(items)))
        """Numbers of the items that no worker has taken."""
        self.answers: dict[int, tuple[bool, Any]] = {}
        """Number of an item -> whether the function returned, and its result or the exception that it raised."""


class _WorkerProcess:
    """A process that calls functions for this one."""

    def __init__(self) -> None:
        self._process = start_process("looping_pendulum.discrepancy.workers:serve", [])

    def write(self, message: Any) -> None:
        """Send a message; nothing happens if the process is dead.

        Raises
        ------
        Exception
            If the message cannot be pickled.
        """
        assert self._process.stdin is not None
        data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
        with contextlib.suppress(OSError):
            self._process.stdin.write(data)
            self._process.stdin.flush()

    def read(self) -> Any:
        """Receive a message; None if the process is dead."""
        assert self._process.stdout is not None
        try:
            return pickle.load(self._process.stdout)
        except (EOFError, OSError, pickle.UnpicklingError):
            return None

    def kill(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """Close the pipes of a process that has ended."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        for pipe in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(OSError):  # what the process has not read is lost
                pipe.close()


def serve() -> None:
    """Call what the parent process sends until its end: the main function of a worker process."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a function prints must not come between the answers
    for module in IMPORTED_EARLY:
        import_module(module)

    message: Any = "ready"
    function: Any = None
    shared: Any = None
    while True:
        try:
            pickle.dump(message, answers, protocol=pickle.HIGHEST_PROTOCOL)
            answers.flush()
            header, item = pickle.load(sys.stdin.buffer)
        except (EOFError, OSError):
            return
        if header is not None:
            function, shared = header
        message = _call(function, shared, item)


def _call(function: Callable[[Any, Any], Any], shared: Any, item: Any) -> tuple[bool, Any]:
    """Return whether the function returned, and its result or the exception that it raised."""
    try:
        return True, function(shared, item)
    except Exception as error:
        return False, error
