"""The commands `map` and `maps`: many runs over one to three quantities."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from looping_pendulum.cli.common import INTERRUPTED, Jobs, MemoryLimit, TimeLimit
from looping_pendulum.cli.terminal import new_table, say, say_file, show_table

if TYPE_CHECKING:
    from looping_pendulum.sweep.plan import MapPlan

SPEAK_EVERY = 10.0
"""Without a terminal, a line of progress at most this often [s]."""


class RunBar:
    """Runs done, rate and time left: a bar on a terminal, else a line now and then."""

    def __enter__(self) -> RunBar:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        console = Console(stderr=True)
        self._live = console.is_terminal
        columns = (BarColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn(), TextColumn("left:"))
        self._bar = Progress(
            *columns,
            TimeRemainingColumn(elapsed_when_finished=True),
            console=console,
            transient=True,
            disable=not self._live,
            speed_estimate_period=120.0,
        )
        self._task: Any = None
        self._bar.start()
        return self

    def __exit__(self, *exception: Any) -> None:
        self._bar.stop()

    def update(self, done: int, runs: int) -> None:
        """Show that ``done`` of all ``runs`` are there."""
        from looping_pendulum.pages.numbers import amount

        now = time.monotonic()
        if self._task is None:
            self._task = self._bar.add_task("starting", total=runs, completed=done)
            self._first = (now, done)
            self._spoke = now
            if done:
                say(f"{done} of {runs} runs are there already", err=True)
            return
        rate = (done - self._first[1]) / max(now - self._first[0], 1e-9)
        left = (runs - done) / rate
        said = f"{done} of {runs} runs, {amount(rate)} runs/s"
        self._bar.update(self._task, completed=done, description=said)
        if not self._live and (now >= self._spoke + SPEAK_EVERY or done == runs):
            self._spoke = now
            say(f"{said}, {_duration(left)} left" if left else said, err=True)


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"


def maps(
    name: Annotated[str | None, typer.Argument(metavar="[MAP]", help="Print this map's YAML.")] = None,
) -> None:
    """List the shipped maps, or print one.

    To write your own:  looping-pendulum maps angle_and_ratio > mine.yaml
    """
    from looping_pendulum.sweep import map_file

    if name is not None:
        say_file(map_file.source_text(name))
    else:
        _list_maps()


def _list_maps() -> None:
    from looping_pendulum.sweep import map_file

    table = new_table("map", "runs", "over", "title")
    for shipped in map_file.shipped():
        plan = map_file.load(shipped)
        over = ", ".join(axis.name for axis in plan.design.axes)
        table.add_row(shipped, str(plan.runs), over, plan.title)
    show_table(table)


def map_(
    file: Annotated[
        str | None, typer.Argument(metavar="[MAP.yaml]", help="Map file, or name of a shipped map. None: list these.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Where the map goes; default: report/MAP-map.")] = None,
    jobs: Jobs = None,
    cluster: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Run on the workers of this Dask scheduler instead.")
    ] = None,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Whether to draw.")] = True,
    max_runs: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Refuse a map of more runs; default: 20 million, 20 000 of engines.")
    ] = None,
    time_limit: TimeLimit = 900.0,
    memory_limit: MemoryLimit = "2 GiB",
) -> None:
    """Run one scenario again and again over one to three quantities, and map how each run ends.

    Writes DIR/map.zarr (xarray opens it), map.md and figures. Interrupted or killed at any moment, the same command goes on
    where it was and ends with the same bytes.

    looping-pendulum map quick --out report/quick-map
    """
    from looping_pendulum.compare.landmarks import run_landmarks
    from looping_pendulum.engines.memory import parse_memory
    from looping_pendulum.files import ready_folder
    from looping_pendulum.sweep import executors, map_file, report, runner
    from looping_pendulum.sweep.store import STORE

    if file is None:
        _list_maps()
        return
    if cluster is not None:
        executors.check_address(cluster)
    plan = map_file.load(file)
    map_file.refuse_typo(plan, max_runs)
    most_memory = parse_memory(memory_limit)
    folder = out or Path("report") / f"{plan.name}-map"
    if folder.exists():
        ready_folder(folder, files=(report.REPORT, report.COPY), folders=(STORE,))  # before the work, not after it
    _say_size(plan)
    with RunBar() as progress:
        outcome = runner.run_map(
            plan,
            folder,
            jobs=jobs,
            cluster=cluster,
            figures=figures,
            time_limit=time_limit,
            memory_limit=most_memory,
            read_moments=run_landmarks,
            progress=progress.update,
        )
    if outcome.interrupted:
        message = (
            f"interrupted: {outcome.done} of {outcome.runs} runs are kept in {folder}; the same command goes on from there"
        )
        say(message, err=True)
        raise typer.Exit(INTERRUPTED)
    for one in outcome.summaries:
        say(report.verdict(one, several=plan.several))
    say(f"wrote {folder / report.REPORT} and {folder / STORE}")


def _say_size(plan: MapPlan) -> None:
    """State the size before anything starts."""
    from looping_pendulum.pages.numbers import amount
    from looping_pendulum.sweep.store import BYTES_PER_RUN

    sizes = " x ".join(f"{size}" for size in plan.design.shape)
    engines = f" x {len(plan.engines)} engines" if len(plan.engines) > 1 else ""
    over = ", ".join(axis.name for axis in plan.design.axes)
    megabytes = plan.runs * BYTES_PER_RUN / 1e6
    said = f"{plan.runs} runs ({sizes}{engines}: {over}) in {plan.units} chunks, at most {amount(megabytes)} MB"
    say(said, err=True)
    sys.stderr.flush()
