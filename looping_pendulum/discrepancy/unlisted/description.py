"""Describe an unlisted force as plain data: where it acts, what it depends on, where it is significant, and its formula."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from looping_pendulum.discrepancy.result import ForceProfile, Formula, FormulaParameter, Unlisted, value_unit
from looping_pendulum.discrepancy.unlisted.closures import STRING, TARGETS, Closure
from looping_pendulum.discrepancy.unlisted.force import RecoveredForce
from looping_pendulum.discrepancy.unlisted.formula import FittedFormula
from looping_pendulum.discrepancy.unlisted.motions import motions
from looping_pendulum.discrepancy.unlisted.simplify import FormulaTerm
from looping_pendulum.pages.numbers import number
from looping_pendulum.reference_ode.effects.closure import COORDINATES

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
            FormulaParameter(
                name=t.name, value=float(v), error=float(e), unit=_unit(t, closure, COORDINATE_UNITS[closure.coordinate])
            )
            for t, v, e in rows
        ),
        delta_bic=fitted.delta_bic,
        delta_bic_of_profile=fitted.delta_bic_of_profile,
        held_out_chi2=fitted.held_out.worst if fitted.held_out else None,
        held_out_chi2_of_profile=fitted.force.held_out.worst,
        accepted=fitted.accepted,
    )


def _unit(term: FormulaTerm, closure: Closure, coordinate: str) -> str:
    if term.of_coordinate:
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
    text = fitted.form.texts[index]
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
