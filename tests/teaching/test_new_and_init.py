"""`new` and `init`: what they write loads, what is given is checked, and nothing is written over."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.errors import HarnessError
from looping_pendulum.files import OutputError
from looping_pendulum.measured import study_io
from looping_pendulum.measured.study import read_files
from looping_pendulum.measured.tables.readers import read, survey
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import load
from looping_pendulum.scenarios.loader import shipped
from looping_pendulum.scenarios.quantities import QUANTITIES
from looping_pendulum.teaching.example_folder import write_example
from looping_pendulum.teaching.new_file import NewFileError
from scripts.make_example_trials import FOLDER, HIDDEN, trials


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.mark.parametrize("name", shipped())
def test_a_new_scenario_is_the_one_that_it_is_like(here, name):
    assert run("new", "scenario", "mine", "--like", name).exit_code == 0
    scenario, expected = load("mine.yaml"), load(name)
    assert (scenario.parameters, scenario.duration) == (expected.parameters, expected.duration)
    assert scenario.title == "mine"


def test_what_is_given_stands_in_the_scenario_and_every_value_is_explained(here):
    options = ["--light-mass", "12 g", "--rod-diameter", "10 mm", "--friction", "0.5", "--duration", "2 s"]
    done = run("new", "scenario", "a_pencil", *options)
    assert done.exit_code == 0, done.output
    assert "next: looping-pendulum run a_pencil.yaml" in done.output
    p = load("a_pencil.yaml").parameters
    assert (p.light_mass, p.rod_radius, load("a_pencil.yaml").duration) == (0.012, 0.005, 2.0)
    assert p.coefficients["kinetic_friction"] == p.coefficients["static_friction"] == 0.5
    for line in Path("a_pencil.yaml").read_text().splitlines():
        assert re.fullmatch(r"#.*|\w+:|title: a pencil|  kind: looping|.*: .*  # .*", line), line


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--light-mass", "5"], "--light-mass: expected a mass, got '5' (the unit is missing); write for example '10 g'"),
        (["--rod-radius", "5 mm", "--rod-diameter", "5 mm"], "leave one out"),
        (["--release-angle", "400 deg"], "--release-angle: expected an angle above 0 up to 360 deg"),
        (["--friction", "0.5 mm"], "--friction: expected a plain number"),
        (["--free-length", "1 mm"], "these are the given values and those of ten_to_one"),
        (["--like", "ten_to_on"], "did you mean"),
    ],
)
def test_a_value_that_cannot_be_leaves_nothing_behind(here, options, message):
    done = run("new", "scenario", "mine", *options)
    assert isinstance(done.exception, HarnessError)
    assert message in str(done.exception)
    assert "\n" not in str(done.exception)
    assert not list(here.iterdir())


def test_a_study_says_what_is_still_to_be_filled_in_and_look_judges_it(here):
    write_example(Path("example"))
    files = ["example/trials/first.csv", "example/trials/second.csv"]
    lengths = ["--free-length", "58 cm +/- 1 mm", "--hanging-length", "5 cm +/- 1 mm"]
    angles = ["--release-angle", "112 deg +/- 0.5 deg", "--release-angle", "95 deg +/- 0.5 deg"]
    masses = ["--light-mass", "10 g +/- 0.5 %", "--heavy-mass", "100 g +/- 0.5 %", "--heavy-mass", "80 g"]
    done = run("new", "study", *files, "--out", "studies/mine.yaml", *lengths, *angles, *masses)
    assert done.exit_code == 0, done.output
    assert "fill in the 2 values that say TODO, then: looping-pendulum look studies/mine.yaml" in done.output
    fault = run("look", "studies/mine.yaml").exception
    assert "apparatus.light.radius: found TODO, needed a length" in str(fault)
    path = Path("studies/mine.yaml")
    path.write_text(path.read_text().replace("radius: TODO ", "radius: 8 mm +/- 0.1 mm ", 1))
    fault = run("look", "studies/mine.yaml").exception
    assert "mine.yaml:11: apparatus.rod.radius: found TODO, needed a length above 0" in str(fault)
    assert "fill it in, for example '6.25 mm +/- 1 %'" in str(fault)
    path.write_text(path.read_text().replace("TODO ", "6.25 mm +/- 1 % ", 2))  # the first is in the head
    study = study_io.load(path)
    assert [t.held_out for t in study.trials] == [False, True]
    assert study.trials[0].files[0][0] == "../example/trials/first.csv"
    assert [t.estimates["heavy_mass"].value for t in study.trials] == [0.1, 0.08]
    assert study.trials[0].estimates["heavy_mass"].sigma == pytest.approx(5e-4)
    assert "# Its mass M2; taken as exact, as it has no standard error, such as +/- 0.5 %" in path.read_text()
    assert {"light_drag", "heavy_drag", "string_drag"} < set(study.effects), "all drags that it has"
    assert run("look", "studies/mine.yaml", "--out", "out").exit_code == 0


FIRST = (FOLDER / "first.csv").read_text(encoding="utf-8")
"""Tracker's export of a synthetic trial: tracks light and heavy, 240 rows a second, metres, the light mass on the left."""
POINTS = [[float(cell or "nan") for cell in row.split(",")[:5]] for row in FIRST.splitlines()[3:]]


def table(name, header, *, order=(0, 1, 2, 3, 4), time=1.0, length=1.0, mirrored=False):
    """Write the synthetic trial in another form: its columns t, light x and y, heavy x and y, in another order or unit."""
    factors = np.array([time, -length if mirrored else length, length, -length if mirrored else length, length])
    rows = np.array(POINTS) * factors
    lines = [",".join("" if np.isnan(row[i]) else f"{row[i]:.7g}" for i in order) for row in rows]
    Path(name).write_text("\n".join([*header, *lines]) + "\n")


GIVEN = [
    *("--light-mass", "10 g", "--light-radius", "5 mm", "--heavy-mass", "100 g", "--rod-radius", "6.25 mm"),
    *("--release-angle", "112 deg", "--free-length", "58 cm"),
]
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
def test_whatever_the_form_of_the_table_the_same_points_are_read(here, form):
    header, changes = FORMS[form]
    table("trial.csv", header, **changes)
    done = run("new", "study", "trial.csv", *GIVEN)
    assert done.exit_code == 0, done.output
    study = study_io.load("my_study.yaml")
    observed = read_files(study.folder, study.trials[0])
    for i, channel in enumerate(("light_x", "light_y", "heavy_x", "heavy_y"), 1):
        column = np.array(POINTS)[:, i]
        assert observed.channel(channel).value == pytest.approx(column[~np.isnan(column)], rel=1e-6)
        assert observed.channel(channel).time_step == pytest.approx(1 / 240, rel=1e-5)


def test_slow_motion_and_frames_without_times_need_the_frame_rate(here):
    table("slow.csv", NAMED, time=8)
    assert run("new", "study", "slow.csv", "--out", "slow.yaml").exit_code == 0
    assert "# frame_rate: 240 Hz  # without the first '#', for slow motion" in Path("slow.yaml").read_text()
    Path("frames.csv").write_text("frame,light_x,light_y\n" + "".join(f"{i},{-0.5 + 0.001 * i},-0.2\n" for i in range(40)))
    assert run("new", "study", "frames.csv", *GIVEN).exit_code == 0
    with pytest.raises(HarnessError, match=r"trials\[0\].frame_rate: found TODO, needed a quantity in Hz above 0"):
        study_io.load("my_study.yaml")


def test_a_table_of_heights_or_angles_is_a_drop_or_a_held_pendulum(here):
    times = np.arange(30) / 15
    drops = [f"{n},{t:.4f},{40 - 4.9 * t**2:.5f}" for n in (1, 2) for t in times]
    Path("ball.csv").write_text("\n".join(["drop,time_s,height_m", *drops]) + "\n")
    Path("swing.csv").write_text("\n".join(["t,angle", *(f"{t:.4f},{0.5 * np.cos(4 * t):.5f}" for t in times)]) + "\n")
    assert run("new", "study", "ball.csv", "--heavy-mass", "50 g +/- 1 %").exit_code == 0
    study = study_io.load("my_study.yaml")
    assert [(t.name, t.run, t.release, t.held_out) for t in study.trials] == [
        ("ball-1", "1", Release.DROP, False),
        ("ball-2", "2", Release.DROP, True),
    ]
    assert not study.apparatus
    assert run("new", "study", "swing.csv", "--out", "swing.yaml", *GIVEN).exit_code == 0
    study = study_io.load("swing.yaml")
    assert study.trials[0].release is Release.HELD
    assert set(study.apparatus) == {"light_mass"}


def test_files_of_one_name_make_trials_of_two(here):
    for folder in ("a", "b"):
        Path(folder).mkdir()
        table(f"{folder}/first.csv", NAMED)
    assert run("new", "study", "a/first.csv", "b/first.csv", *GIVEN).exit_code == 0
    assert [t.name for t in study_io.load("my_study.yaml").trials] == ["first", "first-2"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nope.csv"], "found no file 'nope.csv', needed a film or a table of tracked points"),
        (["bad.csv"], "bad.csv"),
        (["clip.trk"], "clip.trk: found damaged XML"),
        (["good.csv", "--free-length", "5"], "--free-length: expected a length, got '5' (the unit is missing)"),
        (["good.csv", "--free-length", "5 cm", "--free-length", "6 cm"], "found 2 values, needed one for all files, or 1"),
    ],
)
def test_a_study_of_files_that_cannot_be_is_refused_in_one_line(here, arguments, message):
    Path("bad.csv").write_text("t,x,y\n0,1,oops\n")
    Path("clip.trk").write_bytes(b"<?xml version='1.0'?>")
    table("good.csv", NAMED)
    done = run("new", "study", *arguments)
    assert isinstance(done.exception, NewFileError)
    assert message in str(done.exception)
    assert "\n" not in str(done.exception)
    assert not Path("my_study.yaml").exists()


def test_a_vertical_release_is_told_by_the_fall_and_outliers_do_not_count(here):
    t = np.arange(100) / 240
    light, heavy = np.c_[-0.006 + 1e-4 * np.sin(t), -0.5 + 4 * t**2], np.c_[0.006 + 1e-4 * np.cos(t), -0.1 - 4 * t**2]
    light[17] = heavy[40] = (0.7, 0.2)  # the tracker slipped
    rows = [",".join(f"{v:.5f}" for v in row) for row in np.c_[t, heavy, light]]
    Path("drop.csv").write_text("\n".join([*TRACKS, *rows]) + "\n")
    assert survey("drop.csv").masses == {"light": "mass B", "heavy": "mass A"}


def test_every_usual_range_is_inside_what_the_file_takes():
    for q in QUANTITIES.values():
        low, high = q.usual
        assert math.isinf(low) or q.kind.low <= low < high <= q.kind.high


def test_the_first_line_names_a_schema_that_stands_beside_the_file(here):
    write_example(Path("example"))
    assert run("new", "scenario", "example/mine").exit_code == 0
    assert run("new", "study", "example/trials/first.csv", "--out", "example/my_study.yaml").exit_code == 0
    for name in ("mine", "my_study"):
        head = Path(f"example/{name}.yaml").read_text().splitlines()[0]
        schema = Path("example") / head.removeprefix("# yaml-language-server: $schema=")
        assert json.loads(schema.read_text())["title"].startswith("Looping pendulum")


def test_the_example_folder_loads(here):
    done = run("init", "example")
    assert done.exit_code == 0
    assert "Next: cd example" in done.output
    load("example/mine.scenario.yaml")
    study = study_io.load("example/study.yaml")
    for trial in study.trials:
        assert read(Path("example") / trial.files[0][0]).used > 800


def test_a_folder_with_anything_in_it_is_left_alone(here):
    Path("full").mkdir()
    Path("full/notes.txt").write_text("mine")
    with pytest.raises(OutputError, match=r"found notes.txt, needed an empty or a new folder"):
        write_example(Path("full"))
    with pytest.raises(OutputError, match="found a file, needed a folder"):
        write_example(Path("full/notes.txt"))
    assert [p.name for p in Path("full").iterdir()] == ["notes.txt"]


@pytest.mark.long
def test_the_shipped_marks_are_what_the_script_makes():
    folder = Path(__file__).parents[2] / "looping_pendulum" / "teaching" / "example" / "trials"
    for name, text in trials().items():
        assert (folder / f"{name}.csv").read_text(encoding="utf-8") == text


@pytest.mark.accurate
def test_the_examples_missing_effect_is_found(here):
    write_example(Path("example"))
    result = identify(study_io.load("example/study.yaml"))
    assert result.names == ("side_force",)
    effect = result.effects[0]
    assert abs(effect.value - HIDDEN.side_force) < 3 * effect.error
