"""MuJoCo's tendon, documented and with the capstan law, against closed forms, geometry and the reference."""

import math
from dataclasses import replace

import numpy as np
import pytest

from looping_pendulum.engines.mujoco import engines
from looping_pendulum.engines.mujoco.tendon import SETTINGS, MujocoTendon, TendonSettings
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.runs.trajectory import RunStatus
from tests.apparatus import NO_DRAG, TEN_TO_ONE, TWO_TO_ONE, scenario

pytest.importorskip("mujoco")

VARIANTS = ("documented", "capstan")
CREEP = 1e-6
"""Largest speed of a string that the rod holds [m/s], as `TendonSettings.rest_speed` says."""


def with_step(time_step):
    quick = SETTINGS[Profile.QUICK]
    return replace(quick, time_step=time_step, string_time_constant=2 * time_step, friction_time_constant=2 * time_step)


def run(parameters, duration, *, variant="capstan", profile=Profile.QUICK, time_step=None):
    settings = None if time_step is None else with_step(time_step)
    engine = MujocoTendon(variant=variant, profile=profile, settings=settings)
    return engine.simulate(scenario(parameters, duration)).raise_if_failed()


def light_error(trajectory, parameters, until=math.inf):
    """Return the distance of the light mass from the reference's [m], at the samples after release up to ``until`` [s]."""
    watched = (trajectory.t > 0) & (trajectory.t <= until + 1e-9)
    t = trajectory.t[watched]
    exact = solve_at(parameters, t, duration=t[-1] + 0.01)
    return np.linalg.norm(trajectory.light_position[watched] - exact.light_position, axis=1)


def rms(error):
    return float(np.sqrt(np.mean(error**2)))


def test_every_variant_is_offered_in_its_profile():
    names = ["documented", "capstan", "frictionloss", "defaults", "beads"]
    for profile in Profile:
        assert [(e.variant, e.profile) for e in engines(profile)] == [(name, profile) for name in names]


def test_a_comparison_runs_what_is_cheap_and_sound():
    main = {e.variant for e in engines(Profile.QUICK) if e.abilities.main}
    assert main == {"documented", "capstan", "beads"}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("profile", Profile)
def test_vertical_release_is_an_atwood_machine(variant, profile):
    # Oracle: closed form, a = g (M2 - M1 E) / (M2 + M1 E), E = exp(mu pi). A leapfrog step is exact for a constant
    # acceleration, so what is left is the share of a constraint that MuJoCo does not enforce at once.
    parameters = TEN_TO_ONE.replace(release="vertical", **NO_DRAG)
    pull = 0.01 * (math.exp(0.34 * math.pi) if variant == "capstan" else 1.0)
    expected = 0.5 * 9.81 * (0.1 - pull) / (0.1 + pull)
    trajectory = run(parameters, 0.35, variant=variant, profile=profile)
    share = 1 - SETTINGS[profile].impedance
    assert np.all(np.abs(trajectory.heavy_drop - expected * trajectory.t**2) <= share * expected * trajectory.t**2 + 1e-9)


@pytest.mark.parametrize(
    ("parameters", "duration", "least_turning"),
    [
        (TEN_TO_ONE, 1.05, 3 * 2 * math.pi),  # winds for more than three turns
        (TEN_TO_ONE.replace(release="held", release_angle=math.radians(320)), 2.0, math.pi),  # and winds to and fro
        (TEN_TO_ONE.replace(release="held", release_angle=math.radians(250), rod_radius=0.03), 2.0, math.pi / 2),
    ],
)
def test_winding_keeps_the_string_as_long_as_it_is(parameters, duration, least_turning):
    # Oracle: geometry, l + R theta + h = L, with theta counted from positions alone. A slack string may be shorter; a taut one
    # is off by what pulls back an acceleration of l omega^3 dt (the turning's change in a step; l omega^2 is allowed for) with
    # a time constant of 2 dt, and after a catch by a step's way.
    trajectory = run(parameters, duration)
    dt = SETTINGS[Profile.QUICK].time_step
    length = trajectory.free_length + parameters.rod_radius * trajectory.wrap_angle - trajectory.heavy_position[:, 1]
    speed = np.linalg.norm(trajectory.light_velocity, axis=1)
    was_slack = length.min() < parameters.string_length - 1e-3
    allowed = speed.max() * dt if was_slack else np.max(speed**3 / trajectory.free_length**2) * dt * (2 * dt) ** 2
    assert np.ptp(trajectory.wrap_angle) > least_turning
    assert length.max() - parameters.string_length <= allowed
    np.testing.assert_allclose(trajectory.string_stretch, length - parameters.string_length, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("parameters", "until"),
    [
        (TEN_TO_ONE, 0.3),
        (TEN_TO_ONE, 0.5),  # past the halt
        (TWO_TO_ONE, 0.45),  # past the reversal of the heavy mass
        (TWO_TO_ONE, 0.7),  # past its stop and its breaking away
        (TEN_TO_ONE.replace(release="held"), 1.0),
    ],
)
def test_error_falls_with_the_square_of_the_step(parameters, until):
    # Oracle: order of convergence against the reference. A tenth of the step leaves a hundredth of the error at second order, a
    # tenth at first; the bound is half-way between the two in logarithm.
    coarse, fine = (rms(light_error(run(parameters, until, time_step=dt), parameters)) for dt in (1e-3, 1e-4))
    assert coarse / fine >= 10**1.5


@pytest.mark.long
def test_ten_to_one_accurate_keeps_its_targets():
    # Oracle: reference. Bounds of the path: five times what was measured, 7, 31 and 48 nm, or more.
    trajectory = run(TEN_TO_ONE, 1.05, profile=Profile.ACCURATE)
    assert rms(light_error(trajectory, TEN_TO_ONE, 0.35)) <= 1e-7
    assert rms(light_error(trajectory, TEN_TO_ONE, 0.7)) <= 5e-7
    assert rms(light_error(trajectory, TEN_TO_ONE, 1.0)) <= 1e-6
    speed = trajectory.heavy_velocity[:, 1]
    last = int(np.flatnonzero(np.abs(speed) > 1e-4)[-1])
    slowing = (speed[last] - speed[last - 1]) / (trajectory.t[last] - trajectory.t[last - 1])
    halt = trajectory.t[last] - speed[last] / slowing
    # The speed's curvature over a sample is what straight lines to zero leave out: some tens of microseconds.
    assert abs(halt - solve(TEN_TO_ONE).halting_time) <= 5e-5
    assert np.ptp(trajectory.heavy_position[trajectory.t > halt + 1e-3, 1]) <= CREEP * 1.05


@pytest.mark.parametrize("profile", Profile)
def test_the_rod_holds_what_it_can_and_lets_the_rest_slip(profile):
    # Oracle: statics, M2 <= M1 e^{mu pi} = 29.1 g, and the closed form of what is heavier. There weight and friction cancel to
    # 0.3 %, so the share of a constraint that is not enforced at once may show; bound: five times the 0.08 % measured, or more.
    held, slips = (TEN_TO_ONE.replace(release="vertical", heavy_mass=m, **NO_DRAG) for m in (0.0290, 0.0292))
    assert np.abs(run(held, 0.3, profile=profile).heavy_drop).max() < CREEP * 0.3
    expected = 0.5 * atwood_acceleration(slips) * 0.3**2
    assert run(slips, 0.3, profile=profile).heavy_drop[-1] == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize(
    "parameters",
    [
        # It whips round a short string: in the last step of 1 ms the string turns by 1.6 rad.
        TEN_TO_ONE.replace(
            light_mass=0.1 / 15, release_angle=math.radians(130), light_drag=2.72e-4, heavy_drag=1.11e-3, string_drag=1.56e-6
        ),
        TEN_TO_ONE.replace(rod_radius=0.03),
    ],
)
def test_a_run_ends_where_the_light_mass_reaches_the_rod(parameters):
    # Oracle: the reference's end; bound: two samples.
    trajectory = run(parameters, 0.7)
    assert trajectory.status is RunStatus.LIGHT_REACHED_ROD
    assert trajectory.t[-1] == pytest.approx(solve(parameters).end_time, abs=2e-3)


@pytest.mark.parametrize("static_friction", [0.265, *(pytest.param(mu, marks=pytest.mark.accurate) for mu in (0.28, 0.307))])
def test_two_to_one_reverses_sticks_and_breaks_away_when_the_reference_does(static_friction):
    # Oracle: reference. A change of mode is resolved to the step, so the heavy mass may be off by its jump in acceleration, at
    # most g, for one step, carried to the end: g dt T.
    parameters = TWO_TO_ONE.replace(static_friction=static_friction)
    trajectory = run(parameters, 1.0, profile=Profile.ACCURATE)
    exact = solve_at(parameters, trajectory.t, duration=1.01)
    modes = {mode.name for mode in exact.run.modes}
    assert {"SLIDING_UP", "STICKING", "SLIDING_DOWN"} <= modes
    bound = 9.81 * SETTINGS[Profile.ACCURATE].time_step * 1.0
    np.testing.assert_allclose(trajectory.heavy_position, exact.heavy_position, rtol=0, atol=bound)
    sticking = exact.mode == 0
    inside = sticking & np.roll(sticking, 1) & np.roll(sticking, -1)
    assert np.all(np.abs(trajectory.heavy_velocity[inside, 1]) <= SETTINGS[Profile.ACCURATE].rest_speed)


def test_documented_never_halts_and_follows_the_frictionless_reference():
    # Oracle: reference with no friction. Bound: twice the capstan variant's target, as M2 turns sharply here.
    trajectory = run(TEN_TO_ONE, 0.6, variant="documented", profile=Profile.ACCURATE)
    assert rms(light_error(trajectory, TEN_TO_ONE.replace(kinetic_friction=0.0), 0.35)) <= 0.3e-3
    at_rest = np.abs(trajectory.heavy_velocity[1:, 1]) < 1e-4
    assert not np.any(at_rest[1:] & at_rest[:-1])
    assert trajectory.heavy_velocity[-1, 1] > 0  # it bounced


@pytest.mark.long
@pytest.mark.parametrize("angle", [30, 320])
def test_held_string_goes_slack_and_is_caught(angle):
    # Oracle: reference with its slack mode. Bound: a catch comes up to a step's way late.
    parameters = TEN_TO_ONE.replace(release="held", release_angle=math.radians(angle))
    trajectory = run(parameters, 1.5, profile=Profile.ACCURATE)
    way = np.linalg.norm(trajectory.light_velocity, axis=1).max() * SETTINGS[Profile.ACCURATE].time_step
    assert trajectory.string_stretch.min() < -0.1
    assert light_error(trajectory, parameters).max() <= way


def test_sliding_string_goes_slack_and_is_caught():
    # Oracle: reference with its slack mode; strong drag on the heavy mass lets the light one overtake it. Bound as above.
    parameters = Parameters(
        light_mass=0.01,
        heavy_mass=0.102,
        rod_radius=0.0056,
        free_length=0.58,
        release_angle=math.radians(28),
        coefficients={"kinetic_friction": 0.482, "heavy_drag": 0.321, "string_drag": 0.000474},
    )
    trajectory = run(parameters, 0.8, profile=Profile.ACCURATE)
    way = np.linalg.norm(trajectory.light_velocity, axis=1).max() * SETTINGS[Profile.ACCURATE].time_step
    assert trajectory.string_stretch.min() < -5e-3
    assert light_error(trajectory, parameters).max() <= way


def test_breakdown_is_reported_as_not_finite(monkeypatch, tmp_path):
    # MuJoCo warns into a file in the working directory and steps on.
    monkeypatch.chdir(tmp_path)
    engine = MujocoTendon()
    rig = engine.build(scenario(TEN_TO_ONE, 0.01))
    rig._qvel[0] = 1e20  # beyond what MuJoCo takes for a velocity
    monkeypatch.setattr(engine, "build", lambda _: rig)
    assert engine.simulate(scenario(TEN_TO_ONE, 0.01)).status is RunStatus.NOT_FINITE


def test_time_step_must_divide_the_sample_interval():
    settings = TendonSettings(time_step=3e-4, string_time_constant=6e-4, friction_time_constant=6e-4)
    with pytest.raises(EngineError, match="time_step: found 0.0003 s"):
        MujocoTendon(settings=settings).simulate(scenario(TEN_TO_ONE, 0.01))
