"""Functions of the equations, compiled by heyoka for many runs at once, and the Taylor series of which a step is made.

The inputs of a run are a column: `LEADING`, then the parameters of its apparatus. `equations` takes Taylor series as it takes
floats (automatic differentiation of high order). Each coefficient is a closed expression of the state and the parameters, so
that one compiled function gives the whole series of a step.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from looping_pendulum.reference_ode.effects import EffectKind
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_backend import absent_coefficients
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
    unread = DERIVED_ONLY - ({"hanging_length"} if "heavy_tilt" in extra_variables(stepped) else set())
    return BatchModel(stepped, tuple(sorted(parameters.keys() - absent_coefficients(stepped).keys() - unread)))


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

    x = x[0] if isinstance(x, TaylorSeries) else x
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
        absent = absent_coefficients(model.effects)
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


class TaylorSeries:
    """A Taylor series; its normalised coefficients x^(n) / n! are computed in order when they are asked for."""

    __slots__ = ("_coefficients", "_compute", "algebra", "constant", "number")

    def __init__(self, algebra: SeriesAlgebra, compute: Callable[[int, TaylorSeries], Any], constant: bool = False) -> None:
        self.algebra = algebra
        self.number = next(algebra.numbers)
        """Serial number. Keys of the cache and the order of operands use it, not `id`, so that every process compiles the same
        terms in the same order, and results are equal to the last bit.
        """
        self.constant = constant
        """Whether every coefficient but the first is zero."""
        self._compute = compute
        self._coefficients: list[Any] = []

    def __getitem__(self, n: int) -> Any:
        """Return the normalised coefficient of order ``n``."""
        if self.constant and n:
            return 0.0
        while len(self._coefficients) <= n:
            self._coefficients.append(self._compute(len(self._coefficients), self))
        return self._coefficients[n]

    def __add__(self, other: Any) -> TaylorSeries:
        a, b = self.algebra.ordered_operands(self, other)
        return self.algebra.cached("+", a, b, lambda n, _: a[n] + b[n])

    def __sub__(self, other: Any) -> TaylorSeries:
        a, b = self, self.algebra.series(other)
        return self.algebra.cached("-", a, b, lambda n, _: a[n] - b[n])

    def __mul__(self, other: Any) -> TaylorSeries:
        a, b = self.algebra.ordered_operands(self, other)
        if a.constant:
            return self.algebra.cached("*", a, b, lambda n, _: a[0] * b[n])
        if b.constant:
            return self.algebra.cached("*", a, b, lambda n, _: a[n] * b[0])
        if a is b:
            return self.algebra.cached("*", a, a, lambda n, _: self.algebra.square(a, n, 0))
        return self.algebra.cached("*", a, b, lambda n, _: self.algebra.product(a, b, range(n + 1), n))

    def __truediv__(self, other: Any) -> TaylorSeries:
        a, b = self, self.algebra.series(other)
        inverse = self.algebra.inverse(b)
        if b.constant:
            return self.algebra.cached("/", a, b, lambda n, _: a[n] * inverse)
        return self.algebra.cached(
            "/",
            a,
            b,
            lambda n, own: (a[n] - self.algebra.product(b, own, range(1, n + 1), n)) * inverse if n else a[0] * inverse,
        )

    def __neg__(self) -> TaylorSeries:
        return self.algebra.series(0.0) - self

    def __radd__(self, other: Any) -> TaylorSeries:
        return self.algebra.series(other) + self

    def __rsub__(self, other: Any) -> TaylorSeries:
        return self.algebra.series(other) - self

    def __rmul__(self, other: Any) -> TaylorSeries:
        return self.algebra.series(other) * self

    def __rtruediv__(self, other: Any) -> TaylorSeries:
        return self.algebra.series(other) / self


class SeriesAlgebra:
    """Math namespace of `TaylorSeries`; it caches each result, so that no expression is built twice."""

    def __init__(self) -> None:
        hy = load_heyoka()

        self._hy = hy
        self.numbers = itertools.count()
        self._cache: dict[tuple[Any, ...], TaylorSeries] = {}
        self._inverses: dict[int, Any] = {}

    def series(self, x: Any) -> TaylorSeries:
        """Return ``x`` as a series; an expression or a number becomes a constant one."""
        if isinstance(x, TaylorSeries):
            return x
        # An id is unique here, as the cached series keeps its expression alive
        key = ("constant", x if isinstance(x, (int, float)) else id(x))
        cached_series = self._cache.get(key)
        if cached_series is None:
            cached_series = self._cache[key] = TaylorSeries(self, lambda n, _: x, constant=True)
        return cached_series

    def variable(self, start: Any, rate: Callable[[], TaylorSeries]) -> TaylorSeries:
        """Return the series that begins with ``start`` and whose derivative is the series that ``rate`` returns."""
        # ``rate`` is called late: the rates are series of the variables, which must exist before
        return TaylorSeries(self, lambda n, _: rate()[n - 1] * (1.0 / n) if n else start)

    def cached(
        self, operation: str, a: TaylorSeries, b: TaylorSeries, compute: Callable[[int, TaylorSeries], Any]
    ) -> TaylorSeries:
        """Return the series that ``compute`` defines, or the cached one of the same operation and operands."""
        key = (operation, a.number, b.number)
        if key not in self._cache:
            self._cache[key] = TaylorSeries(self, compute, constant=a.constant and b.constant)
        return self._cache[key]

    def ordered_operands(self, a: TaylorSeries, b: Any) -> tuple[TaylorSeries, TaylorSeries]:
        """Return the operands of a commutative operation in the order of their serial numbers."""
        other = self.series(b)
        return (a, other) if a.number <= other.number else (other, a)

    def inverse(self, a: TaylorSeries) -> Any:
        """Return 1 / a at the start of the step, an expression."""
        if a.number not in self._inverses:
            self._inverses[a.number] = 1.0 / a[0]
        return self._inverses[a.number]

    def product(self, a: Any, b: Any, orders: range, n: int, weight: Callable[[int], float] | None = None) -> Any:
        """Return the sum of a[j] b[n - j] (times a weight) over ``orders`` j: coefficient ``n`` of a product."""
        terms = [a[j] * b[n - j] * (1.0 if weight is None else weight(j)) for j in orders]
        return self._hy.sum([self._expression(term) for term in terms])

    def square(self, a: TaylorSeries, n: int, first: int) -> Any:
        """Return the sum of a[j] a[n - j] over ``first`` <= j <= n - first, with ``first`` <= n / 2 or n odd.

        Equal terms are added once and doubled, which halves the work of `product`.
        """
        half = self.product(a, a, range(first, (n + 1) // 2), n)
        middle = a[n // 2] * a[n // 2] if n % 2 == 0 else 0.0
        return 2.0 * half + middle

    def _expression(self, x: Any) -> Any:
        return self._hy.expression(x) if isinstance(x, (int, float)) else x

    def _function(self, name: str, x: Any, further: Callable[[int, TaylorSeries, TaylorSeries], Any]) -> TaylorSeries:
        """Return a function of ``x`` that heyoka has.

        Parameters
        ----------
        further
            Function of an order above 0, the series ``x`` and the function's own that returns the latter's coefficient.
        """
        a = self.series(x)

        def compute(n: int, own: TaylorSeries) -> Any:
            return further(n, a, own) if n else getattr(self._hy, name)(self._expression(a[0]))

        return self.cached(name, a, a, compute)

    def sqrt(self, x: Any) -> TaylorSeries:
        """Return the square root of ``x``."""
        return self._function("sqrt", x, lambda n, a, own: (a[n] - self.square(own, n, 1)) * (0.5 * self.inverse(own)))

    def exp(self, x: Any) -> TaylorSeries:
        """Return e**x."""
        return self._function("exp", x, lambda n, a, own: self.product(a, own, range(1, n + 1), n, lambda j: j / n))

    def log(self, x: Any) -> TaylorSeries:
        """Return the natural logarithm of ``x``, from its rate log' = x' / x."""

        def further(n: int, a: TaylorSeries, own: TaylorSeries) -> Any:
            return (a[n] - self.product(own, a, range(1, n), n, lambda j: j / n)) * self.inverse(a)

        return self._function("log", x, further)

    def tanh(self, x: Any) -> TaylorSeries:
        """Return the hyperbolic tangent of ``x``, from its rate tanh' = (1 - tanh^2) x'."""
        return self._function(
            "tanh", x, lambda n, a, own: self.product(a, 1.0 - own * own, range(1, n + 1), n, lambda j: j / n)
        )

    def sin(self, x: Any) -> TaylorSeries:
        """Return the sine of ``x`` [rad]."""
        return self._circular(x)[0]

    def cos(self, x: Any) -> TaylorSeries:
        """Return the cosine of ``x`` [rad]."""
        return self._circular(x)[1]

    def _circular(self, x: Any) -> tuple[TaylorSeries, TaylorSeries]:
        """Return sine and cosine together: the coefficients of each need those of the other."""
        a = self.series(x)

        def sine(n: int, own: TaylorSeries) -> Any:
            return self.product(a, cosines, range(1, n + 1), n, lambda j: j / n) if n else self._hy.sin(a[0])

        def cosine(n: int, own: TaylorSeries) -> Any:
            return self.product(a, sines, range(1, n + 1), n, lambda j: -j / n) if n else self._hy.cos(a[0])

        sines, cosines = self.cached("sin", a, a, sine), self.cached("cos", a, a, cosine)
        return sines, cosines
