"""Frame times that the page reads from a film's file against those that PyAV decodes."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest

from looping_pendulum.measured.film.decode import CAPTURE_RATE_KEY

av = pytest.importorskip("av", reason="PyAV, which writes films, is not installed (extra `film`)")
renderer = pytest.importorskip("tests.measured.film.renderer", reason="OpenCV is not installed (extra `film`)")


TINY = renderer.Scene(size=(320, 180), scale=200.0, rod=(190.0, 65.0), frame_rate=60, before=0.05, duration=0.5, crf=32)
KINDS = {
    "plain": {},
    "uneven": {"jitter": 0.4},
    "a ramp of rates": {"ramp": (1.0, 0.5)},
    "slow motion": {"stated_rate": 30.0},
    "lost frames": {"lost": (7, 8, 20)},
}


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    folder = tmp_path_factory.mktemp("times")
    motion = renderer.looping_motion(0.6)
    paths = {kind: folder / f"{kind}.mp4" for kind in KINDS}
    for kind, path in paths.items():
        renderer.render(path, replace(TINY, **KINDS[kind]), motion)
    paths["shortened"] = folder / "shortened.mp4"
    renderer.cut_off(paths["uneven"], paths["shortened"], 9)
    return paths


@pytest.mark.long
def test_times_are_those_of_the_decoder(films, node):
    read = node("frame_times.mjs", [str(path) for path in films.values()])
    for path, found in zip(films.values(), read, strict=True):
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            times = np.array([float(frame.pts * stream.time_base) for frame in container.decode(stream)])
        # A clock may begin at another time, and ticks are rounded
        assert np.array(found["times"]) - found["times"][0] == pytest.approx(times - times[0], abs=1e-4)
        assert found["rate"] == 0


def test_the_rate_of_the_camera_is_read_where_a_phone_wrote_it(films, node, tmp_path):
    path, number = tmp_path / "slow.mp4", tmp_path / "number.mp4"
    with av.open(str(films["plain"])) as source, av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as target:
        target.metadata.update({"com.android.version": "14", CAPTURE_RATE_KEY: "0240"})
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                target.mux(packet)
    # PyAV writes a text, phones a number of 32 bits
    raw, text = path.read_bytes(), struct.pack(">4sII", b"data", 1, 0) + b"0240"
    assert raw.count(text) == 1
    number.write_bytes(raw.replace(text, struct.pack(">4sIIf", b"data", 23, 0, 240)))
    assert [found["rate"] for found in node("frame_times.mjs", [str(path), str(number)])] == [240, 240]


def test_other_and_damaged_files_give_no_times(films, node, tmp_path):
    raw = films["plain"].read_bytes()
    texts = {
        "text.mp4": b"no film",
        "empty.mp4": b"",
        "cut.mp4": raw[: len(raw) // 2],
        "tables.mp4": raw[raw.rfind(b"moov") - 4 :][:400],
    }
    for name, content in texts.items():
        (tmp_path / name).write_bytes(content)
    assert node("frame_times.mjs", [str(tmp_path / name) for name in texts]) == [None] * len(texts)


def test_whole_milliseconds_of_even_frames_are_put_back(node):
    """Rounded, each time was up to half a millisecond off: two millimetres of a mass at 4 m/s."""
    rates = np.repeat((24000 / 1001, 30, 60, 120, 240), 2)
    wanted = [np.delete(np.arange(90), lost) / rate for rate, lost in zip(rates, 5 * ((), (7, 8, 30)), strict=True)]
    # The page knows a step from a few frames only
    cases = [((np.round(1000 * t) / 1000).tolist(), 1.004 / rate) for t, rate in zip(wanted, rates, strict=True)]
    for t, rate, found in zip(wanted, rates, node("even_times.mjs", cases), strict=True):
        beside = np.array(found["times"]) - t
        assert np.abs(beside - beside.mean()).max() < 1e-4
        assert abs(beside.mean()) < 1e-4
        assert 1 / found["step"] == pytest.approx(rate, rel=1e-3)


def test_uneven_frames_keep_their_times(node):
    t = np.cumsum(np.random.default_rng(1).uniform(3e-3, 6e-3, 90))
    uneven, single = node("even_times.mjs", [[np.round(t, 3).tolist(), 1 / 240], [[0.1], 1 / 240]])
    assert uneven is single is None
