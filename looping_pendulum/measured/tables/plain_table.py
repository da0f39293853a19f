"""Write what the readers understood of a trial as a plain table, which they, the live page and any spreadsheet read."""

from __future__ import annotations

import csv
import io
import math

import numpy as np

from looping_pendulum.measured.observations import DataError, Observations
from looping_pendulum.measured.tables.names import ERROR_SUFFIX
from looping_pendulum.reference_ode.geometry import Array

SAME_DIGITS = 1e-6
"""Largest difference of a number from its printed digits, in units of the last one: what converting a unit adds in floats."""


def plain_table(observations: Observations, decimals: int | None = None) -> str:
    """Return the points of a trial as CSV: names with SI units, times, and a cell for each value and stated error.

    Parameters
    ----------
    decimals
        Of all numbers; None: as many as each channel's last digit says, or as its floats have.

    Raises
    ------
    DataError
        If there are no points, only events.
    """
    channels = observations.channels
    if not channels:
        raise DataError(f"{observations.file}: found no points over time, needed some for a table; events have no such form")
    times = np.unique(np.concatenate([c.t for c in channels]))
    # Rounded times have the digits of their rounding, which `read` takes for their error
    columns = {"t [s]": _cells(times, math.sqrt(12) * max(c.time_error for c in channels), decimals)}
    known = {f"{c.name} [{c.unit}]": (c, _cells(c.value, c.last_digit, decimals)) for c in channels}
    # Behind all values, as `track` has them
    known |= {
        f"{c.name}{ERROR_SUFFIX} [{c.unit}]": (c, _cells(np.interp(c.t, *c.stated_error), 0.0, decimals))
        for c in channels
        if c.stated_error is not None
    }
    for name, (channel, cells) in known.items():
        column = columns[name] = [""] * len(times)
        for i, cell in zip(np.searchsorted(times, channel.t), cells, strict=True):
            column[i] = cell
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return text.getvalue()


def _cells(values: Array, digit: float, wanted: int | None) -> list[str]:
    """Return numbers with the digits that they had, if the last one of all was worth ``digit``; else with all of a float's."""
    if wanted is not None:
        return [f"{v:.{wanted}f}" for v in values]
    decimals = max(-round(math.log10(digit)), 0) if digit > 0 else 0
    cells = [f"{v:.{decimals}f}" for v in values]
    if digit > 0 and np.allclose(np.array(cells, dtype=float), values, rtol=0.0, atol=SAME_DIGITS * digit):
        return cells
    return [repr(float(v)) for v in values]
