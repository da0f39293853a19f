"""Tracked points against the renderer's truth; the bounds are those that the tracker must reach."""

import json
import math
import os
import re
import shlex
import shutil
import time
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.cli.track import numbers_of, rule_of
from looping_pendulum.measured import film_points
from looping_pendulum.measured.film import FilmError, output, words
from looping_pendulum.measured.film.decode import Picture
from looping_pendulum.measured.film.moving import background, blobs_of, follow_all, joined, paths
from looping_pendulum.measured.film.record import (
    CAMERA_PRIORS,
    RADIUS_ERROR,
    ScaleRule,
    Shown,
    TrackSettings,
    files_of,
    read_record,
    record_text,
)
from looping_pendulum.measured.film.track import track
from looping_pendulum.measured.film_points import TrackingNeededError, read_track, settle_film
from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.study_io import load
from looping_pendulum.measured.tables.readers import read
from looping_pendulum.teaching.new_file import NewFileError
from tests.command_line import here
from tests.measured.film.conftest import SHORT
from tests.measured.film.renderer import Scene, looping_motion, render, until_ball_rests

WRONG = 6.0
"""Distance from the truth at which a point is on something else [px of a picture 1280 wide]."""
PAPER = TrackSettings(free_length=0.58, free_length_error=1e-3)


def errors(points, truth_places, truth):
    """Distances [px] of a mass's points from the truth, of the frames from the release on, and the share of these frames."""
    after = truth.t[points.frame] >= 0
    distance = np.linalg.norm(points.place - truth_places[points.frame], axis=1)[after]
    return distance, len(distance) / np.sum(truth.t >= 0)


def rms_per_axis(distance):
    return np.sqrt(np.mean(distance**2) / 2)


@pytest.fixture(scope="module")
def tracked(ordinary):
    return track(ordinary[0], PAPER)


@pytest.fixture
def of_a_film(ordinary, tmp_path):
    """A folder with a film and a study of it."""
    shutil.copy(ordinary[0], tmp_path / "trial.mp4")
    (tmp_path / "study.yaml").write_text(
        "title: a film\napparatus: {light: {mass: 10 g}, heavy: {mass: 100 g}, rod: {radius: 6.25 mm}}\n"
        "trials: [{file: trial.mp4, release: {angle: 112 deg, free_length: 58 cm +/- 1 mm}}]\n"
    )
    return tmp_path


@pytest.fixture(scope="module")
def nasty_tracked(nasty):
    return track(nasty[0], PAPER)


def test_an_ordinary_film_gives_both_masses_in_all_frames_to_a_third_of_a_pixel(tracked, ordinary):
    for name in ("light", "heavy"):
        distance, share = errors(getattr(tracked, name), getattr(ordinary[1], name), ordinary[1])
        assert distance.max() < WRONG / 2
        assert rms_per_axis(distance) < 0.3
        assert share >= 0.99


@pytest.mark.long
def test_a_nasty_film_gives_nine_tenths_of_the_frames_and_no_wrong_mark(nasty_tracked, nasty):
    distance, share = errors(nasty_tracked.light, nasty[1].light, nasty[1])
    assert share >= 0.9
    assert rms_per_axis(distance) < 1.0
    assert distance.max() < WRONG


def test_rod_scale_release_and_angle_are_found_without_a_click(tracked, ordinary):
    truth = ordinary[1]
    assert np.abs(np.array(tracked.geometry.rod) - truth.rod).max() < 1.0
    assert abs(tracked.geometry.scale / truth.scale - 1) < 2 * tracked.geometry.scale_error
    k = int(np.argmin(np.abs(truth.t)))
    assert abs(tracked.release.time - (tracked.t[k] - truth.t[k])) < 3 * tracked.release.time_error
    assert np.degrees(tracked.release.angle) == pytest.approx(112, abs=0.3)  # the simulator's
    assert tracked.hanging_length == pytest.approx(0.05, abs=1e-3)
    assert abs(tracked.geometry.values["tilt"]) < 3 * tracked.geometry.errors["tilt"]


def test_the_ball_is_as_large_as_it_is(tracked, ordinary):
    assert abs(tracked.light.radius - 8e-3 * ordinary[1].scale) < 2 * RADIUS_ERROR


def test_a_clock_or_a_length_that_gravity_contradicts_is_doubted(tracked):
    assert words.doubt(tracked) == ""
    slow = replace(
        tracked, t=8 * tracked.t, release=replace(tracked.release, time=8 * tracked.release.time),
        facts=replace(tracked.facts, clock=replace(tracked.facts.clock, rate=30.0)),
    )  # fmt: skip
    (rate,) = re.findall(r'--frame-rate "([\d.]+) Hz"', words.doubt(slow))
    assert float(rate) == 240
    view = tracked.geometry
    said = words.doubt(
        replace(tracked, geometry=replace(view, values={**view.values, "scale": 2 * view.scale}))
    )  # 340/s, as no camera has it
    assert "--frame-rate" not in said
    assert "check the free length" in said


def test_readers_take_the_table(tracked, ordinary, tmp_path):
    files = files_of(ordinary[0], tmp_path)
    output.write(tracked, files)
    points = read(files.table)
    truth = ordinary[1]
    assert {c.name for c in points.channels} == {"light_x", "light_y", "heavy_x", "heavy_y"}
    channel = points.channel("light_x")
    # Apart from the release's own error, which another test holds
    late = tracked.release.time - (tracked.t - truth.t)[0]
    true_x = truth.motion.at(np.clip(channel.t + late, 0, None))[0][:, 0]
    assert np.sqrt(np.mean((channel.value - true_x) ** 2)) < 5e-4  # 0.3 px, and the scale's and the rod's errors
    stored = read_record(files.record.read_bytes())
    assert (stored.facts.width, stored.facts.height, stored.facts.codec, stored.geometry.side) == (1280, 720, "h264", 1)
    assert files.sheet.read_bytes().startswith(b"\x89PNG")
    assert set(stored.camera_errors) == {
        "scale", "origin_x", "origin_y", "tilt", "clock_offset", "heavy_offset_x", "readout", *CAMERA_PRIORS
    }  # fmt: skip


def test_reading_a_study_reads_what_tracking_left_and_never_tracks(tracked, of_a_film, monkeypatch):
    from looping_pendulum.measured.edits import read_trial

    monkeypatch.setattr("looping_pendulum.measured.film.track.track", None)
    monkeypatch.setattr("looping_pendulum.measured.film.output.track", None)
    study = load(of_a_film / "study.yaml")
    before = set(of_a_film.iterdir())
    with pytest.raises(TrackingNeededError, match=r"not tracked yet; track it: looping-pendulum track "):
        read_trial(study, study.trials[0])
    assert set(of_a_film.iterdir()) == before
    output.write(tracked, files_of(of_a_film / "trial.mp4"))
    found = read_trial(study, study.trials[0])
    assert found.camera_errors["scale"] == pytest.approx(1 / 580, rel=0.3)
    for mine, own in zip(found.channels, tracked.observations("trial").channels, strict=True):
        for name in ("t", "value", "stated_error"):
            assert np.array_equal(getattr(mine, name), getattr(own, name))
    with pytest.raises(TrackingNeededError, match=r"frame rate: tracked with none, now 120 Hz; track it again: .*'120 Hz'"):
        read_trial(study, replace(study.trials[0], frame_rate=120.0))


def test_a_film_gives_its_points_as_the_tracker_has_them(tracked, ordinary):
    points = film_points.track(ordinary[0], free_length=0.58, free_length_error=1e-3, rod_radius=6.25e-3)
    t = tracked.t[tracked.light.frame] - tracked.release.time
    assert np.array_equal(points.channel("light_x").t, t[t >= 0])  # the decoder's times, not rounded
    assert np.array_equal(points.channel("light_x").value, tracked.geometry.metres(tracked.light.place)[t >= 0, 0])
    error = tracked.light.counted_error[t >= 0, 1] / tracked.geometry.scale
    assert np.array_equal(points.channel("light_y").stated_error[1], error)
    assert {u.reason: u.count for u in points.unused} == {r: n for r, n in tracked.skipped.items() if n}


def test_a_record_that_is_damaged_is_refused_and_tracked_again(tracked, of_a_film, monkeypatch):
    film = of_a_film / "trial.mp4"
    files = files_of(film)
    output.write(tracked, files)
    whole = json.loads(files.record.read_text())
    assert read_track(film, {}).hanging_length == tracked.hanging_length
    monkeypatch.setattr("looping_pendulum.measured.film.output.track", lambda *args, **options: tracked)
    for damage in (
        {"light": {}}, {"skipped": None}, {"geometry": {"values": {"scale": "small"}}}, {"settings": {"free_length": "58 cm"}},
        {"light": whole["light"] | {"frame": []}}, {"heavy": whole["heavy"] | {"place": [[math.inf, 0.0]]}},
        {"geometry": whole["geometry"] | {"values": {}}},
    ):  # fmt: skip
        files.record.write_text(json.dumps(whole | damage))
        with pytest.raises(TrackingNeededError, match="trial.film.json changed or not complete; track it"):
            read_track(film, {"free_length": 0.58})
        settle_film(film, {"free_length": 0.58}, track=True)
        assert len(film_points.read_film(film, {"free_length": 0.58}, "trial").channels) == 4


def test_a_record_that_is_changed_at_random_is_read_or_refused(tracked):
    whole, random = record_text(tracked), np.random.default_rng(65)
    for _ in range(200):
        begin = int(random.integers(len(whole)))
        new = random.choice(["", "[", "null", "{}", '"', "-1", "1e400", "NaN", "1e30", ", ", '"scale": 0'])
        try:
            read = read_record(whole[:begin] + new + whole[begin + int(random.integers(8)) :])
            assert read.observations("trial").used > 0
        except ValueError:  # a DataError, too, is one
            continue


def test_a_new_study_tracks_no_film_in_silence(tracked, of_a_film, monkeypatch):
    """Points of a length of 58 cm were replaced, within four minutes, since the study said 58.05 cm."""
    film, study, tracks = of_a_film / "trial.mp4", of_a_film / "mine.yaml", []

    def track_with(path, settings, progress):
        tracks.append(settings)
        return replace(tracked, settings=settings)

    monkeypatch.setattr("looping_pendulum.measured.film.output.track", track_with)

    def written(length, *options):
        arguments = ["new", "study", str(film), "--out", str(study), "--force", "--free-length", length, *options]
        return CliRunner().invoke(app, arguments)

    with pytest.raises(NewFileError, match=r"not tracked yet; track it: .*, or add --track$"):
        raise written("58 cm +/- 1 mm").exception
    assert not tracks
    assert written("58 cm +/- 1 mm", "--track").exit_code == 0
    assert written("58 cm +/- 1 mm").exit_code == 0
    assert len(tracks) == 1, "what is stated is the same"
    differs = (
        r"free length: tracked with 58 cm, now 58.05 cm; free length error: tracked with 1 mm, now 2 mm; "
        r"track it again: .*, or add --track$"
    )
    with pytest.raises(NewFileError, match=differs) as refused:
        raise written("58.05 cm +/- 2 mm").exception
    assert "\n" not in str(refused.value)
    assert written("58.05 cm +/- 2 mm", "--track").exit_code == 0
    assert len(tracks) == 2


def test_the_command_that_a_refusal_names_is_the_one_that_helps(tracked, of_a_film):
    shown = replace(
        PAPER, light=Shown(343.0, 438.0, 72), region=(100, 80, 1200, 700), scale=ScaleRule((640, 120), (640, 920), 1.0),
        first=0.5, readout=0.01, still=True,
    )  # fmt: skip
    output.write(replace(tracked, settings=shown), files_of(of_a_film / "trial.mp4"))
    with pytest.raises(TrackingNeededError) as refused:
        read_track(of_a_film / "trial.mp4", {"free_length": 0.57, "rod_radius": 6.25e-3})
    command = shlex.split(str(refused.value).split("track it again: ")[1])
    assert command == [
        "looping-pendulum", "track", str(of_a_film / "trial.mp4"), "--free-length", "57 cm +/- 1 mm", "--rod-radius", "6.25 mm",
        "--from", "0.5 s", "--readout", "10 ms", "--light", "343,438@72", "--region", "100,80 1200,700",
        "--scale", "640,120 640,920 = 1 m", "--still",
    ]  # fmt: skip


@pytest.mark.parametrize("command", ["look", "identify"])
def test_a_command_on_a_study_tracks_as_it_is_told(command, tracked, of_a_film, monkeypatch):
    monkeypatch.chdir(of_a_film)
    seen = []
    where = {"look": "discrepancy.look.check.take_first_look", "identify": "discrepancy.identify.identify"}[command]

    def stop(study, **_):
        seen.append(study)
        raise DataError("stop here")

    monkeypatch.setattr(f"looping_pendulum.{where}", stop)
    monkeypatch.setattr(
        "looping_pendulum.measured.film.output.track", lambda film, settings, progress: replace(tracked, settings=settings)
    )

    def said(*options):
        return str(CliRunner().invoke(app, [command, "study.yaml", *options]).exception)

    assert said().endswith(", or add --track")
    assert not seen
    assert said("--track") == said() == "stop here"
    (of_a_film / "study.yaml").write_text((of_a_film / "study.yaml").read_text().replace("58 cm", "57 cm"))
    assert "free length: tracked with 58 cm, now 57 cm; track it again" in said()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
def test_a_record_that_is_a_pipe_is_refused_at_once(tmp_path):
    (tmp_path / "trial.mp4").touch()
    os.mkfifo(tmp_path / "trial.film.json")
    with pytest.raises(TrackingNeededError, match="trial.film.json changed or not complete"):
        read_track(tmp_path / "trial.mp4", {})


def test_a_table_that_was_changed_after_tracking_is_not_taken_in_silence(tracked, of_a_film):
    film = of_a_film / "trial.mp4"
    files = files_of(film)
    output.write(tracked, files)
    assert not any("was changed" in note for note in film_points.read_film(film, {}, "trial").assumptions)
    os.utime(files.table, (time.time() + 5, time.time() + 5))
    assert any("trial.csv was changed since" in note for note in film_points.read_film(film, {}, "trial").assumptions)


@pytest.mark.long
def test_the_stated_errors_are_those_of_the_points(tracked, ordinary, nasty_tracked, nasty):
    for found, truth in ((tracked, ordinary[1]), (nasty_tracked, nasty[1])):
        for name in ("light", "heavy"):
            points = getattr(found, name)
            after = truth.t[points.frame] >= 0
            relative = (points.place - getattr(truth, name)[points.frame])[after] / points.error[after]
            assert 0.5 < np.sqrt(np.mean(relative**2)) < 1.5
            assert np.mean(np.abs(relative) > 4) < 0.02  # where a shadow or the hand touches the mass


def test_points_of_a_mass_at_rest_have_one_error_together(tracked):
    heavy = tracked.heavy
    at_rest = heavy.place[:, 1] > heavy.place[:, 1].max() - 0.4
    assert np.sum(at_rest) > 20
    together = np.sum(heavy.counted_error[at_rest] ** -2.0, axis=0) ** -0.5
    assert together == pytest.approx(heavy.error[at_rest].min(axis=0), rel=0.5)
    falling = tracked.light.error[:, 0] > 0.99 * tracked.light.counted_error[:, 0]
    assert np.mean(falling) > 0.3  # so fast that no two points show it at one place


@pytest.mark.long
@pytest.mark.parametrize("stopping", [5e-3, 0.06])
def test_a_light_mass_that_a_hand_stops_is_followed_where_it_stands(stopping, tmp_path):
    """At 60 frames a second it was lost, and so was the catch."""
    path = tmp_path / "trial.mp4"
    truth = render(
        path, Scene(frame_rate=60, before=0.15, duration=0.8), until_ball_rests(looping_motion(0.8), 8e-3, 0.5, stopping)
    )
    found = track(path, PAPER)
    late = truth.t[found.light.frame] > 0.5
    assert np.sum(late) > 0.8 * np.sum(truth.t > 0.5)
    assert np.linalg.norm(found.light.place - truth.light[found.light.frame], axis=1)[late].max() < WRONG / 2


@pytest.mark.long
def test_a_fit_weighs_points_by_the_errors_that_the_film_states(tracked, of_a_film):
    from looping_pendulum.discrepancy.fit.data import trial_data
    from looping_pendulum.measured.edits import read_trial

    films = files_of(of_a_film / "trial.mp4")
    error = tracked.light.counted_error.copy()
    error[60:70] = 9.0  # pixels: a long streak
    output.write(replace(tracked, light=replace(tracked.light, counted_error=error)), films)
    study = load(of_a_film / "study.yaml")
    data = trial_data(study.trials[0], read_trial(study, study.trials[0]))
    channel = next(c for c in data.channels if c.name == "light_x")
    sigma = data.sigma[data.slices["light_x"]]
    flagged = np.isclose(np.interp(channel.t, *channel.stated_error), 9.0 / tracked.geometry.scale, rtol=1e-3)
    assert flagged.sum() == 10
    assert sigma[flagged].min() >= 8.9 / tracked.geometry.scale
    assert np.median(sigma[~flagged]) < 2e-3


def test_the_command_prints_the_lines_of_a_study(ordinary, tmp_path):
    arguments = ["track", str(ordinary[0]), "--free-length", "58 cm +/- 1 mm", "--out", str(tmp_path), "--overlay"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert re.search(
        r"  - file: trial.csv\n    light: {radius: \d\.\d+ mm \+/- 0\.\d+ mm}\n    release: {kind: looping, angle: 11",
        done.output,
    )
    assert {p.name for p in tmp_path.iterdir()} == {"trial.csv", "trial.film.json", "trial.track.png", "trial.overlay.mp4"}


@pytest.mark.long
def test_a_new_study_takes_what_the_film_shows_of_the_release(tracked, of_a_film, monkeypatch):
    monkeypatch.setattr("looping_pendulum.measured.film.output.track", lambda *args, **options: tracked)
    film, study = of_a_film / "trial.mp4", of_a_film / "mine.yaml"
    arguments = [
        *("new", "study", str(film), "--out", str(study), "--free-length", "58 cm +/- 1 mm"),
        *("--light-mass", "10 g", "--heavy-mass", "100 g", "--rod-diameter", "12.5 mm +/- 1 %"),
    ]
    done = CliRunner().invoke(app, [*arguments, "--track"])
    assert done.exit_code == 0, done.output
    released = load(study).trials[0].estimates
    assert math.degrees(released["release_angle"].value) == pytest.approx(112, abs=0.3)  # the simulator's
    assert released["hanging_length"].value == pytest.approx(0.05, abs=1e-3)


@pytest.mark.long
def test_plain_follows_without_physics(ordinary, tmp_path):
    done = CliRunner().invoke(app, ["track", str(ordinary[0]), "--plain", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "trial.csv").read_text().startswith("t [s],frame,A_x [px],A_y [px]")


@pytest.mark.long
def test_plain_follows_within_a_region_alone(ordinary):
    heavy = ordinary[1].heavy
    left, right = int(heavy[:, 0].min()) - 30, int(heavy[:, 0].max()) + 30
    found = follow_all(ordinary[0], TrackSettings(region=(left, 0, right, 720)))
    # What passes the edge is cut there, to the width of a pixel of the search grid and its rim
    assert all(left - 8 < x < right + 8 for points in found.things.values() for x in points.place[:, 0])
    assert np.ptp(found.things["A"].place[:, 1]) == pytest.approx(np.ptp(heavy[:, 1]), abs=3)


def test_a_table_of_another_program_is_not_overwritten(ordinary, tmp_path):
    (tmp_path / "trial.csv").write_text("mass A\nt,x,y\n0,1,2\n")
    done = CliRunner().invoke(app, ["track", str(ordinary[0]), "--free-length", "58 cm", "--out", str(tmp_path)])
    assert isinstance(done.exception, FilmError)
    assert (tmp_path / "trial.csv").read_text().startswith("mass A")


def _still(tmp_path, motion):
    path = tmp_path / "still.mp4"
    render(path, Scene(**{**SHORT, "duration": 0.001}), motion)
    return path


def test_bad_films_are_refused_in_one_line_with_a_way_out(ordinary, tmp_path, motion):
    raw = ordinary[0].read_bytes()
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(raw[: len(raw) // 2])
    text = tmp_path / "text.mp4"
    text.write_text("no film")
    cases = {
        tmp_path / "none.mp4": "no such file",
        tmp_path: "a folder",
        text: "no film that can be read",
        cut: "no film that can be read",
        _still(tmp_path, motion): "found",
    }
    for path, said in cases.items():
        with pytest.raises(FilmError) as raised:
            track(path, PAPER)
        assert said in str(raised.value)
        assert "\n" not in str(raised.value)
        assert ";" in str(raised.value)


def test_a_picture_is_no_film(tmp_path):
    import cv2

    path = tmp_path / "photo.png"
    cv2.imwrite(str(path), np.zeros((120, 160, 3), np.uint8))
    with pytest.raises(FilmError, match="single picture"):
        track(path, PAPER)


@pytest.mark.parametrize(
    ("option", "text"),
    [
        ("--free-length", "58"),
        ("--free-length", "-1 cm"),
        ("--free-length", "58 cm +/- 2 kg"),
        ("--scale", "640,120 640,120 = 1 m"),
        ("--scale", "640,120 = 1 m"),
        ("--light", "343,438"),
        ("--rod", "790;262"),
        ("--region", "100,80 90,700"),
        ("--frame-rate", "0 Hz"),
    ],
)
def test_a_wrong_option_is_named_with_an_example(option, text, ordinary, tmp_path):
    done = here("track", str(ordinary[0]), "--out", str(tmp_path), option, text)
    assert done.returncode == 2
    assert re.search(rf"{option}.*: (found|expected) .*; write for example ", " ".join(done.stderr.split()))
    assert not list(tmp_path.iterdir())


def test_options_are_read():
    assert rule_of("640,120 640,920 = 1 m") == ((640, 120), (640, 920), 1)
    assert numbers_of("--light", "343,438.5@72", "343,438@72") == (343.0, 438.5, 72.0)


# ---- background, blobs and paths on pictures of a few grey discs, whose places are known


WIDTH, HEIGHT = 480, 360
STILL = 180
COLUMNS, ROWS = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))


def scene(*discs: tuple[float, float, float, int], noise: float = 1.0, seed: int = 0) -> np.ndarray:
    """A grey picture with discs (x, y, radius, level)."""
    picture = np.full((HEIGHT, WIDTH), STILL, dtype=float)
    for x, y, radius, level in discs:
        cover = np.clip(radius + 0.5 - np.hypot(COLUMNS - x, ROWS - y), 0, 1)
        picture += cover * (level - picture)
    picture += np.random.default_rng(seed).normal(0, noise, picture.shape)
    return np.clip(picture + 0.5, 0, 255).astype(np.uint8)


def blobs(pictures: list[np.ndarray], still: list[np.ndarray], *, whole: bool = False):
    ground = background([Picture(k, (p,)) for k, p in enumerate(still)], (0, len(still) - 1))
    return blobs_of([Picture(k, (p,)) for k, p in enumerate(pictures)], ground, whole=whole)


def test_a_place_that_a_mass_covers_in_nearly_half_of_the_pictures_keeps_its_own_brightness():
    # A textured thing, of another brightness each time, in 7 pictures of 15; and in 8, as chance may have it
    for covered in (7, 8):
        still = [scene((240, 180, 30, 40 + 11 * k) if k < covered else (900, 900, 1, 0), seed=k) for k in range(15)]
        ground = background([Picture(k, (p,)) for k, p in enumerate(still)], (0, 14), rests=False)
        middle = ground.planes[0][170:190, 230:250].astype(float)
        assert np.abs(middle - STILL).max() < 5
        assert ground.threshold[180 * ground.threshold.shape[0] // HEIGHT, 240 * ground.threshold.shape[1] // WIDTH] < 60


def test_what_leaves_the_picture_is_left_out():
    found = blobs([scene((x, 180, 12, 60)) for x in (460, 470, 478)], [scene(seed=k) for k in range(9)])
    assert [len(found[k]) for k in range(3)] == [1, 0, 0]
    assert found[0][0].x == pytest.approx(460, abs=0.1)


def test_parts_of_one_thing_are_one_whole_and_else_the_largest_is_the_mass():
    picture = scene((200, 180, 14, 60), (230, 180, 9, 60))
    still = [scene(seed=k) for k in range(9)]
    (mass, *_), (whole,) = blobs([picture], still)[0], blobs([picture], still, whole=True)[0]
    assert mass.x == pytest.approx(200, abs=0.2)
    assert 203 < whole.x < 213


def test_a_path_goes_on_after_a_bounce():
    t = np.arange(40) / 30
    y = np.where(t < 0.5, 60 + 240 * (t / 0.5) ** 2, 300 - 500 * (t - 0.5) + 400 * (t - 0.5) ** 2)
    found = blobs(
        [scene((100 + 60 * now, at, 10, 60)) for now, at in zip(t, y, strict=True)], [scene(seed=k) for k in range(9)]
    )
    pieces = paths(found, t, WIDTH)
    (path,) = joined(pieces, t)
    assert len(path) >= 38
    assert np.abs(path[:, 2] - y[path[:, 0].astype(int)]).max() < 0.3


def test_a_point_alone_begins_no_path():
    t = np.arange(20) / 240
    pictures = [scene((60 + 3 * k, 100, 6, 60)) if k >= 6 else scene() for k in range(20)]
    pictures[0] = scene((66, 104, 6, 60))  # something else, in one picture
    (path,) = paths(blobs(pictures, [scene(seed=k) for k in range(9)]), t, WIDTH)
    assert path[0, 0] == 6
