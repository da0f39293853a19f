"""Work of independent items, done by this process and by helpers beside it; the results are the same by any number of them.

A helper is a process of its own that does what it is told until its input ends. It is started early, and takes items from when
it is ready. If it dies, its item is done here.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any, Self

from looping_pendulum.processes import start

MOST = 2
"""Processes, this one included, unless asked for another number: each needs some 300 MiB."""

Told = Callable[[str], None]


def available() -> int:
    """Processors that this process may use, `MOST` at most."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(count, MOST)


class Workers:
    """The process itself and ``count`` - 1 helpers. Without helpers, all is done here, in order."""

    def __init__(self, count: int = 1) -> None:
        self._condition = threading.Condition()
        self._work: _Work | None = None
        self._ahead: _Work | None = None
        self._closed = False
        self._homes: dict[str, int] = {}
        """What an item was about -> number of the worker that has its equations compiled; 0: this process."""
        self._helpers: list[_Helper] = []
        with contextlib.suppress(OSError):  # where no process can be started, all is done here
            self._helpers += (_Helper() for _ in range(count - 1))
        self._threads = [
            threading.Thread(target=self._feed, args=(i, h), daemon=True) for i, h in enumerate(self._helpers, start=1)
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Self:
        """Nothing to do: helpers start at once."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the helpers."""
        with self._condition:
            self._closed = True
            self._condition.notify_all()
        for helper in self._helpers:
            helper.kill()
        for thread in self._threads:
            thread.join()
        for helper in self._helpers:
            helper.close()

    def prepare(self, function: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any], about: Sequence[str]) -> None:
        """Let helpers that have nothing else to do call ``function(shared, item)`` of each item, so that it is compiled."""
        with self._condition:
            self._ahead = _Work(function, shared, items, about)
            self._condition.notify_all()

    def map(
        self,
        function: Callable[[Any, Any], Any],
        shared: Any,
        items: Sequence[Any],
        about: Sequence[str] = (),
        told: Told = lambda what: None,
    ) -> list[Any]:
        """Return ``function(shared, item)`` of every item.

        Parameters
        ----------
        function
            A module's own, whose result depends on nothing but its arguments; they and the result can be pickled.
        about
            What each item is about, to tell of it; what a worker was about before comes to it first.
        told
            Told what each item is about that begins here.

        Raises
        ------
        Exception
            What the function raised of the first item of which it did.
        """
        work = _Work(function, shared, items, about or [""] * len(items))
        with self._condition:
            self._work = work
            self._condition.notify_all()
        try:
            while (i := self._take(work, 0)) is not None:
                told(work.about[i])
                self._put(work, i, _answer(function, shared, items[i]))
        finally:
            with self._condition:
                self._work = None
        for good, value in (work.answers[i] for i in range(len(items))):
            if not good:
                raise value
        return [work.answers[i][1] for i in range(len(items))]

    def _take(self, work: _Work, worker: int) -> int | None:
        """Number of an item to do, that of a former one's first; None where all are done, or (for a helper) taken."""
        with self._condition:
            while not work.left:
                if worker or len(work.answers) == len(work.items):
                    return None
                self._condition.wait()
            homes = [self._homes.get(work.about[i]) for i in work.left]
            place = next((k for wanted in (worker, None) for k, home in enumerate(homes) if home == wanted), 0)
            i = work.left.pop(place)
            if work.about[i]:
                self._homes.setdefault(work.about[i], worker)
            return i

    def _put(self, work: _Work, i: int, answer: tuple[bool, Any] | None) -> None:
        """Keep an answer; None: there is none, and the item is to be done by another."""
        with self._condition:
            if answer is None:
                work.left.insert(0, i)
            else:
                work.answers[i] = answer
            self._condition.notify_all()

    def _wait(self) -> _Work | None:
        """Wait until there is something for a helper to do; None: never again."""
        with self._condition:
            while not self._closed:
                for work in (self._work, self._ahead):
                    if work is not None and work.left:
                        return work
                self._condition.wait()
            return None

    def _feed(self, worker: int, helper: _Helper) -> None:
        """Hand items to a helper, as long as it lives."""
        ready = helper.read()
        known: _Work | None = None
        while ready is not None:
            work = self._wait()
            if work is None:
                return
            i = self._take(work, worker)
            if i is None:
                continue
            news = (work.function, work.shared) if work is not known else None
            known = work
            try:
                helper.write((news, work.items[i]))
                ready = helper.read()
            except Exception:  # what cannot be sent is done here, and so is all that follows
                ready = None
            self._put(work, i, ready)


ALONE = Workers()
"""No helpers."""


class _Work:
    """Items to be done, and what came of them."""

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any, items: Sequence[Any], about: Sequence[str]) -> None:
        self.function, self.shared, self.items, self.about = function, shared, items, about
        self.left = list(range(len(items)))
        self.answers: dict[int, tuple[bool, Any]] = {}
        """Number of an item -> whether all went well, and the result or what was raised."""


class _Helper:
    """A process that works for this one."""

    def __init__(self) -> None:
        self._process = start("looping_pendulum.discrepancy.workers:serve", [])

    def write(self, message: Any) -> None:
        """Send it something; one that is dead does not read it.

        Raises
        ------
        Exception
            If it cannot be pickled.
        """
        assert self._process.stdin is not None
        data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
        with contextlib.suppress(OSError):
            self._process.stdin.write(data)
            self._process.stdin.flush()

    def read(self) -> Any:
        """Receive something; None if it is dead."""
        assert self._process.stdout is not None
        try:
            return pickle.load(self._process.stdout)
        except (EOFError, OSError, pickle.UnpicklingError):
            return None

    def kill(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """Close the pipes of one that has ended."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        for pipe in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(OSError):  # what was not read any more is lost
                pipe.close()


def serve() -> None:
    """Do what the parent says, until its end: the main function of a helper."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # nothing that is printed comes between
    from looping_pendulum.discrepancy.unlisted import discovery  # noqa: F401  what takes a while to import

    message: Any = "ready"
    function: Any = None
    shared: Any = None
    while True:
        try:
            pickle.dump(message, answers, protocol=pickle.HIGHEST_PROTOCOL)
            answers.flush()
            news, item = pickle.load(sys.stdin.buffer)
        except (EOFError, OSError):
            return
        if news is not None:
            function, shared = news
        message = _answer(function, shared, item)


def _answer(function: Callable[[Any, Any], Any], shared: Any, item: Any) -> tuple[bool, Any]:
    """Whether all went well, and the result or what was raised."""
    try:
        return True, function(shared, item)
    except Exception as error:
        return False, error
