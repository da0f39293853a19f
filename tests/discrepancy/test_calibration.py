"""The fit: planted values come back, wrong starts end at the same place, derivatives are derivatives, bounds hold."""

import math

import numpy as np
import pytest

from looping_pendulum.discrepancy.fit.calibration import calibrate, minimise
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.measured.study_io import load
from tests.blind import Apparatus
from tests.blind.cases import CLEAN, TRIALS
from tests.discrepancy.blind_study import write_study


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    inputs = read_inputs(load(write_study(tmp_path_factory.mktemp("clean"), CLEAN, 0)))
    return Problem(inputs.study, inputs.training, inputs.free_parameters)


@pytest.fixture(scope="module")
def fit(problem):
    return refit_with_estimated_noise(calibrate(problem))


def test_planted_values_come_back(fit):
    true = Apparatus()
    values, errors = fit.values, fit.errors
    for name, planted in (
        ("kinetic_friction", true.friction),
        ("light_drag", true.light_drag),
        ("string_drag", true.string_drag),
        ("rod_radius", true.rod_radius),
        ("ten_a.release_angle", TRIALS[0].release_angle),
        ("six.free_length", true.free_length),
    ):
        assert abs(values[name] - planted) < 4 * errors[name], name  # 6 numbers: one in 3000 sets by chance
    ratio = values["ten_a.heavy_mass"] / values["light_mass"]
    assert ratio == pytest.approx(10, rel=5e-3)  # only the ratio is seen; each mass is known to 0.5 %


@pytest.mark.long
def test_wrong_initial_values_end_at_the_same_minimum(problem, fit):
    rng = np.random.default_rng(1)
    for _ in range(4):
        start = np.clip(2 * rng.standard_normal(len(problem.free_parameters)), problem.low, problem.high)
        refitted = calibrate(fit.problem, start)
        # the last iterations gain less than a millionth; where a window's event sequence changes, the cost has small steps
        assert refitted.cost == pytest.approx(fit.cost, abs=0.2)


def test_a_fit_ends_at_the_minimum(fit):
    """Oracle: the Gauss-Newton step by central differences there, which is zero at a minimum."""
    sigmas = np.array([fit.errors[name] for name in fit.problem.names]) / [n.scale for n in fit.problem.free_parameters]
    signs = np.random.default_rng(3).choice([-1.0, 1.0], len(sigmas))
    found = minimise(fit.problem, np.clip(fit.x + 0.5 * signs * sigmas, fit.problem.low, fit.problem.high))
    jacobian = fit.problem.jacobian(found.x)
    free = [i for i, name in enumerate(fit.problem.names) if name not in found.at_bounds]
    step = np.linalg.lstsq(jacobian[:, free], found.residuals, rcond=None)[0]
    assert np.abs(step / sigmas[free]).max() < 0.02


def test_derivatives_agree_with_coarser_central_differences(fit):
    p = fit.problem
    fine = fit.jacobian[: p.count]
    for i, name in enumerate(p.names):
        if name == "heavy_drag":  # on its bound, where only one side exists
            continue
        moved = [p.residuals(fit.x + s * 5e-3 * np.eye(len(fit.x))[i]) for s in (1, -1)]
        coarse = (moved[1] - moved[0])[: p.count] / 1e-2
        assert np.linalg.norm(coarse - fine[:, i]) < 1e-2 * np.linalg.norm(fine[:, i]), name


def test_correlations_name_what_the_data_cannot_tell_apart(fit):
    pairs = {frozenset(pair[:2]) for pair in fit.correlations()}
    assert frozenset({"ten_a.heavy_mass", "six.heavy_mass"}) in pairs  # both only through their ratio to the light mass
    assert all(abs(c) > 0.9 for *_, c in fit.correlations())
    assert math.isfinite(fit.condition)


@pytest.mark.long
def test_bounds_hold_and_are_reported(problem):
    tight = Problem(
        problem.study,
        problem.data,
        [n if n.name != "kinetic_friction" else _with_narrow_bounds(n) for n in problem.free_parameters],
    )
    fit = minimise(tight, tight.prior_mean)
    assert fit.values["kinetic_friction"] == pytest.approx(0.32)
    assert "kinetic_friction" in fit.at_bounds


def _with_narrow_bounds(parameter):
    import dataclasses

    return dataclasses.replace(parameter, bounds=(0.2, 0.32))
