"""Test the residuals of a fit: their size, structure beyond noise, and how large they are of held-out data.

What a model lacks moves neighbouring residuals together, and lasts longer than a frame. So each group of residuals, by mode of
motion and direction, has one test: the score test of errors whose correlation falls as exp(-k / tau) over k frames, against
white noise. Beside it are tests of the residuals' size and of held-out data.

With the residuals z of a group, in units of their noise, and a = exp(-1 / tau), the score is the sum over trials of

    S = sum_(i<j) a^(j - i) z_i z_j

If z is white noise, S / z^2 has the mean 0, and its variance and skewness are known exactly (`_lasting_z`): its distribution is
not Gaussian, since few independent errors fit into a trial, but its cube root nearly is (Wilson and Hilferty). Negative
correlations, as a fit leaves of noise, are no sign of what is missing, so that only large scores fail.

A table of events has a few values, each with its own stated error, so that tests for whiteness say nothing and chi2 scatters
widely. The standardised residuals of a linear fit are r ~ N(0, I - H) with H = J (J^T J)^-1 J^T. Over some of the rows, their
sum of squares has the mean tr(I - H) and the variance 2 tr((I - H)^2), and is tested as a scaled chi2 with both. A fit that may
change the apparatus at will explains any few events, so the measured values of the apparatus are among these rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.linalg import solve_banded

from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.data import FRAMES, TrialData, noises_of
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual_noise import modes, refit_with_estimated_noise, sample_index
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.measured.study import Study
from looping_pendulum.pages.numbers import amount
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode

MAX_CHI2_PER_DOF = 1.07
"""Largest chi2 per degree of freedom that passes, of many values."""
CHI2_SCATTER_SIGMAS = 3.5
"""Largest excess of chi2 per value over 1, in units of 1/sqrt(n), for fewer values, in the fit and in held-out data.

The standard deviation of noise is sqrt(2) of these units, so that 0.7 % of clean studies are above it.
"""
MAX_LASTING_Z = 3.4
"""Largest z of the score of lasting errors that passes.

A study has eight groups, four directions in two kinds of mode, each with the largest of three z, which exceeds this about twice
as often as one of them does: together 8 x 2 x 0.034 % = 0.5 % of studies whose residuals are noise.
"""
MIN_GROUP_SIZE = 20
"""Smallest number of values of a group that is tested."""
MIN_P_VALUE = 0.005
"""Smallest p value that passes: with two tests in a study, 1 % of false alarms."""
MAX_HELD_OUT_CHI2 = 1.08
"""Largest chi2 per value of a held-out trial that passes, if it has some 2000 values or more (see `_max_chi2`)."""
BLOCKS = "blocks of time"
"""What is held out of a study without held-out trials."""
BLOCK_COUNT = 8
"""Number of blocks of time that a study without held-out trials is cut into; two that lie far apart are held out at once."""
MAX_ITERATIONS = 30
"""Largest number of Jacobians in each fit without two of the blocks."""


@dataclass(frozen=True, kw_only=True)
class ModelTest:
    """One test of a model."""

    subject: str
    """What was tested: "all residuals", "sliding, light along", "held-out trial eight", the name of a candidate."""
    statistic: str
    """Name of the number that was tested, for example "chi2 per degree of freedom"."""
    value: float
    limit: float
    """Largest value that passes, or the smallest one if `limit_is_lower`."""
    limit_is_lower: bool = False
    passes: bool = field(init=False)
    failure: str
    """What a failure means, in words without the number, for example "the residuals still have a pattern"."""

    def __post_init__(self) -> None:
        """Compare the value with its limit."""
        object.__setattr__(self, "passes", self.value >= self.limit if self.limit_is_lower else self.value <= self.limit)


@dataclass(frozen=True, kw_only=True)
class ResidualTests:
    """Tests of all residuals of a fit against noise alone, without asking for a cause."""

    chi2_per_dof: float
    """Chi2 per degree of freedom of the tracked points, or of the events if there are no points."""
    results: tuple[ModelTest, ...]
    seeks_patterns: bool
    """Whether the points were searched for patterns, not only measured: not where their errors last longer than a frame."""

    @property
    def passes(self) -> bool:
        """Whether all tests pass."""
        return all(t.passes for t in self.results)


def check_residuals(fit: Fit) -> ResidualTests:
    """Test the standardised residuals for structure that noise alone does not have."""
    groups: dict[str, list[Array]] = {}
    total, points = 0.0, 0
    data = fit.problem.data
    for k, d in enumerate(data):
        if d.channels:
            of_points = slice(0, d.event_slice.start)
            z = d.standardise(d.value - fit.problem.predict(fit.x, k))[of_points]
            total += float(z @ z)
            points += int(np.isfinite(d.sigma[of_points]).sum())
            for name, series in _residuals_by_group(fit, k, z).items():
                groups.setdefault(name, []).append(series)
    # Neighbouring points share a part of the errors that a tracker states, and those of real marks are seldom as simple as the
    # process that stands for them: the size alone tells
    if noises_of(data) or any(c.stated_error is not None for d in data for c in d.channels):
        groups = {}
    chi2_per_dof = total / max(points - len(fit.x), 1)
    size = [size_test(chi2_per_dof, points)] if points else []
    patterns = [_test_group(n, parts) for n, parts in sorted(groups.items()) if sum(map(len, parts)) >= MIN_GROUP_SIZE]
    event_test, events_chi2 = check_event_residuals(fit) or (None, chi2_per_dof)
    return ResidualTests(
        chi2_per_dof=chi2_per_dof if points else events_chi2,
        results=(*size, *patterns, *([event_test] if event_test else [])),
        seeks_patterns=bool(patterns),
    )


def size_test(chi2_per_dof: float, points: int) -> ModelTest:
    """Test the size of the residuals of so many values of tracked points."""
    ratio = math.sqrt(max(chi2_per_dof, 0.0))
    larger = f"{amount(ratio)} times as large as" if ratio >= 1.5 else f"{amount(100 * (ratio - 1))} % larger than"
    return ModelTest(
        subject="all tracked points",
        statistic="chi2 per degree of freedom",
        value=chi2_per_dof,
        limit=max(MAX_CHI2_PER_DOF, 1 + CHI2_SCATTER_SIGMAS / math.sqrt(points)),
        failure=f"the residuals are {larger} the noise",
    )


def _residuals_by_group(fit: Fit, k: int, z: Array) -> dict[str, Array]:
    """Return the standardised residuals of trial ``k`` by mode and direction.

    Those of the light mass are turned along and across its string, if both coordinates are there.
    """
    d, mode_of, index = fit.problem.data[k], modes(fit, k), sample_index(fit, k)
    used = np.isfinite(d.sigma)
    series: dict[str, tuple[Array, NDArray[np.int8]]] = {}
    if {"light_x", "light_y"} <= set(d.slices):
        sx, sy = d.slices["light_x"], d.slices["light_y"]
        _, ix, iy = np.intersect1d(d.t[sx], d.t[sy], return_indices=True)
        both = used[sx][ix] & used[sy][iy]
        ix, iy = ix[both], iy[both]
        angle = fit.problem.run(fit.x, k).state.wrap_angle[index[sx][ix]]
        zx, zy, mode = z[sx][ix], z[sy][iy], mode_of[sx][ix]
        series["light along"] = zx * np.sin(angle) - zy * np.cos(angle), mode
        series["light across"] = -zx * np.cos(angle) - zy * np.sin(angle), mode
    for name, part in d.slices.items():
        if not (name.startswith("light") and "light along" in series):
            series[name] = z[part][used[part]], mode_of[part][used[part]]
    groups = {}
    for direction, (values, mode) in series.items():
        sliding = np.isin(mode, [Mode.SLIDING_UP.value, Mode.SLIDING_DOWN.value])
        for word, here in (("sliding", sliding), ("not sliding", ~sliding)):
            if here.sum() >= 2:
                groups[f"{word}, {direction}"] = values[here]
    return groups


def _test_group(name: str, parts: Sequence[Array]) -> ModelTest:
    """Test one group, whose ``parts`` are its residuals in each trial."""
    return ModelTest(
        subject=name,
        statistic="lasting errors z",
        value=max(_lasting_z(parts, frames) for frames in FRAMES),
        limit=MAX_LASTING_Z,
        failure="the residuals still have a pattern",
    )


def _lasting_z(parts: Sequence[Array], frames: float) -> float:
    """Return the standard score of errors that last some ``frames``, against white noise.

    With the matrix A of S = z^T A z, of which tr A = 0, n values of white noise have E S^2 = 2 tr A^2 and E S^3 = 8 tr A^3. The
    moments of S / z^2 are these over those of z^2, n (n + 2) and n (n + 2) (n + 4), as the ratio does not depend on z^2.
    """
    decay = math.exp(-1 / frames)
    count = sum(map(len, parts))
    score = square = cube = 0.0
    for z in parts:
        # The sum over all earlier values, by its recursion. Within a trial only: one's end says nothing about the next's start
        earlier, band = np.zeros_like(z), np.ones((2, len(z)))
        earlier[1:], band[1] = decay * z[:-1], -decay
        score += float(z @ solve_banded((1, 0), band, earlier, check_finite=False))
        lag = np.arange(1, len(z))
        pairs = (len(z) - lag) * decay ** (2 * lag)
        square += float(np.sum(pairs))
        cube += 6 * float(np.sum(pairs * (lag - 1)))
    variance = square / (count * (count + 2))
    skewness = cube / (count * (count + 2) * (count + 4)) / variance**1.5
    standardised = score / max(sum(float(z @ z) for z in parts), 1e-300) / math.sqrt(variance)
    if not skewness:  # of pairs of neighbours alone
        return standardised
    # Wilson's and Hilferty's cube root of the scaled chi2 with this skewness
    root = float(np.cbrt(max(1 + standardised * skewness / 2, 0.0)))
    return float((root - 1 + skewness**2 / 36) * 6 / skewness)


def check_event_residuals(fit: Fit) -> tuple[ModelTest, float] | None:
    """Test the events of a fit with the measured values of the apparatus, by chi2; None: it has none.

    Also returns chi2 over its mean if the model is right.
    """
    rows, names, start = [], [], 0
    for data in fit.problem.data:
        for i, row in enumerate(data.events, start=data.event_slice.start):
            if np.isfinite(data.sigma[i]):
                rows.append(start + i)
                names.append(f"{data.trial.name} {row.quantity} {row.index}")
        start += len(data.value)
    if not names:
        return None
    prior_rows = [start + i for i, n in enumerate(fit.problem.free_parameters) if n.prior is not None]
    rows_tested = np.array([*rows, *prior_rows], dtype=int)
    part = fit.jacobian[rows_tested]
    residual_covariance = np.eye(len(rows_tested)) - part @ fit.covariance @ part.T
    # The trace of a symmetric matrix's square is the sum of its squared elements
    mean, half_variance = float(np.trace(residual_covariance)), float(np.sum(residual_covariance**2))
    residuals = fit.residuals[rows_tested]
    chi2 = float(residuals @ residuals)
    worst = int(np.argmax(np.abs(residuals[: len(rows)])))
    test = ModelTest(
        subject="events",
        statistic=f"p of chi2 {chi2:.1f} where {mean:.1f} is expected",
        # The scaled chi2 whose degrees of freedom and scale give this mean and variance (Satterthwaite)
        value=float(special.chdtrc(mean**2 / half_variance, chi2 * mean / half_variance)),
        limit=MIN_P_VALUE,
        limit_is_lower=True,
        failure="the events are farther off than their errors explain, most of all "
        f"{names[worst]} ({residuals[worst]:+.1f} standard errors)",
    )
    return test, chi2 / mean


def failures_in_words(tests: Iterable[ModelTest]) -> tuple[str, ...]:
    """Return what the failed tests mean, each meaning once, in their order; empty if all pass."""
    return tuple(dict.fromkeys(t.failure for t in tests if not t.passes))


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOutTest:
    """How well a fit predicts held-out data."""

    results: tuple[ModelTest, ...]
    """Of chi2 per value of each held-out trial, or of all held-out blocks of time together."""
    fits: tuple[Fit, ...] = ()
    """Fit of each held-out trial's own parameters; empty for blocks of time."""
    rms_of_blocks: float | None = None
    """Root mean square residual of all blocks of time [SI]; None: they have only events."""

    @property
    def worst(self) -> ModelTest:
        """The test with the largest chi2 per value."""
        return max(self.results, key=lambda t: t.value)


def check_held_out(fit: Fit, held_out: Sequence[tuple[TrialData, Sequence[FreeParameter]]]) -> HeldOutTest:
    """Test a fit on held-out trials or, if there are none, on blocks of time of the training trials.

    Parameters
    ----------
    held_out
        Data of each held-out trial, with the free parameters of that trial.
    """
    if not held_out:
        return _check_held_out_blocks(fit)
    fits = [_fit_held_out_trial(fit, data, parameters) for data, parameters in held_out]
    results = [_test(f"trial {d.trial.name}", f, f.cost / f.problem.count) for (d, _), f in zip(held_out, fits, strict=True)]
    return HeldOutTest(results=tuple(results), fits=tuple(fits))


def _test(subject: str, fit: Fit, chi2: float) -> ModelTest:
    return ModelTest(
        subject=f"held-out {subject}",
        statistic="chi2 per value",
        value=chi2,
        limit=_max_chi2(fit),
        failure=f"the model does not predict the held-out {subject}",
    )


def _max_chi2(fit: Fit) -> float:
    """Return the largest chi2 per value of held-out data that passes.

    Events have stated errors, so that it follows from the chi2 distribution. The noise of points is estimated from themselves.
    """
    if not any(d.channels for d in fit.problem.data):
        count = sum(len(d.events) for d in fit.problem.data)
        return float(special.chdtri(count, MIN_P_VALUE)) / count
    return max(MAX_HELD_OUT_CHI2, 1 + CHI2_SCATTER_SIGMAS / math.sqrt(fit.problem.count))


def problem_of_trial(
    fit: Fit, study: Study, data: TrialData, own: Sequence[FreeParameter], added: Sequence[FreeParameter]
) -> Problem:
    """Return the problem of a further trial, in which the result of a fit is the prior of what they share.

    Parameters
    ----------
    own
        Free parameters that the trial has by itself.
    added
        Those of the fit that act in the trial, too.
    """
    parameters = [*own, *(n for n in added if n.name not in {o.name for o in own})]
    names = fit.problem.names
    here = [i for i, n in enumerate(parameters) if n.name in names]  # parameters of the fit, by their place here
    there = [names.index(parameters[i].name) for i in here]  # and by their place in that fit
    mean, weights = np.zeros(len(parameters)), np.diag([1 / n.prior_sigma for n in parameters])
    if here:
        # A square root of the inverse covariance; tiny eigenvalues are raised, because the covariance may be singular
        values, vectors = np.linalg.eigh(fit.covariance[np.ix_(there, there)])
        weights[np.ix_(here, here)] = (vectors / np.sqrt(np.maximum(values, 1e-12 * values.max()))).T
        mean[here] = fit.x[there]
    return Problem(study, [data], parameters, (mean, weights))


def _fit_held_out_trial(fit: Fit, data: TrialData, own: Sequence[FreeParameter]) -> Fit:
    """Fit the parameters of a held-out trial alone; those of the training fit have its result as their prior."""
    added = [n for n in fit.problem.free_parameters if data.trial.name in n.trials]
    # The tracker is the same, so its correlated noise is that of the training trials
    data = data.with_noises(noises_of(fit.problem.data))
    return refit_with_estimated_noise(calibrate(problem_of_trial(fit, fit.problem.study, data, own, added)))


def _check_held_out_blocks(fit: Fit) -> HeldOutTest:
    """Leave out two of `BLOCK_COUNT` blocks of time at once, refit, and test their prediction by its covariance.

    The two lie half the time apart, which halves the number of fits.
    """
    data = fit.problem.data
    number = [_block_number(d) % (BLOCK_COUNT // 2) for d in data]
    value, sigma = np.concatenate([d.value for d in data]), np.concatenate([d.sigma for d in data])
    # What is left out of fits, as an outlier, is no part of their error
    is_point = np.concatenate([np.arange(len(d.t)) < d.event_slice.start for d in data]) & np.isfinite(sigma)
    square, mean_squares = 0.0, []
    for first in range(BLOCK_COUNT // 2):
        rows = np.concatenate(number) == first
        if not rows.any():
            continue
        # An infinite standard error leaves values out without changing the shape of the problem
        masked = [replace(d, sigma=np.where(n == first, np.inf, d.sigma)) for d, n in zip(data, number, strict=True)]
        partial = minimise(fit.problem.with_data(masked), fit.x, max_iterations=MAX_ITERATIONS)
        r, jacobian = fit.problem.residuals_and_jacobian(partial.x)
        assert r is not None
        square += _square_of_prediction(r[: len(rows)][rows], jacobian[: len(rows)][rows], partial.covariance)
        if (rows & is_point).any():
            predicted = np.concatenate([fit.problem.predict(partial.x, k) for k in range(len(data))])
            off = (value - predicted)[rows & is_point]
            # Twice the mean square of a coordinate is that of a distance in the plane
            mean_squares.append(2 * float(np.mean(off**2)))
    rms = math.sqrt(np.mean(mean_squares)) if mean_squares else None
    return HeldOutTest(results=(_test(BLOCKS, fit, square / len(value)),), rms_of_blocks=rms)


def _square_of_prediction(residuals: Array, jacobian: Array, covariance: Array) -> float:
    """Return r (1 + J C J^T)^-1 r: noise of the values, and uncertainty of the fitted parameters with the ``covariance`` C.

    By the matrix inversion lemma, with C = L L^T, since there are far more values than parameters.
    """
    values, vectors = np.linalg.eigh(covariance)
    spread = jacobian @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    along = spread.T @ residuals
    inner = np.eye(len(values)) + spread.T @ spread
    return float(residuals @ residuals - along @ np.linalg.solve(inner, along))


def _block_number(d: TrialData) -> NDArray[np.int_]:
    """Return the number of the block of time of each value. Events alone are dealt out to the blocks one after another."""
    if not d.channels:
        return np.asarray(np.unique(d.t, return_inverse=True)[1] % BLOCK_COUNT)
    span = float(np.ptp(d.t)) or 1.0
    return np.asarray(np.minimum((BLOCK_COUNT * (d.t - d.t.min()) / span).astype(int), BLOCK_COUNT - 1))
