"""Integrate one mode with heyoka: Taylor series of high order, compiled once per mode, tolerance and set of effects."""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from looping_pendulum.errors import IntegratorGaveUpError
from looping_pendulum.reference_ode import equations
from looping_pendulum.reference_ode.effects import EFFECTS, EffectKind
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_library import load_heyoka
from looping_pendulum.reference_ode.solution import Part, Segment
from looping_pendulum.reference_ode.state import Effects, Signs, State, complete, follow, meaning, variables
from looping_pendulum.reference_ode.transitions import Event, Mode

NAME = "heyoka"
MAX_STEPS = 20_000


class ModeEquations:
    """The equations of one mode as heyoka's expressions."""

    def __init__(self, mode: Mode, effects: Effects, parameter_names: tuple[str, ...]) -> None:
        hy = load_heyoka()

        self.names = names = variables(mode, effects)
        self.variables = dict(zip(names, hy.make_vars(*names), strict=True))
        y, t = complete(mode, **self.variables), hy.time
        signs = Signs(*(hy.par[i] for i in range(len(Signs._fields))))
        offset = len(Signs._fields)
        self.parameters = {name: hy.par[offset + i] for i, name in enumerate(parameter_names)}
        """After the signs, the numbers that ``parameter_names`` names."""
        absent = {c.name: c.null for effect in EFFECTS.values() for c in effect.coefficients}  # constants, so they fold away
        p = SimpleNamespace(**(absent | self.parameters))
        rates = equations.rates(hy, mode, t, y, signs, p, effects)
        self.system = [(self.variables[name], hy.expression(0.0) + getattr(rates, name)) for name in names]
        self.watched = equations.event_functions(hy, mode, t, y, signs, p, effects)
        self.rows = np.array([State._fields.index(name) for name in names])


class _IntegratorOfMode:
    """A Taylor integrator of one mode, with what it needs to translate states, parameters and events."""

    def __init__(self, mode: Mode, effects: Effects, tolerance: float, parameter_names: tuple[str, ...]) -> None:
        hy = load_heyoka()

        written = ModeEquations(mode, effects, parameter_names)
        self.mode, self.names, self.rows = mode, written.names, written.rows
        self.events = tuple(written.watched)
        falling = hy.event_direction.negative
        self.integrator = hy.taylor_adaptive(
            written.system,
            [1.0] * len(self.names),
            tol=tolerance,
            t_events=[hy.t_event(function, direction=falling) for function in written.watched.values()],
        )
        self.success, self.time_limit = hy.taylor_outcome.success, hy.taylor_outcome.time_limit
        self.powers = np.arange(self.integrator.order + 1)


@lru_cache(maxsize=64)
def _compiled(mode: Mode, effects: Effects, tolerance: float, parameter_names: tuple[str, ...]) -> _IntegratorOfMode:
    return _IntegratorOfMode(mode, effects, tolerance, parameter_names)


@lru_cache(maxsize=64)
def _in_the_equations(effects: Effects) -> Effects:
    """Effects that change an equation: a motion at release needs nothing compiled."""
    return tuple(effect for effect in effects if effect.kind is not EffectKind.RELEASE)


@lru_cache(maxsize=64)
def _parameter_names(known: tuple[str, ...], effects: Effects) -> tuple[str, ...]:
    """Numbers that a compiled integrator takes: not those of effects that are absent."""
    absent = {c.name for effect in EFFECTS.values() if effect not in effects for c in effect.coefficients}
    return tuple(sorted(set(known) - absent - {"release"}))


class HeyokaIntegrator:
    """Runs a mode until one of its events."""

    def __init__(self, values: SimpleNamespace, effects: Effects, tolerance: float) -> None:
        self._effects = _in_the_equations(effects)
        self._tolerance = tolerance
        numbers = vars(values)
        self._names = _parameter_names(tuple(numbers), self._effects)
        self._numbers = [numbers[name] for name in self._names]

    def advance(self, mode: Mode, t: float, y: State, signs: Signs, until: float) -> tuple[Event, float, State, Segment]:
        """Integrate ``mode`` from ``y`` at ``t`` [s] until an event, or past the time ``until`` [s].

        Raises
        ------
        IntegratorGaveUpError
            If the state becomes non-finite or the steps do not end.
        """
        run = self._start(mode, t, y, signs)
        taylor = run.integrator
        series: list[Any] = []
        times = [t]
        event = Event.TIME_UP
        for _ in range(MAX_STEPS):
            outcome, _ = taylor.step(write_tc=True)
            series.append(taylor.tc.copy())
            times.append(taylor.time)
            if outcome != run.success:
                event = self._event(run, outcome, signs)
                break
            if taylor.time >= until:
                break
        else:
            raise IntegratorGaveUpError(f"{mode.name.lower()}: no event within {MAX_STEPS} steps, at t = {taylor.time:g} s")
        return event, taylor.time, self._final(run), _segment(run, signs, series, times)

    def advance_sampled(
        self, mode: Mode, t: float, y: State, signs: Signs, until: float, times: Array
    ) -> tuple[Event, float, State, Part]:
        """As `advance`, but return samples at those ``times`` [s] after ``t`` that it reaches: half the work of a segment."""
        run = self._start(mode, t, y, signs)
        taylor = run.integrator
        outcome, *_, rows = taylor.propagate_grid(np.concatenate([[t], times]), max_steps=MAX_STEPS)
        if outcome == run.time_limit and taylor.time < until:
            outcome = taylor.propagate_until(until, max_steps=MAX_STEPS)[0]
        event = Event.TIME_UP if outcome == run.time_limit else self._event(run, outcome, signs)
        values = _full(run, rows[1:].T)
        return event, taylor.time, self._final(run), Part(mode=mode, signs=signs, t=times[: values.shape[1]], values=values)

    def _start(self, mode: Mode, t: float, y: State, signs: Signs) -> _IntegratorOfMode:
        run = _compiled(mode, self._effects, self._tolerance, self._names)
        taylor = run.integrator
        taylor.time = t
        taylor.state[:] = [y[i] for i in run.rows]
        taylor.pars[:] = [*signs, *self._numbers][: len(taylor.pars)]
        taylor.reset_cooldowns()
        return run

    @staticmethod
    def _final(run: _IntegratorOfMode) -> State:
        return complete(run.mode, **dict(zip(run.names, run.integrator.state.tolist(), strict=True)))

    def _event(self, run: _IntegratorOfMode, outcome: Any, signs: Signs) -> Event:
        number = -int(getattr(outcome, "value", outcome)) - 1
        if not 0 <= number < len(run.events):
            state = ", ".join(f"{value:g}" for value in run.integrator.state)
            raise IntegratorGaveUpError(f"{run.mode.name.lower()}: integration broke down ({outcome}) at state {state}")
        return meaning(run.events[number], signs)


def _segment(run: _IntegratorOfMode, signs: Signs, series: list[Any], times: list[float]) -> Segment:
    """Turn Taylor series in time into polynomials in the fraction of each step."""
    edges = np.array(times)
    scale = np.diff(edges)[:, None] ** run.powers
    return Segment(mode=run.mode, signs=signs, times=edges, coefficients=_full(run, np.array(series) * scale[:, None, :]))


def _full(run: _IntegratorOfMode, variables: Array) -> Array:
    """Fill in the entries of the state that the mode implies, along the last axis but one."""
    full = np.zeros((*variables.shape[:-2], len(State._fields), variables.shape[-1]))
    full[..., run.rows, :] = variables
    follow(run.mode, run.names, full)
    return full
