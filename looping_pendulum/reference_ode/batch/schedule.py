"""Run many runs side by side: many take a step at once, and many meet their events at once.

Each run waits for one of a few tasks: to take steps in its mode, or to look for the event that may lie in its next step. The
task for which most runs wait is done next, for all of them, so that each is done for many at once.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from enum import Enum
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.batch.block import NOTES, Block
from looping_pendulum.reference_ode.batch.changes import BatchTransitions
from looping_pendulum.reference_ode.batch.compiled import LEADING, drop, model_of
from looping_pendulum.reference_ode.batch.result import ENDS, HASH_START, BatchResult, hash_further
from looping_pendulum.reference_ode.batch.steps import NONE, UNSURE, stepper
from looping_pendulum.reference_ode.driver import MAX_EVENTS
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.state import Effects
from looping_pendulum.reference_ode.transitions import END_EVENTS, PHASE_EVENTS, PHASE_ZERO, Event, Mode

AT_ONCE = 8192
"""Runs under way."""
PAUSE = 8
"""Steps are taken without a pause until an event may lie ahead of this many runs, or of a tenth."""
MAX_STEPS = 20_000
"""Steps of a run after which it counts as failed."""
Index = NDArray[np.int64]
_NAMING = {Mode.SLIDING_UP: Mode.SLIDING_DOWN}
"""Modes that share another one's compiled step."""
_LOST = -2
"""In place of a kind of event: the run breaks down."""


class BatchTaskKind(Enum):
    """What a run may wait for."""

    STEPS = "to take steps until an event may lie ahead"
    EVENT = "to go on to that event, or to the step's end if there is none"
    SEARCH = "the same where the event is hard to find"


URGENCY = {BatchTaskKind.STEPS: 1, BatchTaskKind.EVENT: 1, BatchTaskKind.SEARCH: 16}
"""How much the wait of one run counts. Searches are rare, and a run that needs one may have a long way to go."""


class BatchTask(NamedTuple):
    """What some runs wait for."""

    kind: BatchTaskKind
    mode: Mode
    """Of those that share a compiled step, the one that names it."""


class RunSource(Protocol):
    """Where the runs come from."""

    @property
    def all(self) -> int:
        """How many there are."""

    def take_possible(self, most: int) -> tuple[Index, Mapping[str, Any]]:
        """The next runs, at most so many, and what the equations need of them, by name: one value, or one per run.

        None if none are left.
        """

    def numbers(self, runs: Index) -> Mapping[str, Any]:
        """What the equations need of these runs."""

    def done(self, runs: int) -> None:
        """Hear that so many have ended."""


class Schedule:
    """Runs that are under way, and the results of those that have ended."""

    def __init__(
        self, source: RunSource, result: BatchResult, effects: Effects, release: Release, duration: float, tolerance: float
    ) -> None:
        """``result``: of all runs; those that are taken are filled in."""
        self._source, self._result = source, result
        self._model = model = model_of(effects, source.numbers(np.arange(0)))
        self._duration, self._tolerance = duration, tolerance
        self._changes = BatchTransitions(model, release)
        self._waiting: dict[BatchTask, list[Block]] = defaultdict(list)
        self._under_way = 0

    def run(self) -> None:
        """Run all to their ends. A run that breaks down is left marked as failed."""
        more = True
        with np.errstate(all="ignore"):  # a run that breaks down must not disturb the others
            while more or self._waiting:
                task, most = None, AT_ONCE - self._under_way if more else 0
                for other, blocks in self._waiting.items():
                    count = URGENCY[other.kind] * sum(map(len, blocks))
                    if count > most:
                        task, most = other, count
                if task is None:
                    more = self._release(most)
                elif task.kind is BatchTaskKind.STEPS:
                    self._step(task.mode, self._waiting.pop(task))
                else:
                    self._meet(task, Block.joined(self._waiting.pop(task)))

    def _wait(self, kind: BatchTaskKind, mode: Mode, block: Block) -> None:
        """Let runs wait for a task."""
        if len(block):
            self._waiting[BatchTask(kind, mode)].append(block)

    def _go_on(self, block: Block) -> None:
        """Let runs go on in their modes."""
        for mode in block.present_modes():
            columns = np.flatnonzero(block["mode"] == mode)
            if mode is Mode.ENDED:
                self._under_way -= len(columns)
            else:
                self._wait(BatchTaskKind.STEPS, _NAMING.get(mode, mode), block.take(columns))

    def _release(self, most: int) -> bool:
        """Release the next runs; return whether there were any."""
        runs, numbers = self._source.take_possible(most)
        if not len(runs):
            return False
        self._under_way += len(runs)
        block = Block(np.zeros((len(NOTES) + len(LEADING) + len(self._model.names), len(runs))))
        for row, name in enumerate(self._model.names, start=len(LEADING)):
            block.numbers[row] = numbers[name]
        block["run"], block["duration"] = runs.astype(float), self._duration
        block["free_length"], block["wrap_angle"] = numbers["free_length"], numbers["release_angle"]
        along, across = (np.broadcast_to(numbers[name], len(runs)) for name in ("push_along", "push_across"))
        self._changes.release(block, along, across)
        result = self._result
        result.stops[runs] = result.slip_count[runs] = result.slack_intervals[runs] = 0
        result.sequence[runs] = HASH_START
        self._note_modes(block, runs)
        self._go_on(block)
        return True

    def _step(self, mode: Mode, blocks: list[Block]) -> None:
        """Take steps until an event may lie in the next step of some."""
        step = stepper(self._model, mode, self._tolerance)
        n = sum(map(len, blocks))
        block, most = Block.joined(blocks, whole_vectors=True), max(PAUSE, n // 10)
        numbers = block.numbers
        while True:
            out = step.step.whole_vectors(numbers)
            clear = (out[-1] > 0) & (block["steps"] < MAX_STEPS)
            for row, new in zip(step.rows, out, strict=False):
                np.copyto(numbers[row], new, where=clear)
            block["steps"] += clear
            going = np.count_nonzero(clear)
            if not going or len(clear) - going > most:
                break
        self._wait(BatchTaskKind.STEPS, mode, block.take(np.flatnonzero(clear[:n])))
        self._wait(BatchTaskKind.EVENT, mode, block.take(np.flatnonzero(~clear[:n])))

    def _meet(self, task: BatchTask, block: Block) -> None:
        """Go on to the first event within the next step and apply it, or to the step's end if there is none."""
        step = stepper(self._model, task.mode, self._tolerance)
        moved, event = (step.search if task.kind is BatchTaskKind.SEARCH else step.meet)(block.numbers)
        unsure = event == UNSURE
        if unsure.any():
            self._wait(BatchTaskKind.SEARCH, task.mode, block.take(np.flatnonzero(unsure)))
            block, moved, event = block.take(np.flatnonzero(~unsure)), moved[:, ~unsure], event[~unsure]
        block.numbers[step.rows] = moved
        if task.mode is Mode.SLIDING_DOWN:
            block["heavy_speed"] = block["retreat_speed"]
        block["events"] += event >= 0
        lost = (block["steps"] >= MAX_STEPS) | (block["events"] > MAX_EVENTS) | ~np.isfinite(moved).all(axis=0)
        kinds = (block["mode"].astype(np.int64) * len(step.events) + event) * 2 + (block["phase"] > 0)
        kinds[event == NONE] = NONE
        kinds[lost] = _LOST
        order = np.argsort(kinds, kind="stable")
        block, kinds = block.take(order), kinds[order]
        for start, end in pairwise([*np.flatnonzero(np.diff(kinds, prepend=np.nan)).tolist(), len(kinds)]):
            kind, part = int(kinds[start]), block.part(start, end)
            if kind == _LOST:
                self._fail(part)
            elif kind >= 0:
                before, watched = Mode(kind // (2 * len(step.events))), step.events[kind // 2 % len(step.events)]
                self._apply(part, before, watched if kind % 2 else PHASE_ZERO.get(watched, watched))  # as `state.meaning`
        self._go_on(block)

    # Results

    def _apply(self, block: Block, mode: Mode, event: Event) -> None:
        """Apply ``event``, which all, in ``mode``, have met, and note what becomes of them."""
        runs = block.runs
        self._changes.follow(block, mode, event)
        if event in END_EVENTS:
            self._note_end(block, runs, mode, event)
        elif event not in PHASE_EVENTS:
            if event is Event.STOP:
                self._result.stops[runs] += 1
            elif event in (Event.SLIP_ONSET_DOWN, Event.SLIP_ONSET_UP):
                self._result.slip_count[runs] += 1
            self._note_modes(block, runs)

    def _note_modes(self, block: Block, runs: Index) -> None:
        """Note that the runs' modes have changed: the last such change may be the halt."""
        result = self._result
        result.slack_intervals[runs] += (block["mode"] == Mode.SLACK) | (block["mode"] == Mode.CLAMPED_SLACK)
        result.sequence[runs] = hash_further(result.sequence[runs], block["mode"].astype(np.uint64))
        result.halting_time[runs] = block["time"]
        result.halting_wrap_angle[runs] = block["wrap_angle"]
        result.halting_free_length[runs] = block["free_length"]

    def _note_end(self, block: Block, runs: Index, mode: Mode, event: Event) -> None:
        """Write down how the runs ended."""
        result = self._result
        result.end_time[runs] = self._duration if event is Event.TIME_UP else block["time"]
        result.wrap_angle[runs], result.free_length[runs] = block["wrap_angle"], block["free_length"]
        (result.drop[runs],) = drop(self._model)(block.numbers)
        result.end[runs] = ENDS.index(event)
        result.sequence[runs] = hash_further(result.sequence[runs], np.uint64(Mode.ENDED))
        if event is not Event.LIGHT_REACHES_ROD or mode is not Mode.STICKING:
            for values in (result.halting_time, result.halting_wrap_angle, result.halting_free_length):
                values[runs] = np.nan
        self._source.done(len(runs))

    def _fail(self, block: Block) -> None:
        """Mark the runs as failed."""
        runs = block.runs
        self._result.put(runs, BatchResult.empty(len(runs)))
        block["mode"] = Mode.ENDED
