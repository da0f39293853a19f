"""Laws of unknown form beside a fit, as Gaussian processes of one coordinate: their evidence by a linear model.

The response of the data to a small push at one time is computed for each place where a law may act and for pulses at all times.
A law that is a function of the state pushes, to first order, as that function of the undisturbed motion: the response to it is
a sum of those to pulses, and no law costs a run of its own. All sums are made once as Gram matrices of each trial.

This says where the exact fit of a law begins. Beside that fit, its weights are linear parameters again, and all priors of them
are compared once more.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.linalg import block_diag

from looping_pendulum.discrepancy.evidence.marginal import NoiseGrid, sigma_of
from looping_pendulum.discrepancy.evidence.motions import (
    COORDINATES_OF,
    N_PULSES,
    POINT_SCALE,
    PULSED_SIDES,
    TARGETS,
    Closure,
    Motions,
    factors_of,
    motions,
    point_parameters,
    respond,
    weight_parameters,
)
from looping_pendulum.discrepancy.evidence.prior import LENGTHS, POINT_SIGMA, RIDGES
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.reference_ode.effects.closure import N_BASIS_FUNCTIONS
from looping_pendulum.reference_ode.geometry import Array

Prior = tuple[float, float]
"""Prior of a law's weights: standard deviation [N, or 1 for friction], of `RIDGES`, and correlation length, of `LENGTHS`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Law:
    """A law beside a fit: its evidence over the fit without it, by the linear model."""

    closure: Closure
    log_bayes_factor: float
    """With all priors of its weights."""
    prior: Prior
    """The one that is most probable."""
    weights: Array
    """Most probable weights by this prior [N, or 1 for friction], shape (sides * N_BASIS_FUNCTIONS,)."""
    step: Array
    """Change of the fitted parameters with these weights, shape (p,)."""
    decrease: float
    """Decrease of the cost, prior of the weights included."""


@lru_cache
def covariance_root(length: float, sides: int) -> Array:
    """Return a root L of the weights' prior covariance L L^T, in units of the ridge's square."""
    i = np.arange(N_BASIS_FUNCTIONS)
    k = np.exp(-0.5 * ((i[:, None] - i) / length) ** 2) if length else np.eye(N_BASIS_FUNCTIONS)
    return np.asarray(block_diag(*[np.linalg.cholesky(k + 1e-6 * np.eye(N_BASIS_FUNCTIONS))] * sides))


@dataclass(frozen=True, kw_only=True, eq=False)
class Weighing:
    """Evidence of a law over the model without it, for all priors of its weights, where the data are linear in these."""

    spectra: tuple[tuple[Array, Array, Array], ...]
    """Of each of `LENGTHS`: eigenvalues of the Gram matrix of the weights, projections of the residuals without the law, shape
    (k,) each, and the weights [N, or 1 for friction] that they belong to, shape (weights, k)."""

    @classmethod
    def of(cls, gram: Array, along: Array) -> Weighing:
        """Return it from the weights' Gram matrix, shape (w, w), and their products with the residuals, shape (w,).

        Both beyond what the fitted parameters can do, per weight [N, or 1 for friction].
        """
        spectra = []
        for length in LENGTHS:
            root = covariance_root(length, len(gram) // N_BASIS_FUNCTIONS)
            values, vectors = np.linalg.eigh(root.T @ gram @ root)
            kept = values > 1e-10 * max(float(values[-1]), 1e-300)
            weights = root @ vectors[:, kept]
            spectra.append((values[kept], weights.T @ along, weights))
        return cls(spectra=tuple(spectra))

    @cached_property
    def log_bayes_factors(self) -> Array:
        """Log Bayes factors, shape (LENGTHS, RIDGES)."""
        square = RIDGES[:, None] ** 2
        return np.array(
            [0.5 * np.sum(square * q**2 / (1 + square * e) - np.log1p(square * e), axis=1) for e, q, _ in self.spectra]
        )

    def log_bayes_factor(self, prior: Prior) -> float:
        """Return the log Bayes factor by one prior."""
        return float(self.log_bayes_factors[LENGTHS.index(prior[1]), RIDGES.tolist().index(prior[0])])

    def weights(self, prior: Prior) -> Array:
        """Return the most probable weights by a prior [N, or 1 for friction]."""
        values, along, weights = self.spectra[LENGTHS.index(prior[1])]
        return np.asarray(weights @ (prior[0] ** 2 / (1 + prior[0] ** 2 * values) * along))

    def decrease(self, prior: Prior) -> float:
        """Return the decrease of the cost by those weights, their prior included."""
        values, along, _ = self.spectra[LENGTHS.index(prior[1])]
        return float(np.sum(along**2 * prior[0] ** 2 / (1 + prior[0] ** 2 * values)))


def best_prior(log_bayes_factors: Array) -> Prior:
    """Return the most probable prior, from an array of shape (LENGTHS, RIDGES)."""
    length, ridge = np.unravel_index(int(np.argmax(log_bayes_factors)), log_bayes_factors.shape)
    return float(RIDGES[ridge]), LENGTHS[length]


class Laws:
    """All laws beside a fit.

    Parameters
    ----------
    grid, settings, log_z
        Settings of the noise that are looked at, white first, and the log evidence of the fit with each, shape (settings,).
    fitted
        `explanation.raw` of the fit.
    """

    def __init__(self, fit: Fit, runs: Motions, grid: NoiseGrid, settings: Sequence[int], log_z: Array, fitted: Array) -> None:
        self.fit, self.runs = fit, runs
        self._log_weights = log_z - np.logaddexp.reduce(log_z)
        problem, sides = fit.problem, ("across",) if runs.clamped else PULSED_SIDES
        n = problem.measured_rows
        responses = respond(problem, fit.x, runs.pulse_spacing, sides).reshape(n, -1) * sigma_of(problem.data)[:, None]
        at = set(fit.at_bounds)
        self._free = [i for i, name in enumerate(problem.names) if name not in at]
        # Residuals and derivatives by the free parameters
        fitted = np.nan_to_num(fitted[:, [0, *(1 + i for i in self._free)]])
        self._sides = {side: slice(i * N_PULSES, (i + 1) * N_PULSES) for i, side in enumerate(sides)}
        edges = np.cumsum([0] + [len(d.t) for d in problem.data]).tolist()
        self._beside = [_Beside(grid, s, edges, responses, fitted) for s in settings]
        self._projections = [runs.pulses_of(k) for k in range(len(problem.data))]

    def all(self) -> list[Law]:
        """Return all laws."""
        found = []
        for target, names in COORDINATES_OF.items():
            if self.runs.clamped and TARGETS[target] != ("across",):
                continue
            for name in names:
                closures = (
                    [self.runs.best_from_point(target, lambda closure: self.law(closure).log_bayes_factor)]
                    if name == "distance"
                    else [self.runs.closure(target, name, factor) for factor in factors_of(target)]
                )
                found += [self.law(c) for c in closures if c]
        return found

    def law(self, closure: Closure) -> Law:
        """Return the evidence of a law."""
        used, of_trials = self._of_pulses(closure)
        weighings, to_fitted = [], []
        for beside in self._beside:
            gram = sum(m.T @ g[np.ix_(used, used)] @ m for m, g in zip(of_trials, beside.grams, strict=True))
            cross = np.asarray(sum(m.T @ c[used] for m, c in zip(of_trials, beside.crosses, strict=True)))
            fitted = cross[:, 1:]
            weighings.append(
                Weighing.of(gram - fitted @ beside.inverse @ fitted.T, cross[:, 0] - fitted @ beside.inverse @ beside.cross)
            )
            to_fitted.append(fitted)
        log_bf = np.array([w.log_bayes_factors for w in weighings])
        weighted = log_bf + self._log_weights[:, None, None]
        setting = int(np.argmax(weighted.max(axis=(1, 2))))
        prior = best_prior(weighted[setting])
        weights, beside = weighings[setting].weights(prior), self._beside[setting]
        step = np.zeros(len(self.fit.x))
        step[self._free] = beside.inverse @ (beside.cross - to_fitted[setting].T @ weights)
        # A point is two fitted numbers, which cost what the Bayesian information criterion takes for them
        cost_of_point = 0.5 * len(closure.point_coefficients) * math.log(self.fit.problem.count)
        return Law(
            closure=closure,
            log_bayes_factor=float(np.logaddexp.reduce(weighted, axis=None)) - math.log(log_bf[0].size) - cost_of_point,
            prior=prior,
            weights=weights,
            step=step,
            decrease=weighings[0].decrease(prior),
        )

    def _of_pulses(self, closure: Closure) -> tuple[Array, list[Array]]:
        """Return the pulses that a law needs, and how large each of them is by each weight, for every trial."""
        basis = closure.basis_functions(self.runs.coordinate(closure.coordinate, closure.point))
        directions = self.runs.directions(closure)
        together = TARGETS[closure.target] == ("gradient",)  # both parts of a force belong to the same weights
        found = []
        for k, projection in enumerate(self._projections):
            here = self.runs.trial == k
            parts = [projection @ (push[here, None] * basis[here]) for push in directions.values()]
            found.append(np.vstack(parts) if together else block_diag(*parts))
        used = np.concatenate([np.arange(self._sides[s].start, self._sides[s].stop) for s in directions])
        return used, found


class _Beside:
    """Gram matrices of responses to pulses, residuals and derivatives, by one setting of the noise."""

    def __init__(self, grid: NoiseGrid, setting: int, edges: Sequence[int], responses: Array, fitted: Array) -> None:
        prior = fitted[edges[-1] :]
        self.grams, self.crosses, whole = [], [], prior.T @ prior
        noises = grid.noises(setting)
        for data, (begin, end) in zip(grid.data, itertools.pairwise(edges), strict=True):
            standardised = data.with_noises(noises).standardise(np.hstack([responses[begin:end], fitted[begin:end]]))
            pulses, rest = standardised[:, : responses.shape[1]], standardised[:, responses.shape[1] :]
            self.grams.append(pulses.T @ pulses)
            self.crosses.append(pulses.T @ rest)
            whole = whole + rest.T @ rest
        self.inverse = np.linalg.pinv(whole[1:, 1:], hermitian=True)
        self.cross = whole[1:, 0]
        """Products of the derivatives with the residuals, shape (p,)."""


def laws_beside(fit: Fit, grid: NoiseGrid, settings: Sequence[int], log_z: Array, fitted: Array) -> Laws | None:
    """Return all laws beside a fit; None: the records are too long for pulses to show where in a swing a force acts."""
    if not any(d.channels for d in fit.problem.data):  # a few events do not determine a law as a function
        return None
    runs = motions(fit)
    return None if runs.is_too_long else Laws(fit, runs, grid, settings, log_z, fitted)


def with_law(p: Problem, closure: Closure, prior: Prior) -> Problem:
    """Return a problem with a law's point and weights as further parameters, the weights in units of the prior's ridge."""
    trials = tuple(t.name for t in p.study.trials)
    of_point = POINT_SIGMA / POINT_SCALE
    points, weights = point_parameters(closure, trials, of_point), weight_parameters(closure, trials, prior[0])
    root = block_diag(p.prior_weights, np.eye(len(points)) / of_point, prior_root(closure, prior))
    mean = np.append(p.prior_mean, np.zeros(len(points) + len(weights)))
    return Problem(closure.added_to(p.study), p.data, (*p.free_parameters, *points, *weights), (mean, root))


def prior_root(closure: Closure, prior: Prior) -> Array:
    """Return a root of the inverse prior covariance of a law's weights, in units of the ridge."""
    return np.asarray(np.linalg.inv(covariance_root(prior[1], len(TARGETS[closure.target]))))


def weighed(closure: Closure, prior: Prior, p: Problem, x: Array, gram: Array, free: Sequence[int]) -> Weighing:
    """Return the evidence of a fitted law by all priors.

    Parameters
    ----------
    p, x
        The fit's problem, in which the weights have ``prior``, and its parameters.
    gram
        Gram matrix of the fit's residuals and derivatives, prior included, shape (1 + p, 1 + p).
    free
        Parameters that are on no bound, by their index.
    """
    of_law = [p.names.index(n) for n in closure.names]
    others = [i for i in free if i not in of_law]
    normal, along = gram[1:, 1:], gram[1:, 0]
    inverse = np.linalg.pinv(normal[np.ix_(others, others)], hermitian=True)
    cross = normal[np.ix_(of_law, others)]
    root = prior_root(closure, prior)
    # Without the prior of the weights, which have it in units of the ridge
    complement = normal[np.ix_(of_law, of_law)] - root.T @ root - cross @ inverse @ cross.T
    rest = along[of_law] + root.T @ root @ x[of_law] - cross @ inverse @ along[others]
    return Weighing.of(complement / prior[0] ** 2, (rest + complement @ x[of_law]) / prior[0])
