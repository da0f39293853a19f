"""Generated files of measured data: a Tracker export reads back exactly, and whatever else is read or refused in one line."""

import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from looping_pendulum.measured.tables.readers import DataError, read
from tests.discrepancy.real_data import real

LIGHT = {"light": "mass A"}
BOTH = {"light": "mass A", "heavy": "mass B"}

# (0, 0) and (-1, -1) are how trackers write a lost object
number = st.floats(-9.0, 9.0, allow_nan=False).map(lambda v: round(v, 6)).filter(lambda v: v not in (0, -1))
rows = st.lists(
    st.tuples(st.none() | number, st.none() | number, st.none() | number, st.none() | number), min_size=1, max_size=12
)


def java(value, decimal):
    """1.245987E1, as Java writes it."""
    if value is None:
        return ""
    text = np.format_float_scientific(value, trim="0", exp_digits=1).replace("e+", "E").replace("e", "E")
    return text.replace(".", decimal)


@pytest.mark.long
@settings(max_examples=150, deadline=None)
@given(
    rows=rows,
    style=st.sampled_from([(",", "."), (";", "."), ("\t", "."), (";", ","), ("\t", ",")]),
    bom=st.booleans(),
    newline=st.sampled_from(["\n", "\r\n"]),
    trailing=st.booleans(),
    multi=st.booleans(),
)
def test_a_generated_tracker_file_reads_back(tmp_path_factory, rows, style, bom, newline, trailing, multi):
    delimiter, decimal = style
    end = delimiter if trailing else ""
    lines = ["#multi:"] if multi else []
    lines += [delimiter.join(["", "mass A", "", "mass B", ""]) + end, delimiter.join("txyxy") + end]
    times = [k / 240 for k in range(len(rows))]
    lines += [delimiter.join(java(v, decimal) for v in (t, *row)) + end for t, row in zip(times, rows, strict=True)]
    path = tmp_path_factory.mktemp("tracker") / "clip.csv"
    path.write_bytes((("\ufeff" if bom else "") + newline.join(lines) + newline).encode())
    expected = {
        name: [(t, row[i]) for t, row in zip(times, rows, strict=True) if row[i] is not None]
        for i, name in enumerate(("light_x", "light_y", "heavy_x", "heavy_y"))
    }
    if not all(expected.values()):
        with pytest.raises(DataError, match="found no values at all"):
            read(path, tracks=BOTH)
        return
    observations = read(path, tracks=BOTH)
    # Exact: the text has the shortest digits that give each number back.
    assert {c.name: list(zip(c.t.tolist(), c.value.tolist(), strict=True)) for c in observations.channels} == expected
    assert observations.used + sum(d.count for d in observations.unused) == 4 * len(rows)


pieces = st.sampled_from(
    [
        *"txy,;\t \n-²",
        "\r\n",
        "#multi:\n",
        "light_x",
        "frame",
        "angle",
        "height",
        "drop",
        "quantity",
        "index",
        "value",
        "sigma",
        "unit",
    ]
    + ["1", "2.5", "0,5", "nan", "inf", "1e999", "mass A", "[cm]", "(kg)", '"', "\ufeff", "\u2028"]
)


@settings(max_examples=int(os.environ.get("FUZZ_EXAMPLES", 200)), deadline=None)
@given(
    text=st.lists(pieces, max_size=40).map("".join),
    tracks=st.sampled_from([None, {"light": ""}, LIGHT, BOTH]),
    frame_rate=st.sampled_from([None, 30.0]),
)
def test_whatever_the_file_it_reads_or_says_why_not(tmp_path_factory, text, tracks, frame_rate):
    path = tmp_path_factory.mktemp("any") / "clip.csv"
    path.write_bytes(text.encode())
    message = ""
    try:
        message = read(path, tracks=tracks, frame_rate=frame_rate).summary()
    except DataError as error:
        message = str(error)
    assert message
    assert len(message.splitlines()) == 1


# ---- the shipped data files are read whole: counts and first values as the files have them


@pytest.mark.parametrize(
    ("file", "drops"),
    [("baseball", (44, 44)), ("bowling_ball", (43, 42)), ("green_basketball", (45, 44)), ("tennis_ball", (46, 47)),
     ("wiffle_ball_1", (54, 53))],
)  # fmt: skip
def test_the_falling_balls(file, drops):
    path = real(f"falling_balls/{file}.csv")
    for drop, count in enumerate(drops, start=1):
        observations = read(path, run=str(drop))
        height = observations.channel("height")
        assert len(height) == count
        assert 45 < height.value[0] < 49
        assert height.value[-1] < 20
        assert [(d.count, d.reason) for d in observations.unused] == [
            (count, "column 'velocity_m_per_s': not a time or a position")
        ]


def test_the_pendulum():
    observations = read(real("pendulum/free_decay_65cm.txt"))
    assert [c.name for c in observations.channels] == ["angle"]
    assert len(observations.channel("angle")) == 2330
    assert observations.channel("angle").value[0] == 0.7020338666008175
    # Its third column follows neither the angle nor its slope.
    assert observations.unused[0].count == 2330
    assert "column '3 (angle_rate)': not a time or a position" in observations.unused[0].reason


def test_the_papers_tables():
    ten = read(real("paper/trial_10to1.csv"))
    assert len(ten.events) == 16
    assert ten.events[0].value == 0.38
    assert {e.sigma for e in ten.events} == {0.01}
    assert ten.unused[0].count == 3
    two = read(real("paper/trial_2to1.csv"))
    assert {e.quantity: (e.value, e.sigma) for e in two.events}["halting_time"] == (1.0, 0.1)  # printed as 1.0
