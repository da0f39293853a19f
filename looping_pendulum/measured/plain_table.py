"""Write what the readers understood of a trial as a plain table, which they, the live page and any spreadsheet read."""

from __future__ import annotations

import csv
import io
import math

import numpy as np

from looping_pendulum.measured.observations import DataError, Observations
from looping_pendulum.reference_ode.geometry import Array

SAME_DIGITS = 1e-6
"""Largest difference of a number from its printed digits, in units of the last one: what converting a unit adds in floats."""


def plain_table(observations: Observations) -> str:
    """Return the points of a trial as CSV: one line of names with SI units, the times, and a cell for each value.

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
    columns = [_cells(times, math.sqrt(12) * max(c.time_error for c in channels))]
    for channel in channels:
        cells = [""] * len(times)
        for i, cell in zip(np.searchsorted(times, channel.t), _cells(channel.value, channel.last_digit), strict=True):
            cells[i] = cell
        columns.append(cells)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t [s]", *(f"{c.name} [{c.unit}]" for c in channels)])
    writer.writerows(zip(*columns, strict=True))
    return text.getvalue()


def _cells(values: Array, digit: float) -> list[str]:
    """Return numbers with the digits that they had, if the last one of all was worth ``digit``; else with all of a float's."""
    decimals = max(-round(math.log10(digit)), 0) if digit > 0 else 0
    cells = [f"{v:.{decimals}f}" for v in values]
    if digit > 0 and np.allclose(np.array(cells, dtype=float), values, rtol=0.0, atol=SAME_DIGITS * digit):
        return cells
    return [repr(float(v)) for v in values]
