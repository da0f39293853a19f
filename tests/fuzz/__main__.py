"""The command ``python -m tests.fuzz``."""

import faulthandler
import resource
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from looping_pendulum.cli.terminal import show_table
from tests.fuzz.judging import WALL_LIMIT, Outcome
from tests.fuzz.kinds import KINDS
from tests.fuzz.session import Tally, fuzz

MOST_MEMORY = 6 * 1024**3
"""[bytes]; an input that asks for more gets a MemoryError, which is a fault, instead of the machine."""


def shares(count: int, names: list[str]) -> dict[str, int]:
    """Split ``count`` inputs evenly among the kinds."""
    return {name: count // len(names) + (i < count % len(names)) for i, name in enumerate(names)}


def main(
    count: Annotated[int, typer.Option(metavar="N", min=1, help="Inputs of all kinds together.")] = 20_000,
    seed: Annotated[int, typer.Option(metavar="N", help="Each input follows from it and from its number.")] = 0,
    only: Annotated[list[str] | None, typer.Option(metavar="KIND", help=f"Repeatable; of: {', '.join(KINDS)}.")] = None,
    failures: Annotated[Path, typer.Option(metavar="DIR", help="Where failing inputs go.")] = Path("fuzz-failures"),
) -> None:
    """Try damaged and hostile inputs. Exit status 1 if one ends in a traceback, or in no time at all."""
    unknown = [name for name in only or () if name not in KINDS]
    if unknown:
        raise typer.BadParameter(f"found {unknown[0]!r}, needed one of: {', '.join(KINDS)}", param_hint="--only")
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_MEMORY, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    names = only or list(KINDS)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    tallies: list[Tally] = []
    from rich.console import Console

    with Progress(*columns, console=Console(file=sys.__stderr__)) as bar:
        task = bar.add_task("starting", total=count)
        done = 0
        for name, share in shares(count, names).items():

            def show(tally: Tally, done: int = done) -> None:
                faults = f", {tally.faults} faults" if tally.faults else ""
                bar.update(task, completed=done + tally.tried, description=f"{tally.kind}{faults}")
                faulthandler.dump_traceback_later(4 * WALL_LIMIT, exit=True)  # what no signal interrupts

            tallies.append(fuzz(KINDS[name], share, seed=seed, failures=failures, report_progress=show))
            done += share
    faulthandler.cancel_dump_traceback_later()
    rows = [
        [tally.kind, tally.tried, *(tally.outcomes[outcome] for outcome in Outcome), f"{tally.seconds:.1f}"]
        for tally in tallies
    ]
    faults = sum(tally.faults for tally in tallies)
    totals = [sum(tally.outcomes[outcome] for tally in tallies) for outcome in Outcome]
    rows.append(["all", sum(totals), *totals, f"{sum(tally.seconds for tally in tallies):.1f}"])
    show_table(["kind", "tried", *Outcome, "wall [s]"], rows)
    for tally in tallies:
        for signature, times in tally.signatures.most_common():
            typer.echo(f"{tally.kind}: {times} x {signature}")
    if faults:
        typer.echo(f"the failing inputs are in {failures}")
    raise typer.Exit(1 if faults else 0)


if __name__ == "__main__":
    typer.run(main)
