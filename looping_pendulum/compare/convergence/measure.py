"""From runs to errors, and from errors to verdicts and parts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.compare.align import align
from looping_pendulum.compare.convergence.ladder import Correction, SequenceFinding, SequenceKind, norm, sizes, split_error
from looping_pendulum.compare.convergence.result import (
    DROP,
    HALT,
    MARKS,
    QUANTITIES,
    ConvergenceVerdict,
    ErrorSplit,
    RunSummary,
)
from looping_pendulum.compare.landmarks import SampledReference, run_landmarks
from looping_pendulum.compare.metrics import MARK_SLACK, rms_until
from looping_pendulum.compare.run_cache import EndedRun
from looping_pendulum.compare.tables import number
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.studies import Ladder
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.scenario import Scenario

PATH_FLOOR = 1e-9
"""Changes of a path up to a nanometre are not looked at [m]."""
NUMBER_FLOOR = 1e-6
"""The least floor of a number of the halt [s], [m]."""
READINGS = 8
"""Shifts of the samples within one interval with which the reference's own halt is read off."""
SHOWN = {"m": ("mm", 1e3), "s": ("ms", 1e3)}
"""SI unit -> the unit that sentences use, and how many of it make one."""

Errors = Mapping[str, Array | None]
"""Quantity -> engine less reference, shape (samples, components); one sample of one component for a number. None: it has none."""


@dataclass(frozen=True, kw_only=True)
class ReferenceTarget:
    """The reference of one scenario, and its numbers."""

    scenario: Scenario
    reference: Reference
    numbers: Mapping[str, float | None]
    """`HALT` and `DROP`."""


@dataclass(frozen=True, kw_only=True)
class MeasuredRun:
    """A run's errors and its summary."""

    key: str
    errors: Errors
    ended: bool
    """Whether the run came to its proper end."""
    summary: RunSummary


def target(scenario: Scenario, reference: Reference) -> ReferenceTarget:
    """Return the reference of ``scenario`` with its numbers."""
    marks = SampledReference(reference, scenario.parameters).beside()
    return ReferenceTarget(scenario=scenario, reference=reference, numbers={HALT: marks.halting_time, DROP: marks.drop_at_halt})


def floors(t: ReferenceTarget) -> dict[str, float]:
    """Quantity -> how well it can be read off: numbers of the halt by reading the reference's own from its samples, shifted."""
    grid, worst = _grid(t.scenario), {HALT: NUMBER_FLOOR, DROP: NUMBER_FLOOR}
    for shift in np.arange(READINGS) / READINGS * SAMPLE_INTERVAL:
        run = t.reference(grid[:-1] + shift)
        start = float(
            t.reference(np.zeros(1)).heavy_position[0, 1] - run.heavy_position[0, 1]
        )  # the drop before the first sample
        seen = run_landmarks(run, t.scenario.parameters)
        true_halt, true_drop = t.numbers[HALT], t.numbers[DROP]
        if seen.halting_time is not None and true_halt is not None:
            worst[HALT] = max(worst[HALT], abs(seen.halting_time - true_halt))
        if seen.drop_at_halt is not None and true_drop is not None:
            worst[DROP] = max(worst[DROP], abs(seen.drop_at_halt + start - true_drop))
    return dict.fromkeys(MARKS, PATH_FLOOR) | worst


def _grid(scenario: Scenario) -> Array:
    return np.arange(round(scenario.duration / SAMPLE_INTERVAL) + 1, dtype=np.float64) * SAMPLE_INTERVAL


def measure(key: str, done: EndedRun | None, t: ReferenceTarget) -> MeasuredRun:
    """Errors of a run, all None where there is no run."""
    run = None if done is None else done.run
    if run is None:
        waited = done is not None and done.expected is not None
        why = f"left out: expected {number(done.expected, digits=2)} s" if done is not None and waited else "not run"
        summary = RunSummary(
            key=key,
            status="SKIPPED" if waited else "NOT_RUN",
            ok=False,
            why=why,
            rms=dict.fromkeys(MARKS),
            halting_time=None,
            halting_time_error=None,
            drop_at_halt=None,
            drop_error=None,
            string_stretch=None,
        )
        return MeasuredRun(key=key, errors=dict.fromkeys(QUANTITIES), ended=False, summary=summary)
    aligned = align(run, t.reference)
    rms = {name: rms_until(aligned, mark) for name, mark in MARKS.items()}
    errors: dict[str, Array | None] = {
        name: None if rms[name] is None else aligned.deviation[aligned.t <= mark + MARK_SLACK] for name, mark in MARKS.items()
    }
    found = run_landmarks(run, t.scenario.parameters) if run.status.ok else None
    own = {HALT: found.halting_time if found else None, DROP: found.drop_at_halt if found else None}
    off: dict[str, float | None] = {}
    for name, value in own.items():
        true = t.numbers[name]
        off[name] = None if value is None or true is None else value - true
        errors[name] = None if off[name] is None else np.array([[off[name]]], dtype=float)
    stretch = np.abs(run.string_stretch[np.isfinite(run.string_stretch)])
    summary = RunSummary(
        key=key,
        status=run.status.name,
        ok=run.status.ok,
        why=run.status.value + (f": {run.message.strip().splitlines()[-1]}" if run.message.strip() else ""),
        rms=rms,
        halting_time=own[HALT],
        halting_time_error=off[HALT],
        drop_at_halt=own[DROP],
        drop_error=off[DROP],
        string_stretch=float(stretch.max()) if len(stretch) else None,
    )
    return MeasuredRun(key=key, errors=errors, ended=run.status.ok, summary=summary)


def change(quantity: str, of: Errors, to: Errors) -> float | None:
    """How far a quantity moves between two runs of one scenario: a distance for a path, signed for a number."""
    a, b = of[quantity], to[quantity]
    if a is None or b is None:
        return None
    return norm(b - a) if quantity in MARKS else float((b - a)[0, 0])


def finding_of(quantity: str, rungs: Sequence[MeasuredRun], found: SequenceFinding) -> SequenceFinding:
    """``found``, or what to say of a halt that some or all rungs lack."""
    if quantity in MARKS:
        return found
    ended = [rung for rung in rungs if rung.ended]
    lacking = sum(rung.errors[quantity] is None for rung in ended)
    if ended and lacking == len(ended):
        return SequenceFinding(kind=SequenceKind.NEVER, why=f"no halt at any of {len(ended)} rungs")
    if lacking:
        return dataclasses.replace(
            found, kind=SequenceKind.SCATTERS, why=f"no halt at {lacking} of {len(ended)} rungs", limit=None, order=None
        )
    return found


def verdict(quantity: str, found: SequenceFinding, rungs: int, t: ReferenceTarget) -> ConvergenceVerdict:
    """Put a finding into numbers and words."""
    distance = limit = None
    if found.limit is not None:
        distance = norm(found.limit) if quantity in MARKS else float(found.limit[0, 0])
        true = t.numbers.get(quantity)
        limit = None if true is None else true + distance
    return ConvergenceVerdict(
        quantity=quantity,
        unit=QUANTITIES[quantity],
        kind=found.kind,
        why=found.why,
        rungs=rungs,
        used=found.used,
        order=found.order,
        order_uncertainty=found.order_uncertainty,
        limit=limit,
        uncertainty=found.uncertainty if found.limit is not None else None,
        scatter=found.scatter,
        limit_error=distance,
        sentence=sentence(QUANTITIES[quantity], found, distance),
    )


def sentence(unit: str, found: SequenceFinding, distance: float | None) -> str:
    """One line: whether it converges, how, and to what."""
    shown, scale = SHOWN[unit]
    if distance is None or found.uncertainty is None:
        return f"{found.kind.value}: {found.why}"
    if found.kind is SequenceKind.CONVERGES and found.order is not None:
        known = "" if found.order_uncertainty is None else f" ± {number(found.order_uncertainty, digits=2)}"
        how = f"converges, order {number(found.order, digits=3)}{known},"
    elif found.kind is SequenceKind.SETTLED:
        how = f"no longer changes over the last {found.used} rungs,"
    else:
        each = number(found.scatter, scale, digits=2)
        how = f"{found.kind.value}: {found.why}; rungs scatter by ± {each} {shown} about a mean"
    off = f"{number(abs(distance), scale, digits=2)} ± {number(found.uncertainty, scale, digits=2)} {shown}"
    return f"{how} {off} from the reference" + (
        "" if abs(distance) <= found.uncertainty else ", so not to it with the other settings as they are"
    )


@dataclass(frozen=True, kw_only=True)
class LadderResult:
    """A ladder with its runs and what every quantity does along it."""

    ladder: Ladder
    rungs: tuple[MeasuredRun, ...]
    findings: Mapping[str, SequenceFinding]
    own: float | None
    """The setting's value at the variant's own settings."""

    def finest(self, setting: str) -> float | None:
        """Value to which this ladder takes ``setting``; None if it leaves it where it is."""
        values = [getattr(engine.settings, setting, None) for engine in self.ladder.engines]
        return float(values[-1]) if values and isinstance(values[-1], (int, float)) and values[0] != values[-1] else None


def contained(one: LadderResult, others: Sequence[LadderResult]) -> bool:
    """Whether another ladder takes the setting of ``one`` along, as far or further, so that it would count twice.

    Of two that take each other's along, the later is contained.
    """
    places = {id(c): place for place, c in enumerate(others)}
    for other in others:
        reached = other.finest(one.ladder.setting)
        if other is one or reached is None:
            continue
        values = one.ladder.values
        as_far = reached <= values[-1] if values[-1] < values[0] else reached >= values[-1]
        mutual = one.finest(other.ladder.setting) is not None
        if as_far and (not mutual or places[id(other)] < places[id(one)]):
            return True
    return False


def correction(quantity: str, climbed: LadderResult, own: MeasuredRun) -> Correction | None:
    """How far the ladder's limit is from the variant's own setting, along this ladder; None without a limit."""
    found = climbed.findings[quantity]
    if found.limit is None or found.uncertainty is None:
        return None
    start: Array | None = own.errors[quantity]
    if own.key not in {rung.key for rung in climbed.rungs} and climbed.own is not None:
        same = [
            rung.errors[quantity]
            for value, rung in zip(climbed.ladder.values, climbed.rungs, strict=True)
            if math.isclose(value, climbed.own, rel_tol=1e-9)
        ]
        start = same[0] if same else start
    if start is None:
        return None
    return Correction(
        ladder=climbed.ladder.setting,
        change=found.limit - start,
        uncertainty=found.uncertainty,
        converges=found.kind in (SequenceKind.CONVERGES, SequenceKind.SETTLED),
    )


def error_split(
    quantity: str,
    own: MeasuredRun,
    climbed: Sequence[LadderResult],
    choices: Mapping[str, MeasuredRun],
    spread: float | None,
    floor: float,
) -> ErrorSplit | None:
    """Parts of one quantity's error at the variant's own settings; None if it has none."""
    error = own.errors[quantity]
    if error is None:
        return None
    counted = [c for c in climbed if not contained(c, climbed)]
    found = {c.ladder.setting: correction(quantity, c, own) for c in counted}
    values = {what: value for what, m in choices.items() if (value := m.errors[quantity]) is not None}
    parts = split_error(
        error,
        np.zeros_like(error),
        corrections=[c for c in found.values() if c is not None],
        choices=values,
        spread=spread,
        floor=floor,
    )
    fields: dict[str, Any] = {f.name: getattr(parts, f.name) for f in dataclasses.fields(parts)}
    missing = tuple(setting for setting, c in found.items() if c is None)
    return ErrorSplit(quantity=quantity, unit=QUANTITIES[quantity], without_limit=missing, **fields)


def size_of(ladder: Ladder) -> Array:
    """Falling sizes of a ladder's rungs."""
    return sizes(ladder.values)
