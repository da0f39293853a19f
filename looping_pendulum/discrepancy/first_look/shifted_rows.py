"""Columns of a table that stand in other rows than the rest, by the length of the string."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.first_look.declared_trial import DeclaredTrial
from looping_pendulum.discrepancy.first_look.misfit import measured_distance
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.noise import scatter
from looping_pendulum.measured.observations import Channel
from looping_pendulum.reference_ode.geometry import string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters

MIN_ROWS = 12
"""Smallest number of rows in which the string's two ends are compared."""
MAX_SHIFT = 20
"""Largest number of rows by which columns may be shifted that is looked for."""
MIN_ROWS_A_SHIFT = 4
"""Smallest number of rows in a table for each row by which columns may be shifted: enough must remain that are compared."""
MIN_SHIFT_RATIOS = {"heavy": 1.5, "light_x": 4.0, "light_y": 4.0}
"""Columns -> smallest ratio of the mean squares before and after rows are put right at which shifted ones are named.

A single column of the light mass in other rows makes no string at all; errors of the picture do so a little. Of 312 blind
trials with rows as they are, two exceed it, of a push out of the picture's plane. At 240 frames a second and 1.8 mm of noise, a
shift by two rows gives 2 to 2.5, and one by one row 1.3 to 1.7, which is no more than its noise.
"""
CLEAR_SHIFT_RATIO = 4.0
"""The same for a trial in which nothing else looks wrong, as the clock's offset may hide a shift."""
MAX_STRING_SIGMAS = 4.0
"""Largest difference of the string's two ends in one row that counts [standard deviations of the noise]."""
MAX_PICTURE_ERROR = 0.05
"""Usual error of a picture's scale, turn and, in free lengths, place."""


@dataclass(frozen=True, kw_only=True)
class RowShift:
    """Columns of a table that stand in other rows than the rest."""

    columns: str
    """Which: a channel, or "heavy" or "light" for all of a mass's."""
    rows: int
    """By how many rows their points are late; negative: early."""

    @property
    def text(self) -> str:
        """Return what is shifted, and by how much, in words."""
        body, _, axis = self.columns.partition("_")
        what = f"{axis} of the {body} mass" if axis else f"the {body} mass's points"
        plural = "s" if abs(self.rows) > 1 else ""
        return f"{what} {abs(self.rows)} row{plural} {'later' if self.rows > 0 else 'earlier'} than the other columns"


def with_rows_together(declared: DeclaredTrial) -> DeclaredTrial | None:
    """Return the trial with all columns in the same rows, if the string's length says that they are not."""
    shift = row_shift(declared)
    return None if shift is None else without_shift(declared, shift)


def without_shift(declared: DeclaredTrial, shift: RowShift) -> DeclaredTrial:
    """Return the trial, with y up, with columns earlier by so many rows."""

    def earlier(channel: Channel) -> Channel:
        is_shifted = channel.name.startswith(shift.columns)
        return dataclasses.replace(channel, t=channel.t - shift.rows * channel.time_step) if is_shifted else channel

    return declared.upright().with_channels(earlier)


def row_shift(declared: DeclaredTrial, least_ratio: float = 1.0) -> RowShift | None:
    """Return which columns stand in other rows than the rest, by the string's length; None: there are none.

    The free string, what is wound up, and the height of the heavy mass make one length, whatever the forces are.

    Parameters
    ----------
    least_ratio
        Smallest ratio of the mean squares before and after, where it is larger than `MIN_SHIFT_RATIOS`.
    """
    declared = declared.upright()
    channels = {c.name: c for c in declared.observations.channels}
    if not {"light_x", "light_y", "heavy_y"} <= channels.keys() or min(map(len, channels.values())) < MIN_ROWS:
        return None
    noise, parameters = _string_noise(channels), declared.study.parameters({}, declared.trial)
    before = _string_misfit(declared, parameters, noise)
    best, least = None, math.inf
    limit = min(MAX_SHIFT, len(channels["light_x"]) // MIN_ROWS_A_SHIFT)
    for columns, usual_ratio in MIN_SHIFT_RATIOS.items():
        if before <= max(usual_ratio, least_ratio):
            continue
        shifts = [RowShift(columns=columns, rows=n) for n in range(-limit, limit + 1)]
        misfits = [before if not s.rows else _string_misfit(without_shift(declared, s), parameters, noise) for s in shifts]
        at = int(np.argmin(misfits))
        # Far shifts leave few rows, which the terms of the picture fit better than their noise allows
        clear = before > max(usual_ratio, least_ratio) * max(misfits[at], 1.0)
        if shifts[at].rows and 0 < at < len(shifts) - 1 and clear and misfits[at] < least:
            best, least = shifts[at], misfits[at]
    return best


def shifts_by_motion(declared: DeclaredTrial) -> list[RowShift]:
    """Return with which columns in other rows the points are nearest to the declared motion, and those by a row more and less.

    Where columns are shifted far, few rows are left in which the string's two ends can be compared.
    """
    limit = min(MAX_SHIFT, max((len(c) for c in declared.observations.channels), default=0) // MIN_ROWS_A_SHIFT)
    shifts = [RowShift(columns=c, rows=n) for c in ("heavy", "light", *MIN_SHIFT_RATIOS) for n in range(-limit, limit + 1)]
    nearest = min(shifts, key=lambda shift: measured_distance(without_shift(declared, shift)).relative)
    # Before anything is fitted, one row more or less may be nearer
    rows = (nearest.rows + more for more in (0, 1, -1))
    return [dataclasses.replace(nearest, rows=n) for n in rows if n] if nearest.rows else []


def _string_noise(channels: Mapping[str, Channel]) -> float:
    """Return the mean square by which noise alone makes the string's two ends differ [m^2]."""
    x, y, heavy = (scatter(channels[name]) ** 2 for name in ("light_x", "light_y", "heavy_y"))
    return (x + y) / 2 + heavy


def _string_misfit(declared: DeclaredTrial, parameters: Parameters, noise: float) -> float:
    """Return the mean square of what the string's two ends differ by, in that of the noise.

    What scale, turn and place of the picture change is fitted. Large differences count as `MAX_STRING_SIGMAS`: it matters in
    how many rows the ends differ, so that a tracker that slips for some is no shift.
    """
    channels = {c.name: c for c in declared.observations.channels}
    x, y, heavy = (channels[name] for name in ("light_x", "light_y", "heavy_y"))
    camera = Camera(**{name: known.value for name, known in declared.trial.camera.items()})
    inside = (x.t >= max(y.t[0], heavy.t[0])) & (x.t <= min(y.t[-1], heavy.t[-1]))
    t = x.t[inside]
    if len(t) < MIN_ROWS:
        return math.inf
    place = camera.true_position(np.stack([x.value[inside], np.interp(t, y.t, y.value)], axis=1))
    length, angle = string_coordinates(place, parameters.rod_radius, parameters.release_angle)
    wound = length + parameters.rod_radius * angle
    below = camera.true_position(np.stack([np.full(len(t), camera.origin_x), np.interp(t, heavy.t, heavy.value)], axis=1))
    picture = np.stack([*place.T, place[:, 0] ** 2, place[:, 0] * place[:, 1], place[:, 1] ** 2])
    picture /= np.maximum(length, 0.1 * parameters.free_length)
    design = np.stack([np.ones(len(t)), below[:, 1], *picture], axis=1)
    # A picture is known about; without these limits far shifts would be made good by it
    usual = np.array([parameters.free_length, 1.0, *np.zeros(5)])
    limits = np.array([parameters.free_length, *([MAX_PICTURE_ERROR] * 6)]) * [1, 1, *([parameters.free_length] * 2), 1, 1, 1]
    rest = np.concatenate([(wound - design @ usual) / math.sqrt(noise), np.zeros(len(usual))])
    change = np.linalg.lstsq(np.concatenate([design / math.sqrt(noise), np.diag(1 / limits)]), rest, rcond=None)[0]
    difference = wound - design @ (usual + change)
    return float(np.mean(np.minimum(difference**2 / noise, MAX_STRING_SIGMAS**2)))
