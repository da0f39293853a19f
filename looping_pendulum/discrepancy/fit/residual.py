"""Test the residuals of a fit: how large their noise is, and whether they have structure beyond it.

Each threshold is one that all but 1-2 % of 120 simulated studies without a missing effect ("clean studies") pass. The extreme
value of those studies stands with it below.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from looping_pendulum.discrepancy.data.noise import estimate_noise, speed_at
from looping_pendulum.discrepancy.data.observations import BODIES, Observations
from looping_pendulum.discrepancy.data.study import Trial
from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.event_tests import EventTest, check_event_residuals
from looping_pendulum.discrepancy.fit.problem import TrialData
from looping_pendulum.pages.numbers import number
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode

MAX_CHI2_PER_DOF = 1.07
"""Largest chi2 per degree of freedom that passes.

Of clean studies with some 2900 values, 95 % are below 1.056; the largest has 1.073.
"""
CHI2_SCATTER_SIGMAS = 3.8
"""Largest excess of chi2 per degree of freedom over 1, in units of 1/sqrt(n), for studies with fewer values."""
MAX_LAG1_Z = 2.9
"""Largest z of the lag-1 autocorrelation that passes: what a model lacks lasts longer than a frame.

The maximum of the clean studies is 2.87.
"""
MIN_LJUNG_BOX_P = 5e-4
"""Smallest p value of the Ljung-Box test over ten lags that passes."""
MIN_RUNS_Z = -3.4
"""Smallest z of the runs test that passes: below it there are fewer sign changes than by chance.

The minimum of the clean studies is -2.98.
"""
MIN_GROUP_SIZE = 20
"""Smallest number of values of a group that is tested."""
MIN_SIGMA_RATIO = 0.2
"""Smallest sigma of a point, as a part of the median sigma of its body's points."""
MAX_STEP_RATIO = 1.5
"""Time steps longer than this many median steps are gaps."""
OUTLIER_SIGMAS = 4.0
"""Differences of more standard deviations than this are outliers, which are clipped."""


def trial_data(trial: Trial, observations: Observations) -> TrialData:
    """Return a trial's data: channels with noise estimated from the points alone, and events with their stated errors."""
    parts = {}
    for channels in observations.bodies().values():
        noise = estimate_noise(channels)
        for c in channels:
            parts[c.name] = np.maximum(noise.sigma(speed_at(channels, c.t, noise.a)), 1e-9)
    if "angle_rate" in {c.name for c in observations.channels}:
        channels = tuple(
            c for c in observations.channels if c.name != "angle_rate"
        )  # computed from the angles: no new information
    else:
        channels = observations.channels
    stated = np.array([e.sigma for e in observations.events], dtype=float)
    sigma = np.concatenate([*(parts[c.name] for c in channels), stated])
    return TrialData(trial=trial, channels=channels, events=observations.events, sigma=sigma)


def with_noise_of_residuals(fit: Fit) -> Fit:
    """Estimate each trial's noise from differences of neighbouring residuals, and refit with it.

    Such differences do not see slow misfits. With them, chi2 scatters by 1/sqrt(n); with second differences 1.5 times as much;
    with the points' own differences of fourth order, which need no model, twice as much.
    """
    data = []
    jacobian = None if fit.final_jacobian is None else fit.final_jacobian.copy()
    row = 0
    for k, d in enumerate(fit.problem.data):
        residual = d.value - fit.problem.predict(fit.x, k)
        sigma = d.sigma.copy()
        for names in BODIES.values():
            channels = [c for c in d.channels if c.name in names]
            if channels:
                law = _noise_of_body(fit, k, residual, [c.name for c in channels])
                for c in channels:
                    # values that are left out of the fit, with infinite sigma, stay so
                    sigma[d.slices[c.name]] = np.where(np.isfinite(sigma[d.slices[c.name]]), law[c.name], np.inf)
        data.append(dataclasses.replace(d, sigma=sigma))
        if jacobian is not None:
            # rows of the Jacobian are in units of sigma, so new errors only rescale them
            counts = np.isfinite(sigma)
            jacobian[row : row + len(sigma)][counts] *= (d.sigma[counts] / sigma[counts])[:, None]
        row += len(sigma)
    return minimise(fit.problem.with_data(data), fit.x, initial_jacobian=jacobian)


def refit_with_estimated_noise(fit: Fit) -> Fit:
    """Estimate noise and refit, twice in turn; after two rounds they agree."""
    return with_noise_of_residuals(with_noise_of_residuals(fit))


def best_of(fits: Sequence[Fit]) -> Fit:
    """Return the fit of lowest cost."""
    return min(fits, key=lambda f: f.cost)


def calibrate_from_random_start(fit: Fit, rng: np.random.Generator) -> Fit:
    """Fit the same problem again from an initial value drawn from the prior."""
    p = fit.problem
    return calibrate(p, np.clip(p.prior_mean + rng.standard_normal(len(p.free_parameters)), p.low, p.high))


def _noise_of_body(fit: Fit, k: int, residual: Array, names: Sequence[str]) -> dict[str, Array]:
    """Return channel -> sigma of its points, a + b |v|, for one body, by differences of neighbouring residuals."""
    d = fit.problem.data[k]
    speeds = {n: _speed(fit, k, n) for n in names}
    differences, mean_speeds = [], []
    for n in names:
        part = d.slices[n]
        t, mode = d.t[part], _modes(fit, k)[part]
        if len(t) < MIN_GROUP_SIZE:
            continue
        step = np.diff(t)
        counts = np.isfinite(d.sigma[part][:-1] + d.sigma[part][1:])
        kept = counts & (mode[:-1] == mode[1:]) & (step < MAX_STEP_RATIO * np.median(step))
        # Only neighbours in one mode: the model's error may jump where the mode changes.
        differences.append((np.diff(residual[part]) / math.sqrt(2))[kept])
        mean_speeds.append(0.5 * (speeds[n][1:] + speeds[n][:-1])[kept])
    if not differences or sum(map(len, differences)) < MIN_GROUP_SIZE:
        return {n: d.sigma[d.slices[n]] for n in names}
    a, b = _fit_noise_law(np.concatenate(differences), np.concatenate(mean_speeds))
    return {n: np.maximum(a + b * speeds[n], MIN_SIGMA_RATIO * (a + b * float(np.median(speeds[n])))) for n in names}


def _fit_noise_law(difference: Array, v: Array) -> tuple[float, float]:
    """Fit sigma = a + b v with a, b >= 0 to Gaussian differences by maximum likelihood; outliers are clipped."""
    a, b = 1.4826 * float(np.median(np.abs(difference))) + 1e-12, 0.0
    for _ in range(40):
        sigma = np.maximum(a + b * v, 0.05 * a + 1e-12)
        y = 0.5 * (sigma + np.minimum(difference**2, (OUTLIER_SIGMAS * sigma) ** 2) / sigma)
        w = 1 / sigma**2
        middle = float(w @ v / w.sum())
        spread = float(w @ (v - middle) ** 2)
        b = max(float(w @ ((v - middle) * y)) / spread, 0.0) if spread > 1e-12 * w.sum() else 0.0
        a = float(w @ y / w.sum()) - b * middle
        if a < 0:
            a, b = 1e-12, float(w @ (v * y) / (w @ v**2))
    return a, b


def _sample_index(fit: Fit, k: int) -> NDArray[np.intp]:
    """Return the index of the run's sample that belongs to each value of trial ``k``."""
    samples = fit.problem.run(fit.x, k)
    _, camera = fit.problem.parameters_and_camera(fit.x, k)
    t = np.maximum(camera.true_time(fit.problem.data[k].t), 0.0)
    return np.minimum(np.searchsorted(samples.t, t - 1e-12), len(samples.t) - 1)


def _modes(fit: Fit, k: int) -> NDArray[np.int8]:
    """Return the mode of the run at each value of trial ``k``."""
    return np.asarray(fit.problem.run(fit.x, k).mode[_sample_index(fit, k)])


def _speed(fit: Fit, k: int, channel: str) -> Array:
    """Return the speed [unit/s] of the body that a channel shows, at its points, by the model."""
    samples = fit.problem.run(fit.x, k)
    at = _sample_index(fit, k)[fit.problem.data[k].slices[channel]]
    state = samples.state
    if channel.startswith("angle"):
        return np.asarray(np.abs(state.across_speed / state.free_length)[at])
    heavy = channel.startswith("heavy") or (channel == "height" and fit.problem.data[k].trial.dropped == "heavy")
    return np.asarray(np.linalg.norm(samples.heavy_velocity if heavy else samples.light_velocity, axis=1)[at])


@dataclass(frozen=True, kw_only=True)
class GroupTest:
    """Tests of one group of residuals, all trials together."""

    group: str
    """Mode and direction, for example "sliding, light along"."""
    count: int
    """Number of values."""
    chi2: float
    """Mean squared residual."""
    lag1: float
    """Standard score (z) of the lag-1 autocorrelation."""
    ljung_box: float
    """p value of the Ljung-Box test over ten lags."""
    runs: float
    """Standard score (z) of the number of runs of one sign."""

    @property
    def passes(self) -> bool:
        """Return whether the group looks like white noise."""
        return self.lag1 <= MAX_LAG1_Z and self.ljung_box >= MIN_LJUNG_BOX_P and self.runs >= MIN_RUNS_Z


@dataclass(frozen=True, kw_only=True)
class ResidualTests:
    """Tests of all residuals of a fit against noise alone, without asking for a cause."""

    chi2_per_dof: float
    """Chi2 per degree of freedom of the tracked points, or of the events if there are no points."""
    count: int
    """Number of fitted values."""
    groups: tuple[GroupTest, ...]
    """Tests of the points, by mode and direction."""
    events: EventTest | None = None
    """Test of the events; None: there are none."""
    limit: float = MAX_CHI2_PER_DOF
    """Largest `chi2_per_dof` that passes; infinite if there are no points, because events have a test of their own."""

    @property
    def passes(self) -> bool:
        """Return whether all tests pass."""
        points_pass = self.chi2_per_dof <= self.limit and all(g.passes for g in self.groups)
        return points_pass and (self.events is None or self.events.passes)

    @property
    def failures(self) -> str:
        """Describe the tests that fail; empty: all pass."""
        failures = [] if self.chi2_per_dof <= self.limit else [f"chi2/dof {self.chi2_per_dof:.3f}"]
        if self.events is not None and not self.events.passes:
            failures.append(self.events.description)
        for g in self.groups:
            if not g.passes:
                failures.append(
                    f"{g.group}: lag-1 z {g.lag1:.1f}, Ljung-Box p {number(g.ljung_box, digits=1)}, runs z {g.runs:.1f}"
                )
        return "; ".join(failures)


def check_residuals(fit: Fit) -> ResidualTests:
    """Test the standardised residuals for structure that noise alone does not have."""
    groups: dict[str, list[Array]] = {}
    total, points = 0.0, 0
    for k, d in enumerate(fit.problem.data):
        if not d.channels:
            continue
        z = ((d.value - fit.problem.predict(fit.x, k)) / d.sigma)[: d.event_slice.start]
        total += float(z @ z)
        points += int(np.isfinite(d.sigma[: d.event_slice.start]).sum())
        for name, series in _residuals_by_group(fit, k, z).items():
            groups.setdefault(name, []).append(series)
    events = check_event_residuals(fit)
    tests = [_test_group(n, parts) for n, parts in sorted(groups.items()) if sum(map(len, parts)) >= MIN_GROUP_SIZE]
    return ResidualTests(
        chi2_per_dof=total / max(points - len(fit.x), 1) if points or events is None else events.chi2 / events.expected,
        count=fit.problem.count,
        groups=tuple(tests),
        events=events,
        limit=max(MAX_CHI2_PER_DOF, 1 + CHI2_SCATTER_SIGMAS / math.sqrt(points)) if points else math.inf,
    )


def _residuals_by_group(fit: Fit, k: int, z: Array) -> dict[str, Array]:
    """Return the standardised residuals of trial ``k`` by mode and direction.

    Those of the light mass are turned along and across its string, if both coordinates are there.
    """
    d, modes, index = fit.problem.data[k], _modes(fit, k), _sample_index(fit, k)
    series: dict[str, tuple[Array, NDArray[np.int8]]] = {}
    if {"light_x", "light_y"} <= set(d.slices):
        sx, sy = d.slices["light_x"], d.slices["light_y"]
        _, ix, iy = np.intersect1d(d.t[sx], d.t[sy], return_indices=True)
        angle = fit.problem.run(fit.x, k).state.wrap_angle[index[sx][ix]]
        zx, zy, mode = z[sx][ix], z[sy][iy], modes[sx][ix]
        series["light along"] = zx * np.sin(angle) - zy * np.cos(angle), mode
        series["light across"] = -zx * np.cos(angle) - zy * np.sin(angle), mode
    for name, part in d.slices.items():
        if not (name.startswith("light") and "light along" in series):
            series[name] = z[part], modes[part]
    groups = {}
    for direction, (values, mode) in series.items():
        sliding = np.isin(mode, [Mode.SLIDING_UP.value, Mode.SLIDING_DOWN.value])
        for word, here in (("sliding", sliding), ("not sliding", ~sliding)):
            if here.sum() >= 2:
                groups[f"{word}, {direction}"] = values[here]
    return groups


def _test_group(name: str, parts: Sequence[Array]) -> GroupTest:
    """Test one group, whose ``parts`` are its residuals in each trial."""
    count = sum(map(len, parts))
    square = sum(float(z @ z) for z in parts)
    lag = [sum(float(z[j:] @ z[:-j]) for z in parts if len(z) > j) / square for j in range(1, 11)]
    ljung_box = sum(count * (count + 2) * r * r / (count - j) for j, r in enumerate(lag, start=1) if count > j)
    return GroupTest(
        group=name,
        count=count,
        chi2=square / count,
        lag1=lag[0] * math.sqrt(count),
        ljung_box=float(special.chdtrc(10, ljung_box)),
        runs=sum(_runs_z(z) for z in parts) / math.sqrt(len(parts)),
    )


def _runs_z(z: Array) -> float:
    """Return the standard score of the number of runs of one sign (test of Wald and Wolfowitz)."""
    positive = z > 0
    up, down = int(positive.sum()), int((~positive).sum())
    if min(up, down) == 0 or len(z) < 4:
        return -math.sqrt(len(z)) if len(z) >= 4 else 0.0
    runs = 1 + int(np.sum(positive[1:] != positive[:-1]))
    mean = 2 * up * down / len(z) + 1
    return (runs - mean) / math.sqrt(max((mean - 1) * (mean - 2) / (len(z) - 1), 1e-9))
