"""Writes the report of a finished map: `map.md`, its figure, and a copy of the map file.

The map is read from its store chunk by chunk, so that memory use does not grow with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment

from looping_pendulum.files import optional_output, write_atomically
from looping_pendulum.pages.markdown import fenced
from looping_pendulum.pages.numbers import number
from looping_pendulum.pages.templates import markdown_templates, sections
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.sweep.cells import ENDING_DESCRIPTIONS, ENDINGS, FIELDS
from looping_pendulum.sweep.plan import Axis, MapPlan, Sample
from looping_pendulum.sweep.store import MapStore, attributes

REPORT = "map.md"
COPY = "map.yaml"
RANGES = tuple(field.name for field in FIELDS if field.dtype in ("float64", "int32"))
"""Fields of which a report gives the smallest, mean and largest value: not codes."""


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


def write(plan: MapPlan, store: MapStore, folder: Path, *, figures: bool) -> list[EngineSummary]:
    """Write report, figure and a copy of the map file to ``folder``, the same bytes for the same map; return the summaries."""
    write_atomically(folder / COPY, plan.text)
    summaries = summarize(plan, store)
    drawn: dict[str, tuple[str, bytes]] = {}
    if figures:
        from looping_pendulum.sweep.figures import draw  # matplotlib takes half a second to import

        with optional_output("the figure"):
            drawn = draw(plan, store.path)
    for name, (_, png) in drawn.items():
        write_atomically(folder / name, png)
    write_atomically(folder / REPORT, map_markdown(plan, summaries, {name: caption for name, (caption, _) in drawn.items()}))
    return summaries


def summarize(plan: MapPlan, store: MapStore) -> list[EngineSummary]:
    """Read a whole map once and return one summary per engine."""
    axes = [axis.name for axis in plan.design.axes]
    summaries = {
        engine: EngineSummary(engine=engine, where_halting={name: ValueRange() for name in axes}) for engine in plan.engines
    }
    for region in plan.regions():
        _add(summaries[plan.engine(region)], store.read(region), plan.values_in(region))
    return list(summaries.values())


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


def map_markdown(plan: MapPlan, summaries: list[EngineSummary], captions: dict[str, str]) -> str:
    """Return the report in Markdown: verdict, figures, tables, provenance."""
    report = sections(
        _templates(),
        "map.md.jinja",
        plan=plan,
        summaries=summaries,
        captions=captions,
        metadata=attributes(plan),
        sample=plan.design if isinstance(plan.design, Sample) else None,
    )
    # Not by the template, which removes empty lines: this is the file as it is
    return "\n".join([*report, f"## Map file\n\n{fenced(plan.text, 'yaml')}\n"])


@cache
def _templates() -> Environment:
    environment = markdown_templates("looping_pendulum.sweep")
    environment.filters |= {
        "formatted": lambda value, axis: _formatted(axis, float(value)),
        "percent_of": _percent,
        "sentence": verdict,
    }
    environment.globals |= {"ENDING_DESCRIPTIONS": ENDING_DESCRIPTIONS, "UNITS": {field.name: field.unit for field in FIELDS}}
    return environment


def verdict(one: EngineSummary, *, several: bool = False) -> str:
    """Return the first sentence about a map: "12 000 runs: 8 000 (66.7 %) halt, 0.29 s to 4.41 s after the release.""."""
    begin = f"{one.engine}: " if several else ""
    halts = f"{one.halted} ({_percent(one.halted, one.runs)}) halt"
    times = one.ranges["halting_time"]
    if times.count:
        halts += f", {number(times.low, digits=4)} s to {number(times.high, digits=4)} s after the release"
    return f"{begin}{one.runs} runs: {halts}."


def _percent(part: int, whole: int) -> str:
    return f"{number(100 * part / whole)} %"


def _formatted(axis: Axis, value: float) -> str:
    """Return ``value`` [SI] in the unit of the map file."""
    return f"{number(value / axis.scale, digits=6)} {axis.written}".strip()
