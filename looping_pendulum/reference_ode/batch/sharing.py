"""Share the runs of a batch between one process or several."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.errors import HarnessError
from looping_pendulum.jobs.processes import process_pool
from looping_pendulum.reference_ode.batch.numbers import Columns, equation_parameters, parameters_of_run, valid_runs
from looping_pendulum.reference_ode.batch.result import BYTES_PER_RUN, FAILED, BatchResult, summary
from looping_pendulum.reference_ode.batch.samples import BatchSamples
from looping_pendulum.reference_ode.batch.schedule import Index, Schedule
from looping_pendulum.reference_ode.batch.steps import supports_batch
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import available_integrators, solve_without_warning

_SPAWN = multiprocessing.get_context("spawn")
"""Source of shared memory for a `process_pool`, whose processes are spawned."""
Progress = Callable[[int, int], None]
"""Called with the number of runs that have ended and the number of all runs."""


class _LocalCounter:
    """A counter with the interface of `multiprocessing.Value`, for a batch that only this process works on."""

    value = 0

    def get_lock(self) -> AbstractContextManager[None]:
        """Return a lock that never waits."""
        return nullcontext()


@dataclass(frozen=True, kw_only=True)
class SharedBatch:
    """A batch in memory that all its processes share."""

    base: Parameters
    names: tuple[str, ...]
    """Names of the columns."""
    n: int
    """Number of runs."""
    durations: Array
    """Limit on the simulated time of each run [s], shape (n,)."""
    tolerance: float
    acting: frozenset[str]
    """Coefficients whose effects are compiled in even at their null values."""
    processes: int
    column_buffer: Any
    """Values of the columns, one column after another."""
    result_buffer: Any
    """Memory of the results (`BatchResult.over`)."""
    taken_count: Any
    """Number of runs that some process has taken; runs are taken in the order of their indices."""
    ended_count: Any
    """Number of runs that have ended."""

    @classmethod
    def of(
        cls,
        base: Parameters,
        columns: Columns,
        n: int,
        duration: float | Array,
        tolerance: float,
        processes: int,
        acting: frozenset[str] = frozenset(),
    ) -> SharedBatch:
        """Return a batch of which no run has been taken yet."""
        value_count, result_bytes = n * len(columns), n * BYTES_PER_RUN
        alone = processes == 1
        job = cls(
            base=base,
            names=tuple(columns),
            n=n,
            durations=np.broadcast_to(np.asarray(duration, dtype=float), n),
            tolerance=tolerance,
            acting=acting,
            processes=processes,
            column_buffer=np.empty(value_count) if alone else _SPAWN.RawArray("d", value_count),
            result_buffer=bytearray(result_bytes) if alone else _SPAWN.RawArray("b", result_bytes),
            taken_count=_LocalCounter() if alone else _SPAWN.Value("q", 0),
            ended_count=_LocalCounter() if alone else _SPAWN.Value("q", 0),
        )
        for name, values in job.columns().items():
            values[:] = columns[name]
        job.result().clear()
        return job

    def columns(self) -> dict[str, Array]:
        """Return the columns by name, as views of the shared memory."""
        values = np.frombuffer(self.column_buffer) if self.n else np.empty(0)
        return dict(zip(self.names, values.reshape(len(self.names), self.n), strict=True))

    def result(self) -> BatchResult:
        """Return the results, a view of the shared memory, which other processes fill in, too."""
        return BatchResult.over(self.result_buffer, self.n)


class BatchRuns:
    """The runs of a batch as one process takes them, with their parameters (a `schedule.RunSource`)."""

    def __init__(self, job: SharedBatch, progress: Progress | None = None) -> None:
        self.job, self.run_count, self._progress = job, job.n, progress
        self.columns = job.columns()
        self._taken_here: list[Index] = []

    def take(self, most: int) -> Index:
        """Take the next runs, at most ``most``, and of the last ones only a share, so that all processes end together."""
        taken = self.job.taken_count
        with taken.get_lock():
            start = taken.value
            taken.value = end = start + min(most, -(-(self.run_count - start) // self.job.processes))  # rounded up
        runs = np.arange(start, end)
        self._taken_here.append(runs)
        return runs

    def taken_here(self) -> Index:
        """Return the indices of all runs that this process has taken."""
        return np.concatenate([*self._taken_here, np.arange(0)])

    def parameter_values(self, runs: Index) -> dict[str, Any]:
        """Return every parameter of ``runs`` that the equations read, by name: one value, or one per run."""
        return equation_parameters(self.job.base, {name: values[runs] for name, values in self.columns.items()})

    def take_valid(self, most: int) -> tuple[Index, dict[str, Any]]:
        """Take the next runs; return those whose values `Parameters` accepts, and their parameters. The others stay failed."""
        while len(runs := self.take(most)):
            values = self.parameter_values(runs)
            valid = valid_runs(self.job.base, values, len(runs))
            if valid.any():
                return runs[valid], {name: v[valid] if np.ndim(v) else v for name, v in values.items()}
        return runs, {}

    def take_single(self) -> Iterator[int]:
        """Take the next runs one by one."""
        while len(run := self.take(1)):
            yield int(run[0])

    def report_ended(self, runs: int) -> None:
        """Count ``runs`` more runs that have ended, and report the progress."""
        # Read, then written: without the lock two processes might count as one
        with self.job.ended_count.get_lock():
            self.job.ended_count.value = ended = self.job.ended_count.value + runs
        if self._progress is not None:
            self._progress(ended, self.run_count)


def work(runs: BatchRuns, samples: BatchSamples | None = None) -> None:
    """Take runs until none are left, and fill in their results, and their samples if any are wanted."""
    job, result = runs.job, runs.job.result()
    effects = job.base.effects_with(job.acting.union(name for name in job.names if name in job.base.coefficients))
    if "heyoka" in available_integrators() and supports_batch(effects):
        Schedule(runs, result, effects, job.base.release, job.durations, job.tolerance, samples).run()
        taken = runs.taken_here()
        # A run that failed here is solved once more by itself, where SciPy may take over from heyoka
        remaining = iter(taken[result.end[taken] == FAILED].tolist())
    else:
        remaining = runs.take_single()
    for i in remaining:
        try:
            run = solve_without_warning(
                parameters_of_run(job.base, runs.columns, i), duration=float(job.durations[i]), tolerance=job.tolerance
            )
        except (HarnessError, ArithmeticError):
            pass  # the run stays marked as failed
        else:
            if samples is not None:
                times = samples.t[samples.part(i)]
                samples.put(i, run.sample(times[times <= run.end_time]))
            for name, value in summary(run).items():
                getattr(result, name)[i] = value
        runs.report_ended(1)


def work_together(job: SharedBatch, progress: Progress | None) -> None:
    """Do the same as `work` in several processes. Runs of a process that dies are solved again in this one."""
    # One fewer, as this process works, too
    with process_pool(job.processes - 1, _keep_job, (job,)) as pool:
        others = [pool.submit(_work_in_helper) for _ in range(job.processes - 1)]
        try:
            work(BatchRuns(job, progress))
            for other in others:
                other.result()
        except BrokenProcessPool:
            _rerun_unfinished(job)
    if progress is not None:
        progress(job.n, job.n)


def _rerun_unfinished(job: SharedBatch) -> None:
    """Solve the runs without a result in this process."""
    result = job.result()
    # A run that failed by itself looks like one that was never solved; it fails again
    unfinished = np.flatnonzero(result.end == FAILED)
    columns = {name: values[unfinished] for name, values in job.columns().items()}
    rest = SharedBatch.of(
        job.base, columns, len(unfinished), job.durations[unfinished], job.tolerance, processes=1, acting=job.acting
    )
    work(BatchRuns(rest))
    result.put(unfinished, rest.result())


_job: SharedBatch
"""Batch of this process, if it is a helping one."""


def _keep_job(job: SharedBatch) -> None:
    """Keep the batch, which can be passed only when a process starts: shared memory cannot be sent to it later."""
    global _job
    _job = job


def _work_in_helper() -> None:
    """Take part in the work of the batch of this process."""
    work(BatchRuns(_job))
