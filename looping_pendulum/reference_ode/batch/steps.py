"""One step of one mode for many runs at once: their Taylor series, its length, and which events may lie in it.

heyoka compiles the whole step as one function of the state, the signs and the parameters, and evaluates it over arrays. The
steps are in s with dt = l ds, l the free length: the winding string makes the motion ever faster, but not in s.
"""

from __future__ import annotations

import math
from functools import cached_property, lru_cache, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode import equations
from looping_pendulum.reference_ode.batch.compiled import LEADING, BatchModel, CompiledFunction, Symbols, expression, size
from looping_pendulum.reference_ode.batch.roots import CLOSE, first_falls, horner, look
from looping_pendulum.reference_ode.batch.series import Series
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_library import load_heyoka
from looping_pendulum.reference_ode.state import Effects, complete, variables
from looping_pendulum.reference_ode.transitions import Event, Mode

OF_TENSION = (Event.STOP, Event.LOSES_TENSION, Event.SLIP_ONSET_DOWN, Event.SLIP_ONSET_UP)
"""Events whose functions are forces, with w^2 / l in them: times l, which changes no sign, they are smooth to the end."""
LAST_TERM = 0.05
"""Largest last term of a step's series over the tolerance: errors of some hundred steps add up."""
LONGEST = 100.0
"""Longest step in s [s/m]."""

NONE, UNSURE = -1, -2
"""In place of an event's index."""


def covered(effects: Effects) -> bool:
    """Whether runs with these effects can be stepped here: neither variables of their own nor a string that lies on itself."""
    return not any(effect.variables or effect.winding or effect.watches_first_turn for effect in effects)


class Stepper:
    """The compiled step of a mode, as functions of runs' numbers (`compiled.CompiledFunction`)."""

    def __init__(self, model: BatchModel, mode: Mode, tolerance: float) -> None:
        hy = load_heyoka()

        self.order = order = math.ceil(2.0 - 0.5 * math.log(tolerance))
        moving = (*variables(mode, model.effects), "time")
        self.rows = np.array([LEADING.index(name) for name in moving])
        """Rows of the input that a step changes."""
        symbols = Symbols(model)
        motion, watched = _series(symbols, mode, model.effects)
        self.events = tuple(watched)
        length = _step_length(hy, [motion[name] for name in moving[:-1]], list(watched.values()), order, tolerance)
        powers = [length**k for k in range(order + 1)]
        moved, changes = (
            [[expression(series[k]) * powers[k] for k in range(order + 1)] for series in part.values()]
            for part in (motion, watched)
        )
        lows = [hy.sum([terms[0], *(_smaller(hy, term, 0.0) for term in terms[1:])]) for terms in changes]
        self.step = CompiledFunction([*(hy.sum(terms) for terms in moved), _least(hy, lows)], symbols.inputs)
        """Values of `rows` at the end of the step, and a lower bound of all event functions within it."""
        fraction, event = _first_event(hy, changes, lows)
        self._meet = CompiledFunction([*(horner(terms, fraction) for terms in moved), event], symbols.inputs)
        self._terms, self._inputs = [term for terms in moved + changes for term in terms], symbols.inputs

    def meet(self, data: Array) -> tuple[Array, NDArray[np.int64]]:
        """Values of `rows` at the first event, or at the end of the step without one; and the event's index, or `NONE`.

        The index is `UNSURE` where only `search` finds it. Values are not finite where a run breaks down.
        """
        out = self._meet(data)
        return out[:-1], out[-1].astype(np.int64)

    def search(self, data: Array) -> tuple[Array, NDArray[np.int64]]:
        """Do as `meet`, by a search that is slower but always sure."""
        coefficients = self._expand(data).reshape(-1, self.order + 1, data.shape[1]).swapaxes(0, 1)
        motion, changes = coefficients[:, : len(self.rows)], coefficients[:, len(self.rows) :]
        falls = first_falls(changes.reshape(len(changes), -1)).reshape(changes.shape[1:])
        first, event = falls.min(axis=0), np.where(np.isfinite(falls).any(axis=0), falls.argmin(axis=0), NONE)
        whole = np.isfinite(coefficients).all(axis=(0, 1))
        return horner(motion, np.where(whole, np.minimum(first, 1.0), np.nan)), event

    @cached_property
    def _expand(self) -> CompiledFunction:
        """Coefficients of `rows` and then of the event functions, of each all, in powers of the fraction of the step."""
        return CompiledFunction(self._terms, self._inputs)


def _series(symbols: Symbols, mode: Mode, effects: Effects) -> tuple[dict[str, Series], dict[Event, Series]]:
    """Series in s of what moves (time included) and of the event functions."""
    book, inputs = symbols.book, symbols.leading
    rates: dict[str, Series] = {}
    motion = {
        name: book.variable(inputs[name], lambda name=name: rates[name])  # type: ignore[misc]
        for name in (*variables(mode, effects), "time")
    }
    t = motion["time"]
    y = complete(mode, **{name: series for name, series in motion.items() if name != "time"})
    by_time = equations.rates(book, mode, t, y, symbols.signs, symbols.p, effects)._asdict() | {"time": 1.0}
    rates.update({name: y.free_length * by_time[name] for name in motion})
    watched = equations.event_functions(book, mode, t, y, symbols.signs, symbols.p, effects)
    watched |= {event: y.free_length * function for event, function in watched.items() if event in OF_TENSION}
    watched[Event.TIME_UP] = book.series(inputs["duration"]) - t
    return motion, {event: book.series(function) for event, function in watched.items()}


def _first_event(hy: Any, changes: list[list[Any]], lows: list[Any]) -> tuple[Any, Any]:
    """Fraction of the step until an event function first falls through zero, else 1; and the event as in `Stepper.meet`.

    That is unsure where Descartes' rule leaves more than one root open, Newton's method fails, or numbers are not finite.
    """
    first, event, sure = (hy.expression(value) for value in (math.inf, float(NONE), 1.0))
    for i, (terms, low) in enumerate(zip(changes, lows, strict=True)):
        seen = look(terms)
        above = [hy.select(hy.gt(coefficient, 0.0), hy.expression(1.0), hy.expression(0.0)) for coefficient in seen.bernstein]
        sign_changes = hy.sum([(a - b) * (a - b) for a, b in zip(above, above[1:], strict=False)])
        found = hy.logical_and([hy.gte(seen.root, 0.0), hy.lte(seen.root, 1.0), hy.lt(seen.moved, CLOSE)])
        falls = hy.logical_and([hy.eq(sign_changes, 1.0), hy.gt(above[0], 0.0)])
        rises = hy.logical_and([hy.eq(sign_changes, 1.0), hy.eq(above[0], 0.0)])
        clear = hy.logical_or([hy.gt(low, 0.0), hy.eq(sign_changes, 0.0), rises, hy.logical_and([falls, found])])
        finite = hy.lt(hy.sum([size(term) for term in terms]), math.inf)
        sure = hy.select(hy.logical_and([clear, finite]), sure, 0.0)
        earlier = hy.logical_and([hy.lte(low, 0.0), falls, found, hy.lt(seen.root, first)])
        first, event = hy.select(earlier, seen.root, first), hy.select(earlier, hy.expression(float(i)), event)
    return _smaller(hy, first, 1.0), hy.select(hy.gt(sure, 0.0), event, float(UNSURE))


def _step_length(hy: Any, moving: list[Series], watched: list[Series], order: int, tolerance: float) -> Any:
    """Longest step in s whose last two terms are below the tolerance, those of the event functions (SI) too.

    As Jorba and Zou (2005) choose it, but for the size of the last term, `LAST_TERM`. Errors count relative to what is above 1.
    """

    def largest(sizes: list[Any]) -> Any:
        return reduce(lambda a, b: _larger(hy, a, b), sizes)

    scale = _larger(hy, largest([size(series[0]) for series in moving]), 1.0)
    scales = [*(scale for _ in moving), *(_larger(hy, size(series[0]), 1.0) for series in watched)]
    inverses = [1.0 / scale for scale in scales]
    lengths = []
    for n in (order - 1, order):
        last = largest([size(series[n]) * inverse for series, inverse in zip(moving + watched, inverses, strict=True)])
        lengths.append(hy.exp((math.log(LAST_TERM * tolerance) - hy.log(last)) * (1.0 / n)))
    return _smaller(hy, _smaller(hy, *lengths), LONGEST)


def _larger(hy: Any, a: Any, b: Any) -> Any:
    return hy.select(hy.gt(a, b), a, b)


def _smaller(hy: Any, a: Any, b: Any) -> Any:
    return hy.select(hy.lt(a, b), a, b)


def _least(hy: Any, sizes: list[Any]) -> Any:
    return reduce(lambda a, b: _smaller(hy, a, b), sizes)


@lru_cache(maxsize=64)
def stepper(model: BatchModel, mode: Mode, tolerance: float) -> Stepper:
    """The compiled step of ``mode``."""
    return Stepper(model, mode, tolerance)
