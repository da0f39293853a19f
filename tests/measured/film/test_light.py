"""Light that drifts, flickers and is covered by a cloud; pixels that are not square; and what gravity in a film may propose."""

import re
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from looping_pendulum.measured.film import FilmError, words
from looping_pendulum.measured.film.decode import gain, light_of, picture_change, relit, survey
from looping_pendulum.measured.film.track import track
from tests.discrepancy.real_data import real
from tests.measured.film.renderer import Scene, render
from tests.measured.film.test_track import PAPER, errors, rms_per_axis

WIDTH, HEIGHT = 640, 360
COLUMNS, ROWS = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
SMALL = Scene(before=0.1, duration=0.6, frame_rate=120, size=(WIDTH, HEIGHT), scale=415.0, rod=(395.0, 131.0), seed=501)


def drift(t):
    """An exposure that falls by 30 % within 0.3 s."""
    return 1 - 0.3 * np.clip((t - 0.2) / 0.3, 0, 1)


def bands(t):
    """Lamps at 100 Hz before a shutter that reads the picture in 15 ms."""
    return 1 - 0.15 * (1 + np.sin(2 * np.pi * 100 * (t + 0.015 * ROWS / HEIGHT)))


def cloud(t):
    """A cloud whose soft edge crosses the picture."""
    return 1 - 0.35 / (1 + np.exp((COLUMNS + 0.3 * ROWS + 150 - 1200 * t) / 60))


LIGHTS = {"drift": drift, "bands": bands, "cloud": cloud}


def filmed_again(source: Path, target: Path, *, light=None, shake: float = 0.0, aspect: Fraction | None = None) -> Path:
    """Write a copy of a film in another light [in linear light], by a camera that trembles [px], or with other pixels."""
    with av.open(str(source)) as container, av.open(str(target), "w") as copy:
        stream = container.streams.video[0]
        new = copy.add_stream("libx264", rate=stream.average_rate)
        width = WIDTH if aspect is None else 2 * round(WIDTH / aspect / 2)
        new.width, new.height, new.pix_fmt = width, HEIGHT, "yuv420p"
        new.options = {"crf": "18", "preset": "veryfast", "threads": "1"}
        if aspect is not None:
            new.codec_context.sample_aspect_ratio = aspect
        new.codec_context.time_base = new.time_base = stream.time_base
        for k, frame in enumerate(container.decode(stream)):
            picture = frame.to_ndarray(format="bgr24").astype(np.float32)
            if light is not None:
                picture *= np.broadcast_to(light(k / 120), (HEIGHT, WIDTH))[..., None] ** (1 / 2.2)
            if shake:
                moved = np.array([[1, 0, shake * np.sin(0.15 * k)], [0, 1, 0.5 * shake * np.sin(0.2 * k)]])
                picture = cv2.warpAffine(picture, moved, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
            if aspect is not None:
                picture = cv2.resize(picture, (width, HEIGHT), interpolation=cv2.INTER_AREA)
            shown = av.VideoFrame.from_ndarray(np.clip(picture + 0.5, 0, 255).astype(np.uint8), format="bgr24")
            shown.pts, shown.time_base = frame.pts, frame.time_base
            copy.mux(new.encode(shown))
        copy.mux(new.encode())
    return target


@pytest.fixture(scope="module")
def small(tmp_path_factory, motion):
    path = tmp_path_factory.mktemp("light") / "trial.mp4"
    return path, render(path, SMALL, motion)


@pytest.fixture(scope="module")
def tracked(small):
    return track(small[0], PAPER)


def textured(seed: int = 0) -> np.ndarray:
    blurred = cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 30, (HEIGHT, WIDTH)), (0, 0), 2)
    return np.clip(150 + 3 * blurred, 40, 220)


def bytes_of(picture: np.ndarray, seed: int = 1) -> np.ndarray:
    return np.clip(picture + np.random.default_rng(seed).normal(0, 1, picture.shape) + 0.5, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
def test_the_light_is_found_beside_things_that_move(light):
    still = textured()
    factor = np.broadcast_to(light(0.35), still.shape)
    picture = still.copy()
    picture[150:210, 0:170] = 90  # an arm
    picture[:, 400:455] = 60  # somebody who walks by
    found = light_of(bytes_of(picture * factor))
    (shown,) = relit((bytes_of(still, 2),), found)
    off = cv2.blur(np.abs(shown - still * factor), (9, 9))[20:-20, 20:-20]
    # Half of what counts as a change of a pixel; more only where somebody stands before the cloud's edge
    assert np.percentile(off, 90) < 6
    assert off.max() < 20


def test_steady_light_is_not_touched_whatever_moves():
    still = textured()
    picture = still.copy()
    picture[150:210, 0:170] = 90
    picture[:, 400:455] = 60
    assert gain(light_of(bytes_of(picture)), light_of(bytes_of(still, 2))) is None


@pytest.mark.parametrize("slope", [0.0, 0.4])
def test_colours_follow_the_light_about_grey(slope):
    """The light is three quarters as bright, the same everywhere or falling from left to right."""
    planes = [np.full((HEIGHT >> (k > 0), WIDTH >> (k > 0)), level, np.uint8) for k, level in enumerate((200, 108, 168))]
    factor = 0.75 - slope * (COLUMNS / WIDTH - 0.5)
    shown = relit(planes, light_of((200 * factor + 0.5).astype(np.uint8)))
    centres = [int(p[p.shape[0] // 2, p.shape[1] // 2]) for p in shown]
    assert centres == pytest.approx([150, 113, 158], abs=1)


def test_a_flicker_is_no_change_of_the_picture_and_a_mass_is():
    still = textured()
    moved = still.copy()
    moved[100:120, 100:120] = 20
    lit = bytes_of(still * bands(0.004))
    assert picture_change(lit, bytes_of(still * bands(0.01), 2)) < 10
    assert picture_change(bytes_of(moved * bands(0.004)), bytes_of(still * bands(0.01), 2)) > 60


@pytest.mark.long
@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
def test_masses_are_followed_in_light_that_changes(light, small, tmp_path):
    """The drift was "a camera that moves", by eleven to 71 pixels: optical flow takes brightness for constant."""
    found = track(filmed_again(small[0], tmp_path / "trial.mp4", light=light), PAPER)
    distance, share = errors(found.light, small[1].light, small[1])
    assert share > 0.95
    assert rms_per_axis(distance) < 0.3
    assert distance.max() < 3
    assert not any(found.facts.repeated)


@pytest.mark.long
@pytest.mark.parametrize("light", [None, *LIGHTS.values()], ids=["steady", *LIGHTS])
def test_a_camera_that_moves_is_refused_in_any_light_and_still_overrides_it(light, small, tmp_path):
    path = filmed_again(small[0], tmp_path / "trial.mp4", light=light, shake=2.0)
    with pytest.raises(FilmError, match="a camera that moves .* or, if it stood still, --still"):
        track(path, PAPER)
    assert survey(path, needs_rest=False).facts.shake > 1


def test_still_takes_the_camera_as_standing_still(small, tracked, monkeypatch):
    monkeypatch.setattr("looping_pendulum.measured.film.decode.camera_shake", lambda small: 50.0)
    with pytest.raises(FilmError, match="--still"):
        track(small[0], PAPER)
    assert np.array_equal(track(small[0], replace(PAPER, still=True)).light.place, tracked.light.place)


def test_pixels_that_are_not_square_are_made_so(small, tracked, tmp_path):
    path = filmed_again(small[0], tmp_path / "trial.mp4", aspect=Fraction(4, 3))
    found = track(path, PAPER)
    assert (found.facts.width, found.facts.height) == (WIDTH, HEIGHT)
    assert found.facts.pixel_aspect == pytest.approx(4 / 3)
    distance, share = errors(found.light, small[1].light, small[1])
    assert share > 0.95
    assert rms_per_axis(distance) < 0.4
    assert np.degrees(found.release.angle - tracked.release.angle) == pytest.approx(0, abs=0.3)
    assert "1.333 times as wide as high" in words.film_notes(found.facts)[0]
    assert words.film_notes(tracked.facts) == []


def test_a_film_of_a_camera_with_pixels_of_16_to_15_has_the_true_angle():
    found = track(real("forms/41-pixels-not-square/pal_16_15.mp4"), PAPER)  # 108.6 deg as it is stored
    assert np.degrees(found.release.angle) == pytest.approx(112, abs=0.3)
    assert words.doubt(found) == ""


def test_interlaced_pictures_are_named(tracked):
    (note,) = words.film_notes(replace(tracked.facts, interlaced=True))
    assert "alternate rows show different instants" in note


def at_rate(found, stated: float, true: float = 120.0):
    """A film whose rate is stated as another one."""
    factor = true / stated
    return replace(
        found,
        t=factor * found.t,
        release=replace(found.release, time=factor * found.release.time),
        facts=replace(found.facts, clock=replace(found.facts.clock, rate=stated)),
    )


def scaled(found, factor: float):
    """A film whose scale is stated as another one."""
    view = found.geometry
    return replace(found, geometry=replace(view, values={**view.values, "scale": factor * view.scale}))


@pytest.mark.parametrize("stated", [240.0, 30.0, 30 * 1000 / 1001, 60.0, 25.0])
def test_a_rate_that_gravity_contradicts_is_proposed_as_a_camera_has_it(tracked, stated):
    (rate,) = re.findall(r'--frame-rate "([\d.]+) Hz"', words.doubt(at_rate(tracked, stated)))
    assert float(rate) == pytest.approx(120, rel=2e-3)


def test_no_rate_is_proposed_that_would_only_hide_another_fault(tracked):
    for wrong in (scaled(tracked, 1.3), scaled(tracked, 0.6)):
        text = words.doubt(wrong)
        assert "--frame-rate" not in text
        assert "the free length" in text
    # A rate would explain gravity, but not a string that is bent in the picture
    view = replace(tracked.geometry, residual=np.linspace(-4, 4, len(tracked.geometry.residual)))
    bent = replace(at_rate(tracked, 240.0), geometry=view)
    assert "--frame-rate" not in words.doubt(bent)
