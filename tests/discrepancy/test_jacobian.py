"""The exact Jacobian of a fit against differences of runs, for all that is measured and everything that may be fitted."""

import dataclasses

import numpy as np
import pytest

from looping_pendulum.discrepancy.evidence.laws import Closure, weight_parameters
from looping_pendulum.discrepancy.fit import event_prediction
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.measured import measurement, study_io
from looping_pendulum.measured.study_io import load
from looping_pendulum.reference_ode.solve import DURATION
from tests.blind.cases import CASES
from tests.blind.pendulum import Pendulum, write_gyroscope
from tests.discrepancy.event_study import write_blind_study
from tests.discrepancy.held_study import write_held_study
from tests.discrepancy.test_problem import FREE_OF_A_CAMERA, with_candidate, with_errors_of_the_camera

FINE = 1e-12
"""Tolerance of the runs whose differences are the oracle of derivatives."""
STEP = 3e-4
"""Step of the differences, in scales."""


def differences(problem, x, step, monkeypatch):
    """Minus the derivative of the residuals by fourth-order differences of runs at `FINE`."""
    with monkeypatch.context() as patch:
        patch.setattr(measurement, "FIT_TOLERANCE", FINE)
        patch.setattr(event_prediction, "FIT_TOLERANCE", FINE)
        columns = []
        for i in range(len(x)):
            rows = np.tile(x, (4, 1))
            rows[:, i] += step * np.array([-2, -1, 1, 2])
            r = [problem.residuals(row) for row in rows]
            columns.append((r[3] - r[0] + 8 * (r[1] - r[2])) / (12 * step))
        return np.stack(columns, axis=1)


def assert_derivatives(problem, x, monkeypatch, step=STEP, bound=2e-5):
    """Relative to the largest of each column: runs at the fit's tolerance are good to 1e-6 of it, differences to the rest."""
    found, expected = problem.jacobian(x), differences(problem, x, step, monkeypatch)
    largest = abs(expected).max(axis=0)
    np.testing.assert_allclose(found / largest, expected / largest, atol=bound, rtol=0)


def test_the_declared_model(problem, monkeypatch):
    """Two trials and their cameras' origins, static friction following the kinetic one."""
    x = np.random.default_rng(1).normal(0, 0.3, len(problem.names))
    assert_derivatives(problem, x, monkeypatch)


def test_every_error_of_the_camera(problem, monkeypatch):
    """Clocks and a rolling shutter among them."""
    extended = with_errors_of_the_camera(problem, FREE_OF_A_CAMERA)
    x = np.random.default_rng(2).normal(0, 0.2, len(extended.names))
    assert_derivatives(extended, x, monkeypatch)


def test_the_weights_of_a_law(problem, monkeypatch):
    closure = Closure(coordinate="wrap_angle", factor="across_speed", target="light mass", first_centre=0.0, spacing=0.6)
    trials = tuple(d.trial.name for d in problem.data)
    parameters = (*problem.free_parameters, *weight_parameters(closure, trials, 1e-3))
    root = np.eye(len(parameters))
    extended = Problem(closure.added_to(problem.study), problem.data, parameters, (np.zeros(len(parameters)), root))
    assert_derivatives(extended, np.random.default_rng(3).normal(0, 0.3, len(parameters)), monkeypatch)


@pytest.mark.parametrize(
    "name",
    ["static_friction", "wrong_light_mass", "friction_per_wrap", "string_compliance", "rod_mobility", "string_thickness",
     "heavy_swing", "push_sideways"],
)  # fmt: skip
def test_a_candidate(inputs, problem, monkeypatch, name):
    """Those beside which clocks and places depend on more of the state, beside a clock that is wrong."""
    c = next(c for c in inputs.library if c.name == name)
    beside = with_errors_of_the_camera(problem, ["clock_offset", "scale"])
    extended, x = with_candidate(beside, c, c.companion_grid()[-1])
    if name == "string_thickness":  # 2 % of a metre a turn would be a spool
        x[len(beside.names)] *= 0.02
    # Some points are close to the end of the first turn, from which on the string lies on itself
    assert_derivatives(extended, x, monkeypatch, step=3e-5 if name == "string_thickness" else STEP)


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


def test_angles_and_angular_velocities_of_a_held_pendulum(tmp_path, monkeypatch):
    """A gyroscope's file, by a clock that is wrong, and a film; with friction in the pivot."""
    swing = Pendulum(mass=0.15, length=0.4, angle=0.3, rate=-4.0, quadratic_drag=4e-3, axle_torque=3e-4)
    for write in ({"write": write_gyroscope, "offset": 0.012}, {}):
        folder = tmp_path / f"with_{len(write)}"
        folder.mkdir()
        given = read_inputs(load(write_held_study(folder, swing, turning_points=8, **write)))
        extended = with_errors_of_the_camera(Problem(given.study, given.training, given.free_parameters), ["clock_ratio"])
        friction = next(c for c in given.library if c.name == "pivot_friction")
        extended, x = with_candidate(extended, dataclasses.replace(friction, bounds=(0.0, 1e-3)))
        assert_derivatives(extended, x + np.where(x == 0, 0.3, 0.0), monkeypatch)


@pytest.mark.parametrize("mass", ["light", "heavy"])
def test_heights_of_a_drop(tmp_path, monkeypatch, mass):
    """Heights are from the release, so that what moves the release moves none of them."""
    rows = [f"{i / 240!r},{0.3 - 9.81 * (i / 240) ** 2 / 2!r}" for i in range(80)]
    (tmp_path / "drop.csv").write_text("\n".join(["t,height", *rows]) + "\n")
    text = (
        "title: A drop\napparatus: {heavy: {mass: 1 kg}, light: {mass: 10 g}}\n"
        f"trials: [{{file: drop.csv, dropped: {mass}, release: {{kind: drop}}}}]\neffects: {{gravity: free from 9.8 m/s^2, "
        f"{mass}_drag: free from 0.001 kg/m}}\n"
    )
    given = read_inputs(study_io.load_text(text, "study.yaml", tmp_path))
    extended = with_errors_of_the_camera(
        Problem(given.study, given.training, given.free_parameters), ["clock_offset", "clock_ratio", "scale"]
    )
    # the bounds of gravity on Earth are narrow
    assert_derivatives(extended, np.where(np.array(extended.names) == "gravity", 0.005, 0.3), monkeypatch)


def test_rows_of_event_tables(tmp_path, monkeypatch):
    """Stops and heights there, slip onsets, the halt, and extrema, which a tilt and a perspective move; one has points, too."""
    # An extremum that is interpolated between samples a millisecond apart is off by 0.1 us, not by the same in each run
    monkeypatch.setattr(event_prediction, "_SAMPLE_TIMES", np.linspace(0.0, DURATION, 80_001))
    path = write_blind_study(tmp_path, CASES["clean_varied"], 3, tracks_of=["six"], trials=["ten_a", "six"])
    given = read_inputs(load(path))
    names = ["clock_offset", "clock_ratio", "scale", "tilt", "foreshortening", "perspective_x"]
    extended = with_errors_of_the_camera(Problem(given.study, given.training, given.free_parameters), names)
    x = np.random.default_rng(4).normal(0, 0.2, len(extended.names))
    assert {e.quantity for d in extended.data for e in d.events} >= {"stop_time", "height_change_at_stop", "x1_extremum"}
    assert np.count_nonzero(extended.events_that_happen(x)) > 20
    assert_derivatives(extended, x, monkeypatch, step=1e-4)
