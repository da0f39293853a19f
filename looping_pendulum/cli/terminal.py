"""Print lines, tables and progress on a terminal. Commands print through this file alone.

Names, messages and file contents come from strangers: control characters, which may colour or hide what stands on a terminal,
and bidirectional ones, which may reorder it, are shown as escapes.

What a command prints has three kinds: results (`say`, `say_prose`, `show_table`) on standard output, notes and progress
(`note`, `ProgressBars`) on standard error, and errors (`say` with ``err``), too. The options --json and --quiet choose among
them.
"""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

from looping_pendulum.errors import printable

if TYPE_CHECKING:
    from looping_pendulum.runs.trajectory import Trajectory


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

LINE_EVERY = 10.0
"""Time between two lines on what is done, where no bar shows it [s]."""
WIDTH_OUTSIDE_TERMINAL = 200
"""Width of a table that goes into a file or another program [characters]."""
BETWEEN_COLUMNS = 3
"""Blanks between two columns of rich's SIMPLE_HEAD [characters]."""
MIN_TEXT_WIDTH = 20
"""Width at which a column of sentences is still readable [characters]."""
NO_BREAK_SPACE = "\u00a0"
"""Stands inside what a line does not end in."""


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


def say(text: str, *, err: bool = False) -> None:
    """Print ``text``, of one or several lines: a result, or with ``err`` an error."""
    if err or output.shows_text:
        typer.echo(printable(text), err=err)


def say_prose(text: str, indent: int = 0) -> None:
    """Print sentences, with lines broken at blanks on a terminal; not for a command, which a break would spoil for pasting.

    Parameters
    ----------
    indent
        Blanks before each further line; those of an entry of a list are the list's own.
    """
    if not sys.stdout.isatty():
        say(text)
        return
    further = "  " if text.startswith("- ") else " " * indent
    width = shutil.get_terminal_size().columns
    say(textwrap.fill(text, width, subsequent_indent=further, break_long_words=False, break_on_hyphens=False))


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


def show_table(head: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Print a table whose cells are plain text: "[mm]" and "[/x]" are no markup.

    Where it is wider than the terminal, its columns go on below, each part beginning with the first columns, as many as tell
    the rows apart. Outside a terminal a part is up to 200 columns wide.
    """
    if not output.shows_text:
        return
    # Imported on use, as rich is slow to import
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    if not console.is_terminal:
        console = Console(width=WIDTH_OUTSIDE_TERMINAL)
    cells = [[printable(str(cell)) for cell in row] for row in (head, *rows)]
    for part in _parts(cells, console.width):
        table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
        titles, *body = part
        for title in titles:
            table.add_column(Text(title), overflow="fold")
        for row in body:
            table.add_row(*map(Text, row))
        console.print()
        console.print(table)
    console.print()


def _parts(cells: Sequence[Sequence[str]], width: int) -> Iterator[list[list[str]]]:
    """Yield tables that are at most ``width`` characters wide, with the cells' lines broken at blanks alone.

    Parameters
    ----------
    cells
        Rows of equal length, the head first.
    """
    columns = [list(column) for column in zip(*cells, strict=True)]
    narrow = [_narrow_width(column) for column in columns]
    # What all parts begin with: a part without the engine's name would not say whose outcome it is
    counts = (n for n in range(1, len(columns)) if len({tuple(row[:n]) for row in cells}) == len(cells))
    count = next((n for n in counts if _table_width(narrow, range(n + 1)) <= width), 1)
    first = list(range(count))
    parts: list[list[int]] = []
    for i in range(count, len(columns)):
        if not parts or _table_width(narrow, [*first, *parts[-1], i]) > width:
            parts.append([])
        parts[-1].append(i)
    for part in parts or [[]]:
        shown = [*first, *part]
        widths = {i: narrow[i] for i in shown}
        # What is left of the width goes to the columns that need it most, a character at a time
        natural = {i: max(map(len, columns[i])) for i in shown}
        for _ in range(width - _table_width(narrow, shown)):
            widths[max(shown, key=lambda i: natural[i] - widths[i])] += 1
        wrapped = [[_wrapped(cell, widths[i]) for cell in columns[i]] for i in shown]
        yield [list(row) for row in zip(*wrapped, strict=True)]


def _table_width(widths: Sequence[int], columns: Sequence[int]) -> int:
    return sum(widths[i] for i in columns) + BETWEEN_COLUMNS * (len(columns) - 1)


def _narrow_width(column: Sequence[str]) -> int:
    """Return the least width [characters] that shows every word, number with its unit, and sentence of a column."""
    title, *cells = column
    words = [word for cell in column for word in _unbroken(cell).split(" ")]
    sentence = min(max(map(len, cells), default=0), MIN_TEXT_WIDTH)
    return max(1, sentence, *map(len, words))


def _wrapped(cell: str, width: int) -> str:
    lines = textwrap.wrap(_unbroken(cell), width, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines).replace(NO_BREAK_SPACE, " ")


def _unbroken(text: str) -> str:
    """Return ``text`` with no-break spaces inside units in brackets, "[s per s]", and between a number and what it counts."""
    text = re.sub(r"\[[^\[\]]*\]", lambda unit: unit.group().replace(" ", NO_BREAK_SPACE), text)
    return re.sub(r"(?<=\d) (?=[^\W\d])", NO_BREAK_SPACE, text)


@dataclass(kw_only=True)
class ProgressBars:
    """A bar per task on a terminal; elsewhere a line every `LINE_EVERY`, and one at the end."""

    time_left: bool = False
    """Whether to estimate the time that is left: of use where work is spread evenly over the task."""
    keep: bool = False
    """Whether the bars stay on the terminal at the end."""

    def __enter__(self) -> ProgressBars:
        # rich is imported here, as it would double the time that --help takes
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        console = Console(stderr=True)
        self.on_terminal = console.is_terminal and not output.quiet
        columns: list[Any] = [BarColumn(), TaskProgressColumn(), TimeElapsedColumn()]
        if self.time_left:
            columns += [TextColumn("left:"), TimeRemainingColumn()]
        self._bar = Progress(
            *columns,
            TextColumn("{task.description}", markup=False),
            console=console,
            transient=not self.keep,
            disable=not self.on_terminal,
            speed_estimate_period=120.0,  # [s]; longer than the default of 30 s, as a single run may take minutes
        )
        self._tasks: dict[str, Any] = {}
        self._line_time = time.monotonic()
        self._bar.start()
        return self

    def __exit__(self, *exception: Any) -> None:
        self._bar.stop()

    def update(self, description: str, fraction: float, *, line: str = "") -> None:
        """Show that ``fraction`` of the work is complete.

        Parameters
        ----------
        description
            What is being done, beside the bar.
        line
            Text of the line without a terminal; default: percentage and description.
        """
        self._show("", description, fraction)
        now = time.monotonic()
        if not self.on_terminal and (fraction >= 1 or now >= self._line_time + LINE_EVERY):
            self._line_time = now
            note(line or f"{100 * fraction:.0f} %: {description}")

    def update_engine(self, engine: Any, fraction: float) -> None:
        """Show that ``fraction`` of the run of ``engine`` is complete, on a bar of its own."""
        from looping_pendulum.engines.registry import label

        self._show(label(engine), label(engine), fraction)

    def _show(self, task: str, description: str, fraction: float) -> None:
        if task in self._tasks:
            self._bar.update(self._tasks[task], completed=fraction, description=printable(description))
        else:
            # Not add and then update: rich would count a fraction that was complete before for the speed. It annotates an int.
            self._tasks[task] = self._bar.add_task(printable(description), total=1.0, completed=fraction)  # type: ignore[arg-type]

    def show_finished_run(self, run: Trajectory) -> None:
        """Print a line for a run that has ended, where no bar shows it."""
        if not self.on_terminal:
            # A run that was stopped from outside has no times: they are NaN, which does not equal itself.
            cost = f" ({run.cpu_time:.1f} s of CPU time)" if run.cpu_time == run.cpu_time else ""
            note(f"{run.label}: {run.status.value}{cost}")
