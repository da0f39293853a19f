"""A sample of `python -m research.film_faults`, and what the harness itself must be able to tell."""

import dataclasses

import numpy as np
import pytest

from tests.film_faults.faults import KINDS, NONE, Faulty, mirrored, rounded_times
from tests.film_faults.films import clean_study
from tests.film_faults.forms import Form
from tests.film_faults.judging import Outcome, judge

SAMPLE = (
    (60, NONE),
    (240, "rounded times"),
    (60, "few digits"),
    (240, "every picture repeated"),
    (240, "pictures lost"),
    (240, "uneven in turn"),
    (240, "true uneven times"),
    (440, "slow in the middle"),
    (60, "late rows"),
    (240, "wrong unit of time"),
    (480, "mirrored"),
    (240, "turned"),
    (240, "smoothed"),
    (240, "interpolated"),
    (240, "objects exchanged"),
)
"""Number and kind of studies of one apparatus, most of them of one trial, whose motion is simulated once."""
IDENTIFIED = ((60, "rounded times"), (240, "every picture repeated"))
FOUND = (
    # Of the four rows that show a picture, two were left
    (440, "every picture repeated"),
    pytest.param(720, "slow in the middle", marks=pytest.mark.accurate),
    (60, "pictures lost"),
    (720, "pictures lost"),
    # Of 27 rows, the last six looked as if the tracker slipped from the light mass
    (8_100_186, "pictures lost"),
    # A column one row late was "averaged over 5 frames"
    (7_100_022, "late rows"),
    (8_100_048, "slow in the middle"),
    (8_400_152, "uneven in turn"),
    (7_100_057, "times of a recorder"),
    # Its unrest moves points by one to three of their standard errors
    (9_640_039, "times of a recorder"),
    # About the declared fit, a third change was added that was wrong
    (9_610_027, "pictures lost"),
    # Three rows in which the points are exchanged were the tracker's slips
    (9_500_020, "objects exchanged"),
    # In tables without some rows, hardly any run was long enough
    (9_500_040, "smoothed"),
    # Slow from the first rows on was taken for a hand that stops the light mass
    (9_500_033, "slow in the middle"),
    # Points of whole centimetres were pictures that are stored again
    (9_500_044, "rounded points"),
    # Rows that are missing were taken for a stop
    (3_100_091, "rows missing"),
)
"""Studies of the same apparatus in which a fault was once neither put right nor named."""


@pytest.mark.long
@pytest.mark.parametrize(("number", "kind"), [*SAMPLE, *FOUND])
def test_a_fault_is_put_right_or_named(tmp_path, number, kind):
    judgement = judge(number, kind, tmp_path, with_identify=False)
    assert not judgement.outcome.is_failure, judgement


@pytest.mark.long
@pytest.mark.parametrize(("number", "kind"), IDENTIFIED)
def test_nothing_is_added(tmp_path, number, kind):
    judgement = judge(number, kind, tmp_path)
    assert not judgement.outcome.is_failure, judgement
    assert judgement.verdict in ("no_missing_effect", "unexplained")


@pytest.mark.long
def test_a_rate_that_a_recorder_leaves_open_is_no_effect(tmp_path):
    """Its points stay 1.3 standard deviations off, which a clock that is known to a thousandth must explain."""
    judgement = judge(8_400_082, "times of a recorder", tmp_path)
    assert judgement.verdict in ("no_missing_effect", "unexplained"), judgement


def test_points_of_a_clean_film_are_not_moved():
    for film in clean_study(60).films:
        assert np.nanmax(film.displaced(film.taken, film.written)) == 0
        later = film.displaced(film.taken + 0.01, film.written)
        assert np.nanmax(later) > 10


def wrong(faulty: Faulty, **changes: object) -> Faulty:
    """Return a fault of which something is not said in the words that its kind asks for."""
    return dataclasses.replace(faulty, **changes)  # type: ignore[arg-type]


@pytest.mark.long
@pytest.mark.parametrize(
    ("put", "outcome"),
    [
        # A motion that is mirrored without a word of it is another fault than one whose name is asked for
        (lambda rng, study: wrong(mirrored(rng, study), words="$^"), Outcome.MISNAMED),
        # Times to milliseconds of a film that is said to be another one's
        (lambda rng, study: late_by_a_frame(rounded_times(rng, study)), Outcome.SILENT),
        (
            lambda rng, study: Faulty(films=study.films, form=Form(names=("t", "a", "b", "c", "d")), words="$^"),
            Outcome.MISNAMED,
        ),
    ],
    ids=["not named", "silent", "refused"],
)
def test_the_harness_tells_what_is_wrong(tmp_path, monkeypatch, put, outcome):
    monkeypatch.setitem(KINDS, "tested", put)
    assert judge(60, "tested", tmp_path, with_identify=False).outcome is outcome


def late_by_a_frame(faulty: Faulty) -> Faulty:
    """Return what the films would have been, had each point been taken two frames before: what is read is then wrong."""
    films = tuple(dataclasses.replace(f, taken=np.maximum(f.taken - 5 * f.taken / f.rate, 0)) for f in faulty.films)
    return dataclasses.replace(faulty, films=films)
