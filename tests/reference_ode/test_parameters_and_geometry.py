"""Parameters are accepted up to the edges of what is possible; positions agree with plane geometry."""

import math
import pickle
import re

import numpy as np
import pytest

from looping_pendulum.errors import ParameterError
from looping_pendulum.notebook import reference_run
from looping_pendulum.reference_ode.cartesian import cartesian_force, masses_at_release
from looping_pendulum.reference_ode.closed_forms import mechanical_energy
from looping_pendulum.reference_ode.effects import COEFFICIENTS, EFFECTS, Kinematics, drag_coefficient
from looping_pendulum.reference_ode.geometry import light_position, light_velocity, next_string_coordinates, string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import solve
from tests.apparatus import TEN_TO_ONE

LENGTHS_AND_MASSES = ("light_mass", "heavy_mass", "rod_radius", "free_length", "hanging_length")


@pytest.mark.parametrize("name", LENGTHS_AND_MASSES)
@pytest.mark.parametrize("value", [0.0, -1e-9, -1.0, 1.01e9, 5e300, math.inf, math.nan])
def test_masses_and_lengths_are_finite_and_above_zero(name, value):
    with pytest.raises(ParameterError, match=f"{name}: found {re.escape(f'{value:g}')}, needed a finite number above 0"):
        TEN_TO_ONE.replace(**{name: value})


@pytest.mark.parametrize("name", ["light_mass", "heavy_mass", "hanging_length"])
@pytest.mark.parametrize("value", [1e-9, 0.5, 1e9])
def test_any_other_mass_is_taken(name, value):
    assert getattr(TEN_TO_ONE.replace(**{name: value}), name) == value


@pytest.mark.parametrize(("radius", "taken"), [(0.0, True), (0.01, True), (-1e-9, False), (math.inf, False), (math.nan, False)])
def test_a_light_mass_may_have_a_radius(radius, taken):
    if taken:
        assert TEN_TO_ONE.replace(light_radius=radius).light_radius == radius
    else:
        with pytest.raises(ParameterError, match="light_radius: found .*, needed 0 or more"):
            TEN_TO_ONE.replace(light_radius=radius)


@pytest.mark.parametrize(("degrees", "taken"), [(0.0, False), (-1.0, False), (0.01, True), (359.9, True), (360.0, False)])
def test_a_release_is_within_a_turn(degrees, taken):
    if taken:
        assert TEN_TO_ONE.replace(release_angle=math.radians(degrees)).release_angle == math.radians(degrees)
    else:
        with pytest.raises(ParameterError, match=re.escape(f"release_angle: found {degrees:g} deg")):
            TEN_TO_ONE.replace(release_angle=math.radians(degrees))


@pytest.mark.parametrize("name", sorted(COEFFICIENTS))
def test_coefficients_are_taken_up_to_their_bounds_and_no_further(name):
    low, high = COEFFICIENTS[name].bounds
    assert low <= COEFFICIENTS[name].null <= high
    assert low <= COEFFICIENTS[name].default <= high
    for value in (low - 1e-6 * max(1.0, abs(low)), high + 1e-6 * max(1.0, abs(high)), math.nan):
        with pytest.raises(ParameterError, match=f"{name}: found"):
            TEN_TO_ONE.replace(**{name: value})


def test_a_coefficient_of_no_effect_is_refused():
    with pytest.raises(ParameterError, match="no effect has a coefficient 'wind'"):
        Parameters(light_mass=1, heavy_mass=1, rod_radius=1, free_length=1, release_angle=1, coefficients={"wind": 1})


def test_static_friction_is_the_kinetic_one_unless_it_is_given():
    p = TEN_TO_ONE.replace(kinetic_friction=0.2)
    assert p.coefficients["static_friction"] == 0.2
    assert p.static_equals_kinetic
    apart = p.replace(static_friction=0.3)
    assert not apart.static_equals_kinetic
    assert apart.replace(kinetic_friction=0.25).coefficients["static_friction"] == 0.3
    with pytest.raises(ParameterError, match=r"static_friction: found 0.1, needed at least kinetic_friction \(0.2\)"):
        p.replace(static_friction=0.1)


def test_a_turning_rod_and_a_stretching_string_exclude_each_other():
    rod, string = {"rod_mobility": 0.1}, {"string_compliance": 1e-3}
    assert TEN_TO_ONE.replace(**rod).coefficients["rod_mobility"] == 0.1
    assert TEN_TO_ONE.replace(**string).coefficients["string_compliance"] == 1e-3
    with pytest.raises(ParameterError, match="rod_mobility and string_compliance: found both above 0, needed one of them 0"):
        TEN_TO_ONE.replace(**rod, **string)


def test_the_light_mass_ends_where_its_surface_touches_the_rod():
    # Oracle: Pythagoras, l^2 + R^2 = (R + r)^2; a point by convention at a third of the rod's radius.
    p = TEN_TO_ONE.replace(light_radius=0.01)
    assert p.end_length == pytest.approx(math.sqrt(0.01625**2 - 0.00625**2), rel=1e-12)
    assert TEN_TO_ONE.end_length == pytest.approx(0.00625 / 3, rel=1e-12)
    assert p.replace(free_length=p.end_length * 1.001).free_length > p.end_length
    for shorter in (1.0, 0.999):
        with pytest.raises(ParameterError, match="already touches the rod"):
            p.replace(free_length=p.end_length * shorter)


def test_the_string_is_as_long_as_its_three_parts():
    p = TEN_TO_ONE.replace(free_length=0.5, hanging_length=0.1, release_angle=2.0)
    assert p.string_length == pytest.approx(0.5 + 0.1 + 0.00625 * 2.0, rel=1e-12)
    assert p.replace(heavy_swing=0.1).string_length == pytest.approx(0.5 + 0.1 + 0.00625 * 1.9, rel=1e-12)


def test_a_vertical_release_hangs_straight_down():
    assert TEN_TO_ONE.replace(release=Release.VERTICAL).release_angle == math.pi


def test_printed_parameters_show_what_acts_and_make_them_again():
    p = TEN_TO_ONE.replace(side_force=0.005, gravity=0.0)
    printed = repr(p)
    acting = {name for name, value in p.coefficients.items() if value} | {"gravity"}
    assert {name for name in p.coefficients if f"'{name}': " in printed} == acting
    assert eval(printed) == p


def test_parameters_are_the_same_after_a_pickle_and_as_plain_data():
    p = TEN_TO_ONE.replace(wind_speed=-2.0, light_drag=0.02, static_friction=0.5)
    assert pickle.loads(pickle.dumps(p)) == p
    assert Parameters(**p.as_dict()) == p
    assert p.as_dict()["release"] == "looping"
    assert p.values().wind_speed == -2.0
    assert p.values().string_length == p.string_length


def test_acting_effects_are_the_declared_ones_and_those_off_their_null_value():
    base = {e.name for e in TEN_TO_ONE.effects}
    assert base == {e.name for e in EFFECTS.values() if e.in_base_model}
    assert {e.name for e in TEN_TO_ONE.replace(side_force=0.1).effects} == base | {"side_force"}
    assert {e.name for e in TEN_TO_ONE.effects_with(frozenset({"side_force"}))} == base | {"side_force"}
    assert "string_drag" not in {e.name for e in TEN_TO_ONE.replace(release=Release.DROP).effects}


def test_drag_of_a_sphere():
    # Oracle: C rho A / 2 for a ball of 4 cm in air.
    assert drag_coefficient(0.47, 1.2, math.pi * 0.02**2) == pytest.approx(0.5 * 0.47 * 1.2 * 1.2566370614e-3, rel=1e-9)


R = 0.01
ANGLES = np.linspace(0.1, 5 * math.pi, 400)


def test_the_string_is_a_tangent():
    # Oracle: the free string starts on the rod and is at right angles to the radius there.
    lengths = np.linspace(0.5, 0.1, 400)
    x, y = light_position(np, lengths, ANGLES, R)
    foot = R * np.stack([np.cos(ANGLES), np.sin(ANGLES)])
    string = np.stack([x, y]) - foot
    np.testing.assert_allclose(np.hypot(*string), lengths, rtol=1e-12)
    np.testing.assert_allclose(np.sum(string * foot, axis=0), 0.0, atol=1e-15)
    np.testing.assert_allclose(light_position(math, 0.5, math.pi / 2, R), (-0.5, R), atol=1e-15)


def test_velocities_are_the_derivative_of_positions():
    # Oracle: central differences; u = l' + R theta', w = l theta'. Bound: their error, h^2 times the third derivative.
    t, h = np.linspace(0, 1, 50), 1e-5

    def at(t):
        return np.stack(light_position(np, 0.5 - 0.2 * t, 1.0 + 7.0 * t, R))

    length = 0.5 - 0.2 * t
    velocity = np.stack(light_velocity(np, 1.0 + 7.0 * t, -0.2 + R * 7.0, length * 7.0))
    np.testing.assert_allclose(velocity, (at(t + h) - at(t - h)) / (2 * h), atol=1e-8)


def test_string_coordinates_are_read_back_with_their_turns():
    lengths = np.linspace(0.5, 0.1, 400)
    positions = np.stack(light_position(np, lengths, ANGLES, R), axis=1)
    actual, angles = string_coordinates(positions, R, ANGLES[0])
    np.testing.assert_allclose(actual, lengths, rtol=1e-12)
    np.testing.assert_allclose(angles, ANGLES, rtol=1e-12)
    angle = ANGLES[0]
    for (x, y), length, expected in zip(positions, lengths, ANGLES, strict=True):
        one, angle = next_string_coordinates(x, y, R, angle)
        assert one == pytest.approx(length, rel=1e-12)
        assert angle == pytest.approx(expected, rel=1e-12)
    for x, y, angle in [(*positions[50], ANGLES[50] - 3.0), (*positions[50], ANGLES[50] + 3.0)]:
        assert next_string_coordinates(x, y, R, angle)[1] == pytest.approx(ANGLES[50], rel=1e-12), "less than half a turn away"


def test_a_place_inside_the_rod_has_next_to_no_free_string():
    assert next_string_coordinates(R / 2, 0.0, R, 0.0)[0] == pytest.approx(1e-8)
    assert string_coordinates(np.array([[R / 2, 0.0]]), R, 0.0)[0] == [0.0]


def test_energy_of_two_masses():
    # Oracle: m v^2 / 2 + m g y of each, by hand: 0.01 (12.5 + 9.81) + 0.1 (2 - 19.62).
    one = [np.array([values]) for values in ((3.0, 1.0), (3.0, 4.0), (5.0, -2.0), (0.0, 2.0))]
    assert mechanical_energy(TEN_TO_ONE, *one) == pytest.approx([0.01 * (12.5 + 9.81) + 0.1 * (2.0 - 19.62)], rel=1e-12)


def test_forces_in_x_and_y_are_those_along_and_across_the_string():
    # Oracle: drag is against the velocity; of a mass at (-l, R), released at a right angle, the string lies along -x, so that
    # across it is straight down.
    drag = TEN_TO_ONE.replace(light_drag=0.3, heavy_drag=0.2, string_drag=0.0)
    fx, fy, heavy = cartesian_force(drag)(0.0, -0.58, 0.00625, 3.0, 4.0, -2.0)
    assert (fx, fy, heavy) == pytest.approx((-0.3 * 5 * 3, -0.3 * 5 * 4, 0.2 * 4), rel=1e-12)
    free = {"light_drag": 0.0, "heavy_drag": 0.0, "string_drag": 0.0}
    assert cartesian_force(TEN_TO_ONE.replace(**free)) is None
    string = TEN_TO_ONE.replace(**free | {"string_drag": 0.5}, release_angle=math.pi / 2)
    fx, fy, heavy = cartesian_force(string)(0.0, -0.4, 0.00625, 1.0, -3.0, -2.0)
    assert (fx, fy, heavy) == pytest.approx((0.0, 0.5 * 0.4 * 9.0, 0.0), abs=1e-12)


def test_a_push_across_the_string_is_the_velocity_at_release():
    p = TEN_TO_ONE.replace(release_angle=math.pi / 2, push_across=0.7)
    masses = masses_at_release(p)
    assert masses.light_velocity == pytest.approx((0.0, -0.7), abs=1e-12)
    assert masses.heavy_velocity == pytest.approx((0.0, 0.0), abs=1e-12)
    resting = masses_at_release(TEN_TO_ONE)
    assert (*resting.light_velocity, *resting.heavy_velocity) == pytest.approx((0.0, 0.0, 0.0, 0.0), abs=1e-15)


def test_beyond_the_first_turn_string_lies_on_string():
    def seen(angle, overlap=None, tilt=0.0, sliding=None):
        return Kinematics(
            0.0, 0.5, angle, 0.1, 0.2, 0.2, 0.3, -0.4, 0.4, overlap=overlap, heavy_tilt=tilt, sliding_speed=sliding
        )

    assert seen(7.0).wrap_beyond_first_turn == pytest.approx(7.0 - 2 * math.pi)
    assert seen(6.0).wrap_beyond_first_turn == 0.0
    assert seen(7.0, overlap=0).wrap_beyond_first_turn == 0.0
    assert seen(6.0, overlap=1).wrap_beyond_first_turn == pytest.approx(6.0 - 2 * math.pi)
    assert seen(3.0, tilt=0.2).contact_angle == pytest.approx(2.8)
    assert seen(3.0).slip_speed == 0.4
    assert seen(3.0, sliding=0.05).slip_speed == 0.05


def test_a_run_in_a_notebook_tells_its_events():
    run = solve(TEN_TO_ONE)
    page = reference_run(run)
    assert f"halts after {run.halting_time:.4f} s" in page
    assert f"{float(run.heavy_drop(run.halt.state)):.4f}" in page
    assert f"{float(run.halt.state.wrap_angle):.4f}" in page
    assert f"{float(run.halt.state.free_length):.4f}" in page
    for event in run.events:
        assert (f"{event.time:.6f}" in page) or event.event is not None
    assert "does not halt within 0.2 s" in reference_run(solve(TEN_TO_ONE, duration=0.2))
