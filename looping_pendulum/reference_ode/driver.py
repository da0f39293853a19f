"""Drive one run from release to end: integrate one mode after another, as the transition table says."""

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
from looping_pendulum.reference_ode.solution import RunEvent, Segment, SegmentSamples
from looping_pendulum.reference_ode.state import Effects, Signs, State, extra_variables, winding
from looping_pendulum.reference_ode.transitions import Event, Mode, TransitionChoice, next_mode

MAX_EVENTS = 4000
"""Number of events after which a run is given up as endless."""
REST_SERIES_DURATION = 1e-6
"""Length of the step by which a run leaves rest [s]: |v| is not analytic at v = 0, so a series of second order takes it.

The next term of the series is of order REST_SERIES_DURATION^3.
"""
MARGIN_TOLERANCE = 1e-9
"""Margin within which a tension is on the edge of the friction cone where a string that stretches comes to rest [N]."""
RELATIVE_TENSION_TOLERANCE = 1e-14
"""Tension at release, as a fraction of the light mass's weight, that is zero but for rounding (-6e-17 at 90 deg)."""
TINY_SPEED = 1e-300
"""Speed that stands for zero with a sign [m/s]: the event function of the speed then starts beyond the root just handled."""


class Integrator(Protocol):
    """Integrates one mode until one of its events."""

    def advance(self, mode: Mode, t: float, y: State, signs: Signs, until: float) -> tuple[Event, float, State, Segment]:
        """Integrate ``mode`` from ``y`` at ``t`` [s] until an event, or past the time ``until`` [s]."""

    def advance_sampled(
        self, mode: Mode, t: float, y: State, signs: Signs, until: float, times: Array
    ) -> tuple[Event, float, State, SegmentSamples]:
        """Do the same as `advance`, but return samples at those ``times`` [s] after ``t`` that it reaches."""


class Driver:
    """Integrates one run from release to end. Its `record` is complete once `run_dense` or `run_sampled` has returned.

    Comparisons with 0 are of three kinds. Coefficients are as given, and signs and the speeds of what rests (or `TINY_SPEED`)
    were assigned, so these comparisons are exact. Tensions and margins are computed and have tolerances
    (`RELATIVE_TENSION_TOLERANCE`, `MARGIN_TOLERANCE`, `equations.FRICTION_CONE_TOLERANCE`). Other computed numbers are far from
    0, except where an event is only grazed; there both of the possible modes are right to rounding.
    """

    xp: Any = math
    """Math namespace for the numbers of the state (`dual` for derivatives, `numpy` for extended precision)."""

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
        self.rod_turns = "rod_speed" in extra_variables(self.effects)
        self.y = self._release_state()
        self.signs = Signs(slide=-1.0, across=-1.0 if self.y.across_speed < 0 else 1.0, heavy=-1.0, phase=0.0)
        self.string_stretches = "light_stretch" in extra_variables(self.effects)
        if self.string_stretches:
            self.y = equations.with_stretch_at_rest(self.xp, 0.0, self.y, self.signs, self.values, self.effects)
            if parameters.release is Release.HELD:  # what the clamp holds does not stretch
                self.y = self.y._replace(heavy_stretch=0.0)
        self.mode = self._release_mode()

    def run_dense(self) -> list[Segment]:
        """Run to the end; return the segments between the events, in order."""
        segments = self._start_run()
        for _ in range(MAX_EVENTS):
            event, self.t, self.y, segment = self.integrator.advance(self.mode, self.t, self.y, self.signs, self.duration)
            segments.append(segment)
            if self.t >= self.duration:
                # The last step may go beyond the limit: cut the run at it
                event, self.t = Event.TIME_UP, self.duration
                self.y = State(*segment.sample(np.array([self.t])).values[:, 0].tolist())
            if self._apply_event(event):
                return segments
        raise self._too_many_events()

    def run_sampled(self, times: Array) -> list[SegmentSamples]:
        """Run to the end; return samples at ``times`` [s], ascending, in parts between the events."""
        times = times[times <= self.duration]
        at_release = np.repeat(np.array(self.y, dtype=float)[:, None], np.count_nonzero(times == 0), axis=1)
        # The series step that leaves rest, if there is one, yields the samples within it
        early = times[: np.searchsorted(times, REST_SERIES_DURATION, side="right")]
        first_segments = self._start_run()
        if first_segments and early.any():
            parts = [segment.sample(early) for segment in first_segments]
        else:
            parts = [SegmentSamples(mode=self.mode, signs=self.signs, t=early[early == 0], values=at_release)]
        for _ in range(MAX_EVENTS):
            remaining_times = times[np.searchsorted(times, float(self.t), side="right") :]
            event, self.t, self.y, part = self.integrator.advance_sampled(
                self.mode, self.t, self.y, self.signs, self.duration, remaining_times
            )
            parts.append(part)
            if self._apply_event(event):
                return parts
        raise self._too_many_events()

    def _start_run(self) -> list[Segment]:
        """Record the release, enter its mode and leave rest; return the segment of the latter, if there is one."""
        self._record(None, self.mode)
        self._enter(self.mode)
        return self._leave_rest()

    def _too_many_events(self) -> IntegrationError:
        """Return the error of a run whose events do not end."""
        where = f"at t = {self.t:g} s, in mode {self.mode.name.lower()}"
        return IntegrationError(f"more than {MAX_EVENTS} events {where}; check the parameters")

    def _release_state(self) -> State:
        """Return the state at release, before a push along the string has acted on the heavy mass."""
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

    def _release_mode(self) -> Mode:
        """Return the mode at release; a push away from the rod acts on both masses as when a slack string becomes taut."""
        release, push = self.parameters.release, self.y.retreat_speed
        if release is Release.DROP:
            return Mode.FALLING
        if self.string_stretches:
            return Mode.CLAMPED if release is Release.HELD else Mode.SLIDING_DOWN
        slack = Mode.CLAMPED_SLACK if release is Release.HELD else Mode.SLACK
        if push < 0:
            return slack
        if release is Release.HELD:
            self.y = self.y._replace(retreat_speed=0.0)
            mode = Mode.CLAMPED
        elif push == 0:
            mode = self._stick_or_slide()
        else:
            mode = self._after_impulse()
            self._set_phase(mode)
        return mode if self._light_tension(mode) >= self._min_release_tension() else slack

    def _min_release_tension(self) -> float:
        """Return the least tension at which the string is taut at release [N].

        If the light mass does not move backwards the tension grows, so that a tension of zero, but for rounding, is the edge of
        a taut string. Taken for slack it would never become taut, as its slack neither opens nor closes.
        """
        weight: float = self.values.light_mass * self.values.gravity
        return -RELATIVE_TENSION_TOLERANCE * weight if self.y.across_speed >= 0 else 0.0

    def _float_arguments(self) -> tuple[Any, State, Signs, Any]:
        """Return time, state, signs and parameters as floats, from which the next mode is decided."""
        return self.t, self.y, self.signs, self.values

    def _light_tension(self, mode: Mode) -> float:
        return self._tensions(mode)[0]

    def _margins(self, mode: Mode) -> tuple[float, float]:
        return equations.holding_margins(math, *self._float_arguments(), self.effects, mode)

    def _stick_or_slide(self) -> Mode:
        """Return the mode of a string that does not slide now: sticking if the rod holds it, else the way it will slide."""
        if self.rod_turns:
            return self._stick_roll_or_slide()
        down, up = self._margins(Mode.STICKING)
        # A string that stretches slows down onto the edge of the friction cone, where a margin is 0 but for rounding
        min_margin = -MARGIN_TOLERANCE if self.string_stretches else 0.0
        if down < min_margin:
            return Mode.SLIDING_DOWN
        return Mode.SLIDING_UP if up < min_margin else Mode.STICKING

    def _stick_roll_or_slide(self) -> Mode:
        """Return the same as `_stick_or_slide` for a rod that can turn, and set the sign of its speed."""
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
        return equations.tensions(math, mode, *self._float_arguments(), self.effects)

    def _turn_rod(self, sign: float) -> None:
        """Let the rod begin to turn, towards the light side if ``sign`` is +1."""
        self.signs = self.signs._replace(rod=sign, rod_phase=0.0)
        self.y = self.y._replace(rod_speed=sign * TINY_SPEED)

    def _let_rod_turn(self, mode: Mode) -> None:
        """Let a rod at rest begin to turn if the friction of the string exceeds that of its bearing."""
        self.signs = self.signs._replace(rod=0.0)
        if mode.sliding:
            slide = 1.0 if mode is Mode.SLIDING_UP else -1.0
            self.signs = self.signs._replace(slide=slide)
            light, heavy = self._tensions(mode)
            if slide * (light - heavy) > self.values.bearing_friction:
                self._turn_rod(slide)

    def _after_impulse(self) -> Mode:
        """Apply an inelastic impulse along the string and return the mode after it.

        Exactly one of up, down and sticking is consistent; energy falls in each.
        """
        for mode, slide in ((Mode.SLIDING_UP, 1.0), (Mode.SLIDING_DOWN, -1.0)):
            after = self._impact(slide)
            if slide * after.sliding > 0:
                self._set_state_after_impulse(after.state)
                return mode
        self._set_state_after_impulse(self._impact(0.0).state)
        return self._stick_or_slide()

    def _impact(self, slide: float) -> equations.Impact:
        return equations.impact(self.xp, slide, self.t, self.y, self.signs, self.values, self.effects)

    def _set_state_after_impulse(self, state: State) -> None:
        """Continue from ``state``, just after an impulse, which may have set the rod in motion."""
        self.y = state
        if self.rod_turns:
            self.signs = self.signs._replace(rod=math.copysign(1.0, state.rod_speed) if state.rod_speed else 0.0)

    def _apply_event(self, event: Event) -> bool:
        """Apply ``event`` and record it; return whether the run is over."""
        before, following = self.mode, next_mode(self.mode, event)
        if following is Mode.ENDED:
            self._record(event, before, Mode.ENDED)
            return True
        if event is Event.ACROSS_REVERSES:
            self.signs = self.signs._replace(across=-self.signs.across)
            self.y = self.y._replace(across_speed=self.signs.across * TINY_SPEED)
        elif event is Event.HEAVY_REVERSES:
            self.signs = self.signs._replace(heavy=-self.signs.heavy)
            self.y = self.y._replace(heavy_speed=self.signs.heavy * TINY_SPEED)
        elif event in (Event.SLOWS, Event.CLOSES):
            self.signs = self.signs._replace(phase=1.0)
        elif event is Event.ROD_SLOWS:
            self.signs = self.signs._replace(rod_phase=1.0)
        elif event is Event.FIRST_TURN:
            self._cross_first_turn()
        elif event is Event.ROD_CHANGES:
            if self.signs.rod:
                self.y = self.y._replace(rod_speed=0.0)
                self._let_rod_turn(before)
            else:
                self._turn_rod(self.signs.slide)
        else:
            self._change_mode(event, following)
        self._record(event, before)
        return False

    def _change_mode(self, event: Event, following: Mode | TransitionChoice) -> None:
        """Set the speeds that ``event`` sets, and enter the mode that follows."""
        if self.string_stretches:
            if event is Event.TAUT and self.mode is Mode.SLACK:
                self.y = equations.with_even_stretch(self.xp, self.y, self.signs, self.values, self.effects)
        elif event is Event.STOP:
            self._set_string_speed(self.y.rod_speed if self.rod_turns else 0.0)
        elif event is Event.ROD_STOPS:
            self._set_string_speed(0.0)
            self.y = self.y._replace(rod_speed=0.0)
        elif event in (Event.ROD_YIELDS_UP, Event.ROD_YIELDS_DOWN):
            self._turn_rod(1.0 if event is Event.ROD_YIELDS_UP else -1.0)
        elif event is Event.TAUT and self.mode is Mode.CLAMPED_SLACK:
            self._set_state_after_impulse(self._impact(0.0).state)
        if following is TransitionChoice.BY_HOLDING:
            following = self._stick_or_slide()
        elif following is TransitionChoice.BY_IMPULSE:
            following = self._stick_or_slide() if self.string_stretches else self._after_impulse()
        assert isinstance(following, Mode)
        self._enter(following)
        # Other forces may still push the ends of the string together: then it is slack again at once
        if event is Event.TAUT and not self.string_stretches and not following.slack and self._light_tension(following) < 0:
            self._enter(Mode.CLAMPED_SLACK if following is Mode.CLAMPED else Mode.SLACK)

    def _set_string_speed(self, speed: float) -> None:
        """Give the heavy mass, and the string with it, exactly ``speed`` [m/s]: a root is found only to rounding."""
        moves_together = "sideways" not in extra_variables(self.effects)
        self.y = self.y._replace(heavy_speed=speed, retreat_speed=speed if moves_together else self.y.retreat_speed)

    def _cross_first_turn(self) -> None:
        """Change the overlap at a full turn, where the place at which the string leaves the rod jumps.

        The free length changes by as much, so that the light mass stays where it is.
        """
        overlap = 1.0 - self.signs.overlap
        feet = [winding(self.y, beyond, self.values, self.effects).foot for beyond in (self.signs.overlap, overlap)]
        self.signs = self.signs._replace(overlap=overlap)
        self.y = self.y._replace(free_length=self.y.free_length + feet[0] - feet[1])

    def _set_phase(self, mode: Mode) -> None:
        """Set the sign and the phase with which a sliding ``mode`` begins."""
        if mode.sliding:
            slide = 1.0 if mode is Mode.SLIDING_UP else -1.0
            resting = abs(self.y.heavy_speed - self.y.rod_speed) <= TINY_SPEED and not self.string_stretches
            self.signs = self.signs._replace(slide=slide, phase=0.0 if resting else 1.0)

    def _enter(self, mode: Mode) -> None:
        """Enter ``mode``, with the signs and the phase with which it begins."""
        if abs(self.y.rod_speed) > TINY_SPEED:
            self.signs = self.signs._replace(rod_phase=1.0)
        if mode.sliding:
            self._set_phase(mode)
        elif mode.slack:
            falls_from_rest = mode is Mode.SLACK and self.y.heavy_speed == 0
            slack = self.y.slack if self.string_stretches else 0.0
            self.y = self.y._replace(heavy_speed=-TINY_SPEED if falls_from_rest else self.y.heavy_speed, slack=slack)
            self.signs = self.signs._replace(heavy=1.0 if self.y.heavy_speed > 0 else -1.0, phase=0.0)
        self.mode = mode

    def _leave_rest(self) -> list[Segment]:
        """Take the first `REST_SERIES_DURATION` by a series if the light mass starts at rest, where |v| is not analytic."""
        rate = equations.rates(self.xp, self.mode, self.t, self.y, self.signs, self.values, self.effects)
        if self.y.across_speed == 0:
            self.signs = self.signs._replace(across=1.0 if rate.across_speed >= 0 else -1.0)
        moving = any((self.y.across_speed, self.y.retreat_speed, self.y.sideways_speed))
        if moving or not (self.mode.string_moves or self.mode.slack or self.string_stretches):
            if self.y.across_speed == 0:
                self.y = self.y._replace(across_speed=self.y.across_speed + self.signs.across * TINY_SPEED)
            return []
        # Speeds grow linearly from rest, so that what they move has these second derivatives
        turning = rate.across_speed / self.y.free_length
        tilting = rate.heavy_across_speed / self.parameters.hanging_length
        second_derivatives = State(
            free_length=rate.retreat_speed - self.parameters.rod_radius * turning,
            wrap_angle=turning,
            retreat_speed=0.0,
            across_speed=0.0,
            heavy_speed=0.0,
            slack=rate.heavy_speed - rate.retreat_speed,
            heavy_tilt=tilting,
        )
        series = (
            self.y,
            [REST_SERIES_DURATION * r for r in rate],
            [0.5 * REST_SERIES_DURATION**2 * r for r in second_derivatives],
        )
        self.t, self.y = REST_SERIES_DURATION, State(*map(sum, zip(*series, strict=True)))
        coefficients = np.array(series, dtype=float).T[None]
        return [
            Segment(mode=self.mode, signs=self.signs, times=np.array([0.0, REST_SERIES_DURATION]), coefficients=coefficients)
        ]

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
        """Return the fields of a `Run`."""
        return {
            "parameters": self.parameters,
            "integrator": self.integrator_name,
            "tolerance": self.tolerance,
            "events": tuple(self.events),
        }
