"""Find which candidate explains the residuals of a fit: refit the model with those of the best scores."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, calibrate_steps, minimise, minimise_steps
from looping_pendulum.discrepancy.fit.correlated_noise_fit import (
    data_with_possible_wander,
    noises_of,
    with_correlated_noise,
)
from looping_pendulum.discrepancy.fit.likelihood import refit_with_fixed_value
from looping_pendulum.discrepancy.fit.predictions import Steps, alone, together
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.screening import ScreenedCandidate
from looping_pendulum.discrepancy.workers import SERIAL, ProgressCallback, Workers
from looping_pendulum.reference_ode.geometry import Array

MIN_DELTA_BIC = 10.0
"""Smallest decrease of the Bayesian information criterion with which an effect is added.

Kass and Raftery (J. Am. Stat. Assoc. 90 (1995) 773) call it very strong evidence: odds of exp(10 / 2), 148 to 1. In 99 % of
clean studies every effect stays below it (docs/data/calibration.json).
"""
MAX_START_AMPLITUDE = 10.0
"""Largest amplitude from screening that a refit starts from, in units of the candidate's scale."""
FIRST_REFITS = 2
"""Number of candidates that are refitted first; the others have to beat their delta BIC."""
MIN_RIVAL_SHARE = 0.9
"""Share of another candidate's delta BIC that a first fit or the score must reach for a second fit from another start."""
RESTART_FACTORS = (5.0, 0.2)
"""Factors on a companion's fitted value at which its fit is restarted: the cost has further minima there."""
SATURATION_FACTORS = (0.03, 0.003)
"""Factors on the value of an effect that saturates at which its fit is restarted.

A rod that turns does the same for mobilities from some hundred to 10,000 1/kg. Refits that ended there had a delta BIC of 703
and 157; from these starts they come to 877 and 197, near its value of 40.
"""
HOLDING_FACTOR = 1.2
"""Factor on a value that hardly matters where it is, with which all others are fitted once more.

Static friction that just holds the string keeps the kinetic one, of which it is a multiple, from becoming smaller: in two of
three blind studies the cost was 4 and 6 above that beside a larger static friction.
"""
MAX_PRIOR_PULL = 0.05
"""Largest shift of a value by its own weak prior, in standard errors.

A rod that turns saturates, so that its scale, by a small change, is far below the mobilities that the data leave possible: in
two blind studies the prior pulled 41 down to 13 +/- 6 and 7 +/- 3 1/kg.
"""
MIN_PULLED_VALUE = 2.0
"""Smallest value [scales] that is looked at for such a shift; smaller ones are not shifted by as much."""
MAX_RESCALINGS = 4
"""Largest number of times that a refit begins again with a scale as large as its value."""
RESTART_MARGIN = 20.0
"""Delta BIC by which a candidate may be behind another one and still be restarted."""


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
    def predicted_delta_bic(self) -> float:
        """Return the delta BIC that the score predicts by a model linear in the value."""
        return self.screened.score**2 - bic_penalty(self.candidate, self.fit)

    @property
    def chi2_decrease(self) -> float:
        """Return by how much chi-square decreases with the candidate."""
        return self.delta_bic + bic_penalty(self.candidate, self.fit)

    @property
    def within_bounds(self) -> bool:
        """Return whether the fitted value is not on a bound."""
        return self.candidate.name not in self.fit.at_bounds


def refit(base: Fit, screened: ScreenedCandidate, delta_bic_to_beat: float = 0.0) -> Refit | None:
    """Fit the model with a candidate; arguments and result as of `refit_steps`."""
    return alone(refit_steps(base, screened, delta_bic_to_beat))


def refit_steps(base: Fit, screened: ScreenedCandidate, delta_bic_to_beat: float = 0.0) -> Steps[Refit | None]:
    """Fit the model with a candidate, from the value that screening found, in steps; None if it cannot run.

    Parameters
    ----------
    delta_bic_to_beat
        Delta BIC that another candidate has; a second start is only tried for a candidate that could come near to it.
    """
    problem = _with_candidate(base, screened)
    amplitude = float(np.clip(screened.amplitude / screened.scale, -MAX_START_AMPLITUDE, MAX_START_AMPLITUDE))
    fits: list[Fit] = []
    predicted_decrease = screened.score**2
    at_base = screened.candidate.where_it_acts(base.problem.free_parameters, base.x)
    from_base = functools.partial(minimise_steps, problem)
    # From the base fit's values it takes half the time of growing windows, but may end in a minimum that these have been bent
    # to: with a static friction that was missing, at a cost of 2450 where the windows reach 1805. The windows may end early,
    # too, so that a candidate that comes near to the best gets both.
    starts: list[tuple[Callable[[Array], Steps[Fit]], Array, float]] = [
        (from_base, at_base, amplitude),
        (functools.partial(calibrate_steps, problem), base.problem.prior_mean, amplitude),
    ]
    if base.problem.is_swing:
        # The amplitude alone, before the other parameters follow it, would put a long swing out of phase
        starts = [(functools.partial(minimise_steps, problem), base.x, 0.0), starts[0]]
    for fit_from, start, value in starts:
        try:
            fits.append((yield from fit_from(np.concatenate([start, [value], np.zeros(len(screened.companions))]))))
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
            there = yield from minimise_steps(problem, null)
            best = min(best, there, key=lambda f: f.cost)
    is_rival = delta_bic_of(screened.candidate, base, best) > max(delta_bic_to_beat - RESTART_MARGIN, 0.0)
    if is_rival:
        best = min([best, *(yield from _restart(best, screened))], key=lambda f: f.cost)
        screened, best = yield from _without_pull_of_prior(base, screened, best)
    result = Refit(screened=screened, fit=best, delta_bic=delta_bic_of(screened.candidate, base, best))
    return with_own_noise(base, result) if noises_of(base) else result


def delta_bic_of(candidate: Candidate, without: Fit, fit: Fit) -> float:
    """Return the delta BIC of a candidate by fits without and with it to the same data."""
    return without.cost - fit.cost - bic_penalty(candidate, without)


def delta_bic_of_likelihoods(candidate: Candidate, without: Fit, fit: Fit) -> float:
    """Return the delta BIC of a candidate by fits without and with it, each with a noise of its own."""
    return without.minus_twice_log_likelihood - fit.minus_twice_log_likelihood - bic_penalty(candidate, without)


def bic_penalty(candidate: Candidate, fit: Fit) -> float:
    """Return what the Bayesian information criterion adds for the parameters of a candidate: ln n for each."""
    return (1 + len(candidate.companions)) * math.log(fit.problem.count)


def min_distance(candidate: Candidate, fit: Fit) -> float:
    """Return the distance from its null value, in standard errors, from which on a candidate's evidence suffices."""
    return math.sqrt(MIN_DELTA_BIC + bic_penalty(candidate, fit))


def with_own_noise(base: Fit, r: Refit) -> Refit:
    """Return a refit with the noise that its own residuals show, compared with ``base`` by the likelihoods of both.

    Under the noise of ``base``, which may stand for much of what the candidate explains, its refit would gain too little.
    """
    fit = with_correlated_noise(r.fit)
    return dataclasses.replace(r, fit=fit, delta_bic=delta_bic_of_likelihoods(r.candidate, base, fit))


def delta_bic_beside_wander(base: Fit, fit: Fit, candidate: Candidate) -> float:
    """Return the delta BIC of a candidate if errors of neighbouring points are correlated as much as its residuals can be.

    A tracker that wanders too little for evidence leaves a pattern that one of many candidates may fit. Both models get the
    noise that makes the residuals of the fit *with* the candidate most likely, so that it does not stand for the effect.
    """
    data = data_with_possible_wander(fit)
    without = minimise(base.problem.with_data(data), base.x)
    return delta_bic_of(candidate, without, minimise(fit.problem.with_data(data), fit.x))


def refits(
    base: Fit,
    chosen: Sequence[ScreenedCandidate],
    known: Mapping[str, Refit | None],
    workers: Workers = SERIAL,
    report_progress: ProgressCallback = lambda name: None,
    delta_bic_to_beat: float = 0.0,
) -> list[Refit]:
    """Fit the model with each of the chosen candidates and return the refits, best first.

    The largest delta BIC of the first `FIRST_REFITS` is what the others have to beat; these, ``delta_bic_to_beat``.

    Parameters
    ----------
    known
        Candidate's name -> refit that has been made already.
    report_progress
        Called with the name of each candidate whose refit begins in this process.
    """
    refit_of = dict(known)
    for part in (chosen[:FIRST_REFITS], chosen[FIRST_REFITS:]):
        to_beat = max([delta_bic_to_beat, *(r.delta_bic for r in refit_of.values() if r)])
        new = [s for s in part if s.candidate.name not in known]
        for s in new:
            report_progress(s.candidate.name)
        results = workers.map_together(_refit_together, base, [(s, to_beat) for s in new])
        refit_of |= {s.candidate.name: r and _with_local_objects(base, s, r) for s, r in zip(new, results, strict=True)}
    chosen_refits = (refit_of[s.candidate.name] for s in chosen)
    return sorted((r for r in chosen_refits if r), key=lambda r: -r.delta_bic)


def with_own_noises(base: Fit, known: Sequence[Refit], workers: Workers = SERIAL) -> list[Refit]:
    """Return refits, each with the noise that its own residuals show; see `with_own_noise`."""
    results = workers.map(with_own_noise, base, known, [r.candidate.name for r in known])
    return [dataclasses.replace(r, screened=before.screened) for r, before in zip(results, known, strict=True)]


def _refit_together(base: Fit, tasks: Sequence[tuple[ScreenedCandidate, float]]) -> list[Refit | None]:
    """Call `refit` for many candidates, in step."""
    return together([refit_steps(base, *task) for task in tasks])


def _with_local_objects(base: Fit, screened: ScreenedCandidate, result: Refit) -> Refit:
    """Return a refit with this process's own objects: a worker process returns copies."""
    screened = dataclasses.replace(screened, scale=result.screened.scale)
    problem = _with_candidate(base, screened)
    if noises_of(base):  # a refit then has data with a noise of its own
        problem = problem.with_data(result.fit.problem.data)
    return dataclasses.replace(result, screened=screened, fit=dataclasses.replace(result.fit, problem=problem))


def _with_candidate(base: Fit, screened: ScreenedCandidate) -> Problem:
    """Return the problem of a fit with a candidate and its companions as further free parameters."""
    return base.problem.with_parameters(screened.candidate.free_parameter(screened.scale), *screened.companions)


def _without_pull_of_prior(base: Fit, screened: ScreenedCandidate, fit: Fit) -> Steps[tuple[ScreenedCandidate, Fit]]:
    """Fit again with a larger scale, and so a wider prior, where the candidate's own prior has shifted its value.

    Return the screening with that scale, and the fit.
    """
    name = screened.candidate.name
    i = fit.problem.names.index(name)
    for _ in range(MAX_RESCALINGS):
        size, prior_sigma = abs(float(fit.x[i])), fit.problem.free_parameters[i].prior_sigma
        if size < MIN_PULLED_VALUE or name in fit.at_bounds:
            break
        if size * math.sqrt(fit.covariance[i, i]) / prior_sigma**2 <= MAX_PRIOR_PULL:
            break
        wider = dataclasses.replace(screened, scale=screened.scale * size)
        x = fit.x.copy()
        x[i] /= size
        try:
            fit = yield from minimise_steps(_with_candidate(base, wider), x)
        except FitError:
            break
        screened = wider
    return screened, fit


def _restart(fit: Fit, screened: ScreenedCandidate) -> Steps[list[Fit]]:
    """Fit again from smaller values of a candidate that saturates, and from other values of its companions."""
    name, companions = screened.candidate.name, screened.companions
    own = fit.problem.free_parameters[len(fit.x) - len(companions) - 1]
    starts = [(c, factor * fit.values[c.name]) for c in companions for factor in RESTART_FACTORS]
    change = fit.values[name] - own.init_value
    if name in fit.at_bounds or fit.errors[name] > abs(change):
        starts += [(own, own.init_value + factor * change) for factor in SATURATION_FACTORS]
    fits = []
    for parameter, value in starts:
        x = fit.x.copy()
        x[fit.problem.names.index(parameter.name)] = (value - parameter.init_value) / parameter.scale
        with contextlib.suppress(FitError):
            fits.append((yield from minimise_steps(fit.problem, x)))
    if fit.errors[name] > abs(change):
        held = refit_with_fixed_value(fit, fit, name, own.init_value + HOLDING_FACTOR * change)
        if held:
            fits.append((yield from minimise_steps(fit.problem, held.x)))
    return fits
