"""Points of a film straight into `Observations`, with the errors and the times that the tracker and the decoder know."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.observations import Channel, DataError, Observations, UnusedValues

if TYPE_CHECKING:
    from looping_pendulum.processes import ReportShare


def track(film: str | Path, *, progress: ReportShare | None = None, **known: Any) -> Observations:
    """Track the masses of a film and return their points; nothing is written.

    Parameters
    ----------
    progress
        Called with what is being done, and the share of it that is done.
    **known
        What is known of the film, in SI units: fields of `looping_pendulum.film.track.TrackSettings`, such as
        ``free_length=0.58`` (string from the rod to the light mass at the release [m]), ``free_length_error``, ``rod_radius``
        and ``frame_rate``.

    Raises
    ------
    FilmError
        If the film cannot be read, or the masses are not found in it beyond doubt.
    """
    from looping_pendulum.film import output
    from looping_pendulum.film.track import TrackSettings, track

    return _observations(output.facts(track(film, TrackSettings(**known), progress)), Path(film).stem, str(film))


def read_film(film: Path, stated: Mapping[str, Any], name: str, progress: ReportShare | None = None) -> Observations:
    """Return the points of a study's film: those of its last tracking, or of one that is done now.

    Tracking writes its facts beside the film; they are taken as long as they are newer and what is stated has not changed.

    Parameters
    ----------
    stated
        Fields of `TrackSettings` that the study states, in SI units.
    name
        Name of the trial.

    Raises
    ------
    DataError
        If the film cannot be tracked.
    """
    # Here, as OpenCV takes a while to import, and no other study needs it
    from looping_pendulum.film import output

    files = output.files_of(film)
    facts = facts_of_film(film, stated, progress)
    note = f"the film's points are those of its tracking; {files.sheet.name} shows the marks on it"
    if output.is_edited(files):
        note += f"; {files.table.name} was changed since: name it in place of the film if it is what counts"
    return _observations(facts, name, str(film), note)


def facts_of_film(film: Path, stated: Mapping[str, Any], progress: ReportShare | None = None) -> dict[str, Any]:
    """Return `looping_pendulum.film.output.facts` of a film, as `read_film` takes them.

    Raises
    ------
    DataError
        If the film cannot be tracked.
    """
    from looping_pendulum.film import output

    files = output.files_of(film)
    stored = output.stored_facts(files, film, stated)
    if stored is not None:
        return stored
    # What a person has shown in the film stays
    settings = dataclasses.replace(output.stored_settings(files), **stated)
    try:
        found, _ = output.track_and_write(film, settings, files, progress)
    except HarnessError as error:
        raise DataError(str(error)) from None
    return output.facts(found)


def _observations(facts: Mapping[str, Any], name: str, film: str, *notes: str) -> Observations:
    channels = []
    for mass, points in facts["points"].items():
        t = np.array(points["t"])
        for axis in ("x", "y"):
            error = np.array(points[f"{axis}_error"])
            value = np.array(points[axis])
            channel = f"{mass}_{axis}"
            channels.append(Channel(name=channel, t=t, value=value, column=channel, stated_error=(t, error)))
    return Observations(
        name=name,
        file=film,
        channels=tuple(channels),
        unused=tuple(UnusedValues(count=count, reason=reason) for reason, count in facts["skipped"].items() if count),
        assumptions=notes,
        camera_errors=facts["camera_errors"],
        light_radius=(facts["points"]["light"]["radius"], facts["points"]["light"]["radius_error"]),
    )
