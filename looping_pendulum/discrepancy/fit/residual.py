"""Test the residuals of a fit: how large their noise is, and whether they have structure beyond it.

A study has some eight groups of residuals with three tests each, and tests of their size and of held-out data. Each limit is
chosen so that of studies without a missing effect ("clean studies") it fails about 0.5 %, and all together some 3 %.
`research/data/calibration.json` has what clean studies reach (``thresholds``), by which a test judges the limits, and the rates
that were measured with other studies (``rates``).

A table of events has a few values, each with its own stated error, so that tests for whiteness say nothing and chi2 scatters
widely. The standardised residuals of a linear fit are r ~ N(0, I - H) with H = J (J^T J)^-1 J^T. Over some of the rows, their
sum of squares has the mean tr(I - H) and the variance 2 tr((I - H)^2), and is tested as a scaled chi2 with both. A fit that may
change the apparatus at will explains any few events, so the measured values of the apparatus are among these rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import special

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.residual_noise import modes, sample_index
from looping_pendulum.pages.numbers import amount
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode

MAX_CHI2_PER_DOF = 1.07
"""Largest chi2 per degree of freedom that passes; 99 % of clean studies stay below it (research/data/calibration.json)."""
CHI2_SCATTER_SIGMAS = 3.5
"""Largest excess of chi2 per value over 1, in units of 1/sqrt(n), for fewer values, in the fit and in held-out data.

The standard deviation of noise is sqrt(2) of these units, so that 0.7 % of clean studies are above it.
"""
MAX_LAG1_Z = 3.2
"""Largest z of the lag-1 autocorrelation that passes: what a model lacks lasts longer than a frame.

Noise exceeds it in 0.07 % of the groups.
"""
LAGS = 10
"""Number of lags of the Ljung-Box test."""
MIN_LJUNG_BOX_P = 5e-4
"""Smallest p value of the Ljung-Box test that passes."""
SHUFFLED_FROM, SHUFFLED_TO, SHUFFLES = 1e-2, 1e-12, 10_000
"""p values of the Ljung-Box test by the chi-square distribution between which it is found by shuffling, and how often.

With a hundred values, white noise is below 5e-4 of that distribution four times as often as it says, with twenty values ten
times. Below the smaller p value no shuffled series comes near.
"""
MAX_SHUFFLED = 500
"""Largest number of values of a group that is shuffled; with more, the distribution holds well enough."""
MIN_RUNS_Z = -3.4
"""Smallest z of the runs test that passes: below it there are fewer sign changes than by chance.

Noise is below it in 0.03 % of the groups.
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
    def results(self) -> tuple[ModelTest, ...]:
        """Return the result of each test."""
        test = partial(ModelTest, subject=self.group, failure="the residuals still have a pattern")
        return (
            test(statistic="lag-1 autocorrelation z", value=self.lag1, limit=MAX_LAG1_Z),
            test(statistic="Ljung-Box p", value=self.ljung_box, limit=MIN_LJUNG_BOX_P, limit_is_lower=True),
            test(statistic="runs z", value=self.runs, limit=MIN_RUNS_Z, limit_is_lower=True),
        )


@dataclass(frozen=True, kw_only=True)
class ResidualTests:
    """Tests of all residuals of a fit against noise alone, without asking for a cause."""

    chi2_per_dof: float
    """Chi2 per degree of freedom of the tracked points, or of the events if there are no points."""
    count: int
    """Number of fitted values."""
    groups: tuple[GroupTest, ...]
    """Tests of the points, by mode and direction."""
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
        results = [t for g in self.groups for t in g.results]
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
    if any(c.stated_error is not None for d in fit.problem.data for c in d.channels):
        # Neighbouring points share a part of the errors that a tracker states: a pattern is no misfit, and the size alone tells
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
    square = sum(float(z @ z) for z in parts)
    autocorrelation, statistic = _ljung_box([z[None] for z in parts])
    p = float(special.chdtrc(LAGS, statistic[0]))
    if count <= MAX_SHUFFLED and SHUFFLED_TO < p < SHUFFLED_FROM:
        rng = np.random.default_rng(0)  # a constant seed: the same residuals have the same p value
        shuffled = [rng.permuted(np.broadcast_to(z, (SHUFFLES, len(z))), axis=1) for z in parts]
        p = float(1 + np.sum(_ljung_box(shuffled)[1] >= statistic[0])) / (1 + SHUFFLES)
    return GroupTest(
        group=name,
        count=count,
        chi2=square / count,
        lag1=float(autocorrelation[0, 0]) * math.sqrt(count),
        ljung_box=p,
        runs=sum(_runs_z(z) for z in parts) / math.sqrt(len(parts)),
    )


def _ljung_box(parts: Sequence[Array]) -> tuple[Array, Array]:
    """Return the autocorrelations at the first `LAGS` lags, shape (m, lags), and the Ljung-Box statistic, shape (m,).

    Parameters
    ----------
    parts
        Residuals in each trial, shape (m, n): m series of which each is tested by itself.
    """
    count = sum(z.shape[1] for z in parts)
    square = sum(np.sum(z * z, axis=1) for z in parts)
    # Products within a trial only: the end of one says nothing about the start of the next
    lagged = [sum(np.sum(z[:, j:] * z[:, : max(z.shape[1] - j, 0)], axis=1) for z in parts) for j in range(1, LAGS + 1)]
    autocorrelation = np.stack(lagged, axis=1) / np.asarray(square)[:, None]
    weights = np.array([count * (count + 2) / (count - j) if count > j else 0.0 for j in range(1, LAGS + 1)])
    return autocorrelation, autocorrelation**2 @ weights


def _runs_z(z: Array) -> float:
    """Return the standard score of the number of runs of one sign (test of Wald and Wolfowitz)."""
    positive = z > 0
    up, down = int(positive.sum()), int((~positive).sum())
    if min(up, down) == 0 or len(z) < 4:
        # A single run of one sign is as far from chance as it can be; its standard score is not defined
        return -math.sqrt(len(z)) if len(z) >= 4 else 0.0
    runs = 1 + int(np.sum(positive[1:] != positive[:-1]))
    mean = 2 * up * down / len(z) + 1
    return (runs - mean) / math.sqrt(max((mean - 1) * (mean - 2) / (len(z) - 1), 1e-9))


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
