"""Taylor series in time of whatever the equations compute: numbers whose coefficients are heyoka's expressions.

`equations` runs on these as it runs on floats. Each coefficient is a closed expression of the state and the parameters, so that
one compiled function can give the whole series of a step.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

from looping_pendulum.reference_ode.heyoka_library import load_heyoka


class Series:
    """A Taylor series, its normalised coefficients x^(n) / n! found one after another when they are asked for."""

    __slots__ = ("_find", "_found", "book", "constant", "number")

    def __init__(self, book: SeriesAlgebra, find: Callable[[int, Series], Any], constant: bool = False) -> None:
        self.book = book
        self.number = next(book.numbers)
        """In the order in which series were made, so that every process compiles the same terms in the same order."""
        self.constant = constant
        """Whether every coefficient but the first is zero."""
        self._find = find
        self._found: list[Any] = []

    def __getitem__(self, n: int) -> Any:
        """Coefficient ``n``."""
        if self.constant and n:
            return 0.0
        while len(self._found) <= n:
            self._found.append(self._find(len(self._found), self))
        return self._found[n]

    def __add__(self, other: Any) -> Series:
        a, b = self.book.ordered(self, other)
        return self.book.kept("+", a, b, lambda n, _: a[n] + b[n])

    def __sub__(self, other: Any) -> Series:
        a, b = self, self.book.series(other)
        return self.book.kept("-", a, b, lambda n, _: a[n] - b[n])

    def __mul__(self, other: Any) -> Series:
        a, b = self.book.ordered(self, other)
        if a.constant:
            return self.book.kept("*", a, b, lambda n, _: a[0] * b[n])
        if b.constant:
            return self.book.kept("*", a, b, lambda n, _: a[n] * b[0])
        if a is b:
            return self.book.kept("*", a, a, lambda n, _: self.book.square(a, n, 0))
        return self.book.kept("*", a, b, lambda n, _: self.book.product(a, b, range(n + 1), n))

    def __truediv__(self, other: Any) -> Series:
        a, b = self, self.book.series(other)
        inverse = self.book.inverse(b)
        if b.constant:
            return self.book.kept("/", a, b, lambda n, _: a[n] * inverse)
        return self.book.kept(
            "/", a, b, lambda n, own: (a[n] - self.book.product(b, own, range(1, n + 1), n)) * inverse if n else a[0] * inverse
        )

    def __neg__(self) -> Series:
        return self.book.series(0.0) - self

    def __radd__(self, other: Any) -> Series:
        return self.book.series(other) + self

    def __rsub__(self, other: Any) -> Series:
        return self.book.series(other) - self

    def __rmul__(self, other: Any) -> Series:
        return self.book.series(other) * self

    def __rtruediv__(self, other: Any) -> Series:
        return self.book.series(other) / self


class SeriesAlgebra:
    """Math namespace of `Series`; keeps each that was made, so that nothing is computed twice."""

    def __init__(self) -> None:
        hy = load_heyoka()

        self._hy = hy
        self.numbers = itertools.count()
        self._made: dict[tuple[Any, ...], Series] = {}
        self._inverses: dict[int, Any] = {}

    def series(self, x: Any) -> Series:
        """``x`` as a series; an expression or number is a constant."""
        if isinstance(x, Series):
            return x
        key = ("constant", x if isinstance(x, (int, float)) else id(x))
        made = self._made.get(key)
        if made is None:
            made = self._made[key] = Series(self, lambda n, _: x, constant=True)
        return made

    def variable(self, start: Any, rate: Callable[[], Series]) -> Series:
        """A series that begins with ``start`` and whose derivative is what ``rate`` returns."""
        return Series(self, lambda n, _: rate()[n - 1] * (1.0 / n) if n else start)

    def kept(self, operation: str, a: Series, b: Series, find: Callable[[int, Series], Any]) -> Series:
        """The series that ``find`` defines, or the one made before from the same operation and operands."""
        key = (operation, a.number, b.number)
        if key not in self._made:
            self._made[key] = Series(self, find, constant=a.constant and b.constant)
        return self._made[key]

    def ordered(self, a: Series, b: Any) -> tuple[Series, Series]:
        """Operands of a commutative operation, always in the same order."""
        other = self.series(b)
        return (a, other) if a.number <= other.number else (other, a)

    def inverse(self, a: Series) -> Any:
        """1 / a at the start of the step."""
        if a.number not in self._inverses:
            self._inverses[a.number] = 1.0 / a[0]
        return self._inverses[a.number]

    def product(self, a: Any, b: Any, orders: range, n: int, weight: Callable[[int], float] | None = None) -> Any:
        """Sum of a[j] b[n - j] (times a weight) over ``orders`` j."""
        terms = [a[j] * b[n - j] * (1.0 if weight is None else weight(j)) for j in orders]
        return self._hy.sum([self._expression(term) for term in terms])

    def square(self, a: Series, n: int, first: int) -> Any:
        """Sum of a[j] a[n - j] over ``first`` <= j <= n - first, with ``first`` <= n / 2 or n odd."""
        half = self.product(a, a, range(first, (n + 1) // 2), n)
        middle = a[n // 2] * a[n // 2] if n % 2 == 0 else 0.0
        return 2.0 * half + middle

    def _expression(self, x: Any) -> Any:
        return self._hy.expression(x) if isinstance(x, (int, float)) else x

    def sqrt(self, x: Any) -> Series:
        """Square root."""
        a = self.series(x)

        def find(n: int, own: Series) -> Any:
            if n == 0:
                return self._hy.sqrt(a[0])
            return (a[n] - self.square(own, n, 1)) * (0.5 * self.inverse(own))

        return self.kept("sqrt", a, a, find)

    def exp(self, x: Any) -> Series:
        """Exponential."""
        a = self.series(x)

        def find(n: int, own: Series) -> Any:
            if n == 0:
                return self._hy.exp(self._expression(a[0]))
            return self.product(a, own, range(1, n + 1), n, lambda j: j / n)

        return self.kept("exp", a, a, find)

    def sin(self, x: Any) -> Series:
        """Sine."""
        return self._circular(x)[0]

    def cos(self, x: Any) -> Series:
        """Cosine."""
        return self._circular(x)[1]

    def _circular(self, x: Any) -> tuple[Series, Series]:
        a = self.series(x)

        def sine(n: int, own: Series) -> Any:
            return self.product(a, cosines, range(1, n + 1), n, lambda j: j / n) if n else self._hy.sin(a[0])

        def cosine(n: int, own: Series) -> Any:
            return self.product(a, sines, range(1, n + 1), n, lambda j: -j / n) if n else self._hy.cos(a[0])

        sines, cosines = self.kept("sin", a, a, sine), self.kept("cos", a, a, cosine)
        return sines, cosines
