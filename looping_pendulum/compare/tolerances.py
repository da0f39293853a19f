"""Judges a scenario's tolerances: passed, failed, failed as expected, passed unexpectedly, or not run."""

from __future__ import annotations

from collections.abc import Iterable

from looping_pendulum.compare.result import EngineResult, ToleranceOutcome, ToleranceResult
from looping_pendulum.engines.trajectory import RunStatus
from looping_pendulum.scenarios.metrics import METRICS
from looping_pendulum.scenarios.scenario import Tolerance

NOT_RUN_STATUSES = frozenset({RunStatus.MISSING, RunStatus.UNSUPPORTED, RunStatus.INTERRUPTED})
"""Statuses of a run that was not made or not finished for reasons outside the engine: its tolerances neither pass nor fail."""


def judge(tolerances: Iterable[Tolerance], engines: Iterable[EngineResult]) -> tuple[ToleranceResult, ...]:
    """Judge each tolerance whose engine and profile are among ``engines``.

    Tolerances of engines that were not run are left out.
    """
    runs = {(e.label, e.profile): e for e in engines}
    return tuple(judge_tolerance(t, runs[t.engine, t.profile]) for t in tolerances if (t.engine, t.profile) in runs)


def judge_tolerance(tolerance: Tolerance, run: EngineResult) -> ToleranceResult:
    """Judge one tolerance against its engine's run."""
    value = run.metrics[tolerance.metric]
    outcome, explanation = _outcome(tolerance, run, value)
    return ToleranceResult(
        engine=tolerance.engine,
        profile=tolerance.profile,
        metric=tolerance.metric,
        limit=tolerance.limit,
        value=value,
        outcome=outcome,
        explanation=explanation,
        reason=tolerance.reason,
        expected_failure=tolerance.expected_failure,
    )


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
    return ToleranceOutcome.FAILED, "" if value is not None else _why_no_value(run)


def _why_no_value(run: EngineResult) -> str:
    if not run.ok:
        return f"no value: {run.status_sentence}"
    if run.not_comparable:
        return f"no value: {run.not_comparable}"
    return "no value: the run or the reference ends before the time at which the metric is taken"
