"""Writes the report of a finished map: `map.md`, its figure, and a copy of the map file.

The map is read from its store chunk by chunk, so that memory use does not grow with it.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
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
from looping_pendulum.sweep.cells import ENDING_DESCRIPTIONS, ENDINGS, FIELDS, Values
from looping_pendulum.sweep.map_file import MapPlan
from looping_pendulum.sweep.quantities import Axis
from looping_pendulum.sweep.store import MapStore

REPORT = "map.md"
COPY = "map.yaml"
FIGURE = "halting_time.png"
RANGES = tuple(name for name, field in FIELDS.items() if field.kind in (np.float64, np.int32))
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
    ends: Counter[str] = field(default_factory=Counter)
    """Ending -> number of runs that end so without a halt."""
    ranges: dict[str, ValueRange] = field(default_factory=lambda: {name: ValueRange() for name in RANGES})
    where_halting: dict[str, ValueRange] = field(default_factory=lambda: defaultdict(ValueRange))
    """Varied quantity -> range of its values in runs that halt."""

    def add(self, values: Values, given: Mapping[str, Array]) -> None:
        """Add runs, by their fields and by the values of the varied quantities."""
        halted = np.isfinite(values["halting_time"])
        self.runs += len(halted)
        self.halted += int(halted.sum())
        self.ends.update(ENDINGS[code] for code in values["end"][~halted].tolist())
        for name, of_field in self.ranges.items():
            # A negative count means that the engine does not report it
            known = values[name].astype(float)
            of_field.add(known if FIELDS[name].kind is np.float64 else known[known >= 0])
        for name, varied in given.items():
            self.where_halting[name].add(varied[halted])


def write(plan: MapPlan, store: MapStore, folder: Path, *, figures: bool) -> list[EngineSummary]:
    """Write report, figure and a copy of the map file to ``folder``, the same bytes for the same map; return the summaries."""
    write_atomically(folder / COPY, plan.text)
    summaries = summarize(plan, store)
    caption, png = "", b""
    if figures:
        from looping_pendulum.sweep.figures import draw  # matplotlib takes half a second to import

        with optional_output("the figure"):
            caption, png = draw(plan, store.path)
    if png:
        write_atomically(folder / FIGURE, png)
    write_atomically(folder / REPORT, map_markdown(plan, summaries, store.attributes, caption))
    return summaries


def summarize(plan: MapPlan, store: MapStore) -> list[EngineSummary]:
    """Read a whole map once and return one summary per engine."""
    summaries = {engine: EngineSummary(engine=engine) for engine in plan.engines}
    for region in plan.regions():
        summaries[plan.engine(region)].add(store.read(region), plan.values_in(region))
    return list(summaries.values())


def map_markdown(plan: MapPlan, summaries: list[EngineSummary], metadata: Mapping[str, Any], caption: str) -> str:
    """Return the report in Markdown: verdict, figure, tables, provenance. ``metadata``: the store's attributes."""
    shown = {"plan": plan, "summaries": summaries, "metadata": metadata, "caption": caption, "figure": FIGURE}
    report = sections(_templates(), "map.md.jinja", **shown)
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
    environment.globals |= {"ENDING_DESCRIPTIONS": ENDING_DESCRIPTIONS, "FIELDS": FIELDS}
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
