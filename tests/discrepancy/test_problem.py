"""What a fit predicts: of candidates, cameras, clocks, several trials, and impossible values."""

import dataclasses

import numpy as np

from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.measured.free_parameter import FreeParameter, ParameterRole


def with_candidate(problem, candidate, companions=()):
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


FREE_OF_A_CAMERA = sorted(set(CAMERA) - {"origin_x", "origin_y", "rate_offset"})


def with_errors_of_the_camera(problem, names):
    trials = tuple(d.trial.name for d in problem.data)
    return problem.with_parameters(*(error_of_camera(name, trials, CAMERA[name].error) for name in names))


def together(problem, rows):
    """Predictions of all trials end to end, shape (rows, n)."""
    return np.array([np.concatenate([problem.predict(x, k) for k in range(len(problem.data))]) for x in rows])


def test_where_the_model_or_the_camera_cannot_be_there_is_no_number(problem):
    trials = tuple(d.trial.name for d in problem.data)
    own = [
        FreeParameter(name="rod_radius", parameter="rod_radius", trials=trials, init_value=0.006, scale=1.0),
        error_of_camera("perspective_x", trials, 1.0),
        error_of_camera("clock_offset", trials, 1.0),
    ]
    extended = Problem(problem.study, problem.data, own)
    rows = np.array([[0, 0, 0], [-1, 0, 0], [9, 0, 0], [0, 5, 0], [0, 0, 50], [0, 0, 90], [0, 0.1, 0.01], [1e-3, 0, 0.0]])
    found = together(extended, rows)
    assert np.isnan(found).all(axis=1).tolist() == [False, True, True, True, True, True, False, False]
    assert extended.residuals(rows[1]) is None
