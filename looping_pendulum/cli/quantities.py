"""Quantities on the command line: a number with its unit, "2 min" or "2 GiB", as in files, or in the option's own unit."""

from __future__ import annotations

import math
from collections.abc import Callable

import typer

from looping_pendulum.errors import one_line, shorten
from looping_pendulum.scenarios.units import UnitError, to_si

UNITS = {"s": ("a time", "90 s"), "Hz": ("frames per second", "240 Hz"), "byte": ("an amount of memory", "2 GiB")}
"""Unit of a number without one -> what it is, and an example."""


def quantity(unit: str, *, least: str) -> Callable[[str | float], float]:
    """Return the parser of an option that takes a quantity of ``unit``, a key of `UNITS`, of ``least`` or more."""
    what, example = UNITS[unit]

    def parse(given: str | float) -> float:
        try:
            value = float(given)
        except ValueError:
            try:
                value = to_si(str(given), unit)
            except UnitError:
                value = math.nan
        if not to_si(least, unit) <= value < math.inf:
            found = one_line(shorten(str(given)))
            raise typer.BadParameter(f"found '{found}', needed {what} of {least} or more; write for example '{example}'")
        return value

    return parse
