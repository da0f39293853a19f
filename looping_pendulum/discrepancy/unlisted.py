"""Tell in plain data what an unlisted force is like: where it acts, on what, how much of it is sure, and a formula."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from looping_pendulum.discrepancy.discovery import SIGNIFICANT, TARGETS, Found
from looping_pendulum.discrepancy.simplify import simplify
from looping_pendulum.discrepancy.verdict import ForceProfile, OtherClosure, Unlisted
from looping_pendulum.reference_ode.effects import Kinematics
from looping_pendulum.reference_ode.transitions import Mode

POINTS = 60
"""At which a profile is told."""
UNITS = {"time": "s", "free_length": "m", "wrap_angle": "rad", "retreat_speed": "m/s", "across_speed": "m/s"}
TIMES = {"constant": "", "retreat_speed": "-u", "across_speed": "-w"}
"""What a factor writes before a formula: u away from the rod along the string, w across it."""

assert set(UNITS) <= set(Kinematics._fields)


def unlisted(found: Sequence[Found], before: float) -> Unlisted:
    """Tell of the best of ``found``; ``before``: largest chi2 per value of unseen data under the declared model."""
    best = found[0]
    profiles = tuple(_profile(best, i, side) for i, side in enumerate(TARGETS[best.closure.target]))
    return Unlisted(
        acts_on=best.closure.target,
        depends_on=best.closure.coordinate,
        multiplied_by=best.closure.factor,
        unit=UNITS[best.closure.coordinate],
        profiles=profiles,
        phase=_phase(best),
        gain=best.gain,
        held_out_before=before,
        held_out_after=best.unseen.worst,
        others=tuple(
            OtherClosure(
                acts_on=f.closure.target,
                depends_on=f.closure.coordinate,
                multiplied_by=f.closure.factor,
                gain=f.gain,
                held_out=f.unseen.worst,
            )
            for f in found[1:]
        ),
    )


def _profile(found: Found, index: int, side: str) -> ForceProfile:
    s = np.linspace(found.coordinates.min(), found.coordinates.max(), POINTS)
    value, error = found.closure.profile(found.weights[index], s), found.band(index, s)
    sure = s[np.abs(value) > SIGNIFICANT * error]
    formula = simplify(found, index)
    factor = TIMES[found.closure.factor]
    text = formula.text.format(*(f"{n:.4g}" for n in formula.numbers))
    return ForceProfile(
        side=side,
        coordinate=tuple(s.tolist()),
        value=tuple(value.tolist()),
        error=tuple(error.tolist()),
        largest=float(value[np.argmax(np.abs(value))]),
        largest_at=float(s[np.argmax(np.abs(value))]),
        sure_from=float(sure.min()) if sure.size else None,
        sure_to=float(sure.max()) if sure.size else None,
        form=formula.form,
        formula=f"{factor} ({text})" if factor and formula.form != "nothing" else text,
        numbers=formula.numbers,
        errors=formula.errors,
        misfit=formula.misfit,
    )


def _phase(found: Found) -> str:
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
