"""The account of time: the oracle is the clock that the printed times were made from."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest

from looping_pendulum.measured.clock import even_clock, frame_grid
from looping_pendulum.measured.edits import without_copies
from looping_pendulum.measured.observations import Channel, DataError, ReadingNotes
from looping_pendulum.measured.tables.delimited import last_digits
from looping_pendulum.measured.tables.readers import read

NOISE = 1e-3


def motion(t):
    """A light mass that swings down and whips round, and a heavy one that falls and slows down; columns x, y, x, y [m]."""
    angle = 0.3 + 6 * t**2
    length = 0.55 - 0.3 * t**2
    return np.stack([-length * np.cos(angle), -length * np.sin(angle), 0.006 + 0 * t, -0.05 - 0.4 * t**2 / (0.4 + t)], axis=1)


def points(t, seed=1, noise=NOISE):
    values = motion(t) + noise * np.random.default_rng(seed).standard_normal((len(t), 4))
    return [Channel(name=n, t=t, value=v) for n, v in zip(("light_x", "light_y", "heavy_x", "heavy_y"), values.T, strict=True)]


@pytest.fixture
def table(clip):
    def write(times, values, digits=6):
        rows = (",".join([t, *(f"{v:.{digits}f}" for v in row)]) for t, row in zip(times, values, strict=True))
        return clip("t,light_x,light_y,heavy_x,heavy_y\n" + "\n".join(rows) + "\n")

    return write


@pytest.mark.parametrize(
    ("texts", "digits"),
    [
        (["0.000", "0.004", "1.000"], [1e-3] * 3),
        (["0", "0.00416667", "0.5", "0.991667", "1"], [1e-8, 1e-8, 1e-6, 1e-6, 1e-5]),
        (["5.46E+00", "5.50E+00"], [1e-2] * 2),
        (["4.000000E-03", "8.000000E-03", "1.200000E-02"], [1e-3] * 3),
        (["-0.5401", "0.00592"], [1e-4, 1e-5]),
        (["0", "33", "-12"], [1.0] * 3),
    ],
)
def test_the_last_digit_that_tells_anything(texts, digits):
    assert last_digits(texts) == pytest.approx(digits)


@pytest.mark.parametrize(
    ("rate", "decimals"),
    [c for c in itertools.product((25, 30, 60, 120, 240, 480), (2, 3, 4)) if c[0] * 10.0 ** -c[1] < 5],
)
@pytest.mark.parametrize("start", [0.0, 0.357])
def test_rounded_times_are_put_back_on_their_frames(table, rate, decimals, start):
    """With two decimals at 240 frames a second, three rows have one time."""
    t = start + np.arange(rate) / rate
    observations = read(table([f"{v:.{decimals}f}" for v in t], motion(t - start)), frame_rate=float(rate))
    steps = np.diff(observations.channels[0].t)
    assert steps == pytest.approx(1 / rate, rel=1e-6)
    # Nothing tells where in its last digit a whole row of times lies
    assert abs(observations.channels[0].t[0]) <= 0.5 * 10.0**-decimals + 1e-9


@pytest.mark.parametrize("rate", [30.0, 240.0])
def test_rounded_times_with_missing_rows(table, rate):
    t = np.arange(240) / rate
    kept = np.random.default_rng(3).random(240) > 0.1
    kept[0] = True
    observations = read(table([f"{v:.3f}" for v in t[kept]], motion(t[kept] * rate / 240)))
    assert observations.channels[0].t == pytest.approx(t[kept], abs=1e-6)


@pytest.mark.parametrize("rate", [25, 30, 60, 120, 240])
@pytest.mark.parametrize(("decimals", "first"), [(2, 0), (3, 0), (3, 1), (3, 100)])
def test_times_that_are_cut_off_are_put_back_on_their_frames(table, rate, decimals, first):
    """A film's first time is the one of a frame, so that times before it are no rounded ones."""
    frame = first + np.arange(2 * rate)
    # 1e-6: a whole number of milliseconds is no smaller one
    printed = [f"{np.floor(k * 10**decimals / rate + 1e-6) / 10**decimals:.{decimals}f}" for k in frame]
    path = table(printed, motion(frame / rate / 2))
    for stated in (None, float(rate)):
        observations = read(path, frame_rate=stated, starts_at_release=False)
        assert observations.channels[0].t == pytest.approx(frame / rate, abs=1e-4)


@pytest.mark.parametrize(("rate", "decimals"), [(50, 2), (100, 2), (500, 3), (1000, 3), (50, 6), (100, 6)])
@pytest.mark.parametrize("missing", [(0.2,), (0.2, 0.22), "a tenth"])
def test_exact_times_of_few_digits_with_missing_rows(table, rate, decimals, missing):
    """A missing row was taken for rounding: 100 frames a second for 98.98."""
    t = np.arange(rate) / rate
    rows = (
        np.random.default_rng(6).random(rate) > 0.1
        if missing == "a tenth"
        else ~np.isin(np.arange(rate), rate * np.array(missing))
    )
    path = table([f"{v:.{decimals}f}" for v in t[rows]], motion(t[rows]))
    for stated in (None, float(rate)):
        observations = read(path, frame_rate=stated, starts_at_release=False)
        assert observations.channels[0].t == pytest.approx(t[rows], abs=1e-9)


@pytest.mark.parametrize(("rate", "decimals"), [(90, 2), (960, 3)])
def test_rounded_times_are_no_exact_ones_with_missing_rows(table, rate, decimals):
    """Of 90 frames a second, every ninth step is 0.02 s, as of 100 frames a second with missing rows."""
    t = np.arange(rate) / rate
    observations = read(table([f"{v:.{decimals}f}" for v in t], motion(t)))
    assert observations.channels[0].t == pytest.approx(t, abs=1e-9)


def test_two_rows_that_are_close(table):
    """A tenth of 16 steps lay between the steps of 1 and 100 ms, near neither: the mean of none was not a number."""
    t = 1e-3 * np.cumsum([0, 1, 1, *[100] * 14])
    observations = read(table([f"{v:.4f}" for v in t], motion(t)))
    assert observations.channels[0].t == pytest.approx(t, abs=1e-4)


def test_slow_motion_by_rounded_times_has_the_rate_of_the_span(table):
    """Of steps of 4, 4 and 5 ms, the median step has another rate than the film."""
    t = np.arange(241) / 240
    observations = read(table([f"{v:.3f}" for v in t], motion(t)), frame_rate=960.0)
    assert observations.channels[0].t == pytest.approx(t / 4, abs=1e-9)
    assert any("times made for 240 frames a second were put to 960" in said for said in observations.assumptions)


def test_exact_times_are_left_alone(table):
    t = np.arange(200) / 240
    observations = read(table([repr(float(v)) for v in t], motion(t)))
    assert observations.channels[0].t.tolist() == t.tolist()
    assert observations.assumptions == ("lengths without a unit taken in m", "times without a unit taken in s")


def test_values_that_rounding_makes_equal_count_once():
    """The x of a heavy mass that hangs at 6 mm, to whole centimetres: a hundred times the same error, and no information."""
    t = np.arange(100) / 100
    channel = Channel(name="heavy_x", t=t, value=np.full(100, 0.01), last_digit=0.01)
    assert 1 / np.sum(channel.least_sigma(np.zeros(100)) ** -2.0) == pytest.approx(0.01**2 / 12)


def test_times_that_are_on_no_frames_have_their_rounding_as_an_error(table):
    t = np.cumsum(np.random.default_rng(2).uniform(0.02, 0.05, 100))
    observations = read(table([f"{v:.3f}" for v in t], motion(t / 3), digits=7))
    channel = observations.channels[0]
    assert channel.time_error == pytest.approx(0.5e-3 / np.sqrt(3))
    # What a stated error of a time gives a point that moves at 2 m/s
    least = channel.least_sigma(np.full(len(channel), 2.0))
    assert least == pytest.approx(np.hypot(1e-7 / np.sqrt(12), 2 * channel.time_error), rel=1e-6)


@pytest.mark.parametrize("gone", [(), (41,), (40, 41, 42)])
def test_even_frames_of_a_recorder_with_uneven_times(gone):
    """A recorder writes 31 to 33 ms with 48 ms now and then, while the camera took 30 even frames a second."""
    even = np.arange(150) / 30
    recorded = even + np.random.default_rng(4).uniform(-0.006, 0.006, 150)
    even, recorded = (np.delete(t, gone) for t in (even, recorded))
    clock = even_clock(recorded)
    assert np.diff(clock.t) == pytest.approx(np.diff(even), rel=1e-9)
    # The mean of 150 errors of 6 ms / sqrt(3)
    assert clock.camera_errors["clock_offset"] == pytest.approx(6e-3 / np.sqrt(3 * 150), rel=0.2)
    assert np.abs(clock.t - even).max() < 3 * clock.camera_errors["clock_offset"]


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (range(12), "if times count frames, give the camera's rate by 'frame_rate'"),
        ([k * 4.1667 for k in range(12)], "if times are in ms, say so: 'units: {time: ms}'"),
        ([k * 4166.7 for k in range(12)], "if times are in us, say so: 'units: {time: us}'"),
    ],
)
def test_times_that_are_no_seconds(table, times, message):
    values = motion(np.arange(12) / 240)
    with pytest.raises(DataError, match="found a row every") as caught:
        read(table([f"{v:g}" for v in times], values))
    assert message in str(caught.value)
    observations = read(table([f"{v:g}" for v in times], values), frame_rate=240.0)
    assert observations.channels[0].t == pytest.approx(np.arange(12) / 240, abs=1e-6)


def test_a_clock_that_begins_elsewhere_begins_at_the_release(table):
    t = np.arange(120) / 120
    observations = read(table([f"{v + 5.4:.4f}" for v in t], motion(t)))
    assert observations.channels[0].t == pytest.approx(t, abs=1e-4)
    assert any("was taken as 0: the masses rest there" in said for said in observations.assumptions)
    # In mid-motion it is the first points that are missing
    late = read(table([f"{v:.4f}" for v in t[60:]], motion(t[60:])))
    assert late.channels[0].t[0] == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize(("pattern", "noise"), list(itertools.product([(1, 0), (1, 0, 0), (1, 0, 0, 0)], [0.0, 0.3])))
def test_repeated_pictures_are_kept_once(pattern, noise):
    t = np.arange(240) / 240
    shown = np.maximum.accumulate(np.where(np.resize(pattern, 240), np.arange(240), 0))
    rng = np.random.default_rng(7)
    copied = [replace(c, value=c.value[shown] + noise * NOISE * rng.standard_normal(240)) for c in points(t)]
    notes = ReadingNotes()
    kept = without_copies(copied, notes)
    assert [len(c) for c in kept] == [240 // len(pattern)] * 4
    assert kept[0].t == pytest.approx(t[:: len(pattern)])
    said = f"every picture is stored {len(pattern)} times: one row of each is kept"
    assert (notes.unused[said] or 4 * notes.unused["light_x: a copy of the point before"]) == 4 * (240 - len(kept[0]))


@pytest.mark.parametrize(("taken", "shown"), [(24, 60), (25, 30), (24, 30)])
def test_a_film_that_is_shown_at_another_rate_than_it_was_taken_at(taken, shown):
    rows = np.arange(3 * shown)
    picture = rows * taken // shown
    whole = points(np.arange(3 * taken) / taken / 3, noise=2e-4)
    channels = [replace(c, t=rows / shown, value=c.value[picture]) for c in whole]
    kept = without_copies(channels, ReadingNotes())
    assert len(kept[0]) == 3 * taken
    assert np.diff(kept[0].t) == pytest.approx(1 / taken)


def test_a_resting_mass_whose_points_a_codec_copies():
    """The blocks of a picture in which nothing moves are skipped, so that marks there are equal in every digit."""
    t = np.arange(240) / 240
    channels = points(t)
    rest = t < 0.1
    copied = [replace(c, value=np.where(rest, c.value[0], c.value)) for c in channels]
    notes = ReadingNotes()
    kept = without_copies(copied, notes)
    assert [len(c) for c in kept] == [240 - rest.sum() + 1] * 4
    assert notes.unused["light_x: a copy of the point before"] == rest.sum() - 1


def test_points_rounded_to_centimetres_are_no_copies():
    t = np.arange(240) / 240
    channels = [replace(c, value=np.round(c.value, 2), last_digit=1e-2) for c in points(t)]
    assert [len(c) for c in without_copies(channels, ReadingNotes())] == [240] * 4


def test_equal_points_on_a_raster_are_no_copies():
    """A resting mass between two pixels of 2 mm has one place, again and again."""
    t = np.arange(240) / 240
    channels = [replace(c, value=np.round(c.value / 2e-3) * 2e-3, last_digit=1e-9) for c in points(t)]
    assert [len(c) for c in without_copies(channels, ReadingNotes())] == [240] * 4


@pytest.mark.parametrize("seed", range(20))
def test_an_even_film_has_no_copies(seed):
    rate = (30, 60, 120, 240)[seed % 4]
    channels = points(np.arange(rate) / rate, seed=seed)
    assert [len(c) for c in without_copies(channels, ReadingNotes())] == [rate] * 4


def test_a_grid_is_none_where_nothing_tells_it():
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.01, 0.05, 50))
    assert frame_grid(t, np.full(50, 1e-6)) is None
    assert frame_grid(np.zeros(5), np.full(5, 1e-3)) is None
    grid = frame_grid(np.array([0.0, 0.004, 0.008, 0.013, 0.021]), np.full(5, 5e-4))
    assert grid is not None
    assert grid.number.tolist() == [0, 1, 2, 3, 5]
    assert grid.rate == pytest.approx(240, rel=0.03)


@pytest.mark.parametrize("step", [1, 2, 4])
@pytest.mark.parametrize("rate", [30.0, 120.0, 240.0, 1000.0])
def test_whole_numbers_named_as_times_are_frames_also_where_rows_are_lost(clip, step, rate):
    """Lost rows made seconds of them in 52 of 60 tables, in silence."""
    rng = np.random.default_rng([step, int(rate)])
    kept = np.sort(rng.choice(200, 170, replace=False))
    frame = step * kept + 17
    path = clip("t,light_x\n" + "".join(f"{f},{(f / 1000) ** 2:.6f}\n" for f in frame))
    observations = read(path, frame_rate=rate)
    assert observations.channels[0].t == pytest.approx((frame - frame[0]) / rate, abs=1e-12)
    assert "whole numbers without a unit: taken as" in observations.summary()


@pytest.mark.parametrize("rate", [30.0, 60.0, 120.0, 240.0, 480.0, 960.0])
def test_whole_numbers_are_milliseconds_where_their_steps_are_those_of_a_film(clip, rate):
    """At 480/s and 960/s they were taken as frame numbers, whose steps these are not."""
    path = clip("t,light_x\n" + "".join(f"{1000 * i / rate:.0f},{(i / 200) ** 2:.6f}\n" for i in range(200)))
    for stated in ({}, {"frame_rate": rate}, {"frame_rate": 960.0, "clip_rate": rate}):
        observations = read(path, **stated)
        played = rate / stated.get("frame_rate", rate)
        assert observations.channels[0].t == pytest.approx(played * np.arange(200) / rate, abs=1e-9)
        assert "taken as milliseconds" in observations.summary()


@pytest.mark.parametrize(
    ("step", "stated", "taken"),
    [
        (
            1,
            {},
            "if times are in ms, say so: 'units: {time: ms}'; if times count frames, give the camera's rate by 'frame_rate'",
        ),
        (40, {"frame_rate": 240.0}, "if times are in ms, say so: 'units: {time: ms}'; else name the column 'frame'"),
        (40, {"frame_rate": 240.0, "clip_rate": 25.0}, "taken as milliseconds"),
        (5, {"frame_rate": 240.0}, "taken as numbers of frames"),
        (4, {"frame_rate": 250.0}, "taken as milliseconds"),
    ],
)
def test_equal_whole_steps_are_asked_for_where_they_may_be_both(clip, step, stated, taken):
    path = clip("t,light_x\n" + "".join(f"{step * i},{(i / 200) ** 2:.6f}\n" for i in range(40)))
    if taken.startswith("taken"):
        assert taken in read(path, **stated).summary()
    else:
        with pytest.raises(DataError, match=re.escape(taken)):
            read(path, **stated)
