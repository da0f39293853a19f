"""Field types and groups of which the pydantic models of files are made, and the errors that they raise."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from looping_pendulum.errors import one_line
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.units import QuantityKind, RangeError, UnitError

NUMBER_PATTERN = r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?"
"""Regular expression of a number, as JSON Schema takes it."""
QUANTITY_TEXT = "x-words"
"""Temporary key of the JSON Schema for what a key takes; `file_schema.json_schema` moves its text into the description."""


def input_error(message: str, key: str = "") -> PydanticCustomError:
    """Return an error with a message for the user; ``key`` is the key below the validated group to which it refers."""
    # one_line() also escapes lone surrogates, which pydantic cannot hold; they come from files and terminals that are not UTF-8
    return PydanticCustomError("scenario", "{message}", {"message": one_line(message), "key": key})


class QuantityField:
    """Field type for pydantic: text with a unit in the file, a number [SI] in the program."""

    def __init__(self, kind: QuantityKind) -> None:
        self.kind = kind

    def read(self, value: object) -> float:
        """Return the number [SI] for the value in the file."""
        detail, expected = "", self.kind.noun
        if isinstance(value, str):
            try:
                return self.kind.parse(value)
            except RangeError:
                expected = self.kind.requirement
            except UnitError as error:
                detail = f" ({error})" if str(error) else ""
        raise input_error(f"expected {expected}, got {quote(value)}{detail}; write for example '{self.kind.example_text}'")

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read, metadata={"kind": self.kind})

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return self.json_schema

    @property
    def json_schema(self) -> JsonSchemaValue:
        """Return the JSON Schema of such a value."""
        if not self.kind.unit:
            bounds = {"minimum": self.kind.low, "maximum": self.kind.high}
            number = {"type": "number"} | {name: bound for name, bound in bounds.items() if math.isfinite(bound)}
            percent = {"type": "string", "pattern": rf"^{NUMBER_PATTERN} ?%$"}
            return {
                "anyOf": [number, percent],
                "examples": [float(self.kind.example_text)],
                QUANTITY_TEXT: self.kind.requirement,
            }
        return {
            "type": "string",
            # A unit may begin with 1, as 1/rad does
            "pattern": rf"^{NUMBER_PATTERN} ?[A-Za-z°µ1].*$",
            "examples": [self.kind.example_text],
            QUANTITY_TEXT: f"{self.kind.requirement}, with its unit",
        }


class OneOf:
    """Field type for pydantic: one of a few words."""

    def __init__(self, *words: str) -> None:
        self.words = words

    def read(self, value: object) -> str:
        """Return the word in the file."""
        if isinstance(value, str) and value in self.words:
            return value
        raise input_error(f"expected one of {', '.join(self.words)}, got {quote(value)}{suggest(str(value), self.words)}")

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"type": "string", "enum": list(self.words)}


class WholeNumber:
    """Field type for pydantic: a whole number without a sign, of ten digits at most."""

    def __init__(self, example: str, *, low: int = 1) -> None:
        self.example = example
        self.low = low

    def read(self, value: object) -> int:
        """Return the number in the file."""
        # ASCII, as isdigit() takes superscripts, too, which int() refuses; the length first, as int() of a very long text takes
        # quadratic time
        if isinstance(value, str) and value.isascii() and value.isdigit() and len(value) <= 10 and int(value) >= self.low:
            return int(value)
        raise input_error(f"expected a whole number from {self.low}, got {quote(value)}; write for example '{self.example}'")

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"type": "integer", "minimum": self.low, "examples": [int(self.example)]}


class Flag:
    """Field type for pydantic: true or false."""

    def read(self, value: object) -> bool:
        """Return the flag in the file."""
        if value in ("true", "false"):
            return value == "true"
        raise input_error(f"expected true or false, got {quote(value)}")

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"type": "boolean"}


def _text(value: object) -> str:
    """Validate a text."""
    if isinstance(value, str):
        return value
    raise input_error(f"expected text, got {quote(value)}; write for example 'two words'")


Text = Annotated[str, BeforeValidator(_text)]


def suggest(text: str, known: Iterable[str]) -> str:
    """Return "; did you mean 'radius'?" for the nearest known word, or an empty text if none is near."""
    near = difflib.get_close_matches(text, list(known), n=1, cutoff=0.6)
    return f"; did you mean '{near[0]}'?" if near else ""


class Group(BaseModel):
    """A group of keys; one that is not declared is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)
