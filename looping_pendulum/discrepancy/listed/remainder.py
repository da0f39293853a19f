"""What no explanation removes: errors of the marks that last longer than a frame, as of a hand-set scale or a slow tracker.

Real marks are off by more than they scatter from frame to frame, so no model leaves white noise. What even the best explanation
leaves, listed or not, is then taken for error of the marks: their standard errors are multiplied by the root of its chi2 per
value (Birge's ratio), and by the root of the number of marks over which it lasts, so that n marks count as n / lasting.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.problem import FreeParameter, Problem, TrialData
from looping_pendulum.discrepancy.fit.residual import ResidualTests
from looping_pendulum.discrepancy.listed.attribution import HeldOutTest, judge, places

FARTHEST = 4.0
"""Standard errors that a measured number may be off: a calibration cannot hide an effect in what is known."""
RARE = 0.01
"""Chance that an explanation as good as the best one is refused."""
REMOVED = 0.5
"""Share of the misfit of unseen data that an effect must remove if a remainder is left."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ScaledErrors:
    """Data with errors that contain the remainder."""

    ratio: float
    """Birge's: of the errors that explain what is left to the marks' scatter."""
    lasting: float
    """Marks over which what is left keeps its sign, at least 1."""
    least: str
    """Explanation that leaves least."""
    training: tuple[TrialData, ...]
    held: tuple[tuple[TrialData, tuple[FreeParameter, ...]], ...]

    @property
    def factor(self) -> float:
        """By which the marks' standard errors were multiplied."""
        return self.ratio * math.sqrt(self.lasting)

    def calibrated(self, fit: Fit) -> Fit:
        """Fit the same model to these data, from the prior and from where it was; the better one."""
        numbers = _near(fit.problem.numbers)
        problem = Problem(fit.problem.study, self.training, numbers)
        return min((calibrate(problem), minimise(problem, fit.x)), key=lambda f: f.cost)

    def judge(self, fit: Fit) -> HeldOutTest:
        """Judge by as many values as there are independent ones."""
        found = judge(fit, self.held, settled=True)
        return dataclasses.replace(
            found,
            chi2=tuple(self.lasting * c for c in found.chi2),
            limits=tuple(self._limit(n) for n in found.counts),
        )

    def tests(self, fit: Fit) -> ResidualTests:
        """Only the size of the residuals speaks: they are not white."""
        count = fit.problem.count
        chi2 = self.lasting * _square(fit) / max(count - len(fit.x), 1)
        return ResidualTests(chi2_per_dof=chi2, count=count, groups=(), limit=self._limit(count))

    def _limit(self, count: int) -> float:
        """Chi2 per value up to which ``count`` marks are explained: the remainder's size is no better known than theirs."""
        independent = max(count / self.lasting, 2.0)
        return float(special.fdtri(independent, independent, 1 - RARE))

    def beyond(self, fit: Fit, unseen: HeldOutTest, *, enlarged: bool) -> float:
        """By how much marks are off beyond their scatter [SI], seen and unseen ones together.

        Parameters
        ----------
        enlarged
            Whether the fit's errors are these, or the marks' scatter.
        """
        fits = [(fit, k) for k in range(len(fit.problem.data))] + [(f, 0) for f in unseen.fits]
        square, count = 0.0, 0
        factor = self.factor if enlarged else 1.0
        for f, k in fits:
            d = f.problem.data[k]
            left = d.value - f.problem.predict(f.x, k)
            for part in places(d):
                kept = np.isfinite(d.sigma[part])
                scatter = d.sigma[part][kept] / factor
                square += float(np.sum(left[part][kept] ** 2 - scatter**2))
                count += int(kept.sum())
        return math.sqrt(max(square, 0.0) / max(count, 1))


def scaled(
    explanations: Sequence[tuple[str, Fit, HeldOutTest]], held: Sequence[tuple[TrialData, tuple[FreeParameter, ...]]]
) -> ScaledErrors:
    """Take what the best of ``explanations`` (name, fit, judgement) leaves of seen or unseen data for error of the marks."""
    least, fit, unseen = min(explanations, key=lambda e: _left(e[1], e[2]))
    ratio, lasting = math.sqrt(max(_left(fit, unseen), 1.0)), max(_lasting([fit]), _lasting(unseen.fits or [fit]))
    factor = ratio * math.sqrt(lasting)  # of independent errors that say as much
    known = [f.problem.data[0] for f in unseen.fits]
    return ScaledErrors(
        ratio=ratio,
        lasting=lasting,
        least=least,
        training=tuple(_enlarged(d, factor) for d in fit.problem.data),
        held=tuple((_enlarged(d, factor), _near(numbers)) for d, (_, numbers) in zip(known, held, strict=True)),
    )


def _left(fit: Fit, unseen: HeldOutTest) -> float:
    """Chi2 per value of seen or unseen data, the larger one."""
    return max(_square(fit) / max(fit.problem.count - len(fit.x), 1), unseen.worst)


def _square(fit: Fit) -> float:
    return float(np.sum(fit.residuals[: -len(fit.x)] ** 2))


def _lasting(fits: Sequence[Fit]) -> float:
    """Integrated autocorrelation of the residuals [marks], up to its first zero; all channels together."""
    series = []
    for fit in fits:
        for k, d in enumerate(fit.problem.data):
            z = (d.value - fit.problem.predict(fit.x, k)) / d.sigma
            series += [z[part] for part in d.slices.values()]
    square = sum(float(z @ z) for z in series)
    total = 1.0
    for lag in range(1, max(map(len, series)) // 2):
        r = sum(float(z[lag:] @ z[:-lag]) for z in series if len(z) > lag) / square
        if r <= 0:
            break
        total += 2 * r
    return total


def _enlarged(d: TrialData, factor: float) -> TrialData:
    return dataclasses.replace(d, sigma=factor * d.sigma)


def _near(numbers: Sequence[FreeParameter]) -> tuple[FreeParameter, ...]:
    """Keep what was measured within `FARTHEST` of its standard errors."""
    found = []
    for n in numbers:
        reach = FARTHEST * n.scale if n.prior == 1.0 else math.inf
        bounds = max(n.bounds[0], n.start - reach), min(n.bounds[1], n.start + reach)
        found.append(dataclasses.replace(n, bounds=bounds))
    return tuple(found)
