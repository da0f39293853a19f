"""Lists what changed between two results of the same scenario.

`changes.json` is `ResultChanges` as JSON: one object per dataclass, one key per field, SI and radians, and first the key
``schema`` with its id and version. It is written beside `result.json`, which does not depend on the baseline.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from looping_pendulum.compare.json_text import JsonResult, flatten, plain
from looping_pendulum.compare.result import ComparisonResult, EngineResult, RunProvenance
from looping_pendulum.engines.landmarks import Landmarks
from looping_pendulum.errors import ResultError
from looping_pendulum.pages.markdown import table
from looping_pendulum.pages.numbers import DISPLAY_UNITS, GAP, DisplayUnit, number
from looping_pendulum.scenarios.metrics import metric_called

SAME_SETTING = 1e-9
"""Largest relative difference of equal settings: some are computed, and their last bits depend on the processor."""

MIN_RELATIVE_CHANGE = 0.01
"""Smallest change of a metric that is listed, as a fraction of its earlier value."""

MIN_METRIC_CHANGES = {"m": 1e-6, "s": 1e-6, "rad": 1e-6, "": 1e-6}
"""SI unit -> smallest change of a metric, or of a landmark of the reference, that is listed."""

MIN_LANDMARK_CHANGES = {"m": 1e-4, "s": 1e-4, "rad": 1e-3}
"""SI unit -> smallest change of an engine's landmark that is listed: a tenth of the sample interval, and the motion in it."""

# The fields of `Landmarks` that are single numbers; the others are tuples of events, or no numbers
LANDMARK_UNITS = {
    "halting_time": "s",
    "drop_at_halt": "m",
    "wrap_angle_at_halt": "rad",
    "free_length_at_halt": "m",
    "light_reaches_rod": "s",
}

MAX_BASELINE_BYTES = 64 * 1024 * 1024
"""Largest size of a baseline file [bytes]; the result of a dozen engines has 0.2 MiB."""

REFERENCE = "reference"
NOT_RUN_TEXT = "not run"
MAX_CONSOLE_CHANGES = 40
"""Largest number of changes that the terminal shows; the report has all."""


class ChangeKind(StrEnum):
    """Kind of a change."""

    SCENARIO = "scenario"
    RUN = "run"
    STATUS = "status"
    METRIC = "metric"
    TOLERANCE = "tolerance"
    LANDMARK = "landmark"
    VERSION = "version"
    SETTING = "setting"
    SUPPLY = "supply"


@dataclass(frozen=True, kw_only=True)
class ResultChange:
    """One difference between two results."""

    kind: ChangeKind
    run: str
    """"reference", "pymunk:chain, quick", or empty for the scenario."""
    what: str
    """Name of the metric, landmark, package or setting."""
    unit: str
    """SI unit; '' for a pure number and for what is not a number."""
    before: Any
    """Earlier value; None if there was none."""
    after: Any
    """Present value; None if there is none."""


@dataclass(frozen=True, kw_only=True)
class ResultChanges(JsonResult):
    """All differences between two results."""

    SCHEMA_ID = "looping-pendulum/changes"
    SCHEMA_VERSION = 1

    scenario: str
    baseline: str
    """Path of the earlier result."""
    baseline_written: str
    """Date and time at which that was written, UTC."""
    relative: float
    """Smallest relative change of a metric that is listed."""
    floors: dict[str, float]
    landmark_floors: dict[str, float]
    changes: tuple[ResultChange, ...]


def read_baseline(path: Path, scenario: str) -> ComparisonResult:
    """Read the result of an earlier `compare` of ``scenario``; a folder means the result.json in it.

    Raises
    ------
    ResultError
        If there is none, if it is of another scenario, or from a later version.
    """
    file = path / "result.json" if path.is_dir() else path
    try:
        with file.open("rb") as stream:
            # One byte more than is allowed tells that a file is too large, however large it is
            raw = stream.read(MAX_BASELINE_BYTES + 1)
        text = raw.decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = (error.strerror or str(error)) if isinstance(error, OSError) else "it is not text"
        raise ResultError(f"--baseline: {file}: {why}; `looping-pendulum compare {scenario}` writes one") from None
    if len(raw) > MAX_BASELINE_BYTES:
        raise ResultError(f"--baseline: {file}: found more than {MAX_BASELINE_BYTES // 1024**2} MiB, needed a result.json")
    try:
        result = ComparisonResult.from_json(text)
    except ResultError as error:
        raise ResultError(f"--baseline: {file}: {str(error).removeprefix('result.json: ')}") from None
    if result.scenario != scenario:
        raise ResultError(
            f"--baseline: {file}: found a result of {result.scenario!r}, needed one of {scenario!r}; give such a file"
        )
    return result


def changes_since(
    before: ComparisonResult, after: ComparisonResult, *, source: str = "", relative: float = MIN_RELATIVE_CHANGE
) -> ResultChanges:
    """List what changed from ``before`` to ``after``; times of day and wall times are left out.

    Parameters
    ----------
    source
        Path or name of the file of ``before``.
    relative
        Smallest change of a metric that is listed, as a fraction of its earlier value.
    """
    old, new = ({**flatten(plain(result.parameters)), "duration": result.duration} for result in (before, after))
    changes = [
        *_differences(ChangeKind.SCENARIO, "", old, new),
        *_reference(before, after),
        *_runs(before, after, relative),
    ]
    return ResultChanges(
        scenario=after.scenario,
        baseline=source,
        baseline_written=before.clock.written,
        relative=relative,
        floors=dict(MIN_METRIC_CHANGES),
        landmark_floors=dict(MIN_LANDMARK_CHANGES),
        changes=tuple(changes),
    )


def _reference(before: ComparisonResult, after: ComparisonResult) -> Iterator[ResultChange]:
    old, new = before.reference, after.reference
    names = [f"{t.engine}:{t.variant}" for t in (old, new)]
    yield from _differences(ChangeKind.RUN, REFERENCE, {"integrator": names[0]}, {"integrator": names[1]})
    yield from _landmarks(REFERENCE, old.landmarks, new.landmarks, MIN_METRIC_CHANGES)
    yield from _provenance(REFERENCE, old.provenance, new.provenance)


def _runs(before: ComparisonResult, after: ComparisonResult, relative: float) -> Iterator[ResultChange]:
    old, new = ({(e.label, e.profile): e for e in result.engines} for result in (before, after))
    for key in [*new, *(key for key in old if key not in new)]:
        run = ", ".join(part for part in key if part)
        if key in old and key in new:
            yield from _run(run, old[key], new[key], relative)
            # Either run serves, as only its label and profile are asked for
            yield from _tolerances(run, before, after, old[key])
        else:
            statuses = [known[key].status if key in known else NOT_RUN_TEXT for known in (old, new)]
            yield ResultChange(kind=ChangeKind.RUN, run=run, what="run", unit="", before=statuses[0], after=statuses[1])


def _run(run: str, old: EngineResult, new: EngineResult, relative: float) -> Iterator[ResultChange]:
    yield from _differences(ChangeKind.STATUS, run, {"status": old.status}, {"status": new.status})
    for name in (name for name in new.metrics if name in old.metrics):  # one that only one version knows cannot be compared
        unit = metric_called(name).unit
        was, now = old.metrics[name], new.metrics[name]
        # The absolute floor is for values near zero, whose relative changes are rounding
        if _has_changed(was, now, max(MIN_METRIC_CHANGES[unit], relative * abs(was or 0.0))):
            yield ResultChange(kind=ChangeKind.METRIC, run=run, what=name, unit=unit, before=was, after=now)
    yield from _landmarks(run, old.landmarks, new.landmarks, MIN_LANDMARK_CHANGES)
    yield from _provenance(run, old.provenance, new.provenance)


def _tolerances(run: str, before: ComparisonResult, after: ComparisonResult, engine: EngineResult) -> Iterator[ResultChange]:
    judged = [{t.metric: t for t in result.judged(engine)} for result in (before, after)]
    old, new = ({metric: t.outcome.value for metric, t in known.items()} for known in judged)
    yield from _differences(ChangeKind.TOLERANCE, run, old, new)
    for metric in (metric for metric in judged[1] if metric in judged[0]):
        limits = [known[metric].limit for known in judged]
        if limits[0] != limits[1]:  # exact: limits are read, not computed
            unit = metric_called(metric).unit
            yield ResultChange(
                kind=ChangeKind.TOLERANCE, run=run, what=f"limit of {metric}", unit=unit, before=limits[0], after=limits[1]
            )


def _landmarks(run: str, before: Landmarks, after: Landmarks, floors: Mapping[str, float]) -> Iterator[ResultChange]:
    def change(what: str, unit: str, old: Any, new: Any) -> ResultChange:
        return ResultChange(kind=ChangeKind.LANDMARK, run=run, what=what, unit=unit, before=old, after=new)

    for f in dataclasses.fields(Landmarks):
        old, new = getattr(before, f.name), getattr(after, f.name)
        name = f.name.replace("_", " ")
        if not isinstance(new, tuple):
            unit = LANDMARK_UNITS.get(f.name, "")
            if _has_changed(old, new, floors[unit]) if unit else old != new:
                yield change(name, unit, old, new)
        # Events are told apart by their index: if one is missing, all that follow would be compared with the wrong one
        elif len(old) != len(new):
            yield change(f"number of {name}", "", len(old), len(new))
        else:
            pairs = zip(map(_quantities, old), map(_quantities, new), strict=True)
            for index, (was, now) in enumerate(pairs, 1):
                # A slip onset has only a time, a stop a height besides, and an extremum a value
                for what, unit in (("time", "s"), ("height_change", "m"), ("value", "m")):
                    if what in now and _has_changed(was[what], now[what], floors[unit]):
                        yield change(f"{name} {index}, {what.replace('_', ' ')}", unit, was[what], now[what])


def _quantities(landmark: Any) -> dict[str, float]:
    return vars(landmark) if dataclasses.is_dataclass(landmark) else {"time": landmark}


def _provenance(run: str, before: RunProvenance, after: RunProvenance) -> Iterator[ResultChange]:
    yield from _differences(ChangeKind.VERSION, run, before.versions, after.versions)
    old, new = (flatten(p.settings) | ({} if p.seed is None else {"seed": p.seed}) for p in (before, after))
    yield from _differences(ChangeKind.SETTING, run, old, new)
    by, now_by = ({s.what: s.by for s in p.supplies} for p in (before, after))
    yield from _differences(ChangeKind.SUPPLY, run, by, now_by)


def _differences(kind: ChangeKind, run: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[ResultChange]:
    """Yield every entry that differs, numbers by more than `SAME_SETTING`."""
    for key in [*new, *(key for key in old if key not in new)]:
        was, now = old.get(key), new.get(key)
        if isinstance(was, float) and isinstance(now, float) and math.isclose(was, now, rel_tol=SAME_SETTING):
            continue
        if was != now:
            yield ResultChange(kind=kind, run=run, what=key, unit="", before=was, after=now)


def _has_changed(was: float | None, now: float | None, floor: float) -> bool:
    if was is None or now is None:
        return was is not now
    return abs(now - was) > floor


def heading(changes: ResultChanges) -> str:
    """Return a sentence that says how many changes there are, and since what."""
    count = len(changes.changes)
    what = "Nothing changed" if count == 0 else f"{count} change{'s' if count > 1 else ''}"
    return f"{what} since {changes.baseline or 'the baseline'} (written {changes.baseline_written})."


def thresholds(changes: ResultChanges) -> str:
    """Return the sentence that says which changes are listed."""
    floors = (changes.floors, changes.landmark_floors)
    metric, landmark = ({unit: _cell(value, unit) for unit, value in known.items()} for known in floors)
    return (
        f"Listed: metrics that moved by more than {100 * changes.relative:g} % and more than {metric['m']}, {metric['s']} or "
        f"{metric['rad']} (1e-6 of a plain number); an engine's landmarks by more than {landmark['m']}, {landmark['s']} or "
        f"{landmark['rad']}, the reference's by the floors of the metrics; any other difference."
    )


def rows(changes: ResultChanges) -> list[list[str]]:
    """Return rows of (run, what, before, after, change), for Markdown and for a terminal."""
    return [
        [c.run or "scenario", f"{c.kind.value}: {c.what}", _cell(c.before, c.unit), _cell(c.after, c.unit), _percent(c)]
        for c in changes.changes
    ]


HEADER = ["run", "what", "before", "now", "change"]


def render(changes: ResultChanges) -> str:
    """Return the report's section."""
    text = f"{heading(changes)} {thresholds(changes)}\n"
    return f"{text}\n{table(HEADER, rows(changes), left=4)}" if changes.changes else text


def _cell(value: Any, unit: str) -> str:
    if value is None:
        return GAP
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return str(value)
    shown, scale = DISPLAY_UNITS.get(unit, DisplayUnit(unit, 1.0))
    return f"{number(value, scale, digits=6)} {shown}".rstrip()


def _percent(c: ResultChange) -> str:
    numeric = all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in (c.before, c.after))
    if not numeric or not c.before or not math.isfinite(share := 100 * (c.after - c.before) / abs(c.before)):
        return ""
    return f"{share:+.3g} %"
