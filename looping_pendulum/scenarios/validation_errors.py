"""Convert pydantic's errors on a scenario file to one line for its author."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from looping_pendulum.errors import ScenarioError
from looping_pendulum.scenarios.document import Document, Path, quote
from looping_pendulum.scenarios.fields import QuantityField, suggest
from looping_pendulum.scenarios.quantities import FILE_KEYS


def first_error(error: ValidationError, doc: Document, model: type[BaseModel]) -> ScenarioError:
    """Return the error to correct first: an unknown key (often a missing one, misspelt), else the topmost in the file."""
    errors = error.errors(include_url=False)

    def order(details: ErrorDetails) -> tuple[bool, int]:
        path = _path(details)
        lines = [doc.lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in doc.lines]
        return details["type"] != "extra_forbidden", lines[0] if lines else 1 << 30

    first = min(errors, key=order)
    return doc.error(_path(first), _message(first, model))


def _path(details: ErrorDetails) -> Path:
    """Return where in the file an error is, without the parts that pydantic adds for unions and keys."""
    path = tuple(part for part in details["loc"] if part not in ("<direct>", "<shape>", "[key]"))
    key = details.get("ctx", {}).get("key")
    return (*path, *key.split(".")) if key else path


def _message(details: ErrorDetails, model: type[BaseModel]) -> str:
    """Return a message of what was found and what was needed."""
    path = _path(details)
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
            is_collection = not _is_model(field.annotation) and path[0] in ("inferred", "tolerances", "own_effects")
            if is_collection and not rest:
                return BaseModel
            # [1:]: a number in the list, or an engine's name, stands between the collection and its group
            return _group_at(below, rest[1:] if is_collection else rest)
    return BaseModel


def _is_model(annotation: Any) -> bool:
    """Return whether a field's annotation is itself a model."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _model_in(annotation: Any) -> type[BaseModel]:
    """Return the model inside ``X | None``, ``list[X]`` or ``dict[str, X]``."""
    if _is_model(annotation):
        return annotation  # type: ignore[no-any-return]
    inner = [_model_in(a) for a in getattr(annotation, "__args__", ())]
    return next((m for m in inner if m is not BaseModel), BaseModel)
