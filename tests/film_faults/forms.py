"""Write a film's table: in plain columns or as Tracker does, with the digits that a program prints.

Other forms of tables are in tests/measured/tables/test_readers.py.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.blind.camera import exponent_notation
from tests.film_faults.films import CHANNELS, Array, Film

IN_SI = {"s": 1.0, "ms": 1e-3}


@dataclass(frozen=True, kw_only=True)
class Form:
    """How a table is written."""

    tracker: bool = False
    """Whether it is Tracker's, with numbers in exponents, or plain."""
    names: tuple[str, ...] = ("t", *CHANNELS)
    """Of the columns of a plain table."""
    time: str = "s"
    """Unit of times."""
    with_units: bool = False
    """Whether names of a plain table say their units."""
    length_decimals: int = 6
    time_decimals: int = 6
    """Of a time in seconds."""
    significant: int = 0
    """Digits of every number, in exponents; 0: as the above say."""
    truncated: bool = False
    """Whether further decimals of a time are cut off and not rounded."""

    @property
    def tracks(self) -> dict[str, str]:
        """Mass -> name of its track."""
        return {"light": "mass A", "heavy": "mass B"} if self.tracker else {"light": "light", "heavy": "heavy"}

    @property
    def length_error(self) -> float:
        """Largest error of a length below 1 m by its rounding [m]."""
        return 0.51 * 10.0 ** -(self.significant or self.length_decimals) + 1e-9

    def time_text(self, t: float) -> str:
        """Write a time [s]."""
        t /= IN_SI[self.time]
        if self.significant:
            return f"{t:.{self.significant - 1}E}"
        if self.tracker and not self.truncated and self.time_decimals >= 6:
            return exponent_notation(t)
        decimals = max(0, self.time_decimals + round(math.log10(IN_SI[self.time])))
        if self.truncated:
            t = math.floor(t * 10**decimals + 1e-6) / 10**decimals
        return f"{t:.{decimals}f}"

    def length_text(self, v: float) -> str:
        """Write a length [m]."""
        if np.isnan(v):
            return ""
        if self.significant:
            return f"{v:.{self.significant - 1}E}"
        return exponent_notation(v) if self.tracker and self.length_decimals >= 6 else f"{v:.{self.length_decimals}f}"


def table_text(film: Film, form: Form) -> str:
    """Return a film's table as a file."""
    units = [form.time, *"mmmm"]
    rows: list[Sequence[str]] = [[f"{n} ({u})" if form.with_units else n for n, u in zip(form.names, units, strict=True)]]
    if form.tracker:
        rows = [["", "mass A", "", "mass B", ""], ["t", "x", "y", "x", "y"]]
    rows += [[form.time_text(t), *map(form.length_text, row)] for t, row in zip(film.t, film.written, strict=True)]
    end = ",\n" if form.tracker else "\n"
    return ("# multi:\n" if form.tracker else "") + "".join(",".join(row) + end for row in rows)


def as_written(film: Film, form: Form) -> tuple[Array, Array]:
    """Return the times and points that the texts of a table say, rounded as they are written."""
    t = np.array([float(form.time_text(v)) * IN_SI[form.time] for v in film.t])
    return t, np.array([[float(form.length_text(v) or "nan") for v in row] for row in film.written])
