"""Scenarios: YAML files with units, and the frozen data classes that engines take.

Loading needs pydantic and pint, which engines do not need, so the functions here are imported on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from looping_pendulum.scenarios.loader import dump, json_schema, load, load_text, shipped

__all__ = ["dump", "json_schema", "load", "load_text", "shipped"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("looping_pendulum.scenarios.loader"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
