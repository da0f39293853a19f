"""What several commands share: their options, and how a run of engines ends."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from looping_pendulum.cli.progress import EngineBars
from looping_pendulum.cli.terminal import say

if TYPE_CHECKING:
    from looping_pendulum.compare.result import ComparisonResult
    from looping_pendulum.engines.trajectory import Trajectory
    from looping_pendulum.scenarios.scenario import Scenario

OUTSIDE, BAD_INPUT, INTERRUPTED = 1, 2, 130
BESIDE = "interrupted"
"""Folder of an interrupted report, below that of a complete one."""


class ProfileChoice(StrEnum):
    """How much a run may cost; the values of `engines.protocol.Profile`, which is too heavy to import for --help."""

    QUICK = "quick"
    ACCURATE = "accurate"


ScenarioName = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="Name of a shipped scenario (see `scenarios`), or path of a YAML file.")
]
EngineNames = Annotated[
    list[str] | None,
    typer.Option("--engine", "-e", metavar="NAME", help="Only this engine (pymunk) or variant (mujoco:capstan); repeatable."),
]
ProfileName = Annotated[ProfileChoice, typer.Option("--profile", "-p", help="quick: seconds to a minute. accurate: minutes.")]
TimeLimit = Annotated[
    float, typer.Option(metavar="SECONDS", min=0.1, help="Stop an engine's run after this long; keep what it has.")
]
MemoryLimit = Annotated[
    str, typer.Option(metavar="AMOUNT", help="Stop an engine's run that holds more than this; keep what it has.")
]
MOST_JOBS = 1024
"""More runs at once than any one machine has cores."""
Jobs = Annotated[int | None, typer.Option(metavar="N", min=1, max=MOST_JOBS, help="Runs at once; default: one per core.")]
DataFolder = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="Folder with measured tables (paper/...); also $LOOPING_PENDULUM_DATA."),
]


def load_scenario(name: str) -> Scenario:
    """Load a shipped scenario or a file."""
    from looping_pendulum.scenarios import loader

    return loader.load(name)


def run_and_compare(
    scenario: Scenario,
    engine: list[str] | None,
    profile: ProfileChoice,
    *,
    data: Path | None = None,
    time_limit: float,
    memory_limit: str,
    jobs: int | None,
) -> ComparisonResult:
    """Run engines on ``scenario`` with their progress shown, and compare them."""
    from looping_pendulum.compare.harness import compare_engines
    from looping_pendulum.engines.memory import parse_memory

    most = parse_memory(memory_limit)
    with EngineBars() as progress:
        return compare_engines(
            scenario,
            engines=engine or (),
            profile=profile.value,
            data_folder=data,
            jobs=jobs,
            time_limit=time_limit,
            memory_limit=most,
            progress=progress.update,
            finished=progress.finished,
        )


COMPARE_FILES, COMPARE_FOLDERS = ("result.json", "report.md", "report.html"), ("figures", "trajectories")
"""What `compare.write` leaves in a folder."""


def beside_complete(folder: Path, file: str, *, interrupted: bool, cut_short: Callable[[Any], bool]) -> Path:
    """Return where a report goes: in ``folder``, but an interrupted one beside a complete one that is there, not over it.

    Parameters
    ----------
    file
        Which file of the folder says whether the report there is complete.
    cut_short
        Whether that file's content is of an interrupted run.
    """
    if not interrupted:
        return folder
    try:
        kept = not cut_short(json.loads((folder / file).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, KeyError, RecursionError):  # nothing, or nothing worth keeping
        kept = False
    if not kept:
        return folder
    say(f"interrupted: the complete report in {folder} is kept; this one goes into {folder / BESIDE}", err=True)
    return folder / BESIDE


def beside_complete_comparison(folder: Path, result: ComparisonResult) -> Path:
    """As `beside_complete`, for what `compare.write` leaves."""

    def interrupted(statuses: Iterable[str]) -> bool:
        return "INTERRUPTED" in statuses

    return beside_complete(
        folder,
        "result.json",
        interrupted=interrupted(e.status for e in result.engines),
        cut_short=lambda found: interrupted(e["status"] for e in found["engines"]),
    )


def exit_for(runs: list[Trajectory], *, within: bool | None = None) -> None:
    """Leave with the status that the runs deserve."""
    from looping_pendulum.engines.trajectory import RunStatus

    statuses = {run.status for run in runs}
    if RunStatus.INTERRUPTED in statuses:
        raise typer.Exit(INTERRUPTED)
    if within is None:
        gaps = {RunStatus.MISSING, RunStatus.UNSUPPORTED}
        within = all(status.ok or status in gaps for status in statuses)
    raise typer.Exit(0 if within else OUTSIDE)


def show_output_of_failed(runs: list[Trajectory]) -> None:
    """Show the last lines that a failed engine printed."""
    for run in runs:
        if not run.status.ok and run.output.strip():
            say(f"{run.label} printed:", err=True)
            for line in run.output.strip().splitlines()[-8:]:
                say(f"    {line}", err=True)
