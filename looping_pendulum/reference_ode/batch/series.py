"""Taylor series whose coefficients are heyoka expressions, with the arithmetic that the equations need.

`equations` takes these as it takes floats (automatic differentiation of high order). Each coefficient is a closed expression of
the state and the parameters, so that one compiled function gives the whole series of a step.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

from looping_pendulum.reference_ode.heyoka_library import load_heyoka


class Series:
    """A Taylor series; its normalised coefficients x^(n) / n! are computed in order when they are asked for."""

    __slots__ = ("_coefficients", "_compute", "algebra", "constant", "number")

    def __init__(self, algebra: SeriesAlgebra, compute: Callable[[int, Series], Any], constant: bool = False) -> None:
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

    def __add__(self, other: Any) -> Series:
        a, b = self.algebra.ordered_operands(self, other)
        return self.algebra.cached("+", a, b, lambda n, _: a[n] + b[n])

    def __sub__(self, other: Any) -> Series:
        a, b = self, self.algebra.series(other)
        return self.algebra.cached("-", a, b, lambda n, _: a[n] - b[n])

    def __mul__(self, other: Any) -> Series:
        a, b = self.algebra.ordered_operands(self, other)
        if a.constant:
            return self.algebra.cached("*", a, b, lambda n, _: a[0] * b[n])
        if b.constant:
            return self.algebra.cached("*", a, b, lambda n, _: a[n] * b[0])
        if a is b:
            return self.algebra.cached("*", a, a, lambda n, _: self.algebra.square(a, n, 0))
        return self.algebra.cached("*", a, b, lambda n, _: self.algebra.product(a, b, range(n + 1), n))

    def __truediv__(self, other: Any) -> Series:
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

    def __neg__(self) -> Series:
        return self.algebra.series(0.0) - self

    def __radd__(self, other: Any) -> Series:
        return self.algebra.series(other) + self

    def __rsub__(self, other: Any) -> Series:
        return self.algebra.series(other) - self

    def __rmul__(self, other: Any) -> Series:
        return self.algebra.series(other) * self

    def __rtruediv__(self, other: Any) -> Series:
        return self.algebra.series(other) / self


class SeriesAlgebra:
    """Math namespace of `Series`; it caches each result, so that no expression is built twice."""

    def __init__(self) -> None:
        hy = load_heyoka()

        self._hy = hy
        self.numbers = itertools.count()
        self._cache: dict[tuple[Any, ...], Series] = {}
        self._inverses: dict[int, Any] = {}

    def series(self, x: Any) -> Series:
        """Return ``x`` as a series; an expression or a number becomes a constant one."""
        if isinstance(x, Series):
            return x
        # An id is unique here, as the cached series keeps its expression alive
        key = ("constant", x if isinstance(x, (int, float)) else id(x))
        cached_series = self._cache.get(key)
        if cached_series is None:
            cached_series = self._cache[key] = Series(self, lambda n, _: x, constant=True)
        return cached_series

    def variable(self, start: Any, rate: Callable[[], Series]) -> Series:
        """Return the series that begins with ``start`` and whose derivative is the series that ``rate`` returns."""
        # ``rate`` is called late: the rates are series of the variables, which must exist before
        return Series(self, lambda n, _: rate()[n - 1] * (1.0 / n) if n else start)

    def cached(self, operation: str, a: Series, b: Series, compute: Callable[[int, Series], Any]) -> Series:
        """Return the series that ``compute`` defines, or the cached one of the same operation and operands."""
        key = (operation, a.number, b.number)
        if key not in self._cache:
            self._cache[key] = Series(self, compute, constant=a.constant and b.constant)
        return self._cache[key]

    def ordered_operands(self, a: Series, b: Any) -> tuple[Series, Series]:
        """Return the operands of a commutative operation in the order of their serial numbers."""
        other = self.series(b)
        return (a, other) if a.number <= other.number else (other, a)

    def inverse(self, a: Series) -> Any:
        """Return 1 / a at the start of the step, an expression."""
        if a.number not in self._inverses:
            self._inverses[a.number] = 1.0 / a[0]
        return self._inverses[a.number]

    def product(self, a: Any, b: Any, orders: range, n: int, weight: Callable[[int], float] | None = None) -> Any:
        """Return the sum of a[j] b[n - j] (times a weight) over ``orders`` j: coefficient ``n`` of a product."""
        terms = [a[j] * b[n - j] * (1.0 if weight is None else weight(j)) for j in orders]
        return self._hy.sum([self._expression(term) for term in terms])

    def square(self, a: Series, n: int, first: int) -> Any:
        """Return the sum of a[j] a[n - j] over ``first`` <= j <= n - first, with ``first`` <= n / 2 or n odd.

        Equal terms are added once and doubled, which halves the work of `product`.
        """
        half = self.product(a, a, range(first, (n + 1) // 2), n)
        middle = a[n // 2] * a[n // 2] if n % 2 == 0 else 0.0
        return 2.0 * half + middle

    def _expression(self, x: Any) -> Any:
        return self._hy.expression(x) if isinstance(x, (int, float)) else x

    def sqrt(self, x: Any) -> Series:
        """Return the square root of ``x``."""
        a = self.series(x)

        def compute(n: int, own: Series) -> Any:
            if n == 0:
                return self._hy.sqrt(a[0])
            return (a[n] - self.square(own, n, 1)) * (0.5 * self.inverse(own))

        return self.cached("sqrt", a, a, compute)

    def exp(self, x: Any) -> Series:
        """Return e**x."""
        a = self.series(x)

        def compute(n: int, own: Series) -> Any:
            if n == 0:
                return self._hy.exp(self._expression(a[0]))
            return self.product(a, own, range(1, n + 1), n, lambda j: j / n)

        return self.cached("exp", a, a, compute)

    def log(self, x: Any) -> Series:
        """Return the natural logarithm of ``x``, from its rate log' = x' / x."""
        a = self.series(x)

        def compute(n: int, own: Series) -> Any:
            if n == 0:
                return self._hy.log(self._expression(a[0]))
            return (a[n] - self.product(own, a, range(1, n), n, lambda j: j / n)) * self.inverse(a)

        return self.cached("log", a, a, compute)

    def tanh(self, x: Any) -> Series:
        """Return the hyperbolic tangent of ``x``, from its rate tanh' = (1 - tanh^2) x'."""
        a = self.series(x)

        def compute(n: int, own: Series) -> Any:
            if n == 0:
                return self._hy.tanh(self._expression(a[0]))
            return self.product(a, 1.0 - own * own, range(1, n + 1), n, lambda j: j / n)

        return self.cached("tanh", a, a, compute)

    def sin(self, x: Any) -> Series:
        """Return the sine of ``x`` [rad]."""
        return self._circular(x)[0]

    def cos(self, x: Any) -> Series:
        """Return the cosine of ``x`` [rad]."""
        return self._circular(x)[1]

    def _circular(self, x: Any) -> tuple[Series, Series]:
        """Return sine and cosine together: the coefficients of each need those of the other."""
        a = self.series(x)

        def sine(n: int, own: Series) -> Any:
            return self.product(a, cosines, range(1, n + 1), n, lambda j: j / n) if n else self._hy.sin(a[0])

        def cosine(n: int, own: Series) -> Any:
            return self.product(a, sines, range(1, n + 1), n, lambda j: -j / n) if n else self._hy.cos(a[0])

        sines, cosines = self.cached("sin", a, a, sine), self.cached("cos", a, a, cosine)
        return sines, cosines
