"""Look into a file of tracked points before anything is known of it: which tracks, rows per second and units it has.

`readers.read` needs to know which track is which mass, and in which unit; here the file says it, or the motion proposes it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from looping_pendulum.measured.clock import MAX_TIME_STEP
from looping_pendulum.measured.columns import PIXELS, read_columns
from looping_pendulum.measured.delimited import read_text
from looping_pendulum.measured.events import is_event_table
from looping_pendulum.measured.observations import DataError, ReadingNotes, Track, value_range
from looping_pendulum.measured.readers import MASSES, numbers, propose_masses, read_content, tracks_of
from looping_pendulum.measured.tracker_project import is_named_project, is_project, read_project
from looping_pendulum.reference_ode.geometry import Array

UNNAMED_TRACKS = {"light": "first", "heavy": "second"}
"""Names for the two tracks of a file without names of columns, in the order of its columns."""
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


def survey(path: str | Path) -> FileSurvey:
    """Look into a file of measured data.

    Raises
    ------
    DataError
        If it cannot be read as a table of positions, angles, heights or events, or as a project of Tracker.
    """
    file = os.fspath(path)
    raw = read_content(path, file)
    if is_named_project(file) or is_project(raw):
        project = read_project(raw, file)
        return FileSurvey(
            file=file,
            kind="positions",
            tracks=project.tracks,
            time_step=_typical_step(np.concatenate([project.frame_time[t.frame] for t in project.tracks])),
            length_unit="" if project.length_unit in PIXELS else project.length_unit,
            time_unit="s",
        )
    text = read_text(raw, file)
    if is_event_table(text):
        return FileSurvey(file=file, kind="events")
    has_names = True
    try:
        columns = read_columns(text, "auto", (), ReadingNotes())
    except DataError:
        # Five columns without names are read if both tracks get names from outside
        columns = read_columns(text, "auto", tuple(UNNAMED_TRACKS.values()), ReadingNotes())
        has_names = False
    roles = {c.role for c in columns}
    clock = next((c for c in columns if c.role == "t"), None)
    times = None if clock is None else numbers(text, clock)[0]
    return FileSurvey(
        file=file,
        kind="positions" if roles & {"x", "y"} else "drop" if "height" in roles else "angle",
        tracks=tuple(tracks_of(text, columns)),
        has_names=has_names,
        time_step=None if times is None else _typical_step(times[np.isfinite(times)]),
        length_unit=next((c.unit for c in columns if c.role in ("x", "y", "height") and c.unit), ""),
        time_unit=clock.unit if clock else "",
        runs=tuple(dict.fromkeys(c.run for c in columns if c.is_position and c.run)),
    )


def _typical_step(times: Array) -> float:
    """Return the median step of times; 0 with fewer than two."""
    steps = np.diff(np.unique(times))
    return float(np.median(steps)) if len(steps) else 0.0
