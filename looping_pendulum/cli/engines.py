"""The commands about the engines themselves: `engines`, `conformance` and `versions`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from looping_pendulum.cli import common
from looping_pendulum.cli.terminal import ProgressBars, note, say, show_json, show_table
from looping_pendulum.engines import Profile
from looping_pendulum.errors import EngineError

if TYPE_CHECKING:
    from looping_pendulum.engines.conformance import CheckResult


def engines(
    profile: common.ProfileName = Profile.QUICK,
    support: Annotated[bool, typer.Option("--support", help="Show which engine can run which scenario, and why not.")] = False,
    as_json: common.AsJson = False,
) -> None:
    """List the engines, how to install missing ones, and which physics is the engine's own or fed in by its adapter.

    An engine from another package is listed with the package's name.
    """
    if support:
        _list_support(profile)
    else:
        _list_engines(profile)


def _list_engines(profile: Profile) -> None:
    """Print a table of the engines."""
    from looping_pendulum.engines.registry import adapter_packages, how_to_get, label, load_engines, missing_packages
    from looping_pendulum.engines.trajectory import supplies_as_rows

    head = ["engine", "here", "winding", "friction law", "stick-slip", "drag", "runs", "what it is"]
    rows: list[list[str]] = []
    notes: dict[str, str] = {}
    listed: list[dict[str, Any]] = []
    available, load_errors = load_engines(profile)
    packages = adapter_packages()
    for engine in available:
        missing = missing_packages(engine)
        supplied_by = {physics: supplier for physics, supplier, _ in supplies_as_rows(engine.abilities.supplies)}
        when = "as reference" if engine.name == "reference" else "always" if engine.abilities.main else "if named"
        source = f" (of the package {packages[engine.name]})" if packages.get(engine.name) else ""
        summary = engine.abilities.summary + source
        rows.append([label(engine), "no" if missing else "yes", *supplied_by.values(), when, summary])
        listed.append(
            {
                "engine": label(engine),
                "missing_packages": missing,
                "supplied_by": supplied_by,
                "runs": when,
                "summary": summary,
            }
        )
        notes |= {package: how_to_get(package) for package in missing}
    rows += [[name, "broken", *[""] * 5, "left out; see below"] for name in load_errors]
    show_table(head, rows)
    for package, how in notes.items():
        say(f"{package} is not installed; to get it: {how}")
    for load_error in load_errors.values():
        say(load_error)
    show_json({"engines": listed, "how_to_get": notes, "broken": load_errors})


def _list_support(profile: Profile) -> None:
    """Print which engine can run which scenario."""
    from looping_pendulum.engines import support
    from looping_pendulum.engines.registry import all_engines

    available = all_engines(profile)
    tables = list(support.tables(available))
    show_json({"tables": [[dict(zip(header, row, strict=True)) for row in rows] for header, rows in tables]})
    for header, rows in tables:
        show_table(header, rows)


def conformance(
    name: Annotated[
        str,
        typer.Argument(
            metavar="ENGINE", help="Engine (all its variants) or variant (my_engine:chain).", autocompletion=common.engine_names
        ),
    ],
    profile: common.ProfileName = Profile.QUICK,
    time_limit: common.TimeLimit = 300.0,
    as_json: common.AsJson = False,
    quiet: common.Quiet = False,
) -> None:
    """Check that an engine does what every engine must do; for adapters of your own (docs/write-an-engine.md).

    Each run has a process of its own, so a crash or a hang fails one check only.
    """
    from looping_pendulum.engines.conformance import run_checks
    from looping_pendulum.engines.registry import how_to_get, label, missing_packages, select

    all_good = True
    listed: dict[str, list[CheckResult]] = {}
    for engine in select([name], profile):
        missing = missing_packages(engine)
        if missing:
            raise EngineError(f"{label(engine)}: {missing[0]} is not installed; to get it: {how_to_get(missing[0])}")
        say(f"{label(engine)}, {profile.value}")
        listed[label(engine)] = []
        for verdict in run_checks(engine, time_limit=time_limit):
            listed[label(engine)].append(verdict)
            why = f": {verdict.why}" if verdict.why else ""
            say(f"  {verdict.outcome.value:8}  {verdict.check.replace('_', ' ')}{why}")
            all_good = all_good and verdict.outcome.acceptable
    show_json({"profile": profile, "conforms": all_good, "checks": listed})
    raise typer.Exit(0 if all_good else common.OUTSIDE_TOLERANCE)


def versions(
    engine: Annotated[
        str,
        typer.Argument(metavar="ENGINE", help="Engine whose releases are run (mujoco).", autocompletion=common.engine_names),
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
        typer.Option(
            metavar="SCENARIO", help="Shipped scenario, or path of a YAML file.", autocompletion=common.scenario_names
        ),
    ] = "ten_to_one",
    profile: common.ProfileName = Profile.QUICK,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for the results and for each ended release; default: report/versions-ENGINE."),
    ] = None,
    time_limit: common.TimeLimit = 900.0,
    memory_limit: common.MemoryLimit = "2 GiB",
    jobs: Annotated[
        int, typer.Option(metavar="N", min=1, max=common.MAX_JOBS, help="Number of releases at the same time.")
    ] = 2,
    as_json: common.AsJson = False,
    quiet: common.Quiet = False,
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
    from looping_pendulum.files import optional_output, prepare_output_folder, write_atomically
    from looping_pendulum.releases.figure import png_of
    from looping_pendulum.releases.installers import list_releases
    from looping_pendulum.releases.result import FILE, HEADER, move_sentences, rows
    from looping_pendulum.releases.study import ReleaseStudy, chosen_releases, chosen_variants, distribution_of

    engines = chosen_variants(engine, variant or (), profile)
    chosen, memory_bytes = common.load_scenario(scenario), parse_memory(memory_limit)
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
            progress=bars.update,
        )
        result = study.run(releases)
    show_table(HEADER, rows(result))
    if result.interrupted:
        note(f"interrupted: {len(result.releases)} of {len(releases)} releases are kept in {folder}; the same command goes on")
        show_json({"result": result, "file": None})
        raise typer.Exit(common.INTERRUPTED)
    for release, label, sentence in move_sentences(result):
        say(f"- {release}, {label}, {sentence}")
    if not result.moves:
        say("No number moved by more than its spread.")
    write_atomically(folder / FILE, result.to_json())
    with optional_output("versions.png"):
        write_atomically(folder / "versions.png", png_of([result]))
    say(f"wrote {folder / FILE}")
    show_json({"result": result, "file": folder / FILE})
    raise typer.Exit(0 if any(row.ran for row in result.releases) else common.OUTSIDE_TOLERANCE)
