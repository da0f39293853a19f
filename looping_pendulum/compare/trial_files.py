"""Read the files of one trial for a comparison: every form that a study's trial may have, as points since the release.

The camera is taken at its word and undone, never fitted: `identify` fits it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.compare.trial import MeasuredTrack, MeasuredTrial
from looping_pendulum.errors import ScenarioError
from looping_pendulum.measured import study_io
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.edits import read_trial, until_end
from looping_pendulum.measured.observations import Channel, DataError, Observations
from looping_pendulum.measured.study import Trial, read_files
from looping_pendulum.measured.tables.events import MeasuredEventRow
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.runs.trajectory import SAME_TIME
from looping_pendulum.scenarios.document import Document, quote
from looping_pendulum.scenarios.fields import suggest

OPTION = "--marks-set"
"""Option of the command line by which a user gives the keys of a trial."""
KEYS = (
    "name",
    "kind",
    "frame_rate",
    "clip_rate",
    "tracks",
    "units",
    "plane",
    "box",
    "run",
    "dropped",
    "mirrored",
    "camera",
)
"""Keys of a study's trial that say how its files are read."""
STUDY_SUFFIXES = (".yaml", ".yml")


def read_measured_trial(files: Sequence[str], settings: Sequence[str] = ()) -> MeasuredTrial:
    """Read one trial.

    Parameters
    ----------
    files
        Files of tracked points or events, each for both masses or, as "light=FILE" or "heavy=FILE", for one; or one study
        file, of which one trial is taken.
    settings
        Keys of a study's trial, `KEYS`, as "tracks.light=mass A"; of a study only "name=TRIAL".

    Raises
    ------
    DataError, ScenarioError, StudyError
        In one line, if a file or a setting cannot be used.
    """
    given = settings_by_key(settings, OPTION, KEYS)
    if any(Path(file).suffix.lower() in STUDY_SUFFIXES for file in files):
        return _trial_of_study(files, given)
    trial = trial_of_files(files, given, OPTION)
    try:
        return measured_trial(trial, read_files(Path(), trial))
    except DataError as error:
        raise DataError(error.on_command_line(OPTION)) from None


def measured_trial(trial: Trial, observations: Observations) -> MeasuredTrial:
    """Return what was measured in a trial: the masses' true positions by its camera's stated values, and its events."""
    camera = Camera(**{name: estimate.value for name, estimate in trial.camera.items()})
    channels = {c.name: c for c in observations.channels}
    tracks, late = [], 0
    for name, track_channels, t, values in _tracks(channels, camera, trial.dropped):
        kept = t > -SAME_TIME  # a clock offset may round the release itself to just before it
        late += int(np.sum(~kept))
        if kept.any():
            tracks.append(
                MeasuredTrack(
                    name=name,
                    channels=track_channels,
                    unit="rad" if "wrap_angle" in track_channels else "m",
                    t=tuple(np.maximum(t[kept], 0.0).tolist()),
                    values=tuple(tuple(v[kept].tolist()) for v in values),
                    level_unknown="heavy_y" in track_channels or "height" in channels,
                )
            )
    if not tracks and not observations.events:
        way_out = f"say when it was by {OPTION} camera.clock_offset"
        raise DataError(f"{observations.file}: found no point after the release, needed some; {way_out}")
    left_out = [f"{late} points before the release are left out."] if late else []
    notes = [f"{observations.summary()}.", *(f"{a[0].upper()}{a[1:]}." for a in observations.assumptions), *left_out]
    return MeasuredTrial(
        name=observations.name,
        source=observations.file,
        tracks=tuple(tracks),
        rows=tuple(
            MeasuredEventRow(
                quantity=e.quantity, index=e.index, measured=e.value, paper_numerical=None, unit=e.unit, sigma=e.sigma
            )
            for e in observations.events
        ),
        notes=tuple(notes),
        clock_offset=camera.clock_offset,
        origin=(camera.origin_x, camera.origin_y),
    )


_Track = tuple[str, tuple[str, ...], Array, list[Array]]
"""Name, channels, true times [s] and true values [SI] of a track."""


def _tracks(channels: dict[str, Channel], camera: Camera, dropped: str) -> list[_Track]:
    """Return every track of a trial."""
    found: list[_Track] = []
    for mass in ("light", "heavy"):
        x, y = channels.get(f"{mass}_x"), channels.get(f"{mass}_y")
        if x is not None and y is not None:
            t, in_x, in_y = np.intersect1d(x.t, y.t, return_indices=True)
            position = camera.true_position(np.stack([x.value[in_x], y.value[in_y]], axis=1))
            found.append((f"{mass} mass", (x.name, y.name), camera.true_time(t), list(position.T)))
        elif x is not None or y is not None:
            # Without the other coordinate, a tilted or oblique view cannot be undone
            only = x or y
            assert only is not None
            origin = camera.origin_x if only is x else camera.origin_y
            values = (only.value - origin) / camera.scale
            found.append((f"{mass} mass", (only.name,), camera.true_time(only.t), [values]))
    if "height" in channels:
        height = channels["height"]
        values = (height.value - camera.origin_y) / camera.scale
        found.append((f"{dropped} mass", (f"{dropped}_y",), camera.true_time(height.t), [values]))
    if "angle" in channels:
        angle = channels["angle"]
        found.append(("wrap angle", ("wrap_angle",), camera.true_time(angle.t), [angle.value + np.pi - camera.tilt]))
    return found


def settings_by_key(settings: Sequence[str], option: str, keys: Sequence[str]) -> dict[str, str]:
    """Return key -> value of the settings KEY=VALUE that ``option`` takes; ``keys`` are those of a study's trial that may be.

    Raises
    ------
    DataError
        If one is none.
    """
    given = {}
    for text in settings:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not (key and equals and value):
            message = f"{option}: found {quote(text)}, needed KEY=VALUE; write for example 'frame_rate=240 Hz'"
            raise DataError(message)
        if key.partition(".")[0] not in keys:
            message = f"{option}: found the key {quote(key)}, needed one of: {', '.join(keys)}{suggest(key, keys)}"
            raise DataError(message)
        given[key] = value
    return given


def trial_of_files(files: Sequence[str], given: Mapping[str, str], option: str) -> Trial:
    """Return the trial that the files and settings of a command line describe, checked as a study's.

    Raises
    ------
    DataError
        If a setting cannot be used.
    """
    entry: dict[str, Any] = {}
    for key, value in given.items():
        group, dot, inner = key.partition(".")
        if dot:
            entry.setdefault(group, {})[inner] = value
        else:
            entry[group] = value
    of_mass = [file.partition("=") for file in files if file.startswith(("light=", "heavy="))]
    whole = [file for file in files if not file.startswith(("light=", "heavy="))]
    named: tuple[tuple[str, dict[str, str]], ...] = tuple((path, {mass: ""}) for mass, _, path in of_mass)
    paths = [path for path, _ in named] + whole
    entry = {"name": Path(paths[0]).stem, "file": paths[0]} | entry
    doc = Document(file=option, data={"title": "trial", "trials": [entry]}, lines={}, text="")
    try:
        trial = study_io.trial_of(doc)
    except ScenarioError as error:
        raise DataError(str(doc.error(error.path[2:], error.problem))) from None  # without the list of trials
    tracks = trial.files[0][1] if entry.get("tracks") else {}
    return replace(trial, files=(*named, *((file, tracks) for file in whole)))


def _trial_of_study(files: Sequence[str], given: dict[str, str]) -> MeasuredTrial:
    """Read a trial of a study file, which says itself how its files are read."""
    if len(files) > 1 or set(given) - {"name"}:
        raise DataError(
            f"--marks: found a study file beside other files or settings, needed it alone, or with {OPTION} name=TRIAL; "
            "write the rest into the study"
        )
    study = study_io.load(files[0])
    names = [trial.name for trial in study.trials]
    name = given.get("name", names[0] if len(names) == 1 else "")
    if name not in names:
        what = f"no trial {quote(name)} among" if name else "the trials"
        raise DataError(f"{files[0]}: found {what} {', '.join(names)}, needed one of them; choose by {OPTION} name={names[0]}")
    trial = study.trial(name)
    return measured_trial(trial, until_end(study, trial, read_trial(study, trial), {}))
