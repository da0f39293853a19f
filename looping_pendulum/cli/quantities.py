"""Quantities on the command line: a number with its unit, "2 min" or "240 Hz", as in files; times and rates may go without."""

from __future__ import annotations

import math
from collections.abc import Callable

import typer

from looping_pendulum.scenarios.units import UnitError, to_si

UNITS = {"s": ("a time", "90 s"), "Hz": ("frames per second", "240 Hz")}
"""Unit of a number without one -> what it is, and an example."""


def quantity(unit: str, *, least: float) -> Callable[[str | float], float]:
    """Return the parser of an option that takes a quantity of ``unit``, a key of `UNITS`, of ``least`` or more [SI]."""
    what, example = UNITS[unit]

    def parse(given: str | float) -> float:
        try:
            value = float(given)
        except ValueError:
            try:
                value = to_si(str(given), unit)
            except UnitError:
                value = math.nan
        if not least <= value < math.inf:
            needed = f"{what} of {least:g} {unit} or more"
            raise typer.BadParameter(f"found '{given}', needed {needed}; write for example '{example}'")
        return value

    return parse
