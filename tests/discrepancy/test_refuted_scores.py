"""A score is a reason to try an effect; whether the model lacks it is for the refit and for held-out data to say."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from looping_pendulum.discrepancy.listed import candidate_model
from looping_pendulum.discrepancy.listed.attribution import MIN_DELTA_BIC
from looping_pendulum.discrepancy.listed.candidate_model import CandidateModel
from looping_pendulum.discrepancy.listed.screening import MAX_NULL_SCORE
from looping_pendulum.discrepancy.rounds import MAX_CHANCE_DELTA_BIC
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


def search_with(model, delta_bic, refused, correlated_base=None):
    """A search that has tried the scale beside the declared model."""
    ranking = (SimpleNamespace(name="scale", delta_bic=delta_bic), SimpleNamespace(name="tilt", delta_bic=None))
    beside, later = (SimpleNamespace(added_before=added, ranking=ranking) for added in ((), ("scale",)))
    tested = SimpleNamespace(other_tests=(SimpleNamespace(passes=not refused),))
    return SimpleNamespace(
        declared_model=model, correlated_base=correlated_base, rounds=[beside, later], tested_beside_declared={"scale": tested}
    )


@pytest.mark.parametrize(
    ("delta_bic", "refused", "passes"),
    [(10.3, True, True), (10.3, False, False), (MAX_CHANCE_DELTA_BIC + 1, True, False)],
    ids=["refused", "not refused", "too much for chance"],
)
def test_an_effect_that_held_out_data_refuse_does_not_fail_the_declared_model(monkeypatch, delta_bic, refused, passes):
    """In a clean blind study a scale of 0.995 had a score of 4.18, and made held-out data less likely by -2 ln L = 11.6."""
    search = search_with(model_with_score(monkeypatch, HIGH, delta_bic), delta_bic, refused)
    Search.withdraw_refuted_scores(search)
    assert search.declared_model.failed_tests == (() if passes else ("the residuals look like scale",))
    (score,) = search.declared_model.test_results
    assert score.statistic.endswith("not confirm") is passes


@pytest.mark.parametrize("refused", [True, False])
def test_the_same_holds_beside_errors_that_last_longer_than_a_frame(monkeypatch, refused):
    """A clean study of a tracker that wanders passed all tests with its errors, but foreshortening had a delta BIC of 12.7."""
    white, correlated = (model_with_score(monkeypatch, score, 12.7) for score in (HIGH, 1.0))
    search = search_with(white, 12.7, refused, correlated)
    Search.withdraw_refuted_scores(search)
    assert bool(search.declared_model.failed_tests) is not refused


def test_another_failed_test_stands(monkeypatch):
    monkeypatch.setattr(candidate_model, "refit", lambda fit, screened: SimpleNamespace(delta_bic=20.0))
    pattern = SimpleNamespace(passes=False, failure="the residuals still have a pattern")
    screened = SimpleNamespace(candidate=SimpleNamespace(name="scale"), score=HIGH)
    model = CandidateModel(
        fit=None, added=(), tests=SimpleNamespace(results=(pattern,)), held_out=NO_TESTS, screening=lambda: (screened,)
    )
    search = search_with(model, 12.0, refused=True)
    Search.withdraw_refuted_scores(search)
    assert "the residuals still have a pattern" in search.declared_model.failed_tests
