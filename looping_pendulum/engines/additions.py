"""What adapters add beyond their engines, and by how much each addition reduces the error on the 10:1 trial."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from looping_pendulum.pages.numbers import amount

FILE = "additions.json"
"""File beside this module with what `benchmarks.additions` measured."""
SIGNIFICANT_DIGITS = 2
"""Significant digits of an error in a sentence; whole millimetres are not rounded further."""


@dataclass(frozen=True, kw_only=True)
class Addition:
    """One addition of an adapter, and the errors on the shipped scenario ten_to_one with and without it, quick profile."""

    what: str
    errors: tuple[float, float]
    """Root mean square distance of the light mass from the reference up to 0.35 s and up to 0.7 s [m]."""
    errors_without: tuple[float, float] | None
    """The same without the addition; None: the run did not come to its proper end."""

    def __str__(self) -> str:
        """Return a sentence on the addition with both errors."""
        if self.errors_without is None:
            return f"{self.what}: without it ten_to_one does not come to its proper end"
        return (
            f"{self.what}: without it ten_to_one is off by {_in_millimetres(self.errors_without)} up to 0.35 / 0.7 s, "
            f"with it by {_in_millimetres(self.errors)}"
        )


def _in_millimetres(errors: tuple[float, float]) -> str:
    return " / ".join(amount(error, 1e3, SIGNIFICANT_DIGITS) for error in errors) + " mm"


def measured_additions(label: str) -> tuple[str, ...]:
    """Return sentences on what the adapter of the variant ``label``, "mujoco:beads", adds; empty: none was measured."""
    return tuple(str(addition) for addition in _shipped_additions().get(label, ()))


@cache
def _shipped_additions() -> dict[str, tuple[Addition, ...]]:
    tree: dict[str, Any] = json.loads(files(__package__).joinpath(FILE).read_text(encoding="utf-8"))
    return {label: tuple(from_plain(row) for row in rows) for label, rows in tree.items()}


def from_plain(row: dict[str, Any]) -> Addition:
    """Read one row of the stored file."""
    early, late = row["errors"]
    without = row["errors_without"]
    return Addition(
        what=row["what"], errors=(early, late), errors_without=None if without is None else (without[0], without[1])
    )
