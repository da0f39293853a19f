"""The commands about the engines themselves: `engines` and `conformance`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from looping_pendulum.cli import common
from looping_pendulum.cli.terminal import say, say_prose, show_json, show_table
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
    from looping_pendulum.runs.trajectory import supplies_as_rows

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
            say_prose(f"  {verdict.outcome.value:8}  {verdict.check.replace('_', ' ')}{why}", indent=12)
            all_good = all_good and verdict.outcome.acceptable
    show_json({"profile": profile, "conforms": all_good, "checks": listed})
    raise typer.Exit(0 if all_good else common.OUTSIDE_TOLERANCE)
