"""Writes results as JSON and reads them back; the layout is documented in `result`."""

from __future__ import annotations

import dataclasses
import json
import math
import types
import typing
from collections.abc import Mapping
from enum import Enum
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from looping_pendulum.errors import ResultError
from looping_pendulum.files import utf8
from looping_pendulum.reference_ode.parameters import Parameters, parameters_from
from looping_pendulum.scenarios.document import quote, shorten

T = TypeVar("T")


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


def flatten(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the values of nested mappings in one, by keys such as "light.mass"."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        flat |= flatten(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
    return flat


def dump(result: Any, schema_id: str, version: int) -> str:
    """Write a result, a dataclass, as JSON text."""
    tree = {"schema": {"id": schema_id, "version": version}} | plain(result)
    # A NaN that got through would be an error here rather than a file that other programs cannot read
    return json.dumps(tree, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def load(
    cls: type[T],
    text: str,
    schema_id: str,
    version: int,
    *,
    file: str,
    rewrite_hint: str = "",
) -> T:
    """Read `dump`'s text back as ``cls``.

    Parameters
    ----------
    file, rewrite_hint
        Name of the file and a way to write it again, both for the messages of errors.
    """
    try:
        # By default Python reads NaN and Infinity, which are not JSON, and 1e999 as infinite
        tree = json.loads(text, parse_int=_integer, parse_float=_finite, parse_constant=_finite)
        _refuse_unwritable(tree)
    # First, as it is a ValueError, too, and knows the line
    except json.JSONDecodeError as error:
        raise ResultError(f"{file}: line {error.lineno}: {error.msg}; {rewrite_hint}") from None
    except ValueError as error:
        raise ResultError(f"{file}: {error}; {rewrite_hint}") from None
    except RecursionError:
        raise ResultError(f"{file}: found nesting without end, needed a result; {rewrite_hint}") from None
    schema = tree.pop("schema", None) if isinstance(tree, dict) else None
    if not isinstance(schema, dict) or schema.get("id") != schema_id:
        raise ResultError(f"{file}: schema: found {quote(schema)}, needed the id {schema_id!r}")
    if not isinstance(schema.get("version"), int) or not 0 < schema["version"] <= version:
        mismatch = f"found version {quote(schema.get('version'))}, needed {version} or less"
        raise ResultError(f"{file}: schema: {mismatch}; update looping-pendulum")
    try:
        return typing.cast(T, _build(cls, tree, ""))
    except ValueError as error:
        raise ResultError(f"{file}: not as documented: {error}; {rewrite_hint}") from None


class JsonResult:
    """Base of a result that is one JSON file; a frozen dataclass that derives from it names the file's schema."""

    SCHEMA_ID: ClassVar[str]
    SCHEMA_VERSION: ClassVar[int]
    FILE: ClassVar[str] = "result.json"
    COMMAND: ClassVar[str] = "compare"
    """Command that writes the file."""

    def to_json(self) -> str:
        """Return the text of the file; everything but ``clock``, where it has one, is the same for the same input."""
        return dump(self, self.SCHEMA_ID, self.SCHEMA_VERSION)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read `to_json`'s text back.

        Raises
        ------
        ResultError
            If the text is not such a result, or is of a later version.
        """
        hint = f"write it again with `looping-pendulum {cls.COMMAND}`"
        return load(cls, text, cls.SCHEMA_ID, cls.SCHEMA_VERSION, file=cls.FILE, rewrite_hint=hint)


MAX_NESTING = 64
"""Largest number of nested levels; a result needs eight, and an engine's settings a few more."""
MAX_INTEGER_DIGITS = 300
"""Largest number of digits of an integer: one with more could not be a floating-point number either."""


def _integer(digits: str) -> int:
    if len(digits) > MAX_INTEGER_DIGITS:
        raise ValueError(f"found a whole number of {len(digits)} digits, needed at most {MAX_INTEGER_DIGITS}")
    return int(digits)


def _finite(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise ValueError(f"found {shorten(digits)}, needed a finite number")
    return value


def _refuse_unwritable(tree: Any) -> None:
    """Refuse what could be read but not traversed or written again: very deep nesting, and halves of surrogate pairs."""
    # Level by level: a recursive function would itself fail at the nesting that it is to refuse
    level = [tree]
    for _ in range(MAX_NESTING):
        strings = [each for each in level if isinstance(each, str)]
        strings += [key for each in level if isinstance(each, dict) for key in each]
        half = next((c for text in strings for c in text if "\ud800" <= c <= "\udfff"), None)
        if half is not None:
            raise ValueError(f"found {half!a}, which is half a character, needed text")
        level = [inner for each in level if isinstance(each, dict) for inner in each.values()] + [
            inner for each in level if isinstance(each, list) for inner in each
        ]
        if not level:
            return
    raise ValueError(f"found more than {MAX_NESTING} levels of nesting, needed a result")


_TYPE_NAMES = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


def _build(kind: Any, value: Any, where: str) -> Any:
    """Rebuild a value of the annotated ``kind`` from plain data; ``where`` is its place, "engines[0].metrics.drop_error"."""
    if kind is Any:
        return value
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    # The only unions are of one type and None
    if origin is types.UnionType or origin is typing.Union:
        return None if value is None else _build(next(k for k in inner if k is not type(None)), value, where)
    if origin is tuple:
        items = _checked(list, "a list", value, where)
        kinds = [inner[0]] * len(items) if len(inner) == 2 and inner[1] is Ellipsis else list(inner)
        if len(kinds) != len(items):
            raise ValueError(f"{where}: found {len(items)} values, needed {len(kinds)}")
        return tuple(_build(k, item, f"{where}[{i}]") for i, (k, item) in enumerate(zip(kinds, items, strict=True)))
    if origin is dict:
        group = _checked(dict, "an object", value, where)
        return {key: _build(inner[1], item, f"{where}.{key}".lstrip(".")) for key, item in group.items()}
    if kind is Parameters:
        return _parameters(_checked(dict, "an object", value, where), where)
    if dataclasses.is_dataclass(kind):
        return _build_dataclass(kind, _checked(dict, "an object", value, where), where)
    if isinstance(kind, type) and issubclass(kind, Enum):
        known = [each.value for each in kind]
        if not isinstance(value, str) or value not in known:
            raise ValueError(f"{where}: found {quote(value)}, needed one of {', '.join(known)}")
        return kind(value)
    if kind is float:
        # Other programs write 1.0 as 1
        whole = isinstance(value, int) and not isinstance(value, bool)
        return float(value if whole else _checked(float, _TYPE_NAMES[float], value, where))
    return _checked(kind, _TYPE_NAMES[kind], value, where)


def _build_dataclass(kind: Any, group: dict[str, Any], where: str) -> Any:
    hints = typing.get_type_hints(kind)
    fields = [f for f in dataclasses.fields(kind) if f.compare]
    for f in fields:
        required = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
        if required and f.name not in group:
            raise ValueError(f"{where}: found no {f.name!r}, needed it".removeprefix(": "))
    # A key with a default may be missing, in a file that is older than the key.
    return kind(
        **{f.name: _build(hints[f.name], group[f.name], f"{where}.{f.name}".lstrip(".")) for f in fields if f.name in group}
    )


def _parameters(group: dict[str, Any], where: str) -> Parameters:
    try:
        return parameters_from(group)
    except (ValueError, TypeError, AttributeError, KeyError) as error:
        raise ValueError(f"{where}: {error}") from None


def _checked(kind: type[T], words: str, value: Any, where: str) -> T:
    """Return ``value`` if it is of the ``kind``; true and false do not count as numbers."""
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(f"{where or 'the file'}: found {quote(value)}, needed {words}")
    return value
