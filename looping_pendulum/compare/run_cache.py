"""Many runs, each in a process of its own, kept on disk as they end: an interrupted study goes on where it was."""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path

import numpy as np

from looping_pendulum import __version__
from looping_pendulum.compare.export import file_stem, unknown_as_nan, write_whole
from looping_pendulum.compare.json_text import plain
from looping_pendulum.engines.isolation import POLL_INTERVAL, run_isolated
from looping_pendulum.engines.job import identity
from looping_pendulum.engines.memory import MEMORY_LIMIT
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.registry import label
from looping_pendulum.engines.trajectory import COLUMNS, RunStatus, Trajectory, from_samples
from looping_pendulum.scenarios.scenario import Scenario

NOT_KEPT = (RunStatus.INTERRUPTED, RunStatus.MISSING, RunStatus.MEMORY_LIMIT)
"""Ends after which a run is worth another try."""
STEEPEST = 3.0
"""Largest power of the refinement with which costs are taken to grow."""
FIRST_GUESS = 10.0
"""Most that a cost is taken to grow to the second rung, while nothing says how it grows."""


class DamagedRunWarning(UserWarning):
    """A kept run cannot be read, so it is made again."""


Progress = Callable[[float, str], None]
"""Called with the share of the work that is done, 0 to 1, and what goes on."""


@dataclass(frozen=True, kw_only=True)
class RunTask:
    """One run to be made."""

    key: str
    engine: Engine
    scenario: Scenario
    what: str
    """For the progress bar."""
    like: str = ""
    """Key of a run that costs as much, as far as one knows beforehand."""
    size: float = 1.0
    """Of a rung's setting; falls as the ladder gets finer."""
    coarser: tuple[tuple[str, float], ...] = ()
    """Keys and sizes of the rungs above it, from coarse to fine."""


@dataclass(frozen=True, kw_only=True)
class EndedRun:
    """What became of a task."""

    run: Trajectory | None
    """None if it was left out."""
    seconds: float | None
    """Wall time, start of the process included."""
    expected: float | None = None
    """Wall time that it was expected to take, where that was above the budget."""


def run_key(engine: Engine, scenario: Scenario) -> str:
    """Name of a run: the same for the same settings, scenario, versions and adapter.

    The adapter's own folder is part of it; code that adapters share is by the version of this package alone.
    """
    versions = {package: _version(package) for package in engine.abilities.packages} | {"looping-pendulum": __version__}
    state = {name: plain(value) for name, value in getattr(engine, "__dict__", {}).items() if name != "abilities"}
    what = {
        "class": f"{type(engine).__module__}.{type(engine).__qualname__}",
        "engine": [label(engine), engine.profile.value, state, plain(engine.settings)],
        "scenario": [plain(scenario.parameters.as_dict()), scenario.duration],
        "versions": versions,
        "source": _source(type(engine).__module__),
    }
    digest = hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()[:20]
    return f"{file_stem(label(engine))}-{digest}"


@cache
def _source(module: str) -> str:
    """Digest of the Python files beside ``module``, but for those that only say what to vary."""
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:
        return ""
    files = sorted(path for path in Path(file).parent.glob("*.py") if path.name != "studies.py")
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


@cache
def _version(package: str) -> str:
    """Version of what is imported as ``package``, which pip may call otherwise."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ", ".join(version(name) for name in packages_distributions().get(package, ())) or "none"


class RunCache:
    """Ended runs, a file each."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def get(self, task: RunTask, time_limit: float) -> EndedRun | None:
        """Return the kept run of ``task``; None if there is none, or one that a shorter time limit has cut.

        A file that is damaged in whatever way is as none: the run is made again and takes its place.
        """
        path = self.folder / f"{task.key}.npz"
        if not path.is_file():
            return None
        try:
            return self._read(path, task, time_limit)
        except Exception as error:
            warnings.warn(DamagedRunWarning(f"{path} is damaged ({type(error).__name__}); its run is made again"), stacklevel=2)
            return None

    @staticmethod
    def _read(path: Path, task: RunTask, time_limit: float) -> EndedRun | None:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:  # of a damaged one np.load closes nothing
            rows, said = np.asarray(file["rows"], dtype=float), json.loads(str(file["said"]))
        if not (rows.ndim == 2 and rows.shape[1] == len(COLUMNS) and (np.diff(rows[:, 0]) > 0).all()):
            raise ValueError(f"{path}: found rows of shape {rows.shape}, needed {len(COLUMNS)} columns and times that grow")
        status = RunStatus[said["status"]]
        if status is RunStatus.TIME_LIMIT and said["time_limit"] < time_limit:
            return None
        run = from_samples(
            rows,
            parameters=task.scenario.parameters,
            status=status,
            message=str(said["message"]),
            wall_time=math.nan if said["wall_time"] is None else float(said["wall_time"]),
            **identity(task.engine, task.scenario),
        )
        versions = {str(package): str(found) for package, found in said["versions"].items()}
        provenance = replace(run.provenance, versions=versions)
        seconds = None if said["seconds"] is None else float(said["seconds"])
        return EndedRun(run=replace(run, provenance=provenance), seconds=seconds)

    def put(self, task: RunTask, done: EndedRun, time_limit: float) -> None:
        """Keep a run, unless its end says to try again."""
        run = done.run
        if run is None or run.status in NOT_KEPT:
            return
        said = {
            "status": run.status.name,
            "message": run.message,
            "wall_time": run.wall_time if math.isfinite(run.wall_time) else None,
            "seconds": done.seconds,
            "time_limit": time_limit,
            "versions": run.provenance.versions,
        }
        parts = (run.light_position, run.light_velocity, run.heavy_position, run.heavy_velocity)
        slip = unknown_as_nan(run.string_slip, run)
        rows = np.column_stack([run.t, *parts, run.string_stretch, slip]).reshape(-1, len(COLUMNS))
        out = io.BytesIO()
        np.savez_compressed(out, rows=rows, said=np.array(json.dumps(said)))
        write_whole(self.folder / f"{task.key}.npz", out.getvalue())


class Runner:
    """Makes runs side by side; what it knows of their cost decides what a budget leaves out."""

    def __init__(
        self,
        kept: RunCache,
        *,
        jobs: int | None,
        time_limit: float,
        budget: float | None,
        memory_limit: int = MEMORY_LIMIT,
        progress: Progress | None = None,
    ) -> None:
        self.kept, self.jobs, self.budget, self.progress = kept, jobs or os.cpu_count() or 1, budget, progress
        self.time_limit, self.memory_limit = time_limit, memory_limit
        self.done: dict[str, EndedRun] = {}
        self.cancelled = threading.Event()
        self._running: dict[str, float] = {}
        self._lock = threading.Lock()

    def run(self, tasks: Sequence[RunTask]) -> dict[str, EndedRun]:
        """Make all runs in the order of ``tasks``; after an interrupt (Ctrl-C), return those that ended before it."""
        tasks = list({task.key: task for task in tasks}.values())
        for task in tasks:
            found = self.kept.get(task, self.time_limit)
            if found is not None:
                self.done[task.key] = found
        waiting = [task for task in tasks if task.key not in self.done]
        queue = iter(waiting)

        def work() -> None:
            while not self.cancelled.is_set():
                with self._lock:
                    task = next(queue, None)
                if task is None:
                    return
                self._one(task)

        with ThreadPoolExecutor(max_workers=self.jobs) as pool:
            futures = [pool.submit(work) for _ in range(self.jobs)]
            while not all(future.done() for future in futures):
                try:
                    time.sleep(POLL_INTERVAL)
                    self._report(tasks)
                except KeyboardInterrupt:
                    self.cancelled.set()
            for future in futures:
                future.result()
        return self.done

    def _one(self, task: RunTask) -> None:
        expected = self.expected(task)
        if self.budget is not None and expected is not None and expected > self.budget:
            self.done[task.key] = EndedRun(run=None, seconds=None, expected=expected)
            return
        with self._lock:
            self._running[task.key] = 0.0
        started = time.perf_counter()
        run = run_isolated(
            task.engine,
            task.scenario,
            time_limit=self.time_limit,
            memory_limit=self.memory_limit,
            progress=lambda _, share: self._running.__setitem__(task.key, share),
            cancelled=self.cancelled,
        )
        done = EndedRun(run=run, seconds=time.perf_counter() - started)
        self.kept.put(task, done, self.time_limit)
        with self._lock:
            del self._running[task.key]
        if run.status is not RunStatus.INTERRUPTED:
            self.done[task.key] = done

    def expected(self, task: RunTask) -> float | None:
        """Wall time [s] that ``task`` is expected to take, from coarser rungs or from the variant's own run; None: no idea."""
        known = [(size, cost) for key, size in task.coarser if (cost := self._cost(key)) is not None]
        if not known:
            return self._cost(task.like)
        size, cost = known[-1]
        if task.size <= 0:
            return cost
        if len(known) == 1:
            return float(cost * min(size / task.size, FIRST_GUESS))
        before, earlier = known[-2]
        power = min(max(math.log(cost / earlier) / math.log(before / size), 0.0), STEEPEST)
        return float(cost * (size / task.size) ** power)

    def _cost(self, key: str) -> float | None:
        done = self.done.get(key)
        if done is None or done.run is None:
            return None if done is None else done.expected
        return done.run.wall_time if math.isfinite(done.run.wall_time) else done.seconds

    def _report(self, tasks: Sequence[RunTask]) -> None:
        if self.progress is None:
            return
        costs = [self._cost(task.key) for task in tasks]
        known = [cost for cost in costs if cost is not None]
        usual = sum(known) / len(known) if known else 1.0
        total = finished = 0.0
        with self._lock:
            running = dict(self._running)
        for task in tasks:
            ended = self.done.get(task.key)
            if ended is not None:
                weight, share = ended.seconds or 0.0, 1.0
            else:
                weight, share = self.expected(task) or usual, running.get(task.key, 0.0)
                weight = 0.0 if self.budget is not None and weight > self.budget and task.key not in running else weight
            total, finished = total + weight, finished + share * weight
        going_on = ", ".join(task.what for task in tasks if task.key in running)
        ended_runs = sum(task.key in self.done for task in tasks)
        self.progress(finished / total if total else 1.0, f"{ended_runs} of {len(tasks)} runs; {going_on}")
