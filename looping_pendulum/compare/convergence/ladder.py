"""Classifies a sequence of ever finer runs (does it converge, with which order, to which limit) and splits an error into parts.

The functions are pure and take plain numbers.

The order and the limit are a least-squares fit of ``limit + b h^order`` to the finest rungs (L. Eça and M. Hoekstra, J. Comput.
Phys. 262, 104, 2014), with all samples of a path in one fit. Their uncertainty comes from leaving out one rung at a time (the
jackknife) and from a safety factor as in P. Roache's grid convergence index, for what a few rungs cannot show. Rungs too coarse
for the law, outside the asymptotic range, are left out. A sequence that follows no power law gets no order. If each rung comes
much nearer to the finest than the one before, the finest is its limit; otherwise its scatter is given.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special  # scipy.stats takes a second to import
from scipy.optimize import minimize_scalar

from looping_pendulum.compare.convergence.result import QUANTITIES, ErrorCause, ErrorSplit, SequenceKind
from looping_pendulum.reference_ode.geometry import Array

ORDERS = np.linspace(0.05, 8.0, 160)
"""Orders that a fit tries before it refines the best; a best fit at either end is rejected."""
MIN_RUNGS = 3
"""Smallest number of rungs that determine order, limit and slope."""
SAFETY_FACTOR, CAUTIOUS_SAFETY_FACTOR = 1.25, 3.0
"""Roache's safety factors on the distance of the finest rung from the limit.

The first holds where four rungs or more agree on an order, the second otherwise.
"""
HIGHER_ORDER_SHARE = 0.1
"""Error that a rung may have against a power law, as a share of its distance from the finest rung: terms of higher order."""
MIN_EXPECTED_SHARE = 1e-6
"""Smallest expected error of a rung, as a share of the largest one: a bound on the weights of the fit, for rounding."""
MAX_MISFIT = 3.0
"""Largest root mean square residual of a fit, in units of the expected error, at which the rungs follow a power law."""
SIGNIFICANT_CHANGE = 2.0
"""Number of standard deviations of the spread above which a change is significant."""
CONFIDENCE = 0.975
"""Quantile of Student's t: one-sided, so that intervals have 95 %."""
CLOSING_FACTOR = 3.0
"""Smallest factor by which the distance from the finest rung falls at each rung of a sequence that closes in on its limit."""
SCATTER_RUNGS = 4
"""Number of the finest rungs whose scatter is given if they follow no power law."""


@dataclass(frozen=True, kw_only=True)
class SequenceFinding:
    """Behaviour of a sequence under refinement, and its limit."""

    kind: SequenceKind
    why: str = ""
    """Reason for the kind, in a few words, where it is not convergence."""
    used: int = 0
    """Number of the finest rungs that the limit is derived from."""
    left_out: int = 0
    """Number of coarse rungs that are not in the asymptotic range, and so have no part in order and limit."""
    order: float | None = None
    order_uncertainty: float | None = None
    """Half-width of the 95 % interval of the order; None where three rungs leave no degree of freedom."""
    limit: Array | None = None
    """Limit of the sequence, shape (samples, components); None where it has none."""
    uncertainty: float | None = None
    """Half-width of the 95 % interval of the limit, in the unit of the values."""
    scatter: float | None = None
    """Standard deviation of a rung, where rungs follow no power law."""

    def agrees_with(self, value: Array) -> bool:
        """Return whether the limit equals ``value`` within its uncertainty."""
        return self.limit is not None and self.uncertainty is not None and rms_norm(self.limit - value) <= self.uncertainty


def rms_norm(value: Array) -> float:
    """Return the root mean square, over the samples, of the length of ``value``, shape (samples, components)."""
    return float(np.sqrt(np.mean(np.sum(np.square(value), axis=-1))))


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


def classify_sequence(h: Array, values: Sequence[Array], *, floor: float = 0.0, spread: float | None = None) -> SequenceFinding:
    """Classify how a sequence behaves as ``h`` falls.

    Parameters
    ----------
    h
        Size of each rung, decreasing, shape (n,).
    values
        Value of each rung, shape (samples, components): one sample of one component for a number.
    floor
        Largest change that is due to rounding or to how a value is read from samples.
    spread
        Standard deviation under small changes of the start; changes within it are not evidence of convergence.
    """
    if len(values) < MIN_RUNGS:
        have = "run has" if len(values) == 1 else "runs have"
        return SequenceFinding(kind=SequenceKind.UNKNOWN, why=f"{len(values)} {have} a value, {MIN_RUNGS} are needed")
    settled = _settled(values, floor)
    # The rungs that still move, and the first that does not: their power law has to lead there
    moving = len(values) - settled + 1
    if settled > 1:
        before = _power_law(h[:moving], values[:moving], floor, spread, settled=True)
        if before is not None and before.agrees_with(values[-1]):
            # Only the order is taken from the fit: the settled rungs show the limit themselves
            return replace(before, limit=values[-1], uncertainty=floor)
    if settled >= MIN_RUNGS:  # Two alone may agree by chance.
        return SequenceFinding(kind=SequenceKind.SETTLED, used=settled, limit=values[-1], uncertainty=floor)
    power_law = _power_law(h, values, floor, spread, settled=False)
    if power_law is not None:
        change = rms_norm(values[-power_law.used] - values[-1])
        # The difference of two rungs scatters by sqrt(2) times as much as one of them
        if spread is None or change > SIGNIFICANT_CHANGE * math.sqrt(2) * spread:
            return power_law
    closing = _closing_in(values, floor, spread or 0.0)
    if closing is not None:
        return closing
    tail = values[-min(len(values), SCATTER_RUNGS) :]
    scatter = deviation(tail) or 0.0
    within = spread is not None and scatter <= SIGNIFICANT_CHANGE * max(spread, floor)
    why = "refinement changes it no more than small changes of the start do" if within else _not_monotone(values)
    mean = np.mean(tail, axis=0)
    # Student's t, because the scatter itself comes from a few rungs
    half_width = float(special.stdtrit(len(tail) - 1, CONFIDENCE)) * scatter / math.sqrt(len(tail))
    drift = rms_norm(np.mean(tail[-2:], axis=0) - mean)  # A trend below the scatter still moves the mean.
    return SequenceFinding(
        kind=SequenceKind.WITHIN_SPREAD if within else SequenceKind.SCATTERS,
        why=why,
        used=len(tail),
        limit=mean,
        uncertainty=math.hypot(half_width, drift, floor),
        scatter=scatter,
    )


def _settled(values: Sequence[Array], floor: float) -> int:
    """Return how many of the finest rungs are within ``floor`` of the finest one, itself included."""
    count = 1
    while count < len(values) and rms_norm(values[-count - 1] - values[-1]) <= floor:
        count += 1
    return count


def _power_law(h: Array, values: Sequence[Array], floor: float, spread: float | None, settled: bool) -> SequenceFinding | None:
    """Fit a power law to as many of the finest rungs as follow one; None if these are less than half, or three of more.

    With settled rungs behind them three suffice, since those show the limit themselves. The noise of a rung is the spread,
    unless more rungs than the fit has parameters follow the law better than that.
    """
    if len(values) < MIN_RUNGS:
        return None
    least = MIN_RUNGS if settled else max(min(MIN_RUNGS + 1, len(values)), math.ceil(len(values) / 2))
    for noise, fewest in ((floor, max(least, MIN_RUNGS + 1)), (max(floor, spread or 0.0), least)):
        for count in range(len(values), fewest - 1, -1):
            if _falls_like_a_power(h[-count:], values[-count:]):
                fit = _fit(h[-count:], values[-count:], noise)
                if fit is not None and fit.misfit <= MAX_MISFIT:
                    return replace(_converging(h[-count:], values[-count:], fit, noise), left_out=len(values) - count)
    return None


def _closing_in(values: Sequence[Array], floor: float, spread: float) -> SequenceFinding | None:
    """Take the finest rung for the limit where every rung is much nearer to it than the one before; None: they are not.

    The coarser rungs are then not in the asymptotic range, so that they follow no power law, but they do not scatter either.
    A distance within the spread or the floor is no evidence; as many as `MIN_RUNGS` must be larger.
    """
    distances = [rms_norm(value - values[-1]) for value in values[:-1]]
    significant = sum(d > max(floor, SIGNIFICANT_CHANGE * math.sqrt(2) * spread) for d in distances)
    if significant < MIN_RUNGS or any(b > a / CLOSING_FACTOR for a, b in zip(distances, distances[1:], strict=False)):
        return None
    return SequenceFinding(
        kind=SequenceKind.CONVERGES,
        used=2,
        left_out=len(values) - 2,
        limit=values[-1],
        uncertainty=math.hypot(CAUTIOUS_SAFETY_FACTOR * distances[-1], SIGNIFICANT_CHANGE * spread, floor),
    )


def _falls_like_a_power(h: Array, values: Sequence[Array]) -> bool:
    """Return whether all changes have one direction and shrink faster than those of a logarithm would."""
    steps = [b - a for a, b in zip(values, values[1:], strict=False)]
    one_way = all(float(np.sum(a * b)) > 0 for a, b in zip(steps, steps[1:], strict=False))
    small = max(h[-1], h[-2] * 1e-3)  # A last rung of size 0 is the limit itself.
    ratios = np.log(h[:-1] / np.append(h[1:-1], small))
    # The change per factor e of the setting is constant for a logarithm, which has no limit, and falls for every power
    rates = np.array([rms_norm(step) for step in steps]) / ratios
    return one_way and bool((np.diff(rates) < 0).all())


@dataclass(frozen=True, kw_only=True)
class _Fit:
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
    weight = (1 / np.maximum(expected, expected.max() * MIN_EXPECTED_SHARE))[:, None]
    # Less the finest rung: what all rungs have in common would only cost digits
    y = weight * np.array([(value - values[-1]).ravel() for value in values])

    def designs(orders: Array) -> Array:
        # In units of the coarsest size both columns are of order one, in whatever unit the setting is
        return np.asarray(weight * np.stack(np.broadcast_arrays(1.0, (h / h[0]) ** orders[:, None]), axis=-1))

    # The squared residuals, |y|^2 - |Q^T y|^2, need y only in this small product, however many samples a path has
    gram = y @ y.T

    def residuals_of(orders: Array) -> Array:
        # All orders in one call: NumPy's overhead for each would take twenty times as long as the fits.
        bases = np.linalg.qr(designs(orders))[0]
        return np.asarray(np.trace(gram) - np.trace(bases.swapaxes(-1, -2) @ gram @ bases, axis1=-2, axis2=-1))

    best = int(np.argmin(residuals_of(np.asarray(ORDERS))))
    # At an end the best order may lie outside, so that the fit has found no minimum
    if best in (0, len(ORDERS) - 1):
        return None
    bounds = (ORDERS[best - 1], ORDERS[best + 1])
    order = float(minimize_scalar(lambda order: residuals_of(np.array([order]))[0], bounds=bounds, method="bounded").x)
    (design,) = designs(np.array([order]))
    solution = np.linalg.lstsq(design, y, rcond=None)[0]
    remainder = y - design @ solution
    # The law has three parameters, limit, slope and order, as many as `MIN_RUNGS`
    freedom = max(len(h) - MIN_RUNGS, 1)
    return _Fit(
        order=order,
        limit=np.asarray(solution[0]).reshape(shape) + values[-1],
        misfit=math.sqrt(sum(rms_norm(row.reshape(shape)) ** 2 for row in remainder) / freedom),
        finest_error=float(expected[-1]),
    )


def _converging(h: Array, values: Sequence[Array], fit: _Fit, noise: float) -> SequenceFinding:
    """Return order and limit of rungs that follow a power law, with uncertainties from leaving out one rung at a time."""
    count = len(values)
    jackknife_fits = []
    if count > MIN_RUNGS:
        for k in range(count):
            without_k = _fit(np.delete(h, k), [value for j, value in enumerate(values) if j != k], noise)
            if without_k is not None:
                jackknife_fits.append(without_k)
    known = len(jackknife_fits) == count
    quantile = float(special.stdtrit(count - 2, CONFIDENCE)) if known else math.nan
    # The jackknife's variance is (n - 1) / n times the sum of squares, as fits without one rung differ little from each other
    factor = math.sqrt((count - 1) / count)
    order_error = factor * math.sqrt(sum((one.order - fit.order) ** 2 for one in jackknife_fits)) * quantile if known else None
    limit_error = (
        factor * math.sqrt(sum(rms_norm(one.limit - fit.limit) ** 2 for one in jackknife_fits)) * quantile if known else 0.0
    )
    # With an interval that includes zero, no order is certain
    orders_agree = order_error is not None and order_error < fit.order
    to_limit = rms_norm(values[-1] - fit.limit)
    # Roache's interval reaches the factor times the limit's distance from the finest rung; this is what lies beyond the limit
    margin = ((SAFETY_FACTOR if orders_agree else CAUTIOUS_SAFETY_FACTOR) - 1) * to_limit
    return SequenceFinding(
        kind=SequenceKind.CONVERGES,
        used=count,
        order=fit.order,
        order_uncertainty=order_error,
        limit=fit.limit,
        uncertainty=math.hypot(margin, limit_error, fit.misfit * fit.finest_error, noise),
    )


def deviation(values: Sequence[Array]) -> float | None:
    """Return the standard deviation of ``values`` about their mean, None for fewer than three."""
    if len(values) < MIN_RUNGS:
        return None
    mean = np.mean(values, axis=0)
    return math.sqrt(sum(rms_norm(value - mean) ** 2 for value in values) / (len(values) - 1))


def _not_monotone(values: Sequence[Array]) -> str:
    """Say in a few words why ``values`` follow no power law."""
    steps = [b - a for a, b in zip(values, values[1:], strict=False)]
    if float(np.sum(steps[-1] * steps[-2])) <= 0:
        return "the last two refinements change it in opposite directions"
    if rms_norm(steps[-1]) >= rms_norm(steps[-2]):
        return "the last refinement changes it more than the one before"
    return "its changes follow no power of the setting"


@dataclass(frozen=True, kw_only=True)
class RefinementChange:
    """Difference that refining one setting to its limit would make."""

    change: Array
    """Limit less the value at the variant's setting, shape (samples, components)."""
    uncertainty: float
    converges: bool


def split_error(
    own: Array,
    reference: Array,
    *,
    quantity: str,
    without_limit: tuple[str, ...] = (),
    corrections: Sequence[RefinementChange],
    choices: Mapping[str, Array],
    spread: float | None,
    floor: float = 0.0,
) -> ErrorSplit:
    """Split the distance of ``own`` from ``reference`` into numerics, model and choice.

    The error that remains at the limit is attributed to the model, unless another choice of the adapter would change the value
    by as much; then it is attributed to that choice.

    Parameters
    ----------
    own, reference
        Value at the variant's settings, and the reference's, shape (samples, components).
    quantity
        One of `QUANTITIES`.
    without_limit
        Ladders that have no limit, so that there is no correction of them.
    corrections
        One per ladder that has a limit; ladders are assumed to act independently, so that their corrections add up.
    choices
        Another choice -> the value with it.
    spread
        Standard deviation under small changes of the start.
    floor
        How well a value can be read from samples at all.
    """
    noise = floor if spread is None else math.hypot(SIGNIFICANT_CHANGE * spread, floor)
    changes = {what: rms_norm(value - own) for what, value in choices.items()}
    choice_of = max(changes, key=lambda what: changes[what], default="")
    choice = changes.get(choice_of)
    numerics = model = half_width = None
    parts: list[tuple[float, ErrorCause]] = []
    if corrections:
        total = np.sum([c.change for c in corrections], axis=0)
        numerics, model = rms_norm(total), rms_norm(own + total - reference)
        half_width = math.hypot(noise, *(c.uncertainty for c in corrections))
        # Without convergence the half-width is that of scattered rungs, below which the numerics may well be a cause
        if numerics > half_width or not all(c.converges for c in corrections):
            parts.append((numerics, ErrorCause.NOT_CONVERGED))
        if model > half_width:
            parts.append(
                (model, ErrorCause.CHOICE if choice is not None and choice >= model - half_width else ErrorCause.MODEL)
            )
    causes = tuple(cause for _, cause in sorted(parts, key=lambda pair: -pair[0]))
    return ErrorSplit(
        quantity=quantity,
        unit=QUANTITIES[quantity],
        error=rms_norm(own - reference),
        numerics=numerics,
        numerics_uncertainty=half_width,
        model=model,
        model_uncertainty=half_width,
        choice=choice,
        choice_of=choice_of,
        spread=spread,
        causes=causes or ((ErrorCause.NOTHING,) if corrections else (ErrorCause.UNKNOWN,)),
        without_limit=without_limit,
    )
