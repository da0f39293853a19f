"""The command `map`: many runs over ranges of one to three quantities."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from looping_pendulum.cli import common
from looping_pendulum.cli.file_kinds import takes
from looping_pendulum.cli.terminal import ProgressBars, note, say, say_file, say_prose, show_json, show_table
from looping_pendulum.engines import MEMORY_LIMIT

if TYPE_CHECKING:
    from looping_pendulum.sweep.map_file import MapPlan


def _run_counter(bars: ProgressBars) -> Callable[[int, int], None]:
    """Return a callback that shows how many runs are complete, their rate, and without a terminal the time left."""
    from looping_pendulum.pages.numbers import amount

    first: tuple[float, int] | None = None
    """Time [s] of the first call and the runs that were complete then: stored ones, which do not count for the rate."""

    def show(complete: int, runs: int) -> None:
        nonlocal first
        now = time.monotonic()
        if first is None:
            first = (now, complete)
            if complete:
                note(f"{complete} of {runs} runs are stored already")
            if complete < runs:
                bars.update("starting", complete / runs)
            return
        rate = (complete - first[1]) / max(now - first[0], 1e-9)
        seconds_left = (runs - complete) / rate
        description = f"{complete} of {runs} runs, {amount(rate)} runs/s"
        line = f"{description}, {timedelta(seconds=round(seconds_left))} left" if seconds_left else description
        bars.update(description, complete / runs, line=line)

    return show


def map_(
    file: Annotated[
        str | None,
        typer.Argument(
            metavar="[MAP.yaml]",
            help="Map file, or name of a shipped map; without it, list the shipped maps.",
            autocompletion=common.map_names,
            callback=takes("map"),
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the map; default: report/MAP-map.")] = None,
    jobs: common.Jobs = None,
    cluster: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Run on the workers of this Dask scheduler instead of here.")
    ] = None,
    to_print: Annotated[bool, typer.Option("--print", help="Print the map file, to change it, and run nothing.")] = False,
    schema: Annotated[bool, common.schema_option("map", "looping_pendulum.sweep.map_file")] = False,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Whether to draw figures.")] = True,
    max_runs: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Refuse a map of more runs; default: 20 million, 20 000 of engines.")
    ] = None,
    time_limit: common.TimeLimit = 900.0,
    memory_limit: common.MemoryLimit = MEMORY_LIMIT,
    as_json: common.AsJson = False,
    quiet: common.Quiet = False,
) -> None:
    """Run one scenario over ranges of one to three quantities, and map how each run ends.

    Writes DIR/map.zarr (xarray opens it), map.md and figures. If it is interrupted or killed, the same command continues from
    the stored runs, and ends with the same bytes.

    looping-pendulum map quick --out report/quick-map
    To write your own:  looping-pendulum map quick --print > mine.yaml
    """
    from looping_pendulum.sweep import map_file, report, runner
    from looping_pendulum.sweep.dask_cluster import check_address
    from looping_pendulum.sweep.store import STORE

    if file is None:
        _list_maps()
        return
    if to_print:
        text = map_file.load(file).text
        say_file(text)
        show_json(common.yaml_content(text))
        return
    if cluster is not None:
        check_address(cluster)
    plan = map_file.load(file)
    map_file.refuse_unintended_size(plan, max_runs)
    folder = out or Path("report") / f"{plan.name}-map"
    _show_size(plan)
    with ProgressBars(time_left=True) as bars:
        outcome = runner.run_map(
            plan,
            folder,
            jobs=jobs,
            cluster=cluster,
            figures=figures,
            time_limit=time_limit,
            memory_limit=memory_limit,
            progress=_run_counter(bars),
        )
    show_json({"map": plan.name, "outcome": outcome, "report": folder / report.REPORT, "store": folder / STORE})
    if outcome.interrupted:
        stored = f"{outcome.runs_now} of {outcome.runs} runs are kept in {folder}"
        say(f"interrupted: {stored}; the same command continues from there", err=True)
        raise typer.Exit(common.INTERRUPTED)
    for summary in outcome.summaries:
        say_prose(report.verdict(summary, several=plan.several))
    say(f"wrote {folder / report.REPORT} and {folder / STORE}")


def _show_size(plan: MapPlan) -> None:
    """Print the number of runs and the disk space of a map, before anything starts."""
    from looping_pendulum.pages.numbers import amount
    from looping_pendulum.sweep.store import BYTES_PER_RUN

    sizes = " x ".join(f"{size}" for size in plan.sizes.values())
    over = ", ".join(["engine"] * plan.several + [axis.name for axis in plan.axes])
    megabytes = plan.runs * BYTES_PER_RUN / 1e6
    message = f"{plan.runs} runs ({sizes}: {over}) in {plan.chunk_count} chunks, at most {amount(megabytes)} MB"
    note(message)
    sys.stderr.flush()


def _list_maps() -> None:
    """Print a table of the shipped maps."""
    from looping_pendulum.sweep import map_file

    rows, listed = [], []
    for shipped in map_file.shipped():
        plan = map_file.load(shipped)
        over = [axis.name for axis in plan.axes]
        rows.append([shipped, str(plan.runs), ", ".join(over), plan.title])
        listed.append({"map": shipped, "runs": plan.runs, "over": over, "title": plan.title})
    show_table(["map", "runs", "over", "title"], rows)
    show_json({"maps": listed})
