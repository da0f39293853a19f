"""Sliding and resting read from positions, against closed forms. Bounds: the detector's own resolution, 0.1 mm and 10 ms."""

import math

import numpy as np
import pytest

from looping_pendulum.engines.string_motion import (
    MIN_REST,
    RESOLUTION,
    REST_TIME,
    find_rests,
    halting_time,
    slip_onset,
    turning_points,
)

DT = 1e-3


def braked(t, halt, brake, top=1.5):
    """Place of a string that slides at ``top`` [m/s] until it is braked at a constant rate, to rest at ``halt``."""
    since = np.clip(t - (halt - top / brake), 0, top / brake)
    return top * np.minimum(t, halt - top / brake) + top * since - 0.5 * brake * since**2


@pytest.mark.parametrize("phase", [0.0, 0.13, 0.5, 0.77])
@pytest.mark.parametrize("brake", [8.0, 12.0, 40.0])
@pytest.mark.parametrize("resolution", [1e-5, RESOLUTION, 1e-3])
def test_a_constant_deceleration_halts_within_rounding_at_every_resolution(brake, phase, resolution):
    t, halt = (np.arange(600) + phase) * DT, 0.3333
    # The parabola through three samples is the motion itself.
    assert halting_time(t, braked(t, halt, brake), resolution, ended=False) == pytest.approx(halt, abs=1e-9)


@pytest.mark.parametrize("phase", [0.0, 0.3, 0.6])
def test_a_smooth_deceleration_halts_within_a_tenth_of_a_millisecond(phase):
    t, halt = (np.arange(600) + phase) * DT, 0.4
    place = np.where(t < halt, -1.5 * halt / math.pi * np.cos(math.pi * t / halt), 1.5 * halt / math.pi)
    assert halting_time(t, place, RESOLUTION, ended=False) == pytest.approx(halt, abs=1e-4)


def test_noise_moves_the_halt_by_no_more_than_the_last_tenth_of_a_millimetre_takes():
    t, halt, brake, noise = np.arange(1000) * DT, 0.4, 20.0, 5e-6
    place = braked(t, halt, brake) + np.random.default_rng(2).uniform(-noise, noise, len(t))
    assert halting_time(t, place, RESOLUTION, ended=False) == pytest.approx(halt, abs=math.sqrt(2 * RESOLUTION / brake))


@pytest.mark.parametrize(("travel", "later"), [(0.5 * RESOLUTION, False), (1.15 * RESOLUTION, True), (2 * RESOLUTION, True)])
def test_a_rebound_delays_the_halt_if_it_is_longer_than_the_resolution(travel, later):
    t, halt, swing = np.arange(1000) * DT, 0.4, 8e-3
    # After its halt the string comes back by ``travel`` in half a cosine, and rests.
    back = 0.5 * travel * (1 - np.cos(math.pi * np.clip((t - halt) / swing, 0, 1)))
    expected = halt + swing if later else halt
    # The cosine's end is no parabola: its curvature changes by a tenth in the interval of the last three samples.
    assert halting_time(t, braked(t, halt, 20.0) - back, RESOLUTION, ended=False) == pytest.approx(expected, abs=3e-4)
    assert halting_time(t, braked(t, halt, 20.0) - back, 1e-3, ended=False) == pytest.approx(halt, abs=1e-9)


@pytest.mark.parametrize("speed", [0.01, 0.001])
def test_a_string_that_creeps_on_has_not_halted_however_slowly_it_creeps(speed):
    t = np.arange(1000) * DT
    place = braked(t, 0.3, 20.0) + speed * np.maximum(t - 0.3, 0)
    assert halting_time(t, place, RESOLUTION, ended=False) is None or speed * MIN_REST < RESOLUTION
    halt = halting_time(t, place, RESOLUTION, ended=True)
    assert halt is None or t[-1] - halt <= RESOLUTION / speed + DT  # no more than the resolution is left to creep


@pytest.mark.parametrize(("watched", "ended", "halts"), [(0.04, False, False), (0.06, False, True), (0.005, True, False)])
def test_a_rest_must_be_watched(watched, ended, halts):
    t = np.arange(round((0.3 + watched) / DT) + 1) * DT
    assert (halting_time(t, braked(t, 0.3, 20.0), RESOLUTION, ended=ended) is not None) is halts


def test_a_string_that_sticks_since_the_release_halts_then():
    t = np.arange(200) * DT
    assert halting_time(t, np.zeros(200), RESOLUTION, ended=True) == 0.0
    assert halting_time(t[:2], np.zeros(2), RESOLUTION, ended=True) is None


def test_a_reversal_is_one_stop_and_no_stick():
    t, turn = np.arange(600) * DT, 0.3007
    place = np.where(t < turn, -8 * (t - turn) ** 2 / 2, -20 * (t - turn) ** 2 / 2)
    (rest,) = find_rests(t, place)
    assert rest.stop == pytest.approx(turn, abs=1e-9)
    assert slip_onset(t, place, rest, 2) is None


def test_a_slow_reversal_that_looks_like_a_rest_is_still_no_stick():
    t, turn, rate = np.arange(600) * DT, 0.3007, 2.0
    place = -rate * (t - turn) ** 2 / 2
    assert math.sqrt(2 * RESOLUTION / rate) > REST_TIME / 2  # it stays within the resolution for longer than `REST_TIME`
    (rest,) = find_rests(t, place)
    assert rest.stop == pytest.approx(turn, abs=1e-9)
    assert [slip_onset(t, place, rest, power) for power in (2, 3)] == [None, None]


@pytest.mark.parametrize("power", [2, 3])
def test_a_stick_and_the_onset_of_slip(power):
    t, stop, onset = np.arange(900) * DT, 0.3, 0.5
    place = braked(t, stop, 20.0) - 5 * np.maximum(t - onset, 0) ** power
    (rest,) = find_rests(t, place)
    assert rest.stop == pytest.approx(stop, abs=1e-9)
    assert slip_onset(t, place, rest, power) == pytest.approx(onset, abs=1e-6)


def test_jitter_at_rest_makes_no_stops():
    t = np.arange(1000) * DT
    jitter = 0.3 * RESOLUTION * np.sin(900 * t)
    assert len(find_rests(t, braked(t, 0.3, 20.0) + jitter)) == 1


def test_turns_are_distinguished_from_noise():
    t = np.arange(1100) * DT
    noisy = 0.2 * np.cos(9 * t + 0.5) + np.random.default_rng(3).uniform(-2e-4, 2e-4, len(t))
    assert len(turning_points(noisy, 1e-3)) == 3
    assert turning_points(np.zeros(5), 1e-3) == turning_points(np.zeros(0), 1e-3) == []
