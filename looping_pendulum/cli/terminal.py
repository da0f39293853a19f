"""Print lines and tables of plain text on a terminal. Commands print through this file alone.

Names, messages and file contents come from strangers: control characters, which may colour or hide what stands on a terminal,
and bidirectional ones, which may reorder it, are shown as escapes.

What a command prints has three kinds: results (`say`, `show_table`) on standard output, notes and progress (`note`) on standard
error, and errors (`say` with ``err``), too. The options --json and --quiet choose among them, for all commands here.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import typer

from looping_pendulum.errors import printable


@dataclass(kw_only=True)
class OutputChoice:
    """What the command that runs prints; its options set it."""

    as_json: bool = False
    """Whether the results are one JSON document, instead of lines and tables."""
    quiet: bool = False
    """Whether notes and progress are left out, and results, too, unless they are JSON."""

    @property
    def shows_text(self) -> bool:
        """Return whether results are printed as lines and tables."""
        return not (self.as_json or self.quiet)


output = OutputChoice()
"""Choice of the command that runs; a process runs one command at a time."""


def reset_output() -> None:
    """Forget what an earlier command in this process chose."""
    output.as_json = output.quiet = False


def choose_json(wanted: bool) -> bool:
    """Print the results as JSON if it is ``wanted``; a callback of the option --json."""
    output.as_json = wanted
    return wanted


def choose_quiet(wanted: bool) -> bool:
    """Print errors only if it is ``wanted``; a callback of the option --quiet."""
    output.quiet = wanted
    return wanted


def say(text: str, *, err: bool = False, nl: bool = True) -> None:
    """Print ``text``, of one or several lines: a result, or with ``err`` an error."""
    if err or output.shows_text:
        typer.echo(printable(text), err=err, nl=nl)


def note(text: str) -> None:
    """Print a line on standard error that is neither a result nor an error: progress, or what else is good to know."""
    if not output.quiet:
        typer.echo(printable(text), err=True)


def show_json(results: Any) -> None:
    """Print the results as JSON if the user asked for that: dataclasses, enums and arrays as in result.json, in SI units."""
    if output.as_json:
        import json

        from looping_pendulum.compare.json_text import plain

        # Characters other than ASCII as escapes, so that any terminal and any pipe takes them
        typer.echo(json.dumps(plain(results), indent=2, allow_nan=False))


def say_file(text: str) -> None:
    """Print the text of a file: with escapes on a terminal, unchanged where the output is redirected into another file."""
    if output.shows_text:
        typer.echo(printable(text) if sys.stdout.isatty() else text, nl=False)


def new_table(*columns: str) -> Any:
    """Return an empty table for a terminal, whose cells are plain text: "[mm]" and "[/x]" are no markup."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    # Defined here, as rich, whose import is slow, is imported on use
    class PlainTable(Table):
        def add_row(self, *cells: Any, **options: Any) -> None:
            super().add_row(*(Text(printable(str(cell))) for cell in cells), **options)

    table = PlainTable(box=SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        table.add_column(Text(printable(column)), overflow="fold")
    return table


def show_table(table: Any) -> None:
    """Print a table that `new_table` returned; outside a terminal 200 columns wide, so that lines do not wrap."""
    if not output.shows_text:
        return
    from rich.console import Console

    console = Console()
    if not console.is_terminal:
        console = Console(width=200)
    console.print(table)
