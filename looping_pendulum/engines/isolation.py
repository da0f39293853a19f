"""Run each engine in a process of its own, with limits, so that one that crashes, hangs or fills the memory harms no other run.

The worker (`worker.py`) appends every sample to a file as it is computed, so the parent keeps the samples of a run that died.
Whatever the engine prints, from Python or from C, goes to another file.
"""

from __future__ import annotations

import contextlib
import pickle
import tempfile
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from looping_pendulum.engines import MEMORY_LIMIT
from looping_pendulum.engines.protocol import Engine, known_fields
from looping_pendulum.engines.registry import how_to_get, missing_packages
from looping_pendulum.engines.worker import FAILURE, JOB, WORKER, simulate
from looping_pendulum.errors import EngineError, shorten
from looping_pendulum.pages.numbers import number
from looping_pendulum.processes import (
    DISK_LIMIT,
    OUTPUT,
    Cause,
    Ending,
    Interpreter,
    core_count,
    file_size,
    run_many,
    run_python,
)
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.runs.storage import field_error, read_run, read_samples, recorded_count
from looping_pendulum.runs.trajectory import COLUMNS, SAMPLE_INTERVAL, Provenance, RunStatus, Trajectory, from_samples
from looping_pendulum.scenarios.scenario import Scenario

TIME_LIMIT = 900.0
"""Default time limit of one run [s]."""

NO_SAMPLES = np.empty((0, len(COLUMNS)))
"""Rows of a run that has none."""

PREFIX = "looping-pendulum-"
"""Beginning of the name of a run's temporary folder."""
MAX_RETURNED_OUTPUT = 2**16
"""How much of the end of an engine's output is returned [bytes]."""
MAX_MESSAGE = 500
"""Longest message of a run; an engine's own may be of any length and of several lines."""
OF_THE_PROCESS = (
    *(RunStatus.TIME_LIMIT, RunStatus.MEMORY_LIMIT, RunStatus.DISK_LIMIT),
    *(RunStatus.CRASHED, RunStatus.MISSING, RunStatus.INTERRUPTED),
)
"""Statuses that no engine can know of its own run."""
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    # so that a crash in C code leaves its stack in the output
    "PYTHONFAULTHANDLER": "1",
    "PYTHONUNBUFFERED": "1",  # so that what was printed before a crash is in the file
}
"""Environment variables of a worker.

One thread each: as many runs go on at once as there are cores.
"""

Progress = Callable[[Engine, float], None]
"""Function that is called with an engine and the completed fraction of its run, 0 to 1."""


def run_isolated(
    engine: Engine,
    scenario: Scenario,
    *,
    time_limit: float = TIME_LIMIT,
    memory_limit: int = MEMORY_LIMIT,
    progress: Progress | None = None,
    cancelled: threading.Event | None = None,
    interpreter: Interpreter | None = None,
) -> Trajectory:
    """Run ``engine`` on ``scenario`` in a process of its own.

    Whatever happens there, this returns a trajectory, whose status says how the run ended. ``time_limit`` is in s,
    ``memory_limit`` in bytes. With an ``interpreter`` it runs by that Python, which must have the engine's packages.
    """
    missing = missing_packages(engine) if interpreter is None else ()
    if missing:
        return _unfinished(engine, scenario, RunStatus.MISSING, f"get it: {how_to_get(missing[0], anywhere=True)}")
    unsupported = engine.abilities.unsupported(scenario.parameters)
    if unsupported:
        return _unfinished(engine, scenario, RunStatus.UNSUPPORTED, unsupported)
    if cancelled is not None and cancelled.is_set():
        return _unfinished(engine, scenario, RunStatus.INTERRUPTED, "")
    try:
        job = pickle.dumps((partial(simulate, engine, scenario), time_limit))
    # Another package's engine may hold anything, and raise anything on being pickled
    except Exception as error:
        why = f"it cannot be pickled for its process: {type(error).__name__}: {error}"
        return _unfinished(engine, scenario, RunStatus.FAILED, why)
    expected = max(1, round(scenario.duration / SAMPLE_INTERVAL) + 1)

    def report_progress() -> None:
        if progress is not None:
            # The number of samples says how far a run is, without the worker having to report it
            progress(engine, min(1.0, recorded_count(folder) / expected))

    try:
        with tempfile.TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as path:
            folder = Path(path)
            (folder / JOB).write_bytes(job)
            ending = run_python(
                WORKER,
                folder,
                time_limit=time_limit,
                memory_limit=memory_limit,
                environment=ENVIRONMENT,
                interpreter=interpreter,
                cancelled=cancelled,
                meanwhile=report_progress,
            )
            if progress is not None and ending.cause in (Cause.ITSELF, Cause.SIGNAL):
                progress(engine, 1.0)
            return _result(folder, engine, scenario, *_status(ending, time_limit, memory_limit))
    except OSError as error:
        why = f"its process could not start, or its files not be read: {error.filename}: {error.strerror}"
        return _unfinished(engine, scenario, RunStatus.CRASHED, why)


def _status(ending: Ending, time_limit: float, memory_limit: int) -> tuple[RunStatus | None, str]:
    """Return status and message of a run by how its process ended; (None, "") if its record tells them."""
    held = format_memory(ending.amount)
    match ending.cause:
        case Cause.TIME:
            return RunStatus.TIME_LIMIT, f"limit {time_limit:g} s"
        case Cause.MEMORY:
            return RunStatus.MEMORY_LIMIT, f"held {held}, limit {format_memory(memory_limit)}"
        case Cause.DISK:
            return RunStatus.DISK_LIMIT, f"its folder held {held}, limit {format_memory(DISK_LIMIT)}"
        case Cause.CANCELLED:
            return RunStatus.INTERRUPTED, ""
    return (None, "") if ending.succeeded else (RunStatus.CRASHED, str(ending))


def _result(folder: Path, engine: Engine, scenario: Scenario, status: RunStatus | None, message: str) -> Trajectory:
    """Return the trajectory of a worker that has ended, from the files in its folder.

    ``status`` is None if the worker ended by itself and should have written its record, or what its engine raised.
    """
    output = ""
    with contextlib.suppress(OSError), (folder / OUTPUT).open("rb") as file:
        file.seek(max(0, file_size(folder / OUTPUT) - MAX_RETURNED_OUTPUT))
        output = file.read().decode(errors="replace")
    failure = folder / FAILURE
    if status is None and failure.exists():
        status, message = RunStatus.FAILED, failure.read_text(encoding="utf-8", errors="replace")
    if status is None:
        known = known_fields(engine, scenario)
        try:
            run = read_run(folder, parameters=scenario.parameters, duration=scenario.duration, output=output, **known)
            if run.status in OF_THE_PROCESS:
                raise field_error("status", run.status.name, f"none of {', '.join(status.name for status in OF_THE_PROCESS)}")
            return replace(run, message=_short(run.message))
        except FileNotFoundError:
            status, message = RunStatus.CRASHED, "it ended without a result"
        except EngineError as error:
            status, message = RunStatus.FAILED, str(error)
    rows = read_samples(folder, duration=scenario.duration)
    return _unfinished(engine, scenario, status, _short(message), rows=rows, output=output)


def _short(message: str) -> str:
    """Return a message as one line that is not too long."""
    return shorten(" ".join(message.split()), MAX_MESSAGE)


def run_all(
    engines: Sequence[Engine],
    scenario: Scenario,
    *,
    jobs: int | None = None,
    time_limit: float = TIME_LIMIT,
    memory_limit: int = MEMORY_LIMIT,
    progress: Progress | None = None,
    finished: Callable[[Trajectory], None] | None = None,
    meanwhile: Callable[[list[Trajectory]], None] | None = None,
) -> list[Trajectory]:
    """Run several engines in parallel, at most ``jobs`` at once (default: one per core), and return them in that order.

    They start in that order. Each run may take ``time_limit`` [s] and ``memory_limit`` [bytes]. ``finished`` is called with
    each trajectory, from the thread that waited for it; ``meanwhile`` with all those so far, in the engines' order and from the
    caller's thread, whenever more have ended while others go on. An interrupt (Ctrl-C) stops all runs that still go on; their
    trajectories have the status INTERRUPTED and the samples computed so far.
    """
    cancelled = threading.Event()

    def run_one(engine: Engine) -> Trajectory:
        trajectory = run_isolated(
            engine, scenario, time_limit=time_limit, memory_limit=memory_limit, progress=progress, cancelled=cancelled
        )
        if finished is not None:
            finished(trajectory)
        return trajectory

    shown = 0

    def show(results: dict[int, Trajectory]) -> None:
        nonlocal shown
        if meanwhile is not None and shown < len(results) < len(engines):
            shown = len(results)
            meanwhile([results[k] for k in sorted(results)])

    calls = [partial(run_one, engine) for engine in engines]
    ended = run_many(calls, jobs or core_count(), cancelled=cancelled, meanwhile=show)
    # An interrupt leaves runs that had not begun; each of these, too, is reported
    return [ended[k] if k in ended else run_one(engine) for k, engine in enumerate(engines)]


def _unfinished(
    engine: Engine, scenario: Scenario, status: RunStatus, message: str, *, rows: Array = NO_SAMPLES, output: str = ""
) -> Trajectory:
    """Return the trajectory of a run that its engine could not return itself."""
    return from_samples(
        rows,
        parameters=scenario.parameters,
        status=status,
        message=message,
        output=output,
        provenance=Provenance(versions={}, settings=vars(engine.settings), supplies=engine.abilities.supplies),
        **known_fields(engine, scenario),
    )


def format_memory(amount: int) -> str:
    """Write ``amount`` [bytes] in MiB or GiB: "2 GiB", "512 MiB"."""
    return f"{number(amount / 1024**3)} GiB" if amount >= 1024**3 else f"{number(amount / 1024**2)} MiB"
