"""The interval of a fitted number: three standard errors where the model is linear, and the cost's own rise where it is not."""

from __future__ import annotations

import pytest

from looping_pendulum.discrepancy.data.study_io import load
from looping_pendulum.discrepancy.fit.calibration import calibrate
from looping_pendulum.discrepancy.fit.likelihood import cost_rise, likelihood_interval
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.inputs import read_inputs
from tests.blind.cases import CLEAN
from tests.discrepancy.blind_study import write_study


@pytest.fixture(scope="module")
def fit(tmp_path_factory):
    inputs = read_inputs(load(write_study(tmp_path_factory.mktemp("clean"), CLEAN, 5, trials=["ten_a"])))
    return calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))


@pytest.mark.parametrize("name", ["ten_a.origin_x", "ten_a.release_angle"])
def test_it_is_three_standard_errors_of_a_nearly_linear_number(fit, name):
    low, high = likelihood_interval(fit, name)
    value, error = fit.values[name], fit.errors[name]
    assert (low, high) == pytest.approx((value - 3 * error, value + 3 * error), abs=0.15 * error)
    assert cost_rise(fit, name, high) == pytest.approx(9, rel=0.02)


def test_it_ends_at_what_is_physically_possible(fit):
    # one trial hardly sees the drag on the heavy mass, which cannot be negative
    assert likelihood_interval(fit, "heavy_drag")[0] == 0
