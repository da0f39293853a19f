"""A run of the reference: its events, and its state at any time to the accuracy of its steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from looping_pendulum.reference_ode.core.trace import EVENTS
from looping_pendulum.reference_ode.effects.types import TURN
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.geometry import Array, light_position, light_velocity, xy_pairs
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.state import (
    Effects,
    Signs,
    State,
    extra_variables,
    heavy_drop,
    string_has_thickness,
    variables,
    winding,
)
from looping_pendulum.reference_ode.transitions import PHASE_EVENTS, Event, Mode

MAX_RESTING_ROD_SPEED = 1e-200
"""Largest surface speed of a rod that counts as at rest [m/s]; it is above `state.TINY_SPEED`, which stands for zero."""


# A named tuple, as a long swing has hundreds of them in each of the thousands of runs of a fit
class RunEvent(NamedTuple):
    """One event of a run."""

    event: Event | None
    """The event; None for the release."""
    time: float
    """[s]"""
    mode_before: Mode
    mode_after: Mode
    state: State
    """State just after the event."""


_MODES = {mode.value: mode for mode in Mode}
_FIRST_SIGN = 3 + len(State._fields)


def events_of(rows: Array) -> tuple[RunEvent, ...]:
    """Return the events of one run from the driver's rows, shape (events, `EVENT_COLUMNS`)."""
    events, before = [], _MODES[int(rows[0, 1])]
    for code, mode, time, *numbers in rows[:, :_FIRST_SIGN].tolist():
        after = _MODES[int(mode)]
        events.append(RunEvent(EVENTS[int(code)] if code >= 0 else None, time, before, after, State(*numbers)))
        before = after
    return tuple(events)


@dataclass(frozen=True, kw_only=True)
class Run:
    """Events of a run of the reference, from release to end."""

    parameters: Parameters
    tolerance: float
    events: tuple[RunEvent, ...]
    """All events in order, the release first and the end last."""

    @property
    def end(self) -> RunEvent:
        """The event that ended the run."""
        return self.events[-1]

    @property
    def end_time(self) -> float:
        """Time at which the run ended [s]."""
        return self.end.time

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The sequence of modes, from the release's to ENDED."""
        return tuple(e.mode_after for e in self.events if e.event not in PHASE_EVENTS)

    @property
    def stops(self) -> tuple[float, ...]:
        """Times at which the heavy mass's speed becomes zero [s]; of a string that stretches, its sliding speed."""
        ends = (Event.STOP, Event.ROD_STOPS)
        return tuple(e.time for e in self.events if e.event in ends and abs(e.state.rod_speed) < MAX_RESTING_ROD_SPEED)

    @property
    def halt(self) -> RunEvent | None:
        """The event that began the sticking that lasted until the light mass reached the rod; None without one."""
        if self.end.event is not Event.LIGHT_REACHES_ROD or self.end.mode_before is not Mode.STICKING:
            return None
        # The last change of mode before the end is the one that began the sticking
        halt: RunEvent = next(e for e in reversed(self.events[:-1]) if e.event not in PHASE_EVENTS)
        return halt

    @property
    def halting_time(self) -> float | None:
        """Start of the sticking that lasts until the light mass reaches the rod [s]; None without one."""
        return None if self.halt is None else self.halt.time

    def heavy_drop(self, state: State) -> Array:
        """Return how far the heavy mass is below its release [m] in states of this run (numbers or arrays)."""
        effects = self.parameters.effects
        return np.asarray(heavy_drop(np, state, string_overlap(state, effects), self.parameters.values(), effects))


@dataclass(frozen=True, kw_only=True)
class Samples:
    """Samples of a run at n given times; arrays of shape (n,) or (n, 2), SI."""

    run: Run
    t: Array
    """Times [s], shape (n,)."""
    state: State
    """Entries of the state, arrays of shape (n,)."""
    mode: NDArray[np.int8]
    """Mode of each sample, a number of `Mode`."""
    signs: Signs
    """Signs and phases of each sample, which the equations need beside the state, arrays of shape (n,)."""

    def and_end(self) -> Samples:
        """Return these samples and, as the last one, the end of the run."""
        end, signs = self.run.end, np.array(self.signs)
        # All entries at once: a fit asks for this thousands of times
        return Samples(
            run=self.run,
            t=np.append(self.t, end.time),
            state=State(*np.column_stack([np.array(self.state), end.state])),
            mode=np.append(self.mode, self.mode.dtype.type(end.mode_after)),
            signs=Signs(*np.column_stack([signs, signs[:, -1:]])),
        )

    @cached_property
    def light_position(self) -> Array:
        """Position (x, y) of the light mass [m], shape (n, 2)."""
        return xy_pairs(*light_mass_position(np, self.state, *self._model))

    @cached_property
    def light_velocity(self) -> Array:
        """Velocity (x, y) of the light mass [m/s], shape (n, 2)."""
        s = self.state
        return xy_pairs(*light_velocity(np, s.wrap_angle, s.retreat_speed, s.across_speed))

    @cached_property
    def heavy_position(self) -> Array:
        """Position (x, y) of the heavy mass [m], shape (n, 2)."""
        return xy_pairs(*heavy_mass_position(np, self.state, *self._model))

    @cached_property
    def heavy_velocity(self) -> Array:
        """Velocity (x, y) of the heavy mass [m/s], shape (n, 2)."""
        speed = self.state.heavy_speed
        if "heavy_tilt" not in extra_variables(self.run.parameters.effects):
            return xy_pairs(0.0, speed)
        across, cosine, sine = self.state.heavy_across_speed, np.cos(self.state.heavy_tilt), np.sin(self.state.heavy_tilt)
        return xy_pairs(across * cosine - speed * sine, across * sine + speed * cosine)

    @cached_property
    def _model(self) -> tuple[Any, SimpleNamespace, Effects]:
        p = self.run.parameters
        return string_overlap(self.state, p.effects), p.values(), p.effects

    @cached_property
    def tensions(self) -> tuple[Array, Array]:
        """Tensions in the free string and above the heavy mass, arrays of shape (n,) [N]."""
        light, heavy = np.zeros(len(self.t)), np.zeros(len(self.t))
        for mode, here, state, signs in self._by_mode():
            light[here], heavy[here] = self._equations.tensions(mode, self.t[here], state, signs)
        return light, heavy

    @cached_property
    def rates(self) -> State:
        """Derivatives of the state by time, arrays of shape (n,)."""
        rates = State(*np.zeros((len(State._fields), len(self.t))))
        for mode, here, state, signs in self._by_mode():
            moving = self._equations.rates(mode, self.t[here], state, signs)._asdict()
            for name in variables(mode, self._equations.effects):
                getattr(rates, name)[here] = moving[name]
        return rates

    @cached_property
    def _equations(self) -> Equations:
        return Equations(np, self.run.parameters.values(), self.run.parameters.effects)

    def _by_mode(self) -> Iterator[tuple[Mode, NDArray[np.bool_], State, Signs]]:
        """Yield each mode, which has equations of its own, with its samples, their states and signs."""
        for mode in map(Mode, np.unique(self.mode)):
            here = self.mode == mode
            yield mode, here, State(*(v[here] for v in self.state)), Signs(*(v[here] for v in self.signs))


def string_overlap(state: State, effects: Effects) -> Any:
    """Return 1 where the string lies on itself, else 0; 0 throughout if it has no thickness."""
    return np.asarray(np.asarray(state.wrap_angle) > TURN, dtype=float) if string_has_thickness(effects) else 0.0


def light_mass_position(xp: Any, s: State, overlap: Any, p: SimpleNamespace, effects: Effects) -> tuple[Any, Any]:
    """Return the position (x, y) of the light mass [m]; ``overlap``: 1 where the string lies on itself, else 0."""
    if not string_has_thickness(effects):
        return light_position(xp, s.free_length, s.wrap_angle, p.rod_radius)
    wound = winding(s, overlap, p, effects)
    return light_position(xp, s.free_length + wound.foot, s.wrap_angle, wound.radius)


def heavy_mass_position(xp: Any, s: State, overlap: Any, p: SimpleNamespace, effects: Effects) -> tuple[Any, Any]:
    """Return the position (x, y) of the heavy mass [m]; arguments as for `light_mass_position`."""
    height = -p.hanging_length - heavy_drop(xp, s, overlap, p, effects)
    if "heavy_tilt" not in extra_variables(effects):
        return p.rod_radius, height
    length = p.rod_radius * (s.heavy_tilt - p.heavy_swing) - height
    cosine, sine = xp.cos(s.heavy_tilt), xp.sin(s.heavy_tilt)
    return p.rod_radius * cosine + length * sine, p.rod_radius * sine - length * cosine


def height_at_release(p: SimpleNamespace, effects: Effects, mass: str) -> Any:
    """Return the height of a mass, "light" or "heavy", at release [m]."""
    at_release = State(p.free_length, p.release_angle, 0.0, 0.0, 0.0, 0.0, heavy_tilt=p.heavy_swing)
    place = heavy_mass_position if mass == "heavy" else light_mass_position
    return place(np, at_release, 0.0, p, effects)[1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution(Run):
    """A run that can be sampled at any time: polynomials of degree 7 between its steps, exact to the tolerance."""

    rows: Array
    """The events as the driver's rows, which have the signs, too, shape (events, `EVENT_COLUMNS`)."""
    steps: Array
    """The driver's steps: their starts [s], lengths [s], modes and polynomials, shape (steps, `DENSE_COLUMNS`)."""

    def sample(self, t: ArrayLike) -> Samples:
        """Sample the run at times ``t`` [s], shape (n,), in any order; they must lie within it.

        Raises
        ------
        ValueError
            If a time lies outside the run.
        """
        t = np.asarray(t, dtype=float)
        if t.size and not (t.min() >= 0 and t.max() <= self.end_time):
            raise ValueError(f"times from {t.min():g} to {t.max():g} s asked for; the run covers 0 to {self.end_time:g} s")
        step = np.maximum(np.searchsorted(self.steps[:, 0], t, side="right") - 1, 0)
        starts, lengths = self.steps[step, 0], self.steps[step, 1]
        x = ((t - starts) / lengths)[:, None]
        rest = 1.0 - x
        # As the driver's function `at`
        z, *d = self.steps[step, 3:].reshape(len(t), 8, len(State._fields)).swapaxes(0, 1)
        values = d[6]
        for k, factor in ((5, x), (4, rest), (3, x), (2, rest), (1, x), (0, rest)):
            values = d[k] + factor * values
        return samples_at(self, self.rows, t, State(*(z + x * values).T), side="right")


def samples_at(run: Run, rows: Array, t: Array, state: State, side: Literal["left", "right"] = "left") -> Samples:
    """Return samples with their modes and signs, which are those after the last event before them.

    A sample at the very time of an event belongs to the motion before it (``side`` "left") or after it ("right").
    """
    # The mode after the last event, ENDED, has no equations
    event = np.maximum(np.minimum(np.searchsorted(rows[:, 2], t, side=side), len(rows) - 1) - 1, 0)
    return Samples(run=run, t=t, state=state, mode=rows[event, 1].astype(np.int8), signs=Signs(*rows[event, _FIRST_SIGN:].T))
