"""Samples of many runs at times of their own, from the series of the steps that a batch takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.batch.block import Block
from looping_pendulum.reference_ode.batch.compiled import STATE, CompiledFunction
from looping_pendulum.reference_ode.batch.roots import horner
from looping_pendulum.reference_ode.batch.steps import Stepper
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_library import compiled, load_heyoka
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.state import State
from looping_pendulum.reference_ode.transitions import Mode

NEWTON_STEPS = 6
"""Newton steps from the chord to the fraction of a step at which a sample lies."""
_RETREAT_SPEED, _HEAVY_SPEED = STATE.index("retreat_speed"), STATE.index("heavy_speed")
AHEAD = 12
"""Number of a run's next samples of which is asked at a time whether they are due."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchSamples:
    """States of runs at their own times, one run after another."""

    t: Array
    """Times since release [s], shape (m,)."""
    start: NDArray[np.int64]
    """Where each run's samples begin, and m, shape (n + 1,)."""
    state: Array
    """Entries of `STATE`, shape (len(STATE), m); past a run's end those of its end; nan for a run that failed."""
    count: NDArray[np.int64]
    """How many of each run's times lie within it, shape (n,)."""

    @classmethod
    def at(cls, times: Sequence[Array]) -> BatchSamples:
        """Return samples at the ascending times of each run [s] that are still to be taken."""
        start = np.cumsum([0, *map(len, times)])
        t = np.concatenate([np.zeros(0), *times])
        return cls(t=t, start=start, state=np.full((len(STATE), len(t)), np.nan), count=np.zeros(len(times), dtype=np.int64))

    def part(self, run: int) -> slice:
        """Return where the samples of a run are."""
        return slice(int(self.start[run]), int(self.start[run + 1]))

    def put(self, run: int, samples: Samples) -> None:
        """Fill in samples of a run that was solved by itself."""
        here, ended = self.part(run), samples.and_end()
        index = np.minimum(np.arange(here.stop - here.start), len(samples.t))
        for row, name in zip(self.state, STATE, strict=True):
            row[here] = np.broadcast_to(getattr(ended.state, name), len(ended.t))[index]
        self.count[run] = len(samples.t)

    def begin(self, block: Block, released: State, until: float) -> None:
        """Fill in the first samples, up to ``until`` [s], with the state at release, and set the runs' next ones."""
        block["sample"] = self.start[block.runs].astype(float)
        columns, index = self._due(block, np.full(len(block), until))
        for row, values in zip(self.state, released, strict=False):
            row[index] = np.broadcast_to(values, len(block))[columns]

    def advance(self, block: Block, step: Stepper, series: Array, until: Array) -> None:
        """Fill in samples up to the times ``until`` [s], shape (n,), by the series of a step.

        The block's runs are still at its beginning.
        """
        columns, index = self._due(block, until)
        if not len(index):
            return
        taken = np.concatenate([series.reshape(-1, series.shape[2]).take(columns, axis=1), self.t[index][None]])
        state = block.inputs[: len(STATE)].take(columns, axis=1)
        state[step.rows[:-1]] = _sampler(len(step.rows), step.order)(taken)
        if step.mode is Mode.SLIDING_DOWN:  # and SLIDING_UP, as in `schedule`
            state[_HEAVY_SPEED] = state[_RETREAT_SPEED]
        self.state[:, index] = state

    def end(self, block: Block, runs: NDArray[np.int64]) -> None:
        """Fill in the samples past the ends of runs with their states there."""
        done = block["sample"].astype(np.int64)
        self.count[runs] = done - self.start[runs]
        columns, index = _each(done, self.start[runs + 1] - done)
        self.state[:, index] = block.inputs[: len(STATE)].take(columns, axis=1)

    def _due(self, block: Block, until: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return columns of the block and indices of their samples up to some times, which are then no longer the next ones."""
        first = block["sample"].astype(np.int64)
        last, end = first.copy(), self.start[block.runs + 1]
        ahead = np.arange(AHEAD)
        while True:
            index = last[:, None] + ahead
            due = (self.t[np.minimum(index, len(self.t) - 1)] <= until[:, None]) & (index < end[:, None])
            more = due.sum(axis=1)
            last += more
            if not (more == AHEAD).any():
                break
        block["sample"] = last.astype(float)
        return _each(first, last - first)


def _each(first: NDArray[np.int64], count: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return columns and indices of so many samples of each column, from its first one on."""
    columns = np.repeat(np.arange(len(first)), count)
    return columns, np.arange(len(columns)) + np.repeat(first - np.cumsum(count) + count, count)


@lru_cache(maxsize=64)
def _sampler(row_count: int, order: int) -> CompiledFunction:
    """Compile the variables of a step at a time within it; inputs: the terms of each one and of the time, and that time."""
    return compiled(("sampler", row_count, order), (), lambda: _make_sampler(row_count, order))


def _make_sampler(row_count: int, order: int) -> CompiledFunction:
    hy = load_heyoka()

    terms = [[hy.expression(f"c{i}_{k}") for k in range(order + 1)] for i in range(row_count)]
    target = hy.expression("target")
    *motion, time = terms
    x = (target - time[0]) / hy.sum(time[1:])
    for _ in range(NEWTON_STEPS):
        value, slope = time[-1] * x + time[-2], time[-1]
        for coefficient in time[-3::-1]:
            value, slope = value * x + coefficient, slope * x + value
        x = x - (value - target) / slope
    return CompiledFunction([horner(each, x) for each in motion], [*(term for each in terms for term in each), target])
