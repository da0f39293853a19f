"""Expressions of the equations, compiled by heyoka into functions of many runs at once.

A run's numbers are a column: `LEADING`, then those of its apparatus.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from looping_pendulum.reference_ode import equations
from looping_pendulum.reference_ode.batch.series import Series, SeriesAlgebra
from looping_pendulum.reference_ode.effects import EFFECTS, EffectKind
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_library import load_heyoka
from looping_pendulum.reference_ode.state import Effects, Signs, State, heavy_drop
from looping_pendulum.reference_ode.transitions import Mode

STATE = State._fields[: State._fields.index("slack") + 1]
"""Entries of the state that a run without effects of its own variables has."""
SIGNS = Signs._fields[: Signs._fields.index("phase") + 1]
LEADING = (*STATE, "time", *SIGNS, "duration")
"""What a run is described by, before the numbers of its apparatus."""
UNREAD = {"light_radius", "hanging_length"}
"""Numbers that only others are made of; no equation reads them."""


class BatchModel(NamedTuple):
    """What the equations of a batch depend on, beside the runs' numbers."""

    effects: Effects
    names: tuple[str, ...]
    """Numbers of the apparatus that each run has."""


def model_of(effects: Effects, numbers: Mapping[str, Any]) -> BatchModel:
    """The model of runs with these effects and numbers."""
    stepped = tuple(effect for effect in effects if effect.kind is not EffectKind.RELEASE)
    absent = {c.name for effect in EFFECTS.values() if effect not in stepped for c in effect.coefficients}
    return BatchModel(stepped, tuple(sorted(numbers.keys() - absent - UNREAD)))


class CompiledFunction:
    """A compiled function of columns of numbers."""

    def __init__(self, outputs: Sequence[Any], inputs: Sequence[Any]) -> None:
        hy = load_heyoka()

        self._function = hy.cfunc([expression(output) for output in outputs], list(inputs))

    def __call__(self, data: Array) -> Array:
        """Outputs, shape (number of outputs, n), of columns of inputs, shape (number of inputs, n).

        What comes of a column does not depend on where it stands, nor on the others: all are computed by vector instructions.
        """
        n = data.shape[1]
        more = filler(data, n)
        return self.whole_vectors(np.concatenate([data, *more], axis=1) if more else data)[:, :n]

    def whole_vectors(self, data: Array) -> Array:
        """The same for a number of columns that fills whole vectors."""
        out: Array = self._function(np.ascontiguousarray(data), batch_parallel=False)
        return out


@cache
def vector_size() -> int:
    """How many numbers this processor takes at once."""
    hy = load_heyoka()

    return int(hy.recommended_simd_size())


def filler(table: Array, n: int) -> list[Array]:
    """What ``n`` columns, the last one that of ``table``, lack to fill whole vectors: copies of the last, if anything."""
    missing = -n % vector_size()
    return [table[:, -1:].repeat(missing, axis=1)] if missing else []


def expression(x: Any) -> Any:
    """A number, or a series' first coefficient, as an expression."""
    hy = load_heyoka()

    x = x[0] if isinstance(x, Series) else x
    return hy.expression(float(x)) if isinstance(x, (int, float)) else x


def size(x: Any) -> Any:
    """Absolute value, as an expression."""
    hy = load_heyoka()

    x = expression(x)
    return hy.select(hy.lt(x, 0.0), -x, x)


class Symbols:
    """A run's numbers as series for the equations."""

    def __init__(self, model: BatchModel) -> None:
        hy = load_heyoka()

        self.book = SeriesAlgebra()
        self.leading = {name: hy.expression(name) for name in LEADING}
        numbers = {name: hy.expression(f"given {name}") for name in model.names}
        self.inputs = [*self.leading.values(), *numbers.values()]
        absent = {c.name: c.null for effect in EFFECTS.values() for c in effect.coefficients}
        self.signs = Signs(**{name: self.book.series(self.leading[name]) for name in SIGNS})
        self.p = SimpleNamespace(**(absent | {name: self.book.series(number) for name, number in numbers.items()}))

    def instant(self) -> tuple[Any, State, Signs, Any]:
        """Time, state, signs and parameters of one instant."""
        t, *state = (self.book.series(self.leading[name]) for name in ("time", *STATE))
        return t, State(*state), self.signs, self.p


@lru_cache(maxsize=64)
def holding_margins(model: BatchModel) -> CompiledFunction:
    """`equations.holding_margins`: down, up."""
    symbols = Symbols(model)
    return CompiledFunction(equations.holding_margins(symbols.book, *symbols.instant(), model.effects), symbols.inputs)


@lru_cache(maxsize=64)
def light_tension(model: BatchModel, mode: Mode) -> CompiledFunction:
    """The first of `equations.tensions`."""
    symbols = Symbols(model)
    return CompiledFunction(equations.tensions(symbols.book, mode, *symbols.instant(), model.effects)[:1], symbols.inputs)


@lru_cache(maxsize=64)
def rates(model: BatchModel, mode: Mode) -> CompiledFunction:
    """`equations.rates` of `STATE`."""
    symbols = Symbols(model)
    rate = equations.rates(symbols.book, mode, *symbols.instant(), model.effects)
    return CompiledFunction([getattr(rate, name) for name in STATE], symbols.inputs)


@lru_cache(maxsize=64)
def impact(model: BatchModel, slide: float) -> CompiledFunction:
    """`equations.impact`: `STATE`, and the speed at which the string then slides."""
    symbols = Symbols(model)
    hit = equations.impact(symbols.book, slide, *symbols.instant(), model.effects)
    return CompiledFunction([*(getattr(hit.state, name) for name in STATE), hit.sliding], symbols.inputs)


@lru_cache(maxsize=64)
def drop(model: BatchModel) -> CompiledFunction:
    """`state.heavy_drop`, of a string that does not lie on itself."""
    symbols = Symbols(model)
    _, y, _, p = symbols.instant()
    return CompiledFunction([heavy_drop(symbols.book, y, 0.0, p, model.effects)], symbols.inputs)
