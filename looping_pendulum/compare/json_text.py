"""Results as JSON and back; the layout is documented in `result`."""

from __future__ import annotations

import dataclasses
import json
import math
import types
import typing
from collections.abc import Mapping
from enum import Enum
from typing import Any, TypeVar

import numpy as np

from looping_pendulum.compare.result import SCHEMA_ID, SCHEMA_VERSION, ResultError

T = TypeVar("T")

AGAIN = "write it again with `looping-pendulum compare`"


def plain(value: Any) -> Any:
    """Return ``value`` as what JSON knows: sorted dicts, lists, and None for a number that is not finite.

    Anything else becomes its text, so that an engine's odd setting never costs the whole result.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value) if f.compare}
    if isinstance(value, Mapping):
        return {str(key): plain(value[key]) for key in sorted(value, key=str)}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (set, frozenset)):
        return sorted((plain(item) for item in value), key=str)
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return str(value)


def dump(result: Any, schema_id: str = SCHEMA_ID, version: int = SCHEMA_VERSION) -> str:
    """Write a result, a dataclass, as JSON text."""
    tree = {"schema": {"id": schema_id, "version": version}} | plain(result)
    return json.dumps(tree, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def load(
    cls: type[T],
    text: str,
    schema_id: str = SCHEMA_ID,
    version: int = SCHEMA_VERSION,
    *,
    file: str = "result.json",
    again: str = AGAIN,
) -> T:
    """Read `dump`'s text back as ``cls``; ``file`` and ``again``, a way to write it again, are for the errors."""
    try:
        tree = json.loads(text)
    except json.JSONDecodeError as error:
        raise ResultError(f"{file}: line {error.lineno}: {error.msg}; {again}") from None
    schema = tree.pop("schema", None) if isinstance(tree, dict) else None
    if not isinstance(schema, dict) or schema.get("id") != schema_id:
        raise ResultError(f"{file}: schema: found {schema!r}, needed the id {schema_id!r}")
    if not isinstance(schema.get("version"), int) or schema["version"] > version:
        found = f"found version {schema.get('version')}, needed {version} or less"
        raise ResultError(f"{file}: schema: {found}; update looping-pendulum")
    try:
        return typing.cast(T, _build(cls, tree))
    except (KeyError, TypeError, ValueError) as error:
        raise ResultError(f"{file}: not as documented: {error!r}; {again}") from None


def _has_no_default(field: dataclasses.Field[Any]) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _build(kind: Any, value: Any) -> Any:
    """Rebuild a value of the annotated ``kind`` from plain data."""
    if kind is Any:
        return value
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is types.UnionType or origin is typing.Union:
        return None if value is None else _build(next(k for k in inner if k is not type(None)), value)
    if origin is tuple:
        if len(inner) == 2 and inner[1] is Ellipsis:
            return tuple(_build(inner[0], item) for item in value)
        return tuple(_build(k, item) for k, item in zip(inner, value, strict=True))
    if origin is dict:
        return {key: _build(inner[1], item) for key, item in value.items()}
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        # a key with a default may be missing: the file is older than the key
        needed = [f.name for f in dataclasses.fields(kind) if f.compare and (f.name in value or _has_no_default(f))]
        return typing.cast(Any, kind)(**{name: _build(hints[name], value[name]) for name in needed})
    if kind is float:
        return float(value)
    return kind(value)
