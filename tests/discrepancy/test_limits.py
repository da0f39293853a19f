"""The limits by which the search decides, each at its edge, on made-up fits: no run is needed."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.discrepancy.listed.held_out import check_held_out, loss_test
from looping_pendulum.discrepancy.search import Search
from tests.discrepancy.expected import DECISIVE


def a_refit(name, delta_bic):
    candidate = SimpleNamespace(unit="", name=name, kind="a force", companions=())
    screened = SimpleNamespace(candidate=candidate, score=20.0, amplitude=1.0, held_by="")
    return SimpleNamespace(
        candidate=candidate, screened=screened, delta_bic=delta_bic, within_bounds=True, value=1.0, error=0.1
    )


def one_round(delta_bics, failed=()):
    """Return a search after a round in which the candidates a, b, ... have these delta BIC; those ``failed`` pass no test."""
    refits = [a_refit(name, delta_bic) for name, delta_bic in zip("abcdef", delta_bics, strict=False)]
    search = Search(SimpleNamespace(), 0, lambda what, share: None)
    search.refit_candidates = lambda current, share: refits
    search.judge_refits = lambda current, near, share, without=None: {
        r.candidate.name: SimpleNamespace(
            names=(r.candidate.name,),
            failed_tests=("it fails",) if r.candidate.name in failed else (),
            test_results=(),
            held_out=SimpleNamespace(worst=1.0),
        )
        for r in near
    }
    search.run_round(DECLARED, 0.0)
    return search


DECLARED = SimpleNamespace(names=(), added=(), fit=None, remaining=(), held_out=None)


def screened(name, score):
    return SimpleNamespace(candidate=SimpleNamespace(name=name, kind="a force"), score=score, amplitude=1.0, held_by="")


@pytest.mark.parametrize(("score", "found"), [(10.0, True), (6.0, False)])
def test_where_none_passes_further_candidates_are_refitted_whose_score_is_not_far_below_the_best(monkeypatch, score, found):
    search = one_round([150.0, 100.0], failed=("a", "b"))
    assert not search.accepted_models

    def refits(fit, chosen, known, workers):
        assert max(r.delta_bic for r in known.values()) == 150.0, "what cannot beat the best so far gets no second start"
        return [a_refit(s.candidate.name, 750.0) for s in chosen]

    monkeypatch.setattr("looping_pendulum.discrepancy.rounds.refits", refits)
    remaining = [screened("a", 20.0), screened("b", 19.0), screened("late", score)]
    model = search.run_wider_round(SimpleNamespace(**vars(DECLARED) | {"remaining": remaining}), 0.0)
    assert (model is not None) is found
    assert [m.names[0] for m in search.accepted_models] == (["late"] if found else [])
    (record,) = search.rounds  # the wider round takes the place of the first
    assert record.best == ("late" if found else "a")


@pytest.mark.parametrize(("rise", "passes"), [(1.9, True), (2.1, False), (-50.0, True)])
def test_an_effect_must_not_make_held_out_data_less_likely(rise, passes):
    without, with_it = (SimpleNamespace(minus_twice_log_likelihood=value) for value in (1000.0, 1000.0 + rise))
    assert loss_test(without, with_it).passes is passes


@pytest.mark.parametrize(
    ("delta_bic", "enough"), [(DECISIVE + 0.1, True), (DECISIVE - 0.1, False), (0.5, False), (-4.0, False)]
)
def test_a_candidate_is_added_if_its_delta_bic_decides(delta_bic, enough):
    search = one_round([delta_bic])
    assert bool(search.accepted_models) is enough
    (ranked,) = search.rounds[0].ranking
    assert ranked.passes is enough
    assert ranked.reason == ("" if enough else "it explains too little to be more than chance")


@pytest.mark.parametrize(("behind", "tied"), [(0.4, True), (DECISIVE - 0.1, True), (DECISIVE + 0.1, False), (40.0, False)])
def test_a_rival_is_ruled_out_if_the_difference_decides(behind, tied):
    search = one_round([100.0, 100.0 - behind])
    assert [m.names[0] for m in search.accepted_models] == (["a", "b"] if tied else ["a"])
    assert search.rounds[0].margin == pytest.approx(behind)


@pytest.mark.parametrize(("failed", "explanations"), [((), ["a", "b"]), (("b",), ["a", "b"]), (("a",), [])])
def test_a_rival_that_alone_would_be_chance_is_not_ruled_out_by_a_difference_that_does_not_decide(failed, explanations):
    """The best says that something is missing; odds of e^3 to 1 do not say which of the two it is."""
    search = one_round([DECISIVE + 5.0, DECISIVE - 1.0, DECISIVE - 5.1], failed)
    assert [m.names[0] for m in search.accepted_models] == explanations
    best, weak, out = search.rounds[0].ranking
    chance = "it explains too little to be more than chance"
    assert weak.reason == ("it explains less than a, but these data do not rule it out" if explanations else chance)
    assert (best.passes, weak.passes, out.passes, out.reason) == (bool(explanations), False, False, chance)


def held_out(chi2_per_value, count, monkeypatch):
    """What is said of a held-out trial of marks that a fit leaves with this chi2 per value."""
    data = SimpleNamespace(channels=(), trial=SimpleNamespace(name="six"))
    marks = SimpleNamespace(channels=("light_x", "light_y"))
    fit = SimpleNamespace(cost=chi2_per_value * count, problem=SimpleNamespace(count=count, data=[marks]))
    monkeypatch.setattr("looping_pendulum.discrepancy.listed.held_out._fit_held_out_trial", lambda *_: fit)
    monkeypatch.setattr("looping_pendulum.discrepancy.listed.held_out.rms", lambda *_: 1e-3)
    return check_held_out(fit, [(data, ())]).passes


@pytest.mark.parametrize("count", [1000, 4000, 100_000])
def test_held_out_data_are_explained_up_to_what_clean_ones_reach(count, monkeypatch):
    # 120 clean studies of about a thousand values reached 1.072. A signature of a third of the noise's size adds 1/9 to that of
    # noise alone, 1, and must not be called explained.
    assert held_out(1.072, count, monkeypatch)
    assert not held_out(1 + 1 / 9, count, monkeypatch)


@pytest.mark.parametrize("count", [25, 100, 400])
def test_few_values_are_granted_two_and_a_half_standard_deviations(count, monkeypatch):
    # Oracle: chi2 per value of noise has the standard deviation sqrt(2 / n); above 2.47 of them is 0.7 % of it.
    limit = 1 + 2.475 * math.sqrt(2 / count)
    assert held_out(limit - 1e-3, count, monkeypatch)
    assert not held_out(limit + 1e-3, count, monkeypatch)


def test_nan_explains_nothing(monkeypatch):
    assert not held_out(np.nan, 1000, monkeypatch)
