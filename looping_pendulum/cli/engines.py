"""The commands about engines themselves: `engines` and `conformance`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from looping_pendulum.cli.common import OUTSIDE, ProfileChoice, ProfileName, TimeLimit
from looping_pendulum.cli.terminal import new_table, say, show_table
from looping_pendulum.errors import EngineError

if TYPE_CHECKING:
    from looping_pendulum.engines.protocol import Profile


def engines(
    profile: ProfileName = ProfileChoice.QUICK,
    support: Annotated[bool, typer.Option("--support", help="Which engine can run which scenario, and why not.")] = False,
    markdown: Annotated[bool, typer.Option("--markdown", help="With --support: as a page of Markdown.")] = False,
) -> None:
    """List the engines: installed or how to get them, and who supplies which physics.

    An engine of another package is listed with the package's name.
    """
    from looping_pendulum.engines.protocol import Profile

    if markdown and not support:
        raise EngineError("--markdown: found it alone, needed --support with it; write `engines --support --markdown`")
    (_support if support else _listed)(Profile(profile.value), markdown)


def _listed(profile: Profile, markdown: bool) -> None:
    from looping_pendulum.engines.registry import how_to_get, label, loaded, missing_packages, suppliers
    from looping_pendulum.engines.trajectory import supplies_as_rows

    table = new_table("engine", "here", "winding", "friction law", "stick-slip", "drag", "runs", "what it is")
    notes: dict[str, str] = {}
    found, faults = loaded(profile)
    offered = suppliers()
    for engine in found:
        missing = missing_packages(engine)
        by = [by for _, by, _ in supplies_as_rows(engine.abilities.supplies)]
        when = "as reference" if engine.name == "reference" else "always" if engine.abilities.main else "if named"
        source = f" (of the package {offered[engine.name]})" if offered.get(engine.name) else ""
        table.add_row(label(engine), "no" if missing else "yes", *by, when, engine.abilities.summary + source)
        notes |= {package: how_to_get(package) for package in missing}
    for name in faults:
        table.add_row(name, "broken", *[""] * 5, "left out; see below")
    show_table(table)
    for package, how in notes.items():
        say(f"{package} is not installed; to get it: {how}")
    for fault in faults.values():
        say(fault)


def _support(profile: Profile, markdown: bool) -> None:
    from looping_pendulum.engines import support
    from looping_pendulum.engines.registry import all_engines

    found = all_engines(profile)
    if markdown:
        say(support.page(found), nl=False)
        return
    for header, rows in support.tables(found):
        table = new_table(*header)
        for row in rows:
            table.add_row(*row)
        show_table(table)


def conformance(
    name: Annotated[str, typer.Argument(metavar="ENGINE", help="Engine (all its variants) or variant (my_engine:chain).")],
    profile: ProfileName = ProfileChoice.QUICK,
    time_limit: TimeLimit = 300.0,
) -> None:
    """Hold an engine against what every engine must do; meant for adapters of your own (docs/write-an-engine.md).

    Each run has a process of its own, so a crash or a hang fails one check and no more.
    """
    from looping_pendulum.engines.conformance import examine
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.engines.registry import how_to_get, label, missing_packages, select

    good = True
    for engine in select([name], Profile(profile.value)):
        missing = missing_packages(engine)
        if missing:
            raise EngineError(f"{label(engine)}: {missing[0]} is not installed; to get it: {how_to_get(missing[0])}")
        say(f"{label(engine)}, {profile.value}")
        for verdict in examine(engine, time_limit=time_limit):
            why = f": {verdict.why}" if verdict.why else ""
            say(f"  {verdict.outcome.value:8}  {verdict.check.replace('_', ' ')}{why}")
            good = good and verdict.outcome.good
    raise typer.Exit(0 if good else OUTSIDE)
