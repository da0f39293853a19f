"""What a fit leaves: how much of it is noise, and whether the rest has structure.

Thresholds are those that 120 simulated clean studies passed in all but 1-2 % (each stands with its number below).
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
from looping_pendulum.discrepancy.fit.event_tests import EventTest, check_events_of
from looping_pendulum.discrepancy.fit.problem import TrialData
from looping_pendulum.pages.numbers import number
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode

CHI2_LIMIT = 1.07
"""Of chi2 per degree of freedom; 95 % of clean studies of some 2900 values are below 1.056, the largest 1.073."""
CHI2_SCATTER = 3.8
"""The same in units of 1/sqrt(n), granted to studies with fewer values."""
LAG_LIMIT = 2.9
"""Of the lag-1 autocorrelation's z: what a model misses lasts longer than a frame; clean maximum 2.87."""
LJUNG_BOX_LIMIT = 5e-4
"""Of the p value over ten lags."""
RUNS_LIMIT = -3.4
"""Of the runs test's z: fewer sign changes than chance; clean minimum -2.98."""
FEWEST = 20
"""Values in a group below which it is not tested."""
SMALLEST_SIGMA = 0.2
"""Share of a body's typical noise below which none of its marks goes."""
WIDEST_STEP = 1.5
"""Steps in time longer than this many median ones are gaps."""
WILD = 4.0
"""Differences beyond this many standard deviations count no more."""


def data_of(trial: Trial, observations: Observations) -> TrialData:
    """Channels of a trial, with the noise that the marks alone tell, and its events with their stated errors."""
    parts = {}
    for channels in observations.bodies().values():
        noise = estimate_noise(channels)
        for c in channels:
            parts[c.name] = np.maximum(noise.sigma(speed_at(channels, c.t, noise.a)), 1e-9)
    if "angle_rate" in {c.name for c in observations.channels}:
        channels = tuple(c for c in observations.channels if c.name != "angle_rate")  # computed from the angles: no news
    else:
        channels = observations.channels
    stated = np.array([e.sigma for e in observations.events], dtype=float)
    sigma = np.concatenate([*(parts[c.name] for c in channels), stated])
    return TrialData(trial=trial, channels=channels, events=observations.events, sigma=sigma)


def with_noise_of_residuals(fit: Fit) -> Fit:
    """Estimate each trial's noise from differences of neighbouring residuals, and return the fit to that.

    These are blind to slow misfits. Chi2 by them scatters by 1/sqrt(n), by second differences 1.5 times as much, and by the
    marks' own differences of fourth order, which need no model, twice as much.
    """
    data = []
    slopes = None if fit.slopes is None else fit.slopes.copy()
    row = 0
    for k, d in enumerate(fit.problem.data):
        residual = d.value - fit.problem.predict(fit.x, k)
        sigma = d.sigma.copy()
        for names in BODIES.values():
            chosen = [c for c in d.channels if c.name in names]
            if chosen:
                law = _law(fit, k, residual, [c.name for c in chosen])
                for c in chosen:
                    sigma[d.slices[c.name]] = np.where(np.isfinite(sigma[d.slices[c.name]]), law[c.name], np.inf)
        data.append(dataclasses.replace(d, sigma=sigma))
        if slopes is not None:
            counts = np.isfinite(sigma)
            slopes[row : row + len(sigma)][counts] *= (d.sigma[counts] / sigma[counts])[:, None]
        row += len(sigma)
    return minimise(fit.problem.with_data(data), fit.x, slopes=slopes)


def calibrated(problem_fit: Fit) -> Fit:
    """Alternate noise and fit until they agree, as two rounds do."""
    return with_noise_of_residuals(with_noise_of_residuals(problem_fit))


def best_of(fits: Sequence[Fit]) -> Fit:
    """Return the fit of lowest cost."""
    return min(fits, key=lambda f: f.cost)


def started(problem_fit: Fit, rng: np.random.Generator) -> Fit:
    """Fit again from a start drawn from the prior."""
    p = problem_fit.problem
    return calibrate(p, np.clip(p.prior_mean + rng.standard_normal(len(p.numbers)), p.low, p.high))


def _law(fit: Fit, k: int, residual: Array, names: Sequence[str]) -> dict[str, Array]:
    """Sigma of every mark of one body: a + b |v| by differences of neighbouring residuals."""
    d = fit.problem.data[k]
    speeds = {n: _speed(fit, k, n) for n in names}
    sizes, at = [], []
    for n in names:
        part = d.slices[n]
        t, mode = d.t[part], _modes(fit, k)[part]
        if len(t) < FEWEST:
            continue
        step = np.diff(t)
        counts = np.isfinite(d.sigma[part][:-1] + d.sigma[part][1:])
        kept = counts & (mode[:-1] == mode[1:]) & (step < WIDEST_STEP * np.median(step))
        sizes.append((np.diff(residual[part]) / math.sqrt(2))[kept])
        at.append(0.5 * (speeds[n][1:] + speeds[n][:-1])[kept])
    if not sizes or sum(map(len, sizes)) < FEWEST:
        return {n: d.sigma[d.slices[n]] for n in names}
    a, b = _line(np.concatenate(sizes), np.concatenate(at))
    return {n: np.maximum(a + b * speeds[n], SMALLEST_SIGMA * (a + b * float(np.median(speeds[n])))) for n in names}


def _line(difference: Array, v: Array) -> tuple[float, float]:
    """Fit sigma = a + b v, neither below zero, to Gaussian differences by maximum likelihood; wild ones are clipped."""
    a, b = 1.4826 * float(np.median(np.abs(difference))) + 1e-12, 0.0
    for _ in range(40):
        sigma = np.maximum(a + b * v, 0.05 * a + 1e-12)
        y = 0.5 * (sigma + np.minimum(difference**2, (WILD * sigma) ** 2) / sigma)
        w = 1 / sigma**2
        middle = float(w @ v / w.sum())
        spread = float(w @ (v - middle) ** 2)
        b = max(float(w @ ((v - middle) * y)) / spread, 0.0) if spread > 1e-12 * w.sum() else 0.0
        a = float(w @ y / w.sum()) - b * middle
        if a < 0:
            a, b = 1e-12, float(w @ (v * y) / (w @ v**2))
    return a, b


def _index(fit: Fit, k: int) -> NDArray[np.intp]:
    """Sample of the run that belongs to each mark."""
    samples = fit.problem.run(fit.x, k)
    _, camera = fit.problem.setting(fit.x, k)
    t = np.maximum(camera.true_time(fit.problem.data[k].t), 0.0)
    return np.minimum(np.searchsorted(samples.t, t - 1e-12), len(samples.t) - 1)


def _modes(fit: Fit, k: int) -> NDArray[np.int8]:
    return np.asarray(fit.problem.run(fit.x, k).mode[_index(fit, k)])


def _speed(fit: Fit, k: int, channel: str) -> Array:
    """Speed of what a channel sees at its marks, by the model."""
    samples = fit.problem.run(fit.x, k)
    at = _index(fit, k)[fit.problem.data[k].slices[channel]]
    state = samples.state
    if channel.startswith("angle"):
        return np.asarray(np.abs(state.across_speed / state.free_length)[at])
    heavy = channel.startswith("heavy") or (channel == "height" and fit.problem.data[k].trial.dropped == "heavy")
    return np.asarray(np.linalg.norm(samples.heavy_velocity if heavy else samples.light_velocity, axis=1)[at])


@dataclass(frozen=True, kw_only=True)
class GroupTest:
    """Tests of one kind of residual, all trials together."""

    group: str
    """Mode and direction, "sliding, light along"."""
    count: int
    chi2: float
    """Mean square."""
    lag1: float
    """z of the lag-1 autocorrelation."""
    ljung_box: float
    """p value over ten lags."""
    runs: float
    """z of the number of runs of one sign."""

    @property
    def quiet(self) -> bool:
        """Whether this looks like white noise."""
        return self.lag1 <= LAG_LIMIT and self.ljung_box >= LJUNG_BOX_LIMIT and self.runs >= RUNS_LIMIT


@dataclass(frozen=True, kw_only=True)
class ResidualTests:
    """Whether what a fit leaves is noise by itself."""

    chi2_per_dof: float
    """Of marks; of events where there are no marks."""
    count: int
    groups: tuple[GroupTest, ...]
    events: EventTest | None = None
    limit: float = CHI2_LIMIT
    """Of `chi2_per_dof`; infinite where there are no marks: events have a test of their own."""

    @property
    def quiet(self) -> bool:
        """Whether nothing is left that can be seen without asking for a cause."""
        marks = self.chi2_per_dof <= self.limit and all(g.quiet for g in self.groups)
        return marks and (self.events is None or self.events.quiet)

    @property
    def loudest(self) -> str:
        """What is not quiet, in words; empty: all is."""
        found = [] if self.chi2_per_dof <= self.limit else [f"chi2/dof {self.chi2_per_dof:.3f}"]
        if self.events is not None and not self.events.quiet:
            found.append(self.events.told)
        for g in self.groups:
            if not g.quiet:
                found.append(
                    f"{g.group}: lag-1 z {g.lag1:.1f}, Ljung-Box p {number(g.ljung_box, digits=1)}, runs z {g.runs:.1f}"
                )
        return "; ".join(found)


def check_residuals(fit: Fit) -> ResidualTests:
    """Test the standardised residuals for leftover structure."""
    groups: dict[str, list[Array]] = {}
    total, marks = 0.0, 0
    for k, d in enumerate(fit.problem.data):
        if not d.channels:
            continue
        z = ((d.value - fit.problem.predict(fit.x, k)) / d.sigma)[: d.event_slice.start]
        total += float(z @ z)
        marks += int(np.isfinite(d.sigma[: d.event_slice.start]).sum())
        for name, series in _directions(fit, k, z).items():
            groups.setdefault(name, []).append(series)
    events = check_events_of(fit)
    tests = [_group(n, parts) for n, parts in sorted(groups.items()) if sum(map(len, parts)) >= FEWEST]
    return ResidualTests(
        chi2_per_dof=total / max(marks - len(fit.x), 1) if marks or events is None else events.chi2 / events.expected,
        count=fit.problem.count,
        groups=tuple(tests),
        events=events,
        limit=max(CHI2_LIMIT, 1 + CHI2_SCATTER / math.sqrt(marks)) if marks else math.inf,
    )


def _directions(fit: Fit, k: int, z: Array) -> dict[str, Array]:
    """Residuals by mode and direction."""
    d, modes, index = fit.problem.data[k], _modes(fit, k), _index(fit, k)
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
    found = {}
    for direction, (values, mode) in series.items():
        sliding = np.isin(mode, [Mode.SLIDING_UP.value, Mode.SLIDING_DOWN.value])
        for word, here in (("sliding", sliding), ("not sliding", ~sliding)):
            if here.sum() >= 2:
                found[f"{word}, {direction}"] = values[here]
    return found


def _group(name: str, parts: Sequence[Array]) -> GroupTest:
    count = sum(map(len, parts))
    square = sum(float(z @ z) for z in parts)
    lag = [sum(float(z[j:] @ z[:-j]) for z in parts if len(z) > j) / square for j in range(1, 11)]
    box = sum(count * (count + 2) * r * r / (count - j) for j, r in enumerate(lag, start=1) if count > j)
    return GroupTest(
        group=name,
        count=count,
        chi2=square / count,
        lag1=lag[0] * math.sqrt(count),
        ljung_box=float(special.chdtrc(10, box)),
        runs=sum(_runs(z) for z in parts) / math.sqrt(len(parts)),
    )


def _runs(z: Array) -> float:
    """Standardised number of runs of one sign (Wald and Wolfowitz)."""
    positive = z > 0
    up, down = int(positive.sum()), int((~positive).sum())
    if min(up, down) == 0 or len(z) < 4:
        return -math.sqrt(len(z)) if len(z) >= 4 else 0.0
    runs = 1 + int(np.sum(positive[1:] != positive[:-1]))
    mean = 2 * up * down / len(z) + 1
    return (runs - mean) / math.sqrt(max((mean - 1) * (mean - 2) / (len(z) - 1), 1e-9))
