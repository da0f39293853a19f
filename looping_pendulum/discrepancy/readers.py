"""Files of measured data to `Observations`: Tracker exports, tidy tables, angles, drops and event tables.

Only times and positions are read: velocities and the like in such files are computed from them, so they hold nothing more.
A cell without a mark is missing, never zero. Whatever is not used is counted with its reason.
"""

from __future__ import annotations

import difflib
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from looping_pendulum.discrepancy.delimited import Row, Table, data_error, read_table
from looping_pendulum.discrepancy.events import is_event_table, read_events
from looping_pendulum.discrepancy.observations import UNITS, Channel, DataError, Dropped, Observations
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.units import UnitError, factor

__all__ = ["KINDS", "DataError", "read"]

KINDS = ("auto", "positions", "angle", "drop", "events")
"""What a file may hold; "positions" are Tracker exports and tidy tables alike."""
MASSES = ("light", "heavy")
FARTHEST = {"m": 1000.0, "light": 20.0, "heavy": 20.0, "rad": 4 * np.pi, "rad/s": 1000.0}
"""Beyond this a number is in another unit than was said: [m] for heights, then for looping masses, [rad], [rad/s]."""
LONGEST_STEP = 0.5
"""Median time between rows beyond which times are frames or milliseconds [s]; the slowest real set has 15 rows a second."""
SAME_RATE = 0.01
"""Relative difference of frame rates that is only the rounding of printed times."""
_DEFAULT_UNITS = {"length": "m", "time": "s", "angle": "rad"}
_ROLES = {
    "t": "t", "time": "t", "zeit": "t", "temps": "t", "tiempo": "t", "frame": "frame", "x": "x", "y": "y", "drop": "drop",
    "height": "height", "h": "height", "angle": "angle", "theta": "angle", "rate": "angle_rate", "omega": "angle_rate",
    "angle_rate": "angle_rate", "angular_velocity": "angle_rate", "angular_rate": "angle_rate",
}  # fmt: skip
_TIDY = re.compile(r"(light|heavy|m1|m2)[_ ]?([xy])|([xy])[_ ]?([12])")
_SUFFIX = re.compile(r"(.*?)_(s|ms|m|cm|mm|rad|deg|m_per_s|rad_per_s)")
_KIND_OF_UNIT = {"t": "time", "x": "length", "y": "length", "height": "length", "angle": "angle"}


@dataclass(frozen=True, kw_only=True)
class _Column:
    """What one column holds."""

    index: int
    label: str
    """Name for errors, track included: "x (mass A)"."""
    role: str
    """t, frame, drop, x, y, height, angle, angle_rate; '' for what is not used."""
    track: str
    unit: str
    """As the header writes it; '' if it does not."""


@dataclass(kw_only=True)
class _Notes:
    """What is left out and taken for granted while a file is read."""

    dropped: Counter[str] = field(default_factory=Counter)
    assumptions: list[str] = field(default_factory=list)


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
        True frame rate of the camera [Hz]; the file's own times are then only used to count frames.
    clip_rate
        Frame rate by which the file's times were made [Hz], for slow-motion clips; None: one row is one frame, unless the file
        has a column of frame numbers.
    tracks
        Mass -> name of its track in the file, ``{"light": "mass A"}``.
    kind
        One of `KINDS`.
    units
        Unit of what the header leaves open: ``{"length": "cm", "angle": "deg", "time": "ms"}``.
    drop
        Which of several drops in the file.
    name
        What to call the trial; the file's stem if not given.

    Raises
    ------
    DataError
        In one line: file, row, column, what was found, what was needed, and a way out.
    """
    file = os.fspath(path)
    name = name or Path(path).stem
    if kind not in KINDS:
        raise data_error(file, None, "", f"found kind {quote(kind)}, needed one of {', '.join(KINDS)}")
    table = read_table(path)
    if kind == "events" or (kind == "auto" and is_event_table(table)):
        return read_events(path, table, name)
    notes = _Notes()
    columns = _columns(table, kind, tracks, notes)
    rows = _rows_of_drop(table, columns, drop)
    _refuse_ragged(table, rows, columns)
    units = _DEFAULT_UNITS | dict(units or {})
    channels = _channels(table, rows, columns, tracks, units, notes)
    channels = _retimed(table, rows, columns, channels, frame_rate, clip_rate, notes)
    channels = _checked_rate(channels, notes)
    _refuse_absurd(table, channels)
    return Observations(
        name=name,
        file=file,
        channels=tuple(channels),
        dropped=tuple(Dropped(count=count, reason=reason) for reason, count in notes.dropped.items()),
        assumptions=tuple(dict.fromkeys(notes.assumptions)),
    )


def _columns(table: Table, kind: str, tracks: Mapping[str, str] | None, notes: _Notes) -> list[_Column]:
    """What the columns hold, by the header or by their number."""
    names = next((row for row in reversed(table.head) if _role(row.cells[0])[0] in ("t", "frame", "drop")), None)
    above = [row for row in table.head if row is not names]
    if names is None:
        return _columns_without_names(table, kind, tracks, above, notes)
    # A name stands above the first column of its track; all columns up to the next name are that track's.
    starts = {i: cell for row in above for i, cell in enumerate(row.cells) if cell}
    if len(starts) == 1:
        starts = {0: next(iter(starts.values()))}  # `cm_A` alone in a line stands anywhere above the only track
    columns, track = [], ""
    for index, cell in enumerate(names.cells):
        track = starts.get(index, track)
        role, own, unit = _role(cell)
        if cell:
            owner = own or track
            label = f"{cell} ({owner})" if owner and not own else cell
            columns.append(_Column(index=index, label=label, role=role, track=owner, unit=unit))
    if not any(c.role == "t" for c in columns) and not any(c.role == "frame" for c in columns):
        raise table.error(
            names.line, "", f"found no column of times among {quote(', '.join(filter(None, names.cells)))}, needed 't'"
        )
    return _known_roles(table, names, columns)


def _known_roles(table: Table, names: Row, columns: list[_Column]) -> list[_Column]:
    """Refuse a header from which nothing could be used."""
    if any(c.role in ("x", "y", "height", "angle") for c in columns):
        return columns
    near = [
        (c, difflib.get_close_matches(c.label.lower(), ["x", "y", "light_x", "heavy_y", "angle", "height"], 1)) for c in columns
    ]
    hint = next((f"; did you mean '{m[0]}' by '{c.label}'?" for c, m in near if m), "; rename the columns so")
    found = quote(", ".join(c.label for c in columns))
    raise table.error(
        names.line, "", f"found columns {found}, needed positions (x, y), an angle or a height beside the time{hint}"
    )


def _role(cell: str) -> tuple[str, str, str]:
    """Role, mass and unit of a column's name: "light_x [cm]" -> ("x", "light", "cm")."""
    text, unit = cell.strip(), ""
    bracket = re.fullmatch(r"(.*?)\s*[\[(]([^\])]*)[\])]", text)
    if bracket:
        text, unit = bracket[1], bracket[2].strip()
    text = text.lower()
    suffix = _SUFFIX.fullmatch(text)
    if suffix and not unit and not _TIDY.fullmatch(text):
        text, unit = suffix[1], suffix[2].replace("_per_", "/")
    tidy = _TIDY.fullmatch(text)
    if tidy:
        mass, axis = (tidy[1], tidy[2]) if tidy[1] else (tidy[4], tidy[3])
        return axis, {"m1": "light", "1": "light", "m2": "heavy", "2": "heavy"}.get(mass, mass), unit
    return _ROLES.get(text, ""), "", unit


def _columns_without_names(
    table: Table, kind: str, tracks: Mapping[str, str] | None, above: Sequence[Row], notes: _Notes
) -> list[_Column]:
    """Columns of a file that does not name them: t,x,y for each track, or t,angle[,rate]."""
    width = max(len([c for c in row.cells if c]) for row in table.rows)
    titles = [cell for row in above for cell in row.cells if cell]
    if kind == "drop":
        raise table.error(table.rows[0].line, "", "found no names of columns, needed 'time' and 'height'; write them above")
    is_angle = kind == "angle" or (kind == "auto" and not tracks and not titles and table.delimiter == " " and width in (2, 3))
    if is_angle:
        roles = [("t", ""), ("angle", ""), ("angle_rate", "")][:width]
        notes.assumptions.append("columns without names: taken as t [s], angle [rad]" + (", rate [rad/s]" if width > 2 else ""))
    elif width in (3, 5) and (width == 3 or (tracks and len(tracks) == 2) or len(titles) == 2):
        names = titles if len(titles) == width // 2 else list((tracks or {}).values())
        names = names if len(names) == width // 2 else [Path(table.file).stem]
        roles = [("t", "")] + [(axis, track) for track in names for axis in "xy"]
        notes.assumptions.append("columns without names: taken as t, x, y" + (", x, y" if width == 5 else ""))
    else:
        found = f"found {width} columns without names"
        raise table.error(table.rows[0].line, "", f"{found}, needed a line of names above such as 't,light_x,light_y'; add it")
    return [
        _Column(index=i, label=f"{i + 1} ({role}{' of ' + track if track else ''})", role=role, track=track, unit="")
        for i, (role, track) in enumerate(roles)
    ]


def _rows_of_drop(table: Table, columns: list[_Column], drop: int | None) -> list[Row]:
    """Rows of the chosen drop; all where the file has no such column."""
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


def _refuse_ragged(table: Table, rows: list[Row], columns: list[_Column]) -> None:
    """Refuse rows of another width than the header's; blank cells at the end are Tracker's trailing delimiter."""
    width = columns[-1].index + 1
    for row in rows:
        filled = max((i + 1 for i, cell in enumerate(row.cells) if cell), default=0)
        # Editors trim the tabs at the end of a line, so there a short row only misses its last marks.
        short = len(row.cells) < width and table.delimiter != "\t"
        if filled > width or short:
            comma = table.delimiter == "," and filled > width
            hint = "if these are decimal commas, export with semicolons" if comma else "complete or delete the row"
            raise table.error(row.line, "", f"found {len(row.cells)} cells, needed {width}; {hint}")


def _channels(
    table: Table,
    rows: list[Row],
    columns: list[_Column],
    tracks: Mapping[str, str] | None,
    units: Mapping[str, str],
    notes: _Notes,
) -> list[tuple[Channel, list[Row]]]:
    """Channels by the file's clock, each with the rows that its points stand in."""
    masses = _masses(table, columns, tracks)
    clocks = [c for c in columns if c.role == "t"] or [c for c in columns if c.role == "frame"]
    found: dict[str, tuple[Channel, list[Row]]] = {}
    for column in columns:
        role = column.role
        if role in ("t", "frame", "drop"):
            continue
        channel = f"{masses.get(column.track, '')}_{role}" if role in ("x", "y") else role
        if channel not in UNITS:
            reason = f"column {column.label!r}: " + ("track not asked for" if role else "not a time or a position")
            notes.dropped[reason] += sum(bool(row.cells[column.index]) for row in rows if column.index < len(row.cells))
            continue
        if channel in found:
            message = f"found {channel} a second time, needed one column for it; say by 'tracks' which is meant"
            raise table.error(None, column.label, message)
        clock = next((c for c in reversed(clocks) if c.index < column.index), clocks[0])
        found[channel] = _channel(table, rows, clock, column, channel, units, notes)
    return list(found.values())


def _masses(table: Table, columns: list[_Column], tracks: Mapping[str, str] | None) -> dict[str, str]:
    """Track -> mass, as asked for or by the track's own name."""
    have = list(dict.fromkeys(c.track for c in columns if c.role in ("x", "y")))
    shown = ", ".join(f"'{t}'" if t else "one without a name" for t in have)
    if tracks:
        unknown = [m for m in tracks if m not in MASSES]
        if unknown:
            raise table.error(None, "", f"tracks: found {quote(unknown[0])}, needed 'light' or 'heavy'")
        lost = [t for t in tracks.values() if t not in have]
        if lost and len(tracks) == len(have) == 1:
            return {have[0]: next(iter(tracks))}  # the only track is meant, whatever it is called
        if lost:
            raise table.error(None, "", f"found the tracks {shown}, needed {quote(lost[0])}; correct 'tracks'")
        return {track: mass for mass, track in tracks.items()}
    known = {t: m for t in have for m in MASSES if t.lower() == m or re.search(rf"\b{m}\b", t.lower().replace("_", " "))}
    if have and not known:
        way_out = f"'tracks: {{light: {have[0] or Path(table.file).stem}}}'"
        raise table.error(None, "", f"found the tracks {shown}, needed to know which mass each is; say so by {way_out}")
    return known


def _channel(
    table: Table, rows: list[Row], clock: _Column, column: _Column, channel: str, units: Mapping[str, str], notes: _Notes
) -> tuple[Channel, list[Row]]:
    time_factor = 1.0 if clock.role == "frame" else _to_si(table, clock, "s", units)
    value_factor = _to_si(table, column, UNITS[channel], units)
    times: list[float] = []
    values: list[float] = []
    kept: list[Row] = []
    for row in rows:
        value, time = table.number(row, column.index, column.label), table.number(row, clock.index, clock.label)
        if value is None:
            notes.dropped[f"{channel}: no mark in the cell"] += 1
            continue
        if time is None:
            notes.dropped[f"{channel}: a mark without a time"] += 1
            continue
        if times and time <= times[-1]:
            if time == times[-1] and value == values[-1]:
                notes.dropped[f"{channel}: the row before repeated"] += 1
                continue
            message = f"found {time:g} after {times[-1]:g} (line {kept[-1].line}), needed times that grow; sort or delete rows"
            raise table.error(row.line, clock.label, message)
        times.append(time)
        values.append(value)
        kept.append(row)
    if not times:
        raise table.error(None, column.label, f"found no marks at all, needed {channel}; export that track again")
    if not column.unit and _KIND_OF_UNIT.get(column.role) == "length":
        notes.assumptions.append(f"lengths without a unit taken in {units['length']}")
    t, v = np.array(times) * time_factor, np.array(values) * value_factor
    return Channel(name=channel, t=t, value=v, column=column.label), kept


def _to_si(table: Table, column: _Column, si: str, units: Mapping[str, str]) -> float:
    """Factor from the column's unit to SI."""
    written = column.unit or units.get(_KIND_OF_UNIT.get(column.role, ""), si)
    try:
        return float(factor(written.replace("**", "^"), si))
    except UnitError as error:
        line = table.head[-1].line if table.head and column.unit else None
        detail = f" ({error})" if str(error) else ""
        message = f"found the unit {quote(written)}{detail}, needed one that converts to {si}; write for example '[{si}]'"
        raise table.error(line, column.label, message) from None


def _retimed(
    table: Table,
    rows: list[Row],
    columns: list[_Column],
    channels: list[tuple[Channel, list[Row]]],
    frame_rate: float | None,
    clip_rate: float | None,
    notes: _Notes,
) -> list[Channel]:
    """Put the true frame rate in place of the one by which the file's times were made."""
    frames = next((c for c in columns if c.role == "frame"), None)
    if frame_rate is None:
        if not any(c.role == "t" for c in columns):
            raise table.error(None, "", "found frame numbers but no times, needed the camera's frame rate; give 'frame_rate'")
        return [channel for channel, _ in channels]
    if frames is not None:
        counts = [table.number(row, frames.index, frames.label) for row in rows]
        first = min((c for c in counts if c is not None), default=0.0)
        return [_by_frame(table, frames, channel, kept, first, frame_rate) for channel, kept in channels]
    steps = np.diff(np.unique(np.concatenate([channel.t for channel, _ in channels])))
    own = clip_rate or (1 / float(np.median(steps)) if steps.size else frame_rate)
    if abs(own / frame_rate - 1) < SAME_RATE:
        return [channel for channel, _ in channels]
    known = "" if clip_rate else ", taking one row as one frame"
    notes.assumptions.append(f"times made for {own:.4g} frames a second were put to {frame_rate:.4g}{known}")
    return [Channel(name=c.name, t=c.t * own / frame_rate, value=c.value, column=c.column) for c, _ in channels]


def _by_frame(table: Table, frames: _Column, channel: Channel, kept: list[Row], first: float, frame_rate: float) -> Channel:
    counts: list[float] = []
    for row in kept:
        count = table.number(row, frames.index, frames.label)
        if count is None or (counts and count <= counts[-1]):
            found = "nothing" if count is None else f"{count:g} after {counts[-1]:g}"
            raise table.error(row.line, frames.label, f"found {found}, needed frame numbers that grow; export them again")
        counts.append(count)
    t = (np.array(counts) - first) / frame_rate
    return Channel(name=channel.name, t=t, value=channel.value, column=channel.column)


def _checked_rate(channels: list[Channel], notes: _Notes) -> list[Channel]:
    """Leave out an angular rate that is not the rate of the angle beside it."""
    named = {c.name: c for c in channels}
    if "angle_rate" not in named or "angle" not in named or len(named["angle"]) < 5:
        return channels
    angle, rate = named["angle"], named["angle_rate"]
    slope: Array = np.interp(rate.t, angle.t, np.gradient(angle.value, angle.t))
    size = float(slope @ slope)
    ratio = float(slope @ rate.value) / size if size else 0.0
    alike = abs(float(slope @ rate.value)) / (np.sqrt(size * float(rate.value @ rate.value)) or 1.0)
    if alike > 0.9 and 0.8 < ratio < 1.25:
        return channels
    reason = f"column {rate.column!r}: not the rate of the angle (best multiple {ratio:.2g}, correlation {alike:.2f})"
    notes.dropped[reason] += len(rate)
    return [c for c in channels if c is not rate]


def _refuse_absurd(table: Table, channels: list[Channel]) -> None:
    """Refuse numbers that must be in another unit."""
    for channel in channels:
        limit = FARTHEST.get(channel.name.partition("_")[0], FARTHEST[channel.unit])
        worst = int(np.argmax(np.abs(channel.value)))
        if abs(channel.value[worst]) > limit:
            found = f"found {channel.value[worst]:g} {channel.unit} at t = {channel.t[worst]:g} s"
            kind, unit = ("angle", "deg") if channel.unit.startswith("rad") else ("length", "cm")
            message = (
                f"{found}, needed at most {limit:.4g}; if the file is in another unit, say so: 'units: {{{kind}: {unit}}}'"
            )
            raise table.error(None, channel.column, message)
        step = float(np.median(np.diff(channel.t))) if len(channel) > 1 else 0.0
        if step > LONGEST_STEP:
            message = f"found a row every {step:g} s, needed many a second; if times are in ms, say so: 'units: {{time: ms}}'"
            raise table.error(None, "t", message)
