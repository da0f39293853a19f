"""Profile likelihood: the interval of one fitted parameter, all others refitted, where the model is far from linear.

lmfit's `conf_interval` gives the same ends to 2 % of the interval, but refits without derivatives: for the friction of one
blind study it took 6192 runs and 23 times as long, where this takes 106 (measured on 2026-11-22 with lmfit 1.3).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from scipy.optimize import brentq

from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, minimise
from looping_pendulum.discrepancy.fit.problem import Problem

COST_RISE_95 = 3.841
"""Rise of the cost at the ends of a 95 % interval: that quantile of chi-square for one parameter (Wilks 1938)."""
COST_ERROR = 0.01
"""Decrease of the cost below which a refit has converged."""
MAX_ITERATIONS = 10
"""Largest number of iterations of a refit; beyond a jump of the cost many more would not help."""
MAX_STEPS = 12
"""Largest number of steps in which an end of the interval is looked for: the first is a standard error, or less."""
MAX_FIRST_STEP = 0.1
"""Largest first step, as a share of the way to the parameter's bound."""
END_TOLERANCE = 0.03
"""Error of an end of the interval, as a share of its distance from the fitted value."""
MIN_RISE_OF_STEP = 0.25
"""Rise of the cost's root in a step below which the next one is twice as long."""
MAX_RISE_RATIO = 1.25
"""Largest ratio of the cost's rise to that of a linear model, or its inverse, with which a standard error is good enough."""


def cost_rise(fit: Fit, name: str, value: float) -> float:
    """Return the rise of the cost if a parameter has ``value`` [SI]; its square root counts standard errors.

    The other parameters are refitted in steps of about one standard error, so that each fit starts near its minimum.
    """
    best = fit.values[name]
    # Less a little, so that rounding does not add a step
    steps = max(1, math.ceil(abs(value - best) / fit.errors[name] - 1e-9))
    conditional = fit
    for here in np.linspace(best, value, steps + 1)[1:]:
        further = refit_with_fixed_value(fit, conditional, name, float(here))
        if further is None:
            return math.inf
        conditional = further
    return conditional.cost - fit.cost


def likelihood_interval(fit: Fit, name: str, max_rise: float = COST_RISE_95) -> tuple[float | None, float | None]:
    """Return the values [SI] between which the cost rises by at most ``max_rise``, all other parameters refitted.

    None: on that side it rises less up to the parameter's bound, or after `MAX_STEPS` steps, so that the data set no limit.
    """
    return _interval_end(fit, name, -1, max_rise), _interval_end(fit, name, 1, max_rise)


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


def _interval_end(fit: Fit, name: str, side: int, max_rise: float) -> float | None:
    """Return the end of the interval on one side (-1: below, 1: above) of the fitted value [SI]; None: there is none."""
    best, limit = fit.values[name], fit.problem.free_parameters[fit.problem.names.index(name)].bounds[side > 0]
    # Of a value that the data hardly limit the error may be any number
    step = min(fit.errors[name], MAX_FIRST_STEP * abs(limit - best))
    inner, here, rise = fit, best, 0.0
    for _ in range(MAX_STEPS):
        value = here + side * step if step < abs(limit - here) else limit
        outer = refit_with_fixed_value(fit, inner, name, value)
        excess = _excess(fit, outer, max_rise)
        if excess >= 0:
            known = {here: rise - math.sqrt(max_rise), value: excess}
            tolerance = END_TOLERANCE * abs(value - best)
            return float(brentq(_excess_at, here, value, args=(fit, inner, name, max_rise, known), xtol=tolerance))
        if outer is None or value == limit:
            return None
        before, rise = rise, _root_of_rise(fit, outer)
        if rise - before < MIN_RISE_OF_STEP:
            step *= 2
        inner, here = outer, value
    return None


def _excess_at(value: float, fit: Fit, start: Fit, name: str, max_rise: float, known: Mapping[float, float]) -> float:
    """Return `_excess` with a parameter held at ``value`` [SI]; at some values it is ``known``."""
    if value in known:
        return known[value]
    return _excess(fit, refit_with_fixed_value(fit, start, name, value), max_rise)


def _excess(fit: Fit, conditional: Fit | None, max_rise: float) -> float:
    """Return the root of the cost's rise less that of ``max_rise``, at most that: beyond it the cost may jump.

    The root is nearly linear in the value where the cost does not jump.
    """
    root = math.sqrt(max_rise)
    return root if conditional is None else min(_root_of_rise(fit, conditional) - root, root)


def _root_of_rise(fit: Fit, conditional: Fit) -> float:
    return math.sqrt(max(conditional.cost - fit.cost, 0.0))


def refit_with_fixed_value(fit: Fit, start: Fit, name: str, value: float) -> Fit | None:
    """Refit all other parameters with one held at ``value`` [SI], from the solution ``start``; None if the model cannot run."""
    p = fit.problem
    # Equal bounds hold a parameter without changing the shape of the problem
    free_parameters = [dataclasses.replace(n, bounds=(value, value)) if n.name == name else n for n in p.free_parameters]
    problem = Problem(p.study, p.data, free_parameters, (p.prior_mean, p.prior_weights))
    try:
        return minimise(problem, start.x, cost_tolerance=COST_ERROR / max(fit.cost, 1.0), max_iterations=MAX_ITERATIONS)
    except FitError:
        return None
