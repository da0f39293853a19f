"""Read the range or the list of values of one quantity of a map file."""

from __future__ import annotations

from typing import Any

import numpy as np

from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import Key, KeyGroup, QuantityField, SimpleField, input_error, one_of, whole_number
from looping_pendulum.scenarios.units import factor, unit_text
from looping_pendulum.sweep.plan import Axis
from looping_pendulum.sweep.quantities import Variable

MAX_RUNS = 20_000_000
"""Largest number of runs of the reference without --max-runs: ten minutes at 32 000 runs/s, on two cores."""
COUNT = whole_number("50")
"""Field type of a number of runs."""


def axis_field(variable: Variable) -> SimpleField:
    """Return the field type of a quantity that a map varies: a range, or a list of values; read, a dict by key [SI]."""
    quantity = QuantityField(variable.kind)

    def listed(raw: object) -> Array:
        if not isinstance(raw, list) or not raw:
            what = "an empty list, so an empty grid" if raw == [] else quote(raw)
            raise input_error(f"found {what}, needed a list of values; write for example '[{quantity.way_out}]'")
        values = np.array([quantity.read(value) for value in raw])
        if np.any(np.diff(values) <= 0):
            raise input_error("found values out of order or twice, needed each once, rising; sort them")
        return values

    list_schema = {"type": "array", "minItems": 1, "items": quantity.json_schema}
    keys = KeyGroup(
        keys={
            "from": Key(quantity, "First value."),
            "to": Key(quantity, "Last value."),
            "count": Key(COUNT, "Number of values; not with `sample`."),
            "spacing": Key(one_of("linear", "log"), "linear, if not given; log: equal factors, not equal steps."),
            "values": Key(SimpleField(listed, list_schema), "The values, instead of a range."),
        }
    )
    schema = {"anyOf": [keys.json_schema, list_schema], "description": variable.meaning}
    return SimpleField(lambda raw: keys.read({"values": raw} if isinstance(raw, list) else raw), schema)


def axis_of(variable: Variable, given: dict[str, Any], written: Any, *, sampled: bool) -> Axis:
    """Return the axis of a quantity, whose keys must go together.

    Parameters
    ----------
    given
        Its keys, as its `axis_field` reads them.
    written
        The same as the file has them.

    Raises
    ------
    PydanticCustomError
        If they do not; its context has the key.
    """
    if sampled and (extra := given.keys() & {"count", "values"}):
        why = "needed one of: from, to, spacing (a sample has one count for all, under 'sample')"
        raise input_error(f"found an unknown key, {why}", min(extra))
    logarithmic = given.get("spacing") == "log"
    if "values" in given:
        for other in (key for key in given if key != "values"):
            raise input_error("found beside 'values', needed either these or a range; delete one", other)
        values = given["values"]
    else:
        for key in ("from", "to") if sampled else ("from", "to", "count"):
            if key not in given:
                example = f"{{from: {QuantityField(variable.kind).way_out}, to: ...{'' if sampled else ', count: 50'}}}"
                raise input_error(f"missing; write for example '{example}'", key)
        low, high, count = given["from"], given["to"], 2 if sampled else given["count"]
        if low > high or (low == high and count > 1):
            found = quote(written["to"])
            raise input_error(f"found {found}, needed more than 'from'; swap them, or list one under 'values'", "to")
        values = _range(low, high, count, logarithmic)
    first = written[0] if isinstance(written, list) else written["values"][0] if "values" in given else written["from"]
    unit = unit_text(first)
    return Axis(
        name=variable.axis_name,
        unit=variable.kind.unit,
        written=unit,
        scale=float(factor(unit, variable.kind.unit)) if unit else 1.0,
        meaning=variable.meaning,
        values=values,
        logarithmic=logarithmic,
    )


def _range(low: float, high: float, count: int, logarithmic: bool) -> Array:
    """Return the values of a range; of a sample, its ends."""
    if count > MAX_RUNS:
        raise input_error(f"found {count} values of one quantity, needed at most {MAX_RUNS}; lower it", "count")
    if logarithmic and low <= 0:
        raise input_error("found a start of 0 or less, needed one above 0 with 'spacing: log'", "from")
    if count == 1 and low < high:
        raise input_error("found 1 value for a range of two ends, needed 2 or more; or list it under 'values'", "count")
    return np.geomspace(low, high, count) if logarithmic else np.linspace(low, high, count)
