"""Refit formulas of an unlisted force to the trajectories, with all parameters of the declared model, and test the best.

A formula acts through the radial basis functions that are fitted to it, so the reference, the engines and the repaired scenario
run it by the same code as the force that it replaces; the parameters of the fit are those of the formula.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, minimise_steps
from looping_pendulum.discrepancy.fit.held_out import HeldOutTest, check_held_out
from looping_pendulum.discrepancy.fit.predictions import Steps, together
from looping_pendulum.discrepancy.fit.problem import Problem, TrialData
from looping_pendulum.discrepancy.fit.residual_noise import with_noise_of_residuals
from looping_pendulum.discrepancy.unlisted.closures import TARGETS
from looping_pendulum.discrepancy.unlisted.force import WEAK_PRIOR, RecoveredForce, point_parameters
from looping_pendulum.discrepancy.unlisted.simplify import (
    MIN_WIDTH,
    CoordinateRange,
    FormulaFamily,
    PredictedFormula,
    coordinate_range_of,
    predict_formulas,
)
from looping_pendulum.discrepancy.workers import SERIAL, Workers
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.measured.study import Study, Trial
from looping_pendulum.reference_ode.effects.closure import weight_name
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters

MAX_REFITS = 3
"""Formulas that are refitted to the trajectories, those of the lowest predicted BIC."""
BIC_MARGIN = 10.0
"""Difference of BIC within which formulas count as equally good on the training data."""
PREFIX = "force_"
"""Prefix of the names of a formula's parameters in a fit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedFormula:
    """A formula that was refitted to the trajectories."""

    prediction: PredictedFormula
    fit: Fit
    delta_bic: float
    """Decrease of the Bayesian information criterion from the declared model."""
    delta_bic_of_profile: float
    """The same of the radial basis functions that the formula was fitted to."""
    held_out: HeldOutTest | None = None
    """Held-out test of the formula; None: not made, since a better formula was accepted or its delta BIC is too far behind."""

    @property
    def form(self) -> FormulaFamily:
        """Kind of formula."""
        return self.prediction.form

    @property
    def force(self) -> RecoveredForce:
        """The force as radial basis functions, which the formula was fitted to."""
        return self.prediction.force

    @property
    def values(self) -> Array:
        """Fitted values of its terms [SI]."""
        values = self.fit.values
        return np.array([values[PREFIX + t.name] for t in self.form.terms])

    @property
    def errors(self) -> Array:
        """Standard errors of its terms [SI]."""
        errors = self.fit.errors
        return np.array([errors[PREFIX + t.name] for t in self.form.terms])

    @property
    def accepted(self) -> bool:
        """Whether its delta BIC is larger than its basis functions', and it explains held-out data as well as they do."""
        if self.delta_bic <= self.delta_bic_of_profile or self.held_out is None or not self.held_out.passes:
            return False
        scatter = [math.sqrt(2 / n) for n in self.held_out.counts]  # standard deviation of chi2 per value of n values
        rows = zip(self.held_out.chi2, self.force.held_out.chi2, scatter, strict=True)
        return all(own <= of_profile + s for own, of_profile, s in rows)


def refit(
    base: Fit,
    force: RecoveredForce,
    held_out: Sequence[tuple[TrialData, Sequence[FreeParameter]]],
    workers: Workers = SERIAL,
) -> list[FittedFormula]:
    """Refit a force's formulas of lowest predicted BIC to the trajectories; return them, largest delta BIC first.

    Of those within `BIC_MARGIN` of the best, the first that is accepted on held-out data goes to the front.
    """
    predictions = predict_formulas(force, np.concatenate([d.sigma for d in base.problem.data]))[:MAX_REFITS]
    results = workers.map_together(_refit_together, base, predictions)
    formulas = sorted((f for f in results if f), key=lambda f: -f.delta_bic)
    for i, formula in enumerate(formulas):
        if formula.delta_bic < formulas[0].delta_bic - BIC_MARGIN:
            break
        final = with_noise_of_residuals(formula.fit)
        formulas[i] = judged = dataclasses.replace(formula, fit=final, held_out=check_held_out(final, held_out))
        if judged.accepted:
            return [judged, *formulas[:i], *formulas[i + 1 :]]
    return formulas


def _delta_bic_of_profile(base: Fit, force: RecoveredForce) -> float:
    """Return the delta BIC of radial basis functions, with their effective number of parameters."""
    p = force.fit.problem
    added = [i for i, name in enumerate(p.names) if name not in base.problem.names]
    weights = [p.names.index(name) for name in force.closure.names]
    # The posterior covariance of the weights over that of their prior is the part of them that the data do not determine, so
    # their number less that part is their effective number of parameters.
    root = p.prior_weights[np.ix_(weights, weights)]
    effective = len(added) - float(np.trace(root @ force.fit.covariance[np.ix_(weights, weights)] @ root.T))
    of_prior = force.fit.residuals[[p.measured_rows + i for i in added]]
    return base.cost - (force.fit.cost - float(of_prior @ of_prior)) - effective * math.log(base.problem.count)


def _refit_together(base: Fit, predictions: Sequence[PredictedFormula]) -> list[FittedFormula | None]:
    """Refit formulas to the trajectories, in step."""
    return together([_refit(base, prediction) for prediction in predictions])


def _refit(base: Fit, prediction: PredictedFormula) -> Steps[FittedFormula | None]:
    """Refit one formula to the trajectories from its predicted values; None if the model cannot run."""
    problem = _problem(base, prediction)
    names = base.problem.names
    n_added = len(problem.free_parameters) - len(names)
    # The other parameters start where the fit with radial basis functions left them
    of_force = prediction.force.fit
    start = np.concatenate([of_force.x[[of_force.problem.names.index(n) for n in names]], np.zeros(n_added)])
    try:
        fit = yield from minimise_steps(problem, start)
    except FitError:
        return None
    delta_bic = base.cost - fit.cost - n_added * math.log(base.problem.count)
    return FittedFormula(
        prediction=prediction,
        fit=fit,
        delta_bic=delta_bic,
        delta_bic_of_profile=_delta_bic_of_profile(base, prediction.force),
    )


def _problem(base: Fit, prediction: PredictedFormula) -> Problem:
    """Return the declared model with the formula's parameters, which start at their predicted values."""
    coordinate_range = coordinate_range_of(prediction.force)
    p = base.problem
    study = FormulaStudy(
        **{f.name: getattr(p.study, f.name) for f in dataclasses.fields(Study)},
        closure_coefficients=functools.partial(_closure_coefficients, prediction, coordinate_range),
        formula_parameters=tuple(PREFIX + t.name for t in prediction.form.terms),
        start_values=tuple(prediction.values.tolist()),
    )
    added = [_free_parameter(prediction, i, coordinate_range, study) for i in range(len(prediction.values))]
    point = point_parameters(prediction.force.closure, tuple(t.name for t in study.trials))
    return Problem(study, p.data, (*p.free_parameters, *point, *added))


def _free_parameter(prediction: PredictedFormula, i: int, coordinate_range: CoordinateRange, study: Study) -> FreeParameter:
    term, value, error = prediction.form.terms[i], float(prediction.values[i]), float(prediction.errors[i])
    bounds = (-1e6, 1e6)
    # The scale is the unit of the parameter in the fit; a tenth of the value is the least, lest a tiny predicted error set it.
    min_scale = 0.1 * abs(value)
    if term.of_coordinate:
        width = float(prediction.values[1])
        # A place may be near zero, so that its own size is no scale; the width is
        min_scale = 0.1 * width
        bounds = (MIN_WIDTH * coordinate_range.spacing, 1e3 * width)
        if term.name == "place":
            bounds = (coordinate_range.low - width, coordinate_range.high + width)
    return FreeParameter(
        name=PREFIX + term.name,
        parameter=PREFIX + term.name,
        trials=tuple(t.name for t in study.trials),
        init_value=value,
        scale=max(error, min_scale, 1e-9),
        prior=WEAK_PRIOR,
        bounds=bounds,
    )


def _closure_coefficients(
    prediction: PredictedFormula, coordinate_range: CoordinateRange, parameters: Sequence[float]
) -> dict[str, float]:
    """Return the coefficients of the closure that stands for the formula with these values of its parameters."""
    values, form, closure = np.asarray(parameters), prediction.form, prediction.force.closure
    placement = form.placement(values, coordinate_range)
    sides = zip(TARGETS[closure.target], form.weights(values, placement), strict=True)
    weights = {weight_name(side, i): float(v) for side, of_side in sides for i, v in enumerate(of_side)}
    placed = dataclasses.replace(closure, first_centre=placement.first_centre, spacing=placement.spacing)
    return weights | placed.coefficients


@dataclass(frozen=True, kw_only=True)
class FormulaStudy(Study):
    """A study whose model has a formula's force, with the parameters of the formula as free parameters."""

    closure_coefficients: Callable[[Sequence[float]], Mapping[str, float]] = dataclasses.field(compare=False)
    """Values of `formula_parameters` -> coefficients of the closure."""
    formula_parameters: tuple[str, ...]
    """Names of the formula's parameters in a fit."""
    start_values: tuple[float, ...]
    """Values of the formula's parameters before a fit changes them [SI]."""

    def parameters(self, values: Mapping[str, float], trial: Trial) -> Parameters:
        """Return the reference's parameters of a trial."""
        return super().parameters(values, trial).replace(**self.closure_coefficients(self.start_values))

    def changes_of_model(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return the same with the coefficients of the closure in place of the formula's parameters."""
        values = [changes.get(name, v) for name, v in zip(self.formula_parameters, self.start_values, strict=True)]
        rest = {name: value for name, value in changes.items() if name not in self.formula_parameters}
        # A point among the changes is that of the fit, and not the one at which the formula was fitted first
        if not any(np.ndim(v) for v in values):
            return {**self.closure_coefficients(values), **rest}
        rows = [self.closure_coefficients(row) for row in zip(*np.broadcast_arrays(*values), strict=True)]
        return {**{name: np.array([row[name] for row in rows]) for name in rows[0]}, **rest}
