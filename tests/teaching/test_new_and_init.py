"""`new` and `init`: what they write loads, what they ask is checked, and nothing is written over."""

import math
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured import study_io
from looping_pendulum.measured.readers import read
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import load
from looping_pendulum.scenarios.loader import shipped
from looping_pendulum.teaching.example_folder import FolderError, write_example
from looping_pendulum.teaching.new_file import new_scenario
from looping_pendulum.teaching.questions import QUESTIONS, AnswerError, Answers
from scripts.make_example_trials import HIDDEN, trials
from tests.docs_commands import PROJECT


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments, answers=None):
    return CliRunner().invoke(app, [str(a) for a in arguments], input=answers)


@pytest.mark.parametrize("command", ["new", "init", "tracker", "demonstrations"])
def test_help_shows_how_it_is_written(command):
    done = run(command, "--help")
    assert done.exit_code == 0
    assert f"looping-pendulum {command} " in " ".join(done.output.split())


def take_default(words, default, check):
    check(default)
    return default


@pytest.mark.parametrize("name", shipped())
def test_the_defaults_are_the_shipped_scenarios_numbers(name):
    _, scenario = new_scenario(Answers(take_default, {}), name="mine", like=name)
    expected = load(name)
    skipped = {"heavy_drag", "kinetic_friction", "static_friction"} if expected.parameters.release is Release.HELD else set()
    for key, value in expected.parameters.coefficients.items():
        assert key in skipped or scenario.parameters.coefficients[key] == value
    for field in ("light_mass", "heavy_mass", "rod_radius", "free_length", "release_angle", "hanging_length", "release"):
        assert getattr(scenario.parameters, field) == getattr(expected.parameters, field)


def test_answers_are_checked_as_they_come_and_asked_again(here):
    done = run("new", "scenario", "mine.yaml", answers="A pencil\n\n5\n12 g\n2 kg\n3.5 cm\n1.5\n" + "\n" * 20)
    assert done.exit_code == 0, done.output
    assert "expected a mass, got '5' (the unit is missing)" in done.output
    assert "unusual: most are between 0.05 and 1" in done.output
    p = load("mine.yaml").parameters
    assert (p.light_mass, p.heavy_mass, p.rod_radius, p.coefficients["kinetic_friction"]) == (0.012, 2.0, 0.035, 1.5)
    assert load("mine.yaml").title == "A pencil"


def test_the_dialogue_that_the_page_shows_is_what_is_printed(here):
    page = (PROJECT / "docs" / "start.md").read_text(encoding="utf-8")
    (dialogue,) = re.findall(r"^```text\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    asked, *_ = dialogue.partition("]: ")
    answers = [line.removeprefix(f"{asked}]: ") for line in dialogue.splitlines() if line.startswith(asked)]
    done = run("new", "scenario", "mine.yaml", answers="\n\n" + "\n".join(answers) + "\n" * 20)
    assert done.exit_code == 0, done.output
    assert answers == ["5", "5 kg"]
    for line in dialogue.splitlines():
        assert line.removesuffix(f" {answers[1]}").removesuffix(f" {answers[0]}") in done.output


def test_without_asking_answers_come_from_options(here):
    done = run("new", "scenario", "mine.yaml", "-y", "--set", "light.mass=20 g", "--set", "string.static_friction=0.5")
    assert done.exit_code == 0, done.output
    p = load("mine.yaml").parameters
    assert (p.light_mass, p.coefficients["static_friction"]) == (0.02, 0.5)
    assert "halts after" in done.output


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("light.mass=5", "--set light.mass: expected a mass"),
        ("light.mas=5 g", "did you mean 'mass'"),
        ("light.mass", "needed KEY=VALUE"),
        ("release.kind=throw", "expected one of looping"),
        ("string.static_friction=0.1", "needed at least kinetic_friction"),
        ("release.angle=400 deg", "expected an angle above 0 up to 360 deg"),
    ],
)
def test_an_answer_that_cannot_be_leaves_nothing_behind(here, setting, message):
    done = run("new", "scenario", "mine.yaml", "-y", "--set", setting)
    assert isinstance(done.exception, HarnessError)
    assert message in str(done.exception)
    assert "\n" not in str(done.exception)
    assert not Path("mine.yaml").exists()


def test_a_file_is_never_written_over_without_asking(here):
    Path("mine.yaml").write_text("mine\n")
    for done in (run("new", "scenario", "mine.yaml", "-y"), run("new", "scenario", "mine.yaml", answers="n\n")):
        assert isinstance(done.exception, AnswerError)
        assert Path("mine.yaml").read_text() == "mine\n"
    assert run("new", "scenario", "mine.yaml", answers="y\n" + "\n" * 20).exit_code == 0
    assert load("mine.yaml").title == "mine"


def test_every_question_has_its_usual_range_inside_what_the_file_takes():
    for question in QUESTIONS.values():
        low, high = question.usual
        assert question.kind.low <= low < high <= question.kind.high


def test_a_study_is_written_from_two_trials(here):
    write_example(Path("example"))
    options = [
        "--trial",
        "example/trials/first.csv",
        "--trial",
        "example/trials/second.csv",
        "--set",
        "trials.2.heavy.mass=60 g",
    ]
    done = run("new", "study", "studies/mine.yaml", "-y", *options)
    assert done.exit_code == 0, done.output
    study = study_io.load("studies/mine.yaml")
    assert [t.held_out for t in study.trials] == [False, True]
    assert study.trials[0].files[0][0] == "../example/trials/first.csv"
    assert study.trials[1].estimates["heavy_mass"].value == 0.06
    assert math.isclose(study.trials[0].estimates["heavy_mass"].sigma, 5e-4)
    assert study.declared == ("gravity", "capstan", "light_drag", "heavy_drag", "string_drag"), "all drags that it has"


def test_marks_that_cannot_be_read_are_said_at_once(here):
    Path("bad.csv").write_text("t,x,y\n0,1,oops\n")
    done = run("new", "study", "mine.yaml", "-y", "--trial", "bad.csv")
    assert isinstance(done.exception, AnswerError)
    assert "bad.csv" in str(done.exception)
    # It asked for the title again and again
    done = run("new", "study", "mine.yaml", "--trial", "bad.csv", answers="\n" * 50)
    assert isinstance(done.exception, AnswerError)
    assert "Title" not in done.output
    Path("standing.csv").write_text("t,light_x,light_y\n0,2,3\n0,3,4\n0,4,5\n")
    done = run("new", "study", "mine.yaml", "--trial", "standing.csv", answers="\n" * 50)
    assert "needed times that grow" in str(done.exception), "said again after the same answers"
    assert done.output.count("true frame rate") == 2
    Path("standing.csv").unlink()
    done = run("new", "study", "mine.yaml", "-y", "--set", "effects=capstan, magic")
    assert "unknown effect 'magic'" in str(done.exception)


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
    with pytest.raises(FolderError, match=r"found notes.txt, needed an empty or a new folder"):
        write_example(Path("full"))
    with pytest.raises(FolderError, match="found a file, needed a folder"):
        write_example(Path("full/notes.txt"))
    assert [p.name for p in Path("full").iterdir()] == ["notes.txt"]


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
