"""Makes a map: computes the missing chunks, writes each when it is ready, and makes the figures and the report."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path

from looping_pendulum.engines import MEMORY_LIMIT
from looping_pendulum.engines.isolation import TIME_LIMIT
from looping_pendulum.errors import EngineError, HarnessError
from looping_pendulum.processes import POLL_INTERVAL, core_count
from looping_pendulum.reference_ode.batch import Progress
from looping_pendulum.sweep import cells, report
from looping_pendulum.sweep.cells import Values
from looping_pendulum.sweep.dask_cluster import cluster_executor
from looping_pendulum.sweep.map_file import MapPlan, Region, run_count
from looping_pendulum.sweep.report import EngineSummary
from looping_pendulum.sweep.store import MapStore, claimed

MAX_ON_CLUSTER = 256
"""Chunks that a cluster holds at a time: results that are ready sooner than they can be written fill the memory."""


@dataclass(frozen=True, kw_only=True)
class MapOutcome:
    """Outcome of `run_map`."""

    folder: Path
    runs: int
    """Number of runs of the whole map."""
    runs_before: int
    """Number of runs that the folder held before this call."""
    runs_now: int
    """Number of runs that it holds now."""
    seconds: float
    """Wall time of the runs made by this call [s]."""
    interrupted: bool = False
    summaries: tuple[EngineSummary, ...] = ()
    """Summary of each engine's runs; empty if the map is not complete."""

    @property
    def complete(self) -> bool:
        """Whether the folder holds every run."""
        return self.runs_now == self.runs


def run_map(
    plan: MapPlan,
    folder: Path | str,
    *,
    jobs: int | None = None,
    cluster: str | None = None,
    figures: bool = True,
    time_limit: float = TIME_LIMIT,
    memory_limit: int = MEMORY_LIMIT,
    progress: Progress = lambda done, runs: None,
    solve: Callable[..., Values] = cells.solve_chunk,
) -> MapOutcome:
    """Make the map of ``plan`` in ``folder``, or continue one that was interrupted.

    Parameters
    ----------
    plan
        The map; `map_file.load` reads one.
    folder
        A new or empty folder, or one that holds a part of this map.
    jobs
        Number of chunks that are computed at a time on this machine; one per core if None.
    cluster
        Address of a Dask scheduler, "tcp://host:port", to run there instead.
    figures
        Whether to draw the figure.
    time_limit, memory_limit
        Limits of each run of an engine [s], [bytes].
    progress
        Called after each chunk with the number of runs that are done and the number of all runs.
    solve
        Function that computes a chunk; tests replace it.

    Raises
    ------
    MapError
        If the folder holds something else, or if the disk is full.
    EngineError
        If the cluster fails.
    """
    folder = Path(folder)
    with claimed(folder):
        store = MapStore(plan, folder)
        missing = store.missing()
        before = done = plan.runs - sum(map(run_count, missing))
        progress(done, plan.runs)
        interrupted, started = False, time.monotonic()
        cancelled = threading.Event()
        compute = partial(solve, plan, time_limit=time_limit, memory_limit=memory_limit)
        executor: AbstractContextManager[Executor]
        if cluster is None:
            jobs = jobs or core_count()
            # Threads do: the core computes without the interpreter's lock, and engines run in processes of their own
            executor, limit = ThreadPoolExecutor(jobs), 2 * jobs
            compute = partial(compute, cancelled=cancelled)
        else:
            executor, limit = cluster_executor(cluster), MAX_ON_CLUSTER
            compute = partial(compute, expected_versions=store.attributes["versions"])
        try:
            with executor as pool:
                try:
                    for region, future in _ended(pool, compute, missing, limit):
                        store.write(region, _result(future, cluster))
                        done += run_count(region)
                        progress(done, plan.runs)
                finally:
                    cancelled.set()
        except KeyboardInterrupt:
            interrupted = True
        seconds = time.monotonic() - started
        summaries = tuple(report.write(plan, store, folder, figures=figures)) if done == plan.runs else ()
    counts = {"runs": plan.runs, "runs_before": before, "runs_now": done}
    return MapOutcome(folder=folder, **counts, seconds=seconds, interrupted=interrupted, summaries=summaries)


def _ended(
    executor: Executor, compute: Callable[[Region], Values], regions: list[Region], limit: int
) -> Iterator[tuple[Region, Future[Values]]]:
    """Compute chunks, at most ``limit`` at a time; yield each when it has ended."""
    waiting = iter(regions)
    computing: dict[Future[Values], Region] = {}
    while True:
        computing |= {executor.submit(compute, region): region for region in islice(waiting, limit - len(computing))}
        if not computing:
            return
        # In short steps, as Windows lets Ctrl-C through only between two of them
        for future in wait(computing, POLL_INTERVAL, FIRST_COMPLETED).done:
            yield computing.pop(future), future


def _result(future: Future[Values], cluster: str | None) -> Values:
    """Return the result of a chunk; an error of the cluster's own is an `EngineError` of one line."""
    try:
        return future.result()
    except Exception as error:
        # Our own errors are one line already, and the fault is not the cluster's
        if cluster is None or isinstance(error, HarnessError):
            raise
        # Dask cancels what it computes when it loses its scheduler
        lost, why = isinstance(error, CancelledError), f"{type(error).__name__}: {' '.join(str(error).split())}"
        what = "its scheduler no longer answers" if lost else f"a chunk failed ({why})"
        way_out = "what is finished is kept: repair the cluster and run the same command again"
        raise EngineError(f"--cluster: {cluster}: {what}; {way_out}") from None
