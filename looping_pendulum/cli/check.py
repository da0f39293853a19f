"""The command `check`: judge the tolerances of scenario files; a check that judges nothing is not a success."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from looping_pendulum.cli import common
from looping_pendulum.cli.file_kinds import takes
from looping_pendulum.cli.terminal import say, show_json, show_table
from looping_pendulum.engines import MEMORY_LIMIT, Profile
from looping_pendulum.errors import ScenarioError

if TYPE_CHECKING:
    from looping_pendulum.compare.result import ComparisonResult


def check(
    scenario: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SCENARIO ...]",
            help="Default: all shipped scenarios.",
            autocompletion=common.scenario_names,
            callback=takes("scenario"),
        ),
    ] = None,
    engine: common.EngineNames = None,
    profile: common.ProfileName = Profile.QUICK,
    time_limit: common.TimeLimit = 900.0,
    memory_limit: common.MemoryLimit = MEMORY_LIMIT,
    jobs: common.Jobs = None,
    as_json: common.AsJson = False,
    quiet: common.Quiet = False,
) -> None:
    """Check whether engines keep the tolerances in scenario files; write no report.

    Only engines for which a scenario has tolerances are run. The exit status is 2 if nothing was judged, or if one of several
    named scenarios has no tolerances, unless --engine left it out.

    looping-pendulum check mine.yaml --engine pymunk
    """
    from looping_pendulum.compare.report import value_and_limit
    from looping_pendulum.engines.registry import expand_tolerances, label, select, why_no_tolerances
    from looping_pendulum.scenarios import loader

    requested = None if not engine else {label(variant) for variant in select(engine, profile)}
    scenarios = [expand_tolerances(common.load_scenario(name), profile) for name in scenario or loader.shipped()]
    results: list[ComparisonResult] = []
    without_tolerances: dict[str, str] = {}
    not_judged: list[str] = []
    for loaded in scenarios:
        reason = why_no_tolerances(loaded, profile.value, requested)
        if reason:
            say(f"{loaded.name}: {reason}")
            without_tolerances[loaded.name] = reason
            if scenario and requested is None:
                not_judged.append(f"{loaded.name}: {reason}")
            continue
        with_limits = {t.engine for t in loaded.tolerances if t.profile == profile.value}
        wanted = sorted(with_limits if requested is None else with_limits & requested)
        result = common.run_and_compare(loaded, wanted, profile, time_limit=time_limit, memory_limit=memory_limit, jobs=jobs)
        say(f"{result.scenario}, {profile.value}:")
        rows = [[t.engine, t.metric, *value_and_limit(t), t.outcome.value] for t in result.tolerances]
        show_table(["engine", "metric", "value", "limit", "outcome"], rows)
        results.append(result)
        if result.interrupted:
            break
        gap = why_nothing_judged(result)
        not_judged += [f"{loaded.name}: {gap}"] if gap else []
    within = all(result.within_tolerance for result in results)
    judged = {result.scenario: result.tolerances for result in results}
    gaps = {"without_tolerances": without_tolerances, "not_judged": not_judged}
    show_json({"within_tolerance": within if results else None, "profile": profile, "tolerances": judged, **gaps})
    if results and results[-1].interrupted:
        raise typer.Exit(common.INTERRUPTED)
    if not within:
        raise typer.Exit(common.OUTSIDE_TOLERANCE)
    if not_judged:
        raise ScenarioError(f"check: nothing was judged of {'; '.join(not_judged)}")
    if not results:
        message = "check: nothing was judged: no scenario has tolerances for this profile of the engines asked for"
        raise ScenarioError(
            f"{message}; write some under 'tolerances' into a copy of one: looping-pendulum scenarios ten_to_one > mine.yaml"
        )


def why_nothing_judged(result: ComparisonResult) -> str:
    """Return why no tolerance of ``result`` was judged; empty if one was, or if a run broke off, which is reported anyway."""
    from looping_pendulum.compare.result import ToleranceOutcome

    if any(t.outcome is not ToleranceOutcome.NOT_RUN for t in result.tolerances) or any(
        result.broke_off(e) for e in result.engines
    ):
        return ""
    gap = [f"{e.label}: {e.status_sentence}" + (f" ({e.message})" if e.message else "") for e in result.engines]
    return "; ".join(gap)
