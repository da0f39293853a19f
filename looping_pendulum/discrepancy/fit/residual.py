"""Test the residuals of a fit: how large their noise is, and whether they have structure beyond it.

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
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.linalg import solve_banded

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.data import FRAMES, noises_of
from looping_pendulum.discrepancy.fit.residual_noise import modes, sample_index
from looping_pendulum.pages.numbers import amount
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode

MAX_CHI2_PER_DOF = 1.07
"""Largest chi2 per degree of freedom that passes.

Of 103 clean blind studies (2026-11-24) none was above the limit for its number of values, which is larger for few.
"""
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
class GroupTest:
    """Test of one group of residuals, all trials together."""

    group: str
    """Mode and direction, for example "sliding, light along"."""
    count: int
    """Number of values."""
    chi2: float
    """Mean squared residual."""
    lasting: float
    """Largest standard score (z) of errors that last some `FRAMES`."""

    @property
    def result(self) -> ModelTest:
        """Return the result of the test."""
        return ModelTest(
            subject=self.group,
            statistic="lasting errors z",
            value=self.lasting,
            limit=MAX_LASTING_Z,
            failure="the residuals still have a pattern",
        )


@dataclass(frozen=True, kw_only=True)
class ResidualTests:
    """Tests of all residuals of a fit against noise alone, without asking for a cause."""

    chi2_per_dof: float
    """Chi2 per degree of freedom of the tracked points, or of the events if there are no points."""
    count: int
    """Number of fitted values."""
    groups: tuple[GroupTest, ...]
    """Tests of the points, by mode and direction; empty where errors last longer than a frame by the fit's noise or by what a
    tracker states: a pattern is no misfit then."""
    events: ModelTest | None = None
    """Test of the events; None: there are none."""
    limit: float = MAX_CHI2_PER_DOF
    """Largest `chi2_per_dof` that passes; infinite if there are no points, because events have a test of their own."""

    @property
    def passes(self) -> bool:
        """Return whether all tests pass."""
        return all(t.passes for t in self.results)

    @property
    def results(self) -> tuple[ModelTest, ...]:
        """Return the result of each test."""
        results = [g.result for g in self.groups]
        if math.isfinite(self.limit):
            ratio = math.sqrt(max(self.chi2_per_dof, 0.0))
            larger = f"{amount(ratio)} times as large as" if ratio >= 1.5 else f"{amount(100 * (ratio - 1))} % larger than"
            size = ModelTest(
                subject="all tracked points",
                statistic="chi2 per degree of freedom",
                value=self.chi2_per_dof,
                limit=self.limit,
                failure=f"the residuals are {larger} the noise",
            )
            results.insert(0, size)
        return (*results, *([self.events] if self.events else []))


def check_residuals(fit: Fit) -> ResidualTests:
    """Test the standardised residuals for structure that noise alone does not have."""
    groups: dict[str, list[Array]] = {}
    total, points = 0.0, 0
    for k, d in enumerate(fit.problem.data):
        if not d.channels:
            continue
        z = d.standardise(d.value - fit.problem.predict(fit.x, k))[: d.event_slice.start]
        total += float(z @ z)
        points += int(np.isfinite(d.sigma[: d.event_slice.start]).sum())
        for name, series in _residuals_by_group(fit, k, z).items():
            groups.setdefault(name, []).append(series)
    events, events_chi2 = check_event_residuals(fit) or (None, math.nan)
    if noises_of(fit.problem.data) or any(c.stated_error is not None for d in fit.problem.data for c in d.channels):
        # Neighbouring points share a part of the errors that a tracker states, and those of real marks are seldom as simple as
        # the process that stands for them: the size alone tells
        groups = {}
    tests = [_test_group(n, parts) for n, parts in sorted(groups.items()) if sum(map(len, parts)) >= MIN_GROUP_SIZE]
    return ResidualTests(
        chi2_per_dof=total / max(points - len(fit.x), 1) if points or events is None else events_chi2,
        count=fit.problem.count,
        groups=tuple(tests),
        events=events,
        limit=max(MAX_CHI2_PER_DOF, 1 + CHI2_SCATTER_SIGMAS / math.sqrt(points)) if points else math.inf,
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


def _test_group(name: str, parts: Sequence[Array]) -> GroupTest:
    """Test one group, whose ``parts`` are its residuals in each trial."""
    count = sum(map(len, parts))
    return GroupTest(
        group=name,
        count=count,
        chi2=sum(float(z @ z) for z in parts) / count,
        lasting=max(_lasting_z(parts, frames) for frames in FRAMES),
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


def event_rms_by_unit(fit: Fit, k: int) -> dict[str, float]:
    """Return the root mean square of measured less predicted events of trial ``k`` for each SI unit.

    Events that do not happen in the model's run are left out.
    """
    data = fit.problem.data[k]
    if not data.events:
        return {}
    predicted = fit.problem.predict_events(fit.x, k)
    squares: dict[str, list[float]] = {}
    for row, value in zip(data.events, predicted, strict=True):
        if math.isfinite(value):
            squares.setdefault(row.unit, []).append((row.value - value) ** 2)
    return {unit: math.sqrt(sum(each) / len(each)) for unit, each in sorted(squares.items())}


def failures_in_words(tests: Iterable[ModelTest]) -> tuple[str, ...]:
    """Return what the failed tests mean, each meaning once, in their order; empty if all pass."""
    return tuple(dict.fromkeys(t.failure for t in tests if not t.passes))
