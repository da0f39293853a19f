"""Measures how rough the boundaries of a map are, by the uncertainty exponent.

The method is by Grebogi, McDonald, Ott and Yorke (Phys. Lett. A 99, 1983). A start is uncertain at a distance eps if one of
its neighbours along an axis, at eps or at one of the smaller `NEIGHBOUR_DISTANCES`, has another outcome. The fraction f of
uncertain starts falls as eps^alpha: alpha = 1 for smooth boundaries; a smaller alpha for fractal ones, where a start known ten
times better makes the outcome hardly more certain.

At small eps hardly any start is uncertain, so f is computed from large to small eps (subset simulation, Au and Beck 2001): the
starts that are uncertain at one eps are spread at random over their neighbourhoods, and the share of them that is uncertain at
the next eps is counted; f is the product of these shares. This requires that starts uncertain at one eps are so at the larger
ones, which the nearer neighbours ensure almost exactly.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.geometry import Array

NEIGHBOUR_DISTANCES = 10 ** -np.arange(0.0, 1.1, 0.5)
"""Distances of the neighbours, in units of eps."""
MOVES_PER_LEVEL = 2
"""Number of random moves of every start within the uncertain set at each eps."""
Outcome = Callable[[Array], NDArray[Any]]
"""Function of starts in the unit cube, shape (n, d), that returns a code of each one's outcome, shape (n,)."""


@dataclass(frozen=True, kw_only=True)
class UncertaintyExponent:
    """Slope of log f against log eps."""

    value: float
    standard_error: float
    """Standard error from bootstrap samples of the replicates."""


def uncertain(outcome: Outcome, starts: Array, eps: float) -> NDArray[np.bool_]:
    """Return whether each of the ``starts``, shape (n, d), is uncertain at the distance ``eps`` (the cube's side is 1)."""
    n, d = starts.shape
    steps = [sign * eps * part * np.eye(d) for part in NEIGHBOUR_DISTANCES for sign in (1.0, -1.0)]
    offsets = np.concatenate([np.zeros((1, d)), *steps])
    codes = outcome((starts + offsets[:, None]).reshape(-1, d)).reshape(len(offsets), n)
    return np.asarray((codes != codes[0]).any(axis=0))


def uncertain_fractions(outcome: Outcome, dimension: int, eps: Array, *, count: int, replicates: int, seed: int) -> Array:
    """Return the fraction of starts in the unit cube that are uncertain at each of ``eps`` (descending).

    It is 0 once no start is left.

    Parameters
    ----------
    outcome
        Function that gives outcomes; it must accept starts up to ``eps[0]`` outside the cube.
    dimension
        Dimension of the cube.
    count
        Number of starts in each replicate.
    replicates
        Number of independent replicates.
    seed
        Seed of the random numbers.

    Returns
    -------
    Array
        Shape (replicates, levels).
    """
    rng = np.random.default_rng(seed)
    starts = rng.random((replicates, count, dimension))
    fractions = np.zeros((replicates, len(eps)))
    fraction = np.ones(replicates)
    for level, distance in enumerate(eps):
        here = _each(outcome, starts, float(distance))
        fraction = fraction * here.mean(axis=1)
        fractions[:, level] = fraction
        if not here.any():
            break
        for row, kept in zip(starts, here, strict=True):
            if kept.any():
                row[:] = rng.choice(row[kept], count)
        for _ in range(MOVES_PER_LEVEL):
            proposed = starts + distance * rng.uniform(-1.0, 1.0, starts.shape)
            taken = ((proposed >= 0) & (proposed <= 1)).all(axis=2) & _each(outcome, proposed, float(distance))
            starts[taken] = proposed[taken]
    return fractions


def _each(outcome: Outcome, starts: Array, eps: float) -> NDArray[np.bool_]:
    """Apply `uncertain` to the starts of every replicate; shape (replicates, count)."""
    return uncertain(outcome, starts.reshape(-1, starts.shape[2]), eps).reshape(starts.shape[:2])


def uncertainty_exponent(eps: Array, fractions: Array, *, resamples: int = 2000, seed: int = 0) -> UncertaintyExponent:
    """Return the least-squares slope of log f against log eps, with f averaged over independent replicates.

    Parameters
    ----------
    eps
        Shape (levels,).
    fractions
        Fractions of each replicate, shape (replicates, levels).
    resamples
        Number of bootstrap samples of the replicates.
    """
    x = np.log(eps)

    def slope(rows: Array) -> float:
        return float(np.polyfit(x, np.log(rows.mean(axis=0)), 1)[0])

    rng = np.random.default_rng(seed)
    n = len(fractions)
    scatter = [slope(fractions[rng.integers(0, n, n)]) for _ in range(resamples)]
    return UncertaintyExponent(value=slope(fractions), standard_error=float(np.std(scatter, ddof=1)))
