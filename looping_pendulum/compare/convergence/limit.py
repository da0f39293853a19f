"""Extrapolates a sequence of ever finer runs to its limit, with an uncertainty.

The functions are pure and take plain numbers.

The order and the limit are a least-squares fit of ``limit + b h^order`` to the finest rungs (L. Eça and M. Hoekstra, J. Comput.
Phys. 262, 104, 2014), with all samples of a path in one fit. Their uncertainty comes from leaving out one rung at a time (the
jackknife) and from a safety factor as in P. Roache's grid convergence index, for what a few rungs cannot show. Rungs too coarse
for the law, outside the asymptotic range, are left out. Rungs that follow no power law have a limit only if the finest ones
agree or each refinement changes much less than the one before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import special  # scipy.stats takes a second to import
from scipy.optimize import minimize_scalar

from looping_pendulum.reference_ode.geometry import Array

ORDERS = np.geomspace(0.05, 8.0, 54)
"""Orders that a fit tries before it refines the best; a best fit at either end is rejected."""
MIN_RUNGS = 3
"""Smallest number of rungs that determine order, limit and slope."""
SAFETY_FACTOR, CAUTIOUS_SAFETY_FACTOR = 1.25, 3.0
"""Roache's safety factors on the distance of the finest rung from the limit.

The first holds where four rungs or more agree on an order, the second otherwise.
"""
HIGHER_ORDER_SHARE = 0.1
"""Error that a rung may have against a power law, as a share of its distance from the finest rung: terms of higher order."""
MAX_MISFIT = 3.0
"""Largest root mean square residual of a fit, in units of the expected error, at which the rungs follow a power law."""
SIGNIFICANT_CHANGE = 2.0
"""Number of standard deviations of the noise above which a change is significant."""
CONFIDENCE = 0.975
"""Quantile of Student's t: one-sided, so that intervals have 95 %."""
CLOSING_FACTOR = 2.0
"""Smallest factor by which each change of a sequence without a power law must be smaller than the one before."""


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Limit of a sequence under refinement."""

    value: Array
    """Shape (samples, components)."""
    uncertainty: float
    """Half-width of the 95 % interval, in the unit of the values."""
    order: float | None = None
    """None where the finest rungs show the limit, but follow no power law."""


def rms_norm(value: Array) -> float:
    """Return the root mean square, over the samples, of the length of ``value``, shape (samples, components)."""
    return float(np.sqrt(np.mean(np.sum(np.square(value), axis=-1))))


def deviation(values: Sequence[Array]) -> float | None:
    """Return the standard deviation of ``values`` about their mean, None for fewer than three."""
    if len(values) < MIN_RUNGS:
        return None
    mean = np.mean(values, axis=0)
    return math.sqrt(sum(rms_norm(value - mean) ** 2 for value in values) / (len(values) - 1))


def significant_change(noise: float) -> float:
    """Return the largest difference between two runs that ``noise``, the standard deviation of one, explains."""
    return SIGNIFICANT_CHANGE * math.sqrt(2) * noise


def refinement_sizes(values: Sequence[float]) -> Array:
    """Return the decreasing sizes h of a setting given from coarse to fine: the setting itself, or its inverse if it grows.

    Raises
    ------
    ValueError
        If the values neither rise nor fall all the way.
    """
    given = np.asarray(values, dtype=float)
    steps = np.diff(given)
    if (steps < 0).all():
        return given
    if (steps > 0).all() and (given > 0).all():
        return 1.0 / given
    raise ValueError(f"found values from coarse to fine that neither rise nor fall: {', '.join(f'{v:g}' for v in values)}")


def extrapolate(h: Array, values: Sequence[Array], *, noise: float, resolution: float) -> Limit | None:
    """Return the limit of a sequence as ``h`` falls; None if its rungs show none.

    Parameters
    ----------
    h
        Size of each rung, decreasing, shape (n,).
    values
        Value of each rung, shape (samples, components): one sample of one component for a number.
    noise
        Standard deviation of a run, by small changes of its start or by rounding; positive.
    resolution
        Difference between rungs up to which they agree, even if it is above the noise.
    """
    if len(values) < MIN_RUNGS:
        return None
    # At least half of the rungs, and four where there are as many: any three that fall follow some power law
    fewest = max(min(MIN_RUNGS + 1, len(values)), math.ceil(len(values) / 2))
    for count in range(len(values), fewest - 1, -1):
        limit = _power_law(h[-count:], values[-count:], noise)
        if limit is not None:
            return limit
    steps = [rms_norm(b - a) for a, b in zip(values, values[1:], strict=False)]
    # Of two runs: the finest rung stands for the limit, and another run confirms it
    half_width = significant_change(noise)
    last = steps[-MIN_RUNGS:]
    if len(last) == MIN_RUNGS and all(CLOSING_FACTOR * b <= a for a, b in zip(last, last[1:], strict=False)):
        return Limit(value=values[-1], uncertainty=math.hypot(CAUTIOUS_SAFETY_FACTOR * last[-1], half_width))
    largest = max(rms_norm(value - values[-1]) for value in values[-MIN_RUNGS:])
    if largest <= max(resolution, half_width):
        return Limit(value=values[-1], uncertainty=math.hypot(largest, half_width))
    return None


def _power_law(h: Array, values: Sequence[Array], noise: float) -> Limit | None:
    """Return the limit of rungs that follow a power law; None if they follow none, or change no more than the noise."""
    if rms_norm(values[0] - values[-1]) <= significant_change(noise) or not _falls_like_a_power(h, values):
        return None
    fit = _fit(h, values, noise)
    if fit is None or fit.misfit > MAX_MISFIT:
        return None
    count, others = len(values), []
    if count > MIN_RUNGS:
        without = ((np.delete(h, k), [value for j, value in enumerate(values) if j != k]) for k in range(count))
        others = [other for sizes, rest in without if (other := _fit(sizes, rest, noise)) is not None]
    order_error, limit_error = math.inf, 0.0
    if len(others) == count:
        # The jackknife's variance is (n - 1) / n times the sum of squares, as the fits differ little from each other
        factor = math.sqrt((count - 1) / count) * float(special.stdtrit(count - 2, CONFIDENCE))
        order_error = factor * math.sqrt(sum((other.order - fit.order) ** 2 for other in others))
        limit_error = factor * math.sqrt(sum(rms_norm(other.limit - fit.limit) ** 2 for other in others))
    # With an interval that includes zero, no order is certain
    safety = SAFETY_FACTOR if order_error < fit.order else CAUTIOUS_SAFETY_FACTOR
    # Roache's interval reaches the factor times the limit's distance from the finest rung; this is what lies beyond the limit
    margin = (safety - 1) * rms_norm(values[-1] - fit.limit)
    half_width = math.hypot(margin, limit_error, fit.misfit * fit.finest_error, noise)
    return Limit(value=fit.limit, uncertainty=half_width, order=fit.order)


def _falls_like_a_power(h: Array, values: Sequence[Array]) -> bool:
    """Return whether all changes have one direction and shrink faster than those of a logarithm would."""
    steps = [b - a for a, b in zip(values, values[1:], strict=False)]
    one_way = all(float(np.sum(a * b)) > 0 for a, b in zip(steps, steps[1:], strict=False))
    small = max(h[-1], h[-2] * 1e-3)  # A last rung of size 0 is the limit itself.
    ratios = np.log(h[:-1] / np.append(h[1:-1], small))
    # The change per factor e of the setting is constant for a logarithm, which has no limit, and falls for every power
    rates = np.array([rms_norm(step) for step in steps]) / ratios
    return one_way and bool((np.diff(rates) < 0).all())


class _Fit(NamedTuple):
    """Least-squares fit of a power law."""

    order: float
    limit: Array
    misfit: float
    """Root mean square residual, in units of each rung's expected error."""
    finest_error: float
    """Expected error of the finest rung."""


def _expected_errors(values: Sequence[Array], noise: float) -> Array:
    """Return the error that each rung may have against a power law: a share of its distance from the finest, and the noise."""
    distance = [rms_norm(value - values[-1]) for value in values[:-1]]
    # The finest rung has no finer one: its distance is extrapolated from the last two by their ratio.
    distance.append(distance[-1] * min(distance[-1] / distance[-2], 1.0))
    return np.hypot(HIGHER_ORDER_SHARE * np.array(distance), noise)


def _fit(h: Array, values: Sequence[Array], noise: float) -> _Fit | None:
    """Fit ``limit + slope h^order`` by least squares; None if no order within `ORDERS` is best."""
    shape, expected = values[0].shape, _expected_errors(values, noise)
    weight = (1 / expected)[:, None]
    # Less the finest rung: what all rungs have in common would only cost digits
    y = weight * np.array([(value - values[-1]).ravel() for value in values])
    # The squared residuals, |y|^2 - |Q^T y|^2, need y only in this small product, however many samples a path has
    gram = y @ y.T

    def design(order: float) -> Array:
        # In units of the coarsest size both columns are of order one, in whatever unit the setting is
        return np.asarray(weight * np.column_stack([np.ones(len(h)), (h / h[0]) ** order]))

    def squared_residual(order: float) -> float:
        basis = np.linalg.qr(design(order))[0]
        return float(np.trace(gram) - np.trace(basis.T @ gram @ basis))

    best = int(np.argmin([squared_residual(order) for order in ORDERS]))
    # At an end the best order may lie outside, so that the fit has found no minimum
    if best in (0, len(ORDERS) - 1):
        return None
    order = float(minimize_scalar(squared_residual, bounds=(ORDERS[best - 1], ORDERS[best + 1]), method="bounded").x)
    solution = np.linalg.lstsq(design(order), y, rcond=None)[0]
    remainder = y - design(order) @ solution
    # The law has three parameters, limit, slope and order, as many as `MIN_RUNGS`
    freedom = max(len(h) - MIN_RUNGS, 1)
    return _Fit(
        order=order,
        limit=np.asarray(solution[0]).reshape(shape) + values[-1],
        misfit=math.sqrt(sum(rms_norm(row.reshape(shape)) ** 2 for row in remainder) / freedom),
        finest_error=float(expected[-1]),
    )
