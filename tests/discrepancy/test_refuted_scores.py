"""A score is a reason to try an effect; whether the model lacks it is for the refit and for held-out data to say."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from looping_pendulum.discrepancy.listed import candidate_model
from looping_pendulum.discrepancy.listed.attribution import MIN_DELTA_BIC
from looping_pendulum.discrepancy.listed.candidate_model import CandidateModel
from looping_pendulum.discrepancy.listed.screening import MAX_NULL_SCORE
from looping_pendulum.discrepancy.search import Search

NO_TESTS = SimpleNamespace(results=())
HIGH = MAX_NULL_SCORE + 0.2


def model_with_score(monkeypatch, score, delta_bic, **refused):
    """A model that passes all other tests; the refit with the one candidate has this delta BIC."""
    monkeypatch.setattr(candidate_model, "refit", lambda fit, screened: SimpleNamespace(delta_bic=delta_bic))
    screened = SimpleNamespace(candidate=SimpleNamespace(name="scale"), score=score)
    return CandidateModel(fit=None, added=(), tests=NO_TESTS, held_out=NO_TESTS, screening=lambda: (screened,), **refused)


@pytest.mark.parametrize(
    ("score", "delta_bic", "failed"),
    [
        (HIGH, MIN_DELTA_BIC, ("the residuals look like scale",)),
        (-HIGH, MIN_DELTA_BIC, ("the residuals look like scale",)),
        (HIGH, MIN_DELTA_BIC - 1, ()),
        (MAX_NULL_SCORE - 0.1, 100.0, ()),
    ],
    ids=["evidence", "of either sign", "too little evidence", "low score"],
)
def test_a_score_fails_a_model_with_the_evidence_by_which_its_effect_would_be_added(monkeypatch, score, delta_bic, failed):
    """A clean blind study had a score of 4.08, and a delta BIC of 9.1: nothing could be added, and it did not pass."""
    assert model_with_score(monkeypatch, score, delta_bic).failed_tests == failed


def judged(passes):
    return SimpleNamespace(other_tests=(SimpleNamespace(passes=passes),))


@pytest.mark.parametrize(("passes", "failed"), [(False, ()), (True, ("the residuals look like scale",))])
def test_an_effect_that_held_out_data_refuse_does_not_fail_the_declared_model(monkeypatch, passes, failed):
    """In a clean blind study a scale of 0.995 had a score of 4.18, and made held-out data less likely by -2 ln L = 11.6."""
    model = model_with_score(monkeypatch, HIGH, 10.3)
    search = SimpleNamespace(declared_model=model, white_rounds={0: (model, [], {"scale": judged(passes)})})
    Search.withdraw_refuted_scores(search)
    assert search.declared_model.failed_tests == failed
    (score,) = search.declared_model.test_results
    assert score.statistic.endswith("not confirm") is not bool(failed)


def test_another_failed_test_stands(monkeypatch):
    monkeypatch.setattr(candidate_model, "refit", lambda fit, screened: SimpleNamespace(delta_bic=20.0))
    pattern = SimpleNamespace(passes=False, failure="the residuals still have a pattern")
    screened = SimpleNamespace(candidate=SimpleNamespace(name="scale"), score=HIGH)
    model = CandidateModel(
        fit=None, added=(), tests=SimpleNamespace(results=(pattern,)), held_out=NO_TESTS, screening=lambda: (screened,)
    )
    search = SimpleNamespace(declared_model=model, white_rounds={0: (model, [], {"scale": judged(False)})})
    Search.withdraw_refuted_scores(search)
    assert "the residuals still have a pattern" in search.declared_model.failed_tests
