"""Many jobs at a time, each in a process of its own: one loop, which Ctrl-C ends in order.

`run_many` makes calls that wait for processes; `jobs.processes` starts these, with their limits on imports, and ends them.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

POLL_INTERVAL = 0.05
"""Time between two looks at what goes on [s]; Ctrl-C is noticed in between."""
ReportShare = Callable[[str, float], None]
"""Function that is called with what is being done, and the share of all of it that is done."""
Result = TypeVar("Result")


def run_many(
    calls: Iterable[Callable[[], Result]],
    jobs: int,
    *,
    cancelled: threading.Event,
    meanwhile: Callable[[dict[int, Result]], None] = lambda results: None,
) -> dict[int, Result]:
    """Make ``calls`` in their order, ``jobs`` at a time; return position -> result of those that had begun.

    Ctrl-C sets ``cancelled``: no further call begins, and those that go on are to end soon, with a result. No interrupt is
    raised, so that the caller returns what there is.

    Parameters
    ----------
    calls
        Each is made in a thread, as it only waits for a process.
    cancelled
        Event that the calls watch.
    meanwhile
        Called from the caller's thread, every `POLL_INTERVAL`, with the results so far.

    Raises
    ------
    Exception
        What the first thread raised in which a call raised anything, after all others have ended.
    """
    queue = iter(enumerate(calls))
    results: dict[int, Result] = {}
    lock = threading.Lock()

    def work() -> None:
        while not cancelled.is_set():
            with lock:
                i, call = next(queue, (0, None))
            if call is None:
                return
            results[i] = call()

    with ThreadPoolExecutor(max_workers=jobs) as pool:
        threads = [pool.submit(work) for _ in range(jobs)]
        going_on = True
        while going_on:
            try:
                # In short steps, as Ctrl-C reaches this thread alone, and only between two steps
                time.sleep(POLL_INTERVAL)
                meanwhile(dict(results))
                going_on = not all(thread.done() for thread in threads)
            except KeyboardInterrupt:
                cancelled.set()
        for thread in threads:
            thread.result()
    return results


def core_count() -> int:
    """Return the number of cores that this process may use; a container or batch system may allow fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
