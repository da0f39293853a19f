"""One Taylor step of one mode for many runs at once: the series, the length of the step, and the events within it.

heyoka compiles the whole step as one function of the state, the signs and the parameters, and evaluates it over arrays. The
independent variable of a step is s with dt = l ds, l the free length: as the string winds the motion becomes ever faster in t,
but not in s.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, lru_cache, reduce
from itertools import chain
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.batch.compiled import (
    LEADING,
    BatchModel,
    CompiledFunction,
    Symbols,
    TaylorSeries,
    absolute_value,
    expression,
)
from looping_pendulum.reference_ode.batch.roots import first_falling_roots, horner
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_library import compiled, load_heyoka
from looping_pendulum.reference_ode.state import Effects, State, extra_variables, full_state, variables
from looping_pendulum.reference_ode.transitions import Event, Mode

FORCE_EVENTS = (Event.STOP, Event.LOSES_TENSION, Event.SLIP_ONSET_DOWN, Event.SLIP_ONSET_UP)
"""Events whose functions are forces that contain w^2 / l. Times l, which changes no sign, they stay smooth as l shrinks."""
LAST_TERM_TOLERANCE = 0.05
"""Largest last term of a step's series, as a fraction of the tolerance: errors of some hundred steps add up."""
# Needed where the last terms of the series vanish, for which the formula of the step's length gives infinity
MAX_STEP_LENGTH = 100.0
"""Longest step in s [s/m]."""

T = TypeVar("T")
NO_EVENT = -1
"""Value in place of an event's index: no event within the step."""


SINGLY = frozenset({"rod_speed", "light_stretch"})
"""State variables of a rod that turns and of a string that stretches: with these, runs are made one by one."""


def supports_batch(effects: Effects) -> bool:
    """Return whether a batch can step runs with these effects.

    It can unless the rod turns or the string stretches, whose transitions are written for one run.
    """
    return extra_variables(effects).isdisjoint(SINGLY)


class Stepper:
    """The compiled step of a mode; its functions take a table of runs (`Block.inputs`), one column per run."""

    def __init__(self, model: BatchModel, mode: Mode, tolerance: float) -> None:
        self.mode, self._model, self._tolerance = mode, model, tolerance
        # One order above that of Jorba and Zou (2005), ceil(1 - ln(tolerance) / 2)
        self.order = math.ceil(2.0 - 0.5 * math.log(tolerance))
        moving = (*variables(mode, model.effects), "time")
        self.rows = np.array([LEADING.index(name) for name in moving])
        """Rows of the inputs that a step changes."""
        self.resting = [row for row in range(len(State._fields)) if row not in self.rows]
        """Rows of the state that it does not change."""
        self.heavy_mass_follows = mode.string_moves and "heavy_speed" not in moving
        """Whether the taut string gives the heavy mass the light mass's speed along it (`state.full_state`)."""
        self.events: tuple[Event, ...] = self._compiled("events", lambda: self._terms.events)

    @cached_property
    def step(self) -> CompiledFunction:
        """Compile the step; outputs: `rows` at its end, then a lower bound of all event functions within it."""
        hy = load_heyoka()
        return self._function("step", lambda t: [*(hy.sum(terms) for terms in t.motion), _smallest(hy, t.lower_bounds)])

    @cached_property
    def series(self) -> CompiledFunction:
        """Compile the step as series; outputs: for each of `rows` its terms, `resting`, the terms of the event functions, and
        the lower bound of `step`.

        The terms of a series are the coefficients of the powers of the fraction of the step, in ascending order.
        """
        hy = load_heyoka()

        def outputs(t: _Terms) -> list[Any]:
            resting = [t.inputs[row] for row in self.resting]
            return [*chain(*t.motion), *resting, *chain(*t.event_functions), _smallest(hy, t.lower_bounds)]

        return self._function("series", outputs)

    @property
    def sampled(self) -> slice:
        """Outputs of `series` that samples are made of: the terms of `rows`, then `resting`."""
        return slice(0, len(self.rows) * (self.order + 1) + len(self.resting))

    def end(self, series: Array) -> Array:
        """Return `rows` at the end of a step from the outputs of `series`."""
        moved: Array = self._terms_of_rows(series).sum(axis=1)
        return moved

    def first_event(self, series: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return `rows` at the first event of a step, or at its end if there is none, and the event's index, or `NO_EVENT`.

        Values are not finite where a run breaks down.
        """
        n = series.shape[1]
        functions = series[self.sampled.stop : -1].reshape(len(self.events), self.order + 1, n).swapaxes(0, 1)
        falls = first_falling_roots(functions.reshape(self.order + 1, -1)).reshape(len(self.events), n)
        first, event = falls.min(axis=0), np.where(np.isfinite(falls).any(axis=0), falls.argmin(axis=0), NO_EVENT)
        finite = np.isfinite(series).all(axis=0)
        at = np.where(finite, np.minimum(first, 1.0), np.nan)
        return horner(self._terms_of_rows(series).swapaxes(0, 1), at), event

    def _terms_of_rows(self, series: Array) -> Array:
        return series[: len(self.rows) * (self.order + 1)].reshape(len(self.rows), self.order + 1, -1)

    def _function(self, name: str, outputs: Callable[[_Terms], list[Any]]) -> CompiledFunction:
        return self._compiled(name, lambda: CompiledFunction(outputs(self._terms), self._terms.inputs))

    def _compiled(self, name: str, make: Callable[[], T]) -> T:
        what = ("step", name, self.mode.name, self._tolerance, self._model.names)
        return compiled(what, self._model.effects, make)

    @cached_property
    def _terms(self) -> _Terms:
        """Make the expressions, which is needed only for what was not compiled before."""
        return _terms(self._model, self.mode, self._tolerance, self.order)


class _Terms(NamedTuple):
    """Terms of the step's series as expressions: of each series the coefficients of the powers of the fraction of the step."""

    motion: list[list[Any]]
    event_functions: list[list[Any]]
    lower_bounds: list[Any]
    """Below each event function within the step."""
    events: tuple[Event, ...]
    inputs: list[Any]


def _terms(model: BatchModel, mode: Mode, tolerance: float, order: int) -> _Terms:
    hy = load_heyoka()

    symbols = Symbols(model)
    motion_series, event_series = _series(symbols, mode, model.effects)
    *moving, _ = motion_series.values()  # without the time
    length = _step_length(hy, moving, list(event_series.values()), order, tolerance)
    powers = [length**k for k in range(order + 1)]
    motion, event_functions = (
        [[expression(series[k]) * powers[k] for k in range(order + 1)] for series in part.values()]
        for part in (motion_series, event_series)
    )
    # On [0, 1] no power of the fraction exceeds 1, so a polynomial is at least its constant plus its negative terms
    lower_bounds = [hy.sum([terms[0], *(_smaller(hy, term, 0.0) for term in terms[1:])]) for terms in event_functions]
    return _Terms(motion, event_functions, lower_bounds, tuple(event_series), symbols.inputs)


def _series(symbols: Symbols, mode: Mode, effects: Effects) -> tuple[dict[str, TaylorSeries], dict[Event, TaylorSeries]]:
    """Return the Taylor series in s of the moving variables and the time, and those of the event functions."""
    algebra, inputs = symbols.algebra, symbols.leading
    rates: dict[str, TaylorSeries] = {}
    motion_series = {
        name: algebra.variable(inputs[name], lambda name=name: rates[name])  # type: ignore[misc]
        for name in (*variables(mode, effects), "time")
    }
    t = motion_series["time"]
    y = full_state(mode, **{name: series for name, series in motion_series.items() if name != "time"})
    by_time = symbols.equations.rates(mode, t, y, symbols.signs)._asdict() | {"time": 1.0}
    rates.update({name: y.free_length * by_time[name] for name in motion_series})
    event_series = symbols.equations.event_functions(mode, t, y, symbols.signs)
    event_series |= {event: y.free_length * function for event, function in event_series.items() if event in FORCE_EVENTS}
    event_series[Event.TIME_UP] = algebra.series(inputs["duration"]) - t
    return motion_series, {event: algebra.series(function) for event, function in event_series.items()}


def _step_length(hy: Any, moving: list[TaylorSeries], event_series: list[TaylorSeries], order: int, tolerance: float) -> Any:
    """Return the longest step in s whose last two terms, those of the event functions (SI) included, are within the tolerance.

    This is the choice of Jorba and Zou (2005) except for the size of the last term, `LAST_TERM_TOLERANCE`. Errors are relative
    to the largest variable (or to an event function's own value) where that is above 1, else absolute.
    """

    def largest(sizes: list[Any]) -> Any:
        return reduce(lambda a, b: _larger(hy, a, b), sizes)

    scale = _larger(hy, largest([absolute_value(series[0]) for series in moving]), 1.0)
    scales = [*(scale for _ in moving), *(_larger(hy, absolute_value(series[0]), 1.0) for series in event_series)]
    inverses = [1.0 / scale for scale in scales]
    lengths = []
    for n in (order - 1, order):
        last = largest(
            [absolute_value(series[n]) * inverse for series, inverse in zip(moving + event_series, inverses, strict=True)]
        )
        lengths.append(hy.exp((math.log(LAST_TERM_TOLERANCE * tolerance) - hy.log(last)) * (1.0 / n)))
    return _smaller(hy, _smaller(hy, *lengths), MAX_STEP_LENGTH)


def _larger(hy: Any, a: Any, b: Any) -> Any:
    return hy.select(hy.gt(a, b), a, b)


def _smaller(hy: Any, a: Any, b: Any) -> Any:
    return hy.select(hy.lt(a, b), a, b)


def _smallest(hy: Any, sizes: list[Any]) -> Any:
    return reduce(lambda a, b: _smaller(hy, a, b), sizes)


@lru_cache(maxsize=64)
def stepper(model: BatchModel, mode: Mode, tolerance: float) -> Stepper:
    """Return the compiled step of ``mode``; compiling takes seconds, so it is cached."""
    return Stepper(model, mode, tolerance)
