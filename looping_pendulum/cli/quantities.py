"""Quantities on the command line: a number with its unit, "2 min" or "240 Hz", as in files; times and rates may go without."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import typer

from looping_pendulum.errors import one_line, shorten

PLAIN_NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*")
UNITS = {"s": ("a time", "90 s"), "Hz": ("frames per second", "240 Hz"), "byte": ("an amount of memory", "2 GiB")}
"""Unit of a number without one -> what it is, and an example."""


def quantity(unit: str, *, least: float = -math.inf) -> Callable[[str | float], float]:
    """Return the parser of an option that takes a quantity of ``unit``, a key of `UNITS`, of ``least`` or more [SI]."""
    what, example = UNITS[unit]

    def parse(given: str | float) -> float:
        # A default is a number already
        value = given if isinstance(given, float) else _in_si(given, unit)
        if value is None or not least <= value < math.inf:
            smallest = f"{least / 1024**2:g} MiB" if unit == "byte" else f"{least:g} {unit}"
            bound = "" if least == -math.inf else f" of {smallest} or more"
            found = one_line(shorten(str(given)))
            raise typer.BadParameter(f"found '{found}', needed {what}{bound}; write for example '{example}'")
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
