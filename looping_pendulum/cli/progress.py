"""Progress on a terminal: a bar per engine, or one bar that says what goes on."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

from looping_pendulum.cli.terminal import say
from looping_pendulum.errors import printable

if TYPE_CHECKING:
    from looping_pendulum.engines.trajectory import Trajectory


class EngineBars:
    """A bar per engine on a terminal; else a line as each run ends."""

    def __enter__(self) -> EngineBars:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        console = Console(stderr=True)
        self._tasks: dict[str, Any] = {}
        self._bars = None
        if console.is_terminal:
            columns = (TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
            self._bars = Progress(*columns, TimeRemainingColumn(), console=console)
        self._context = self._bars or nullcontext()
        self._context.__enter__()
        return self

    def __exit__(self, *exception: Any) -> None:
        self._context.__exit__(*exception)

    def update(self, engine: Any, share: float) -> None:
        """Show that ``share`` of the run of ``engine`` is done."""
        if self._bars is None:
            return
        name = f"{engine.name}:{engine.variant}"
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(printable(name), total=1.0)
        self._bars.update(self._tasks[name], completed=share)

    def finished(self, run: Trajectory) -> None:
        """Say that a run has ended."""
        if self._bars is None:
            took = f" ({run.wall_time:.1f} s)" if run.wall_time == run.wall_time else ""  # NaN: it never ended by itself
            say(f"{run.label}: {run.status.value}{took}", err=True)


class StageBar:
    """One bar on a terminal that says what goes on; else nothing."""

    def __enter__(self) -> StageBar:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        console = Console(stderr=True)
        columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
        self._bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._task = self._bar.add_task("reading", total=1.0)
        self._bar.start()
        return self

    def __exit__(self, *exception: Any) -> None:
        self._bar.stop()

    def update(self, what: str, share: float) -> None:
        """Show what goes on, and that ``share`` of the work is done."""
        self._bar.update(self._task, description=printable(what), completed=share)
