"""Help as people type it, and hints that can be pasted: quoted, and with options that there are."""

import re
import shlex
import sys

import pytest
import typer

from looping_pendulum.cli.main import app
from looping_pendulum.errors import MissingPackageError
from looping_pendulum.film import decode
from looping_pendulum.installation import install_command
from tests.command_line import here

GROUP = typer.main.get_command(app)
COMMANDS = sorted([(name,) for name in GROUP.commands] + [("new", name) for name in GROUP.commands["new"].commands])


@pytest.mark.parametrize("command", [(), *COMMANDS], ids=" ".join)
def test_help_has_two_names_a_usage_to_type_and_whole_examples(command, monkeypatch):
    done, same = here(*command, "-h"), here(*command, "--help")
    assert done == same
    assert done.returncode == 0
    usage = done.stdout.splitlines()[0]
    assert usage.startswith(" ".join(["Usage: looping-pendulum", *command, "[OPTIONS]"]))
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


def test_packages_that_read_films_are_installed_as_this_one_was(monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingPackageError) as caught:
        decode.decoding()
    assert f"to get it: `{install_command('opencv-python-headless', 'av')}`" in str(caught.value)


@pytest.mark.parametrize("command", [("init", "folder"), ("new", "scenario", "mine")], ids=" ".join)
def test_where_nothing_can_be_written_no_option_is_named_that_there_is_not(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied", "folder")

    monkeypatch.setattr("os.open", refuse)
    error = here(*command).stderr
    monkeypatch.undo()
    assert error == "error: folder: Permission denied; write to a folder that is yours and has room\n"
