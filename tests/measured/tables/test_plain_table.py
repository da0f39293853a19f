"""A plain table holds what the readers understood: read again, it gives the same points."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.tables.plain_table import plain_table
from looping_pendulum.measured.tables.readers import read
from tests.measured.tables.test_readers import FORMS
from tests.measured.test_clock import motion


def assert_same_points(found, expected):
    assert [c.name for c in found.channels] == [c.name for c in expected.channels]
    for mine, theirs in zip(found.channels, expected.channels, strict=True):
        # Within rounding in floats, as units were converted once more
        assert mine.t == pytest.approx(theirs.t, rel=1e-12, abs=1e-12)
        assert mine.value == pytest.approx(theirs.value, rel=1e-12, abs=1e-12)


def written_and_read(observations):
    Path("plain.csv").write_text(plain_table(observations))
    return read("plain.csv", starts_at_release=False)


@pytest.mark.parametrize("form", FORMS)
def test_whatever_the_form_was_the_plain_table_has_its_points(clip, form):
    content, options = FORMS[form]
    expected = read(clip(content), **options)
    assert_same_points(written_and_read(expected), expected)


@pytest.mark.parametrize(("decimals", "unit", "factor"), [(3, "m", 1), (1, "cm", 100), (6, "m", 1), (2, "in", 1 / 0.0254)])
def test_digits_that_were_rounded_stay_so(clip, decimals, unit, factor):
    t = np.arange(60) / 240
    values = factor * motion(np.linspace(0, 1, 60))
    rows = "".join(f"{time:.3f},{','.join(f'{v:.{decimals}f}' for v in row)}\n" for time, row in zip(t, values, strict=True))
    names = ",".join(["t", *(f"{n} [{unit}]" for n in ("light_x", "light_y", "heavy_x", "heavy_y"))])
    expected = read(clip(f"{names}\n{rows}"))
    found = written_and_read(expected)
    assert_same_points(found, expected)
    if unit != "in":  # which has no whole number of digits in metres
        assert [c.last_digit for c in found.channels] == pytest.approx([c.last_digit for c in expected.channels])


def test_look_writes_what_it_read_of_a_table_and_says_what_it_guessed(clip):
    rows = "".join(f"{i / 240:.5f} {5 * i % 7 / 100} {20 + i * i / 9} {30 - i} {-20 + i / 50}\n" for i in range(30))
    done = CliRunner().invoke(app, ["look", str(clip("t x1 y1 x2 y2\n" + rows)), "--write", "plain.csv"])
    assert done.exit_code == 0, done.output
    assert "by their motion: light = '2', heavy = '1'; by their size: length in cm" in done.output
    found = read("plain.csv")
    assert {c.name for c in found.channels} == {"light_x", "light_y", "heavy_x", "heavy_y"}
    assert found.channel("light_x").value[0] == pytest.approx(0.3)


def test_events_are_no_table_of_points(clip):
    with pytest.raises(DataError, match="found no points over time"):
        plain_table(read(clip("quantity,index,value,sigma,unit\nstop,1,1,1,s\n")))
