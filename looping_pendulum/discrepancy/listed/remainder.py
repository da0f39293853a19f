"""Scale the errors of tracked points by what no explanation removes: errors that last longer than a frame.

Tracked points of real videos are off by more than they scatter from frame to frame, for example by a scale set by hand or by a
slow tracker, so that no model leaves white noise. The residuals that even the best explanation leaves, listed or not, are then
taken for errors of the points. Their standard errors are multiplied by the root of its chi2 per value (the Birge ratio), and by
the root of the residuals' autocorrelation time in points, so that n points count as n / autocorrelation_time.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from looping_pendulum.discrepancy.data.free_parameter import FreeParameter
from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.problem import Problem, TrialData
from looping_pendulum.discrepancy.fit.residual import ResidualTests
from looping_pendulum.discrepancy.listed.attribution import HeldOutTest, check_held_out, position_slices

MAX_PRIOR_SIGMAS = 4.0
"""Largest distance of a measured parameter from its value, in standard errors.

It keeps the calibration from hiding an effect in parameters that are known.
"""
MIN_P_VALUE = 0.01
"""Probability with which an explanation that is as good as the best one fails."""
MIN_MISFIT_REMOVED = 0.5
"""Smallest part of the misfit of held-out data that an effect must remove if a remainder is left."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ScaledErrors:
    """Data with standard errors that are scaled up to contain the remainder."""

    ratio: float
    """Birge ratio: errors that explain the residuals, in units of the points' scatter."""
    autocorrelation_time: float
    """Integrated autocorrelation time of the residuals [points], at least 1."""
    best_explanation: str
    """Explanation that leaves the smallest residuals."""
    training: tuple[TrialData, ...]
    """Data of the training trials, with scaled errors."""
    held_out: tuple[tuple[TrialData, tuple[FreeParameter, ...]], ...]

    @property
    def factor(self) -> float:
        """Return the factor on the points' standard errors."""
        return self.ratio * math.sqrt(self.autocorrelation_time)

    def calibrate(self, fit: Fit) -> Fit:
        """Fit the same model to these data, from the prior's mean and from its earlier values; return the better fit."""
        parameters = _with_prior_bounds(fit.problem.free_parameters)
        problem = Problem(fit.problem.study, self.training, parameters)
        return min((calibrate(problem), minimise(problem, fit.x)), key=lambda f: f.cost)

    def check_held_out(self, fit: Fit) -> HeldOutTest:
        """Test a fit on held-out data, counting only as many values as are independent."""
        test = check_held_out(fit, self.held_out, keep_sigma=True)
        return dataclasses.replace(
            test,
            # Scaled errors contain the root of the autocorrelation time, for sums over points; a mean square has to undo that
            chi2=tuple(self.autocorrelation_time * c for c in test.chi2),
            limits=tuple(self._max_chi2(n) for n in test.counts),
        )

    def tests(self, fit: Fit) -> ResidualTests:
        """Test only the size of the residuals: with a remainder in them, they are not white."""
        count = fit.problem.count
        chi2 = self.autocorrelation_time * _data_cost(fit) / max(count - len(fit.x), 1)
        return ResidualTests(chi2_per_dof=chi2, count=count, groups=(), limit=self._max_chi2(count))

    def _max_chi2(self, count: int) -> float:
        """Return the largest chi2 per value of ``count`` points that passes.

        It follows from the F distribution, because the remainder was measured on no more independent values than these.
        """
        independent = max(count / self.autocorrelation_time, 2.0)
        return float(special.fdtri(independent, independent, 1 - MIN_P_VALUE))

    def excess_rms(self, fit: Fit, held_out_test: HeldOutTest, *, scaled_errors: bool) -> float:
        """Return by how much points are off beyond their scatter [SI], of training and held-out data together.

        Parameters
        ----------
        scaled_errors
            Whether the fit's errors are the scaled ones; otherwise they are the points' scatter.
        """
        fits = [(fit, k) for k in range(len(fit.problem.data))] + [(f, 0) for f in held_out_test.fits]
        square, count = 0.0, 0
        factor = self.factor if scaled_errors else 1.0
        for f, k in fits:
            d = f.problem.data[k]
            residual = d.value - f.problem.predict(f.x, k)
            for part in position_slices(d):
                kept = np.isfinite(d.sigma[part])
                scatter = d.sigma[part][kept] / factor
                # Independent errors add by their squares, so that the remainder's square is what the scatter leaves
                square += float(np.sum(residual[part][kept] ** 2 - scatter**2))
                count += int(kept.sum())
        return math.sqrt(max(square, 0.0) / max(count, 1))


def scale_errors(
    explanations: Sequence[tuple[str, Fit, HeldOutTest]], held_out: Sequence[tuple[TrialData, tuple[FreeParameter, ...]]]
) -> ScaledErrors:
    """Take the residuals that the best explanation leaves, of training or held-out data, for errors of the points.

    Parameters
    ----------
    explanations
        Name, fit and test on held-out data of each explanation.
    held_out
        Data of each held-out trial, with the free parameters of that trial.
    """
    best_explanation, fit, held_out_test = min(explanations, key=lambda e: _largest_chi2(e[1], e[2]))
    ratio = math.sqrt(max(_largest_chi2(fit, held_out_test), 1.0))
    autocorrelation_time = max(_autocorrelation_time([fit]), _autocorrelation_time(held_out_test.fits or [fit]))
    factor = ratio * math.sqrt(autocorrelation_time)  # on independent errors that carry as much information
    held_out_data = [f.problem.data[0] for f in held_out_test.fits]  # with the noise that was estimated from their residuals
    return ScaledErrors(
        ratio=ratio,
        autocorrelation_time=autocorrelation_time,
        best_explanation=best_explanation,
        training=tuple(_with_scaled_sigma(d, factor) for d in fit.problem.data),
        held_out=tuple(
            (_with_scaled_sigma(d, factor), _with_prior_bounds(parameters))
            for d, (_, parameters) in zip(held_out_data, held_out, strict=True)
        ),
    )


def _largest_chi2(fit: Fit, held_out_test: HeldOutTest) -> float:
    """Return chi2 per value of training or held-out data, the larger one."""
    return max(_data_cost(fit) / max(fit.problem.count - len(fit.x), 1), held_out_test.worst)


def _data_cost(fit: Fit) -> float:
    """Return the sum of squared residuals of the data, without those of the prior."""
    return float(np.sum(fit.residuals[: -len(fit.x)] ** 2))


def _autocorrelation_time(fits: Sequence[Fit]) -> float:
    """Return the integrated autocorrelation time of the residuals [points], up to the first zero; all channels together."""
    series = []
    for fit in fits:
        for k, d in enumerate(fit.problem.data):
            z = (d.value - fit.problem.predict(fit.x, k)) / d.sigma
            series += [z[part] for part in d.slices.values()]
    square = sum(float(z @ z) for z in series)
    total = 1.0
    # Beyond half the series too few products are left to tell a correlation from chance
    for lag in range(1, max(map(len, series)) // 2):
        r = sum(float(z[lag:] @ z[:-lag]) for z in series if len(z) > lag) / square
        if r <= 0:
            break
        total += 2 * r
    return total


def _with_scaled_sigma(d: TrialData, factor: float) -> TrialData:
    """Return data with standard errors that are ``factor`` times as large."""
    return dataclasses.replace(d, sigma=factor * d.sigma)


def _with_prior_bounds(parameters: Sequence[FreeParameter]) -> tuple[FreeParameter, ...]:
    """Bound measured parameters to within `MAX_PRIOR_SIGMAS` standard errors of their values."""
    bounded = []
    for n in parameters:
        reach = math.inf if n.sigma is None else MAX_PRIOR_SIGMAS * n.sigma
        bounds = max(n.bounds[0], n.init_value - reach), min(n.bounds[1], n.init_value + reach)
        bounded.append(dataclasses.replace(n, bounds=bounds))
    return tuple(bounded)
