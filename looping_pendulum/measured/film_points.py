"""Points of films as `Observations`: reading takes the record beside a film and never tracks; tracking is asked for."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from looping_pendulum.errors import HarnessError
from looping_pendulum.files import read_file
from looping_pendulum.installation import command_line
from looping_pendulum.measured.film.record import FilmTrack, TrackSettings, files_of, read_record
from looping_pendulum.measured.observations import DataError, Observations
from looping_pendulum.scenarios.units import show

if TYPE_CHECKING:
    from looping_pendulum.processes import ReportShare

OPTIONS = {"free_length": "m", "rod_radius": "m", "frame_rate": "Hz", "first": "s", "last": "s", "readout": "s"}
"""Field of `TrackSettings` that is a quantity -> its SI unit."""
MAX_RECORD_SIZE = 64 * 1024**2
"""Largest record that is read [bytes]: one of ten minutes at 240 Hz has 40 million."""


class TrackingNeededError(DataError):
    """A film has no points with what is stated; the message says why, and what to type."""


def track(film: str | Path, *, progress: ReportShare | None = None, **known: Any) -> Observations:
    """Track the masses of a film and return their points; nothing is written.

    Parameters
    ----------
    progress
        Called with what is being done, and the share of it that is done.
    **known
        What is known of the film, in SI units: fields of `looping_pendulum.measured.film.record.TrackSettings`, such as
        ``free_length=0.58`` (string from the rod to the light mass at the release [m]), ``free_length_error``, ``rod_radius``
        and ``frame_rate``.

    Raises
    ------
    FilmError
        If the film cannot be read, or the masses are not found in it beyond doubt.
    """
    # Here, as OpenCV takes a while to import, and reading needs none
    from looping_pendulum.measured.film.track import track

    return track(film, TrackSettings(**known), progress).observations(Path(film).stem)


def read_film(film: Path, stated: Mapping[str, float], name: str) -> Observations:
    """Return the points of a study's film, as its last tracking left them beside it.

    Parameters
    ----------
    stated
        Fields of `TrackSettings` that the study states, in SI units.
    name
        Name of the trial.

    Raises
    ------
    TrackingNeededError
        If there are none, or if the film was tracked with other values.
    """
    found, files = read_track(film, stated), files_of(film)
    note = f"the film's points are those of its tracking; {files.sheet.name} shows the marks on it"
    # The record is written after the table
    if files.table.exists() and files.table.stat().st_mtime_ns > files.record.stat().st_mtime_ns:
        note += f"; {files.table.name} was changed since: name it in place of the film if it is what counts"
    return found.observations(name, note)


def read_track(film: Path, stated: Mapping[str, float]) -> FilmTrack:
    """Return what the last tracking of a film found, if it was tracked with what is stated.

    Raises
    ------
    TrackingNeededError
        As `read_film` does.
    """
    found, why = _stored(film)
    if found is None and not film.exists():
        raise TrackingNeededError(f"{film}: {why}, needed a film; correct the path")
    settings = TrackSettings() if found is None else found.settings
    differing = [] if found is None else found.stated_otherwise(stated)
    if found is not None and not differing:
        return found
    why = why or "; ".join(
        f"{name.replace('_', ' ')}: tracked with {_shown(name, getattr(settings, name))}, now {_shown(name, stated[name])}"
        for name in differing
    )
    again = " again" if differing else ""
    raise TrackingNeededError(f"{film}: {why}; track it{again}: {_command(film, stated, settings)}")


def settle_film(film: Path, stated: Mapping[str, float], *, track: bool, progress: ReportShare | None = None) -> FilmTrack:
    """Return what tracking found in a film, as a command asks for it, and leave it beside the film for those that follow.

    Parameters
    ----------
    track
        Whether to track a film that has no points, or was tracked with other values than the stated ones.

    Raises
    ------
    TrackingNeededError
        As `read_track` does, where it is not asked for, or the film is not there.
    DataError
        If the film cannot be tracked.
    """
    try:
        return read_track(film, stated)
    except TrackingNeededError as error:
        if not film.exists():
            raise
        if not track:
            raise TrackingNeededError(f"{error}, or add --track") from None
    from looping_pendulum.measured.film.output import track_and_write

    found, _ = _stored(film)
    # What a person has shown in the film stays
    settings = (TrackSettings() if found is None else found.settings).with_stated(stated)
    try:
        return track_and_write(film, settings, files_of(film), progress)[0]
    except HarnessError as error:
        raise DataError(str(error)) from None


def _stored(film: Path) -> tuple[FilmTrack | None, str]:
    """Return the record beside a film, or None and why it cannot be taken."""
    record = files_of(film).record
    try:
        filmed = film.stat().st_mtime_ns
    except OSError:
        return None, "found no such file"
    try:
        raw = read_file(record, MAX_RECORD_SIZE)
        if record.stat().st_mtime_ns < filmed:
            return None, "found a film that is newer than the points beside it"
        if len(raw) > MAX_RECORD_SIZE:
            raise OSError(f"{record} is no record")
        return dataclasses.replace(read_record(raw), path=str(film)), ""
    except FileNotFoundError:
        return None, "found no points beside it, as it was not tracked yet"
    # Whoever changed or cut the record, tracking the film again puts it right
    except (OSError, ValueError):
        return None, f"found {record.name} changed or not complete"


def _shown(name: str, value: float | None) -> str:
    """Return a setting [SI] with a usual unit."""
    return show(value, OPTIONS[name.removesuffix("_error")]) if value else "none"


def _command(film: Path, stated: Mapping[str, float], settings: TrackSettings) -> str:
    """Return the command that tracks a film with what is stated, and with what a person has shown in it before."""
    now = settings.with_stated(stated)
    words: list[str] = []
    for name in OPTIONS:
        value, error = getattr(now, name), getattr(now, f"{name}_error", 0.0)
        if name in stated or error or value != getattr(TrackSettings(), name):
            option = {"first": "from", "last": "to"}.get(name, name.replace("_", "-"))
            words += [f"--{option}", _shown(name, value) + (f" +/- {_shown(f'{name}_error', error)}" if error else "")]
    for option, mass in (("--light", now.light), ("--heavy", now.heavy)):
        words += [] if mass is None else [option, f"{mass.x:g},{mass.y:g}@{mass.frame}"]
    words += [] if now.rod is None else ["--rod", "{:g},{:g}".format(*now.rod)]
    words += [] if now.region is None else ["--region", "{},{} {},{}".format(*now.region)]
    if now.scale is not None:
        words += ["--scale", "{:g},{:g} {:g},{:g} = {:g} m".format(*now.scale.start, *now.scale.end, now.scale.length)]
    words += ["--still"] if now.still else []
    return command_line("track", film, *words)
