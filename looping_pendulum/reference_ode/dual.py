"""Dual numbers (forward automatic differentiation), and the functions of them that the equations need, a math namespace ``xp``.

The driver, run with dual numbers, differentiates the release and what happens at every event.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.geometry import Array


class Dual:
    """A number, or an array of shape (n,), with its m derivatives, shape (m,) or (m, n). It compares as its value does."""

    __slots__ = ("derivatives", "value")
    __array_ufunc__ = None  # so that NumPy arrays leave mixed operations to these methods

    def __init__(self, value: Any, derivatives: Array) -> None:
        self.value = value
        self.derivatives = derivatives

    def __float__(self) -> float:
        """Return the value alone."""
        return float(self.value)

    def __bool__(self) -> bool:
        """Return whether the value is not zero."""
        return bool(self.value)

    def __format__(self, spec: str) -> str:
        """Format the value, for messages."""
        return format(self.value, spec)

    def __add__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value + other.value, self.derivatives + other.derivatives)
        return Dual(self.value + other, self.derivatives)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.derivatives)

    def __sub__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value - other.value, self.derivatives - other.derivatives)
        return Dual(self.value - other, self.derivatives)

    def __rsub__(self, other: Any) -> Dual:
        return Dual(other - self.value, -self.derivatives)

    def __mul__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value * other.value, self.value * other.derivatives + other.value * self.derivatives)
        return Dual(self.value * other, other * self.derivatives)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            ratio = self.value / other.value
            return Dual(ratio, (self.derivatives - ratio * other.derivatives) / other.value)
        return Dual(self.value / other, self.derivatives / other)

    def __rtruediv__(self, other: Any) -> Dual:
        ratio = other / self.value
        return Dual(ratio, -ratio / self.value * self.derivatives)

    def __pow__(self, power: float) -> Dual:
        return Dual(self.value**power, power * self.value ** (power - 1) * self.derivatives)

    def __abs__(self) -> Dual:
        return -self if self.value < 0 else self

    def __eq__(self, other: object) -> bool:
        return bool(self.value == value_of(other))

    def __lt__(self, other: Any) -> bool:
        return bool(self.value < value_of(other))

    def __le__(self, other: Any) -> bool:
        return bool(self.value <= value_of(other))

    def __gt__(self, other: Any) -> bool:
        return bool(self.value > value_of(other))

    def __ge__(self, other: Any) -> bool:
        return bool(self.value >= value_of(other))

    __hash__ = None  # type: ignore[assignment]


def value_of(x: Any) -> Any:
    """Return ``x`` without its derivatives."""
    return x.value if isinstance(x, Dual) else x


def derivatives_of(x: Any, count: int) -> Array:
    """Return the ``count`` derivatives of ``x``, zeros for a plain number."""
    return x.derivatives if isinstance(x, Dual) else np.zeros(count)


def _function(name: str, differential: Callable[[Any, Any, Array], Array]) -> Callable[[Any], Any]:
    """Return a function of a number or a dual number.

    Parameters
    ----------
    differential
        Function of the argument, the value there and the argument's derivatives that returns the value's.
    """
    # NumPy's for dual numbers, as the value may be an array of samples, which `math` does not take
    of_number, of_samples = getattr(math, name), getattr(np, name)

    def of_any(x: Any) -> Any:
        if not isinstance(x, Dual):
            return of_number(x)
        value = of_samples(x.value)
        return Dual(value, differential(x.value, value, x.derivatives))

    return of_any


exp = _function("exp", lambda x, value, dx: value * dx)
sin = _function("sin", lambda x, value, dx: np.cos(x) * dx)
cos = _function("cos", lambda x, value, dx: -np.sin(x) * dx)
tanh = _function("tanh", lambda x, value, dx: (1.0 - value * value) * dx)
log = _function("log", lambda x, value, dx: dx / x)
# `where` evaluates both branches, so that the division must be harmless at 0
sqrt = _function("sqrt", lambda x, root, dx: np.where(x > 0, 0.5 / np.maximum(root, 1e-300), 0.0) * dx)
"""Square root of a number from 0 on. Its derivatives at 0 are 0: there it is a speed, which only multiplies velocities of 0."""
