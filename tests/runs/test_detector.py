"""Sliding and resting read from positions, against closed forms. Bounds: the detector's own resolution, 0.1 mm and 10 ms."""

import math

import numpy as np
import pytest

from looping_pendulum.runs.events import (
    MIN_REST,
    RESOLUTION,
    RESOLUTIONS,
    REST_TIME,
    Rest,
    final_rest_start,
    find_rests,
    halting_time,
    resting_samples,
    slip_onset,
    stop_time,
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


# ---- the detector of sliding and resting on a dozen samples each, where every position and time can be worked out by hand


def array(*values):
    return np.array(values, dtype=float)


# ---- turns


@pytest.mark.parametrize(
    ("values", "turns"),
    [
        ((0, 2, 0.5), [1]),
        ((0, -2, -0.5), [1]),
        ((0, 2, 1, 3, 0), [3]),
        ((0, -2, -1, -3, 0), [3]),
        ((0, 2, 0, 2, 0), [1, 2, 3]),
        ((0, 1, -0.5, 0.25), []),
        ((0, 0.5, -0.5, 3, 1), [3]),
        ((5, 7, 5), [1]),
        ((0, 2, 2, 0), [1]),
        ((0, 2, 3, 4), []),
    ],
)
def test_a_turn_is_a_way_back_of_more_than_the_band(values, turns):
    """Band 1: a rise or a way back of just 1 is none."""
    assert turning_points(array(*values), 1.0) == turns


# ---- resting


@pytest.mark.parametrize(("samples", "rest"), [(10, 0), (11, 11), (12, 12), (30, 30)])
def test_a_rest_takes_ten_milliseconds(samples, rest):
    assert resting_samples(np.zeros(samples), 0.25).sum() == rest


def test_a_rest_is_where_the_string_moves_by_at_most_the_resolution():
    place = np.concatenate([np.arange(-8.0, 0.0), np.zeros(12), np.arange(1.0, 9.0)])
    assert list(np.flatnonzero(resting_samples(place, 0.25))) == list(range(8, 20))
    place[13] = 0.25
    assert list(np.flatnonzero(resting_samples(place, 0.25))) == list(range(8, 20)), "just the resolution is no motion"
    place[13] = 0.26
    assert resting_samples(place, 0.25).sum() == 0


@pytest.mark.parametrize(
    ("place", "first"),
    [((5, 1, 1.25, 1), 1), ((5, 1, 1.5, 1.25), 2), ((1, 1, 1), 0), ((0, 1, 2, 3), 3), ((1, 1.25, 1.5), 1), ((3, 2), 1)],
)
def test_the_final_rest_begins_where_no_more_than_the_resolution_is_left(place, first):
    assert final_rest_start(array(*place), 0.25) == first


# ---- stops


def times(count):
    return np.arange(count) * 1.0


@pytest.mark.parametrize("way", [1, -1])
def test_the_stop_is_the_apex_of_the_parabola_before_it(way):
    """Speeds 8, 6, 4, 2 in the intervals 0.5, 1.5, 2.5, 3.5 fall by 2 a second: zero at 4.5."""
    place = way * array(0, 8, 14, 18, 20, 20, 20, 20)
    for first in (3, 4, 5):
        assert stop_time(times(8), place, first, 2.0) == pytest.approx(4.5)


def test_a_stop_is_not_before_the_last_sample_of_the_sliding():
    """It brakes hard from 10 to 3 between 1.5 and 2.5 s, as if to stop at 2.93 s, yet slides on by 2 and by 1."""
    place = array(0, 10, 20, 23, 25, 26, 26, 26, 26)
    # At sample 4 there is more than the resolution of 1 left... at 3 there are 3; at 4 just 1.
    assert stop_time(times(9), place, 4, 1.0) == pytest.approx(5.5), "speeds 3, 2 and 1: zero at 5.5"


def test_a_stop_within_the_first_samples_knows_of_none_before_them():
    # Speeds 3 and 1 at 0.5 s and 1.5 s: zero at 2.
    assert stop_time(times(6), array(0, 3, 4, 4, 4, 4), 1, 1.0) == pytest.approx(2.0)
    assert stop_time(times(6), array(0, 3, 4, 4, 4, 4), 2, 1.0) == pytest.approx(2.0)


def test_a_string_that_stands_still_at_once_stops_where_it_stands():
    assert stop_time(times(7), array(0, 5, 10, 10, 10, 10, 10), 2, 1.0) == 2.0
    assert stop_time(times(7), array(0, 5, 10, 5, 0, -5, -10), 3, 1.0) == 2.0, "and one that turns at once, where it turns"


def test_a_string_that_never_brakes_stops_at_the_sample_that_is_asked_of():
    place = array(0, 1, 3, 6, 10, 15)
    assert stop_time(times(6), place, 4, 1.0) == 4.0
    assert stop_time(times(6), place, 5, 1.0) == 5.0


def test_a_brake_whose_apex_is_far_off_is_none():
    # Speeds 10, 9, 8: zero only at 10.5; then it stands.
    place = array(0, 10, 19, 27, 27, 27)
    assert stop_time(times(6), place, 3, 1.0) == 3.0


def test_a_turn_has_no_stop_before_it_has_only_the_resolution_left():
    """Regression: `near // 1` for `near + 1` took the parabola of a hard braking for the stop, with 0.2 mm left to slide."""
    steps = array(*[1.0] * 12, 0.3, 0.15, 0.05, -0.05, *[-0.3] * 12) * 1e-3
    place = np.concatenate([[0.0], np.cumsum(steps)])
    t = np.arange(len(place)) * DT
    (rest,) = find_rests(t, place)
    turn = int(np.argmax(place))
    assert (rest.first, rest.last) == (turn, turn)
    # Speeds 0.3 and 0.15 m/s in the intervals up to 0.5 ms and 1.5 ms before the turn: zero at half a millisecond before it.
    assert rest.stop == pytest.approx(t[turn] - 0.5e-3, abs=1e-9)


def test_stops_are_in_the_order_of_time():
    """A turn at 0.1 s, a rest from 0.2 s to 0.3 s, a turn after it: turns are looked for after rests."""
    t = np.arange(500) * DT
    falling = 0.4 * np.minimum(t, 0.1) - 0.3 * np.clip(t - 0.1, 0, 0.1)
    place = falling + 0.5 * np.clip(t - 0.3, 0, 0.05) - 0.5 * np.clip(t - 0.35, 0, 1)
    rests = find_rests(t, place)
    assert [rest.stop for rest in rests] == pytest.approx([0.1, 0.2, 0.35], abs=DT)
    assert [rest.last > rest.first for rest in rests] == [False, True, False]
    assert (rests[1].first, rests[1].last) == (200, 300)


# ---- the onset of slip


def slipping(speed=1e-3, rest=0.0, count=60):
    """Place of a string that rests for 20 samples and then slides ``speed`` per sample."""
    return np.concatenate([np.full(20, rest), rest + speed * np.arange(1, count - 19)])


def test_an_onset_is_where_the_line_through_one_and_eight_resolutions_meets_the_rest():
    # Power 1: the line itself. It is at 0.15 mm and 0.3 mm ... at 0.9 mm; it leaves the rest at sample 19.
    place = slipping(speed=1.5e-4)
    assert slip_onset(np.arange(60) * DT, place, Rest(stop=0.0, first=0, last=19), 1) == pytest.approx(19 * DT, abs=1e-9)
    back = slip_onset(np.arange(60) * DT, -place, Rest(stop=0.0, first=0, last=19), 1)
    assert back == pytest.approx(19 * DT, abs=1e-9)


def test_the_rest_is_at_the_median_of_its_samples():
    """Thirteen samples, seven of them 0.06 mm further: the line through the slip meets those, 0.4 ms after the last one."""
    t = np.arange(60) * DT
    place = np.concatenate([np.zeros(6), np.full(7, 6e-5), 6e-5 + 1.5e-4 * (np.arange(1, 48) - 0.4)])
    assert slip_onset(t, place, Rest(stop=0.0, first=0, last=12), 1) == pytest.approx(12.4e-3, abs=1e-9)


@pytest.mark.parametrize(("stop", "expected_onset"), [(0.009, 0.019), (0.0085, 0.019), (0.0095, None), (0.03, None)])
def test_an_onset_sooner_than_a_rest_after_the_stop_is_none(stop, expected_onset):
    rest = Rest(stop=stop, first=0, last=19)
    onset = slip_onset(np.arange(60) * DT, slipping(speed=1.5e-4) + 0.0, rest, 1)
    assert onset == (None if expected_onset is None else pytest.approx(expected_onset, abs=1e-9))


def test_a_string_that_does_not_slide_far_has_no_onset():
    t, rest = np.arange(60) * DT, Rest(stop=0.0, first=0, last=19)
    far = np.minimum(slipping(speed=1.5e-4), 8.5 * RESOLUTION)
    assert slip_onset(t, far, rest, 1) == pytest.approx(0.019, abs=DT)
    assert slip_onset(t, np.minimum(far, 7.5 * RESOLUTION), rest, 1) is None
    assert slip_onset(t, far, Rest(stop=0.0, first=19, last=19), 1) is None, "a turn"


def test_a_slip_that_jumps_begins_with_the_jump():
    place = np.concatenate([np.zeros(20), np.full(40, 2e-3)])
    assert slip_onset(np.arange(60) * DT, place, Rest(stop=0.0, first=0, last=19), 3) == pytest.approx(0.020)


# ---- halting


@pytest.mark.parametrize(
    ("samples", "ended", "halts"), [(72, False, True), (71, False, False), (31, True, True), (30, True, False)]
)
def test_a_halt_is_watched_for_50_ms_or_for_10_ms_up_to_the_rod(samples, ended, halts):
    """The string stands still from sample 19 on, for 52, 51, 11 and 10 intervals of 1 / 1024 s."""
    t = np.arange(samples) / 1024
    place = 1e-2 * np.minimum(np.arange(samples), 19)
    assert halting_time(t, place, RESOLUTION, ended=ended) == (t[19] if halts else None)


def test_a_halt_needs_three_samples():
    assert halting_time(array(0, 1), array(0, 0), RESOLUTION, ended=True) is None
    assert halting_time(array(0, 1, 2), array(0, 0, 0), RESOLUTION, ended=True) == 0.0


@pytest.mark.parametrize("constant", [2e-3, 5e-3, 20e-3])
def test_a_string_that_creeps_to_rest_halts_once_the_resolution_is_left(constant):
    """Exponential: never at an apex, and its last digits only tremble. Of 0.3 m, 0.1 mm is left after ln(3000) constants."""
    t = 1e-3 * np.arange(700)
    place = 0.3 * (1 - np.exp(-t / constant))
    for resolution in RESOLUTIONS:
        left = constant * math.log(0.3 / resolution)
        assert halting_time(t, place, resolution, ended=False) == pytest.approx(left, abs=1.5e-3)  # a sample and a half
