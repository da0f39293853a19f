import math

import numpy as np
import pytest

from looping_pendulum.reference_ode.transitions import Event
from looping_pendulum.scenarios.loader import load
from scripts.answers_parts.grazing import ParameterLine, approach, find_changes, gap

CLOSE = 1e-8


def line(**changes):
    return ParameterLine(base=load("two_and_a_half_to_one").parameters.replace(**changes), name="release_angle", duration=8.0)


def only_change(of, low, high):
    (change,) = find_changes(of, np.radians(np.linspace(low, high, 5)), width=CLOSE)
    return change


def test_a_break_away_that_only_just_happens_is_found_and_its_margin_goes_to_zero():
    """A margin that dips to zero does so in proportion to the distance, as any smooth least value does."""
    of = line()
    change = only_change(of, 64.4, 64.7)
    assert (change.kind, change.event, change.missing_below) == ("graze", Event.SLIP_ONSET_DOWN, True)
    distances = np.radians([1e-3, 1e-4])
    margins = approach(of, change, distances)
    assert np.all(margins > 0)
    assert math.log10(margins[0] / margins[1]) == pytest.approx(1.0, abs=0.01)
    assert 0 <= change.quantity < 2 * CLOSE / distances[1] * margins[1]


def test_only_the_words_jump_not_the_motion_while_static_friction_is_the_kinetic_one():
    of = line()
    change = only_change(of, 64.4, 64.7)
    assert abs(change.halting_times[1] - change.halting_times[0]) > 0.2
    middle = 0.5 * (change.low + change.high)
    apart = [gap(of.run(middle - w), of.run(middle + w)) for w in (1e-5, 1e-7)]
    assert apart[0] / apart[1] == pytest.approx(100, rel=0.1)


def test_above_it_the_motion_jumps_too():
    of = line(static_friction=1.16 * 0.3)
    change = only_change(of, 64.92, 64.97)
    middle = 0.5 * (change.low + change.high)
    apart = [gap(of.run(middle - w), of.run(middle + w)) for w in (1e-5, 1e-7)]
    assert apart[1] > 0.05
    assert apart[0] / apart[1] == pytest.approx(1, rel=0.01)


def test_a_stop_that_only_just_holds():
    change = only_change(line(), 70.7, 70.9)
    assert (change.kind, change.event, change.rival) == ("choice", Event.STOP, Event.STOP)
    assert 0 <= change.quantity < 1e-7


def test_no_change_where_the_paper_saw_its_four_curves_part():
    assert find_changes(line(), np.radians(np.linspace(74.9, 75.4, 51)), width=CLOSE) == []
