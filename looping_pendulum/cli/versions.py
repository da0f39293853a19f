"""The command `versions`: run one engine's releases, and name those in which a number moved."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from looping_pendulum.cli.common import (
    INTERRUPTED,
    MAX_JOBS,
    OUTSIDE_TOLERANCE,
    AsJson,
    MemoryLimit,
    ProfileChoice,
    ProfileName,
    Quiet,
    TimeLimit,
    load_scenario,
)
from looping_pendulum.cli.completion import engine_names, scenario_names
from looping_pendulum.cli.progress import ProgressBars
from looping_pendulum.cli.terminal import new_table, note, say, show_json, show_table


def versions(
    engine: Annotated[
        str, typer.Argument(metavar="ENGINE", help="Engine whose releases are run (mujoco).", autocompletion=engine_names)
    ],
    first: Annotated[
        str | None, typer.Option("--from", metavar="V", help="Oldest release; default: the first there is.")
    ] = None,
    last: Annotated[str | None, typer.Option("--to", metavar="W", help="Newest release; default: the last there is.")] = None,
    listed: Annotated[
        str | None, typer.Option("--versions", metavar="V,W,...", help="Only these releases, in place of --from and --to.")
    ] = None,
    variant: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Variant of the engine (capstan); repeatable. Default: the main ones."),
    ] = None,
    scenario: Annotated[
        str,
        typer.Option(metavar="SCENARIO", help="Shipped scenario, or path of a YAML file.", autocompletion=scenario_names),
    ] = "ten_to_one",
    profile: ProfileName = ProfileChoice.QUICK,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for the results and for each ended release; default: report/versions-ENGINE."),
    ] = None,
    time_limit: TimeLimit = 900.0,
    memory_limit: MemoryLimit = "2 GiB",
    jobs: Annotated[int, typer.Option(metavar="N", min=1, max=MAX_JOBS, help="Number of releases at the same time.")] = 2,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Run many releases of one engine, and name each release in which a number moved by more than its spread.

    pip or uv installs each release with NumPy and SciPy into an environment of its own, which is removed afterwards; nothing
    is compiled. Each runs the scenario and the static capstan test. The spread is the standard deviation of a number when the
    start changes by 0.01 deg or 0.1 mm, with the newest release that runs. A release that cannot be installed or run is a row
    with its error. Writes versions.json and versions.png. Ended releases are kept in DIR: after Ctrl-C, the same command
    continues from there.

    looping-pendulum versions mujoco --from 3.1 --to 3.3
    """
    from looping_pendulum.engines.isolation import parse_memory
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.files import optional_output, prepare_output_folder, write_atomically
    from looping_pendulum.releases.figure import png_of
    from looping_pendulum.releases.installers import list_releases
    from looping_pendulum.releases.result import FILE, HEADER, move_sentences, rows
    from looping_pendulum.releases.study import ReleaseStudy, chosen_releases, chosen_variants, distribution_of

    engines = chosen_variants(engine, variant or (), Profile(profile.value))
    chosen, memory_bytes = load_scenario(scenario), parse_memory(memory_limit)
    package = distribution_of(engines[0])
    releases = chosen_releases(package, list_releases(package), first=first, last=last, listed=listed)
    folder = out or Path("report") / f"versions-{engine}"
    prepare_output_folder(folder, files=(FILE, "versions.png"), folders=("releases", "environments"))
    with ProgressBars(time_left=True, line_every_fraction=0.05) as bars:
        study = ReleaseStudy(
            engines,
            chosen,
            folder,
            jobs=jobs,
            time_limit=time_limit,
            memory_limit=memory_bytes,
            progress=lambda fraction, description: bars.update(description, fraction),
        )
        result = study.run(releases)
    table = new_table(*HEADER)
    for row in rows(result):
        table.add_row(*row)
    show_table(table)
    if result.interrupted:
        note(f"interrupted: {len(result.releases)} of {len(releases)} releases are kept in {folder}; the same command goes on")
        show_json({"result": result, "file": None})
        raise typer.Exit(INTERRUPTED)
    for release, label, sentence in move_sentences(result):
        say(f"- {release}, {label}, {sentence}")
    if not result.moves:
        say("No number moved by more than its spread.")
    write_atomically(folder / FILE, result.to_json())
    with optional_output("versions.png"):
        write_atomically(folder / "versions.png", png_of([result]))
    say(f"wrote {folder / FILE}")
    show_json({"result": result, "file": folder / FILE})
    raise typer.Exit(0 if any(row.ran for row in result.releases) else OUTSIDE_TOLERANCE)
