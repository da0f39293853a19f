"""The report as people read it: a sentence, a picture and what to do next come first; statistics stand in tables."""

from __future__ import annotations

import dataclasses
import functools
import re
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.discrepancy.fit.event_tests import EventTest
from looping_pendulum.discrepancy.fit.model_test import ModelTest, failures_in_words
from looping_pendulum.discrepancy.fit.residual import GroupTest, ResidualTests
from looping_pendulum.discrepancy.listed.held_out import HeldOutTest
from looping_pendulum.discrepancy.listed.round_record import _reason
from looping_pendulum.discrepancy.report import lead_figure, markdown, next_steps, page, plots, visible_report
from looping_pendulum.discrepancy.result import Experiment, SmallestVisible, Verdict
from looping_pendulum.discrepancy.trial_results import CorrelatedError
from looping_pendulum.discrepancy.verdict_sentence import verdict_notes, verdict_sentence
from tests.compare.conftest import quick_figures  # noqa: F401, a fixture
from tests.pages.made_up import identification

STATISTICS = re.compile(r"chi2|chi-square|BIC|Bayes|\bz\b|\bp\b|Ljung|lag-1", re.IGNORECASE)
"""Words that belong into tables."""
TESTS = (
    ModelTest(subject="all tracked points", statistic="chi2 per degree of freedom", value=2.3, limit=1.07, passes=False,
              failure="the residuals are 1.5 times as large as the noise"),
)  # fmt: skip


@functools.cache
def made_up(verdict):
    result = identification("swing")
    ties = (result.effects, (dataclasses.replace(result.effects[0], name="clock_ratio"),))
    added = {Verdict.IDENTIFIED, Verdict.AMBIGUOUS}
    unlisted = result.unlisted if verdict is Verdict.UNLISTED else None
    effects = result.effects if verdict in added else ()
    held_out = dataclasses.replace(result.errors[0], held_out=True)
    ranking = tuple(
        dataclasses.replace(c, reason="" if c.passes else "it explains less than swing0") for c in result.rounds[0].ranking
    )
    rounds = (dataclasses.replace(result.rounds[0], ranking=ranking),)
    noise = (CorrelatedError(body="light", amplitude=2e-3, unit="m", correlation_time=0.05, points=5.0),)
    visible = tuple(
        SmallestVisible(name=f"effect_{i}", value=1e-3 * i, unit="m/s**2", acts_on="rod", null_value=0.0, motion=12.0 - i)
        for i in range(12)
    )
    fit = dataclasses.replace(result.before, failed_tests=failures_in_words(TESTS), tests=TESTS)
    return dataclasses.replace(
        result,
        verdict=verdict,
        effects=effects,
        ties=ties if verdict is Verdict.AMBIGUOUS else (),
        unlisted=unlisted,
        sentence=verdict_sentence(verdict, effects, ties, unlisted, (held_out,), failures=(), own_effects=False),
        notes=verdict_notes(verdict, rounds, unlisted, noise, result.outliers),
        errors=(held_out,),
        correlated_noise=noise,
        smallest_visible=visible,
        can_hide=("rod_mobility",),
        next_experiments=(
            Experiment(
                release="held",
                release_angle=1.0,
                free_length=0.3,
                mass_ratio=3.0,
                pairs=1,
                separated_pairs=1,
                distance=8.0,
                tells_apart=("swing", "clock_ratio"),
            ),
        ),
        rounds=rounds,
        before=fit,
        after=fit,
    )


@pytest.mark.usefixtures("quick_figures")
@pytest.mark.parametrize("verdict", list(Verdict))
def test_a_report_begins_with_the_sentence_the_picture_and_what_to_do_next(verdict):
    result = made_up(verdict)
    report = markdown.render(result, {path: caption for path, (caption, _) in pictures(verdict).items()})
    blocks = [b for b in report.split("\n\n") if b.strip()]
    assert blocks[1].strip().startswith("## Verdict: ")
    assert blocks[2].strip() == result.sentence
    assert blocks[3].strip().startswith("![")
    assert blocks[3].strip().endswith(f"](figures/{lead_figure.NAME})")
    assert blocks[5].strip() == "## What to do next"
    assert blocks[6].startswith("1. ")
    assert report.index("## Tests") > report.index("## Candidates")


@functools.cache
def pictures(verdict):
    return {f"figures/{name}": drawing for name, drawing in plots.draw(made_up(verdict)).items()}


@pytest.mark.usefixtures("quick_figures")
@pytest.mark.parametrize("verdict", list(Verdict))
def test_no_sentence_has_test_statistics(verdict):
    result = made_up(verdict)
    assert result.sentence.count(". ") == 0
    assert result.sentence.endswith(".")
    for text in (
        result.sentence,
        *result.notes,
        lead_figure.caption(result),
        *(caption for caption, _ in pictures(verdict).values()),
    ):
        assert not STATISTICS.search(text), text
    report = markdown.render(result).split("## Tests")[0]
    for line in report.splitlines():
        if not line.startswith("|"):
            assert not STATISTICS.search(line), line


def test_the_sentence_says_how_much_nearer_the_model_comes():
    assert made_up(Verdict.IDENTIFIED).sentence == (
        "swing = 0.0100 +/- 0.0010 N s/m explains what the declared model misses: with it, the model comes to within 1 mm "
        "(RMS) of the data of the held-out trial swing, instead of 3 mm."
    )


def test_the_sentence_calls_no_model_nearer_that_is_not():
    """Beside errors that last longer than a frame, a better model of two falling basketballs is 74 mm off instead of 54 mm."""
    result = made_up(Verdict.IDENTIFIED)
    error = dataclasses.replace(result.errors[0], rms_before=0.054, rms_after=0.074)
    sentence = verdict_sentence(result.verdict, result.effects, (), None, (error,), failures=(), own_effects=False)
    assert "nearer" not in sentence
    assert "to within" not in sentence
    assert "74 mm (RMS)" in sentence


def test_a_model_as_near_as_errors_allow_is_not_said_to_be_off():
    """Such a sentence ended in "1 times their error", without what fails."""
    result = made_up(Verdict.UNEXPLAINED)
    error = dataclasses.replace(result.errors[0], standardised_rms_after=1.02)
    failures = ("the residuals still have a pattern", "the residuals look like scale")
    sentence = verdict_sentence(result.verdict, (), (), None, (error,), failures=failures, own_effects=False)
    assert "as near as their errors allow, but the residuals still have a pattern and the residuals look like scale" in sentence
    assert "times their error" not in sentence


@pytest.mark.parametrize(("count", "value"), [(3, "swing = 0.0100 +/- 0.0010 N s/m"), (4, "swing")])
def test_a_sentence_of_many_explanations_leaves_their_values_to_the_table(count, value):
    result = made_up(Verdict.AMBIGUOUS)
    ties = (result.effects,) * count
    sentence = verdict_sentence(result.verdict, result.effects, ties, None, result.errors, failures=(), own_effects=False)
    assert f"which of {count} explanations is right: {'; or '.join([value] * count)}; with the first" in sentence


def test_every_reason_is_words():
    candidate = SimpleNamespace(bounds_reason="gravity on Earth is 9.764 to 9.834 m/s^2", name="a")
    free = SimpleNamespace(bounds_reason="", name="a")
    best = SimpleNamespace(delta_bic=90.0, candidate=free, within_bounds=True)
    group = GroupTest(group="sliding, light along", count=30, chi2=4.0, lag1=9.0, ljung_box=0.0, runs=-9.0)
    events = EventTest(count=3, chi2=90.0, expected=3.0, p=0.0, worst="two t_C 1 (+4.2 standard errors)")
    residuals = ResidualTests(chi2_per_dof=9.0, count=30, groups=(group,), events=events)
    held_out = HeldOutTest(names=("two",), chi2=(9.0,), counts=(30,), limits=(1.1,), rms=(0.1,), fits=(None,))
    failed = failures_in_words([*residuals.results, *held_out.results])
    assert len(failed) == 4
    models = SimpleNamespace(failed_tests=failed)
    assert _reason(best, None, best, one_passes=True) == "it explains less than the effect in its place"
    for within, delta_bic, known, model in (
        (False, 90.0, candidate, models), (False, 90.0, free, models), (True, 3.0, free, None), (True, 50.0, free, None),
        (True, 50.0, free, models), (True, 3.0, free, models),
    ):  # fmt: skip
        r = SimpleNamespace(within_bounds=within, delta_bic=delta_bic, candidate=known)
        reason = _reason(r, model, best, one_passes=True)
        assert reason
        assert not STATISTICS.search(reason), reason
    assert "impossible: gravity on Earth" in _reason(
        SimpleNamespace(within_bounds=False, delta_bic=90.0, candidate=candidate), None, best, one_passes=True
    )


def test_every_test_stands_in_the_table_with_its_limit():
    report = markdown.render(made_up(Verdict.IDENTIFIED))
    assert "| all tracked points | chi2 per degree of freedom | at most 1.07 | 2.3 | no | 2.3 | no |" in report


def test_the_ten_that_hide_best_are_listed_with_their_units():
    section = visible_report.section(made_up(Verdict.NO_MISSING_EFFECT))
    rows = [line for line in section.splitlines() if line.startswith("| effect_")]
    assert len(rows) == visible_report.MAX_ROWS
    assert "0.001 m/s^2" in rows[1]
    assert "The other 2 are in `verdict.json`" in section
    assert "No size of rod_mobility would be sure to show" in section


def test_without_positions_the_picture_is_the_residual_over_time():
    result = made_up(Verdict.IDENTIFIED)
    (picture,) = result.trial_figures
    t = picture.t["light_x"]
    heights = {
        name: {"height": getattr(picture, name)["light_x"]}
        for name in ("t", "measured", "before", "after", "residual_before", "residual_after", "outliers")
    }
    falling = dataclasses.replace(result, trial_figures=(dataclasses.replace(picture, channels=("height",), **heights),))
    (figure,) = page.first_figures(falling)
    assert [trace["name"] for trace in figure.traces] == ["declared model", "repaired model"]
    assert len(figure.traces[0]["x"]) == len(t)
    assert lead_figure.draw(falling, {"before": "red", "after": "blue"}).axes[0].get_ylabel().startswith("height")


def test_residual_vectors_lead_to_the_points_magnified():
    (picture,) = made_up(Verdict.IDENTIFIED).trial_figures
    off = {name: values + 0.01 for name, values in picture.measured.items()}
    picture = dataclasses.replace(picture, before=off)
    vectors, factor = lead_figure.residual_vectors(picture, "light")
    assert factor == 10.0  # 0.1 of a motion of 2 m by 14 mm, rounded down to 1, 2 or 5 times a power of ten
    assert np.allclose(vectors["before"].tips - vectors["before"].path, -factor * 0.01)
    assert len(vectors["before"].path) == len(picture.t["light_x"]) - 1  # without the outlier


def test_the_farthest_misfits_are_named_with_their_times():
    step = next_steps.section(made_up(Verdict.UNEXPLAINED))
    assert "trial swing, halting time (off by 100 ms)" in step


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, " deg, with a heavy mass of 3 times the light one. It separates the explanations by 8 times the noise."),
        ({"mass_ratio": None}, " deg. It separates"),
        ({"pairs": 3}, "It separates 1 of 3 pairs of explanations by at least 8 times the noise."),
        ({"separated_pairs": 0, "distance": 2.0}, "no trial within the study's limits separates them."),
    ],
)
def test_the_next_trial_is_described_with_what_it_separates(changes, words):
    result = made_up(Verdict.AMBIGUOUS)
    (experiment,) = result.next_experiments
    result = dataclasses.replace(result, next_experiments=(dataclasses.replace(experiment, **changes),))
    assert words in next_steps.section(result)
