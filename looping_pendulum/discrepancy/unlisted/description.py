"""Tell in plain data what an unlisted force is like: where it acts, on what, how much of it is sure, and a formula."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from looping_pendulum.discrepancy.result import ForceProfile, Formula, FormulaParameter, OtherClosure, Unlisted
from looping_pendulum.discrepancy.unlisted.discovery import SIGNIFICANT, TARGETS, RecoveredForce
from looping_pendulum.discrepancy.unlisted.formula import FittedFormula
from looping_pendulum.discrepancy.unlisted.simplify import FormulaTerm
from looping_pendulum.pages.numbers import number
from looping_pendulum.reference_ode.effects import Kinematics
from looping_pendulum.reference_ode.transitions import Mode

POINTS = 60
"""At which a profile is told."""
UNITS = {"time": "s", "free_length": "m", "wrap_angle": "rad", "retreat_speed": "m/s", "across_speed": "m/s"}
TIMES = {"constant": "", "retreat_speed": "-u", "across_speed": "-w"}
"""What a factor writes before a formula: u away from the rod along the string, w across it."""

assert set(UNITS) <= set(Kinematics._fields)


BUMPS_ONLY = "no simple formula; twelve bumps"
"""What stands in a formula's place where none explains the data."""


def unlisted(found: Sequence[RecoveredForce], written: Sequence[FittedFormula], before: float) -> Unlisted:
    """Tell of an unlisted force.

    Parameters
    ----------
    found
        As bumps, the best first.
    written
        As formulas refitted by trajectory; if the first stands, it and its own bumps are told of.
    before
        Largest chi2 per value of unseen data under the declared model.
    """
    formula = written[0] if written and written[0].stands else None
    best = formula.found if formula else found[0]
    unseen = formula.unseen if formula and formula.unseen else best.unseen
    return Unlisted(
        acts_on=best.closure.target,
        depends_on=best.closure.coordinate,
        multiplied_by=best.closure.factor,
        unit=UNITS[best.closure.coordinate],
        profiles=tuple(_profile(best, formula, i) for i in range(len(TARGETS[best.closure.target]))),
        formula=_formula(formula) if formula else None,
        formulas=tuple(_formula(w) for w in written),
        phase=_phase(best),
        gain=best.gain,
        held_out_before=before,
        held_out_after=unseen.worst,
        others=tuple(
            OtherClosure(
                acts_on=f.closure.target,
                depends_on=f.closure.coordinate,
                multiplied_by=f.closure.factor,
                gain=f.gain,
                held_out=f.unseen.worst,
            )
            for f in found
            if f is not best
        ),
    )


def _formula(written: FittedFormula) -> Formula:
    closure = written.found.closure
    rows = zip(written.form.terms, written.q, written.errors, strict=True)
    return Formula(
        form=written.form.name,
        depends_on=closure.coordinate,
        multiplied_by=closure.factor,
        numbers=tuple(
            FormulaParameter(
                name=t.name, value=float(v), error=float(e), unit=_unit(t, closure.factor, UNITS[closure.coordinate])
            )
            for t, v, e in rows
        ),
        gain=written.gain,
        gain_of_bumps=written.gain_of_bumps,
        held_out=written.unseen.worst if written.unseen else None,
        held_out_of_bumps=written.found.unseen.worst,
        stands=written.stands,
    )


def _unit(term: FormulaTerm, factor: str, coordinate: str) -> str:
    if term.of_coordinate:
        return coordinate
    force = "N" if factor == "constant" else "N s/m"
    per = f"({coordinate})" if "/" in coordinate else coordinate
    return force if not term.power else f"{force}/{per}" + (f"^{term.power}" if term.power > 1 else "")


def _profile(found: RecoveredForce, formula: FittedFormula | None, index: int) -> ForceProfile:
    s = np.linspace(found.coordinates.min(), found.coordinates.max(), POINTS)
    value, error = found.closure.profile(found.weights[index], s), found.band(index, s)
    sure = s[np.abs(value) > SIGNIFICANT * error]
    written = formula.form.profile(formula.q, s)[index] if formula else None
    told = value if written is None else written
    return ForceProfile(
        side=TARGETS[found.closure.target][index],
        coordinate=tuple(s.tolist()),
        value=tuple(value.tolist()),
        error=tuple(error.tolist()),
        largest=float(told[np.argmax(np.abs(told))]),
        largest_at=float(s[np.argmax(np.abs(told))]),
        sure_from=float(sure.min()) if sure.size else None,
        sure_to=float(sure.max()) if sure.size else None,
        formula=_text(formula, index) if formula else BUMPS_ONLY,
        written=None if written is None else tuple(written.tolist()),
    )


def _text(written: FittedFormula, index: int) -> str:
    """Formula of one side, its numbers filled in."""
    text = written.form.texts[index]
    values = {t.name: number(v, digits=4) for t, v in zip(written.form.terms, written.q, strict=True)}
    factor = TIMES[written.found.closure.factor]
    filled = text.format(**values)
    return f"{factor} ({filled})" if factor and text != "0" else filled


def _phase(found: RecoveredForce) -> str:
    """In which phase most of the force's push comes: "while the string slides", "while it sticks" or "both"."""
    problem = found.fit.problem
    modes = np.concatenate([problem.run(found.fit.x, k).mode for k in range(len(problem.data))])
    size = np.sqrt(sum(found.closure.profile(w, found.coordinates) ** 2 for w in found.weights))
    sliding = np.isin(modes, (Mode.SLIDING_DOWN, Mode.SLIDING_UP))
    count = min(len(sliding), len(size))
    share = float(size[:count][sliding[:count]].sum() / max(size[:count].sum(), 1e-300))
    if share > 0.8:
        return "while the string slides"
    return "while the string does not slide" if share < 0.2 else "while the string slides and while it does not"
