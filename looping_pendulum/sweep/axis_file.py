"""Read the range or the list of values of one quantity of a map file."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError

from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import FieldType, QuantityField, input_error, one_of, suggest, whole_number
from looping_pendulum.scenarios.quantities import FILE_KEYS
from looping_pendulum.scenarios.units import factor, unit_text
from looping_pendulum.sweep.plan import Axis
from looping_pendulum.sweep.quantities import Variable, variables

MAX_AXES = 3
"""Largest number of quantities that a map varies."""
MAX_RUNS = 20_000_000
"""Largest number of runs of the reference without --max-runs: ten minutes at 32 000 runs/s, on two cores."""
COUNT = whole_number("50")
"""Field type of a number of runs."""
SPACING = one_of("linear", "log")


def parameters_schema() -> JsonSchemaValue:
    """Return the JSON Schema of the quantities that a map varies."""
    properties = {}
    for variable in variables().values():
        one = QuantityField(variable.kind).json_schema
        ranged = {
            "from": one | {"description": "First value."},
            "to": one | {"description": "Last value."},
            "count": {"type": "integer", "minimum": 1, "description": "Number of values; not with `sample`."},
            "spacing": {"enum": ["linear", "log"], "default": "linear", "description": "log: equal factors, not equal steps."},
            "values": {"type": "array", "minItems": 1, "items": one, "description": "The values, instead of a range."},
        }
        range_schema = {"type": "object", "properties": ranged, "additionalProperties": False}
        listed = {"type": "array", "minItems": 1, "items": one}
        file_key = FILE_KEYS.get(variable.name, variable.name)
        for name in dict.fromkeys((variable.name, file_key)):
            properties[name] = {"anyOf": [range_schema, listed], "description": variable.meaning}
    return {
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
        "minProperties": 1,
        "maxProperties": MAX_AXES,
    }


def read_axis(variable: Variable, content: object, *, sampled: bool) -> Axis:
    """Read and check the values of one quantity of a map file.

    Raises
    ------
    PydanticCustomError
        If they are faulty; its context has the key inside the range.
    """
    quantity = QuantityField(variable.kind)
    group = {"values": content} if isinstance(content, list) else content
    keys = ("from", "to", "spacing") if sampled else ("from", "to", "count", "spacing", "values")
    example = f"{{from: {quantity.way_out}, to: ...{'' if sampled else ', count: 50'}}}"
    if not isinstance(group, dict):
        raise input_error(f"expected a range or a list of values, got {quote(content)}; write for example '{example}'")
    for key in group:
        if key not in keys:
            why = " (a sample has one count for all, under 'sample')" if sampled and key in ("count", "values") else ""
            raise input_error(f"found an unknown key, needed one of: {', '.join(keys)}{why}{suggest(key, keys)}", key)
    logarithmic = "spacing" in group and _read(SPACING, group, "spacing") == "log"
    if "values" in group:
        values, first = _listed(quantity, group), group["values"][0]
    else:
        for key in ("from", "to") if sampled else ("from", "to", "count"):
            if key not in group:
                raise input_error(f"missing; write for example '{example}'", key)
        values, first = _range(quantity, group, 2 if sampled else _read(COUNT, group, "count"), logarithmic), group["from"]
    written = unit_text(first)
    return Axis(
        name=variable.axis_name,
        unit=variable.kind.unit,
        written=written,
        scale=float(factor(written, variable.kind.unit)) if written else 1.0,
        meaning=variable.meaning,
        values=values,
        logarithmic=logarithmic,
    )


def _read(field: FieldType, group: dict[str, Any], key: str) -> Any:
    """Return the value of a key of a range, whose error names the key."""
    try:
        return field.read(group[key])
    except PydanticCustomError as error:
        raise input_error(str(error), key) from None


def _listed(quantity: QuantityField, group: dict[str, Any]) -> Array:
    """Return the values [SI] of a list."""
    example = f"write for example '[{quantity.way_out}]'"
    if len(group) > 1:
        other = next(key for key in group if key != "values")
        raise input_error("found beside 'values', needed either these or a range; delete one", other)
    if not isinstance(group["values"], list):
        raise input_error(f"expected a list, got {quote(group['values'])}; {example}", "values")
    if not group["values"]:
        raise input_error(f"found an empty list, so an empty grid, needed a value; {example}", "values")
    values = np.array([_read(quantity, {"values": value}, "values") for value in group["values"]])
    if np.any(np.diff(values) <= 0):
        raise input_error("found values out of order or twice, needed each once, rising; sort them", "values")
    return values


def _range(quantity: QuantityField, group: dict[str, Any], count: int, logarithmic: bool) -> Array:
    """Return the values [SI] of a range; of a sample, its ends."""
    low, high = _read(quantity, group, "from"), _read(quantity, group, "to")
    if count > MAX_RUNS:
        raise input_error(f"found {count} values of one quantity, needed at most {MAX_RUNS}; lower it", "count")
    if not low < high and not (low == high and count == 1):
        raise input_error(f"found {quote(group['to'])}, needed more than 'from'; swap them, or list one under 'values'", "to")
    if logarithmic and low <= 0:
        raise input_error("found a start of 0 or less, needed one above 0 with 'spacing: log'", "from")
    if count == 1 and low < high:
        raise input_error("found 1 value for a range of two ends, needed 2 or more; or list it under 'values'", "count")
    return np.geomspace(low, high, count) if logarithmic else np.linspace(low, high, count)
