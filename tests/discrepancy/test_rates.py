"""Blind angular velocities of a held pendulum, as of a phone that is the bob, are fitted as its angles are."""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.discrepancy.fit.data import trial_data
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.report import markdown
from looping_pendulum.discrepancy.result import Verdict
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.measurement import predict
from looping_pendulum.measured.observations import Channel, Observations, rates_from_release
from looping_pendulum.measured.study import Trial
from looping_pendulum.measured.study_io import load
from looping_pendulum.reference_ode.parameters import Parameters, Release
from tests.blind.pendulum import Pendulum, motion, write_gyroscope
from tests.discrepancy.blind_study import only_candidates
from tests.discrepancy.held_study import write_held_study
from tests.discrepancy.test_held_pendulum import fitted_start

PHONE = Pendulum(mass=0.15, length=0.4, angle=0.3, rate=-4.0, quadratic_drag=4e-3)
"""An amplitude of 50 degrees."""
RELEASED = dataclasses.replace(PHONE, angle=math.radians(55), rate=0.0)
OFFSET = 0.012
"""Of the gyroscope [rad/s]."""
RIVALS = ("pivot_friction", "light_linear_drag", "clock_ratio")
TURNING_POINTS = 24


def write_study(folder, *pendulums, **options):
    defaults = {"write": write_gyroscope, "turning_points": TURNING_POINTS, "offset": OFFSET}
    return write_held_study(folder, *pendulums, **(defaults | options))


def identified(folder, *pendulums, names=RIVALS, **options):
    with only_candidates(names):
        return identify(load(write_study(folder, *pendulums, **options)))


def fitted(result):
    return {n.parameter.name.removeprefix("swing_0."): n for n in result.after.parameters}


def rates(*values, t=None, **more):
    value = np.array(values, dtype=float)
    channel = Channel(name="angle_rate", t=np.arange(len(value)) / 50 if t is None else t, value=value)
    return Observations(name="swing", file="swing.csv", channels=(channel,), **more)


@pytest.mark.long
def test_what_a_phone_measures_in_mid_swing_tells_drag_length_and_offset(tmp_path):
    result = identified(tmp_path, PHONE)
    assert result.verdict is Verdict.NO_MISSING_EFFECT
    found = fitted(result)
    # The axis of a gyroscope may point either way
    offset = math.copysign(OFFSET, found["rate_offset"].value)
    for name, value in {"light_drag": PHONE.quadratic_drag, "free_length": PHONE.length, "rate_offset": offset}.items():
        assert abs(found[name].value - value) < 3 * found[name].error, name
    angle, speed = fitted_start(result)
    assert abs(abs(angle.value - math.pi) - PHONE.angle) < 3 * angle.error
    assert abs(abs(speed.value) + PHONE.rate * PHONE.length) < 3 * speed.error
    assert "rad/s (RMS)" in result.sentence
    text = markdown.identification_markdown(result)
    assert "RMS before [mrad/s]" in text
    assert "swing_0.rate_offset" in text


@pytest.mark.long
def test_linear_drag_is_named_by_angular_velocities(tmp_path):
    braked = dataclasses.replace(PHONE, linear_drag=8e-3)
    result = identified(tmp_path, braked)
    assert result.names == ("light_linear_drag",)
    (effect,) = result.effects
    assert abs(effect.value - braked.linear_drag) < 3 * effect.error


@pytest.mark.long
@pytest.mark.parametrize("stated_angle", [True, False])
def test_a_record_that_begins_at_rest_begins_with_the_release(tmp_path, stated_angle):
    result = identified(tmp_path, RELEASED, stated_angle=stated_angle, rest=1.5)
    assert result.verdict is Verdict.NO_MISSING_EFFECT
    found = fitted(result)
    assert abs(found["light_drag"].value - RELEASED.quadratic_drag) < 3 * found["light_drag"].error
    assert "not used: angle_rate: at rest, before the release" in result.data[0]


def test_the_axis_of_a_gyroscope_points_as_the_stated_release_says():
    swing = rates(0.0, *np.sin(np.arange(100) / 10))
    same, other = (rates_from_release(swing, 1.0, angle) for angle in (math.radians(130), math.radians(230)))
    assert same is swing
    assert np.array_equal(other.channels[0].value, -swing.channels[0].value)
    assert rates_from_release(swing, 1.0, None) is swing


@pytest.mark.parametrize("amplitude", [10, 60, 85])
@pytest.mark.parametrize("time", [0.0, 0.11, 0.3, 0.47, 0.7])
def test_a_record_may_begin_anywhere_in_a_swing(tmp_path, amplitude, time):
    released = dataclasses.replace(PHONE, angle=math.radians(amplitude), rate=0.0)
    angle, rate = motion(released, np.array([0.0, time]))[:, -1]
    seen = dataclasses.replace(PHONE, angle=float(angle), rate=float(rate))
    trial = read_inputs(load(write_study(tmp_path, seen, turning_points=6))).training[0].trial
    found, speed = trial.estimates["release_angle"], trial.estimates["push_across"]
    side = math.copysign(1.0, speed.value * -rate)  # the axis may point either way
    if abs(rate) > 0.1:
        assert abs(found.value - (math.pi - side * angle)) < 2 * found.sigma
    else:
        assert abs(abs(found.value - math.pi) - abs(angle)) < 2 * found.sigma
    assert abs(abs(speed.value) - abs(rate) * PHONE.length) < speed.sigma


def test_rates_beside_angles_are_left_out():
    alone = rates(*np.sin(np.arange(60) / 5))
    angle = dataclasses.replace(alone.channels[0], name="angle")
    both = dataclasses.replace(alone, channels=(angle, *alone.channels))
    trial = Trial(name="swing", files=(("swing.csv", {}),), release=Release.HELD)
    assert [c.name for c in trial_data(trial, both).channels] == ["angle"]
    assert [c.name for c in trial_data(trial, alone).channels] == ["angle_rate"]


def test_the_camera_of_rates_has_a_clock_and_an_offset(tmp_path):
    study = load(write_study(tmp_path, PHONE, turning_points=6))
    alone = rates(*np.sin(np.arange(60) / 5))
    angle = dataclasses.replace(alone.channels[0], name="angle")
    both = dataclasses.replace(alone, channels=(angle, *alone.channels))
    assert set(study.camera_priors(study.trials[0], alone)) == {"clock_offset", "clock_ratio", "rate_offset"}
    assert set(study.camera_priors(study.trials[0], both)) == {"clock_offset", "clock_ratio", "tilt"}


def test_predicted_rates_and_their_derivatives():
    pushed = Parameters(
        release=Release.HELD, light_mass=0.15, heavy_mass=1.0, rod_radius=1e-9, release_angle=2.5, free_length=0.4,
        coefficients={"light_drag": 4e-3, "push_across": 0.3},
    )  # fmt: skip
    camera = Camera(clock_offset=-0.1, clock_ratio=1.02, rate_offset=OFFSET)
    (channel,) = rates(*np.zeros(60)).channels
    before = camera.true_time(channel.t) < 0

    def predicted(parameters, camera=camera):
        return predict(parameters, camera, [channel])["angle_rate"]

    exact = motion(
        Pendulum(mass=0.15, length=0.4, angle=math.pi - 2.5, rate=-0.3 / 0.4, quadratic_drag=4e-3, gravity=9.81),
        np.maximum(camera.true_time(channel.t), 0.0),
    )[1]
    # The blind pendulum's own tolerance is 1e-10
    assert predicted(pushed) == pytest.approx(np.where(before, OFFSET, OFFSET - camera.clock_ratio * exact), abs=1e-6)
