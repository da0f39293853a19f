"""First derivatives of a run by its parameters: variational equations within a mode, dual numbers at its events.

Between two events the derivatives S of the state follow S' = df/dy S + df/dp, integrated with heyoka beside the state. At an
event, g(t, y) = 0, the driver does what it always does, but with dual numbers (`dual`), so that its code is differentiated
and not written a second time. Its input is the state at the event, which moves with the time of the event,

    dt = -(dg/dy S + dg/dp) / (dg/dt + dg/dy f)          dy = S + f dt,

and its output starts the next mode, whose rates are f+: S+ = dy+ - f+ dt. Together these are the saltation matrices
(see docs/derivation.md).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from looping_pendulum.errors import IntegrationError, ParameterError
from looping_pendulum.reference_ode import dual, effects
from looping_pendulum.reference_ode.dual import Dual
from looping_pendulum.reference_ode.effects.types import Effect
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_backend import MAX_STEPS, HeyokaIntegrator, ModeEquations
from looping_pendulum.reference_ode.heyoka_library import COMPILER_OPTIONS, compiled, load_heyoka
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.rules import HybridSystem
from looping_pendulum.reference_ode.solution import (
    Run,
    RunEvent,
    Samples,
    SegmentSamples,
    heavy_mass_position,
    join_samples,
    light_mass_position,
)
from looping_pendulum.reference_ode.solve import DURATION, TOLERANCE, Driver, require_heyoka
from looping_pendulum.reference_ode.state import Effects, Signs, State, event_in_phase, fill_in_heavy_speed, full_state
from looping_pendulum.reference_ode.transitions import PHASE_ZERO, Event, Mode

# Ample: derivatives are tested to 1e-6 (tests/reference_ode/test_sensitivity.py)
DERIVATIVE_TOLERANCE = 1e-10
"""Relative tolerance of a step of the variational equations, unless that of the run is larger."""
GRAZING_STEP = 1e-6
"""Time step by which grazing is detected [s].

An event is grazed, its function touching zero without crossing it, if the slope of the function one step earlier is more than
twice the slope at the event.
"""
CONTINUOUS_EVENTS = frozenset({*PHASE_ZERO.values(), Event.ROD_SLOWS})
"""Events that only change which function is watched: neither the state nor its rates jump."""

SWITCH_COEFFICIENTS = frozenset(e.switch for e in effects.EFFECTS.values() if e.switch)
"""Coefficients at whose null value an effect sets in, so that no derivative exists there."""


class SensitivityError(IntegrationError):
    """A derivative does not exist."""


@dataclass(frozen=True, kw_only=True)
class Sensitivities:
    """Derivatives of a run by m parameters ``wrt`` at the times of its n samples. SI."""

    wrt: tuple[str, ...]
    """Names of the parameters."""
    samples: Samples
    """The run itself."""
    parameters: Parameters
    """Parameters of the run, those of ``wrt`` as dual numbers."""
    state: State
    """Derivatives of every entry of the state at fixed time, each of shape (m, n)."""
    event_times: Array
    """Derivatives of the times of all events of the run, shape (events, m); 0 for the release and for TIME_UP."""
    end_state: State
    """Derivatives of every entry of the state at the run's end, whose time moves, each of shape (m,)."""

    def and_end(self) -> Sensitivities:
        """Return the same with the end of the run as the last sample; the derivatives there are those of `end_state`."""
        columns = zip(self.state, self.end_state, strict=True)
        return dataclasses.replace(
            self,
            samples=self.samples.and_end(),
            state=State(*(np.column_stack([values, at_end]) for values, at_end in columns)),
        )

    @cached_property
    def dual_state(self) -> State:
        """State of the samples as dual numbers."""
        return State(*(Dual(v, d) for v, d in zip(self.samples.state, self.state, strict=True)))

    @cached_property
    def light_position(self) -> Array:
        """Derivatives of the light mass's position [m per unit of the parameter], shape (n, 2, m)."""
        return self._position_derivatives(light_mass_position)

    @cached_property
    def heavy_position(self) -> Array:
        """Derivatives of the heavy mass's position [m per unit of the parameter], shape (n, 2, m)."""
        return self._position_derivatives(heavy_mass_position)

    def _position_derivatives(self, place: Any) -> Array:
        p = SimpleNamespace(**vars(self.parameters.values()))
        for name, x in vars(p).items():
            if isinstance(x, Dual):
                setattr(p, name, Dual(x.value, x.derivatives[:, None]))  # shape (m, 1), which broadcasts over samples
        parts = place(dual, self.dual_state, self.samples.signs.overlap, p, self.parameters.effects)
        shape = (len(self.wrt), len(self.samples.t))
        return np.stack([np.broadcast_to(x.derivatives if isinstance(x, Dual) else 0.0, shape) for x in parts]).transpose(
            2, 0, 1
        )


def solve_sensitivities(
    parameters: Parameters,
    t: Array,
    wrt: Sequence[str],
    *,
    duration: float = DURATION,
    tolerance: float = TOLERANCE,
) -> Sensitivities:
    """Solve as `solve_at` does, and return the derivatives by the parameters ``wrt`` at the times ``t`` [s], ascending.

    A parameter changes as in `Parameters.replace`: the kinetic friction takes the static one along where they are equal. The
    coefficient of an effect that is absent, at its null value, is allowed, too. The sequence of events is taken as fixed.

    Parameters
    ----------
    wrt
        Names of fields or coefficients of ``parameters``.

    Raises
    ------
    MissingPackageError
        If heyoka is not installed.
    ParameterError
        If a name is no field or coefficient of ``parameters``, or occurs twice.
    SensitivityError
        If a derivative does not exist: an event is only grazed, or the motion changes its kind at the value of a parameter.
    """
    require_heyoka("sensitivities")
    wrt = tuple(wrt)
    _check_wrt(parameters, wrt)
    moved = _as_dual_numbers(parameters, wrt)
    count = len(wrt)
    driver = DualDriver(moved, duration, tolerance, count)
    released = driver.motion.y
    parts = driver.run_sampled(np.asarray(t, dtype=float))
    run = Run(parameters=parameters, integrator="heyoka", tolerance=tolerance, events=driver.events_without_derivatives())
    at_start = np.array([dual.derivatives_of(v, count) for v in released])[:, :, None]
    first = np.repeat(at_start, len(parts[0].t), axis=2)  # within `rules.REST_SERIES_DURATION` of the release
    derivatives = np.concatenate([first, *driver.variational.derivatives], axis=2)
    return Sensitivities(
        wrt=wrt,
        samples=join_samples(run, parts),
        parameters=moved,
        state=State(*derivatives),
        event_times=np.array([dual.derivatives_of(e.time, count) for e in driver.events]),
        end_state=State(*(dual.derivatives_of(v, count) for v in driver.events[-1].state)),
    )


class _DualParameters(Parameters):
    """Parameters as dual numbers. The effect of a coefficient that carries derivatives acts even at its null value."""

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        off = {name for name, value in self.coefficients.items() if isinstance(value, Dual)}
        return self.effects_with(off)


def _as_dual_numbers(parameters: Parameters, wrt: tuple[str, ...]) -> Parameters:
    """Return ``parameters`` with those named ``wrt`` as dual numbers, with unit vectors as their derivatives."""
    fields = {f.name: getattr(parameters, f.name) for f in dataclasses.fields(parameters) if f.name != "coefficients"}
    coefficients: dict[str, Any] = dict(parameters.coefficients)
    unit = dict(zip(wrt, np.eye(len(wrt)), strict=True))
    if "kinetic_friction" in unit and parameters.static_equals_kinetic:
        # Added, as the static friction may itself be among ``wrt``
        unit["static_friction"] = unit["kinetic_friction"] + unit.get("static_friction", 0.0)
    for name, derivatives in unit.items():
        target: dict[str, Any] = coefficients if name in coefficients else fields
        target[name] = Dual(float(target[name]), derivatives)
    return _DualParameters(**fields, coefficients=coefficients)


def _check_wrt(parameters: Parameters, wrt: tuple[str, ...]) -> None:
    """Refuse names that are unknown or repeated, and parameters by which no derivative exists at their value."""
    known = {f.name for f in dataclasses.fields(parameters)} - {"coefficients", "release", "own_effects"} | set(
        parameters.coefficients
    )
    for name in wrt:
        if name not in known:
            raise ParameterError(f"wrt: found {name!r}, needed one of {', '.join(sorted(known))}")
        if wrt.count(name) > 1:
            raise ParameterError(f"wrt: found {name!r} more than once, needed it once")
        if name in SWITCH_COEFFICIENTS and parameters.coefficients[name] == effects.COEFFICIENTS[name].null:
            raise SensitivityError(f"wrt {name}: no derivative where its effect sets in; give it a value off its null value")
    if "light_radius" in wrt and parameters.light_radius == 0:
        raise SensitivityError("wrt light_radius: no derivative at 0, which stands for a point; give it another value")
    if "push_along" in wrt and parameters.coefficients["push_along"] == 0 and parameters.release is not Release.DROP:
        raise SensitivityError("wrt push_along: no derivative at 0, where a taut string goes slack; give it another value")


class DualDriver(Driver):
    """The driver with dual numbers."""

    def __init__(self, parameters: Parameters, duration: float, tolerance: float, count: int) -> None:
        super().__init__(parameters, duration, tolerance, "heyoka")
        self.variational = _VariationalIntegrator(self.values, self._float_values, count, self.effects, tolerance)
        self.integrator = self.variational

    def _make_system(self) -> HybridSystem:
        return HybridSystem(Equations(dual, self.values, self.effects), Equations(math, self._float_values, self.effects))

    @cached_property
    def _float_values(self) -> SimpleNamespace:
        return SimpleNamespace(**{name: dual.value_of(value) for name, value in vars(self.values).items()})

    def events_without_derivatives(self) -> tuple[RunEvent, ...]:
        """Return the events so far, without derivatives."""
        return tuple(e._replace(time=float(e.time), state=State(*map(dual.value_of, e.state))) for e in self.events)


class _VariationalIntegrator(HeyokaIntegrator):
    """Integrates a mode, and ``count`` derivatives of it, until one of its events."""

    def __init__(self, values: SimpleNamespace, plain: SimpleNamespace, count: int, effects: Effects, tolerance: float) -> None:
        super().__init__(plain, effects, tolerance)
        numbers = vars(values)
        self._count = count
        self._differentiated = tuple(name for name in self._names if isinstance(numbers[name], Dual))
        self._parameter_derivatives = np.array([numbers[name].derivatives for name in self._differentiated]).reshape(
            len(self._differentiated), count
        )
        self.derivatives: list[Array] = []
        """Derivatives of every entry of the state at the samples of each part, shape (len(State), count, n)."""

    def advance_sampled(
        self, mode: Mode, t: Any, y: State, signs: Signs, until: float, times: Array
    ) -> tuple[Event, Any, State, SegmentSamples]:
        """Do the same as the base class, with ``t`` and ``y`` as dual numbers, before and after."""
        start, plain = float(t), State(*map(dual.value_of, y))
        event, end, state, part = super().advance_sampled(mode, start, plain, signs, until, times)
        # A separate integration: the run itself is that of `solve`, to the last bit
        variational = _variational(
            mode, self._effects, max(self._tolerance, DERIVATIVE_TOLERANCE), self._names, self._differentiated
        )
        pars, x, count = np.array([*signs, *self._numbers]), variational.variables(plain), len(part.t)
        rates, _ = variational.rates_and_gradients(x, pars, start)
        # S+ = dy+ - f+ dt: from derivatives of the state at the event to those at fixed time
        before = np.array([dual.derivatives_of(v, self._count) for v in variational.variables(y)]) - np.outer(
            rates, dual.derivatives_of(t, self._count)
        )
        last = part.t[-1] if count else start
        grid = np.concatenate([[start], part.t, [end] if end > last else []])
        derivatives = variational.propagate(x, pars, grid, before, self._parameter_derivatives)
        full = np.zeros((len(State._fields), self._count, count))
        full[variational.rows] = derivatives[1 : 1 + count].transpose(1, 2, 0)
        fill_in_heavy_speed(mode, variational.names, full.transpose(1, 0, 2))
        self.derivatives.append(full)
        # From derivatives at fixed time to those of the state at the event, whose time moves
        shift, at_end = np.zeros(self._count), derivatives[-1]
        if event is not Event.TIME_UP:
            number = next(i for i, e in enumerate(variational.events) if event_in_phase(e, signs) is event)
            rates, shift = self._event_time_derivatives(
                variational, number, event, variational.variables(state), pars, end, at_end
            )
            at_end = at_end + np.outer(rates, shift)
        values = {
            name: Dual(v, row) for name, v, row in zip(variational.names, variational.variables(state), at_end, strict=True)
        }
        return event, Dual(end, shift), full_state(mode, **values), part

    def _event_time_derivatives(
        self, variational: _Variational, number: int, event: Event, x: list[float], pars: Array, t: float, derivatives: Array
    ) -> tuple[Array, Array]:
        """Return the rates where event ``number`` happens, and the derivatives of its time."""
        n = len(x)
        rates, gradients = variational.rates_and_gradients(x, pars, t)
        along = gradients[number, :n] @ rates + gradients[number, n]
        rates_before, before = variational.rates_and_gradients(
            [v - GRAZING_STEP * r for v, r in zip(x, rates, strict=True)], pars, t - GRAZING_STEP
        )
        if abs(before[number, :n] @ rates_before + before[number, n]) > 2 * abs(along):
            if event in CONTINUOUS_EVENTS:
                return rates, np.zeros(self._count)
            raise SensitivityError(f"no derivatives beyond t = {t:g} s, where the event {event} is grazed, not crossed")
        return rates, -(gradients[number, :n] @ derivatives + gradients[number, n + 1 :] @ self._parameter_derivatives) / along


class _Variational:
    """Variational equations of one mode, and the gradients of its event functions."""

    def __init__(
        self, mode: Mode, effects: Effects, tolerance: float, names: tuple[str, ...], differentiated: tuple[str, ...]
    ) -> None:
        hy = load_heyoka()

        mode_equations = ModeEquations(mode, effects, names)
        self.names, self.rows, self.events = mode_equations.names, mode_equations.rows, tuple(mode_equations.event_functions)
        variables = list(mode_equations.variables.values())
        parameters = [mode_equations.parameters[name] for name in differentiated]
        # Parameters that occur in events only need no variational equations
        occurring = set(hy.get_params([rate for _, rate in mode_equations.system]))
        self.columns = np.array([i for i, p in enumerate(parameters) if p in occurring], dtype=int)
        system = hy.var_ode_sys(mode_equations.system, [*variables, *(parameters[i] for i in self.columns)])
        # compact_mode: a variational system is large, and its code without loops takes long to compile
        self.taylor = hy.taylor_adaptive(system, [1.0] * len(variables), tol=tolerance, compact_mode=True, **COMPILER_OPTIONS)
        clock = hy.make_vars("clock")  # heyoka differentiates by variables and parameters only
        arguments = [*variables, clock, *parameters]
        outputs = [rate for _, rate in mode_equations.system]
        for function in mode_equations.event_functions.values():
            outputs += [hy.diff(hy.subs(hy.expression(0.0) + function, {hy.time: clock}), x) for x in arguments]
        self._rates_and_gradients = hy.cfunc(
            hy.subs(outputs, {hy.time: clock}), vars=[*variables, clock], compact_mode=True, **COMPILER_OPTIONS
        )
        self._events_shape = (len(self.events), len(arguments))

    def variables(self, y: State) -> list[Any]:
        """Return the variables of the mode from the state."""
        return [y[i] for i in self.rows]

    def rates_and_gradients(self, x: list[float], pars: Array, t: float) -> tuple[Array, Array]:
        """Return the rates of the variables ``x``, and the gradients of the event functions by variables, time, parameters."""
        n = len(x)
        out = self._rates_and_gradients(np.array([*x, t]), pars=pars[: self._rates_and_gradients.nparams])
        return out[:n], out[n:].reshape(self._events_shape)

    def propagate(self, x: list[float], pars: Array, grid: Array, before: Array, numbers: Array) -> Array:
        """Return the derivatives of the variables at the times ``grid`` [s], shape (times, n, m).

        They begin with ``before``, shape (n, m); ``numbers`` are the derivatives of the parameters.
        """
        if len(grid) == 1:
            return before[None]
        taylor, n = self.taylor, len(x)
        width = n + len(self.columns)
        taylor.time = grid[0]
        taylor.state[:n] = x
        # The equations are linear, so the fundamental matrix, integrated once from the identity, serves any number of
        # derivatives
        taylor.state[n:] = np.eye(n, width).ravel()
        taylor.pars[:] = pars[: len(taylor.pars)]
        outcome, *_, rows = taylor.propagate_grid(grid, max_steps=MAX_STEPS)
        if len(rows) < len(grid):
            raise IntegrationError(f"derivatives: integration broke down ({outcome}) at t = {taylor.time:g} s")
        matrices = rows[:, n:].reshape(-1, n, width)
        return np.asarray(matrices[:, :, :n] @ before + matrices[:, :, n:] @ numbers[self.columns])


@lru_cache(maxsize=64)
def _variational(
    mode: Mode, effects: Effects, tolerance: float, names: tuple[str, ...], differentiated: tuple[str, ...]
) -> _Variational:
    return compiled(
        ("variational", mode.name, tolerance, names, differentiated),
        effects,
        lambda: _Variational(mode, effects, tolerance, names, differentiated),
    )
