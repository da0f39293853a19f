"""Runs by heyoka's Taylor series, in double precision, 80 or 128 bits: exact to rounding, and a check on the package's core.

They show how much of a result is rounding. The parameters are always those of double precision, and so is the choice of the
mode after an event, for which only signs matter. heyoka has wheels for Linux: `pip install -e ".[test]"`.
"""

import math
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from looping_pendulum.errors import IntegrationError, MissingPackageError
from looping_pendulum.reference_ode import rules
from looping_pendulum.reference_ode.effects import EFFECTS, EffectKind
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import Run, RunEvent, Samples
from looping_pendulum.reference_ode.solve import DURATION
from looping_pendulum.reference_ode.state import (
    Effects,
    Motion,
    Signs,
    State,
    event_in_phase,
    full_state,
    variables,
)
from looping_pendulum.reference_ode.transitions import Event, Mode
from research.driver import Part, drive, fill_in_heavy_speed, join

try:
    import heyoka as hy
except ModuleNotFoundError:
    raise ModuleNotFoundError(
        'heyoka is not installed; on Linux the extra `test` has it: `pip install -e ".[test]"`', name="heyoka"
    ) from None

hy.set_logger_level_critical()  # what it would warn of is returned as an outcome, too
hy.llvm_state.set_diskcache_enabled(False)  # it would grow in the home folder by hundreds of megabytes

TOLERANCES = {"double": 1e-15, "80-bit": 1e-18, "128-bit": 1e-24}
"""Precision -> default relative tolerance of a step. The series of the step that leaves rest has an error of about 1e-18."""
MAX_STEPS = 20_000
"""Number of steps in one mode after which a run is given up."""


def solve_at(
    parameters: Parameters,
    t: Array,
    *,
    duration: float = DURATION,
    tolerance: float = TOLERANCES["double"],
    precision: str = "double",
) -> Samples:
    """Do what the package's `solve_at` does.

    Times and states of the events are numbers of ``precision``: "double", "80-bit" (`numpy.longdouble` on x86) or "128-bit"
    (`heyoka.real128`).

    Raises
    ------
    IntegrationError
        If the run breaks down or its events do not end.
    MissingPackageError
        If this machine does not have the precision.
    """
    run = HeyokaRun(parameters, tolerance=tolerance, precision=precision)
    return join(parameters, tolerance, *run.drive(run.released, np.asarray(t, dtype=float), duration))


def solve(
    parameters: Parameters, *, duration: float = DURATION, precision: str = "double", tolerance: float | None = None
) -> Run:
    """Return the events of the run of `solve_at`, by default at the tolerance of `TOLERANCES`."""
    tolerance = TOLERANCES[_known(precision)] if tolerance is None else tolerance
    return solve_at(parameters, np.zeros(0), duration=duration, tolerance=tolerance, precision=precision).run


class HeyokaRun:
    """A run that can start from any motion."""

    def __init__(self, parameters: Parameters, *, tolerance: float, precision: str) -> None:
        number_type = number_type_of(precision)
        p, effects = parameters.values(), parameters.effects
        # Functions of `math` would round to double precision
        xp = math if number_type is float else np
        self.system = rules.HybridSystem(Equations(xp, p, effects))
        self.integrator = HeyokaIntegrator(p, effects, tolerance, number_type)
        y = State(*map(number_type, rules.state_at_release(parameters)))
        self.released = rules.release(self.system, parameters.release, y)
        """The motion just after release."""

    def drive(self, start: Motion, t: Array, duration: float) -> tuple[list[RunEvent], list[Part]]:
        """Run from ``start``; return events and samples as `driver.drive` does."""
        return drive(self.system, start, self.integrator, t, duration)


def _known(precision: str) -> str:
    if precision not in TOLERANCES:
        raise ValueError(f"precision: found {precision!r}, needed one of {', '.join(TOLERANCES)}")
    return precision


def number_type_of(precision: str) -> Any:
    """Return the type of the numbers; refuse one that this machine does not have."""
    if _known(precision) == "double":
        return float
    # longdouble has a significand of 64 bits on x86; on other machines it may be a plain double
    number_type = np.longdouble if precision == "80-bit" else getattr(hy, "real128", None)
    if number_type is None or (precision == "80-bit" and np.finfo(np.longdouble).nmant < 63):
        raise MissingPackageError(f"precision: {precision} numbers are not available on this machine; use another precision")
    return number_type


class ModeEquations:
    """Equations and event functions of one mode as heyoka expressions."""

    def __init__(self, mode: Mode, effects: Effects, parameter_names: tuple[str, ...]) -> None:
        self.names = variables(mode, effects)
        self.rows = np.array([State._fields.index(name) for name in self.names])
        self.variables = dict(zip(self.names, hy.make_vars(*self.names), strict=True))
        y, signs = full_state(mode, **self.variables), Signs(*(hy.par[i] for i in range(len(Signs._fields))))
        offset = len(Signs._fields)
        self.parameters = {name: hy.par[offset + i] for i, name in enumerate(parameter_names)}
        """Name -> heyoka parameter; in heyoka's parameter array those of ``parameter_names`` follow the signs."""
        # Coefficients of absent effects are constants, so that heyoka folds their terms away
        equations = Equations(hy, SimpleNamespace(**(_absent_coefficients(effects) | self.parameters)), effects)
        rates = equations.rates(mode, hy.time, y, signs)
        # A rate that is constant is a Python float; the sum makes it an expression
        self.system = [(self.variables[name], hy.expression(0.0) + getattr(rates, name)) for name in self.names]
        self.event_functions = equations.event_functions(mode, hy.time, y, signs)


def _absent_coefficients(effects: Effects) -> dict[str, float]:
    """Return the null values of the coefficients of all effects but those given."""
    return {c.name: c.null for effect in EFFECTS.values() if effect not in effects for c in effect.coefficients}


@lru_cache(maxsize=256)
def _compiled(
    mode: Mode, effects: Effects, tolerance: float, names: tuple[str, ...], number_type: Any
) -> tuple[Any, ModeEquations]:
    """Return heyoka's integrator of a mode, and the mode's equations."""
    equations = ModeEquations(mode, effects, names)
    # Every event function falls through zero; without a direction heyoka would also report where it rises
    falling = hy.event_direction.negative
    taylor = hy.taylor_adaptive(
        equations.system,
        [number_type(1.0)] * len(equations.names),  # any state will do: each run sets it
        tol=number_type(tolerance),
        t_events=[hy.t_event(f, direction=falling, fp_type=number_type) for f in equations.event_functions.values()],
        fp_type=number_type,
        # Compiles faster and runs slower, which suits these few runs
        compact_mode=True,
    )
    return taylor, equations


class HeyokaIntegrator:
    """Integrates a mode until one of its events."""

    def __init__(self, p: SimpleNamespace, effects: Effects, tolerance: float, number_type: Any = float) -> None:
        # Motions at release change no equation: runs with and without a push share their compiled code
        self.effects = tuple(effect for effect in effects if effect.kind is not EffectKind.RELEASE)
        self.tolerance, self.number_type = tolerance, number_type
        self.names = tuple(sorted(set(vars(p)) - _absent_coefficients(self.effects).keys() - {"release"}))
        """Names of the parameters, in heyoka's order."""
        self.numbers = [getattr(p, name) for name in self.names]

    def advance(self, m: Motion, until: float, times: Array) -> tuple[Event, Any, State, Array]:
        """Do what `driver.ModeIntegrator` says.

        Raises
        ------
        IntegrationError
            If the state becomes non-finite or the steps do not end.
        """
        number = self.number_type
        taylor, equations = _compiled(m.mode, self.effects, self.tolerance, self.names, number)
        taylor.time = number(m.t)
        taylor.state[:] = [number(m.y[i]) for i in equations.rows]
        # heyoka knows no parameters beyond the last one that occurs in the equations
        taylor.pars[:] = [number(x) for x in [*m.signs, *self.numbers][: len(taylor.pars)]]
        taylor.reset_cooldowns()  # else heyoka would ignore events just after those of an earlier run
        reached, outcome = taylor.state[None], hy.taylor_outcome.time_limit
        if len(times):
            grid = np.array([taylor.time, *map(number, times)])
            outcome, *_, reached = taylor.propagate_grid(grid, max_steps=MAX_STEPS)
        if outcome == hy.taylor_outcome.time_limit and taylor.time < until:
            # The samples end before the time limit, and the mode goes on
            outcome = taylor.propagate_until(number(until), max_steps=MAX_STEPS)[0]
        full = np.zeros((len(State._fields), len(reached) - 1), dtype=number)  # the first row is the start itself
        full[equations.rows] = reached[1:].T
        fill_in_heavy_speed(m.mode, equations.names, full)
        state = full_state(m.mode, **{name: number(x) for name, x in zip(equations.names, taylor.state, strict=True)})
        if outcome == hy.taylor_outcome.time_limit:
            return Event.TIME_UP, taylor.time, state, full
        # heyoka numbers terminal events -1, -2, ... in their order
        index = -int(getattr(outcome, "value", outcome)) - 1
        if not 0 <= index < len(equations.event_functions):
            raise IntegrationError(f"{m.mode.name.lower()}: integration broke down ({outcome}) at t = {float(taylor.time):g} s")
        return event_in_phase(list(equations.event_functions)[index], m.signs), taylor.time, state, full
