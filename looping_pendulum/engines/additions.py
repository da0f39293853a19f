"""What an adapter puts in beyond its engine, and what that is worth on the 10:1 trial."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from looping_pendulum.pages.numbers import amount

FILE = "additions.json"
"""Beside this module: what `benchmarks.additions` measured."""
SHOWN = 2
"""Significant digits of an error, and all digits of whole millimetres."""


@dataclass(frozen=True, kw_only=True)
class Addition:
    """One thing that an adapter adds, and the errors of the shipped 10:1 trial with and without it, quick profile."""

    what: str
    errors: tuple[float, float]
    """Root mean square distance of the light mass from the reference up to 0.35 s and up to 0.7 s [m]."""
    errors_without: tuple[float, float] | None
    """The same without it; None: the run did not come to its proper end."""

    def __str__(self) -> str:
        """Return a sentence with its worth."""
        if self.errors_without is None:
            return f"{self.what}: without it ten_to_one does not come to its proper end"
        return (
            f"{self.what}: without it ten_to_one is off by {_pair(self.errors_without)} up to 0.35 / 0.7 s, "
            f"with it by {_pair(self.errors)}"
        )


def _pair(errors: tuple[float, float]) -> str:
    return " / ".join(amount(error, 1e3, SHOWN) for error in errors) + " mm"


def measured_additions(label: str) -> tuple[str, ...]:
    """Sentences on what the adapter of ``label``, "mujoco:beads", adds; empty: nothing was measured of it."""
    return tuple(str(addition) for addition in _shipped().get(label, ()))


@cache
def _shipped() -> dict[str, tuple[Addition, ...]]:
    tree: dict[str, Any] = json.loads(files(__package__).joinpath(FILE).read_text(encoding="utf-8"))
    return {label: tuple(from_plain(row) for row in rows) for label, rows in tree.items()}


def from_plain(row: dict[str, Any]) -> Addition:
    """Read one stored row."""
    early, late = row["errors"]
    without = row["errors_without"]
    return Addition(
        what=row["what"], errors=(early, late), errors_without=None if without is None else (without[0], without[1])
    )
