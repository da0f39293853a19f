"""Advance many runs together: one compiled function takes a step, or finds an event, for many runs at once.

Each run is in the queue of one task: to take steps in its mode, or to find the event that may lie in its next step. The task
with the longest queue is done next, for all runs in it, so that each call works on many runs.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise

import numpy as np

from looping_pendulum.reference_ode.batch import system
from looping_pendulum.reference_ode.batch.compiled import LEADING, batch_model, drop
from looping_pendulum.reference_ode.batch.runs import AT_END, ENDS, HASH_START, BatchResult, BatchRuns, Index, update_hash
from looping_pendulum.reference_ode.batch.samples import BatchSamples, SampleLog
from looping_pendulum.reference_ode.batch.steps import NO_EVENT, stepper
from looping_pendulum.reference_ode.batch.system import BOOKKEEPING, Block
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.rules import REST_SERIES_DURATION
from looping_pendulum.reference_ode.solve import MAX_EVENTS
from looping_pendulum.reference_ode.state import Effects, State
from looping_pendulum.reference_ode.transitions import END_EVENTS, PHASE_EVENTS, PHASE_ZERO, Event, Mode

MAX_CONCURRENT_RUNS = 8192
"""Largest number of runs that are integrated at a time, which bounds the memory."""
MIN_PENDING_EVENTS = 8
"""Number of runs, or a tenth of them if that is more, whose next step may hold an event before the stepping of a block ends."""
MAX_STEPS = 20_000
"""Number of steps of a run after which it counts as failed."""
_SHARED_STEP_MODES = {Mode.SLIDING_UP: Mode.SLIDING_DOWN}
"""Mode -> mode whose compiled step it shares: the direction of sliding is an input, the sign `slide`."""
_Task = tuple[bool, Mode]
"""Key of a queue: what its runs do next, and the mode whose compiled step is used for it (`_SHARED_STEP_MODES`).

True: advance to the event that may lie in the next step; False: take steps until one may hold an event.
"""
_BROKEN_DOWN = -2
"""Value in place of a combination of mode, event and phase: the run breaks down."""


class Schedule:
    """Integrates the runs of a source, and fills in their results."""

    def __init__(self, source: BatchRuns, effects: Effects, samples: BatchSamples | None = None) -> None:
        """Prepare; the batch's result, and ``samples`` if any are wanted, are filled in for the runs that are taken here."""
        batch = source.batch
        self._source, self._result = source, source.result
        self._log = None if samples is None else SampleLog(samples)
        self._model = batch_model(effects, source.parameter_values(np.arange(0)))
        self._durations, self._tolerance = batch.durations, batch.tolerance
        self._kind = batch.base.release
        self._queues: dict[_Task, list[Block]] = defaultdict(list)
        self._running_count = 0

    def run(self) -> None:
        """Run all runs to their ends. A run that breaks down stays marked as failed."""
        more = True
        with np.errstate(all="ignore"):  # a run that breaks down must not disturb the others
            while more or self._queues:
                # Releasing new runs competes with the queues: its length is the number of places that are free
                task, longest = None, MAX_CONCURRENT_RUNS - self._running_count if more else 0
                for candidate, blocks in self._queues.items():
                    length = sum(map(len, blocks))
                    if length > longest:
                        task, longest = candidate, length
                if task is None:
                    more = self._release(longest)
                else:
                    blocks, (to_event, mode) = self._queues.pop(task), task
                    if to_event:
                        self._advance_to_event(mode, Block.joined(blocks))
                    else:
                        self._step(mode, blocks)
            if self._log is not None:
                self._log.finish()

    def _enqueue(self, task: _Task, block: Block) -> None:
        """Put runs into the queue of a task."""
        if len(block):
            self._queues[task].append(block)

    def _enqueue_by_mode(self, block: Block) -> None:
        """Put runs into the queues of their modes; those that have ended leave."""
        for mode in block.present_modes():
            columns = np.flatnonzero(block["mode"] == mode)
            if mode is Mode.ENDED:
                self._running_count -= len(columns)
            else:
                self._enqueue((False, _SHARED_STEP_MODES.get(mode, mode)), block.take(columns))

    def _release(self, most: int) -> bool:
        """Release the next runs; return whether there were any."""
        runs, values = self._source.take_valid(most)
        if not len(runs):
            return False
        self._running_count += len(runs)
        block = Block(np.zeros((len(BOOKKEEPING) + len(LEADING) + len(self._model.names), len(runs))))
        for row, name in enumerate(self._model.names, start=len(LEADING)):
            block.inputs[row] = values[name]
        block["run"], block["duration"] = runs.astype(float), self._durations[runs]
        block["free_length"], block["wrap_angle"] = values["free_length"], values["release_angle"]
        if self._kind is not Release.DROP:
            block["heavy_tilt"], block["sideways_speed"] = values["heavy_swing"], values["push_sideways"]
        along, across = (np.broadcast_to(values[name], len(runs)) for name in ("push_along", "push_across"))
        released = State(*block.inputs[: len(State._fields)].copy())._replace(retreat_speed=along, across_speed=across)
        system.release(self._model, self._kind, block, along, across)
        if self._log is not None:
            # Within the first step from rest, a microsecond, nothing moves by a picometre
            self._log.begin(runs, released, REST_SERIES_DURATION)
        result = self._result
        result.stops[runs] = result.slip_count[runs] = result.slack_intervals[runs] = 0
        result.sequence[runs] = HASH_START
        self._record_modes(block, runs)
        self._enqueue_by_mode(block)
        return True

    def _step(self, mode: Mode, blocks: list[Block]) -> None:
        """Take steps until the next step of enough runs may hold an event (`MIN_PENDING_EVENTS`)."""
        step = stepper(self._model, mode, self._tolerance)
        n = sum(map(len, blocks))
        block, max_waiting = Block.joined(blocks, pad_to_vectors=True), max(MIN_PENDING_EVENTS, n // 10)
        inputs, runs = block.inputs, block.runs[:n]
        while True:
            if self._log is None:
                out = step.step.evaluate_padded(inputs)
                moved = out[:-1]
            else:
                out = step.series.evaluate_padded(inputs)
                moved = step.end(out)
            # No event can lie in a step in which the lower bound of all event functions is positive
            clear = (out[-1] > 0) & (block["steps"] < MAX_STEPS)
            if self._log is not None:
                self._log.add(step, out[step.sampled], runs, np.where(clear, moved[-1], -np.inf)[:n])
            moving_count = np.count_nonzero(clear)
            if moving_count == len(clear):
                inputs[step.rows] = moved
            else:
                for row, new in zip(step.rows, moved, strict=True):
                    np.copyto(inputs[row], new, where=clear)
            block["steps"] += clear
            if not moving_count or len(clear) - moving_count > max_waiting:
                break
        # [:n]: without the columns that only fill the last vector
        self._enqueue((False, mode), block.take(np.flatnonzero(clear[:n])))
        self._enqueue((True, mode), block.take(np.flatnonzero(~clear[:n])))

    def _advance_to_event(self, mode: Mode, block: Block) -> None:
        """Advance to the first event within the next step and apply it, or to the end of the step if there is none."""
        step = stepper(self._model, mode, self._tolerance)
        series = step.series(block.inputs)
        moved, event = step.first_event(series)
        if self._log is not None:
            until = np.where(np.isfinite(moved).all(axis=0), moved[-1], -np.inf)
            self._log.add(step, series[step.sampled], block.runs, until)
        block.inputs[step.rows] = moved
        if step.heavy_mass_follows:
            block["heavy_speed"] = block["retreat_speed"]
        block["events"] += event >= 0
        broken_down = (block["steps"] >= MAX_STEPS) | (block["events"] > MAX_EVENTS) | ~np.isfinite(moved).all(axis=0)
        # One number for mode, event and phase: runs are sorted by it, and their event is applied to all that share it
        kinds = (block["mode"].astype(np.int64) * len(step.events) + event) * 2 + (block["phase"] > 0)
        kinds[event == NO_EVENT] = NO_EVENT
        kinds[broken_down] = _BROKEN_DOWN
        order = np.argsort(kinds, kind="stable")
        block, kinds = block.take(order), kinds[order]
        # NaN differs from every number, so that the first group begins at 0
        for start, end in pairwise([*np.flatnonzero(np.diff(kinds, prepend=np.nan)).tolist(), len(kinds)]):
            kind, part = int(kinds[start]), block.view(start, end)
            if kind == _BROKEN_DOWN:
                self._fail(part)
            elif kind >= 0:
                before, event_index, phase = Mode(kind // (2 * len(step.events))), kind // 2 % len(step.events), kind % 2
                in_phase_one = step.events[event_index]
                self._apply(part, before, in_phase_one if phase else PHASE_ZERO.get(in_phase_one, in_phase_one))
        self._enqueue_by_mode(block)

    def _apply(self, block: Block, mode: Mode, event: Event) -> None:
        """Apply ``event``, at which all runs of the block, in ``mode``, have arrived, and record it in their results."""
        runs = block.runs
        system.apply_event(self._model, block, mode, event)
        if event in END_EVENTS:
            self._record_end(block, runs, mode, event)
        elif event not in PHASE_EVENTS:
            if event is Event.STOP:
                self._result.stops[runs] += 1
            elif event in (Event.SLIP_ONSET_DOWN, Event.SLIP_ONSET_UP):
                self._result.slip_count[runs] += 1
            self._record_modes(block, runs)

    def _record_modes(self, block: Block, runs: Index) -> None:
        """Record a change of mode. Time and place are those of the halt if no other change follows."""
        result = self._result
        result.slack_intervals[runs] += (block["mode"] == Mode.SLACK) | (block["mode"] == Mode.CLAMPED_SLACK)
        result.sequence[runs] = update_hash(result.sequence[runs], block["mode"].astype(np.uint64))
        result.halting_time[runs] = block["time"]
        result.halting_wrap_angle[runs] = block["wrap_angle"]
        result.halting_free_length[runs] = block["free_length"]

    def _record_end(self, block: Block, runs: Index, mode: Mode, event: Event) -> None:
        """Record how the runs ended; halts only where the light mass reached the rod while the string was sticking."""
        result = self._result
        result.end_time[runs] = block["duration"] if event is Event.TIME_UP else block["time"]
        for name, entry in AT_END:
            getattr(result, name)[runs] = block[entry]
        (result.drop[runs],) = drop(self._model)(block.inputs)
        if self._log is not None:
            self._log.end(block, runs)
        result.end[runs] = ENDS.index(event)
        result.sequence[runs] = update_hash(result.sequence[runs], np.uint64(Mode.ENDED))
        if event is not Event.LIGHT_REACHES_ROD or mode is not Mode.STICKING:
            for values in (result.halting_time, result.halting_wrap_angle, result.halting_free_length):
                values[runs] = np.nan
        self._source.report_ended(len(runs))

    def _fail(self, block: Block) -> None:
        """Mark the runs as failed."""
        runs = block.runs
        self._result.put(runs, BatchResult.empty(len(runs)))
        block["mode"] = Mode.ENDED
