"""How one process or several share the runs of a batch."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.errors import HarnessError
from looping_pendulum.processes import end_with_parent
from looping_pendulum.reference_ode.batch.numbers import Columns, free_parameters_of, member, possible
from looping_pendulum.reference_ode.batch.result import BYTES_PER_RUN, FAILED, BatchResult, summary
from looping_pendulum.reference_ode.batch.schedule import Index, Schedule
from looping_pendulum.reference_ode.batch.steps import covered
from looping_pendulum.reference_ode.effects import COEFFICIENTS
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import available_integrators, solve_quietly

_SPAWN = multiprocessing.get_context("spawn")
"""Not forked: a copy of a process whose libraries have threads may hang."""
Progress = Callable[[int, int], None]
"""Called with the number of runs that are done, and of all."""


class _Count:
    """A number that only this process has; otherwise as `multiprocessing.Value`."""

    value = 0

    def get_lock(self) -> AbstractContextManager[None]:
        """Nothing to wait for."""
        return nullcontext()


@dataclass(frozen=True, kw_only=True)
class SharedBatch:
    """A batch, as the processes that work on it share it."""

    base: Parameters
    names: tuple[str, ...]
    """Of the columns."""
    n: int
    """How many runs."""
    duration: float
    tolerance: float
    processes: int
    values: Any
    """Buffer of the columns' numbers, one column after another."""
    results: Any
    """Buffer of the results (`BatchResult.over`)."""
    taken: Any
    """How many runs have been taken by some process."""
    ended: Any
    """How many runs have ended."""

    @classmethod
    def of(cls, base: Parameters, columns: Columns, n: int, duration: float, tolerance: float, processes: int) -> SharedBatch:
        """A batch of which nothing has been done yet."""
        numbers, size = n * len(columns), n * BYTES_PER_RUN
        alone = processes == 1
        job = cls(
            base=base,
            names=tuple(columns),
            n=n,
            duration=duration,
            tolerance=tolerance,
            processes=processes,
            values=np.empty(numbers) if alone else _SPAWN.RawArray("d", numbers),
            results=bytearray(size) if alone else _SPAWN.RawArray("b", size),
            taken=_Count() if alone else _SPAWN.Value("q", 0),
            ended=_Count() if alone else _SPAWN.Value("q", 0),
        )
        for name, values in job.columns().items():
            values[:] = columns[name]
        job.result().clear()
        return job

    def columns(self) -> dict[str, Array]:
        """The columns, by name."""
        values = np.frombuffer(self.values) if self.n else np.empty(0)
        return dict(zip(self.names, values.reshape(len(self.names), self.n), strict=True))

    def result(self) -> BatchResult:
        """The results, which other processes fill in, too."""
        return BatchResult.over(self.results, self.n)


class BatchRuns:
    """The runs of a batch: who takes which, and their numbers."""

    def __init__(self, job: SharedBatch, progress: Progress | None = None) -> None:
        self.job, self.all, self._progress = job, job.n, progress
        self.columns = job.columns()
        self._mine: list[Index] = []

    def take(self, most: int) -> Index:
        """The next runs; of the last ones only a share, so that all processes end together."""
        taken = self.job.taken
        with taken.get_lock():
            start = taken.value
            taken.value = end = start + min(most, -(-(self.all - start) // self.job.processes))
        runs = np.arange(start, end)
        self._mine.append(runs)
        return runs

    def mine(self) -> Index:
        """What this process has taken."""
        return np.concatenate([*self._mine, np.arange(0)])

    def numbers(self, runs: Index) -> dict[str, Any]:
        """Every number that the equations need, by name: one value, or one per run."""
        return free_parameters_of(self.job.base, {name: values[runs] for name, values in self.columns.items()})

    def take_possible(self, most: int) -> tuple[Index, dict[str, Any]]:
        """The next runs whose values `Parameters` does not refuse, and their numbers."""
        while len(runs := self.take(most)):
            numbers = self.numbers(runs)
            can = possible(numbers, len(runs))
            if can.any():
                return runs[can], {name: v[can] if np.ndim(v) else v for name, v in numbers.items()}
        return runs, {}

    def singly(self) -> Iterator[int]:
        """The next runs, one by one."""
        while len(run := self.take(1)):
            yield int(run[0])

    def done(self, runs: int) -> None:
        """Count runs that have ended."""
        with self.job.ended.get_lock():
            self.job.ended.value = ended = self.job.ended.value + runs
        if self._progress is not None:
            self._progress(ended, self.all)


def work(runs: BatchRuns) -> None:
    """Take runs until none are left, and fill in their results."""
    job, result = runs.job, runs.job.result()
    effects = job.base.effects_with([name for name in job.names if name in COEFFICIENTS])
    if "heyoka" in available_integrators() and covered(effects):
        Schedule(runs, result, effects, job.base.release, job.duration, job.tolerance).run()
        mine = runs.mine()
        left = iter(mine[result.end[mine] == FAILED].tolist())  # a single run says what is wrong with these
    else:
        left = runs.singly()
    for i in left:
        try:
            run = solve_quietly(member(job.base, runs.columns, i), duration=job.duration, tolerance=job.tolerance)
        except (HarnessError, ArithmeticError):
            pass
        else:
            for name, value in summary(run).items():
                getattr(result, name)[i] = value
        runs.done(1)


def work_together(job: SharedBatch, progress: Progress | None) -> None:
    """Do as `work`, with helping processes. The runs of one that dies are run again here."""
    with ProcessPoolExecutor(job.processes - 1, mp_context=_SPAWN, initializer=_take_part, initargs=(job,)) as pool:
        others = [pool.submit(_help) for _ in range(job.processes - 1)]
        try:
            work(BatchRuns(job, progress))
            for other in others:
                other.result()
        except BrokenProcessPool:
            _work_again(job)
        finally:
            job.taken.value = job.n  # so that after an interrupt the others take no more
    if progress is not None:
        progress(job.n, job.n)


def _work_again(job: SharedBatch) -> None:
    """Run what has no result, in this process."""
    result = job.result()
    left = np.flatnonzero(result.end == FAILED)
    columns = {name: values[left] for name, values in job.columns().items()}
    rest = SharedBatch.of(job.base, columns, len(left), job.duration, job.tolerance, processes=1)
    work(BatchRuns(rest))
    result.put(left, rest.result())


_job: SharedBatch
"""Of a helping process."""


def _take_part(job: SharedBatch) -> None:
    global _job
    end_with_parent()
    _job = job


def _help() -> None:
    work(BatchRuns(_job))
