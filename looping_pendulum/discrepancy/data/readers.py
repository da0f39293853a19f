"""Read files of measured data into `Observations`: tables of tracked points, angles, drops or events, and Tracker's projects.

Only times and positions are read: velocities and accelerations in such files are computed from them, so they tell nothing more.
An empty cell is a missing point, never zero. Values that are not used are counted with the reason.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from looping_pendulum.discrepancy.data import step_durations
from looping_pendulum.discrepancy.data.clock import Series, Sheet, timed_channels
from looping_pendulum.discrepancy.data.columns import PIXELS, POSITION_ROLES, Column, read_columns
from looping_pendulum.discrepancy.data.delimited import (
    LARGEST_FILE,
    DelimitedText,
    data_error,
    last_digits,
    read_bytes,
    read_text,
)
from looping_pendulum.discrepancy.data.events import is_event_table, read_events
from looping_pendulum.discrepancy.data.noise import scatter
from looping_pendulum.discrepancy.data.observations import (
    UNITS,
    Channel,
    DataError,
    ImplausibleLengthError,
    Observations,
    ReadingNotes,
    UnusedValues,
)
from looping_pendulum.discrepancy.data.tracker_project import LARGEST_ARCHIVE, is_named_project, is_project, read_project
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.units import UnitError, to_si

__all__ = ["KINDS", "DataError", "read"]

KINDS = ("auto", "positions", "angle", "drop", "events")
"""Kinds of files; "positions" stands for tracked points of every form, "auto" tells the kind by the names of the columns."""
MASSES = ("light", "heavy")
MAX_VALUE = {"m": 1000.0, "light": 20.0, "heavy": 20.0, "rad": 4 * np.pi, "rad/s": 1000.0}
"""Largest plausible heights [m], positions of the light and heavy mass [m], angles [rad] and angular rates [rad/s].

A larger value must be in another unit than the file or the study says.
"""
MAX_START_ACCELERATION = {"m": 9.81, "rad": 98.1}
"""Twice the largest acceleration of a mass after its release [m/s^2], and of a pendulum of 20 cm [rad/s^2].

A record whose masses are faster in its first two steps begins later.
"""
MAX_START_SIGMAS = 4.0
"""The same by noise, in its standard deviations."""
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
    run: str | None = None,
    name: str | None = None,
    starts_at_release: bool = True,
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
    run
        Number of the run or drop to read, if the file has several.
    name
        Name of the trial; by default that of the file without its ending.
    starts_at_release
        Whether a record whose clock begins elsewhere and whose masses are at rest at first begins at time 0.

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
    notes = ReadingNotes()
    raw = read_content(path, file)
    if is_named_project(file) or is_project(raw):
        sheets = _project_sheets(raw, file, tracks, units or {}, notes)
    else:
        text = read_text(raw, file)
        if kind == "events" or (kind == "auto" and is_event_table(text)):
            return read_events(text, name)
        columns = _of_one_run(text, read_columns(text, kind, list((tracks or {}).values()), notes), run, notes)
        sheets = _sheets(text, columns, tracks, _DEFAULT_UNITS | dict(units or {}), notes)
    for sheet in sheets:
        _refuse_implausible_values(file, sheet)

    def refuse(line: int | None, column: str, message: str) -> DataError:
        return data_error(file, line, column, message)

    channels = timed_channels(sheets, frame_rate, clip_rate, refuse, notes)
    if starts_at_release:
        channels = _from_release(channels, notes)
    channels = step_durations.without_copies(_without_inconsistent_rate(channels, notes), notes)
    return Observations(
        name=name,
        file=file,
        channels=tuple(channels),
        unused=tuple(UnusedValues(count=count, reason=reason) for reason, count in notes.unused.items() if count),
        assumptions=tuple(dict.fromkeys(notes.assumptions)),
        faults=tuple(step_durations.clock_faults(channels)),
    )


def read_content(path: str | Path, file: str) -> bytes:
    """Return the content of a file; a project of Tracker may be large, as it may hold the film."""
    return read_bytes(path, file, LARGEST_ARCHIVE if is_named_project(file) else LARGEST_FILE)


def _of_one_run(text: DelimitedText, columns: list[Column], run: str | None, notes: ReadingNotes) -> list[Column]:
    """Return the columns of the chosen run, and those of no run, that are times or positions."""
    runs = list(dict.fromkeys(c.run for c in columns if c.role in POSITION_ROLES))
    shown = ", ".join(runs)
    if run is None and len(runs) > 1:
        raise text.error(None, "", f"found the runs {shown}, needed one trial; choose by 'run: {runs[0]}'")
    if run is not None and run not in runs:
        found = f"found the runs {shown}" if any(runs) else "found a single run without a number"
        raise text.error(
            None, "", f"{found}, needed run {quote(run)}; {'choose one that is there' if any(runs) else 'leave it out'}"
        )
    columns = [c for c in columns if run is None or c.run in (run, "")]
    rest = [c for c in columns if not c.role]
    names = list(dict.fromkeys(f"{c.label!r}" for c in rest))
    if names:
        what = "not a time or a position" if len(names) == 1 else "not times or positions"
        reason = f"column{'s' if len(names) > 1 else ''} {', '.join(names)}: {what}"
        notes.unused[reason] += sum(bool(row.cell(c.index)) for c in rest for row in c.rows)
    return [c for c in columns if c.role]


def _sheets(
    text: DelimitedText,
    columns: list[Column],
    tracks: Mapping[str, str] | None,
    units: Mapping[str, str],
    notes: ReadingNotes,
) -> list[Sheet]:
    """Return the channels of a table, by the columns of times or frames that belong to them."""
    masses = _mass_of_track(text.file, tracks_of(text, columns), tracks)
    rates = [c for c in columns if c.role == "angle_rate"]
    clocks = [c for c in columns if c.role == "t"] or [c for c in columns if c.role == "frame"]
    frames = [c for c in columns if c.role == "frame"]
    timed: dict[tuple[int, int], tuple[Column, Column | None, dict[str, Series]]] = {}
    left_out: dict[str, int] = {}
    for column in (c for c in columns if c.role in POSITION_ROLES and c not in rates[1:]):
        channel = f"{masses.get(column.track, '')}_{column.role}" if column.role in ("x", "y") else column.role
        if channel not in UNITS:
            left_out[column.label] = sum(bool(row.cell(column.index)) for row in column.rows)
            continue
        if any(channel in channels for *_, channels in timed.values()):
            message = f"found {channel} a second time, needed one column for it; say by 'tracks' which is meant"
            raise text.error(None, column.label, message)
        # Tracker repeats the column of times for each track; the one that belongs to a column stands left of it
        own = [c for c in clocks if c.rows is column.rows]
        clock = next((c for c in reversed(own) if c.index < column.index), own[0])
        own_frames = [f for f in frames if f.rows is column.rows]
        frame = next((f for f in own_frames if f.track == column.track), own_frames[0] if own_frames else None)
        parts = [_series(text, c, channel, units, notes) for c in (rates if column in rates else [column])]
        timed.setdefault((id(clock), id(frame)), (clock, frame, {}))[2][channel] = (
            _about_one_axis(parts, notes) if len(parts) > 1 else parts[0]
        )
    if left_out:
        names = ", ".join(f"{label!r}" for label in left_out)
        notes.unused[f"column{'s' if len(left_out) > 1 else ''} {names}: track not asked for"] += sum(left_out.values())
    if not timed:
        raise text.error(
            None, "", "found no positions, angles or heights, needed one column of them; check 'tracks' and 'kind'"
        )
    sheets = []
    for clock, frame, channels in timed.values():
        time, rounding = (None, np.zeros(len(clock.rows))) if clock.role == "frame" else numbers(text, clock)
        factor = _to_si(text, clock, "s", units) if time is not None else 1.0
        number = None if frame is None else numbers(text, frame)[0]
        if frame is not None and number is not None and np.any(np.nan_to_num(number) % 1):
            line = clock.rows[int(np.argmax(np.nan_to_num(number) % 1 > 0))].line
            raise text.error(
                line, frame.label, "found no whole number, needed a frame's; if these are times, name the column 't'"
            )
        sheets.append(
            Sheet(
                clock=clock.label,
                lines=np.array([row.line for row in clock.rows]),
                time=None if time is None else time * factor,
                rounding=0.5 * rounding * factor,
                frame=number,
                channels=channels,
            )
        )
        for channel, series in channels.items():
            has_time = np.isfinite(time) if time is not None else np.ones(len(clock.rows), dtype=bool)
            notes.unused[f"{channel}: empty cell"] += int(np.sum(~np.isfinite(series.value) & has_time))
            notes.unused[f"{channel}: a value without a time"] += int(np.sum(np.isfinite(series.value) & ~has_time))
    return sheets


def numbers(text: DelimitedText, column: Column) -> tuple[Array, Array]:
    """Return the values of a column, not a number where there is none, and what the last digit of each is worth."""
    values = [text.number(row, column.index, column.label) for row in column.rows]
    digits = last_digits([row.cell(column.index) for row in column.rows])
    return np.array([np.nan if v is None else v for v in values]), np.array(digits)


def _series(text: DelimitedText, column: Column, channel: str, units: Mapping[str, str], notes: ReadingNotes) -> Series:
    """Read one channel in SI units."""
    factor = _to_si(text, column, UNITS[channel], units)
    value, digit = numbers(text, column)
    if not np.isfinite(value).any():
        raise text.error(None, column.label, f"found no values at all, needed {channel}; export that track again")
    if not column.unit and _KIND_OF_UNIT.get(column.role) == "length":
        notes.assumptions.append(f"lengths without a unit taken in {units['length']}")
    return Series(column=column.label, value=value * factor, last_digit=digit * factor)


def _to_si(text: DelimitedText, column: Column, si: str, units: Mapping[str, str]) -> float:
    """Return the factor from the column's unit to SI."""
    unit_text = column.unit or units.get(_KIND_OF_UNIT.get(column.role, ""), si)
    if unit_text.lower() in PIXELS and si == "m":
        unit_text = units["length"]
        if unit_text == _DEFAULT_UNITS["length"] or unit_text.lower() in PIXELS:
            raise ImplausibleLengthError(str(text.error(None, column.label, _NO_PIXEL)))
    try:
        # A unit may have a size of its own: "1.4 mm" for the pixels of a picture
        return to_si(unit_text if unit_text[:1].isdigit() else f"1 {unit_text}", si)
    except UnitError as error:
        line = min((row.line for row in column.rows), default=1) - 1 if column.unit else None
        detail = f" ({error})" if str(error) else ""
        message = f"found the unit {quote(unit_text)}{detail}, needed one that converts to {si}; write for example '[{si}]'"
        raise text.error(line, column.label, message) from None


_NO_PIXEL = "found lengths in pixels, needed the size of one; say so by 'units: {length: 1.4 mm}'"


def tracks_of(text: DelimitedText, columns: list[Column]) -> dict[str, tuple[Array, Array]]:
    """Return name -> x and y of every track of a table of positions, in the file's units, without missing points."""
    tracks: dict[str, tuple[Array, Array]] = {}
    empty = np.empty(0)
    for c in columns:
        if c.role in ("x", "y"):
            value = numbers(text, c)[0]
            value = value[np.isfinite(value)]
            x, y = tracks.get(c.track, (empty, empty))
            tracks[c.track] = (value, y) if c.role == "x" else (x, value)
    return tracks


def _about_one_axis(axes: Sequence[Series], notes: ReadingNotes) -> Series:
    """Return the rate about the axis about which a body turns, of rates about three axes of its own."""
    values = np.stack([a.value for a in axes], axis=1)
    known = np.all(np.isfinite(values), axis=1)
    axis = np.linalg.svd(values[known], full_matrices=False)[2][0]
    axis *= np.sign(axis[np.argmax(np.abs(axis))])
    share = float(np.sum((values[known] @ axis) ** 2) / np.sum(values[known] ** 2))
    named = ", ".join(f"{a:.2f}" for a in axis)
    notes.assumptions.append(
        f"rates about {len(axes)} axes: taken about the one ({named}) that has {100 * share:.3g} % of them"
    )
    return Series(column=axes[int(np.argmax(np.abs(axis)))].column, value=values @ axis, last_digit=axes[0].last_digit)


def mass_in_name(track: str) -> str:
    """Return the mass that the name of a track says, such as "light ball" or "mass_heavy"; '' if it says none, or both."""
    words = track.lower().replace("_", " ")
    said = [mass for mass in MASSES if re.search(rf"\b{mass}\b", words)]
    return said[0] if len(said) == 1 else ""


def propose_masses(tracks: Mapping[str, tuple[Array, Array]]) -> dict[str, str]:
    """Return mass -> name of its track: by the names of the tracks, or by their motion.

    The heavy mass falls along a vertical line, the light one swings: of two tracks, the narrower one is the heavy mass's. If
    neither is clearly narrower, as in a vertical release, it is the one that falls farther.
    """
    named = {mass: name for name in tracks if (mass := mass_in_name(name))}
    rest = [name for name in tracks if name not in named.values()]
    missing = [mass for mass in MASSES if mass not in named]
    if not rest or not missing:
        return named
    by_width = sorted(rest, key=lambda name: value_range(tracks[name][0]))
    narrow, wide = by_width[0], by_width[-1]
    if len(rest) > 1 and 2 * value_range(tracks[narrow][0]) > value_range(tracks[wide][0]):
        by_fall = sorted(rest, key=lambda name: fall(tracks[name][1]))
        narrow, wide = by_fall[-1], by_fall[0]
    if len(rest) == 1 and len(missing) > 1:
        missing = ["heavy" if 2 * value_range(tracks[wide][0]) < fall(tracks[wide][1]) else "light"]
    return named | {mass: {"light": wide, "heavy": narrow}[mass] for mass in missing}


OUTLIER_SHARE = 5.0
"""Percentage of the points at either end of a range that do not count, as an autotracker slips."""


def value_range(values: Array) -> float:
    """Return the range of values without outliers."""
    return float(np.subtract(*np.percentile(values, [100 - OUTLIER_SHARE, OUTLIER_SHARE]))) if len(values) else 0.0


def fall(y: Array) -> float:
    """Return how much lower a track ends than it begins."""
    return float(y[0] - y[-1]) if len(y) else 0.0


def _mass_of_track(file: str, have: Mapping[str, tuple[Array, Array]], tracks: Mapping[str, str] | None) -> dict[str, str]:
    """Return the mass of each track, as asked for or by the track's own name."""
    shown = ", ".join(f"'{t}'" if t else "one without a name" for t in have)
    proposed = ", ".join(f"{mass}: {name or Path(file).stem}" for mass, name in propose_masses(have).items())
    way_out = f"by their motion, write 'tracks: {{{proposed}}}'"
    if tracks:
        unknown = [m for m in tracks if m not in MASSES]
        if unknown:
            raise data_error(file, None, "", f"tracks: found {quote(unknown[0])}, needed 'light' or 'heavy'")
        if len(set(tracks.values())) < len(tracks):
            name = quote(next(iter(tracks.values())))
            raise data_error(file, None, "", f"tracks: found {name} for both masses, needed one for each")
        if len(have) == 1 and len(tracks) == 1 and "" in (*have, *tracks.values()):
            return {next(iter(have)): next(iter(tracks))}
        missing = [t for t in tracks.values() if t not in have]
        if missing and have:
            raise data_error(file, None, "", f"found the tracks {shown}, needed {quote(missing[0])}; {way_out}")
        return {track: mass for mass, track in tracks.items()}
    known = {t: m for t in have if (m := mass_in_name(t))}
    if have and not known:
        raise data_error(file, None, "", f"found the tracks {shown}, needed to know which mass each is; {way_out}")
    return known


def _project_sheets(
    raw: bytes, file: str, tracks: Mapping[str, str] | None, units: Mapping[str, str], notes: ReadingNotes
) -> list[Sheet]:
    """Return the channels of a project of Tracker."""
    project = read_project(raw, file)
    notes.assumptions += project.notes
    unit = project.length_unit
    if unit in PIXELS:
        if "length" not in units:
            raise ImplausibleLengthError(str(data_error(file, None, "", _NO_PIXEL)))
        unit = units["length"]
    try:
        factor = to_si(unit if unit[:1].isdigit() else f"1 {unit}", "m")
    except UnitError:
        raise data_error(file, None, "", f"found the unit of length {quote(unit)}, needed one such as m or cm") from None
    masses = _mass_of_track(file, {t.name: (t.x, t.y) for t in project.tracks}, tracks)
    sheets = []
    for track in (t for t in project.tracks if t.name in masses):
        none = np.zeros(len(track.frame))
        mass = masses[track.name]
        sheets.append(
            Sheet(
                clock="t",
                lines=track.frame,
                time=project.frame_time[track.frame],
                rounding=none,
                frame=track.frame.astype(float),
                channels={
                    f"{mass}_{axis}": Series(column=f"{axis} ({track.name})", value=value * factor, last_digit=none)
                    for axis, value in (("x", track.x), ("y", track.y))
                },
            )
        )
    left_out = [t for t in project.tracks if t.name not in masses]
    if left_out:
        names = ", ".join(f"{t.name!r}" for t in left_out)
        notes.unused[f"track {names}: not asked for"] += 2 * sum(len(t.frame) for t in left_out)
    return sheets


def _refuse_implausible_values(file: str, sheet: Sheet) -> None:
    """Refuse values that must be in another unit than was said."""
    for name, series in sheet.channels.items():
        unit = UNITS[name]
        limit = MAX_VALUE.get(name.partition("_")[0], MAX_VALUE[unit]) if unit != "rad/s" else MAX_VALUE[unit]
        worst = int(np.nanargmax(np.abs(series.value)))
        if abs(series.value[worst]) > limit:
            kind, other = ("angle", "deg") if unit.startswith("rad") else ("length", "cm")
            values = f"found {series.value[worst]:g} {unit}, needed at most {limit:.4g}"
            message = f"{values}; if the file is in another unit, say so: 'units: {{{kind}: {other}}}'"
            error = data_error(file, int(sheet.lines[worst]), series.column, message)
            raise ImplausibleLengthError(str(error)) if kind == "length" else error


def _from_release(channels: list[Channel], notes: ReadingNotes) -> list[Channel]:
    """Return the channels with their clock from the first point on, where it begins elsewhere and the masses rest at first."""
    start = min(float(c.t[0]) for c in channels)
    step = min((c.time_step for c in channels if c.time_step > 0), default=0.0)
    if abs(start) <= 3 * step or step == 0:
        return channels
    for c in channels:
        if len(c) < 5 or c.name == "angle_rate":
            return channels
        acceleration = MAX_START_ACCELERATION[c.unit]
        if abs(c.value[2] - c.value[0]) > acceleration * (c.t[2] - c.t[0]) ** 2 + MAX_START_SIGMAS * scatter(c):
            return channels
    notes.assumptions.append(f"the first time, {start:.4g} s, was taken as 0: the masses rest there")
    return [replace(c, t=c.t - start) for c in channels]


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
