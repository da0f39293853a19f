"""verdict.json: an identification as JSON text, and back.

Layout: ``schema`` {id, version}, then the fields of `result.Identification` by their names, as documented there; SI and
radians; null for what is not known or not finite. Fields marked `compare=False` (arrays for figures) are left out. Version 3
renamed fields of version 2 without a change of meaning; `RENAMED` lists them. Version 4 has ``correlated_noise`` and
``smallest_visible`` in place of ``remainder`` and of the factor on the errors of a round, which `load` leaves as they are in
older files. In version 5 an effect's ``interval`` is one of 95 % and may be open (null) on a side; before, its ends were those
of three standard errors, or the value's bounds. From version 6 on ``other_closures`` has laws that were screened only, whose
``held_out_chi2`` is null. From version 7 on the ``distance`` of an experiment is that of the closest explanations which it
separates, and two fields count these; before, it was that of any two. From version 8 on the interval of an effect
that is just large enough to be named reaches farther towards its null value.
"""

from __future__ import annotations

import json
from typing import Any, cast

from looping_pendulum.compare import json_text
from looping_pendulum.discrepancy.result import Identification
from looping_pendulum.errors import ResultError
from looping_pendulum.scenarios.document import quote

SCHEMA_ID = "looping-pendulum/identification"
SCHEMA_VERSION = 8
OLDEST_VERSION = 2
"""Oldest version of verdict.json that `load` reads."""
_EFFECT = {"null": "null_value"}
_FIT = {
    "numbers": "parameters",
    "condition": "condition_number",
    "held_out": "held_out_chi2",
    "alarms": "failed_tests",
    "starts": "start_costs",
}
_FORMULA = {
    "numbers": "parameters",
    "gain": "delta_bic",
    "gain_of_bumps": "delta_bic_of_profile",
    "held_out": "held_out_chi2",
    "held_out_of_bumps": "held_out_chi2_of_profile",
    "stands": "accepted",
}
RENAMED: dict[str, dict[str, str]] = {
    "effects": _EFFECT,
    "ties": _EFFECT,
    "ranking": {"gain": "delta_bic", "held_out": "held_out_chi2"},
    "errors": {"noise_before": "standardised_rms_before", "noise_after": "standardised_rms_after"},
    "before": _FIT,
    "after": _FIT,
    "unlisted": {
        "gain": "twice_log_bayes_factor",
        "held_out_before": "held_out_chi2_before",
        "held_out_after": "held_out_chi2_after",
        "others": "other_closures",
    },
    "others": {"gain": "twice_log_bayes_factor", "held_out": "held_out_chi2"},
    "profiles": {"sure_from": "significant_from", "sure_to": "significant_to", "written": "fitted_formula_values"},
    "formula": _FORMULA,
    "formulas": _FORMULA,
}
"""Field of version 2 that holds an object, or a list of them -> the object's fields in version 2 -> their names in version 3.

By the field that holds them, since one old name had several meanings: ``gain`` was a difference of the Bayesian information
criterion in a ranking, and twice a log Bayes factor in an unlisted force.
"""


def dump(result: Identification) -> str:
    """Write a result as JSON text."""
    return json_text.dump(result, SCHEMA_ID, SCHEMA_VERSION)


def load(text: str) -> dict[str, Any]:
    """Read the text of a verdict.json of version 2 to 8 as plain data, under the field names of its `Identification`.

    Raises
    ------
    ResultError
        If the text is no JSON, is no verdict.json, or is of a version that this package does not know.
    """
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ResultError(f"verdict.json: {error}; write it again with `looping-pendulum identify`") from None
    schema = tree.pop("schema", None) if isinstance(tree, dict) else None
    if not isinstance(schema, dict) or schema.get("id") != SCHEMA_ID:
        raise ResultError(f"verdict.json: schema: found {quote(schema)}, needed the id {SCHEMA_ID!r}")
    version = schema.get("version")
    if version == OLDEST_VERSION:
        return cast(dict[str, Any], _renamed(tree))
    if version not in (3, 4, 5, 6, SCHEMA_VERSION):
        problem = f"found version {quote(version)}, needed {OLDEST_VERSION} to {SCHEMA_VERSION}"
        raise ResultError(f"verdict.json: schema: {problem}; write it again with `looping-pendulum identify`")
    return cast(dict[str, Any], tree)


def _renamed(value: Any, field_name: str = "") -> Any:
    """Return what the field ``field_name`` of a version 2 file holds, under the names of today."""
    if isinstance(value, list):
        return [_renamed(item, field_name) for item in value]
    if not isinstance(value, dict):
        return value
    names = RENAMED.get(field_name, {})
    return {names.get(key, key): _renamed(item, key) for key, item in value.items()}
