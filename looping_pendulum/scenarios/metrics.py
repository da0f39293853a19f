"""The registry of the metrics, which say how far an engine's run is from the reference.

A metric is one function with its specification, `@metric(...)`. Those of this package stand in `compare.metrics`; another
package offers the module of its own by an entry point of the group `ENTRY_POINTS`. Scenarios limit metrics by this registry,
and reports, results, messages, pytest and docs/metrics.md show them by it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal, TypeVar

from looping_pendulum.errors import HarnessError, ScenarioError
from looping_pendulum.pages.numbers import DISPLAY_UNITS, PERCENT, DisplayUnit, number, signed

OWN_MODULE = "looping_pendulum.compare.metrics"
"""Module of the metrics of this package, which may import what scenarios may not; it is imported when a metric is asked for."""
ENTRY_POINTS = "looping_pendulum.metrics"
"""Group of entry points by which other packages offer metrics: name -> module whose import registers them."""

Function = TypeVar("Function", bound=Callable[[Any], float | None])
"""Function that returns a metric's value [SI] for a `compare.metrics.ComparedRun`; None where it is not defined."""


class MetricWarning(UserWarning):
    """Another package's metrics cannot be used, or one of them failed; the message says why and what to do."""


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
    function: Callable[[Any], float | None] = lambda _: None
    """Function that computes it, see `Function`; without one it is a number that something else computes."""
    has_sign: bool = False
    """Whether its sign says something, so that tables show a plus too: late, and more than the reference, is positive."""
    has_lower_limit: bool = False
    """Whether a limit is the smallest value allowed; otherwise its magnitude must be at most the limit."""
    table: Literal["verdict", "detail", ""] = ""
    """Table of the report that has a column for it after the others; '': none, or one to which the report gives a place."""

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


class MetricRegistry(Mapping[str, Metric]):
    """Metric by name, in the order of reports and of result.json; all are registered when one is first asked for."""

    def __init__(self) -> None:
        self._metrics: dict[str, Metric] = {}
        self._is_loaded = False

    def add(self, metric: Metric) -> None:
        """Register a metric.

        Raises
        ------
        ScenarioError
            If its name is taken by another function.
        """
        taken = self._metrics.get(metric.name)
        # The same function again is that of a module or a notebook's cell that is run once more
        if taken is not None and _origin(taken) != _origin(metric):
            raise ScenarioError(f"metric {metric.name!r}: the name is taken by {_origin(taken)}; needed another name")
        self._metrics[metric.name] = metric

    def load(self) -> None:
        """Register the metrics of this package and of all others; a module that cannot be used is left out with a warning."""
        if self._is_loaded:
            return
        self._is_loaded = True
        import_module(OWN_MODULE)
        for point in sorted(set(entry_points(group=ENTRY_POINTS)), key=lambda point: (point.name, point.value)):
            before = dict(self._metrics)
            try:
                point.load()
            except (Exception, SystemExit) as error:  # foreign code may raise anything, and must not end this program
                self._metrics = before
                warnings.warn(_fault(point, error), MetricWarning, stacklevel=2)

    def __getitem__(self, name: str) -> Metric:
        self.load()
        return self._metrics[name]

    def __iter__(self) -> Iterator[str]:
        self.load()
        return iter(self._metrics)

    def __len__(self) -> int:
        self.load()
        return len(self._metrics)


METRICS = MetricRegistry()
"""All metrics."""


def metric(
    name: str = "",
    *,
    unit: str,
    heading: str,
    shown_in: DisplayUnit | None = None,
    has_sign: bool = False,
    has_lower_limit: bool = False,
    table: Literal["verdict", "detail", ""] = "detail",
) -> Callable[[Function], Function]:
    """Return a decorator that registers a function as a metric; the first line of its docstring is the description.

    Parameters
    ----------
    name
        Key in result.json and in a scenario's tolerances; the function's name if empty.
    unit, heading, has_sign, has_lower_limit, table
        As in `Metric`.
    shown_in
        Unit in which reports and messages show it; by default thousandths of the SI unit, or percent of a plain number.
    """

    def register(function: Function) -> Function:
        lines = (function.__doc__ or "").strip().splitlines()
        if not lines:
            raise ScenarioError(f"metric {function.__name__!r}: found no docstring, needed one line that says what it is")
        METRICS.add(
            Metric(
                name=name or function.__name__,
                unit=unit,
                shown_in=shown_in or (DISPLAY_UNITS.get(unit, DisplayUnit(unit, 1.0)) if unit else PERCENT),
                heading=heading,
                description=lines[0],
                function=function,
                has_sign=has_sign,
                has_lower_limit=has_lower_limit,
                table=table,
            )
        )
        return function

    return register


def metric_called(name: str) -> Metric:
    """Return the metric ``name``; one that only another version knows, and whose result is read, is a plain number."""
    if name in METRICS:
        return METRICS[name]
    return Metric(name=name, unit="", shown_in=DisplayUnit("SI", 1.0), heading=name, description="")


def _origin(metric: Metric) -> str:
    return f"{metric.function.__module__}.{metric.function.__qualname__}"


def _fault(point: EntryPoint, error: BaseException) -> str:
    why = str(error) if isinstance(error, HarnessError) else f"{type(error).__name__}: {error}"
    package = point.dist.name if point.dist else "?"
    return (
        f"the metrics of {point.value} of the package {package} are left out: {' '.join(why.split())}; "
        "correct or uninstall that package"
    )
