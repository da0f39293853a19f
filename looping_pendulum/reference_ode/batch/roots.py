"""Where polynomials on [0, 1] first fall through zero, for many polynomials at once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import comb
from typing import Any, NamedTuple

import numpy as np

from looping_pendulum.reference_ode.batch.compiled import CompiledFunction, size
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_library import load_heyoka

DEEPEST = 50
"""Halvings after which two roots count as one."""
NEWTON_STEPS = 8
POLISHINGS = 60
CLOSE = 1e-10
"""Newton's step after which a root is exact but for rounding: the next would be about its square."""


def first_falls(polynomials: Array) -> Array:
    """First root in [0, 1] at which each polynomial changes from above zero to below it; inf without one. Shape (n,).

    The signs of the coefficients in Bernstein's basis bound the number of roots from above, and exactly where they change no
    more than once (Descartes' rule of signs). Intervals that they leave open are halved until they do not, so that no pair of
    roots is missed, however close.

    Parameters
    ----------
    polynomials
        Coefficients of ascending powers, shape (degree + 1, n).
    """
    degree = len(polynomials) - 1
    first = np.full(polynomials.shape[1], np.inf)
    if not len(first):
        return first
    found = _look(degree)(polynomials)
    bernstein, roots, moved = found[:-2], found[-2], found[-1]
    owner, low, width = np.arange(len(first)), np.zeros(len(first)), 1.0
    for depth in range(DEEPEST):
        positive = bernstein > 0
        changes = np.count_nonzero(positive[1:] != positive[:-1], axis=0)
        falls = np.flatnonzero((changes == 1) & positive[0])
        at = roots[falls] if depth == 0 else np.full(len(falls), np.nan)
        unsure = np.flatnonzero(~((at >= 0) & (at <= 1) & (moved[falls] < CLOSE))) if depth == 0 else np.arange(len(falls))
        at[unsure] = _bracketed(polynomials[:, owner[falls[unsure]]], low[falls[unsure]], width)
        np.minimum.at(first, owner[falls], at)
        open_ = np.flatnonzero((changes > 1) & (low < first[owner]))
        if not len(open_):
            return first
        halves = _halves(degree)(bernstein[:, open_])
        bernstein = np.concatenate([halves[: degree + 1], halves[degree + 1 :]], axis=1)
        width *= 0.5
        owner, low = np.tile(owner[open_], 2), np.concatenate([low[open_], low[open_] + width])
    return first


def _bracketed(polynomials: Array, low: Array, width: float) -> Array:
    """The one root of each polynomial in (low, low + width): Newton's method, or halving where that leaves the interval."""
    if not len(low):
        return low
    high = low + width
    x, found = 0.5 * (low + high), np.zeros(len(low), dtype=bool)
    slopes = polynomials[1:] * np.arange(1.0, len(polynomials))[:, None]
    for _ in range(POLISHINGS):
        value = horner(polynomials, x)
        above = value > 0
        low, high = np.where(above, x, low), np.where(above, high, x)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = x - value / horner(slopes, x)
        better = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        x, found = np.where(found, x, better), found | (np.abs(better - x) < CLOSE)
        if found.all():
            break
    return x


def horner(coefficients: Sequence[Any] | Array, x: Any) -> Any:
    """Polynomials at ``x``, numbers or expressions; coefficients of ascending powers, along the first axis of an array."""
    value = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = value * x + coefficient
    return value


class RootExpressions(NamedTuple):
    """Expressions of what is easily seen of a polynomial on [0, 1]."""

    bernstein: list[Any]
    """Coefficients in Bernstein's basis; the first and the last are the values at 0 and 1."""
    root: Any
    """The root that Newton's method finds."""
    moved: Any
    """Size of its last step."""


def look(c: list[Any]) -> RootExpressions:
    """Look at the polynomial with coefficients ``c`` of ascending powers."""
    hy = load_heyoka()

    degree = len(c) - 1
    bernstein = [hy.sum([comb(k, j) / comb(degree, j) * c[j] for j in range(k + 1)]) for k in range(degree + 1)]
    before = x = c[0] / (c[0] - bernstein[-1])  # the secant's
    for _ in range(NEWTON_STEPS):
        value, slope = c[-1] * x + c[-2], c[-1]
        for coefficient in c[-3::-1]:
            value, slope = value * x + coefficient, slope * x + value
        before, x = x, x - value / slope
    return RootExpressions(bernstein, x, size(x - before))


@lru_cache(maxsize=8)
def _look(degree: int) -> CompiledFunction:
    """Compiled: coefficients -> `RootExpressions`."""
    hy = load_heyoka()

    c = [hy.expression(f"c{k}") for k in range(degree + 1)]
    found = look(c)
    return CompiledFunction([*found.bernstein, found.root, found.moved], c)


@lru_cache(maxsize=8)
def _halves(degree: int) -> CompiledFunction:
    """Compiled: coefficients in Bernstein's basis -> those on the left half and on the right half (de Casteljau)."""
    hy = load_heyoka()

    b = [hy.expression(f"b{k}") for k in range(degree + 1)]
    left = [hy.sum([comb(k, j) / 2.0**k * b[j] for j in range(k + 1)]) for k in range(degree + 1)]
    right = [hy.sum([comb(k, j) / 2.0**k * b[degree - j] for j in range(k + 1)]) for k in range(degree + 1)]
    return CompiledFunction([*left, *right[::-1]], b)
