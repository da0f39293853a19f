"""One run from release to end: one mode after another, as the transition table says."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from looping_pendulum.errors import IntegrationError
from looping_pendulum.reference_ode import equations
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_backend import HeyokaIntegrator
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.scipy_backend import ScipyIntegrator
from looping_pendulum.reference_ode.solution import Part, RunEvent, Segment
from looping_pendulum.reference_ode.state import Effects, Signs, State, own_variables, winding
from looping_pendulum.reference_ode.transitions import Event, Mode, TransitionChoice, next_mode

MAX_EVENTS = 4000
START = 1e-6
"""Length of the series step that leaves rest [s]: |v| is not analytic at v = 0. The series' next term is of order START^3."""
ROUNDING = 1e-9
"""Tension that counts as none where a string that stretches comes to rest on the rod [N]."""
NO_TENSION = 1e-14
"""Tension over the light mass's weight that is none but for rounding, at a release (a string released at 90 deg has -6e-17)."""
TINY = 1e-300
"""Stands for zero where an event function starts at a zero that is already dealt with."""


class Integrator(Protocol):
    """Runs one mode until one of its events."""

    def advance(self, mode: Mode, t: float, y: State, signs: Signs, until: float) -> tuple[Event, float, State, Segment]:
        """Integrate ``mode`` from ``y`` at ``t`` [s] until an event, or past the time ``until`` [s]."""

    def advance_sampled(
        self, mode: Mode, t: float, y: State, signs: Signs, until: float, times: Array
    ) -> tuple[Event, float, State, Part]:
        """As `advance`, but return samples at those ``times`` [s] after ``t`` that it reaches."""


class Driver:
    """The state of one run while it goes on. Its `record` is complete once `run_dense` or `run_sampled` has returned.

    Where it compares a number with 0: coefficients are as written; speeds of what rests (or `TINY`) and signs were assigned,
    so these are exact. Tensions and margins are computed: they have `NO_TENSION`, `ROUNDING` and `equations.EDGE`, or are far
    from 0 but in grazing cases, in which both neighbours are right to rounding.
    """

    xp: Any = math
    """Math namespace of the numbers that the state is made of."""

    def __init__(self, parameters: Parameters, duration: float, tolerance: float, integrator: str) -> None:
        self.parameters = parameters
        self.values = parameters.values()
        self.effects: Effects = parameters.effects
        self.duration = duration
        self.tolerance = tolerance
        self.integrator_name = integrator
        backend = HeyokaIntegrator if integrator == "heyoka" else ScipyIntegrator
        self.integrator: Integrator = backend(self.values, self.effects, tolerance)
        self.events: list[RunEvent] = []
        self.t = 0.0
        self.turns = "rod_speed" in own_variables(self.effects)
        self.y = self._released_state()
        self.signs = Signs(slide=-1.0, across=-1.0 if self.y.across_speed < 0 else 1.0, heavy=-1.0, phase=0.0)
        self.stretches = "light_stretch" in own_variables(self.effects)
        if self.stretches:
            self.y = equations.stretched_at_rest(self.xp, 0.0, self.y, self.signs, self.values, self.effects)
            if parameters.release is Release.HELD:  # what the clamp holds does not stretch
                self.y = self.y._replace(heavy_stretch=0.0)
        self.mode = self._released_mode()

    def run_dense(self) -> list[Segment]:
        """Run to the end; return what every integrator did."""
        segments = self._begin()
        for _ in range(MAX_EVENTS):
            event, self.t, self.y, segment = self.integrator.advance(self.mode, self.t, self.y, self.signs, self.duration)
            segments.append(segment)
            if self.t >= self.duration:
                event, self.t = Event.TIME_UP, self.duration
                self.y = State(*segment.sample(np.array([self.t])).values[:, 0].tolist())
            if self._follow(event):
                return segments
        raise self._endless()

    def run_sampled(self, times: Array) -> list[Part]:
        """Run to the end; return samples at ``times``."""
        times = times[times <= self.duration]
        at_release = np.repeat(np.array(self.y, dtype=float)[:, None], np.count_nonzero(times == 0), axis=1)
        early = times[: np.searchsorted(times, START, side="right")]
        begun = self._begin()
        if begun and early.any():
            parts = [segment.sample(early) for segment in begun]
        else:
            parts = [Part(mode=self.mode, signs=self.signs, t=early[early == 0], values=at_release)]
        for _ in range(MAX_EVENTS):
            ahead = times[np.searchsorted(times, float(self.t), side="right") :]
            event, self.t, self.y, part = self.integrator.advance_sampled(
                self.mode, self.t, self.y, self.signs, self.duration, ahead
            )
            parts.append(part)
            if self._follow(event):
                return parts
        raise self._endless()

    def _begin(self) -> list[Segment]:
        self._record(None, self.mode)
        self._enter(self.mode)
        return self._leave_rest()

    def _endless(self) -> IntegrationError:
        where = f"at t = {self.t:g} s, in mode {self.mode.name.lower()}"
        return IntegrationError(f"more than {MAX_EVENTS} events {where}; are the parameters meant to be so?")

    def _released_state(self) -> State:
        """State at release, before a push along the string has been shared."""
        start, c = self.parameters, self.parameters.coefficients
        at_rest = State(start.free_length, start.release_angle, 0.0, 0.0, 0.0, 0.0)
        if start.release is Release.DROP:
            return at_rest._replace(retreat_speed=c["push_along"], across_speed=c["push_across"])
        return at_rest._replace(
            retreat_speed=c["push_along"],
            across_speed=c["push_across"],
            heavy_tilt=c["heavy_swing"],
            sideways_speed=c["push_sideways"],
        )

    def _released_mode(self) -> Mode:
        """Mode at release; a push along the string away from the rod is shared as by a string that becomes taut."""
        release, push = self.parameters.release, self.y.retreat_speed
        if release is Release.DROP:
            return Mode.FALLING
        if self.stretches:
            return Mode.CLAMPED if release is Release.HELD else Mode.SLIDING_DOWN
        slack = Mode.CLAMPED_SLACK if release is Release.HELD else Mode.SLACK
        if push < 0:
            return slack
        if release is Release.HELD:
            self.y = self.y._replace(retreat_speed=0.0)
            mode = Mode.CLAMPED
        elif push == 0:
            mode = self._held_or_sliding()
        else:
            mode = self._after_impulse()
            self._set_phase(mode)
        return mode if self._light_tension(mode) >= self._least_released_tension() else slack

    def _least_released_tension(self) -> float:
        """Tension from which a string is taut at its release [N].

        A light mass that does not move back makes the tension grow, so that none but for rounding is the edge of a taut string;
        taken for slack, it would never become taut, as it neither opens nor closes.
        """
        weight: float = self.values.light_mass * self.values.gravity
        return -NO_TENSION * weight if self.y.across_speed >= 0 else 0.0

    def _now(self) -> tuple[Any, State, Signs, Any]:
        """What decides which mode follows: time, state, signs and values, as plain numbers."""
        return self.t, self.y, self.signs, self.values

    def _light_tension(self, mode: Mode) -> float:
        return self._tensions(mode)[0]

    def _margins(self, mode: Mode) -> tuple[float, float]:
        return equations.holding_margins(math, *self._now(), self.effects, mode)

    def _held_or_sliding(self) -> Mode:
        """Choice.BY_HOLDING: whether the rod holds a string that does not slide, and if not which way it slides."""
        if self.turns:
            return self._held_rolling_or_sliding()
        down, up = self._margins(Mode.STICKING)
        # A string that stretches slows down onto the edge of the friction cone, where a margin is 0 but for rounding
        least = -ROUNDING if self.stretches else 0.0
        if down < least:
            return Mode.SLIDING_DOWN
        return Mode.SLIDING_UP if up < least else Mode.STICKING

    def _held_rolling_or_sliding(self) -> Mode:
        """As `_held_or_sliding`, on a rod that can turn; sets the sign of its speed."""
        at_rest = self.y.rod_speed == 0
        margins = (0.0, 0.0)
        if at_rest:
            self.signs = self.signs._replace(rod=0.0)
            light, heavy = self._tensions(Mode.STICKING)
            margins = self._margins(Mode.STICKING)
            if abs(light - heavy) > self.values.bearing_friction:
                self._turn_rod(math.copysign(1.0, light - heavy))
            elif min(margins) >= 0:
                return Mode.STICKING
        if self.signs.rod:
            margins = self._margins(Mode.ROLLING)
            if min(margins) >= 0:
                return Mode.ROLLING
        mode = Mode.SLIDING_DOWN if margins[0] < 0 else Mode.SLIDING_UP
        if at_rest:
            self.y = self.y._replace(rod_speed=0.0)
            self._let_rod_turn(mode)
        return mode

    def _tensions(self, mode: Mode) -> tuple[float, float]:
        return equations.tensions(math, mode, *self._now(), self.effects)

    def _turn_rod(self, sign: float) -> None:
        self.signs = self.signs._replace(rod=sign, rod_phase=0.0)
        self.y = self.y._replace(rod_speed=sign * TINY)

    def _let_rod_turn(self, mode: Mode) -> None:
        """Let a resting rod turn if the string's friction is more than its bearing holds."""
        self.signs = self.signs._replace(rod=0.0)
        if mode.sliding:
            slide = 1.0 if mode is Mode.SLIDING_UP else -1.0
            self.signs = self.signs._replace(slide=slide)
            light, heavy = self._tensions(mode)
            if slide * (light - heavy) > self.values.bearing_friction:
                self._turn_rod(slide)

    def _after_impulse(self) -> Mode:
        """Choice.BY_IMPULSE: exactly one of up, down and stick is consistent; energy falls in each."""
        for mode, slide in ((Mode.SLIDING_UP, 1.0), (Mode.SLIDING_DOWN, -1.0)):
            hit = self._impact(slide)
            if slide * hit.sliding > 0:
                self._take(hit.state)
                return mode
        self._take(self._impact(0.0).state)
        return self._held_or_sliding()

    def _impact(self, slide: float) -> equations.Impact:
        return equations.impact(self.xp, slide, self.t, self.y, self.signs, self.values, self.effects)

    def _take(self, state: State) -> None:
        """Go on from ``state``, just after an impulse."""
        self.y = state
        if self.turns:
            self.signs = self.signs._replace(rod=math.copysign(1.0, state.rod_speed) if state.rod_speed else 0.0)

    def _follow(self, event: Event) -> bool:
        """Apply ``event``; return whether the run is over."""
        before, following = self.mode, next_mode(self.mode, event)
        if following is Mode.ENDED:
            self._record(event, before, Mode.ENDED)
            return True
        if event is Event.ACROSS_REVERSES:
            self.signs = self.signs._replace(across=-self.signs.across)
            self.y = self.y._replace(across_speed=self.signs.across * TINY)
        elif event is Event.HEAVY_REVERSES:
            self.signs = self.signs._replace(heavy=-self.signs.heavy)
            self.y = self.y._replace(heavy_speed=self.signs.heavy * TINY)
        elif event in (Event.SLOWS, Event.CLOSES):
            self.signs = self.signs._replace(phase=1.0)
        elif event is Event.ROD_SLOWS:
            self.signs = self.signs._replace(rod_phase=1.0)
        elif event is Event.FIRST_TURN:
            self._pass_first_turn()
        elif event is Event.ROD_CHANGES:
            if self.signs.rod:
                self.y = self.y._replace(rod_speed=0.0)
                self._let_rod_turn(before)
            else:
                self._turn_rod(self.signs.slide)
        else:
            self._change(event, following)
        self._record(event, before)
        return False

    def _change(self, event: Event, following: Mode | TransitionChoice) -> None:
        """Change the mode, and the speeds that the event sets."""
        if self.stretches:
            if event is Event.TAUT and self.mode is Mode.SLACK:
                self.y = equations.evened_out(self.xp, self.y, self.signs, self.values, self.effects)
        elif event is Event.STOP:
            self._stop(self.y.rod_speed if self.turns else 0.0)
        elif event is Event.ROD_STOPS:
            self._stop(0.0)
            self.y = self.y._replace(rod_speed=0.0)
        elif event in (Event.ROD_YIELDS_UP, Event.ROD_YIELDS_DOWN):
            self._turn_rod(1.0 if event is Event.ROD_YIELDS_UP else -1.0)
        elif event is Event.TAUT and self.mode is Mode.CLAMPED_SLACK:
            self._take(self._impact(0.0).state)
        if following is TransitionChoice.BY_HOLDING:
            following = self._held_or_sliding()
        elif following is TransitionChoice.BY_IMPULSE:
            following = self._held_or_sliding() if self.stretches else self._after_impulse()
        assert isinstance(following, Mode)
        self._enter(following)
        if event is Event.TAUT and not self.stretches and not following.slack and self._light_tension(following) < 0:
            self._enter(Mode.CLAMPED_SLACK if following is Mode.CLAMPED else Mode.SLACK)

    def _stop(self, speed: float) -> None:
        """Give the heavy mass, and the string with it, exactly ``speed`` [m/s]."""
        follows = "sideways" not in own_variables(self.effects)
        self.y = self.y._replace(heavy_speed=speed, retreat_speed=speed if follows else self.y.retreat_speed)

    def _pass_first_turn(self) -> None:
        """Change over at a full turn: there the wound string is a step further out, and the free length a step shorter."""
        overlap = 1.0 - self.signs.overlap
        feet = [winding(self.y, beyond, self.values, self.effects).foot for beyond in (self.signs.overlap, overlap)]
        self.signs = self.signs._replace(overlap=overlap)
        self.y = self.y._replace(free_length=self.y.free_length + feet[0] - feet[1])

    def _set_phase(self, mode: Mode) -> None:
        """Set the signs and phase with which a sliding ``mode`` begins."""
        if mode.sliding:
            slide = 1.0 if mode is Mode.SLIDING_UP else -1.0
            resting = abs(self.y.heavy_speed - self.y.rod_speed) <= TINY and not self.stretches
            self.signs = self.signs._replace(slide=slide, phase=0.0 if resting else 1.0)

    def _enter(self, mode: Mode) -> None:
        """Set the signs and phase with which ``mode`` begins."""
        if abs(self.y.rod_speed) > TINY:
            self.signs = self.signs._replace(rod_phase=1.0)
        if mode.sliding:
            self._set_phase(mode)
        elif mode.slack:
            falls_from_rest = mode is Mode.SLACK and self.y.heavy_speed == 0
            slack = self.y.slack if self.stretches else 0.0
            self.y = self.y._replace(heavy_speed=-TINY if falls_from_rest else self.y.heavy_speed, slack=slack)
            self.signs = self.signs._replace(heavy=1.0 if self.y.heavy_speed > 0 else -1.0, phase=0.0)
        self.mode = mode

    def _leave_rest(self) -> list[Segment]:
        """Take the first START seconds by series if the light mass starts at rest and |v| has a root there."""
        rate = equations.rates(self.xp, self.mode, self.t, self.y, self.signs, self.values, self.effects)
        if self.y.across_speed == 0:
            self.signs = self.signs._replace(across=1.0 if rate.across_speed >= 0 else -1.0)
        moving = any((self.y.across_speed, self.y.retreat_speed, self.y.sideways_speed))
        if moving or not (self.mode.string_moves or self.mode.slack or self.stretches):
            if self.y.across_speed == 0:
                self.y = self.y._replace(across_speed=self.y.across_speed + self.signs.across * TINY)
            return []
        turning = rate.across_speed / self.y.free_length
        tilting = rate.heavy_across_speed / self.parameters.hanging_length
        twice = State(
            free_length=rate.retreat_speed - self.parameters.rod_radius * turning,
            wrap_angle=turning,
            retreat_speed=0.0,
            across_speed=0.0,
            heavy_speed=0.0,
            slack=rate.heavy_speed - rate.retreat_speed,
            heavy_tilt=tilting,
        )
        series = (self.y, [START * r for r in rate], [0.5 * START**2 * r for r in twice])
        self.t, self.y = START, State(*map(sum, zip(*series, strict=True)))
        coefficients = np.array(series, dtype=float).T[None]
        return [Segment(mode=self.mode, signs=self.signs, times=np.array([0.0, START]), coefficients=coefficients)]

    def _record(self, event: Event | None, before: Mode, after: Mode | None = None) -> None:
        self.events.append(
            RunEvent(
                event=event,
                time=self.t,
                mode_before=before,
                mode_after=self.mode if after is None else after,
                state=self.y,
            )
        )

    def record(self) -> dict[str, Any]:
        """Fields of a `Run`."""
        return {
            "parameters": self.parameters,
            "integrator": self.integrator_name,
            "tolerance": self.tolerance,
            "events": tuple(self.events),
        }
