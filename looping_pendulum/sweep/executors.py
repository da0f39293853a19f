"""Executors of chunks: this process, processes of this machine, or a Dask cluster.

Each executor takes tasks one by one, submits only a few at a time, and yields results as they arrive, in any order.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from typing import Any
from urllib.parse import urlsplit

from looping_pendulum.errors import EngineError, HarnessError, MissingPackageError
from looping_pendulum.installation import install_command
from looping_pendulum.processes import process_pool
from looping_pendulum.scenarios.document import one_line, quote
from looping_pendulum.sweep.cells import CellResult, CellTask

Solve = Callable[[CellTask], CellResult]

SCHEMES = ("tcp", "tls", "ws", "wss")
"""Protocols with which Dask connects to a scheduler."""
CONNECT_TIME = 5.0
"""Time limit for a scheduler to answer [s]."""
WORKER_TIME = 15.0
"""Time limit for a cluster to have a worker [s]."""
RETRIES = 3
"""Number of times that the cluster may repeat a failed chunk."""
WINDOW_CHECK = 32
"""Number of results after which the number of workers is checked again."""


def in_process(tasks: Iterator[CellTask], solve: Solve) -> Iterator[CellResult]:
    """Run tasks in this process, one after another."""
    for task in tasks:
        yield solve(task)


def in_processes(tasks: Iterator[CellTask], solve: Solve, jobs: int) -> Iterator[CellResult]:
    """Run tasks in ``jobs`` processes of this machine.

    Raises
    ------
    EngineError
        If one of them dies.
    """
    try:
        with process_pool(jobs) as pool:
            # Two for each process, so that none waits for its next; not all of a long map, since each task holds its columns
            running: set[Future[CellResult]] = {pool.submit(solve, task) for task in itertools.islice(tasks, 2 * jobs)}
            while running:
                done, running = wait(running, return_when=FIRST_COMPLETED)
                running |= {pool.submit(solve, task) for task in itertools.islice(tasks, len(done))}
                for future in done:
                    yield future.result()
    except BrokenProcessPool:
        message = "a worker process died; was the machine out of memory? What is finished is kept: run the same command again"
        raise EngineError(f"{message}, with fewer --jobs") from None


def check_address(address: str) -> None:
    """Refuse what cannot be the address of a scheduler; Dask itself would take ten seconds and raise an unclear error.

    Raises
    ------
    EngineError
        If it cannot be one.
    """
    try:
        parts = urlsplit(address if "://" in address else f"tcp://{address}")
        good = parts.scheme in SCHEMES and bool(parts.hostname) and bool(parts.port) and not (parts.path or parts.query)
    except ValueError:
        good = False
    if not good:
        message = f"--cluster: found {quote(address)}, needed the address of a Dask scheduler; write for example"
        raise EngineError(one_line(f"{message} --cluster tcp://127.0.0.1:8786"))


def on_cluster(tasks: Iterator[CellTask], solve: Solve, address: str) -> Iterator[CellResult]:
    """Run tasks on the workers of a Dask scheduler; if a worker dies, only its own chunks are computed again.

    Raises
    ------
    EngineError
        If the scheduler does not answer, has no workers, goes away, or a chunk kills worker after worker.
    MissingPackageError
        If Dask is not installed.
    """
    check_address(address)
    with _Cluster(address) as cluster:
        running = cluster.collector()
        cluster.begin(tasks, solve, running)
        for future in running:
            yield cluster.result(future)
            cluster.more(tasks, solve, running)


class _Cluster:
    """A connection to a scheduler that turns Dask's exceptions into our errors."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._submitted = self._results = self._window = 0

    def __enter__(self) -> _Cluster:
        try:
            self._distributed: Any = import_module("distributed")
        except ImportError:
            message = f"--cluster: Dask is not installed; to get it: `{install_command('dask')}`"
            raise MissingPackageError(message) from None
        try:
            # Not the default client, which a caller's own program may have set
            self._client = self._distributed.Client(self._address, timeout=CONNECT_TIME, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            why = " ".join(str(error).split()) or type(error).__name__
            message = f"--cluster: {self._address}: found no scheduler that answers ({why}), needed one; start it with"
            raise EngineError(one_line(f"{message} `dask scheduler`, and its workers with `dask worker`")) from None
        try:
            self._client.wait_for_workers(1, timeout=WORKER_TIME)
        except OSError:
            self._client.close()
            message = f"--cluster: {self._address}: found a scheduler without workers, needed one or more"
            raise EngineError(one_line(f"{message}; start them with `dask worker {self._address} --nthreads 1`")) from None
        return self

    def __exit__(self, *exception: Any) -> None:
        self._client.close(timeout=CONNECT_TIME)  # this also cancels submitted tasks

    def collector(self) -> Any:
        """Return Dask's iterator over submitted tasks in the order in which they end."""
        return self._distributed.as_completed(loop=self._client.loop)

    def begin(self, tasks: Iterator[CellTask], solve: Solve, running: Any) -> None:
        """Submit the first tasks."""
        self._update_window()
        self._submit(tasks, solve, running)

    def more(self, tasks: Iterator[CellTask], solve: Solve, running: Any) -> None:
        """Submit tasks in place of those that have ended."""
        # Workers may join or leave during a long map
        if self._results % WINDOW_CHECK == 0:
            self._update_window()
        self._submit(tasks, solve, running)

    def result(self, future: Any) -> CellResult:
        """Return the result of a task that has ended."""
        self._submitted -= 1
        self._results += 1
        try:
            result: CellResult = future.result()
        # Our own errors are one line already, and the fault is not the cluster's
        except HarnessError:
            raise
        except Exception as error:
            why = f"{type(error).__name__}: {' '.join(str(error).split())}"
            message = f"--cluster: {self._address}: a chunk failed ({why}); what is finished is kept"
            raise EngineError(one_line(f"{message}: repair the cluster and run the same command again")) from None
        # Otherwise the cluster would keep the values of every chunk until the end
        future.release()
        return result

    def _submit(self, tasks: Iterator[CellTask], solve: Solve, running: Any) -> None:
        for task in itertools.islice(tasks, max(0, self._window - self._submitted)):
            # By default Dask hashes the arguments, to find the result of an equal call; no two chunks are equal
            running.add(self._client.submit(solve, task, pure=False, retries=RETRIES))
            self._submitted += 1

    def _update_window(self) -> None:
        """Allow twice as many submitted chunks as the cluster has threads: no thread waits, and the scheduler holds few."""
        # At least two: all workers may be gone for a moment, and come back
        self._window = max(2, 2 * sum(self._client.nthreads().values()))
