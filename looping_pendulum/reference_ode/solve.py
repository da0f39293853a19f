"""Drive a run from release to end: one mode after another, as the transition table says."""

from __future__ import annotations

import math
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np

from looping_pendulum.errors import IntegrationError, MissingPackageError
from looping_pendulum.reference_ode import equations
from looping_pendulum.reference_ode.equations import Effects, Signs, State
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_backend import HeyokaIntegrator
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.scipy_backend import ScipyIntegrator
from looping_pendulum.reference_ode.solution import Part, Run, RunEvent, Samples, Segment, Solution, join
from looping_pendulum.reference_ode.transitions import Choice, Event, Mode, next_mode

TOLERANCE = 1e-12
DURATION = 5.0
"""Default limit on the simulated time [s]; most runs end long before, when the light mass reaches the rod."""
MAX_EVENTS = 4000
START = 1e-6
"""Length of the series step that leaves rest [s]: |v| is not analytic at v = 0. The series' next term is of order START^3."""
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


def solve(
    parameters: Parameters, *, duration: float = DURATION, tolerance: float = TOLERANCE, integrator: str = "auto"
) -> Solution:
    """Integrate the hybrid model from its release until it ends or ``duration`` [s] is over.

    Parameters
    ----------
    parameters
        Apparatus, release and coefficients.
    duration
        Limit on the simulated time [s].
    tolerance
        Relative tolerance of a step.
    integrator
        "heyoka", "scipy", or "auto": heyoka where it is installed.

    Raises
    ------
    IntegrationError
        If the run breaks down or its events do not end.
    MissingPackageError
        If heyoka is asked for by name and not installed.
    """
    driver = _Driver(parameters, duration, tolerance, integrator)
    segments = driver.run_dense()
    return Solution(**driver.record(), segments=tuple(segments))


def solve_at(
    parameters: Parameters,
    t: Array,
    *,
    duration: float = DURATION,
    tolerance: float = TOLERANCE,
    integrator: str = "auto",
) -> Samples:
    """Integrate as `solve` does, but only keep the samples at times ``t`` [s], ascending: faster where many runs are needed.

    Times after the run's end are left out, so the samples may be fewer than the times.
    """
    driver = _Driver(parameters, duration, tolerance, integrator)
    parts = driver.run_sampled(np.asarray(t, dtype=float))
    return join(Run(**driver.record()), parts)


def available_integrators() -> tuple[str, ...]:
    """Names that `solve` takes here, the default first."""
    return ("heyoka", "scipy") if find_spec("heyoka") else ("scipy",)


class _Driver:
    """The state of one run while it goes on."""

    def __init__(self, parameters: Parameters, duration: float, tolerance: float, integrator: str) -> None:
        name = available_integrators()[0] if integrator == "auto" else integrator
        if name not in ("heyoka", "scipy"):
            raise ValueError(f"integrator: found {integrator!r}, needed 'heyoka', 'scipy' or 'auto'")
        if name not in available_integrators():
            raise MissingPackageError("heyoka is not installed: `pip install heyoka` (Linux x86-64), or use integrator='scipy'")
        self.parameters = parameters
        self.values = parameters.values()
        self.effects: Effects = parameters.effects
        self.duration = duration
        self.tolerance = tolerance
        self.integrator_name = name
        backend = HeyokaIntegrator if name == "heyoka" else ScipyIntegrator
        self.integrator: Integrator = backend(self.values, self.effects, tolerance)
        self.events: list[RunEvent] = []
        self.t = 0.0
        self.y = State(parameters.free_length, parameters.release_angle, 0.0, 0.0, 0.0, 0.0)
        self.signs = Signs(slide=-1.0, across=1.0, heavy=-1.0, phase=0.0)
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
        at_release = np.repeat(np.array(self.y)[:, None], np.count_nonzero(times == 0), axis=1)
        parts = [segment.sample(times[times <= START]) for segment in self._begin()]
        if not parts:
            parts = [Part(mode=self.mode, signs=self.signs, t=times[times == 0], values=at_release)]
        for _ in range(MAX_EVENTS):
            ahead = times[np.searchsorted(times, self.t, side="right") :]
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

    def _released_mode(self) -> Mode:
        release = self.parameters.release
        if release is Release.DROP:
            return Mode.FALLING
        if release is Release.HELD:
            return Mode.CLAMPED if self._light_tension(Mode.CLAMPED) >= 0 else Mode.CLAMPED_SLACK
        return self._held_or_sliding()

    def _light_tension(self, mode: Mode) -> float:
        return float(equations.tensions(math, mode, self.t, self.y, self.signs, self.values, self.effects)[0])

    def _held_or_sliding(self) -> Mode:
        """Choice.BY_HOLDING: whether the rod holds the resting string, and if not which way it slides."""
        down, up = equations.holding_margins(math, self.t, self.y, self.signs, self.values, self.effects)
        if down < 0:
            return Mode.SLIDING_DOWN
        return Mode.SLIDING_UP if up < 0 else Mode.STICKING

    def _after_impulse(self) -> Mode:
        """Choice.BY_IMPULSE: exactly one of up, down and stick is consistent; energy falls in each."""
        for mode, slide in ((Mode.SLIDING_UP, 1.0), (Mode.SLIDING_DOWN, -1.0)):
            speed = equations.retaut_speed(math, slide, self.t, self.y, self.signs, self.values, self.effects)
            if slide * speed > 0:
                self.y = self.y._replace(retreat_speed=speed, heavy_speed=speed, slack=0.0)
                return mode
        self.y = self.y._replace(retreat_speed=0.0, heavy_speed=0.0, slack=0.0)
        return self._held_or_sliding()

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
        else:
            self._change(event, following)
        self._record(event, before)
        return False

    def _change(self, event: Event, following: Mode | Choice) -> None:
        """Change the mode, and the speeds that the event sets."""
        if event is Event.STOP:
            self.y = self.y._replace(retreat_speed=0.0, heavy_speed=0.0)
        if event is Event.TAUT and self.mode is Mode.CLAMPED_SLACK:
            self.y = self.y._replace(retreat_speed=0.0, heavy_speed=0.0, slack=0.0)
        if following is Choice.BY_HOLDING:
            following = self._held_or_sliding()
        elif following is Choice.BY_IMPULSE:
            following = self._after_impulse()
        assert isinstance(following, Mode)
        self._enter(following)
        if event is Event.TAUT and not following.slack and self._light_tension(following) < 0:
            self._enter(Mode.CLAMPED_SLACK if following is Mode.CLAMPED else Mode.SLACK)

    def _enter(self, mode: Mode) -> None:
        """Set the signs and phase with which ``mode`` begins."""
        if mode.sliding:
            slide = 1.0 if mode is Mode.SLIDING_UP else -1.0
            self.signs = self.signs._replace(slide=slide, phase=0.0 if self.y.retreat_speed == 0 else 1.0)
        elif mode.slack:
            heavy = 0.0 if mode is Mode.CLAMPED_SLACK else self.y.retreat_speed
            self.y = self.y._replace(heavy_speed=heavy, slack=0.0)
            self.signs = self.signs._replace(heavy=1.0 if heavy > 0 else -1.0, phase=0.0)
        self.mode = mode

    def _leave_rest(self) -> list[Segment]:
        """Take the first START seconds by series if the light mass starts at rest and |v| has a root there."""
        rate = equations.rates(math, self.mode, self.t, self.y, self.signs, self.values, self.effects)
        across = rate.across_speed
        self.signs = self.signs._replace(across=1.0 if across >= 0 else -1.0)
        if not (self.mode.sliding or self.mode.slack):
            self.y = self.y._replace(across_speed=self.signs.across * TINY)
            return []
        along, heavy = rate.retreat_speed, rate.heavy_speed
        turning = across / self.y.free_length
        half = 0.5 * START**2
        series = np.zeros((len(State._fields), 3))
        series[:, 0] = self.y
        series[:, 1] = State(0.0, 0.0, along * START, across * START, heavy * START, 0.0)
        growth = along - self.parameters.rod_radius * turning
        series[:, 2] = State(growth * half, turning * half, 0.0, 0.0, 0.0, (heavy - along) * half)
        self.t, self.y = START, State(*series.sum(axis=1).tolist())
        return [Segment(mode=self.mode, signs=self.signs, times=np.array([0.0, START]), coefficients=series[None])]

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
