"""Drive one run from release to end: integrate one mode after another, as the transition table says."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from looping_pendulum.errors import IntegrationError
from looping_pendulum.reference_ode import rules
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_backend import HeyokaIntegrator
from looping_pendulum.reference_ode.hybrid_system import SingleRunSystem, system_of_floats
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.scipy_backend import ScipyIntegrator
from looping_pendulum.reference_ode.solution import RunEvent, Segment, SegmentSamples
from looping_pendulum.reference_ode.state import Effects, Motion, Signs, State
from looping_pendulum.reference_ode.transitions import Event, Mode

# Far above need: of the shipped scenarios, `frictionless` has the most events, 19
MAX_EVENTS = 4000
"""Number of events after which a run is given up as endless."""


class Integrator(Protocol):
    """Integrates one mode until one of its events."""

    def advance(self, mode: Mode, t: float, y: State, signs: Signs, until: float) -> tuple[Event, float, State, Segment]:
        """Integrate ``mode`` from ``y`` at ``t`` [s] until an event, or past the time ``until`` [s]."""

    def advance_sampled(
        self, mode: Mode, t: float, y: State, signs: Signs, until: float, times: Array
    ) -> tuple[Event, float, State, SegmentSamples]:
        """Do the same as `advance`, but return samples at those ``times`` [s] after ``t`` that it reaches."""


class Driver:
    """Integrates one run from release to end. Its `record` is complete once `run_dense` or `run_sampled` has returned."""

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
        self.system = self._make_system()
        self.motion = rules.release(self.system, parameters.release, self._state_at_release())
        """Where the run stands."""

    def _make_system(self) -> SingleRunSystem:
        """Return the equations as the rules ask them."""
        return system_of_floats(self.values, self.effects)

    def _state_at_release(self) -> State:
        """Return the state at release, before a push along the string has acted on the heavy mass."""
        return rules.state_at_release(self.parameters)

    def run_dense(self) -> list[Segment]:
        """Run to the end; return the segments between the events, in order."""
        first_segment = self._start_run()
        segments = [] if first_segment is None else [first_segment]
        for _ in range(MAX_EVENTS):
            event, t, y, segment = self.integrator.advance(*self.motion, self.duration)
            segments.append(segment)
            if t >= self.duration:
                # The last step may go beyond the limit: cut the run at it
                event, t = Event.TIME_UP, self.duration
                y = State(*segment.sample(np.array([t])).values[:, 0].tolist())
            if self._apply_event(event, t, y):
                return segments
        raise self._too_many_events()

    def run_sampled(self, times: Array) -> list[SegmentSamples]:
        """Run to the end; return samples at ``times`` [s], ascending, in parts between the events."""
        times = times[times <= self.duration]
        # An integrator returns samples after its start only, so that those at t = 0 come from the release itself
        at_release = np.repeat(np.array(self.motion.y, dtype=float)[:, None], np.count_nonzero(times == 0), axis=1)
        # The series step that leaves rest, if there is one, yields the samples within it
        early = times[: times.searchsorted(rules.REST_SERIES_DURATION, side="right")]
        first_segment = self._start_run()
        if first_segment is not None and early.any():
            parts = [first_segment.sample(early)]
        else:
            mode, signs = self.motion.mode, self.motion.signs
            parts = [SegmentSamples(mode=mode, signs=signs, t=early[early == 0], values=at_release)]
        for _ in range(MAX_EVENTS):
            # As a float: the time may be a dual number. "right": the part before has the sample at the very time of the event
            remaining_times = times[times.searchsorted(float(self.motion.t), side="right") :]
            if self.motion.mode is Mode.CLAMPED and type(self.integrator) is HeyokaIntegrator:
                event, t, y, part = self._pass_turns(self.integrator, remaining_times)
            else:
                event, t, y, part = self.integrator.advance_sampled(*self.motion, self.duration, remaining_times)
            parts.append(part)
            if self._apply_event(event, t, y):
                return parts
        raise self._too_many_events()

    def _pass_turns(self, integrator: HeyokaIntegrator, times: Array) -> tuple[Event, float, State, SegmentSamples]:
        """Do what `Integrator.advance_sampled` does, past the turning points of a swing, and record these.

        Raises
        ------
        IntegrationError
            If there were too many.
        """
        mode, _, _, signs = self.motion
        sign_after_turn = None if rules.turning_back_reverses(self.system, mode) else self._sign_after_turn
        event, t, y, part, turns = integrator.advance_past_turns(*self.motion[1:], self.duration, times, sign_after_turn)
        self.events += [
            RunEvent(event=Event.ACROSS_REVERSES, time=now, mode_before=mode, mode_after=mode, state=State(*state))
            for now, state in zip(turns.times.tolist(), turns.states.T.tolist(), strict=True)
        ]
        if len(self.events) > MAX_EVENTS:
            raise self._too_many_events()
        if len(turns.across):
            self.motion = self.motion._replace(signs=signs._replace(across=float(turns.across[-1])))
        return event, t, y, part

    def _sign_after_turn(self, t: float, y: State) -> float:
        return float(rules.across_after_turn(self.system, self.motion.mode, self.motion._replace(t=t, y=y)))

    def _start_run(self) -> Segment | None:
        """Record the release, enter its mode and leave rest; return the segment of the latter, if there is one."""
        self._record(None, self.motion.mode)
        self.motion, series, by_series = rules.leave_rest(self.system, rules.enter(self.system, self.motion))
        if not by_series:
            return None
        return Segment(
            mode=self.motion.mode,
            signs=self.motion.signs,
            times=np.array([0.0, rules.REST_SERIES_DURATION]),
            coefficients=np.array(series, dtype=float).T[None],
        )

    def _too_many_events(self) -> IntegrationError:
        """Return the error of a run whose events do not end."""
        where = f"at t = {self.motion.t:g} s, in mode {self.motion.mode.name.lower()}"
        return IntegrationError(f"more than {MAX_EVENTS} events {where}; check the parameters")

    def _apply_event(self, event: Event, t: Any, y: State) -> bool:
        """Apply ``event``, which happens at ``t`` [s] in the state ``y``, and record it; return whether the run is over."""
        before = self.motion.mode
        self.motion = rules.apply_event(self.system, before, event, Motion(before, t, y, self.motion.signs))
        self._record(event, before)
        return self.motion.mode is Mode.ENDED

    def _record(self, event: Event | None, before: Mode) -> None:
        mode, t, y, _ = self.motion
        self.events.append(RunEvent(event=event, time=t, mode_before=before, mode_after=mode, state=y))

    def record(self) -> dict[str, Any]:
        """Return the fields of a `Run`."""
        return {
            "parameters": self.parameters,
            "integrator": self.integrator_name,
            "tolerance": self.tolerance,
            "events": tuple(self.events),
        }
