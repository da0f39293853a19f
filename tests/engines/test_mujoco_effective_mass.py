"""MuJoCo with the capstan law as a factor on the heavy mass, on a tendon and in the string's own coordinates."""

import math

import numpy as np
import pytest

from looping_pendulum.engines.mujoco.effective_mass import SETTINGS, MujocoEffectiveMass
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.runs.trajectory import RunStatus
from tests.apparatus import NO_DRAG, TEN_TO_ONE, TWO_TO_ONE, distances, scenario, simulated

pytest.importorskip("mujoco")

LIGHT_DRAG = {"light_drag": 2.72e-4, "heavy_drag": 1.11e-3, "string_drag": 1.56e-6}
both = pytest.mark.parametrize("coordinates", ["effective_mass", "drum"])
daily_without_drum = pytest.mark.parametrize(
    "coordinates", ["effective_mass", pytest.param("drum", marks=pytest.mark.accurate)]
)
"""Daily, test_tolerances.py runs the drum through the shipped scenarios."""


def run(coordinates, parameters, duration, *, profile=Profile.QUICK, **changes):
    return simulated(MujocoEffectiveMass(variant=coordinates, profile=profile), parameters, duration, **changes)


@both
@pytest.mark.parametrize("friction", [0.0, 0.34])
def test_vertical_release_is_an_atwood_machine_with_the_capstan_ratio(coordinates, friction):
    # Oracle: closed form. Runge-Kutta is exact for a constant acceleration; left is the share of the string that MuJoCo does
    # not enforce at once.
    p = TEN_TO_ONE.replace(release="vertical", kinetic_friction=friction, **NO_DRAG)
    trajectory = run(coordinates, p, 0.3)
    expected = 0.5 * atwood_acceleration(p) * trajectory.t**2
    np.testing.assert_allclose(trajectory.heavy_drop, expected, rtol=2e-4, atol=1e-8)


@both
def test_a_light_mass_that_whips_round_a_short_string_reaches_the_rod(coordinates):
    # A step of 1 ms in which the string turns by 1.6 rad ended the drum in a number that is none, a millisecond before the rod.
    # Oracle: the reference's end; bound: two samples.
    p = TEN_TO_ONE.replace(light_mass=0.1 / 15, heavy_mass=0.1, release_angle=math.radians(130), **LIGHT_DRAG)
    trajectory = run(coordinates, p, 0.7)
    assert trajectory.status is RunStatus.LIGHT_REACHED_ROD
    assert trajectory.t[-1] == pytest.approx(solve(p).end_time, abs=2e-3)


@both
def test_a_string_that_the_rod_can_hold_stays(coordinates):
    # Oracle: statics, M2 <= M1 e^{mu pi} = 29.1 g.
    held, slips = (TEN_TO_ONE.replace(release="vertical", heavy_mass=m, **NO_DRAG) for m in (0.0290, 0.0292))
    assert np.abs(run(coordinates, held, 0.3).heavy_drop).max() < 1e-6
    expected = 0.5 * atwood_acceleration(slips) * 0.3**2
    assert run(coordinates, slips, 0.3).heavy_drop[-1] == pytest.approx(expected, rel=1e-2)


@both
def test_drop_is_free_fall(coordinates):
    # Oracle: closed form. The drum's two coordinates turn as the mass falls, so it is a fourth-order method's fall.
    trajectory = run(coordinates, TEN_TO_ONE.replace(release="drop", **NO_DRAG), 0.3)
    fall = 0.5 * 9.81 * trajectory.t**2
    for position in (trajectory.light_position, trajectory.heavy_position):
        np.testing.assert_allclose(position[0, 1] - position[:, 1], fall, rtol=0, atol=1e-9)


@both
def test_held_pendulum_follows_the_reference(coordinates):
    # Oracle: reference. Bound: a micrometre; nothing slides and nothing is fed in.
    p = TEN_TO_ONE.replace(release="held")
    assert distances(run(coordinates, p, 1.0), p).max() < 1e-6


@pytest.mark.long
@daily_without_drum
def test_ten_to_one_keeps_the_targets(coordinates):
    # Oracle: reference. Bounds: the accurate figures of the prototype, 0.1 um, 2 um and 4 um, rounded up.
    trajectory = run(coordinates, TEN_TO_ONE, 1.0, profile=Profile.ACCURATE)
    error = distances(trajectory, TEN_TO_ONE)
    for until, bound in ((0.35, 1e-7), (0.7, 2e-6), (1.0, 4e-6)):
        assert math.sqrt(np.mean(error[trajectory.t <= until + 1e-9] ** 2)) <= bound
    halt = solve(TEN_TO_ONE).halting_time
    speed = trajectory.heavy_velocity[:, 1]
    last = int(np.flatnonzero(speed < -1e-6)[-1])
    slowing = (speed[last] - speed[last - 1]) / (trajectory.t[last] - trajectory.t[last - 1])
    # The speed's curvature over a sample is what straight lines to zero leave out: some tens of microseconds.
    assert trajectory.t[last] - speed[last] / slowing == pytest.approx(halt, abs=5e-5)
    assert np.ptp(trajectory.heavy_position[trajectory.t > halt + 1e-3, 1]) < 1e-9


@daily_without_drum
@pytest.mark.parametrize("static_friction", [0.265, pytest.param(0.307, marks=pytest.mark.accurate)])
def test_two_to_one_reverses_sticks_and_breaks_away(coordinates, static_friction):
    # Oracle: reference. Changes are found within the step, so an error is one of time, of second order in it: with a jump in
    # acceleration of at most g, g dt^2 per change, carried on for T.
    p = TWO_TO_ONE.replace(static_friction=static_friction)
    trajectory = run(coordinates, p, 1.0, profile=Profile.ACCURATE)
    exact = solve_at(p, trajectory.t, duration=1.01)
    assert {"SLIDING_UP", "STICKING", "SLIDING_DOWN"} <= {mode.name for mode in exact.run.modes}
    step = SETTINGS[coordinates, Profile.ACCURATE].time_step
    assert np.abs(trajectory.heavy_position - exact.heavy_position).max() < 9.81 * step * 0.1


@both
def test_error_falls_with_the_square_of_the_step(coordinates):
    # Oracle: order of convergence against the reference, over sliding alone. Half-way between first and second order.
    stiff = 5 if coordinates == "effective_mass" else 2
    errors = [
        distances(run(coordinates, TEN_TO_ONE, 0.3, time_step=dt, string_time_constant=stiff * dt), TEN_TO_ONE)[-1]
        for dt in (1e-3, 1e-4)
    ]
    assert errors[0] / errors[1] >= 10**1.5


@pytest.mark.long
@daily_without_drum
def test_held_string_goes_slack_and_is_caught(coordinates):
    # Oracle: reference with its slack mode. The catch is found within the step, but takes the string's time constant, in which
    # the light mass goes on at its speed at first.
    p = TEN_TO_ONE.replace(release="held", release_angle=math.radians(30))
    trajectory = run(coordinates, p, 1.0, profile=Profile.ACCURATE)
    assert trajectory.string_stretch.min() < -0.1
    way = np.linalg.norm(trajectory.light_velocity, axis=1).max()
    assert distances(trajectory, p).max() < way * SETTINGS[coordinates, Profile.ACCURATE].string_time_constant


def test_the_drum_ends_at_the_rod():
    # The light mass comes in faster than a step resolves; the run must end there all the same.
    p = TEN_TO_ONE.replace(rod_radius=0.03)
    trajectory = MujocoEffectiveMass(variant="drum").simulate(scenario(p, 0.6))
    assert trajectory.status is RunStatus.LIGHT_REACHED_ROD
    assert trajectory.t[-1] == pytest.approx(solve(p).end_time, abs=2e-3)


def test_two_rigs_in_one_process_keep_apart():
    # MuJoCo's callback is one for the whole process.
    short = scenario(TEN_TO_ONE.replace(light_drag=0.05), 0.05)
    alone = MujocoEffectiveMass(variant="drum").simulate(short)
    rigs = [MujocoEffectiveMass(variant="drum").build(short) for _ in range(2)]
    for _ in range(50):
        for rig in rigs:
            rig.advance()
    assert rigs[0].read() == rigs[1].read()
    np.testing.assert_array_equal(rigs[0].read()[:2], alone.light_position[-1])
