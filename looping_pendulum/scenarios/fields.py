"""Field types of which the models of files are made, their JSON Schemas, and messages on faulty files.

A field type says all about a key: how its value is read from a file, how it is written, and what its JSON Schema is.
"""

from __future__ import annotations

import difflib
import functools
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from numbers import Real
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
)
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import CoreSchema, ErrorDetails, PydanticCustomError, core_schema
from yaml.constructor import SafeConstructor

from looping_pendulum.errors import ScenarioError, one_line
from looping_pendulum.scenarios.document import QUOTE_COMMENT_SIGN, Document, Path, quote
from looping_pendulum.scenarios.quantities import FILE_KEYS
from looping_pendulum.scenarios.units import QuantityKind, RangeError, UnitError, show

NUMBER_PATTERN = r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?"
"""Regular expression of a number, as JSON Schema takes it."""
MAX_CHOICES = 40
"""Largest number of known keys that a message lists beside the one that may be meant; the effects have more."""
TO_FILL_IN = "TODO"
"""What `new study` writes for a value that nobody has given yet."""
QUANTITY_TEXT = "x-words"
"""Temporary key of the JSON Schema for what a key takes; `model_schema` moves its text into the description."""
OTHER_KEYS = MappingProxyType({**FILE_KEYS, "own_effects": "candidates", "candidates": "own_effects"})
"""Name that a user may give to a value -> its key: of a parameter; and of a key that another kind of file has for the same."""
UNKNOWN_KEY = ("extra_forbidden", "unexpected_keyword_argument", "unknown_key")
"""Kinds of pydantic's errors, and of ours, for a key that is not known."""


def input_error(message: str, *keys: str, kind: Literal["scenario", "unknown_key"] = "scenario") -> PydanticCustomError:
    """Return an error with a message for the user; ``keys`` lead from the validated group to that to which it refers."""
    # one_line() also escapes lone surrogates, which pydantic cannot hold; they come from files and terminals that are not UTF-8
    return PydanticCustomError(kind, "{message}", {"message": one_line(message), "keys": keys})


class FieldType:
    """Base of the field types: what a value is in the program and, by `read` and `write`, in a file.

    Values are read only where pydantic validates a file, which it does with a context (`read_model`); what the program gives to
    a model is in SI already.
    """

    def read(self, raw: object, /) -> Any:
        """Return the value for that in a file, whose every scalar is text."""
        raise NotImplementedError

    def write(self, value: Any, /) -> Any:
        """Return a value as a file has it."""
        return value

    @property
    def json_schema(self) -> JsonSchemaValue:
        """Return the JSON Schema of a value in a file."""
        raise NotImplementedError

    def validate(self, value: object, info: ValidationInfo) -> Any:
        """Return the value in the program, as pydantic calls it; ``info.data`` has the fields that stand before this one."""
        return value if info.context is None else self.read(value)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        writing = core_schema.plain_serializer_function_ser_schema(self.write)
        return core_schema.with_info_plain_validator_function(self.validate, serialization=writing)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return self.json_schema


def in_si_unit(number: Real, unit: str) -> str:
    """Return a number of a script [SI] as text with its unit, all digits kept."""
    return f"{float(number)!r} {unit}".rstrip()


class QuantityField(FieldType):
    """A quantity: text with a unit in the file, a number [SI] in the program."""

    def __init__(self, kind: QuantityKind) -> None:
        self.kind = kind

    def read(self, raw: object, /) -> Any:
        """Return the number [SI] for the value in the file, or in a script, where a number is in SI."""
        detail, expected = "", self.kind.noun
        if isinstance(raw, Real) and not isinstance(raw, bool):
            raw = in_si_unit(raw, self.kind.unit)
        if raw == TO_FILL_IN:
            raise input_error(f"found {TO_FILL_IN}, needed {self.kind.requirement}; fill it in, for example '{self.way_out}'")
        if isinstance(raw, str):
            try:
                return self.kind.parse(raw)
            except RangeError:
                expected = self.kind.requirement
            except UnitError as error:
                detail = f" ({error})" if str(error) else ""
        raise input_error(f"expected {expected}, got {quote(raw)}{detail}; write for example '{self.kind.example_text}'")

    def write(self, value: Any, /) -> Any:
        """Return a number [SI] with its unit."""
        return show(value, self.kind.unit) if self.kind.unit else float(value)

    @property
    def way_out(self) -> str:
        """Return an example to copy."""
        return self.kind.example_text

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


@dataclass(frozen=True, eq=False)
class Key:
    """A key of a group."""

    field: FieldType
    """What it takes."""
    meaning: str = ""
    """Its description in the JSON Schema."""
    required: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class KeyGroup(FieldType):
    """A group of known keys; in the program a dict of those that the file gives, or what `from_keys` makes of it."""

    keys: Mapping[str, Key]
    description: str = ""
    from_keys: Callable[[dict[str, Any]], Any] = dict
    """Function that makes the value in the program of those by key."""
    to_keys: Callable[[Any], Mapping[str, Any]] = dict
    """Its inverse."""

    def read(self, raw: object, /) -> Any:
        """Return the value in the program; an error has the key."""
        if not isinstance(raw, dict):
            raise input_error(no_group(self.keys, raw))
        for key in raw:
            if key not in self.keys:
                raise input_error(unknown_key(key, self.keys), key, kind="unknown_key")
        for key, known in self.keys.items():
            if known.required and key not in raw:
                raise input_error(f"missing, needed {_words(known.field.json_schema, key)}", key)
        return self.from_keys({key: read_key(self.keys[key].field, value, key) for key, value in raw.items()})

    def write(self, value: Any, /) -> Any:
        """Return key -> value as a file has it."""
        return {key: self.keys[key].field.write(each) for key, each in self.to_keys(value).items()}

    @property
    def json_schema(self) -> JsonSchemaValue:
        """Return the JSON Schema of the group."""
        described = {key: {"description": known.meaning} if known.meaning else {} for key, known in self.keys.items()}
        properties = {key: known.field.json_schema | described[key] for key, known in self.keys.items()}
        schema = {"type": "object", "properties": properties, "additionalProperties": False}
        required = [key for key, known in self.keys.items() if known.required]
        return (
            schema
            | ({"required": required} if required else {})
            | ({"description": self.description} if self.description else {})
        )


class SimpleField(FieldType):
    """A field type that is made of a function, a JSON Schema and the inverse function."""

    def __init__(
        self, read: Callable[..., Any], json_schema: JsonSchemaValue, write: Callable[[Any], Any] = lambda value: value
    ) -> None:
        self._read, self._write, self._json_schema = read, write, json_schema

    def read(self, raw: object, /) -> Any:
        """Return the value for that in a file."""
        return self._read(raw)

    def write(self, value: Any, /) -> Any:
        """Return a value as a file has it."""
        return self._write(value)

    @property
    def json_schema(self) -> JsonSchemaValue:
        """Return the JSON Schema of a value in a file."""
        return self._json_schema


class DependentField(SimpleField):
    """A field type whose value depends on the fields of its model that stand before it.

    Its function to read is given the value in the file, and the fields before it, by name; a faulty one is not among them.
    """

    def validate(self, value: object, info: ValidationInfo) -> Any:
        """Return the value in the program."""
        return value if info.context is None else self._read(value, info.data)


def read_key(field_type: FieldType, raw: object, key: str) -> Any:
    """Return the value of a key of a group, whose error names the key."""
    try:
        return field_type.read(raw)
    except PydanticCustomError as error:
        kind: Any = error.type
        raise input_error(str(error), key, *(error.context or {}).get("keys", ()), kind=kind) from None


def one_of(*words: str) -> SimpleField:
    """Return the type of a key that takes one of a few words, which may be members of a StrEnum."""
    known = {str(word): word for word in words}

    def read(raw: object) -> str:
        if isinstance(raw, str) and raw in known:
            return known[raw]
        raise input_error(f"expected one of {', '.join(known)}, got {quote(raw)}{suggest(str(raw), known)}")

    return SimpleField(read, write=str, json_schema={"type": "string", "enum": list(known)})


def whole_number(example: str, *, low: int = 1) -> SimpleField:
    """Return the type of a key that takes a whole number without a sign, of ten digits at most."""

    def read(raw: object) -> int:
        # ASCII, as isdigit() takes superscripts, too, which int() refuses; the length first, as int() of a very long text takes
        # quadratic time
        if isinstance(raw, str) and raw.isascii() and raw.isdigit() and len(raw) <= 10 and int(raw) >= low:
            return int(raw)
        raise input_error(f"expected a whole number from {low}, got {quote(raw)}; write for example '{example}'")

    return SimpleField(read, {"type": "integer", "minimum": low, "examples": [int(example)]})


def _flag(raw: object) -> bool:
    if isinstance(raw, bool):
        return raw
    known = SafeConstructor.bool_values  # YAML's words: yes, no, true, false, on, off
    if isinstance(raw, str) and raw.lower() in known:
        return known[raw.lower()]
    raise input_error(f"expected true or false, got {quote(raw)}; write 'true' or 'false'")


Flag = Annotated[bool, SimpleField(_flag, {"type": "boolean"})]


def _text(raw: object) -> str:
    if isinstance(raw, str):
        return raw
    raise input_error(f"expected text, got {quote(raw)}; write for example 'two words'")


TEXT = SimpleField(_text, {"type": "string"})
Text = Annotated[str, TEXT]


def suggest(text: str, known: Iterable[str]) -> str:
    """Return "; did you mean 'radius'?" for the nearest known word, or an empty text if none is near."""
    near = difflib.get_close_matches(text, list(known), n=1, cutoff=0.6)
    return f"; did you mean '{near[0]}'?" if near else ""


# Not with `defer_build`: a dataclass that is built on its first use loses the texts under its fields (pydantic 2.14)
FILE_CONFIG = ConfigDict(
    extra="forbid",
    use_attribute_docstrings=True,
    validate_by_name=True,
    validate_by_alias=True,
)
"""Settings of the models of files: a key that is not declared is an error, and the text under a field describes its key."""


def in_brackets(name: str) -> Any:
    """Return the alias of a field that several keys of a file make up: its name in brackets, which is no key of any file."""
    return Field(validation_alias=f"<{name}>", serialization_alias=f"<{name}>")


def in_no_file(name: str) -> Any:
    """Return the alias of a field that is in no file."""
    return Field(validation_alias=f"<{name}>", exclude=True)


class Group(BaseModel):
    """A group of keys; one that is not declared is an error."""

    # Validators are built on first use: a command reads one kind of file
    model_config = FILE_CONFIG | ConfigDict(frozen=True, defer_build=True)


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


@functools.cache
def _adapter(model: Any) -> TypeAdapter[Any]:
    return TypeAdapter(model)


def undescribed_schema(model: Any) -> dict[str, Any]:
    """Return the JSON Schema of a model, in which the key `QUANTITY_TEXT` says what each quantity takes."""

    def with_keys_spread(schema: dict[str, Any]) -> dict[str, Any]:
        if "properties" in schema:
            schema["properties"] = _spread(schema["properties"], lambda inner: inner.get("properties", {}))
        if "required" in schema:
            schema["required"] = [key for key in schema["required"] if not is_bracketed(key)]
        return schema

    changed: dict[str, Any] = _with_dicts_changed(_adapter(model).json_schema(schema_generator=_FileSchema), with_keys_spread)
    return changed


def model_schema(model: Any, title: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a file, for editors that complete and check YAML."""

    def described(schema: dict[str, Any]) -> dict[str, Any]:
        if quantity := schema.pop(QUANTITY_TEXT, ""):
            meaning = schema.get("description", "").rstrip(".")
            schema["description"] = f"{meaning}. Needed: {quantity}." if meaning else f"Needed: {quantity}."
        return schema

    schema = _with_dicts_changed(undescribed_schema(model), described)
    return {"$schema": _FileSchema.schema_dialect, **schema, "title": title}


def _with_dicts_changed(tree: Any, change: Callable[[dict[str, Any]], dict[str, Any]]) -> Any:
    """Return a copy of nested dicts and lists in which each dict is changed, the inner ones first."""
    if isinstance(tree, (list, tuple)):
        return [_with_dicts_changed(each, change) for each in tree]
    if not isinstance(tree, dict):
        return tree
    return change({key: _with_dicts_changed(value, change) for key, value in tree.items()})


def is_bracketed(key: object) -> bool:
    """Return whether a key stands for several keys of a file, or for none: the name of a field of a model in brackets."""
    return isinstance(key, str) and key.startswith("<") and key.endswith(">")


def gathered(keys: Any, places: Mapping[str, Collection[str]]) -> Any:
    """Return a group of a file whose keys that one field is made of stand together under its name in brackets."""
    if not isinstance(keys, dict):  # made by the program, or no group
        return keys
    inside = {key for names in places.values() for key in names}
    others = {key: value for key, value in keys.items() if key not in inside}
    return others | {place: {key: keys[key] for key in names if key in keys} for place, names in places.items()}


def file_keys(model: Any) -> Any:
    """Return what a model writes into a file, as nested keys and texts."""
    kind: Any = type(model)
    return _with_dicts_changed(_adapter(kind).dump_python(model, by_alias=True, exclude_defaults=True), _spread)


def _spread(keys: dict[str, Any], inside: Callable[[Any], dict[str, Any]] = dict) -> dict[str, Any]:
    """Return a dict in which a key in brackets is replaced by what is ``inside`` its value."""
    flat: dict[str, Any] = {}
    for key, value in keys.items():
        for inner, content in inside(value).items() if is_bracketed(key) else ((key, value),):
            flat[inner] = flat[inner] | content if inner in flat else content
    return flat


Model = TypeVar("Model")


def read_model(model: Callable[..., Model], doc: Document, beside: Mapping[str, Any] | None = None) -> Model:
    """Check a file against its model.

    Parameters
    ----------
    beside
        Values that are in no file, by the names of their fields in brackets.

    Raises
    ------
    ScenarioError
        In one line, with the file's line and the key.
    """
    try:
        keys = doc.data | dict(beside or {})
        checked: Model = _adapter(model).validate_python(keys, context={}, by_alias=True, by_name=False)
    except ValidationError as error:
        raise _first_error(error, doc, model) from None
    return checked


def _first_error(error: ValidationError, doc: Document, model: Any) -> ScenarioError:
    """Return the error to correct first: an unknown key (often a missing one, misspelt), else the topmost in the file."""
    errors = [(_path(details), details) for details in error.errors(include_url=False)]

    def order(placed: tuple[Path, ErrorDetails]) -> tuple[bool, bool, int]:
        path, details = placed
        lines = [doc.lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in doc.lines]
        # A list is too short for pydantic, too, if an entry is faulty; an error without a line comes last
        return details["type"] not in UNKNOWN_KEY, details["type"] == "too_short", lines[0] if lines else 1 << 30

    path, first = min(errors, key=order)
    message = _message(first, path, model)
    if re.search(r"[:-]\s+#", doc.line_of(path)):
        message = f"{message}; {QUOTE_COMMENT_SIGN}"
    return doc.error(path, message)


def _path(details: ErrorDetails) -> Path:
    """Return where in the file an error is, without the parts that pydantic adds for keys and fields of several keys."""
    path = tuple(part for part in details["loc"] if part != "[key]" and not is_bracketed(part))
    return (*path, *details.get("ctx", {}).get("keys", ()))


def _message(details: ErrorDetails, path: Path, model: Any) -> str:
    """Return a message of what was found and what was needed."""
    kind, value = details["type"], details["input"]
    if kind in ("scenario", "unknown_key"):
        return details["msg"]
    if kind in UNKNOWN_KEY:
        return unknown_key(str(path[-1]), _schema_at(model, path[:-1]).get("properties", {}))
    if kind == "missing":
        return f"missing, needed {_words(_schema_at(model, path), str(path[-1]))}"
    if kind == "too_short":
        return "found an empty list, needed at least one entry"
    if kind == "string_type":
        return f"expected text, got {quote(value)}; write for example 'two words'"
    if kind in ("list_type", "tuple_type"):
        return f"expected a list, got {quote(value)}; begin each entry with '- '"
    return no_group(_schema_at(model, path).get("properties", {}), value)


def unknown_key(key: str, known: Collection[str]) -> str:
    """Return the message on an unknown key, with the key that may be meant."""
    elsewhere = [place for place in FILE_KEYS.values() if place.rpartition(".")[2] == key]
    if key in OTHER_KEYS:
        hint = f"; write it as '{OTHER_KEYS[key]}'"
    else:
        hint = suggest(key, known) or (f"; did you mean '{elsewhere[0]}'?" if len(elsewhere) == 1 else "")
    choices = f"needed one of: {', '.join(known)}" if known else "and no keys are known here"
    if hint and len(known) > MAX_CHOICES:  # a terminal's message would be cut before the hint
        choices = "needed another"
    return f"found an unknown key, {choices}{hint}"


def no_group(known: Collection[str], value: object) -> str:
    """Return the message on a value that is no group of keys."""
    if known:
        return f"expected a group of keys ({', '.join(known)}), got {quote(value)}; write them indented below it"
    return f"expected a group of keys, got {quote(value)}; write 'key: value' lines indented below it"


def _words(schema: JsonSchemaValue, key: str) -> str:
    """Return what a missing key takes, with an example."""
    if QUANTITY_TEXT in schema:
        return f"{schema[QUANTITY_TEXT].partition(', with its unit')[0]}; write for example '{key}: {schema['examples'][0]}'"
    if "properties" in schema:
        few = len(schema["properties"]) <= MAX_CHOICES
        return "a group of keys" + (f" ({', '.join(schema['properties'])})" if few else "")
    if schema.get("type") == "array":
        return f"a list of {key}, each begun with '- '"
    return f"text; write for example '{key}: ...'"


_known_schema = functools.cache(undescribed_schema)


def _schema_at(model: Any, path: Path) -> JsonSchemaValue:
    """Return the JSON Schema of the value at ``path``; an empty one if no such key is known."""
    root = _known_schema(model)
    schema: Any = root
    for part in path:
        group = _resolved(schema, root)
        below = group.get("items") if isinstance(part, int) else group.get("properties", {}).get(part)
        schema = below or group.get("additionalProperties") or {}
    return _resolved(schema, root)


def _resolved(schema: JsonSchemaValue, root: JsonSchemaValue) -> JsonSchemaValue:
    """Return a schema without a reference or choices, of which that of a group is taken."""
    if "$ref" in schema:
        return _resolved(root["$defs"][schema["$ref"].removeprefix("#/$defs/")] | {"description": ""}, root)
    groups = [choice for choice in schema.get("anyOf", ()) if "properties" in choice]
    return groups[0] if groups else schema
