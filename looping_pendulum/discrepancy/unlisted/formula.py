"""Refit formulas of an unlisted force by trajectory, all numbers of the declared model with them, and judge the best.

A formula acts as the row of bumps that it is laid into, so the reference, the engines and the repaired scenario run it as they
run the bumps that it came from; what is fitted are its own numbers.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from looping_pendulum.discrepancy.data.study import Study, Trial
from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, minimise
from looping_pendulum.discrepancy.fit.problem import FreeParameter, ParameterRole, Problem, TrialData
from looping_pendulum.discrepancy.fit.residual import with_noise_of_residuals
from looping_pendulum.discrepancy.listed.attribution import HeldOutTest, judge
from looping_pendulum.discrepancy.unlisted.discovery import TARGETS, WEAK_PRIOR, RecoveredForce, Tick
from looping_pendulum.discrepancy.unlisted.simplify import (
    THINNEST,
    CoordinateRange,
    FormulaFamily,
    PredictedFormula,
    promises,
    range_of,
)
from looping_pendulum.reference_ode.effects.closure import weight
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters

REFITS = 3
"""Formulas that are refitted, of all closures."""
MARGIN = 10.0
"""Of gain within which formulas count as equally good on what the fit saw; twice that among mere promises."""
PATIENCE = 15
"""Iterations of each."""
PREFIX = "force_"
"""Before the names of a formula's numbers in a fit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedFormula:
    """A formula, refitted by trajectory."""

    promise: PredictedFormula
    fit: Fit
    gain: float
    """On the Bayesian information criterion, over the declared model."""
    gain_of_bumps: float
    """The same of the bumps that it came from."""
    to_match: HeldOutTest
    """How the best bumps of all explain unseen data."""
    unseen: HeldOutTest | None = None
    """None: not judged, another formula gains more."""

    @property
    def form(self) -> FormulaFamily:
        """Its kind."""
        return self.promise.form

    @property
    def found(self) -> RecoveredForce:
        """The bumps that it came from."""
        return self.promise.found

    @property
    def q(self) -> Array:
        """Its numbers [SI]."""
        values = self.fit.values
        return np.array([values[PREFIX + t.name] for t in self.form.terms])

    @property
    def errors(self) -> Array:
        """Standard errors of its numbers [SI]."""
        errors = self.fit.errors
        return np.array([errors[PREFIX + t.name] for t in self.form.terms])

    @property
    def stands(self) -> bool:
        """Whether it gains more than its bumps, and explains unseen data to their noise and as well as any bumps do."""
        if self.gain <= self.gain_of_bumps or self.unseen is None or not self.unseen.explained:
            return False
        scatter = [math.sqrt(2 / n) for n in self.unseen.counts]
        pairs = zip(self.unseen.chi2, self.to_match.chi2, scatter, strict=True)
        return all(own <= bumps + s for own, bumps, s in pairs)


def refit(
    base: Fit, found: Sequence[RecoveredForce], held: Sequence[tuple[TrialData, Sequence[FreeParameter]]], tick: Tick
) -> list[FittedFormula]:
    """Refit the formulas that promise most by trajectory, best first.

    Of those within `MARGIN` of the best, the first that explains what no fit saw goes to the front.
    """
    to_match = min((f.unseen for f in found), key=lambda u: u.worst)
    written = []
    for promise in _promising(base, found):
        tick(f"fitting a formula of the unknown force by {promise.found.closure.coordinate}")
        refitted = _refit(base, promise, to_match)
        written += [refitted] if refitted else []
    written.sort(key=lambda w: -w.gain)
    for i, w in enumerate(written):
        if w.gain < written[0].gain - MARGIN:
            break
        final = with_noise_of_residuals(w.fit)
        written[i] = judged = dataclasses.replace(w, fit=final, unseen=judge(final, held))
        if judged.stands:
            return [judged, *written[:i], *written[i + 1 :]]
    return written


def _promising(base: Fit, found: Sequence[RecoveredForce]) -> list[PredictedFormula]:
    """Forms of all closures that promise about as much as the best, each once: a side may have nothing to add."""
    noise = np.concatenate([d.sigma for d in base.problem.data])
    ranked = sorted((p for one in found for p in promises(one, noise)), key=lambda p: p.score)
    different: dict[object, PredictedFormula] = {}
    for p in ranked:
        closure = p.found.closure
        different.setdefault((closure.coordinate, closure.factor, frozenset(p.form.texts) - {"0"}), p)
    return [p for p in different.values() if p.score <= ranked[0].score + 2 * MARGIN][:REFITS]


def _gain_of_bumps(base: Fit, found: RecoveredForce) -> float:
    """Gain of bumps on the Bayesian information criterion, each counted as far as the data and not the ridge set it."""
    fit = found.fit
    known = len(base.problem.numbers)
    residuals = fit.problem.with_data(base.problem.data).residuals(fit.x)
    assert residuals is not None
    added = len(fit.problem.numbers) - known
    # what the data leave of a weight's variance, in units of the ridge's, is what the data do not set
    free = added - float(np.trace(fit.covariance[known:, known:]))
    kept = residuals[:-added]
    return base.cost - float(kept @ kept) - free * math.log(base.problem.count)


def _refit(base: Fit, promise: PredictedFormula, to_match: HeldOutTest) -> FittedFormula | None:
    problem = _problem(base, promise)
    known = len(base.problem.numbers)
    try:
        fit = minimise(problem, np.concatenate([promise.found.fit.x[:known], np.zeros(len(promise.q))]), most=PATIENCE)
    except FitError:
        return None
    gain = base.cost - fit.cost - len(promise.q) * math.log(base.problem.count)
    bumps = _gain_of_bumps(base, promise.found)
    return FittedFormula(promise=promise, fit=fit, gain=gain, gain_of_bumps=bumps, to_match=to_match)


def _problem(base: Fit, promise: PredictedFormula) -> Problem:
    """Return the declared model with the formula's numbers, which start where they are promised."""
    where = range_of(promise.found)
    p = base.problem
    study = FormulaStudy(
        **{f.name: getattr(p.study, f.name) for f in dataclasses.fields(Study)},
        written=lambda numbers: _laid(promise, where, numbers),
        terms=tuple(PREFIX + t.name for t in promise.form.terms),
        starts=tuple(promise.q.tolist()),
    )
    added = [_number(promise, i, where, study) for i in range(len(promise.q))]
    return Problem(study, p.data, (*p.numbers, *added))


def _number(promise: PredictedFormula, i: int, where: CoordinateRange, study: Study) -> FreeParameter:
    term, value, error = promise.form.terms[i], float(promise.q[i]), float(promise.errors[i])
    bounds = (-1e6, 1e6)
    least = 0.1 * abs(value)
    if term.of_coordinate:
        width = float(promise.q[1])
        least = 0.1 * width
        bounds = (where.low - width, where.high + width) if term.name == "place" else (THINNEST * where.step, 1e3 * width)
    return FreeParameter(
        name=PREFIX + term.name,
        parameter=PREFIX + term.name,
        how=ParameterRole.SET,
        trials=tuple(t.name for t in study.trials),
        start=value,
        scale=max(error, least, 1e-9),
        prior=WEAK_PRIOR,
        bounds=bounds,
    )


def _laid(promise: PredictedFormula, where: CoordinateRange, numbers: Sequence[float]) -> dict[str, float]:
    """The formula as coefficients of the closure."""
    q, form, closure = np.asarray(numbers), promise.form, promise.found.closure
    row = form.row(q, where)
    sides = zip(TARGETS[closure.target], form.weights(q, row), strict=True)
    laid = {weight(side, i): float(v) for side, weights in sides for i, v in enumerate(weights)}
    return laid | dataclasses.replace(closure, low=row.low, step=row.step).coefficients


@dataclass(frozen=True, kw_only=True)
class FormulaStudy(Study):
    """A study whose model has a formula's force, written in numbers of its own."""

    written: Callable[[Sequence[float]], Mapping[str, float]] = dataclasses.field(compare=False)
    """Values of `terms` -> coefficients of the closure."""
    terms: tuple[str, ...]
    """Names of the formula's numbers."""
    starts: tuple[float, ...]

    def parameters(self, values: Mapping[str, float], trial: Trial) -> Parameters:
        """Reference parameters of a trial, to be changed by a formula's numbers as by any other."""
        plain = super().parameters(values, trial)
        return cast(Parameters, _FormulaParameters(plain.replace(**self.written(self.starts)), self))


class _FormulaParameters:
    """Parameters that take a formula's numbers in `replace`."""

    def __init__(self, plain: Parameters, study: FormulaStudy) -> None:
        self._plain = plain
        self._study = study

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plain, name)

    def replace(self, **changes: object) -> Parameters:
        numbers = [
            cast(float, changes.pop(term, start)) for term, start in zip(self._study.terms, self._study.starts, strict=True)
        ]
        return self._plain.replace(**changes, **self._study.written(numbers))
