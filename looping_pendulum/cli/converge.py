"""The command `converge`: split an engine's error into its parts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from looping_pendulum.cli import common
from looping_pendulum.cli.quantities import quantity
from looping_pendulum.cli.terminal import convergence_bars, say, say_prose, show_json, show_table
from looping_pendulum.engines import Profile


def converge(
    scenario: common.OptionalScenario = "ten_to_one",
    engine: Annotated[
        list[str] | None,
        typer.Option(
            "--engine",
            "-e",
            metavar="NAME",
            help="Engine, variant, or all; repeatable. Default: the main variants.",
            autocompletion=common.engine_names,
        ),
    ] = None,
    profile: common.ProfileName = Profile.QUICK,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for the report and the runs; default: report/SCENARIO-converge."),
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(
            metavar="TIME",
            parser=quantity("s", least=0.01),
            help="Length of the runs; default: until 0.1 s after the halt, at least 0.7 s.",
        ),
    ] = None,
    budget: Annotated[
        float | None,
        typer.Option(
            metavar="TIME",
            parser=quantity("s", least=0.1),
            help="Leave out runs that are expected to take longer than this time [s].",
        ),
    ] = None,
    time_limit: common.TimeLimit = 3600.0,
    memory_limit: common.MemoryLimit = "2 GiB",
    jobs: common.Jobs = None,
    as_json: common.AsJson = False,
    quiet: common.Quiet = False,
) -> None:
    """Split each engine's error into three parts: not converged, different model, and adapter's choice.

    Refines every numerical setting that a variant offers, changes the initial state a little, and restores the engine's
    defaults one at a time. Writes convergence.md, convergence.json and a figure per setting. Completed runs are stored in DIR:
    after Ctrl-C it reports what it has, and the same command continues from there.

    looping-pendulum converge ten_to_one --engine mujoco:capstan --budget 60
    """
    from looping_pendulum.compare.convergence.report import halting_verdict
    from looping_pendulum.compare.convergence.result import FILE
    from looping_pendulum.compare.convergence.study import study_convergence, write
    from looping_pendulum.compare.harness import chosen_engines
    from looping_pendulum.engines.isolation import parse_memory
    from looping_pendulum.files import prepare_output_folder
    from looping_pendulum.pages.numbers import number

    chosen = common.load_scenario(scenario)
    engines = chosen_engines(engine or (), profile)
    folder = out or Path("report") / f"{chosen.name}-converge"
    prepare_output_folder(
        folder, files=("convergence.md", FILE), folders=("figures",), record=FILE
    )  # refuse an unusable folder before the work, not after it
    with convergence_bars() as bars:
        result = study_convergence(
            chosen,
            engines,
            folder,
            until=until,
            budget=budget,
            jobs=jobs,
            time_limit=time_limit,
            memory_limit=parse_memory(memory_limit),
            progress=bars.update,
        )
    with common.without_interrupts():
        folder = common.report_folder(
            folder, FILE, interrupted=result.interrupted, was_interrupted=lambda result: result["interrupted"]
        )
        written = write(result, folder)
    head = ["variant", "quantity", "error", "not converged", "different model", "+/-", "choice", "spread", "larger part"]
    rows = []
    for v in result.variants:
        for s in v.splits:
            parts = (s.error, s.numerics, s.model, s.numerics_uncertainty, s.choice, s.spread)
            cells = [number(x, 1e3, 2) for x in parts]
            rows.append([v.label, f"{s.quantity} [m{s.unit}]", *cells, ", then ".join(c.value for c in s.causes)])
    show_table(head, rows)
    for v in result.variants:
        say_prose(f"- {v.label}: halting time converges: {halting_verdict(v)}")
    say(f"wrote {written}")
    listed = [{"variant": v.label, "splits": v.splits, "halting_time_converges": halting_verdict(v)} for v in result.variants]
    show_json({"scenario": chosen.name, "interrupted": result.interrupted, "variants": listed, "report": written})
    if result.interrupted:
        raise typer.Exit(common.INTERRUPTED)
