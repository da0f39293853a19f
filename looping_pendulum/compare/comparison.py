"""Builds the result object of a comparison from trajectories."""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections.abc import Sequence

import numpy as np

from looping_pendulum.compare.align import Aligned, Reference, SampledReference, align, reference_landmarks, why_not_comparable
from looping_pendulum.compare.deviation import departures as departures_of
from looping_pendulum.compare.deviation import evaluate_tube, growth_rate, string_stretch
from looping_pendulum.compare.json_text import plain
from looping_pendulum.compare.metrics import ComparedRun, metrics
from looping_pendulum.compare.result import (
    Clock,
    ComparisonResult,
    EngineResult,
    MeasuredRow,
    ReferenceResult,
    ResultSamples,
    ToleranceOutcome,
    ToleranceResult,
    WallTime,
    stored_provenance,
)
from looping_pendulum.compare.simple_mistakes import simple_mistake, velocity_mistake
from looping_pendulum.compare.stories import missing_physics, story
from looping_pendulum.compare.trial import MeasuredTrial, compare_trial
from looping_pendulum.measured.tables.events import MeasuredEventRow
from looping_pendulum.runs.events import Landmarks, event_value, run_landmarks
from looping_pendulum.runs.trajectory import (
    SAME_TIME,
    RunStatus,
    Trajectory,
    finite_length,
    first_samples,
    sample_times,
)
from looping_pendulum.scenarios.metrics import METRICS
from looping_pendulum.scenarios.scenario import Scenario, Tolerance

NOT_RUN_STATUSES = frozenset({RunStatus.MISSING, RunStatus.UNSUPPORTED, RunStatus.INTERRUPTED})
"""Statuses of a run that was not made or not finished for reasons outside the engine: its tolerances neither pass nor fail."""


def compare(
    scenario: Scenario,
    reference: Reference,
    trajectories: Sequence[Trajectory],
    measured: Sequence[MeasuredEventRow] = (),
) -> ComparisonResult:
    """Compare engines with the reference, and both with measured events if there are any; `with_trial` adds a trial.

    Parameters
    ----------
    reference
        Function that returns the reference's `Trajectory` at given times [s], ascending; its events are those of the whole run.
    trajectories
        One per engine, including failed and missing ones: they keep their row.
    """
    grid = sample_times(scenario.duration)
    reference_run = reference(grid)
    exact_landmarks = reference_landmarks(reference, grid)
    sampled = SampledReference(reference, scenario.parameters)
    runs = tuple(_until_model_ends(run, reference_run) for run in trajectories)
    # A run that broke down may end in NaN; what it has before is compared
    aligned = tuple(align(first_samples(run, finite_length(run)), reference) for run in runs)
    engines = tuple(_engine(run, a, scenario, reference, reference_run, sampled) for run, a in zip(runs, aligned, strict=True))
    judged = {(e.label, e.profile): e for e in engines}
    return ComparisonResult(
        scenario=scenario.name,
        title=scenario.title,
        description=scenario.description,
        parameters=scenario.parameters,
        duration=scenario.duration,
        inferred=scenario.inferred,
        reference=ReferenceResult(
            engine=reference_run.engine,
            variant=reference_run.variant,
            landmarks=exact_landmarks,
            sampled=sampled.landmarks_beside(),
            events=tuple((event.name, float(event.time)) for event in reference_run.events),
            end_time=float(reference_run.t[finite_length(reference_run) - 1]),
            provenance=stored_provenance(reference_run.provenance),
        ),
        engines=engines,
        tolerances=tuple(
            judge_tolerance(t, judged[t.engine, t.profile]) for t in scenario.tolerances if (t.engine, t.profile) in judged
        ),
        measured=_measured(measured, exact_landmarks, engines),
        measured_source="" if scenario.measured is None else scenario.measured.source,
        clock=Clock(
            written=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            wall_times=tuple(_wall_time(run) for run in trajectories),
        ),
        samples=ResultSamples(reference=reference_run, aligned=aligned),
    )


def _until_model_ends(run: Trajectory, reference_run: Trajectory) -> Trajectory:
    """Return ``run`` up to the time at which the reference's heavy mass reaches the rod or its string leaves it.

    What an engine does beyond it nothing is known to compare with. A light mass that reaches the rod is no such end: each run
    ends at its own.
    """
    if reference_run.status not in (RunStatus.HEAVY_REACHED_ROD, RunStatus.STRING_LEFT_ROD):
        return run
    count = int(np.searchsorted(run.t, reference_run.t[-1] + SAME_TIME))
    return run if count == len(run.t) else dataclasses.replace(first_samples(run, count), status=reference_run.status)


def with_trial(result: ComparisonResult, trial: MeasuredTrial) -> ComparisonResult:
    """Return ``result`` with the residuals of a measured trial, which replaces the scenario's own measured events.

    Raises
    ------
    ValueError
        If ``result`` was read from a file without its trajectories.
    """
    if result.samples is None:
        raise ValueError("this result was read without its trajectories; make it again with `looping-pendulum compare`")
    return dataclasses.replace(
        result,
        measured=_measured(trial.rows, result.reference.landmarks, result.engines),
        measured_source=trial.source,
        trial=compare_trial(trial, result.samples.reference, tuple(a.run for a in result.samples.aligned)),
    )


def _engine(
    run: Trajectory,
    aligned: Aligned,
    scenario: Scenario,
    reference: Reference,
    reference_run: Trajectory,
    sampled: SampledReference,
) -> EngineResult:
    own, expected = run_landmarks(run, scenario.parameters), sampled.landmarks_beside(aligned.run)
    not_comparable = why_not_comparable(aligned.run, own, sampled)
    tube = evaluate_tube(aligned, reference)
    stretch = string_stretch(aligned, scenario.parameters)
    compared = ComparedRun(
        aligned=aligned,
        parameters=scenario.parameters,
        landmarks=own,
        reference_landmarks=expected,
        tube=tube,
        stretch=stretch,
        comparable=not not_comparable,
    )
    departures = departures_of(aligned, reference_run.events, stretch)
    provenance = stored_provenance(run.provenance)
    return EngineResult(
        engine=run.engine,
        variant=run.variant,
        profile=run.profile,
        status=run.status.name,
        status_sentence=run.status.value,
        ok=run.status.ok,
        available=run.status not in NOT_RUN_STATUSES,
        message=run.message,
        samples=len(run.t),
        end_time=float(aligned.t[-1]) if len(aligned.t) else None,
        landmarks=own,
        metrics=metrics(compared),
        not_comparable=not_comparable,
        tube=tube,
        departures=departures,
        growth_rate=growth_rate(departures),
        outside_range=run.outside_range,
        additions=run.additions,
        from_reference=run.from_reference,
        lacks=missing_physics(provenance.supplies, scenario.parameters, run.lacks),
        story=story(
            aligned.run,
            scenario.parameters,
            provenance.supplies,
            departures,
            own,
            expected,
            not_comparable,
            simple_mistake(aligned, scenario.parameters) if departures else "",
            velocity_mistake(aligned.run),
        ),
        provenance=provenance,
    )


def _wall_time(run: Trajectory) -> WallTime:
    def per_simulated_second(seconds: float | None) -> float | None:
        return None if seconds is None or len(run.t) < 2 else float(seconds / run.t[-1])

    wall, cpu = (seconds if math.isfinite(seconds) else None for seconds in (run.wall_time, run.cpu_time))
    return WallTime(
        engine=run.label,
        profile=run.profile,
        seconds=wall,
        per_simulated_second=per_simulated_second(wall),
        cpu_seconds=cpu,
        cpu_per_simulated_second=per_simulated_second(cpu),
    )


def _measured(
    rows: Sequence[MeasuredEventRow], exact_landmarks: Landmarks, engines: tuple[EngineResult, ...]
) -> tuple[MeasuredRow, ...]:
    return tuple(
        MeasuredRow(
            quantity=row.quantity,
            index=row.index,
            unit=row.unit,
            measured=plain(row.measured),
            paper_numerical=plain(row.paper_numerical),
            # By its own events: here the reference is compared with a measurement, not with runs that only have samples
            reference=event_value(exact_landmarks, row.quantity, row.index),
            engines=tuple(event_value(e.landmarks, row.quantity, row.index) for e in engines),
            sigma=plain(row.sigma),
        )
        for row in rows
    )


def judge_tolerance(tolerance: Tolerance, run: EngineResult) -> ToleranceResult:
    """Judge one tolerance against its engine's run."""
    value = run.metrics[tolerance.metric]
    outcome, explanation = _outcome(tolerance, run, value)
    return ToleranceResult(**vars(tolerance), value=value, outcome=outcome, explanation=explanation)


def _outcome(tolerance: Tolerance, run: EngineResult, value: float | None) -> tuple[ToleranceOutcome, str]:
    # A value decides even if the run was interrupted; only without one it is not judged
    if value is None and not run.available:
        return ToleranceOutcome.NOT_RUN, run.status_sentence
    passes = value is not None and METRICS[tolerance.metric].is_within(value, tolerance.limit)
    if tolerance.expected_failure:
        if passes:
            return ToleranceOutcome.UNEXPECTED_PASS, "passes although a failure is expected; correct the scenario"
        return ToleranceOutcome.EXPECTED_FAILURE, tolerance.expected_failure
    if passes:
        return ToleranceOutcome.PASSED, ""
    if value is not None:
        return ToleranceOutcome.FAILED, ""
    why = (
        run.not_comparable or "the run or the reference ends before the time at which the metric is taken, or it does not apply"
    )
    return ToleranceOutcome.FAILED, f"no value: {why if run.ok else run.status_sentence}"
