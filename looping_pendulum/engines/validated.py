"""Ranges of scenarios over which a variant's accuracy was measured, the errors there, and whether a scenario is inside.

`research.engine_range` measures it on seeded random scenarios and writes `validated.json`; a third party's engine may declare
its own in `Abilities.validated`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from looping_pendulum.pages.numbers import amount
from looping_pendulum.reference_ode.parameters import Parameters, Release

FILE = "validated.json"
"""File beside this module with what `research.engine_range` measured of the shipped variants."""
ROUNDING_MARGIN = 1e-9
"""Relative margin of a bound, so that rounding does not put a scenario at the very edge outside the range."""


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
    releases: frozenset[Release]
    bounds: Mapping[str, tuple[float, float]]
    """Name of a `ValidatedQuantity` -> smallest and largest value among the scenarios [SI]."""
    errors: Mapping[str, ErrorDistribution]
    """Metric of `VALIDATED_METRICS` -> the distribution of its magnitude."""


def outside_range(validated: Sequence[ValidatedRange], profile: str, parameters: Parameters) -> tuple[str, ...]:
    """Return the quantities of ``parameters`` outside the range over which a variant's ``profile`` was measured.

    Each is a phrase such as "mass ratio M2/M1 30 (measured: 1.6 to 19)". A variant that states no range gives none. If it
    states several ranges, the one with the fewest quantities outside counts.
    """
    known = [each for each in validated if each.profile == profile]
    if not known:
        return ()
    if all(parameters.release not in each.releases for each in known):
        return (f"release {parameters.release.value!r} (measured: {', '.join(sorted(r.value for r in known[0].releases))})",)
    return min((_outside(each, parameters) for each in known), key=len)


def _outside(validated: ValidatedRange, parameters: Parameters) -> tuple[str, ...]:
    """Return a phrase for each quantity outside one range."""
    phrases = []
    for quantity in QUANTITIES:
        bounds, value = validated.bounds.get(quantity.name), quantity.of(parameters)
        if bounds is None or value is None:
            continue
        low, high = bounds
        if not low * (1 - ROUNDING_MARGIN) <= value <= high * (1 + ROUNDING_MARGIN):
            shown = " ".join([amount(value, quantity.per_unit, 3), *([quantity.unit] if quantity.unit else [])])
            measured = f"{amount(low, quantity.per_unit, 3)} to {amount(high, quantity.per_unit, 3)}"
            phrases.append(f"{quantity.name} {shown} (measured: {measured})")
    return tuple(phrases)


def shipped_range(label: str) -> tuple[ValidatedRange, ...]:
    """Return the measured ranges of the variant ``label``, "mujoco:beads"; empty: none was measured."""
    return _shipped_ranges().get(label, ())


@cache
def _shipped_ranges() -> dict[str, tuple[ValidatedRange, ...]]:
    path = files(__package__).joinpath(FILE)
    tree = json.loads(path.read_text(encoding="utf-8"))
    return {label: tuple(from_plain(each) for each in ranges) for label, ranges in tree.items()}


def to_plain(validated: ValidatedRange) -> dict[str, Any]:
    """Return ``validated`` as plain data for JSON."""
    return {
        "profile": validated.profile,
        "scenarios": validated.scenarios,
        "failed": validated.failed,
        "releases": sorted(release.value for release in validated.releases),
        "bounds": {name: list(pair) for name, pair in validated.bounds.items()},
        "errors": {name: vars(spread) for name, spread in validated.errors.items()},
    }


def from_plain(tree: dict[str, Any]) -> ValidatedRange:
    """Return the range that `to_plain` wrote as ``tree``."""
    return ValidatedRange(
        profile=tree["profile"],
        scenarios=tree["scenarios"],
        failed=tree["failed"],
        releases=frozenset(Release(name) for name in tree["releases"]),
        bounds={name: (low, high) for name, (low, high) in tree["bounds"].items()},
        errors={name: ErrorDistribution(**spread) for name, spread in tree["errors"].items()},
    )
