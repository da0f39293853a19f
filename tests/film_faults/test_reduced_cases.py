"""What `python -m tests.film_faults` found, reduced to the rows and names that matter.

Each case is a table of a smooth motion whose points are known, and says what was read of it when it was found.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from looping_pendulum.discrepancy.look.check import take_first_look
from looping_pendulum.measured import study_io
from looping_pendulum.measured.edits import Change, even_times
from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.tables.readers import read
from tests.discrepancy.mistaken_study import Mistake, mended, mistaken
from tests.film_faults.faults import TRACKER, Faulty
from tests.film_faults.films import CHANNELS, Array, clean_study
from tests.film_faults.judging import write

NOISE = 1e-3


def motion(t: Array, seed: int = 1) -> Array:
    """A light mass that swings down and round, and a heavy one that falls; columns x, y, x, y [m], with noise."""
    angle, length = 0.3 + 6 * t**2, 0.55 - 0.3 * t**2
    places = [-length * np.cos(angle), -length * np.sin(angle), 0.006 + 0 * t, -0.05 - 0.4 * t**2 / (0.4 + t)]
    return np.stack(places, axis=1) + NOISE * np.random.default_rng(seed).standard_normal((len(t), 4))


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table, and the points that it is of."""

    t: Array
    """True times [s]."""
    names: Sequence[str] = ("t", *CHANNELS)
    times: Sequence[str] = ()
    """As they are written; by default with six decimals."""
    decimals: int = 6
    """Of the points."""
    frame_rate: float | None = None
    may_refuse: bool = False
    """Whether the table may be refused, as it contradicts itself."""
    values: Array = field(default_factory=lambda: np.empty((0, 4)))
    """Points; by default those of `motion`."""
    edit: Change = lambda o: o
    """What a look does with them."""


def even(rate: float, count: int, gone: Sequence[int] = ()) -> Array:
    """Return times of frames, of which some are gone."""
    return np.array([k / rate for k in range(count) if k not in gone])


def as_a_recorder_says(rate: float, count: int, unrest: float) -> list[str]:
    rng = np.random.default_rng(4)
    late = np.where(np.arange(count) > 0, rng.uniform(-unrest, unrest, count), 0.0)
    late[-1] = unrest
    return [f"{v:.6f}" for v in (np.arange(count) + late) / rate]


TABLES = {
    # 98.98 frames a second, from 2.7 ms on: times are exact, but their steps have one digit
    "a row is missing at 100 frames a second": Table(t=even(100, 101, gone=(21,))),
    "the same with the rate stated": Table(t=even(100, 101, gone=(21,)), frame_rate=100.0),
    # "times printed to 0.01 s, at no equal steps: that rounding is an error of each time", 2.9 ms
    "two rows are missing at 100 frames a second": Table(t=even(100, 101, gone=(20, 21))),
    "two rows are missing at 50 frames a second": Table(t=even(50, 51, gone=(20, 21))),
    # 100.3 frames a second, as the first and the last time say; that the frames are even, a look sees by the motion
    "even frames with the times of a recorder": Table(
        t=even(100, 101), times=as_a_recorder_says(100, 101, 0.3), edit=even_times()
    ),
    # 98.9 frames a second: a missing row counts as a long step
    "the same with a missing row": Table(
        t=even(100, 101, gone=(41,)), times=np.delete(as_a_recorder_says(100, 101, 0.3), 41).tolist(), edit=even_times()
    ),
    # As the file has them, without a word, as soon as three rows are missing
    "the same with three missing rows": Table(
        t=even(100, 101, gone=(40, 41, 42)),
        times=np.delete(as_a_recorder_says(100, 101, 0.3), [40, 41, 42]).tolist(),
        edit=even_times(),
    ),
    # Begins at -4.7 ms, so that a clock_offset was identified
    "times cut off after two decimals": Table(
        t=even(30, 31), times=[f"{np.floor(100 * k / 30 + 1e-6) / 100:.2f}" for k in range(31)], frame_rate=30.0
    ),
    # 42 % of the points are left: equal ones are taken for copies of a picture
    "points to a centimetre": Table(t=even(240, 241), decimals=2),
    # Times are taken as numbers of frames, as soon as a rate is stated
    "frame above times": Table(t=even(30, 31), names=("frame", *CHANNELS), frame_rate=30.0, may_refuse=True),
}


@pytest.mark.parametrize("name", TABLES)
def test_the_points_of_a_table_are_read(tmp_path, name):
    table = TABLES[name]
    values = table.values if len(table.values) else motion(table.t)
    times = table.times or [f"{v:.6f}" for v in table.t]
    rows = [[text, *(f"{v:.{table.decimals}f}" for v in row)] for text, row in zip(times, values, strict=True)]
    path = tmp_path / "clip.csv"
    path.write_text("\n".join(",".join(row) for row in (table.names, *rows)) + "\n", encoding="utf-8")
    try:
        observations = table.edit(read(path, frame_rate=table.frame_rate))
    except DataError:
        if table.may_refuse:
            return
        raise
    assert {c.name for c in observations.channels} == set(CHANNELS)
    for i, name in enumerate(CHANNELS):
        channel = observations.channel(name)
        assert len(channel) == len(table.t)
        # A mass moves by some noise in a millisecond
        assert channel.t == pytest.approx(table.t, abs=0.5e-3)
        assert channel.time_error < 0.5e-3
        assert np.max(np.abs(channel.value - values[:, i])) <= 0.51 * 10.0**-table.decimals


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """A clean study of one trial, at 300 frames a second."""
    study = clean_study(60)
    return write(study, Faulty(films=study.films, form=TRACKER), tmp_path_factory.mktemp("clean"))


def rewritten(clean, folder, names="t,x,y,x,y,", row=lambda row: row):
    """Return the clean study with other names of columns, or with other rows."""
    path = mistaken(clean, folder, Mistake(keys=frozenset(), row=row))
    table = folder / "first.csv"
    table.write_text(table.read_text(encoding="utf-8").replace("t,x,y,x,y,", names), encoding="utf-8")
    return path


EXCHANGED = {
    "x and y of the heavy mass": lambda row: [*row[:3], row[4], row[3]],
    "x and y of the light mass": lambda row: [row[0], row[2], row[1], *row[3:]],
}


@pytest.mark.long
@pytest.mark.parametrize("which", EXCHANGED)
def test_exchanged_columns_of_one_mass_are_named(clean, tmp_path, which):
    """The points were 15 cm from the declared motion, which "no single usual mistake" explained."""
    check = take_first_look(study_io.load(rewritten(clean, tmp_path, row=EXCHANGED[which])))
    assert [m for m in check.mistakes if "exchanged" in m.text]


@pytest.mark.long
def test_seconds_that_are_called_milliseconds_are_named(clean, tmp_path):
    """No film has 240 000 frames a second."""
    with pytest.raises(DataError, match=r"column t \[ms\]: found .* rows a second.*correct the times or their unit"):
        take_first_look(study_io.load(rewritten(clean, tmp_path, names="t [ms],x,y,x,y,")))


@pytest.mark.parametrize("unit", ["cm", *(pytest.param(u, marks=pytest.mark.accurate) for u in ("mm", "inch"))])
def test_a_wrong_unit_in_a_name_is_named(clean, tmp_path, unit):
    """It was "units: {length: 99800 mm}", which the name overrides: then "units: {length: 9960000 mm}" was needed."""
    path = rewritten(clean, tmp_path, names=f"t,x ({unit}),y ({unit}),x ({unit}),y ({unit}),")
    (mistake,) = take_first_look(study_io.load(path)).mistakes
    assert "unit of the points" in mistake.text
    assert f"the header says {unit}" in mistake.text
    if mistake.keys:
        assert not take_first_look(study_io.load(mended(path, mistake.keys))).mistakes
