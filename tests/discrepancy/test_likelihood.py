"""The interval of a fitted number: 1.96 standard errors where the model is linear, and the cost's own rise where it is not."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from looping_pendulum.discrepancy.fit import likelihood
from looping_pendulum.discrepancy.fit.calibration import FitError
from looping_pendulum.discrepancy.fit.likelihood import (
    COST_RISE_95,
    interval_end,
    is_nearly_linear,
    rise_after_selection,
    stated_interval,
)
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.verdict import effect_in_words
from looping_pendulum.measured.study_io import load
from tests.blind.cases import CLEAN
from tests.discrepancy.blind_sample import BlindStudy, planted_values, write_files
from tests.discrepancy.blind_study import fit_declared, only_candidates, write_study
from tests.pages import made_up as pages


@pytest.fixture(scope="module")
def fit(tmp_path_factory):
    return fit_declared(write_study(tmp_path_factory.mktemp("clean"), CLEAN, 5, trials=["ten_a"]))[1]


def cost_rise(fit, name, value):
    """Return the rise of the cost if a parameter has ``value`` [SI]; its square root counts standard errors.

    The other parameters are refitted in steps of about one standard error, so that each fit starts near its minimum.
    """
    best = fit.values[name]
    # Less a little, so that rounding does not add a step
    steps = max(1, math.ceil(abs(value - best) / fit.errors[name] - 1e-9))
    conditional = fit
    for here in np.linspace(best, value, steps + 1)[1:]:
        conditional = likelihood.refit_with_fixed_value(fit, conditional, name, float(here))
    return conditional.cost - fit.cost


@pytest.mark.long
@pytest.mark.parametrize("name", ["ten_a.origin_x", "ten_a.release_angle"])
def test_it_is_two_standard_errors_of_a_nearly_linear_number(fit, name):
    assert is_nearly_linear(fit, name)
    low, high = interval_end(fit, name, -1), interval_end(fit, name, 1)
    value, error = fit.values[name], fit.errors[name]
    assert (low, high) == pytest.approx((value - 1.96 * error, value + 1.96 * error), abs=0.1 * error)
    assert cost_rise(fit, name, high) == pytest.approx(3.84, rel=0.02)


def test_it_is_open_where_the_data_set_no_limit(fit):
    # one trial hardly sees the drag on the heavy mass, which cannot be negative
    assert not is_nearly_linear(fit, "heavy_drag")
    low, high = interval_end(fit, "heavy_drag", -1), interval_end(fit, "heavy_drag", 1)
    assert low is None
    assert high > fit.values["heavy_drag"]


@pytest.mark.parametrize("truth", [0.0, 2.0, 4.0, 5.0, 6.0, 8.0])
def test_of_values_that_are_only_stated_where_they_are_large_95_percent_of_the_intervals_have_the_truth(truth):
    """By 1.96 standard errors on either side none of those at 2 and 60 % of those at 4 have it, of values above 4.1."""
    least, draws = 4.1, 4000
    rng = np.random.default_rng(7)
    measured = truth + norm.isf(norm.sf(least - truth) * rng.random(draws))
    assert measured.min() >= least
    rises = [rise_after_selection(z, least) for z in measured]
    low = np.array([0.0 if r is None else z - math.sqrt(r) for z, r in zip(measured, rises, strict=True)])
    assert np.all(low <= measured - 1.959)
    share = np.mean((low <= truth) & (truth <= measured + 1.96))
    assert share >= 0.95 - 3 * math.sqrt(0.05 * 0.95 / draws)


def test_far_beyond_the_least_value_or_below_it_a_selection_changes_nothing():
    for distance in (3.0, 8.2, 100.0, math.inf):
        assert rise_after_selection(distance, 4.1) == COST_RISE_95
    assert rise_after_selection(8.0, 4.1) == pytest.approx(COST_RISE_95, rel=0.02)


@pytest.mark.parametrize("side", [-1, 1])
def test_the_end_towards_the_null_value_is_the_farther_one(fit, side):
    """Whether the value was found above or below the value of no effect."""
    name = "ten_a.release_angle"
    value, error = fit.values[name], fit.errors[name]
    for distance, least in ((6.0, 5.0), (5.1, 5.0)):
        null = value - side * distance * error
        low, high = stated_interval(fit, name, null, least)
        near, far = (low, high) if side > 0 else (high, low)
        assert far == pytest.approx(value + side * 1.96 * error, abs=1e-3 * error)
        rise = rise_after_selection(distance, least)
        if rise is None:
            assert near == null
        else:
            assert 1.96 < abs(near - value) / error < distance
    assert stated_interval(fit, name, value - side * 20 * error, 5.0) is None


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
    found = interval_end(fit, "static_friction", side)
    assert found == pytest.approx(end, abs=0.03 * 6)
    assert abs(found - end) <= 0.1 * abs(end - 1.62) + 0.002
    assert len(tried) <= 25


def test_a_value_that_cannot_run_has_no_fit(fit, monkeypatch):
    monkeypatch.setattr(likelihood, "minimise", lambda *a, **k: (_ for _ in ()).throw(FitError("cannot run")))
    value = fit.values["ten_a.origin_x"]
    assert likelihood.refit_with_fixed_value(fit, fit, "ten_a.origin_x", value + 1e-3) is None


@pytest.mark.accurate  # a fine step of the simulator takes most of its time; daily, the interval that is open on one side
def test_of_static_friction_that_holds_the_interval_has_the_planted_value(tmp_path):
    """Any larger value holds the string as well, so that the standard error says nothing."""
    study = BlindStudy(hidden=("static_excess",), size=8e-3, noise=2e-3, trials=3, seed=1242401441)
    (planted,) = planted_values(study).values()
    with only_candidates(["static_friction"]):
        (effect,) = identify(load(write_files(study, tmp_path))).effects
    low, high = effect.interval
    assert not 0.01 < effect.error / effect.value < 1
    assert low < planted
    assert high is None or high > planted


def effect(interval):
    made = pages.named(pages.identification("swing").effects[0], "static_friction", unit="", null=1.0)
    return dataclasses.replace(made, value=1.2345, error=1e-3, interval=interval)


@pytest.mark.parametrize(
    ("interval", "text"),
    [
        (None, "friction of the string at rest (static_friction) = 1.2345 +/- 0.0010"),
        ((1.18, 3.1), "friction of the string at rest (static_friction) = 1.23 (probably 1.18 to 3.1)"),
        ((1.0, 3.1), "friction of the string at rest (static_friction) = 1.23 (probably 1 to 3.1)"),
        ((1.0012, 1.0123), "friction of the string at rest (static_friction) = 1.23 (probably 1.001 to 1.012)"),
        ((1.18, None), "friction of the string at rest (static_friction) of at least 1.18"),
        ((None, 3.1), "friction of the string at rest (static_friction) of at most 3.1"),
        ((None, None), "friction of the string at rest (static_friction) = 1.23 (the data set it no limits)"),
    ],
)
def test_the_sentence_states_it(interval, text):
    assert effect_in_words(effect(interval)) == text
