"""Read files of measured data into `Observations`: tables of tracked points, angles, drops or events, and Tracker's projects.

Only times and positions are read: velocities and accelerations in such files are computed from them, so they tell nothing more.
An empty cell is a missing point, never zero. Values that are not used are counted with the reason.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.errors import WayOut
from looping_pendulum.measured.clock import MAX_TIME_STEP, Series, Sheet, are_milliseconds, timed_channels
from looping_pendulum.measured.columns import ERROR_SUFFIX, PIXELS, Column, read_columns
from looping_pendulum.measured.copies import without_copies
from looping_pendulum.measured.delimited import (
    LARGEST_FILE,
    DelimitedText,
    data_error,
    last_digits,
    listed,
    read_bytes,
    read_text,
)
from looping_pendulum.measured.events import is_event_table, read_events
from looping_pendulum.measured.noise import scatter
from looping_pendulum.measured.observations import (
    UNITS,
    Channel,
    DataError,
    ImplausibleLengthError,
    Observations,
    ReadingNotes,
    Track,
    UnusedValues,
    value_range,
)
from looping_pendulum.measured.tracker_project import (
    LARGEST_ARCHIVE,
    TrackerProject,
    is_named_project,
    is_project,
    read_project,
)
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
MAX_CHANCE = 1e-3
"""Largest number of records in which noise repeats a point in every digit as often as a tracker that has lost an object."""
LAST_STEPS = 3
"""Number of steps before a mass stays, and before these, whose lengths tell whether it slows down."""
LOST_PLACES = (0.0, -1.0)
"""Both coordinates by which trackers write an object that they have lost, in their unit."""
MIN_SCORE = 0.5
"""Smallest score of a point that is used, as a share of the median of its object's, as programs scale scores in many ways."""
FORMATS: tuple[tuple[Callable[[str, bytes], bool], Callable[[bytes, str], TrackerProject | DelimitedText]], ...] = (
    (lambda file, raw: is_named_project(file) or is_project(raw), read_project),
    (lambda file, raw: True, read_text),
)
"""Whether a file is of a format, by its name and content, and the function of content and name that reads it."""
_NO_NAME = "one without a name"
_DEFAULT_UNITS = {"length": "m"}
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
    content = _parsed(path, file)
    all_units = _DEFAULT_UNITS | dict(units or {})
    if isinstance(content, TrackerProject):
        sheets = _project_sheets(content, file, tracks, all_units, notes)
    else:
        if kind == "events" or (kind == "auto" and is_event_table(content)):
            return read_events(content, name)
        columns = read_columns(content, kind, list((tracks or {}).values()), notes)
        sheets = _sheets(content, _of_one_run(content, columns, run, notes), tracks, all_units, notes)
    for sheet in sheets:
        _refuse_implausible_values(file, sheet)
    channels = timed_channels(sheets, frame_rate, clip_rate, partial(data_error, file), notes)
    if starts_at_release:
        channels = _from_release(channels, notes)
    channels = without_copies(_without_inconsistent_rate(channels, notes), notes)
    return Observations(
        name=name,
        file=file,
        channels=tuple(channels),
        unused=tuple(UnusedValues(count=count, reason=reason) for reason, count in notes.unused.items() if count),
        assumptions=tuple(dict.fromkeys(notes.assumptions)),
        camera_errors=notes.camera_errors,
        tracks=notes.tracks,
        length_unit=notes.length_unit,
    )


def _parsed(path: str | Path, file: str) -> TrackerProject | DelimitedText:
    """Return the content of a file, by the first of `FORMATS` that it is of."""
    # A project may hold the film
    raw = read_bytes(path, file, LARGEST_ARCHIVE if is_named_project(file) else LARGEST_FILE)
    return next(parse for is_of_format, parse in FORMATS if is_of_format(file, raw))(raw, file)


def _of_one_run(text: DelimitedText, columns: list[Column], run: str | None, notes: ReadingNotes) -> list[Column]:
    """Return the columns of the chosen run, and those of no run, that are times or positions."""
    runs = list(dict.fromkeys(c.run for c in columns if c.is_position))
    shown = listed([name or _NO_NAME for name in runs])
    if run is None and len(runs) > 1:
        first = next(filter(None, runs))
        raise text.error(
            None, "", f"found the runs {shown}, needed one trial", WayOut(words="choose by {}", keys={"run": str(first)})
        )
    if run is not None and run not in runs:
        found, way_out = f"found the runs {shown}", "choose one that is there"
        if not any(runs):
            found, way_out = "found a single run without a number", "leave it out"
        raise text.error(None, "", f"{found}, needed run {quote(run)}; {way_out}")
    # Positions of no run are a run of their own, while all runs may share a column of times
    columns = [c for c in columns if run is None or c.run == run or not (c.run or c.is_position)]
    _leave_out([c for c in columns if not c.role], "not a time or a position", "not times or positions", notes)
    return [c for c in columns if c.role]


def _leave_out(columns: Sequence[Column], why: str, why_several: str, notes: ReadingNotes) -> None:
    """Count the cells of columns that are not used."""
    names = list(dict.fromkeys(repr(c.label) for c in columns))
    reason = f"columns {listed(names)}: {why_several}" if len(names) > 1 else f"column {''.join(names)}: {why}"
    notes.unused[reason] += sum(map(bool, (cell for c in columns for cell in c.cells)))


def _sheets(
    text: DelimitedText,
    columns: list[Column],
    tracks: Mapping[str, str] | None,
    units: Mapping[str, str],
    notes: ReadingNotes,
) -> list[Sheet]:
    """Return the channels of a table, by the columns of times or frames that belong to them."""
    masses = _mass_of_track(text.file, tracks_of(text, columns), tracks)
    notes.tracks = {mass: track for track, mass in masses.items()}
    notes.length_unit = next((c.unit for c in columns if c.is_length and c.unit), "")
    by_track = {"x", "y"} | {c.role for c in columns if c.track in masses}
    left_out = [c for c in columns if c.is_position and c.role in by_track and c.track not in masses]
    timed: dict[tuple[Column, Column | None], dict[str, Series]] = {}
    for column in (c for c in columns if c.is_position and c not in left_out):
        name = f"{masses[column.track]}_{column.role}" if column.role in ("x", "y") else column.role
        beside = [c for c in columns if c.rows is column.rows]
        # The rates of one body about several axes are one channel
        axes = [c for c in beside if c.axis and c.track == column.track] if column.axis else [column]
        if column is not axes[0] and len({c.axis for c in axes}) == len(axes):
            continue
        if any(name in channels for channels in timed.values()):
            found = f"found {name} a second time"
            way_out = WayOut(words="say by {} which is meant", keys={"tracks.light": "NAME"}, is_example=True)
            raise text.error(None, column.label, f"{found}, needed one column for it", way_out)
        frames = [c for c in beside if c.role == "frame"]
        clocks = [c for c in beside if c.role == "t"] or frames
        if not clocks:
            raise text.error(None, column.label, f"found no column of times among '{column.label}', needed one; name it 't'")
        # Tracker repeats the column of times for each track; the one that belongs to a column stands left of it
        clock = next((c for c in reversed(clocks) if c.index < column.index), clocks[0])
        frame = next((f for f in frames if f.track == column.track), frames[0] if frames else None)
        parts = [_series(text, c, name, units, notes, beside) for c in axes]
        series = _about_one_axis(text, parts, notes) if len(parts) > 1 else parts[0]
        timed.setdefault((clock, frame), {})[name] = series
    _leave_out(left_out, "track not asked for", "track not asked for", notes)
    if not timed:
        way_out = WayOut(words="check {}", keys={"tracks.light": "NAME", "kind": "positions"}, is_example=True)
        raise text.error(None, "", "found no positions, angles or heights, needed one column of them", way_out)
    scores = [c for c in columns if c.role == "score" and c.track in masses]
    return [
        _sheet(text, clock, frame, channels, {masses[c.track]: c for c in scores if c.rows is clock.rows}, units, notes)
        for (clock, frame), channels in timed.items()
    ]


def _sheet(
    text: DelimitedText,
    clock: Column,
    frame: Column | None,
    channels: dict[str, Series],
    scores: Mapping[str, Column],
    units: Mapping[str, str],
    notes: ReadingNotes,
) -> Sheet:
    """Return the rows of a column of times or frames, with the channels that it times; ``scores`` are those of each mass."""
    time, rounding = None, np.zeros(len(clock.rows))
    if clock.role == "t":
        time, rounding = numbers(text, clock)
        factor = _to_si(text, clock, "s", units)
        time, rounding = factor * time, factor * rounding
    number = None if frame is None else numbers(text, frame)[0]
    if frame is not None and number is not None and np.any(np.nan_to_num(number) % 1):
        line = clock.rows[int(np.argmax(np.nan_to_num(number) % 1 > 0))].line
        needed = "needed a frame's; if these are times, name the column 't'"
        raise text.error(line, frame.label, f"found no whole number, {needed}")
    for name, series in channels.items():
        has_value = np.isfinite(series.value)
        has_time = np.isfinite(time) if time is not None else np.ones(len(has_value), dtype=bool)
        notes.unused[f"{name}: empty cell"] += int(np.sum(~has_value & has_time))
        notes.unused[f"{name}: a value without a time"] += int(np.sum(has_value & ~has_time))
    for mass in MASSES:
        pair = {name: channels[name] for name in (f"{mass}_x", f"{mass}_y") if name in channels}
        lost = {}
        if mass in scores:
            score = numbers(text, scores[mass])[0]
            lost["the tracker's score is low"] = (
                score < MIN_SCORE * np.nanmedian(score) if np.isfinite(score).any() else score > 0
            )
        if len(pair) == 2:
            lost["the mark of a lost object"] = _is_marked_lost(*(series.value / series.unit for series in pair.values()))
            lost["the last place of a lost object"] = _is_at_last_place(pair)
        for why, rows in lost.items():
            for name in pair:
                series = channels[name]
                notes.unused[f"{name}: {why}"] += int(np.sum(rows & np.isfinite(series.value)))
                channels[name] = replace(series, value=np.where(rows, np.nan, series.value))
    lines = np.array([row.line for row in clock.rows])
    return Sheet(
        clock=clock.label,
        lines=lines,
        time=time,
        rounding=0.5 * rounding,
        frame=number,
        channels=channels,
        has_unit=bool(clock.unit or "time" in units),
    )


def _is_marked_lost(x: Array, y: Array) -> NDArray[np.bool_]:
    """Return which points, in the file's unit, are none but the writing of some trackers for a lost object: (0, 0) or (-1, -1).

    A mass may begin at the origin, if somebody put it there; then its next step is no longer than all others.
    """
    lost = np.zeros(len(x), dtype=bool)
    known = np.isfinite(x) & np.isfinite(y)
    for place in LOST_PLACES:
        is_there = known & (x == place) & (y == place)
        elsewhere = np.flatnonzero(known & ~is_there)
        if not len(elsewhere):
            continue
        steps = np.hypot(np.diff(x[elsewhere]), np.diff(y[elsewhere]))
        first = elsewhere[0]
        if np.hypot(x[first] - place, y[first] - place) <= steps.max(initial=0.0 if len(elsewhere) > 1 else np.inf):
            is_there[:first] = False
        lost |= is_there
    return lost


def _is_at_last_place(pair: Mapping[str, Series]) -> NDArray[np.bool_]:
    """Return which points at the end repeat the one before to a unit of the last digit, although noise would have moved a mass.

    A mass comes to rest over some steps, also in an exact motion, and the mark of a lost one in one step.
    """
    known = np.flatnonzero(np.all([np.isfinite(series.value) for series in pair.values()], axis=0))
    lost = np.zeros(len(next(iter(pair.values())).value), dtype=bool)
    steps = np.hypot(*(np.diff(series.value[known]) for series in pair.values()))
    digits = {name: float(np.max(series.last_digit[known], initial=0.0)) for name, series in pair.items()}
    moves = np.flatnonzero(steps > 1.5 * max(digits.values()))
    start = int(moves[-1]) + 1 if len(moves) else 0
    before, last = (steps[max(end - LAST_STEPS, 0) : max(end, 0)].sum() for end in (start - LAST_STEPS, start))
    if start and last > 0.5 * before:
        chance = 1.0
        for name, series in pair.items():
            noise = scatter(Channel(name=name, t=np.arange(start + 1.0), value=series.value[known[: start + 1]]))
            # The chance that two values of normal noise are so near: three values of the last digit are
            chance *= min(1.0, 3 * digits[name] / (2 * np.sqrt(np.pi) * noise)) if noise > 0 else 1.0
        lost[known[start + 1 :]] = len(known) * chance ** (len(known) - start - 1) < MAX_CHANCE
    return lost


def numbers(text: DelimitedText, column: Column) -> tuple[Array, Array]:
    """Return the values of a column, not a number where there is none, and what the last digit of each is worth."""
    values = [text.number(row, column.index, column.label) for row in column.rows]
    return np.array(values), np.array(last_digits(column.cells))


def _series(
    text: DelimitedText, column: Column, name: str, units: Mapping[str, str], notes: ReadingNotes, beside: Sequence[Column]
) -> Series:
    """Read one channel in SI units, with its errors if a column ``beside`` it has them."""
    factor = _to_si(text, column, UNITS[name], units)
    value, digit = numbers(text, column)
    if not np.isfinite(value).any():
        raise text.error(None, column.label, f"found no values at all, needed {name}; export that track again")
    if not column.unit and _KIND_OF_UNIT.get(column.role) == "length":
        notes.assumptions.append(f"lengths without a unit taken in {units['length']}")
    error = _errors(text, column, name, units, beside)
    return Series(column=column.label, value=value * factor, last_digit=digit * factor, unit=factor, error=error)


def _errors(text: DelimitedText, column: Column, name: str, units: Mapping[str, str], beside: Sequence[Column]) -> Array | None:
    """Return the errors that a column ``beside`` it states [SI], 0 for an empty cell; None: there is no such column."""
    stated = next((c for c in beside if c.role == column.role + ERROR_SUFFIX and c.track == column.track), None)
    if stated is None:
        return None
    error, _ = numbers(text, stated)
    negative = np.flatnonzero(error < 0)
    if len(negative):
        line = stated.rows[int(negative[0])].line
        raise text.error(line, stated.label, f"found {error[negative[0]]:g}, needed a standard error, 0 or more")
    return np.asarray(np.nan_to_num(error) * _to_si(text, replace(stated, role=column.role), UNITS[name], units))


def _to_si(text: DelimitedText, column: Column, si: str, units: Mapping[str, str]) -> float:
    """Return the factor from the column's unit to SI."""
    unit = column.unit or units.get(_KIND_OF_UNIT.get(column.role, ""), si)
    if unit.lower() in PIXELS and si == "m":
        unit = _size_of_pixel(text.file, column.label, units)
    try:
        return _factor(unit, si)
    except UnitError as error:
        line = min((row.line for row in column.rows), default=1) - 1 if column.unit else None
        detail = f" ({error})" if str(error) else ""
        message = f"found the unit {quote(unit)}{detail}, needed one that converts to {si}; write for example '[{si}]'"
        raise text.error(line, column.label, message) from None


def _factor(unit: str, si: str) -> float:
    """Return the factor from a unit to SI; it may have a size of its own: "1.4 mm" for the pixels of a picture."""
    return to_si(unit if unit[:1].isdigit() else f"1 {unit}", si)


def _size_of_pixel(file: str, column: str, units: Mapping[str, str]) -> str:
    """Return the stated length of a pixel."""
    if units["length"] == _DEFAULT_UNITS["length"] or units["length"].lower() in PIXELS:
        message = "found lengths in pixels, needed the size of one"
        way_out = WayOut(words="say so by {}", keys={"units.length": "1.4 mm"})
        raise data_error(file, None, column, message, way_out, ImplausibleLengthError)
    return units["length"]


def tracks_of(text: DelimitedText, columns: Sequence[Column]) -> list[Track]:
    """Return every track of a table of positions, in the file's units, without missing points."""
    places: dict[str, dict[str, Array]] = {}
    for c in (c for c in columns if c.role in ("x", "y")):
        value = numbers(text, c)[0]
        places.setdefault(c.track, {"x": np.empty(0), "y": np.empty(0)})[c.role] = value[np.isfinite(value)]
    return [Track(name=name, **axes) for name, axes in places.items()]


def _about_one_axis(text: DelimitedText, axes: Sequence[Series], notes: ReadingNotes) -> Series:
    """Return the rate about the axis about which a body turns, of rates about three axes of its own."""
    values = np.stack([a.value for a in axes], axis=1)
    known = np.all(np.isfinite(values), axis=1)
    if not known.any():
        raise text.error(None, axes[0].column, "found no values at all, needed angle_rate; export that track again")
    axis = np.linalg.svd(values[known], full_matrices=False)[2][0]
    axis *= np.sign(axis[np.argmax(np.abs(axis))])
    total = float(np.sum(values[known] ** 2))
    share = float(np.sum((values[known] @ axis) ** 2)) / total if total else 1.0
    named = ", ".join(f"{round(a, 2) + 0.0:.2f}" for a in axis)
    notes.assumptions.append(
        f"rates about {len(axes)} axes: taken about the one ({named}) that has {100 * share:.3g} % of them"
    )
    return Series(column=axes[int(np.argmax(np.abs(axis)))].column, value=values @ axis, last_digit=axes[0].last_digit)


def mass_in_name(track: str) -> str:
    """Return the mass that the name of a track says, such as "light ball" or "mass_heavy"; '' if it says none, or both."""
    words = track.lower().replace("_", " ")
    said = [mass for mass in MASSES if re.search(rf"\b{mass}\b", words)]
    return said[0] if len(said) == 1 else ""


def propose_masses(tracks: Sequence[Track]) -> dict[str, str]:
    """Return mass -> name of its track: by the names of the tracks, or by their motion.

    The heavy mass falls along a vertical line, the light one swings: of two tracks, the narrower one is the heavy mass's. If
    neither is clearly narrower, as in a vertical release, it is the one that falls farther.
    """
    named = {mass: t.name for t in tracks if (mass := mass_in_name(t.name))}
    rest = [t for t in tracks if t.name not in named.values()]
    missing = [mass for mass in MASSES if mass not in named]
    if not rest or not missing:
        return named
    by_width = sorted(rest, key=lambda t: t.width)
    narrow, wide = by_width[0], by_width[-1]
    if len(rest) > 1 and 2 * narrow.width > wide.width:
        by_fall = sorted(rest, key=lambda t: t.fall)
        narrow, wide = by_fall[-1], by_fall[0]
    if len(rest) == 1 and len(missing) > 1:
        missing = ["heavy" if 2 * wide.width < wide.fall else "light"]
    return named | {mass: {"light": wide, "heavy": narrow}[mass].name for mass in missing}


def _mass_of_track(file: str, have: Sequence[Track], tracks: Mapping[str, str] | None) -> dict[str, str]:
    """Return the mass of each track, as asked for or by the track's own name."""
    names = [t.name for t in have]
    shown = listed([f"'{name}'" if name else _NO_NAME for name in names])
    proposed = {f"tracks.{mass}": name or Path(file).stem for mass, name in propose_masses(have).items()}
    by_motion = WayOut(words="by their motion, write {}", keys=proposed)
    way_out: WayOut | None = None
    message = ""
    if tracks:
        unknown = [m for m in tracks if m not in MASSES]
        missing = [t for t in tracks.values() if t not in names]
        if unknown:
            message = f"tracks: found {quote(unknown[0])}, needed 'light' or 'heavy'"
        elif len(set(tracks.values())) < len(tracks):
            message = f"tracks: found {quote(next(iter(tracks.values())))} for both masses, needed one for each"
        elif len(names) == 1 and len(tracks) == 1 and "" in (*names, *tracks.values()):
            return {names[0]: next(iter(tracks))}
        elif missing and names:
            message, way_out = f"found the tracks {shown}, needed {quote(missing[0])}", by_motion
        masses = {track: mass for mass, track in tracks.items()}
    else:
        masses = {name: mass for name in names if (mass := mass_in_name(name))}
        if names and not masses:
            message, way_out = f"found the tracks {shown}, needed to know which mass each is", by_motion
    if message:
        raise data_error(file, None, "", message, way_out)
    return masses


def _project_sheets(
    project: TrackerProject, file: str, tracks: Mapping[str, str] | None, units: Mapping[str, str], notes: ReadingNotes
) -> list[Sheet]:
    """Return the channels of a project of Tracker."""
    notes.assumptions += project.notes
    unit = _size_of_pixel(file, "", units) if project.length_unit in PIXELS else project.length_unit
    try:
        factor = _factor(unit, "m")
    except UnitError:
        raise data_error(file, None, "", f"found the unit of length {quote(unit)}, needed one such as m or cm") from None
    masses = _mass_of_track(file, project.tracks, tracks)
    notes.tracks = {mass: track for track, mass in masses.items()}
    notes.length_unit = "" if project.length_unit in PIXELS else project.length_unit
    left_out = [t for t in project.tracks if t.name not in masses]
    if left_out:
        names = listed([repr(t.name) for t in left_out])
        notes.unused[f"track {names}: not asked for"] += 2 * sum(len(t.frame) for t in left_out)
    return [
        Sheet(
            clock="t",
            lines=track.frame,
            time=project.frame_time[track.frame],
            rounding=np.zeros(len(track.frame)),
            frame=track.frame.astype(float),
            channels={
                f"{masses[track.name]}_{axis}": Series(
                    column=f"{axis} ({track.name})", value=value * factor, last_digit=np.zeros(len(value))
                )
                for axis, value in (("x", track.x), ("y", track.y))
            },
        )
        for track in project.tracks
        if track.name in masses
    ]


def _refuse_implausible_values(file: str, sheet: Sheet) -> None:
    """Refuse values that must be in another unit than was said."""
    for name, series in sheet.channels.items():
        unit = UNITS[name]
        limit = MAX_VALUE.get(name.partition("_")[0], MAX_VALUE[unit])
        worst = int(np.nanargmax(np.abs(series.value)))
        if abs(series.value[worst]) > limit:
            kind, other = ("angle", "deg") if unit.startswith("rad") else ("length", "cm")
            message = f"found {series.value[worst]:g} {unit}, needed at most {limit:.4g}"
            way_out = WayOut(words="if the file is in another unit, say so: {}", keys={f"units.{kind}": other})
            error = ImplausibleLengthError if kind == "length" else DataError
            raise data_error(file, int(sheet.lines[worst]), series.column, message, way_out, error)


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
    return [
        replace(
            c, t=c.t - start, stated_error=None if c.stated_error is None else (c.stated_error[0] - start, c.stated_error[1])
        )
        for c in channels
    ]


def _without_inconsistent_rate(channels: list[Channel], notes: ReadingNotes) -> list[Channel]:
    """Leave out an angular rate that is not the rate of the angle beside it."""
    named = {c.name: c for c in channels}
    if "angle_rate" not in named or "angle" not in named or len(named["angle"]) < 5:
        return channels
    angle, rate = named["angle"], named["angle_rate"]
    _, at_angle, at_rate = np.intersect1d(angle.t, rate.t, return_indices=True)
    slope, value = np.gradient(angle.value, angle.t)[at_angle], rate.value[at_rate]
    size = float(slope @ slope)
    ratio = float(slope @ value) / size if size else 0.0
    correlation = abs(float(slope @ value)) / (np.sqrt(size * float(value @ value)) or 1.0)
    if correlation > 0.9 and 0.8 < ratio < 1.25:
        return channels
    reason = f"column {rate.column!r}: not the rate of the angle (best multiple {ratio:.2g}, correlation {correlation:.2f})"
    notes.unused[reason] += len(rate)
    return [c for c in channels if c is not rate]


LENGTH_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Units that a file without units may have, each in metres; the first with plausible positions is proposed."""
PLAUSIBLE_SPAN = 5.0
"""Largest distance that tracked points plausibly span [m]: a string of 2.5 m to both sides."""


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
    runs: tuple[str, ...] = ()
    """Names of the runs that the file holds."""

    @property
    def proposed_length_unit(self) -> str:
        """Return the header's unit of length, or the largest in which the positions are plausible."""
        spans = [max(value_range(t.x), value_range(t.y)) for t in self.tracks] or [0.0]
        plausible = (unit for unit, metres in LENGTH_UNITS.items() if max(spans) * metres <= PLAUSIBLE_SPAN)
        return self.length_unit or next(plausible, "m")

    @property
    def proposed_time_unit(self) -> str:
        """Return the header's unit of time, or s, or ms if that would make rows too rare."""
        return self.time_unit or ("ms" if self.time_step is not None and self.time_step > MAX_TIME_STEP else "s")

    def proposed_units(self) -> dict[str, str]:
        """Return the units of lengths and times that the header lacks and that are not the usual ones."""
        units = {}
        if self.kind in ("positions", "drop") and not self.length_unit and self.proposed_length_unit != "m":
            units["length"] = self.proposed_length_unit
        if self.time_step is not None and not self.time_unit and self.proposed_time_unit != "s":
            units["time"] = self.proposed_time_unit
        return units

    def proposed_masses(self) -> dict[str, str]:
        """Return mass -> name of its track: by the names of the tracks, or by their motion."""
        return propose_masses(self.tracks)

    def starts_on_the_right(self, masses: Mapping[str, str]) -> bool:
        """Return whether the light mass's first point is to the right of the heavy mass's line: the picture is mirrored."""
        by_name = {t.name: t for t in self.tracks}
        if not {"light", "heavy"} <= masses.keys() or not set(masses.values()) <= by_name.keys():
            return False
        light, heavy = (by_name[masses[mass]].x for mass in MASSES)
        return bool(len(light) and len(heavy) and light[0] > np.median(heavy))


def survey(path: str | Path, kind: str = "auto", tracks: Sequence[str] = ()) -> FileSurvey:
    """Look into a file of measured data.

    Parameters
    ----------
    kind
        One of `KINDS`.
    tracks
        Names of the tracks that are asked for, if they are known.

    Raises
    ------
    DataError
        If it cannot be read as a table of positions, angles, heights or events, or as a project of Tracker.
    """
    file = os.fspath(path)
    content = _parsed(path, file)
    if isinstance(content, TrackerProject):
        return FileSurvey(
            file=file,
            kind="positions",
            tracks=content.tracks,
            time_step=_typical_step(np.concatenate([content.frame_time[t.frame] for t in content.tracks])),
            length_unit="" if content.length_unit in PIXELS else content.length_unit,
            time_unit="s",
        )
    if is_event_table(content):
        return FileSurvey(file=file, kind="events")
    has_names = True
    try:
        columns = read_columns(content, kind, tracks, ReadingNotes())
    except DataError:
        # Five columns without names are read if two tracks are asked for
        columns = read_columns(content, kind, MASSES, ReadingNotes())
        has_names = False
    roles = {c.role for c in columns}
    clock = next((c for c in columns if c.role == "t"), None)
    times = np.empty(0) if clock is None else numbers(content, clock)[0]
    times = np.unique(times[np.isfinite(times)])
    step = None if clock is None else _typical_step(times)
    if clock is not None and not clock.unit and len(times) > 1 and not np.any(times % 1) and not are_milliseconds(times):
        step = None  # perhaps numbers of frames, whatever their name
    return FileSurvey(
        file=file,
        kind="positions" if roles & {"x", "y"} else "drop" if "height" in roles else "angle",
        tracks=tuple(tracks_of(content, columns)),
        has_names=has_names,
        time_step=step,
        length_unit=next((c.unit for c in columns if c.is_length and c.unit), ""),
        time_unit=clock.unit if clock else "",
        runs=tuple(dict.fromkeys(c.run for c in columns if c.is_position and c.run)),
    )


def read_as_proposed(
    path: str | Path,
    *,
    tracks: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    kind: str = "auto",
    **stated: Any,
) -> Observations:
    """Read a file by what is stated, as of `read`, and for the rest by what `survey` proposes.

    Raises
    ------
    DataError
        As of `read`.
    """
    found = survey(path, kind, list((tracks or {}).values()))
    masses = {} if tracks else found.proposed_masses()
    sizes = {what: unit for what, unit in found.proposed_units().items() if what not in (units or {})}
    observations = read(path, tracks=tracks or masses, units={**sizes, **(units or {})}, kind=kind, **stated)
    moving = ", ".join(f"{mass} = {quote(name)}" for mass, name in masses.items() if mass_in_name(name) != mass)
    guesses = [f"by their motion: {moving}"] if moving else []
    guesses += [f"by their size: {', '.join(f'{what} in {unit}' for what, unit in sizes.items())}"] if sizes else []
    return replace(observations, assumptions=(*observations.assumptions, *guesses))


def _typical_step(times: Array) -> float:
    """Return the median step of times; 0 with fewer than two."""
    steps = np.diff(np.unique(times))
    return float(np.median(steps)) if len(steps) else 0.0
