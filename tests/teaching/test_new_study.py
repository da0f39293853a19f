"""`new study`: what the files say is not asked, no answer is lost, and `identify` accepts what is written."""

import shlex
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.discrepancy.first_look.check import DeclarationCheck, DeclarationError, NamedMistake
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured import study_io
from looping_pendulum.measured.readers import survey
from looping_pendulum.measured.study import read_files
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import load
from looping_pendulum.teaching.new_study import keys_of_fault
from looping_pendulum.teaching.questions import AnswerError
from scripts.make_example_trials import FOLDER

FIRST = (FOLDER / "first.csv").read_text(encoding="utf-8")
"""Tracker's export of a synthetic trial: tracks light and heavy, 240 rows a second, metres, the light mass on the left."""
POINTS = [[float(cell or "nan") for cell in row.split(",")[:5]] for row in FIRST.splitlines()[3:]]
LIKE_IT = "\n".join(["", "", "112 deg +/- 0.5 deg", "58 cm +/- 1 mm", "5 cm +/- 1 mm", ""])
"""Answers from "keep it away from the fit" to the end that fit it."""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments, answers=None):
    return CliRunner().invoke(app, ["new", "study", *map(str, arguments)], input=answers)


def table(name, header, *, order=(0, 1, 2, 3, 4), time=1.0, length=1.0, mirrored=False):
    """Write the synthetic trial in another form: its columns t, light x and y, heavy x and y, in another order or unit."""
    factors = np.array([time, -length if mirrored else length, length, -length if mirrored else length, length])
    rows = np.array(POINTS) * factors
    lines = [",".join("" if np.isnan(row[i]) else f"{row[i]:.7g}" for i in order) for row in rows]
    Path(name).write_text("\n".join([*header, *lines]) + "\n")


NAMED = ["t,light_x,light_y,heavy_x,heavy_y"]
TRACKS = [",mass A,,mass B,,", "t,x,y,x,y,"]
FORMS = {
    "names say the masses": (NAMED, {}),
    "the motion says the masses": (TRACKS, {"order": (0, 3, 4, 1, 2)}),
    "no names at all": ([], {"order": (0, 3, 4, 1, 2)}),
    "centimetres, not said": (NAMED, {"length": 100}),
    "millimetres in the header": (["t,light_x [mm],light_y [mm],heavy_x [mm],heavy_y [mm]"], {"length": 1000}),
    "milliseconds, not said": (NAMED, {"time": 1000}),
    "the light mass on the right": (NAMED, {"mirrored": True}),
}


@pytest.mark.parametrize("form", FORMS)
def test_whatever_the_form_of_the_file_the_same_points_are_read(here, form):
    header, changes = FORMS[form]
    table("trial.csv", header, **changes)
    done = run("mine.yaml", "-y", "--trial", "trial.csv")
    assert done.exit_code == 0, done.output
    assert "refuse" not in done.output
    study = study_io.load("mine.yaml")
    observed = read_files(study.folder, study.trials[0])
    for i, channel in enumerate(("light_x", "light_y", "heavy_x", "heavy_y"), 1):
        column = np.array(POINTS)[:, i]
        assert observed.channel(channel).value == pytest.approx(column[~np.isnan(column)], rel=1e-6)
        assert observed.channel(channel).time_step == pytest.approx(1 / 240, rel=1e-5)


def test_slow_motion_is_asked_for_and_a_fault_of_the_data_leads_back_to_it(here):
    table("slow.csv", NAMED, time=8)
    before = "\n" * 6  # title, unit, 30 Hz as the file has it, light mass, rod, effects
    again = "\n".join(["n", "", "240 Hz", "", "", "", ""])  # do not write it so: unit, rate, angle, two lengths
    done = run("mine.yaml", "--trial", "slow.csv", answers=f"{before}{LIKE_IT}{again}")
    assert done.exit_code == 0, done.output
    assert "true frame rate of the camera (the file has 30 rows a second" in done.output
    assert "needed 'frame_rate: 240 Hz'" in done.output
    assert done.output.count("Radius of the rod") == 1, "only what may be wrong is asked again"
    (trial,) = study_io.load("mine.yaml").trials
    assert trial.frame_rate == 240
    assert trial.estimates["release_angle"].value == pytest.approx(np.radians(112))
    without_asking = run("other.yaml", "-y", "--trial", "slow.csv")
    assert without_asking.exit_code == 0
    assert "warning: `identify` will refuse this until it is corrected: trial 'slow'" in without_asking.output


def test_a_fault_goes_back_to_its_question_and_the_rest_is_kept(here):
    table("trial.csv", TRACKS)
    answers = ["Mine", "mass A", "mass A", "mass A", "mass B", "stones", "m", "5", "12 g"]
    done = run("mine.yaml", "--trial", "trial.csv", answers="\n".join([*answers, "", "", ""]) + LIKE_IT)
    assert done.exit_code == 0, done.output
    for message in ("one track for both masses", "got 'stones'", "expected a mass, got '5' (the unit is missing)"):
        assert message in done.output
    assert done.output.count("Title") == 1
    study = study_io.load("mine.yaml")
    assert study.title == "Mine"
    assert study.apparatus["light_mass"].value == 0.012


def test_a_contradiction_in_a_scenario_goes_back_to_its_question(here):
    usual = ["", "", "", "", "", "0.5", "0.3", *[""] * 7]  # title, kind, three quantities; friction: static below kinetic
    done = CliRunner().invoke(
        app, ["new", "scenario", "mine.yaml", "--like", "static_friction"], input="\n".join([*usual, "0.6", ""])
    )
    assert done.exit_code == 0, done.output
    assert "needed at least kinetic_friction" in done.output
    assert done.output.count("Light mass") == 1
    friction = load("mine.yaml").parameters.coefficients
    assert (friction["kinetic_friction"], friction["static_friction"]) == (0.5, 0.6)


def test_who_breaks_off_gets_a_command_that_asks_the_rest_only(here):
    table("trial.csv", TRACKS)
    done = run("mine.yaml", "--trial", "trial.csv", answers="It's mine\nmass A\nmass B\nm\n12 g +/- 1 %\n")
    assert done.exit_code != 0
    assert not Path("mine.yaml").exists()
    (line,) = [line for line in done.output.splitlines() if line.startswith("  looping-pendulum new study mine.yaml")]
    command = shlex.split(line)
    assert "light.mass=12 g +/- 1 %" in command
    done = CliRunner().invoke(app, command[1:], input=f"\n\n{LIKE_IT}")
    assert done.exit_code == 0, done.output
    assert "Light mass" not in done.output
    assert study_io.load("mine.yaml").title == "It's mine"


def test_a_faulty_option_is_asked_for_and_one_that_is_no_question_is_said_before_any(here):
    table("trial.csv", NAMED)
    options = ["--trial", "trial.csv", "--set", "light.mass=5", "--set", "rod.radios=5 mm"]
    done = run("mine.yaml", *options, answers=f"\n\n11 g\n\n\n{LIKE_IT}")
    assert done.exit_code == 0, done.output
    assert done.output.index("found 'rod.radios', which is not asked for; did you mean 'rod.radius'?") < done.output.index(
        "Title"
    )
    assert "--set light.mass: expected a mass, got '5'" in done.output
    assert study_io.load("mine.yaml").apparatus["light_mass"].value == 0.011
    done = run("other.yaml", "-y", "--trial", "trial.csv", "--set", "trials.2.frame_rate=240 Hz")
    assert isinstance(done.exception, HarnessError)
    assert "not asked for in this study" in str(done.exception)


def test_what_was_not_measured_is_named_where_nothing_is_asked(here):
    table("trial.csv", NAMED)
    done = run("mine.yaml", "-y", "--trial", "trial.csv", "--set", "rod.radius=6 mm +/- 1 %")
    assert "taken from ten_to_one, and not measured: light.mass, trials.1.heavy.mass" in done.output
    assert "rod.radius" not in done.output


def test_frames_without_times_need_the_frame_rate(here):
    rows = "\n".join(f"{i},{-0.5 + 0.001 * i},{-0.2}" for i in range(40))
    Path("frames.csv").write_text(f"frame,light_x,light_y\n{rows}\n")
    done = run("mine.yaml", "-y", "--trial", "frames.csv", "--set", "trials.1.frame_rate=120 Hz")
    assert done.exit_code == 0, done.output
    study = study_io.load("mine.yaml")
    assert read_files(study.folder, study.trials[0]).channel("light_x").time_step == pytest.approx(1 / 120)


def test_a_file_of_heights_or_angles_is_a_drop_or_a_held_pendulum(here):
    times = np.arange(30) / 15
    drops = [f"{n},{t:.4f},{40 - 4.9 * t**2:.5f}" for n in (1, 2) for t in times]
    Path("ball.csv").write_text("\n".join(["drop,time_s,height_m", *drops]) + "\n")
    Path("swing.csv").write_text("\n".join(["t,angle", *(f"{t:.4f},{0.5 * np.cos(4 * t):.5f}" for t in times)]) + "\n")
    done = run("mine.yaml", "-y", "--trial", "ball.csv", "--trial", "ball.csv")
    assert done.exit_code == 0, done.output
    study = study_io.load("mine.yaml")
    assert [(t.name, t.run, t.release, t.held_out) for t in study.trials] == [
        ("ball-1", "1", Release.DROP, False),
        ("ball-2", "2", Release.DROP, True),
    ]
    assert not study.apparatus
    done = run("swing.yaml", "-y", "--trial", "swing.csv", "--set", "release.kind=held")
    assert "is not asked for" in str(done.exception)
    done = run("swing.yaml", "-y", "--trial", "swing.csv")
    assert done.exit_code == 0, done.output
    study = study_io.load("swing.yaml")
    assert study.trials[0].release is Release.HELD
    assert set(study.apparatus) == {"light_mass"}


def test_files_of_one_name_make_trials_of_two(here):
    for folder in ("a", "b"):
        Path(folder).mkdir()
        table(f"{folder}/first.csv", NAMED)
    assert run("mine.yaml", "-y", "--trial", "a/first.csv", "--trial", "b/first.csv").exit_code == 0
    assert [t.name for t in study_io.load("mine.yaml").trials] == ["first", "first-2"]


def test_a_misspelt_file_is_asked_for_again_and_one_that_will_come_is_accepted(here):
    table("first.csv", NAMED)
    answers = "\n".join(["", "2", "fist.csv", "first.csv", "m", "later_on.txt", "ball", "bob"]) + "\n"
    done = run("mine.yaml", answers=answers + "\n" * 20)
    assert done.exit_code == 0, done.output
    assert "found no file 'fist.csv'; did you mean 'first.csv'?" in done.output
    assert "later_on.txt is not there yet" in done.output
    assert study_io.load("mine.yaml").trials[1].files == (("later_on.txt", {"light": "ball", "heavy": "bob"}),)


def test_a_vertical_release_is_told_by_the_fall_and_outliers_do_not_count(here):
    t = np.arange(100) / 240
    light, heavy = np.c_[-0.006 + 1e-4 * np.sin(t), -0.5 + 4 * t**2], np.c_[0.006 + 1e-4 * np.cos(t), -0.1 - 4 * t**2]
    light[17] = heavy[40] = (0.7, 0.2)  # the tracker slipped
    rows = [",".join(f"{v:.5f}" for v in row) for row in np.c_[t, heavy, light]]
    Path("drop.csv").write_text("\n".join([*TRACKS, *rows]) + "\n")
    assert survey("drop.csv").proposed_masses() == {"light": "mass B", "heavy": "mass A"}


def test_a_file_that_is_no_table_is_said_in_one_line(here):
    Path("clip.trk").write_bytes(b"<?xml version='1.0'?>")
    done = run("mine.yaml", "-y", "--trial", "clip.trk")
    assert isinstance(done.exception, AnswerError)
    assert "clip.trk: found damaged XML" in str(done.exception)


@pytest.mark.parametrize(
    ("keys", "asked_again"),
    [
        ("frame_rate: 240 Hz", ("trials.2.units", "trials.2.frame_rate", "trials.2.release")),
        ("rod: {radius: 3 mm}", ()),
    ],
)
def test_a_mistake_leads_back_to_the_questions_that_mend_it(keys, asked_again):
    """A diameter for the radius led back to unit, rate and release, none of which mends it."""
    study = SimpleNamespace(trials=[SimpleNamespace(name=name) for name in ("first", "slow")])
    mistake = NamedMistake(trials=("slow",), names=("any",), keys=keys, text=f"trial 'slow': found one; needed '{keys}'")
    assert keys_of_fault(study, DeclarationError(DeclarationCheck(trials=(), mistakes=(mistake,)))) == asked_again
