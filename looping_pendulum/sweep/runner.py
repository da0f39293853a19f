"""Makes a map: computes the missing chunks, writes each when it is ready, and makes the figures and the report."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from looping_pendulum.engines.isolation import MEMORY_LIMIT, TIME_LIMIT
from looping_pendulum.errors import EngineError
from looping_pendulum.files import write_atomically
from looping_pendulum.processes import core_count, in_processes
from looping_pendulum.scenarios.document import one_line
from looping_pendulum.sweep import cells, dask_cluster, report
from looping_pendulum.sweep.dask_cluster import Solve
from looping_pendulum.sweep.plan import MapPlan
from looping_pendulum.sweep.report import EngineSummary
from looping_pendulum.sweep.store import STORE, MapStore, claimed, open_store

TIMINGS = "timings.json"
"""File with the times at which a map was made and its speed; the store itself does not depend on them."""

Progress = Callable[[int, int], None]
"""Callback that is given the number of runs that are done and the number of all runs."""


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
    progress: Progress | None = None,
    solve: Solve = cells.solve,
) -> MapOutcome:
    """Make the map of ``plan`` in ``folder``, or continue one that was interrupted.

    Parameters
    ----------
    plan
        The map; `map_file.load` reads one.
    folder
        A new or empty folder, or one that holds a part of this map.
    jobs
        Number of processes on this machine; one per core if None.
    cluster
        Address of a Dask scheduler, "tcp://host:port", to run there instead.
    figures
        Whether to draw the figure.
    time_limit, memory_limit
        Limits of each run of an engine [s], [bytes].
    progress
        Callback after each chunk.
    solve
        Function that computes a chunk; tests replace it.

    Raises
    ------
    MapError
        If the folder holds something else, or if the disk is full.
    EngineError
        If a worker process or the cluster fails.
    """
    folder = Path(folder)
    with claimed(folder):
        store = open_store(plan, folder)
        missing = store.missing()
        tasks = _tasks(plan, missing, time_limit, memory_limit)
        processes = min(jobs or core_count(), len(missing))
        if cluster is not None:
            results = dask_cluster.on_cluster(tasks, solve, cluster)
        else:
            results = in_processes(tasks, solve, processes)
        outcome = _fill(plan, store, folder, missing, results, progress)
        if outcome.seconds:
            _note_time(folder, outcome, "a cluster" if cluster else f"{jobs or core_count()} processes")
        if outcome.complete:
            summaries = report.write(plan, folder / STORE, folder, figures=figures)
            return replace(outcome, summaries=tuple(summaries))
    return outcome


def _tasks(plan: MapPlan, missing: list[int], time_limit: float, memory_limit: int) -> Iterator[cells.CellTask]:
    for index in missing:
        unit = plan.unit(index)
        yield cells.CellTask(
            index=index,
            engine=plan.engines[unit.engine],
            profile=plan.profile,
            scenario=plan.scenario,
            columns=plan.columns(unit),
            tolerance=plan.tolerance,
            duration=plan.duration,
            time_limit=time_limit,
            memory_limit=memory_limit,
        )


def _fill(
    plan: MapPlan,
    store: MapStore,
    folder: Path,
    missing: list[int],
    results: Iterator[cells.CellResult],
    progress: Progress | None,
) -> MapOutcome:
    """Write each chunk when its result arrives."""
    before = plan.runs - sum(plan.unit(index).runs for index in missing)
    done, interrupted, started = before, False, time.monotonic()
    wanted = {engine: cells.versions(engine, plan.profile) for engine in plan.engines}
    if progress is not None:
        progress(done, plan.runs)
    try:
        # Closed also on an exception: the generator's own end stops the processes or leaves the cluster
        with closing(results):  # type: ignore[type-var]
            # A generator starts its processes with its first item, so a complete map starts none
            for result in results if missing else ():
                unit = plan.unit(result.index)
                # Before writing: versions on a cluster's machines may differ, and a map is made with one
                for package, there, here in cells.differing_versions(result.versions, wanted[plan.engines[unit.engine]]):
                    message = f"--cluster: found {package} {there} on a worker, needed {here} as on this machine"
                    raise EngineError(one_line(f"{message}; install {package} {here} there"))
                store.write(unit, result.values)
                done += unit.runs
                if progress is not None:
                    progress(done, plan.runs)
    except KeyboardInterrupt:
        interrupted = True
    seconds = time.monotonic() - started if missing else 0.0
    return MapOutcome(
        folder=folder, runs=plan.runs, runs_before=before, runs_now=done, seconds=seconds, interrupted=interrupted
    )


def _note_time(folder: Path, outcome: MapOutcome, where: str) -> None:
    """Append the duration of this call to the folder's timings."""
    path = folder / TIMINGS
    sessions: list[Any] = []
    if path.exists():
        try:
            sessions = json.loads(path.read_text())["sessions"]
        except (ValueError, KeyError, TypeError):
            sessions = []  # a damaged file is replaced: it holds nothing but timings
    runs = outcome.runs_now - outcome.runs_before
    sessions.append(
        {
            "ended": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "on": where,
            "runs": runs,
            "seconds": round(outcome.seconds, 3),
            "runs_per_second": round(runs / outcome.seconds, 1) if outcome.seconds else None,
        }
    )
    write_atomically(path, json.dumps({"sessions": sessions}, indent=2) + "\n")
