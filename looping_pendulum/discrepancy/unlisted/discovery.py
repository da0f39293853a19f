"""Search for a law that no library lists, as a function of time or of the state, by radial basis functions.

It may be a force on a mass or a change of the friction of the string on the rod. While the string slides, a force on the heavy
mass and one along the light mass's string move everything alike, so a force as a function of *time* cannot name its body; as a
function of the *state* it can, and held-out data decide. Each closure (a coordinate, a factor, where it acts) is screened by
`screening`; the best are refitted to the trajectories.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from looping_pendulum.discrepancy.data.free_parameter import FreeParameter
from looping_pendulum.discrepancy.fit.calibration import WINDOW_COST_TOLERANCE, Fit, FitError, minimise, minimise_steps
from looping_pendulum.discrepancy.fit.predictions import Steps, together
from looping_pendulum.discrepancy.fit.problem import Problem, TrialData
from looping_pendulum.discrepancy.fit.residual_noise import with_noise_of_residuals_steps
from looping_pendulum.discrepancy.listed.held_out import HeldOutTest, check_held_out
from looping_pendulum.discrepancy.unlisted.closures import STRING, Closure, complexity_cost
from looping_pendulum.discrepancy.unlisted.screening import (
    Motions,
    ScreenedClosure,
    begin_responses,
    motions,
    responses_of,
    screen,
)
from looping_pendulum.discrepancy.workers import SERIAL, Batch, ProgressCallback, Workers
from looping_pendulum.reference_ode.effects.closure import N_BASIS_FUNCTIONS
from looping_pendulum.reference_ode.geometry import Array

MAX_REFITS = 6
"""Closures that are refitted to the trajectories, the best of the screening."""
FIRST_REFITS = 2
"""Closures that are refitted before all trials are screened, the best by the training trials."""
MAX_REFITS_OF_BODY = 3
"""Of these, the largest number that act on one body, so that the best of every body are compared."""
MIN_EVIDENCE_SHARE = 0.7
"""Smallest twice log Bayes factor of a closure that is refitted, as a share of the best one's."""
SIGNIFICANT_ERRORS = 2.0
"""Standard errors that a force must exceed at a coordinate to be reported as significant there."""
LIKELIHOOD_MARGIN = 10.0
"""Difference of -2 ln L of held-out data within which the data do not tell two closures apart: odds of 148 to 1."""
POINT_SCALE = 0.01
"""Unit of a point's coordinates in a fit [m]."""
WEAK_PRIOR = 1e6
"""Prior standard deviation, in scales of a parameter, that leaves it to the data."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RefittedClosure:
    """A closure that was refitted to the trajectories."""

    closure: Closure
    fit: Fit
    twice_log_bayes_factor: float
    """Twice the log of the Bayes factor over the model without it: the larger of the screening's and the refit's."""
    coordinates: Array
    """Values of the coordinate along the training trials, where it matters, shape (n,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RecoveredForce(RefittedClosure):
    """A refitted closure that was tested on held-out data."""

    held_out: HeldOutTest

    @property
    def evidence(self) -> float:
        """Twice the log of the probability of all data, but for a constant: of training data, and of held-out ones given these.

        Between two closures it is twice the log of the ratio of these probabilities.
        """
        return self.twice_log_bayes_factor - self.held_out.minus_twice_log_predictive_density

    @property
    def preference(self) -> float:
        """By what closures are ordered, the largest first: `evidence` less what the closure costs beside simpler ones."""
        return self.evidence - complexity_cost(self.closure)

    @cached_property
    def weights(self) -> Array:
        """Weights of all sides [N], shape (sides, N_BASIS_FUNCTIONS)."""
        values = self.fit.values
        return np.array([values[n] for n in self.closure.names]).reshape(-1, N_BASIS_FUNCTIONS)

    def covariance(self, side: int) -> Array:
        """Return the covariance of a side's weights [N^2], shape (N_BASIS_FUNCTIONS, N_BASIS_FUNCTIONS)."""
        problem = self.fit.problem
        index = [problem.names.index(n) for n in self.closure.names[side * N_BASIS_FUNCTIONS : (side + 1) * N_BASIS_FUNCTIONS]]
        scale = np.array([problem.free_parameters[i].scale for i in index])
        return np.asarray(self.fit.covariance[np.ix_(index, index)] * np.outer(scale, scale))

    def standard_error(self, side: int, s: Array) -> Array:
        """Return the standard error of a side's profile at coordinates ``s``, shape of ``s``."""
        basis = self.closure.basis_functions(s)
        variance = np.einsum("ij,jk,ik->i", basis, self.covariance(side), basis)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))  # rounding can leave a variance slightly negative


def discover(
    base: Fit,
    held_out: Sequence[tuple[TrialData, Sequence[FreeParameter]]],
    report_step: ProgressCallback = lambda what: None,
    workers: Workers = SERIAL,
    min_evidence: float = -math.inf,
    min_evidence_of_best: float = -math.inf,
    begun: Batch | None = None,
    held_out_fits: Sequence[Fit] = (),
) -> tuple[list[RecoveredForce], list[ScreenedClosure]]:
    """Search all closures; return the best ones, refitted, in the order of `by_preference`, and others that are as likely.

    The training data say whether there is a force: its weights are fitted to them alone, and held-out data test it. Which
    closures are refitted all trials say together, since in one trial time, place and speed are mostly functions of each other.
    None is searched for in records that are too long (`Motions.is_too_long`).

    Parameters
    ----------
    base
        Fit of the declared model.
    held_out
        Held-out trials, each with the parameters that it alone has; empty: blocks of time are held out.
    min_evidence
        Smallest twice log Bayes factor, by the model linearised about the fit, of a closure that is refitted.
    min_evidence_of_best
        Smallest one that the best refit must have; if it has less, none is tested on held-out data, nor returned. If it is
        above ``min_evidence``, the best two by the training trials are refitted first, and one of these must have it.
    begun
        What `begin_to_discover` returned for the same fit; None: nothing was begun.
    held_out_fits
        Fits of the held-out trials by ``base`` (`HeldOutTest.fits`); empty: the training trials alone say which law it is.
    """
    report_step("screening unknown forces")
    runs = motions(base)
    if runs.is_too_long:
        return [], []
    responses = responses_of(base, runs, workers, begun)
    screened = screen(responses)
    if not screened or screened[0].twice_log_bayes_factor < min_evidence:
        return [], []
    known: dict[Closure, RefittedClosure | None] = {}

    def refit(chosen: Sequence[ScreenedClosure]) -> list[RefittedClosure]:
        """Refit closures, each once; without those with which the model cannot run."""
        new = [s for s in chosen if s.closure not in known]
        if new:
            report_step("fitting unknown laws, such as one of the " + f"{new[0].closure.target} by {new[0].closure.coordinate}")
        results = workers.map_together(_refit_together, (base, runs), new)
        known.update(zip((s.closure for s in new), results, strict=True))
        return [r for s in chosen if (r := known[s.closure])]

    if min_evidence_of_best > min_evidence:
        # The screening by all trials takes as long as some refits, which mostly say that there is no such force
        if _most_evidence(refit(_different(screened)[:FIRST_REFITS])) < min_evidence_of_best:
            return [], []
    ranked = _screened_by_all_trials(base, held_out_fits, workers) or screened
    # That by which the force shows in the training data is always tried
    different = _different(ranked, always=screened[0])
    chosen = [s for one in different if (s := responses.evidence_of(one.closure)).twice_log_bayes_factor >= min_evidence]
    refitted = refit(chosen)
    if _most_evidence(refitted) < min_evidence_of_best:
        return [], []
    labels = [f"{r.closure.target} by {r.closure.coordinate}" for r in refitted]
    forces = workers.map(_tested, held_out, refitted, labels, lambda what: report_step(f"testing the law of the {what}"))
    # With the evidence of the training trials, as the others have it
    return by_preference(forces), [responses.evidence_of(s.closure) for s in _as_likely(ranked, chosen)]


def _most_evidence(refitted: Sequence[RefittedClosure]) -> float:
    return max((r.twice_log_bayes_factor for r in refitted), default=-math.inf)


def _screened_by_all_trials(base: Fit, fits: Sequence[Fit], workers: Workers) -> list[ScreenedClosure]:
    """Return the evidence of every closure by the residuals of a fit of ``base``'s model to all trials, largest first.

    It is empty if there are no held-out trials, if one is too long for it (`Motions.is_too_long`) or if the model cannot run.
    """
    if not fits:
        return []
    p = base.problem
    parameters = {n.name: n for n in p.free_parameters}
    x, sigmas = base.x.tolist(), []
    for fit in fits:
        for n, value in zip(fit.problem.free_parameters, fit.x.tolist(), strict=True):
            if n.name in parameters:  # one that several trials share
                known = parameters[n.name]
                parameters[n.name] = dataclasses.replace(known, trials=tuple(dict.fromkeys((*known.trials, *n.trials))))
            else:
                parameters[n.name] = n
                x.append(value)
                sigmas.append(n.prior_sigma)
    prior = np.append(p.prior_mean, np.zeros(len(sigmas))), block_diag(p.prior_weights, np.diag(1 / np.array(sigmas)))
    data = [*p.data, *(d for fit in fits for d in fit.problem.data)]
    try:
        whole = minimise(
            Problem(p.study, data, list(parameters.values()), prior), np.array(x), cost_tolerance=WINDOW_COST_TOLERANCE
        )
    except FitError:
        return []
    runs = motions(whole)
    return [] if runs.is_too_long else screen(responses_of(whole, runs, workers))


def _as_likely(screened: Sequence[ScreenedClosure], chosen: Sequence[ScreenedClosure]) -> list[ScreenedClosure]:
    """Return the first closure of each target and coordinate that is as likely as the best by screening, but not refitted."""
    limit = screened[0].twice_log_bayes_factor - LIKELIHOOD_MARGIN if screened else math.inf
    known = {(s.closure.target, s.closure.coordinate) for s in chosen}
    left_out: dict[tuple[str, str], ScreenedClosure] = {}
    for one in screened:
        law = one.closure.target, one.closure.coordinate
        if one.twice_log_bayes_factor >= limit and law not in known:
            left_out.setdefault(law, one)
    return list(left_out.values())


def begin_to_discover(base: Fit, workers: Workers) -> Batch | None:
    """Let idle worker processes compute what `discover` needs first; None: it will not search."""
    runs = motions(base)
    return None if runs.is_too_long else begin_responses(base, runs, workers)


def by_preference(forces: Sequence[RecoveredForce]) -> list[RecoveredForce]:
    """Return closures in order, first those that pass held-out data, by `RecoveredForce.preference`."""
    return sorted(forces, key=lambda f: (not f.held_out.passes, -f.preference))


def _problem(problem: Problem, closure: Closure, scale: float, prior: float) -> Problem:
    """Return ``problem`` with a closure's point and weights as further parameters; the prior is of the weights.

    The weights have the standard deviation ``prior`` times ``scale``.
    """
    trials = tuple(t.name for t in problem.study.trials)
    weights = weight_parameters(closure, trials, scale, prior)
    added = [*point_parameters(closure, trials), *weights]
    parameters = (*problem.free_parameters, *added)
    mean = np.append(problem.prior_mean, np.zeros(len(added)))
    n_declared = len(problem.free_parameters)
    root = np.diag([1 / WEAK_PRIOR] * len(parameters))
    root[:n_declared, :n_declared] = problem.prior_weights
    for i in range(len(parameters) - len(weights), len(parameters)):
        root[i, i] = 1 / prior
    return Problem(closure.added_to(problem.study), problem.data, parameters, (mean, root))


def point_parameters(closure: Closure, trials: tuple[str, ...]) -> list[FreeParameter]:
    """Return x and y of the point from which a closure's distance is measured as free parameters; empty without one."""
    return [
        FreeParameter(
            name=name, parameter=name, trials=trials, init_value=value, scale=POINT_SCALE, prior=WEAK_PRIOR,
            bounds=(value - MAX_SHIFT, value + MAX_SHIFT),
        )
        for name, value in closure.point_coefficients.items()
    ]  # fmt: skip


def weight_parameters(closure: Closure, trials: tuple[str, ...], scale: float, prior: float) -> list[FreeParameter]:
    """Return a closure's weights as free parameters, of standard deviation ``prior`` times ``scale``."""
    return [
        FreeParameter(name=n, parameter=n, trials=trials, init_value=0.0, scale=scale, prior=prior, bounds=(-1e6, 1e6))
        for n in closure.names
    ]


MAX_SHIFT = 0.3
"""Largest distance of a fitted point from where the screening has it, in each direction [m]."""


def _different(ranked: Sequence[ScreenedClosure], always: ScreenedClosure | None = None) -> list[ScreenedClosure]:
    """Return the closures to refit: the first of every body and coordinate, not too many of one body, and one ``always``.

    Those that differ by their factor are alike, and so are a force in one direction and one in both. The latter is taken if it
    is about as likely: its formulas may be zero in one of them.
    """
    in_both = {s.closure.coordinate: s for s in reversed(ranked) if s.closure.target == LIGHT_MASS}
    seen: set[tuple[str, str]] = set()
    counts = dict.fromkeys(BODIES, 0)
    different = []
    for one in ranked:
        body = _body(one.closure)
        near = one.twice_log_bayes_factor >= MIN_EVIDENCE_SHARE * ranked[0].twice_log_bayes_factor
        if near and _law(one.closure) not in seen and counts[body] < MAX_REFITS_OF_BODY:
            seen.add(_law(one.closure))
            counts[body] += 1
            wider = in_both.get(one.closure.coordinate, one) if body == LIGHT_MASS else one
            is_as_likely = wider.twice_log_bayes_factor >= one.twice_log_bayes_factor - LIKELIHOOD_MARGIN
            different.append(wider if is_as_likely else one)
    different = different[:MAX_REFITS]
    if always and _law(always.closure) not in {_law(s.closure) for s in different}:
        different.append(always)
    return different


def _law(closure: Closure) -> tuple[str, str]:
    """Return the body that a closure acts on, of `BODIES`, and its coordinate."""
    return _body(closure), closure.coordinate


def _body(closure: Closure) -> str:
    """Return what a closure acts on, of `BODIES`."""
    return next(b for b in BODIES if closure.target.startswith(b))


LIGHT_MASS = "light mass"
BODIES = (LIGHT_MASS, "heavy mass", STRING)
"""Beginnings of the names of targets."""


def _refit_together(shared: tuple[Fit, Motions], screened: Sequence[ScreenedClosure]) -> list[RefittedClosure | None]:
    """Refit closures, in step."""
    return together([_refit(*shared, one) for one in screened])


def _refit(base: Fit, runs: Motions, screened: ScreenedClosure) -> Steps[RefittedClosure | None]:
    """Refit a closure to the trajectories with the ridge that maximises the evidence; None if the model cannot run."""
    closure = screened.closure
    problem = _problem(base.problem, closure, screened.ridge, 1.0)
    # The ridge is the scale of the weights in this problem, so that their prior has unit variance
    start = np.concatenate([base.x, np.zeros(len(closure.point_coefficients)), screened.weights / screened.ridge])
    try:
        refitted = yield from minimise_steps(problem, start, cost_tolerance=WINDOW_COST_TOLERANCE)
        fit = yield from with_noise_of_residuals_steps(refitted)
    except FitError:
        return None
    if closure.point is not None:
        values = fit.values
        x, y = (values[name] for name in closure.point_coefficients)
        closure = dataclasses.replace(closure, point=(x, y))
    return RefittedClosure(
        closure=closure,
        fit=fit,
        # Of few iterations many a refit ends short of its minimum, where the linear model has the better estimate
        twice_log_bayes_factor=max(screened.twice_log_bayes_factor, _evidence_of_refit(base, refitted, closure)),
        coordinates=runs.where_it_acts(closure),
    )


def _tested(held_out: Sequence[tuple[TrialData, Sequence[FreeParameter]]], refitted: RefittedClosure) -> RecoveredForce:
    """Test a refitted closure on held-out data."""
    return RecoveredForce(
        closure=refitted.closure,
        fit=refitted.fit,
        twice_log_bayes_factor=refitted.twice_log_bayes_factor,
        coordinates=refitted.coordinates,
        held_out=check_held_out(refitted.fit, held_out),
    )


def _evidence_of_refit(base: Fit, refitted: Fit, closure: Closure) -> float:
    """Return twice the log of the Bayes factor of a closure over ``base`` by Laplace's method about its refit.

    That of the screening is right for a model that is linear in the weights, and too small for a large force. Both fits have
    the same noise, and the weights a prior of unit variance in their scales. A fitted point costs what the Bayesian information
    criterion takes for two parameters.
    """
    points = set(closure.point_coefficients)
    kept = [i for i, name in enumerate(refitted.problem.names) if name not in points]
    volumes = [float(np.linalg.slogdet(j.T @ j)[1]) for j in (refitted.jacobian[:, kept], base.jacobian)]
    return base.cost - refitted.cost - (volumes[0] - volumes[1]) - len(points) * math.log(base.problem.count)
