"""The film of a demonstration; the oracle is the file as Pillow reads it, and the runs themselves."""

import dataclasses

import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from PIL import Image

from looping_pendulum.errors import HarnessError
from looping_pendulum.teaching import film
from looping_pendulum.teaching.film import FRAME_RATE, MAX_FRAMES, check_film, frame_times, write_film
from tests.pages.small import small_result, with_points


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


def test_a_film_that_breaks_off_leaves_nothing(tmp_path, monkeypatch):
    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(film, "write_atomically", fail)
    with pytest.raises(OSError, match="disk full"):
        write_film(dataclasses.replace(small_result(), duration=0.02), tmp_path / "demo.gif")
    assert list(tmp_path.iterdir()) == []
