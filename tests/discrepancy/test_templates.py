"""Templates of listed effects: changes of a given size are found, whatever their power of the value; what would show, shows."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from benchmarks.blind_sample import draw, write_files
from looping_pendulum.discrepancy.evidence.explanation import raw
from looping_pendulum.discrepancy.evidence.marginal import Marginal, NoiseGrid
from looping_pendulum.discrepancy.evidence.prior import VISIBLE
from looping_pendulum.discrepancy.evidence.templates import _chosen, _next_try, columns, finer, smallest_visible, templates
from looping_pendulum.discrepancy.fit.calibration import calibrate, minimise
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.measured.study_io import load
from tests.blind.cases import CASES
from tests.discrepancy.blind_study import write_study


def found(change, first, reach, sizes, smallest):
    """Look for changes of these sizes as templates do; return them, and every value that was tried."""
    rms, tries, steps = {}, [first], 0
    while tries and steps < 12:
        rms |= {value: change(value) for value in tries}
        known = sorted(rms.items())
        tries = [value for size in sizes if (value := _next_try(known, reach, size, smallest)) is not None]
        steps += 1
    return [_chosen(sorted(rms.items()), 1.0, reach, size) for size in sizes], rms, steps


def visible(fit, chosen):
    """Return candidate's name -> its smallest visible size beside a fit."""
    found = templates(fit, chosen)
    grid = NoiseGrid(fit.problem.data)
    m = Marginal(grid, raw(fit), columns(found, grid.count), settings=[0])
    return {v.name: v for v in smallest_visible(fit, found, m.complement[0])}


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("first", [1e-6, 4.0])
def test_sizes_are_met_in_few_steps(power, first):
    values, rms, steps = found(lambda value: 40.0 * value**power, first, 5.0, [0.3, 3.0, 12.0], 0.0)
    for value, size in zip(values, [0.3, 3.0, 12.0], strict=True):
        assert 0.5 < rms[value] / size < 2
    assert steps <= 8


@pytest.mark.parametrize("first", [1e-6, 1e-3])
def test_below_a_value_that_cannot_run_nothing_is_tried(first):
    """A string that stretches too little takes more steps than the integrator has: no smaller value would run."""
    (value,), rms, _ = found(lambda value: 1e5 * value if value > 5e-5 else math.inf, first, 0.1, [0.3], 1e-6)
    assert value is None
    assert len(rms) <= 2


def test_the_reach_is_taken_if_something_changes_there():
    assert found(lambda value: 0.2 * value, 1e-3, 0.5, [0.3], 0.0)[0] == [0.5]
    assert found(lambda value: 0.01 * value, 1e-3, 0.5, [0.3], 0.0)[0] == [None]


def test_a_push_out_of_the_plane_counts_by_its_square(tmp_path):
    inputs = read_inputs(load(write_study(tmp_path, CASES["clean"], 0, trials=["ten_a"])))
    fit = calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))
    (push,) = (c for c in inputs.library if c.name == "push_sideways")
    assert push.bounds[0] < 0
    assert push.free_parameter(1.0).bounds == (0.0, push.bounds[1])
    problem = fit.problem.with_parameters(push.free_parameter(1.0))
    here = fit.problem.residuals(fit.x)

    def independent(value):
        moved = problem.residuals(np.append(fit.x, value))
        difference = (here - moved[: len(here)])[: fit.problem.measured_rows]
        basis, _ = np.linalg.qr(fit.jacobian[: len(difference)])
        return np.linalg.norm(difference - basis @ (basis.T @ difference))

    size = visible(fit, [push])["push_sideways"].value
    # At twice the value it is four times as many standard errors large
    assert independent(size) == pytest.approx(VISIBLE, rel=0.1)
    assert independent(2 * size) == pytest.approx(4 * VISIBLE, rel=0.2)


def test_a_rod_whose_bearing_holds_it_can_hide_at_any_size(tmp_path):
    """Of blind studies that missed an effect of more than twice its smallest visible size, two thirds hid such a rod."""
    inputs = read_inputs(load(write_study(tmp_path, CASES["clean"], 0, trials=["ten_a"])))
    fit = calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))
    chosen = [c for c in inputs.library if c.name in ("rod_mobility", "push_sideways", "light_linear_drag")]
    assert {name: v.can_hide for name, v in visible(fit, chosen).items()} == {
        "rod_mobility": True, "push_sideways": False, "light_linear_drag": False,
    }  # fmt: skip


def test_a_wrong_mass_beside_a_fitted_one_is_judged_by_what_is_linear(tmp_path):
    """Oracle: the fitted mass's own derivative. Only its weighing tells the two apart, so that curvature had passed for more.

    That nothing was missing had been the verdict, though by the report an error of a twentieth would have shown.
    """
    inputs = read_inputs(load(write_files(draw("rates", "single", 161, 14)[160], tmp_path)))
    fit = calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))
    size = visible(fit, [c for c in inputs.library if c.name == "wrong_light_mass"])["wrong_light_mass"].value
    i = fit.problem.names.index("light_mass")
    factor = fit.jacobian[:, i] * fit.values["light_mass"] / fit.problem.free_parameters[i].scale
    factor[fit.problem.measured_rows :] = 0.0  # the prior is that of the weighed mass
    basis, _ = np.linalg.qr(fit.jacobian)
    assert size == pytest.approx(VISIBLE / np.linalg.norm(factor - basis @ (basis.T @ factor)), rel=0.02)


CHOSEN = ("scale", "tilt", "clock_offset", "wrong_free_length", "wrong_light_mass", "light_linear_drag")


def test_the_smallest_visible_size_is_four_standard_errors_of_a_fit(tmp_path):
    """Oracle: the standard error of a fit with the effect. From finite changes, linear drag's was 6.3 times too small."""
    inputs = read_inputs(load(write_study(tmp_path, CASES["clean"], 2)))
    fit = calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))
    found = visible(fit, [c for c in inputs.library if c.name in CHOSEN])
    assert set(found) == set(CHOSEN)
    for candidate in (c for c in inputs.library if c.name in CHOSEN):
        name, v = candidate.name, found[candidate.name]
        own = dataclasses.replace(candidate.free_parameter(v.value), prior=1e3)  # the data alone say how large it is
        fitted = minimise(fit.problem.with_parameters(own), np.append(fit.x, 0.0))
        assert v.value == pytest.approx(VISIBLE * fitted.errors[name], rel=0.1), name


@pytest.mark.parametrize("central", [True, False])
def test_a_change_that_fitted_parameters_nearly_undo_is_taken_where_it_is_linear(central):
    linear, curved = np.array([1.0, 0.0]), np.array([0.0, 0.5])

    def change(delta):
        return linear * delta + curved * delta * abs(delta)

    known = {2.0 * share: change(2.0 * share) for share in (1.0, 0.1, -0.1)}
    assert finer(known, 2.0, central, known[2.0]) == pytest.approx([2.0, 0.2])  # a tenth of the curvature
    assert finer(dict.fromkeys(known), 2.0, central, known[2.0]) is known[2.0]
