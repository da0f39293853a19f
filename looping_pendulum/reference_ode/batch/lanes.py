"""Run many runs side by side: all those in one mode take a step at once, and each changes its mode when its event comes.

The equations, the transition table and the choice of what follows an event are those of the single run (`driver`); only here
they act on arrays. A run sits in a lane; a lane whose run has ended takes the next one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode import equations
from looping_pendulum.reference_ode.batch.result import ENDS, HASH_START, BatchResult, hash_further
from looping_pendulum.reference_ode.batch.roots import first_falls, values
from looping_pendulum.reference_ode.batch.steps import LEADING, SIGNS, STATE, stepper
from looping_pendulum.reference_ode.driver import MAX_EVENTS, START, TINY
from looping_pendulum.reference_ode.effects import EFFECTS, EffectKind
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.state import Effects, Signs, State, meaning, string_path
from looping_pendulum.reference_ode.transitions import PHASE_EVENTS, Choice, Event, Mode, next_mode

LANES = 16384
"""Runs side by side."""
UNREAD = {"light_radius", "hanging_length"}
"""Numbers that only others are made of; no equation reads them."""
MAX_STEPS = 20_000
"""Steps of a run after which it counts as failed."""
_ROW = {name: row for row, name in enumerate(LEADING)}
_STATE, _SIGNS = slice(0, len(STATE)), slice(_ROW[SIGNS[0]], _ROW[SIGNS[-1]] + 1)
_SLACK = np.array([mode in (Mode.SLACK, Mode.CLAMPED_SLACK) for mode in Mode])
Index = NDArray[np.int64]


class View(NamedTuple):
    """Some lanes as the equations take them: arrays of shape (n,)."""

    t: Array
    y: State
    signs: Signs
    p: SimpleNamespace


def _first_events(changes: Array, lows: Array) -> tuple[Array, Index]:
    """Fraction of the step at which each run meets its first event, inf if it meets none, and the event's number."""
    numbers, runs = np.nonzero(~(lows > 0))
    by_event = np.full(lows.shape, np.inf)
    by_event[numbers, runs] = first_falls(changes[:, numbers, runs])
    event = by_event.argmin(axis=0)
    return by_event[event, np.arange(len(event))], event


class Lanes:
    """Runs that are under way, and the results of those that have ended."""

    def __init__(
        self,
        numbers: Mapping[str, Any],
        n: int,
        effects: Effects,
        release: Release,
        duration: float,
        tolerance: float,
        done: Callable[[int], None] = lambda n: None,
    ) -> None:
        """``numbers``: parameters and derived numbers by name, each for all runs or of shape (``n``,)."""
        self.result = BatchResult.empty(n)
        self._numbers, self._n, self._duration, self._tolerance = numbers, n, duration, tolerance
        self._release, self._done = release, done
        self._effects = tuple(effect for effect in effects if effect.kind is not EffectKind.RELEASE)
        absent = {c.name: c.null for effect in EFFECTS.values() if effect not in self._effects for c in effect.coefficients}
        self._absent, self._names = absent, tuple(sorted(numbers.keys() - absent.keys() - UNREAD))
        width = min(LANES, n)
        self._next = 0
        self._data = np.zeros((len(LEADING) + len(self._names), width))
        self._mode = np.full(width, Mode.ENDED, dtype=np.int8)
        self._run = np.zeros(width, dtype=np.int64)
        self._steps, self._events = np.zeros(width, dtype=np.int32), np.zeros(width, dtype=np.int32)

    def run(self) -> BatchResult:
        """Run all to their ends. A run that breaks down is left marked as failed."""
        with np.errstate(all="ignore"):  # a lane that breaks down must not disturb the others
            while True:
                free = np.flatnonzero(self._mode == Mode.ENDED)
                if len(free) > len(self._mode) // 8 and self._next < self._n:
                    self._fill(free[: self._n - self._next])
                elif len(free) == len(self._mode):
                    return self.result
                for mode in (Mode.SLIDING_DOWN, Mode.STICKING, Mode.SLACK, Mode.CLAMPED, Mode.CLAMPED_SLACK, Mode.FALLING):
                    here = self._mode == mode
                    if mode is Mode.SLIDING_DOWN:
                        here |= self._mode == Mode.SLIDING_UP
                    lanes = np.flatnonzero(here)
                    if len(lanes):
                        self._step(mode, lanes)

    def _step(self, mode: Mode, lanes: Index) -> None:
        """Take one step, up to an event, in lanes of one mode."""
        step = stepper(mode, self._effects, self._tolerance, self._names)
        data = self._data.take(lanes, axis=1)
        ends, lows = step.step(data)
        self._put(step.rows, lanes, ends)
        self._steps[lanes] += 1
        unclear = np.flatnonzero(~(lows > 0).all(axis=0))
        if not len(unclear):
            return
        lanes, lows = lanes[unclear], lows[:, unclear]
        motion, changes = step.expand(data.take(unclear, axis=1))
        broken = ~np.isfinite(motion[-1]).all(axis=0) | ~np.isfinite(changes[-1]).all(axis=0) | (self._steps[lanes] > MAX_STEPS)
        self._fail(lanes[broken])
        fraction, event = _first_events(changes, lows)
        met = np.flatnonzero(np.isfinite(fraction) & ~broken)
        lanes, fraction, event = lanes[met], fraction[met], event[met]
        self._put(step.rows, lanes, values(motion[:, :, met], fraction))
        if mode is Mode.SLIDING_DOWN:
            self._set(lanes, heavy_speed=self._get(lanes, "retreat_speed"))
        self._follow(lanes, step.events, event)

    def _view(self, lanes: Index) -> View:
        data = self._data[:, lanes]
        numbers = dict(zip(self._names, data[len(LEADING) :], strict=True))
        return View(
            t=data[_ROW["time"]],
            y=State(*data[_STATE]),
            signs=Signs(*data[_SIGNS]),
            p=SimpleNamespace(**(self._absent | numbers)),
        )

    def _put(self, rows: Index, lanes: Index, new: Array) -> None:
        for row, numbers in zip(rows, new, strict=True):
            self._data[row, lanes] = numbers

    def _set(self, lanes: Index, **values: Any) -> None:
        for name, value in values.items():
            self._data[_ROW[name], lanes] = value

    def _get(self, lanes: Index, name: str) -> Array:
        values: Array = self._data[_ROW[name], lanes]
        return values

    # Release

    def _fill(self, lanes: Index) -> None:
        """Release the next runs in ``lanes``."""
        runs = np.arange(self._next, self._next + len(lanes))
        self._next += len(lanes)
        self._run[lanes], self._steps[lanes], self._events[lanes] = runs, 0, 0
        for row, name in enumerate(self._names, start=len(LEADING)):
            self._data[row, lanes] = self._start(name, runs)
        along, across = (np.broadcast_to(self._start(name, runs), len(runs)) for name in ("push_along", "push_across"))
        self._data[: len(LEADING), lanes] = 0.0
        self._set(
            lanes,
            free_length=self._start("free_length", runs),
            wrap_angle=self._start("release_angle", runs),
            retreat_speed=along,
            across_speed=across,
            slide=-1.0,
            across=np.where(across < 0, -1.0, 1.0),
            heavy=-1.0,
            duration=self._duration,
        )
        self._mode[lanes] = self._released_modes(lanes, along)
        start = self.result
        start.stops[runs] = start.reslips[runs] = start.slack_intervals[runs] = 0
        start.sequence[runs] = HASH_START
        self._changed(lanes)
        self._enter(lanes)
        self._leave_rest(lanes)

    def _start(self, name: str, runs: Index) -> Any:
        """A number of these runs, or of all."""
        values = np.asarray(self._numbers[name])
        return values[runs] if values.ndim else values

    def _released_modes(self, lanes: Index, push: Array) -> NDArray[np.int8]:
        """Modes at release; a push along the string away from the rod is shared as by a string that becomes taut."""
        if self._release is Release.DROP:
            return np.full(len(lanes), Mode.FALLING, dtype=np.int8)
        held = self._release is Release.HELD
        slack = Mode.CLAMPED_SLACK if held else Mode.SLACK
        modes = np.full(len(lanes), slack, dtype=np.int8)
        pulled = push >= 0
        if held:
            self._set(lanes[pulled], retreat_speed=0.0)
            modes[pulled] = Mode.CLAMPED
        else:
            modes[push == 0] = self._held_or_sliding(lanes[push == 0])
            modes[push > 0] = self._after_impulse(lanes[push > 0])
        self._begin_slides(lanes[pulled], modes[pulled])
        return np.where(pulled & ~self._pulls(lanes, modes), slack, modes).astype(np.int8)

    def _leave_rest(self, lanes: Index) -> None:
        """Take the first START seconds by series where the light mass starts at rest and |v| has a root there."""
        for mode in map(Mode, np.unique(self._mode[lanes])):
            here = lanes[self._mode[lanes] == mode]
            view = self._view(here)
            y = view.y
            rate = equations.rates(np, mode, *view, self._effects)
            at_rest = y.across_speed == 0
            signs = np.where(at_rest, np.where(rate.across_speed >= 0, 1.0, -1.0), view.signs.across)
            self._set(here, across=signs)
            moving = (y.across_speed != 0) | (y.retreat_speed != 0)
            by_series = ~moving & (mode.string_moves or mode.slack)
            turning = rate.across_speed / y.free_length
            self._set(here, across_speed=np.where(at_rest & ~by_series, signs * TINY, y.across_speed))
            twice = {
                "free_length": rate.retreat_speed - view.p.rod_radius * turning,
                "wrap_angle": turning,
                "slack": rate.heavy_speed - rate.retreat_speed,
            }
            for name in STATE:
                moved = getattr(y, name) + START * getattr(rate, name) + 0.5 * START**2 * twice.get(name, 0.0)
                self._set(here[by_series], **{name: np.broadcast_to(moved, by_series.shape)[by_series]})
            self._set(here[by_series], time=START)

    # Events

    def _follow(self, lanes: Index, events: tuple[Event, ...], event: Index) -> None:
        """Apply each lane's event."""
        if not len(lanes):
            return
        self._events[lanes] += 1
        phases = self._get(lanes, "phase")
        kinds = (self._mode[lanes].astype(np.int64) * len(events) + event) * 2 + (phases > 0)
        for kind in np.unique(kinds):
            here = lanes[kinds == kind]
            mode = Mode(kind // (2 * len(events)))
            phase_signs = Signs(0.0, 0.0, 0.0, phase=float(kind % 2))
            self._follow_one(here, mode, meaning(events[kind // 2 % len(events)], phase_signs))
        self._fail(lanes[(self._events[lanes] > MAX_EVENTS) & (self._mode[lanes] != Mode.ENDED)])

    def _follow_one(self, lanes: Index, mode: Mode, event: Event) -> None:
        """Apply ``event``, which all ``lanes``, in ``mode``, have met."""
        following = next_mode(mode, event)
        if following is Mode.ENDED:
            self._end(lanes, mode, event)
        elif event is Event.ACROSS_REVERSES:
            signs = -self._get(lanes, "across")
            self._set(lanes, across=signs, across_speed=signs * TINY)
        elif event is Event.HEAVY_REVERSES:
            signs = -self._get(lanes, "heavy")
            self._set(lanes, heavy=signs, heavy_speed=signs * TINY)
        elif event in PHASE_EVENTS:
            self._set(lanes, phase=1.0)
        else:
            self._change(lanes, mode, event, following)

    def _change(self, lanes: Index, mode: Mode, event: Event, following: Mode | Choice) -> None:
        """Change the modes, and the speeds that the event sets."""
        runs = self._run[lanes]
        if event is Event.STOP:
            self._set(lanes, heavy_speed=0.0, retreat_speed=0.0)
            self.result.stops[runs] += 1
        elif event in (Event.BREAKS_DOWN, Event.BREAKS_UP):
            self.result.reslips[runs] += 1
        elif mode is Mode.CLAMPED_SLACK:
            self._take(lanes, self._impact(lanes, 0.0).state)
        if following is Choice.BY_HOLDING:
            modes = self._held_or_sliding(lanes)
        elif following is Choice.BY_IMPULSE:
            modes = self._after_impulse(lanes)
        else:
            modes = np.full(len(lanes), following, dtype=np.int8)
        self._mode[lanes] = modes
        self._enter(lanes)
        if event is Event.TAUT:
            loose = lanes[~self._pulls(lanes, modes)]
            self._mode[loose] = np.where(self._mode[loose] == Mode.CLAMPED, Mode.CLAMPED_SLACK, Mode.SLACK)
            self._enter(loose)
        self._changed(lanes)

    def _held_or_sliding(self, lanes: Index) -> NDArray[np.int8]:
        """Choice.BY_HOLDING: whether the rod holds a string that does not slide, and if not which way it slides."""
        down, up = equations.holding_margins(np, *self._view(lanes), self._effects)
        return np.where(down < 0, Mode.SLIDING_DOWN, np.where(up < 0, Mode.SLIDING_UP, Mode.STICKING)).astype(np.int8)

    def _after_impulse(self, lanes: Index) -> NDArray[np.int8]:
        """Choice.BY_IMPULSE: exactly one of up, down and stick is consistent; energy falls in each."""
        modes = np.full(len(lanes), Mode.ENDED, dtype=np.int8)
        for mode, slide in ((Mode.SLIDING_UP, 1.0), (Mode.SLIDING_DOWN, -1.0)):
            rest = np.flatnonzero(modes == Mode.ENDED)
            hit = self._impact(lanes[rest], slide)
            so = slide * hit.sliding > 0
            modes[rest[so]] = mode
            self._take(lanes[rest[so]], State(*(np.broadcast_to(v, so.shape)[so] for v in hit.state)))
        rest = np.flatnonzero(modes == Mode.ENDED)
        self._take(lanes[rest], self._impact(lanes[rest], 0.0).state)
        modes[rest] = self._held_or_sliding(lanes[rest])
        return modes

    def _impact(self, lanes: Index, slide: float) -> equations.Impact:
        view = self._view(lanes)
        return equations.impact(np, slide, *view, self._effects)

    def _take(self, lanes: Index, state: State) -> None:
        """Go on from ``state``, just after an impulse."""
        self._set(lanes, **{name: getattr(state, name) for name in STATE})

    def _pulls(self, lanes: Index, modes: NDArray[np.int8]) -> NDArray[np.bool_]:
        """Whether the light mass's tension is not below zero; so too where there is none."""
        pulls = np.ones(len(lanes), dtype=bool)
        for mode in map(Mode, np.unique(modes)):
            here = modes == mode
            light, _ = equations.tensions(np, mode, *self._view(lanes[here]), self._effects)
            pulls[here] = light >= 0
        return pulls

    def _begin_slides(self, lanes: Index, modes: NDArray[np.int8]) -> None:
        """Set the signs and phase with which sliding modes begin."""
        for mode, slide in ((Mode.SLIDING_UP, 1.0), (Mode.SLIDING_DOWN, -1.0)):
            here = lanes[modes == mode]
            resting = np.abs(self._get(here, "heavy_speed")) <= TINY
            self._set(here, slide=slide, phase=np.where(resting, 0.0, 1.0))

    def _enter(self, lanes: Index) -> None:
        """Set the signs and phase with which the lanes' modes begin."""
        modes = self._mode[lanes]
        self._begin_slides(lanes, modes)
        slack = lanes[_SLACK[modes] | (modes == Mode.FALLING)]
        speed = self._get(slack, "heavy_speed")
        speed = np.where((speed == 0) & (self._mode[slack] == Mode.SLACK), -TINY, speed)
        self._set(slack, heavy_speed=speed, slack=0.0, heavy=np.where(speed > 0, 1.0, -1.0), phase=0.0)

    # Results

    def _changed(self, lanes: Index) -> None:
        """Note that the lanes' modes have changed: the last such change may be the halt."""
        runs, modes = self._run[lanes], self._mode[lanes]
        self.result.slack_intervals[runs] += _SLACK[modes]
        self.result.sequence[runs] = hash_further(self.result.sequence[runs], modes.astype(np.uint64))
        self.result.halting_time[runs] = self._get(lanes, "time")
        self.result.halting_wrap_angle[runs] = self._get(lanes, "wrap_angle")
        self.result.halting_free_length[runs] = self._get(lanes, "free_length")

    def _end(self, lanes: Index, mode: Mode, event: Event) -> None:
        """Write down how the lanes' runs ended."""
        runs, result = self._run[lanes], self.result
        _, y, _, p = self._view(lanes)
        result.end_time[runs] = self._duration if event is Event.TIME_UP else self._get(lanes, "time")
        result.wrap_angle[runs], result.free_length[runs] = y.wrap_angle, y.free_length
        path = string_path(np, y, 0.0, p, self._effects) + y.slack
        result.drop[runs] = p.free_length + p.rod_radius * p.release_angle - path
        result.end[runs] = ENDS.index(event)
        result.sequence[runs] = hash_further(result.sequence[runs], np.uint64(Mode.ENDED))
        if event is not Event.LIGHT_REACHES_ROD or mode is not Mode.STICKING:
            for values in (result.halting_time, result.halting_wrap_angle, result.halting_free_length):
                values[runs] = np.nan
        self._mode[lanes] = Mode.ENDED
        self._done(len(lanes))

    def _fail(self, lanes: Index) -> None:
        """Mark the lanes' runs as failed."""
        if not len(lanes):
            return
        empty, runs = BatchResult.empty(1), self._run[lanes]
        for field in dataclasses.fields(BatchResult):
            getattr(self.result, field.name)[runs] = getattr(empty, field.name)
        self._mode[lanes] = Mode.ENDED
