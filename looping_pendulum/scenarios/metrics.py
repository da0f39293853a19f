"""The specifications of the metrics of how far an engine's run is from the reference, in one table.

Scenarios limit them by this table, and reports, messages and docs/metrics.md show them by it. The function that computes one
stands in `compare.metrics`, under `@metric` with its name.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from looping_pendulum.pages.numbers import DISPLAY_UNITS, PERCENT, DisplayUnit, number, signed

RMS_END_TIMES = MappingProxyType({f"rms_{end_time}s": end_time for end_time in (0.35, 0.7, 1.0)})
"""Metric -> time [s] up to which the deviation is averaged: the fall, the first loops, nearly all of a trial."""


@dataclass(frozen=True, kw_only=True)
class Metric:
    """One number that says how far an engine's run is from the reference."""

    name: str
    """Key in result.json and in a scenario's tolerances, "rms_0.35s"."""
    unit: str
    """SI unit; '' for a plain number (a relative error, a share of the samples)."""
    shown_in: DisplayUnit
    """Unit in which reports and messages show it."""
    heading: str
    """Heading of its column in tables, without the unit."""
    description: str
    """What it is, as a sentence."""
    has_sign: bool = False
    """Whether its sign says something, so that tables show a plus too: late, and more than the reference, is positive."""
    has_lower_limit: bool = False
    """Whether a limit is the smallest value allowed; otherwise its magnitude must be at most the limit."""

    @property
    def column(self) -> str:
        """Return the heading of its column with the unit, "RMS to 0.35 s [mm]"."""
        return f"{self.heading} [{self.shown_in.name}]"

    @property
    def limit_words(self) -> str:
        """Return "at least" or "at most", to be followed by a limit."""
        return "at least" if self.has_lower_limit else "at most"

    def is_within(self, value: float, limit: float) -> bool:
        """Return whether ``value`` keeps ``limit`` [both SI]."""
        return value >= limit if self.has_lower_limit else abs(value) <= limit

    def cell(self, value: float | None) -> str:
        """Return ``value`` [SI] as a table shows it, in the unit of `column`."""
        return (signed if self.has_sign else number)(value, self.shown_in.per_si_unit)

    def quantity(self, value: float | None) -> str:
        """Return the magnitude or limit ``value`` [SI] with its unit, "0.6 mm"; a gap for None."""
        return number(value, self.shown_in.per_si_unit) + ("" if value is None else f" {self.shown_in.name}")


_MILLIMETRES = DISPLAY_UNITS["m"]
_SECONDS = DisplayUnit("s", 1.0)


def _error_at_halt(name: str, unit: str, heading: str, quantity: str) -> Metric:
    """Return the metric of the error of a quantity at the halt."""
    return Metric(
        name=name,
        unit=unit,
        shown_in=DISPLAY_UNITS[unit],
        heading=heading,
        description=f"{quantity} less the reference's.",
        has_sign=True,
    )


METRICS = MappingProxyType(
    {
        metric.name: metric
        for metric in (
            *(
                Metric(
                    name=name,
                    unit="m",
                    shown_in=_MILLIMETRES,
                    heading=f"RMS to {end_time} s",
                    description=f"Root mean square distance of the light mass from the reference's in the first {end_time} s.",
                )
                for name, end_time in RMS_END_TIMES.items()
            ),
            Metric(
                name="rms_halt",
                unit="m",
                shown_in=_MILLIMETRES,
                heading="RMS to halt",
                description="Root mean square distance of the light mass from the reference's until the reference halts.",
            ),
            _error_at_halt("halting_time_error", "s", "halting error", "Halting time"),
            Metric(
                name="rebound",
                unit="m",
                shown_in=_MILLIMETRES,
                heading="rebound",
                description="Distance between the string's extreme positions after its first rest.",
            ),
            _error_at_halt("drop_error", "m", "drop error", "Drop of the heavy mass at the halt"),
            _error_at_halt("wrap_angle_error", "rad", "wrap angle error", "Wrap angle at the halt"),
            _error_at_halt("free_length_error", "m", "free length error", "Free length at the halt"),
            Metric(
                name="string_stretch",
                unit="m",
                shown_in=_MILLIMETRES,
                heading="stretch",
                description="Largest magnitude of the string's stretch.",
            ),
            Metric(
                name="acceleration_error",
                unit="",
                shown_in=PERCENT,
                heading="acceleration error",
                description="Relative error of the heavy mass's acceleration in a vertical release.",
                has_sign=True,
            ),
            Metric(
                name="tube_fraction",
                unit="",
                shown_in=PERCENT,
                heading="in tube",
                description="Share of the samples that lie in the tube around the reference.",
                has_lower_limit=True,
            ),
            Metric(
                name="simulated_time",
                unit="s",
                shown_in=_SECONDS,
                heading="simulated time",
                description="Time of the run's last sample.",
                has_lower_limit=True,
            ),
        )
    }
)
"""Metric by name, in the order of reports and of result.json."""


def metric_called(name: str) -> Metric:
    """Return the metric ``name``; one that only another version knows, and whose result is read, is a plain number."""
    unknown = Metric(name=name, unit="", shown_in=DisplayUnit("SI", 1.0), heading=name, description="")
    return METRICS.get(name, unknown)
