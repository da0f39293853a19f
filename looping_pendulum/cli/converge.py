"""The command `converge`: what an engine's error consists of."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Annotated, Any

import typer

from looping_pendulum.cli.common import (
    INTERRUPTED,
    Jobs,
    MemoryLimit,
    ProfileChoice,
    ProfileName,
    TimeLimit,
    beside_complete,
    load_scenario,
)
from looping_pendulum.cli.terminal import new_table, say, show_table
from looping_pendulum.errors import printable


class StudyBar:
    """One bar with the time that is left on a terminal; else a line for every tenth of the work."""

    def __enter__(self) -> StudyBar:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        console = Console(stderr=True)
        self._shown = 0.0
        self._live = console.is_terminal
        columns = (BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TextColumn("left:"), TimeRemainingColumn())
        self._bar = Progress(
            *columns, TextColumn("{task.description}", markup=False), console=console, transient=True, disable=not self._live
        )
        self._task = self._bar.add_task("starting", total=1.0)
        self._bar.start()
        return self

    def __exit__(self, *exception: Any) -> None:
        self._bar.stop()

    def update(self, share: float, what: str) -> None:
        """Show the share that is done, and what goes on."""
        self._bar.update(self._task, completed=share, description=printable(what))
        if not self._live and share >= self._shown + 0.1:
            self._shown = share
            say(f"{100 * share:.0f} %: {what}", err=True)


def converge(
    scenario: Annotated[
        str, typer.Argument(metavar="[SCENARIO]", help="Shipped scenario, or path of a YAML file.")
    ] = "ten_to_one",
    engine: Annotated[
        list[str] | None,
        typer.Option("--engine", "-e", metavar="NAME", help="Engine, variant, or all; repeatable. Default: the main variants."),
    ] = None,
    profile: ProfileName = ProfileChoice.QUICK,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where the report goes and runs are kept; default: report/SCENARIO-converge."),
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS", min=0.01, help="Watch runs for so long; default: to 0.1 s after the halt, at least 0.7 s."
        ),
    ] = None,
    budget: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", min=0.1, help="Leave out runs that are expected to take longer than this."),
    ] = None,
    time_limit: TimeLimit = 3600.0,
    memory_limit: MemoryLimit = "2 GiB",
    jobs: Jobs = None,
) -> None:
    """Split each engine's error into not converged, different model and adapter's choice.

    Refines every setting that a variant offers, changes the start a little, puts the engine's defaults back one at a time.
    Writes convergence.md, convergence.json and a figure per setting. Ended runs are kept in DIR: after Ctrl-C the same command
    goes on where it was, and reports what there is.

    looping-pendulum converge ten_to_one --engine mujoco:capstan --budget 60
    """
    from looping_pendulum.compare.convergence.report import halting_verdict
    from looping_pendulum.compare.convergence.result import FILE
    from looping_pendulum.compare.convergence.study import study_convergence, write
    from looping_pendulum.compare.harness import chosen_engines
    from looping_pendulum.compare.tables import number
    from looping_pendulum.engines.memory import parse_memory
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.files import ready_folder

    chosen = load_scenario(scenario)
    engines = chosen_engines(engine or (), Profile(profile.value))
    folder = out or Path("report") / f"{chosen.name}-converge"
    ready_folder(folder, files=("convergence.md", FILE), folders=("figures",))  # before the work, not after it
    with StudyBar() as progress:
        result = study_convergence(
            chosen,
            engines,
            folder,
            until=until,
            budget=budget,
            jobs=jobs,
            time_limit=time_limit,
            memory_limit=parse_memory(memory_limit),
            progress=progress.update,
        )
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # what was found is written whole
    try:
        folder = beside_complete(folder, FILE, interrupted=result.interrupted, cut_short=lambda found: found["interrupted"])
        written = write(result, folder)
    finally:
        signal.signal(signal.SIGINT, before)
    table = new_table(
        "variant", "quantity", "error", "not converged", "different model", "+/-", "choice", "spread", "larger part"
    )
    for v in result.variants:
        for s in v.splits:
            parts = (s.error, s.numerics, s.model, s.numerics_uncertainty, s.choice, s.spread)
            cells = [number(x, 1e3, 2) for x in parts]
            table.add_row(v.label, f"{s.quantity} [m{s.unit}]", *cells, ", then ".join(c.value for c in s.causes))
    show_table(table)
    for v in result.variants:
        say(f"- {v.label}: halting time converges: {halting_verdict(v)}")
    say(f"wrote {written}")
    if result.interrupted:
        raise typer.Exit(INTERRUPTED)
