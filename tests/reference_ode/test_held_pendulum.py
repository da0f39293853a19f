"""Losses at a held pendulum's pivot, the size of its bob: closed forms, the separate pendulum."""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.reference_ode.batch import solve_batch
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.sensitivity import solve_sensitivities
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.reference_ode.transitions import Event, Mode
from tests.apparatus import TEN_TO_ONE
from tests.blind.pendulum import Pendulum, swing

MASS, LENGTH, G = 0.0415, 0.65, 9.81
WEIGHT_TORQUE = MASS * G * LENGTH
"""m g l [N m]."""


def pendulum(angle: float, **coefficients: float) -> Parameters:
    """Return a pendulum that is let go at ``angle`` [rad] from the vertical; its rod is a pivot without thickness."""
    return Parameters(
        light_mass=MASS, heavy_mass=1.0, rod_radius=1e-9, free_length=LENGTH, release_angle=math.pi - angle, release="held",
        coefficients={"gravity": G} | coefficients,
    )  # fmt: skip


def turning_angles(run) -> np.ndarray:
    """Return the angle from the vertical at each turning point [rad]."""
    return np.array([math.pi - e.state.wrap_angle for e in run.events if e.event is Event.ACROSS_REVERSES])


def test_constant_friction_takes_the_same_from_every_half_swing_and_then_holds():
    # Small swings about -tau0 / (m g l) and +tau0 / (m g l) in turn: each is smaller than the last by twice that
    friction = 1e-3 * WEIGHT_TORQUE
    run = solve(pendulum(0.0195, pivot_friction=friction), duration=25.0)
    expected = [(0.0195 - 2e-3 * n) * (-1) ** n for n in range(1, 11)]  # until it is below 1e-3
    bound = 0.0195**2 / 6 * 0.0195  # sin(phi) is phi to this
    assert np.allclose(turning_angles(run), expected, rtol=0, atol=10 * bound)
    assert run.modes == (Mode.CLAMPED, Mode.ENDED)
    rest = run.sample(np.array([20.0, 25.0])).state
    assert (rest.across_speed == 0).all()
    assert np.ptp(rest.wrap_angle) < 1e-12


def test_a_pendulum_within_its_friction_is_not_let_go():
    for angle in (0.02, -0.02):
        held = solve(pendulum(angle, pivot_friction=0.021 * WEIGHT_TORQUE), duration=1.0)
        assert held.end.state.wrap_angle == math.pi - angle
        moves = solve(pendulum(angle, pivot_friction=0.019 * WEIGHT_TORQUE), duration=0.1)
        assert (moves.end.state.wrap_angle - math.pi + angle) * angle > 0


def test_a_batch_stops_as_a_single_run_does():
    base, friction = pendulum(0.02), np.array([0.0, 1e-3, 2e-3, 0.03]) * WEIGHT_TORQUE
    together = solve_batch(base, {"pivot_friction": friction}, duration=15.0)
    single = [solve(base.replace(pivot_friction=value), duration=15.0).end.state.wrap_angle for value in friction]
    assert np.allclose(together.wrap_angle, single, rtol=0, atol=1e-10)


def test_viscous_friction_damps_small_swings_exponentially():
    damping = 5e-3
    rate = damping / (2 * MASS * LENGTH**2)
    t = np.linspace(0, 6.0, 61)
    angle = math.pi - solve_at(pendulum(1e-3, pivot_damping=damping), t, duration=6.1).state.wrap_angle
    omega = math.sqrt(G / LENGTH - rate**2)
    expected = 1e-3 * np.exp(-rate * t) * (np.cos(omega * t) + rate / omega * np.sin(omega * t))
    assert np.allclose(angle, expected, rtol=0, atol=1e-9)  # the phase of a finite amplitude, phi^2 / 16 of omega t


def test_damping_of_the_pivot_is_linear_drag_for_one_length():
    t = np.linspace(0, 5.0, 101)
    one = solve_at(pendulum(1.0, pivot_damping=1e-3), t, duration=5.1).state.wrap_angle
    other = solve_at(pendulum(1.0, light_linear_drag=1e-3 / LENGTH**2), t, duration=5.1).state.wrap_angle
    assert np.allclose(one, other, rtol=0, atol=1e-8)


def test_a_bob_with_size_swings_as_in_weaker_gravity():
    inertia = 0.4 * MASS * 0.2**2
    t = np.linspace(0, 5.0, 101)
    sized = solve_at(pendulum(1.4, light_inertia=inertia), t, duration=5.1).state.wrap_angle
    weaker = solve_at(pendulum(1.4, gravity=G / (1 + inertia / (MASS * LENGTH**2))), t, duration=5.1).state.wrap_angle
    assert np.allclose(sized, weaker, rtol=0, atol=1e-7)  # a pivot of 1 nm


@pytest.mark.parametrize("angle", [0.7, -1.3])
def test_everything_together_moves_as_the_separate_pendulum(angle):
    blind = Pendulum(
        mass=MASS, length=LENGTH, angle=angle, rate=0.4, bob_radius=0.1, axle_torque=2e-3, axle_damping=3e-4,
        linear_drag=1e-3, quadratic_drag=2e-3,
    )  # fmt: skip
    p = pendulum(
        angle, push_across=-0.4 * LENGTH, light_inertia=0.4 * MASS * 0.1**2, pivot_friction=2e-3, pivot_damping=3e-4,
        light_linear_drag=1e-3, light_drag=2e-3,
    )  # fmt: skip
    t = np.linspace(0, 20.0, 401)
    without = swing(dataclasses.replace(blind, axle_torque=0.0), t)
    expected = swing(blind, t)
    assert np.abs(expected - without).max() > 0.05  # the friction shows
    assert np.abs(math.pi - solve_at(p, t, duration=20.1).state.wrap_angle - expected).max() < 1e-7


def test_a_slack_string_leaves_the_bob_and_the_pivot_alone():
    above = TEN_TO_ONE.replace(release="held", release_angle=math.radians(50))
    t = np.linspace(0, 0.1, 11)
    plain = solve_at(above, t)
    moved = solve_at(above.replace(pivot_friction=0.02, pivot_damping=0.01, light_inertia=1e-4), t)
    assert (plain.mode == Mode.CLAMPED_SLACK).all()
    assert np.array_equal(plain.light_position, moved.light_position)


@pytest.mark.parametrize("friction", [0.0, 2e-3])
def test_samples_of_a_swing_are_those_of_its_dense_solution(friction):
    p = pendulum(2.0, light_drag=2e-3, pivot_friction=friction)
    t = np.linspace(0, 30.0, 301)
    dense, direct = solve(p, duration=30.01), solve_at(p, t, duration=30.01)
    assert len(dense.events) > 20
    assert [e.event for e in direct.run.events] == [e.event for e in dense.events]
    assert np.allclose([e.time for e in direct.run.events], [e.time for e in dense.events], rtol=0, atol=1e-11)
    samples = dense.sample(t)
    assert np.allclose(direct.state, samples.state, rtol=0, atol=1e-11)
    assert np.array_equal(direct.signs.across, samples.signs.across)


def test_derivatives_pass_the_jump_of_friction_at_a_turning_point():
    p = pendulum(0.8, pivot_friction=5e-3, pivot_damping=1e-3, light_inertia=1e-4)
    wrt, t = ("pivot_friction", "pivot_damping", "light_inertia", "free_length"), np.linspace(0, 6.0, 61)
    s = solve_sensitivities(p, t, wrt, duration=6.1)
    for i, (name, step) in enumerate(zip(wrt, (1e-7, 1e-7, 1e-8, 1e-7), strict=True)):
        value = getattr(p, name, None) or p.coefficients[name]
        low, high = (solve_at(p.replace(**{name: value + d}), t, duration=6.1).state.wrap_angle for d in (-step, step))
        quotient = (high - low) / (2 * step)
        assert np.allclose(s.state.wrap_angle[i], quotient, rtol=0, atol=1e-5 * np.abs(quotient).max())
