"""Wrong times of a film's rows are named or put right by the probability of its points, and slips of a tracker are none."""

import dataclasses

import numpy as np
import pytest

from looping_pendulum.discrepancy.look.case import Case, Rows
from looping_pendulum.discrepancy.look.check import take_first_look
from looping_pendulum.measured import study_io
from looping_pendulum.measured.study import read_files
from tests.film_faults.faults import Faulty
from tests.film_faults.films import clean_study
from tests.film_faults.judging import write

STUDY = clean_study(63)
"""One trial at 60 frames a second."""
FILM = STUDY.films[0]
STEP = 1 / FILM.rate


def look(folder, **changes):
    """Take a first look at the film with other times or points."""
    film = dataclasses.replace(FILM, **changes)
    return take_first_look(study_io.load(write(STUDY, Faulty(films=(film,)), folder)))


def without_rows(*rows):
    """Return the film's times and points without some rows, numbered on."""
    kept = np.setdiff1d(np.arange(len(FILM.t)), rows)
    return {"t": FILM.t[: len(kept)], "written": FILM.written[kept]}


def test_a_film_with_right_times_has_nothing_wrong(tmp_path):
    check = look(tmp_path)
    assert not check.mistakes
    assert not check.put_right


def test_lost_pictures_are_named_with_their_places_and_number(tmp_path):
    [mistake] = look(tmp_path, **without_rows(20, 21)).mistakes
    assert f"from {FILM.t[20]:.4g} s on the masses are ahead of their times" in mistake.text
    assert "(at the first place 2)" in mistake.text


def test_a_picture_that_is_stored_again_is_left_out(tmp_path):
    written = FILM.written.copy()
    written[30] = written[29]
    check = look(tmp_path, written=written)
    assert not check.mistakes
    [name] = check.put_right
    kept = check.observations[name].channel("light_x").t
    assert not np.any(np.isclose(kept, FILM.t[30]))
    assert len(kept) == np.isfinite(written[:, 0]).sum() - 1
    assert any("a picture is stored again there: left out" in text for text in check.warnings)


def test_a_clock_that_changes_is_named(tmp_path):
    t = FILM.t.copy()
    t[25:] = t[25] + 4 * (t[25:] - t[25])
    [mistake] = look(tmp_path, t=t).mistakes
    assert "the clock changes" in mistake.text
    assert "on a row lasts 1/4 as long" in mistake.text


def test_frames_that_are_uneven_in_turn_are_named(tmp_path):
    late = np.where(np.arange(len(FILM.t)) % 2, 0.3, 0.0) * STEP
    moved = FILM.motion(FILM.t + late) - FILM.motion(FILM.t)
    [mistake] = look(tmp_path, written=FILM.written + moved).mistakes
    assert "one of 2 frames in turn lasts longer than their times say" in mistake.text


def test_uneven_times_become_an_error_of_each(tmp_path):
    late = np.random.default_rng(1).uniform(-0.4, 0.4, len(FILM.t)) * STEP
    moved = FILM.motion(np.maximum(FILM.t + late, 0.0)) - FILM.motion(FILM.t)
    check = look(tmp_path, written=FILM.written + moved)
    assert not check.mistakes
    [name] = check.put_right
    # 0.4 / sqrt(3) of a step
    assert check.observations[name].channel("light_x").time_error == pytest.approx(0.23 * STEP, rel=0.5)


@pytest.mark.parametrize(("column", "rows"), [(0, 1), (2, -4)])
def test_columns_in_other_rows_are_named(tmp_path, column, rows):
    """A column that is one row late was "averaged over 5 frames"."""
    written, source = FILM.written.copy(), np.arange(len(FILM.t)) - rows
    for c in [column] if column == 0 else [2, 3]:
        inside = (source >= 0) & (source < len(source))
        written[:, c] = np.where(inside, FILM.written[np.clip(source, 0, len(source) - 1), c], np.nan)
    [mistake] = look(tmp_path, written=written).mistakes
    assert f"{abs(rows)} row" in mistake.text
    assert ("later" if rows > 0 else "earlier") in mistake.text


@pytest.mark.parametrize(("first", "count"), [(31, 5), (37, 8)])
def test_marks_that_stay_where_they_were_are_left_out(tmp_path, first, count):
    """One that stayed for long drew the fit to itself, and the points were "38 mm from the declared motion"."""
    written, rows = FILM.written.copy(), slice(first, first + count)
    written[rows, :2] = written[first, :2] + 3e-4 * np.random.default_rng(2).standard_normal((count, 2))
    check = look(tmp_path, written=written)
    assert not check.mistakes
    [name] = check.put_right
    light, heavy = (check.observations[name].channel(channel) for channel in ("light_x", "heavy_x"))
    assert not np.isin(np.round(FILM.t[first + 1 : first + count], 6), np.round(light.t, 6)).any()
    assert len(heavy) == np.isfinite(written[:, 2]).sum()
    [text] = check.warnings
    assert "the light mass's mark stays where it was, though the mass moves on: left out" in text


def test_what_begins_to_act_later_is_no_wrong_time(tmp_path):
    """A late and large effect was a clock that changes or a picture that is lost."""
    late = np.maximum(FILM.t - FILM.t[44], 0)
    written = FILM.written.copy()
    written[:, 1] += 4.0 * late**2
    check = look(tmp_path, written=written)
    assert not check.mistakes
    assert not check.put_right


def test_even_frames_with_uneven_times_are_even_again(tmp_path):
    """An unrest that hardly scatters the points is no sign to the reader, but makes them less probable."""
    unrest = np.random.default_rng(4).uniform(-0.04, 0.04, len(FILM.t)) * STEP
    check = look(tmp_path, t=FILM.t + np.where(FILM.t > 0, unrest, 0.0))
    assert not check.mistakes
    [name] = check.put_right
    steps = np.diff(check.observations[name].channel("light_x").t)
    steps /= np.median(steps)
    assert np.abs(steps - np.rint(steps)).max() < 1e-6
    assert any("but the masses move as in equal ones" in text for text in check.warnings)


def test_the_errors_of_a_row_are_one(tmp_path):
    """As errors of each point, uneven times of 0.1 steps at 60/s were taken in by the noise of moving masses."""
    late = np.random.default_rng(7).uniform(-0.25, 0.25, len(FILM.t)) * STEP
    moved = FILM.motion(np.maximum(FILM.t + late, 0.0)) - FILM.motion(FILM.t)
    check = look(tmp_path, written=FILM.written + moved)
    assert not check.mistakes
    assert any("taken unevenly" in text for text in check.warnings)


def test_a_hand_ends_the_record_where_the_fitted_motion_ends(tmp_path):
    """What a hand does to the masses is said, and nothing after it is fitted."""
    held, written = 40, FILM.written.copy()
    written[held:] = written[held] + 3e-4 * np.random.default_rng(5).standard_normal(written[held:].shape)
    check = look(tmp_path, written=written)
    assert not check.mistakes
    [name] = check.put_right
    assert FILM.t[held - 3] <= check.observations[name].channel("light_x").t[-1] <= FILM.t[held + 1]
    assert any("something other than its string" in text for text in check.warnings)


def test_equal_marks_of_masses_that_stay_are_no_picture_stored_again(tmp_path):
    """In films of a ball that a hand holds, every second picture was one."""
    held, written = 40, FILM.written.copy()
    written[held:] = written[held]
    study = study_io.load(write(STUDY, Faulty(films=(dataclasses.replace(FILM, written=written),)), tmp_path))
    [trial] = study.trials
    rows = Rows.of(Case.of(study, trial, read_files(study.folder, trial, None)))
    stay = slice(held + 2, len(rows.t) - 1)
    assert np.all(rows.log_copied()[stay] <= rows.log_otherwise().sum(axis=1)[stay] + 1e-9)
