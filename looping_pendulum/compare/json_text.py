"""Writes results as JSON and reads them back; the layout is documented in `result`."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar

import numpy as np
from pydantic import ConfigDict, PlainValidator, TypeAdapter, ValidationError, WithJsonSchema
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import from_json

from looping_pendulum.errors import ResultError
from looping_pendulum.files import read_file, utf8
from looping_pendulum.installation import command_line
from looping_pendulum.reference_ode.parameters import Parameters, parameters_from
from looping_pendulum.scenarios.document import quote

T = TypeVar("T")
Keys = tuple[str, ...]
"""Keys that lead to a value in nested mappings and lists."""
LENGTH = "how many"
"""Key that a list's length has beside its numbered items."""
MAX_BYTES = 64 * 1024 * 1024
"""Largest size of a result's file [bytes]; the result of a dozen engines has 0.2 MiB."""


def plain(value: Any) -> Any:
    """Return ``value`` as what JSON knows: sorted dicts, lists, and None for a number that is not finite.

    Anything else becomes its text, so that an engine's odd setting never costs the whole result.
    """
    if isinstance(value, Parameters):
        return plain(value.as_dict())
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        # A field that does not count in comparisons, such as the trajectories, is not written either
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value) if f.compare}
    if isinstance(value, Mapping):
        # Sorted, so that the bytes do not depend on the order in which a dict was filled
        return {str(key): plain(value[key]) for key in sorted(value, key=str)}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (set, frozenset)):
        return sorted((plain(item) for item in value), key=str)
    # Before float and str, of which many enums and NumPy's own numbers are subclasses
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str):
        return utf8(value).decode()  # half of a surrogate pair is written as its escape
    if value is None or isinstance(value, (bool, int)):
        return value
    return str(value)


def flatten(tree: Any, keys: Keys = ()) -> dict[Keys, Any]:
    """Return the values of nested mappings and lists by all their keys; items have their number, and a list its length."""
    if isinstance(tree, list):
        tree = {LENGTH: len(tree)} | {str(i): item for i, item in enumerate(tree, 1)}
    if not isinstance(tree, Mapping):
        return {keys: tree}
    return {each: value for key, inner in tree.items() for each, value in flatten(inner, (*keys, key)).items()}


def dump(result: Any, schema_id: str, version: int) -> str:
    """Write a result, a dataclass, as JSON text."""
    tree = {"schema": {"id": schema_id, "version": version}} | plain(result)
    # A NaN that got through would be an error here rather than a file that other programs cannot read
    return json.dumps(tree, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def file_schema(
    cls: Any, schema_id: str, version: int, generator: type[GenerateJsonSchema] = GenerateJsonSchema
) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of `dump`'s text of a result of the dataclass ``cls``."""
    schema = TypeAdapter(cls).json_schema(mode="serialization", schema_generator=generator)
    constants = {"id": {"const": schema_id}, "version": {"const": version}}
    key = {"type": "object", "properties": constants, "required": list(constants)}
    not_written = {f.name for f in dataclasses.fields(cls) if not f.compare}
    written = {name: kind for name, kind in schema["properties"].items() if name not in not_written}
    required = [name for name in schema["required"] if name not in not_written]
    return schema | {"properties": {"schema": key} | written, "required": ["schema", *required]}


def _read_parameters(tree: Any) -> Parameters:
    """Return the parameters that `plain` has written."""
    try:
        return parameters_from(tree)
    except (TypeError, AttributeError, KeyError) as error:
        raise ValueError(str(error)) from None


StoredParameters = Annotated[Parameters, PlainValidator(_read_parameters), WithJsonSchema({"type": "object"})]
"""`Parameters` as a field of a result."""


class JsonResult:
    """Base of a result that is one JSON file; a frozen dataclass that derives from it names the file's schema."""

    __pydantic_config__ = ConfigDict(allow_inf_nan=False)
    SCHEMA_ID: ClassVar[str]
    SCHEMA_VERSION: ClassVar[int]
    FILE: ClassVar[str] = "result.json"
    COMMAND: ClassVar[str] = "compare"
    """Command that writes the file."""

    def to_json(self) -> str:
        """Return the text of the file; everything but ``clock``, where it has one, is the same for the same input."""
        return dump(self, self.SCHEMA_ID, self.SCHEMA_VERSION)

    @classmethod
    def json_schema(cls) -> dict[str, Any]:
        """Return the JSON Schema (draft 2020-12) of the file."""
        return file_schema(cls, cls.SCHEMA_ID, cls.SCHEMA_VERSION)

    @classmethod
    def from_json(cls, text: str, file: str = "") -> Self:
        """Read `to_json`'s text back; ``file`` is its name in messages.

        Raises
        ------
        ResultError
            If the text is not such a result, or is of a later version.
        """
        file = file or cls.FILE
        try:
            tree = from_json(text, allow_inf_nan=False)
        except ValueError as error:
            raise ResultError(f"{file}: {error}; {cls._hint()}") from None
        schema = tree.get("schema") if isinstance(tree, dict) else None
        if not isinstance(schema, dict) or schema.get("id") != cls.SCHEMA_ID:
            raise ResultError(f"{file}: schema: found {quote(schema)}, needed the id {cls.SCHEMA_ID!r}")
        version = schema.get("version")
        if not isinstance(version, int) or not 0 < version <= cls.SCHEMA_VERSION:
            mismatch = f"found version {quote(version)}, needed {cls.SCHEMA_VERSION} or less"
            raise ResultError(f"{file}: schema: {mismatch}; update looping-pendulum")
        try:
            # From the text: strict about types, it takes what JSON has no type for, tuples and enums, only there
            return TypeAdapter(cls).validate_json(text, strict=True)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(map(str, first["loc"])) or "the file"
            what = f"found {quote(first['input'])}; {first['msg'][:1].lower()}{first['msg'][1:]}"
            raise ResultError(f"{file}: not as documented: {where}: {what}; {cls._hint()}") from None

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file that `to_json` has filled.

        Raises
        ------
        ResultError
            If it cannot be read, or is not such a result.
        """
        try:
            raw = read_file(path, MAX_BYTES)
            text = raw.decode("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            why = (error.strerror or str(error)) if isinstance(error, OSError) else "it is not text"
            raise ResultError(f"{path}: {why}; {cls._hint()}") from None
        if len(raw) > MAX_BYTES:
            raise ResultError(f"{path}: found more than {MAX_BYTES // 1024**2} MiB, needed a {cls.FILE}; {cls._hint()}")
        return cls.from_json(text, str(path))

    @classmethod
    def _hint(cls) -> str:
        return f"write it again with `{command_line(cls.COMMAND)}`"
