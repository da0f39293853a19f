"""A measured trial beside the runs; the oracle is the closed form's motion, with offsets planted into points made from it."""

import csv
import dataclasses
import io

import numpy as np
import pytest

from looping_pendulum.compare import compare, figures, report
from looping_pendulum.compare.comparison import with_trial
from looping_pendulum.compare.report import residual_rows
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.compare.trajectories import residual_csv
from looping_pendulum.compare.trial import MeasuredTrack, MeasuredTrial
from looping_pendulum.measured.tables.events import MeasuredEventRow
from tests.compare.conftest import rows as closed_form_rows

FRAMES = np.arange(200) / 240
"""Times of a film at 240 frames per second [s]."""
JOIN = 3e-5
"""Largest error of a motion that is joined linearly between milliseconds [m]: an eighth of 150 m/s^2 times their square."""


def tracked(offset=(0.0, 0.0), heavy_offset=0.0, late=0.0, t=FRAMES):
    """Trial of the closed form: points off by ``offset`` [m], at times by a clock that is ``late`` [s]."""
    motion = closed_form_rows(t - late)
    light = MeasuredTrack(
        name="light mass",
        channels=("light_x", "light_y"),
        unit="m",
        t=tuple(t.tolist()),
        values=(tuple(motion[:, 1] + offset[0]), tuple(motion[:, 2] + offset[1])),
    )
    heavy = MeasuredTrack(
        name="heavy mass",
        channels=("heavy_x", "heavy_y"),
        unit="m",
        t=tuple(t.tolist()),
        values=(tuple(motion[:, 5]), tuple(motion[:, 6] + heavy_offset)),
        level_unknown=True,
    )
    return MeasuredTrial(name="mine", source="mine.csv", tracks=(light, heavy))


@pytest.fixture
def against(scenario, reference, make_run):
    """Compare a trial with the closed form and two runs: one shifted by 3 and 4 mm, one that ends at 0.4 s."""
    runs = [make_run(shift=(3e-3, 4e-3)), make_run(until=0.4, engine="mujoco")]
    return lambda trial: with_trial(compare(scenario, reference, runs), trial)


def test_residuals_are_what_was_planted(against):
    light, heavy = against(tracked(offset=(-6e-3, 8e-3))).trial.tracks
    assert light.reference.rms == pytest.approx(10e-3, abs=JOIN)
    assert light.reference.mean == pytest.approx((-6e-3, 8e-3), abs=JOIN)
    shifted, short = light.engines
    assert shifted.rms == pytest.approx(np.hypot(9e-3, 4e-3), abs=JOIN)
    assert shifted.compared == len(FRAMES)
    assert short.compared == np.sum(FRAMES <= 0.4)
    assert short.rms == pytest.approx(10e-3, abs=JOIN)
    assert heavy.reference.rms < JOIN


def test_one_wrong_point_is_the_largest_residual(against):
    trial = tracked()
    light = trial.tracks[0]
    x = [v + (0.05 if i == 120 else 0.0) for i, v in enumerate(light.values[0])]
    moved = dataclasses.replace(light, values=(tuple(x), light.values[1]))
    found = against(dataclasses.replace(trial, tracks=(moved,))).trial.tracks[0].reference
    assert found.largest == pytest.approx(0.05, abs=JOIN)
    assert found.largest_at == FRAMES[120]
    assert found.rms == pytest.approx(0.05 / np.sqrt(len(FRAMES)), abs=JOIN)


def test_the_level_of_a_hanging_mass_is_taken_from_its_first_points(against):
    result = against(tracked(heavy_offset=-0.0203))
    heavy = result.trial.tracks[1]
    assert heavy.level_shift == pytest.approx(0.0203, abs=JOIN)
    assert heavy.reference.rms < JOIN
    assert "raised by 20.3 mm" in " ".join(result.trial.notes)
    t, drops = result.trial.heavy_drops(result.samples.reference)
    assert drops == pytest.approx(closed_form_rows(t)[0, 6] - closed_form_rows(t)[:, 6], abs=JOIN)


@pytest.mark.long
def test_a_clock_that_does_not_start_at_the_release_is_noticed(against):
    late = np.arange(300) / 240
    notes = " ".join(against(tracked(late=0.35, t=late)).trial.notes)
    assert "if the release was 0.350 s later by the file's clock" in notes
    assert "--marks-set 'camera.clock_offset=-0.350 s'" in notes
    said = dataclasses.replace(tracked(late=0.35, t=late), clock_offset=0.1)
    assert "camera.clock_offset=-0.250 s" in " ".join(against(said).trial.notes), "in addition to what was said"
    assert "clock" not in " ".join(against(tracked()).trial.notes)


def test_the_release_is_found_although_the_model_is_wrong_later(against):
    """After 0.35 s these points stay where they were; their release is 0.35 s into the clip all the same."""
    late = np.arange(300) / 240
    trial = tracked(late=0.35, t=late)
    light = trial.tracks[0]
    stopped = tuple(tuple(np.where(late > 0.7, values[168], values).tolist()) for values in light.values)
    notes = against(dataclasses.replace(trial, tracks=(dataclasses.replace(light, values=stopped),))).trial.notes
    assert "camera.clock_offset=-0.350 s" in " ".join(notes)


def test_axes_beside_the_rod_are_noticed(against):
    notes = " ".join(against(tracked(offset=(0.012, -0.005))).trial.notes)
    assert "lie 12.0 mm right of and 5.0 mm below the reference" in notes
    assert "'camera.origin_x=12.0 mm' --marks-set 'camera.origin_y=-5.0 mm'" in notes
    assert "origin" not in " ".join(against(tracked(offset=(1e-3, 0.0))).trial.notes)  # as accurate as tracking is


def test_the_report_speaks_of_no_paper_over_a_trial_of_ones_own(against, measured_scenario):
    row = MeasuredEventRow(quantity="halting_time", index=1, measured=0.351, paper_numerical=None, unit="s", sigma=0.002)
    result = against(dataclasses.replace(tracked(offset=(-6e-3, 8e-3)), rows=(row,)))
    text, html = report.comparison_markdown(result), report.render_page(result, figures.charts(result))
    assert "## Against the measured trial" in text
    assert "mine.csv" in text
    assert "paper" not in text.partition("## Words")[0].lower()
    assert "paper's numerical" not in html
    assert "0.3510" in text, "as precisely as its standard error"
    table = dict(zip(*(lambda head, body: (head, body[0]))(*residual_rows(result)), strict=False))
    assert table["light mass: RMS residual [mm]"] == "10"
    assert {chart.id for chart in figures.charts(result)} == {"path", "drop", "divergence", "residuals", "events"}


def test_it_reads_back_from_json(against):
    result = against(tracked())
    again = ComparisonResult.from_json(result.to_json())
    assert again.trial == result.trial
    assert report.comparison_markdown(dataclasses.replace(result, samples=None)) == report.comparison_markdown(again)


def test_residuals_csv_has_every_point(against):
    result = against(tracked(offset=(-6e-3, 8e-3)))
    body = list(csv.DictReader(io.StringIO(residual_csv(result, result.samples, result.trial))))
    assert len(body) == 4 * len(FRAMES)
    x = [row for row in body if row["channel"] == "light_x"]
    assert [float(row["t [s]"]) for row in x] == pytest.approx(FRAMES, rel=1e-8)
    assert [float(row["residual of reference"]) for row in x] == pytest.approx([-6e-3] * len(FRAMES), abs=JOIN)
    assert x[-1]["residual of mujoco:chain"] == ""  # its run ends before


def test_an_angle_is_compared_in_degrees(against):
    track = MeasuredTrack(
        name="wrap angle",
        channels=("wrap_angle",),
        unit="rad",
        t=tuple(FRAMES.tolist()),
        values=(tuple((np.radians(112) + 6.0 * FRAMES + 0.02).tolist()),),
    )
    head, body = residual_rows(against(MeasuredTrial(name="a", source="a.txt", tracks=(track,))))
    assert head[1] == "wrap angle: RMS residual [deg]"
    assert float(body[0][1]) == pytest.approx(np.degrees(0.02), rel=5e-3)
