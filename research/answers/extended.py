"""Runs in extended precision: the same equations, transition table and driver, with numbers of 80 or 128 bits.

They show how much of a result is rounding. They are slower than `solve`, without samples, and need heyoka. The parameters stay
in double precision (the same numbers as in `solve`), and so does the choice of the mode after an event, for which only signs
matter.
"""

import math
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from looping_pendulum.errors import IntegrationError, MissingPackageError
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_backend import MAX_STEPS, HeyokaIntegrator, ModeEquations
from looping_pendulum.reference_ode.heyoka_library import COMPILER_OPTIONS, load_heyoka
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.rules import HybridSystem
from looping_pendulum.reference_ode.solution import Run, SegmentSamples
from looping_pendulum.reference_ode.solve import DURATION, Driver, require_heyoka
from looping_pendulum.reference_ode.state import Effects, Signs, State, event_in_phase, full_state
from looping_pendulum.reference_ode.transitions import Event, Mode

TOLERANCES = {"80-bit": 1e-18, "128-bit": 1e-24}
"""Precision -> default relative tolerance of a step. The series of the step that leaves rest has an error of about 1e-18."""


def solve_extended(
    parameters: Parameters, *, precision: str = "128-bit", duration: float = DURATION, tolerance: float | None = None
) -> Run:
    """Integrate as `solve` does, in extended precision; times and states of the run's events are numbers of that type.

    Parameters
    ----------
    precision
        "80-bit" (`numpy.longdouble` on x86) or "128-bit" (`heyoka.real128`).
    tolerance
        Relative tolerance of a step; None: that of `TOLERANCES`.

    Raises
    ------
    MissingPackageError
        If heyoka is not installed, or does not have this precision on this machine.
    IntegrationError
        If the run breaks down or its events do not end.
    """
    if precision not in TOLERANCES:
        raise ValueError(f"precision: found {precision!r}, needed one of {', '.join(TOLERANCES)}")
    require_heyoka("extended precision")
    driver = _ExtendedDriver(parameters, duration, TOLERANCES[precision] if tolerance is None else tolerance, precision)
    driver.run_sampled(np.zeros(0))
    return Run(**(driver.record() | {"integrator": f"heyoka, {precision}"}))


def _number_type(precision: str) -> Any:
    """Return the type of the numbers; refuse one that this machine does not have."""
    hy = load_heyoka()

    # longdouble has a significand of 64 bits on x86; on other machines it may be a plain double
    number_type = np.longdouble if precision == "80-bit" else getattr(hy, "real128", None)
    if number_type is None or (precision == "80-bit" and np.finfo(np.longdouble).nmant < 63):
        raise MissingPackageError(f"precision: {precision} numbers are not available on this machine; use another precision")
    return number_type


class _ExtendedDriver(Driver):
    """The driver with a state in extended precision."""

    def __init__(self, parameters: Parameters, duration: float, tolerance: float, precision: str) -> None:
        super().__init__(parameters, duration, tolerance, "heyoka")
        number_type = _number_type(precision)
        self.motion = self.motion._replace(y=State(*map(number_type, self.motion.y)))
        # Functions of `math` would round to double precision
        self.system = HybridSystem(Equations(np, self.values, self.effects), Equations(math, self.values, self.effects))
        self.integrator = _ExtendedIntegrator(self.values, self.effects, tolerance, number_type)


class _ExtendedIntegrator(HeyokaIntegrator):
    """Integrates a mode until one of its events, without samples."""

    def __init__(self, values: SimpleNamespace, effects: Effects, tolerance: float, number_type: Any) -> None:
        super().__init__(values, effects, tolerance)
        self._number_type = number_type

    def advance_sampled(
        self, mode: Mode, t: Any, y: State, signs: Signs, until: float, times: Array
    ) -> tuple[Event, Any, State, SegmentSamples]:
        """Do the same as the base class, without samples."""
        number_type = self._number_type
        run = _compiled(mode, self._effects, self._tolerance, self._names, number_type)
        taylor = run.taylor
        taylor.time = number_type(t)
        taylor.state[:] = [number_type(y[i]) for i in run.rows]
        taylor.pars[:] = [number_type(x) for x in [*signs, *self._numbers][: len(taylor.pars)]]
        taylor.reset_cooldowns()
        outcome = taylor.propagate_until(number_type(until), max_steps=MAX_STEPS)[0]
        number = -int(getattr(outcome, "value", outcome)) - 1
        if outcome == run.time_limit:
            event = Event.TIME_UP
        elif 0 <= number < len(run.events):
            event = event_in_phase(run.events[number], signs)
        else:
            raise IntegrationError(f"{mode.name.lower()}: integration broke down ({outcome}) at t = {float(taylor.time):g} s")
        state = full_state(mode, **{name: number_type(x) for name, x in zip(run.names, taylor.state, strict=True)})
        no_samples = SegmentSamples(mode=mode, signs=signs, t=np.zeros(0), values=np.zeros((len(State._fields), 0)))
        return event, taylor.time, state, no_samples


class _ExtendedIntegratorOfMode:
    """A Taylor integrator of one mode in extended precision."""

    def __init__(
        self, mode: Mode, effects: Effects, tolerance: float, parameter_names: tuple[str, ...], number_type: Any
    ) -> None:
        hy = load_heyoka()

        mode_equations = ModeEquations(mode, effects, parameter_names)
        self.names, self.rows, self.events = mode_equations.names, mode_equations.rows, tuple(mode_equations.event_functions)
        falling = hy.event_direction.negative
        self.taylor = hy.taylor_adaptive(
            mode_equations.system,
            [number_type(1.0)] * len(self.names),
            tol=number_type(tolerance),
            t_events=[
                hy.t_event(function, direction=falling, fp_type=number_type)
                for function in mode_equations.event_functions.values()
            ],
            fp_type=number_type,
            # Compiles faster and runs slower, which suits these few runs
            compact_mode=True,
            **COMPILER_OPTIONS,
        )
        self.time_limit = hy.taylor_outcome.time_limit


@lru_cache(maxsize=32)
def _compiled(
    mode: Mode, effects: Effects, tolerance: float, names: tuple[str, ...], number_type: Any
) -> _ExtendedIntegratorOfMode:
    return _ExtendedIntegratorOfMode(mode, effects, tolerance, names, number_type)
