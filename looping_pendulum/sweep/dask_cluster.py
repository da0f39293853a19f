"""Computes the chunks of a map on a Dask cluster: submits only a few at a time, and yields results as they arrive."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any
from urllib.parse import urlsplit

from looping_pendulum.errors import EngineError, HarnessError, MissingPackageError
from looping_pendulum.installation import install_command
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
"""Number of results after which the number of workers is checked again, as they may join or leave during a long map."""


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
    with _connected(address) as client:
        running = import_module("distributed").as_completed(loop=client.loop)
        submitted = results = window = 0

        def submit() -> None:
            nonlocal submitted, window
            if results % WINDOW_CHECK == 0:
                # Twice as many as the cluster has threads: none waits, and the scheduler holds few. At least two: all workers
                # may be gone for a moment, and come back
                window = max(2, 2 * sum(client.nthreads().values()))
            for task in itertools.islice(tasks, max(0, window - submitted)):
                # By default Dask hashes the arguments, to find the result of an equal call; no two chunks are equal
                running.add(client.submit(solve, task, pure=False, retries=RETRIES))
                submitted += 1

        submit()
        for future in running:
            submitted, results = submitted - 1, results + 1
            yield _result(future, address)
            submit()


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    """Connect to a scheduler, and yield Dask's client; at the end, submitted tasks are cancelled."""
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        message = f"--cluster: Dask is not installed; to get it: `{install_command('dask')}`"
        raise MissingPackageError(message) from None
    try:
        # Not the default client, which a caller's own program may have set
        client = distributed.Client(address, timeout=CONNECT_TIME, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        why = " ".join(str(error).split()) or type(error).__name__
        message = f"--cluster: {address}: found no scheduler that answers ({why}), needed one; start it with"
        raise EngineError(one_line(f"{message} `dask scheduler`, and its workers with `dask worker`")) from None
    try:
        client.wait_for_workers(1, timeout=WORKER_TIME)
    except OSError:
        client.close()
        message = f"--cluster: {address}: found a scheduler without workers, needed one or more"
        raise EngineError(one_line(f"{message}; start them with `dask worker {address} --nthreads 1`")) from None
    try:
        yield client
    finally:
        client.close(timeout=CONNECT_TIME)


def _result(future: Any, address: str) -> CellResult:
    """Return the result of a task that has ended."""
    try:
        result: CellResult = future.result()
    # Our own errors are one line already, and the fault is not the cluster's
    except HarnessError:
        raise
    except Exception as error:
        why = f"{type(error).__name__}: {' '.join(str(error).split())}"
        message = f"--cluster: {address}: a chunk failed ({why}); what is finished is kept"
        raise EngineError(one_line(f"{message}: repair the cluster and run the same command again")) from None
    # Otherwise the cluster would keep the values of every chunk until the end
    future.release()
    return result
