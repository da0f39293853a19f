"""Print lines and tables of plain text on a terminal. Commands print through this file alone.

Names, messages and file contents come from strangers: control characters, which may colour or hide what stands on a terminal,
and bidirectional ones, which may reorder it, are shown as escapes.
"""

from __future__ import annotations

import sys
from typing import Any

import typer

from looping_pendulum.errors import printable


def say(text: str, *, err: bool = False, nl: bool = True) -> None:
    """Print ``text``, of one or several lines."""
    typer.echo(printable(text), err=err, nl=nl)


def say_file(text: str) -> None:
    """Print the text of a file: with escapes on a terminal, unchanged where the output is redirected into another file."""
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
    from rich.console import Console

    console = Console()
    if not console.is_terminal:
        console = Console(width=200)
    console.print(table)
