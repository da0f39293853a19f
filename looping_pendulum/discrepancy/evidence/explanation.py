"""Explanations: what is added to the declared model, its exact fit, and the log evidence of that.

The evidence is by Laplace's method, a Gaussian about the best fit, and where that decides, by importance sampling, too.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from looping_pendulum.discrepancy.candidates import Candidate, in_words
from looping_pendulum.discrepancy.evidence.laws import (
    Closure,
    Law,
    Prior,
    best_prior,
    log_share,
    prior_root,
    weighed,
    with_law,
    without_law,
)
from looping_pendulum.discrepancy.evidence.marginal import Marginal, NoiseGrid, sigma_of
from looping_pendulum.discrepancy.evidence.prior import log_density, log_occam, log_prior
from looping_pendulum.discrepancy.evidence.templates import Template
from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, calibrate, minimise
from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.measured.study import Study
from looping_pendulum.reference_ode.geometry import Array

Key = frozenset[str]
"""Names of all that an explanation adds."""
NOTHING: Key = frozenset()
WIDE = 1e3
"""Prior standard deviation of an added effect [scales]: the fit is by the data alone, and the prior of its size by `prior`."""
COST_ERROR = 0.1
"""Decrease of the cost below which a fit has converged."""
MAX_PRIORS = 2
"""Largest number of priors by which a law is fitted, one after another."""
SAMPLES = 300
"""Number of runs of each trial by which an evidence is checked."""
LEAST_EFFECTIVE = 0.05
"""Effective share of the samples below which they say nothing: a few of them have nearly all the weight."""


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
        return frozenset([c.name for c in self.effects] + ([self.law.name] if self.law else []))

    @property
    def in_words(self) -> str:
        """All parts in plain words; "nothing" without any."""
        return parts_in_words(sorted(c.name for c in self.effects), self.law)

    @property
    def kind(self) -> tuple[int, bool]:
        """Number of effects, and whether there is a law."""
        return len(self.effects), self.law is not None

    def without(self, part: str) -> Parts:
        """Return all parts but one, by its name."""
        law = None if self.law is None or self.law.name == part else self.law
        return dataclasses.replace(self, effects=tuple(c for c in self.effects if c.name != part), law=law)

    def parameters_of(self, part: str) -> set[str]:
        """Return the names of a part's free parameters."""
        if self.law and self.law.name == part:
            return {*self.law.point_coefficients, *self.law.names}
        return {name for c in self.effects if c.name == part for name in (c.name, *(k.name for k in c.companions))}

    def shapes_of(self, part: str) -> list[dict[str, float]]:
        """Return the initial values [SI] of the companions of a part from which a fit may begin: none where it has none."""
        shaped = (c for c in self.effects if c.name == part and c.companions)
        return [{k.name: v for k, v in zip(c.companions, values, strict=True)} for c in shaped for values in c.companion_grid()]


def parts_in_words(effects: Iterable[str], law: Closure | None) -> str:
    """Return effects, by their names, and a law in plain words; "nothing" without any."""
    return " and ".join([*map(in_words, effects), *([f"an unlisted {law.in_words}"] if law else [])]) or "nothing"


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """A model that was fitted exactly."""

    parts: Parts
    fit: Fit
    """With white noise."""
    log_z: float
    """Log evidence, the noise marginalised."""
    setting: int
    """Most probable setting of the noise."""
    log_prior: float
    checked: bool = False
    """Whether its evidence is by sampling, too, not by Laplace's method alone."""

    @property
    def key(self) -> Key:
        """Names of all that it adds."""
        return self.parts.key

    @property
    def log_posterior(self) -> float:
        """Log posterior probability but for a constant."""
        return self.log_z + self.log_prior


def raw(fit: Fit) -> Array:
    """Return residuals and their derivatives in the units of the data, then those of the prior, shape (n + p, 1 + p)."""
    rows = np.column_stack([fit.residuals, fit.jacobian])
    rows[: fit.problem.measured_rows] *= sigma_of(fit.problem.data)[:, None]
    return rows


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
    m = Marginal(grid, raw(fit), at_bounds=fit.at_bounds, settings=settings)
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
        setting=int(m.settings[np.argmax(log_z)]),
        log_prior=log_prior(len(parts.effects), library, log_share(parts.law) if parts.law else None),
    )


def _all_priors(fit: Fit, parts: Parts, m: Marginal, setting: int) -> float:
    """Return the log evidence of a fitted law by all priors of its weights, less that by the prior of its fit."""
    assert parts.law is not None
    weighing = weighed(fit, parts.law, parts.prior, m.gram[setting])
    own = weighing.log_bayes_factor(parts.prior)
    # What the linear model promises by another prior beyond this, no fit has kept: see `with_best_prior`
    log_bf = np.minimum(weighing.log_bayes_factors, own)
    return float(np.logaddexp.reduce(log_bf, axis=None)) - math.log(log_bf.size) - own


def checked(e: Explanation, fit: Fit, seed: int = 0) -> Explanation:
    """Return an explanation with its evidence by sampling around its optimum; unchanged where too few samples count.

    Samples are Gaussian, as Laplace's method takes the posterior to be. Each counts by the ratio of the posterior density there
    to that: beyond a bound it counts nothing, and the prior of an effect is the one at its own size.

    Parameters
    ----------
    fit
        The explanation's fit with its most probable noise.
    """
    p = fit.problem
    values, vectors = np.linalg.eigh(fit.jacobian.T @ fit.jacobian)
    # The widest prior is a bound, which rounding loses beside what is known a billion times as well
    values = np.maximum(values, WIDE**-2)
    z = np.random.default_rng(seed).standard_normal((SAMPLES, len(values)))
    x = fit.x + (z / np.sqrt(values)) @ vectors.T
    inside = np.all((x >= p.low) & (x <= p.high), axis=1)
    log_weights = np.full(SAMPLES, -np.inf)
    residuals = [p.residuals(row) for row in x[inside]]
    rise = np.array([math.inf if r is None else float(r @ r) - fit.cost for r in residuals])
    log_weights[inside] = 0.5 * (np.sum(z[inside] ** 2, axis=1) - rise)
    sigma = np.sqrt(np.sum(vectors**2 / values, axis=1))
    for c in e.parts.effects:
        i = p.names.index(c.name)
        error = float(sigma[i]) * p.free_parameters[i].scale / c.stated_error
        # The log prior density less that of the fit's wide one, but for a constant, as `explained` has it
        density = np.minimum(log_density(np.append(x[:, i], fit.x[i]) / sigma[i], error), -0.5 * math.log(2 * math.pi))
        of_prior = density + 0.5 * (np.append(x[:, i], fit.x[i]) / WIDE) ** 2
        log_weights += of_prior[:-1] - of_prior[-1]
    most = float(log_weights.max())
    weights = np.exp(log_weights - most) if most > -math.inf else np.zeros(SAMPLES)
    if float(weights.sum()) ** 2 < LEAST_EFFECTIVE * SAMPLES * float(np.sum(weights**2)) or most == -math.inf:
        return e
    return dataclasses.replace(e, log_z=e.log_z + most + math.log(float(weights.mean())), checked=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Addition:
    """What may be added to an explanation, by a linear model beside its fit."""

    parent: Explanation
    templates: tuple[Template, ...] = ()
    amounts: tuple[float, ...] = ()
    """Amount of each template."""
    law: Law | None = None
    step: Array
    """Change of the parent's parameters."""
    gain: float
    """Gain of log evidence over the parent."""
    decrease: float
    """Decrease of the cost with white noise."""
    library: int
    """Number of listed effects that there are."""

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
        of_law = log_share(self.parts.law) if self.parts.law else None
        return self.parent.log_z + self.gain + log_prior(len(self.parts.effects), self.library, of_law)


def fit_addition(a: Addition, needless_below: float = -math.inf) -> Fit | None:
    """Fit an explanation with what is added to it, from where the linear model leads; None: it cannot run, or is needless.

    Parameters
    ----------
    needless_below
        Log posterior with which nobody wants the explanation.
    """
    parent = a.parent.fit
    p, of_law = parent.problem, np.zeros(0)
    if a.law:
        p = with_law(p, a.law.closure, a.law.prior)
        of_law = np.append(np.zeros(len(a.law.closure.point_coefficients)), a.law.weights / a.law.prior[0])
    more, amounts, at = [], [], parent.x
    for t, amount in zip(a.templates, a.amounts, strict=True):
        # Below a finite change nothing is known: a fit that begins there may find no way to the value that explains
        value = t.value(max(amount, 1.0) if t.finite else amount) or t.delta
        effect = dataclasses.replace(t.candidate.free_parameter(max(t.scale, abs(value))), prior=WIDE)
        more += [effect, *t.companions]
        amounts += [value / effect.scale, *(0.0 for _ in t.companions)]
        at = t.candidate.where_it_acts(parent.problem.free_parameters, at)
    root = block_diag(p.prior_weights, np.diag([1 / n.prior_sigma for n in more]))
    prior = np.append(p.prior_mean, np.zeros(len(more))), root
    problem = Problem(p.study, p.data, (*p.free_parameters, *more), prior)
    added = np.append(of_law, amounts)
    starts: list[tuple[Callable[..., Fit], Array, Array]] = [
        (minimise, at + np.clip(a.step, -3, 3), added),
        (minimise, at, added),
        (calibrate, parent.problem.prior_mean, added),
        (minimise, parent.x, np.zeros(len(added))),
    ]
    if p.is_swing:  # the amplitude alone, before the other parameters follow it, would put a long swing out of phase
        starts = [(minimise, at, np.zeros(len(added))), starts[0]]
    # The cost of a fit, with white noise, that gives this log posterior
    needless_above = parent.cost - a.decrease + 2 * (a.log_posterior - needless_below)
    fits: list[Fit] = []
    for i, (fit_from, start, beside) in enumerate(starts):
        with contextlib.suppress(FitError):
            x = np.append(start, beside)
            fits.append(fit_from(problem, x, cost_tolerance=enough_cost(parent), needless_above=needless_above))
            # From where it explains less than its parent, the linear model says nothing of how far a fit will come
            if needless_above < fits[-1].cost <= parent.cost and not fits[-1].converged:
                return None
        decrease = parent.cost - min((f.cost for f in fits), default=math.inf)
        if decrease > 0.9 * a.decrease or (i and decrease > 0):
            break
    return min(fits, key=lambda f: f.cost, default=None)


def with_best_prior(fit: Fit, parts: Parts) -> tuple[Fit, Parts]:
    """Return a fit, if it has a law, by the prior of its weights that is most probable beside the fit itself.

    The one that it began with is that of a linear model, which may be far off, or that of the law before an effect was added.
    """
    if parts.law is None:
        return fit, parts
    for _ in range(MAX_PRIORS):
        rows = np.column_stack([fit.residuals, fit.jacobian])
        weighing = weighed(fit, parts.law, parts.prior, rows.T @ rows)
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
            again = minimise(problem, x, cost_tolerance=enough_cost(fit))
        except FitError:
            break
        # Far from linear, the linear model may promise tens by large weights, with which the fit is worse
        if _log_evidence(again) < _log_evidence(fit):
            break
        fit, parts = again, dataclasses.replace(parts, prior=prior)
    return fit, parts


def _log_evidence(fit: Fit) -> float:
    """Return the log evidence of a fit by its own noise and prior, but for a constant of the data."""
    log_normal = float(np.linalg.slogdet(fit.jacobian.T @ fit.jacobian)[1])
    return -0.5 * (fit.cost + log_normal) + float(np.linalg.slogdet(fit.problem.prior_weights)[1])


def enough_cost(fit: Fit) -> float:
    """Return the relative decrease of the cost below which a fit that begins there has converged.

    What is then left is a step of the linear model, which the evidence takes.
    """
    return COST_ERROR / max(min(fit.cost, fit.problem.count), 1.0)


def fit_without(e: Explanation, part: str) -> Fit | None:
    """Fit an explanation again without one of its parts; None: it cannot run."""
    dropped, p = e.parts.parameters_of(part), e.fit.problem
    # What places a law would move the pulses by which other laws are judged
    study = without_law(p.study) if e.parts.law and e.parts.law.name == part else p.study
    return _refit(e.fit, [i for i, n in enumerate(p.names) if n not in dropped], p.data, study)


def fit_again_at(fit: Fit, values: Mapping[str, float]) -> Fit | None:
    """Fit a model again from where some of its parameters have other ``values`` [SI]; None: it cannot run there."""
    p = fit.problem
    start = [
        (values[n.name] - n.init_value) / n.scale if n.name in values else x
        for n, x in zip(p.free_parameters, fit.x, strict=True)
    ]
    return _refit(fit, range(len(start)), p.data, p.study, np.array(start))


def _refit(fit: Fit, kept: Sequence[int], data: Sequence[TrialData], study: Study, start: Array | None = None) -> Fit | None:
    """Fit some of a fit's parameters to other data, from where they were or from ``start``; None: the model cannot run."""
    p = fit.problem
    prior = p.prior_mean[kept], p.prior_weights[np.ix_(kept, kept)]
    try:
        problem = Problem(study, data, [p.free_parameters[i] for i in kept], prior)
        return minimise(problem, (fit.x if start is None else start)[kept], cost_tolerance=enough_cost(fit))
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
    return _refit(fit, sorted(kept, key=lambda i: fit.problem.names[i] in last), data, fit.problem.study)
