"""Quantities that a map may vary: fields of `Parameters`, coefficients of effects, and ratios; their values in a map file."""

from __future__ import annotations

import itertools
from collections import ChainMap
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import (
    DependentField,
    Key,
    KeyGroup,
    QuantityField,
    SimpleField,
    input_error,
    one_of,
    whole_number,
)
from looping_pendulum.scenarios.quantities import FILE_KEYS, QUANTITIES, Quantity, quantity_kind
from looping_pendulum.scenarios.units import QuantityKind, factor, unit_text

MAX_AXES = 3
"""Largest number of quantities that a map varies."""
MAX_RUNS = 20_000_000
"""Largest number of runs of the reference without --max-runs: ten minutes at 32 000 runs/s, on two cores."""
COUNT = whole_number("50")
"""Field type of a number of runs."""
FACTORS = MappingProxyType(
    {
        "mass_scale": {"light_mass": "light_mass", "heavy_mass": "heavy_mass"},
        "mass_ratio": {"heavy_mass": "light_mass"},
        "static_ratio": {"static_friction": "kinetic_friction"},
    }
)
"""Ratio -> parameter that it sets -> parameter that it multiplies; each uses what those before it have set."""
ALLOWED_OVERLAP = frozenset({"mass_scale", "mass_ratio"})
"""Ratios that set the same parameter and may still be varied together; the ratio is applied last."""
AXIS_NAMES = MappingProxyType({"free_length": "release_free_length"})
"""Parameter -> name of its axis, where a field of the map has the parameter's own name; arrays need names of their own."""


def _variables() -> dict[str, Quantity]:
    parameters = [QUANTITIES[name] for name in FILE_KEYS if name != "release" and name not in effect_library.COEFFICIENTS]
    coefficients = [
        Quantity(name=name, key=FILE_KEYS.get(name, name), kind=quantity_kind(c), meaning=c.meaning)
        for name, c in effect_library.COEFFICIENTS.items()
    ]
    positive = QuantityKind(unit="", low=0.0, exclusive_low=True)
    ratios = {
        "mass_scale": (replace(positive, example="2"), "factor on both masses, their ratio kept"),
        "mass_ratio": (replace(positive, example="2.5"), "heavy over light mass M2/M1, the light one kept"),
        "static_ratio": (QuantityKind(unit="", low=1.0, example="1.2"), "static over kinetic friction, the kinetic one kept"),
    }
    return {
        **{q.name: replace(q, meaning=f"{q.group}: {q.description()}".rstrip("."), if_absent="") for q in parameters},
        **{q.name: q for q in coefficients},
        **{name: Quantity(name=name, key=name, kind=kind, meaning=meaning) for name, (kind, meaning) in ratios.items()},
    }


VARIABLES = MappingProxyType(_variables())
"""Every quantity that a map may vary, by name."""
_BY_KEY = {key: q for q in VARIABLES.values() for key in (q.name, q.key)}
"""Key under ``parameters`` -> its quantity: "release_angle" or, as in a scenario file, "release.angle"."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """A varied quantity of a map."""

    quantity: Quantity
    written: str
    """Unit in which the map file writes it, used for figures."""
    values: Array
    """Grid: every value [SI], ascending, shape (n,). Sample: lowest and highest value [SI], shape (2,)."""
    logarithmic: bool = False

    @property
    def name(self) -> str:
        """Name of its array in a map."""
        return AXIS_NAMES.get(self.quantity.name, self.quantity.name)

    @property
    def scale(self) -> float:
        """Size of the unit ``written`` in SI units."""
        return float(factor(self.written, self.quantity.kind.unit)) if self.written else 1.0


def _values_field(quantity: QuantityField) -> SimpleField:
    """Return the field type of a list of values."""

    def read(raw: object) -> Array:
        if not isinstance(raw, list) or not raw:
            what = "an empty list, so an empty grid" if raw == [] else quote(raw)
            raise input_error(f"found {what}, needed a list of values; write for example '[{quantity.way_out}]'")
        values = np.array([quantity.read(value) for value in raw])
        if np.any(np.diff(values) <= 0):
            raise input_error("found values out of order or twice, needed each once, rising; sort them")
        return values

    return SimpleField(read, {"type": "array", "minItems": 1, "items": quantity.json_schema})


def _axis_field(variable: Quantity, *, sampled: bool = False) -> SimpleField:
    """Return the field type of a quantity that a map varies: a range, or a list of values."""
    quantity = QuantityField(variable.kind)
    values = _values_field(quantity)
    listed = KeyGroup(keys={"values": Key(values, "The values, instead of a range.", required=True)})
    ends = {"from": Key(quantity, "First value.", required=True), "to": Key(quantity, "Last value.", required=True)}
    spacing = Key(one_of("linear", "log"), "linear, if not given; log: equal factors, not equal steps.")
    count = Key(COUNT, "Number of values; not with `sample`.")
    ranged = KeyGroup(keys={**ends, "count": count, "spacing": spacing})

    def read(raw: Any) -> Axis:
        written = {"values": raw} if isinstance(raw, list) else raw
        is_listed = isinstance(written, dict) and "values" in written
        for other in sorted({*written} - {"values"}, key=str) if is_listed else ():
            raise input_error("found beside 'values', needed only one of them; delete one", str(other))
        keys = (listed if is_listed else ranged).read(written)
        first: Any = written["values"][0] if is_listed else written["from"]
        return Axis(
            quantity=variable,
            written=unit_text(first),
            values=keys["values"] if is_listed and not sampled else _range(keys, written, sampled=sampled),
            logarithmic=keys.get("spacing") == "log",
        )

    schemas = [form.json_schema for form in (ranged, listed, values)]
    return SimpleField(read, {"anyOf": schemas, "description": variable.meaning})


def _range(keys: Mapping[str, Any], written: Mapping[str, Any], *, sampled: bool) -> Array:
    """Return the values of a range; of a sample, its ends. ``written``: its keys as the file has them."""
    for key in ("values", "count") if sampled else ():
        if key in keys:
            raise input_error("found it in a sample, needed 'from' and 'to': the number of runs stands under 'sample'", key)
    if not sampled and "count" not in keys:
        raise input_error("missing, needed the number of values; write for example 'count: 50'", "count")
    low, high, count, is_log = keys["from"], keys["to"], keys.get("count", 2), keys.get("spacing") == "log"
    if low > high or (low == high and count > 1):
        needed = "needed more than 'from'; swap them, or list one under 'values'"
        raise input_error(f"found {quote(written['to'])}, {needed}", "to")
    if count > MAX_RUNS:
        raise input_error(f"found {count} values of one quantity, needed at most {MAX_RUNS}; lower it", "count")
    if is_log and low <= 0:
        raise input_error("found a start of 0 or less, needed one above 0 with 'spacing: log'", "from")
    if count == 1 and low < high:
        raise input_error("found 1 value for a range of two ends, needed 2 or more; or list it under 'values'", "count")
    return np.geomspace(low, high, count) if is_log else np.linspace(low, high, count)


def _keys(*, sampled: bool = False) -> KeyGroup:
    return KeyGroup(keys={key: Key(_axis_field(variable, sampled=sampled)) for key, variable in _BY_KEY.items()})


def _axes(raw: object, before: Mapping[str, Any]) -> tuple[Axis, ...]:
    """Return the axes of a map, of which no two may set the same."""
    if not isinstance(raw, dict) or not 1 <= len(raw) <= MAX_AXES:
        number = f"{len(raw)} quantities" if isinstance(raw, dict) else quote(raw)
        example = "release_angle: {from: 60 deg, to: 130 deg, count: 71}"
        raise input_error(f"found {number}, needed one to {MAX_AXES}; write for example '{example}'")
    # A faulty sample is not among the fields before, but was meant as one
    sampled = before.get("sample", ...) is not None
    axes = _keys(sampled=sampled).read(raw)
    scenario = before.get("scenario")
    for key in raw if scenario and scenario.parameters.release is Release.VERTICAL else ():
        if _BY_KEY[key].name == "release_angle":
            why = "found an angle, but a vertical release hangs at 180 deg"
            raise input_error(f"{why}, needed another quantity; leave it out", key)
    for key, other in itertools.combinations(raw, 2):
        one, two = _BY_KEY[key].name, _BY_KEY[other].name
        both = sorted({*FACTORS.get(one, [one])} & {*FACTORS.get(two, [two])})
        if both and {one, two} != ALLOWED_OVERLAP:
            why = f"found beside {one}, which also sets {both[0]}"
            raise input_error(f"{why}, needed only one of them; leave one out", other)
    return tuple(axes.values())


AXES = DependentField(_axes, _keys().json_schema | {"minProperties": 1, "maxProperties": MAX_AXES})
"""Field type of the quantities that a map varies; the map's `sample` must stand before it."""


def columns(base: Parameters, given: Mapping[str, Array]) -> dict[str, Array]:
    """Return the columns for `solve_batch`: fields and coefficients that differ from ``base``.

    Parameters
    ----------
    base
        Parameters that the runs have in common.
    given
        Varied quantities by the names of their axes (`Axis.name`), SI, shape (n,) each.
    """
    parameters = {axis: name for name, axis in AXIS_NAMES.items()}
    out = base.with_static_friction(
        {parameters.get(name, name): np.asarray(values, dtype=float) for name, values in given.items() if name not in FACTORS}
    )
    # What is set so far comes first, so that a ratio uses a varied value rather than the scenario's
    now = ChainMap(out, vars(base.values()))
    for ratio in (ratio for ratio in FACTORS if ratio in given):
        out |= {target: given[ratio] * now[source] for target, source in FACTORS[ratio].items()}
    return out
