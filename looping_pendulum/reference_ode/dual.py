"""Numbers that carry their derivatives, and the few functions of them that the equations need (a math namespace ``xp``).

The driver's own lines, run with them, differentiate the release and what happens at every event.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.geometry import Array


class Dual:
    """A number (or an array of shape (n,)) and its derivatives, shape (m,) (or (m, n)). It compares as its value does."""

    __slots__ = ("slopes", "value")
    __array_ufunc__ = None  # so that an array leaves the operation to the methods here

    def __init__(self, value: Any, slopes: Array) -> None:
        self.value = value
        self.slopes = slopes

    def __float__(self) -> float:
        """Return the value alone."""
        return float(self.value)

    def __bool__(self) -> bool:
        """Whether the value is not zero."""
        return bool(self.value)

    def __format__(self, spec: str) -> str:
        """Format the value, for messages."""
        return format(self.value, spec)

    def __add__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value + other.value, self.slopes + other.slopes)
        return Dual(self.value + other, self.slopes)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slopes)

    def __sub__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value - other.value, self.slopes - other.slopes)
        return Dual(self.value - other, self.slopes)

    def __rsub__(self, other: Any) -> Dual:
        return Dual(other - self.value, -self.slopes)

    def __mul__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value * other.value, self.value * other.slopes + other.value * self.slopes)
        return Dual(self.value * other, other * self.slopes)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            ratio = self.value / other.value
            return Dual(ratio, (self.slopes - ratio * other.slopes) / other.value)
        return Dual(self.value / other, self.slopes / other)

    def __rtruediv__(self, other: Any) -> Dual:
        ratio = other / self.value
        return Dual(ratio, -ratio / self.value * self.slopes)

    def __pow__(self, power: float) -> Dual:
        return Dual(self.value**power, power * self.value ** (power - 1) * self.slopes)

    def __abs__(self) -> Dual:
        return -self if self.value < 0 else self

    def __eq__(self, other: object) -> bool:
        return bool(self.value == plain(other))

    def __lt__(self, other: Any) -> bool:
        return bool(self.value < plain(other))

    def __le__(self, other: Any) -> bool:
        return bool(self.value <= plain(other))

    def __gt__(self, other: Any) -> bool:
        return bool(self.value > plain(other))

    def __ge__(self, other: Any) -> bool:
        return bool(self.value >= plain(other))

    __hash__ = None  # type: ignore[assignment]


def plain(x: Any) -> Any:
    """Return ``x`` without its derivatives."""
    return x.value if isinstance(x, Dual) else x


def slopes(x: Any, count: int) -> Array:
    """Return the ``count`` derivatives of ``x``, zeros for a plain number."""
    return x.slopes if isinstance(x, Dual) else np.zeros(count)


def exp(x: Any) -> Any:
    """e**x."""
    if not isinstance(x, Dual):
        return math.exp(x)
    value = np.exp(x.value)
    return Dual(value, value * x.slopes)


def sin(x: Any) -> Any:
    """Sine of x [rad]."""
    return Dual(np.sin(x.value), np.cos(x.value) * x.slopes) if isinstance(x, Dual) else math.sin(x)


def cos(x: Any) -> Any:
    """Cosine of x [rad]."""
    return Dual(np.cos(x.value), -np.sin(x.value) * x.slopes) if isinstance(x, Dual) else math.cos(x)


def sqrt(x: Any) -> Any:
    """Square root of x >= 0. At 0 its slopes count as 0: a speed is a root there, and only ever multiplies a velocity."""
    if not isinstance(x, Dual):
        return math.sqrt(x)
    root = np.sqrt(x.value)
    return Dual(root, np.where(x.value > 0, 0.5 / np.maximum(root, 1e-300), 0.0) * x.slopes)
