"""A run in more than double precision: the same equations, table and driver, with numbers of 80 or 128 bits.

It shows what of a result is rounding. Slower than `solve`, without samples, and with heyoka only. What stays in double
precision are the parameters (the same numbers as `solve`'s), and which mode follows an event, of which only signs matter.
"""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from looping_pendulum.errors import IntegrationError, MissingPackageError
from looping_pendulum.reference_ode.driver import Driver
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_backend import MAX_STEPS, HeyokaIntegrator, ModeEquations
from looping_pendulum.reference_ode.heyoka_library import load_heyoka
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import Part, Run
from looping_pendulum.reference_ode.solve import DURATION, available_integrators
from looping_pendulum.reference_ode.state import Effects, Signs, State, complete, meaning
from looping_pendulum.reference_ode.transitions import Event, Mode

TOLERANCES = {"80-bit": 1e-18, "128-bit": 1e-24}
"""Precision -> default relative tolerance of a step. The step that leaves rest is a series whose error is about 1e-18."""


def solve_extended(
    parameters: Parameters, *, precision: str = "128-bit", duration: float = DURATION, tolerance: float | None = None
) -> Run:
    """Integrate as `solve` does, in extended precision; times and states of the run's events are numbers of that kind.

    Parameters
    ----------
    precision
        "80-bit" (`numpy.longdouble` on x86) or "128-bit" (`heyoka.real128`).
    tolerance
        Relative tolerance of a step; `TOLERANCES` without one.

    Raises
    ------
    MissingPackageError
        If heyoka is not installed, or has no such numbers on this machine.
    IntegrationError
        If the run breaks down or its events do not end.
    """
    if precision not in TOLERANCES:
        raise ValueError(f"precision: found {precision!r}, needed one of {', '.join(TOLERANCES)}")
    if "heyoka" not in available_integrators():
        raise MissingPackageError("extended precision needs heyoka, which is not installed: `pip install heyoka`")
    driver = _ExtendedDriver(parameters, duration, TOLERANCES[precision] if tolerance is None else tolerance, precision)
    driver.run_sampled(np.zeros(0))
    return Run(**(driver.record() | {"integrator": f"heyoka, {precision}"}))


def _kind(precision: str) -> Any:
    """Type of the numbers."""
    hy = load_heyoka()

    kind = np.longdouble if precision == "80-bit" else getattr(hy, "real128", None)
    if kind is None or (precision == "80-bit" and np.finfo(np.longdouble).nmant < 63):
        raise MissingPackageError(f"precision: {precision} numbers are not available on this machine; use another precision")
    return kind


class _ExtendedDriver(Driver):
    """The driver, its state in extended precision."""

    def __init__(self, parameters: Parameters, duration: float, tolerance: float, precision: str) -> None:
        super().__init__(parameters, duration, tolerance, "heyoka")
        kind = _kind(precision)
        self.y = State(*map(kind, self.y))
        self.xp = np
        self.integrator = _ExtendedIntegrator(self.values, self.effects, tolerance, kind)

    def _now(self) -> tuple[Any, State, Signs, Any]:
        return float(self.t), State(*map(float, self.y)), self.signs, self.values


class _ExtendedIntegrator(HeyokaIntegrator):
    """Runs a mode until one of its events; it returns no samples."""

    def __init__(self, values: SimpleNamespace, effects: Effects, tolerance: float, kind: Any) -> None:
        super().__init__(values, effects, tolerance)
        self._kind = kind

    def advance_sampled(
        self, mode: Mode, t: Any, y: State, signs: Signs, until: float, times: Array
    ) -> tuple[Event, Any, State, Part]:
        """As the reference's own, without samples."""
        kind = self._kind
        run = _compiled(mode, self._effects, self._tolerance, self._names, kind)
        taylor = run.taylor
        taylor.time = kind(t)
        taylor.state[:] = [kind(y[i]) for i in run.rows]
        taylor.pars[:] = [kind(x) for x in [*signs, *self._numbers][: len(taylor.pars)]]
        taylor.reset_cooldowns()
        outcome = taylor.propagate_until(kind(until), max_steps=MAX_STEPS)[0]
        number = -int(getattr(outcome, "value", outcome)) - 1
        if outcome == run.time_limit:
            event = Event.TIME_UP
        elif 0 <= number < len(run.events):
            event = meaning(run.events[number], signs)
        else:
            raise IntegrationError(f"{mode.name.lower()}: integration broke down ({outcome}) at t = {float(taylor.time):g} s")
        state = complete(mode, **{name: kind(x) for name, x in zip(run.names, taylor.state, strict=True)})
        nothing = Part(mode=mode, signs=signs, t=np.zeros(0), values=np.zeros((len(State._fields), 0)))
        return event, taylor.time, state, nothing


class _ExtendedIntegratorOfMode:
    """A Taylor integrator of one mode in extended precision."""

    def __init__(self, mode: Mode, effects: Effects, tolerance: float, parameter_names: tuple[str, ...], kind: Any) -> None:
        hy = load_heyoka()

        written = ModeEquations(mode, effects, parameter_names)
        self.names, self.rows, self.events = written.names, written.rows, tuple(written.watched)
        falling = hy.event_direction.negative
        self.taylor = hy.taylor_adaptive(
            written.system,
            [kind(1.0)] * len(self.names),
            tol=kind(tolerance),
            t_events=[hy.t_event(function, direction=falling, fp_type=kind) for function in written.watched.values()],
            fp_type=kind,
            compact_mode=True,
        )
        self.time_limit = hy.taylor_outcome.time_limit


@lru_cache(maxsize=32)
def _compiled(mode: Mode, effects: Effects, tolerance: float, names: tuple[str, ...], kind: Any) -> _ExtendedIntegratorOfMode:
    return _ExtendedIntegratorOfMode(mode, effects, tolerance, names, kind)
