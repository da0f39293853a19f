"""Find tracked points that do not show the mass: single wild points, and blocks in which the tracker followed something else.

Distances are measured from where the neighbours lead one to expect the residual, not from the model: what a model lacks moves
the residuals of many neighbouring points together and smoothly, so that it is never taken for an outlier. Of these distances d,
a part 1 - e is Gaussian noise in the plane and a part e lies anywhere in the picture, of area A (Hogg, Bovy and Lang,
arXiv:1008.4686, section 3):

    p(d) = (1 - e) exp(-d^2 / 2) / (2 pi sigma^2) + e / A        d in units of sigma

The share e is fitted by expectation-maximisation. A point that is an outlier with a probability above a half is left out of the
fit altogether, as a mark on another object carries no information about the mass; all others keep their full weight. A
Student-t law would lower the weight of every point a little off, and with it that of an effect's onset.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from looping_pendulum.reference_ode.geometry import Array

HALF_WINDOW = 6
"""Neighbours on each side whose median tells where a point is expected.

Over twelve frames at 240 frames/s even a string that lacks drag or friction moves its residual nearly along a line.
"""
MAX_BLOCK = 60
"""Longest block of points on another object [points]: a quarter of a second at 240 frames/s."""
EDGE_POINTS = 5
"""Points before and after a block from which its expected place is interpolated."""
MIN_BLOCK_SHARE = 0.8
"""Share of the points of a block that must be off by more than noise: the mass may cross what the tracker followed."""
MIN_SHARE = 1e-4
"""Smallest share of outliers that is assumed [1], so that the first wild point of a film can be one."""
MAX_SHARE = 0.2
"""Largest share of outliers. With more of them it is not the mass that was tracked, and the residuals should show it."""
MAX_ITERATIONS = 50
"""Iterations of expectation-maximisation; it ends after some ten."""
MEDIAN_VARIANCE = math.pi / 2
"""Variance of a median of many Gaussian values, in units of that of their mean."""


def find_outliers(residual: Array, sigma: Array, area: float) -> NDArray[np.bool_]:
    """Return which points of one body are outliers, shape (n,).

    Parameters
    ----------
    residual
        Measured minus predicted position, in the order of time [m], shape (n, components).
    sigma
        Standard deviation of each component of a point [m], shape (n,).
    area
        Area in which a wild point may lie [m^components].
    """
    if len(residual) < 2 * HALF_WINDOW + 1:
        return np.zeros(len(residual), dtype=bool)
    place = np.arange(len(residual))
    single = _single(place, residual, sigma, area)
    blocks = _blocks(residual, sigma, single, area)
    rest = np.flatnonzero(~blocks)
    if not blocks.any() or len(rest) <= 2 * HALF_WINDOW:
        return single | blocks
    # Beside a block the neighbours' median was wrong: what is left is looked at again without it
    blocks[rest] = _single(rest, residual[rest], sigma[rest], area)
    return blocks


def _single(place: NDArray[np.int_], residual: Array, sigma: Array, area: float) -> NDArray[np.bool_]:
    """Return which points, at ``place`` in the film, are far from where their neighbours lead one to expect them."""
    return _improbable(_distance_from_neighbours(place, residual), sigma, area)


def _improbable(distance: Array, sigma: Array, area: float) -> NDArray[np.bool_]:
    """Return where a point is an outlier with a probability above a half, by the mixture of the module's docstring."""
    components = distance.shape[1]
    spread = math.sqrt(1 + MEDIAN_VARIANCE / (2 * HALF_WINDOW))  # the median that is subtracted scatters, too
    square = np.sum((distance / (spread * sigma[:, None])) ** 2, axis=1)
    log_noise = -0.5 * square - components * np.log(math.sqrt(2 * math.pi) * spread * sigma)
    share = MIN_SHARE
    probability = np.zeros(len(distance))
    for _ in range(MAX_ITERATIONS):
        log_wild = math.log(share) - math.log(area)
        # Clipped, because the exponential of more than 709 is infinite in double precision
        probability = 1 / (1 + np.exp(np.clip(log_noise + math.log1p(-share) - log_wild, -700, 700)))
        new = float(np.clip(probability.mean(), MIN_SHARE, MAX_SHARE))
        if abs(new - share) < 1e-3 * share:
            break
        share = new
    return np.asarray(probability > 0.5)


def _distance_from_neighbours(place: NDArray[np.int_], residual: Array) -> Array:
    """Return how far each point is from the medians of its neighbours, shape (n, components).

    Of the neighbours on both sides, of those before and of those after, the nearest median counts: where the residual jumps,
    for a bumped camera or an event that the model misses, a point agrees with one side. On both sides together, a residual that
    changes at a steady rate has the value of the point itself.
    """
    n, width = len(residual), HALF_WINDOW
    padded = np.pad(residual, ((width, width), (0, 0)), constant_values=np.nan)
    windows = sliding_window_view(padded, 2 * width + 1, axis=0)
    before, after = windows[..., :width], windows[..., width + 1 :]
    expected = [np.median(part, axis=2) for part in (np.concatenate([before, after], axis=2), before, after)]
    # At the ends one side lacks neighbours: a line through the others leads to the point, or where the model lacks something
    # large and the frames are few, a parabola
    ends = np.array([*range(width), *range(n - width, n)])
    nearest = np.where(ends[:, None] < width, np.arange(2 * width + 1), np.arange(n - 2 * width - 1, n))
    others = nearest[nearest != ends[:, None]].reshape(len(ends), 2 * width)
    steps = place[others] - place[ends][:, None]
    expected[0][ends] = _theil_sen(steps, residual[others])
    parabola = np.full_like(residual, np.nan)
    value_at_point = np.linalg.pinv(steps[..., None] ** np.arange(3.0))[:, 0]  # least squares, by the twelve neighbours
    parabola[ends] = np.einsum("kp,kpc->kc", value_at_point, residual[others])
    expected.append(parabola)
    distance = residual - np.array(expected)
    size = np.nan_to_num(np.linalg.norm(distance, axis=2), nan=np.inf)
    return np.asarray(distance[size.argmin(axis=0), np.arange(n)])


def _theil_sen(x: NDArray[np.int_], values: Array) -> Array:
    """Return the values at x = 0 of lines by the medians of slopes and of remainders (Theil and Sen), shape (k, components).

    Each of the k lines goes through points of its own, ``x`` of shape (k, points) and ``values`` of (k, points, components).
    """
    i, j = np.triu_indices(x.shape[1], 1)
    slope = np.median((values[:, j] - values[:, i]) / (x[:, j] - x[:, i])[..., None], axis=1)
    return np.asarray(np.median(values - slope[:, None] * x[..., None], axis=1))


def _blocks(residual: Array, sigma: Array, single: NDArray[np.bool_], area: float) -> NDArray[np.bool_]:
    """Return which points belong to blocks that leave the expected place in one jump and come back to it in another."""
    n = len(residual)
    mask = np.zeros(n, dtype=bool)
    kept = np.flatnonzero(~single)
    step = np.diff(residual[kept], axis=0)
    scatter = math.sqrt(2) * np.maximum(sigma[kept][1:], sigma[kept][:-1])
    # A jump counts as an outlier counts, so that both have one threshold
    jumps = 1 + np.flatnonzero(_improbable(step, scatter, area))
    for k, start in enumerate(jumps):
        for end in jumps[k + 1 :]:
            # The jumps are in order, so all that follow are too far as well
            if end - start > MAX_BLOCK:
                break
            if start < EDGE_POINTS or end + EDGE_POINTS > len(kept):
                continue
            before, after = (np.median(residual[kept[part]], axis=0) for part in (
                slice(start - EDGE_POINTS, start), slice(end, end + EDGE_POINTS)))  # fmt: skip
            inside = kept[start:end]
            way = (np.arange(len(inside)) + 1)[:, None] / (len(inside) + 1)
            distance = residual[inside] - (before + way * (after - before))
            off = _improbable(distance, sigma[inside], area)
            returns = np.linalg.norm(after - before) < 0.5 * np.median(np.linalg.norm(distance, axis=1))
            if returns and off.mean() >= MIN_BLOCK_SHARE:
                mask[kept[start] : kept[end - 1] + 1] = True
                break
    return mask
