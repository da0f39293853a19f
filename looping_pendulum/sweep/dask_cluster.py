"""Connects to a Dask cluster, whose workers then compute the chunks of a map."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from looping_pendulum.errors import EngineError, MissingPackageError
from looping_pendulum.installation import install_command
from looping_pendulum.scenarios.document import quote

ADDRESS = re.compile(r"((tcp|tls|wss?)://)?[^\s/?#@]+:[0-9]{1,5}", re.IGNORECASE)
"""Regular expression of the address of a scheduler, with the protocols by which Dask connects to one."""
CONNECT_TIME = 5.0
"""Time limit for a scheduler to answer [s]."""
WORKER_TIME = 15.0
"""Time limit for a cluster to have a worker [s]."""
RETRIES = 3
"""Number of times that the cluster may repeat a failed chunk."""


def check_address(address: str) -> None:
    """Refuse what cannot be the address of a scheduler; Dask itself would take ten seconds and raise an unclear error.

    Raises
    ------
    EngineError
        If it cannot be one.
    """
    if not ADDRESS.fullmatch(address):
        needed = "the address of a Dask scheduler; write for example --cluster tcp://127.0.0.1:8786"
        raise EngineError(f"--cluster: found {quote(address)}, needed {needed}")


@contextmanager
def cluster_executor(address: str) -> Iterator[Executor]:
    """Return a context with an executor of the workers of a Dask scheduler; at its end, what they have not done is cancelled.

    Raises
    ------
    EngineError
        If the scheduler does not answer or has no workers.
    MissingPackageError
        If Dask is not installed.
    """
    check_address(address)
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        message = f"--cluster: Dask is not installed; to get it: `{install_command('dask')}`"
        raise MissingPackageError(message) from None
    # A scheduler that goes away is our error of one line, not a traceback in Dask's log
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        # Not the default client, which a caller's own program may have set
        client = distributed.Client(address, timeout=CONNECT_TIME, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        why = " ".join(str(error).split()) or type(error).__name__
        way_out = "start it with `dask scheduler`, and its workers with `dask worker`"
        raise EngineError(f"--cluster: {address}: found no scheduler that answers ({why}), needed one; {way_out}") from None
    try:
        try:
            client.wait_for_workers(1, timeout=WORKER_TIME)
        except OSError:
            found = "found a scheduler without workers, needed one or more"
            raise EngineError(f"--cluster: {address}: {found}; start them with `dask worker {address}`") from None
        # By default Dask hashes the arguments, to find the result of an equal call; no two chunks are equal
        yield client.get_executor(pure=False, retries=RETRIES)
    finally:
        client.close(timeout=CONNECT_TIME)
