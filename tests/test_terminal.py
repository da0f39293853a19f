"""What a terminal gets: names and messages of strangers as plain text, whatever characters they have."""

from pathlib import Path

import pytest

from looping_pendulum.cli import terminal as cli_terminal
from looping_pendulum.cli.terminal import ProgressBars, convergence_bars, say, say_file, show_table

HOSTILE = "[/x][red]\x1b[2J\u202e\u2066\x07\x9b1A\ud800"
"""rich's markup, an escape sequence, bidirectional controls, a bell, an 8-bit control sequence, half a character."""
SHOWN = "[/x][red]\\x1b[2J\\u202e\\u2066\\x07\\x9b1A\\ud800"


def test_lines_show_control_characters_as_escapes(capsys):
    say(f"a {HOSTILE}\n\tb")
    say(f"c {HOSTILE}", err=True)
    assert capsys.readouterr() == (f"a {SHOWN}\n\tb\n", f"c {SHOWN}\n")


def test_tables_show_markup_and_control_characters(capsys):
    show_table(["name [mm]", HOSTILE], [[HOSTILE, 3]])
    out = capsys.readouterr().out
    assert "name [mm]" in out
    assert out.count(SHOWN) == 2
    assert "\x1b" not in out


@pytest.mark.parametrize("is_terminal", [True, False])
def test_a_file_is_printed_unchanged_only_into_another(capsys, monkeypatch, is_terminal):
    monkeypatch.setattr(cli_terminal.sys.stdout, "isatty", lambda: is_terminal)
    say_file("title: \u202ex\n")
    assert capsys.readouterr().out == ("title: \\u202ex\n" if is_terminal else "title: \u202ex\n")


@pytest.mark.parametrize("make_bars", [ProgressBars, convergence_bars])
def test_bars_show_descriptions_as_plain_text(capsys, monkeypatch, make_bars):
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich then takes the stream for a terminal
    monkeypatch.setenv("COLUMNS", "200")
    with make_bars() as bars:
        bars.update(HOSTILE, 0.5)
        bars._bar.refresh()
    err = capsys.readouterr().err
    assert "[/x][red]\\x1b[2J" in err
    assert "\u202e" not in err
    assert "\x1b[2J" not in err


def test_without_a_terminal_a_tenth_of_the_work_is_a_line(capsys):
    with convergence_bars() as bars:
        for percent in range(0, 101, 4):
            bars.update("runs", percent / 100)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"{percent} %: runs" for percent in (12, 24, 36, 48, 60, 72, 84, 96)]


def test_no_command_prints_past_this_place():
    package = Path(cli_terminal.__file__).parent
    others = [path for path in package.glob("*.py") if path.name != "terminal.py"]
    assert len(others) > 5
    for path in others:
        text = path.read_text()
        assert "echo(" not in text, path.name
        assert " print(" not in text, path.name
