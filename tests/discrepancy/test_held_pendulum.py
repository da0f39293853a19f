"""Blind held pendulums: what brakes them is named or tied, a clean one stays clean, and a start in mid-swing is no push."""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.discrepancy.candidates import candidates
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.report import markdown
from looping_pendulum.discrepancy.result import Verdict
from looping_pendulum.measured.study_io import load, load_text
from tests.blind.pendulum import Pendulum, swing
from tests.discrepancy.blind_study import WHOLE_LIBRARY, only_candidates
from tests.discrepancy.held_study import write_held_study

AIR = Pendulum(quadratic_drag=8e-4)
MID_SWING = dataclasses.replace(AIR, angle=0.05, rate=-2.3)
RUBBING = Pendulum(quadratic_drag=4e-4, axle_torque=3e-4)
DAMPED = Pendulum(quadratic_drag=4e-4, axle_damping=2e-4)
SHORT, SHORTER = 0.3, 0.15
"""[m]"""


def identified(folder, *pendulums, names=WHOLE_LIBRARY, **study):
    with only_candidates(names):
        return identify(load(write_held_study(folder, *pendulums, **study)))


def explanations(result):
    return [{e.name for e in tie} for tie in result.ties] or [set(result.names)]


def start_of(folder, pendulum, **study):
    """Return the only trial of a study as it is fitted."""
    inputs = read_inputs(load(write_held_study(folder, pendulum, turning_points=6, **study)))
    return inputs.training[0].trial


@pytest.mark.parametrize("clock", [0.0, 12.34])
def test_a_record_that_begins_in_mid_swing_starts_at_its_first_point(tmp_path, clock):
    trial = start_of(tmp_path, MID_SWING, clock=clock)
    assert trial.in_mid_swing
    angle, speed = trial.estimates["release_angle"], trial.estimates["push_across"]
    assert abs(angle.value - (math.pi - MID_SWING.angle)) < angle.sigma / 5
    assert abs(speed.value + MID_SWING.rate * MID_SWING.length) < speed.sigma / 2
    assert trial.camera["clock_offset"].value == -clock


def test_a_stated_release_stays_one(tmp_path):
    trial = start_of(tmp_path, AIR, stated_angle=True)
    assert not trial.in_mid_swing
    assert "push_across" not in trial.estimates


def test_a_stated_angle_of_an_earlier_release_is_not_that_of_the_first_point(tmp_path):
    released_at = dataclasses.replace(MID_SWING, angle=math.radians(40))
    path = write_held_study(tmp_path, MID_SWING, turning_points=6, stated_angle=True)
    text = path.read_text(encoding="utf-8")
    stated = f"{180 - math.degrees(MID_SWING.angle)} deg"
    path.write_text(text.replace(stated, f"{180 - math.degrees(released_at.angle)} deg"), encoding="utf-8")
    trial = read_inputs(load(path)).training[0].trial
    assert trial.in_mid_swing
    assert trial.estimates["release_angle"].value == pytest.approx(math.pi - MID_SWING.angle, abs=0.02)


def test_a_stated_speed_is_kept(tmp_path):
    path = write_held_study(tmp_path, MID_SWING, turning_points=6)
    text = path.read_text(encoding="utf-8").replace("kind: held", "kind: held\n    speed: 1.5 m/s +/- 1 cm/s")
    trial = read_inputs(load_text(text, "study.yaml", tmp_path)).training[0].trial
    assert (trial.estimates["push_across"].value, trial.estimates["push_across"].sigma) == (1.5, 0.01)


def test_candidates_are_those_that_can_act(tmp_path):
    inputs = read_inputs(load(write_held_study(tmp_path, AIR, turning_points=6)))
    names = {c.name for c in inputs.library}
    assert {"pivot_friction", "pivot_damping", "light_inertia", "light_linear_drag"} <= names
    assert not names & {"kinetic_friction", "heavy_drag", "heavy_swing", "turning_rod", "friction_per_wrap", "push_across"}
    assert "clock_offset" not in names  # the clock of a start in mid-swing is that of its first point
    looping = dataclasses.replace(inputs.study, trials=tuple(
        dataclasses.replace(t, release="looping") for t in inputs.study.trials
    ))  # fmt: skip
    assert not {c.name for c in candidates(looping, (), ())} & {"pivot_friction", "pivot_damping"}


def fitted_start(result):
    """Return the fitted angle and speed at the first point of the record that begins in mid-swing."""
    parameters = {n.parameter.name.partition(".")[2]: n for n in result.after.parameters}
    return parameters["release_angle"], parameters["push_across"]


@pytest.mark.long
def test_a_start_in_mid_swing_is_reported_and_no_push(tmp_path):
    names = ("pivot_friction", "pivot_damping", "side_force", "tilt", "push_along")
    result = identified(tmp_path, MID_SWING, names=names, turning_points=30)
    assert result.verdict is Verdict.NO_MISSING_EFFECT
    angle, speed = fitted_start(result)
    assert abs(angle.value - (math.pi - MID_SWING.angle)) < 4 * angle.error + 2e-3  # the operator's origin: 1 mm of 65 cm
    assert abs(speed.value + MID_SWING.rate * MID_SWING.length) < 4 * speed.error
    assert "These records begin in mid-swing" in markdown.identification_markdown(result)


@pytest.mark.long
def test_friction_of_the_pivot_is_named_among_losses(tmp_path):
    names = ("pivot_friction", "pivot_damping", "light_drag")
    rubbing = Pendulum(axle_torque=1e-3)
    result = identified(tmp_path, rubbing, names=names, turning_points=24, declared=())
    assert result.verdict is Verdict.IDENTIFIED
    (effect,) = result.effects
    assert effect.name == "pivot_friction"
    assert abs(effect.value - rubbing.axle_torque) < 4 * effect.error


@pytest.mark.accurate  # daily, friction of the pivot is named among all losses
def test_damping_of_the_pivot_and_linear_drag_are_tied_until_another_length(tmp_path):
    result = identified(tmp_path, DAMPED, names=("pivot_damping", "light_linear_drag"), turning_points=24)
    assert result.verdict is Verdict.AMBIGUOUS
    assert {frozenset(names) for names in explanations(result)} == {
        frozenset({"pivot_damping"}), frozenset({"light_linear_drag"}),
    }  # fmt: skip
    best = result.next_experiments[0]
    assert best.distance > 10
    assert best.free_length != pytest.approx(DAMPED.length, rel=0.3)
    assert f"{100 * best.free_length:.3g}" in markdown.identification_markdown(result)


@pytest.mark.accurate
def test_two_lengths_tell_damping_of_the_pivot_from_drag(tmp_path):
    result = identified(tmp_path, DAMPED, dataclasses.replace(DAMPED, length=SHORT))
    assert result.names == ("pivot_damping",)


@pytest.mark.accurate
@pytest.mark.parametrize(
    ("pendulum", "declared", "expected"),
    [
        pytest.param(AIR, ("light_drag",), set(), id="clean"),
        pytest.param(MID_SWING, ("light_drag",), set(), id="mid-swing"),
        pytest.param(RUBBING, ("light_drag",), {frozenset({"pivot_friction"})}, id="constant friction"),
        pytest.param(
            DAMPED, ("light_drag",), {frozenset({"pivot_damping"}), frozenset({"light_linear_drag"})}, id="viscous friction"
        ),
        pytest.param(AIR, (), {frozenset({"light_drag"}), frozenset({"string_drag"})}, id="air"),
        # Of one length, all that changes the period by a factor is the same; gravity would be 9.75 m/s^2, as nowhere on Earth
        pytest.param(
            dataclasses.replace(AIR, bob_radius=0.08), ("light_drag",),
            {frozenset({"light_inertia"}), frozenset({"clock_ratio"})}, id="bob",
        ),
    ],
)  # fmt: skip
def test_a_hundred_turning_points_among_the_whole_library(tmp_path, pendulum, declared, expected):
    result = identified(tmp_path, pendulum, declared=declared)
    if not expected:
        assert result.verdict is Verdict.NO_MISSING_EFFECT
        assert not result.effects
        return
    assert {frozenset(names) for names in explanations(result)} == expected


@pytest.mark.accurate
def test_the_size_of_a_bob_is_named_by_three_lengths(tmp_path):
    ball = dataclasses.replace(AIR, bob_radius=0.04)
    result = identified(tmp_path, *(dataclasses.replace(ball, length=length) for length in (SHORT, ball.length, SHORTER)))
    assert result.names == ("light_inertia",)
    assert abs(result.effects[0].value - 0.4 * ball.mass * ball.bob_radius**2) < 3 * result.effects[0].error


def test_blind_pendulum_keeps_its_energy_without_losses():
    p = Pendulum(angle=2.0, bob_radius=0.1)
    t = np.linspace(0, 10, 2001)
    phi = swing(p, t)
    rate = np.gradient(phi, t)
    energy = p.inertia * rate**2 / 2 - p.mass * p.gravity * p.length * np.cos(phi)
    assert np.ptp(energy[2:-2]) < 1e-3 * p.mass * p.gravity * p.length  # the differences' error
