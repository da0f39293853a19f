"""Growth of small differences."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.errors import ParameterError
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.sensitivity import solve_sensitivities
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.scenarios.loader import load

pytest.importorskip("heyoka", reason="exponents need heyoka")
from research.answers.lyapunov import OBSERVABLES, TangentMap, solve_tangent_map  # noqa: E402

LENGTH, GRAVITY = 0.58, 9.81


def apparatus(**changes):
    given = dict(light_mass=0.01, heavy_mass=0.1, rod_radius=1e-3, free_length=LENGTH, release_angle=2.0, hanging_length=0.1)
    coefficients = changes.pop("coefficients", {})
    return Parameters(**(given | changes), coefficients=coefficients)


def test_free_flight_grows_as_its_closed_form_says():
    """x = x0 + v0 t for both masses: [[1, s], [0, 1]], s = t sqrt(g / l), on what a string of fixed length lets differ."""
    p = apparatus(release=Release.DROP)
    t = np.array([0.1, 0.25])
    tangent_map = solve_tangent_map(p, t)
    along = np.array([-math.sin(p.release_angle), math.cos(p.release_angle)])  # away from the rod
    tied = np.array([[*along, 0, 0, -1, 0]])  # the heavy mass rises by what the path to the light one grows
    free = np.linalg.svd(tied)[2][1:].T
    for k, s in enumerate(t * math.sqrt(GRAVITY / LENGTH)):
        flight = np.eye(6)
        flight[0, 2] = flight[1, 3] = flight[4, 5] = s
        expected = np.linalg.svd(flight @ free, compute_uv=False)
        np.testing.assert_allclose(tangent_map.growth[k], expected, rtol=1e-9)
        np.testing.assert_allclose(tangent_map.exponents[k], np.log(expected) / t[k], rtol=1e-7, atol=1e-9)


def test_small_swings_turn_differences_and_do_not_stretch_them():
    """A harmonic oscillation is a rotation of (place / l, speed / sqrt(g l)): of its two directions neither grows."""
    amplitude = 1e-4
    p = apparatus(release=Release.HELD, release_angle=math.pi - amplitude, rod_radius=1e-6)
    t = np.linspace(0.2, 1.5, 6)
    tangent_map = solve_tangent_map(p, t)
    assert tangent_map.names == ("free_length", "wrap_angle", "across_speed")
    phase = t * math.sqrt(GRAVITY / LENGTH)
    # place and velocity across the string by wrap angle and speed at release, in the scaled coordinates
    place, speed = (LENGTH * tangent_map.state[:, 1, 1:].T, tangent_map.state[:, 3, 1:].T)
    np.testing.assert_allclose(place[0] / LENGTH, np.cos(phase), atol=2e-5)
    np.testing.assert_allclose(speed[1], np.cos(phase), atol=2e-5)
    np.testing.assert_allclose(place[1] * math.sqrt(GRAVITY / LENGTH), np.sin(phase), atol=2e-5)
    assert tangent_map.matrices.shape == (6, len(OBSERVABLES), 3)


def test_a_stop_that_holds_takes_one_direction_away():
    p = load("ten_to_one").parameters
    halt = solve(p).halting_time
    tangent_map = solve_tangent_map(p, np.array([halt - 1e-3, halt + 1e-3]))
    assert tangent_map.growth[0, 3] > 1e-4
    assert tangent_map.growth[1, 3] == 0  # what linear algebra makes of it, of rounding size or not, depends on the processor
    assert tangent_map.exponents[1, 3] == -np.inf
    assert np.all(tangent_map.growth[1, :3] > 1e-2)


@pytest.mark.parametrize("angle", [67.0, 75.1, 101.5])
def test_tangent_map_is_the_difference_of_two_nearby_runs(angle):
    """Central differences over every stop, break-away and reversal: their error is the third derivative times h^2 / 6."""
    p = load("two_and_a_half_to_one").parameters.replace(release_angle=math.radians(angle))
    run = solve(p)
    t = np.linspace(0.1, 0.6 * run.end_time, 12)
    t = t[np.min(np.abs(t[:, None] - [e.time for e in run.events]), axis=1) > 1e-3]
    tangent_map = solve_tangent_map(p, t)
    h = 1e-5
    for column, name in enumerate(("free_length", "release_angle")):
        ahead, behind = (solve_at(p.replace(**{name: getattr(p, name) + s * h}), t, tolerance=1e-15) for s in (1, -1))
        for row, field in enumerate(("free_length", "wrap_angle", "retreat_speed", "across_speed")):
            difference = (getattr(ahead.state, field) - getattr(behind.state, field)) / (2 * h)
            derivative = tangent_map.state[:, row, column]
            np.testing.assert_allclose(derivative, difference, rtol=1e-5, atol=1e-5 * np.abs(difference).max())


def test_release_columns_agree_with_the_sensitivities_by_release_angle_and_length():
    p = load("two_to_one").parameters
    t = np.linspace(0.05, 0.9, 9)
    tangent_map = solve_tangent_map(p, t)
    other = solve_sensitivities(p, t, ("free_length", "release_angle"))
    for row, field in enumerate(("free_length", "wrap_angle", "retreat_speed", "across_speed")):
        np.testing.assert_allclose(tangent_map.state[:, row, :2].T, getattr(other.state, field), rtol=1e-8, atol=1e-8)


def test_growth_does_not_depend_on_the_masses_when_the_ratio_stays_and_there_is_no_drag():
    p = load("two_and_a_half_to_one").parameters.replace(light_drag=0.0, heavy_drag=0.0)
    t = np.linspace(0.1, 0.9, 5)
    heavier = p.replace(light_mass=7 * p.light_mass, heavy_mass=7 * p.heavy_mass)
    np.testing.assert_allclose(solve_tangent_map(p, t).growth, solve_tangent_map(heavier, t).growth, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize(("gravity", "speed"), [(9.81, 2.385), (1.6, 0.9633), (0.0, 2.385)])
def test_differences_are_measured_in_lengths_and_speeds_of_the_apparatus(gravity, speed):
    # Oracle: l0 and sqrt(g l0) by hand; weightless, speeds still need a scale, and the usual g gives it
    p = apparatus(coefficients={"gravity": gravity})
    run = SimpleNamespace(run=SimpleNamespace(parameters=p))
    empty = np.zeros((0, 0))
    scales = TangentMap(samples=run, names=(), state=empty, start=empty, observables=empty).scales
    by_name = dict(zip(OBSERVABLES, scales, strict=True))
    assert {by_name[n] for n in ("x1", "y1", "y2")} == {LENGTH}
    assert [by_name[n] for n in ("vx1", "vy1", "vy2")] == pytest.approx([speed] * 3, rel=1e-3)


def test_an_effect_with_a_state_of_its_own_is_refused():
    p = load("ten_to_one").parameters.replace(push_sideways=0.1)
    with pytest.raises(ParameterError, match="out_of_plane"):
        solve_tangent_map(p, np.array([0.1]))
