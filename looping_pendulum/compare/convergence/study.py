"""Runs the convergence study of each variant: ladders, changed starts, other choices, hidden defaults."""

from __future__ import annotations

import dataclasses
import datetime
import math
import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from looping_pendulum.compare.align import SampledReference, align
from looping_pendulum.compare.convergence.limit import Limit, deviation, extrapolate, refinement_sizes, rms_norm
from looping_pendulum.compare.convergence.result import (
    DROP,
    FILE,
    HALT,
    PATH_END_TIMES,
    QUANTITIES,
    ConvergenceResult,
    LadderStudy,
    Rung,
    RunSummary,
    StudyClock,
    VariantStudy,
    VariationStudy,
)
from looping_pendulum.compare.convergence.verdict import RESOLUTION, Refinement, ladder_verdict, variant_verdict
from looping_pendulum.compare.metrics import END_TIME_TOLERANCE, rms_until
from looping_pendulum.compare.result import stored_provenance
from looping_pendulum.compare.run_cache import RunTask, make_runs, run_key
from looping_pendulum.engines import MEMORY_LIMIT
from looping_pendulum.engines.isolation import TIME_LIMIT
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import label
from looping_pendulum.engines.studies import Ladder, Variation
from looping_pendulum.errors import EngineError
from looping_pendulum.files import write_atomically
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.runs.events import run_landmarks
from looping_pendulum.runs.trajectory import Provenance, Trajectory
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
LEAST_NOISE = dict.fromkeys(PATH_END_TIMES, 1e-9) | {HALT: 1e-6, DROP: 1e-6}
"""Quantity -> smallest standard deviation of a run [m], [s]: rounding, and the reading of a halt from samples."""
Errors = Mapping[str, Array]
"""Quantity -> engine less reference, shape (samples, components); a number is one sample of one component."""


@dataclass(frozen=True, kw_only=True)
class ReferenceTarget:
    """The reference of one scenario, and its values of the halt."""

    scenario: Scenario
    reference: Reference
    numbers: Mapping[str, float | None]
    """Values of `HALT` and `DROP`; None where the reference does not halt."""


@dataclass(frozen=True, kw_only=True)
class MeasuredRun:
    """The errors of a run, of those quantities that it has, and its summary."""

    errors: Errors
    summary: RunSummary


@dataclass(frozen=True, kw_only=True)
class StudyPlan:
    """Runs that the study of one variant consists of."""

    engine: Engine
    own: RunTask
    starts: tuple[tuple[str, RunTask], ...]
    ladders: tuple[tuple[Ladder, tuple[RunTask, ...]], ...]
    choices: tuple[tuple[Variation, RunTask], ...]
    defaults: tuple[tuple[Variation, RunTask], ...]

    def tasks(self) -> list[RunTask]:
        """Return all runs; the coarse rungs of all ladders come before any fine one, which they may cause to be left out."""
        rungs = sorted((task for _, tasks in self.ladders for task in tasks), key=lambda task: len(task.coarser))
        others = [task for _, task in (*self.starts, *self.choices, *self.defaults)]
        return [self.own, *rungs, *others]


def reference_target(scenario: Scenario, reference: Reference) -> ReferenceTarget:
    """Return the reference of ``scenario`` with its values of the halt."""
    landmarks = SampledReference(reference, scenario.parameters).landmarks_beside()
    return ReferenceTarget(
        scenario=scenario, reference=reference, numbers={HALT: landmarks.halting_time, DROP: landmarks.drop_at_halt}
    )


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
    name = label(engine)

    def task(one: Engine, what: str, where: Scenario = scenario, coarser: Sequence[RunTask] = ()) -> RunTask:
        keys = tuple(rung.key for rung in coarser)
        return RunTask(key=run_key(one, where), engine=one, scenario=where, what=f"{name} {what}", coarser=keys)

    studies = engine.studies()
    ladders = []
    for ladder in studies.ladders:
        try:
            refinement_sizes(ladder.values)
        except ValueError as error:
            raise EngineError(
                f"{name}: ladder of {ladder.setting}: {error}; put them in order in the adapter's studies()"
            ) from None
        rungs: list[RunTask] = []
        for value, changes in zip(ladder.values, ladder.changes, strict=True):
            rungs.append(task(engine.with_settings(**changes), f"{ladder.setting} {value:g}", coarser=rungs))
        ladders.append((ladder, tuple(rungs)))
    return StudyPlan(
        engine=engine,
        own=task(engine, "at its own settings"),
        starts=tuple((what, task(engine, what, where)) for what, where in starts),
        ladders=tuple(ladders),
        choices=tuple((choice, task(engine.with_settings(**choice.changes), choice.what)) for choice in studies.choices),
        defaults=tuple(
            (default, task(engine.with_settings(**default.changes), f"default {default.what}")) for default in studies.defaults
        ),
    )


def study_convergence(
    scenario: Scenario,
    engines: Iterable[Engine],
    folder: Path,
    *,
    until: float | None = None,
    jobs: int | None = None,
    time_limit: float = TIME_LIMIT,
    memory_limit: int = MEMORY_LIMIT,
    progress: ReportShare | None = None,
) -> ConvergenceResult:
    """Run the convergence studies of ``engines`` on ``scenario`` and judge every ladder and every variant.

    Parameters
    ----------
    folder
        Where finished runs are cached (in ``runs``); cached runs are not made again.
    until
        Simulated time of the runs [s]; None: to shortly after the reference's halt, at least to the last path's end time.
    jobs
        Number of runs at the same time; one per core if None.
    time_limit, memory_limit
        Limits of each run [s], [bytes]; rungs finer than one that reached the time limit are left out.
    progress
        Called with a description of what is running and the share of the runs that have ended.
    """
    scenario = cut_to_watched(scenario, until)
    starts = changed_starts(scenario)
    plans = [plan_variant(engine, scenario, starts) for engine in engines]
    cancelled = threading.Event()
    runs = make_runs(
        [task for one in plans for task in one.tasks()],
        folder / "runs",
        jobs=jobs,
        time_limit=time_limit,
        memory_limit=memory_limit,
        progress=progress,
        cancelled=cancelled,
    )
    target = reference_target(scenario, Reference(scenario))
    changed_targets = {what: reference_target(where, Reference(where)) for what, where in starts}
    return ConvergenceResult(
        scenario=scenario.name,
        title=scenario.title,
        parameters=scenario.parameters,
        until=scenario.duration,
        time_limit=time_limit,
        reference=label(target.reference.engine),
        reference_values=dict(target.numbers),
        resolution=RESOLUTION,
        interrupted=cancelled.is_set(),
        variants=tuple(evaluate_variant(one, runs, target, changed_targets) for one in plans),
        clock=StudyClock(
            written=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            run_times={key: run.wall_time if math.isfinite(run.wall_time) else None for key, run in runs.items()},
        ),
    )


def measure_run(key: str, run: Trajectory | None, target: ReferenceTarget) -> MeasuredRun:
    """Return the errors of a run against ``target``; none where there is no run."""
    if run is None:
        why = "not run: a coarser rung reached the time limit, or the study was interrupted"
        nothing = dict.fromkeys(QUANTITIES)
        summary = RunSummary(key=key, status="NOT_RUN", ok=False, why=why, errors=nothing, halting_time=None)
        return MeasuredRun(errors={}, summary=summary)
    aligned = align(run, target.reference)
    sizes: dict[str, float | None] = {name: rms_until(aligned, end_time) for name, end_time in PATH_END_TIMES.items()}
    errors = {
        name: aligned.deviation[aligned.t <= end_time + END_TIME_TOLERANCE]
        for name, end_time in PATH_END_TIMES.items()
        if sizes[name] is not None
    }
    # A run that broke off may end at what looks like a halt
    landmarks = run_landmarks(run, target.scenario.parameters) if run.status.ok else None
    own = {HALT: landmarks.halting_time, DROP: landmarks.drop_at_halt} if landmarks else dict.fromkeys((HALT, DROP))
    for name, value in own.items():
        exact = target.numbers[name]
        sizes[name] = None if value is None or exact is None else value - exact
        if sizes[name] is not None:
            errors[name] = np.array([[sizes[name]]], dtype=float)
    summary = RunSummary(
        key=key,
        status=run.status.name,
        ok=run.status.ok,
        why=run.status.value + (f": {run.message.strip().splitlines()[-1]}" if run.message.strip() else ""),
        errors=sizes,
        halting_time=own[HALT],
    )
    return MeasuredRun(errors=errors, summary=summary)


def evaluate_variant(
    plan: StudyPlan,
    runs: Mapping[str, Trajectory],
    target: ReferenceTarget,
    changed_targets: Mapping[str, ReferenceTarget],
) -> VariantStudy:
    """Return the verdicts on one variant, from its runs."""

    def measured(task: RunTask, against: ReferenceTarget = target) -> MeasuredRun:
        return measure_run(task.key, runs.get(task.key), against)

    def variation(one: Variation, task: RunTask) -> VariationStudy:
        run = measured(task)
        changes = {name: change(name, own.errors, run.errors) for name in QUANTITIES}
        return VariationStudy(what=one.what, ours=one.ours, other=one.other, effect=one.effect, run=run.summary, change=changes)

    own = measured(plan.own)
    # Each against its own reference: the spread is that of the engine's error, not that of the motion
    starts = [own.errors, *(measured(task, changed_targets[what]).errors for what, task in plan.starts)]
    spread = {name: deviation([errors[name] for errors in starts if name in errors]) for name in QUANTITIES}
    noise = {name: max(LEAST_NOISE[name], spread[name] or 0.0) for name in QUANTITIES}
    ladders = [
        MeasuredLadder(
            ladder=ladder,
            own=ladder.own_value(plan.engine.settings),
            refined_further_by=refined_further_by(place, [one for one, _ in plan.ladders]),
            rungs=tuple(map(measured, tasks)),
            noise=noise,
        )
        for place, (ladder, tasks) in enumerate(plan.ladders)
    ]
    counted = [one for one in ladders if not one.refined_further_by]
    choices = tuple(variation(*each) for each in plan.choices)
    verdicts = []
    for name in QUANTITIES:
        # What the reference itself has not in this time is not judged
        if PATH_END_TIMES.get(name, 0.0) <= target.scenario.duration and target.numbers.get(name, 0.0) is not None:
            refinements = {ladder.ladder.setting: ladder.refinement(name, own.errors) for ladder in counted}
            made = {setting: refinement for setting, refinement in refinements.items() if refinement is not None}
            moved = {f"{one.what}: {one.other}": one.change[name] for one in choices}
            verdicts.append(variant_verdict(name, own.errors.get(name), made, moved, noise[name]))
    own_run = runs.get(plan.own.key)
    return VariantStudy(
        engine=plan.engine.name,
        variant=plan.engine.variant,
        profile=plan.engine.profile.value,
        summary=plan.engine.abilities.summary,
        own=own.summary,
        ladders=tuple(one.study(own.errors) for one in ladders),
        spread=spread,
        choices=choices,
        defaults=tuple(variation(*each) for each in plan.defaults),
        verdicts=tuple(verdicts),
        provenance=stored_provenance(
            Provenance(
                versions={} if own_run is None else own_run.provenance.versions,
                settings=vars(plan.engine.settings),
                supplies=plan.engine.abilities.supplies,
            )
        ),
    )


@dataclass(frozen=True, kw_only=True)
class MeasuredLadder:
    """A ladder with its runs."""

    ladder: Ladder
    own: float | None
    """The setting's value at the variant's own settings."""
    refined_further_by: str
    rungs: tuple[MeasuredRun, ...]
    noise: Mapping[str, float]
    """Quantity -> standard deviation of a run."""

    def limit(self, name: str) -> Limit | None:
        """Return the limit of quantity ``name`` along the ladder; None if it has none."""
        # A halt that comes and goes with the setting has no limit, however well the rungs that have it agree
        if name not in PATH_END_TIMES and any(rung.summary.ok and name not in rung.errors for rung in self.rungs):
            return None
        known = [name in rung.errors for rung in self.rungs]
        errors = [rung.errors[name] for rung in self.rungs if name in rung.errors]
        h = refinement_sizes(self.ladder.values)
        return extrapolate(h[known], errors, noise=self.noise[name], resolution=RESOLUTION[name])

    def refinement(self, name: str, own: Errors) -> Refinement | None:
        """Return the change from the variant's ``own`` errors to the limit; None without a value at its own setting."""
        # A ladder may change other settings with its own, so that the change starts from its rung with the variant's value
        places = zip(self.ladder.values, self.rungs, strict=True)
        same = [rung.errors for value, rung in places if self.own is not None and math.isclose(value, self.own)]
        start, errors = (same or [own])[0], [rung.errors[name] for rung in self.rungs if name in rung.errors]
        if name not in start or not errors:
            return None
        limit = self.limit(name)
        return (errors[-1] - start[name], None) if limit is None else (limit.value - start[name], limit.uncertainty)

    def study(self, own: Errors) -> LadderStudy:
        """Return the ladder as it is reported, beside the variant's ``own`` errors."""
        limits = {name: self.limit(name) for name in QUANTITIES}
        rungs, verdicts = [], []
        for value, rung in zip(self.ladder.values, self.rungs, strict=True):
            to_limit = {
                name: None if limit is None or name not in rung.errors else rms_norm(rung.errors[name] - limit.value)
                for name, limit in limits.items()
            }
            rungs.append(Rung(value=value, run=rung.summary, to_limit=to_limit))
        for name, limit in limits.items():
            errors = [rung.errors.get(name) for rung in self.rungs]
            verdicts.append(ladder_verdict(name, self.ladder, errors, limit, self.refinement(name, own)))
        return LadderStudy(
            setting=self.ladder.setting,
            unit=self.ladder.unit,
            follows=self.ladder.follows,
            refined_further_by=self.refined_further_by,
            own=self.own,
            rungs=tuple(rungs),
            verdicts=tuple(verdicts),
        )


def change(name: str, of: Errors, to: Errors) -> float | None:
    """Return how far a quantity moves between two runs of one scenario: a distance for a path, signed for a number."""
    if name not in of or name not in to:
        return None
    moved = to[name] - of[name]
    return rms_norm(moved) if name in PATH_END_TIMES else float(moved[0, 0])


def finest_value(ladder: Ladder, setting: str) -> float | None:
    """Return the value that ``setting`` has on the finest rung; None if the ladder does not change it."""
    values = [changes.get(setting) for changes in ladder.changes]
    changes_it = values and isinstance(values[-1], (int, float)) and values[0] != values[-1]
    return values[-1] if changes_it else None


def refined_further_by(place: int, ladders: Sequence[Ladder]) -> str:
    """Return the setting of a ladder that refines that of ``ladders[place]`` as well, as far or further; empty: none does.

    Such a ladder would count twice. Of two ladders that refine each other's setting, the later one does.
    """
    ladder = ladders[place]
    values = ladder.values
    for other_place, other in enumerate(ladders):
        finest = finest_value(other, ladder.setting)
        if other_place == place or finest is None:
            continue
        as_far = finest <= values[-1] if values[-1] < values[0] else finest >= values[-1]
        mutual = finest_value(ladder, other.setting) is not None
        if as_far and (not mutual or other_place < place):
            return other.setting
    return ""


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
