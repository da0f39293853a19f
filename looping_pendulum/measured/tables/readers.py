"""Read files of measured data into `Observations`: tables of tracked points, angles, drops or events, and Tracker's projects.

Only times and positions are read: velocities and accelerations in such files are computed from them, so they tell nothing more.
An empty cell is a missing point, never zero. Values that are not used are counted with the reason. The way of a table stands in
`delimited`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.errors import WayOut
from looping_pendulum.measured.clock import MAX_TIME_STEP, are_milliseconds, typical_step
from looping_pendulum.measured.noise import scatter
from looping_pendulum.measured.observations import (
    UNITS,
    Channel,
    DataError,
    ImplausibleLengthError,
    Observations,
    ReadingNotes,
    Track,
    value_range,
)
from looping_pendulum.measured.tables import lost
from looping_pendulum.measured.tables.columns import checked, counts, read_columns
from looping_pendulum.measured.tables.delimited import (
    DelimitedText,
    data_error,
    last_digits,
    listed,
    read_bytes,
    read_text,
)
from looping_pendulum.measured.tables.events import is_event_table, read_events
from looping_pendulum.measured.tables.forms import (
    Stated,
    TrackedObject,
    another_unit,
    si_factor,
    tracked_objects,
    tracks_of,
)
from looping_pendulum.measured.tables.names import CLOCK_ROLES, ERROR_SUFFIX, PIXELS, Column
from looping_pendulum.measured.tables.times import Sheet, timed_channels
from looping_pendulum.measured.tables.tracker_project import (
    LARGEST_ARCHIVE,
    is_project,
    read_project,
)
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.document import quote

__all__ = ["DataError", "read"]

ROLES_OF_KIND = {"positions": ("x", "y"), "angle": ("angle", "angle_rate"), "drop": ("height",)}
"""Kind -> what is read; beside positions, a program computed angles and heights from them."""
MASSES = ("light", "heavy")
MAX_VALUE = {"height": 1000.0, "light": 20.0, "heavy": 20.0, "angle": 4 * np.pi, "angle_rate": 1000.0}
"""Largest plausible heights [m], positions of the light and heavy mass [m], angles [rad] and angular rates [rad/s].

A larger value must be in another unit than the file or the study says.
"""
MAX_START_ACCELERATION = {"m": 9.81, "rad": 98.1}
"""Twice the largest acceleration of a mass after its release [m/s^2], and of a pendulum of 20 cm [rad/s^2].

A record whose masses are faster in its first two steps begins later.
"""
MAX_START_SIGMAS = 4.0
"""The same by noise, in its standard deviations."""
LENGTH_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Units that a file without units may have, each in metres; the first with plausible positions is proposed."""
PLAUSIBLE_SPAN = 5.0
"""Largest distance that tracked points plausibly span [m]: a string of 2.5 m to both sides."""
_NO_NAME = "one without a name"


def read(
    path: str | Path,
    *,
    content: str | None = None,
    frame_rate: float | None = None,
    clip_rate: float | None = None,
    tracks: Mapping[str, str] | None = None,
    kind: str = "auto",
    units: Mapping[str, str] | None = None,
    plane: str | None = None,
    box: str | None = None,
    run: str | None = None,
    name: str | None = None,
    starts_at_release: bool = True,
    proposes: bool = False,
) -> Observations:
    """Read one file of measured data.

    Parameters
    ----------
    content
        Text of a table, which then has ``path`` for a name in messages; None: the file is read.
    frame_rate, clip_rate, kind, units, plane, box
        What is known of the file, as in `Stated`.
    tracks
        Mass -> name of its track in the file, for example ``{"light": "mass A"}``. An empty name stands for the only track.
    run
        Number of the run or drop to read, if the file has several.
    name
        Name of the trial; by default that of the file without its ending.
    starts_at_release
        Whether a record whose clock begins elsewhere and whose masses are at rest at first begins at time 0.
    proposes
        Whether tracks and units that nothing states are those that `survey` proposes.

    Raises
    ------
    DataError
        If the file cannot be used; the message has one line with file, line, column, what was found and needed, and a way out.
    """
    file = os.fspath(path)
    name = name or Path(path).stem
    notes = ReadingNotes()
    stated = Stated(kind=kind, units=units or {}, plane=plane, box=box, frame_rate=frame_rate, clip_rate=clip_rate)
    parsed = _parsed(path, file) if content is None else read_text(content.encode(), file)
    if proposes:
        tracks, stated = _proposals(parsed, tracks, stated, notes)
    if kind == "events" or (kind == "auto" and is_event_table(parsed)):
        return read_events(parsed, name)
    notes.assumptions += parsed.notes
    columns = _of_one_run(parsed, read_columns(parsed, kind, list((tracks or {}).values()), notes), run)
    sheets = _sheets(parsed, columns, tracks, stated, notes)
    for sheet in sheets:
        _refuse_implausible_values(sheet)
    channels = timed_channels(sheets, stated, notes)
    if starts_at_release:
        channels = _from_release(channels, notes)
    return Observations(
        name=name,
        file=file,
        channels=tuple(channels),
        edits=notes.edits(),
        camera_errors=notes.camera_errors,
        tracks=notes.tracks,
        length_unit=next((c.unit for c in columns if c.is_length and c.unit), ""),
    )


def _parsed(path: str | Path, file: str) -> DelimitedText:
    """Return the table in a file, which is a project of Tracker, by its name, or a text."""
    if is_project(file):
        return read_project(read_bytes(path, file, LARGEST_ARCHIVE), file)  # it may hold the film
    return read_text(read_bytes(path, file), file)


def _of_one_run(text: DelimitedText, columns: list[Column], run: str | None) -> list[Column]:
    """Return the columns of the chosen run, and those of no run that are no positions."""
    runs = list(dict.fromkeys(c.run for c in columns if c.is_position))
    found = f"found the runs {listed([name or _NO_NAME for name in runs])}"
    if run is None and len(runs) > 1:
        way_out = WayOut(words="choose by {}", keys={"run": str(next(filter(None, runs)))})
        raise text.error(None, "", f"{found}, needed one trial", way_out)
    if run is not None and run not in runs:
        found = found if any(runs) else "found a single run without a number"
        advice = "choose one that is there" if any(runs) else "leave it out"
        raise text.error(None, "", f"{found}, needed run {quote(run)}; {advice}")
    # Positions of no run are a run of their own, while all runs may share a column of times
    return [c for c in columns if run is None or c.run == run or not (c.run or c.is_position)]


def _leave_out(columns: Sequence[Column], why: str, notes: ReadingNotes) -> None:
    """Count the cells of columns that are not used."""
    names = list(dict.fromkeys(repr(c.label) for c in columns))
    reason = f"{'columns' if len(names) > 1 else 'column'} {listed(names)}: {why}"
    notes.unused[reason] += sum(map(bool, (cell for c in columns for cell in c.cells)))


def _sheets(
    text: DelimitedText,
    columns: list[Column],
    tracks: Mapping[str, str] | None,
    stated: Stated,
    notes: ReadingNotes,
) -> list[Sheet]:
    """Return the channels of a table, by the columns of times or frames that belong to them."""
    objects = tracked_objects(text, columns, stated, notes)
    wanted = wanted_roles(stated.kind, objects)
    has_places = "x" in wanted
    if has_places:
        _refuse_times_as_places(text, objects)
    masses = _mass_of_track(text.file, tracks_of(objects) if has_places else [], tracks)
    notes.tracks = {mass: track for track, mass in masses.items()}
    parts = [(own, thing.track) for thing in objects for role in wanted if (own := thing.with_role(role))]
    parts.sort(key=lambda part: part[0][0].index)
    if has_places or any(track in masses for _, track in parts):
        _leave_out([c for own, track in parts if track not in masses for c in own], "track not asked for", notes)
        parts = [(own, track) for own, track in parts if track in masses]
    used = {*wanted, *CLOCK_ROLES, "score", *(role for thing in objects for role in thing.form)}
    unread = [c for c in columns if c.role not in used and not c.role.endswith(ERROR_SUFFIX)]
    _leave_out(unread, "not times or positions" if len({c.label for c in unread}) > 1 else "not a time or a position", notes)
    timed: dict[tuple[Column, Column | None], dict[str, Column]] = {}
    for own, track in parts:
        name = f"{masses[track]}_{own[0].role}" if has_places else own[0].role
        again = [c for i, c in enumerate(own) if c.axis in (other.axis for other in own[:i])]
        again += own if any(name in channels for channels in timed.values()) else []
        if again:
            named = track or next((o.track for o in objects if o.track), "")
            way_out = WayOut(words="say by {} which is meant", keys={"tracks.light": named or "NAME"}, is_example=not named)
            raise text.error(None, again[0].label, f"found {name} a second time, needed one column for it", way_out)
        channels = timed.setdefault(_clock_of(text, columns, own[0]), {})
        read = [_in_si(text, c, name, columns, stated.units, notes) for c in own]
        channels[name] = read[0] if len(read) == 1 else _about_one_axis(text, read, notes)
    if not timed:
        way_out = WayOut(words="check {}", keys={"tracks.light": "NAME", "kind": "positions"}, is_example=True)
        raise text.error(None, "", "found no positions, angles or heights, needed one column of them", way_out)
    scores = {masses[o.track]: checked(text, o.columns["score"]) for o in objects if o.track in masses and "score" in o.columns}
    return [_sheet(text, *clock, channels, scores, stated.units, notes) for clock, channels in timed.items()]


def _refuse_times_as_places(text: DelimitedText, objects: Sequence[TrackedObject]) -> None:
    for column in (c for thing in objects for role, c in thing.columns.items() if role in ("x", "y") and counts(c)):
        found = f"found values that grow by equal steps from {column.cells[0]}, as times or numbers of rows do"
        raise text.error(column.rows[0].line, column.label, f"{found}, needed positions; correct the names of the columns")


def wanted_roles(kind: str, objects: Sequence[TrackedObject]) -> tuple[str, ...]:
    """Return the roles that are read of a file with several kinds; a rate beside an angle was computed from it."""
    columns = {role.partition(" ")[0]: c for o in objects for role, c in o.columns.items()}
    lengths = [c for o in objects for role, c in o.columns.items() if role in ("x", "y")]
    if kind == "auto":
        # Of pixels the file does not say how long they are; of an angle it says all
        has_places = lengths and not ("angle" in columns and all(c.unit.lower() in PIXELS for c in lengths))
        kinds = [k for k, roles in ROLES_OF_KIND.items() if columns.keys() & set(roles) and k != "positions"]
        kind = "positions" if has_places else next(iter(kinds), "angle")
    return ("angle",) if kind == "angle" and "angle" in columns else ROLES_OF_KIND[kind]


def _clock_of(text: DelimitedText, columns: Sequence[Column], column: Column) -> tuple[Column, Column | None]:
    """Return the columns of times, or of frames where there are none, and of frames that belong to a column."""
    beside = [c for c in columns if c.rows is column.rows]
    frames = [c for c in beside if c.role == "frame"]
    clocks = [c for c in beside if c.role == "t"] or frames
    if not clocks:
        raise text.error(None, column.label, f"found no column of times among '{column.label}', needed one; name it 't'")
    # Tracker repeats the column of times for each track; the one that belongs to a column stands left of it
    clock = next((c for c in reversed(clocks) if c.index < column.index), clocks[0])
    return clock, next((f for f in frames if f.track == column.track), frames[0] if frames else None)


def _sheet(
    text: DelimitedText,
    clock: Column,
    frame: Column | None,
    channels: dict[str, Column],
    scores: Mapping[str, Column],
    units: Mapping[str, str],
    notes: ReadingNotes,
) -> Sheet:
    """Return the rows of a column of times or frames, with the channels that it times; ``scores`` are those of each mass."""
    time, rounding, number = np.full((3, len(clock.rows)), np.nan)
    has_time = np.ones(len(clock.rows), dtype=bool)
    if clock.role == "t":
        factor = si_factor(text, checked(text, clock), "s", units)
        time, rounding, has_time = factor * clock.value, 0.5 * factor * np.array(last_digits(clock.cells)), clock.has_values
    if frame is not None:
        number = checked(text, frame).value
        broken = np.flatnonzero(np.nan_to_num(number) % 1)
        if len(broken):
            found = "found no whole number, needed a frame's; if these are times, name the column 't'"
            raise text.error(clock.rows[broken[0]].line, frame.label, found)
    for name, column in channels.items():
        notes.unused[f"{name}: empty cell"] += int(np.sum(~column.has_values & has_time))
        notes.unused[f"{name}: a value without a time"] += int(np.sum(column.has_values & ~has_time))
    return Sheet(
        file=text.file,
        clock=clock.label,
        lines=np.array([row.line for row in clock.rows]),
        time=time,
        rounding=rounding,
        frame=number,
        channels=_without_lost_points(channels, scores, notes),
        has_unit=bool(clock.unit or "time" in units),
    )


def _without_lost_points(
    channels: Mapping[str, Column], scores: Mapping[str, Column], notes: ReadingNotes
) -> dict[str, Column]:
    """Return the channels without the points of lost objects, which are counted."""
    left = dict(channels)

    def take_out(names: Sequence[str], rows: NDArray[np.bool_], why: str) -> None:
        for name in names:
            notes.unused[f"{name}: {why}"] += int(np.sum(rows & left[name].has_values))
            left[name] = replace(left[name], value=np.where(rows, np.nan, left[name].value))

    bodies = [names for mass in MASSES if set(names := [f"{mass}_x", f"{mass}_y"]) <= left.keys()]
    # A lone coordinate may be lost, too
    for names in (*bodies, *([name] for name in left)):
        in_file = np.stack([left[n].value for n in names])
        take_out(names, lost.marked_as_lost(np.round(in_file, 9)), "the mark of a lost object")
        score = scores.get(names[0].partition("_")[0])
        if score is not None:
            take_out(names, lost.low_scores(score.value), "the tracker's score is low")
    return left


def _in_si(
    text: DelimitedText, column: Column, name: str, columns: Sequence[Column], units: Mapping[str, str], notes: ReadingNotes
) -> Column:
    """Return a column with the size of its unit, its last digit, and its errors; a unit that is assumed is said."""
    factor = si_factor(text, checked(text, column), UNITS[name], units)
    error = _stated_error(text, column, name, columns, units)
    read = replace(column, factor=factor, digit=column.digit or max(last_digits(column.cells)), error=error)
    if column.unit:
        return read
    first = int(np.argmax(column.has_values))
    # No pendulum hangs beyond half a turn at first
    if name == "angle" and "angle" not in units and abs(column.value[first]) > np.pi:
        found = f"found {column.value[first]:g} rad at the beginning, needed at most {np.pi:.4g}"
        raise text.error(column.rows[first].line, column.label, found, another_unit("angle", "deg"))
    has_name = not column.label[:1].isdigit()  # of columns without names it is said what they were taken as
    if column.is_length:
        notes.assumptions.append(f"lengths without a unit taken in {units.get('length', 'm')}")
    elif name == "angle" and "angle" not in units and has_name:
        said = "angles without a unit taken in rad; if they are in degrees, say so by 'units: {angle: deg}'"
        notes.assumptions.append(said)
    elif name == "angle_rate" and has_name and not column.axis:
        notes.assumptions.append("angular rates without a unit taken in rad/s")
    return read


def _stated_error(
    text: DelimitedText, column: Column, name: str, columns: Sequence[Column], units: Mapping[str, str]
) -> Array | None:
    """Return the errors that a column beside it states [SI], 0 for an empty cell; None: there is no such column."""
    beside = (c for c in columns if c.rows is column.rows and c.role == column.role + ERROR_SUFFIX and c.track == column.track)
    stated = next(beside, None)
    if stated is None:
        return None
    error = checked(text, stated).value
    negative = np.flatnonzero(error < 0)
    if len(negative):
        found = f"found {error[negative[0]]:g}, needed a standard error, 0 or more"
        raise text.error(stated.rows[negative[0]].line, stated.label, found)
    return np.asarray(np.nan_to_num(error) * si_factor(text, replace(stated, role=column.role), UNITS[name], units))


def _about_one_axis(text: DelimitedText, axes: Sequence[Column], notes: ReadingNotes) -> Column:
    """Return the rate about the axis about which a body turns, of rates about several axes of its own [rad/s]."""
    values = np.stack([a.value * a.factor for a in axes], axis=1)
    known = np.all(np.isfinite(values), axis=1)
    if not known.any():
        raise text.error(None, axes[0].label, "found no values at all, needed angle_rate; export that track again")
    axis = np.linalg.svd(values[known], full_matrices=False)[2][0]
    axis *= np.sign(axis[np.argmax(np.abs(axis))])
    total = float(np.sum(values[known] ** 2))
    share = float(np.sum((values[known] @ axis) ** 2)) / total if total else 1.0
    named = ", ".join(f"{round(a, 2) + 0.0:.2f}" for a in axis)
    notes.assumptions.append(
        f"rates about {len(axes)} axes: taken about the one ({named}) that has {100 * share:.3g} % of them"
    )
    return replace(axes[0], value=values @ axis, digit=axes[0].digit * axes[0].factor, factor=1.0, error=None)


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
    rest = sorted((t for t in tracks if t.name not in named.values()), key=lambda t: t.width)
    missing = [mass for mass in MASSES if mass not in named]
    if not rest or not missing:
        return named
    narrow, wide = rest[0], rest[-1]
    if len(rest) == 1 and len(missing) > 1:
        missing = ["heavy" if 2 * wide.width < wide.fall else "light"]
    elif 2 * narrow.width > wide.width:
        narrow, wide = max(rest, key=lambda t: t.fall), min(rest, key=lambda t: t.fall)
    return named | {mass: {"light": wide, "heavy": narrow}[mass].name for mass in missing}


def _mass_of_track(file: str, have: Sequence[Track], tracks: Mapping[str, str] | None) -> dict[str, str]:
    """Return the mass of each track, as asked for or by the track's own name."""
    names = [t.name for t in have]
    shown = [f"'{name}'" if name else _NO_NAME for name in names]
    found = f"found the tracks {listed(shown)}"
    proposed = {f"tracks.{mass}": name or Path(file).stem for mass, name in propose_masses(have).items()}
    by_motion = WayOut(words="by their motion, write {}", keys=proposed)
    if not tracks:
        masses = {name: mass for name in names if (mass := mass_in_name(name))}
        if names and not masses:
            raise data_error(file, None, "", f"{found}, needed to know which mass each is", by_motion)
        return masses
    if len(names) == 1 and len(tracks) == 1 and "" in (*names, *tracks.values()):
        return {names[0]: next(iter(tracks))}
    missing = [track for track in tracks.values() if track not in names]
    if len(set(tracks.values())) < len(tracks):
        message = f"tracks: found {quote(next(iter(tracks.values())))} for both masses, needed one for each"
        raise data_error(file, None, "", message)
    if missing and names:
        raise data_error(file, None, "", f"{found}, needed {quote(missing[0])}", by_motion)
    return {track: mass for mass, track in tracks.items()}


def _refuse_implausible_values(sheet: Sheet) -> None:
    """Refuse values that must be in another unit than was said."""
    for name, column in sheet.channels.items():
        values = np.abs(column.value * column.factor)
        limit = MAX_VALUE.get(name) or MAX_VALUE[name.partition("_")[0]]
        if column.has_values.any() and np.nanmax(values) > limit:
            worst = int(np.nanargmax(values))
            is_angle = name in ("angle", "angle_rate")
            message = f"found {column.value[worst] * column.factor:g} {UNITS[name]}, needed at most {limit:.4g}"
            shorter = next((u for u, metres in LENGTH_UNITS.items() if abs(column.value[worst]) * metres <= limit), "1 um")
            way_out = another_unit("angle", "deg") if is_angle else another_unit("length", shorter)
            error = DataError if is_angle else ImplausibleLengthError
            raise data_error(sheet.file, int(sheet.lines[worst]), column.label, message, way_out, error)


def _from_release(channels: list[Channel], notes: ReadingNotes) -> list[Channel]:
    """Return the channels with their clock from the first point on, where it begins elsewhere and the masses rest at first."""
    start = min(float(c.t[0]) for c in channels)
    step = min((c.time_step for c in channels if c.time_step > 0), default=0.0)
    if abs(start) <= 3 * step or step == 0:
        return channels
    for c in channels:
        if len(c) < 5 or c.name == "angle_rate":
            return channels
        way = MAX_START_ACCELERATION[c.unit] * (c.t[2] - c.t[0]) ** 2
        if abs(c.value[2] - c.value[0]) > way + MAX_START_SIGMAS * scatter(c):
            return channels
    notes.assumptions.append(f"the first time, {start:.4g} s, was taken as 0: the masses rest there")
    errors = ((c.stated_error[0] - start, c.stated_error[1]) if c.stated_error else None for c in channels)
    return [replace(c, t=c.t - start, stated_error=error) for c, error in zip(channels, errors, strict=True)]


@dataclass(frozen=True, kw_only=True, eq=False)
class FileSurvey:
    """What a file says of itself, and what is proposed where it is silent."""

    kind: str
    """"positions", "angle", "drop" or "events", as in `observations.KINDS`."""
    tracks: tuple[Track, ...] = ()
    """Tracks in the order of their columns; none if the file has no positions."""
    time_step: float | None = None
    """Typical time between rows [s]; None: it has no times, only numbers of frames."""
    length_unit: str = ""
    """Unit that the header gives for lengths; '' if it gives none."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Proposed units of lengths and times, where the header gives none and they are not m and s."""
    runs: tuple[str, ...] = ()
    """Names of the runs that the file holds."""

    @property
    def masses(self) -> dict[str, str]:
        """Return mass -> name of its track: by the names of the tracks, or by their motion."""
        return propose_masses(self.tracks)

    @property
    def starts_on_the_right(self) -> bool:
        """Return whether the light mass's first point is to the right of the heavy mass's line: the picture is mirrored."""
        x = {mass: track.x for mass, name in self.masses.items() for track in self.tracks if track.name == name}
        has_both = all(len(x.get(mass, ())) for mass in MASSES)
        return has_both and bool(x["light"][0] > np.median(x["heavy"]))


def survey(path: str | Path) -> FileSurvey:
    """Look into a file of measured data.

    Raises
    ------
    DataError
        If it cannot be read as a table of positions, angles, heights or events, or as a project of Tracker.
    """
    return _surveyed(_parsed(path, os.fspath(path)), (), Stated())


def _surveyed(content: DelimitedText, tracks: Sequence[str], stated: Stated) -> FileSurvey:
    """Return what a file says of itself; ``tracks`` are those that are asked for."""
    if is_event_table(content):
        return FileSurvey(kind="events")
    try:
        columns = read_columns(content, stated.kind, tracks, ReadingNotes())
    except DataError:
        # Five columns without names are read if two tracks are asked for
        columns = read_columns(content, stated.kind, MASSES, ReadingNotes())
    objects = tracked_objects(content, columns, stated, ReadingNotes())
    wanted = wanted_roles(stated.kind, objects)
    time_step, units = _proposed_time(content, columns)
    found = tracks_of(objects) if "x" in wanted else []
    length_unit = next((c.unit for thing in objects for c in thing.columns.values() if c.is_length and c.unit), "")
    span = max((value_range(values) for t in found for values in (t.x, t.y)), default=0.0)
    proposed = next((unit for unit, metres in LENGTH_UNITS.items() if span * metres <= PLAUSIBLE_SPAN), "m")
    if not length_unit and proposed != "m":
        units["length"] = proposed
    return FileSurvey(
        kind=next(name for name, roles in ROLES_OF_KIND.items() if set(wanted) <= set(roles)),
        tracks=tuple(found),
        time_step=time_step,
        length_unit=length_unit,
        units=units,
        runs=tuple(dict.fromkeys(c.run for c in columns if c.is_position and c.run)),
    )


def _proposed_time(text: DelimitedText, columns: Sequence[Column]) -> tuple[float | None, dict[str, str]]:
    """Return the typical time between rows [s], None without times, and the unit that times without one most likely have."""
    clock = next((checked(text, c) for c in columns if c.role == "t"), None)
    times = np.empty(0) if clock is None else np.unique(clock.value[clock.has_values])
    is_whole = clock is not None and not clock.unit and len(times) > 1 and not np.any(times % 1)
    # Else perhaps numbers of frames, whatever their name
    if clock is None or (is_whole and not are_milliseconds(times)):
        return None, {}
    units = {"time": "ms"} if not clock.unit and typical_step(times) > MAX_TIME_STEP else {}
    return typical_step(times) * si_factor(text, clock, "s", units), units


def _proposals(
    content: DelimitedText, tracks: Mapping[str, str] | None, stated: Stated, notes: ReadingNotes
) -> tuple[Mapping[str, str], Stated]:
    """Return tracks and what is stated, with what a survey proposes where nothing is."""
    found = _surveyed(content, list((tracks or {}).values()), stated)
    masses = {} if tracks else found.masses
    sizes = {what: unit for what, unit in found.units.items() if what not in stated.units}
    moving = ", ".join(f"{mass} = {quote(name)}" for mass, name in masses.items() if mass_in_name(name) != mass)
    notes.assumptions += [f"by their motion: {moving}"] if moving else []
    notes.assumptions += [f"by their size: {', '.join(f'{what} in {unit}' for what, unit in sizes.items())}"] if sizes else []
    return tracks or masses, replace(stated, units={**sizes, **stated.units})
