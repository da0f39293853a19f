"""Which candidates are refitted: the best by score, and what acts on the same as the best of them and may explain as much."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from looping_pendulum.discrepancy import rounds
from looping_pendulum.discrepancy.rounds import MAX_REFITS, Rounds


def screened(name, score, acts_on, acts_at_fit=True):
    candidate = SimpleNamespace(name=name, acts_on=acts_on)
    return SimpleNamespace(candidate=candidate, score=score, amplitude=1.0, acts_at_fit=acts_at_fit)


REMAINING = [
    screened("wind", 30.0, "light mass"),
    *(screened(f"view {i}", 28.0 - i, "camera") for i in range(MAX_REFITS - 1)),
    screened("tilt", 20.0, "camera"),
    screened("push", 19.0, "light mass"),
    screened("drag", 12.0, "light mass"),
    screened("weak", 4.0, "light mass"),
]


@pytest.mark.parametrize(("gain", "more"), [(0.01, []), (1.0, ["push"]), (2.0, ["push", "drag", "weak"])])
def test_what_acts_on_the_same_is_refitted_if_it_may_explain_as_much(monkeypatch, gain, more):
    """``gain``: decrease of chi2 by the best over what its score predicts; 0.01: too little to be added.

    A string that rubs on itself was not refitted, and friction per wrap angle was named in its place. Where the scores say
    little any may explain as much: "weak" is below a sixth of the best score.
    """
    refitted = []

    def refits(base, chosen, known, *rest):
        refitted.extend(s.candidate.name for s in chosen if s.candidate.name not in known)
        return [
            SimpleNamespace(
                candidate=s.candidate, screened=s, chi2_decrease=gain * s.score**2, delta_bic=gain * s.score**2 - 10.0
            )
            for s in chosen
        ]

    monkeypatch.setattr(rounds, "refits", refits)
    current = SimpleNamespace(remaining=REMAINING, refitted={}, fit=None, added=())
    search = SimpleNamespace(correlated_base=None, workers=None, declared_model=None, report_progress=lambda *_: None)
    results = Rounds.refit_candidates(search, current, 0.0)
    assert refitted == [s.candidate.name for s in REMAINING[:MAX_REFITS]] + more
    assert len(results) == len(refitted)


def test_what_does_nothing_at_the_fit_is_refitted_whatever_its_score(monkeypatch):
    """Of an attitude drag beside a drag of zero the score was 0.7, its refit had the largest delta BIC (57)."""
    refitted = []
    monkeypatch.setattr(rounds, "refits", lambda base, chosen, *rest: refitted.extend(s.candidate.name for s in chosen) or [])
    remaining = [*REMAINING, screened("attitude_drag", 0.7, "light mass", acts_at_fit=False)]
    current = SimpleNamespace(remaining=remaining, refitted={}, fit=None, added=())
    search = SimpleNamespace(correlated_base=None, workers=None, declared_model=None, report_progress=lambda *_: None)
    assert not Rounds.refit_candidates(search, current, 0.0)
    assert refitted == [*(s.candidate.name for s in REMAINING[:MAX_REFITS]), "attitude_drag"]
