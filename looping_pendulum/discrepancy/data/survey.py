"""Look into a file of tracked points before anything is known of it: which tracks, rows per second and units it has.

`readers.read` needs to know which track is which mass, and in which unit; here the file says it, or the motion proposes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from looping_pendulum.discrepancy.data.columns import Column, ReadingNotes, read_columns
from looping_pendulum.discrepancy.data.delimited import DelimitedTable, read_table
from looping_pendulum.discrepancy.data.events import is_event_table
from looping_pendulum.discrepancy.data.observations import DataError
from looping_pendulum.discrepancy.data.readers import MASSES, MAX_TIME_STEP, mass_in_name
from looping_pendulum.reference_ode.geometry import Array

UNNAMED_TRACKS = {"light": "first", "heavy": "second"}
"""Names for the two tracks of a file without names of columns, in the order of its columns."""
LENGTH_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Units that a file without units may have, each in metres; the first with plausible positions is proposed."""
PLAUSIBLE_SPAN = 5.0
"""Largest distance that tracked points plausibly span [m]: a string of 2.5 m to both sides."""
OUTLIER_SHARE = 5.0
"""Percentage of the points at either end of a range that do not count, as an autotracker slips."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """Tracked points of one object, in the unit of the file."""

    name: str
    """Name in the file; '' if it has none."""
    x: Array
    """Horizontal positions, shape (n,)."""
    y: Array
    """Vertical positions, shape (m,); n and m may differ by empty cells."""

    @property
    def width(self) -> float:
        """Return the range of x without outliers."""
        return _range(self.x)

    @property
    def fall(self) -> float:
        """Return how much lower the track ends than it begins."""
        return float(self.y[0] - self.y[-1]) if len(self.y) else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class FileSurvey:
    """What a file says of itself."""

    file: str
    kind: str
    """"positions", "angle", "drop" or "events", as in `readers.KINDS`."""
    tracks: tuple[Track, ...] = ()
    """Tracks in the order of their columns; none if the file has no positions."""
    has_names: bool = True
    """Whether the file names its columns."""
    time_step: float | None = None
    """Median time between rows, in the file's unit of time; None: it has no times, only numbers of frames."""
    length_unit: str = ""
    """Unit that the header gives for lengths; '' if it gives none."""
    time_unit: str = ""
    drops: tuple[int, ...] = ()
    """Numbers of the drops that the file holds."""

    @property
    def proposed_length_unit(self) -> str:
        """Return the header's unit of length, or the largest in which the positions are plausible."""
        spans = [max(_range(t.x), _range(t.y)) for t in self.tracks] or [0.0]
        plausible = (unit for unit, metres in LENGTH_UNITS.items() if max(spans) * metres <= PLAUSIBLE_SPAN)
        return self.length_unit or next(plausible, "m")

    @property
    def proposed_time_unit(self) -> str:
        """Return the header's unit of time, or s, or ms if that would make rows too rare."""
        return self.time_unit or ("ms" if self.time_step is not None and self.time_step > MAX_TIME_STEP else "s")

    def proposed_masses(self) -> dict[str, str]:
        """Return mass -> name of its track: by the names of the tracks, or by their motion.

        The heavy mass falls along a vertical line, the light one swings: of two tracks, the narrower one is the heavy mass's.
        If neither is clearly narrower, as in a vertical release, it is the one that falls farther.
        """
        named = {mass: t.name for t in self.tracks if (mass := mass_in_name(t.name))}
        rest = [t for t in self.tracks if t.name not in named.values()]
        missing = [mass for mass in MASSES if mass not in named]
        if not rest or not missing:
            return named
        wide, narrow = (choose(rest, key=lambda track: track.width) for choose in (max, min))
        if len(rest) > 1 and 2 * narrow.width > wide.width:
            wide, narrow = (choose(rest, key=lambda track: track.fall) for choose in (min, max))
        if len(rest) == 1 and len(missing) > 1:
            missing = ["heavy" if 2 * wide.width < wide.fall else "light"]
        return named | {mass: {"light": wide, "heavy": narrow}[mass].name for mass in missing}

    def starts_on_the_right(self, masses: Mapping[str, str]) -> bool:
        """Return whether the light mass's first point is to the right of the heavy mass's line: the picture is mirrored."""
        by_name = {t.name: t for t in self.tracks}
        if not {"light", "heavy"} <= masses.keys() or not set(masses.values()) <= by_name.keys():
            return False
        light, heavy = (by_name[masses[mass]].x for mass in MASSES)
        return bool(len(light) and len(heavy) and light[0] > np.median(heavy))


def survey(path: str | Path) -> FileSurvey:
    """Look into a file of measured data.

    Raises
    ------
    DataError
        If it cannot be read as a table of positions, angles, heights or events.
    """
    table = read_table(path, text_column="quantity")
    if is_event_table(table):
        return FileSurvey(file=table.file, kind="events")
    has_names = True
    try:
        columns = read_columns(table, "auto", None, ReadingNotes())
    except DataError:
        # Five columns without names are read if both tracks get names from outside
        columns = read_columns(table, "auto", UNNAMED_TRACKS, ReadingNotes())
        has_names = False
    roles = {c.role for c in columns}
    kind = "positions" if roles & {"x", "y"} else "drop" if "height" in roles else "angle"
    drop = next((c for c in columns if c.role == "drop"), None)
    return FileSurvey(
        file=table.file,
        kind=kind,
        tracks=_tracks(table, columns) if kind == "positions" else (),
        has_names=has_names,
        time_step=_time_step(table, columns),
        length_unit=next((c.unit for c in columns if c.role in ("x", "y", "height") and c.unit), ""),
        time_unit=next((c.unit for c in columns if c.role == "t" and c.unit), ""),
        drops=() if drop is None else tuple(sorted({int(n) for n in _numbers(table, drop)})),
    )


def _tracks(table: DelimitedTable, columns: list[Column]) -> tuple[Track, ...]:
    """Return the tracks of a table of positions."""
    names = dict.fromkeys(c.track for c in columns if c.role in ("x", "y"))
    of = {(c.track, c.role): c for c in reversed(columns)}
    empty = np.empty(0)
    return tuple(
        Track(
            name=name,
            x=_numbers(table, of[name, "x"]) if (name, "x") in of else empty,
            y=_numbers(table, of[name, "y"]) if (name, "y") in of else empty,
        )
        for name in names
    )


def _numbers(table: DelimitedTable, column: Column) -> Array:
    """Return the values of a column, without empty cells."""
    values = [table.number(row, column.index, column.label) for row in table.rows]
    return np.array([value for value in values if value is not None])


def _time_step(table: DelimitedTable, columns: list[Column]) -> float | None:
    """Return the median step of the first column of times; None if there is no such column."""
    clock = next((c for c in columns if c.role == "t"), None)
    if clock is None:
        return None
    steps = np.diff(_numbers(table, clock))
    return float(np.median(steps)) if len(steps) else 0.0


def _range(values: Array) -> float:
    """Return the range of ``values`` without outliers."""
    return float(np.subtract(*np.percentile(values, [100 - OUTLIER_SHARE, OUTLIER_SHARE]))) if len(values) else 0.0
