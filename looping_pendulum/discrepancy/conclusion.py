"""What a search concludes: the verdict, the model that it speaks of, and the explanations that the data do not tell apart."""

from __future__ import annotations

from looping_pendulum.discrepancy.fit.residual import check_residuals
from looping_pendulum.discrepancy.listed.candidate_model import CandidateModel
from looping_pendulum.discrepancy.result import Verdict
from looping_pendulum.discrepancy.search import Search


def conclude(search: Search, interrupted: bool) -> tuple[Verdict, CandidateModel, tuple[CandidateModel, ...]]:
    """Return the verdict, the repaired model, and the tied models if the verdict is ambiguous."""
    declared, accepted, forces = search.declared_model, search.accepted_models, search.forces
    assert declared is not None
    if interrupted:
        return Verdict.INTERRUPTED, accepted[0] if accepted else declared, ()
    if accepted:
        # Beside accepted models, a force is one that explains held-out data as well
        if len(accepted) > 1 or forces:
            return Verdict.AMBIGUOUS, accepted[0], accepted
        return Verdict.IDENTIFIED, accepted[0], ()
    if not declared.failed_tests:
        return Verdict.NO_MISSING_EFFECT, declared, ()
    if forces:
        return Verdict.UNLISTED, _with_unlisted_force(search), ()
    return Verdict.UNEXPLAINED, declared, ()


def _with_unlisted_force(search: Search) -> CandidateModel:
    """Return the model with the best unlisted force, as its formula if one explains held-out data as well."""
    fit, held_out = search.forces[0].fit, search.forces[0].held_out
    for formula in search.formulas[:1]:
        if formula.accepted and formula.held_out:
            fit, held_out = formula.fit, formula.held_out
    # The screening is `tuple`, which returns no candidates: nothing is added to this model any more
    return CandidateModel(fit=fit, added=search.beside_forces, tests=check_residuals(fit), held_out=held_out, screening=tuple)
