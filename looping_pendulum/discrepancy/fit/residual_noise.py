"""Estimate the noise of tracked points from the residuals of a fit, and leave out points that do not show the mass."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise_steps
from looping_pendulum.discrepancy.fit.outliers import find_outliers
from looping_pendulum.discrepancy.fit.predictions import Steps, alone
from looping_pendulum.discrepancy.fit.problem import TrialData
from looping_pendulum.measured.noise import GAUSSIAN_MAD
from looping_pendulum.measured.observations import BODIES
from looping_pendulum.reference_ode.geometry import Array

MIN_DIFFERENCES = 20
"""Smallest number of differences from which a noise law is estimated."""
MIN_SIGMA_RATIO = 0.2
"""Smallest sigma of a point, as a part of the median sigma of its body's points."""
MAX_STEP_RATIO = 1.5
"""Time steps longer than this many median steps are gaps."""
MAX_DIFFERENCE_SIGMAS = 4.0
"""Standardised size at which differences are clipped."""


def with_noise_of_residuals(fit: Fit) -> Fit:
    """Do the same as `with_noise_of_residuals_steps`."""
    return alone(with_noise_of_residuals_steps(fit))


def with_noise_of_residuals_steps(fit: Fit) -> Steps[Fit]:
    """Estimate each trial's noise from differences of neighbouring residuals, leave out outliers, and refit.

    Such differences do not see slow misfits. With them, chi2 scatters by 1/sqrt(n); with second differences 1.5 times as much;
    with the points' own differences of fourth order, which need no model, twice as much.
    """
    data = [data_with_noise_of_residuals(fit, k) for k in range(len(fit.problem.data))]
    return minimise_steps(fit.problem.with_data(data), fit.x, initial_jacobian=_rescaled_jacobian(fit, data))


def refit_with_estimated_noise(fit: Fit) -> Fit:
    """Estimate noise and refit, twice in turn; after two rounds they agree."""
    first = with_noise_of_residuals(fit)
    if any(d.is_outlier.any() for d in first.problem.data):
        # Outliers may have led the fit astray, so that it begins anew without them
        first = min((first, calibrate(first.problem)), key=lambda f: f.cost)
    return with_noise_of_residuals(first)


def _rescaled_jacobian(fit: Fit, data: Sequence[TrialData]) -> Array | None:
    """Return the fit's Jacobian for new errors: rows are in units of sigma, so these only rescale them. None: not known."""
    if fit.final_jacobian is None or any(d.correlated for d in (*fit.problem.data, *data)):
        return None
    jacobian = fit.final_jacobian.copy()
    row = 0
    for before, after in zip(fit.problem.data, data, strict=True):
        counts = np.isfinite(after.sigma)
        if np.isinf(before.sigma[counts]).any():
            return None  # rows of values that were left out until now are zero
        rows = jacobian[row : row + len(counts)]
        rows[counts] *= (before.sigma[counts] / after.sigma[counts])[:, None]
        rows[~counts] = 0.0
        row += len(counts)
    return jacobian


def data_with_noise_of_residuals(fit: Fit, k: int) -> TrialData:
    """Return the data of trial ``k`` with the noise of its residuals, and without outliers; its correlated noise stays."""
    d = fit.problem.data[k]
    residual = d.value - fit.problem.predict(fit.x, k)
    used = np.isfinite(d.sigma) | d.is_outlier
    sigma, outliers = d.sigma.copy(), np.zeros(len(d.sigma), dtype=bool)
    for names in BODIES.values():
        steps = {c.name: c.time_step for c in d.channels if c.name in names}
        channels = list(steps)
        if not channels:
            continue
        law = _noise_of_body(fit, k, residual, channels)
        here = _outliers_of_body(d, residual, channels, law, used)
        if here.any():  # they have widened the law
            clean = dataclasses.replace(d, sigma=np.where(here, np.inf, d.sigma))
            law = _noise_of_body(fit, k, residual, channels, clean)
            here = _outliers_of_body(d, residual, channels, law, used)
        outliers |= here
        for name in channels:
            part = d.slices[name]
            scatter = law[name]
            if name in d.correlated:
                scatter = d.correlated[name].white_sigma(scatter, steps[name])
            # Values that are left out of the fit for another reason, with infinite sigma, stay so
            sigma[part] = np.where((used & ~here)[part], scatter, np.inf)
    return dataclasses.replace(d, sigma=sigma, outliers=outliers)


def _outliers_of_body(
    d: TrialData, residual: Array, names: Sequence[str], law: dict[str, Array], used: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which values do not show the body, shape of the whole vector; a point's coordinates are judged together."""
    outliers = np.zeros(len(residual), dtype=bool)
    times = [d.t[d.slices[name]] for name in names]
    together = all(np.array_equal(t, times[0]) for t in times)
    for group in [list(names)] if together else [[name] for name in names]:
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


def _noise_of_body(fit: Fit, k: int, residual: Array, names: Sequence[str], data: TrialData | None = None) -> dict[str, Array]:
    """Return channel -> sigma of its points, a + b |v|, for one body, by differences of neighbouring residuals.

    The values that ``data`` leaves out do not count; by default those that the fit leaves out.
    """
    d = data or fit.problem.data[k]
    speeds = {n: _speed(fit, k, n) for n in names}
    differences, mean_speeds = [], []
    for n in names:
        part = d.slices[n]
        t, mode = d.t[part], modes(fit, k)[part]
        if len(t) < MIN_DIFFERENCES:
            continue
        step = np.diff(t)
        counts = np.isfinite(d.sigma[part][:-1] + d.sigma[part][1:])
        kept = counts & (mode[:-1] == mode[1:]) & (step < MAX_STEP_RATIO * np.median(step))
        # Only neighbours in one mode: the model's error may jump where the mode changes.
        differences.append((np.diff(residual[part]) / math.sqrt(2))[kept])
        mean_speeds.append(0.5 * (speeds[n][1:] + speeds[n][:-1])[kept])
    if not differences or sum(map(len, differences)) < MIN_DIFFERENCES:
        sigma = {n: d.sigma[d.slices[n]] for n in names}
        # Points that were left out have the error of the others
        typical = {n: np.median(s[np.isfinite(s)]) for n, s in sigma.items() if np.isfinite(s).any()}
        return {n: np.where(np.isfinite(s), s, typical.get(n, np.inf)) for n, s in sigma.items()}
    a, b = _fit_noise_law(np.concatenate(differences), np.concatenate(mean_speeds))
    least = {c.name: c.least_sigma(speeds[c.name]) for c in d.channels if c.name in speeds}
    return {
        n: np.maximum(np.maximum(a + b * speeds[n], least[n]), MIN_SIGMA_RATIO * (a + b * float(np.median(speeds[n]))))
        for n in names
    }


def _fit_noise_law(difference: Array, v: Array) -> tuple[float, float]:
    """Fit sigma = a + b v with a, b >= 0 to Gaussian differences by maximum likelihood; outliers are clipped."""
    a, b = GAUSSIAN_MAD * float(np.median(np.abs(difference))) + 1e-12, 0.0
    for _ in range(40):
        sigma = np.maximum(a + b * v, 0.05 * a + 1e-12)
        # Linearised, as in `data.noise`, the estimating equation is a weighted line through these values
        y = 0.5 * (sigma + np.minimum(difference**2, (MAX_DIFFERENCE_SIGMAS * sigma) ** 2) / sigma)
        w = 1 / sigma**2
        middle = float(w @ v / w.sum())
        spread = float(w @ (v - middle) ** 2)
        b = max(float(w @ ((v - middle) * y)) / spread, 0.0) if spread > 1e-12 * w.sum() else 0.0
        a = float(w @ y / w.sum()) - b * middle
        if a < 0:
            a, b = 1e-12, float(w @ (v * y) / (w @ v**2))
    return a, b


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
