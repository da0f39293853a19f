"""Put faults into clean blind films: how many are put right or named, and to how many of them anything is added."""

import shutil
import tempfile
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Annotated

import typer

from looping_pendulum.cli.terminal import show_table
from tests.film_faults.faults import KINDS, NONE
from tests.film_faults.films import APPARATUS
from tests.film_faults.judging import MOVED_BY, Judgement, Outcome, judge

Task = tuple[int, str, Path, bool]
"""Number of a study, its kind of fault, its folder, and whether it is identified."""
SHOWN = 400
"""Longest message that is shown [characters]; the whole one is kept with the study."""


def tasks(count: int, seed: int, kinds: Sequence[str], folder: Path, *, with_identify: bool) -> list[list[Task]]:
    """Return all studies, those of one apparatus together, as its motions are simulated once."""
    groups: dict[int, list[Task]] = {}
    for i in range(count):
        number = 100_000 * seed + i
        kind = kinds[i % len(kinds)]
        name = f"{number}-{kind.replace(' ', '_')}"
        groups.setdefault(number % APPARATUS, []).append((number, kind, folder / name, with_identify))
    return list(groups.values())


def judge_group(group: list[Task]) -> list[Judgement]:
    """Judge the studies of one apparatus; the folders of failures are kept."""
    judged = []
    for number, kind, folder, with_identify in group:
        judgement = judge(number, kind, folder, with_identify=with_identify)
        if judgement.outcome.is_failure:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "failure.txt").write_text(f"{line_of(judgement)}\n{judgement.message}\n", encoding="utf-8")
        else:
            shutil.rmtree(folder)
        judged.append(judgement)
    return judged


def line_of(judgement: Judgement) -> str:
    """Return number, kind, outcome and detail of a study."""
    return f"{judgement.number} {judgement.kind}: {judgement.outcome}; {judgement.detail}"


def main(
    count: Annotated[int, typer.Option(metavar="N", min=1, help="Studies of all kinds together.")] = 500,
    seed: Annotated[int, typer.Option(metavar="N", help="Each study follows from it and from its number.")] = 1,
    kinds: Annotated[
        list[str] | None, typer.Option(metavar="KIND", help=f"Repeatable; of: {NONE}, {', '.join(KINDS)}.")
    ] = None,
    jobs: Annotated[int, typer.Option(metavar="N", min=1, help="Processes.")] = 2,
    identify: Annotated[bool, typer.Option(help="Whether studies in which nothing looks wrong are identified.")] = True,
    failures: Annotated[Path | None, typer.Option(metavar="DIR", help="Where failing studies go.")] = None,
) -> None:
    """Put faults into clean films. Exit status 1 if a fault is neither put right nor named, or anything is added."""
    asked = kinds or list(KINDS)
    if unknown := set(asked) - {NONE, *KINDS}:
        raise typer.BadParameter(f"found {unknown}, needed some of: {NONE}, {', '.join(KINDS)}", param_hint="--kinds")
    folder = failures or Path(tempfile.mkdtemp(prefix="film-faults-"))
    judged: list[Judgement] = []
    with ProcessPoolExecutor(jobs) as pool:
        for group in pool.map(judge_group, tasks(count, seed, asked, folder, with_identify=identify)):
            judged += group
            for j in group:
                if j.outcome.is_failure:
                    typer.echo(f"{line_of(j)}\n    {j.message[:SHOWN]}")
    show(judged, asked)
    failed = [j for j in judged if j.outcome.is_failure]
    moving = [j for j in judged if j.moved > MOVED_BY]
    added = sum(j.outcome is Outcome.ADDED for j in judged)
    typer.echo(f"{len(judged)} studies; {len(failed)} failures, {added} with an addition or a tie")
    if moving:
        share = sum(not j.outcome.is_failure for j in moving) / len(moving)
        typer.echo(f"of {len(moving)} faults that move a point by more than the noise, {share:.1%} were named or put right")
    if failed:
        typer.echo(f"the failing studies are in {folder}")
    raise typer.Exit(1 if failed else 0)


def show(judged: Sequence[Judgement], kinds: Sequence[str]) -> None:
    """Print a table of outcomes by kind."""
    ways = [o for o in Outcome if not o.is_failure or any(j.outcome is o for j in judged)]
    rows = []
    for kind in (*kinds, "all"):
        of_kind = [j for j in judged if kind in (j.kind, "all")]
        outcomes = Counter(j.outcome for j in of_kind)
        failures = sum(j.outcome.is_failure for j in of_kind)
        rows.append([kind, len(of_kind), *(outcomes[o] or "" for o in ways), failures or ""])
    show_table(["kind", "tried", *ways, "FAILED"], rows)


if __name__ == "__main__":
    typer.run(main)
