"""A study of two mass ratios in which nothing is hidden, for what fits are made of."""

import pytest

from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.measured.study_io import load
from tests.blind.cases import CASES
from tests.discrepancy.blind_study import write_study


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    return read_inputs(load(write_study(folder, CASES["clean_varied"], 3, trials=["ten_a", "six"])))


@pytest.fixture(scope="module")
def problem(inputs):
    return Problem(inputs.study, inputs.training, inputs.free_parameters)
