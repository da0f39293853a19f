"""The times of a table's points: from what a file says of its times, and a study of the camera, to channels.

Where times are whole numbers of equal steps that were rounded, they are put back; where they are not, the rounding is an error
of each time. What was done is said in a sentence. What is wrong with times that are printed well, the look finds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.errors import WayOut
from looping_pendulum.measured.clock import EXACT, MAX_TIME_STEP, RATE_TOLERANCE, are_milliseconds, frame_grid, typical_step
from looping_pendulum.measured.observations import Channel, DataError, ReadingNotes
from looping_pendulum.measured.tables.delimited import data_error
from looping_pendulum.measured.tables.forms import Stated
from looping_pendulum.measured.tables.names import Column
from looping_pendulum.reference_ode.geometry import Array

MAX_FRAME_RATE = 50_000.0
"""Largest plausible rate of rows, and of the camera of a pendulum [Hz]."""
MAX_FRAMES = 1_000_000
"""Largest number of frames, or of typical steps, from the first row to the last: more than an hour at 240/s."""
OTHER_UNITS = {
    "us": (1e-6, "us"), "ms": (1e-3, "ms"), "min": (60.0, "minutes"), "h": (3600.0, "hours"),
    "day": (86400.0, "fractions of a day, as spreadsheets have them"),
}  # fmt: skip
"""Units that times without one may be in where seconds are impossible -> size [s] and words."""
LIKELY_STEPS = (1 / 1000, 1 / 15)
"""Smallest and largest time between rows by which one of these units is recognised [s]."""
DAY = 86400.0
"""Times that begin later are those of a calendar [s]."""
MIN_ROUNDED = 10
"""Smallest number of rows whose times are looked at for rounding."""


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """Rows with one column of times or frames, and the channels that it times."""

    file: str
    clock: str
    """Name of the column of times, or of frames where there are no times."""
    lines: NDArray[np.intp]
    """Numbers of the lines, shape (n,)."""
    time: Array
    """Times by the file's clock [s], shape (n,); not a number: none."""
    rounding: Array
    """Largest error by which rounding has changed each time [s], shape (n,)."""
    frame: Array
    """Numbers of the frames, shape (n,); not a number: none."""
    channels: Mapping[str, Column] = field(default_factory=dict)
    has_unit: bool = True
    """Whether the file or the study says in which unit the times are."""

    @property
    def has_frames(self) -> bool:
        """Return whether any row has the number of a frame."""
        return bool(np.isfinite(self.frame).any())

    def error(self, row: int | None, message: str, way_out: WayOut | None = None, column: str | None = None) -> DataError:
        """Return an error about a row, by default about its time."""
        line = None if row is None else int(self.lines[row])
        return data_error(self.file, line, self.clock if column is None else column, message, way_out)

    def rows(self, kept: NDArray[np.bool_]) -> Sheet:
        """Return the sheet with some of its rows.

        Raises
        ------
        DataError
            If a channel has no value in them.
        """
        channels = {
            name: replace(c, value=c.value[kept], error=None if c.error is None else c.error[kept])
            for name, c in self.channels.items()
        }
        for name, c in channels.items():
            if not c.has_values.any():
                raise self.error(None, f"found no values at all, needed {name}(t); export that track again", column=c.label)
        lines, time, rounding, frame = self.lines[kept], self.time[kept], self.rounding[kept], self.frame[kept]
        return replace(self, channels=channels, lines=lines, time=time, rounding=rounding, frame=frame)


def timed_channels(sheets: Sequence[Sheet], stated: Stated, notes: ReadingNotes) -> list[Channel]:
    """Return the channels with the times of their points; what is put right or assumed is noted.

    Raises
    ------
    DataError
        If the times cannot be used.
    """
    sheets = [s.rows(np.any([c.has_values for c in s.channels.values()], axis=0)) for s in sheets]
    times = np.concatenate([s.time[np.isfinite(s.time)] for s in sheets])
    if len(times) and times.min() > DAY:
        # Doubles hold times of a calendar to microseconds only
        notes.assumptions.append(f"the first time, {times.min():.4g} s, was taken as 0: the file has days of a calendar")
        sheets = [replace(s, time=s.time - times.min()) for s in sheets]
    # No film has whole numbers of seconds
    is_stated = any(s.has_unit or s.has_frames for s in sheets)
    if not is_stated and len(np.unique(times)) > 1 and not np.any(times % 1):
        sheets = _of_whole_numbers(sheets, np.unique(times), stated, notes)
    error = 0.0
    if stated.frame_rate is not None and all(s.has_frames for s in sheets):
        on_clock = _times_of_frames(sheets, stated.frame_rate)
    elif any(s.has_frames and not np.isfinite(s.time).any() for s in sheets):
        way_out = WayOut(words="give {}", keys={"frame_rate": "240 Hz"}, is_example=True)
        found = "found frame numbers but no times, needed the camera's frame rate"
        raise sheets[0].error(None, found, way_out, column="")
    else:
        sheets = [s.rows(np.isfinite(s.time)) for s in sheets]
        on_clock, error = _times_of_clock(sheets, stated, notes)
    return [
        _channel(name, column, t, error) for s, t in zip(sheets, on_clock, strict=True) for name, column in s.channels.items()
    ]


def _channel(name: str, column: Column, t: Array, time_error: float) -> Channel:
    """Return the points of a column that have a value and a time."""
    kept = column.has_values & np.isfinite(t)
    return Channel(
        name=name,
        t=t[kept],
        value=column.value[kept] * column.factor,
        time_error=time_error,
        last_digit=column.digit * column.factor,
        stated_error=None if column.error is None else (t[kept], column.error[kept]),
    )


def _of_whole_numbers(sheets: Sequence[Sheet], number: Array, stated: Stated, notes: ReadingNotes) -> list[Sheet]:
    """Return sheets whose times are whole numbers without a unit with milliseconds, or with numbers of frames.

    Raises
    ------
    DataError
        If the column does not tell which of both they are.
    """
    in_milliseconds = are_milliseconds(number, stated.frame_rate, stated.clip_rate)
    if in_milliseconds is None:
        ask = (
            "if times count frames, give the camera's rate by {}"
            if stated.frame_rate is None
            else "else name the column 'frame'"
        )
        counted = WayOut(words=ask, keys={"frame_rate": "240 Hz"}, is_example=True)
        way_out = WayOut(words="if times are in ms, say so: {}", keys={"units.time": "ms"}, alternative=counted)
        raise sheets[0].error(0, f"found a row every {typical_step(number):g} s, needed many a second", way_out)
    what = "milliseconds, as their steps say" if in_milliseconds else "numbers of frames"
    notes.assumptions.append(f"column {sheets[0].clock!r} has whole numbers without a unit: taken as {what}")
    if not in_milliseconds:
        return [replace(s, frame=s.time) for s in sheets]
    return [replace(s, time=s.time / 1000, rounding=s.rounding / 1000, has_unit=True) for s in sheets]


def _times_of_frames(sheets: Sequence[Sheet], frame_rate: float) -> list[Array]:
    """Compute times from frame numbers; all tracks count from the first frame in which any of them has a point."""
    for s in sheets:
        is_wrong = np.isnan(s.frame) | np.append(False, ~(np.diff(s.frame) > 0))
        _refuse_order(s, s.frame, "frame", is_wrong, "frame numbers that grow; export them again")
    first, last = min(s.frame[0] for s in sheets), max(s.frame[-1] for s in sheets)
    if last - first > MAX_FRAMES:
        found = f"found frames from {first:g} to {last:g}, needed at most {MAX_FRAMES} of one trial"
        raise sheets[0].error(-1, f"{found}; export the trial's alone", column="frame")
    return [(s.frame - first) / frame_rate for s in sheets]


def _refuse_order(sheet: Sheet, number: Array, column: str, is_wrong: NDArray[np.bool_], needed: str) -> None:
    """Refuse the first row whose time or frame is wrong after that of the row before."""
    for i in np.flatnonzero(is_wrong):
        found = "nothing" if np.isnan(number[i]) else f"{number[i]:g} after {number[i - 1]:g} (line {sheet.lines[i - 1]})"
        raise sheet.error(int(i), f"found {found}, needed {needed}", column=column)


def _times_of_clock(sheets: Sequence[Sheet], stated: Stated, notes: ReadingNotes) -> tuple[list[Array], float]:
    """Return the times of the rows of each sheet [s], and how far rounding may have changed them, as a standard error [s]."""
    for s in sheets:
        _refuse_order(s, s.time, s.clock, np.append(False, np.diff(s.time) < 0), "times that grow; sort or delete rows")
    longest = max(sheets, key=lambda s: len(s.lines))
    rounding = float(longest.rounding.max()) if len(longest.time) >= MIN_ROUNDED else 0.0
    rates = [r for r in (stated.clip_rate, stated.frame_rate) if r is not None]
    grid = frame_grid(longest.time, longest.rounding, rates) if rounding else None
    step = 1 / grid.rate if grid else typical_step(longest.time)
    _refuse_impossible_times(longest, step, stated.frame_rate)
    # Of a column without a name, "1 (t)", the unit is said with what it was taken as
    if not longest.has_unit and stated.frame_rate is None and not longest.clock[:1].isdigit():
        notes.assumptions.append("times without a unit taken in s")
    if grid and grid.largest_error > EXACT * step:
        # On the declared rate, if the rounded times do not tell the difference
        wanted = [r for r in rates if abs(r * step - 1) < RATE_TOLERANCE]
        grid = grid.at_usual_rate(longest.time, longest.rounding, wanted) or grid
        own = grid.start + grid.number / grid.rate
        on_grid = [t for s in sheets if (t := own if s is longest else grid.times(s.time, s.rounding)) is not None]
        if len(on_grid) == len(sheets):
            notes.camera_errors["clock_offset"] = rounding
            coarse = ", which is coarse" if rounding > 0.1 * step else ""
            notes.assumptions.append(
                f"times printed to {2 * rounding:.2g} s{coarse}: put back on {grid.rate:.4g} frames a second; an export with "
                "more decimals needs no such step"
            )
            factor = _clock_factor(grid.rate, stated, notes)
            return [t * factor for t in on_grid], 0.0
    times = [_without_repeated_rows(s, notes) for s in sheets]
    error = 0.0
    if not grid and rounding > EXACT * step:
        error = rounding / np.sqrt(3)
        said = f"times printed to {2 * rounding:.2g} s, at no equal steps: that rounding is an error of each time"
        notes.assumptions.append(said)
    factor = _clock_factor(1 / step if step else stated.frame_rate, stated, notes)
    return [t * factor for t in times], error * factor


def _clock_factor(file_rate: float | None, stated: Stated, notes: ReadingNotes) -> float:
    """Return by what the file's times are multiplied to have the camera's rate; ``file_rate`` is that of its rows [Hz]."""
    file_rate = stated.clip_rate or file_rate
    if stated.frame_rate is None or file_rate is None or abs(file_rate / stated.frame_rate - 1) < RATE_TOLERANCE:
        return 1.0
    assumption = "" if stated.clip_rate else ", taking one row as one frame"
    notes.assumptions.append(f"times made for {file_rate:.4g} frames a second were put to {stated.frame_rate:.4g}{assumption}")
    return file_rate / stated.frame_rate


def _refuse_impossible_times(sheet: Sheet, step: float, frame_rate: float | None) -> None:
    """Refuse times that no film in seconds has, and say in which unit they may be."""
    duration = float(sheet.time[-1] - sheet.time[0])
    if frame_rate is None and step > MAX_TIME_STEP:
        found = f"found a row every {step:g} s, needed many a second"
    elif 0 < step * MAX_FRAME_RATE < 1:
        found = f"found {1 / step:.4g} rows a second, needed at most {MAX_FRAME_RATE:g}"
    elif step and duration > MAX_FRAMES * step:
        found = f"found rows every {step:.3g} s in {duration:.3g} s, needed at most {MAX_FRAMES} of one trial"
        raise sheet.error(0, f"{found}; cut the file to the trial's frames")
    else:
        return
    low, high = LIKELY_STEPS
    units = (u for u, (size, _) in OTHER_UNITS.items() if low <= step * size <= high)
    unit = None if sheet.has_unit else next(units, None)
    if unit is None:
        raise sheet.error(0, f"{found}; correct the times or their unit, or export them in seconds")
    words = f"if times are in {OTHER_UNITS[unit][1]}, say so: {{}}"
    raise sheet.error(0, found, WayOut(words=words, keys={"units.time": unit}))


def _without_repeated_rows(sheet: Sheet, notes: ReadingNotes) -> Array:
    """Return the times of a sheet's rows [s], not a number for a row that repeats the one before whole.

    Raises
    ------
    DataError
        If rows at the same time have different values.
    """
    repeated = np.append(False, np.diff(sheet.time) == 0)
    differs = np.zeros(len(repeated), dtype=bool)
    for name, c in sheet.channels.items():
        notes.unused[f"{name}: the row before repeated"] += int(np.sum(repeated & c.has_values))
        differs[1:] |= repeated[1:] & (np.abs(np.diff(c.value)) > 0)
    needed = "times that grow; export them with more decimals, or with the numbers of the frames"
    _refuse_order(sheet, sheet.time, sheet.clock, differs, needed)
    return np.where(repeated, np.nan, sheet.time)
