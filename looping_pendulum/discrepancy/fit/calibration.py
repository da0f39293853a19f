"""Fit a model to all trials together by the Levenberg-Marquardt method, in windows of time that grow to the whole trials.

Parameters are in units of their prior standard errors. If the heavy mass turns several times, the cost has many minima. That of
the first part of the motion has one, so fits start there.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.fit.predictions import Steps, alone
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.errors import HarnessError
from looping_pendulum.reference_ode.geometry import Array

# In a prototype, on simulated trials at mass ratios of 10, 6 and 4, fits in windows converged from 40 of 40 wrong starts each,
# and fits of the whole trials at once from 7, 3 and 1
WINDOW_SHARES = (0.3, 0.5, 0.8, 1.0)
"""Parts of the longest trial that are fitted one after the other."""
FIRST_WINDOW_POINTS = 80
"""Largest number of points of a channel in the first window.

Later points of a long swing only mislead the fit until its period is known.
"""
# Each component is clipped by itself: where the whole step was shortened, fits at a mass ratio of 4 failed (same prototype)
MAX_STEP = 3.0
"""Largest change of one parameter in one iteration, in units of its scale."""
COST_TOLERANCE, WINDOW_COST_TOLERANCE = 1e-6, 3e-4
"""Relative decrease of the cost below which a fit has converged, in the last window and in those before it."""
MIN_DECREASE_RATIO = 0.5
"""Smallest ratio of actual to predicted decrease of the cost after which the Jacobian is updated, not recomputed."""
MAX_BROYDEN_UPDATES = 6
"""Number of Broyden updates after which the Jacobian is recomputed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Minimum of a `Problem`'s cost."""

    problem: Problem
    x: Array
    """Free parameters at the minimum, in units of their scales, shape (p,)."""
    residuals: Array
    """Standardised residuals there, then those of the prior, shape (n + p,)."""
    iterations: int
    """Number of Jacobians that were computed."""
    final_jacobian: Array | None = None
    """Jacobian of the last iteration.

    None: the last one was not computed so near to ``x``.
    """

    @property
    def cost(self) -> float:
        """Return the sum of squared residuals, prior included."""
        return float(self.residuals @ self.residuals)

    @property
    def minus_twice_log_likelihood(self) -> float:
        """Return -2 ln L but for a constant, prior included: it compares models whose noise differs."""
        return self.cost + sum(d.log_determinant for d in self.problem.data)

    @cached_property
    def jacobian(self) -> Array:
        """Return the Jacobian at the minimum, shape (n + p, p): `final_jacobian`, or one that is computed now."""
        return self.problem.jacobian(self.x) if self.final_jacobian is None else self.final_jacobian

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

    def correlations(self, above: float = 0.9) -> tuple[tuple[str, str, float], ...]:
        """Return pairs of parameters with a correlation above ``above`` in size, and that correlation, strongest first."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        matrix = self.covariance / np.outer(sigma, sigma)
        names = self.problem.names
        rows, columns = np.triu_indices(len(names), 1)
        pairs = [(names[i], names[j], float(matrix[i, j])) for i, j in zip(rows, columns, strict=True)]
        return tuple(sorted((p for p in pairs if abs(p[2]) > above), key=lambda p: -abs(p[2])))

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Return the parameters that ended on a bound."""
        p = self.problem
        return tuple(n for n, v, lo, hi in zip(p.names, self.x, p.low, p.high, strict=True) if min(v - lo, hi - v) < 1e-9)


class FitError(HarnessError, RuntimeError):
    """Raised if no fit can be made."""


def minimise(problem: Problem, x: Array, **options: Any) -> Fit:
    """Minimise the cost within the bounds; arguments, result and errors as of `minimise_steps`."""
    return alone(minimise_steps(problem, x, **options))


def minimise_steps(
    problem: Problem,
    x: Array,
    *,
    cost_tolerance: float = COST_TOLERANCE,
    max_iterations: int = 30,
    confirm: bool = True,
    initial_jacobian: Array | None = None,
    known_columns: Array | None = None,
) -> Steps[Fit]:
    """Minimise the cost within the bounds by the Levenberg-Marquardt method, in steps that ask for predictions.

    The Jacobian follows from one step to the next by Broyden's update. It is recomputed if a step with an updated one fails or
    decreases the cost by much less than predicted.

    `scipy.optimize.least_squares` with the same Jacobian finds the same minima, but computes it at every step: of five blind
    studies a calibration from the study's values took 0.7 times as long, and a whole identification, most of whose fits begin
    near their minimum, 1.6 to 2.4 times (measured on 2026-11-22).

    Parameters
    ----------
    x
        Initial parameters in units of their scales, shape (p,).
    cost_tolerance
        Relative decrease of the cost below which the fit has converged.
    max_iterations
        Largest number of Jacobians that are computed.
    confirm
        Whether convergence must be confirmed with a newly computed Jacobian.
    initial_jacobian
        Jacobian at ``x``, or as near to it as two iterations are when a fit ends; None: not known.
    known_columns
        Jacobian near ``x`` of the same problem without its last parameters, with which the first step is made.

    Raises
    ------
    FitError
        If the model cannot run at ``x``.
    """
    x = np.clip(x, problem.low, problem.high)
    r = yield from _residuals(problem, x)
    if r is None:
        raise FitError("the model cannot run at the start of the fit; check the study's values")
    cost, damping, iterations = float(r @ r), 1e-3, 0
    # The age is the number of updates since the Jacobian was computed; at its largest value a new one is due
    if initial_jacobian is not None:
        jacobian, age = initial_jacobian, 0
    elif known_columns is not None:
        jacobian, age = (yield from _jacobian(problem, x, known_columns)), 1  # one that may be wrong, like an updated one
    else:
        jacobian, age = np.zeros((0, 0)), MAX_BROYDEN_UPDATES
    while True:
        if age >= MAX_BROYDEN_UPDATES:
            if iterations == max_iterations:
                break
            jacobian, age = (yield from _jacobian(problem, x)), 0
            iterations += 1
        # The Jacobian is that of the prediction, minus that of the residuals, so the cost falls along +J^T r.
        gradient, normal = jacobian.T @ r, jacobian.T @ jacobian
        free = ~(((x <= problem.low) & (gradient < 0)) | ((x >= problem.high) & (gradient > 0)))
        decrease = 0.0
        # An updated Jacobian gets one try: if its step fails, it is not the damping that is wrong.
        for _ in range(1 if age else 8):
            whole_step = _step(normal, gradient, free, damping, problem.low - x, problem.high - x)
            trial_x = np.clip(x + whole_step, problem.low, problem.high)  # a bound is met exactly, whatever the rounding
            new = yield from _residuals(problem, trial_x)
            if new is not None and float(new @ new) < cost:
                step, change = trial_x - x, new - r
                predicted_decrease = float(2 * step @ gradient - step @ normal @ step)
                x, r, decrease = trial_x, new, cost - float(new @ new)
                cost -= decrease
                break
            if not age:
                damping *= 10
        if not decrease or decrease < cost_tolerance * cost:
            # A newly computed Jacobian leaves no better step. An updated one may be wrong, and is replaced before the fit ends
            if not age or (decrease and not confirm):
                break
            age, damping = MAX_BROYDEN_UPDATES, min(damping, 1e-3)
        elif decrease < MIN_DECREASE_RATIO * predicted_decrease:
            age = MAX_BROYDEN_UPDATES
        else:
            # Broyden's update: the smallest change with which the Jacobian predicts what this step did to the residuals
            jacobian = jacobian - np.outer(change + jacobian @ step, step / float(step @ step))
            age += 1
        damping = max(damping / 10, 1e-9)
    return Fit(problem=problem, x=x, residuals=r, iterations=iterations, final_jacobian=None if age else jacobian)


def _residuals(problem: Problem, x: Array) -> Steps[Array | None]:
    (predicted,) = yield problem, x[None]
    return problem.residuals_of(x, predicted)


def _jacobian(problem: Problem, x: Array, known_columns: Array | None = None) -> Steps[Array]:
    rows = problem.rows_of_jacobian(x, 0 if known_columns is None else known_columns.shape[1])
    return problem.jacobian_of(x, rows, (yield problem, rows), known_columns)


def _step(normal: Array, gradient: Array, free: NDArray[np.bool_], damping: float, below: Array, above: Array) -> Array:
    """Return the damped step, each component clipped; parameters that press against a bound stay.

    One that would go beyond its bound, ``below`` or ``above`` it, goes to it, and the step of the others is computed anew: they
    may not make up for what it does not do.
    """
    step = np.zeros(len(gradient))
    moving = free.copy()
    while moving.any():
        part = normal[np.ix_(moving, moving)]
        remaining = gradient[moving] - normal[np.ix_(moving, ~moving)] @ step[~moving]
        # The tiny summand keeps the matrix regular where a parameter changes nothing
        step[moving] = np.linalg.solve(part + damping * np.diag(np.diag(part) + 1e-12), remaining)
        step = np.clip(step, -MAX_STEP, MAX_STEP)
        beyond = moving & ((step < below) | (step > above))
        if not beyond.any():
            break
        step[beyond] = np.clip(step, below, above)[beyond]
        moving &= ~beyond
    return step


def _window_shares(problem: Problem) -> tuple[float, ...]:
    """Return the parts of the longest trial that are fitted before the whole.

    For a long channel they begin with `FIRST_WINDOW_POINTS` and double up to those of `WINDOW_SHARES`; for swings, whose fits
    cost in proportion to the time, up to the whole.
    """
    longest = max((len(c) for d in problem.data for c in d.channels), default=0)
    early, share = [], FIRST_WINDOW_POINTS / max(longest, 1)
    if problem.is_swing:
        return tuple(share * 2**i for i in range(max(0, math.ceil(math.log2(1 / share)))))
    while share < WINDOW_SHARES[0]:
        early.append(share)
        share *= 2
    return (*early, *WINDOW_SHARES[:-1])


def calibrate(problem: Problem, start: Array | None = None, *, max_iterations: int = 30) -> Fit:
    """Fit in growing windows of time, by default from the prior's mean, with at most ``max_iterations`` in each window."""
    return alone(calibrate_steps(problem, start, max_iterations=max_iterations))


def calibrate_steps(problem: Problem, start: Array | None = None, *, max_iterations: int = 30) -> Steps[Fit]:
    """Do the same as `calibrate` in steps that ask for predictions."""
    x = problem.prior_mean.copy() if start is None else start
    total = 0
    for share in _window_shares(problem):
        fit = yield from minimise_steps(
            problem.until(share), x, cost_tolerance=WINDOW_COST_TOLERANCE, max_iterations=max_iterations, confirm=False
        )
        x, total = fit.x, total + fit.iterations
    fit = yield from minimise_steps(problem, x, max_iterations=max_iterations)
    return dataclasses.replace(fit, iterations=fit.iterations + total)
