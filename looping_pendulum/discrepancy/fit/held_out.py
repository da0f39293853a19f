"""Test how well a fit predicts held-out trials, or blocks of time that were left out."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.data import TrialData, noises_of
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual import CHI2_SCATTER_SIGMAS, MIN_P_VALUE, ModelTest
from looping_pendulum.discrepancy.fit.residual_noise import with_noise_of_residuals
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.reference_ode.geometry import Array

MAX_HELD_OUT_CHI2 = 1.08
"""Largest chi2 per value of a held-out trial that passes, if it has some 2000 values or more (see `_max_chi2`)."""
BLOCK_COUNT = 8
"""Number of blocks of time that a study without held-out trials is cut into; two that lie far apart are held out at once."""
MAX_ITERATIONS = 30
"""Largest number of Jacobians in each fit without two of the blocks."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOutTest:
    """How well a fit predicts held-out data."""

    subjects: tuple[str, ...]
    """"trial eight" for each held-out trial, or "blocks of time" for those of the training trials."""
    chi2: tuple[float, ...]
    """Chi2 per value of each trial, or of all blocks together."""
    counts: tuple[int, ...]
    """Number of values of each `chi2`."""
    limits: tuple[float, ...]
    """Largest chi2 per value of each that passes."""
    fits: tuple[Fit, ...] = ()
    """Fit of each held-out trial's own parameters; empty for blocks of time."""
    rms_of_blocks: float | None = None
    """Root mean square residual of all blocks of time [SI]; None: they have only events."""

    @property
    def worst(self) -> float:
        """Return the largest chi2 per value."""
        return max(self.chi2)

    @property
    def passes(self) -> bool:
        """Return whether all held-out data are predicted to their noise."""
        return all(t.passes for t in self.results)

    @property
    def results(self) -> tuple[ModelTest, ...]:
        """Return the result of the test of each trial, or of all blocks together."""
        return tuple(
            ModelTest(
                subject=f"held-out {subject}",
                statistic="chi2 per value",
                value=chi2,
                limit=limit,
                failure=f"the model does not predict the held-out {subject}",
            )
            for subject, chi2, limit in zip(self.subjects, self.chi2, self.limits, strict=True)
        )


def check_held_out(
    fit: Fit,
    held_out: Sequence[tuple[TrialData, Sequence[FreeParameter]]],
) -> HeldOutTest:
    """Test a fit on held-out trials or, if there are none, on blocks of time of the training trials.

    Parameters
    ----------
    held_out
        Data of each held-out trial, with the free parameters of that trial.
    """
    if not held_out:
        return _check_held_out_blocks(fit)
    fits = [_fit_held_out_trial(fit, data, parameters) for data, parameters in held_out]
    return HeldOutTest(
        subjects=tuple(f"trial {d.trial.name}" for d, _ in held_out),
        chi2=tuple(f.cost / f.problem.count for f in fits),
        counts=tuple(f.problem.count for f in fits),
        limits=tuple(_max_chi2(f) for f in fits),
        fits=tuple(fits),
    )


def _max_chi2(fit: Fit) -> float:
    """Return the largest chi2 per value of held-out data that passes.

    Events have stated errors, so that it follows from the chi2 distribution. The noise of points is estimated from themselves.
    """
    if not any(d.channels for d in fit.problem.data):
        count = sum(len(d.events) for d in fit.problem.data)
        return float(special.chdtri(count, MIN_P_VALUE)) / count
    return max(MAX_HELD_OUT_CHI2, 1 + CHI2_SCATTER_SIGMAS / math.sqrt(fit.problem.count))


def _fit_held_out_trial(fit: Fit, data: TrialData, own: Sequence[FreeParameter]) -> Fit:
    """Fit the parameters of a held-out trial alone; those of the training fit have its result as their prior."""
    p = fit.problem
    known = {n.name: i for i, n in enumerate(p.free_parameters)}
    added = [n for n in p.free_parameters if data.trial.name in n.trials and n.name not in {o.name for o in own}]
    parameters = [*own, *added]
    here = [i for i, n in enumerate(parameters) if n.name in known]  # parameters of the training fit, by their place here
    there = [known[parameters[i].name] for i in here]  # and by their place in that fit
    mean, weights = np.zeros(len(parameters)), np.diag([1 / n.prior_sigma for n in parameters])
    if here:
        covariance = fit.covariance[np.ix_(there, there)]
        # a square root of the inverse covariance; tiny eigenvalues are raised, because the covariance may be singular
        values, vectors = np.linalg.eigh(covariance)
        root = (vectors / np.sqrt(np.maximum(values, 1e-12 * values.max()))).T
        weights[np.ix_(here, here)] = root
        mean[here] = fit.x[there]
    # The tracker is the same, so its correlated noise is that of the training trials
    data = data.with_noises(noises_of(p.data))
    return with_noise_of_residuals(calibrate(Problem(p.study, [data], parameters, (mean, weights))))


def _check_held_out_blocks(fit: Fit) -> HeldOutTest:
    """Leave out two of `BLOCK_COUNT` blocks of time at once, refit, and test their prediction by its covariance."""
    results = [_check_two_blocks(fit, first) for first in range(BLOCK_COUNT // 2)]
    chi2, counts, rms_of_blocks = zip(*(block for block in results if block), strict=True)
    known = [size for size in rms_of_blocks if size is not None]
    return HeldOutTest(
        subjects=("blocks of time",),
        chi2=(float(np.average(chi2, weights=counts)),),
        counts=(fit.problem.count,),
        limits=(_max_chi2(fit),),
        rms_of_blocks=float(np.sqrt(np.mean(np.square(known)))) if known else None,
    )


_Blocks = tuple[float, int, float | None]
"""How well two blocks of time are predicted by a fit to the others.

Their chi2 per value, number of values, and root mean square residual [SI], None if there are only events.
"""


def _check_two_blocks(fit: Fit, first: int) -> _Blocks | None:
    """Fit without two blocks that lie half the time apart, which halves the number of fits; None: they hold nothing.

    Parameters
    ----------
    fit
        The fit to all blocks.
    first
        Number of the first of the two.
    """
    problem = fit.problem
    out = [(_block_number(d) % (BLOCK_COUNT // 2)) == first for d in problem.data]
    rows = np.concatenate(out)
    if not rows.any():
        return None
    # An infinite standard error leaves values out without changing the shape of the problem
    masked = [dataclasses.replace(d, sigma=np.where(o, np.inf, d.sigma)) for d, o in zip(problem.data, out, strict=True)]
    partial = minimise(problem.with_data(masked), fit.x, max_iterations=MAX_ITERATIONS)
    r, jacobian = problem.residuals_and_jacobian(partial.x)
    assert r is not None
    # Noise of the values, and uncertainty of the fitted parameters
    square = _square_of_prediction(r[: len(rows)][rows], jacobian[: len(rows)][rows], partial.covariance)
    count = int(rows.sum())
    is_point = np.concatenate([np.arange(len(d.t)) < d.event_slice.start for d in problem.data])[rows]
    # What is left out of fits, as an outlier, is no part of their error
    is_point &= np.isfinite(np.concatenate([d.sigma for d in problem.data])[rows])
    off = (np.concatenate([d.value for d in problem.data]) - problem.predict_many(partial.x[None])[0])[rows]
    # Twice the mean square of a coordinate is that of a distance in the plane
    size = math.sqrt(2 * float(np.mean(off[is_point] ** 2))) if is_point.any() else None
    return square / count, count, size


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
