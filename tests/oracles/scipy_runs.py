"""Runs by SciPy's DOP853 over the model's equations and rules: a check on the core that needs nothing but SciPy."""

import math

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq, minimize_scalar

from looping_pendulum.errors import IntegrationError
from looping_pendulum.reference_ode import rules
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.solve import DURATION
from looping_pendulum.reference_ode.state import State, event_in_phase, full_state, variables
from looping_pendulum.reference_ode.transitions import Event
from research.driver import drive, fill_in_heavy_speed, join

MAX_STEPS = 200_000
"""Number of steps in one mode after which a run is given up."""
FIRST_STEP = 1e-6
"""First step in a mode [s], short enough for any release."""
CHECKS = np.linspace(0.0, 1.0, 17)
"""Fractions of a step at which event functions are evaluated, so that two crossings within one step are seen."""
DIP_THRESHOLD = 0.05
"""Fraction of a function's largest value in a step below which a lowest of the checks is looked at for a dip through zero."""
MIN_DIP_DEPTH = 1e-6
"""Fraction of the same by which a minimum must be below zero: rounding moves a function that rises from zero by less."""


def solve_at(parameters, t, *, duration=DURATION, tolerance=1e-12):
    """Do what the package's `solve_at` does."""
    p, effects = parameters.values(), parameters.effects
    system = rules.system_of_floats(p, effects)
    released = rules.release(system, parameters.release, rules.state_at_release(parameters))
    integrator = ScipyIntegrator(p, effects, tolerance)
    return join(parameters, tolerance, *drive(system, released, integrator, np.asarray(t, dtype=float), duration))


def solve(parameters, *, duration=DURATION, tolerance=1e-12):
    """Return the events of the run of `solve_at`."""
    return solve_at(parameters, np.zeros(0), duration=duration, tolerance=tolerance).run


class ScipyIntegrator:
    """Integrates a mode until one of its events; `research.driver.ModeIntegrator` says what `advance` does."""

    number_type = float

    def __init__(self, p, effects, tolerance):
        self.effects = effects
        self.of_numbers, self.of_arrays = (Equations(xp, p, effects) for xp in (math, np))
        self.tolerance = max(tolerance, 1e-13)  # DOP853 warns below about 2e-14 and gains nothing

    def advance(self, m, until, times):
        names = variables(m.mode, self.effects)
        rows = [State._fields.index(name) for name in names]

        def rates(t, values):
            y = full_state(m.mode, **dict(zip(names, values.tolist(), strict=True)))
            derivative = self.of_numbers.rates(m.mode, t, y, m.signs)
            return [derivative[i] for i in rows]

        # No bound: a mode ends at an event, or at the first step past ``until``. Values near 0 count as 0.1 m, rad or m/s.
        options = {"rtol": self.tolerance, "atol": 0.1 * self.tolerance, "first_step": FIRST_STEP}
        solver = DOP853(rates, m.t, np.array([m.y[i] for i in rows]), np.inf, **options)
        samples = [np.zeros((len(State._fields), 0))]
        for step in range(MAX_STEPS):
            message = solver.step()
            if solver.status == "failed":
                raise IntegrationError(f"{m.mode.name.lower()}: {message}")
            dense = solver.dense_output()

            def state_at(t, dense=dense):
                """Return whole states at the times ``t`` [s] within the step, shape (len(State), n)."""
                full = np.zeros((len(State._fields), len(t)))
                full[rows] = dense(t)
                fill_in_heavy_speed(m.mode, names, full)
                return full

            event, end = self.first_event(m, solver.t_old, solver.t, state_at, dips=step > 0)
            if end >= until:
                event, end = Event.TIME_UP, until
            samples.append(state_at(times[(times > solver.t_old) & (times <= end)]))
            if event is not None:
                return event, end, State(*state_at(np.array([end]))[:, 0].tolist()), np.concatenate(samples, axis=1)
        raise IntegrationError(f"{m.mode.name.lower()}: no event within {MAX_STEPS} steps")

    def first_event(self, m, start, stop, state_at, *, dips):
        """Return the first event within a step and its time [s]; None and the step's end without one.

        Without ``dips``, dips between `CHECKS` are ignored: in a mode's first step a function that starts at zero is all
        rounding.
        """

        def event_values(t):
            functions = self.of_arrays.event_functions(m.mode, t, State(*state_at(t)), m.signs)
            return {event: np.broadcast_to(values, t.shape) for event, values in functions.items()}

        checks = start + CHECKS * (stop - start)
        first = None, stop
        for event, values in event_values(checks).items():

            def value(t, event=event):
                return float(event_values(np.array([t]))[event][0])

            falls = np.flatnonzero((values[:-1] > 0) & (values[1:] <= 0))
            last = int(falls[0]) if falls.size else len(checks) - 1  # before it the function stays above zero at all checks
            bracket = (checks[last], checks[last + 1]) if falls.size else None
            largest = np.abs(values).max()
            for i in range(1, last) if dips and values[0] > 0 else ():
                if values[i - 1] > values[i] <= values[i + 1] and values[i] < DIP_THRESHOLD * largest:
                    found = minimize_scalar(value, bounds=checks[[i - 1, i + 1]], method="bounded", options={"xatol": 1e-12})
                    if found.fun <= -MIN_DIP_DEPTH * largest:
                        bracket = checks[i - 1], float(found.x)
                        break
            if bracket is not None:
                root = brentq(value, *bracket, xtol=1e-15, rtol=1e-15)
                if first[0] is None or root < first[1]:
                    first = event_in_phase(event, m.signs), root
        return first
