"""What `solve` returns: halts and stops, sampled positions and velocities, and what it refuses."""

import math

import numpy as np
import pytest

from looping_pendulum.reference_ode.closed_forms import HELD_PERIOD_NODES
from looping_pendulum.reference_ode.solution import Run, RunEvent
from looping_pendulum.reference_ode.solve import DURATION, TOLERANCE, solve, solve_at
from looping_pendulum.reference_ode.state import (
    State,
)
from looping_pendulum.reference_ode.transitions import Event, Mode
from tests.apparatus import TEN_TO_ONE, TWO_TO_ONE


def run_of(*events: tuple[Event | None, Mode, Mode, float]) -> Run:
    """Return a run whose k-th event is at k s; the last number of each is the rod's speed after it [m/s]."""
    y = State(0.5, 2.0, 0.0, 1.0, 0.0, 0.0)
    made = [
        RunEvent(event=e, time=float(k), mode_before=before, mode_after=after, state=y._replace(rod_speed=rod))
        for k, (e, before, after, rod) in enumerate(events)
    ]
    return Run(parameters=TEN_TO_ONE, tolerance=0.0, events=tuple(made))


def test_the_halt_is_the_last_stop_of_a_run_that_ends_at_rest_at_the_rod():
    down, stick, up = Mode.SLIDING_DOWN, Mode.STICKING, Mode.SLIDING_UP
    begun = (None, down, down, 0.0)
    stop, reverses = (Event.STOP, down, stick, 0.0), (Event.ACROSS_REVERSES, stick, stick, 0.0)
    run = run_of(begun, stop, reverses, (Event.LIGHT_REACHES_ROD, stick, Mode.ENDED, 0.0))
    assert run.halting_time == 1.0
    assert run.halt is run.events[1]
    assert run.stops == (1.0,)
    assert run.modes == (down, stick, Mode.ENDED)
    assert (run.end.event, run.end_time) == (Event.LIGHT_REACHES_ROD, 3.0)
    for last in ((Event.TIME_UP, stick, Mode.ENDED, 0.0), (Event.LIGHT_REACHES_ROD, up, Mode.ENDED, 0.0)):
        assert run_of(begun, stop, last).halt is None
        assert run_of(begun, stop, last).halting_time is None
    turning = run_of(begun, (Event.STOP, down, Mode.ROLLING, -0.5), (Event.ROD_STOPS, Mode.ROLLING, stick, 0.0))
    assert turning.stops == (2.0,)  # a string that stops on a rod that turns goes on with it


def test_a_swinging_heavy_mass_is_where_its_string_ends():
    """Oracle: the tangent from the rod at the tilt, as long as what hangs; at release, h at the angle phi."""
    p = TEN_TO_ONE.replace(heavy_swing=0.3, hanging_length=0.2)
    samples = solve_at(p, np.array([0.0, 0.1]), duration=0.11, tolerance=1e-9)
    s = samples.state
    fed = p.free_length + p.rod_radius * p.release_angle - s.free_length - p.rod_radius * s.wrap_angle
    length = 0.2 + p.rod_radius * (s.heavy_tilt - 0.3) + fed
    foot = p.rod_radius * np.stack([np.cos(s.heavy_tilt), np.sin(s.heavy_tilt)], axis=1)
    down = np.stack([np.sin(s.heavy_tilt), -np.cos(s.heavy_tilt)], axis=1)
    np.testing.assert_allclose(samples.heavy_position, foot + length[:, None] * down, rtol=0, atol=1e-14)
    assert s.heavy_tilt[0] == 0.3


@pytest.mark.parametrize("values", [{}, {"heavy_swing": 0.3}, {"string_thickness": 2e-3, "string_on_string": 0.1}])
def test_sampled_velocities_are_the_derivatives_of_sampled_places(values):
    # Bound: differences over 2e-4 s err by h^2 / 6 of the third derivative, about 1e4 m/s^3 late in a run
    p = TEN_TO_ONE.replace(**values)
    run = solve(p, duration=0.6, tolerance=1e-10)
    t = np.linspace(0.05, 0.59, 40)
    t, h = t[np.abs(t[:, None] - [e.time for e in run.events]).min(axis=1) > 1e-3], 1e-4
    before, now, after = (run.sample(t + k * h) for k in (-1, 0, 1))
    for place, velocity in (("light_position", "light_velocity"), ("heavy_position", "heavy_velocity")):
        slope = (getattr(after, place) - getattr(before, place)) / (2 * h)
        np.testing.assert_allclose(slope, getattr(now, velocity), rtol=0, atol=1e-4)
    assert run.sample(np.zeros(1)).state.wrap_angle[0] < 2 * math.pi < run.end.state.wrap_angle


def test_times_are_sampled_from_release_to_end_and_no_others():
    run = solve(TEN_TO_ONE, duration=0.1, tolerance=1e-8)
    for t in ([-1e-9], [0.1 + 1e-9]):
        with pytest.raises(ValueError, match="the run covers 0 to 0.1 s"):
            run.sample(np.array(t))
    assert run.sample(np.array([0.0, 0.1])).t.tolist() == [0.0, 0.1]
    assert run.sample(np.zeros(0)).light_position.shape == (0, 2)
    beyond = solve_at(TEN_TO_ONE, np.array([0.0, 5e-7, 0.05, 0.1, 0.2]), duration=0.1, tolerance=1e-8)
    assert beyond.t.tolist() == [0.0, 5e-7, 0.05, 0.1]
    np.testing.assert_allclose(beyond.light_position, run.sample(beyond.t).light_position, rtol=0, atol=1e-14)


def test_a_tolerance_below_what_double_precision_can_keep_is_taken_as_the_least():
    t = np.linspace(0, 0.1, 3)
    fine, finest = (solve_at(TEN_TO_ONE, t, duration=0.1, tolerance=x) for x in (1e-13, 1e-16))
    assert np.array_equal(fine.light_position, finest.light_position)


def test_defaults_are_those_of_the_documentation():
    assert (TOLERANCE, DURATION) == (1e-12, 5.0)
    assert HELD_PERIOD_NODES >= 50
    assert solve(TWO_TO_ONE, duration=0.01).tolerance == TOLERANCE
