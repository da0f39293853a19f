"""Field types and groups of which the pydantic models of files are made, their JSON Schemas, and messages on faulty files."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar, get_origin

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    create_model,
)
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import CoreSchema, ErrorDetails, PydanticCustomError, core_schema
from yaml.constructor import SafeConstructor

from looping_pendulum.errors import ScenarioError, one_line
from looping_pendulum.scenarios.document import QUOTE_COMMENT_SIGN, Document, EmptyValue, Path, quote
from looping_pendulum.scenarios.quantities import FILE_KEYS
from looping_pendulum.scenarios.units import QuantityKind, RangeError, UnitError

NUMBER_PATTERN = r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?"
"""Regular expression of a number, as JSON Schema takes it."""
_NO_KEYS = ("<direct>", "<shape>", "[key]")
"""Parts that pydantic adds to the place of an error for unions and keys."""
MAX_CHOICES = 40
"""Largest number of known keys that a message lists beside the one that may be meant; the effects have more."""
TO_FILL_IN = "TODO"
"""What `new study` writes for a value that nobody has given yet."""
QUANTITY_TEXT = "x-words"
"""Temporary key of the JSON Schema for what a key takes; `model_schema` moves its text into the description."""


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
        if value == TO_FILL_IN:
            raise input_error(f"found {TO_FILL_IN}, needed {self.kind.requirement}; fill it in, for example '{self.way_out}'")
        if isinstance(value, str):
            try:
                return self.kind.parse(value)
            except RangeError:
                expected = self.kind.requirement
            except UnitError as error:
                detail = f" ({error})" if str(error) else ""
        raise input_error(f"expected {expected}, got {quote(value)}{detail}; write for example '{self.kind.example_text}'")

    @property
    def way_out(self) -> str:
        """Return an example to copy."""
        return self.kind.example_text

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


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldType:
    """Field type for pydantic: how a key's value is read from the file, and its JSON Schema."""

    read: Callable[[object], Any]
    json_schema: JsonSchemaValue

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return self.json_schema


def one_of(*words: str) -> FieldType:
    """Return the type of a key that takes one of a few words."""

    def read(value: object) -> str:
        if isinstance(value, str) and value in words:
            return value
        raise input_error(f"expected one of {', '.join(words)}, got {quote(value)}{suggest(str(value), words)}")

    return FieldType(read=read, json_schema={"type": "string", "enum": list(words)})


def whole_number(example: str, *, low: int = 1) -> FieldType:
    """Return the type of a key that takes a whole number without a sign, of ten digits at most."""

    def read(value: object) -> int:
        # ASCII, as isdigit() takes superscripts, too, which int() refuses; the length first, as int() of a very long text takes
        # quadratic time
        if isinstance(value, str) and value.isascii() and value.isdigit() and len(value) <= 10 and int(value) >= low:
            return int(value)
        raise input_error(f"expected a whole number from {low}, got {quote(value)}; write for example '{example}'")

    return FieldType(read=read, json_schema={"type": "integer", "minimum": low, "examples": [int(example)]})


def _flag(value: object) -> bool:
    known = SafeConstructor.bool_values  # YAML's words: yes, no, true, false, on, off
    if isinstance(value, str) and value.lower() in known:
        return known[value.lower()]
    raise input_error(f"expected true or false, got {quote(value)}; write 'true' or 'false'")


Flag = Annotated[bool, FieldType(read=_flag, json_schema={"type": "boolean"})]


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

    # Validators are built on first use: a command reads one kind of file
    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, defer_build=True)


AnyGroup = TypeVar("AnyGroup", bound=Group)


def made_group(name: str, meaning: str | None, base: type[AnyGroup], **keys: Any) -> type[AnyGroup]:
    """Return a group with further keys, as `pydantic.create_model` takes them.

    Parameters
    ----------
    meaning
        Docstring, which becomes the description in the JSON Schema; None: it has none.
    """
    # It has no source, which pydantic would look for, for longer than for all else, to find docstrings of its keys
    return create_model(name, __base__=base, __doc__=meaning, __cls_kwargs__={"use_attribute_docstrings": False}, **keys)


class _FileSchema(GenerateJsonSchema):
    """Generator of a JSON Schema without null: a key is either given or left out."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        inner = self.generate_inner(schema["schema"])
        default = schema.get("default")
        # An empty text or group is no value that anybody would write into a file
        if default in (None, "") or not isinstance(default, (str, bool, int, float)):
            return inner
        return inner | {"default": default}


def undescribed_schema(model: type[BaseModel]) -> dict[str, Any]:
    """Return the JSON Schema of ``model``, in which the key `QUANTITY_TEXT` says what each quantity takes."""
    return model.model_json_schema(schema_generator=_FileSchema)


def model_schema(model: type[BaseModel], title: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a file, for editors that complete and check YAML."""
    schema = undescribed_schema(model)
    _describe_quantities(schema)
    return {"$schema": _FileSchema.schema_dialect} | schema | {"title": title}


def _describe_quantities(schema: Any) -> None:
    """Add to the description of each quantity what kind of quantity it is."""
    if isinstance(schema, dict):
        quantity = schema.pop(QUANTITY_TEXT, "")
        if quantity:
            meaning = schema.get("description", "").rstrip(".")
            schema["description"] = f"{meaning}. Needed: {quantity}." if meaning else f"Needed: {quantity}."
    for inner in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
        _describe_quantities(inner)


def first_error(
    error: ValidationError,
    doc: Document,
    model: type[BaseModel],
    own_words: Callable[[ErrorDetails, Path], str] = lambda details, path: "",
) -> ScenarioError:
    """Return the error to correct first: an unknown key (often a missing one, misspelt), else the topmost in the file.

    Parameters
    ----------
    own_words
        Function of pydantic's error and its place that words what this kind of file words in its own way; else ''.
    """
    errors = [(_path(details), details) for details in error.errors(include_url=False)]

    def order(placed: tuple[Path, ErrorDetails]) -> tuple[bool, int]:
        path, details = placed
        lines = [doc.lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in doc.lines]
        # An error without a line comes last
        return details["type"] != "extra_forbidden", lines[0] if lines else 1 << 30

    path, first = min(errors, key=order)
    message = own_words(first, path) or _message(first, path, model)
    if isinstance(first["input"], EmptyValue) and "#" in doc.line_of(path):
        message = f"{message}; {QUOTE_COMMENT_SIGN}"
    return doc.error(path, message)


def _path(details: ErrorDetails) -> Path:
    """Return where in the file an error is, without the parts that pydantic adds for unions, keys and validators."""
    path = tuple(part for part in details["loc"] if part not in _NO_KEYS and not str(part).startswith("function-"))
    key = details.get("ctx", {}).get("key")
    return (*path, *str(key).split(".")) if key else path


def _message(details: ErrorDetails, path: Path, model: type[BaseModel]) -> str:
    """Return a message of what was found and what was needed."""
    kind, value = details["type"], details["input"]
    if kind == "scenario":
        return details["msg"]
    if kind == "extra_forbidden":
        return _unknown_key(str(path[-1]), keys_below(model, path[:-1]), path)
    if kind == "missing":
        return f"missing, needed {_requirement(model, path)}"
    if kind == "too_short":
        return "found an empty list, needed at least one entry; write for example '[release.angle]'"
    if kind == "list_type":
        return f"expected a list, got {quote(value)}; begin each entry with '- '"
    below = keys_below(model, path)
    if below:
        return f"expected a group of keys ({', '.join(below)}), got {quote(value)}; write them indented below it"
    return f"expected a group of keys, got {quote(value)}; write 'key: value' lines indented below it"


def _unknown_key(key: str, known: list[str], path: Path) -> str:
    """Return the message on an unknown key, with the key that may be meant."""
    hint = suggest(key, known)
    elsewhere = [k for k in FILE_KEYS.values() if k.rpartition(".")[2] == key]
    if path[0] == "effects" and key in FILE_KEYS:
        hint = f"; write it as '{FILE_KEYS[key]}'"
    elif key in FILE_KEYS and not hint:
        hint = f"; did you mean '{FILE_KEYS[key]}'?"
    elif len(elsewhere) == 1 and not hint:
        hint = f"; did you mean '{elsewhere[0]}'?"
    choices = f"needed one of: {', '.join(known)}" if known else "and no keys are known here"
    if hint and len(known) > MAX_CHOICES:  # a terminal's message would be cut before the hint
        choices = "needed another"
    return f"found an unknown key, {choices}{hint}"


def _requirement(model: type[BaseModel], path: Path) -> str:
    """Return what a missing key takes, with an example."""
    field = _group_at(model, path[:-1]).model_fields[str(path[-1])]
    for item in field.metadata:
        if isinstance(item, QuantityField):
            return f"{item.kind.requirement}; write for example '{path[-1]}: {item.kind.example_text}'"
    below = keys_below(model, path)
    if below:
        return f"a group of keys ({', '.join(below)})"
    return f"text; write for example '{path[-1]}: ...'"


def keys_below(model: type[BaseModel], path: Path) -> list[str]:
    """Return the keys that the group at ``path`` may have; none if it is not a group."""
    group = _group_at(model, path)
    return [f.alias or name for name, f in group.model_fields.items()] if group is not BaseModel else []


def _group_at(model: type[BaseModel], path: Path) -> type[BaseModel]:
    """Return the model of the group at ``path``; BaseModel itself, which has no fields, if it is not a group."""
    if not path:
        return model
    for name, field in model.model_fields.items():
        if path[0] in (name, field.alias):
            below, rest = _model_in(field.annotation), path[1:]
            is_collection = get_origin(field.annotation) in (list, dict)
            if is_collection and not rest:
                return BaseModel
            # [1:]: a number in the list, or an engine's name, stands between the collection and its group
            return _group_at(below, rest[1:] if is_collection else rest)
    return BaseModel


def _model_in(annotation: Any) -> type[BaseModel]:
    """Return the model in an annotation: ``X``, ``X | None``, ``list[X]`` or ``dict[str, X]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inner = [_model_in(a) for a in getattr(annotation, "__args__", ())]
    return next((m for m in inner if m is not BaseModel), BaseModel)
