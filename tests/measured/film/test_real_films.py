"""Real films of other motions, with what is known of them (README.md beside them); they are no part of the project."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from looping_pendulum.measured.film.moving import follow_all
from looping_pendulum.measured.film.record import PlainTrack, Points, TrackSettings
from tests.discrepancy.real_data import real

GRAVITY = 9.81

pytestmark = pytest.mark.accurate


def film(name: str) -> Path:
    return Path(real(f"films/{name}"))


def longest(found: PlainTrack, first: int, last: int) -> Points:
    """Return the thing that was followed through most of some frames."""
    return max(found.things.values(), key=lambda points: np.sum((points.frame >= first) & (points.frame <= last)))


def within(found: PlainTrack, points: Points, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and places [px] in some frames."""
    inside = (points.frame >= first) & (points.frame <= last)
    return found.t[points.frame[inside]], points.place[inside]


def scatter(t: np.ndarray, values: np.ndarray, degree: int) -> tuple[np.ndarray, float]:
    """Return a fitted polynomial's coefficients and what it leaves, RMS."""
    fitted = np.polyfit(t, values, degree)
    return fitted, float(np.std(values - np.polyval(fitted, t)))


@pytest.mark.parametrize(
    ("name", "first", "last", "speed"),
    [
        ("projectile_240fps/Projectile_Motion__30Deg_2_726mps.MP4", 259, 344, 2.385),
        ("projectile_240fps/Projectile_Motion__60Deg_2_699mps.MP4", 198, 326, 1.346),
    ],
)
def test_a_projectile_flies_on_a_parabola(name, first, last, speed):
    found = follow_all(film(name), TrackSettings(frame_rate=240.0, first=(first - 30) / 240, last=(last + 5) / 240))
    best = []
    for points in found.things.values():  # its shadow moves, too
        t, place = within(found, points, first + 2, last - 2)
        if len(t) >= 40:
            falls, off = scatter(t, place[:, 1], 2)
            best.append((off, abs(np.polyfit(t, place[:, 0], 1)[0]) * GRAVITY / (2 * falls[0])))
    off, measured = min(best)
    assert off < 0.3
    assert measured == pytest.approx(speed, rel=0.02)


def test_a_falling_ball_is_followed_to_its_bounce_and_beyond():
    found = follow_all(film("bouncing_ball/demo_bounching_ball.mp4"), TrackSettings())
    ball = longest(found, 0, 40)
    t, place = within(found, ball, 3, 20)
    assert len(t) == 18
    falls, off = scatter(t, place[:, 1], 2)
    assert off < 1.5
    assert 2 * falls[0] == pytest.approx(1606, rel=0.05)  # [px/s^2]
    assert {24, 30, 36} <= set(ball.frame.tolist())  # after the bounce


def test_a_ball_that_rolls_off_a_table_falls_with_g():
    found = follow_all(film("galileo/Galileo_sProjectile.mp4"), TrackSettings())
    t, place = within(found, longest(found, 18, 32), 18, 32)
    assert len(t) == 15
    falls, off = scatter(t, place[:, 1], 2)
    assert off < 0.7
    assert 2 * falls[0] == pytest.approx(3100, rel=0.02)  # [px/s^2]


@pytest.mark.parametrize("clock", ["the file's times", "30 frames a second"])
def test_an_oscillating_cart_has_its_period(clock):
    found = follow_all(film("oscillating_cart/oscillatingCar.webm"), TrackSettings())
    points = longest(found, 0, found.facts.frames)
    assert len(points.frame) > 0.9 * found.facts.frames
    t, x = found.t[points.frame] if clock == "the file's times" else points.frame / 30, points.place[:, 0]

    def off(p):
        return p[0] + p[1] * np.exp(-p[2] * t) * np.cos(2 * np.pi * t / p[3] + p[4]) - x

    fits = [
        least_squares(off, [x.mean(), np.ptp(x) / 2, 0.1, period, phase]) for period in (1.1, 1.2, 1.3) for phase in (0, 2, 4)
    ]
    assert min(fits, key=lambda fit: fit.cost).x[3] == pytest.approx(1.205, rel=0.005)


def test_a_recorders_unrest_is_no_lost_frame():
    found = follow_all(film("oscillating_cart/oscillatingCar.webm"), TrackSettings())
    assert (found.facts.clock.lost, found.facts.clock.uneven) == (0, 20)
    assert found.facts.clock.rate == pytest.approx(30, rel=1e-3)


def test_two_masses_on_one_string_are_told_apart_through_the_whole_fall():
    first, last = 92, 127
    found = follow_all(film("cart_and_bobs/8_hanging_fishbobs.mp4"), TrackSettings())
    cart, bobs = (
        next(p for p in found.things.values() if np.all(ahead(within(found, p, first, last)[1])) and covers(p, first, last))
        for ahead in (lambda place: place[:, 0] > 700, lambda place: place[:, 0] < 550)
    )
    _, place = within(found, cart, first, last)
    assert np.all(np.diff(place[:, 0]) < 0)  # to the pulley
    assert np.ptp(place[:, 1]) < 20
    _, place = within(found, bobs, first, last)
    assert np.all(np.diff(place[:, 1]) > 0)  # down
    assert np.ptp(place[:, 0]) < 30


def covers(points: Points, first: int, last: int) -> bool:
    return np.sum((points.frame >= first) & (points.frame <= last)) >= 0.9 * (last - first + 1)


def test_times_that_run_backwards_are_replaced_and_named():
    found = follow_all(film("force_constante/Force_constante.avi"), TrackSettings())
    assert found.facts.clock.backward > 0
    assert "backwards" in found.facts.clock.source
    t, place = within(found, longest(found, 11, 23), 11, 23)
    assert len(t) == 13  # then it begins to leave the picture
    assert np.allclose(np.diff(found.t), 1 / 25)
    # The ball is pulled by a constant force: a parabola, to half a percent of its way
    fitted, off = scatter(t, place[:, 0], 2)
    assert fitted[0] > 0
    assert off < 0.005 * np.ptp(place[:, 0])
