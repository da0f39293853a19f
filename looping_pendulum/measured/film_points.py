"""Read the points of a film where a study takes a table: from the table beside it, or by tracking it now."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from looping_pendulum.measured.observations import DataError, Observations

if TYPE_CHECKING:
    from looping_pendulum.measured.study import Trial

FALLBACK_ROD_RADIUS = 5e-3
"""Radius of a rod that the study does not state [m]; an error of a millimetre moves the scale by a fifth of a percent."""


def read_film(film: Path, trial: Trial, rod_radius: float | None, read: Callable[[Path], Observations]) -> Observations:
    """Read the points of a film, and what is known of its camera.

    Parameters
    ----------
    rod_radius
        Of the rod [m]; None: not known.
    read
        Reads a table.

    Raises
    ------
    DataError
        If the film cannot be tracked.
    """
    # Here, as OpenCV takes a while to import, and no other study needs it
    from looping_pendulum.errors import HarnessError
    from looping_pendulum.film import output
    from looping_pendulum.film.track import TrackSettings, track

    files = output.files_of(film)
    if not output.is_newer(files, film):
        length = trial.estimates.get("free_length")
        settings = TrackSettings(
            free_length=None if length is None else length.value,
            free_length_error=0.0 if length is None or length.sigma is None else length.sigma,
            rod_radius=rod_radius or FALLBACK_ROD_RADIUS,
            frame_rate=trial.frame_rate,
        )
        try:
            output.refuse_foreign_table(files)
            output.write(track(film, settings), files)
        except HarnessError as error:
            raise DataError(str(error)) from None
    points = read(files.table)
    assumption = f"the film's points were read from {files.table.name}; {files.sheet.name} shows the marks on it"
    return replace(
        points,
        assumptions=(*points.assumptions, assumption),
        camera_errors={**points.camera_errors, **output.camera_errors(files)},
    )
