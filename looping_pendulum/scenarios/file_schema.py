"""JSON Schemas of the files that a user writes, made from their pydantic models, for editors and for the page of all keys."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from looping_pendulum.scenarios.fields import QUANTITY_TEXT


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


def json_schema(model: type[BaseModel], title: str) -> dict[str, Any]:
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
