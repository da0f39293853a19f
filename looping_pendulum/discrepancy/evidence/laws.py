"""Laws of unknown form beside a fit, as Gaussian processes of one coordinate: their evidence by a linear model.

The response of the data to a small push at one time is computed for each place where a law may act and for pulses at all times.
A law that is a function of the state pushes, to first order, as that function of the undisturbed motion: the response to it is
a sum of those to pulses, and no law costs a run of its own. All sums are made once as Gram matrices of each trial.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

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
from looping_pendulum.discrepancy.evidence.prior import LENGTHS, POINT_SIGMA, RIDGES, log_occam, log_share
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.reference_ode.effects.closure import N_BASIS_FUNCTIONS
from looping_pendulum.reference_ode.geometry import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Law:
    """A law beside a fit: its evidence over the fit without it, by the linear model."""

    closure: Closure
    log_bayes_factor: float
    """With all priors of its weights."""
    ridge: float
    """Standard deviation of the weights that is most probable [N, or 1 for friction]."""
    length: float
    """Correlation length of the weights that is most probable [basis functions]."""
    mixed: float
    """Log Bayes factor with all priors less that with this one."""
    weights: Array
    """Most probable weights by this prior [N, or 1 for friction], shape (sides * N_BASIS_FUNCTIONS,)."""
    step: Array
    """Change of the fitted parameters with these weights, shape (p,)."""
    decrease: float
    """Decrease of the cost, prior of the weights included."""

    @property
    def log_odds(self) -> float:
        """Log Bayes factor and share of the prior."""
        return self.log_bayes_factor + log_share(self.closure)


@lru_cache
def covariance_root(length: float, sides: int) -> Array:
    """Return a root L of the weights' prior covariance L L^T, in units of the ridge's square."""
    i = np.arange(N_BASIS_FUNCTIONS)
    k = np.exp(-0.5 * ((i[:, None] - i) / length) ** 2) if length else np.eye(N_BASIS_FUNCTIONS)
    return np.asarray(block_diag(*[np.linalg.cholesky(k + 1e-6 * np.eye(N_BASIS_FUNCTIONS))] * sides))


class Laws:
    """All laws beside a fit.

    Parameters
    ----------
    grid, settings, log_z
        Settings of the noise that are looked at, and the log evidence of the fit with each of them, shape (settings,).
    fitted
        `explanation.raw` of the fit.
    templates
        Changes of the prediction in the units of the data, shape (n, m), beside which laws are looked at, too.
    """

    def __init__(
        self, fit: Fit, runs: Motions, grid: NoiseGrid, settings: Sequence[int], log_z: Array, fitted: Array, templates: Array,
    ) -> None:  # fmt: skip
        self.fit, self.runs = fit, runs
        self._log_weights = log_z - np.logaddexp.reduce(log_z)
        problem, sides = fit.problem, ("across",) if runs.clamped else PULSED_SIDES
        items = [(side, i) for side in sides for i in range(0, N_PULSES, N_BASIS_FUNCTIONS)]
        found = [respond(problem, fit.x, runs.pulse_spacing, side, first) for side, first in items]
        n = problem.measured_rows
        responses = np.hstack(found) * sigma_of(problem.data)[:, None]
        at = set(fit.at_bounds)
        self._free = [i for i, name in enumerate(problem.names) if name not in at]
        self._p = len(self._free)
        # Residuals, derivatives by the free parameters, templates
        kept = [0, *(1 + i for i in self._free)]
        others = np.hstack([np.nan_to_num(fitted[:n, kept]), templates])
        prior = np.hstack([fitted[n:, kept], np.zeros((len(fitted) - n, templates.shape[1]))])
        self._sides = {side: slice(i * N_PULSES, (i + 1) * N_PULSES) for i, side in enumerate(sides)}
        edges = np.cumsum([0] + [len(d.t) for d in problem.data]).tolist()
        self._beside = [_Beside(grid, s, edges, responses, others, prior, self._p) for s in settings]
        self._last: tuple[Closure, list[tuple[Array, Array]]] | None = None
        self._projections = [runs.pulses_of(k) for k in range(len(problem.data))]

    def all(self) -> list[Law]:
        """Return all laws, the most probable first."""
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
        return sorted(found, key=lambda law: -law.log_odds)

    def law(self, closure: Closure) -> Law:
        """Return the evidence of a law."""
        spectra = self._spectra(closure)
        log_bf = np.array([[_log_bayes_factors(s) for s in of_setting] for of_setting in spectra])
        weighted = log_bf + self._log_weights[:, None, None]
        best = np.unravel_index(int(np.argmax(weighted)), log_bf.shape)
        mixed = float(np.logaddexp.reduce(weighted, axis=None) - math.log(log_bf[0].size))
        return self._law(closure, spectra, best, log_bf, mixed)

    def with_effects(self, law: Law, allowed: Sequence[bool]) -> list[tuple[Law, int, float]]:
        """Return a law beside each template: the law, the template's index, and its amount.

        The law has the weights that are most probable beside the template, and the Bayes factor of both over the fit without.

        Parameters
        ----------
        allowed
            Which amounts may be negative, shape (m,).
        """
        spectra = self._spectra(law.closure)
        logs, amounts = [], []
        for beside, of_setting in zip(self._beside, spectra, strict=True):
            square_of_templates, along_of_templates = np.diag(beside.others)[1:], beside.others[0, 1:]
            for eigenvalues, projected, _ in of_setting:
                power = RIDGES[:, None] ** 2 / (1 + RIDGES[:, None] ** 2 * eigenvalues)
                square = np.maximum(square_of_templates - power @ projected[:, 1:] ** 2, 1e-9 * square_of_templates + 1e-12)
                along = along_of_templates - power @ (projected[:, :1] * projected[:, 1:])
                z = along / np.sqrt(square)
                logs.append(_log_bayes_factors((eigenvalues, projected, None))[:, None] + 0.5 * z**2 + log_occam(z))
                amounts.append(along / square)
        shape = (len(self._beside), len(LENGTHS), len(RIDGES), len(allowed))
        log_bf, amount = np.reshape(logs, shape), np.reshape(amounts, shape)
        weighted = log_bf + self._log_weights[:, None, None, None]
        mixed = np.logaddexp.reduce(weighted, axis=(0, 1, 2)) - math.log(len(LENGTHS) * len(RIDGES))
        found = []
        for t in range(len(allowed)):
            best = np.unravel_index(int(np.argmax(weighted[..., t])), shape[:3])
            a = float(amount[(*best, t)])
            if a > 0 or allowed[t]:
                beside_it = self._law(law.closure, spectra, best, log_bf[..., t], float(mixed[t]), t, a)
                found.append((dataclasses.replace(beside_it, mixed=law.mixed), t, a))
        return found

    def _law(
        self, closure: Closure, spectra: Sequence[Sequence[_Spectrum]], best: tuple[np.intp, ...], log_bf: Array, mixed: float,
        template: int | None = None, amount: float = 0.0,
    ) -> Law:  # fmt: skip
        setting, i, j = (int(v) for v in best)
        eigenvalues, projected, vectors = spectra[setting][i]
        beside, ridge = self._beside[setting], float(RIDGES[j])
        q, known = projected[:, 0], beside.cross[:, 0]
        if template is not None:
            q, known = q - amount * projected[:, 1 + template], known - amount * beside.cross[:, 1 + template]
        weights = vectors @ (ridge**2 / (1 + ridge**2 * eigenvalues) * q)
        decrease = self._decrease(spectra[0][i], ridge, template, amount)
        step = np.zeros(len(self.fit.x))
        b = self._to_others(closure)[setting][1]
        step[self._free] = beside.inverse @ (known - b[:, 1 : 1 + self._p].T @ weights)
        at_best = float(np.logaddexp.reduce(log_bf[:, i, j] + self._log_weights))
        # A point is two fitted numbers, which cost what the Bayesian information criterion takes for them
        cost_of_point = 0.5 * len(closure.point_coefficients) * math.log(self.fit.problem.count)
        return Law(
            closure=closure, log_bayes_factor=mixed - cost_of_point, ridge=ridge, length=LENGTHS[i],
            mixed=mixed - at_best, weights=weights, step=step, decrease=decrease,
        )  # fmt: skip

    def _decrease(self, spectrum: _Spectrum, ridge: float, template: int | None, amount: float) -> float:
        """Return the decrease of the cost with white noise, prior of the weights included, by a law and a template."""
        eigenvalues, projected, _ = spectrum
        q, by_template = projected[:, 0], 0.0
        if template is not None:
            others = self._beside[0].others
            q = q - amount * projected[:, 1 + template]
            by_template = 2 * amount * others[0, 1 + template] - amount**2 * others[1 + template, 1 + template]
        return float(by_template + np.sum(q**2 * ridge**2 / (1 + ridge**2 * eigenvalues)))

    def _spectra(self, closure: Closure) -> list[list[_Spectrum]]:
        """Return for each setting and correlation length: eigenvalues, projections of residuals and templates, and weights."""
        found = []
        for beside, (a, b) in zip(self._beside, self._to_others(closure), strict=True):
            fitted = b[:, 1 : 1 + self._p]
            inner = a - fitted @ beside.inverse @ fitted.T
            others = b[:, [0, *range(1 + self._p, b.shape[1])]] - fitted @ beside.inverse @ beside.cross
            of_setting = []
            for length in LENGTHS:
                root = covariance_root(length, len(TARGETS[closure.target]))
                eigenvalues, vectors = np.linalg.eigh(root.T @ inner @ root)
                kept = eigenvalues > 1e-10 * max(float(eigenvalues[-1]), 1e-300)
                vectors = root @ vectors[:, kept]
                of_setting.append((eigenvalues[kept], vectors.T @ others, vectors))
            found.append(of_setting)
        return found

    def _to_others(self, closure: Closure) -> list[tuple[Array, Array]]:
        """Return for each setting the Gram matrix of the responses to a law's weights, and that with residuals, derivatives and
        templates.
        """
        if self._last is None or self._last[0] is not closure:
            used, of_trials = self._of_pulses(closure)
            found = []
            for beside in self._beside:
                a = sum(m.T @ g[np.ix_(used, used)] @ m for m, g in zip(of_trials, beside.grams, strict=True))
                b = sum(m.T @ c[used] for m, c in zip(of_trials, beside.crosses, strict=True))
                found.append((a, b))
            self._last = closure, found
        return self._last[1]

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


_Spectrum = tuple[Array, Array, Any]


def _log_bayes_factors(spectrum: _Spectrum) -> Array:
    """Return the log Bayes factor of a law by each ridge, shape (ridges,)."""
    power = RIDGES[:, None] ** 2 * spectrum[0]
    gain = RIDGES[:, None] ** 2 * spectrum[1][:, 0] ** 2 / (1 + power)
    return np.asarray(0.5 * np.sum(gain - np.log1p(power), axis=1))


class _Beside:
    """Gram matrices of responses to pulses, residuals, derivatives and templates, by one setting of the noise."""

    def __init__(
        self, grid: NoiseGrid, setting: int, edges: Sequence[int], responses: Array, others: Array, prior: Array, p: int
    ) -> None:
        self.grams, self.crosses, whole = [], [], prior.T @ prior
        noises = grid.noises(setting)
        for data, (begin, end) in zip(grid.data, itertools.pairwise(edges), strict=True):
            standardised = data.with_noises(noises).standardise(np.hstack([responses[begin:end], others[begin:end]]))
            pulses, rest = standardised[:, : responses.shape[1]], standardised[:, responses.shape[1] :]
            self.grams.append(pulses.T @ pulses)
            self.crosses.append(pulses.T @ rest)
            whole = whole + rest.T @ rest
        fitted, free = slice(1, 1 + p), [0, *range(1 + p, len(whole))]
        self.inverse = np.linalg.pinv(whole[fitted, fitted], hermitian=True)
        self.cross = whole[fitted][:, free]
        """Derivatives with residuals and templates, shape (p, 1 + m)."""
        self.others = whole[np.ix_(free, free)] - self.cross.T @ self.inverse @ self.cross
        """Complement of the residuals and templates, shape (1 + m, 1 + m)."""


def laws_beside(
    fit: Fit, grid: NoiseGrid, settings: Sequence[int], log_z: Array, fitted: Array, templates: Array
) -> Laws | None:
    """Return all laws beside a fit; None: the records are too long for pulses to show where in a swing a force acts."""
    if not any(d.channels for d in fit.problem.data):  # a few events do not determine a law as a function
        return None
    runs = motions(fit)
    return None if runs.is_too_long else Laws(fit, runs, grid, settings, log_z, fitted, templates)


def with_law(p: Problem, law: Law) -> tuple[Problem, Array]:
    """Return a problem with a law's point and weights as further parameters, and their values by the linear model."""
    closure, trials = law.closure, tuple(t.name for t in p.study.trials)
    prior = POINT_SIGMA / POINT_SCALE
    points, weights = point_parameters(closure, trials, prior), weight_parameters(closure, trials, law.ridge)
    root_of_weights = np.linalg.inv(covariance_root(law.length, len(TARGETS[closure.target])))
    root = block_diag(p.prior_weights, np.eye(len(points)) / prior, root_of_weights)
    mean = np.append(p.prior_mean, np.zeros(len(points) + len(weights)))
    problem = Problem(closure.added_to(p.study), p.data, (*p.free_parameters, *points, *weights), (mean, root))
    return problem, np.concatenate([np.zeros(len(points)), law.weights / law.ridge])
