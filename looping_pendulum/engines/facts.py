"""What is known of an engine without running it: how to get it, how it looks in figures, and what was measured of it.

Such facts stand in `FACTS_FILE` in the engine's folder. `research.additions` and `research.engine_range` write what they
measured there. Another package's adapter may state its own as ``FACTS``, an `EngineFacts`, beside its ``engines``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from looping_pendulum.engines import FACTS_FILE
from looping_pendulum.errors import EngineError
from looping_pendulum.pages.numbers import amount
from looping_pendulum.pages.palette import COLOUR_NAMES, MARKERS
from looping_pendulum.reference_ode.parameters import Parameters, Release

ROUNDING_MARGIN = 1e-9
"""Relative margin of a bound, so that rounding does not put a scenario at the very edge outside the range."""
SIGNIFICANT_DIGITS = 2
"""Significant digits of an error in a sentence; whole millimetres are not rounded further."""


# ---- quantities and errors of a measured range


@dataclass(frozen=True, kw_only=True)
class ValidatedQuantity:
    """A quantity of a scenario that determines how difficult it is for an engine."""

    name: str
    unit: str
    """Unit in which it is shown; empty: a pure number."""
    per_unit: float
    """Shown units per SI unit."""
    of: Callable[[Parameters], float | None]
    """Function that returns its value [SI]; None: the scenario has no such quantity."""


def _drag(name: str, mass: Callable[[Parameters], float], power: int) -> Callable[[Parameters], float]:
    """Return a function for the ratio of drag to inertia on a path of one free length: coefficient * length**power / mass."""
    return lambda p: p.coefficients[name] * p.free_length**power / mass(p)


def _friction_ratio(p: Parameters) -> float | None:
    """Return static over kinetic friction; None without friction."""
    kinetic, static = p.coefficients["kinetic_friction"], p.coefficients["static_friction"]
    return static / kinetic if kinetic > 0 else None


QUANTITIES: tuple[ValidatedQuantity, ...] = (
    ValidatedQuantity(name="mass ratio M2/M1", unit="", per_unit=1.0, of=lambda p: p.heavy_mass / p.light_mass),
    ValidatedQuantity(name="light mass", unit="g", per_unit=1e3, of=lambda p: p.light_mass),
    ValidatedQuantity(
        name="release angle",
        unit="deg",
        per_unit=180 / math.pi,
        of=lambda p: None if p.release is Release.VERTICAL else p.release_angle,
    ),
    ValidatedQuantity(name="rod radius", unit="mm", per_unit=1e3, of=lambda p: p.rod_radius),
    ValidatedQuantity(name="free length", unit="cm", per_unit=1e2, of=lambda p: p.free_length),
    ValidatedQuantity(name="kinetic friction", unit="", per_unit=1.0, of=lambda p: p.coefficients["kinetic_friction"]),
    ValidatedQuantity(name="static over kinetic friction", unit="", per_unit=1.0, of=_friction_ratio),
    ValidatedQuantity(name="light mass's drag l/M1", unit="", per_unit=1.0, of=_drag("light_drag", lambda p: p.light_mass, 1)),
    ValidatedQuantity(name="heavy mass's drag l/M2", unit="", per_unit=1.0, of=_drag("heavy_drag", lambda p: p.heavy_mass, 1)),
    ValidatedQuantity(name="string's drag l^2/M1", unit="", per_unit=1.0, of=_drag("string_drag", lambda p: p.light_mass, 2)),
)


VALIDATED_METRICS = ("rms_0.35s", "rms_0.7s", "halting_time_error")
"""Metrics whose distribution over the scenarios is measured; deviations to the end of the run if that is earlier."""


@dataclass(frozen=True, kw_only=True)
class ErrorDistribution:
    """Distribution of one error over the scenarios [SI]."""

    count: int
    """Number of scenarios in which it could be measured."""
    median: float
    ninety: float
    """90th percentile: 90 % of the scenarios have at most this error."""
    worst: float


@dataclass(frozen=True, kw_only=True)
class ValidatedRange:
    """The range of scenarios over which one profile's accuracy was measured, and the errors there."""

    profile: str
    scenarios: int
    """Number of scenarios that were run."""
    failed: int
    """Number of runs that did not come to their proper end; `errors` does not include them."""
    releases: tuple[Release, ...]
    bounds: Mapping[str, tuple[float, float]]
    """Name of a `ValidatedQuantity` -> smallest and largest value among the scenarios [SI]."""
    errors: Mapping[str, ErrorDistribution]
    """Metric of `VALIDATED_METRICS` -> the distribution of its magnitude."""

    def outside(self, parameters: Parameters) -> tuple[str, ...]:
        """Return a phrase for each quantity of ``parameters`` outside the range: "rod radius 2 mm (measured: 3 to 15)"."""
        phrases = []
        for quantity in QUANTITIES:
            bounds, value = self.bounds.get(quantity.name), quantity.of(parameters)
            if bounds is None or value is None:
                continue
            low, high = bounds
            if not low * (1 - ROUNDING_MARGIN) <= value <= high * (1 + ROUNDING_MARGIN):
                shown = " ".join([amount(value, quantity.per_unit, 3), *([quantity.unit] if quantity.unit else [])])
                measured = f"{amount(low, quantity.per_unit, 3)} to {amount(high, quantity.per_unit, 3)}"
                phrases.append(f"{quantity.name} {shown} (measured: {measured})")
        return tuple(phrases)


# ---- facts of a variant and of an engine


@dataclass(frozen=True, kw_only=True)
class Addition:
    """Something that the adapter adds to the engine, and what the variant is without it.

    Errors are the root mean square distances of the light mass from the reference on ten_to_one with the quick profile,
    up to 0.35 s and up to 0.7 s [m].
    """

    what: str
    errors: tuple[float, float]
    errors_without: tuple[float, float] | None
    """None: without it that run does not come to its proper end."""

    def __str__(self) -> str:
        """Return a sentence on the addition, with the errors with and without it."""
        if self.errors_without is None:
            return f"{self.what}: without it ten_to_one does not come to its proper end"
        ours, without = (
            " / ".join(amount(error, 1e3, SIGNIFICANT_DIGITS) for error in errors) + " mm"
            for errors in (self.errors, self.errors_without)
        )
        return f"{self.what}: without it ten_to_one is off by {without} up to 0.35 / 0.7 s, with it by {ours}"


@dataclass(frozen=True, kw_only=True)
class VariantFacts:
    """How a variant looks in figures and on pages, and what was measured of it; everything may be left out."""

    colour: str = ""
    """One of `palette.COLOUR_NAMES`; empty: one is chosen."""
    symbol: str = ""
    """One of `palette.MARKERS`; empty: one is chosen."""
    additions: tuple[Addition, ...] = ()
    measured: tuple[ValidatedRange, ...] = ()
    known_failures: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Measured reason -> the checks of `conformance` that the variant fails by it; see `Abilities.known_failures`."""

    @property
    def failed_checks(self) -> dict[str, str]:
        """Return the checks that the variant is known to fail -> the reason."""
        return {check: reason for reason, checks in self.known_failures.items() for check in checks}

    def __post_init__(self) -> None:
        """Refuse a colour or a symbol that the pages do not have."""
        for name, value, known in (("colour", self.colour, COLOUR_NAMES), ("symbol", self.symbol, tuple(MARKERS))):
            if value and value not in known:
                raise EngineError(f"facts: {name}: found {value!r}, needed one of {', '.join(known)}")


@dataclass(frozen=True, kw_only=True)
class Package:
    """A package that an engine needs."""

    pip: str
    """Its name for pip."""
    systems: str = ""
    """The systems for which PyPI has it compiled, if they are not all (docs/install.md)."""


@dataclass(frozen=True, kw_only=True)
class EngineFacts:
    """What is known of an engine without running it."""

    title: str = ""
    """Its name in headings; empty: the adapter's."""
    packages: Mapping[str, Package] = field(default_factory=dict)
    """Package, as Python imports it -> how to get it."""
    variants: Mapping[str, VariantFacts] = field(default_factory=dict)

    def variant(self, name: str) -> VariantFacts:
        """Return the facts of the variant ``name``; empty ones if none are stated."""
        return self.variants.get(name, VariantFacts())


def facts_from_plain(tree: Mapping[str, Any]) -> EngineFacts:
    """Return the facts of a file of facts, as JSON has them."""

    def addition(row: Mapping[str, Any]) -> Addition:
        without = row["errors_without"]
        return Addition(what=row["what"], errors=tuple(row["errors"]), errors_without=without and tuple(without))

    def measured(row: Mapping[str, Any]) -> ValidatedRange:
        return ValidatedRange(**{
            **row,
            "releases": tuple(Release(name) for name in row["releases"]),
            "bounds": {name: (low, high) for name, (low, high) in row["bounds"].items()},
            "errors": {name: ErrorDistribution(**spread) for name, spread in row["errors"].items()},
        })  # fmt: skip

    def variant(row: Mapping[str, Any]) -> VariantFacts:
        return VariantFacts(**{
            **row,
            "additions": tuple(addition(each) for each in row.get("additions", ())),
            "measured": tuple(measured(each) for each in row.get("measured", ())),
            "known_failures": {reason: tuple(checks) for reason, checks in row.get("known_failures", {}).items()},
        })  # fmt: skip

    return EngineFacts(
        title=tree.get("title", ""),
        packages={name: Package(**row) for name, row in tree.get("packages", {}).items()},
        variants={name: variant(row) for name, row in tree.get("variants", {}).items()},
    )


def read_facts(path: Path) -> EngineFacts:
    """Return the facts in the file at ``path``, such as the `FACTS_FILE` of another package's adapter."""
    return facts_from_plain(json.loads(path.read_text(encoding="utf-8")))


@cache
def own_facts(engine: str) -> EngineFacts:
    """Return the facts of an engine of this package; empty ones if it has no such engine."""
    path = facts_path(engine)
    return read_facts(path) if path.is_file() else EngineFacts()


def facts_path(engine: str) -> Path:
    """Return the path of the facts of an engine of this package."""
    return Path(str(files(__package__).joinpath(engine, FACTS_FILE)))
