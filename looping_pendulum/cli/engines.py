"""The commands about the engines themselves: `engines` and `conformance`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from looping_pendulum.cli.common import OUTSIDE_TOLERANCE, AsJson, ProfileChoice, ProfileName, Quiet, TimeLimit
from looping_pendulum.cli.completion import engine_names
from looping_pendulum.cli.terminal import new_table, say, show_json, show_table
from looping_pendulum.errors import EngineError

if TYPE_CHECKING:
    from looping_pendulum.engines.conformance import CheckResult
    from looping_pendulum.engines.protocol import Profile


def engines(
    profile: ProfileName = ProfileChoice.QUICK,
    support: Annotated[bool, typer.Option("--support", help="Show which engine can run which scenario, and why not.")] = False,
    markdown: Annotated[bool, typer.Option("--markdown", help="With --support: print it as a Markdown page.")] = False,
    as_json: AsJson = False,
) -> None:
    """List the engines, how to install missing ones, and which physics is the engine's own or fed in by its adapter.

    An engine from another package is listed with the package's name.
    """
    from looping_pendulum.engines.protocol import Profile

    if markdown and not support:
        raise EngineError("--markdown: found it alone, needed --support with it; write `engines --support --markdown`")
    (_list_support if support else _list_engines)(Profile(profile.value), markdown)


def _list_engines(profile: Profile, markdown: bool) -> None:
    """Print a table of the engines; ``markdown`` has no meaning here."""
    from looping_pendulum.engines.registry import adapter_packages, how_to_get, label, load_engines, missing_packages
    from looping_pendulum.engines.trajectory import supplies_as_rows

    table = new_table("engine", "here", "winding", "friction law", "stick-slip", "drag", "runs", "what it is")
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
        table.add_row(label(engine), "no" if missing else "yes", *supplied_by.values(), when, summary)
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
    for name in load_errors:
        table.add_row(name, "broken", *[""] * 5, "left out; see below")
    show_table(table)
    for package, how in notes.items():
        say(f"{package} is not installed; to get it: {how}")
    for load_error in load_errors.values():
        say(load_error)
    show_json({"engines": listed, "how_to_get": notes, "broken": load_errors})


def _list_support(profile: Profile, markdown: bool) -> None:
    """Print which engine can run which scenario, as tables or as the page docs/support.md."""
    from looping_pendulum.engines import support
    from looping_pendulum.engines.registry import all_engines

    available = all_engines(profile)
    if markdown:
        say(support.page(available), nl=False)
        return
    tables = list(support.tables(available))
    show_json({"tables": [[dict(zip(header, row, strict=True)) for row in rows] for header, rows in tables]})
    for header, rows in tables:
        table = new_table(*header)
        for row in rows:
            table.add_row(*row)
        show_table(table)


def conformance(
    name: Annotated[
        str,
        typer.Argument(
            metavar="ENGINE", help="Engine (all its variants) or variant (my_engine:chain).", autocompletion=engine_names
        ),
    ],
    profile: ProfileName = ProfileChoice.QUICK,
    time_limit: TimeLimit = 300.0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Check that an engine does what every engine must do; for adapters of your own (docs/write-an-engine.md).

    Each run has a process of its own, so a crash or a hang fails one check only.
    """
    from looping_pendulum.engines.conformance import run_checks
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.engines.registry import how_to_get, label, missing_packages, select

    all_good = True
    listed: dict[str, list[CheckResult]] = {}
    for engine in select([name], Profile(profile.value)):
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
    raise typer.Exit(0 if all_good else OUTSIDE_TOLERANCE)
