"""Explanations: what is added to the declared model, its exact fit, and the log evidence of that."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.evidence.laws import Law, Prior, Weighing, best_prior, prior_root, weighed, with_law
from looping_pendulum.discrepancy.evidence.marginal import Marginal, NoiseGrid, sigma_of
from looping_pendulum.discrepancy.evidence.motions import Closure
from looping_pendulum.discrepancy.evidence.prior import log_occam, log_prior
from looping_pendulum.discrepancy.evidence.templates import Template
from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, NeedlessFit, calibrate, minimise
from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.reference_ode.geometry import Array

Key = frozenset[str]
"""Names of all that an explanation adds."""
NOTHING: Key = frozenset()
WIDE = 1e3
"""Prior standard deviation of an added effect [scales]: the fit is by the data alone, and the prior of its size by `prior`."""
COST_ERROR = 0.1
"""Decrease of the cost below which a fit has converged."""
LEAST_WORTH, FEW_ITERATIONS = 10.0, 10
"""Decrease of the cost that pays for no effect: for less, a fit is not begun a third time, and has so many iterations.

A fit of how much a string stretches goes to ever stiffer ones, whose runs take a hundred times as long.
"""
MAX_PRIORS = 2
"""Largest number of priors by which a law is fitted, one after another."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Parts:
    """What an explanation adds to the declared model."""

    effects: tuple[Candidate, ...] = ()
    law: Closure | None = None
    prior: Prior = (1.0, 0.0)
    """That of the law's weights in the fit."""

    @cached_property
    def key(self) -> Key:
        """Names of all parts."""
        return frozenset([c.name for c in self.effects] + ([law_name(self.law)] if self.law else []))

    def without(self, part: str) -> Parts:
        """Return all parts but one, by its name."""
        if self.law and law_name(self.law) == part:
            return Parts(effects=self.effects)
        return dataclasses.replace(self, effects=tuple(c for c in self.effects if c.name != part))

    def parameters_of(self, part: str) -> set[str]:
        """Return the names of a part's free parameters."""
        if self.law and law_name(self.law) == part:
            return {*self.law.point_coefficients, *self.law.names}
        return {name for c in self.effects if c.name == part for name in (c.name, *(k.name for k in c.companions))}


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """A model that was fitted exactly."""

    parts: Parts
    fit: Fit
    """With white noise."""
    log_z: float
    """Log evidence, the noise marginalised."""
    settings: tuple[int, ...]
    """Settings of the noise that were looked at, the most probable first."""
    log_prior: float
    checked: bool = False
    """Whether its evidence is by sampling, too, not by Laplace's method alone."""

    @property
    def key(self) -> Key:
        """Names of all that it adds."""
        return self.parts.key

    @property
    def setting(self) -> int:
        """Most probable setting of the noise."""
        return self.settings[0]

    @property
    def log_posterior(self) -> float:
        """Log posterior probability but for a constant."""
        return self.log_z + self.log_prior


def law_name(law: Closure) -> str:
    """Return the name of a law as a part of an explanation."""
    by = "" if law.factor == "constant" else f" times {law.factor}"
    return f"law: {law.target} by {law.coordinate}{by}"


def raw(fit: Fit) -> Array:
    """Return residuals and their derivatives in the units of the data, then those of the prior, shape (n + p, 1 + p)."""
    rows = np.column_stack([fit.residuals, fit.jacobian])
    rows[: fit.problem.measured_rows] *= sigma_of(fit.problem.data)[:, None]
    return rows


def bounded(fit: Fit) -> list[int]:
    """Return the indices of the parameters of a fit that are on a bound."""
    return [fit.problem.names.index(n) for n in fit.at_bounds]


def explained(grid: NoiseGrid, fit: Fit, parts: Parts, library: int, settings: Sequence[int] | None = None) -> Explanation:
    """Return a fit as an explanation, with its evidence by Laplace's method.

    The wide Gaussian prior of each effect's value is replaced by that of `prior`, and that of a law's weights by all of them.

    Parameters
    ----------
    library
        Number of listed effects that there are.
    settings
        Settings of the noise that are looked at; None: all.
    """
    m = Marginal(grid, raw(fit), at_bounds=bounded(fit), settings=settings)
    log_z = m.log_z_of_settings.copy()
    if parts.law is not None:
        log_z += _all_priors(fit, parts, m, int(np.argmax(log_z)))
    step, variance = m.shift()
    for c in parts.effects:
        i = fit.problem.names.index(c.name)
        # With noise of a setting at which the fit is no minimum, there is no evidence
        is_minimum = variance[:, i] > 0
        x, sigma = fit.x[i] + np.clip(step[:, i], -3, 3), np.sqrt(np.where(is_minimum, variance[:, i], 1.0))
        error = sigma * fit.problem.free_parameters[i].scale / c.stated_error
        # Without the Gaussian prior of the fit, the posterior's width is sigma; what the prior makes of it is `log_occam`
        of_prior = log_occam(x / sigma, error) + (math.log(2) if c.even else 0.0)
        log_z += 0.5 * (x / WIDE) ** 2 + math.log(WIDE) - np.log(sigma) + of_prior
        log_z[~is_minimum] = -math.inf
    return Explanation(
        parts=parts,
        fit=fit,
        log_z=float(np.logaddexp.reduce(log_z)),
        settings=tuple(m.settings[np.argsort(-log_z, kind="stable")].tolist()),
        log_prior=log_prior(len(parts.effects), library, parts.law),
    )


def _weighed(fit: Fit, law: Closure, prior: Prior, gram: Array) -> Weighing:
    free = [i for i, name in enumerate(fit.problem.names) if name not in fit.at_bounds]
    return weighed(law, prior, fit.problem, fit.x, gram, free)


def _all_priors(fit: Fit, parts: Parts, m: Marginal, setting: int) -> float:
    """Return the log evidence of a fitted law by all priors of its weights, less that by the prior of its fit."""
    assert parts.law is not None
    weighing = _weighed(fit, parts.law, parts.prior, m.gram[setting])
    log_bf = weighing.log_bayes_factors
    return float(np.logaddexp.reduce(log_bf, axis=None)) - math.log(log_bf.size) - weighing.log_bayes_factor(parts.prior)


def free_parameters(t: Template, value: float) -> tuple[FreeParameter, ...]:
    """Return an effect and its companions as free parameters; ``value`` is about its own, less the null value [SI]."""
    scale = max(t.scale, abs(value))
    return dataclasses.replace(t.candidate.free_parameter(scale), prior=WIDE), *t.companions


@dataclass(frozen=True, kw_only=True, eq=False)
class Addition:
    """What may be added to an explanation, by a linear model beside its fit."""

    parent: Explanation
    templates: tuple[Template, ...]
    amounts: tuple[float, ...]
    """Amount of each template."""
    law: Law | None
    step: Array
    """Change of the parent's parameters."""
    gain: float
    """Gain of log evidence over the parent."""
    decrease: float
    """Decrease of the cost with white noise."""
    log_prior: float
    """That of the explanation which it makes."""

    @cached_property
    def key(self) -> Key:
        """What the explanation which it makes adds, by name."""
        return self.parts.key

    @cached_property
    def parts(self) -> Parts:
        """What the explanation which it makes adds."""
        before = self.parent.parts
        effects = before.effects + tuple(t.candidate for t in self.templates)
        if self.law is None:
            return dataclasses.replace(before, effects=effects)
        return Parts(effects=effects, law=self.law.closure, prior=self.law.prior)

    @property
    def log_posterior(self) -> float:
        """Log posterior probability of that explanation, as `Explanation.log_posterior`."""
        return self.parent.log_z + self.gain + self.log_prior


def fit_addition(a: Addition, needless_below: float = -math.inf) -> tuple[Fit, Parts] | None:
    """Fit an explanation with what is added to it, from where the linear model leads; None: it cannot run, or is needless.

    Parameters
    ----------
    needless_below
        Log posterior with which nobody wants the explanation.
    """
    parent = a.parent.fit
    p, weights = parent.problem, np.zeros(0)
    if a.law:
        p = with_law(p, a.law.closure, a.law.prior)
        weights = np.append(np.zeros(len(a.law.closure.point_coefficients)), a.law.weights / a.law.prior[0])
    values = [t.value(amount) or t.delta for t, amount in zip(a.templates, a.amounts, strict=True)]
    groups = [free_parameters(t, v) for t, v in zip(a.templates, values, strict=True)]
    more = [n for group in groups for n in group]
    root = block_diag(p.prior_weights, np.diag([1 / n.prior_sigma for n in more]))
    prior = np.append(p.prior_mean, np.zeros(len(more))), root
    problem = Problem(p.study, p.data, (*p.free_parameters, *more), prior)
    own = [[v / group[0].scale, *(0.0 for _ in group[1:])] for v, group in zip(values, groups, strict=True)]
    added = np.concatenate([weights, *own])
    at = parent.x
    for t in a.templates:
        at = t.candidate.where_it_acts(parent.problem.free_parameters, at)
    starts: list[tuple[Callable[..., Fit], Array, Array]] = [
        (minimise, at + np.clip(a.step, -3, 3), added),
        (minimise, at, added),
        (calibrate, parent.problem.prior_mean, added),
    ]
    if p.is_swing:  # the amplitude alone, before the other parameters follow it, would put a long swing out of phase
        starts = [(minimise, at, np.zeros(len(added))), starts[0]]
    fits: list[Fit] = []
    # The cost of a fit, with white noise, that gives this log posterior
    needless_above = parent.cost - a.decrease + 2 * (a.log_posterior - needless_below)
    limit = {}
    if a.decrease < LEAST_WORTH:
        starts, limit = starts[:2], {"max_iterations": FEW_ITERATIONS}
    for i, (fit_from, start, beside) in enumerate(starts):
        try:
            x = np.concatenate([start, beside])
            fits.append(fit_from(problem, x, cost_tolerance=enough_cost(parent), needless_above=needless_above, **limit))
        except NeedlessFit:
            return None
        except FitError:
            continue
        decrease = parent.cost - min((f.cost for f in fits), default=math.inf)
        if decrease > 0.9 * a.decrease or (i and decrease > 0):
            break
    if not fits:
        return None
    fit = min(fits, key=lambda f: f.cost)
    if limit and parent.cost - fit.cost > LEAST_WORTH:  # more than the linear model knew of
        try:
            fit = minimise(problem, fit.x, cost_tolerance=enough_cost(parent), needless_above=needless_above)
        except NeedlessFit:
            return None
    if fit.cost > parent.cost:
        with contextlib.suppress(FitError):
            again = minimise(problem, np.concatenate([parent.x, np.zeros(len(added))]), cost_tolerance=enough_cost(parent))
            fit = min(fit, again, key=lambda f: f.cost)
    return (fit, a.parts) if a.law is None else _with_best_prior(fit, a.parts)


def _with_best_prior(fit: Fit, parts: Parts) -> tuple[Fit, Parts]:
    """Return the fit of a law by the prior of its weights that is most probable beside the fit itself.

    The one that it began with is that of a linear model, which may be far off.
    """
    assert parts.law is not None
    for _ in range(MAX_PRIORS):
        rows = np.column_stack([fit.residuals, fit.jacobian])
        weighing = _weighed(fit, parts.law, parts.prior, rows.T @ rows)
        prior = best_prior(weighing.log_bayes_factors)
        if weighing.log_bayes_factor(prior) - weighing.log_bayes_factor(parts.prior) < COST_ERROR:
            break
        p, names = fit.problem, parts.law.names
        parameters = [dataclasses.replace(n, scale=prior[0]) if n.name in names else n for n in p.free_parameters]
        is_weight = [n in names for n in p.names]
        root = p.prior_weights.copy()
        root[np.ix_(is_weight, is_weight)] = prior_root(parts.law, prior)
        problem = Problem(p.study, p.data, parameters, (p.prior_mean, root))
        x = np.where(is_weight, fit.x * parts.prior[0] / prior[0], fit.x)
        try:
            fit, parts = minimise(problem, x, cost_tolerance=enough_cost(fit)), dataclasses.replace(parts, prior=prior)
        except FitError:
            break
    return fit, parts


def fit_again(e: Explanation) -> Fit | None:
    """Fit an explanation again from where its other parameters are as likely as can be before the data are seen."""
    p = e.fit.problem
    added = {name for part in e.key for name in e.parts.parameters_of(part)}
    start = np.where([name in added for name in p.names], e.fit.x, p.prior_mean)
    try:
        return calibrate(p, start, cost_tolerance=enough_cost(e.fit))
    except FitError:
        return None


def enough_cost(fit: Fit) -> float:
    """Return the relative decrease of the cost below which a fit that begins there has converged.

    What is then left is a step of the linear model, which the evidence takes.
    """
    return COST_ERROR / max(min(fit.cost, fit.problem.count), 1.0)


def fit_without(e: Explanation, part: str) -> Fit | None:
    """Fit an explanation again without one of its parts; None: it cannot run."""
    p, dropped = e.fit.problem, e.parts.parameters_of(part)
    kept = [i for i, n in enumerate(p.names) if n not in dropped]
    return _refit(e.fit, kept, p.data)


def _refit(fit: Fit, kept: Sequence[int], data: Sequence[TrialData]) -> Fit | None:
    """Fit some of a fit's parameters to other data, from where they were; None: the model cannot run."""
    p = fit.problem
    prior = p.prior_mean[kept], p.prior_weights[np.ix_(kept, kept)]
    try:
        problem = Problem(p.study, data, [p.free_parameters[i] for i in kept], prior)
        return minimise(problem, fit.x[kept], cost_tolerance=enough_cost(fit))
    except FitError:
        return None


def fit_to_data(fit: Fit, data: Sequence[TrialData], last: Collection[str] = ()) -> Fit | None:
    """Fit a model to other data of the same trials, or of some of them, from where it was.

    Parameters
    ----------
    last
        Parameters that come after all others then.
    """
    trials = {d.trial.name for d in data}
    kept = [i for i, n in enumerate(fit.problem.free_parameters) if trials & set(n.trials)]
    return _refit(fit, sorted(kept, key=lambda i: fit.problem.names[i] in last), data)
