"""What a fit predicts, and its derivatives: of candidates, cameras, clocks, laws, several trials, and impossible values."""

import dataclasses

import numpy as np
import pytest

from looping_pendulum.discrepancy.evidence.motions import Closure, weight_parameters
from looping_pendulum.discrepancy.fit import problem as fit_problem
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.measured.free_parameter import FreeParameter, ParameterRole
from looping_pendulum.measured.measurement import FIT_TOLERANCE, predict
from looping_pendulum.measured.study_io import load
from looping_pendulum.reference_ode.solve import solve_at
from tests.blind.cases import CASES
from tests.discrepancy.blind_study import write_study

FINE = 1e-12
"""Tolerance of the runs whose differences are the oracle of derivatives."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    return read_inputs(load(write_study(folder, CASES["clean_varied"], 3, trials=["ten_a", "six"])))


@pytest.fixture(scope="module")
def problem(inputs):
    return Problem(inputs.study, inputs.training, inputs.free_parameters)


def singly(problem, rows):
    """Predict by `solve_at` and one camera at a time."""
    return np.array([np.concatenate([one(problem, x, k) for k in range(len(problem.data))]) for x in rows])


def one(problem, x, k):
    d = problem.data[k]
    try:
        parameters, camera = problem.parameters_and_camera(x, k)
        values = predict(
            lambda t: solve_at(parameters, t, duration=t[-1] + 1e-3, tolerance=FIT_TOLERANCE),
            camera,
            d.channels,
            dropped=d.trial.dropped,
        )
        return np.concatenate([values[c.name] for c in d.channels])
    except HarnessError:
        return np.full(len(d.value), np.nan)


def with_candidate(problem, candidate, companions):
    """The problem with a candidate, and a value of it that changes little."""
    reach = min(candidate.bounds[1] - candidate.null, 0.02 * (abs(candidate.null) or 1.0)) or -0.02
    added = dataclasses.replace(candidate.free_parameter(1.0), scale=abs(reach))
    extended = problem.with_parameters(added, *candidate.companion_parameters(companions))
    x = np.zeros(len(extended.names))
    x[len(problem.names)] = 0.7 * np.sign(reach)
    return extended, x


def error_of_camera(name, trials, scale):
    role, c = ParameterRole.CAMERA, CAMERA[name]
    return FreeParameter(name=name, parameter=name, role=role, trials=trials, init_value=c.null, scale=scale)


def with_every_error_of_the_camera(problem):
    trials = tuple(d.trial.name for d in problem.data)
    names = set(CAMERA) - {"origin_x", "origin_y", "rate_offset"}
    return problem.with_parameters(*(error_of_camera(name, trials, CAMERA[name].error) for name in sorted(names)))


def test_many_predictions_are_those_of_each_alone(inputs, problem):
    """Oracle: `solve_at` and one camera at a time, which share no array with the vectorised measurement."""
    rng = np.random.default_rng(5)
    for c in inputs.library:
        extended, x = with_candidate(problem, c, c.companion_grid()[0])
        rows = x + rng.normal(0, 0.3, (2, len(x)))
        rows[:, len(problem.names) :] = x[len(problem.names) :]
        np.testing.assert_allclose(extended.predict_many(rows), singly(extended, rows), atol=1e-9, rtol=0, err_msg=c.name)
    extended = with_every_error_of_the_camera(problem)
    rows = rng.normal(0, 0.5, (3, len(extended.names)))
    np.testing.assert_allclose(extended.predict_many(rows), singly(extended, rows), atol=1e-9, rtol=0)


def test_where_the_model_or_the_camera_cannot_be_there_is_no_number(problem):
    trials = tuple(d.trial.name for d in problem.data)
    own = [
        FreeParameter(name="rod_radius", parameter="rod_radius", trials=trials, init_value=0.006, scale=1.0),
        error_of_camera("perspective_x", trials, 1.0),
        error_of_camera("clock_offset", trials, 1.0),
    ]
    extended = Problem(problem.study, problem.data, own)
    rows = np.array([[0, 0, 0], [-1, 0, 0], [9, 0, 0], [0, 5, 0], [0, 0, 50], [0, 0, 90], [0, 0.1, 0.01], [1e-3, 0, 0.0]])
    found = extended.predict_many(rows)
    assert np.isnan(found).all(axis=1).tolist() == [False, True, True, True, True, True, False, False]
    np.testing.assert_allclose(found, singly(extended, rows), atol=1e-9, rtol=0)
    assert extended.residuals(rows[1]) is None


def test_a_prediction_depends_on_no_other_in_any_bit(problem):
    rows = np.random.default_rng(7).normal(0, 0.5, (40, len(problem.names)))
    assert np.array_equal(problem.predict_many(rows)[11:23], problem.predict_many(rows[11:23]))


def differences(problem, x, step, monkeypatch):
    """Minus the derivative of the residuals by fourth-order differences of runs at `FINE`."""
    with monkeypatch.context() as patch:
        patch.setattr(fit_problem, "FIT_TOLERANCE", FINE)
        columns = []
        for i in range(len(x)):
            rows = np.tile(x, (4, 1))
            rows[:, i] += step * np.array([-2, -1, 1, 2])
            r = [problem.residuals_of(*row) for row in zip(rows, problem.predict_many(rows), strict=True)]
            columns.append((r[3] - r[0] + 8 * (r[1] - r[2])) / (12 * step))
        return np.stack(columns, axis=1)


def assert_derivatives(problem, x, monkeypatch, step=3e-4, bound=2e-5):
    """Relative to the largest of each column: runs at the fit's tolerance are good to 1e-6 of it, differences to the rest."""
    found, expected = problem.jacobian(x), differences(problem, x, step, monkeypatch)
    np.testing.assert_allclose(found / abs(expected).max(axis=0), expected / abs(expected).max(axis=0), atol=bound, rtol=0)


def test_derivatives_of_the_declared_model(problem, monkeypatch):
    """Of two trials and their cameras' origins, static friction following the kinetic one."""
    x = np.random.default_rng(1).normal(0, 0.3, len(problem.names))
    assert_derivatives(problem, x, monkeypatch)


def test_derivatives_by_every_error_of_the_camera(problem, monkeypatch):
    extended = with_every_error_of_the_camera(problem)
    x = np.random.default_rng(2).normal(0, 0.2, len(extended.names))
    assert_derivatives(extended, x, monkeypatch)


def test_derivatives_by_the_weights_of_a_law(problem, monkeypatch):
    closure = Closure(coordinate="wrap_angle", factor="across_speed", target="light mass", first_centre=0.0, spacing=0.6)
    trials = tuple(d.trial.name for d in problem.data)
    parameters = (*problem.free_parameters, *weight_parameters(closure, trials, 1e-3))
    root = np.eye(len(parameters))
    extended = Problem(closure.added_to(problem.study), problem.data, parameters, (np.zeros(len(parameters)), root))
    assert_derivatives(extended, np.random.default_rng(3).normal(0, 0.3, len(parameters)), monkeypatch)


@pytest.mark.parametrize(
    "name", ["static_friction", "wrong_light_mass", "friction_per_wrap", "string_compliance", "rod_mobility"]
)
def test_derivatives_by_a_candidate(inputs, problem, monkeypatch, name):
    c = next(c for c in inputs.library if c.name == name)
    extended, x = with_candidate(problem, c, c.companion_grid()[-1])
    assert_derivatives(extended, x, monkeypatch)


@pytest.mark.parametrize("name", ["rod_mobility", "string_compliance", "push_along"])
def test_where_the_motion_changes_its_kind_there_is_no_derivative(inputs, problem, name):
    """A string begins to stretch at a compliance of 0: that column is 0 and named, all others are as without the effect."""
    c = next(c for c in inputs.library if c.name == name)
    extended, x = with_candidate(problem, c, c.companion_grid()[-1])
    assert name not in extended.without_derivative(x)
    x[len(problem.names)] = 0.0
    assert name in extended.without_derivative(x)
    found, others = extended.jacobian(x), problem.jacobian(x[: len(problem.names)])
    n = problem.measured_rows
    assert not found[:n, len(problem.names)].any()
    np.testing.assert_allclose(found[:n, : len(problem.names)], others[:n], atol=1e-9 * abs(others[:n]).max(), rtol=0)
