"""A scenario in a notebook: its numbers with their units, and what engines must keep."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import yaml

from looping_pendulum.pages.notebook import shown, table
from looping_pendulum.scenarios import loader
from looping_pendulum.scenarios.scenario import METRICS, Scenario
from looping_pendulum.scenarios.units import show

NOT_NUMBERS = ("title", "description", "inferred", "measured", "tolerances")


def html(scenario: Scenario) -> str:
    """HTML of a scenario."""
    tree = yaml.safe_load(loader.dump(scenario))
    numbers = {key: value for key, value in tree.items() if key not in NOT_NUMBERS}
    parts = [table(["key", "value"], _leaves(numbers))]
    if scenario.tolerances:
        rows = [[t.engine, t.profile, t.metric, show(t.limit, METRICS[t.metric]), t.reason] for t in scenario.tolerances]
        parts.append(table(["engine", "profile", "metric", "limit", "why this much"], rows))
    return shown(f"{scenario.name}: {scenario.title}", scenario.description, *parts)


def _leaves(tree: dict[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    """Yield key and value of every number, keys as "light.mass"."""
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", str(value)
