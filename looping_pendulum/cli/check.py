"""The command `check`: the limits that stand in scenario files, and no success where nothing was judged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from looping_pendulum.cli.common import (
    INTERRUPTED,
    OUTSIDE,
    EngineNames,
    Jobs,
    MemoryLimit,
    ProfileChoice,
    ProfileName,
    TimeLimit,
    load_scenario,
    run_and_compare,
)
from looping_pendulum.cli.terminal import new_table, say, show_table
from looping_pendulum.errors import ScenarioError

if TYPE_CHECKING:
    from looping_pendulum.compare.result import ComparisonResult


def check(
    scenario: Annotated[list[str] | None, typer.Argument(metavar="[SCENARIO]...", help="Default: every shipped one.")] = None,
    engine: EngineNames = None,
    profile: ProfileName = ProfileChoice.QUICK,
    time_limit: TimeLimit = 900.0,
    memory_limit: MemoryLimit = "2 GiB",
    jobs: Jobs = None,
) -> None:
    """Check the tolerances that stand in the scenarios' files; write nothing.

    Engines whose tolerances a scenario does not name are not run. A check that judges nothing is no success: its exit status
    is 2. So it is if one of several named scenarios has no tolerances, unless --engine left it out.

    looping-pendulum check mine.yaml --engine pymunk
    """
    from looping_pendulum.engines.limits import nothing_to_judge, with_variants
    from looping_pendulum.engines.protocol import Profile
    from looping_pendulum.engines.registry import label, select
    from looping_pendulum.scenarios import loader

    speed = Profile(profile.value)
    asked = None if not engine else {label(one) for one in select(engine, speed)}
    chosen = [with_variants(load_scenario(name), speed) for name in scenario or loader.shipped()]
    results: list[ComparisonResult] = []
    unjudged: list[str] = []
    for one in chosen:
        lacking = nothing_to_judge(one, profile.value, asked)
        if lacking:
            say(f"{one.name}: {lacking}")
            if scenario and asked is None:
                unjudged.append(f"{one.name}: {lacking}")
            continue
        limited = {t.engine for t in one.tolerances if t.profile == profile.value}
        wanted = sorted(limited if asked is None else limited & asked)
        result = run_and_compare(one, wanted, profile, time_limit=time_limit, memory_limit=memory_limit, jobs=jobs)
        _show(result)
        results.append(result)
        gaps = nothing_judged(result)
        unjudged += [f"{one.name}: {gaps}"] if gaps else []
    if not all(result.within_tolerance for result in results):
        raise typer.Exit(OUTSIDE)
    if unjudged:
        raise ScenarioError(f"check: nothing was judged of {'; '.join(unjudged)}")
    if not results:
        raise ScenarioError("check: nothing was judged: no scenario has tolerances for this profile of the engines asked for")


def _show(result: ComparisonResult) -> None:
    """Show what became of each limit; an interrupted check ends here."""
    from looping_pendulum.engines.trajectory import RunStatus

    table = new_table("scenario", "engine", "metric", "value", "limit", "outcome")
    for t in result.tolerances:
        value = "" if t.value is None else f"{t.value:.6g}"
        table.add_row(result.scenario, t.engine, t.metric, value, f"{t.limit:.6g}", t.outcome.value)
    show_table(table)
    if any(engine.status == RunStatus.INTERRUPTED.name for engine in result.engines):
        raise typer.Exit(INTERRUPTED)


def nothing_judged(result: ComparisonResult) -> str:
    """Return why no tolerance of ``result`` was judged; empty: at least one was, or a run broke off, which says enough."""
    from looping_pendulum.compare.result import ToleranceOutcome

    if any(t.outcome is not ToleranceOutcome.NOT_RUN for t in result.tolerances) or any(
        result.broke_off(e) for e in result.engines
    ):
        return ""
    gaps = [f"{e.label}: {e.status_sentence}" + (f" ({e.message})" if e.message else "") for e in result.engines]
    return "; ".join(gaps)
