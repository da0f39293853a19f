"""A string that becomes taut at once: impulses and momenta, solved anew as linear equations; and stretches at rest."""

import math

import numpy as np
import pytest

from looping_pendulum.reference_ode import rules
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.rules import MARGIN_TOLERANCE, RELATIVE_TENSION_TOLERANCE, REST_SERIES_DURATION
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.reference_ode.state import TINY_SPEED, Motion, Signs, State, extra_variables
from looping_pendulum.reference_ode.transitions import Event, Mode
from tests.apparatus import TEN_TO_ONE, TWO_TO_ONE
from tests.reference_ode.released import Released

BODIES = {
    "points": {},
    "heavy string": {"string_density": 0.05},
    "friction that grows": {"friction_per_wrap": 0.1},
    "sideways": {"push_sideways": 0.5},
    "heavy string, sideways": {"string_density": 0.05, "push_sideways": 0.5},
    "turning rod": {"rod_mobility": 12.0, "bearing_friction": 0.2},
    "all": {"rod_mobility": 5.0, "string_density": 0.03, "push_sideways": 0.5, "friction_per_wrap": 0.1},
}
BEFORE = State(0.4, 2.5, 1.7, -0.8, -0.6, 2e-3)
EACH = pytest.mark.parametrize("name", BODIES)
SLIDES = pytest.mark.parametrize("slide", [1.0, -1.0, 0.0])


def after(name: str, slide: float) -> dict[str, float]:
    """Solve for speeds and impulses just after: momentum of each body, the capstan law, and a string of fixed length again."""
    p, y, c, s, *_ = before(name)
    m_along = p.light_mass + p.string_density * y.free_length / 2
    m_heavy = p.heavy_mass + p.string_density * (p.string_length - math.hypot(c[0], c[1]) - y.slack)
    share, share_z = (x / math.hypot(*c) for x in c)
    friction = p.kinetic_friction * y.wrap_angle * (1 + p.friction_per_wrap * y.wrap_angle)
    mobility = p.rod_mobility
    # unknown: u, v along the rod, heavy speed, rod speed, J1, J2
    laws = [
        [m_along, 0, 0, 0, share, 0],
        [0, p.light_mass, 0, 0, share_z, 0],
        [0, 0, m_heavy, 0, 0, -1],
        [share, share_z, -1, 0, 0, 0],
    ]
    right = [m_along * y.retreat_speed, p.light_mass * y.sideways_speed, m_heavy * y.heavy_speed, 0.0]
    if slide == 0 and not mobility:  # the rod takes up what it must to stop the string: no law of the heavy mass's own
        laws += [[0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0]]
        right += [0.0, 0.0]
    else:
        laws += [[0, 0, 0, 1, -mobility, mobility]]
        laws += [[0, 0, -1, 1, 0, 0]] if slide == 0 else [[0, 0, 0, 0, -math.exp(-slide * friction), 1]]
        right += [y.rod_speed, 0.0]
    return dict(zip(("u", "v", "heavy", "rod", "j1", "j2"), np.linalg.solve(laws, right), strict=True))


def before(name: str):
    p = TEN_TO_ONE.replace(rod_radius=0.03, hanging_length=0.5, **BODIES[name])
    own = extra_variables(p.effects)
    y = BEFORE
    if "sideways" in own:
        y = y._replace(sideways=0.15, sideways_speed=0.9)
    if "rod_speed" in own:
        y = y._replace(rod_speed=0.25)
    signs = Signs(slide=-1.0, across=-1.0, heavy=-1.0, phase=1.0, rod=1.0 if "rod_speed" in own else 0.0)
    return p.values(), y, (y.free_length + 0.03 * y.wrap_angle, y.sideways), signs, p.effects


@SLIDES
@EACH
def test_momentum_goes_where_newton_and_the_capstan_law_send_it(name, slide):
    p, y, _, signs, effects = before(name)
    hit, expected = Equations(math, p, effects).impact(slide, 0.3, y, signs), after(name, slide)
    assert hit.state.retreat_speed == pytest.approx(expected["u"], rel=1e-12)
    assert hit.state.sideways_speed == pytest.approx(expected["v"], rel=1e-12)
    assert hit.state.heavy_speed == pytest.approx(expected["heavy"], rel=1e-12, abs=1e-15)
    assert hit.state.rod_speed == pytest.approx(expected["rod"], rel=1e-12, abs=1e-15)
    assert hit.sliding == pytest.approx(expected["heavy"] - expected["rod"], rel=1e-11, abs=1e-15)
    assert hit.state.slack == 0
    kept = ("free_length", "wrap_angle", "across_speed", "sideways")
    assert [getattr(hit.state, n) for n in kept] == [getattr(y, n) for n in kept]


@EACH
def test_the_rules_take_the_one_slide_that_is_consistent_and_loses_energy(name):
    """Oracle: of up, down and stick, that whose string slides the way it was said to; of none, stick."""
    parameters = TEN_TO_ONE.replace(rod_radius=0.03, hanging_length=0.5, **BODIES[name])
    for heavy, retreat in ((-0.6, 1.7), (-0.6, 0.05), (0.3, 0.8), (-0.1, 6.0)):
        begun = Released(parameters)
        p, y, _, signs, effects = before(name)
        y = y._replace(heavy_speed=heavy, retreat_speed=retreat)
        after_impulse = rules.slide_or_stick_after_impulse(begun.system, begun.motion._replace(y=y, signs=signs))
        hits = {slide: Equations(math, p, effects).impact(slide, 0.0, y, signs) for slide in (1.0, -1.0, 0.0)}
        consistent = [slide for slide in (1.0, -1.0) if slide * hits[slide].sliding > 0] or [0.0]
        assert len(consistent) == 1
        taken = hits[consistent[0]].state
        assert after_impulse.y[:8] == taken[:8]
        if consistent[0]:
            assert after_impulse.mode is (Mode.SLIDING_UP if consistent[0] > 0 else Mode.SLIDING_DOWN)
        if "rod_speed" in extra_variables(effects):
            assert after_impulse.y.rod_speed == taken.rod_speed
            assert after_impulse.signs.rod == math.copysign(1.0, taken.rod_speed)
        if not p.string_density:

            def energy(s, p=p):
                rod = s.rod_speed**2 / p.rod_mobility if p.rod_mobility else 0.0
                light = p.light_mass * (s.retreat_speed**2 + s.across_speed**2 + s.sideways_speed**2)
                return light + p.heavy_mass * s.heavy_speed**2 + rod

            assert energy(taken) < energy(y)


# At release


def released(**changes) -> Released:
    return Released(TEN_TO_ONE.replace(**changes))


def test_a_push_on_a_rod_that_turns_turns_it():
    # Oracle: the rod takes up J1 - J2; it begins to turn towards the light mass, which pulls harder.
    begun = released(push_along=0.5, rod_mobility=10.0)
    p, mu = TEN_TO_ONE, 0.34 * TEN_TO_ONE.release_angle
    m1, m2, down = p.light_mass, p.heavy_mass, math.exp(-mu)
    j1 = 0.5 / (1 / m1 + down / m2)
    if 10.0 * j1 * (1 - down) < j1 * down / m2:  # else the rod outruns the string, and it sticks to the rod
        expected = (j1 * down / m2, 10.0 * j1 * (1 - down))
    else:
        stuck = 0.5 * m1 / (m1 + m2 + 0.1)
        expected = (stuck, stuck)
    assert (begun.motion.y.heavy_speed, begun.motion.y.rod_speed) == pytest.approx(expected, rel=1e-12)
    assert begun.motion.signs.rod == 1.0


@pytest.mark.parametrize(
    ("changes", "mode"),
    [
        ({}, Mode.SLIDING_DOWN),
        ({"heavy_mass": 0.004}, Mode.STICKING),
        ({"heavy_mass": 0.001}, Mode.SLIDING_UP),
        ({"push_along": 0.5}, Mode.SLIDING_UP),
        ({"push_along": -0.5}, Mode.SLACK),
        ({"push_across": 0.5}, Mode.SLIDING_DOWN),
        ({"release": "held"}, Mode.CLAMPED),
        ({"release": "held", "push_along": 0.5}, Mode.CLAMPED),
        ({"release": "held", "push_along": -0.5}, Mode.CLAMPED_SLACK),
        ({"release": "held", "release_angle": math.radians(60)}, Mode.CLAMPED_SLACK),
        ({"release": "held", "release_angle": math.radians(60), "push_across": 1.5}, Mode.CLAMPED_SLACK),
        ({"release": "held", "release_angle": math.radians(60), "push_across": 3.0}, Mode.CLAMPED),
        ({"release": "drop"}, Mode.FALLING),
        ({"release": "drop", "push_along": -0.5}, Mode.FALLING),
        ({"string_compliance": 1e-3}, Mode.SLIDING_DOWN),
        ({"string_compliance": 1e-3, "release": "held"}, Mode.CLAMPED),
        # T1 H = 0.0367 N H against T2 = 0.981 N, H = exp(5 theta): the rod holds the string, and its bearing all, or not
        ({"static_friction": 5.0, "rod_mobility": 1.0, "bearing_friction": 0.95}, Mode.STICKING),
        ({"static_friction": 5.0, "rod_mobility": 1.0, "bearing_friction": 0.94}, Mode.ROLLING),
        # H = 30: the rod holds T1 H = 1.10 N, which is just more than T2; H = 23: 0.84 N, which is less
        ({"static_friction": 1.74, "rod_mobility": 1.0, "bearing_friction": 0.95}, Mode.STICKING),
        ({"static_friction": 1.74, "rod_mobility": 1.0, "bearing_friction": 0.94}, Mode.ROLLING),
        ({"static_friction": 1.60, "rod_mobility": 1.0, "bearing_friction": 0.95}, Mode.SLIDING_DOWN),
        # friction turns the rod with (1 - exp(-mu theta)) T2 at most; a light rod is taken along, a heavy one is not
        ({"rod_mobility": 0.1}, Mode.SLIDING_DOWN),
        ({"rod_mobility": 1000.0}, Mode.ROLLING),
    ],
)
def test_the_mode_at_release(changes, mode):
    # Oracle: statics. At 60 deg, above the rod, a held string is taut from w^2 = l g cos(60 deg), w = 1.7 m/s.
    begun = released(**changes)
    assert begun.motion.mode is mode
    if mode in (Mode.CLAMPED, Mode.STICKING):
        assert begun.motion.y.retreat_speed == begun.motion.y.heavy_speed == 0


def test_a_push_at_the_horizontal_decides_whether_a_held_string_is_taut():
    # At 90 deg nothing pulls but for rounding. Pushed down, or at rest, the string tightens; pushed up, it goes slack.
    for push, mode in ((1e-9, Mode.CLAMPED), (0.0, Mode.CLAMPED), (-1e-9, Mode.CLAMPED_SLACK)):
        assert released(release="held", release_angle=math.pi / 2, push_across=push).motion.mode is mode
    # Half a degree above it a mass at rest pushes with g sin(0.5 deg) M, 1e13 times rounding, whichever way it is pushed
    for push in (0.01, 0.0, -0.01):
        assert released(release="held", release_angle=math.radians(89.5), push_across=push).motion.mode is Mode.CLAMPED_SLACK
    assert RELATIVE_TENSION_TOLERANCE * 0.01 * 9.81 < 1e-14


@pytest.mark.parametrize(("of_the_edge", "turns"), [(1.001, False), (0.999, True)])
def test_friction_turns_the_rod_that_its_bearing_does_not_hold(of_the_edge, turns):
    # Oracle: sliding down over a resting rod, T2 - T1 from the two masses' acceleration, here by linear equations
    p = TEN_TO_ONE
    theta, m1, m2, g = p.release_angle, p.light_mass, p.heavy_mass, 9.81
    ratio = math.exp(0.34 * theta)
    _, t1, t2 = np.linalg.solve([[m1, 1, 0], [m2, 0, -1], [0, -ratio, 1]], [-m1 * g * math.cos(theta), -m2 * g, 0])
    begun = released(rod_mobility=0.1, bearing_friction=of_the_edge * (t2 - t1))
    assert begun.motion.mode is Mode.SLIDING_DOWN
    assert begun.motion.signs.rod == (-1.0 if turns else 0.0)
    assert begun.motion.y.rod_speed == (-TINY_SPEED if turns else 0.0)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"heavy_swing": 0.4},
        {"release": "drop"},
        {"string_density": 0.01},
        {"heavy_mass": 0.02},
        {"light_drag": 0.02, "wind_speed": 4.0},
    ],
)
def test_the_series_that_leaves_rest_is_the_motion_to_second_order(changes):
    """Oracle: Newton's laws at rest give what speeds grow with; what has such a speed then moves half that times t^2."""
    begun = released(**changes)
    start = begun.motion.y
    series = begun.leave_rest()
    rate = Equations(math, begun.values, begun.effects).rates(begun.motion.mode, 0.0, start, begun.motion.signs)
    constant, linear, square = np.array(series, dtype=float)
    np.testing.assert_allclose(constant, np.array(start, dtype=float), rtol=0, atol=TINY_SPEED)
    np.testing.assert_allclose(linear, REST_SERIES_DURATION * np.array(rate), rtol=1e-12, atol=TINY_SPEED)
    h = 1e-4
    later = State(*(a + h * b for a, b in zip(start, rate, strict=True)))
    then = Equations(math, begun.values, begun.effects).rates(begun.motion.mode, h, later, begun.motion.signs)
    for name in ("free_length", "wrap_angle", "slack", "heavy_tilt"):
        k = State._fields.index(name)
        growth = (then[k] - rate[k]) / h
        assert square[k] == pytest.approx(0.5 * REST_SERIES_DURATION**2 * growth, rel=1e-3, abs=1e-17), name
    assert begun.motion.t == REST_SERIES_DURATION
    np.testing.assert_allclose(np.array(begun.motion.y, dtype=float), constant + linear + square, rtol=1e-15)


def test_what_moves_at_release_needs_no_series():
    for changes in ({"push_across": 0.1}, {"push_along": -0.1}, {"push_sideways": 0.1}):
        begun = released(**changes)
        assert begun.leave_rest() is None
        assert begun.motion.t == 0
    held = released(release="held")
    assert held.leave_rest() is None
    assert held.motion.y.across_speed == TINY_SPEED


def test_a_light_mass_released_at_rest_above_the_rod_falls_the_other_way():
    # Beyond 180 deg the weight pulls it back: the sign of its speed across is negative from the first instant.
    for degrees, sign in ((112, 1.0), (200, -1.0)):
        begun = released(release_angle=math.radians(degrees))
        begun.leave_rest()
        assert begun.motion.signs.across == sign
        assert begun.motion.y.across_speed * sign > 0
    assert released(push_across=-0.3).motion.signs.across == -1.0
    assert released(push_across=0.3).motion.signs.across == 1.0


# A string that stretches


@pytest.mark.parametrize("release", ["looping", "held", "vertical"])
def test_a_stretched_string_at_release_carries_the_heavy_masss_weight(release):
    # Oracle: Hooke. T2 = M2 g on the share of the heavy side, T1 = T2 exp(-mu theta) on the light one's; a clamp carries M2.
    p = TEN_TO_ONE.replace(release=release, string_compliance=2e-3, hanging_length=0.2)
    begun = Released(p)
    t2 = 0.1 * 9.81
    t1 = t2 * math.exp(-0.34 * p.release_angle)
    share = (p.free_length + p.rod_radius * p.release_angle) / p.string_length
    assert begun.motion.y.light_stretch == pytest.approx(2e-3 * share * t1, rel=1e-12)
    assert begun.motion.y.heavy_stretch == pytest.approx(0.0 if release == "held" else 2e-3 * (1 - share) * t2, rel=1e-12)


def test_a_slack_strings_stretch_is_spread_by_the_lengths_of_its_sides():
    p = TEN_TO_ONE.replace(string_compliance=2e-3, hanging_length=0.2)
    y = State(0.3, 2.5, 0.5, 1.0, -0.3, 0.0, light_stretch=4e-3, heavy_stretch=-1e-3)
    actual = Equations(math, p.values(), p.effects).with_even_stretch(y, Signs(-1.0, 1.0, -1.0, 0.0))
    light = 0.3 + p.rod_radius * 2.5 - 4e-3  # unstretched string on the light side
    assert actual.light_stretch + actual.heavy_stretch == pytest.approx(3e-3, rel=1e-12)
    assert actual.light_stretch / actual.heavy_stretch == pytest.approx(light / (p.string_length - light), rel=1e-12)
    assert actual._replace(light_stretch=y.light_stretch, heavy_stretch=y.heavy_stretch) == y


def test_a_string_that_stretches_loses_at_least_a_tenth_of_a_millisecond():
    assert TEN_TO_ONE.replace(string_loss_time=0.0).values().string_loss_time == 1e-4
    assert TEN_TO_ONE.replace(string_loss_time=5e-4).values().string_loss_time == 5e-4
    assert 0 < MARGIN_TOLERANCE < 1e-6 * 0.01 * 9.81  # far below what any mass here weighs


# Runs through what is rare


def test_a_rod_that_turns_rolls_slides_and_rests():
    """Oracle: the same run at a looser tolerance; what stops, stops exactly, but for the sign with which it may turn again."""
    p = TWO_TO_ONE.replace(rod_mobility=30.0, bearing_friction=0.25)
    runs = [solve(p, duration=0.6, tolerance=tolerance) for tolerance in (1e-9, 1e-7)]
    assert [e.event for e in runs[0].events] == [e.event for e in runs[1].events]
    assert {e.event for e in runs[0].events} >= {Event.ROD_STOPS, Event.ROD_SLOWS}
    for a, b in zip(runs[0].events, runs[1].events, strict=True):
        assert a.time == pytest.approx(b.time, abs=1e-5)
        if a.event is Event.ROD_STOPS:
            assert max(map(abs, (a.state.heavy_speed, a.state.retreat_speed, a.state.rod_speed))) <= TINY_SPEED


# What follows an event on a rod that turns

ROD = {"rod_mobility": 1.0, "bearing_friction": 0.2}


def turning(mode: Mode, event: Event, rod_speed: float, slide: float = -1.0, heavy: float = -0.7, **changes) -> Motion:
    """Return the motion just after ``event`` in ``mode``."""
    begun = released(**ROD | changes)
    heavy = rod_speed if mode is Mode.ROLLING or event is Event.STOP else heavy
    retreat = heavy if mode.string_moves else 0.0
    _, t, y, signs = begun.motion
    sign = math.copysign(1.0, rod_speed) if rod_speed else 0.0
    motion = Motion(
        mode,
        t,
        y._replace(retreat_speed=retreat, heavy_speed=heavy, rod_speed=rod_speed, across_speed=1.0),
        signs._replace(slide=slide, across=1.0, phase=1.0, rod=sign, rod_phase=1.0 if rod_speed else 0.0),
    )
    return rules.apply_event(begun.system, mode, event, motion)


@pytest.mark.parametrize("slide", [1.0, -1.0])
def test_a_rod_begins_to_turn_the_way_the_string_slides(slide):
    mode = Mode.SLIDING_UP if slide > 0 else Mode.SLIDING_DOWN
    after = turning(mode, Event.ROD_CHANGES, 0.0, slide, heavy=0.7 * slide)
    assert (after.mode, after.signs.rod, after.signs.rod_phase) == (mode, slide, 0.0)
    assert after.y.rod_speed == slide * TINY_SPEED
    assert after.y.heavy_speed == 0.7 * slide


@pytest.mark.parametrize(("bearing", "rod"), [(0.02, -1.0), (5.0, 0.0)])
def test_a_rod_that_stops_under_a_sliding_string_turns_its_way_or_rests(bearing, rod):
    # It turned up, and the string slides down: its friction, (exp(mu theta) - 1) T1 of about 0.05 N, takes it along, or not
    after = turning(Mode.SLIDING_DOWN, Event.ROD_CHANGES, 0.3, bearing_friction=bearing)
    assert after.mode is Mode.SLIDING_DOWN
    assert (after.signs.rod, after.y.rod_speed) == (rod, rod * TINY_SPEED)


@pytest.mark.parametrize(("event", "sign"), [(Event.ROD_YIELDS_UP, 1.0), (Event.ROD_YIELDS_DOWN, -1.0)])
def test_a_bearing_that_yields_lets_the_string_roll(event, sign):
    after = turning(Mode.STICKING, event, 0.0, heavy=0.0)
    assert (after.mode, after.signs.rod, after.y.rod_speed) == (Mode.ROLLING, sign, sign * TINY_SPEED)


def test_a_rod_that_slows_is_watched_for_its_stop():
    after = turning(Mode.ROLLING, Event.ROD_SLOWS, -0.3)
    assert (after.mode, after.signs.rod, after.signs.rod_phase, after.y.rod_speed) == (Mode.ROLLING, -1.0, 1.0, -0.3)


@pytest.mark.parametrize(
    ("static", "mode"),
    [(5.0, Mode.ROLLING), (0.34, Mode.SLIDING_DOWN)],
)
def test_a_string_that_stops_on_a_turning_rod_has_its_speed(static, mode):
    # T1 is 0.05 N and T2 0.98 N: held by friction of 5 it goes on with the rod, by that of 0.34 it slides on
    after = turning(Mode.SLIDING_DOWN, Event.STOP, -0.3, static_friction=static)
    assert after.mode is mode
    assert after.y.heavy_speed == after.y.retreat_speed == after.y.rod_speed == -0.3
    assert after.signs.rod_phase == 1.0


def test_what_rolls_stops_altogether():
    after = turning(Mode.ROLLING, Event.ROD_STOPS, -0.3, static_friction=5.0, bearing_friction=50.0)
    assert after.mode is Mode.STICKING
    assert after.y.heavy_speed == after.y.retreat_speed == after.y.rod_speed == after.signs.rod == 0


def test_a_string_begins_to_slide_on_a_rolling_rod_with_its_speed():
    for event, mode, slide in ((Event.SLIP_ONSET_DOWN, Mode.SLIDING_DOWN, -1.0), (Event.SLIP_ONSET_UP, Mode.SLIDING_UP, 1.0)):
        after = turning(Mode.ROLLING, event, -0.3)
        assert (after.mode, after.signs.slide, after.signs.phase) == (mode, slide, 0.0)  # relative to the rod it rests
        assert after.y.heavy_speed == after.y.rod_speed == -0.3


def test_a_stretching_string_that_tightens_pulls_evenly_again():
    begun = released(string_compliance=2e-3, hanging_length=0.2)
    y = State(0.4, 2.0, 0.3, 1.0, -0.3, 0.01, light_stretch=2e-3, heavy_stretch=-1e-3)
    slack = Motion(Mode.SLACK, 0.0, y, begun.motion.signs._replace(phase=1.0))
    after = rules.apply_event(begun.system, Mode.SLACK, Event.TAUT, slack)
    whole = y.light_stretch + y.heavy_stretch
    assert not after.mode.slack
    assert after.y.light_stretch + after.y.heavy_stretch == pytest.approx(whole, rel=1e-12)
    light = 0.4 + 2 * 0.00625 - 2e-3  # unstretched
    ratio = light / (begun.parameters.string_length - light)
    assert after.y.light_stretch / after.y.heavy_stretch == pytest.approx(ratio, rel=1e-12)
    assert (after.y.retreat_speed, after.y.heavy_speed) == (0.3, -0.3)  # springs: nothing jumps
