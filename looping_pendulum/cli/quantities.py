"""Quantities on the command line: a number with its unit, "2 min" or "240 Hz", as in files; times and rates may go without."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import typer

PLAIN_NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*")
UNITS = {"s": ("a time", "90 s"), "Hz": ("frames per second", "240 Hz")}
"""Unit of a number without one -> what it is, and an example."""


def quantity(unit: str, *, least: float = -math.inf) -> Callable[[str | float], float]:
    """Return the parser of an option that takes a quantity of ``unit``, a key of `UNITS`, of ``least`` or more [SI]."""
    what, example = UNITS[unit]

    def parse(given: str | float) -> float:
        # A default is a number already
        value = given if isinstance(given, float) else _in_si(given, unit)
        if value is None or not least <= value < math.inf:
            bound = "" if least == -math.inf else f" of {least:g} {unit} or more"
            raise typer.BadParameter(f"found '{given}', needed {what}{bound}; write for example '{example}'")
        return value

    return parse


def _in_si(text: str, unit: str) -> float | None:
    """Return a quantity [SI]; None if it is none of ``unit``."""
    if PLAIN_NUMBER.fullmatch(text):
        return float(text)
    # Imported here, as pint would double the time that a command takes to start
    from looping_pendulum.scenarios.units import UnitError, to_si

    try:
        return to_si(text, unit)
    except UnitError:
        return None
