"""Lists what moved between two results of the same scenario: two flat tables of values, compared key by key.

`changes.json` is `ResultChanges` as JSON: one object per dataclass, one key per field, SI and radians, and first the key
``schema`` with its id and version. It is written beside `result.json`, which does not depend on the baseline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from looping_pendulum.compare.json_text import LENGTH, JsonResult, Keys, flatten, plain
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.errors import ResultError
from looping_pendulum.pages.numbers import DISPLAY_UNITS, GAP, DisplayUnit, number
from looping_pendulum.scenarios.metrics import metric_called

SAME_SETTING = 1e-9
"""Largest relative difference of equal settings: some are computed, and their last bits depend on the processor."""
MIN_RELATIVE_CHANGE = 0.01
"""Smallest change of a metric that is listed, as a fraction of its earlier value."""
MIN_CHANGE = 1e-6
"""Smallest change of a metric, or of a landmark of the reference, that is listed [SI]; what is smaller is rounding."""
MIN_LANDMARK_CHANGES = {"m": 1e-4, "s": 1e-4, "rad": 1e-3}
"""SI unit -> smallest change of an engine's landmark that is listed: a tenth of the sample interval, and the motion in it."""
LANDMARK_UNITS = {
    "halting_time": "s",
    "light_reaches_rod": "s",
    "slip_onsets": "s",
    "time": "s",
    "drop_at_halt": "m",
    "free_length_at_halt": "m",
    "height_change": "m",
    "value": "m",
    "wrap_angle_at_halt": "rad",
}
"""Key of a landmark, or of a part of one -> SI unit, of those that are measured."""
LARGEST_NUMBER = 10**308
"""Numbers from here on are compared as texts."""
MAX_CONSOLE_CHANGES = 40
"""Largest number of changes that the terminal shows; the report has all."""
REFERENCE, SCENARIO = "reference", "scenario"


@dataclass(frozen=True, kw_only=True)
class ResultChange:
    """One value that differs between two results."""

    run: str
    """"scenario", "reference" or "pymunk:chain, quick"."""
    what: str
    """Keys of the value, "metrics: rms_0.7s"."""
    unit: str
    """SI unit; '' for a pure number and for what is not a number."""
    before: Any
    """Earlier value; None if there was none."""
    after: Any
    """Present value; None if there is none."""
    tolerance: float
    """Largest change of a number here that is not listed."""

    def cells(self) -> list[str]:
        """Return its row in a table: run, what, before, after, relative change, tolerance."""
        before, after = _cell(self.before, self.unit), _cell(self.after, self.unit)
        if not (_is_number(self.before) or _is_number(self.after)):
            return [self.run, self.what, before, after, "", ""]
        return [self.run, self.what, before, after, _percent(self.before, self.after), _cell(self.tolerance, self.unit)]


@dataclass(frozen=True, kw_only=True)
class ResultChanges(JsonResult):
    """All differences between two results."""

    SCHEMA_ID = "looping-pendulum/changes"
    SCHEMA_VERSION = 2

    scenario: str
    baseline: str
    """Path of the earlier result."""
    baseline_written: str
    """Date and time at which that was written, UTC."""
    relative: float
    """Smallest relative change of a metric that is listed."""
    changes: tuple[ResultChange, ...]

    @property
    def heading(self) -> str:
        """A sentence that says how many changes there are, and since what."""
        count = len(self.changes)
        what = "Nothing changed" if count == 0 else f"{count} change{'s' if count > 1 else ''}"
        return f"{what} since {self.baseline or 'the baseline'} (written {self.baseline_written})."

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Return header and rows of the changes, for Markdown and for a terminal."""
        return ["run", "what", "before", "now", "change", "not listed up to"], [change.cells() for change in self.changes]


def read_baseline(path: Path, scenario: str) -> ComparisonResult:
    """Read the result of an earlier `compare` of ``scenario``; a folder means the result.json in it.

    Raises
    ------
    ResultError
        If there is none, if it is of another scenario, or from a later version.
    """
    file = path / ComparisonResult.FILE if path.is_dir() else path
    try:
        result = ComparisonResult.read(file)
    except ResultError as error:
        raise ResultError(f"--baseline: {error}") from None
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
    old, new = (flatten(_compared(result)) for result in (before, after))
    # Those that are gone come last in their run
    runs = list(dict.fromkeys(keys[0] for keys in [*new, *old]))
    every = sorted(dict.fromkeys([*new, *old]), key=lambda keys: runs.index(keys[0]))
    alone = {run for run in runs if (run, "status") in old.keys() ^ new.keys()}
    uneven = {keys[:-1] for keys in every if keys[-1] == LENGTH and old.get(keys) != new.get(keys)}
    changes = []
    for keys in every:
        # Its status says that a run is in one result alone
        if keys[0] in alone and keys[1:] != ("status",):
            continue
        # Events are told apart by their index: if one is missing, all that follow would be compared with the wrong one
        if keys[-1] != LENGTH and any(keys[:n] in uneven for n in range(len(keys))):
            continue
        was, now, unit = old.get(keys), new.get(keys), _unit(keys)
        tolerance = _tolerance(keys, unit, was, relative)
        if abs(now - was) > tolerance if _is_number(was) and _is_number(now) else was != now:
            what = ": ".join(keys[1:])
            changes.append(ResultChange(run=keys[0], what=what, unit=unit, before=was, after=now, tolerance=tolerance))
    return ResultChanges(
        scenario=after.scenario,
        baseline=source,
        baseline_written=before.clock.written,
        relative=relative,
        changes=tuple(changes),
    )


def _compared(result: ComparisonResult) -> dict[str, Any]:
    """Return run -> what is compared of it; texts, and numbers that follow from others, are left out."""
    exact = result.reference
    runs = {
        ", ".join(part for part in (engine.label, engine.profile) if part): {
            "status": engine.status,
            "tolerances": {t.metric: {"outcome": t.outcome, "limit": t.limit} for t in result.judged(engine)},
            "metrics": engine.metrics,
            "landmarks": engine.landmarks,
            "provenance": engine.provenance,
        }
        for engine in result.engines
    }
    return {
        SCENARIO: {**plain(result.parameters), "duration": result.duration},
        REFERENCE: {"landmarks": plain(exact.landmarks), "provenance": plain(exact.provenance)},
        **{run: plain(compared) for run, compared in runs.items()},
    }


def _unit(keys: Keys) -> str:
    """Return the SI unit of a number, of those that have one."""
    if "landmarks" in keys:
        return "" if keys[-1] == LENGTH else next((LANDMARK_UNITS[key] for key in reversed(keys) if key in LANDMARK_UNITS), "")
    if keys[1:2] == ("metrics",) or keys[-1] == "limit":
        return metric_called(keys[2]).unit
    return ""


def _tolerance(keys: Keys, unit: str, was: Any, relative: float) -> float:
    """Return the largest change of a number that is not listed."""
    size = abs(was) if _is_number(was) else 0.0
    if keys[1:2] == ("metrics",):
        return max(MIN_CHANGE, relative * size)
    if "landmarks" in keys and unit:
        return MIN_CHANGE if keys[0] == REFERENCE else MIN_LANDMARK_CHANGES[unit]
    return SAME_SETTING * size


def _is_number(value: Any) -> TypeGuard[float]:
    # A whole number of hundreds of digits, which JSON may hold, cannot be calculated with
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < LARGEST_NUMBER


def _cell(value: Any, unit: str) -> str:
    if value is None:
        return GAP
    if not _is_number(value):
        return str(value)
    shown, scale = DISPLAY_UNITS.get(unit, DisplayUnit(unit, 1.0))
    return f"{number(value, scale, digits=6)} {shown}".rstrip()


def _percent(before: Any, after: Any) -> str:
    """Return the relative change of a number; empty where there is none."""
    if not (_is_number(before) and _is_number(after)) or not before:
        return ""
    share = 100 * (after - before) / abs(before)
    return f"{share:+.3g} %" if math.isfinite(share) else ""
