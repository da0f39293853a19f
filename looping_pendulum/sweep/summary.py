"""Summarizes a finished map, read from its store chunk by chunk, so that memory use does not grow with the map."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.sweep.fields import ENDINGS
from looping_pendulum.sweep.plan import MapPlan
from looping_pendulum.sweep.store import stored_name

RANGES = (
    "halting_time",
    "halting_wrap_angle",
    "halting_free_length",
    "drop",
    "stops",
    "slip_count",
    "slack_intervals",
    "end_time",
)
"""Fields of which a report gives the smallest, mean and largest value."""


@dataclass
class ValueRange:
    """Smallest, mean and largest of the finite values added so far."""

    low: float = float("inf")
    high: float = float("-inf")
    total: float = 0.0
    count: int = 0

    def add(self, values: Array) -> None:
        """Add ``values``; those that are not finite are ignored."""
        values = values[np.isfinite(values)]
        if len(values):
            self.low, self.high = min(self.low, float(values.min())), max(self.high, float(values.max()))
            self.total, self.count = self.total + float(values.sum()), self.count + len(values)

    @property
    def mean(self) -> float:
        """Mean of the values; NaN if there are none."""
        return self.total / self.count if self.count else float("nan")


@dataclass
class EngineSummary:
    """Summary of one engine's runs."""

    engine: str
    runs: int = 0
    halted: int = 0
    ends: dict[str, int] = field(default_factory=dict)
    """Ending -> number of runs that end so without a halt."""
    ranges: dict[str, ValueRange] = field(default_factory=lambda: {name: ValueRange() for name in RANGES})
    where_halting: dict[str, ValueRange] = field(default_factory=dict)
    """Varied quantity -> range of its values in runs that halt."""


def summarize(plan: MapPlan, store: Path) -> list[EngineSummary]:
    """Read a whole map once and return one summary per engine."""
    group = zarr.open_group(store, mode="r", use_consolidated=False)
    summaries = [EngineSummary(engine=engine) for engine in plan.engines]
    stored = set(group.array_keys())
    arrays: dict[str, Any] = {name: group[stored_name(stored, name)] for name in (*RANGES, "end")}
    for summary in summaries:
        summary.where_halting = {axis.name: ValueRange() for axis in plan.design.axes}
    for index in range(plan.units):
        unit = plan.unit(index)
        where = (unit.engine, *unit.region) if plan.several else unit.region
        values = {name: np.asarray(array[where]).ravel() for name, array in arrays.items()}
        _add(summaries[unit.engine], values, plan.design.values_in(unit.region))
    return summaries


def _add(summary: EngineSummary, values: dict[str, Any], given: dict[str, Array]) -> None:
    halted = np.isfinite(values["halting_time"])
    summary.runs += len(halted)
    summary.halted += int(halted.sum())
    for code, count in zip(*np.unique(values["end"][~halted], return_counts=True), strict=True):
        ending = ENDINGS[int(code)]
        summary.ends[ending] = summary.ends.get(ending, 0) + int(count)
    for name in RANGES:
        # A negative count means that the engine does not report it.
        known = values[name][values[name] >= 0] if values[name].dtype.kind == "i" else values[name]
        summary.ranges[name].add(known.astype(float))
    for name, varied in given.items():
        summary.where_halting[name].add(varied[halted])
