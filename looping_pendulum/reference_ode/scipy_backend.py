"""Integrate one mode with SciPy's DOP853: slower, but everywhere, and a check on heyoka that shares only the equations."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from looping_pendulum.errors import IntegrationError
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.solution import Segment, SegmentSamples
from looping_pendulum.reference_ode.state import (
    Effects,
    Signs,
    State,
    event_in_phase,
    fill_in_heavy_speed,
    full_state,
    variables,
)
from looping_pendulum.reference_ode.transitions import Event, Mode

NAME = "scipy"
MAX_STEPS = 200_000
"""Number of steps in one mode after which a run is given up."""
FIRST_STEP = 1e-6
"""First step in a mode [s], short enough for any release."""
DEGREE = 7
"""Degree of DOP853's dense output."""
CHECKS = np.linspace(0.0, 1.0, 9)
"""Fractions of a step at which event functions are evaluated, so that two crossings within one step are seen."""
BETWEEN = np.linspace(0.0, 1.0, 65)
"""Fractions of a step at which the polynomial through the values at `CHECKS` is evaluated, to find a dip between them."""
DIP_THRESHOLD = 0.01
"""Fraction of a function's largest value in a step; a dip between `CHECKS` that is lower is minimized by `minimize_scalar`."""
MIN_DIP_DEPTH = 1e-6
"""Fraction of the same by which a minimum must be below zero: rounding moves a function that rises from zero by less."""

# Values at `CHECKS` -> values of the interpolating polynomial at `BETWEEN`
_BETWEEN_FROM_CHECKS = np.vander(BETWEEN, len(CHECKS)) @ np.linalg.inv(np.vander(CHECKS, len(CHECKS)))
# Chebyshev nodes on [0, 1]; values there -> coefficients of ascending powers, which `Segment` stores. Any DEGREE + 1 points
# would determine the polynomial; with these the conversion is well conditioned.
_NODES = 0.5 - 0.5 * np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
_TO_POWERS = np.linalg.inv(np.vander(_NODES, DEGREE + 1, increasing=True))


class ScipyIntegrator:
    """Integrates a mode until one of its events."""

    def __init__(self, values: SimpleNamespace, effects: Effects, tolerance: float) -> None:
        self._effects = effects
        self._of_numbers, self._of_arrays = (Equations(xp, values, effects) for xp in (math, np))
        self._tolerance = max(tolerance, 1e-13)  # DOP853 warns below about 2e-14 and gains nothing

    def advance(self, mode: Mode, t: float, y: State, signs: Signs, until: float) -> tuple[Event, float, State, Segment]:
        """Integrate ``mode`` from ``y`` at ``t`` [s] until an event, or past the time ``until`` [s].

        Raises
        ------
        IntegrationError
            If the step size collapses or the steps do not end.
        """
        from scipy.integrate import DOP853

        names = variables(mode, self._effects)
        rows = [State._fields.index(name) for name in names]
        solver = DOP853(
            self._rates(mode, names, signs),
            t,
            np.array([float(y[i]) for i in rows]),
            # No bound: a mode ends at an event, or at the first step past ``until``
            np.inf,
            rtol=self._tolerance,
            atol=0.1 * self._tolerance,  # values near 0 count as 0.1 m, rad or m/s
            first_step=FIRST_STEP,
        )
        times: list[float] = [t]
        steps: list[Array] = []
        for _ in range(MAX_STEPS):
            message = solver.step()
            if solver.status == "failed":
                raise IntegrationError(f"{mode.name.lower()}: {message}")
            polynomial = self._polynomial(mode, names, solver.dense_output(), solver.t_old, solver.t)
            event, fraction = self._first_event(mode, (solver.t_old, solver.t), polynomial, signs, dips=bool(steps))
            # The last step ends at the event: rescale its polynomial to the shorter step
            if fraction < 1:
                polynomial = polynomial * fraction ** np.arange(DEGREE + 1)
            steps.append(polynomial)
            times.append(float(solver.t_old + fraction * (solver.t - solver.t_old)))
            if event is not None or solver.t >= until:
                segment = Segment(mode=mode, signs=signs, times=np.array(times), coefficients=np.array(steps))
                # The sum of all coefficients is the value at fraction 1
                return event or Event.TIME_UP, times[-1], State(*polynomial.sum(axis=1).tolist()), segment
        raise IntegrationError(f"{mode.name.lower()}: no event within {MAX_STEPS} steps")

    def advance_sampled(
        self, mode: Mode, t: float, y: State, signs: Signs, until: float, times: Array
    ) -> tuple[Event, float, State, SegmentSamples]:
        """Do the same as `advance`, but return samples at those ``times`` [s] after ``t`` that it reaches."""
        event, end, final, segment = self.advance(mode, t, y, signs, until)
        return event, end, final, segment.sample(times[times <= end])

    def _rates(self, mode: Mode, names: tuple[str, ...], signs: Signs) -> Callable[[float, Array], list[float]]:
        """Return the right-hand side of the differential equations, f(t, y), of the variables ``names``."""
        rows = [State._fields.index(name) for name in names]

        def rates(now: float, values: Array) -> list[float]:
            y = full_state(mode, **dict(zip(names, values.tolist(), strict=True)))
            derivative = self._of_numbers.rates(mode, now, y, signs)
            return [derivative[i] for i in rows]

        return rates

    def _polynomial(
        self, mode: Mode, names: tuple[str, ...], dense: Callable[[Array], Array], start: float, stop: float
    ) -> Array:
        """Return DOP853's dense output of one step as coefficients of ascending powers of its fraction.

        Their shape is (len(State), DEGREE + 1).
        """
        full = np.zeros((len(State._fields), DEGREE + 1))
        full[[State._fields.index(name) for name in names]] = dense(start + (stop - start) * _NODES) @ _TO_POWERS.T
        fill_in_heavy_speed(mode, names, full)
        return full

    def _first_event(
        self, mode: Mode, ends: tuple[float, float], polynomial: Array, signs: Signs, *, dips: bool
    ) -> tuple[Event | None, float]:
        """Return the first event within a step and the fraction of the step at which it happens; (None, 1) without one.

        Without ``dips``, dips between `CHECKS` are ignored: in a mode's first step a function that starts at zero is all
        rounding.
        """
        from scipy.optimize import brentq, minimize_scalar

        def event_values(x: Array) -> dict[Event, Array]:
            """Return the event functions at the fractions ``x`` of the step."""
            y = State(*(polynomial @ np.vander(x, DEGREE + 1, increasing=True).T))
            t = ends[0] + x * (ends[1] - ends[0])
            functions = self._of_arrays.event_functions(mode, t, y, signs)
            return {event: np.broadcast_to(values, x.shape) for event, values in functions.items()}

        first: tuple[Event | None, float] = None, 1.0
        for event, values in event_values(CHECKS).items():

            def value(x: float, event: Event = event) -> float:
                return float(event_values(np.array([x]))[event][0])

            falls = np.flatnonzero((values[:-1] > 0) & (values[1:] <= 0))
            before, after = (CHECKS[falls[0]], CHECKS[falls[0] + 1]) if falls.size else (1.0, 1.0)
            between = _BETWEEN_FROM_CHECKS @ values
            lowest = int(np.argmin(between[BETWEEN <= before]))
            # A function that only just falls through zero may be back above it at the next of the checks.
            largest = float(np.max(np.abs(values)))
            if dips and values[0] > 0 and between[lowest] < DIP_THRESHOLD * largest and 0 < lowest < len(BETWEEN) - 1:
                bounds = BETWEEN[lowest - 1], min(BETWEEN[lowest + 1], before)
                minimum = float(minimize_scalar(value, bounds=bounds, method="bounded", options={"xatol": 1e-9}).x)
                if value(minimum) <= -MIN_DIP_DEPTH * largest:
                    before, after = float(np.max(CHECKS[CHECKS < minimum])), minimum
            if after > before:
                root = brentq(value, before, after, xtol=1e-15, rtol=1e-15)
                if first[0] is None or root < first[1]:
                    first = event, float(root)
        return (None if first[0] is None else event_in_phase(first[0], signs)), first[1]
