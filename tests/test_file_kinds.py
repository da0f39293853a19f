"""A file that is for another command: each command says in one line what the file is, and which command takes it."""

import os
import shlex
import signal
from pathlib import Path

import pytest
import typer

from looping_pendulum.cli.file_kinds import COMMANDS, kind_of
from looping_pendulum.cli.main import app
from tests.command_line import here

FILES = {
    "scenario": ("a scenario.yaml", "title: x\nlight: {mass: 1 g}\nrod: {radius: 1 mm}\n"),
    "study": ("a study.yaml", "title: x\ntrials:\n  - file: a.csv\n"),
    "map": ("a map.yaml", "scenario: ten_to_one\nparameters:\n  mass_ratio: {from: 1}\n"),
    "table of numbers": ("a table.csv", "t,light_x,light_y\n0.0,-0.58,\n0.01,-5.8e-1,-0.001\n"),
    "film": ("a film.mp4", "no film"),
}
TAKEN = {
    ("run",): {"scenario"},
    ("compare",): {"scenario"},
    ("check",): {"scenario"},
    ("converge",): {"scenario"},
    ("demo", "--no-open"): {"scenario"},
    ("live", "--no-open"): {"scenario"},
    ("scenarios",): {"scenario"},
    ("tracker",): {"scenario", "table of numbers"},
    ("new", "scenario", "mine", "--like"): {"scenario"},
    ("compare", "ten_to_one", "--marks"): {"study", "table of numbers"},
    ("demo", "ten_to_one", "--no-open", "--marks"): {"study", "table of numbers"},
    ("map",): {"map"},
    ("look",): {"study", "table of numbers"},
    ("identify",): {"study"},
    ("track",): {"film"},
    ("new", "study"): {"table of numbers", "film"},
}
"""Beginning of a command that takes a file -> kinds of files that it takes."""
WITHOUT_FILE = {"engines", "conformance", "init", "demonstrations"}
REFUSED = [(command, kind) for command, taken in TAKEN.items() for kind in FILES if kind not in taken]


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.values():
        Path(name).write_text(text)


def test_kinds_are_told_by_name_and_content(files):
    assert {kind: kind_of(Path(name)) for kind, (name, _) in FILES.items()} == {kind: kind for kind in FILES}
    assert kind_of(Path("ten_to_one")) is None


@pytest.mark.parametrize(("command", "kind"), REFUSED, ids=lambda part: part if isinstance(part, str) else " ".join(part))
def test_another_commands_file_is_named_with_its_command(files, command, kind):
    name = FILES[kind][0]
    done = here(*command, name)
    assert done.returncode == 2
    assert done.stdout == ""
    line = done.stderr.rstrip("\n")
    assert "\n" not in line
    assert line.startswith(f"error: {name}: found a {kind}, needed a ")
    program, *words = shlex.split(line.partition("write: ")[2])
    assert program == "looping-pendulum"
    assert words == [*COMMANDS[kind].split(), name]  # a blank in a file's name is quoted
    assert kind in TAKEN[tuple(words[:-1])]


def test_no_command_is_left_out():
    group = typer.main.get_command(app)
    assert {command[0] for command in TAKEN} | WITHOUT_FILE == set(group.commands)


PIPES = {"scenario": "pipe.yaml", "map": "pipe.yaml", "study": "pipe.yaml", "table of numbers": "pipe.csv", "film": "pipe.mp4"}
OF_PIPES = [(command, PIPES[kind]) for command, kinds in TAKEN.items() for kind in sorted(kinds)]
OF_PIPES.remove((("new", "study"), PIPES["film"]))  # a film that is not tracked yet is not opened
OF_PIPES += [
    (("compare", "ten_to_one", "--baseline"), "pipe.yaml"),
    (("look",), "of_a_pipe.yaml"),
    (("identify",), "of_a_pipe.yaml"),
]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with names")
@pytest.mark.parametrize(("command", "name"), OF_PIPES, ids=lambda part: part if isinstance(part, str) else " ".join(part))
def test_a_pipe_is_refused_and_not_waited_for(command, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for pipe in set(PIPES.values()):
        os.mkfifo(pipe)
    Path("of_a_pipe.yaml").write_text(
        "title: x\napparatus: {light: {mass: 10 g}, heavy: {mass: 100 g}, rod: {radius: 6 mm}}\n"
        "trials: [{file: pipe.csv, release: {angle: 112 deg, free_length: 58 cm}}]\n"
    )
    signal.alarm(60)
    try:
        done = here(*command, name)
    finally:
        signal.alarm(0)
    assert done.returncode == 2
    assert "found a pipe or a device, needed " in done.stderr
