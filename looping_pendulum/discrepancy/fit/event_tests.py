"""Whether the events of a fit are explained to their stated errors.

A table has a few values, each with its own stated error, so tests for whiteness say nothing and chi2 scatters widely. What a
fit leaves of standardised rows is r ~ N(0, I - H), H = J (J^T J)^-1 J^T: their sum of squares has the mean tr(I - H) and the
variance 2 tr((I - H)^2) over these rows, and is tested as a scaled chi2 with both. A few events never resist a fit that may
bend the apparatus as it likes, so what was measured of the apparatus stands among the rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special  # scipy.stats takes a second to import

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.problem import TrialData
from looping_pendulum.pages.numbers import number

RARE = 0.005
"""Chance below which a misfit is not taken for one: with two tests of it in a study, 1 % of false alarms."""


@dataclass(frozen=True, kw_only=True)
class EventTest:
    """All events of a fit together, and the measured values of the apparatus."""

    count: int
    """Events."""
    chi2: float
    """Sum of squares."""
    expected: float
    """Its mean if nothing is missing: degrees of freedom that these rows keep."""
    p: float
    """Chance of as much."""
    worst: str
    """The event that is furthest off, in words."""

    @property
    def quiet(self) -> bool:
        """Whether this is no more than the stated errors."""
        return self.p >= RARE

    @property
    def told(self) -> str:
        """In words."""
        found = f"chi2 {self.chi2:.1f} where {self.expected:.1f} is expected (p {number(self.p, digits=1)})"
        return f"events: {found}, most by {self.worst}"


def check_events_of(fit: Fit) -> EventTest | None:
    """Test the events of a fit; None if it has none."""
    rows, names = _rows(fit)
    if not names:
        return None
    measured = fit.problem.measured_rows
    known = [measured + i for i, n in enumerate(fit.problem.numbers) if n.prior is not None]
    chosen = np.array([*rows, *known], dtype=int)
    part = fit.jacobian[chosen]
    kept = np.eye(len(chosen)) - part @ fit.covariance @ part.T
    mean, half_variance = float(np.trace(kept)), float(np.sum(kept**2))
    left = fit.residuals[chosen]
    chi2 = float(left @ left)
    worst = int(np.argmax(np.abs(left[: len(rows)])))
    return EventTest(
        count=len(rows),
        chi2=chi2,
        expected=mean,
        p=float(special.chdtrc(mean**2 / half_variance, chi2 * mean / half_variance)),
        worst=f"{names[worst]} ({left[worst]:+.1f} standard errors)",
    )


def unseen_limit(data: Sequence[TrialData]) -> float:
    """Chi2 per value up to which unseen trials of events alone are explained."""
    count = sum(len(d.events) for d in data)
    return float(special.chdtri(count, RARE)) / count


def errors_by_unit(fit: Fit, k: int) -> dict[str, float]:
    """Root mean square of measured less predicted events of a trial, for each SI unit; those that happen in the model."""
    data = fit.problem.data[k]
    if not data.events:
        return {}
    predicted = fit.problem.predict_events(fit.x, k)
    squares: dict[str, list[float]] = {}
    for row, value in zip(data.events, predicted, strict=True):
        if math.isfinite(value):
            squares.setdefault(row.unit, []).append((row.value - value) ** 2)
    return {unit: math.sqrt(sum(each) / len(each)) for unit, each in sorted(squares.items())}


def _rows(fit: Fit) -> tuple[list[int], list[str]]:
    """Rows of the residuals that are events, and what they are called."""
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
