"""Fit a model to all trials together: Levenberg-Marquardt in units of prior standard errors, windows of time growing to all.

Where the heavy mass turns several times the cost has many minima; the first part of the motion has one, so fits start there.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.errors import HarnessError
from looping_pendulum.reference_ode.geometry import Array

WINDOWS = (0.3, 0.5, 0.8, 1.0)
"""Shares of the longest trial that are fitted one after the other."""
FIRST_MARKS = 80
"""Of a channel in the first window, at most: later ones of a long swing only mislead until its period is known."""
LARGEST_STEP = 3.0
"""Of one component in one iteration, in scales."""
CLOSE, ROUGHLY = 1e-6, 3e-4
"""Relative decrease of the cost below which a fit has ended, in the last window and before."""
TRUST = 0.5
"""Share of a step's promised decrease below which its Jacobian is not updated but computed afresh."""
STALE = 6
"""Updates of a Jacobian after which it is computed afresh."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """The minimum that was found."""

    problem: Problem
    x: Array
    residuals: Array
    iterations: int
    slopes: Array | None = None
    """Jacobian by which the fit ended, at most in one-sided differences: good for standard errors; None: none so near ``x``."""

    @property
    def cost(self) -> float:
        """Sum of squares, prior included."""
        return float(self.residuals @ self.residuals)

    @cached_property
    def jacobian(self) -> Array:
        """By central differences, shape (n + numbers, numbers)."""
        return self.problem.jacobian(self.x, central=True)

    @cached_property
    def covariance(self) -> Array:
        """Of x."""
        jacobian = self.jacobian if self.slopes is None else self.slopes
        return np.asarray(np.linalg.pinv(jacobian.T @ jacobian, hermitian=True))

    @property
    def condition(self) -> float:
        """Condition number of the scaled Jacobian, prior included."""
        return float(np.linalg.cond(self.jacobian))

    @property
    def values(self) -> dict[str, float]:
        """Number -> value [SI]."""
        return {n.name: n.start + n.scale * float(v) for n, v in zip(self.problem.numbers, self.x, strict=True)}

    @property
    def errors(self) -> dict[str, float]:
        """Number -> standard error [SI]."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return {n.name: n.scale * float(s) for n, s in zip(self.problem.numbers, sigma, strict=True)}

    def correlations(self, above: float = 0.9) -> tuple[tuple[str, str, float], ...]:
        """Pairs of numbers that the data can hardly tell apart, strongest first."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        matrix = self.covariance / np.outer(sigma, sigma)
        names = self.problem.names
        rows, columns = np.triu_indices(len(names), 1)
        found = [(names[i], names[j], float(matrix[i, j])) for i, j in zip(rows, columns, strict=True)]
        return tuple(sorted((f for f in found if abs(f[2]) > above), key=lambda f: -abs(f[2])))

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Numbers that ended on a bound."""
        p = self.problem
        return tuple(n for n, v, lo, hi in zip(p.names, self.x, p.low, p.high, strict=True) if min(v - lo, hi - v) < 1e-9)


class FitError(HarnessError, RuntimeError):
    """No fit could be made."""


def minimise(
    problem: Problem,
    x: Array,
    *,
    close: float = CLOSE,
    most: int = 30,
    confirm: bool = True,
    slopes: Array | None = None,
) -> Fit:
    """Levenberg-Marquardt within the bounds, every component of a step clipped.

    From one step to the next the Jacobian follows by Broyden's update. It is computed afresh at most ``most`` times: where a
    step by an updated one fails or falls short of what it promised, and, if to ``confirm``, before the fit ends.

    Parameters
    ----------
    slopes
        Jacobian at ``x``, or so near to it as two iterations are when a fit ends; None: not known.

    Raises
    ------
    FitError
        If the model cannot run at ``x``.
    """
    x = np.clip(x, problem.low, problem.high)
    r = problem.residuals(x)
    if r is None:
        raise FitError("the model cannot run at the start of the fit; check the study's values")
    cost, damping, iterations = float(r @ r), 1e-3, 0
    jacobian = np.zeros((0, 0)) if slopes is None else slopes
    age = STALE if slopes is None else 0
    while True:
        if age >= STALE:
            if iterations == most:
                break
            jacobian, age = problem.jacobian(x), 0
            iterations += 1
        gradient, normal = jacobian.T @ r, jacobian.T @ jacobian
        free = ~(((x <= problem.low) & (gradient < 0)) | ((x >= problem.high) & (gradient > 0)))
        drop = 0.0
        for _ in range(1 if age else 8):
            trial = np.clip(x + _step(normal, gradient, free, damping), problem.low, problem.high)
            new = problem.residuals(trial)
            if new is not None and float(new @ new) < cost:
                step, change = trial - x, new - r
                promised = float(2 * step @ gradient - step @ normal @ step)
                x, r, drop = trial, new, cost - float(new @ new)
                cost -= drop
                break
            if not age:
                damping *= 10
        if not drop or drop < close * cost:
            if not age or (drop and not confirm):
                break
            age = STALE
        elif drop < TRUST * promised:
            age = STALE
        else:
            jacobian = jacobian - np.outer(change + jacobian @ step, step / float(step @ step))
            age += 1
        damping = max(damping / 10, 1e-9)
    return Fit(problem=problem, x=x, residuals=r, iterations=iterations, slopes=None if age else jacobian)


def _step(normal: Array, gradient: Array, free: NDArray[np.bool_], damping: float) -> Array:
    """Clipped step; numbers that press against a bound stay."""
    step = np.zeros(len(gradient))
    part = normal[np.ix_(free, free)]
    step[free] = np.linalg.solve(part + damping * np.diag(np.diag(part) + 1e-12), gradient[free])
    return np.clip(step, -LARGEST_STEP, LARGEST_STEP)


def _windows(problem: Problem) -> tuple[float, ...]:
    """Shares before the last: doubling up to those of `WINDOWS` where a channel is long."""
    longest = max((len(c) for d in problem.data for c in d.channels), default=0)
    early, share = [], FIRST_MARKS / max(longest, 1)
    while share < WINDOWS[0]:
        early.append(share)
        share *= 2
    return (*early, *WINDOWS[:-1])


def calibrate(problem: Problem, start: Array | None = None, *, most: int = 30) -> Fit:
    """Fit in growing windows of time, with at most so many iterations in each."""
    x = problem.prior_mean.copy() if start is None else start
    total = 0
    for share in _windows(problem):
        fit = minimise(problem.until(share), x, close=ROUGHLY, most=most, confirm=False)
        x, total = fit.x, total + fit.iterations
    fit = minimise(problem, x, most=most)
    return dataclasses.replace(fit, iterations=fit.iterations + total)
