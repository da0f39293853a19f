"""verdict.json: an identification as JSON text, and back.

Layout: ``schema`` {id, version}, then the fields of `result.Identification` by their names, as documented there; SI and
radians; null for what is not known or not finite. Fields marked `compare=False` (arrays for figures) are left out.
"""

from __future__ import annotations

import json
from typing import Any, cast

from looping_pendulum.compare import json_text
from looping_pendulum.discrepancy.result import Identification
from looping_pendulum.errors import ResultError
from looping_pendulum.scenarios.document import quote

SCHEMA_ID = "looping-pendulum/identification"
SCHEMA_VERSION = 9


def dump(result: Identification) -> str:
    """Write a result as JSON text."""
    return json_text.dump(result, SCHEMA_ID, SCHEMA_VERSION)


def load(text: str) -> dict[str, Any]:
    """Read the text of a verdict.json as plain data, under the field names of its `Identification`.

    Raises
    ------
    ResultError
        If the text is no JSON, is no verdict.json, or is of another version.
    """
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ResultError(f"verdict.json: {error}; write it again with `looping-pendulum identify`") from None
    schema = tree.pop("schema", None) if isinstance(tree, dict) else None
    if not isinstance(schema, dict) or schema.get("id") != SCHEMA_ID:
        raise ResultError(f"verdict.json: schema: found {quote(schema)}, needed the id {SCHEMA_ID!r}")
    if schema.get("version") != SCHEMA_VERSION:
        problem = f"found version {quote(schema.get('version'))}, needed {SCHEMA_VERSION}"
        raise ResultError(f"verdict.json: schema: {problem}; write it again with `looping-pendulum identify`")
    return cast(dict[str, Any], tree)
