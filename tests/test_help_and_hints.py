"""Help as people type it, and hints that can be pasted: quoted, and with options that there are."""

import re
import shlex
import subprocess
import sys

import pytest
import typer

from looping_pendulum.cli.main import app
from looping_pendulum.cli.quantities import quantity
from looping_pendulum.installation import install_command
from tests.command_line import here

GROUP = typer.main.get_command(app)
COMMANDS = sorted([(name,) for name in GROUP.commands] + [("new", name) for name in GROUP.commands["new"].commands])


def command_called(words):
    command = GROUP
    for word in words:
        command = command.commands[word]
    return command


@pytest.mark.parametrize("command", [(), *COMMANDS], ids=" ".join)
def test_help_has_two_names_a_usage_to_type_and_whole_examples(command, monkeypatch):
    done, same = here(*command, "-h"), here(*command, "--help")
    assert done == same
    assert done.returncode == 0
    usage = done.stdout.splitlines()[0]
    assert " ".join([*command, "[OPTIONS]"]) in usage
    assert not re.search(r"[{}<>]|\[\[|\.\.\.\]\.\.\.", usage)
    assert "<list" not in done.stdout
    for line in done.stdout.splitlines():
        if line.strip().startswith("looping-pendulum "):
            shlex.split(line)  # an example that is broken in its quotes has no closing one


def test_next_commands_take_names_with_blanks(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    init = here("init", "Übung 1").stdout.splitlines()[-1]
    assert init.startswith(f"Next: cd {shlex.quote('Übung 1')}, and read README.md; it begins with: ")
    new = here("new", "scenario", "my rod").stdout.splitlines()[-1]
    assert shlex.split(new.removeprefix("next: ")) == ["looping-pendulum", "run", "my rod.yaml"]
    assert here("run", "my rod.yaml").returncode == 0


def test_packages_that_read_films_are_installed_as_this_one_was():
    code = "import sys; sys.modules['av'] = None; import looping_pendulum.measured.film.decode"
    error = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False).stderr
    assert "found no PyAV or no OpenCV (import of av" in error
    assert f"to get them: `{install_command('opencv-python-headless', 'av')}`" in error


@pytest.mark.parametrize("command", [("init", "folder"), ("new", "scenario", "mine")], ids=" ".join)
def test_where_nothing_can_be_written_no_option_is_named_that_there_is_not(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied", "folder")

    monkeypatch.setattr("os.open", refuse)
    error = here(*command).stderr
    monkeypatch.undo()
    assert error == "error: folder: Permission denied; write to a folder that is yours and has room\n"


TIMES_AND_RATES = [
    (*command, option.opts[0], option.metavar)
    for command in COMMANDS
    for option in command_called(command).params
    if option.metavar in ("TIME", "RATE")
]


@pytest.mark.parametrize("words", TIMES_AND_RATES, ids=" ".join)
def test_every_time_and_rate_says_what_it_needs(words):
    *command, option, metavar = words
    example = {"TIME": "90 s", "RATE": "240 Hz"}[metavar]
    for wrong in ("3,5 m", "soon"):
        done = here(*command, option, wrong)
        assert done.returncode == 2
        assert f"found '{wrong}', needed " in done.stderr
        assert re.search(rf"write for example '{example}'", done.stderr)


@pytest.mark.parametrize(
    ("unit", "text", "value"),
    [
        ("s", "90 s", 90.0),
        ("s", "1.5 min", 90.0),
        ("s", "90", 90.0),
        ("s", 9e2, 900.0),
        ("Hz", "0.24 kHz", 240.0),
        ("Hz", "240", 240.0),
        ("byte", "2GB", 2e9),
        ("byte", "0.5 GiB", 2**29),
        ("byte", "1e9 byte", 1e9),
    ],
)
def test_a_quantity_has_a_unit_or_is_in_the_usual_one(unit, text, value):
    assert quantity(unit, least=f"0 {unit}")(text) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("text", ["0.05 s", "-3", "nan", "inf", "3 m", "", "3,5 s"])
def test_no_other_time_is_taken(text):
    with pytest.raises(typer.BadParameter, match="needed a time of 0.1 s or more; write for example '90 s'"):
        quantity("s", least="0.1 s")(text)


@pytest.mark.parametrize("text", ["", "2", "2 m", "nan GiB", "1e999 B", "-2 GiB", "1 MiB", "2 GiB/0", "9**9**9 B", "(" * 5000])
def test_no_other_amount_of_memory_is_taken(text):
    with pytest.raises(typer.BadParameter, match="needed an amount of memory of 64 MiB or more; write for example '2 GiB'"):
        quantity("byte", least="64 MiB")(text)
