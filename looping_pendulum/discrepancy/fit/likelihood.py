"""Profile likelihood: the interval of one fitted parameter, all others refitted, where the model is far from linear.

lmfit's `conf_interval` gives the same ends, but without derivatives takes 60 times as many runs.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.optimize import brentq
from scipy.special import log_ndtr

from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, minimise
from looping_pendulum.discrepancy.fit.problem import Problem

COST_RISE_95 = 3.841
"""Rise of the cost at the ends of a 95 % interval: that quantile of chi-square for one parameter (Wilks 1938)."""
COST_ERROR = 0.01
"""Decrease of the cost below which a refit has converged."""
MAX_STEPS = 12
"""Largest number of steps, each twice as long, in which an end is looked for: the first is a standard error, or less."""
MAX_FIRST_STEP = 0.1
"""Largest first step, as a share of the way to the parameter's bound."""
END_TOLERANCE = 0.03
"""Error of an end of the interval, as a share of its distance from the fitted value."""
MAX_SELECTION_MARGIN = 4.0
"""Standard errors beyond the least distance at which a value is stated, from which on that selection moves no end by 1 %."""
MAX_RISE_RATIO = 1.25
"""Largest ratio of the cost's rise to that of a linear model, or its inverse, with which a standard error is good enough."""


def stated_interval(fit: Fit, name: str, null: float, min_distance: float) -> tuple[float | None, float | None] | None:
    """Return where a value [SI] lies with 95 % probability that is only stated if it is far enough from its null value.

    None: it is 1.96 standard errors on either side, since the model is nearly linear and the value far beyond what is needed.

    Parameters
    ----------
    null
        Value [SI] at which the effect is absent.
    min_distance
        Distance from it, in standard errors, from which on the value is stated.
    """
    linear = is_nearly_linear(fit, name)
    value, error = fit.values[name], fit.errors[name]
    # In standard errors
    distance = abs(value - null) / error if linear else _root_of_rise(fit, refit_with_fixed_value(fit, fit, name, null))
    rise = rise_after_selection(distance, min_distance)
    if linear and rise == COST_RISE_95:
        return None
    sides = (-1, 1) if value > null else (1, -1)
    ends = [
        null if r is None else value + side * math.sqrt(r) * error if linear else interval_end(fit, name, side, r)
        for side, r in zip(sides, (rise, COST_RISE_95), strict=True)
    ]
    return (ends[0], ends[1]) if value > null else (ends[1], ends[0])


def rise_after_selection(distance: float, min_distance: float) -> float | None:
    """Return the rise of the cost at that end of a stated value's 95 % interval that is nearer to its null value.

    Of values near the least that is stated, those are stated which noise has enlarged. So the end is where a value as large as
    this one has a probability of 2.5 % among those that are stated (conditional likelihood: Zhong and Prentice, Biostatistics 9
    (2008) 621). None: it would be beyond the null value, which is the end then. The other end, which that would bring nearer,
    keeps the usual rise.

    Parameters
    ----------
    distance, min_distance
        Distances from the null value, in standard errors: of this value, and from which on values are stated.
    """
    # Nearer, it is stated for another reason
    if not min_distance <= distance <= min_distance + MAX_SELECTION_MARGIN:
        return COST_RISE_95

    def log_excess(end: float) -> float:
        return float(log_ndtr(end - distance) - log_ndtr(end - min_distance)) - math.log(0.025)

    if log_excess(0.0) >= 0:
        return None
    return float((distance - brentq(log_excess, 0.0, distance)) ** 2)


def is_nearly_linear(fit: Fit, name: str) -> bool:
    """Return whether the cost rises at either end of a parameter's linear 95 % interval about as if the model were linear.

    The other parameters follow as the fit's covariance says, so that it takes two runs and no refit.
    """
    i = fit.problem.names.index(name)
    step = math.sqrt(COST_RISE_95) * fit.covariance[i] / math.sqrt(max(fit.covariance[i, i], 1e-300))
    for side in (-1, 1):
        x = fit.x + side * step
        if np.any((x < fit.problem.low) | (x > fit.problem.high)):
            return False
        residuals = fit.problem.residuals(x)
        rise = math.inf if residuals is None else float(residuals @ residuals) - fit.cost
        if not COST_RISE_95 / MAX_RISE_RATIO <= rise <= COST_RISE_95 * MAX_RISE_RATIO:
            return False
    return True


def interval_end(fit: Fit, name: str, side: int, max_rise: float = COST_RISE_95) -> float | None:
    """Return up to which value [SI] the cost rises by at most ``max_rise``, all other parameters refitted.

    None: it rises less up to the parameter's bound, or after `MAX_STEPS` steps, so that the data set no limit.

    Parameters
    ----------
    side
        -1: below the fitted value; 1: above it.
    """
    best, limit = fit.values[name], fit.problem.free_parameters[fit.problem.names.index(name)].bounds[side > 0]
    # Of a value that the data hardly limit the error may be any number
    step = min(fit.errors[name], MAX_FIRST_STEP * abs(limit - best))
    inner, here, root = fit, best, math.sqrt(max_rise)
    known = {best: -root}

    def excess(value: float) -> float:
        """Return the root of the cost's rise less that of ``max_rise``, at most that: beyond it the cost may jump.

        The root is nearly linear in the value where the cost does not jump.
        """
        if value not in known:
            known[value] = min(_root_of_rise(fit, refit_with_fixed_value(fit, inner, name, value)) - root, root)
        return known[value]

    for _ in range(MAX_STEPS):
        value = here + side * step if step < abs(limit - here) else limit
        outer = refit_with_fixed_value(fit, inner, name, value)
        known[value] = min(_root_of_rise(fit, outer) - root, root)
        if outer is None or known[value] >= 0:
            return float(brentq(excess, here, value, xtol=END_TOLERANCE * abs(value - best)))
        if value == limit:
            return None
        inner, here, step = outer, value, 2 * step
    return None


def _root_of_rise(fit: Fit, conditional: Fit | None) -> float:
    """Return the root of the cost's rise, which counts standard errors; infinite if the model cannot run."""
    return math.inf if conditional is None else math.sqrt(max(conditional.cost - fit.cost, 0.0))


def refit_with_fixed_value(fit: Fit, start: Fit, name: str, value: float) -> Fit | None:
    """Refit all other parameters with one held at ``value`` [SI], from the solution ``start``; None if the model cannot run."""
    p = fit.problem
    # Equal bounds hold a parameter without changing the shape of the problem
    free_parameters = [dataclasses.replace(n, bounds=(value, value)) if n.name == name else n for n in p.free_parameters]
    problem = Problem(p.study, p.data, free_parameters, (p.prior_mean, p.prior_weights))
    try:
        return minimise(problem, start.x, cost_tolerance=COST_ERROR / max(fit.cost, 1.0))
    except FitError:
        return None
