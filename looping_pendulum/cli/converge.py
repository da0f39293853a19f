"""The command `converge`: whether an engine's error goes away with finer settings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from looping_pendulum.cli import common
from looping_pendulum.cli.quantities import quantity
from looping_pendulum.cli.terminal import ProgressBars, say, say_prose, show_json, show_table
from looping_pendulum.engines import MEMORY_LIMIT, Profile


def converge(
    scenario: common.OptionalScenario = "ten_to_one",
    engine: common.EngineNames = None,
    profile: common.ProfileName = Profile.QUICK,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for the report and the runs; default: report/SCENARIO-converge."),
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(
            metavar="TIME",
            parser=quantity("s", least="0.01 s"),
            help="Length of the runs; default: until 0.1 s after the halt, at least 0.7 s.",
        ),
    ] = None,
    time_limit: common.TimeLimit = 3600.0,
    memory_limit: common.MemoryLimit = MEMORY_LIMIT,
    jobs: common.Jobs = None,
    as_json: common.AsJson = False,
    quiet: common.Quiet = False,
) -> None:
    """Say of each engine whether it has converged, whether it has not, or whether it leads to another limit than the reference.

    Refines every numerical setting that a variant offers, of the main variants if no --engine is given, changes the initial
    state a little, and restores the engine's defaults one at a time. Writes convergence.md, convergence.json and a figure per
    setting. Completed runs are stored in DIR: after Ctrl-C it reports what it has, and the same command continues from there.
    Rungs finer than one that reaches the time limit are left out.

    looping-pendulum converge ten_to_one --engine mujoco:capstan --time-limit 60
    """
    from looping_pendulum.compare.convergence.result import FILE, QUANTITIES
    from looping_pendulum.compare.convergence.study import study_convergence, write
    from looping_pendulum.compare.harness import chosen_engines
    from looping_pendulum.files import prepare_output_folder
    from looping_pendulum.pages.numbers import number

    chosen = common.load_scenario(scenario)
    engines = chosen_engines(engine or (), profile)
    folder = out or Path("report") / f"{chosen.name}-converge"
    prepare_output_folder(folder, files=("convergence.md", FILE), folders=("figures",), record=FILE)
    with ProgressBars(time_left=True) as bars:
        result = study_convergence(
            chosen,
            engines,
            folder,
            until=until,
            jobs=jobs,
            time_limit=time_limit,
            memory_limit=memory_limit,
            progress=bars.update,
        )
    with common.without_interrupts():
        folder = common.report_folder(folder, FILE, interrupted=result.interrupted)
        written = write(result, folder)
    head = ["variant", "quantity", "verdict", "error", "refining changes it by", "limit's error", "+/-", "choice", "noise"]
    rows = []
    for v in result.variants:
        for one in v.verdicts:
            name = one.quantity
            sizes = (v.own.errors[name], one.refinement, one.limit_error, one.uncertainty, v.choice(name), v.spread[name])
            rows.append([v.label, f"{name} [m{QUANTITIES[name]}]", one.verdict, *(number(size, 1e3, 2) for size in sizes)])
    show_table(head, rows)
    for v in result.variants:
        for one in v.verdicts:
            say_prose(f"- {v.label}: {one.quantity}: {one.sentence}")
    say(f"wrote {written}")
    listed = [{"variant": v.label, "verdicts": v.verdicts} for v in result.variants]
    show_json({"scenario": chosen.name, "interrupted": result.interrupted, "variants": listed, "report": written})
    if result.interrupted:
        raise typer.Exit(common.INTERRUPTED)
