"""The small parts that every run is made of: what a state implies, what may be asked for."""

import math

import numpy as np
import pytest

from looping_pendulum.reference_ode import rules, solution, state
from looping_pendulum.reference_ode.effects import COEFFICIENTS, EFFECTS
from looping_pendulum.reference_ode.effects.closure import (
    COORDINATES,
    FACTORS,
    N_BASIS_FUNCTIONS,
    ROUNDING_DISTANCE,
    SIDES,
    weight_name,
)
from looping_pendulum.reference_ode.effects.library import REST_SPEED
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.state import (
    Signs,
    State,
    event_in_phase,
    extra_variables,
    full_state,
    kinematics,
    variables,
)
from looping_pendulum.reference_ode.transitions import END_EVENTS, PHASE_EVENTS, Event, Mode, next_mode
from research.driver import fill_in_heavy_speed
from tests.apparatus import TEN_TO_ONE
from tests.reference_ode.released import Released

BASE = TEN_TO_ONE.effects
UP = Signs(slide=1.0, across=-1.0, heavy=-1.0, phase=1.0)
TURNING = TEN_TO_ONE.replace(rod_mobility=1.0)
SWINGING = TEN_TO_ONE.replace(heavy_swing=0.1)
STRETCHING = TEN_TO_ONE.replace(string_compliance=1e-3)
SIDEWAYS = TEN_TO_ONE.replace(push_sideways=0.1)

# What a state implies


def seen(p: Parameters, mode: Mode, y: State, signs: Signs = UP):
    return kinematics(math, mode, 0.2, y, signs, p.values(), p.effects)


def test_sizes_of_speeds_in_every_mode():
    # Oracle: Pythagoras. What rests has no speed, whatever its entry of the state says.
    y = State(0.5, 2.0, 3.0, -4.0, 3.0, 0.0)
    up = seen(TEN_TO_ONE, Mode.SLIDING_UP, y)
    assert (up.light_mass_speed, up.across_speed_size, up.heavy_speed_size, up.slip_speed) == (5.0, 4.0, 3.0, 3.0)
    down = seen(TEN_TO_ONE, Mode.SLIDING_DOWN, y._replace(heavy_speed=-3.0), UP._replace(slide=-1.0))
    assert (down.heavy_speed_size, down.slip_speed) == (3.0, 3.0)
    slack = seen(TEN_TO_ONE, Mode.SLACK, y._replace(heavy_speed=-2.0))
    assert (slack.light_mass_speed, slack.heavy_speed_size) == (5.0, 2.0)
    held = seen(TEN_TO_ONE, Mode.STICKING, State(0.5, 2.0, 0.0, -4.0, 0.0, 0.0))
    assert (held.light_mass_speed, held.heavy_speed_size) == (4.0, 0.0)
    rolling = seen(TURNING, Mode.ROLLING, y._replace(rod_speed=3.0), UP._replace(rod=1.0))
    assert rolling.heavy_speed_size == 3.0
    assert rolling.slip_speed == 0.0
    backwards = seen(TURNING, Mode.ROLLING, y._replace(heavy_speed=-3.0, rod_speed=-3.0), UP._replace(rod=-1.0))
    assert backwards.heavy_speed_size == 3.0


def test_what_only_some_effects_move_is_seen():
    y = State(0.5, 2.0, 3.0, -4.0, 3.0, 0.01, 0.2, 1.5, 0.3, 12.0, 1.0, 1e-3, 2e-3)
    sideways = seen(SIDEWAYS, Mode.SLIDING_UP, y)
    assert sideways.light_mass_speed == 13.0
    assert sideways.sideways_speed == 12.0
    path = math.hypot(0.5 + 2.0 * TEN_TO_ONE.rod_radius, 0.3)
    assert sideways.hanging_length == pytest.approx(TEN_TO_ONE.string_length - path - 0.01, rel=1e-12)
    swinging = seen(SWINGING, Mode.SLIDING_UP, y)
    assert swinging.heavy_speed_size == pytest.approx(math.hypot(3.0, 1.5, REST_SPEED), rel=1e-12)
    assert (swinging.heavy_tilt, swinging.heavy_across_speed, swinging.contact_angle) == (0.2, 1.5, 1.8)
    turning = seen(TURNING, Mode.SLIDING_UP, y)
    assert turning.slip_speed == 2.0  # relative to the rod's surface
    assert turning.heavy_speed_size == pytest.approx(math.hypot(3.0, REST_SPEED), rel=1e-12)
    assert seen(STRETCHING, Mode.STICKING, y).heavy_speed_size == pytest.approx(math.hypot(3.0, REST_SPEED), rel=1e-12)
    assert seen(STRETCHING, Mode.STICKING, y).light_mass_speed == 5.0  # its string gives way though the rod holds it
    assert seen(TEN_TO_ONE, Mode.STICKING, y).hanging_length is None


def test_what_moves_in_a_mode():
    resting, moving = (
        {"free_length", "wrap_angle", "across_speed"},
        {"free_length", "wrap_angle", "retreat_speed", "across_speed"},
    )
    whole = moving | {"heavy_speed", "slack"}
    for mode in Mode:
        expected = whole if mode.slack else moving if mode.string_moves else resting
        assert set(variables(mode, BASE)) == expected
        assert set(variables(mode, SIDEWAYS.effects)) >= expected | {"retreat_speed", "sideways", "sideways_speed"}
        assert ("heavy_speed" in variables(mode, SIDEWAYS.effects)) is (mode.string_moves or mode.slack)
        assert set(variables(mode, STRETCHING.effects)) == whole | {"light_stretch", "heavy_stretch"}
        assert variables(mode, BASE) == tuple(name for name in State._fields if name in expected)  # in the state's order
    assert extra_variables(SWINGING.effects) == {"heavy_tilt", "heavy_across_speed"}


def test_a_taut_strings_heavy_mass_moves_as_its_light_one_retreats():
    given = {"free_length": 0.5, "wrap_angle": 2.0, "across_speed": 1.0}
    assert full_state(Mode.STICKING, **given) == State(0.5, 2.0, 0.0, 1.0, 0.0, 0.0)
    assert full_state(Mode.SLIDING_UP, retreat_speed=0.3, **given) == State(0.5, 2.0, 0.3, 1.0, 0.3, 0.0)
    assert full_state(Mode.ROLLING, retreat_speed=0.3, **given).heavy_speed == 0.3
    assert full_state(Mode.SLACK, retreat_speed=0.3, heavy_speed=-1.0, slack=0.1, **given) == State(
        0.5, 2.0, 0.3, 1.0, -1.0, 0.1
    )
    assert full_state(Mode.STICKING, retreat_speed=0.3, **given).heavy_speed == 0.0
    for mode, names, follows in (
        (Mode.SLIDING_UP, variables(Mode.SLIDING_UP, BASE), True),
        (Mode.STICKING, variables(Mode.STICKING, BASE), False),
        (Mode.SLIDING_UP, variables(Mode.SLIDING_UP, SIDEWAYS.effects), False),
    ):
        full = np.arange(2.0 * len(State._fields)).reshape(len(State._fields), 2)
        before = full.copy()
        fill_in_heavy_speed(mode, names, full)
        heavy, retreat = State._fields.index("heavy_speed"), State._fields.index("retreat_speed")
        assert np.array_equal(full[heavy], before[retreat] if follows else before[heavy])
        full[heavy] = before[heavy]
        assert np.array_equal(full, before)


def test_an_event_means_what_its_phase_says():
    still = UP._replace(phase=0.0)
    assert [event_in_phase(e, still) for e in (Event.STOP, Event.TAUT, Event.UNWRAPPED)] == [
        Event.SLOWS,
        Event.CLOSES,
        Event.UNWRAPPED,
    ]
    assert [event_in_phase(e, UP) for e in (Event.STOP, Event.TAUT)] == [Event.STOP, Event.TAUT]
    for event in (Event.ROD_CHANGES, Event.ROD_STOPS):
        assert event_in_phase(event, UP._replace(rod=-1.0)) is Event.ROD_SLOWS
        assert event_in_phase(event, UP._replace(rod=-1.0, rod_phase=1.0)) is event
        assert event_in_phase(event, UP) is event  # of a rod that does not turn


def test_every_event_ends_a_mode_changes_it_or_leaves_it():
    for event in END_EVENTS:
        assert {next_mode(mode, event) for mode in Mode} == {Mode.ENDED}
    for event in PHASE_EVENTS:
        assert [next_mode(mode, event) for mode in Mode] == list(Mode)
    assert not END_EVENTS & PHASE_EVENTS


@pytest.mark.parametrize(("values", "watches"), [
    ({}, False), ({"string_on_string": 0.1}, True), ({"string_thickness": 1e-4}, True), ({"friction_per_wrap": 0.1}, False),
])  # fmt: skip
def test_what_changes_its_law_at_a_full_turn_looks_for_it(values, watches):
    p = TEN_TO_ONE.replace(**values)
    y = State(0.5, 6.0, -0.1, 1.0, -0.1, 0.0)
    actual = Equations(math, p.values(), p.effects).event_functions(Mode.SLIDING_DOWN, 0.0, y, UP._replace(slide=-1.0))
    assert (Event.FIRST_TURN in actual) is watches


def test_at_the_first_turn_a_string_steps_out_and_the_light_mass_stays():
    """Oracle: continuity of the place of the light mass, of the string's length and of the direction of the string."""
    p = TEN_TO_ONE.replace(string_thickness=2e-3)
    begun = Released(p)
    m = begun.motion._replace(mode=Mode.SLIDING_DOWN, y=State(0.3, 2 * math.pi, -0.2, 1.5, -0.2, 0.0))
    positions, paths = [], []
    for overlap in (0.0, 1.0, 0.0):
        assert m.signs.overlap == overlap
        positions.append(solution.light_mass_position(math, m.y, overlap, begun.values, p.effects))
        paths.append(state.string_path(math, m.y, overlap, begun.values, p.effects))
        m = rules.apply_event(begun.system, Mode.SLIDING_DOWN, Event.FIRST_TURN, m)
    np.testing.assert_allclose(positions, np.broadcast_to(positions[0], (3, 2)), rtol=0, atol=1e-15)
    np.testing.assert_allclose(paths, paths[0], rtol=1e-14)


# What may be asked for

BOUNDS = {
    "gravity": (0, 100), "kinetic_friction": (0, 5), "static_friction": (0, 10), "light_drag": (0, 1), "heavy_drag": (0, 1),
    "string_drag": (0, 1), "light_linear_drag": (0, 1), "heavy_linear_drag": (0, 10), "attitude_drag": (-1, 100),
    "wind_speed": (-20, 20), "side_force": (-10, 10), "side_stiffness": (-10, 10), "friction_per_speed": (-0.1, 10),
    "friction_per_wrap": (-0.05, 1), "string_on_string": (0, 5), "push_across": (-20, 20), "push_along": (-20, 20),
    "string_density": (0, 0.1), "string_thickness": (0, 0.01), "heavy_swing": (-1.2, 1.2), "push_sideways": (-5, 5),
    "pivot_friction": (0, 10), "pivot_damping": (0, 10), "light_inertia": (0, 1),
    "rod_mobility": (0, 1e4), "bearing_friction": (0, 100), "string_compliance": (0, 0.1), "string_loss_time": (0, 0.1),
}  # fmt: skip
"""Bounds that scenario files rely on since 2026: a file that was valid must stay so, and a wrong unit must be refused."""


def test_bounds_are_those_that_scenario_files_rely_on():
    actual = {name: c.bounds for name, c in COEFFICIENTS.items() if not name.startswith("closure_")}
    assert actual == BOUNDS
    for name in set(COEFFICIENTS) - set(BOUNDS):
        assert COEFFICIENTS[name].bounds == (-1e6, 1e6)
    assert {name: c.default for name, c in COEFFICIENTS.items() if c.default} == {"gravity": 9.81}
    assert {c.null for c in COEFFICIENTS.values()} == {0.0}


def test_effects_that_need_a_pivot_act_where_the_heavy_mass_is_held():
    values = {"pivot_friction": 1e-3, "pivot_damping": 1e-3}
    for release in ("looping", "vertical", "drop", "held"):
        names = {e.name for e in TEN_TO_ONE.replace(release=release, **values).effects}
        assert (names >= set(values)) is (release == "held")
        assert bool(names & set(values)) is (release == "held")


def test_effects_that_need_a_string_are_those_of_string_and_rod():
    without = {e.name for e in TEN_TO_ONE.replace(release="drop").effects}
    assert without == {"gravity", "capstan", "light_drag", "heavy_drag"}
    needing = {e.name for e in EFFECTS.values() if e.needs_string}
    # A pivot is that of a string that is held
    assert needing == {"string_drag", "pivot_friction", "pivot_damping"} | {
        e.name for e in EFFECTS.values() if e.kind.name == "PROPERTY"
    }


@pytest.mark.parametrize("coordinate", COORDINATES)
@pytest.mark.parametrize("factor", FACTORS)
def test_an_unknown_law_is_a_sum_of_radial_basis_functions_of_its_coordinate(coordinate, factor):
    """Oracle: Gaussians a width apart, by NumPy: c_i exp(-(s / h - s_0 / h - i)^2 / 2), times 1 or minus a speed."""
    rng = np.random.default_rng(8)
    weights = {side: rng.normal(size=N_BASIS_FUNCTIONS) for side in SIDES}
    named = {weight_name(side, i): value for side in SIDES for i, value in enumerate(weights[side])}
    chosen = {f"closure_of_{coordinate}": 1.0, f"closure_by_{factor}": 1.0, "closure_scale": 2.5, "closure_start": -1.5,
              "closure_point_x": -0.3, "closure_point_y": -0.4}  # fmt: skip
    p = TEN_TO_ONE.replace(**named, **chosen)
    y = State(0.45, 2.1, 0.7, -1.3, 0.7, 0.0)
    k = kinematics(math, Mode.SLIDING_UP, 0.8, y, UP, p.values(), p.effects)
    v = p.values()
    x = v.rod_radius * math.cos(2.1) - 0.45 * math.sin(2.1)
    y_up = v.rod_radius * math.sin(2.1) + 0.45 * math.cos(2.1)
    s = {
        "time": 0.8,
        "free_length": 0.45,
        "wrap_angle": 2.1,
        "retreat_speed": 0.7,
        "across_speed": -1.3,
        "slip_speed": 0.7,
        "normal_load": v.light_mass * (1.3**2 / 0.45 - v.gravity * math.cos(2.1)),
        "hanging_length": v.hanging_length + v.free_length + v.rod_radius * v.release_angle - 0.45 - v.rod_radius * 2.1,
        "horizontal_position": x,
        "height": y_up,
        "distance": math.sqrt((x + 0.3) ** 2 + (y_up + 0.4) ** 2 + ROUNDING_DISTANCE**2),
    }[coordinate]
    gradient = {
        "horizontal_position": (1.0, 0.0),
        "height": (0.0, 1.0),
        "distance": ((x + 0.3) / s, (y_up + 0.4) / s),
    }.get(coordinate, (0.0, 0.0))
    e1, t1 = (math.sin(2.1), -math.cos(2.1)), (-math.cos(2.1), -math.sin(2.1))
    times = {"constant": 1.0, "retreat_speed": -0.7, "across_speed": 1.3}[factor]
    basis_functions = times * np.exp(-0.5 * (2.5 * s + 1.5 - np.arange(12)) ** 2)
    actual = (
        *EFFECTS["closure"].force_on_light_mass(math, k, p.values()),
        EFFECTS["closure"].force_on_heavy_mass(math, k, p.values()),
        EFFECTS["closure"].sliding_exponent(math, k, p.values()),
        EFFECTS["closure"].holding_exponent(math, k, p.values()),
    )
    on_side = {side: basis_functions @ weights[side] for side in SIDES}
    expected = [
        on_side["along"] + on_side["gradient"] * np.dot(gradient, e1),
        on_side["across"] + on_side["gradient"] * np.dot(gradient, t1),
        on_side["heavy"],
        2.1 * on_side["friction"],
        2.1 * on_side["friction"],
    ]
    np.testing.assert_allclose(actual, expected, rtol=1e-10, atol=1e-14)


def test_an_unknown_force_may_have_twelve_basis_functions_on_each_side():
    names = {c.name for c in EFFECTS["closure"].coefficients}
    assert len(names) == 5 * 12 + len(COORDINATES) + len(FACTORS) + 4
    assert {n for n in names if n.startswith("closure_along_")} == {f"closure_along_{i}" for i in range(12)}
