"""Field types of which the pydantic models of a study file are made.

As in a scenario, every scalar is still text here, so that no unit is lost. A measured value may carry its standard error,
"10 g +/- 0.05 g" or "10 g +/- 0.5 %" (of the value); "free" stands for a value that is not known.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, PlainValidator, ValidationInfo, WithJsonSchema
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.measured.study import Estimate
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects import Coefficient
from looping_pendulum.reference_ode.effects.own import effect_of
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import NUMBER_PATTERN, QUANTITY_TEXT, QuantityField, input_error, suggest
from looping_pendulum.scenarios.quantities import QUANTITIES, quantity_kind
from looping_pendulum.scenarios.units import QuantityKind, UnitError, show, to_si

MAX_RELATIVE_ERROR = 1000
"""Largest standard error of a value of a range without an end, in units of the value."""
_PLUS_MINUS = re.compile(r"\+/-|\+-|±")


class MeasuredField(QuantityField):
    """Pydantic field of a quantity with its standard error."""

    def __init__(self, kind: QuantityKind, start: float | None = None) -> None:
        super().__init__(kind)
        self.start = start

    def estimate(self, raw: object) -> Estimate:
        """Return value and standard error [SI] of an entry of the file."""
        text = raw.strip() if isinstance(raw, str) else ""
        if text == "free" or text.startswith("free from "):
            return self._free(text)
        inside, bracket, unit = text.removeprefix("(").rpartition(")")
        parts = _split(inside)
        if not (text.startswith("(") and bracket and len(parts) == 2):
            parts, unit = _split(text), ""
        parts = [part + unit for part in parts]  # in "(65 +/- 1) cm" the unit belongs to both
        if len(parts) > 2:
            raise input_error(f"expected one '+/-', got {quote(raw)}; write for example '{self.way_out}'")
        value = self.read(parts[0] if isinstance(raw, str) else raw)
        return Estimate(value=value, sigma=self._error(parts[1], value, parts[0]) if len(parts) == 2 else None)

    @property
    def way_out(self) -> str:
        """Return a value with its standard error, as an example to copy."""
        return f"{self.kind.example_text} +/- 1 %"

    def _free(self, text: str) -> Estimate:
        if text != "free":
            return Estimate(value=self.read(text.removeprefix("free from ")), free=True)
        if self.start is None:
            raise input_error(
                f"found 'free' without a start, needed one; write for example 'free from {self.kind.example_text}'"
            )
        return Estimate(value=self.start, free=True)

    def _error(self, text: str, value: float, value_text: str) -> float:
        try:
            if text.endswith("%"):
                sigma = abs(value) * to_si(text[:-1], "") / 100
            else:
                sigma = QuantityKind(unit=self.kind.unit).parse(text)
        except UnitError as error:
            detail = f" ({error})" if str(error) else ""
            message = f"found {quote(text)} after '+/-'{detail}, needed a standard error in the same kind of unit or in %"
            raise input_error(f"{message}; write for example '{self.way_out}'") from None
        if sigma <= 0:
            raise input_error(
                f"found a standard error of {quote(text)}, needed one above 0; leave '+/-' out if the value is exact"
            )
        whole = self.kind.high - self.kind.low
        is_bounded = math.isfinite(whole)
        if not math.isfinite(sigma) or sigma > (whole if is_bounded else MAX_RELATIVE_ERROR * abs(value)):
            most = f"{show(whole, self.kind.unit)}, its whole range" if is_bounded else f"{MAX_RELATIVE_ERROR} times the value"
            message = f"found a standard error of {quote(text)}, needed at most {most}"
            raise input_error(f"{message}; if nothing is known of the value, write 'free from {value_text}'")
        return sigma

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.estimate)

    @property
    def json_schema(self) -> JsonSchemaValue:
        """Return the JSON Schema of such a value."""
        text = {"type": "string", "pattern": rf"^(free( from {NUMBER_PATTERN}.*)?|\(?{NUMBER_PATTERN}.*)$"}
        parts = "unit and standard error" if self.kind.unit else "standard error"
        free = "'free'" if self.start is not None else f"'free from {self.kind.example_text}'"
        return {
            **(text if self.kind.unit else {"anyOf": [{"type": "number"}, text]}),
            "examples": [self.way_out],
            QUANTITY_TEXT: f"{self.kind.requirement}, with its {parts}; or {free}",
        }


def _split(text: str) -> list[str]:
    """Split at each plus-minus sign; a regular expression that takes spaces off, too, would need quadratic time."""
    return [part.strip() for part in _PLUS_MINUS.split(text)]


def text_by_key(expected: str, keys: Mapping[str, str]) -> PlainValidator:
    """Return a validator of a mapping from known keys to text; ``keys`` has the meaning of each."""

    def read(raw: object) -> dict[str, str]:
        example = f"'{{{next(iter(keys))}: ...}}'"
        if not isinstance(raw, dict) or not raw:
            raise input_error(f"expected {expected}, got {quote(raw)}; write for example {example}")
        for key, value in raw.items():
            if key not in keys:
                raise input_error(f"found an unknown key, needed one of: {', '.join(keys)}{suggest(key, keys)}", key)
            if not isinstance(value, str):
                raise input_error(f"expected text, got {quote(value)}; write for example {example}", key)
        return dict(raw)

    properties = {key: {"type": "string", "description": meaning} for key, meaning in keys.items()}
    return PlainValidator(read, json_schema_input_type=_with_schema({"minProperties": 1} | _group_schema(properties)))


def low_and_high(kind: QuantityKind, example: str) -> PlainValidator:
    """Return a validator of a pair of a lowest and a highest value."""

    def read(raw: object) -> tuple[float, float]:
        if not isinstance(raw, list) or len(raw) != 2:
            raise input_error(f"expected a lowest and a highest value, got {quote(raw)}; write for example '{example}'")
        low, high = (QuantityField(kind).read(each) for each in raw)
        if not low <= high:
            raise input_error(f"found the lowest value above the highest, needed them in order; write for example '{example}'")
        return low, high

    words = f"the lowest and the highest value, each {kind.requirement}"
    schema = {"type": "array", "minItems": 2, "maxItems": 2, "examples": [example], QUANTITY_TEXT: words}
    return PlainValidator(read, json_schema_input_type=_with_schema(schema))


def _group_schema(properties: JsonSchemaValue, *, further: bool = False) -> JsonSchemaValue:
    """Return the JSON Schema of a group of keys; ``further`` allows keys of any other name."""
    return {"type": "object", "properties": properties, "additionalProperties": {} if further else False}


def _with_schema(schema: JsonSchemaValue) -> Any:
    """Return a type that pydantic describes by ``schema``."""
    return Annotated[Any, WithJsonSchema(schema)]


def _effects(raw: object, info: ValidationInfo) -> dict[str, Estimate]:
    """Return coefficient -> estimate of every declared effect; the context gives the file's own effects."""
    library = effect_library.EFFECTS | {own.name: effect_of(own) for own in info.context or ()}
    if not isinstance(raw, dict):
        raise input_error(f"expected effects with their values, got {quote(raw)}; write for example 'light_drag: free'")
    values: dict[str, Estimate] = {}
    for effect, content in raw.items():
        if effect not in library:
            near = suggest(effect, library)
            raise input_error(f"found an unknown effect, needed one of: {', '.join(library)}{near}", effect)
        known = {c.name: c for c in library[effect].coefficients}
        # A single value is that of the effect's first coefficient, which switches it on
        group = content if isinstance(content, dict) else {next(iter(known)): content}
        for name, each in group.items():
            key = f"{effect}.{name}" if isinstance(content, dict) else effect
            if name not in known:
                raise _unknown_key(name, known, key)
            values[name] = _coefficient_estimate(_coefficient_field(known[name]), each, key)
    return values


def _camera(raw: object) -> dict[str, Estimate]:
    """Return coefficient -> estimate of every declared error of a camera, which replaces its usual prior."""
    if not isinstance(raw, dict):
        raise input_error(f"expected a group of keys ({', '.join(CAMERA)}), got {quote(raw)}; write them indented below it")
    values = {}
    for name, each in raw.items():
        if name not in CAMERA:
            raise _unknown_key(name, CAMERA, name)
        values[name] = _coefficient_estimate(_camera_field(CAMERA[name]), each, name)
    return values


def _unknown_key(name: str, known: Collection[str], key: str) -> PydanticCustomError:
    return input_error(f"found an unknown key, needed one of: {', '.join(known)}{suggest(name, known)}", key)


def _coefficient_estimate(field: MeasuredField, raw: object, key: str) -> Estimate:
    try:
        return field.estimate(raw)
    except PydanticCustomError as error:
        raise input_error(str(error), key) from None


def _effects_schema() -> JsonSchemaValue:
    """Return the JSON Schema of the declared effects; those that a file defines itself may be declared, too."""
    properties: JsonSchemaValue = {}
    for effect in effect_library.EFFECTS.values():
        values = {c.name: _coefficient_field(c).json_schema | {"description": c.meaning} for c in effect.coefficients}
        properties[effect.name] = {"anyOf": [next(iter(values.values())), _group_schema(values)]}
    return _group_schema(properties, further=True)


def _camera_schema() -> JsonSchemaValue:
    """Return the JSON Schema of the declared errors of a camera."""
    return _group_schema({c.name: _camera_field(c).json_schema | {"description": c.meaning} for c in CAMERA.values()})


def _coefficient_field(c: Coefficient) -> MeasuredField:
    known = QUANTITIES.get(c.name)
    return MeasuredField(quantity_kind(c), c.default if known is None or known.free_start is None else known.free_start)


def _camera_field(c: Coefficient) -> MeasuredField:
    return MeasuredField(quantity_kind(c, example=show(c.null, c.unit)), c.null)


Effects = Annotated[dict[str, Estimate], PlainValidator(_effects, json_schema_input_type=_with_schema(_effects_schema()))]
"""Field type of the declared effects: coefficient -> estimate."""
Camera = Annotated[dict[str, Estimate], PlainValidator(_camera, json_schema_input_type=_with_schema(_camera_schema()))]
"""Field type of the declared errors of a camera: coefficient -> estimate."""
