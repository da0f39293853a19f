"""Record a round of the search: which candidates were tried, how well they did, and why those that do not pass do not."""

from __future__ import annotations

from collections.abc import Sequence

from looping_pendulum.discrepancy.fit.model_test import ModelTest
from looping_pendulum.discrepancy.listed.attribution import MIN_DELTA_BIC, Refit
from looping_pendulum.discrepancy.listed.candidate_model import CandidateModel
from looping_pendulum.discrepancy.result import RankedCandidate, Round

MIN_DELTA_BIC_MARGIN = 10.0
"""Delta BIC by which an effect must exceed the next candidate's; in trials on blind data all wrong winners were nearer."""


def wander_test(delta_bic: float) -> ModelTest:
    """Test the delta BIC that an effect has left beside errors of the points that last longer than a frame."""
    return ModelTest(
        subject="the effect, beside errors of the tracked points that last longer than a frame",
        statistic="delta BIC",
        value=delta_bic,
        limit=MIN_DELTA_BIC,
        limit_is_lower=True,
        passes=delta_bic >= MIN_DELTA_BIC,
        failure="a tracker that wanders a little explains about as much",
    )


def _passes(r: Refit, model: CandidateModel | None) -> bool:
    return model is not None and r.within_bounds and r.delta_bic >= MIN_DELTA_BIC and not model.failed_tests


def _reason(r: Refit, model: CandidateModel | None, best: Refit, *, one_passes: bool) -> str:
    """Return in words why a refit does not pass; empty if it does. ``model`` is None if the refit was not tested."""
    if not r.within_bounds and r.candidate.bounds_reason:
        return f"its value would be impossible: {r.candidate.bounds_reason}"
    if r.delta_bic < MIN_DELTA_BIC and model is not None and one_passes:
        return f"it explains less than {best.candidate.name}, but these data do not rule it out"
    if r.delta_bic < MIN_DELTA_BIC and model is not None and not model.failed_tests:
        return "it explains too little to be more than chance, but the model with it predicts as well as an unlisted force"
    if r.delta_bic < MIN_DELTA_BIC:
        return "it explains too little to be more than chance"
    if model is None and r is best:
        return "it explains less than the effect in its place"
    if model is None:
        return f"it explains less than {best.candidate.name}"
    if not r.within_bounds:
        return "its value would be impossible: it is on a bound of what physics allows"
    return "; ".join(model.failed_tests)


def record_round(
    current: CandidateModel, refits: Sequence[Refit], judged: dict[str, CandidateModel], *, correlated_noise: bool
) -> Round:
    """Return the record of a round: the refits, best first, then the candidates that were only screened."""
    ranking = []
    one_passes = any(_passes(r, judged.get(r.candidate.name)) for r in refits)
    for r in refits:
        c, model = r.candidate, judged.get(r.candidate.name)
        # Of an effect that is only not ruled out no test is asked
        tests = model.test_results if model and not (one_passes and r.delta_bic < MIN_DELTA_BIC) else ()
        ranking.append(
            RankedCandidate(
                name=c.name,
                kind=c.kind,
                score=r.screened.score,
                delta_bic=r.delta_bic,
                value=r.value,
                error=r.error,
                unit=c.unit,
                held_out_chi2=model.held_out.worst if model else None,
                passes=_passes(r, model),
                reason=_reason(r, model, refits[0], one_passes=one_passes),
                tests=tests,
                held_by=r.screened.held_by if r.within_bounds else c.bounds_reason,
            )
        )
    refitted = {r.name for r in ranking}
    ranking += [
        RankedCandidate(
            name=s.candidate.name,
            kind=s.candidate.kind,
            score=s.score,
            delta_bic=None,
            value=None,
            error=None,
            held_out_chi2=None,
            passes=False,
            reason=(
                f"not refitted, as its value would be impossible: {s.held_by}"
                if s.held_by
                else "not refitted: the residuals look more like others"
            ),
            held_by=s.held_by,
        )
        for s in current.remaining
        if s.candidate.name not in refitted
    ]
    return Round(
        added_before=current.names,
        ranking=tuple(ranking),
        correlated_noise=correlated_noise,
        best=ranking[0].name if refits else "",
        runner_up=ranking[1].name if len(refits) > 1 else "",
        margin=refits[0].delta_bic - refits[1].delta_bic if len(refits) > 1 else None,
    )
