"""Solve the model: the functions that all other parts call, and the driver, which integrates one mode after another."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any, TypeVar

import numpy as np

from looping_pendulum.errors import IntegrationError, IntegratorFallbackWarning, IntegratorGaveUpError, MissingPackageError
from looping_pendulum.installation import install_command
from looping_pendulum.reference_ode import rules
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_backend import HeyokaIntegrator
from looping_pendulum.reference_ode.parameters import HasParameters, Parameters, parameters_of
from looping_pendulum.reference_ode.scipy_backend import ScipyIntegrator
from looping_pendulum.reference_ode.solution import Run, RunEvent, Samples, Segment, SegmentSamples, Solution, join_samples
from looping_pendulum.reference_ode.state import Effects, Motion, State
from looping_pendulum.reference_ode.transitions import Event, Mode

T = TypeVar("T")

# heyoka and SciPy then agree within 1e-9 m and s up to the halt, 1e-7 m to the end (tests/reference_ode/test_solve.py)
TOLERANCE = 1e-12
"""Default relative tolerance of a step."""
DURATION = 5.0
"""Default limit on the simulated time [s]; most runs end long before, when the light mass reaches the rod."""
# Far above need: of the shipped scenarios, `frictionless` has the most events, 19
MAX_EVENTS = 4000
"""Number of events after which a run is given up as endless."""


def solve(
    parameters: Parameters | HasParameters,
    *,
    duration: float = DURATION,
    tolerance: float = TOLERANCE,
    integrator: str = "auto",
) -> Solution:
    """Integrate the equations of all modes from the release until the run ends or ``duration`` [s] is over.

    Parameters
    ----------
    parameters
        Apparatus, release and coefficients; or a scenario, which has them.
    duration
        Limit on the simulated time [s].
    tolerance
        Relative tolerance of a step.
    integrator
        "heyoka", "scipy", or "auto": heyoka where it is installed; a run at which it gives up is handed to SciPy, with a
        `IntegratorFallbackWarning`, and says so (`Run.handed_over`).

    Raises
    ------
    IntegrationError
        If the integration breaks down or the events do not end.
    MissingPackageError
        If heyoka is asked for by name and not installed.
    """
    solution = solve_without_warning(parameters_of(parameters), duration=duration, tolerance=tolerance, integrator=integrator)
    _warn_if_handed_over(solution)
    return solution


def solve_without_warning(
    parameters: Parameters, *, duration: float = DURATION, tolerance: float = TOLERANCE, integrator: str = "auto"
) -> Solution:
    """Do the same as `solve` without a warning if SciPy takes over; `Run.handed_over` says so."""
    record, segments = _run_driver(parameters, duration, tolerance, integrator, Driver.run_dense)
    return Solution(**record, segments=tuple(segments))


def solve_at(
    parameters: Parameters | HasParameters,
    t: Array,
    *,
    duration: float = DURATION,
    tolerance: float = TOLERANCE,
    integrator: str = "auto",
) -> Samples:
    """Integrate as `solve` does, but keep only samples at times ``t`` [s], ascending; this is faster for many runs.

    Times after the run's end are left out, so the samples may be fewer than the times.
    """
    times = np.asarray(t, dtype=float)
    record, parts = _run_driver(
        parameters_of(parameters), duration, tolerance, integrator, lambda driver: driver.run_sampled(times)
    )
    run = Run(**record)
    _warn_if_handed_over(run)
    return join_samples(run, parts)


def _run_driver(
    parameters: Parameters, duration: float, tolerance: float, integrator: str, drive: Callable[[Driver], T]
) -> tuple[dict[str, Any], T]:
    """Run to the end; return the fields of the `Run`, and what ``drive`` returned.

    With integrator "auto", if heyoka gives up, SciPy solves the whole run again: near some ends Taylor steps become too short
    to arrive, while those of DOP853 do not.
    """
    chosen = _resolve_integrator(integrator)
    driver = Driver(parameters, duration, tolerance, chosen)
    try:
        driven = drive(driver)
    except IntegratorGaveUpError as error:
        if integrator != "auto" or chosen == "scipy":
            raise
        driver = Driver(parameters, duration, tolerance, "scipy")
        driven = drive(driver)
        return driver.record() | {"handed_over": f"{chosen} gave up ({error}), so SciPy solved this run"}, driven
    return driver.record(), driven


def _warn_if_handed_over(run: Run) -> None:
    if run.handed_over:
        warnings.warn(IntegratorFallbackWarning(run.handed_over), stacklevel=3)


@cache
def available_integrators() -> tuple[str, ...]:
    """Return the integrators that are installed, the default first."""
    # Looked for, not imported, as the import is slow
    return ("heyoka", "scipy") if find_spec("heyoka") else ("scipy",)


def _resolve_integrator(integrator: str) -> str:
    """Return the name of the integrator to use; refuse one that is unknown or not installed."""
    name = available_integrators()[0] if integrator == "auto" else integrator
    if name not in ("heyoka", "scipy"):
        raise ValueError(f"integrator: found {integrator!r}, needed 'heyoka', 'scipy' or 'auto'")
    if name not in available_integrators():
        require_heyoka("integrator='heyoka'", instead="integrator='scipy'")
    return name


def require_heyoka(what: str, instead: str = "") -> None:
    """Raise `MissingPackageError` if heyoka, which ``what`` needs, is not installed; ``instead`` can do without it."""
    if "heyoka" not in available_integrators():
        way_out = f" (Linux only), or use {instead}" if instead else " (Linux only)"
        raise MissingPackageError(f"{what}: heyoka is not installed; to get it: `{install_command('heyoka')}`{way_out}")


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
        self.integrator: HeyokaIntegrator | ScipyIntegrator = backend(self.values, self.effects, tolerance)
        self.events: list[RunEvent] = []
        self.system = self._make_system()
        self.motion = rules.release(self.system, parameters.release, self._state_at_release())
        """Where the run stands."""

    def _make_system(self) -> rules.HybridSystem:
        """Return the equations as the rules ask them."""
        return rules.system_of_floats(self.values, self.effects)

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
        """Do what `HeyokaIntegrator.advance_sampled` does, past the turning points of a swing, and record these.

        Raises
        ------
        IntegrationError
            If there were too many.
        """
        mode, _, _, signs = self.motion

        def sign_after_turn(t: float, y: State) -> float:
            return float(rules.across_after_turn(self.system, mode, self.motion._replace(t=t, y=y)))

        choose_sign = None if rules.turning_back_reverses(self.system, mode) else sign_after_turn
        event, t, y, part, turns = integrator.advance_past_turns(*self.motion[1:], self.duration, times, choose_sign)
        self.events += [
            RunEvent(event=Event.ACROSS_REVERSES, time=now, mode_before=mode, mode_after=mode, state=State(*state))
            for now, state in zip(turns.times.tolist(), turns.states.T.tolist(), strict=True)
        ]
        if len(self.events) > MAX_EVENTS:
            raise self._too_many_events()
        if len(turns.across):
            self.motion = self.motion._replace(signs=signs._replace(across=float(turns.across[-1])))
        return event, t, y, part

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
