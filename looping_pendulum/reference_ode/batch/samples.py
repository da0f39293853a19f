"""Samples of many runs at times of their own, from the series of the steps that a batch takes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.batch.compiled import CompiledFunction, absolute_value
from looping_pendulum.reference_ode.batch.roots import ROOT_TOLERANCE, first_falling_roots, horner
from looping_pendulum.reference_ode.batch.steps import Stepper
from looping_pendulum.reference_ode.batch.system import Block
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_library import compiled, load_heyoka
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.state import State

NEWTON_STEPS = 6
"""Newton steps from the chord to the fraction of a step at which a sample lies; each ends within the step.

As the string winds, time grows ever slower in the step, and beyond the event at which the light mass reaches the rod it falls:
there tangents lead away or to a second root, so that some samples are left to `roots.first_falling_roots`.
"""
TOGETHER = 4
"""Number of samples that are taken at once of one step: so many lie in a step of a film on average."""
LOG_LIMIT = 4 * 10**6
"""Number of coefficients after which the samples of the steps until then are taken, which bounds the memory (32 MB)."""
_RETREAT_SPEED, _HEAVY_SPEED = State._fields.index("retreat_speed"), State._fields.index("heavy_speed")


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchSamples:
    """States of runs at their own times, one run after another."""

    t: Array
    """Times since release [s], shape (m,)."""
    start: NDArray[np.int64]
    """Where each run's samples begin, and m, shape (n + 1,)."""
    state: Array
    """Entries of the state, shape (len(State), m); past a run's end those of its end; nan for a run that failed."""
    count: NDArray[np.int64]
    """How many of each run's times lie within it, shape (n,)."""

    @classmethod
    def at(cls, times: Sequence[Array]) -> BatchSamples:
        """Return samples at the ascending times of each run [s] that are still to be taken."""
        start = np.cumsum([0, *map(len, times)])
        t = np.concatenate([np.zeros(0), *times])
        return cls(
            t=t, start=start, state=np.full((len(State._fields), len(t)), np.nan), count=np.zeros(len(times), dtype=np.int64)
        )

    def part(self, run: int) -> slice:
        """Return where the samples of a run are."""
        return slice(int(self.start[run]), int(self.start[run + 1]))

    def put(self, run: int, samples: Samples) -> None:
        """Fill in samples of a run that was solved by itself."""
        here, ended = self.part(run), samples.and_end()
        index = np.minimum(np.arange(here.stop - here.start), len(samples.t))
        for row, name in zip(self.state, State._fields, strict=True):
            row[here] = np.broadcast_to(getattr(ended.state, name), len(ended.t))[index]
        self.count[run] = len(samples.t)


class _Entry(NamedTuple):
    """A step of some runs."""

    step: Stepper
    series: Array
    """`Stepper.sampled` of the outputs of `Stepper.series`, shape (outputs, n)."""
    runs: NDArray[np.int64]
    until: Array
    """Time up to which the runs were advanced [s]; -inf: not at all."""


class SampleLog:
    """Keeps the steps of runs, and takes the samples of many steps at once."""

    def __init__(self, samples: BatchSamples) -> None:
        self._samples = samples
        self._next = samples.start[:-1].copy()
        """Each run's next sample."""
        self._at_end = np.full((len(State._fields), len(self._next)), np.nan)
        self._entries: list[_Entry] = []
        self._size = 0

    def begin(self, runs: NDArray[np.int64], released: State, until: float) -> None:
        """Fill in the first samples of runs, up to ``until`` [s], with their states at release."""
        earlier = np.concatenate([[0], np.cumsum(self._samples.t <= until)])
        first, end = self._next[runs], self._samples.start[runs + 1]
        count = earlier[end] - earlier[first]
        column, index = _each(first, count)
        for row, values in zip(self._samples.state, released, strict=False):
            row[index] = np.broadcast_to(values, len(runs))[column]
        self._next[runs] += count

    def add(self, step: Stepper, series: Array, runs: NDArray[np.int64], until: Array) -> None:
        """Add a step of some runs; arguments as in `_Entry`."""
        self._entries.append(_Entry(step, series, runs, until))
        self._size += series.size
        if self._size > LOG_LIMIT:
            self._take()

    def end(self, block: Block, runs: NDArray[np.int64]) -> None:
        """Keep the states of runs at their ends."""
        self._at_end[:, runs] = block.inputs[: len(State._fields)]

    def finish(self) -> None:
        """Take all samples that are left; those past a run's end are its end."""
        self._take()
        samples = self._samples
        column, index = _each(self._next, samples.start[1:] - self._next)
        samples.state[:, index] = self._at_end[:, column]
        samples.count[:] = self._next - samples.start[:-1]
        for run in np.flatnonzero(np.isnan(self._at_end).any(axis=0)).tolist():
            samples.state[:, samples.part(run)], samples.count[run] = np.nan, 0

    def _take(self) -> None:
        """Take the samples of the steps of the log, and empty it."""
        entries, self._entries, self._size = self._entries, [], 0
        if not entries:
            return
        runs, until = (np.concatenate([getattr(entry, name) for entry in entries]) for name in ("runs", "until"))
        first, count = self._due(runs, until)
        edges = np.cumsum([0, *(len(entry.runs) for entry in entries)]).tolist()
        by_step: dict[int, list[int]] = {}
        for i, entry in enumerate(entries):
            by_step.setdefault(id(entry.step), []).append(i)
        for chosen in by_step.values():
            columns = np.concatenate([np.arange(edges[i], edges[i + 1]) for i in chosen])
            self._take_of_step([entries[i] for i in chosen], first[columns], count[columns])

    def _due(self, runs: NDArray[np.int64], until: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the first sample and the number of samples of each step of the log, and set the runs' next ones."""
        samples, count = self._samples, np.zeros(len(runs), dtype=np.int64)
        moved = np.flatnonzero(until > -np.inf)
        moved = moved[np.argsort(runs[moved], kind="stable")]  # the steps of one run after another, each in the order of time
        of_runs = runs[moved]
        edges = np.flatnonzero(np.diff(of_runs, prepend=-1, append=-1)).tolist()
        last = np.empty(len(moved), dtype=np.int64)
        first = np.zeros(len(runs), dtype=np.int64)
        for a, b in pairwise(edges):
            part = samples.part(of_runs[a])
            last[a:b] = part.start + samples.t[part].searchsorted(until[moved[a:b]], side="right")
        before = np.empty_like(last)
        before[1:] = last[:-1]
        before[edges[:-1]] = self._next[of_runs[edges[:-1]]]
        self._next[of_runs[edges[:-1]]] = last[np.array(edges[1:], dtype=np.int64) - 1]
        first[moved], count[moved] = before, last - before
        return first, count

    def _take_of_step(self, entries: list[_Entry], first: NDArray[np.int64], count: NDArray[np.int64]) -> None:
        """Take the samples of some uses of one compiled step, shape (n,) over all its runs."""
        step, samples = entries[0].step, self._samples
        groups = -(-count // TOGETHER)  # rounded up
        column, group = _each(np.zeros_like(groups), groups)
        if not len(column):
            return
        index = first[column] + TOGETHER * group + np.arange(TOGETHER)[:, None]
        index = np.minimum(index, (first + count - 1)[column])  # the last group repeats its last sample
        terms = len(step.rows) * (step.order + 1)
        table = np.empty((terms + len(step.resting), len(column)))
        a, begin = 0, 0
        for entry in entries:
            end = begin + len(entry.runs)
            b = int(column.searchsorted(end))
            if b > a:
                # "clip": no column is out of bounds, and NumPy then writes to the table without a copy
                entry.series.take(column[a:b] - begin, axis=1, out=table[:, a:b], mode="clip")
            a, begin = b, end
        sampled = _sampler(len(step.rows), step.order)(np.concatenate([table[:terms], samples.t[index]]))
        *motion, last_step = sampled.reshape(len(step.rows), TOGETHER, len(column))
        unsure = ~(last_step < ROOT_TOLERANCE)
        if unsure.any():
            which, at = np.nonzero(unsure)
            series = table[:terms, at].reshape(len(step.rows), step.order + 1, -1)
            remaining = -series[-1]
            remaining[0] += samples.t[index[which, at]]
            fraction = np.minimum(first_falling_roots(remaining), 1.0)  # without a root it lies at the end, but for rounding
            for values, coefficients in zip(motion, series, strict=False):
                values[which, at] = horner(coefficients, fraction)
        for row, values in zip(step.rows[:-1], motion, strict=True):
            samples.state[row][index] = values
        for row, values in zip(step.resting, table[terms:], strict=True):
            samples.state[row][index] = values
        if step.heavy_mass_follows:
            samples.state[_HEAVY_SPEED][index] = samples.state[_RETREAT_SPEED][index]


def _each(first: NDArray[np.int64], count: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return columns and indices of so many samples of each column, from its first one on."""
    columns = np.repeat(np.arange(len(first)), count)
    return columns, np.arange(len(columns)) + np.repeat(first - np.cumsum(count) + count, count)


@lru_cache(maxsize=64)
def _sampler(row_count: int, order: int) -> CompiledFunction:
    """Compile the variables of a step at times within it, and the lengths of the last Newton steps; inf where time falls.

    Inputs: the terms of each variable and of the time, and the times.
    """

    def make() -> CompiledFunction:
        hy = load_heyoka()
        terms = [[hy.expression(f"c{i}_{k}") for k in range(order + 1)] for i in range(row_count)]
        *motion, time = terms
        targets = [hy.expression(f"target_{i}") for i in range(TOGETHER)]
        fractions, last_steps = [], []
        for target in targets:
            x = (target - time[0]) / hy.sum(time[1:])
            for _ in range(NEWTON_STEPS):
                value, slope = time[-1] * x + time[-2], time[-1]
                for coefficient in time[-3::-1]:
                    value, slope = value * x + coefficient, slope * x + value
                step = (target - value) / slope
                last_step = hy.select(hy.gt(slope, 0.0), absolute_value(step), math.inf)
                x = hy.select(hy.lt(x + step, 0.0), 0.0, hy.select(hy.gt(x + step, 1.0), 1.0, x + step))
            fractions.append(x)
            last_steps.append(last_step)
        outputs = [horner(each, x) for each in motion for x in fractions]
        return CompiledFunction([*outputs, *last_steps], [*(term for each in terms for term in each), *targets])

    return compiled(("sampler", row_count, order, TOGETHER, NEWTON_STEPS), (), make)
