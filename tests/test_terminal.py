"""What a terminal gets: names and messages of strangers as plain text, whatever characters they have."""

import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from looping_pendulum.cli import terminal as cli_terminal
from looping_pendulum.cli.terminal import ProgressBars, say, say_file, show_table
from tests.command_line import here

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


def test_bars_show_descriptions_as_plain_text(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich then takes the stream for a terminal
    monkeypatch.setenv("COLUMNS", "200")
    with ProgressBars() as bars:
        bars.update(HOSTILE, 0.5)
        bars._bar.refresh()
    err = capsys.readouterr().err
    assert "[/x][red]\\x1b[2J" in err
    assert "\u202e" not in err
    assert "\x1b[2J" not in err


def test_without_a_terminal_there_is_a_line_every_ten_seconds_and_at_the_end(capsys, monkeypatch):
    seconds = iter([0.0, *(2.0 * k for k in range(13))])
    monkeypatch.setattr(cli_terminal, "time", SimpleNamespace(monotonic=lambda: next(seconds)))
    with ProgressBars() as bars:
        for k in range(13):
            bars.update("runs", k / 12)
    assert capsys.readouterr().err.splitlines() == ["42 %: runs", "83 %: runs", "100 %: runs"]


def test_no_command_prints_past_this_place():
    package = Path(cli_terminal.__file__).parent
    others = [path for path in package.glob("*.py") if path.name != "terminal.py"]
    assert len(others) > 5
    for path in others:
        text = path.read_text()
        assert "echo(" not in text, path.name
        assert " print(" not in text, path.name


TABLES = (
    ("scenarios",),
    ("map",),
    ("engines",),
    ("engines", "--support"),
    ("run", "static_friction"),
    ("check", "ten_to_one", "--engine", "mujoco:capstan"),
    ("compare", "ten_to_one", "--engine", "mujoco:capstan", "--engine", "mujoco:documented"),
)


@pytest.mark.parametrize("command", TABLES, ids=" ".join)
@pytest.mark.parametrize("width", [80, 100, 200])
def test_no_table_cuts_a_word_or_a_number(command, width, monkeypatch, tmp_path):
    tables = []

    def laid_out(cells, width):
        tables.append(cells)
        return parts(cells, width)

    parts = cli_terminal._parts
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli_terminal, "_parts", laid_out)
    monkeypatch.setattr(cli_terminal, "WIDTH_OUTSIDE_TERMINAL", width)
    lines = here(*command).stdout.splitlines()
    assert tables
    printed = {word for line in lines for word in line.split()}
    cells = [cell for table in tables for row in table for cell in row]
    assert {word for cell in cells for word in cell.split()} <= printed
    text = "\n".join(lines)
    for cell in cells:
        for number_with_unit in re.findall(r"\d [^\W\d]+|\[[^\]]+\]", cell):
            assert number_with_unit in text
    ruled = [line for line in lines if set(line.strip()) == {"─"}]
    assert ruled
    assert all(len(line) <= width for line in ruled)


@pytest.mark.parametrize(
    ("cells", "width", "parts"),
    [
        ([["engine", "error"], ["mujoco", "0.1"]], 80, [(0, 1)]),
        ([["engine", "first", "second"], ["mujoco", "1" * 20, "2" * 20]], 40, [(0, 1), (0, 2)]),
        # Of a check's outcomes below, each began with the scenario alone, which all had
        (
            [["scenario", "engine", "value", "outcome"], *(["drop", engine, "1" * 12, "2" * 12] for engine in ("a", "b"))],
            40,
            [(0, 1, 2), (0, 1, 3)],
        ),
    ],
)
def test_columns_that_do_not_fit_follow_below_with_those_that_tell_the_rows_apart(capsys, monkeypatch, cells, width, parts):
    monkeypatch.setattr(cli_terminal, "WIDTH_OUTSIDE_TERMINAL", width)
    show_table(cells[0], cells[1:])
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [line for line in lines if line and set(line[0]) != {"─"}] == [
        [row[i] for i in part] for part in parts for row in cells
    ]
