"""Whether the renderer shows what a scene says of its hand, its light and its pixels, and what strangers draw."""

from dataclasses import replace
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from research.films_of_strangers import HIDDEN, commands, drawn
from tests.measured.film.renderer import GAMMA, Scene, looping_motion, render

PLAIN = Scene(frame_rate=60, before=0.1, duration=0.25, noise=0.1)


@pytest.fixture(scope="module")
def motion():
    return looping_motion(0.3)


def pictures(path, kind="bgr24"):
    with av.open(str(path)) as film:
        return [frame.to_ndarray(format=kind) for frame in film.decode(video=0)]


def at_the_edge(path):
    """Return the luma of each row in each picture at the left edge, which nothing crosses, shape (n, 300)."""
    return np.array([p[:300, :100].mean(axis=1) for p in pictures(path, "yuv420p")])


def reddest(picture, place):
    """Return by how much red exceeds blue and green there; skin has less of it than the light mass."""
    x, y = np.round(place).astype(int)
    blue, green, red = cv2.GaussianBlur(picture, (0, 0), 1.5)[y, x].astype(float)
    return (red - max(green, blue)) / red


def test_a_covered_light_mass_is_seen_from_the_end_of_the_cover_on(motion, tmp_path):
    truth = render(tmp_path / "film.mp4", replace(PLAIN, covered=0.07), motion)
    red = np.array([reddest(p, at) for p, at in zip(pictures(tmp_path / "film.mp4"), truth.light, strict=True)])
    assert np.all(red[truth.t < 0.06] < 0.35), red
    assert np.all(red[truth.t > 0.11] > 0.5), red


def test_a_drift_changes_the_picture_by_what_it_says(motion, tmp_path):
    truth = render(tmp_path / "film.mp4", replace(PLAIN, drift=(-0.35, 0.0, 0.1)), motion)
    luma = at_the_edge(tmp_path / "film.mp4").mean(axis=1)
    ratio = luma[truth.t > 0.12].mean() / luma[truth.t < -0.02].mean()
    assert ratio == pytest.approx(0.65 ** (1 / GAMMA), abs=0.01)


def test_lamps_make_bands_over_the_rows_of_a_rolling_readout(motion, tmp_path):
    # The 300 rows that are looked at take 10 ms, one period of the lamps
    scene = replace(PLAIN, duration=0.0, readout=24e-3)
    render(tmp_path / "lamps.mp4", replace(scene, flicker=(0.15, 100.0)), motion)
    render(tmp_path / "still.mp4", scene, motion)
    band = (at_the_edge(tmp_path / "lamps.mp4") / at_the_edge(tmp_path / "still.mp4")) ** GAMMA
    amplitude = 2 * np.abs(np.mean(band * np.exp(2j * np.pi * np.arange(300) / 300), axis=1))
    assert amplitude == pytest.approx(np.full(len(band), 0.15), abs=0.01)


def test_pixels_that_are_not_square_are_stated_and_stored(motion, tmp_path):
    truth = render(tmp_path / "film.mp4", replace(PLAIN, aspect=Fraction(4, 3), duration=0.0), motion)
    with av.open(str(tmp_path / "film.mp4")) as film:
        stream = film.streams.video[0]
        assert (stream.sample_aspect_ratio, stream.width, stream.height) == (Fraction(4, 3), 960, 720)
        picture = next(film.decode(stream)).to_ndarray(format="bgr24")
    x, y = truth.light[0] * (3 / 4, 1)
    near = picture[round(y) - 30 : round(y) + 30, round(x) - 30 : round(x) + 30].astype(float)
    red = near[..., 2] - near[..., :2].max(axis=2) > 60
    assert np.argwhere(red).mean(axis=0) + (round(y) - 30, round(x) - 30) == pytest.approx((y, x), abs=0.6)


def test_every_ten_studies_hide_each_effect_once():
    cases = [drawn(seed) for seed in range(900, 910)]
    assert sorted(c.hidden for c in cases if c.hidden) == sorted(HIDDEN)
    assert [argv[1] for argv in commands(cases[0])] == ["track", "track", "track", "new", "look", "identify"]
