"""Times of films whose file has whole milliseconds only, as WebM and Matroska do, against those of the frames."""

import numpy as np
import pytest

from looping_pendulum.measured.film import decode

MILLISECOND = 1e-3


@pytest.mark.parametrize("lost", [(), (7, 8, 30)])
@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("rate", [24000 / 1001, 29.97, 30, 60, 120, 240])
def test_milliseconds_of_even_frames_are_put_back(rate, stated, lost):
    """Rounded, they were up to half a millisecond beside the frames: two millimetres of a mass at 4 m/s."""
    number = np.delete(np.arange(90), lost)
    t = number / rate
    found, clock = decode.frame_times(np.round(t / MILLISECOND) * MILLISECOND, MILLISECOND, rate if stated else None, None, {})
    # By the ends of a fitted row, each less than half a tick off, where the header states no rate
    assert np.abs(np.diff(found - t)).max() < (1e-9 if stated else 2e-5)
    assert np.abs(found - t - np.mean(found - t)).max() < (1e-9 if stated else 2e-4)
    assert clock.lost == len(lost)
    assert clock.own_rate == pytest.approx(rate, rel=1e-9 if stated else 1e-3)


def test_uneven_frames_keep_their_times():
    t = np.cumsum(np.random.default_rng(1).uniform(3e-3, 6e-3, 90))
    clock = np.round(t / MILLISECOND) * MILLISECOND
    found, said = decode.frame_times(clock, MILLISECOND, 240.0, None, {})
    assert found == pytest.approx(clock - clock[0], abs=1e-12)
    assert said.uneven > 30


def test_a_fine_clock_stays_as_it_is():
    tick = 1 / 90_000
    t = np.round((np.arange(90) / 240 + np.random.default_rng(1).normal(0, 2e-4, 90)) / tick) * tick
    assert decode.frame_times(t, tick, 240.0, None, {})[0] == pytest.approx(t - t[0], abs=1e-12)
