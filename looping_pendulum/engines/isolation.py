"""Each run in a process of its own, with limits: an engine that crashes, hangs or eats memory takes nothing else with it.

The worker (`worker.py`) appends every sample to a file as it is made, so the parent keeps what a dead run had computed.
Whatever the engine prints, from Python or from C, goes to another file.
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from looping_pendulum.engines import memory
from looping_pendulum.engines.job import RESULT, ROW_BYTES, SAMPLES, EngineJob, identity, read_rows
from looping_pendulum.engines.memory import MEMORY_LIMIT, held_memory, show_memory
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Engine, declared
from looping_pendulum.engines.registry import how_to_get, missing_packages
from looping_pendulum.engines.trajectory import COLUMNS, RunStatus, Trajectory, from_samples
from looping_pendulum.process_start import OUTPUT
from looping_pendulum.processes import Supervised
from looping_pendulum.scenarios.scenario import Scenario

TIME_LIMIT = 900.0
"""Default limit on one run [s]."""
POLL_INTERVAL = 0.05
"""Time between two looks at a worker [s]."""
OUTPUT_LIMIT = 2**24
"""An engine that has printed more than this is not kept: the file starts anew [bytes]."""
OUTPUT_KEPT = 2**16
"""How much of the end of what an engine printed comes back [bytes]."""
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONFAULTHANDLER": "1",
    "PYTHONUNBUFFERED": "1",  # what was printed before a crash is there
}
"""Variables of a worker."""

Progress = Callable[[Engine, float], None]
"""Called with an engine and the share of its run that is done, 0 to 1."""


@dataclass(frozen=True, kw_only=True)
class RunLimits:
    """What one run may take."""

    time: float = TIME_LIMIT
    """[s]"""
    memory: int = MEMORY_LIMIT
    """What the worker may hold [bytes]; not watched where the system does not tell (Windows)."""


def run_isolated(
    engine: Engine,
    scenario: Scenario,
    *,
    time_limit: float = TIME_LIMIT,
    memory_limit: int = MEMORY_LIMIT,
    progress: Progress | None = None,
    cancelled: threading.Event | None = None,
) -> Trajectory:
    """Run ``engine`` on ``scenario`` in a process of its own; whatever happens there, return a trajectory that says so.

    ``time_limit`` is in s, ``memory_limit`` in bytes.
    """
    missing = missing_packages(engine)
    if missing:
        return _without_run(engine, scenario, RunStatus.MISSING, f"get it: {how_to_get(missing[0])}")
    unsupported = engine.abilities.unsupported(scenario.parameters)
    if unsupported:
        return _without_run(engine, scenario, RunStatus.UNSUPPORTED, unsupported)
    try:
        job = pickle.dumps(EngineJob(engine=engine, scenario=scenario))
    except Exception as error:
        why = f"it cannot travel to its process: {type(error).__name__}: {error}"
        return _without_run(engine, scenario, RunStatus.FAILED, why)
    limits = RunLimits(time=time_limit, memory=memory_limit)
    process = Supervised("looping_pendulum.engines.worker:main", job, ENVIRONMENT)
    try:
        status, message = _watch(process, engine, scenario, limits, progress, cancelled)
        process.end()
        return _result(process, engine, scenario, status, message)
    finally:
        process.close()


def _result(process: Supervised, engine: Engine, scenario: Scenario, status: RunStatus | None, message: str) -> Trajectory:
    """Return what an ended worker has left in its folder."""
    folder = process.folder
    output = _tail(folder / OUTPUT)
    if status is None:
        try:
            trajectory: Trajectory = pickle.loads((folder / RESULT).read_bytes())
            return replace(trajectory, output=output, **declared(engine, scenario.parameters))
        except FileNotFoundError:
            pass
        except Exception as error:
            status, message = RunStatus.FAILED, f"its result cannot be read: {type(error).__name__}: {error}"
    return from_samples(
        read_rows(folder / SAMPLES),
        parameters=scenario.parameters,
        status=status or RunStatus.CRASHED,
        message=message or "it ended without a result",
        output=output,
        **identity(engine, scenario),
    )


def run_all(
    engines: Sequence[Engine],
    scenario: Scenario,
    *,
    jobs: int | None = None,
    time_limit: float = TIME_LIMIT,
    memory_limit: int = MEMORY_LIMIT,
    progress: Progress | None = None,
    finished: Callable[[Trajectory], None] | None = None,
) -> list[Trajectory]:
    """Run several engines side by side, at most ``jobs`` at once (default: one per core); results in the order of ``engines``.

    Each run may take ``time_limit`` [s] and ``memory_limit`` [bytes].
    An interrupt (Ctrl-C) stops all that still run; their trajectories come back as INTERRUPTED with what they had.
    """
    cancelled = threading.Event()

    def one(engine: Engine) -> Trajectory:
        trajectory = run_isolated(
            engine, scenario, time_limit=time_limit, memory_limit=memory_limit, progress=progress, cancelled=cancelled
        )
        if finished is not None:
            finished(trajectory)
        return trajectory

    with ThreadPoolExecutor(max_workers=jobs or os.cpu_count() or 1) as pool:
        futures = [pool.submit(one, engine) for engine in engines]
        while not all(future.done() for future in futures):
            try:
                time.sleep(POLL_INTERVAL)
            except KeyboardInterrupt:
                cancelled.set()
        return [future.result() for future in futures]


def _watch(
    process: Supervised,
    engine: Engine,
    scenario: Scenario,
    limits: RunLimits,
    progress: Progress | None,
    cancelled: threading.Event | None,
) -> tuple[RunStatus | None, str]:
    """Wait for a worker; return (None, "") if it ended by itself with success."""
    samples, printed = process.folder / SAMPLES, process.folder / OUTPUT
    expected = max(1, round(scenario.duration / SAMPLE_INTERVAL) + 1)
    deadline = time.monotonic() + limits.time
    next_look = 0.0
    while not process.wait(POLL_INTERVAL):
        now = time.monotonic()
        if cancelled is not None and cancelled.is_set():
            return RunStatus.INTERRUPTED, ""
        if now > deadline:
            return RunStatus.TIME_LIMIT, f"limit {limits.time:g} s"
        if now >= next_look and process.pid is not None:
            next_look = now + memory.POLL_INTERVAL
            held = held_memory(process.pid)
            if held is not None and held > limits.memory:
                return RunStatus.MEMORY_LIMIT, f"held {show_memory(held)}, limit {show_memory(limits.memory)}"
        if _size(printed) > OUTPUT_LIMIT:
            os.truncate(printed, 0)
        if progress is not None:
            progress(engine, min(1.0, _size(samples) / ROW_BYTES / expected))
    if progress is not None:
        progress(engine, 1.0)
    code = process.returncode
    if process.fault:
        return RunStatus.CRASHED, f"its process could not begin: {process.fault}"
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        hint = "; not by us: was the machine out of memory?" if name == "SIGKILL" else ""
        return RunStatus.CRASHED, f"killed by signal {name}{hint}"
    return (None, "") if code == 0 else (RunStatus.CRASHED, f"exit status {code}")


def _size(path: Path) -> int:
    """Size of a file [bytes]; 0 if it is not there (yet)."""
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _tail(path: Path) -> str:
    """Return the last `OUTPUT_KEPT` bytes of a file as text; nothing if it is not there."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, _size(path) - OUTPUT_KEPT))
            return file.read().decode(errors="replace")
    except OSError:
        return ""


def _without_run(engine: Engine, scenario: Scenario, status: RunStatus, message: str) -> Trajectory:
    return from_samples(
        np.empty((0, len(COLUMNS))),
        parameters=scenario.parameters,
        status=status,
        message=message,
        **identity(engine, scenario),
    )
