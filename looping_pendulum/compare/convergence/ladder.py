"""Does a sequence of ever finer runs converge, how fast, to what, and how much of an error is it? Pure functions on numbers.

The order and the limit are a least-squares fit of ``limit + b h^order`` to the finest rungs (L. Eça and M. Hoekstra, J. Comput.
Phys. 262, 104, 2014), with all samples of a path in one fit; leaving out one rung at a time says how well they are known, and a
safety factor as in P. Roache's grid convergence index covers what a few rungs cannot show. A sequence that is no power law gets
no order: it is said how far it scatters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import t as students_t

from looping_pendulum.reference_ode.geometry import Array

ORDERS = np.linspace(0.05, 8.0, 160)
"""Orders that a fit tries; one at either end is no order."""
FEWEST = 3
"""Rungs that an order needs."""
SAFETY, CAUTIOUS_SAFETY = 1.25, 3.0
"""Roache's factors on the distance of the finest rung to the limit: where four rungs or more agree on an order, and else."""
SHARE = 0.1
"""Of its distance from the finest, what a rung may be off a power law: terms of higher order."""
LEAST_SHARE = 1e-6
"""What is expected of a rung is at least this share of the coarsest's: rounding."""
POOR_FIT = 3.0
"""A fit that leaves more than this, in units of what is expected, is not that of a power law."""
SEEN = 2.0
"""A change counts as seen if it is this many standard deviations of the spread."""
CONFIDENCE = 0.975
"""One-sided, so that limits are given with 95 %."""
FINEST = 4
"""Rungs whose scatter is taken, where they follow no power law."""


class SequenceKind(StrEnum):
    """What a sequence does."""

    CONVERGES = "converges"
    SETTLED = "no longer changes"
    WITHIN_SPREAD = "converges no further than its spread"
    SCATTERS = "does not converge"
    NEVER = "never happens"
    UNKNOWN = "not known"


@dataclass(frozen=True, kw_only=True)
class SequenceFinding:
    """What a sequence does, and its limit."""

    kind: SequenceKind
    why: str = ""
    """Why it is no better, in a few words."""
    used: int = 0
    """Finest rungs that the limit is of."""
    order: float | None = None
    order_uncertainty: float | None = None
    """95 %; None where three rungs leave nothing to tell it from."""
    limit: Array | None = None
    """Shape (samples, components)."""
    uncertainty: float | None = None
    """Of the limit, 95 %, in the sequence's unit."""
    scatter: float | None = None
    """Standard deviation of a rung, where rungs follow no power law."""

    def points_to(self, value: Array) -> bool:
        """Whether the limit is ``value``, within its uncertainty."""
        return self.limit is not None and self.uncertainty is not None and norm(self.limit - value) <= self.uncertainty


def norm(value: Array) -> float:
    """Root mean square over the samples of the length of ``value``, shape (samples, components)."""
    return float(np.sqrt(np.mean(np.sum(np.square(value), axis=-1))))


def sizes(values: Sequence[float]) -> Array:
    """Falling sizes h of a setting given from coarse to fine: the setting, or one over it if it grows.

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
    raise ValueError(f"values from coarse to fine neither rise nor fall: {', '.join(f'{v:g}' for v in values)}")


def examine(h: Array, values: Sequence[Array], *, floor: float = 0.0, spread: float | None = None) -> SequenceFinding:
    """Say what a sequence does as ``h`` falls.

    Parameters
    ----------
    h
        Size of each rung, falling, shape (n,).
    values
        Per rung shape (samples, components): one sample of one component for a number.
    floor
        Changes up to this are not seen: rounding, or how a value is read off.
    spread
        Standard deviation that small changes of the start give; changes within it are no convergence.
    """
    if len(values) < FEWEST:
        return SequenceFinding(kind=SequenceKind.UNKNOWN, why=f"{len(values)} of the {FEWEST} rungs that it needs")
    settled = _settled(values, floor)
    moving = len(values) - settled + 1
    if settled > 1:
        before = _power_law(h[:moving], values[:moving], floor, spread, settled=True)
        if before is not None and before.points_to(values[-1]):
            return replace(before, limit=values[-1], uncertainty=floor)
    if settled >= FEWEST:  # two alone may be so by chance
        return SequenceFinding(kind=SequenceKind.SETTLED, used=settled, limit=values[-1], uncertainty=floor)
    power_law = _power_law(h, values, floor, spread, settled=False)
    if power_law is not None:
        change = norm(values[-power_law.used] - values[-1])
        if spread is None or change > SEEN * math.sqrt(2) * spread:
            return power_law
    tail = values[-min(len(values), FINEST) :]
    scatter = _deviation(tail)
    within = spread is not None and scatter <= SEEN * max(spread, floor)
    why = "finer rungs change it no more than small changes of the start do" if within else _not_monotone(values)
    mean = np.mean(tail, axis=0)
    half_width = float(students_t.ppf(CONFIDENCE, len(tail) - 1)) * scatter / math.sqrt(len(tail))
    drift = norm(np.mean(tail[-2:], axis=0) - mean)  # a trend below the scatter still moves the mean
    return SequenceFinding(
        kind=SequenceKind.WITHIN_SPREAD if within else SequenceKind.SCATTERS,
        why=why,
        used=len(tail),
        limit=mean,
        uncertainty=math.hypot(half_width, drift, floor),
        scatter=scatter,
    )


def _settled(values: Sequence[Array], floor: float) -> int:
    """How many of the finest rungs are within ``floor`` of the finest: 1 if only itself."""
    count = 1
    while count < len(values) and norm(values[-count - 1] - values[-1]) <= floor:
        count += 1
    return count


def _power_law(h: Array, values: Sequence[Array], floor: float, spread: float | None, settled: bool) -> SequenceFinding | None:
    """Order and limit of most of the finest rungs that follow one power law; None if they are less than half, or three of more.

    With settled rungs behind them three will do: those show the limit themselves. The spread is the noise of a rung, unless
    more rungs than a fit has numbers follow the law better than that.
    """
    if len(values) < FEWEST:
        return None
    least = FEWEST if settled else max(min(FEWEST + 1, len(values)), math.ceil(len(values) / 2))
    for noise, fewest in ((floor, max(least, FEWEST + 1)), (max(floor, spread or 0.0), least)):
        for count in range(len(values), fewest - 1, -1):
            if _falls_like_a_power(h[-count:], values[-count:]):
                fit = _fit(h[-count:], values[-count:], noise)
                if fit is not None and fit.misfit <= POOR_FIT:
                    return _converging(h[-count:], values[-count:], fit, noise)
    return None


def _falls_like_a_power(h: Array, values: Sequence[Array]) -> bool:
    """Whether changes all point one way and shrink faster than those of a logarithm would."""
    steps = [b - a for a, b in zip(values, values[1:], strict=False)]
    one_way = all(float(np.sum(a * b)) > 0 for a, b in zip(steps, steps[1:], strict=False))
    small = max(h[-1], h[-2] * 1e-3)  # a last rung of size 0 is the limit itself
    ratios = np.log(h[:-1] / np.append(h[1:-1], small))
    rates = np.array([norm(step) for step in steps]) / ratios
    return one_way and bool((np.diff(rates) < 0).all())


@dataclass(frozen=True, kw_only=True)
class _Fit:
    order: float
    limit: Array
    misfit: float
    """Root mean square of what the fit leaves, in units of what is expected of each rung."""
    finest: float
    """What is expected of the finest rung."""


def _expected(values: Sequence[Array], noise: float) -> Array:
    """How far each rung may be off a power law: a share of its distance from the finest, and the noise."""
    distance = [norm(value - values[-1]) for value in values[:-1]]
    distance.append(distance[-1] * min(distance[-1] / distance[-2], 1.0))  # the finest is off by that much, as one step tells
    return np.hypot(SHARE * np.array(distance), noise)


def _fit(h: Array, values: Sequence[Array], noise: float) -> _Fit | None:
    """Least squares of ``limit + slope h^order``; None if no order within `ORDERS` is best."""
    shape, expected = values[0].shape, _expected(values, noise)
    weight = (1 / np.maximum(expected, expected.max() * LEAST_SHARE))[:, None]
    y = weight * np.array([(value - values[-1]).ravel() for value in values])

    def design(order: float) -> Array:
        return np.asarray(weight * np.column_stack([np.ones_like(h), (h / h[0]) ** order]))

    gram = y @ y.T

    def left_by(order: float) -> float:
        basis = np.linalg.qr(design(order))[0]
        return float(np.trace(gram) - np.trace(basis.T @ gram @ basis))

    best = int(np.argmin([left_by(order) for order in ORDERS]))
    if best in (0, len(ORDERS) - 1):
        return None
    order = float(minimize_scalar(left_by, bounds=(ORDERS[best - 1], ORDERS[best + 1]), method="bounded").x)
    solution = np.linalg.lstsq(design(order), y, rcond=None)[0]
    remainder = y - design(order) @ solution
    freedom = max(len(h) - FEWEST, 1)
    return _Fit(
        order=order,
        limit=np.asarray(solution[0]).reshape(shape) + values[-1],
        misfit=math.sqrt(sum(norm(row.reshape(shape)) ** 2 for row in remainder) / freedom),
        finest=float(expected[-1]),
    )


def _converging(h: Array, values: Sequence[Array], fit: _Fit, noise: float) -> SequenceFinding:
    """Order and limit of rungs that follow a power law, with what leaving out one rung at a time says of them."""
    count = len(values)
    others = []
    if count > FEWEST:
        for k in range(count):
            one = _fit(np.delete(h, k), [value for j, value in enumerate(values) if j != k], noise)
            if one is not None:
                others.append(one)
    known = len(others) == count
    quantile = float(students_t.ppf(CONFIDENCE, count - 2)) if known else math.nan
    jackknife = math.sqrt((count - 1) / count)
    order_error = jackknife * math.sqrt(sum((one.order - fit.order) ** 2 for one in others)) * quantile if known else None
    limit_error = jackknife * math.sqrt(sum(norm(one.limit - fit.limit) ** 2 for one in others)) * quantile if known else 0.0
    agreed = order_error is not None and order_error < fit.order
    to_limit = norm(values[-1] - fit.limit)
    covered = ((SAFETY if agreed else CAUTIOUS_SAFETY) - 1) * to_limit
    return SequenceFinding(
        kind=SequenceKind.CONVERGES,
        used=count,
        order=fit.order,
        order_uncertainty=order_error,
        limit=fit.limit,
        uncertainty=math.hypot(covered, limit_error, fit.misfit * fit.finest, noise),
    )


def _deviation(values: Sequence[Array]) -> float:
    """Return the standard deviation of ``values`` about their mean; 0 of a single one."""
    if len(values) < 2:
        return 0.0
    mean = np.mean(values, axis=0)
    return math.sqrt(sum(norm(value - mean) ** 2 for value in values) / (len(values) - 1))


def deviation(values: Sequence[Array]) -> float | None:
    """Return the standard deviation of ``values``, None of fewer than three."""
    return _deviation(values) if len(values) >= FEWEST else None


def _not_monotone(values: Sequence[Array]) -> str:
    steps = [b - a for a, b in zip(values, values[1:], strict=False)]
    if float(np.sum(steps[-1] * steps[-2])) <= 0:
        return "the last two refinements change it in opposite directions"
    if norm(steps[-1]) >= norm(steps[-2]):
        return "the last refinement changes it more than the one before"
    return "its changes follow no power of the setting"


class ErrorCause(StrEnum):
    """What the larger part of an error is."""

    NOT_CONVERGED = "not converged"
    MODEL = "different model"
    CHOICE = "adapter's choice"
    NOTHING = "nothing beyond its uncertainty"
    UNKNOWN = "not known"


@dataclass(frozen=True, kw_only=True)
class Correction:
    """How far a ladder's limit is from the variant's own setting."""

    ladder: str
    change: Array
    """Limit less value at the variant's setting, shape (samples, components)."""
    uncertainty: float
    converges: bool


@dataclass(frozen=True, kw_only=True)
class ErrorParts:
    """An error in parts, in the quantity's unit; each with its 95 % uncertainty where it has one."""

    error: float
    numerics: float | None
    numerics_uncertainty: float | None
    model: float | None
    model_uncertainty: float | None
    choice: float | None
    choice_of: str
    spread: float | None
    causes: tuple[ErrorCause, ...]
    """Those seen above their uncertainty, the largest first."""


def split_error(
    own: Array,
    reference: Array,
    *,
    corrections: Sequence[Correction],
    choices: Mapping[str, Array],
    spread: float | None,
    floor: float = 0.0,
) -> ErrorParts:
    """Split the distance of ``own`` from ``reference`` into numerics, model and choice.

    What is left at the limit is the model's if no other choice changes the answer by as much; else it is the adapter's choice.

    Parameters
    ----------
    own, reference
        Value at the variant's settings, and the true one, shape (samples, components).
    corrections
        One per ladder that has a limit; ladders are taken to act independently, so their corrections add up.
    choices
        What else could be chosen -> value with it.
    spread
        Standard deviation that small changes of the start give.
    floor
        How well a value can be read off at all.
    """
    noise = floor if spread is None else math.hypot(SEEN * spread, floor)
    moved = {what: norm(value - own) for what, value in choices.items()}
    choice_of = max(moved, key=lambda what: moved[what], default="")
    choice = moved.get(choice_of)
    numerics = model = half_width = None
    found: list[tuple[float, ErrorCause]] = []
    if corrections:
        total = np.sum([c.change for c in corrections], axis=0)
        numerics, model = norm(total), norm(own + total - reference)
        half_width = math.hypot(noise, *(c.uncertainty for c in corrections))
        if numerics > half_width or not all(c.converges for c in corrections):
            found.append((numerics, ErrorCause.NOT_CONVERGED))
        if model > half_width:
            found.append(
                (model, ErrorCause.CHOICE if choice is not None and choice >= model - half_width else ErrorCause.MODEL)
            )
    causes = tuple(cause for _, cause in sorted(found, key=lambda pair: -pair[0]))
    return ErrorParts(
        error=norm(own - reference),
        numerics=numerics,
        numerics_uncertainty=half_width,
        model=model,
        model_uncertainty=half_width,
        choice=choice,
        choice_of=choice_of,
        spread=spread,
        causes=causes or ((ErrorCause.NOTHING,) if corrections else (ErrorCause.UNKNOWN,)),
    )
