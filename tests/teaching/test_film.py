"""The film of a demonstration; the oracle is the file as Pillow reads it, and the runs themselves."""

import dataclasses

import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from PIL import Image

from looping_pendulum.compare.trajectories import CSV_HEADER, trajectory_csv
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import select
from looping_pendulum.errors import HarnessError
from looping_pendulum.files import file_stem
from looping_pendulum.measured.tables.readers import read
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import load
from looping_pendulum.teaching.film import FRAME_RATE, MAX_FRAMES, check_film, frame_times, write_film
from looping_pendulum.teaching.tracker import HEADER, find_motion, motion_of, overlay, tracker_csv
from tests.pages.small import small_result, with_points


@pytest.mark.long
def test_a_gif_has_every_frame_in_slow_motion_and_the_points(tmp_path):
    short = dataclasses.replace(with_points(small_result()), duration=0.1)
    seen = []
    write_film(short, tmp_path / "demo.gif", lambda words, fraction: seen.append((words, fraction)))
    with Image.open(tmp_path / "demo.gif") as gif:
        assert gif.n_frames == 0.1 * 4 * 25 + 1
        assert gif.info["duration"] == 1000 // FRAME_RATE
        assert gif.info["loop"] == 0, "for ever"
        assert gif.convert("RGB").getpixel((2, 2)) == (255, 255, 255), "a white slide shows no edge"
        first = np.asarray(gif.convert("RGB"))
        gif.seek(10)
        assert (np.asarray(gif.convert("RGB")) != first).any()
    assert seen[-1] == ("film, frame 11 of 11", 1.0)


def test_a_motion_plays_four_times_slower_unless_that_would_take_too_long():
    times, slower = frame_times(1.05)
    assert (len(times), times[0], times[-1]) == (106, 0.0, 1.05)
    assert slower == pytest.approx(4)
    times, slower = frame_times(60.0)
    assert len(times) == MAX_FRAMES
    assert slower == pytest.approx(499 / 25 / 60)


@pytest.mark.parametrize("name", ["demo.avi", "demo"])
def test_another_kind_is_refused(tmp_path, name):
    with pytest.raises(HarnessError, match=r"^--film: .*found .*, needed \.gif or \.mp4; write for example --film demo\.gif$"):
        check_film(tmp_path / name)


def test_without_ffmpeg_an_mp4_is_refused_before_anything_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    with pytest.raises(HarnessError, match=r"found no program ffmpeg, needed it for an MP4; install ffmpeg, or write a GIF"):
        check_film(tmp_path / "demo.mp4")


@pytest.mark.skipif(not FFMpegWriter.isAvailable(), reason="needs the program ffmpeg")
def test_an_mp4_is_written(tmp_path):
    write_film(dataclasses.replace(small_result(), duration=0.05), tmp_path / "demo.mp4")
    assert (tmp_path / "demo.mp4").read_bytes()[4:8] == b"ftyp"
    assert [file.name for file in tmp_path.iterdir()] == ["demo.mp4"]


@pytest.mark.long
def test_a_film_that_breaks_off_leaves_nothing(tmp_path):
    def fail(words, share):
        if share == 1:
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_film(dataclasses.replace(small_result(), duration=0.02), tmp_path / "demo.gif", fail)
    assert list(tmp_path.iterdir()) == []


# ---- a motion for Tracker: what our own readers make of the file, and where its rows lie


def simulated(engine, profile=Profile.QUICK):
    return select([engine], profile)[0].simulate(load("ten_to_one"))


@pytest.mark.long
@pytest.mark.parametrize("engine", [None, "mujoco:capstan"])
def test_our_readers_read_every_digit_back(tmp_path, engine):
    _, rows = overlay(find_motion("ten_to_one", engine), frame_rate=240.0, start=0.35)
    file = tmp_path / "overlay.csv"
    file.write_text(tracker_csv(rows))
    # By the clip's clock, which the study of such a file would state by `clock_offset`
    points = read(file, starts_at_release=False)
    assert not points.unused
    for name, values in zip(HEADER[1:], rows.T[1:], strict=True):
        channel = points.channel(f"{name[:-1]}_{name[-1]}")
        assert np.array_equal(channel.t, rows[:, 0])
        assert np.array_equal(channel.value, values)


def test_rows_lie_on_the_frames_of_the_video_and_have_the_places_of_the_reference():
    first, rows = overlay(find_motion("ten_to_one"), frame_rate=240.0, start=0.3512)
    assert first == 85  # 0.3512 s is between the frames 84 and 85
    assert np.array_equal(rows[:, 0], (85 + np.arange(len(rows))) / 240)
    exact = solve(load("ten_to_one").parameters).sample(rows[:, 0] - 0.3512)
    # Samples are 1 ms apart and a cubic bends by the fourth power of it; at the halt, where the acceleration jumps by some
    # 20 m/s^2, it is off by a tenth of a (1 ms)^2: 2 um.
    assert np.abs(rows[:, 1:] - np.hstack([exact.heavy_position, exact.light_position])).max() < 1e-5


def test_a_run_in_a_folder_of_compare_is_found(tmp_path):
    folder = tmp_path / "trajectories"  # as `compare` writes it
    folder.mkdir()
    for engine in ("mujoco:capstan", "mujoco:documented"):
        run = simulated(engine)
        (folder / f"{file_stem(run.label, run.profile)}.csv").write_text(trajectory_csv(run))
    (folder / "reference.csv").write_text(trajectory_csv(simulated("reference")))
    _, exact = overlay(motion_of(simulated("reference")), frame_rate=240.0)
    _, kept = overlay(find_motion(str(tmp_path)), frame_rate=240.0)
    assert np.allclose(kept, exact, atol=1e-8), "nine digits"
    _, engine = overlay(find_motion(str(tmp_path), "mujoco:documented"), frame_rate=240.0)
    assert np.abs(engine[:, 3:] - exact[:, 3:]).max() > 0.1  # it never halts
    with pytest.raises(HarnessError, match="2 runs of 'mujoco'.*choose by --engine"):
        find_motion(str(tmp_path), "mujoco")
    with pytest.raises(HarnessError, match="no run of 'pymunk'"):
        find_motion(str(tmp_path), "pymunk")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frame_rate": 0.1, "start": 1.0}, "no frame falls into"),
        ({"frame_rate": 240.0, "start": 1e300}, r"^--start, --fps: found 1e\+300 s and 240 frames per second"),
    ],
)
def test_impossible_frames_are_refused(options, message):
    with pytest.raises(HarnessError, match=message):
        overlay(motion_of(simulated("reference")), **options)


@pytest.mark.parametrize("text", ["t,x,y\n0,1,2\n", ",".join(CSV_HEADER) + "\n0,1,,2\n"])
def test_a_file_that_is_no_run_is_refused_in_one_line(tmp_path, text):
    file = tmp_path / "marks.csv"
    file.write_text(text)
    (tmp_path / "empty").mkdir()
    with pytest.raises(
        HarnessError, match=r"^[^\n]*marks\.csv: found no run \(.*\), needed a file that `looping-pendulum run --out`"
    ):
        find_motion(str(file))
    with pytest.raises(HarnessError, match="found no runs"):
        find_motion(str(tmp_path / "empty"))
