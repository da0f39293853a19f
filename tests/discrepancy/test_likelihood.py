"""The interval of a fitted number: 1.96 standard errors where the model is linear, and the cost's own rise where it is not."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from benchmarks.blind_sample import draw, planted_values, write_files
from looping_pendulum.discrepancy.data.study_io import load
from looping_pendulum.discrepancy.fit import likelihood
from looping_pendulum.discrepancy.fit.calibration import FitError, calibrate
from looping_pendulum.discrepancy.fit.likelihood import cost_rise, is_nearly_linear, likelihood_interval
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.verdict_sentence import effect_in_words
from tests.blind.cases import CLEAN
from tests.discrepancy.blind_study import only_candidates, write_study


@pytest.fixture(scope="module")
def fit(tmp_path_factory):
    inputs = read_inputs(load(write_study(tmp_path_factory.mktemp("clean"), CLEAN, 5, trials=["ten_a"])))
    return calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))


@pytest.mark.parametrize("name", ["ten_a.origin_x", "ten_a.release_angle"])
def test_it_is_two_standard_errors_of_a_nearly_linear_number(fit, name):
    assert is_nearly_linear(fit, name)
    low, high = likelihood_interval(fit, name)
    value, error = fit.values[name], fit.errors[name]
    assert (low, high) == pytest.approx((value - 1.96 * error, value + 1.96 * error), abs=0.1 * error)
    assert cost_rise(fit, name, high) == pytest.approx(3.84, rel=0.02)


def test_it_is_open_where_the_data_set_no_limit(fit):
    # one trial hardly sees the drag on the heavy mass, which cannot be negative
    assert not is_nearly_linear(fit, "heavy_drag")
    low, high = likelihood_interval(fit, "heavy_drag")
    assert low is None
    assert high > fit.values["heavy_drag"]


@pytest.mark.parametrize(("side", "end"), [(-1, 1.612), (1, 4.7)])
def test_where_the_cost_jumps_it_ends_at_the_jump(monkeypatch, side, end):
    """Static friction holds the string above a value, and nothing else changes; its standard error may be any number."""
    parameter = SimpleNamespace(name="static_friction", bounds=(1.0, 10.0))
    problem = SimpleNamespace(names=("static_friction",), free_parameters=[parameter])
    fit = SimpleNamespace(problem=problem, values={"static_friction": 1.62}, errors={"static_friction": 20.0}, cost=2000.0)
    tried = []

    def refit(fit, start, name, value):
        tried.append(value)
        return SimpleNamespace(cost=2000.0 if 1.612 < value < 4.7 else 1e6)

    monkeypatch.setattr(likelihood, "refit_with_fixed_value", refit)
    found = likelihood_interval(fit, "static_friction")[side > 0]
    assert found == pytest.approx(end, abs=0.03 * 6)
    assert abs(found - end) <= 0.1 * abs(end - 1.62) + 0.002
    assert len(tried) <= 25


def test_a_value_that_cannot_run_is_no_limit_of_the_data(fit, monkeypatch):
    monkeypatch.setattr(likelihood, "minimise", lambda *a, **k: (_ for _ in ()).throw(FitError("cannot run")))
    assert cost_rise(fit, "ten_a.origin_x", fit.values["ten_a.origin_x"] + 1e-3) == float("inf")


@pytest.mark.accurate  # a fine step of the simulator takes most of its time; daily, the interval that is open on one side
def test_of_static_friction_that_holds_the_interval_has_the_planted_value(tmp_path):
    """Any larger value holds the string as well, so that the standard error says nothing."""
    study = draw("rates", "single", 3, seed=5)[2]
    assert study.hidden == ("static_excess",)
    (planted,) = planted_values(study).values()
    with only_candidates(["static_friction"]):
        (effect,) = identify(load(write_files(study, tmp_path)), workers=1).effects
    low, high = effect.interval
    assert not 0.01 < effect.error / effect.value < 1
    assert low < planted
    assert high is None or high > planted


def effect(interval):
    return SimpleNamespace(name="static_friction", value=1.2345, error=1e-3, unit="", interval=interval)


@pytest.mark.parametrize(
    ("interval", "text"),
    [
        (None, "static_friction = 1.2345 +/- 0.0010"),
        ((1.18, 3.1), "static_friction = 1.23 (probably 1.18 to 3.1)"),
        ((1.18, None), "static_friction of at least 1.18"),
        ((None, 3.1), "static_friction of at most 3.1"),
        ((None, None), "static_friction = 1.23 (the data set it no limits)"),
    ],
)
def test_the_sentence_states_it(interval, text):
    assert effect_in_words(effect(interval)) == text
