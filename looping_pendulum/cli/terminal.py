"""Print lines, tables and progress on a terminal. Commands print through this file alone.

Names, messages and file contents come from strangers: control characters, which may colour or hide what stands on a terminal,
and bidirectional ones, which may reorder it, are shown as escapes.

What a command prints has three kinds: results (`say`, `show_table`) on standard output, notes and progress (`note`,
`ProgressBars`) on standard error, and errors (`say` with ``err``), too. The options --json and --quiet choose among them.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

from looping_pendulum.errors import printable

if TYPE_CHECKING:
    from looping_pendulum.engines.trajectory import Trajectory


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


def show_table(head: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Print a table whose cells are plain text: "[mm]" and "[/x]" are no markup.

    Outside a terminal it is 200 columns wide, so that lines do not wrap.
    """
    if not output.shows_text:
        return
    # Imported on use, as rich is slow to import
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for column in head:
        table.add_column(Text(printable(column)), overflow="fold")
    for row in rows:
        table.add_row(*(Text(printable(str(cell))) for cell in row))
    console = Console()
    if not console.is_terminal:
        console = Console(width=200)
    console.print(table)


@dataclass(kw_only=True)
class ProgressBars:
    """A bar per task on a terminal; elsewhere lines of text now and then, or nothing."""

    time_left: bool = False
    """Whether to estimate the time that is left: of use where work is spread evenly over the task."""
    keep: bool = False
    """Whether the bars stay on the terminal at the end."""
    line_every_fraction: float = math.inf
    """Without a terminal, a line is printed whenever the task has advanced by this fraction."""
    line_every_seconds: float = math.inf
    """Without a terminal, a line is printed after this time [s], and one at the end."""

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
        self._line_fraction = 0.0
        self._line_time = time.monotonic()
        self._bar.start()
        return self

    def __exit__(self, *exception: Any) -> None:
        self._bar.stop()

    def update(self, description: str, fraction: float, *, task: str = "", line: str = "") -> None:
        """Show that ``fraction`` of a task is complete.

        Parameters
        ----------
        description
            What is being done, beside the bar.
        task
            Which bar; the first update of a task adds one.
        line
            Text of the line without a terminal; default: percentage and description.
        """
        if task in self._tasks:
            self._bar.update(self._tasks[task], completed=fraction, description=printable(description))
        else:
            # Not add and then update: rich would count a fraction that was complete before for the speed. It annotates an int.
            self._tasks[task] = self._bar.add_task(printable(description), total=1.0, completed=fraction)  # type: ignore[arg-type]
        due = fraction >= self._line_fraction + self.line_every_fraction
        if math.isfinite(self.line_every_seconds):
            due = due or fraction >= 1 or time.monotonic() >= self._line_time + self.line_every_seconds
        if due and not self.on_terminal:
            self._line_fraction, self._line_time = fraction, time.monotonic()
            note(line or f"{100 * fraction:.0f} %: {description}")

    def update_engine(self, engine: Any, fraction: float) -> None:
        """Show that ``fraction`` of the run of ``engine`` is complete, on a bar of its own."""
        from looping_pendulum.engines.registry import label

        name = label(engine)
        self.update(name, fraction, task=name)

    def show_finished_run(self, run: Trajectory) -> None:
        """Print a line for a run that has ended, where no bar shows it."""
        if not self.on_terminal:
            # A run that was stopped from outside has no times: they are NaN, which does not equal itself.
            cost = f" ({run.cpu_time:.1f} s of CPU time)" if run.cpu_time == run.cpu_time else ""
            note(f"{run.label}: {run.status.value}{cost}")


def convergence_bars() -> ProgressBars:
    """Return the display of a study of convergence: one bar with the time left, or a line for every tenth of the work."""
    return ProgressBars(time_left=True, line_every_fraction=0.1)
