"""Test whether a fit explains its events to their stated errors.

A table has a few values, each with its own stated error, so that tests for whiteness say nothing and chi2 scatters widely. The
standardised residuals of a linear fit are r ~ N(0, I - H) with H = J (J^T J)^-1 J^T. Over some of the rows, their sum of
squares has the mean tr(I - H) and the variance 2 tr((I - H)^2), and is tested as a scaled chi2 with both. A fit that may change
the apparatus at will explains any few events, so the measured values of the apparatus are among these rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special  # scipy.stats takes a second to import

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.model_test import ModelTest
from looping_pendulum.discrepancy.fit.problem import TrialData

MIN_P_VALUE = 0.005
"""Smallest p value that passes: with two tests in a study, 1 % of false alarms."""


@dataclass(frozen=True, kw_only=True)
class EventTest:
    """Chi-square test of all events of a fit, with the measured values of the apparatus."""

    count: int
    """Number of events."""
    chi2: float
    """Sum of squared residuals."""
    expected: float
    """Mean of `chi2` if the model is right: degrees of freedom of these rows."""
    p: float
    """Probability of a `chi2` at least as large if the model is right."""
    worst: str
    """Name and residual of the event with the largest residual."""

    @property
    def passes(self) -> bool:
        """Return whether the residuals are no larger than the stated errors explain."""
        return self.p >= MIN_P_VALUE

    @property
    def result(self) -> ModelTest:
        """Return the result of the test."""
        return ModelTest(
            subject="events",
            statistic=f"p of chi2 {self.chi2:.1f} where {self.expected:.1f} is expected",
            value=self.p,
            limit=MIN_P_VALUE,
            limit_is_lower=True,
            passes=self.passes,
            failure=f"the events are farther off than their errors explain, most of all {self.worst}",
        )


def check_event_residuals(fit: Fit) -> EventTest | None:
    """Test the events of a fit; return None if it has none."""
    rows, names = _event_rows(fit)
    if not names:
        return None
    measured = fit.problem.measured_rows
    prior_rows = [measured + i for i, n in enumerate(fit.problem.free_parameters) if n.prior is not None]
    rows_tested = np.array([*rows, *prior_rows], dtype=int)
    part = fit.jacobian[rows_tested]
    residual_covariance = np.eye(len(rows_tested)) - part @ fit.covariance @ part.T
    # The trace of a symmetric matrix's square is the sum of its squared elements
    mean, half_variance = float(np.trace(residual_covariance)), float(np.sum(residual_covariance**2))
    residuals = fit.residuals[rows_tested]
    chi2 = float(residuals @ residuals)
    worst = int(np.argmax(np.abs(residuals[: len(rows)])))
    return EventTest(
        count=len(rows),
        chi2=chi2,
        expected=mean,
        # The scaled chi2 whose degrees of freedom and scale give this mean and variance (Satterthwaite)
        p=float(special.chdtrc(mean**2 / half_variance, chi2 * mean / half_variance)),
        worst=f"{names[worst]} ({residuals[worst]:+.1f} standard errors)",
    )


def max_held_out_chi2(data: Sequence[TrialData]) -> float:
    """Return the largest chi2 per value of held-out trials of events alone that passes."""
    count = sum(len(d.events) for d in data)
    return float(special.chdtri(count, MIN_P_VALUE)) / count


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


def _event_rows(fit: Fit) -> tuple[list[int], list[str]]:
    """Return the rows of the residuals that belong to events, and the names of these events."""
    rows: list[int] = []
    names: list[str] = []
    start = 0
    for data in fit.problem.data:
        for i, row in enumerate(data.events, start=data.event_slice.start):
            if np.isfinite(data.sigma[i]):
                rows.append(start + i)
                names.append(f"{data.trial.name} {row.quantity} {row.index}")
        start += len(data.value)
    return rows, names
