"""Functions of the equations, compiled by heyoka for many runs at once.

The inputs of a run are a column: `LEADING`, then the parameters of its apparatus.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from looping_pendulum.reference_ode.batch.series import Series, SeriesAlgebra
from looping_pendulum.reference_ode.effects import EFFECTS, EffectKind
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_library import COMPILER_OPTIONS, compiled, load_heyoka
from looping_pendulum.reference_ode.state import Effects, Signs, State, extra_variables, heavy_drop
from looping_pendulum.reference_ode.transitions import Mode

LEADING = (*State._fields, "time", *Signs._fields, "duration")
"""Inputs of every compiled function, in this order, before the parameters of the apparatus."""
DERIVED_ONLY = {"light_radius", "hanging_length"}
"""Parameters from which others are derived (`end_length`, `string_length`), while no equation of the paper reads them."""


class BatchModel(NamedTuple):
    """What is compiled into the functions of a batch: its effects, and the names of their inputs."""

    effects: Effects
    names: tuple[str, ...]
    """Names of the apparatus' parameters, the inputs after `LEADING`."""


def batch_model(effects: Effects, parameters: Mapping[str, Any]) -> BatchModel:
    """Return the model of runs with these effects and parameters.

    A motion at release is left out, as it enters no equation; so are coefficients of effects that do not act.
    """
    stepped = tuple(effect for effect in effects if effect.kind is not EffectKind.RELEASE)
    absent = {c.name for effect in EFFECTS.values() if effect not in stepped for c in effect.coefficients}
    unread = DERIVED_ONLY - ({"hanging_length"} if "heavy_tilt" in extra_variables(stepped) else set())
    return BatchModel(stepped, tuple(sorted(parameters.keys() - absent - unread)))


class CompiledFunction:
    """A compiled function, evaluated on the columns of a table."""

    def __init__(self, outputs: Sequence[Any], inputs: Sequence[Any]) -> None:
        hy = load_heyoka()

        self._function = hy.cfunc([expression(output) for output in outputs], list(inputs), **COMPILER_OPTIONS)

    def __call__(self, data: Array) -> Array:
        """Return the outputs, shape (number of outputs, n), of columns of inputs, shape (number of inputs, n).

        The outputs of a column do not depend, in any bit, on its place or on the other columns: the columns are padded, so that
        vector instructions compute all of them.
        """
        n = data.shape[1]
        padding = padding_columns(data, n)
        return self.evaluate_padded(np.concatenate([data, *padding], axis=1) if padding else data)[:, :n]

    def evaluate_padded(self, data: Array) -> Array:
        """Return the outputs of columns whose number is a multiple of `vector_size`."""
        # heyoka would start threads of its own; a batch uses processes, which also share the work between the calls
        out: Array = self._function(np.ascontiguousarray(data), batch_parallel=False)
        return out


@cache
def vector_size() -> int:
    """Return how many double-precision numbers one vector instruction of this processor takes."""
    hy = load_heyoka()

    return int(hy.recommended_simd_size())


def padding_columns(table: Array, n: int) -> list[Array]:
    """Return copies of the last column of ``table`` that fill ``n`` columns up to a multiple of `vector_size`; [] if none."""
    missing = -n % vector_size()
    return [table[:, -1:].repeat(missing, axis=1)] if missing else []


def expression(x: Any) -> Any:
    """Return a number, an expression, or the first coefficient of a series as an expression."""
    hy = load_heyoka()

    x = x[0] if isinstance(x, Series) else x
    return hy.expression(float(x)) if isinstance(x, (int, float)) else x


def absolute_value(x: Any) -> Any:
    """Return |x| as an expression."""
    hy = load_heyoka()

    x = expression(x)
    return hy.select(hy.lt(x, 0.0), -x, x)


class Symbols:
    """Symbolic inputs of a run, and the same as constant series, which the equations take as arguments."""

    def __init__(self, model: BatchModel) -> None:
        hy = load_heyoka()

        self.algebra = SeriesAlgebra()
        self.leading = {name: hy.expression(name) for name in LEADING}
        # A prefix tells parameters from the state's entries of the same name (free_length)
        parameters = {name: hy.expression(f"given {name}") for name in model.names}
        self.inputs = [*self.leading.values(), *parameters.values()]
        absent = {c.name: c.null for effect in EFFECTS.values() for c in effect.coefficients}
        self.signs = Signs(**{name: self.algebra.series(self.leading[name]) for name in Signs._fields})
        self.p = SimpleNamespace(**(absent | {name: self.algebra.series(symbol) for name, symbol in parameters.items()}))
        self.equations = Equations(self.algebra, self.p, model.effects)

    def arguments(self) -> tuple[Any, State, Signs]:
        """Return time, state and signs, in the order in which the equations take them."""
        t, *state = (self.algebra.series(self.leading[name]) for name in ("time", *State._fields))
        return t, State(*state), self.signs


@lru_cache(maxsize=64)
def holding_margins(model: BatchModel) -> CompiledFunction:
    """Compile `Equations.holding_margins`; outputs: margins (down, up) [N]."""
    return _compiled(model, "margins", (), lambda s: s.equations.holding_margins(Mode.STICKING, *s.arguments()))


@lru_cache(maxsize=64)
def light_tension(model: BatchModel, mode: Mode) -> CompiledFunction:
    """Compile the first of `Equations.tensions`; output: tension of the free string [N]."""
    return _compiled(model, "tension", mode.name, lambda s: s.equations.tensions(mode, *s.arguments())[:1])


@lru_cache(maxsize=64)
def rates(model: BatchModel, mode: Mode) -> CompiledFunction:
    """Compile `Equations.rates`; outputs: derivatives of the state."""
    return _compiled(model, "rates", mode.name, lambda s: s.equations.rates(mode, *s.arguments()))


@lru_cache(maxsize=64)
def impact(model: BatchModel, slide: float) -> CompiledFunction:
    """Compile `Equations.impact`; outputs: the state just after it, and the speed at which the string then slides [m/s]."""

    def outputs(s: Symbols) -> list[Any]:
        after = s.equations.impact(slide, *s.arguments())
        return [*after.state, after.sliding]

    return _compiled(model, "impact", slide, outputs)


@lru_cache(maxsize=64)
def drop(model: BatchModel) -> CompiledFunction:
    """Compile `state.heavy_drop` [m]."""
    return _compiled(
        model, "drop", (), lambda s: [heavy_drop(s.algebra, s.arguments()[1], s.signs.overlap, s.p, model.effects)]
    )


def _compiled(model: BatchModel, name: str, case: object, outputs: Callable[[Symbols], Sequence[Any]]) -> CompiledFunction:
    """Return a function of the equations, from disk if it was compiled before."""

    def make() -> CompiledFunction:
        symbols = Symbols(model)
        return CompiledFunction(outputs(symbols), symbols.inputs)

    return compiled(("batch", name, case, model.names), model.effects, make)
