"""Find where polynomials on [0, 1] first fall through zero, for many polynomials at once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import comb
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.batch.compiled import CompiledFunction, absolute_value
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.heyoka_library import compiled, load_heyoka

# An interval is then 2^-50 of the step, four roundings of 1
MAX_BISECTIONS = 50
"""Number of times that [0, 1] is bisected; two roots that are still in one interval then count as one."""
# They need not suffice for every polynomial: one whose last step is not small is refined or searched by itself
NEWTON_STEPS = 8
"""Newton steps in the compiled expressions, where every polynomial takes the same number."""
# Bisection alone, the worst case, then arrives at 2^-60
MAX_REFINEMENTS = 60
"""Largest number of Newton or bisection steps for a root that is known to be alone in its interval."""
ROOT_TOLERANCE = 1e-10
"""Length of a last Newton step at which a root is taken as exact: the error left is about the square of the step."""


def first_falling_roots(polynomials: Array) -> Array:
    """Return the first root in [0, 1] at which each polynomial falls through zero, shape (n,); inf without one.

    The number of sign changes of the coefficients in the Bernstein basis is an upper bound on the number of roots, and exact if
    it is 0 or 1 (Descartes' rule of signs). Intervals with more sign changes are bisected, so that no pair of roots is missed,
    however close.

    Parameters
    ----------
    polynomials
        Coefficients of ascending powers, shape (degree + 1, n).
    """
    degree = len(polynomials) - 1
    first = np.full(polynomials.shape[1], np.inf)
    if not len(first):
        return first
    outputs = _compiled_root_expressions(degree)(polynomials)
    bernstein, newton_roots, last_steps = outputs[:-2], outputs[-2], outputs[-1]
    # Each column of `bernstein` belongs to polynomial `owner` on the interval (low, low + width)
    owner, low, width = np.arange(len(first)), np.zeros(len(first)), 1.0
    for depth in range(MAX_BISECTIONS):
        positive = bernstein > 0
        changes = np.count_nonzero(positive[1:] != positive[:-1], axis=0)
        falls = np.flatnonzero((changes == 1) & positive[0])
        # The compiled Newton steps belong to the whole of [0, 1], not to its parts
        at = newton_roots[falls] if depth == 0 else np.full(len(falls), np.nan)
        unsure = (
            np.flatnonzero(~((at >= 0) & (at <= 1) & (last_steps[falls] < ROOT_TOLERANCE)))
            if depth == 0
            else np.arange(len(falls))
        )
        at[unsure] = _refine_roots(polynomials[:, owner[falls[unsure]]], low[falls[unsure]], width)
        # `at`, because several intervals may belong to one polynomial
        np.minimum.at(first, owner[falls], at)
        open_ = np.flatnonzero((changes > 1) & (low < first[owner]))
        if not len(open_):
            return first
        halves = _compiled_halves(degree)(bernstein[:, open_])
        bernstein = np.concatenate([halves[: degree + 1], halves[degree + 1 :]], axis=1)
        width *= 0.5
        owner, low = np.tile(owner[open_], 2), np.concatenate([low[open_], low[open_] + width])
    return first


def _refine_roots(polynomials: Array, low: Array, width: float) -> Array:
    """Return the one root of each polynomial in (low, low + width), by Newton's method.

    Where a Newton step would leave the interval that is known to hold the root, the interval is bisected instead.
    """
    if not len(low):
        return low
    high = low + width
    x, converged = 0.5 * (low + high), np.zeros(len(low), dtype=bool)
    derivatives = polynomials[1:] * np.arange(1.0, len(polynomials))[:, None]
    for _ in range(MAX_REFINEMENTS):
        value = horner(polynomials, x)
        above = value > 0
        low, high = np.where(above, x, low), np.where(above, high, x)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = x - value / horner(derivatives, x)
        better = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        x, converged = np.where(converged, x, better), converged | (np.abs(better - x) < ROOT_TOLERANCE)
        if converged.all():
            break
    return x


def horner(coefficients: Sequence[Any] | Array, x: Any) -> Any:
    """Return polynomials at ``x`` by Horner's scheme; coefficients of ascending powers, along the first axis of an array.

    Coefficients and ``x`` may be numbers, arrays or expressions.
    """
    value = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = value * x + coefficient
    return value


def _root_expressions(hy: Any, c: list[Any]) -> list[Any]:
    """Return expressions from which the roots in [0, 1] of a polynomial are found; ``c``: coefficients of ascending powers.

    They are the coefficients in the Bernstein basis, of which the first and the last are the values at 0 and 1; the root at
    which `NEWTON_STEPS` of Newton's method arrive, which may lie outside [0, 1]; and the length of the last of these steps.
    """
    degree = len(c) - 1
    bernstein = [hy.sum([comb(k, j) / comb(degree, j) * c[j] for j in range(k + 1)]) for k in range(degree + 1)]
    before = x = c[0] / (c[0] - bernstein[-1])  # start at the root of the secant through 0 and 1
    for _ in range(NEWTON_STEPS):
        value, slope = c[-1] * x + c[-2], c[-1]
        for coefficient in c[-3::-1]:
            value, slope = value * x + coefficient, slope * x + value
        before, x = x, x - value / slope
    return [*bernstein, x, absolute_value(x - before)]


@lru_cache(maxsize=8)
def _compiled_root_expressions(degree: int) -> CompiledFunction:
    """Compile `_root_expressions`; inputs: coefficients of ascending powers."""

    def make() -> CompiledFunction:
        hy = load_heyoka()
        c = [hy.expression(f"c{k}") for k in range(degree + 1)]
        return CompiledFunction(_root_expressions(hy, c), c)

    return compiled(("roots", degree), (), make)


@lru_cache(maxsize=8)
def _compiled_halves(degree: int) -> CompiledFunction:
    """Compile de Casteljau's subdivision: Bernstein coefficients on an interval -> on its left half, then on its right half."""

    def make() -> CompiledFunction:
        hy = load_heyoka()
        b = [hy.expression(f"b{k}") for k in range(degree + 1)]
        left = [hy.sum([comb(k, j) / 2.0**k * b[j] for j in range(k + 1)]) for k in range(degree + 1)]
        right = [hy.sum([comb(k, j) / 2.0**k * b[degree - j] for j in range(k + 1)]) for k in range(degree + 1)]
        return CompiledFunction([*left, *right[::-1]], b)

    return compiled(("halves", degree), (), make)
