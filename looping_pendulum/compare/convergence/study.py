"""Runs the convergence study of each variant (ladders, changed starts, other choices, hidden defaults) and splits its error."""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from looping_pendulum.compare.convergence.ladder import SequenceFinding, classify_sequence, deviation, rms_norm
from looping_pendulum.compare.convergence.measure import (
    LadderResult,
    MeasuredRun,
    ReferenceTarget,
    change,
    convergence_verdict,
    error_split,
    floors,
    measure_run,
    reference_target,
    rung_sizes,
    with_missing_halts,
)
from looping_pendulum.compare.convergence.result import (
    FILE,
    HALT,
    PATH_END_TIMES,
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
from looping_pendulum.compare.export import write_atomically
from looping_pendulum.compare.json_text import plain
from looping_pendulum.compare.result import RunProvenance, SupplyEntry
from looping_pendulum.compare.run_cache import EndedRun, Progress, RunCache, Runner, RunTask, run_key
from looping_pendulum.engines.isolation import MEMORY_LIMIT, TIME_LIMIT
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
"""Parameter, change [SI] and its description; each changed start is compared with a reference of its own.

The changes are far smaller than anybody could set up a real apparatus to.
"""
WATCH_AFTER_HALT = 0.1
"""Simulated time after the reference's halt, so that the rest can be confirmed [s]."""


@dataclass(frozen=True, kw_only=True)
class StudyPlan:
    """Runs that the study of one variant consists of."""

    engine: Engine
    studies: Studies
    own: RunTask
    starts: tuple[tuple[str, RunTask], ...]
    ladders: tuple[tuple[Ladder, tuple[RunTask, ...]], ...]
    choices: tuple[tuple[AdapterChoice, RunTask], ...]
    defaults: tuple[tuple[HiddenDefault, RunTask], ...]

    def tasks(self) -> list[RunTask]:
        """Return all runs, first those from which the cost of others can be predicted."""
        rungs = [task for _, tasks in self.ladders for task in tasks]
        # The coarse rungs of all ladders come before any fine one, so that the fine ones' costs are known when they are due
        rungs.sort(key=lambda task: len(task.coarser))
        others = [task for _, task in (*self.starts, *self.choices, *self.defaults)]
        return [self.own, *rungs, *others]


def cut_to_watched(scenario: Scenario, until: float | None) -> Scenario:
    """Return ``scenario`` cut at ``until`` [s]; by default shortly after the reference's halt and the last path's end time."""
    if until is None:
        halt = reference_target(scenario, Reference(scenario)).numbers[HALT]
        until = max(*PATH_END_TIMES.values(), 0.0 if halt is None else halt + WATCH_AFTER_HALT)
    # To whole milliseconds, at which engines give their samples
    return dataclasses.replace(scenario, duration=min(scenario.duration, round(until, 3)))


def changed_starts(scenario: Scenario) -> list[tuple[str, Scenario]]:
    """Return ``scenario`` with slightly different starts, each with a description."""
    changed = []
    for name, size, words in START_CHANGES:
        for sign in (1, -1):
            moved = scenario.parameters.replace(**{name: getattr(scenario.parameters, name) + sign * size})
            # A release may fix the parameter, as a vertical one does its angle: then there is nothing to run
            if moved != scenario.parameters:
                what = words.format(sign="+" if sign > 0 else "-")
                changed.append((what, dataclasses.replace(scenario, parameters=moved)))
    return changed


def plan_variant(engine: Engine, scenario: Scenario, starts: Sequence[tuple[str, Scenario]]) -> StudyPlan:
    """Return the runs of one variant."""
    name, own_key = label(engine), run_key(engine, scenario)

    def task(one: Engine, what: str, where: Scenario = scenario) -> RunTask:
        return RunTask(key=run_key(one, where), engine=one, scenario=where, what=f"{name} {what}", like=own_key)

    studies = engine.studies()
    ladders = []
    for ladder in studies.ladders:
        rungs: list[RunTask] = []
        try:
            sizes = rung_sizes(ladder)
        except ValueError as error:
            raise EngineError(
                f"{name}: ladder of {ladder.setting}: {error}; put them in order in the adapter's studies()"
            ) from None
        for value, size, one in zip(ladder.values, sizes, ladder.engines, strict=True):
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
    """Run the convergence studies of ``engines`` on ``scenario`` and split every error into its parts.

    Parameters
    ----------
    folder
        Where finished runs are cached (in ``runs``); cached runs are not made again.
    until
        Simulated time of the runs [s]; None: to shortly after the reference's halt, at least to the last path's end time.
    budget
        Runs expected to take longer than this wall time [s] are left out; the expectation comes from coarser rungs.
    jobs
        Number of runs at the same time; one per core if None.
    time_limit, memory_limit
        Limits of each run [s], [bytes].
    progress
        Called with the share of the work that is done and a description of what is running.
    """
    scenario = cut_to_watched(scenario, until)
    starts = changed_starts(scenario)
    plans = [plan_variant(engine, scenario, starts) for engine in engines]
    runner = Runner(
        RunCache(folder / "runs"),
        jobs=jobs,
        # Above the budget, which is held against the expected cost: a run that takes a little longer than expected may end
        time_limit=time_limit if budget is None else min(time_limit, 2 * budget),
        budget=budget,
        memory_limit=memory_limit,
        progress=progress,
    )
    tasks = [task for one in plans for task in one.tasks()]
    ended_runs = runner.run(tasks)
    reference = reference_target(scenario, Reference(scenario))
    changed_references = {what: reference_target(where, Reference(where)) for what, where in starts}
    smallest_changes = floors(reference)
    return ConvergenceResult(
        scenario=scenario.name,
        title=scenario.title,
        parameters=plain(scenario.parameters.as_dict()),
        until=scenario.duration,
        budget=budget,
        reference=label(reference.reference.engine),
        reference_values=dict(reference.numbers),
        floors=smallest_changes,
        interrupted=runner.cancelled.is_set(),
        variants=tuple(evaluate_variant(one, ended_runs, reference, changed_references, smallest_changes) for one in plans),
        clock=StudyClock(
            written=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            run_times=tuple(
                RunTime(key=key, seconds=ended_runs[key].seconds)
                # Sorted, because runs end in any order
                for key in sorted({task.key for task in tasks} & ended_runs.keys())
            ),
        ),
    )


def evaluate_variant(
    plan: StudyPlan,
    ended_runs: dict[str, EndedRun],
    target: ReferenceTarget,
    changed_references: dict[str, ReferenceTarget],
    floors: dict[str, float],
) -> VariantStudy:
    """Return the verdicts and the parts of the error of one variant, from its runs."""

    def measured(task: RunTask, against: ReferenceTarget = target) -> MeasuredRun:
        return measure_run(task.key, ended_runs.get(task.key), against)

    own = measured(plan.own)
    # Each against its own reference: the spread is that of the engine's error, not that of the motion
    starts = [(what, measured(task, changed_references[what])) for what, task in plan.starts]
    spread = {name: _spread(name, [own, *(m for _, m in starts)]) for name in QUANTITIES}
    results = [
        evaluate_ladder(ladder, tuple(measured(task) for task in tasks), plan.engine, spread, floors)
        for ladder, tasks in plan.ladders
    ]
    choices = {f"{choice.what}: {choice.instead}": measured(task) for choice, task in plan.choices}
    splits = (error_split(name, own, results, choices, spread[name], floors[name]) for name in QUANTITIES)
    own_run = ended_runs.get(plan.own.key)
    return VariantStudy(
        engine=plan.engine.name,
        variant=plan.engine.variant,
        profile=plan.engine.profile.value,
        summary=plan.engine.abilities.summary,
        own=own.summary,
        ladders=tuple(_ladder_study(result, target) for result in results),
        starts=tuple(StartChange(what=what, run=m.summary) for what, m in starts),
        spread=spread,
        choices=tuple(
            _variation(choice.what, choice.ours, choice.instead, "", own, measured(task)) for choice, task in plan.choices
        ),
        defaults=tuple(
            _variation(default.setting, default.ours, default.default, default.effect, own, measured(task))
            for default, task in plan.defaults
        ),
        splits=tuple(split for split in splits if split is not None),
        provenance=RunProvenance(
            versions=plain(own_run.run.provenance.versions) if own_run is not None and own_run.run is not None else {},
            settings=plain(plan.engine.settings),
            supplies=tuple(
                SupplyEntry(what=what, by=by, how=how) for what, by, how in supplies_as_rows(plan.engine.abilities.supplies)
            ),
        ),
    )


def evaluate_ladder(
    ladder: Ladder, rungs: tuple[MeasuredRun, ...], engine: Engine, spread: dict[str, float | None], floors: dict[str, float]
) -> LadderResult:
    """Return how every quantity behaves along one ladder."""
    h = rung_sizes(ladder)
    findings: dict[str, SequenceFinding] = {}
    for name in QUANTITIES:
        known = [value is not None for value in (rung.errors[name] for rung in rungs)]
        values = [value for rung in rungs if (value := rung.errors[name]) is not None]
        findings[name] = with_missing_halts(
            name, rungs, classify_sequence(h[known], values, floor=floors[name], spread=spread[name])
        )
    value = getattr(engine.settings, ladder.setting, None)
    own = float(value) if isinstance(value, (int, float)) else None
    return LadderResult(ladder=ladder, rungs=rungs, findings=findings, own=own)


def _ladder_study(result: LadderResult, target: ReferenceTarget) -> LadderStudy:
    rungs = []
    for value, rung in zip(result.ladder.values, result.rungs, strict=True):
        to_finest, to_limit = {}, {}
        for name in QUANTITIES:
            error, finest = rung.errors[name], [m.errors[name] for m in result.rungs if m.errors[name] is not None]
            limit = result.findings[name].limit
            to_finest[name] = None if error is None or finest[-1] is None else rms_norm(error - finest[-1])
            to_limit[name] = None if error is None or limit is None else rms_norm(error - limit)
        rungs.append(Rung(value=value, run=rung.summary, to_finest=to_finest, to_limit=to_limit))
    counts = {name: sum(rung.errors[name] is not None for rung in result.rungs) for name in QUANTITIES}
    return LadderStudy(
        setting=result.ladder.setting,
        unit=result.ladder.unit,
        follows=result.ladder.follows,
        own=result.own,
        rungs=tuple(rungs),
        verdicts=tuple(convergence_verdict(name, result.findings[name], counts[name], target) for name in QUANTITIES),
    )


def _variation(what: str, ours: str, other: str, effect: str, own: MeasuredRun, run: MeasuredRun) -> VariationStudy:
    changes = {name: change(name, own.errors, run.errors) for name in QUANTITIES}
    return VariationStudy(what=what, ours=ours, other=other, effect=effect, run=run.summary, change=changes)


def _spread(quantity: str, runs: Sequence[MeasuredRun]) -> float | None:
    """Return the standard deviation of the errors of runs whose starts differ a little; None for fewer than three."""
    return deviation([value for run in runs if (value := run.errors[quantity]) is not None])


def write(result: ConvergenceResult, folder: Path) -> Path:
    """Write convergence.md, convergence.json and the figures below ``folder``; return the report's path."""
    from looping_pendulum.compare.convergence.plots import draw
    from looping_pendulum.compare.convergence.report import render

    write_atomically(folder / FILE, result.to_json())
    captions = {}
    for name, (variant, caption, png) in draw(result).items():
        write_atomically(folder / "figures" / name, png)
        captions[f"figures/{name}"] = variant, caption
    report = folder / "convergence.md"
    write_atomically(report, render(result, captions))
    return report
