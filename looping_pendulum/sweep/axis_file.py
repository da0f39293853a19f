"""Read the range or the list of values of one quantity of a map file."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError

from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import QuantityField, input_error, suggest, whole_number
from looping_pendulum.scenarios.quantities import FILE_KEYS
from looping_pendulum.scenarios.units import factor, unit_text
from looping_pendulum.sweep.plan import Axis
from looping_pendulum.sweep.quantities import Variable, variables

MAX_AXES = 3
"""Largest number of quantities that a map varies."""
MAX_RUNS = 20_000_000
"""Largest number of runs of the reference without --max-runs: a quarter of an hour at 25 000 runs/s."""
COUNT = whole_number("100")
"""Field type of a number of runs."""


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
    way_out = variable.kind.example_text
    group = {"values": content} if isinstance(content, list) else content
    example = f"{{from: {way_out}, to: ..., count: 50}}" if not sampled else f"{{from: {way_out}, to: ...}}"
    if not isinstance(group, dict):
        raise input_error(f"expected a range or a list of values, got {quote(content)}; write for example '{example}'")
    keys = ("from", "to", "spacing") if sampled else ("from", "to", "count", "spacing", "values")
    for key in group:
        if key not in keys:
            why = " (a sample has one count for all, under 'sample')" if sampled and key in ("count", "values") else ""
            raise input_error(f"found an unknown key, needed one of: {', '.join(keys)}{why}{suggest(key, keys)}", key)
    spacing = group.get("spacing", "linear")
    if spacing not in ("linear", "log"):
        raise input_error(f"expected linear or log, got {quote(spacing)}; leave it out for linear", "spacing")
    logarithmic = spacing == "log"
    if "values" in group:
        values, first = _listed(quantity, group)
    else:
        values, first = _range(quantity, group, logarithmic, sampled=sampled, example=example)
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


def _listed(quantity: QuantityField, group: dict[str, Any]) -> tuple[Array, str]:
    """Return the values [SI] of a list, and the first as the file writes it."""
    if len(group) > 1:
        other = next(key for key in group if key != "values")
        raise input_error("found beside 'values', needed either these or a range; delete one", other)
    listed = group["values"]
    if not isinstance(listed, list):
        raise input_error(f"expected a list, got {quote(listed)}; write for example '[{quantity.kind.example_text}]'", "values")
    if not listed:
        raise input_error(
            f"found an empty list, so an empty grid, needed a value; write '[{quantity.kind.example_text}]'", "values"
        )
    try:
        values = np.array([quantity.read(each) for each in listed])
    except PydanticCustomError as error:
        raise input_error(str(error), "values") from None
    if np.any(np.diff(values) <= 0):
        raise input_error("found values out of order or twice, needed each once, rising; sort them", "values")
    return values, str(listed[0])


def _range(
    quantity: QuantityField, group: dict[str, Any], logarithmic: bool, *, sampled: bool, example: str
) -> tuple[Array, str]:
    """Return the values [SI] of a range (for a sample, its ends), and its start as the file writes it."""
    ends = []
    for key in ("from", "to"):
        if key not in group:
            raise input_error(f"missing, needed {quantity.kind.requirement}; write for example '{example}'", key)
        try:
            ends.append(quantity.read(group[key]))
        except PydanticCustomError as error:
            raise input_error(str(error), key) from None
    low, high = ends
    count = 2 if sampled else _counted(group, example)
    if not low < high and not (low == high and count == 1):
        raise input_error(f"found {quote(group['to'])}, needed more than 'from'; swap them, or list one under 'values'", "to")
    if logarithmic and low <= 0:
        raise input_error("found a start of 0 or less, needed one above 0 with 'spacing: log'", "from")
    if count == 1 and low < high:
        raise input_error("found 1 value for a range of two ends, needed 2 or more; or list it under 'values'", "count")
    values = np.geomspace(low, high, count) if logarithmic else np.linspace(low, high, count)
    return values, str(group["from"])


def _counted(group: dict[str, Any], example: str) -> int:
    if "count" not in group:
        raise input_error(f"missing, needed the number of values; write for example '{example}'", "count")
    if group["count"] == "0":
        raise input_error("found 0, so an empty grid, needed 1 or more; write for example '50'", "count")
    try:
        count: int = COUNT.read(group["count"])
    except PydanticCustomError as error:
        raise input_error(str(error), "count") from None
    if count > MAX_RUNS:
        raise input_error(f"found {count} values of one quantity, needed at most {MAX_RUNS}; lower it", "count")
    return count
