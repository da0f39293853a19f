"""Estimate the noise of tracked points from the residuals of a fit, and leave out points that do not show the mass.

These are single points, and blocks in which the tracker followed something else. Their distances are measured from where the
neighbours lead one to expect the residual, not from the model: what a model lacks moves the residuals of many neighbouring
points together and smoothly, so that it is never taken for an outlier. Of these distances d, a part 1 - e is Gaussian noise in
the plane and a part e lies anywhere in the picture, of area A (Hogg, Bovy and Lang, arXiv:1008.4686, section 3):

    p(d) = (1 - e) exp(-d^2 / 2) / (2 pi sigma^2) + e / A        d in units of sigma

A point that is an outlier with a probability above a half is left out of the fit altogether, as a mark on another object
carries no information about the mass; all others keep their full weight. A Student-t law would lower the weight of every point
a little off, and with it that of an effect's onset.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.measured.noise import GAUSSIAN_MAD, fit_noise_law
from looping_pendulum.measured.observations import BODIES, Channel
from looping_pendulum.reference_ode.geometry import Array

MIN_DIFFERENCES = 20
"""Smallest number of differences from which a noise law is estimated."""
MIN_SIGMA_RATIO = 0.2
"""Smallest sigma of a point, as a part of the median sigma of its body's points."""
MAX_STEP_RATIO = 1.5
"""Time steps longer than this many median steps are gaps."""
MAX_DIFFERENCE_SIGMAS = 4.0
"""Standardised size at which differences are clipped."""
HALF_WINDOW = 6
"""Neighbours on each side whose median tells where a point is expected.

Over twelve frames at 240 frames/s even a string that lacks drag or friction moves its residual nearly along a line.
"""
TYPICAL_WINDOW = 15
"""Points on each side among which a distance is typical or not."""
MAX_BLOCK = 60
"""Longest block of points on another object [points]: a quarter of a second at 240 frames/s."""
EDGE_POINTS = 5
"""Points before and after a block from which its expected place is interpolated."""
MIN_BLOCK_SHARE = 0.8
"""Share of the points of a block that must be off by more than noise: the mass may cross what the tracker followed."""
SHARE = 1e-3
"""Share e of outliers before the data are seen [1]. A tenfold one moves the distance that counts by 0.4 sigma."""
MAX_SHARE = 0.2
"""Largest share of outliers. With more of them it is not the mass that was tracked, and the residuals should show it."""
MEDIAN_VARIANCE = math.pi / 2
"""Variance of a median of many Gaussian values, in units of that of their mean."""


def with_noise_of_residuals(fit: Fit) -> Fit:
    """Estimate each trial's noise from differences of neighbouring residuals, leave out outliers, and refit.

    Such differences do not see slow misfits; with them, chi2 scatters by 1/sqrt(n).
    """
    data = [data_with_noise_of_residuals(fit, k) for k in range(len(fit.problem.data))]
    return minimise(fit.problem.with_data(data), fit.x)


def refit_with_estimated_noise(fit: Fit) -> Fit:
    """Estimate noise and refit, twice in turn; after two rounds they agree."""
    first = with_noise_of_residuals(fit)
    if any(d.is_outlier.any() for d in first.problem.data):
        # Outliers may have led the fit astray, so that it begins anew without them
        first = min((first, calibrate(first.problem)), key=lambda f: f.cost)
    return with_noise_of_residuals(first)


def data_with_noise_of_residuals(fit: Fit, k: int) -> TrialData:
    """Return the data of trial ``k`` with the noise of its residuals, and without outliers; its correlated noise stays."""
    d = fit.problem.data[k]
    residual = d.value - fit.problem.predict(fit.x, k)
    used = np.isfinite(d.sigma) | d.is_outlier
    sigma, outliers = d.sigma.copy(), np.zeros(len(d.sigma), dtype=bool)
    for names in BODIES.values():
        channels = [c for c in d.channels if c.name in names]
        if not channels:
            continue
        clean = d
        for _ in range(2):  # outliers widen the law by which they are found
            law = _noise_of_body(fit, k, residual, channels, clean)
            here = _outliers_of_body(d, residual, law, used)
            if not here.any():
                break
            clean = dataclasses.replace(d, sigma=np.where(here, np.inf, d.sigma))
        outliers |= here
        for c in channels:
            part, scatter = d.slices[c.name], law[c.name]
            if c.name in d.correlated:
                scatter = d.correlated[c.name].white_sigma(scatter, c.time_step)
            # Values that are left out of the fit for another reason, with infinite sigma, stay so
            sigma[part] = np.where((used & ~here)[part], scatter, np.inf)
    return dataclasses.replace(d, sigma=sigma, outliers=outliers)


def _outliers_of_body(d: TrialData, residual: Array, law: dict[str, Array], used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which values do not show the body, shape of the whole vector; a point's coordinates are judged together.

    Parameters
    ----------
    law
        Channel of the body -> sigma of its points.
    """
    outliers = np.zeros(len(residual), dtype=bool)
    together = len({d.t[d.slices[name]].tobytes() for name in law}) == 1
    for group in [list(law)] if together else [[name] for name in law]:
        parts = [d.slices[name] for name in group]
        kept = np.flatnonzero(np.all([used[part] for part in parts], axis=0))
        if not len(kept):
            continue
        noise = law[group[0]][kept]
        # An outlier may lie anywhere between the extremes of all points, and of a body at rest within its noise
        spans = [max(float(np.ptp(d.value[part][kept])), float(noise.max())) for part in parts]
        columns = np.stack([residual[part][kept] for part in parts], axis=1)
        outliers_of_group = find_outliers(columns, noise, math.prod(spans))
        for part in parts:
            outliers[part.start + kept] = outliers_of_group
    return outliers


def _noise_of_body(fit: Fit, k: int, residual: Array, channels: Sequence[Channel], d: TrialData) -> dict[str, Array]:
    """Return channel -> sigma of its points, a + b |v|, for one body, by differences of neighbouring residuals.

    Values that ``d`` leaves out do not count.
    """
    speeds = {c.name: _speed(fit, k, c.name) for c in channels}
    differences, mean_speeds = [np.zeros(0)], [np.zeros(0)]
    for name, speed in speeds.items():
        part = d.slices[name]
        t, mode = d.t[part], modes(fit, k)[part]
        if len(t) < MIN_DIFFERENCES:
            continue
        step = np.diff(t)
        counts = np.isfinite(d.sigma[part][:-1] + d.sigma[part][1:])
        # Only neighbours in one mode: the model's error may jump where the mode changes
        kept = counts & (mode[:-1] == mode[1:]) & (step < MAX_STEP_RATIO * np.median(step))
        differences.append((np.diff(residual[part]) / math.sqrt(2))[kept])
        mean_speeds.append(0.5 * (speed[1:] + speed[:-1])[kept])
    if sum(map(len, differences)) < MIN_DIFFERENCES:
        sigma = {name: d.sigma[d.slices[name]] for name in speeds}
        # Points that were left out have the error of the others
        return {
            name: np.where(np.isfinite(s), s, np.median(s[np.isfinite(s)]) if np.isfinite(s).any() else np.inf)
            for name, s in sigma.items()
        }
    a, b = fit_noise_law(np.concatenate(differences), np.concatenate(mean_speeds), MAX_DIFFERENCE_SIGMAS)
    law = {}
    for c in channels:
        speed = speeds[c.name]
        least = np.maximum(c.least_sigma(speed), MIN_SIGMA_RATIO * (a + b * float(np.median(speed))))
        law[c.name] = np.maximum(a + b * speed, least)
    return law


def sample_index(fit: Fit, k: int) -> NDArray[np.intp]:
    """Return the index of the run's sample that belongs to each value of trial ``k``."""
    samples = fit.problem.run(fit.x, k)
    _, camera = fit.problem.parameters_and_camera(fit.x, k)
    t = np.maximum(camera.true_time(fit.problem.data[k].t), 0.0)
    # Less than any step, so that rounding does not lead to the sample after
    return np.minimum(np.searchsorted(samples.t, t - 1e-12), len(samples.t) - 1)


def modes(fit: Fit, k: int) -> NDArray[np.int8]:
    """Return the mode of the run at each value of trial ``k``."""
    return np.asarray(fit.problem.run(fit.x, k).mode[sample_index(fit, k)])


def _speed(fit: Fit, k: int, channel: str) -> Array:
    """Return the speed [unit/s] of the body that a channel shows, at its points, by the model."""
    samples, part = fit.problem.run(fit.x, k), fit.problem.data[k].slices[channel]
    at = sample_index(fit, k)[part]
    state = samples.state
    if channel == "angle_rate":
        return np.asarray(np.abs(np.gradient(fit.problem.predict(fit.x, k)[part], fit.problem.data[k].t[part])))
    if channel == "angle":
        return np.asarray(np.abs(state.across_speed / state.free_length)[at])
    heavy = channel.startswith("heavy") or (channel == "height" and fit.problem.data[k].trial.dropped == "heavy")
    return np.asarray(np.linalg.norm(samples.heavy_velocity if heavy else samples.light_velocity, axis=1)[at])


def find_outliers(residual: Array, sigma: Array, area: float) -> NDArray[np.bool_]:
    """Return which points of one body are outliers, shape (n,).

    Parameters
    ----------
    residual
        Measured minus predicted position, in the order of time [m], shape (n, components).
    sigma
        Standard deviation of each component of a point [m], shape (n,).
    area
        Area in which an outlier may lie [m^components].
    """
    if len(residual) < 2 * HALF_WINDOW + 1:
        return np.zeros(len(residual), dtype=bool)
    single = _single(residual, sigma, area, np.zeros(len(residual), dtype=bool))
    blocks = _blocks(residual, sigma, single, area)
    # Beside a block the neighbours led astray: what is left is looked at again without it
    return blocks | _single(residual, sigma, area, blocks) if blocks.any() else single


def _single(residual: Array, sigma: Array, area: float, left_out: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which points are far from where their neighbours, without those ``left_out``, lead one to expect them."""
    gone = left_out.copy()
    while (~gone).sum() > 2 * HALF_WINDOW:
        rest = np.flatnonzero(~gone)
        square, improbable = _improbable(_distance_from_neighbours(rest, residual[rest]), sigma[rest], area, rough=True)
        # An outlier leads its neighbours astray, so that of those that are near each other only the worst goes at a time
        padded = np.pad(np.where(improbable, square, 0.0), HALF_WINDOW)
        worst = improbable & (square >= sliding_window_view(padded, 2 * HALF_WINDOW + 1).max(axis=1))
        if not worst.any():
            break
        gone[rest[worst]] = True
    single = gone & ~left_out
    return single if single.mean() <= MAX_SHARE else np.zeros_like(single)


def _improbable(distance: Array, sigma: Array, area: float, *, rough: bool = False) -> tuple[Array, NDArray[np.bool_]]:
    """Return squared distances in units of noise, and where a point is an outlier with a probability above a half.

    Parameters
    ----------
    rough
        Whether distances that are typical of their surroundings count as noise, however large they are: with few frames in a
        swing that the model misses, the neighbours do not lead to the point.
    """
    components = distance.shape[1]
    standardised = distance / sigma[:, None]
    typical = _typical_size(standardised) if rough else np.ones(len(distance))
    square = np.asarray(np.sum((standardised / typical[:, None]) ** 2, axis=1))
    log_noise = -0.5 * square - components * np.log(math.sqrt(2 * math.pi) * typical * sigma)
    log_odds = math.log(SHARE / (1 - SHARE)) - math.log(area) - log_noise
    return square, np.asarray(log_odds > 0)


def _typical_size(standardised: Array) -> Array:
    """Return the size that is typical around each point, shape (n,): a running median in units of noise, at least 1."""
    width = min(TYPICAL_WINDOW, (len(standardised) - 1) // 2)
    padded = np.pad(np.abs(standardised), ((width, width), (0, 0)), mode="reflect")
    windows = sliding_window_view(padded, 2 * width + 1, axis=0)
    return np.asarray(np.maximum(GAUSSIAN_MAD * np.median(windows, axis=2).max(axis=1), 1.0))


def _distance_from_neighbours(place: NDArray[np.int_], residual: Array) -> Array:
    """Return how far each point is from where its neighbours lead one to expect it, shape (n, components).

    Distances are over the root of 1 + v, where v is the variance of the expectation in units of a point's. Of three of them the
    nearest counts: the median of the neighbours before it, and of those after it, of which one is right where the residual
    jumps, for a bumped camera or an event that the model misses; and a cubic through the nearest on both sides, which is right
    where the residual bends.
    """
    n, width = len(residual), HALF_WINDOW
    padded = np.pad(residual, ((width, width), (0, 0)), constant_values=np.nan)
    windows = sliding_window_view(padded, 2 * width + 1, axis=0)
    before, after = (np.median(part, axis=2) for part in (windows[..., :width], windows[..., width + 1 :]))
    nearest = np.clip(np.arange(n) - width, 0, n - 2 * width - 1)[:, None] + np.arange(2 * width + 1)
    others = nearest[nearest != np.arange(n)[:, None]].reshape(n, 2 * width)
    powers = ((place[others] - place[:, None]) / width)[..., None] ** np.arange(4.0)
    transposed = powers.swapaxes(1, 2)
    inverse = np.linalg.inv(transposed @ powers)[:, :1]
    cubic = (inverse @ (transposed @ residual[others]))[:, 0]  # least squares
    variance = np.array([np.full(n, MEDIAN_VARIANCE / width), np.full(n, MEDIAN_VARIANCE / width), inverse[:, 0, 0]])
    distance = (residual - np.array([before, after, cubic])) / np.sqrt(1 + variance)[..., None]
    size = np.nan_to_num(np.linalg.norm(distance, axis=2), nan=np.inf)
    return np.asarray(distance[size.argmin(axis=0), np.arange(n)])


def _blocks(residual: Array, sigma: Array, single: NDArray[np.bool_], area: float) -> NDArray[np.bool_]:
    """Return which points belong to blocks that leave the expected place in one jump and come back to it in another."""
    n = len(residual)
    mask = np.zeros(n, dtype=bool)
    kept = np.flatnonzero(~single)
    step = np.diff(residual[kept], axis=0)
    scatter = math.sqrt(2) * np.maximum(sigma[kept][1:], sigma[kept][:-1])
    # A jump counts as an outlier counts, so that both have one threshold
    jumps = 1 + np.flatnonzero(_improbable(step, scatter, area, rough=True)[1])
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
            _, off = _improbable(distance, sigma[inside], area)
            returns = np.linalg.norm(after - before) < 0.5 * np.median(np.linalg.norm(distance, axis=1))
            if returns and off.mean() >= MIN_BLOCK_SHARE:
                mask[kept[start] : kept[end - 1] + 1] = True
                break
    return mask
