"""What `python -m research.film_faults` found, reduced to the rows and names that matter; of times: test_clock.py."""

import pytest

from looping_pendulum.discrepancy.look.check import take_first_look
from looping_pendulum.measured import study_io
from looping_pendulum.measured.observations import DataError
from tests.discrepancy.mistaken_study import Mistake, mended, mistaken
from tests.film_faults.faults import TRACKER, Faulty
from tests.film_faults.films import clean_study
from tests.film_faults.judging import write


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
