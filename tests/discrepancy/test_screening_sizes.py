"""Screening finds the change of a value that changes the prediction by a given size, whatever its power of the value."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.blind_sample import draw, write_files
from looping_pendulum.discrepancy.data.study_io import load
from looping_pendulum.discrepancy.fit.calibration import calibrate
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.listed.screening import MAX_NULL_SCORE, _find_template, _finer, screen
from tests.blind.cases import CASES
from tests.discrepancy.blind_study import write_study


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("first", [1e-6, 4.0])
def test_a_size_is_met_in_few_steps_and_the_value_is_that_of_the_change(power, first):
    tried = []

    def change(delta):
        tried.append(delta)
        return np.full(5, 40.0 * abs(delta) ** power)

    delta, template = _find_template(change, first, 5.0, 0.3, 0.0)
    assert 0.15 < template[0] < 0.6
    assert template[0] == pytest.approx(40.0 * delta**power)
    assert len(tried) <= 8


@pytest.mark.parametrize("first", [1e-6, 1e-3])
def test_below_a_value_that_cannot_run_nothing_is_tried(first):
    """A string that stretches too little takes more steps than the integrator has: no smaller value would run."""
    tried = []

    def change(delta):
        tried.append(delta)
        return np.full(5, 1e5 * delta) if delta > 5e-5 else None

    _, template = _find_template(change, first, 0.1, 0.3, 1e-6)
    assert template is None
    assert len(tried) <= 2


def test_a_push_out_of_the_plane_counts_by_its_square(tmp_path):
    inputs = read_inputs(load(write_study(tmp_path, CASES["clean"], 0, trials=["ten_a"])))
    fit = calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))
    (push,) = (c for c in inputs.library if c.name == "push_sideways")
    assert push.bounds[0] < 0
    assert push.free_parameter(1.0).bounds == (0.0, push.bounds[1])
    (screened,) = screen(fit, [push])
    problem = fit.problem.with_parameters(push.free_parameter(1.0))
    here = fit.problem.residuals(fit.x)

    def independent(value):
        moved = problem.residuals(np.append(fit.x, value))
        difference = (here - moved[: len(here)])[: fit.problem.measured_rows]
        basis, _ = np.linalg.qr(fit.jacobian[: len(difference)])
        return np.linalg.norm(difference - basis @ (basis.T @ difference))

    visible = MAX_NULL_SCORE * screened.error
    # The score at that value is that of the limit, and at twice the value four times as large
    assert independent(visible) == pytest.approx(MAX_NULL_SCORE, rel=0.1)
    assert independent(2 * visible) == pytest.approx(4 * MAX_NULL_SCORE, rel=0.2)


def test_a_rod_whose_bearing_holds_it_can_hide_at_any_size(tmp_path):
    """Of blind studies that missed an effect of more than twice its smallest visible size, two thirds hid such a rod."""
    inputs = read_inputs(load(write_study(tmp_path, CASES["clean"], 0, trials=["ten_a"])))
    fit = calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))
    chosen = [c for c in inputs.library if c.name in ("rod_mobility", "push_sideways", "light_linear_drag")]
    assert {s.candidate.name: s.can_hide for s in screen(fit, chosen)} == {
        "rod_mobility": True, "push_sideways": False, "light_linear_drag": False,
    }  # fmt: skip


def test_a_wrong_mass_beside_a_fitted_one_is_screened_by_what_is_linear(tmp_path):
    """Oracle: the fitted mass's own derivative. Only its weighing tells the two apart, so that curvature had passed for more.

    That nothing was missing had been the verdict, though by the report an error of a twentieth would have shown.
    """
    inputs = read_inputs(load(write_files(draw("rates", "single", 161, 14)[160], tmp_path)))
    fit = calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))
    (screened,) = screen(fit, [c for c in inputs.library if c.name == "wrong_light_mass"])
    i = fit.problem.names.index("light_mass")
    factor = fit.jacobian[:, i] * fit.values["light_mass"] / fit.problem.free_parameters[i].scale
    factor[fit.problem.measured_rows :] = 0.0  # the prior is that of the weighed mass
    basis, _ = np.linalg.qr(fit.jacobian)
    assert screened.error == pytest.approx(1 / np.linalg.norm(factor - basis @ (basis.T @ factor)), rel=0.02)


@pytest.mark.parametrize("central", [True, False])
def test_a_change_that_fitted_parameters_nearly_undo_is_taken_where_it_is_linear(central):
    linear, curved = np.array([1.0, 0.0]), np.array([0.0, 0.5])

    def change(delta):
        return linear * delta + curved * delta * abs(delta)

    template = change(2.0)
    assert _finer(change, 2.0, central, template) == pytest.approx([2.0, 0.2])  # a tenth of the curvature
    assert _finer(lambda delta: None, 2.0, central, template) is template
