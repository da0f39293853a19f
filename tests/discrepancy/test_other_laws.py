"""Which other laws than the unlisted force that is named the data do not exclude, and how the report says it."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import pytest

from looping_pendulum.discrepancy.report import unlisted_report
from looping_pendulum.discrepancy.result import STRING_ON_ROD, OtherClosure, Verdict
from looping_pendulum.discrepancy.unlisted import description, discovery
from looping_pendulum.discrepancy.unlisted.discovery import LIKELIHOOD_MARGIN, RecoveredForce
from looping_pendulum.discrepancy.verdict_sentence import verdict_notes
from tests.pages.made_up import identification


def law(target, coordinate):
    return SimpleNamespace(target=target, coordinate=coordinate, factor="constant")


def screened(target, coordinate, evidence):
    return SimpleNamespace(closure=law(target, coordinate), twice_log_bayes_factor=evidence)


FRICTION, PLACE = law(STRING_ON_ROD, "wrap_angle"), law("heavy mass", "hanging_length")
SPEED, TIME = law("heavy mass", "retreat_speed"), law("heavy mass", "time")


def recovered(evidence, passes, of=TIME, gained=0.0):
    held_out = SimpleNamespace(passes=passes, worst=1.2, minus_twice_log_predictive_density=-500.0 - gained)
    return RecoveredForce(closure=of, fit=None, twice_log_bayes_factor=evidence, held_out=held_out, coordinates=None)


def test_what_was_left_out_is_what_the_screening_has_as_likely_as_the_best_once_for_each_law():
    best = screened("light mass", "free_length", 100.0)
    ranked = [
        best,
        screened("light mass", "time", 99.0),
        screened("light mass", "time", 98.0),
        screened("heavy mass", "time", 100.0 - LIKELIHOOD_MARGIN),
        screened("heavy mass", "retreat_speed", 99.9 - LIKELIHOOD_MARGIN),
    ]
    assert discovery._as_likely(ranked, [best]) == [ranked[1], ranked[3]]
    assert discovery._as_likely([], []) == []


@pytest.mark.parametrize(
    ("likelier", "simpler", "margin"),
    [(PLACE, FRICTION, 10.0), (SPEED, PLACE, 2.0), (TIME, SPEED, 2.0), (TIME, FRICTION, 14.0)],
)
def test_a_law_that_is_less_simple_comes_first_if_all_data_together_make_it_likelier_by_its_cost(likelier, simpler, margin):
    """What the training data say counts as much as what the held-out ones do."""
    other = recovered(100.0, True, simpler)
    for evidence, gained in ((margin, 0.0), (0.0, margin), (margin - 30.0, 30.0)):
        first = recovered(100.5 + evidence, True, likelier, gained)
        second = recovered(99.5 + evidence, True, likelier, gained)
        assert discovery.by_preference([second, other, first]) == [first, other, second]
    refuted = recovered(1000.0, False, likelier)
    assert discovery.by_preference([refuted, other]) == [other, refuted]


def test_what_is_refitted_is_one_closure_of_each_body_and_coordinate_and_the_best_of_the_training_trials():
    ranked = [
        screened("light mass", "time", 100.0),
        screened("light mass, across the string", "time", 99.0),
        screened("light mass", "free_length", 98.0),
        screened("light mass, upward", "height", 97.0),
        screened("light mass", "wrap_angle", 96.0),
        screened(STRING_ON_ROD, "wrap_angle", 95.0),
        screened("heavy mass", "time", 60.0),
    ]
    one_direction = screened("light mass, across the string", "time", 109.0)
    assert discovery._different(ranked, always=ranked[1]) == [ranked[0], ranked[2], ranked[3], ranked[5]]
    assert discovery._different(ranked, always=ranked[4]) == [ranked[0], ranked[2], ranked[3], ranked[5], ranked[4]]
    # A force in both directions stands for one in one, unless that is likelier by the margin
    assert discovery._different([one_direction, *ranked])[0] is ranked[0]
    one_direction.twice_log_bayes_factor = 111.0
    assert discovery._different([one_direction, *ranked])[0] is one_direction


@pytest.mark.parametrize(
    ("evidence", "passes", "excluded"),
    [
        (100.0 - LIKELIHOOD_MARGIN, True, False),
        (100.0 - LIKELIHOOD_MARGIN, False, True),
        (99.0 - LIKELIHOOD_MARGIN, True, True),
    ],
    ids=["as likely", "fails held-out data", "less likely"],
)
def test_a_law_is_excluded_by_held_out_data_or_by_odds_of_148_to_1(evidence, passes, excluded):
    """Before, it took both."""
    other = description._other_closure(recovered(evidence, passes), recovered(100.0, passes=True))
    assert (other.excluded, other.held_out_chi2) == (excluded, 1.2)


def test_a_law_that_was_only_screened_is_not_excluded_and_has_no_held_out_number():
    other = description._other_closure(screened("heavy mass", "time", 1.0), recovered(100.0, passes=True))
    assert (other.excluded, other.held_out_chi2) == (False, None)


def test_the_report_names_in_words_what_is_not_excluded():
    def other(acts_on, depends_on, excluded):
        return OtherClosure(
            acts_on=acts_on, depends_on=depends_on, multiplied_by="constant", twice_log_bayes_factor=90.0,
            held_out_chi2=None if not excluded else 3.0, excluded=excluded,
        )  # fmt: skip

    result = identification("a name")
    others = (other("heavy mass", "time", False), other(STRING_ON_ROD, "wrap_angle", False), other("light mass", "time", True))
    force = dataclasses.replace(result.unlisted, other_closures=others)
    section = unlisted_report.section(dataclasses.replace(result, unlisted=force))
    assert (
        "These data do not exclude, in its place, a force on the heavy mass as a function of the time; "
        "a change of the friction of the string on the rod as a function of the wrap angle. *Significant*"
    ) in section
    assert verdict_notes(Verdict.UNLISTED, (), force, (), ()) == (
        "Which law it is, is less sure than that there is one: the data do not exclude 2 others.",
    )
    assert "exclude" not in unlisted_report.section(result)
    assert verdict_notes(Verdict.UNLISTED, (), result.unlisted, (), ()) == ()
    assert "| heavy mass | time | constant | 90 | \N{EN DASH} | no |" in unlisted_report.tests(force)
