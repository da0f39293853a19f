"""Runs the convergence study of each variant (ladders, changed starts, other choices, hidden defaults) and splits its error."""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.compare.align import SampledReference, align
from looping_pendulum.compare.convergence.ladder import (
    RefinementChange,
    SequenceFinding,
    classify_sequence,
    deviation,
    refinement_sizes,
    rms_norm,
    split_error,
)
from looping_pendulum.compare.convergence.result import (
    DROP,
    FILE,
    HALT,
    PATH_END_TIMES,
    QUANTITIES,
    ConvergenceResult,
    ConvergenceVerdict,
    ErrorSplit,
    LadderStudy,
    Rung,
    RunSummary,
    RunTime,
    SequenceKind,
    StartChange,
    StudyClock,
    VariantStudy,
    VariationStudy,
)
from looping_pendulum.compare.deviation import largest_stretch
from looping_pendulum.compare.metrics import END_TIME_TOLERANCE, rms_until
from looping_pendulum.compare.result import stored_provenance
from looping_pendulum.compare.run_cache import EndedRun, RunCache, Runner, RunTask, run_key
from looping_pendulum.engines.isolation import MEMORY_LIMIT, TIME_LIMIT
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import label
from looping_pendulum.engines.studies import AdapterChoice, HiddenDefault, Ladder
from looping_pendulum.errors import EngineError
from looping_pendulum.files import write_atomically
from looping_pendulum.pages.numbers import DISPLAY_UNITS, number
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.runs.events import run_landmarks
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL, Provenance
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
PATH_FLOOR = 1e-9
"""Smallest change of a path that counts [m]: a nanometre."""
NUMBER_FLOOR = 1e-6
"""Smallest change of the halting time [s] or of the drop at the halt [m] that counts."""
SAMPLE_SHIFTS = 8
"""Number of shifts of the sampling grid, within one interval, with which the reference's own halt is read from samples."""


@dataclass(frozen=True, kw_only=True)
class StudyPlan:
    """Runs that the study of one variant consists of."""

    engine: Engine
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
            sizes = refinement_sizes(ladder.values)
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
    progress: ReportShare | None = None,
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
        Called with a description of what is running and the share of the work that is done.
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
        parameters=scenario.parameters,
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
    errors = [own.errors, *(run.errors for _, run in starts)]
    spread = {name: deviation([value for each in errors if (value := each[name]) is not None]) for name in QUANTITIES}
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
        ladders=tuple(_ladder_study(result, refined_further_by(result, results), target) for result in results),
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
        provenance=stored_provenance(
            Provenance(
                versions=own_run.run.provenance.versions if own_run is not None and own_run.run is not None else {},
                settings=vars(plan.engine.settings),
                supplies=plan.engine.abilities.supplies,
            )
        ),
    )


def evaluate_ladder(
    ladder: Ladder, rungs: tuple[MeasuredRun, ...], engine: Engine, spread: dict[str, float | None], floors: dict[str, float]
) -> LadderResult:
    """Return how every quantity behaves along one ladder."""
    h = refinement_sizes(ladder.values)
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


def _ladder_study(result: LadderResult, refined_further: str, target: ReferenceTarget) -> LadderStudy:
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
        refined_further_by=refined_further,
        own=result.own,
        rungs=tuple(rungs),
        verdicts=tuple(convergence_verdict(name, result.findings[name], counts[name], target) for name in QUANTITIES),
    )


def _variation(what: str, ours: str, other: str, effect: str, own: MeasuredRun, run: MeasuredRun) -> VariationStudy:
    changes = {name: change(name, own.errors, run.errors) for name in QUANTITIES}
    return VariationStudy(what=what, ours=ours, other=other, effect=effect, run=run.summary, change=changes)


def write(result: ConvergenceResult, folder: Path) -> Path:
    """Write convergence.md, convergence.json and the figures below ``folder``; return the report's path."""
    from looping_pendulum.compare.convergence.report import convergence_markdown, draw

    write_atomically(folder / FILE, result.to_json())
    captions = {}
    for name, (variant, caption, png) in draw(result).items():
        write_atomically(folder / "figures" / name, png)
        captions[f"figures/{name}"] = variant, caption
    report = folder / "convergence.md"
    write_atomically(report, convergence_markdown(result, captions))
    return report


Errors = Mapping[str, Array | None]
"""Quantity -> engine less reference, shape (samples, components); a number is one sample of one component. None: no value."""


@dataclass(frozen=True, kw_only=True)
class ReferenceTarget:
    """The reference of one scenario, and its values of the halt."""

    scenario: Scenario
    reference: Reference
    numbers: Mapping[str, float | None]
    """Values of `HALT` and `DROP`; None where the reference does not halt."""


@dataclass(frozen=True, kw_only=True)
class MeasuredRun:
    """The errors of a run and its summary."""

    errors: Errors
    summary: RunSummary


def reference_target(scenario: Scenario, reference: Reference) -> ReferenceTarget:
    """Return the reference of ``scenario`` with its values of the halt."""
    landmarks = SampledReference(reference, scenario.parameters).landmarks_beside()
    return ReferenceTarget(
        scenario=scenario, reference=reference, numbers={HALT: landmarks.halting_time, DROP: landmarks.drop_at_halt}
    )


def floors(target: ReferenceTarget) -> dict[str, float]:
    """Return, per quantity, the smallest change that can be seen.

    For the values of the halt it is the largest error of reading the reference's own halt from samples on shifted grids.
    """
    samples = round(target.scenario.duration / SAMPLE_INTERVAL) + 1
    grid = np.arange(samples, dtype=np.float64) * SAMPLE_INTERVAL
    worst = {HALT: NUMBER_FLOOR, DROP: NUMBER_FLOOR}
    for shift in np.arange(SAMPLE_SHIFTS) / SAMPLE_SHIFTS * SAMPLE_INTERVAL:
        # Without the last time, which a shift would move beyond the end
        run = target.reference(grid[:-1] + shift)
        release = target.reference(np.zeros(1))
        # The detector measures drops from the first sample, which is not the release here
        drop_before_first = float(release.heavy_position[0, 1] - run.heavy_position[0, 1])
        sampled = run_landmarks(run, target.scenario.parameters)
        exact_halt, exact_drop = target.numbers[HALT], target.numbers[DROP]
        if sampled.halting_time is not None and exact_halt is not None:
            worst[HALT] = max(worst[HALT], abs(sampled.halting_time - exact_halt))
        if sampled.drop_at_halt is not None and exact_drop is not None:
            worst[DROP] = max(worst[DROP], abs(sampled.drop_at_halt + drop_before_first - exact_drop))
    return dict.fromkeys(PATH_END_TIMES, PATH_FLOOR) | worst


def measure_run(key: str, ended: EndedRun | None, target: ReferenceTarget) -> MeasuredRun:
    """Return the errors of a run against ``target``; all are None where there is no run."""
    run = None if ended is None else ended.run
    if run is None:
        expected = None if ended is None else ended.expected
        status = "NOT_RUN" if expected is None else "SKIPPED"
        why = "not run" if expected is None else f"left out: expected {number(expected, digits=2)} s"
        nothing: dict[str, Any] = dict.fromkeys(
            ("halting_time", "halting_time_error", "drop_at_halt", "drop_error", "string_stretch")
        )
        summary = RunSummary(key=key, status=status, ok=False, why=why, rms=dict.fromkeys(PATH_END_TIMES), **nothing)
        return MeasuredRun(errors=dict.fromkeys(QUANTITIES), summary=summary)
    aligned = align(run, target.reference)
    rms = {name: rms_until(aligned, end_time) for name, end_time in PATH_END_TIMES.items()}
    errors: dict[str, Array | None] = {
        name: None if rms[name] is None else aligned.deviation[aligned.t <= mark + END_TIME_TOLERANCE]
        for name, mark in PATH_END_TIMES.items()
    }
    # A run that broke off may end at what looks like a halt
    landmarks = run_landmarks(run, target.scenario.parameters) if run.status.ok else None
    own = {HALT: landmarks.halting_time if landmarks else None, DROP: landmarks.drop_at_halt if landmarks else None}
    differences: dict[str, float | None] = {}
    for name, value in own.items():
        exact = target.numbers[name]
        differences[name] = None if value is None or exact is None else value - exact
        errors[name] = None if differences[name] is None else np.array([[differences[name]]], dtype=float)
    summary = RunSummary(
        key=key,
        status=run.status.name,
        ok=run.status.ok,
        why=run.status.value + (f": {run.message.strip().splitlines()[-1]}" if run.message.strip() else ""),
        rms=rms,
        halting_time=own[HALT],
        halting_time_error=differences[HALT],
        drop_at_halt=own[DROP],
        drop_error=differences[DROP],
        string_stretch=largest_stretch(run.string_stretch),
    )
    return MeasuredRun(errors=errors, summary=summary)


def change(quantity: str, of: Errors, to: Errors) -> float | None:
    """Return how far a quantity moves between two runs of one scenario: a distance for a path, signed for a number."""
    a, b = of[quantity], to[quantity]
    if a is None or b is None:
        return None
    return rms_norm(b - a) if quantity in PATH_END_TIMES else float((b - a)[0, 0])


def with_missing_halts(quantity: str, rungs: Sequence[MeasuredRun], finding: SequenceFinding) -> SequenceFinding:
    """Return ``finding``, changed where some or all of the runs that ended properly have no halt."""
    if quantity in PATH_END_TIMES:
        return finding
    ended = [rung for rung in rungs if rung.summary.ok]
    lacking = sum(rung.errors[quantity] is None for rung in ended)
    if ended and lacking == len(ended):
        return SequenceFinding(kind=SequenceKind.NEVER, why=f"no halt at any of {len(ended)} rungs")
    # A value that comes and goes with the setting has no limit, however well the rungs that have it agree
    if lacking:
        return dataclasses.replace(
            finding, kind=SequenceKind.SCATTERS, why=f"no halt at {lacking} of {len(ended)} rungs", limit=None, order=None
        )
    return finding


def convergence_verdict(quantity: str, finding: SequenceFinding, rungs: int, target: ReferenceTarget) -> ConvergenceVerdict:
    """Return the verdict on one quantity along one ladder, in numbers and in a sentence."""
    distance = limit = None
    if finding.limit is not None:
        # Errors are less the reference, so their limit is the distance of the limit from the reference.
        distance = rms_norm(finding.limit) if quantity in PATH_END_TIMES else float(finding.limit[0, 0])
        exact = target.numbers.get(quantity)
        limit = None if exact is None else exact + distance
    return ConvergenceVerdict(
        quantity=quantity,
        unit=QUANTITIES[quantity],
        kind=finding.kind,
        why=finding.why,
        rungs=rungs,
        used=finding.used,
        order=finding.order,
        order_uncertainty=finding.order_uncertainty,
        limit=limit,
        uncertainty=finding.uncertainty if finding.limit is not None else None,
        scatter=finding.scatter,
        limit_error=distance,
        sentence=verdict_sentence(QUANTITIES[quantity], finding, distance),
    )


def verdict_sentence(unit: str, finding: SequenceFinding, distance: float | None) -> str:
    """Return one line that says whether the sequence converges, how, and to what."""
    shown, scale = DISPLAY_UNITS[unit]
    if distance is None or finding.uncertainty is None:
        return f"{finding.kind.value}: {finding.why}"
    rungs = "rung, which is" if finding.left_out == 1 else f"{finding.left_out} rungs, which are"
    left_out = f" without the coarsest {rungs} not in the asymptotic range" if finding.left_out else ""
    if finding.kind is SequenceKind.CONVERGES and finding.order is not None:
        interval = "" if finding.order_uncertainty is None else f" ± {number(finding.order_uncertainty, digits=2)}"
        how = f"converges, order {number(finding.order, digits=3)}{interval}{left_out}, to a limit"
    elif finding.kind is SequenceKind.CONVERGES:
        how = f"closes in on its finest rung{left_out}, at a value"
    elif finding.kind is SequenceKind.SETTLED:
        how = f"no longer changes over the last {finding.used} rungs, at a value"
    else:
        scatter = number(finding.scatter, scale, digits=2)
        how = f"{finding.kind.value}: {finding.why}; the finest rungs scatter by ± {scatter} {shown} about a mean"
    error = f"{number(abs(distance), scale, digits=2)} ± {number(finding.uncertainty, scale, digits=2)} {shown}"
    reached = abs(distance) <= finding.uncertainty
    return f"{how} {error} from the reference" + (
        "" if reached else ", which it does not reach with the other settings as they are"
    )


@dataclass(frozen=True, kw_only=True)
class LadderResult:
    """A ladder with its runs and the behaviour of every quantity along it."""

    ladder: Ladder
    rungs: tuple[MeasuredRun, ...]
    findings: Mapping[str, SequenceFinding]
    own: float | None
    """The setting's value at the variant's own settings."""

    def finest(self, setting: str) -> float | None:
        """Return the value that ``setting`` has on the finest rung; None if the ladder does not change it."""
        values = [getattr(engine.settings, setting, None) for engine in self.ladder.engines]
        return float(values[-1]) if values and isinstance(values[-1], (int, float)) and values[0] != values[-1] else None


def refined_further_by(one: LadderResult, others: Sequence[LadderResult]) -> str:
    """Return the setting of another ladder that refines the setting of ``one`` as well, as far or further; empty: none does.

    Such a ladder would count twice. Of two ladders that refine each other's setting, the later one does.
    """
    # By identity, because results hold arrays, which have no hash
    places = {id(c): place for place, c in enumerate(others)}
    for other in others:
        finest = other.finest(one.ladder.setting)
        if other is one or finest is None:
            continue
        values = one.ladder.values
        as_far = finest <= values[-1] if values[-1] < values[0] else finest >= values[-1]
        mutual = one.finest(other.ladder.setting) is not None
        if as_far and (not mutual or places[id(other)] < places[id(one)]):
            return other.ladder.setting
    return ""


def correction(quantity: str, result: LadderResult, own: MeasuredRun) -> RefinementChange | None:
    """Return the difference between the ladder's limit and the variant's own setting; None without a limit."""
    finding = result.findings[quantity]
    if finding.limit is None or finding.uncertainty is None:
        return None
    start: Array | None = own.errors[quantity]
    # A ladder may change other settings with its own, so that the correction starts from its rung with the variant's value
    if own.summary.key not in {rung.summary.key for rung in result.rungs} and result.own is not None:
        same = [
            rung.errors[quantity]
            for value, rung in zip(result.ladder.values, result.rungs, strict=True)
            if math.isclose(value, result.own, rel_tol=1e-9)
        ]
        start = same[0] if same else start
    if start is None:
        return None
    return RefinementChange(
        change=finding.limit - start,
        uncertainty=finding.uncertainty,
        converges=finding.kind in (SequenceKind.CONVERGES, SequenceKind.SETTLED),
    )


def error_split(
    quantity: str,
    own: MeasuredRun,
    results: Sequence[LadderResult],
    choices: Mapping[str, MeasuredRun],
    spread: float | None,
    floor: float,
) -> ErrorSplit | None:
    """Split one quantity's error at the variant's own settings into parts; None if the variant has no value of it."""
    error = own.errors[quantity]
    if error is None:
        return None
    counted = [result for result in results if not refined_further_by(result, results)]
    corrections = {result.ladder.setting: correction(quantity, result, own) for result in counted}
    values = {what: value for what, m in choices.items() if (value := m.errors[quantity]) is not None}
    return split_error(
        error,
        # Errors are less the reference already
        np.zeros_like(error),
        quantity=quantity,
        without_limit=tuple(setting for setting, c in corrections.items() if c is None),
        corrections=[c for c in corrections.values() if c is not None],
        choices=values,
        spread=spread,
        floor=floor,
    )
