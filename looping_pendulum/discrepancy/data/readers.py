"""Read files of measured data into `Observations`: Tracker exports, tidy tables, angles, drops and event tables.

Only times and positions are read: velocities and accelerations in such files are computed from them, so they tell nothing more.
An empty cell is a missing point, never zero. Values that are not used are counted with the reason.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from looping_pendulum.discrepancy.data.columns import Column, ReadingNotes, read_columns
from looping_pendulum.discrepancy.data.delimited import DelimitedTable, TableLine, data_error, read_table
from looping_pendulum.discrepancy.data.events import is_event_table, read_events
from looping_pendulum.discrepancy.data.observations import (
    UNITS,
    Channel,
    DataError,
    ImplausibleLengthError,
    Observations,
    UnusedValues,
)
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.units import UnitError, to_si

__all__ = ["KINDS", "DataError", "read"]

KINDS = ("auto", "positions", "angle", "drop", "events")
"""Kinds of files; "positions" stands for Tracker exports and tidy tables alike, "auto" tells the kind by the header."""
MASSES = ("light", "heavy")
MAX_VALUE = {"m": 1000.0, "light": 20.0, "heavy": 20.0, "rad": 4 * np.pi, "rad/s": 1000.0}
"""Largest plausible heights [m], positions of the light and heavy mass [m], angles [rad] and angular rates [rad/s].

A larger value must be in another unit than the file or the study says.
"""
MAX_TIME_STEP = 0.5
"""Largest plausible median time between rows [s]; beyond it, times must be frames or milliseconds.

The slowest real data set has 15 rows a second.
"""
RATE_TOLERANCE = 0.01
"""Relative difference of two frame rates that rounding of printed times can explain."""
_DEFAULT_UNITS = {"length": "m", "time": "s", "angle": "rad"}
_KIND_OF_UNIT = {"t": "time", "x": "length", "y": "length", "height": "length", "angle": "angle"}


def read(
    path: str | Path,
    *,
    frame_rate: float | None = None,
    clip_rate: float | None = None,
    tracks: Mapping[str, str] | None = None,
    kind: str = "auto",
    units: Mapping[str, str] | None = None,
    drop: int | None = None,
    name: str | None = None,
) -> Observations:
    """Read one file of measured data.

    Parameters
    ----------
    frame_rate
        True frame rate of the camera [Hz]. If it is given, the file's own times are only used to count frames.
    clip_rate
        Frame rate that the file's times were computed with [Hz], for slow-motion clips. None: one row is one frame, unless the
        file has a column of frame numbers.
    tracks
        Mass -> name of its track in the file, for example ``{"light": "mass A"}``. An empty name stands for the only track.
    kind
        One of `KINDS`.
    units
        Units of columns whose header names none, for example ``{"length": "cm", "angle": "deg", "time": "ms"}``; a length of
        ``"1.4 mm"`` is that of a pixel.
    drop
        Number of the drop to read, if the file has several.
    name
        Name of the trial; by default that of the file without its ending.

    Raises
    ------
    DataError
        If the file cannot be used; the message has one line with file, line, column, what was found and needed, and a way out.
    """
    file = os.fspath(path)
    name = name or Path(path).stem
    if kind not in KINDS:
        raise data_error(file, None, "", f"found kind {quote(kind)}, needed one of {', '.join(KINDS)}")
    for key, rate in (("frame_rate", frame_rate), ("clip_rate", clip_rate)):
        if rate is not None and not (np.isfinite(rate) and rate > 0):
            raise data_error(file, None, "", f"{key}: found {rate:g} Hz, needed a number above 0")
    table = read_table(path, text_column="quantity")
    if kind == "events" or (kind == "auto" and is_event_table(table)):
        return read_events(path, table, name)
    notes = ReadingNotes()
    columns = read_columns(table, kind, tracks, notes)
    _refuse_incomplete_rows(table, columns)
    rows = _rows_of_one_drop(table, columns, drop)
    units = _DEFAULT_UNITS | dict(units or {})
    channels_with_rows = _read_channels(table, rows, columns, tracks, units, notes)
    if not channels_with_rows:
        raise table.error(
            None, "", "found no positions, angles or heights, needed one column of them; check 'tracks' and 'kind'"
        )
    # Before the frame rate is corrected, so that messages have the values of the file
    _refuse_implausible_values(
        table, channels_with_rows, check_times=any(c.role == "t" for c in columns) and frame_rate is None
    )
    timed = _with_true_frame_rate(table, columns, channels_with_rows, frame_rate, clip_rate, notes)
    channels = _without_inconsistent_rate(timed, notes)
    return Observations(
        name=name,
        file=file,
        channels=tuple(channels),
        unused=tuple(UnusedValues(count=count, reason=reason) for reason, count in notes.unused.items()),
        assumptions=tuple(dict.fromkeys(notes.assumptions)),
    )


def _rows_of_one_drop(table: DelimitedTable, columns: list[Column], drop: int | None) -> list[TableLine]:
    """Return the rows of the chosen drop; all rows if the file has no column of drops."""
    column = next((c for c in columns if c.role == "drop"), None)
    if column is None:
        if drop is not None:
            raise table.error(None, "", f"found no column 'drop', so drop {drop} cannot be chosen; leave 'drop' out")
        return list(table.rows)
    numbers = [table.number(row, column.index, column.label) for row in table.rows]
    have = sorted({n for n in numbers if n is not None})
    shown = ", ".join(f"{n:g}" for n in have)
    if drop is None and len(have) > 1:
        raise table.error(None, column.label, f"found drops {shown}, needed one trial; choose by 'drop: {have[0]:g}'")
    wanted = have[0] if drop is None else drop
    if wanted not in have:
        raise table.error(None, column.label, f"found drops {shown}, needed drop {wanted:g}; choose one that is there")
    return [row for row, number in zip(table.rows, numbers, strict=True) if number == wanted]


def _refuse_incomplete_rows(table: DelimitedTable, columns: list[Column]) -> None:
    """Refuse rows with more or fewer cells than the header; empty cells at the end are Tracker's trailing delimiter."""
    width = columns[-1].index + 1
    for row in table.rows:
        filled = max((i + 1 for i, cell in enumerate(row.cells) if cell), default=0)
        # Editors trim tabs at the end of a line, so that a short row there only lacks its last points.
        short = len(row.cells) < width and table.delimiter != "\t"
        if filled > width or short:
            too_many = table.delimiter == "," and filled > width
            hint = "if these are decimal commas, export with semicolons" if too_many else "complete or delete the row"
            raise table.error(row.line, "", f"found {len(row.cells)} cells, needed {width}; {hint}")


def _read_channels(
    table: DelimitedTable,
    rows: list[TableLine],
    columns: list[Column],
    tracks: Mapping[str, str] | None,
    units: Mapping[str, str],
    notes: ReadingNotes,
) -> list[tuple[Channel, list[TableLine]]]:
    """Read the channels, timed by the file's clock, each with the rows of its points."""
    masses = _mass_of_track(table, columns, tracks)
    clocks = [c for c in columns if c.role == "t"] or [c for c in columns if c.role == "frame"]
    channels: dict[str, tuple[Channel, list[TableLine]]] = {}
    for column in columns:
        role = column.role
        if role in ("t", "frame", "drop"):
            continue
        channel = f"{masses.get(column.track, '')}_{role}" if role in ("x", "y") else role
        if channel not in UNITS:
            reason = f"column {column.label!r}: " + ("track not asked for" if role else "not a time or a position")
            notes.unused[reason] += sum(bool(row.cells[column.index]) for row in rows if column.index < len(row.cells))
            continue
        if channel in channels:
            message = f"found {channel} a second time, needed one column for it; say by 'tracks' which is meant"
            raise table.error(None, column.label, message)
        # Tracker repeats the column of times for each track; the one that belongs to a column stands left of it
        clock = next((c for c in reversed(clocks) if c.index < column.index), clocks[0])
        channels[channel] = _read_channel(table, rows, clock, column, channel, units, notes)
    return list(channels.values())


def _mass_of_track(table: DelimitedTable, columns: list[Column], tracks: Mapping[str, str] | None) -> dict[str, str]:
    """Return the mass of each track, as asked for or by the track's own name."""
    have = list(dict.fromkeys(c.track for c in columns if c.role in ("x", "y")))
    shown = ", ".join(f"'{t}'" if t else "one without a name" for t in have)
    if tracks:
        unknown = [m for m in tracks if m not in MASSES]
        if unknown:
            raise table.error(None, "", f"tracks: found {quote(unknown[0])}, needed 'light' or 'heavy'")
        if len(set(tracks.values())) < len(tracks):
            raise table.error(
                None, "", f"tracks: found {quote(next(iter(tracks.values())))} for both masses, needed one for each"
            )
        missing = [t for t in tracks.values() if t not in have]
        if len(have) == 1 and (have == [""] or list(tracks.values()) == [""]) and len(tracks) == 1:
            return {have[0]: next(iter(tracks))}
        if missing:
            raise table.error(None, "", f"found the tracks {shown}, needed {quote(missing[0])}; correct 'tracks'")
        return {track: mass for mass, track in tracks.items()}
    known = {t: m for t in have if (m := mass_in_name(t))}
    if have and not known:
        way_out = f"'tracks: {{light: {have[0] or Path(table.file).stem}}}'"
        raise table.error(None, "", f"found the tracks {shown}, needed to know which mass each is; say so by {way_out}")
    return known


def mass_in_name(track: str) -> str:
    """Return the mass that the name of a track says, such as "light ball" or "mass_heavy"; '' if it says none, or both."""
    words = track.lower().replace("_", " ")
    said = [mass for mass in MASSES if re.search(rf"\b{mass}\b", words)]
    return said[0] if len(said) == 1 else ""


def _read_channel(
    table: DelimitedTable,
    rows: list[TableLine],
    clock: Column,
    column: Column,
    channel: str,
    units: Mapping[str, str],
    notes: ReadingNotes,
) -> tuple[Channel, list[TableLine]]:
    """Read one channel in SI units, and return it with the rows of its points."""
    time_factor = 1.0 if clock.role == "frame" else _to_si(table, clock, "s", units)
    value_factor = _to_si(table, column, UNITS[channel], units)
    times: list[float] = []
    values: list[float] = []
    kept: list[TableLine] = []
    for row in rows:
        value, time = table.number(row, column.index, column.label), table.number(row, clock.index, clock.label)
        if value is None:
            notes.unused[f"{channel}: empty cell"] += 1
            continue
        if time is None:
            notes.unused[f"{channel}: a value without a time"] += 1
            continue
        if times and time <= times[-1]:
            # A row that is repeated whole says nothing else; two values at one time contradict each other
            if time == times[-1] and value == values[-1]:
                notes.unused[f"{channel}: the row before repeated"] += 1
                continue
            message = f"found {time:g} after {times[-1]:g} (line {kept[-1].line}), needed times that grow; sort or delete rows"
            raise table.error(row.line, clock.label, message)
        times.append(time)
        values.append(value)
        kept.append(row)
    if not times:
        raise table.error(None, column.label, f"found no values at all, needed {channel}; export that track again")
    if not column.unit and _KIND_OF_UNIT.get(column.role) == "length":
        notes.assumptions.append(f"lengths without a unit taken in {units['length']}")
    t, v = np.array(times) * time_factor, np.array(values) * value_factor
    return Channel(name=channel, t=t, value=v, column=column.label), kept


def _to_si(table: DelimitedTable, column: Column, si: str, units: Mapping[str, str]) -> float:
    """Return the factor from the column's unit to SI."""
    unit_text = column.unit or units.get(_KIND_OF_UNIT.get(column.role, ""), si)
    try:
        # A unit may have a size of its own: "1.4 mm" for the pixels of a picture
        return to_si(unit_text if unit_text[:1].isdigit() else f"1 {unit_text}", si)
    except UnitError as error:
        line = table.head[-1].line if table.head and column.unit else None
        detail = f" ({error})" if str(error) else ""
        message = f"found the unit {quote(unit_text)}{detail}, needed one that converts to {si}; write for example '[{si}]'"
        raise table.error(line, column.label, message) from None


def _with_true_frame_rate(
    table: DelimitedTable,
    columns: list[Column],
    channels_with_rows: list[tuple[Channel, list[TableLine]]],
    frame_rate: float | None,
    clip_rate: float | None,
    notes: ReadingNotes,
) -> list[Channel]:
    """Replace the frame rate that the file's times were computed with by the true one."""
    frames = [c for c in columns if c.role == "frame"]
    if frame_rate is None:
        if not any(c.role == "t" for c in columns):
            raise table.error(None, "", "found frame numbers but no times, needed the camera's frame rate; give 'frame_rate'")
        return [channel for channel, _ in channels_with_rows]
    if frames:
        return _with_times_from_frames(table, frames, columns, channels_with_rows, frame_rate)
    steps = np.diff(np.unique(np.concatenate([channel.t for channel, _ in channels_with_rows])))
    file_rate = clip_rate or (1 / float(np.median(steps)) if steps.size else frame_rate)
    if abs(file_rate / frame_rate - 1) < RATE_TOLERANCE:
        return [channel for channel, _ in channels_with_rows]
    assumption = "" if clip_rate else ", taking one row as one frame"
    notes.assumptions.append(f"times made for {file_rate:.4g} frames a second were put to {frame_rate:.4g}{assumption}")
    return [replace(c, t=c.t * file_rate / frame_rate) for c, _ in channels_with_rows]


def _with_times_from_frames(
    table: DelimitedTable,
    frames: list[Column],
    columns: list[Column],
    channels_with_rows: list[tuple[Channel, list[TableLine]]],
    frame_rate: float,
) -> list[Channel]:
    """Compute times from frame numbers; all tracks count from the first frame in which any of them has a point."""
    tracks = {c.label: c.track for c in columns}
    frame_numbers = []
    for channel, kept in channels_with_rows:
        frame_column = next((f for f in frames if f.track == tracks[channel.column]), frames[0])
        counts: list[float] = []
        for row in kept:
            count = table.number(row, frame_column.index, frame_column.label)
            if count is None or (counts and count <= counts[-1]):
                text = "nothing" if count is None else f"{count:g} after {counts[-1]:g}"
                message = f"found {text}, needed frame numbers that grow; export them again"
                raise table.error(row.line, frame_column.label, message)
            counts.append(count)
        frame_numbers.append(np.array(counts))
    first = min(float(n[0]) for n in frame_numbers)
    return [replace(c, t=(n - first) / frame_rate) for (c, _), n in zip(channels_with_rows, frame_numbers, strict=True)]


def _without_inconsistent_rate(channels: list[Channel], notes: ReadingNotes) -> list[Channel]:
    """Leave out an angular rate that is not the rate of the angle beside it."""
    named = {c.name: c for c in channels}
    if "angle_rate" not in named or "angle" not in named or len(named["angle"]) < 5:
        return channels
    angle, rate = named["angle"], named["angle_rate"]
    slope: Array = np.interp(rate.t, angle.t, np.gradient(angle.value, angle.t))
    size = float(slope @ slope)
    ratio = float(slope @ rate.value) / size if size else 0.0
    correlation = abs(float(slope @ rate.value)) / (np.sqrt(size * float(rate.value @ rate.value)) or 1.0)
    if correlation > 0.9 and 0.8 < ratio < 1.25:
        return channels
    reason = f"column {rate.column!r}: not the rate of the angle (best multiple {ratio:.2g}, correlation {correlation:.2f})"
    notes.unused[reason] += len(rate)
    return [c for c in channels if c is not rate]


def _refuse_implausible_values(
    table: DelimitedTable, channels_with_rows: list[tuple[Channel, list[TableLine]]], *, check_times: bool
) -> None:
    """Refuse values and times that must be in another unit than was said."""
    for channel, rows in channels_with_rows:
        limit = MAX_VALUE.get(channel.name.partition("_")[0], MAX_VALUE[channel.unit])
        worst = int(np.argmax(np.abs(channel.value)))
        if abs(channel.value[worst]) > limit:
            kind, unit = ("angle", "deg") if channel.unit.startswith("rad") else ("length", "cm")
            values = f"found {channel.value[worst]:g} {channel.unit}, needed at most {limit:.4g}"
            message = f"{values}; if the file is in another unit, say so: 'units: {{{kind}: {unit}}}'"
            error = table.error(rows[worst].line, channel.column, message)
            raise ImplausibleLengthError(str(error)) if kind == "length" else error
        if check_times and channel.time_step > MAX_TIME_STEP:
            steps = f"found a row every {channel.time_step:g} s, needed many a second"
            message = f"{steps}; if times are in ms, say so: 'units: {{time: ms}}'"
            raise table.error(rows[0].line, "t", message)
