"""Fit a model to all trials together by the Levenberg-Marquardt method, in windows of time that grow to the whole trials.

Parameters are in units of their prior standard errors. If the heavy mass turns several times, the cost has many minima. That of
the first part of the motion has one, so fits start there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from looping_pendulum.discrepancy.fit.problem import Problem, fits_end_now
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.reference_ode.geometry import Array

FIRST_WINDOW_SHARE, FIRST_WINDOW_POINTS = 0.3, 80
"""Largest part of the longest trial, and number of points of a channel, in the first window. Each further one is twice as long.

Later points of a long swing only mislead the fit until its period is known.
"""
MAX_STEP = 3.0
"""Largest change of one parameter in the first iteration, in units of its scale; each is clipped by itself."""
STEP_GROWTH, MIN_AGREEMENT = 4.0, 0.5
"""Factor by which it grows after an iteration that decreased the cost by at least this share of what the linear model said."""
COST_TOLERANCE, WINDOW_COST_TOLERANCE = 1e-6, 3e-4
"""Relative decrease of the cost below which a fit has converged, in the last window and in those before it."""
MAX_DECREASE = 1.0
"""Largest decrease of the cost that is left, by the linear model, where a fit counts as converged: the evidence takes it."""
MAX_ITERATIONS = 100
"""Largest number of Jacobians of a fit, unless a caller says otherwise."""
FIRST_DAMPING, MIN_DAMPING = 1e-3, 1e-9
"""Damping of the first step, in units of the diagonal of the normal matrix, and its least."""
MAX_DAMPING = 1e8
"""Damping, which rises tenfold with each step that does not decrease the cost, above which none will."""


@dataclass(frozen=True, kw_only=True)
class FittedParameter:
    """A free parameter with its value after a fit."""

    parameter: FreeParameter
    value: float
    """Fitted value [SI]."""
    error: float
    """Standard error [SI]."""
    at_bound: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Minimum of a `Problem`'s cost."""

    problem: Problem
    x: Array
    """Free parameters at the minimum, in units of their scales, shape (p,)."""
    residuals: Array
    """Standardised residuals there, then those of the prior, shape (n + p,)."""
    final_jacobian: Array | None = None
    """Jacobian there; None: not known."""

    @property
    def cost(self) -> float:
        """Return the sum of squared residuals, prior included."""
        return float(self.residuals @ self.residuals)

    @cached_property
    def jacobian(self) -> Array:
        """Return the Jacobian at the minimum, shape (n + p, p): `final_jacobian`, or one that is computed now."""
        return self.problem.jacobian(self.x) if self.final_jacobian is None else self.final_jacobian

    @cached_property
    def converged(self) -> bool:
        """Whether the fit ended near a minimum, and not because its iterations ran out far from one."""
        return _LinearModel(self.problem, self.x, self.residuals, self.jacobian).largest_decrease < MAX_DECREASE

    @cached_property
    def covariance(self) -> Array:
        """Return the covariance matrix of ``x``, shape (p, p)."""
        jacobian = self.jacobian
        # The pseudoinverse also exists where the data do not tell parameters apart
        return np.asarray(np.linalg.pinv(jacobian.T @ jacobian, hermitian=True))

    @property
    def condition(self) -> float:
        """Return the condition number of the scaled Jacobian, prior included."""
        return float(np.linalg.cond(self.jacobian))

    @property
    def values(self) -> dict[str, float]:
        """Return parameter -> value [SI]."""
        return {n.name: n.init_value + n.scale * float(v) for n, v in zip(self.problem.free_parameters, self.x, strict=True)}

    @property
    def errors(self) -> dict[str, float]:
        """Return parameter -> standard error [SI]."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return {n.name: n.scale * float(s) for n, s in zip(self.problem.free_parameters, sigma, strict=True)}

    @property
    def parameters(self) -> tuple[FittedParameter, ...]:
        """Return every free parameter with its value."""
        values, errors, at_bounds = self.values, self.errors, self.at_bounds
        return tuple(
            FittedParameter(parameter=p, value=values[p.name], error=errors[p.name], at_bound=i in at_bounds)
            for i, p in enumerate(self.problem.free_parameters)
        )

    def correlations(self) -> tuple[tuple[str, str, float], ...]:
        """Return pairs of parameters with a correlation above 0.9 in size, and that correlation, strongest first."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        matrix = self.covariance / np.outer(sigma, sigma)
        names = self.problem.names
        rows, columns = np.triu_indices(len(names), 1)
        pairs = [(names[i], names[j], float(matrix[i, j])) for i, j in zip(rows, columns, strict=True)]
        return tuple(sorted((p for p in pairs if abs(p[2]) > 0.9), key=lambda p: -abs(p[2])))

    @property
    def at_bounds(self) -> tuple[int, ...]:
        """Indices of the parameters that ended on a bound."""
        distance = np.minimum(self.x - self.problem.low, self.problem.high - self.x)
        return tuple(np.flatnonzero(distance < 1e-9).tolist())


class FitError(HarnessError, RuntimeError):
    """Raised if no fit can be made."""


def minimise(
    problem: Problem,
    x: Array,
    *,
    cost_tolerance: float = COST_TOLERANCE,
    max_iterations: int = MAX_ITERATIONS,
    needless_above: float = math.inf,
) -> Fit:
    """Minimise the cost within the bounds by the Levenberg-Marquardt method.

    Parameters
    ----------
    x
        Initial parameters in units of their scales, shape (p,).
    cost_tolerance
        Relative decrease of the cost below which the fit has converged.
    max_iterations
        Largest number of Jacobians that are computed.
    needless_above
        Cost above which nobody wants the fit: it ends where it is if the linear model, and by how much that has changed in one
        iteration, say that the cost will stay above.

    Raises
    ------
    FitError
        If the model cannot run at ``x``.
    """
    x = np.clip(x, problem.low, problem.high)
    r, jacobian = problem.residuals_and_jacobian(x)
    if r is None:
        raise FitError("the model cannot run at the start of the fit; check the study's values")
    cost, damping, iterations = float(r @ r), FIRST_DAMPING, 1
    longest_step, growth, least = MAX_STEP, 2.0, math.inf
    model = _LinearModel(problem, x, r, jacobian)
    while iterations < max_iterations and model.largest_decrease > cost_tolerance * cost:
        if fits_end_now():
            break
        there = model.point(damping, longest_step)
        while model.decrease(there) <= 0 and damping <= MAX_DAMPING:  # some components were clipped, and the others misled
            damping *= 10
            there = model.point(damping, longest_step)
        # No longer step leads down, and all that are left of these do not matter: the derivatives do not hold farther
        if (max_iterations - iterations) * model.decrease(there) < cost_tolerance * cost:
            break
        new, new_jacobian = problem.residuals_and_jacobian(there)
        iterations += 1
        if new is None or float(new @ new) >= cost:
            damping, growth, longest_step = growth * damping, 2 * growth, MAX_STEP
            continue
        agreement = min((cost - float(new @ new)) / max(model.decrease(there), 1e-300), 1.0)
        longest_step = STEP_GROWTH * longest_step if agreement > MIN_AGREEMENT else MAX_STEP
        # Nielsen's rule (1999), above, too: it changes gradually, where tenfold changes go to and fro in a curved valley
        damping, growth = max(damping * max(0.1, 1 - (2 * agreement - 1) ** 3), MIN_DAMPING), 2.0
        x, r, jacobian, cost = there, new, new_jacobian, float(new @ new)
        model = _LinearModel(problem, x, r, jacobian)
        least_before, least = least, cost - model.largest_decrease
        if least - max(least_before - least, 0.0) > needless_above:
            break
    return Fit(problem=problem, x=x, residuals=r, final_jacobian=jacobian)


class _LinearModel:
    """The residuals of a problem as a linear function of its parameters about ``x``."""

    def __init__(self, problem: Problem, x: Array, residuals: Array, jacobian: Array) -> None:
        # The Jacobian is that of the prediction, minus that of the residuals, so the cost falls along +J^T r
        self._x, self.gradient, self._normal = x, jacobian.T @ residuals, jacobian.T @ jacobian
        self._low, self._high = problem.low, problem.high
        pressed = ((x <= problem.low) & (self.gradient < 0)) | ((x >= problem.high) & (self.gradient > 0))
        self.free = ~pressed

    def point(self, damping: float, longest: float) -> Array:
        """Return where a damped step leads; each component is clipped at the largest step by itself."""
        # A bound is met exactly, whatever the rounding
        return np.asarray(np.clip(self._x + self._step(damping, longest), self._low, self._high))

    def decrease(self, there: Array) -> float:
        """Return the decrease of the cost that the model predicts at a point."""
        step = there - self._x
        return float(2 * step @ self.gradient - step @ self._normal @ step)

    @cached_property
    def largest_decrease(self) -> float:
        """Decrease of the cost that the model predicts by the whole step to its minimum."""
        return self.decrease(self.point(MIN_DAMPING, math.inf))

    def _step(self, damping: float, longest: float) -> Array:
        """Return the damped step, each component clipped; parameters that press against a bound stay.

        One that would go beyond its bound goes to it, and the step of the others is computed anew: they may not make up for
        what it does not do.
        """
        step = np.zeros(len(self._x))
        moving = self.free.copy()
        below, above = self._low - self._x, self._high - self._x
        while moving.any():
            part = self._normal[np.ix_(moving, moving)]
            remaining = self.gradient[moving] - self._normal[np.ix_(moving, ~moving)] @ step[~moving]
            # The tiny summand keeps the matrix regular where a parameter changes nothing
            step[moving] = np.linalg.solve(part + damping * np.diag(np.diag(part) + 1e-12), remaining)
            step = np.clip(step, -longest, longest)
            beyond = moving & ((step < below) | (step > above))
            if not beyond.any():
                break
            step[beyond] = np.clip(step, below, above)[beyond]
            moving &= ~beyond
        return step


def calibrate(
    problem: Problem, start: Array | None = None, *, cost_tolerance: float = COST_TOLERANCE, needless_above: float = math.inf
) -> Fit:
    """Fit in growing windows of time, by default from the prior's mean; the options are those of `minimise` for the whole."""
    x = problem.prior_mean.copy() if start is None else start
    longest = max((len(c) for d in problem.data for c in d.channels), default=1)
    share = min(FIRST_WINDOW_SHARE, FIRST_WINDOW_POINTS / longest)
    while share < 1 and not fits_end_now():
        x = minimise(problem.until(share), x, cost_tolerance=WINDOW_COST_TOLERANCE).x
        share *= 2
    return minimise(problem, x, cost_tolerance=cost_tolerance, needless_above=needless_above)
