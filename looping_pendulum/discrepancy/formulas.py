"""Formulas of an unlisted force: those of a few families, their refit to the trajectories, and the force as plain data.

Which formulas suit a force follows from the linearised model about its radial basis functions. The best are refitted with all
parameters of the declared model. A formula acts through the radial basis functions that are fitted to it, so the reference,
the engines and the repaired scenario run it by the same code as the force that it replaces; the parameters of the fit are those
of the formula. It has all directions of a force at once: a pulse has one place and one width, and a height in every direction.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from looping_pendulum.discrepancy.evidence.explain import RecoveredForce
from looping_pendulum.discrepancy.evidence.motions import (
    END_MARGIN,
    STRING,
    TARGETS,
    WEAK_PRIOR,
    Closure,
    motions,
    point_parameters,
)
from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, minimise
from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.held_out import HeldOutTest, check_held_out
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual import check_residuals
from looping_pendulum.discrepancy.fit.residual_noise import with_noise_of_residuals
from looping_pendulum.discrepancy.result import ForceProfile, Formula, FormulaParameter, Unlisted, value_unit
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.measured.study import Study, Trial
from looping_pendulum.pages.numbers import number
from looping_pendulum.reference_ode.effects.closure import COORDINATES, N_BASIS_FUNCTIONS, weight_name
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters

PROFILE_POINTS = 60
"""Points of a profile in the result."""
COORDINATE_UNITS = {
    "time": "s",
    "free_length": "m",
    "wrap_angle": "rad",
    "retreat_speed": "m/s",
    "across_speed": "m/s",
    "slip_speed": "m/s",
    "normal_load": "N",
    "hanging_length": "m",
    "horizontal_position": "m",
    "height": "m",
    "distance": "m",
}
"""Coordinate -> its SI unit."""
FACTOR_TEXTS = {"constant": "", "retreat_speed": "-u", "across_speed": "-w"}
"""Factor -> its text before a formula; u is the light mass's speed away from the rod along the string, w across it.

A factor is minus the speed, so a positive function of the coordinate brakes.
"""

assert set(COORDINATE_UNITS) == set(COORDINATES)
NO_FORMULA = "no simple formula; twelve radial basis functions"
"""Text in a formula's place where none is accepted."""
SIGNIFICANT_ERRORS = 2.0
"""Standard errors that a force must exceed at a coordinate to be reported as significant there."""
MOSTLY, SELDOM = 0.8, 0.2
"""Shares of the force's size while the string slides, from and up to which it is said to act then, or not then."""
MAX_REFITS = 3
"""Formulas that are refitted to the trajectories, those of the lowest predicted BIC."""
BIC_MARGIN = 10.0
"""Difference of BIC within which formulas count as equally good on the training data."""
PREFIX = "force_"
"""Prefix of the names of a formula's parameters in a fit."""
POLYNOMIAL_MARGIN = 2.0
"""By how many spacings the basis functions reach beyond either end of the coordinate's range where they stand for a polynomial.

A polynomial does not fall off at the ends of the range as a sum of basis functions does.
"""
PULSE_SPACING = 0.6
"""Spacing of the basis functions that stand for a pulse, in widths of the pulse."""
PROJECTION_POINTS = 120
"""Points at which a profile is projected on basis functions by least squares."""
START_WIDTHS = (0.4, 1.0, 2.5)
"""Start values of the width of a pulse or step, in spacings of the fitted basis functions."""
MIN_WIDTH = 0.2
"""Lower bound of the width of a pulse or step, in spacings of the fitted basis functions."""


def describe_unlisted_force(force: RecoveredForce, formulas: Sequence[FittedFormula], held_out_chi2_before: float) -> Unlisted:
    """Describe an unlisted force.

    Parameters
    ----------
    force
        The force as radial basis functions.
    formulas
        Formulas of it that were refitted to the trajectories; if the first is accepted, it is described, too.
    held_out_chi2_before
        Largest chi2 per value of held-out data under the declared model.
    """
    formula = formulas[0] if formulas and formulas[0].accepted else None
    held_out = formula.held_out if formula and formula.held_out else force.held_out
    closure = force.closure
    return Unlisted(
        acts_on=closure.target,
        depends_on=closure.coordinate,
        multiplied_by=closure.factor,
        unit=COORDINATE_UNITS[closure.coordinate],
        profiles=tuple(_profile(force, formula, i) for i in range(len(TARGETS[closure.target]))),
        formula=_formula(formula) if formula else None,
        formulas=tuple(_formula(f) for f in formulas),
        phase=_phase(force),
        log_bayes_factor=force.log_bayes_factor,
        held_out_chi2_before=held_out_chi2_before,
        held_out_chi2_after=held_out.worst,
        point=closure.point,
    )


def _formula(fitted: FittedFormula) -> Formula:
    closure = fitted.force.closure
    rows = zip(fitted.form.terms, fitted.values, fitted.errors, strict=True)
    return Formula(
        form=fitted.form.name,
        depends_on=closure.coordinate,
        multiplied_by=closure.factor,
        parameters=tuple(
            FormulaParameter(name=t.name, value=float(v), error=float(e), unit=_unit(t, closure)) for t, v, e in rows
        ),
        delta_bic=fitted.delta_bic,
        delta_bic_of_profile=fitted.delta_bic_of_profile,
        held_out_chi2=fitted.held_out.worst if fitted.held_out else None,
        held_out_chi2_of_profile=fitted.force.held_out.worst,
        accepted=fitted.accepted,
    )


def _unit(term: FormulaTerm, closure: Closure) -> str:
    coordinate = COORDINATE_UNITS[closure.coordinate]
    if term.power is None:
        return coordinate
    force = value_unit(closure.target, closure.factor)
    per = f"({coordinate})" if "/" in coordinate else coordinate
    if not term.power:
        return force
    return f"{force or '1'}/{per}" + (f"^{term.power}" if term.power > 1 else "")


def _profile(force: RecoveredForce, formula: FittedFormula | None, index: int) -> ForceProfile:
    s = np.linspace(force.coordinates.min(), force.coordinates.max(), PROFILE_POINTS)
    value, error = force.closure.profile(force.weights[index], s), force.standard_error(index, s)
    significant = s[np.abs(value) > SIGNIFICANT_ERRORS * error]
    formula_values = formula.form.profile(formula.values, s)[index] if formula else None
    in_model = value if formula_values is None else formula_values
    return ForceProfile(
        side=TARGETS[force.closure.target][index],
        coordinate=tuple(s.tolist()),
        value=tuple(value.tolist()),
        error=tuple(error.tolist()),
        largest=float(in_model[np.argmax(np.abs(in_model))]),
        largest_at=float(s[np.argmax(np.abs(in_model))]),
        significant_from=float(significant.min()) if significant.size else None,
        significant_to=float(significant.max()) if significant.size else None,
        formula=_text(formula, index) if formula else NO_FORMULA,
        fitted_formula_values=None if formula_values is None else tuple(formula_values.tolist()),
    )


def _text(fitted: FittedFormula, index: int) -> str:
    """Return the formula of one side with the values of its parameters."""
    text = fitted.form.text(index)
    values = {t.name: number(v, digits=4) for t, v in zip(fitted.form.terms, fitted.values, strict=True)}
    factor = FACTOR_TEXTS[fitted.force.closure.factor]
    filled = text.format(**values)
    return f"{factor} ({filled})" if factor and text != "0" else filled


def _phase(force: RecoveredForce) -> str:
    """Return the phase of the motion in which most of the force acts: while the string slides, while it does not, or both."""
    runs = motions(force.fit)
    s = runs.coordinate(force.closure.coordinate, force.closure.point)
    size = np.sqrt(sum(force.closure.profile(w, s) ** 2 for w in force.weights))
    share = float(size[runs.sliding].sum() / max(size.sum(), 1e-300))
    if force.closure.target == STRING:
        share = 1.0  # friction acts where the string slides
    if share > MOSTLY:
        return "while the string slides"
    return "while the string does not slide" if share < SELDOM else "while the string slides and while it does not"


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedFormula:
    """A formula that was refitted to the trajectories."""

    force: RecoveredForce
    """The force as radial basis functions, which the formula was fitted to."""
    form: FormulaFamily
    fit: Fit
    delta_bic: float
    """Decrease of the Bayesian information criterion from the declared model."""
    delta_bic_of_profile: float
    """The same of the radial basis functions that the formula was fitted to."""
    held_out: HeldOutTest | None = None
    """Held-out test of the formula; None: not made, since a better formula was accepted or its delta BIC is too far behind."""

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
        """Whether its delta BIC is larger than its basis functions', it leaves noise, and predicts as well as they do."""
        if self.delta_bic <= self.delta_bic_of_profile or self.held_out is None or not self.held_out.passes:
            return False
        if not check_residuals(self.fit).passes:
            return False
        scatter = [math.sqrt(2 / n) for n in self.held_out.counts]  # standard deviation of chi2 per value of n values
        rows = zip(self.held_out.chi2, self.force.held_out.chi2, scatter, strict=True)
        return all(own <= of_profile + s for own, of_profile, s in rows)


def refit(
    base: Fit,
    force: RecoveredForce,
    held_out: Sequence[tuple[TrialData, Sequence[FreeParameter]]],
) -> list[FittedFormula]:
    """Refit a force's formulas of lowest predicted BIC to the trajectories; return them, largest delta BIC first.

    Of those within `BIC_MARGIN` of the best, the first that is accepted on held-out data goes to the front.
    """
    predictions = predict_formulas(force, np.concatenate([d.sigma for d in base.problem.data]))[:MAX_REFITS]
    results = [_refit(base, prediction) for prediction in predictions]
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


def _refit(base: Fit, prediction: PredictedFormula) -> FittedFormula | None:
    """Refit one formula to the trajectories from its predicted values; None if the model cannot run."""
    problem = _problem(base, prediction)
    names = base.problem.names
    n_added = len(problem.free_parameters) - len(names)
    # The other parameters start where the fit with radial basis functions left them
    of_force = prediction.force.fit
    start = np.concatenate([of_force.x[[of_force.problem.names.index(n) for n in names]], np.zeros(n_added)])
    try:
        fit = minimise(problem, start)
    except FitError:
        return None
    delta_bic = base.cost - fit.cost - n_added * math.log(base.problem.count)
    return FittedFormula(
        force=prediction.force,
        form=prediction.form,
        fit=fit,
        delta_bic=delta_bic,
        delta_bic_of_profile=_delta_bic_of_profile(base, prediction.force),
    )


def _problem(base: Fit, prediction: PredictedFormula) -> Problem:
    """Return the declared model with the formula's parameters, which start at their predicted values."""
    p = base.problem
    study = FormulaStudy(
        **{f.name: getattr(p.study, f.name) for f in dataclasses.fields(Study)},
        closure_coefficients=functools.partial(_closure_coefficients, prediction),
        formula_parameters=tuple(PREFIX + t.name for t in prediction.form.terms),
        start_values=tuple(prediction.values.tolist()),
    )
    added = [_free_parameter(prediction, i, study) for i in range(len(prediction.values))]
    point = point_parameters(prediction.force.closure, tuple(t.name for t in study.trials))
    return Problem(study, p.data, (*p.free_parameters, *point, *added))


def _free_parameter(prediction: PredictedFormula, i: int, study: Study) -> FreeParameter:
    term, value, error = prediction.form.terms[i], float(prediction.values[i]), float(prediction.errors[i])
    bounds = (-1e6, 1e6)
    # The scale is the unit of the parameter in the fit; a tenth of the value is the least, lest a tiny predicted error set it.
    min_scale = 0.1 * abs(value)
    if term.power is None:
        width = float(prediction.values[1])
        # A place may be near zero, so that its own size is no scale; the width is
        min_scale = 0.1 * width
        bounds = (MIN_WIDTH * prediction.force.closure.spacing, 1e3 * width)
        if term.name == "place":
            low, high = prediction.force.coordinate_range
            bounds = (low - width, high + width)
    return FreeParameter(
        name=PREFIX + term.name,
        parameter=PREFIX + term.name,
        trials=tuple(t.name for t in study.trials),
        init_value=value,
        scale=max(error, min_scale, 1e-9),
        prior=WEAK_PRIOR,
        bounds=bounds,
    )


def _closure_coefficients(prediction: PredictedFormula, parameters: Sequence[float]) -> dict[str, float]:
    """Return the coefficients of the closure that stands for the formula with these values of its parameters."""
    values, form, force = np.asarray(parameters), prediction.form, prediction.force
    closure = form.placed(force.closure, values, *force.coordinate_range)
    sides = zip(TARGETS[closure.target], form.weights(values, closure), strict=True)
    weights = {weight_name(side, i): v for side, of_side in sides for i, v in enumerate(of_side.tolist())}
    return weights | closure.coefficients


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


class FormulaTerm(NamedTuple):
    """One parameter of a formula."""

    name: str
    power: int | None
    """Power of the coordinate that the parameter multiplies: its unit is the force's over the coordinate's to this power.

    None: it is a place or a width, in units of the coordinate.
    """


@dataclass(frozen=True, kw_only=True)
class FormulaKind:
    """Formulas that are sums of the same parts, each of which is multiplied by a parameter."""

    sums: Mapping[str, tuple[str, ...]]
    """Name of a formula -> its parts."""
    parts: Mapping[str, tuple[int, str, Callable[[Array, Array], Array]]]
    """Part -> power of the coordinate, text after its parameter, function of the coordinate s and z = (s - place) / width."""
    envelope: str = ""
    """Text after the sum of a force that is negligible except near a place, or changes there; '': there is no such place."""
    is_pulse: bool = False
    """Whether the force is negligible except near a place, so that basis functions as narrow as itself can stand for it."""


def _bell(s: Array, z: Array) -> Array:
    return np.asarray(np.exp(-0.5 * z * z))


KINDS = {
    "polynomial": FormulaKind(
        sums={"constant": ("0",), "proportional": ("1",), "line": ("0", "1"), "square": ("2",), "parabola": ("0", "1", "2")},
        parts={"0": (0, "", lambda s, z: s**0), "1": (1, " s", lambda s, z: s), "2": (2, " s^2", lambda s, z: s**2)},
    ),
    # The height is even about the place, a Gaussian; the swing is odd, as the pull of a body that is passed
    "pulse": FormulaKind(
        sums={"pulse": ("height",), "odd pulse": ("swing",), "pulse and odd pulse": ("height", "swing")},
        parts={"height": (0, "", _bell), "swing": (0, " z", lambda s, z: z * _bell(s, z))},
        envelope=" exp(-z^2 / 2), z = (s - {place}) / {width}",
        is_pulse=True,
    ),
    "step": FormulaKind(
        sums={"step": ("height",)},
        # Clipped: exp would overflow
        parts={"height": (0, "", lambda s, z: 1 / (1 + np.exp(-np.clip(z, -60, 60))))},
        envelope=" / (1 + exp(-(s - {place}) / {width}))",
    ),
}
"""Kinds of formulas: a formula has one place and one width on all sides, if it has any."""


@dataclass(frozen=True, kw_only=True)
class FormulaFamily:
    """Formulas of one kind and of one coordinate, for all directions (sides) of a closure."""

    kind: str
    """One of `KINDS`."""
    sides: tuple[str, ...]
    chosen: tuple[str, ...]
    """Name of the formula of every side; "nothing" leaves a side out."""

    @property
    def name(self) -> str:
        """Formula of every side in words."""
        if len(self.sides) == 1:
            return self.chosen[0]
        return ", ".join(f"{name} {side}" for side, name in zip(self.sides, self.chosen, strict=True))

    @property
    def has_place(self) -> bool:
        """Whether the first two terms are a place and a width."""
        return bool(KINDS[self.kind].envelope)

    def _parts_of(self, side: int) -> tuple[str, ...]:
        return KINDS[self.kind].sums.get(self.chosen[side], ())

    @cached_property
    def terms(self) -> tuple[FormulaTerm, ...]:
        """Its parameters: place and width, if it has them, then those of all sides."""
        place = (FormulaTerm("place", None), FormulaTerm("width", None)) if self.has_place else ()
        parts = KINDS[self.kind].parts
        of_sides = (
            FormulaTerm(f"{side}_{part}", parts[part][0]) for i, side in enumerate(self.sides) for part in self._parts_of(i)
        )
        return (*place, *of_sides)

    def profile(self, values: Array, s: Array) -> Array:
        """Return the force of every side with these values of the terms at coordinates ``s``, shape (sides, n)."""
        z = (s - values[0]) / values[1] if self.has_place else s
        amounts = iter(values[2:] if self.has_place else values)
        force = np.zeros((len(self.sides), len(s)), dtype=np.result_type(z, values))
        for i in range(len(self.sides)):
            for part in self._parts_of(i):
                force[i] += next(amounts) * KINDS[self.kind].parts[part][2](s, z)
        return force

    def text(self, side: int) -> str:
        """Return the formula of a side, with the names of its terms in braces."""
        kind, parts = KINDS[self.kind], self._parts_of(side)
        text = " + ".join(f"{{{self.sides[side]}_{part}}}{kind.parts[part][1]}" for part in parts)
        if not parts:
            return "0"
        return f"({text}){kind.envelope}" if len(parts) > 1 and kind.envelope else text + kind.envelope

    def placed(self, closure: Closure, values: Array, low: float, high: float) -> Closure:
        """Return a closure whose basis functions stand for the formula with these values, at coordinates from low to high."""
        if KINDS[self.kind].is_pulse:
            place, width = values[:2].tolist()
            # An absolute value has no complex step
            spacing = PULSE_SPACING * (width if width.real > 0 else -width)
            first_centre = place - 0.5 * (N_BASIS_FUNCTIONS - 1) * spacing
        else:
            spacing = (high - low) / (N_BASIS_FUNCTIONS - 1 - 2 * POLYNOMIAL_MARGIN)
            first_centre = low - POLYNOMIAL_MARGIN * spacing
        return dataclasses.replace(closure, first_centre=first_centre, spacing=spacing)

    def weights(self, values: Array, closure: Closure, margin: float | None = None) -> Array:
        """Return the weights of a closure that stands for the formula [N], shape (sides, N_BASIS_FUNCTIONS).

        Parameters
        ----------
        margin
            How many spacings the first and last centres lie outside the range in which the profile matters; negative: inside.
            None: as `placed` has them.
        """
        if margin is None:
            margin = -END_MARGIN if KINDS[self.kind].is_pulse else POLYNOMIAL_MARGIN
        points, projection = _projection_onto_basis(margin)
        return np.asarray(self.profile(values, closure.first_centre + closure.spacing * points) @ projection.T)


# There are three margins in all, and a fit of a formula projects its profile at every step
@cache
def _projection_onto_basis(margin: float) -> tuple[Array, Array]:
    """Return points in spacings from the first centre, and the matrix from a profile at them to the least-squares weights."""
    points = np.linspace(margin, N_BASIS_FUNCTIONS - 1 - margin, PROJECTION_POINTS)
    basis = np.exp(-0.5 * (points[:, None] - np.arange(N_BASIS_FUNCTIONS)) ** 2)
    # The small ridge keeps the system solvable where basis functions lie outside the points (a positive margin).
    return points, np.asarray(np.linalg.solve(basis.T @ basis + 1e-9 * np.eye(N_BASIS_FUNCTIONS), basis.T))


def forms(target: str) -> list[FormulaFamily]:
    """Return every formula family that a force on ``target`` may have."""
    sides = TARGETS[target]
    families = []
    for kind, known in KINDS.items():
        every = itertools.product(("nothing", *known.sums), repeat=len(sides))
        families += [FormulaFamily(kind=kind, sides=sides, chosen=c) for c in every if set(c) != {"nothing"}]
    return families


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedFormula:
    """A formula with the values and the cost that it would have if the model were linear about the fitted basis functions."""

    force: RecoveredForce
    form: FormulaFamily
    values: Array
    """Values of the terms [SI]."""
    errors: Array
    """Standard errors of the terms [SI]."""
    bic: float
    """Predicted Bayesian information criterion, the cost in units of the declared model's noise; lower is better."""


def predict_formulas(force: RecoveredForce, noise: Array) -> list[PredictedFormula]:
    """Return every formula with its best values by the linearised model, lowest BIC first.

    Parameters
    ----------
    noise
        Standard deviation of every measured value, which costs are in units of, shape (n,).
    """
    closure, problem = force.closure, force.fit.problem
    n_declared = len(problem.free_parameters) - len(closure.names)
    root, target, unexplained_cost = _reduced_least_squares(force, noise)
    scale = np.array([n.scale for n in problem.free_parameters[n_declared:]])

    def residuals_of(form: FormulaFamily) -> Callable[[Array], Array]:
        return lambda values: root @ (form.weights(values, closure, END_MARGIN).ravel() / scale) - target

    predictions = [_best_fit(force, form, residuals_of(form), unexplained_cost) for form in forms(closure.target)]
    return sorted((p for p in predictions if p), key=lambda p: p.bic)


def _reduced_least_squares(force: RecoveredForce, noise: Array) -> tuple[Array, Array, float]:
    """Reduce the linearised least-squares problem to the weights, all other parameters at their best (variable projection).

    Returns
    -------
    root, target, unexplained_cost
        The cost of weights w, in scales, is ``|root @ w - target|^2 + unexplained_cost``.
    """
    fit = force.fit
    count = len(noise)
    fit_sigma = np.concatenate([d.sigma for d in fit.problem.data])
    n_declared = len(fit.problem.free_parameters) - len(force.closure.names)
    with np.errstate(invalid="ignore"):
        ratio = np.where(np.isfinite(fit_sigma) & np.isfinite(noise), fit_sigma / noise, 0.0)
    # The last rows of the fit are the ridge (prior) of the weights, which no formula has: they are left out.
    rows = np.concatenate([ratio, np.ones(n_declared)])
    jacobian, residuals = fit.jacobian[: count + n_declared] * rows[:, None], fit.residuals[: count + n_declared] * rows
    basis, _ = np.linalg.qr(jacobian[:, :n_declared])
    unexplained = residuals - basis @ (basis.T @ residuals)
    weight_sensitivity = jacobian[:, n_declared:] - basis @ (basis.T @ jacobian[:, n_declared:])
    orthonormal, root = np.linalg.qr(weight_sensitivity)
    explained = orthonormal.T @ unexplained
    return root, np.asarray(explained + root @ fit.x[n_declared:]), float(unexplained @ unexplained - explained @ explained)


def _best_fit(
    force: RecoveredForce,
    form: FormulaFamily,
    reduced_residuals: Callable[[Array], Array],
    unexplained_cost: float,
) -> PredictedFormula | None:
    """Fit a formula's values to the reduced problem; None if they do not come out finite."""
    starts: list[list[tuple[float, ...]]] = [[()]]
    if form.has_place:
        places = np.linspace(*force.coordinate_range, N_BASIS_FUNCTIONS).tolist()
        starts = [[(place, width * force.closure.spacing) for place in places] for width in START_WIDTHS]
    fits = [min((_fit_linear(form, reduced_residuals, start) for start in each), key=lambda f: f[0]) for each in starts]
    if form.has_place:
        # Only from the best place for each width: the cost has minima at many places, and a fit from each would take long
        fits = [_fit_nonlinear(force, reduced_residuals, values) for _, values, _ in fits]
    cost, values, jacobian = min(fits, key=lambda f: f[0])
    if not np.all(np.isfinite(values)):
        return None
    errors = np.sqrt(np.maximum(np.diag(np.linalg.pinv(jacobian.T @ jacobian)), 0.0))
    bic = cost + unexplained_cost + len(values) * math.log(force.fit.problem.count)
    return PredictedFormula(force=force, form=form, values=values, errors=errors, bic=bic)


def _fit_nonlinear(
    force: RecoveredForce, reduced_residuals: Callable[[Array], Array], values: Array
) -> tuple[float, Array, Array]:
    """Return cost, values and Jacobian of the best fit of all terms, place and width included, from ``values``."""
    from scipy.optimize import least_squares

    spacing, (first, last) = force.closure.spacing, force.coordinate_range
    low, high = np.full(len(values), -np.inf), np.full(len(values), np.inf)
    # Of a pulse or step, the first two terms are its place and its width
    low[:2] = first, MIN_WIDTH * spacing
    high[:2] = last, last - first
    scale = np.concatenate([[spacing, spacing], np.maximum(np.abs(values[2:]), 1e-6)])
    fit = least_squares(reduced_residuals, values, x_scale=scale, bounds=(low, high), max_nfev=60)
    return 2 * float(fit.cost), fit.x, fit.jac  # SciPy's cost is half the sum of squares


def _fit_linear(
    form: FormulaFamily, reduced_residuals: Callable[[Array], Array], start: Sequence[float]
) -> tuple[float, Array, Array]:
    """Return cost, values and Jacobian of the best fit of the terms that enter linearly, at a given place and width."""
    linear = [i for i, t in enumerate(form.terms) if t.power is not None]
    values = np.concatenate([start, np.zeros(len(linear))])
    residuals_without = reduced_residuals(values)
    columns = np.stack([reduced_residuals(values + np.eye(len(values))[i]) - residuals_without for i in linear], axis=1)
    values[linear] = np.linalg.lstsq(columns, -residuals_without, rcond=1e-10)[0]
    return float(np.sum((residuals_without + columns @ values[linear]) ** 2)), values, columns
