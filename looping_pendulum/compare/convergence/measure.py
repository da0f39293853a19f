"""Computes the errors of runs, and from these the verdict of each ladder and the parts of a variant's error."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.compare.align import align
from looping_pendulum.compare.convergence.ladder import (
    Correction,
    SequenceFinding,
    SequenceKind,
    refinement_sizes,
    rms_norm,
    split_error,
)
from looping_pendulum.compare.convergence.result import (
    DROP,
    HALT,
    PATH_END_TIMES,
    QUANTITIES,
    ConvergenceVerdict,
    ErrorSplit,
    RunSummary,
)
from looping_pendulum.compare.metrics import END_TIME_TOLERANCE, rms_until
from looping_pendulum.compare.reference_landmarks import SampledReference
from looping_pendulum.compare.run_cache import EndedRun
from looping_pendulum.compare.tables import number
from looping_pendulum.engines.landmarks import run_landmarks
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.studies import Ladder
from looping_pendulum.pages.numbers import DISPLAY_UNITS
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.scenario import Scenario

PATH_FLOOR = 1e-9
"""Smallest change of a path that counts [m]: a nanometre."""
NUMBER_FLOOR = 1e-6
"""Smallest change of the halting time [s] or of the drop at the halt [m] that counts."""
SAMPLE_SHIFTS = 8
"""Number of shifts of the sampling grid, within one interval, with which the reference's own halt is read from samples."""

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

    key: str
    errors: Errors
    ended: bool
    """Whether the run came to its proper end."""
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
    grid, worst = _grid(target.scenario), {HALT: NUMBER_FLOOR, DROP: NUMBER_FLOOR}
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


def _grid(scenario: Scenario) -> Array:
    return np.arange(round(scenario.duration / SAMPLE_INTERVAL) + 1, dtype=np.float64) * SAMPLE_INTERVAL


def measure_run(key: str, ended: EndedRun | None, target: ReferenceTarget) -> MeasuredRun:
    """Return the errors of a run against ``target``; all are None where there is no run."""
    run = None if ended is None else ended.run
    if run is None:
        skipped = ended is not None and ended.expected is not None
        why = f"left out: expected {number(ended.expected, digits=2)} s" if ended is not None and skipped else "not run"
        summary = RunSummary(
            key=key,
            status="SKIPPED" if skipped else "NOT_RUN",
            ok=False,
            why=why,
            rms=dict.fromkeys(PATH_END_TIMES),
            halting_time=None,
            halting_time_error=None,
            drop_at_halt=None,
            drop_error=None,
            string_stretch=None,
        )
        return MeasuredRun(key=key, errors=dict.fromkeys(QUANTITIES), ended=False, summary=summary)
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
    stretch = np.abs(run.string_stretch[np.isfinite(run.string_stretch)])
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
        string_stretch=float(stretch.max()) if len(stretch) else None,
    )
    return MeasuredRun(key=key, errors=errors, ended=run.status.ok, summary=summary)


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
    ended = [rung for rung in rungs if rung.ended]
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
    if finding.kind is SequenceKind.CONVERGES and finding.order is not None:
        interval = "" if finding.order_uncertainty is None else f" ± {number(finding.order_uncertainty, digits=2)}"
        how = f"converges, order {number(finding.order, digits=3)}{interval}, to a limit"
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


def is_contained(one: LadderResult, others: Sequence[LadderResult]) -> bool:
    """Return whether another ladder refines the setting of ``one`` as well, as far or further, so that it would count twice.

    Of two ladders that refine each other's setting, the later one is contained.
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
            return True
    return False


def correction(quantity: str, result: LadderResult, own: MeasuredRun) -> Correction | None:
    """Return the difference between the ladder's limit and the variant's own setting; None without a limit."""
    finding = result.findings[quantity]
    if finding.limit is None or finding.uncertainty is None:
        return None
    start: Array | None = own.errors[quantity]
    # A ladder may change other settings with its own, so that the correction starts from its rung with the variant's value
    if own.key not in {rung.key for rung in result.rungs} and result.own is not None:
        same = [
            rung.errors[quantity]
            for value, rung in zip(result.ladder.values, result.rungs, strict=True)
            if math.isclose(value, result.own, rel_tol=1e-9)
        ]
        start = same[0] if same else start
    if start is None:
        return None
    return Correction(
        ladder=result.ladder.setting,
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
    counted = [result for result in results if not is_contained(result, results)]
    corrections = {result.ladder.setting: correction(quantity, result, own) for result in counted}
    values = {what: value for what, m in choices.items() if (value := m.errors[quantity]) is not None}
    parts = split_error(
        error,
        # Errors are less the reference already
        np.zeros_like(error),
        corrections=[c for c in corrections.values() if c is not None],
        choices=values,
        spread=spread,
        floor=floor,
    )
    fields: dict[str, Any] = {f.name: getattr(parts, f.name) for f in dataclasses.fields(parts)}
    missing = tuple(setting for setting, c in corrections.items() if c is None)
    return ErrorSplit(quantity=quantity, unit=QUANTITIES[quantity], without_limit=missing, **fields)


def rung_sizes(ladder: Ladder) -> Array:
    """Return the decreasing sizes of a ladder's rungs."""
    return refinement_sizes(ladder.values)
