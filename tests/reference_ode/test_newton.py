"""Newton's second law at random states of every mode and effect, in x, y and z, against the lines that are solved.

The accelerations are differences of the velocities along the rates that the equations give; the forces are written anew, as
vectors, in `instants`. Bounds: central differences over 1e-6 s err by 1e-12 of the third derivative and by rounding over
1e-6, 1e-9.
"""

import math

import numpy as np
import pytest

from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.state import State, extra_variables, string_path
from looping_pendulum.reference_ode.transitions import Event, Mode
from tests.reference_ode.instants import CASES, EFFECT_SETS, EVERY, TAUT, TURN, H, Instant, assert_close, instants, of


@EVERY
def test_speeds_are_the_derivatives_of_places(mode, name):
    for i in instants(mode, name):
        assert_close(i.slope(i.light_mass_position), i.light_velocity(i.y), 5.0)
        growing = i.slope(lambda y, i=i: string_path(math, y, i.overlap, i.p, i.effects))
        assert_close(growing, i.grows if not mode.slack else growing, 5.0)
        assert_close(i.rates.slack, i.y.heavy_speed - growing, 5.0)


@EVERY
def test_the_light_mass_obeys_newton(mode, name):
    for i in instants(mode, name):
        away, t1 = i.directions
        acceleration = i.slope(i.light_velocity)
        pull = -i.t1 / i.whole * (i.path * away + i.y.sideways * np.array([0.0, 0.0, 1.0]))
        force = i.force_on_light() + pull
        string = 0.0 if mode is Mode.FALLING else i.p.string_density * i.y.free_length
        scale = np.abs(force).max() + 1.0
        assert_close((i.p.light_mass + string / 2) * (acceleration @ away), force @ away, scale)
        assert_close((i.p.light_mass + string / 3) * (acceleration @ t1), force @ t1, scale)
        assert_close(i.p.light_mass * acceleration[2], force[2], scale)


@EVERY
def test_the_heavy_mass_obeys_newton(mode, name):
    for i in instants(mode, name):
        if mode in (Mode.CLAMPED, Mode.CLAMPED_SLACK):
            assert i.rates.heavy_speed == 0
            assert i.rates.heavy_tilt == i.rates.heavy_across_speed == 0
            continue
        down = np.array([math.sin(i.y.heavy_tilt), -math.cos(i.y.heavy_tilt)])
        force = i.force_on_heavy() - i.t2 * down
        if mode is Mode.STICKING and "light_stretch" not in extra_variables(i.effects):
            # what it does not swing it rests: the rod's hold makes up whatever is left along the string
            assert i.rates.heavy_speed == 0
            if "heavy_tilt" not in extra_variables(i.effects):
                assert i.t2 == pytest.approx(-i.force_on_heavy()[1], rel=1e-12)
                continue
        string = 0.0 if mode is Mode.FALLING else i.p.string_density * i.hanging
        left = (i.p.heavy_mass + string) * i.slope(i.heavy_velocity)
        assert_close(left, force, np.abs(force).max() + 1.0)
        turning = i.rates.heavy_tilt * (i.hanging + i.p.rod_radius * i.y.heavy_tilt)
        assert_close(turning, i.y.heavy_across_speed, 1.0)


@EVERY
def test_the_strings_law(mode, name):
    """No pull without a taut string; the capstan law where it slides; a fixed length where it does not stretch."""
    for i in instants(mode, name):
        if mode.slack:
            assert i.t1 == i.t2 == 0
            assert i.rates.rod_speed * i.signs.rod <= 0
            continue
        if mode.sliding:
            exponent = i.capstan(i.p.kinetic_friction, i.p.friction_per_speed)
            assert i.t2 / i.t1 == pytest.approx(math.exp(-i.signs.slide * exponent), rel=1e-9)
        stretch = "light_stretch" in extra_variables(i.effects)
        if not stretch:
            continue
        # Two springs with dampers, the stiffness of each by its share of the unstretched string
        share = (i.whole - i.y.light_stretch) / i.p.string_length
        tau, compliance = i.p.string_loss_time, i.p.string_compliance
        assert i.t1 == pytest.approx((i.y.light_stretch + tau * i.rates.light_stretch) / (compliance * share), rel=1e-9)
        assert i.t2 == pytest.approx((i.y.heavy_stretch + tau * i.rates.heavy_stretch) / (compliance * (1 - share)), rel=1e-9)
        assert i.rates.light_stretch + i.rates.heavy_stretch == pytest.approx(i.grows - i.y.heavy_speed, rel=1e-9)
        if not mode.sliding:
            assert i.rates.light_stretch == pytest.approx(i.grows, rel=1e-12)


@of(*TAUT)
def test_a_string_that_does_not_stretch_keeps_its_length(mode, name):
    for i in instants(mode, name):
        if "light_stretch" in extra_variables(i.effects):
            return

        # The second derivative of the path to the light mass, along the rates, is the heavy mass's acceleration
        def grows(y, i=i):
            speed = Instant.light_velocity(y)
            away = np.array([-math.sin(y.wrap_angle), math.cos(y.wrap_angle), 0.0])
            path = string_path(math, y._replace(sideways=0.0), i.overlap, i.p, i.effects)
            return (path * (speed @ away) + y.sideways * speed[2]) / math.hypot(path, y.sideways)

        assert_close(i.slope(grows), i.rates.heavy_speed, 100.0)


ROD = [case for case in CASES if EFFECT_SETS[case[1]].get("rod_mobility")]


@pytest.mark.parametrize(("mode", "name"), ROD)
def test_the_rod_obeys_newton(mode, name):
    for i in instants(mode, name):
        if mode in (Mode.STICKING, Mode.CLAMPED, Mode.CLAMPED_SLACK):
            assert i.rates.rod_speed == 0
            continue
        bearing = i.p.bearing_friction * math.copysign(1.0, i.y.rod_speed)
        assert i.rates.rod_speed == pytest.approx(i.p.rod_mobility * (i.t1 - i.t2 - bearing), rel=1e-9)
        held = Equations(math, i.p, i.effects).rates(mode, 0.3, i.y, i.signs._replace(rod=0.0))
        if mode is not Mode.ROLLING:
            assert held.rod_speed == 0


@EVERY
def test_what_an_effect_alone_moves_rests_without_it(mode, name):
    for i in instants(mode, name):
        absent = set(State._fields[6:]) - extra_variables(i.effects)
        assert {getattr(i.rates, n) for n in absent} <= {0.0}


# Events


def events(i: Instant, y: State | None = None, **signs: float) -> dict[Event, float]:
    return Equations(math, i.p, i.effects).event_functions(i.mode, 0.3, i.y if y is None else y, i.signs._replace(**signs))


@EVERY
def test_events_of_places_happen_there(mode, name):
    for i in instants(mode, name):
        actual = events(i)
        assert actual[Event.LIGHT_REACHES_ROD] == pytest.approx(i.y.free_length - i.parameters.end_length, rel=1e-12)
        assert actual[Event.ACROSS_REVERSES] == pytest.approx(abs(i.y.across_speed), rel=1e-12)
        if mode is Mode.FALLING:
            assert len(actual) == 2
            continue
        assert actual[Event.UNWRAPPED] == i.y.wrap_angle
        overlaps = any(effect.winding or effect.name == "string_on_string" for effect in i.effects)
        assert (Event.FIRST_TURN in actual) is overlaps
        if overlaps:
            assert actual[Event.FIRST_TURN] == pytest.approx(abs(i.y.wrap_angle - TURN), rel=1e-12)
        assert (Event.HEAVY_REACHES_ROD in actual) is (mode.string_moves or mode is Mode.SLACK)
        if mode.string_moves or mode is Mode.SLACK:
            assert actual[Event.HEAVY_REACHES_ROD] == pytest.approx(i.hanging, rel=1e-9)


@of(Mode.SLIDING_DOWN, Mode.SLIDING_UP)
def test_a_slide_ends_where_its_speed_or_its_tension_vanishes(mode, name):
    for i in instants(mode, name):
        actual, slide = events(i), i.signs.slide
        if "light_stretch" in extra_variables(i.effects):
            passing = i.grows - i.rates.light_stretch
            assert actual[Event.STOP] == pytest.approx(slide * passing, abs=1e-9)
            tau, whole = i.p.string_loss_time, i.y.light_stretch + i.y.heavy_stretch
            assert actual[Event.LOSES_TENSION] == pytest.approx(whole + tau * (i.grows - i.y.heavy_speed), rel=1e-9)
            continue
        relative = i.y.heavy_speed - i.y.rod_speed
        assert actual[Event.STOP] == pytest.approx(slide * relative, rel=1e-9)
        # phase 0 waits until that speed falls: its derivative, times an inertia without a rod
        ratio = math.exp(-slide * i.capstan(i.p.kinetic_friction, i.p.friction_per_speed))
        heavy = i.p.heavy_mass + i.p.string_density * i.hanging
        light = 1 / (
            (i.path / i.whole) ** 2 / (i.p.light_mass + i.p.string_density * i.y.free_length / 2)
            + (i.y.sideways / i.whole) ** 2 / i.p.light_mass
        )
        turns = "rod_speed" in extra_variables(i.effects)
        inertia = 1.0 if turns else heavy + light * ratio
        slows = slide * (i.rates.heavy_speed - (i.rates.rod_speed if turns else 0.0)) * inertia
        assert events(i, phase=0.0)[Event.STOP] == pytest.approx(slows, rel=1e-9)
        assert actual[Event.LOSES_TENSION] == pytest.approx(i.t1 * (heavy + light * ratio), rel=1e-7)
        if turns:
            assert actual[Event.ROD_CHANGES] == pytest.approx(abs(i.y.rod_speed), rel=1e-9)
            slowing = events(i, rod_phase=0.0)[Event.ROD_CHANGES]
            assert slowing == pytest.approx(i.signs.rod * i.rates.rod_speed, rel=1e-9)
            resting = i.y._replace(rod_speed=0.0)
            t1, t2 = Equations(math, i.p, i.effects).tensions(mode, 0.3, resting, i.signs._replace(rod=0.0))
            held = events(i, resting, rod=0.0)[Event.ROD_CHANGES]
            assert held == pytest.approx(i.p.bearing_friction - slide * (t1 - t2), rel=1e-9)


@of(Mode.STICKING, Mode.ROLLING)
def test_a_hold_ends_at_the_edge_of_the_friction_cone(mode, name):
    for i in instants(mode, name):
        actual, hold = events(i), math.exp(i.capstan(i.p.static_friction, 0.0))
        assert actual[Event.SLIP_ONSET_DOWN] == pytest.approx(i.t1 * hold - i.t2, rel=1e-9)
        assert actual[Event.SLIP_ONSET_UP] == pytest.approx(i.t2 * hold - i.t1, rel=1e-9)
        margins = Equations(math, i.p, i.effects).holding_margins(mode, 0.3, i.y, i.signs)
        assert margins == (actual[Event.SLIP_ONSET_DOWN], actual[Event.SLIP_ONSET_UP])
        turns = "rod_speed" in extra_variables(i.effects)
        assert (Event.ROD_YIELDS_UP in actual) is (turns and mode is Mode.STICKING)
        if mode is Mode.ROLLING:
            assert actual[Event.ROD_STOPS] == pytest.approx(abs(i.y.rod_speed), rel=1e-12)
            slowing = events(i, rod_phase=0.0)[Event.ROD_STOPS]
            assert slowing == pytest.approx(i.signs.rod * i.rates.rod_speed, rel=1e-9)
        elif turns:
            assert actual[Event.ROD_YIELDS_UP] == pytest.approx(i.p.bearing_friction - (i.t1 - i.t2), rel=1e-9)
            assert actual[Event.ROD_YIELDS_DOWN] == pytest.approx(i.p.bearing_friction + (i.t1 - i.t2), rel=1e-9)


@of(Mode.CLAMPED)
def test_a_clamped_string_loses_its_tension_at_none(mode, name):
    for i in instants(mode, name):
        assert events(i)[Event.LOSES_TENSION] == pytest.approx(i.t1, rel=1e-12)


@of(Mode.SLACK, Mode.CLAMPED_SLACK)
def test_a_slack_string_closes_before_it_is_taut(mode, name):
    """The event function of phase 0 is the derivative, along the motion, of that of phase 1."""
    for i in instants(mode, name):
        actual = events(i)
        stretch = "light_stretch" in extra_variables(i.effects)
        if not stretch:
            assert actual[Event.TAUT] == i.y.slack
        else:  # the stretch, and the loss time times its rate, of the whole string
            rate = i.slope(lambda y, i=i: string_path(math, y, i.overlap, i.p, i.effects)) - i.y.heavy_speed
            expected = -(i.y.light_stretch + i.y.heavy_stretch + i.p.string_loss_time * rate)
            assert_close(actual[Event.TAUT], expected, 1.0)
        closing = (events(i, i.moved(H))[Event.TAUT] - events(i, i.moved(-H))[Event.TAUT]) / (2 * H)
        assert_close(events(i, phase=0.0)[Event.TAUT], closing, 5.0)
        if mode is Mode.SLACK:
            assert actual[Event.HEAVY_REVERSES] == abs(i.y.heavy_speed)
            if "rod_speed" in extra_variables(i.effects):
                assert actual[Event.ROD_CHANGES] == pytest.approx(abs(i.y.rod_speed), rel=1e-12)
                assert events(i, i.y._replace(rod_speed=0.0), rod=0.0)[Event.ROD_CHANGES] == 1.0  # nothing turns it
