"""First derivatives of a run by any of its numbers: variational equations within a mode, the driver's own lines at its events.

Between two events the derivatives S of the state follow S' = df/dy S + df/dp, integrated with heyoka beside the state. At an
event, g(t, y) = 0, the driver does what it always does, but with dual numbers (`dual`), so that its lines are differentiated
and not written a second time. What it is given is the state where the event happens, which moves with the event's time,

    dt = -(dg/dy S + dg/dp) / (dg/dt + dg/dy f)          dy = S + f dt,

and what it makes of it starts the next mode, whose rates are f+: S+ = dy+ - f+ dt. Together these are the saltation matrices
(see docs/derivation.md).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from looping_pendulum.errors import IntegrationError, MissingPackageError, ParameterError
from looping_pendulum.reference_ode import dual, effects
from looping_pendulum.reference_ode.driver import Driver
from looping_pendulum.reference_ode.dual import Dual
from looping_pendulum.reference_ode.effects.types import Effect
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_backend import MAX_STEPS, HeyokaIntegrator, ModeEquations
from looping_pendulum.reference_ode.heyoka_library import load_heyoka
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solution import Part, Run, RunEvent, Samples, heavy_mass_position, join, light_mass_position
from looping_pendulum.reference_ode.solve import DURATION, TOLERANCE, available_integrators
from looping_pendulum.reference_ode.state import Effects, Signs, State, complete, follow, meaning
from looping_pendulum.reference_ode.transitions import PHASE_ZERO, Event, Mode

DERIVATIVE_TOLERANCE = 1e-10
"""Relative tolerance of a step of the variational equations, if the run's own is not larger."""
TOUCH = 1e-6
"""An event is touched, not crossed, if the slope of its function a time TOUCH [s] before is more than twice the slope then."""
CHANGES_NOTHING = frozenset({*PHASE_ZERO.values(), Event.ROD_SLOWS})
"""Events that only begin to watch another function: neither the state nor its rates jump."""

SWITCHES = frozenset(e.switch for e in effects.EFFECTS.values() if e.switch)
"""Coefficients at whose null value an effect sets in."""


class SensitivityError(IntegrationError):
    """A derivative that does not exist, or that this run cannot have."""


@dataclass(frozen=True, kw_only=True)
class Sensitivities:
    """Derivatives of a run by ``wrt``, m numbers, at the times of its n samples. SI."""

    wrt: tuple[str, ...]
    samples: Samples
    """The run itself."""
    parameters: Parameters
    """The run's, as dual numbers."""
    state: State
    """Derivatives at fixed time of every entry of the state, each of shape (m, n)."""
    event_times: Array
    """Derivatives of the time of every event of the run, shape (events, m); 0 for the release and where the time is up."""

    @cached_property
    def moving_state(self) -> State:
        """The samples' state as dual numbers."""
        return State(*(Dual(v, d) for v, d in zip(self.samples.state, self.state, strict=True)))

    @cached_property
    def light_position(self) -> Array:
        """Derivatives of the light mass's place [m per unit], shape (n, 2, m)."""
        return self._places(light_mass_position)

    @cached_property
    def heavy_position(self) -> Array:
        """Derivatives of the heavy mass's place [m per unit], shape (n, 2, m)."""
        return self._places(heavy_mass_position)

    def _places(self, place: Any) -> Array:
        p = _over_samples(self.parameters)
        parts = place(dual, self.moving_state, self.samples.signs.overlap, p)
        shape = (len(self.wrt), len(self.samples.t))
        return np.stack([np.broadcast_to(x.slopes if isinstance(x, Dual) else 0.0, shape) for x in parts]).transpose(2, 0, 1)


def solve_sensitivities(
    parameters: Parameters,
    t: Array,
    wrt: Sequence[str],
    *,
    duration: float = DURATION,
    tolerance: float = TOLERANCE,
) -> Sensitivities:
    """Run as `solve_at` does and return the derivatives of the run by the numbers ``wrt`` at the times ``t`` [s], ascending.

    A number moves as in `Parameters.replace`: the kinetic friction takes the static one along where they are equal. An effect
    that is absent, at its null value, can be asked for too. Derivatives are of the given sequence of events.

    Parameters
    ----------
    wrt
        Names of fields or coefficients of ``parameters``.

    Raises
    ------
    MissingPackageError
        If heyoka is not installed.
    ParameterError
        If a name is no number of ``parameters``.
    SensitivityError
        If a derivative does not exist: an event is only touched, or a number stands where the motion changes its kind.
    """
    if "heyoka" not in available_integrators():
        raise MissingPackageError("sensitivities need heyoka, which is not installed: `pip install heyoka` (Linux x86-64)")
    wrt = tuple(wrt)
    _refuse_corners(parameters, wrt)
    moved = _as_duals(parameters, wrt)
    count = len(wrt)
    driver = DualDriver(moved, duration, tolerance, count)
    released = driver.y
    parts = driver.run_sampled(np.asarray(t, dtype=float))
    run = Run(parameters=parameters, integrator="heyoka", tolerance=tolerance, events=driver.plain_events())
    at_start = np.array([dual.slopes(v, count) for v in released])[:, :, None]
    first = np.repeat(at_start, len(parts[0].t), axis=2)  # within `driver.START` of the release
    slopes = np.concatenate([first, *driver.variational.derivatives], axis=2)
    return Sensitivities(
        wrt=wrt,
        samples=join(run, parts),
        parameters=moved,
        state=State(*slopes),
        event_times=np.array([dual.slopes(e.time, count) for e in driver.events]),
    )


class _DualParameters(Parameters):
    """Parameters of dual numbers. One that carries derivatives is off its null value, so that its effect acts."""

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        off = {name for name, value in self.coefficients.items() if isinstance(value, Dual)}
        return self.effects_with(off)


def _as_duals(parameters: Parameters, wrt: tuple[str, ...]) -> Parameters:
    """``parameters`` with the numbers ``wrt`` as dual numbers, each moving alone."""
    fields = {f.name: getattr(parameters, f.name) for f in dataclasses.fields(parameters) if f.name != "coefficients"}
    coefficients: dict[str, Any] = dict(parameters.coefficients)
    unit = dict(zip(wrt, np.eye(len(wrt)), strict=True))
    if "kinetic_friction" in unit and parameters.static_follows:
        unit["static_friction"] = unit["kinetic_friction"] + unit.get("static_friction", 0.0)
    for name, slopes in unit.items():
        target: dict[str, Any] = coefficients if name in coefficients else fields
        target[name] = Dual(float(target[name]), slopes)
    return _DualParameters(**fields, coefficients=coefficients)


def _over_samples(parameters: Parameters) -> Parameters:
    """``parameters`` with derivatives that broadcast over samples."""

    def spread(x: Any) -> Any:
        return Dual(x.value, x.slopes[:, None]) if isinstance(x, Dual) else x

    fields = {f.name: spread(getattr(parameters, f.name)) for f in dataclasses.fields(parameters) if f.name != "coefficients"}
    return _DualParameters(**fields, coefficients={name: spread(c) for name, c in parameters.coefficients.items()})


def _refuse_corners(parameters: Parameters, wrt: tuple[str, ...]) -> None:
    known = {f.name for f in dataclasses.fields(parameters)} - {"coefficients", "release"} | set(parameters.coefficients)
    for name in wrt:
        if name not in known:
            raise ParameterError(f"wrt: found {name!r}, needed one of {', '.join(sorted(known))}")
        if wrt.count(name) > 1:
            raise ParameterError(f"wrt: found {name!r} more than once, needed it once")
        if name in SWITCHES and parameters.coefficients[name] == effects.COEFFICIENTS[name].null:
            raise SensitivityError(f"wrt {name}: no derivative where its effect sets in; give it a value off its null value")
    if "light_radius" in wrt and parameters.light_radius == 0:
        raise SensitivityError("wrt light_radius: no derivative at 0, which stands for a point; give it another value")
    if "push_along" in wrt and parameters.coefficients["push_along"] == 0 and parameters.release is not Release.DROP:
        raise SensitivityError("wrt push_along: no derivative at 0, where a taut string goes slack; give it another value")


class DualDriver(Driver):
    """The driver, its numbers dual."""

    xp = dual

    def __init__(self, parameters: Parameters, duration: float, tolerance: float, count: int) -> None:
        super().__init__(parameters, duration, tolerance, "heyoka")
        self.variational = _VariationalIntegrator(self.values, self._plain_values, count, self.effects, tolerance)
        self.integrator = self.variational

    @cached_property
    def _plain_values(self) -> SimpleNamespace:
        return SimpleNamespace(**{name: dual.plain(value) for name, value in vars(self.values).items()})

    def _now(self) -> tuple[Any, State, Signs, Any]:
        return float(self.t), State(*map(dual.plain, self.y)), self.signs, self._plain_values

    def plain_events(self) -> tuple[RunEvent, ...]:
        """The events so far, without derivatives."""
        return tuple(replace(e, time=float(e.time), state=State(*map(dual.plain, e.state))) for e in self.events)


class _VariationalIntegrator(HeyokaIntegrator):
    """Runs a mode until one of its events, with ``count`` derivatives."""

    def __init__(self, values: SimpleNamespace, plain: SimpleNamespace, count: int, effects: Effects, tolerance: float) -> None:
        super().__init__(plain, effects, tolerance)
        numbers = vars(values)
        self._count = count
        self._moved = tuple(name for name in self._names if isinstance(numbers[name], Dual))
        self._slopes = np.array([numbers[name].slopes for name in self._moved]).reshape(len(self._moved), count)
        self.derivatives: list[Array] = []
        """Of every entry of the state in the samples of each part, shape (len(State), count, n)."""

    def advance_sampled(
        self, mode: Mode, t: Any, y: State, signs: Signs, until: float, times: Array
    ) -> tuple[Event, Any, State, Part]:
        """As the reference's own, with ``t`` and ``y`` dual before and after."""
        start, plain = float(t), State(*map(dual.plain, y))
        event, end, state, part = super().advance_sampled(mode, start, plain, signs, until, times)
        flow = _variational(mode, self._effects, max(self._tolerance, DERIVATIVE_TOLERANCE), self._names, self._moved)
        pars, x, count = np.array([*signs, *self._numbers]), flow.variables(plain), len(part.t)
        rates, _ = flow.local(x, pars, start)
        before = np.array([dual.slopes(v, self._count) for v in flow.variables(y)]) - np.outer(
            rates, dual.slopes(t, self._count)
        )
        last = part.t[-1] if count else start
        grid = np.concatenate([[start], part.t, [end] if end > last else []])
        slopes = flow.propagate(x, pars, grid, before, self._slopes)
        full = np.zeros((len(State._fields), self._count, count))
        full[flow.rows] = slopes[1 : 1 + count].transpose(1, 2, 0)
        follow(mode, flow.names, full.transpose(1, 0, 2))
        self.derivatives.append(full)
        shift, there = np.zeros(self._count), slopes[-1]
        if event is not Event.TIME_UP:
            number = next(i for i, e in enumerate(flow.events) if meaning(e, signs) is event)
            rates, shift = self._crossing(flow, number, event, flow.variables(state), pars, end, there)
            there = there + np.outer(rates, shift)
        values = {name: Dual(v, row) for name, v, row in zip(flow.names, flow.variables(state), there, strict=True)}
        return event, Dual(end, shift), complete(mode, **values), part

    def _crossing(
        self, flow: _Variational, number: int, event: Event, x: list[float], pars: Array, t: float, slopes: Array
    ) -> tuple[Array, Array]:
        """Rates where event ``number`` happens, and the derivatives of its time."""
        n = len(x)
        rates, gradients = flow.local(x, pars, t)
        along = gradients[number, :n] @ rates + gradients[number, n]
        rates_before, before = flow.local([v - TOUCH * r for v, r in zip(x, rates, strict=True)], pars, t - TOUCH)
        if abs(before[number, :n] @ rates_before + before[number, n]) > 2 * abs(along):
            if event in CHANGES_NOTHING:
                return rates, np.zeros(self._count)
            raise SensitivityError(f"no derivatives beyond t = {t:g} s, where the event {event} is touched, not crossed")
        return rates, -(gradients[number, :n] @ slopes + gradients[number, n + 1 :] @ self._slopes) / along


class _Variational:
    """Variational equations of one mode, and the gradients of its events."""

    def __init__(self, mode: Mode, effects: Effects, tolerance: float, names: tuple[str, ...], moved: tuple[str, ...]) -> None:
        hy = load_heyoka()

        written = ModeEquations(mode, effects, names)
        self.names, self.rows, self.events = written.names, written.rows, tuple(written.watched)
        variables = list(written.variables.values())
        moving = [written.parameters[name] for name in moved]
        occurring = set(hy.get_params([rate for _, rate in written.system]))
        self.columns = np.array([i for i, p in enumerate(moving) if p in occurring], dtype=int)
        system = hy.var_ode_sys(written.system, [*variables, *(moving[i] for i in self.columns)])
        self.taylor = hy.taylor_adaptive(system, [1.0] * len(variables), tol=tolerance, compact_mode=True)
        clock = hy.make_vars("clock")  # heyoka differentiates by variables and parameters only
        by = [*variables, clock, *moving]
        outputs = [rate for _, rate in written.system]
        for function in written.watched.values():
            outputs += [hy.diff(hy.subs(hy.expression(0.0) + function, {hy.time: clock}), x) for x in by]
        self._local = hy.cfunc(hy.subs(outputs, {hy.time: clock}), vars=[*variables, clock], compact_mode=True)
        self._events_shape = (len(self.events), len(by))

    def variables(self, y: State) -> list[Any]:
        """Pick the variables of the mode."""
        return [y[i] for i in self.rows]

    def local(self, x: list[float], pars: Array, t: float) -> tuple[Array, Array]:
        """Rates of the variables ``x``, and the gradients of the events by variables, time and moved numbers."""
        n = len(x)
        out = self._local(np.array([*x, t]), pars=pars[: self._local.nparams])
        return out[:n], out[n:].reshape(self._events_shape)

    def propagate(self, x: list[float], pars: Array, grid: Array, before: Array, numbers: Array) -> Array:
        """Derivatives of the variables at the times ``grid`` [s], shape (times, n, m), from those ``before``, (n, m)."""
        if len(grid) == 1:
            return before[None]
        taylor, n = self.taylor, len(x)
        width = n + len(self.columns)
        taylor.time = grid[0]
        taylor.state[:n] = x
        taylor.state[n:] = np.eye(n, width).ravel()
        taylor.pars[:] = pars[: len(taylor.pars)]
        outcome, *_, rows = taylor.propagate_grid(grid, max_steps=MAX_STEPS)
        if len(rows) < len(grid):
            raise IntegrationError(f"derivatives: integration broke down ({outcome}) at t = {taylor.time:g} s")
        matrices = rows[:, n:].reshape(-1, n, width)
        return np.asarray(matrices[:, :, :n] @ before + matrices[:, :, n:] @ numbers[self.columns])


@lru_cache(maxsize=64)
def _variational(
    mode: Mode, effects: Effects, tolerance: float, names: tuple[str, ...], moved: tuple[str, ...]
) -> _Variational:
    return _Variational(mode, effects, tolerance, names, moved)
