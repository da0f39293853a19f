"""One step of one mode for many runs at once: their Taylor series, its length, and which events may lie in it.

heyoka compiles the whole step as one function of the state, the signs and the parameters, and evaluates it over arrays. The
steps are in s with dt = l ds, l the free length: the winding string makes the motion ever faster, but not in s.
"""

from __future__ import annotations

import math
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from looping_pendulum.reference_ode import equations
from looping_pendulum.reference_ode.batch.series import Book, Series
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.state import Effects, Signs, State, complete, variables
from looping_pendulum.reference_ode.transitions import Event, Mode

STATE = State._fields[: State._fields.index("slack") + 1]
"""Entries of the state that a run without effects of its own variables has."""
SIGNS = Signs._fields[: Signs._fields.index("phase") + 1]
LEADING = (*STATE, "time", *SIGNS, "duration")
"""What a run is described by, before the numbers of its apparatus."""


OF_TENSION = (Event.STOP, Event.LOSES_TENSION, Event.BREAKS_DOWN, Event.BREAKS_UP)
"""Events whose functions are forces, with w^2 / l in them: times l, which changes no sign, they are smooth to the end."""
LAST_TERM = 0.05
"""Largest last term of a step's series over the tolerance: errors of some hundred steps add up."""
LONGEST = 100.0
"""Longest step in s [s/m]."""


def covered(effects: Effects) -> bool:
    """Whether runs with these effects can be stepped here: neither variables of their own nor a string that lies on itself."""
    return not any(effect.variables or effect.winding or effect.watches_first_turn for effect in effects)


class Stepper:
    """The compiled step of a mode: two functions of arrays of shape (rows, n), the rows being `LEADING` and the parameters."""

    def __init__(self, mode: Mode, effects: Effects, tolerance: float, parameter_names: tuple[str, ...]) -> None:
        import heyoka as hy

        self.order = order = math.ceil(2.0 - 0.5 * math.log(tolerance))
        moving = variables(mode, effects)
        self.rows = np.array([LEADING.index(name) for name in (*moving, "time")])
        """Rows of the input that a step changes."""
        inputs = {name: hy.expression(name) for name in LEADING}
        numbers = {name: hy.expression(f"given {name}") for name in parameter_names}
        motion, watched = _series(mode, effects, inputs, numbers)
        self.events = tuple(watched)
        length = _step_length(hy, [motion[name] for name in moving], list(watched.values()), order, tolerance)
        powers = [length**k for k in range(order + 1)]
        moved, changes = (
            [[_expression(hy, series[k]) * powers[k] for k in range(order + 1)] for series in part.values()]
            for part in (motion, watched)
        )
        ends = [hy.sum(terms) for terms in moved]
        lows = [hy.sum([terms[0], *(_smaller(hy, term, 0.0) for term in terms[1:])]) for terms in changes]
        names = [*inputs.values(), *numbers.values()]
        self._step = hy.cfunc([*ends, *lows], names)
        self._expand = hy.cfunc([term for terms in moved + changes for term in terms], names)

    def step(self, data: Array) -> tuple[Array, Array]:
        """Values of `rows` at the end of the step, and lower bounds of the event functions within it."""
        out = self._step(data, batch_parallel=False)
        return out[: len(self.rows)], out[len(self.rows) :]

    def expand(self, data: Array) -> tuple[Array, Array]:
        """Coefficients of `rows` and of the event functions in powers of the fraction of the step, shape (order + 1, ., n)."""
        out = self._expand(data, batch_parallel=False).reshape(-1, self.order + 1, data.shape[1]).swapaxes(0, 1)
        return out[:, : len(self.rows)], out[:, len(self.rows) :]


def _series(
    mode: Mode, effects: Effects, inputs: dict[str, Any], numbers: dict[str, Any]
) -> tuple[dict[str, Series], dict[Event, Series]]:
    """Series in s of what moves (time included) and of the event functions."""
    book = Book()
    rates: dict[str, Series] = {}
    motion = {
        name: book.variable(inputs[name], lambda name=name: rates[name])  # type: ignore[misc]
        for name in (*variables(mode, effects), "time")
    }
    t = motion["time"]
    y = complete(mode, **{name: series for name, series in motion.items() if name != "time"})
    signs = Signs(**{name: book.series(inputs[name]) for name in SIGNS})
    absent = {c.name: c.null for effect in EFFECTS.values() for c in effect.coefficients}
    p = SimpleNamespace(**(absent | {name: book.series(number) for name, number in numbers.items()}))
    by_time = equations.rates(book, mode, t, y, signs, p, effects)._asdict() | {"time": 1.0}
    rates.update({name: y.free_length * by_time[name] for name in motion})
    watched = equations.event_functions(book, mode, t, y, signs, p, effects)
    watched |= {event: y.free_length * function for event, function in watched.items() if event in OF_TENSION}
    watched[Event.TIME_UP] = book.series(inputs["duration"]) - t
    return motion, {event: book.series(function) for event, function in watched.items()}


def _step_length(hy: Any, moving: list[Series], watched: list[Series], order: int, tolerance: float) -> Any:
    """Longest step in s whose last two terms are below the tolerance, those of the event functions (SI) too.

    As Jorba and Zou (2005) choose it, but for the size of the last term, `LAST_TERM`. Errors count relative to what is above 1.
    """

    def largest(sizes: list[Any]) -> Any:
        whole = sizes[0]
        for size in sizes[1:]:
            whole = _larger(hy, whole, size)
        return whole

    scale = _larger(hy, largest([_size(hy, series[0]) for series in moving]), 1.0)
    scales = [*(scale for _ in moving), *(_larger(hy, _size(hy, series[0]), 1.0) for series in watched)]
    inverses = [1.0 / scale for scale in scales]
    lengths = []
    for n in (order - 1, order):
        last = largest([_size(hy, series[n]) * inverse for series, inverse in zip(moving + watched, inverses, strict=True)])
        lengths.append(hy.exp((math.log(LAST_TERM * tolerance) - hy.log(last)) * (1.0 / n)))
    return _smaller(hy, _smaller(hy, *lengths), LONGEST)


def _expression(hy: Any, x: Any) -> Any:
    return hy.expression(x) if isinstance(x, (int, float)) else x


def _size(hy: Any, x: Any) -> Any:
    x = _expression(hy, x)
    return hy.select(hy.lt(x, 0.0), -x, x)


def _larger(hy: Any, a: Any, b: Any) -> Any:
    return hy.select(hy.gt(a, b), a, b)


def _smaller(hy: Any, a: Any, b: Any) -> Any:
    return hy.select(hy.lt(a, b), a, b)


@lru_cache(maxsize=64)
def stepper(mode: Mode, effects: Effects, tolerance: float, parameter_names: tuple[str, ...]) -> Stepper:
    """The compiled step of ``mode``."""
    return Stepper(mode, effects, tolerance, parameter_names)
