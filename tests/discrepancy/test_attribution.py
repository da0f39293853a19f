"""Screening, refits and the judge: the right candidate comes first, also where its first-order sensitivity vanishes."""

from __future__ import annotations

import pytest

from looping_pendulum.discrepancy.data.study_io import load
from looping_pendulum.discrepancy.fit.calibration import calibrate
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual import calibrated
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.listed.attribution import BLOCKS, SCORE_LIMIT, judge, refit
from looping_pendulum.discrepancy.listed.screening import screen
from tests.blind.cases import CASES
from tests.discrepancy.blind_study import TWO_RATIOS, write_study

CHOSEN = ("scale", "tilt", "clock_offset", "wrong_free_length", "wrong_light_mass", "static_friction", "light_linear_drag")


def inputs_and_fit(folder, case, seed, **options):
    inputs = read_inputs(load(write_study(folder, CASES[case], seed, **options)))
    return inputs, calibrated(calibrate(Problem(inputs.study, inputs.training, inputs.numbers)))


def screened(inputs, fit):
    return screen(fit, [c for c in inputs.library if c.name in CHOSEN])


def test_nothing_scores_on_clean_data_and_the_held_out_trial_is_explained(tmp_path):
    inputs, fit = inputs_and_fit(tmp_path, "clean", 2)
    assert all(abs(s.score) < SCORE_LIMIT for s in screened(inputs, fit))
    unseen = judge(fit, inputs.held)
    assert unseen.names == ("eight",)
    assert unseen.explained


def test_static_friction_is_seen_by_finite_templates(tmp_path):
    """Its derivative at the null value is zero: only a finite excess moves the break-away."""
    inputs, fit = inputs_and_fit(tmp_path, "static_excess", 0, trials=TWO_RATIOS)
    first = screened(inputs, fit)[0]
    assert first.candidate.name == "static_friction"
    assert first.score > 20
    found = refit(fit, first)
    assert found.gain > 1000
    assert found.inside


def test_a_scale_error_is_worth_its_gain(tmp_path):
    inputs, fit = inputs_and_fit(tmp_path, "scale", 1, trials=TWO_RATIOS)
    assert not judge(fit, inputs.held).explained
    first = screened(inputs, fit)[0]
    found = refit(fit, first)
    assert first.candidate.name == "scale"
    assert abs(found.value - 1.04) < 3 * found.error
    assert judge(found.fit, inputs.held).explained


def test_a_single_trial_is_judged_on_blocks_of_time(tmp_path):
    inputs, fit = inputs_and_fit(tmp_path, "clean", 3, trials=["ten_a"])
    unseen = judge(fit, inputs.held)
    assert len(unseen.names) == BLOCKS // 2
    assert unseen.explained
    assert unseen.worst == pytest.approx(1, abs=4 / fit.problem.count**0.5)
