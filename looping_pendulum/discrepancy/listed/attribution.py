"""Find which candidate explains the residuals of a fit: refit those with the best scores, test them on held-out data."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.data.free_parameter import FreeParameter
from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, calibrate, minimise
from looping_pendulum.discrepancy.fit.correlated_noise_fit import noises_of, with_correlated_noise, with_noises
from looping_pendulum.discrepancy.fit.event_tests import max_held_out_chi2
from looping_pendulum.discrepancy.fit.model_test import ModelTest
from looping_pendulum.discrepancy.fit.problem import DIFFERENCE_STEP, Problem, TrialData
from looping_pendulum.discrepancy.fit.residual import CHI2_SCATTER_SIGMAS
from looping_pendulum.discrepancy.fit.residual_noise import with_noise_of_residuals
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.screening import ScreenedCandidate
from looping_pendulum.discrepancy.workers import SERIAL, ProgressCallback, Workers
from looping_pendulum.reference_ode.geometry import Array

MAX_HELD_OUT_CHI2 = 1.08
"""Largest chi2 per value of a held-out trial that passes.

Its maximum in studies without a missing effect is 1.072, with about a thousand values.
"""
MAX_START_AMPLITUDE = 10.0
"""Largest amplitude from screening that a refit starts from, in units of the candidate's scale."""
FIRST_REFITS = 2
"""Number of candidates that are refitted first; the others have to beat their delta BIC."""
MAX_ITERATIONS = 10
"""Largest number of iterations in each window of a refit; right explanations need about four."""
MAX_SWING_ITERATIONS = 25
"""Largest number of iterations of a refit to a long swing, which has no windows."""
MIN_RIVAL_SHARE = 0.9
"""Share of another candidate's delta BIC that a first fit or the score must reach for a second fit from another start."""
RESTART_FACTORS = (5.0, 0.2)
"""Factors on a companion's fitted value at which its fit is restarted: the cost has further minima there."""
RESTART_MARGIN = 20.0
"""Delta BIC by which a candidate may be behind another one and still be restarted."""
BLOCK_COUNT = 8
"""Number of blocks of time that a study without held-out trials is cut into; two that lie far apart are held out at once."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Refit:
    """A fit of the model with one more candidate."""

    screened: ScreenedCandidate
    fit: Fit
    delta_bic: float
    """Decrease of the Bayesian information criterion by the candidate; larger is better."""

    @property
    def candidate(self) -> Candidate:
        """Return the candidate that was added."""
        return self.screened.candidate

    @property
    def value(self) -> float:
        """Return the fitted value [SI]."""
        return self.fit.values[self.candidate.name]

    @property
    def error(self) -> float:
        """Return the standard error of the value [SI]."""
        return self.fit.errors[self.candidate.name]

    @property
    def within_bounds(self) -> bool:
        """Return whether the fitted value is not on a bound."""
        return self.candidate.name not in self.fit.at_bounds


def refit(base: Fit, screened: ScreenedCandidate, delta_bic_to_beat: float = 0.0) -> Refit | None:
    """Fit the model with a candidate, from the value that screening found; None if it cannot run.

    Parameters
    ----------
    delta_bic_to_beat
        Delta BIC that another candidate has; a second start is only tried for a candidate that could come near to it.
    """
    problem = _with_candidate(base, screened)
    amplitude = float(np.clip(screened.amplitude / screened.scale, -MAX_START_AMPLITUDE, MAX_START_AMPLITUDE))
    fits: list[Fit] = []
    predicted_decrease = screened.score**2

    def from_base(x: Array) -> Fit:
        jacobian = _rough_jacobian(base, problem, x)
        return minimise(problem, x, max_iterations=MAX_ITERATIONS, initial_jacobian=jacobian, jacobian_is_rough=True)

    # From the base fit's values it takes half the time of growing windows, but may end in a minimum that these have been bent
    # to: with a static friction that was missing, at a cost of 2450 where the windows reach 1805. The windows may end early,
    # too, so that a candidate that comes near to the best gets both.
    starts: list[tuple[Callable[[Array], Fit], Array, float]] = [
        (from_base, base.x, amplitude),
        (functools.partial(calibrate, problem, max_iterations=MAX_ITERATIONS), base.problem.prior_mean, amplitude),
    ]
    if base.problem.is_swing:
        # The amplitude alone, before the other parameters follow it, would put a long swing out of phase
        starts = [(functools.partial(minimise, problem, max_iterations=MAX_SWING_ITERATIONS), base.x, 0.0), starts[0]]
    for fit_from, start, value in starts:
        try:
            fits.append(fit_from(np.concatenate([start, [value], np.zeros(len(screened.companions))])))
        except FitError:
            continue
        decrease = base.cost - fits[-1].cost
        if max(decrease, predicted_decrease) < MIN_RIVAL_SHARE * delta_bic_to_beat:
            break
        # A long swing has no windows, and its second start is only for a first one that failed
        if base.problem.is_swing and decrease > 0.5 * predicted_decrease:
            break
    if not fits:
        return None
    best = min(fits, key=lambda f: f.cost)
    # The candidate's null value gives the base fit. A higher cost means that an event was lost on the way from far off, and
    # no gradient brings it back.
    if best.cost > base.cost:
        null = np.concatenate([base.x, np.zeros(1 + len(screened.companions))])
        with contextlib.suppress(FitError):
            best = min(best, minimise(problem, null, max_iterations=MAX_ITERATIONS), key=lambda f: f.cost)
    penalty = bic_penalty(screened.candidate, base)
    if screened.companions and base.cost - best.cost - penalty > max(delta_bic_to_beat - RESTART_MARGIN, 0.0):
        best = min([best, *_restart(best, screened)], key=lambda f: f.cost)
    result = Refit(screened=screened, fit=best, delta_bic=base.cost - best.cost - penalty)
    return with_own_noise(base, result) if noises_of(base) else result


def _rough_jacobian(base: Fit, problem: Problem, x: Array) -> Array | None:
    """Return the Jacobian at ``x`` of a problem with more parameters than ``base``, whose own parameters are near its minimum.

    The columns of the latter are those of ``base``. None: the model cannot run at or beside ``x``.
    """
    known, rows = len(base.x), problem.measured_rows
    jacobian = np.zeros((rows + len(x), len(x)))
    jacobian[:rows, :known] = base.jacobian[:rows]
    jacobian[rows:] = problem.prior_weights
    here = problem.residuals(x)
    for i in range(known, len(x)):
        moved = x.copy()
        moved[i] += DIFFERENCE_STEP
        there = problem.residuals(moved)
        if here is None or there is None:
            return None
        jacobian[:rows, i] = (here - there)[:rows] / DIFFERENCE_STEP
    return jacobian


def bic_penalty(candidate: Candidate, fit: Fit) -> float:
    """Return what the Bayesian information criterion adds for the parameters of a candidate: ln n for each."""
    return (1 + len(candidate.companions)) * math.log(fit.problem.count)


def with_own_noise(base: Fit, r: Refit) -> Refit:
    """Return a refit with the noise that its own residuals show, compared with ``base`` by the likelihoods of both.

    Under the noise of ``base``, which may stand for much of what the candidate explains, its refit would gain too little.
    """
    fit = with_correlated_noise(r.fit)
    delta_bic = base.minus_twice_log_likelihood - fit.minus_twice_log_likelihood - bic_penalty(r.candidate, base)
    return dataclasses.replace(r, fit=fit, delta_bic=delta_bic)


def refits(
    base: Fit,
    chosen: Sequence[ScreenedCandidate],
    known: Mapping[str, Refit | None],
    workers: Workers = SERIAL,
    report_progress: ProgressCallback = lambda name: None,
) -> list[Refit]:
    """Fit the model with each of the chosen candidates and return the refits, best first.

    The largest delta BIC of the first `FIRST_REFITS` is what the others have to beat.

    Parameters
    ----------
    known
        Candidate's name -> refit that has been made already.
    report_progress
        Called with the name of each candidate whose refit begins in this process.
    """
    refit_of = dict(known)
    for part in (chosen[:FIRST_REFITS], chosen[FIRST_REFITS:]):
        to_beat = max((r.delta_bic for r in refit_of.values() if r), default=0.0)
        new = [s for s in part if s.candidate.name not in known]
        names = [s.candidate.name for s in new]
        results = workers.map(_refit_one, base, [(s, to_beat) for s in new], names, report_progress)
        refit_of |= {s.candidate.name: r and _with_local_objects(base, s, r) for s, r in zip(new, results, strict=True)}
    chosen_refits = (refit_of[s.candidate.name] for s in chosen)
    return sorted((r for r in chosen_refits if r), key=lambda r: -r.delta_bic)


def with_own_noises(base: Fit, known: Sequence[Refit], workers: Workers = SERIAL) -> list[Refit]:
    """Return refits, each with the noise that its own residuals show; see `with_own_noise`."""
    results = workers.map(with_own_noise, base, known, [r.candidate.name for r in known])
    return [dataclasses.replace(r, screened=before.screened) for r, before in zip(results, known, strict=True)]


def _refit_one(base: Fit, task: tuple[ScreenedCandidate, float]) -> Refit | None:
    """Call `refit` in a worker."""
    return refit(base, *task)


def _with_local_objects(base: Fit, screened: ScreenedCandidate, result: Refit) -> Refit:
    """Return a refit with this process's own objects: a worker process returns copies."""
    problem = _with_candidate(base, screened)
    if noises_of(base):  # a refit then has data with a noise of its own
        problem = problem.with_data(result.fit.problem.data)
    return dataclasses.replace(result, screened=screened, fit=dataclasses.replace(result.fit, problem=problem))


def _with_candidate(base: Fit, screened: ScreenedCandidate) -> Problem:
    """Return the problem of a fit with a candidate and its companions as further free parameters."""
    return base.problem.with_parameters(screened.candidate.free_parameter(screened.scale), *screened.companions)


def _restart(fit: Fit, screened: ScreenedCandidate) -> list[Fit]:
    """Fit again from other values of the candidate's companions."""
    fits = []
    for i, companion in enumerate(screened.companions, start=len(fit.x) - len(screened.companions)):
        for factor in RESTART_FACTORS:
            x = fit.x.copy()
            x[i] = (factor * fit.values[companion.name] - companion.init_value) / companion.scale
            with contextlib.suppress(FitError):
                fits.append(minimise(fit.problem, x, max_iterations=MAX_ITERATIONS))
    return fits


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOutTest:
    """How well a fit predicts held-out data."""

    names: tuple[str, ...]
    """Names of the held-out trials, or of blocks of time of the training trials."""
    chi2: tuple[float, ...]
    """Chi2 per value of each trial, or of all blocks together."""
    counts: tuple[int, ...]
    """Number of values of each `chi2`."""
    limits: tuple[float, ...]
    """Largest chi2 per value of each that passes."""
    rms: tuple[float | None, ...]
    """Root mean square residual of each [SI]; None: it has only events."""
    fits: tuple[Fit, ...] = ()
    """Fit of each held-out trial's own parameters; empty for blocks of time."""
    log_determinant: float = 0.0
    """Logarithm of the determinant of the noise's covariance of blocks of time."""

    @property
    def worst(self) -> float:
        """Return the largest chi2 per value."""
        return max(self.chi2)

    @property
    def minus_twice_log_likelihood(self) -> float:
        """Return -2 ln L of all held-out data but for a constant: it compares models whose noise differs."""
        if not self.fits:
            return sum(c * n for c, n in zip(self.chi2, self.counts, strict=True)) + self.log_determinant
        return sum(f.minus_twice_log_likelihood for f in self.fits)

    @property
    def passes(self) -> bool:
        """Return whether all held-out data are predicted to their noise."""
        return all(t.passes for t in self.results)

    @property
    def results(self) -> tuple[ModelTest, ...]:
        """Return the result of the test of each trial, or of all blocks together."""
        subjects = [f"held-out trial {name}" for name in self.names] if self.fits else ["held-out blocks of time"]
        return tuple(
            ModelTest(
                subject=subject,
                statistic="chi2 per value",
                value=chi2,
                limit=limit,
                passes=chi2 <= limit,
                failure=f"the model does not predict the {subject}",
            )
            for subject, chi2, limit in zip(subjects, self.chi2, self.limits, strict=True)
        )


def check_held_out(
    fit: Fit, held_out: Sequence[tuple[TrialData, Sequence[FreeParameter]]], *, max_iterations: int = 30
) -> HeldOutTest:
    """Test a fit on held-out trials or, if there are none, on blocks of time of the training trials.

    Parameters
    ----------
    held_out
        Data of each held-out trial, with the free parameters of that trial.
    max_iterations
        Largest number of Jacobians in each fit without two of the blocks.
    """
    if not held_out:
        return _check_held_out_blocks(fit, max_iterations)
    fits = [_fit_held_out_trial(fit, data, parameters) for data, parameters in held_out]
    return HeldOutTest(
        names=tuple(d.trial.name for d, _ in held_out),
        chi2=tuple(f.cost / f.problem.count for f in fits),
        counts=tuple(f.problem.count for f in fits),
        limits=tuple(_max_chi2(f) for f in fits),
        rms=tuple(rms(f, 0) for f in fits),
        fits=tuple(fits),
    )


def _max_chi2(fit: Fit) -> float:
    """Return the largest chi2 per value of held-out data that passes.

    Events have stated errors, so that it follows from the chi2 distribution. The noise of points is estimated from themselves.
    """
    if not any(d.channels for d in fit.problem.data):
        return max_held_out_chi2(fit.problem.data)
    return max(MAX_HELD_OUT_CHI2, 1 + CHI2_SCATTER_SIGMAS / math.sqrt(fit.problem.count))


def rms(fit: Fit, k: int) -> float | None:
    """Return the root mean square residual of trial ``k`` [SI]; None: it has only events.

    It is that of the light mass's position, a distance, or of all channels if the position was not measured.
    """
    d = fit.problem.data[k]
    if not d.channels:
        return None
    residual = d.value - fit.problem.predict(fit.x, k)
    used = np.isfinite(d.sigma)
    return math.sqrt(sum(float(np.mean(residual[p][used[p]] ** 2)) for p in position_slices(d)))


def position_slices(d: TrialData) -> list[slice]:
    """Return the data that errors are reported for: the light mass's coordinates or, without them, all channels."""
    return [d.slices[n] for n in ("light_x", "light_y") if n in d.slices] or list(d.slices.values())


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
    data = with_noises(data, noises_of(fit))
    return with_noise_of_residuals(calibrate(Problem(p.study, [data], parameters, (mean, weights))))


def _check_held_out_blocks(fit: Fit, max_iterations: int) -> HeldOutTest:
    """Leave out two of `BLOCK_COUNT` blocks of time at once, refit, and test their prediction by its covariance."""
    problem = fit.problem
    names, chi2, rms_of_blocks, counts = [], [], [], []
    half = BLOCK_COUNT // 2
    for j in range(half):
        # Two blocks that lie half the time apart in one fit, which halves the number of fits
        out = [(_block_number(d) % half) == j for d in problem.data]
        if not any(o.any() for o in out):
            continue
        # An infinite standard error leaves values out without changing the shape of the problem
        masked = [dataclasses.replace(d, sigma=np.where(o, np.inf, d.sigma)) for d, o in zip(problem.data, out, strict=True)]
        rows = np.concatenate(out)
        partial = minimise(
            problem.with_data(masked), fit.x, max_iterations=max_iterations, initial_jacobian=_without_rows(fit, rows)
        )
        jacobian = problem.jacobian(partial.x)
        r = problem.residuals(partial.x)
        assert r is not None
        part = jacobian[: len(rows)][rows]
        # noise of the values, and uncertainty of the fitted parameters
        covariance = np.eye(len(part)) + part @ partial.covariance @ part.T
        residuals = r[: len(rows)][rows]
        names.append(f"blocks {j + 1} and {j + 1 + half} of {BLOCK_COUNT}")
        chi2.append(float(residuals @ np.linalg.solve(covariance, residuals)) / len(residuals))
        counts.append(len(residuals))
        is_point = np.concatenate([np.arange(len(d.t)) < d.event_slice.start for d in problem.data])[rows]
        is_point &= np.isfinite(
            np.concatenate([d.sigma for d in problem.data])[rows]
        )  # what is left out of fits, as an outlier, is no part of their error
        if is_point.any():
            # twice the mean square of a coordinate is that of a distance in the plane
            off = np.concatenate([d.value - problem.predict(partial.x, k) for k, d in enumerate(problem.data)])[rows]
            rms_of_blocks.append(math.sqrt(2 * float(np.mean(off[is_point] ** 2))))
    return HeldOutTest(
        names=tuple(names),
        chi2=(float(np.average(chi2, weights=counts)),),
        counts=(problem.count,),
        limits=(_max_chi2(fit),),
        rms=(float(np.sqrt(np.mean(np.square(rms_of_blocks)))) if rms_of_blocks else None,),
        log_determinant=sum(d.log_determinant for d in problem.data),
    )


def _without_rows(fit: Fit, rows: NDArray[np.bool_]) -> Array | None:
    """Return the Jacobian of a long swing's fit with zeros for the values ``rows``; None: not known, or as quick to compute."""
    if fit.final_jacobian is None or not fit.problem.is_swing or noises_of(fit):
        return None
    jacobian = fit.final_jacobian.copy()
    jacobian[: len(rows)][rows] = 0.0
    return jacobian


def _block_number(d: TrialData) -> NDArray[np.int_]:
    """Return the number of the block of time of each value. Events alone are dealt out to the blocks one after another."""
    if not d.channels:
        return np.asarray(np.unique(d.t, return_inverse=True)[1] % BLOCK_COUNT)
    span = float(np.ptp(d.t)) or 1.0
    return np.asarray(np.minimum((BLOCK_COUNT * (d.t - d.t.min()) / span).astype(int), BLOCK_COUNT - 1))
