"""A scenario's tolerances, judged: kept, broken, broken as expected, kept against expectation, or not run."""

from __future__ import annotations

from collections.abc import Iterable

from looping_pendulum.compare.result import EngineResult, ToleranceOutcome, ToleranceResult
from looping_pendulum.engines.trajectory import RunStatus
from looping_pendulum.scenarios.scenario import Tolerance

AT_LEAST = frozenset({"tube_fraction", "simulated_time"})
"""Metrics that are good when large: their limit is the smallest value allowed."""

NOT_RUN = frozenset({RunStatus.MISSING, RunStatus.UNSUPPORTED, RunStatus.INTERRUPTED})
"""Statuses that say nothing against an engine: the gap is shown and does not fail."""


def judge(tolerances: Iterable[Tolerance], engines: Iterable[EngineResult]) -> tuple[ToleranceResult, ...]:
    """Judge each tolerance whose engine and profile are among ``engines``.

    One of an engine that was not asked for says nothing and is left out.
    """
    runs = {(e.label, e.profile): e for e in engines}
    return tuple(judge_one(t, runs[t.engine, t.profile]) for t in tolerances if (t.engine, t.profile) in runs)


def judge_one(tolerance: Tolerance, run: EngineResult) -> ToleranceResult:
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
    if value is None and not run.available:
        return ToleranceOutcome.NOT_RUN, run.status_sentence
    kept = value is not None and _keeps(tolerance, value)
    if tolerance.expected_failure:
        if kept:
            return ToleranceOutcome.UNEXPECTED_PASS, "kept although it was declared out of reach: correct the scenario"
        return ToleranceOutcome.EXPECTED_FAILURE, tolerance.expected_failure
    if kept:
        return ToleranceOutcome.PASSED, ""
    return ToleranceOutcome.FAILED, "" if value is not None else _no_value(run)


def _keeps(tolerance: Tolerance, value: float) -> bool:
    return value >= tolerance.limit if tolerance.metric in AT_LEAST else abs(value) <= tolerance.limit


def _no_value(run: EngineResult) -> str:
    if not run.ok:
        return f"no value: {run.status_sentence}"
    if run.not_comparable:
        return f"no value: {run.not_comparable}"
    return "no value: the run or the reference does not reach what it measures"
