"""Changes of the sequence of events along a line of runs, and how rough the boundaries of maps are."""

import math

import numpy as np
import pytest

from looping_pendulum.reference_ode.transitions import Event
from looping_pendulum.scenarios.loader import load
from research.answers.grazing import ParameterLine, approach, find_changes, gap
from research.answers.uncertainty import uncertain, uncertain_fractions, uncertainty_exponent

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


# ---- uncertainty exponents


EPS = 10.0 ** -np.arange(1.0, 7.6, 0.5)


def inside_a_circle(x):
    return (np.hypot(*(x - 0.5).T) < 0.3).astype(int)


def gap_of_the_cantor_set(x):
    """Parity of the step at which the middle third that holds x is taken out."""
    y, out, done = x[:, 0].copy(), np.zeros(len(x), dtype=int), np.zeros(len(x), dtype=bool)
    for step in range(33):
        y = 3 * y
        third = np.floor(y)
        middle = (third == 1) & ~done
        out[middle] = 1 + step % 2
        done |= middle
        y -= third
    return out


def exponent_of(outcome, dimension, replicates=6):
    rows = uncertain_fractions(outcome, dimension, EPS, count=600, replicates=replicates, seed=1)
    return uncertainty_exponent(EPS, rows), rows.mean(axis=0)


def test_a_smooth_boundary_has_exponent_one():
    exponent, fractions = exponent_of(inside_a_circle, 2)
    assert abs(exponent.value - 1) < 4 * exponent.standard_error + 0.005
    assert exponent.standard_error < 0.02
    # neighbours along the axes reach a boundary of length s from both sides: 2 eps times its mean of max(|cos|, |sin|)
    expected = 2 * EPS[-1] * 0.3 * 2 * math.pi * (2 * math.sqrt(2) / math.pi)
    assert abs(fractions[-1] / expected - 1) < 0.2


def test_the_cantor_set_has_the_exponent_that_its_dimension_leaves():
    """1 - ln 2 / ln 3 = 0.369; its neighbours' outcomes agree by chance now and then, which leaves a percent."""
    exponent, _ = exponent_of(gap_of_the_cantor_set, 1)
    assert abs(exponent.value - (1 - math.log(2) / math.log(3))) < 4 * exponent.standard_error + 0.005


def test_fractions_are_those_of_plain_counting_where_counting_can_see_them():
    rng = np.random.default_rng(7)
    starts = rng.random((40_000, 2))
    followed = uncertain_fractions(inside_a_circle, 2, EPS, count=600, replicates=6, seed=2).mean(axis=0)
    for eps, fraction in zip(EPS[:3], followed[:3], strict=True):
        counted = uncertain(inside_a_circle, starts, eps)
        error = math.hypot(counted.std() / math.sqrt(len(starts)), fraction * math.sqrt(3 / 3600 / max(fraction, 0.01)))
        assert abs(fraction - counted.mean()) < 4 * error


def test_nothing_uncertain_ends_the_search():
    fractions = uncertain_fractions(lambda x: np.zeros(len(x)), 1, EPS, count=50, replicates=2, seed=0)
    np.testing.assert_array_equal(fractions, 0.0)
