"""Runs all that a variant offers to vary, and splits its error: ladders, changes of the start, choices, hidden defaults."""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from looping_pendulum.compare.convergence.ladder import SequenceFinding, deviation, examine, norm
from looping_pendulum.compare.convergence.measure import (
    LadderResult,
    MeasuredRun,
    ReferenceTarget,
    change,
    error_split,
    finding_of,
    floors,
    measure,
    size_of,
    target,
    verdict,
)
from looping_pendulum.compare.convergence.result import (
    FILE,
    HALT,
    MARKS,
    QUANTITIES,
    ConvergenceResult,
    LadderStudy,
    Rung,
    RunTime,
    StartChange,
    StudyClock,
    VariantStudy,
    VariationStudy,
)
from looping_pendulum.compare.export import write_whole
from looping_pendulum.compare.json_text import plain
from looping_pendulum.compare.result import RunProvenance, SupplyEntry
from looping_pendulum.compare.run_cache import EndedRun, Progress, RunCache, Runner, RunTask, run_key
from looping_pendulum.engines.isolation import TIME_LIMIT
from looping_pendulum.engines.memory import MEMORY_LIMIT
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import label
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder, Studies
from looping_pendulum.engines.trajectory import supplies_as_rows
from looping_pendulum.errors import EngineError
from looping_pendulum.scenarios.scenario import Scenario

START_CHANGES = (
    ("release_angle", math.radians(0.01), "release angle {sign}0.01 deg"),
    ("free_length", 1e-4, "free length {sign}0.1 mm"),
    ("hanging_length", 1e-4, "hanging length {sign}0.1 mm"),
)
"""Parameter, change [SI] and its words: far below what anybody could set up. The reference of each changed start is its own."""
AFTER_HALT = 0.1
"""How long a halt is watched [s]."""


@dataclass(frozen=True, kw_only=True)
class StudyPlan:
    """What is run of one variant."""

    engine: Engine
    studies: Studies
    own: RunTask
    starts: tuple[tuple[str, RunTask], ...]
    ladders: tuple[tuple[Ladder, tuple[RunTask, ...]], ...]
    choices: tuple[tuple[AdapterChoice, RunTask], ...]
    defaults: tuple[tuple[HiddenDefault, RunTask], ...]

    def tasks(self) -> list[RunTask]:
        """All runs, those first that tell what others will cost."""
        rungs = [task for _, tasks in self.ladders for task in tasks]
        rungs.sort(key=lambda task: len(task.coarser))
        others = [task for _, task in (*self.starts, *self.choices, *self.defaults)]
        return [self.own, *rungs, *others]


def watched(scenario: Scenario, until: float | None) -> Scenario:
    """``scenario`` cut at ``until`` [s]; by default shortly after the last of the marks and the reference's halt."""
    if until is None:
        halt = target(scenario, Reference(scenario)).numbers[HALT]
        until = max(*MARKS.values(), 0.0 if halt is None else halt + AFTER_HALT)
    return dataclasses.replace(scenario, duration=min(scenario.duration, round(until, 3)))


def changed_starts(scenario: Scenario) -> list[tuple[str, Scenario]]:
    """``scenario`` from slightly different starts, in words and as data."""
    found = []
    for name, size, words in START_CHANGES:
        for sign in (1, -1):
            moved = scenario.parameters.replace(**{name: getattr(scenario.parameters, name) + sign * size})
            if moved != scenario.parameters:
                what = words.format(sign="+" if sign > 0 else "-")
                found.append((what, dataclasses.replace(scenario, parameters=moved)))
    return found


def plan(engine: Engine, scenario: Scenario, starts: Sequence[tuple[str, Scenario]]) -> StudyPlan:
    """List the runs of one variant."""
    name, own_key = label(engine), run_key(engine, scenario)

    def task(one: Engine, what: str, where: Scenario = scenario) -> RunTask:
        return RunTask(key=run_key(one, where), engine=one, scenario=where, what=f"{name} {what}", like=own_key)

    studies = engine.studies()
    ladders = []
    for ladder in studies.ladders:
        rungs: list[RunTask] = []
        try:
            falling = size_of(ladder)
        except ValueError as error:
            raise EngineError(
                f"{name}: ladder of {ladder.setting}: {error}; put them in order in the adapter's studies()"
            ) from None
        for value, size, one in zip(ladder.values, falling, ladder.engines, strict=True):
            above = tuple((rung.key, rung.size) for rung in rungs)
            made = task(one, f"{ladder.setting} {value:g}")
            rungs.append(dataclasses.replace(made, size=float(size), coarser=above))
        ladders.append((ladder, tuple(rungs)))
    return StudyPlan(
        engine=engine,
        studies=studies,
        own=task(engine, "at its own settings"),
        starts=tuple((what, task(engine, what, where)) for what, where in starts),
        ladders=tuple(ladders),
        choices=tuple((choice, task(choice.engine, choice.what)) for choice in studies.choices),
        defaults=tuple((default, task(default.engine, f"default {default.setting}")) for default in studies.defaults),
    )


def study_convergence(
    scenario: Scenario,
    engines: Iterable[Engine],
    folder: Path,
    *,
    until: float | None = None,
    budget: float | None = None,
    jobs: int | None = None,
    time_limit: float = TIME_LIMIT,
    memory_limit: int = MEMORY_LIMIT,
    progress: Progress | None = None,
) -> ConvergenceResult:
    """Run the studies of ``engines`` on ``scenario`` and say what every error consists of.

    Parameters
    ----------
    folder
        Where ended runs are kept (below ``runs``); runs found there are not made again.
    until
        How long runs are watched [s]; None: to shortly after the reference's halt, at least to the last mark.
    budget
        Runs expected to take longer than this [s] are left out, from what coarser rungs took.
    jobs
        Runs at once; one per core if None.
    time_limit, memory_limit
        Of each run [s], [bytes].
    progress
        Called with the share that is done and what goes on.
    """
    scenario = watched(scenario, until)
    starts = changed_starts(scenario)
    plans = [plan(engine, scenario, starts) for engine in engines]
    runner = Runner(
        RunCache(folder / "runs"),
        jobs=jobs,
        time_limit=time_limit if budget is None else min(time_limit, 2 * budget),
        budget=budget,
        memory_limit=memory_limit,
        progress=progress,
    )
    tasks = [task for one in plans for task in one.tasks()]
    done = runner.run(tasks)
    reference = target(scenario, Reference(scenario))
    moved = {what: target(where, Reference(where)) for what, where in starts}
    seen = floors(reference)
    return ConvergenceResult(
        scenario=scenario.name,
        title=scenario.title,
        parameters=plain(scenario.parameters.as_dict()),
        until=scenario.duration,
        budget=budget,
        reference=label(reference.reference.engine),
        reference_values=dict(reference.numbers),
        floors=seen,
        interrupted=runner.cancelled.is_set(),
        variants=tuple(judge(one, done, reference, moved, seen) for one in plans),
        clock=StudyClock(
            written=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            run_times=tuple(
                RunTime(key=key, seconds=done[key].seconds) for key in sorted({t.key for t in tasks} & done.keys())
            ),
        ),
    )


def judge(
    one: StudyPlan, done: dict[str, EndedRun], t: ReferenceTarget, moved: dict[str, ReferenceTarget], seen: dict[str, float]
) -> VariantStudy:
    """Verdicts and parts of the error of one variant, from its runs."""

    def measured(task: RunTask, against: ReferenceTarget = t) -> MeasuredRun:
        return measure(task.key, done.get(task.key), against)

    own = measured(one.own)
    starts = [(what, measured(task, moved[what])) for what, task in one.starts]
    spread = {name: _spread(name, [own, *(m for _, m in starts)]) for name in QUANTITIES}
    climbed = [
        climb(ladder, tuple(measured(task) for task in tasks), one.engine, spread, seen) for ladder, tasks in one.ladders
    ]
    choices = {f"{choice.what}: {choice.instead}": measured(task) for choice, task in one.choices}
    splits = (error_split(name, own, climbed, choices, spread[name], seen[name]) for name in QUANTITIES)
    finished = done.get(one.own.key)
    return VariantStudy(
        engine=one.engine.name,
        variant=one.engine.variant,
        profile=one.engine.profile.value,
        summary=one.engine.abilities.summary,
        own=own.summary,
        ladders=tuple(_ladder_study(c, t) for c in climbed),
        starts=tuple(StartChange(what=what, run=m.summary) for what, m in starts),
        spread=spread,
        choices=tuple(
            _variation(choice.what, choice.ours, choice.instead, "", own, measured(task)) for choice, task in one.choices
        ),
        defaults=tuple(
            _variation(default.setting, default.ours, default.default, default.effect, own, measured(task))
            for default, task in one.defaults
        ),
        splits=tuple(split for split in splits if split is not None),
        provenance=RunProvenance(
            versions=plain(finished.run.provenance.versions) if finished is not None and finished.run is not None else {},
            settings=plain(one.engine.settings),
            supplies=tuple(
                SupplyEntry(what=what, by=by, how=how) for what, by, how in supplies_as_rows(one.engine.abilities.supplies)
            ),
        ),
    )


def climb(
    ladder: Ladder, rungs: tuple[MeasuredRun, ...], engine: Engine, spread: dict[str, float | None], seen: dict[str, float]
) -> LadderResult:
    """Say what every quantity does along one ladder."""
    h = size_of(ladder)
    findings: dict[str, SequenceFinding] = {}
    for name in QUANTITIES:
        known = [value is not None for value in (rung.errors[name] for rung in rungs)]
        values = [value for rung in rungs if (value := rung.errors[name]) is not None]
        findings[name] = finding_of(name, rungs, examine(h[known], values, floor=seen[name], spread=spread[name]))
    value = getattr(engine.settings, ladder.setting, None)
    own = float(value) if isinstance(value, (int, float)) else None
    return LadderResult(ladder=ladder, rungs=rungs, findings=findings, own=own)


def _ladder_study(c: LadderResult, t: ReferenceTarget) -> LadderStudy:
    rungs = []
    for value, rung in zip(c.ladder.values, c.rungs, strict=True):
        to_finest, to_limit = {}, {}
        for name in QUANTITIES:
            error, finest = rung.errors[name], [m.errors[name] for m in c.rungs if m.errors[name] is not None]
            limit = c.findings[name].limit
            to_finest[name] = None if error is None or finest[-1] is None else norm(error - finest[-1])
            to_limit[name] = None if error is None or limit is None else norm(error - limit)
        rungs.append(Rung(value=value, run=rung.summary, to_finest=to_finest, to_limit=to_limit))
    counts = {name: sum(rung.errors[name] is not None for rung in c.rungs) for name in QUANTITIES}
    return LadderStudy(
        setting=c.ladder.setting,
        unit=c.ladder.unit,
        follows=c.ladder.follows,
        own=c.own,
        rungs=tuple(rungs),
        verdicts=tuple(verdict(name, c.findings[name], counts[name], t) for name in QUANTITIES),
    )


def _variation(what: str, ours: str, other: str, effect: str, own: MeasuredRun, run: MeasuredRun) -> VariationStudy:
    moved = {name: change(name, own.errors, run.errors) for name in QUANTITIES}
    return VariationStudy(what=what, ours=ours, other=other, effect=effect, run=run.summary, change=moved)


def _spread(quantity: str, runs: Sequence[MeasuredRun]) -> float | None:
    """Return the standard deviation of the errors of runs whose starts differ a little; None of fewer than three."""
    return deviation([value for run in runs if (value := run.errors[quantity]) is not None])


def write(result: ConvergenceResult, folder: Path) -> Path:
    """Write convergence.md, convergence.json and the figures below ``folder``; return the report's path."""
    from looping_pendulum.compare.convergence.plots import draw
    from looping_pendulum.compare.convergence.report import render

    write_whole(folder / FILE, result.to_json())
    captions = {}
    for name, (variant, caption, png) in draw(result).items():
        write_whole(folder / "figures" / name, png)
        captions[f"figures/{name}"] = variant, caption
    report = folder / "convergence.md"
    write_whole(report, render(result, captions))
    return report
