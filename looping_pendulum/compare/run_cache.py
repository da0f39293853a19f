"""Makes many runs, each in a process of its own, and caches each on disk when it ends, so that a study can be resumed."""

from __future__ import annotations

import hashlib
import io
import json
import math
import sys
import threading
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from looping_pendulum import __version__
from looping_pendulum.compare.json_text import plain
from looping_pendulum.engines.isolation import MEMORY_LIMIT, run_isolated
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.registry import label
from looping_pendulum.engines.worker import identity
from looping_pendulum.files import file_stem, write_atomically
from looping_pendulum.processes import ReportShare, core_count, run_many
from looping_pendulum.runs.trajectory import COLUMNS, RunStatus, Trajectory, from_samples
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import installed_version

NOT_CACHED = (RunStatus.INTERRUPTED, RunStatus.MISSING, RunStatus.MEMORY_LIMIT)
"""Statuses of runs that are not cached, because another try may succeed."""
MAX_COST_EXPONENT = 3.0
"""Largest exponent with which the cost of a run is expected to grow with refinement."""
MAX_FIRST_COST_FACTOR = 10.0
"""Largest factor by which the cost is expected to grow to the second rung, while one rung alone is known."""


class DamagedRunWarning(UserWarning):
    """A cached run cannot be read, so it is made again."""


@dataclass(frozen=True, kw_only=True)
class RunTask:
    """A run to be made."""

    key: str
    engine: Engine
    scenario: Scenario
    what: str
    """Description of the run for the progress bar."""
    like: str = ""
    """Key of a run whose cost is the best estimate of this one's without coarser rungs."""
    size: float = 1.0
    """Size of a rung; decreases with refinement."""
    coarser: tuple[tuple[str, float], ...] = ()
    """Keys and sizes of the coarser rungs, from coarse to fine."""


@dataclass(frozen=True, kw_only=True)
class EndedRun:
    """A run that has ended, or that was left out."""

    run: Trajectory | None
    """None if it was left out."""
    seconds: float | None
    """Wall time, including the start of the process [s]."""
    expected: float | None = None
    """Expected wall time [s] of a run that was left out because it is above the budget."""


def run_key(engine: Engine, scenario: Scenario) -> str:
    """Return the key of a run: the same for the same settings, scenario, versions and adapter.

    It includes a digest of the adapter's own folder; code that adapters share is represented by the version of this package.
    """
    versions = {package: installed_version(package) for package in engine.abilities.packages} | {
        "looping-pendulum": __version__
    }
    state = {name: plain(value) for name, value in getattr(engine, "__dict__", {}).items() if name != "abilities"}
    what = {
        "class": f"{type(engine).__module__}.{type(engine).__qualname__}",
        "engine": [label(engine), engine.profile.value, state, plain(engine.settings)],
        "scenario": [plain(scenario.parameters), scenario.duration],
        "versions": versions,
        "source": source_digest(type(engine).__module__),
    }
    # Only then a further key, so that runs without such effects keep theirs
    if brought := [effect for effect in scenario.parameters.effects if effect.package]:
        what["effects"] = [[e.name, e.package, installed_version(e.package), source_digest(e.module)] for e in brought]
    # 80 bits, so that no two runs share a name by chance
    digest = hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()[:20]
    return f"{file_stem(label(engine))}-{digest}"


@cache
def source_digest(module: str) -> str:
    """Return a digest of the Python files in the folder of ``module``, except studies.py, which only says what to vary."""
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:
        return ""
    files = sorted(path for path in Path(file).parent.glob("*.py") if path.name != "studies.py")
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


class RunCache:
    """Cache of ended runs, one file for each."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def get(self, task: RunTask, time_limit: float) -> EndedRun | None:
        """Return the cached run of ``task``; None if there is none, or if a shorter time limit has cut it.

        A damaged file counts as none: the run is made again and replaces it.
        """
        path = self.folder / f"{task.key}.npz"
        if not path.is_file():
            return None
        try:
            return self._read(path, task, time_limit)
        # A damaged archive may raise anything: of zip, zlib, NumPy or JSON
        except Exception as error:
            warnings.warn(DamagedRunWarning(f"{path} is damaged ({type(error).__name__}); its run is made again"), stacklevel=2)
            return None

    @staticmethod
    def _read(path: Path, task: RunTask, time_limit: float) -> EndedRun | None:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:  # np.load leaves a damaged file open
            rows, said = np.asarray(file["rows"], dtype=float), json.loads(str(file["said"]))
        # An intact archive may still hold something else than a run
        if not (rows.ndim == 2 and rows.shape[1] == len(COLUMNS) and (np.diff(rows[:, 0]) > 0).all()):
            raise ValueError(f"{path}: found rows of shape {rows.shape}, needed {len(COLUMNS)} columns and rising times")
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
        versions = {str(package): str(version) for package, version in said["versions"].items()}
        provenance = replace(run.provenance, versions=versions)
        seconds = None if said["seconds"] is None else float(said["seconds"])
        return EndedRun(run=replace(run, provenance=provenance), seconds=seconds)

    def put(self, task: RunTask, done: EndedRun, time_limit: float) -> None:
        """Cache a run, unless another try may succeed."""
        run = done.run
        if run is None or run.status in NOT_CACHED:
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
        slip = np.full(len(run.t), np.nan) if run.string_slip is None else run.string_slip
        rows = np.column_stack([run.t, *parts, run.string_stretch, slip]).reshape(-1, len(COLUMNS))
        out = io.BytesIO()
        np.savez_compressed(out, rows=rows, said=np.array(json.dumps(said)))
        write_atomically(self.folder / f"{task.key}.npz", out.getvalue())


class Runner:
    """Makes several runs at the same time; a budget leaves out those that are expected to cost too much."""

    def __init__(
        self,
        cache: RunCache,
        *,
        jobs: int | None,
        time_limit: float,
        budget: float | None,
        memory_limit: int = MEMORY_LIMIT,
        progress: ReportShare | None = None,
    ) -> None:
        self.cache, self.jobs, self.budget, self.progress = cache, jobs or core_count(), budget, progress
        self.time_limit, self.memory_limit = time_limit, memory_limit
        self.done: dict[str, EndedRun] = {}
        self.cancelled = threading.Event()
        self._running: dict[str, float] = {}
        self._lock = threading.Lock()

    def run(self, tasks: Sequence[RunTask]) -> dict[str, EndedRun]:
        """Make all runs in the order of ``tasks``; after an interrupt (Ctrl-C) return those that ended before it."""
        # A ladder's rung at the variant's own setting is the same run as the one at its own settings
        tasks = list({task.key: task for task in tasks}.values())
        for task in tasks:
            cached = self.cache.get(task, self.time_limit)
            if cached is not None:
                self.done[task.key] = cached
        waiting = [task for task in tasks if task.key not in self.done]
        run_many(
            [partial(self._make, task) for task in waiting],
            self.jobs,
            cancelled=self.cancelled,
            meanwhile=lambda _: self._report(tasks),
        )
        return self.done

    def _make(self, task: RunTask) -> None:
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
        self.cache.put(task, done, self.time_limit)
        with self._lock:
            del self._running[task.key]
        # An interrupted run is as good as not begun: the next call makes it
        if run.status is not RunStatus.INTERRUPTED:
            self.done[task.key] = done

    def expected(self, task: RunTask) -> float | None:
        """Return the expected wall time [s] of ``task``, from coarser rungs or from the variant's own run; None if unknown."""
        known = [(size, cost) for key, size in task.coarser if (cost := self._cost(key)) is not None]
        if not known:
            return self._cost(task.like)
        size, cost = known[-1]
        if task.size <= 0:
            # A rung of size 0 is the limit itself, from which no ratio of sizes can be taken
            return cost
        if len(known) == 1:
            return float(cost * min(size / task.size, MAX_FIRST_COST_FACTOR))
        before, earlier = known[-2]
        # Cost grows as a power of the refinement; the last two rungs give the exponent
        power = min(max(math.log(cost / earlier) / math.log(before / size), 0.0), MAX_COST_EXPONENT)
        return float(cost * (size / task.size) ** power)

    def _cost(self, key: str) -> float | None:
        done = self.done.get(key)
        if done is None or done.run is None:
            # A run that was left out counts with its expected cost, so that finer rungs are left out as well
            return None if done is None else done.expected
        return done.run.wall_time if math.isfinite(done.run.wall_time) else done.seconds

    def _report(self, tasks: Sequence[RunTask]) -> None:
        if self.progress is None:
            return
        costs = [self._cost(task.key) for task in tasks]
        known = [cost for cost in costs if cost is not None]
        usual = sum(known) / len(known) if known else 1.0
        # The share is of the expected time, not of the number of runs: the finest rungs take most of it
        total = finished = 0.0
        with self._lock:
            # A copy: other threads add and remove runs meanwhile
            running = dict(self._running)
        for task in tasks:
            ended = self.done.get(task.key)
            if ended is not None:
                weight, share = ended.seconds or 0.0, 1.0
            else:
                weight, share = self.expected(task) or usual, running.get(task.key, 0.0)
                # A run that will be left out takes no time
                weight = 0.0 if self.budget is not None and weight > self.budget and task.key not in running else weight
            total, finished = total + weight, finished + share * weight
        running_tasks = ", ".join(task.what for task in tasks if task.key in running)
        ended_runs = sum(task.key in self.done for task in tasks)
        self.progress(f"{ended_runs} of {len(tasks)} runs; {running_tasks}", finished / total if total else 1.0)
