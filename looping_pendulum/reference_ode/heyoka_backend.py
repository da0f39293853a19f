"""Integrate one mode with heyoka: Taylor series of high order, compiled once for each mode, tolerance and set of effects."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from operator import itemgetter
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from looping_pendulum.errors import IntegratorGaveUpError
from looping_pendulum.reference_ode.effects import EFFECTS, EffectKind
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_library import COMPILER_OPTIONS, compiled, load_heyoka
from looping_pendulum.reference_ode.solution import Segment, SegmentSamples
from looping_pendulum.reference_ode.state import (
    TINY_SPEED,
    Effects,
    Signs,
    State,
    event_in_phase,
    fill_in_heavy_speed,
    full_state,
    variables,
)
from looping_pendulum.reference_ode.transitions import Event, Mode

NAME = "heyoka"
# Far above need: the longest mode of the shipped scenarios (`static_friction`) takes 148 steps at 1e-12
MAX_STEPS = 20_000
"""Number of steps in one mode after which heyoka gives up."""
MAX_SAMPLED_STEPS = 5_000
"""The same for samples, but of a swing: fits ask for stiff strings, of which those that matter take up to 3 000 steps."""
_ACROSS_SIGN = Signs._fields.index("across")
SignAfterTurn = Callable[[float, State], float]
"""(time [s], state) at a turning point of the light mass -> sign of its speed across the string just after it."""


class Turns(NamedTuple):
    """Turning points of the light mass that were passed, n of them, in the order of time."""

    times: Array
    """[s], shape (n,)."""
    states: Array
    """Whole states just after, shape (len(State), n)."""
    across: Array
    """Signs of the speed across the string just after, shape (n,)."""


def absent_coefficients(effects: Effects) -> dict[str, float]:
    """Return the null values of the coefficients of all effects but those given."""
    return {c.name: c.null for effect in EFFECTS.values() if effect not in effects for c in effect.coefficients}


class ModeEquations:
    """Equations and event functions of one mode as heyoka expressions."""

    def __init__(self, mode: Mode, effects: Effects, parameter_names: tuple[str, ...]) -> None:
        hy = load_heyoka()

        self.names = names = variables(mode, effects)
        self.variables = dict(zip(names, hy.make_vars(*names), strict=True))
        y, t = full_state(mode, **self.variables), hy.time
        signs = Signs(*(hy.par[i] for i in range(len(Signs._fields))))
        offset = len(Signs._fields)
        self.parameters = {name: hy.par[offset + i] for i, name in enumerate(parameter_names)}
        """Name -> heyoka parameter; in heyoka's parameter array those of ``parameter_names`` follow the signs."""
        # Coefficients of absent effects are constants, so that heyoka folds their terms away
        p = SimpleNamespace(**(absent_coefficients(effects) | self.parameters))
        equations = Equations(hy, p, effects)
        rates = equations.rates(mode, t, y, signs)
        # A rate that is constant is a Python float; the sum makes it an expression
        self.system = [(self.variables[name], hy.expression(0.0) + getattr(rates, name)) for name in names]
        self.event_functions = equations.event_functions(mode, t, y, signs)
        self.rows = np.array([State._fields.index(name) for name in names])


class _IntegratorOfMode:
    """A Taylor integrator of one mode, with what it needs to translate states, parameters and events."""

    def __init__(self, mode: Mode, effects: Effects, tolerance: float, parameter_names: tuple[str, ...]) -> None:
        hy = load_heyoka()

        self.mode, self.names = mode, variables(mode, effects)
        self.rows = np.array([State._fields.index(name) for name in self.names])
        self.across = self.names.index("across_speed")
        self.turns: list[list[float]] | None = None
        """Time, variables and sign just after each turning point of the light mass that was passed; None: stop at the next."""
        self.sign_after_turn: SignAfterTurn | None = None
        """Sign of the speed after a turning point; None: the opposite one, whatever the state."""
        self.integrator, self.events = compiled(
            ("integrator", mode.name, tolerance, parameter_names),
            effects,
            lambda: _integrator(mode, effects, tolerance, parameter_names),
        )
        # Views, kept since heyoka makes a new one at each access, which `pass_turn` would notice
        self.state, self.pars = self.integrator.state, self.integrator.pars
        self.success, self.time_limit = hy.taylor_outcome.success, hy.taylor_outcome.time_limit
        self.powers = np.arange(self.integrator.order + 1)
        self.variables_of = itemgetter(*self.rows.tolist())
        """Returns the variables of the mode from a whole state."""

    def pass_turn(self) -> bool:
        """Return whether the integrator goes on past a turning point; heyoka calls this at each, hundreds of times a swing."""
        if self.turns is None or len(self.turns) >= MAX_STEPS:
            return False
        now, state = self.integrator.time, self.state
        sign = -self.pars.item(_ACROSS_SIGN) if self.sign_after_turn is None else self.sign_after_turn(now, self.whole_state())
        state[self.across] = TINY_SPEED * sign
        self.pars[_ACROSS_SIGN] = sign
        self.turns.append([now, *state.tolist(), sign])
        return True

    def whole_state(self) -> State:
        """Return the state at which the integrator stands."""
        return full_state(self.mode, **dict(zip(self.names, self.state.tolist(), strict=True)))


def _integrator(
    mode: Mode, effects: Effects, tolerance: float, parameter_names: tuple[str, ...]
) -> tuple[Any, tuple[Event, ...]]:
    """Compile the integrator of a mode; return it and its events in their order."""
    hy = load_heyoka()

    equations = ModeEquations(mode, effects, parameter_names)
    # Every event function falls through zero; without a direction heyoka would also report where it rises
    falling = hy.event_direction.negative
    callback = {Event.ACROSS_REVERSES: {"callback": _on_turn}} if mode is Mode.CLAMPED else {}
    integrator = hy.taylor_adaptive(
        equations.system,
        # Any state will do: `HeyokaIntegrator._start` sets it for every run
        [1.0] * len(equations.names),
        tol=tolerance,
        t_events=[
            hy.t_event(function, direction=falling, **callback.get(event, {}))
            for event, function in equations.event_functions.items()
        ],
        **COMPILER_OPTIONS,
    )
    return integrator, tuple(equations.event_functions)


_swinging: _IntegratorOfMode | None = None
"""Integrator that passes turning points now."""


def _on_turn(*_: Any) -> bool:
    # A function of the module, which is pickled by its name; heyoka would copy a bound method, and the object with it
    return _swinging is not None and _swinging.pass_turn()


_compiled = lru_cache(maxsize=64)(_IntegratorOfMode)


# So that runs with and without a push share their compiled code
@lru_cache(maxsize=64)
def _in_the_equations(effects: Effects) -> Effects:
    """Return the effects that change an equation, which a motion at release does not."""
    return tuple(effect for effect in effects if effect.kind is not EffectKind.RELEASE)


@lru_cache(maxsize=64)
def _parameter_names(known: tuple[str, ...], effects: Effects) -> tuple[str, ...]:
    """Return the names of the parameters that a compiled integrator takes, without those of absent effects."""
    return tuple(sorted(set(known) - absent_coefficients(effects).keys() - {"release"}))


class HeyokaIntegrator:
    """Integrates a mode until one of its events."""

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
        # Where the pivot holds the light mass nothing limits a step
        longest = math.inf if signs.across else max(until - t, 1e-3)
        for _ in range(MAX_STEPS):
            outcome, _ = taylor.step(max_delta_t=longest, write_tc=True)
            series.append(taylor.tc.copy())  # the next step overwrites them
            times.append(taylor.time)
            if outcome != run.success:
                if outcome != run.time_limit:
                    event = self._event(run, outcome, signs)
                break
            if taylor.time >= until:
                break
        else:
            raise IntegratorGaveUpError(f"{mode.name.lower()}: no event within {MAX_STEPS} steps, at t = {taylor.time:g} s")
        # As polynomials in the fraction of each step
        edges = np.array(times)
        coefficients = np.array(series) * (np.diff(edges)[:, None] ** run.powers)[:, None, :]
        segment = Segment(mode=mode, signs=signs, times=edges, coefficients=_full(run, coefficients))
        return event, taylor.time, run.whole_state(), segment

    def advance_sampled(
        self, mode: Mode, t: float, y: State, signs: Signs, until: float, times: Array
    ) -> tuple[Event, float, State, SegmentSamples]:
        """Do the same as `advance`, but return samples at those ``times`` [s] after ``t`` that it reaches.

        This is half the work of a segment.
        """
        run, max_steps = self._start(mode, t, y, signs), MAX_STEPS if mode is Mode.CLAMPED else MAX_SAMPLED_STEPS
        event, end, final, values = self._propagate(run, t, signs, until, times, max_steps)
        return event, end, final, SegmentSamples(mode=mode, signs=signs, t=times[: values.shape[1]], values=values)

    def advance_past_turns(
        self, t: float, y: State, signs: Signs, until: float, times: Array, sign_after_turn: SignAfterTurn | None
    ) -> tuple[Event, float, State, SegmentSamples, Turns]:
        """Do the same for a clamped heavy mass, but go on past the turning points of the light mass, to any other event.

        A long swing has hundreds of them, and to stop and start at one costs ten times as much as to integrate to the next.

        Parameters
        ----------
        sign_after_turn
            Called with the time and the state at each turning point; None: the light mass always turns back.
        """
        global _swinging
        run = self._start(Mode.CLAMPED, t, y, signs)
        run.turns, run.sign_after_turn, _swinging = [], sign_after_turn, run
        try:
            event, end, final, values = self._propagate(run, t, signs, until, times, MAX_STEPS)
            rows = np.array(run.turns).reshape(-1, len(run.names) + 2).T
        finally:
            run.turns = run.sign_after_turn = _swinging = None
        turns = Turns(rows[0], _full(run, rows[1:-1]), rows[-1])
        times = times[: values.shape[1]]
        # A sample at the very time of a turning point belongs to the part before it, as in `Driver.run_sampled`
        across = np.append(signs.across, turns.across)[np.searchsorted(turns.times, times, side="left")]
        signs = Signs(*np.broadcast_arrays(*signs._replace(across=across)))
        part = SegmentSamples(mode=Mode.CLAMPED, signs=signs, t=times, values=values)
        return event, end, final, part, turns

    def _propagate(
        self, run: _IntegratorOfMode, t: float, signs: Signs, until: float, times: Array, max_steps: int
    ) -> tuple[Event, float, State, Array]:
        """Advance to an event, or to ``until`` [s]; return it, its time and state, and those at ``times`` [s] in columns."""
        taylor = run.integrator
        outcome, *_, rows = taylor.propagate_grid(np.concatenate([[t], times]), max_steps=max_steps)
        if outcome == run.time_limit and taylor.time < until:
            # The samples end before the time limit, and the mode goes on
            outcome = taylor.propagate_until(until, max_steps=max_steps)[0]
        event = Event.TIME_UP if outcome == run.time_limit else self._event(run, outcome, signs)
        return event, taylor.time, run.whole_state(), _full(run, rows[1:].T)  # the first row is the start itself

    def _start(self, mode: Mode, t: float, y: State, signs: Signs) -> _IntegratorOfMode:
        """Return the compiled integrator of ``mode``, set to this time, state and these parameters."""
        run = _compiled(mode, self._effects, self._tolerance, self._names)
        run.integrator.time = t
        run.state[:] = run.variables_of(y)
        # heyoka knows no parameters beyond the last one that occurs in the equations
        run.pars[:] = [*signs, *self._numbers][: len(run.pars)]
        run.integrator.reset_cooldowns()  # else heyoka would ignore events just after those of an earlier run
        return run

    def _event(self, run: _IntegratorOfMode, outcome: Any, signs: Signs) -> Event:
        """Return the event at which the integrator stopped: heyoka numbers terminal events -1, -2, ... in their order."""
        number = -int(getattr(outcome, "value", outcome)) - 1
        if not 0 <= number < len(run.events):
            state = ", ".join(f"{value:g}" for value in run.integrator.state)
            raise IntegratorGaveUpError(f"{run.mode.name.lower()}: integration broke down ({outcome}) at state {state}")
        return event_in_phase(run.events[number], signs)


def _full(run: _IntegratorOfMode, variables: Array) -> Array:
    """Return whole states, along the last axis but one, from the variables of the mode."""
    full = np.zeros((*variables.shape[:-2], len(State._fields), variables.shape[-1]))
    full[..., run.rows, :] = variables
    fill_in_heavy_speed(run.mode, run.names, full)
    return full
