"""Mistakes of a film's clock that the points show: a clock that changes in the film, and rows of one mass that are shifted."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.data.camera import Camera
from looping_pendulum.discrepancy.data.noise import scatter
from looping_pendulum.discrepancy.data.observations import Channel
from looping_pendulum.discrepancy.first_look.declared_trial import DeclaredTrial
from looping_pendulum.reference_ode.geometry import Array, string_coordinates

SPEED_STEPS = 3
"""Number of steps before and after a row whose speeds are compared."""
MIN_CLOCK_FACTOR = 1.5
"""Smallest factor by which a clock is said to change: a phone's slow motion is 2 to 16 times slower."""
MAX_CHANGES = 4
"""Largest number of rows, those of the greatest changes of speed, at which a clock may have changed."""
MAX_CLOCK_CANDIDATES = 24
"""Largest number of changes of the clock that are tried."""
MAX_SHIFT = 20
"""Largest number of rows by which columns may be shifted that is looked for."""
MIN_SHIFT_RATIOS = {"heavy": 1.5, "light_x": 4.0, "light_y": 4.0}
"""Columns -> smallest ratio of the mean squares before and after rows are put right at which shifted ones are named.

A single column of the light mass in other rows makes no string at all; errors of the picture do so a little. Of 312 blind
trials with rows as they are, two exceed it, of a push out of the picture's plane. At 240 frames a second and 1.8 mm of noise, a
shift by two rows gives 2 to 2.5, and one by one row 1.3 to 1.7, which is no more than its noise.
"""
CLEAR_SHIFT_RATIO = 4.0
"""The same for a trial in which nothing else looks wrong, as the clock's offset may hide a shift."""
MAX_STRING_ERROR = 0.01
"""Largest scatter of the string's length about its mean, in free lengths, with which shifted rows are named.

Beyond it the points show no taut string, and something else is wrong.
"""


def with_one_clock(declared: DeclaredTrial, candidate: int) -> DeclaredTrial | None:
    """Return the trial with one clock for the whole film, where the masses' speeds say that it changes in it.

    Parameters
    ----------
    candidate
        Which of the likely changes, from 0.

    None: there are not so many.
    """
    changes = _changes_of_speed(declared)
    spans = [(t, math.inf, factor) for t, factor in changes]
    spans += [
        (start, end, math.sqrt(factor / back))
        for start, factor in changes
        for end, back in changes
        if start < end and 0.5 < factor * back < 2
    ]
    # Twice or half as many frames a second, rather than what noise makes of it
    usual = [(start, end, 2.0 ** near(math.log2(factor))) for start, end, factor in spans for near in (math.floor, math.ceil)]
    corrections = [(*span, is_inner) for span in dict.fromkeys(usual) for is_inner in (True, False) if span[2] != 1]
    if candidate >= len(corrections):
        return None
    start, end, factor, is_inner = corrections[candidate]

    def one_clock(t: Array) -> Array:
        inside = np.clip(t, start, end) - start
        return np.asarray((t - inside) + inside * factor if is_inner else (t - inside) / factor + inside)

    return declared.with_channels(lambda c: dataclasses.replace(c, t=one_clock(c.t)))


def clock_change_text(declared: DeclaredTrial, corrected: DeclaredTrial) -> str:
    """Return when the clock changes and how, in words."""
    before, after = (max(each.observations.channels, key=len).t for each in (declared, corrected))
    factor = np.diff(after) / np.diff(before)
    at = np.flatnonzero(np.abs(np.diff(factor)) > 0.1 * factor[:-1])
    ratios = [float(factor[k + 1] / factor[k]) for k in at]
    in_words = (f"{r:.3g} times" if r > 1 else f"1/{1 / r:.3g}" for r in ratios)
    return " and ".join(
        f"from {before[k + 1]:.3g} s on a row lasts {words} as long" for k, words in zip(at, in_words, strict=True)
    )


def _changes_of_speed(declared: DeclaredTrial) -> list[tuple[float, float]]:
    """Return times at which all masses' speeds change by one factor from one row to the next, and the factors."""
    moving = [c for c in declared.observations.channels if c.name != "angle_rate"]
    if not moving or max(map(len, moving)) < 4 * SPEED_STEPS:
        return []
    t = max(moving, key=len).t
    rates = np.stack([np.diff(np.interp(t, c.t, c.value)) / np.diff(t) for c in moving], axis=1)
    found = []
    for k in range(SPEED_STEPS, len(rates) - SPEED_STEPS + 1):
        before, after = rates[k - SPEED_STEPS : k].mean(axis=0), rates[k : k + SPEED_STEPS].mean(axis=0)
        product = float(before @ after)
        if product > 0.8 * float(np.linalg.norm(before) * np.linalg.norm(after)):
            factor = float(np.linalg.norm(after) / np.linalg.norm(before))
            found.append((abs(math.log(factor)), float(t[k]), factor))
    chosen: list[tuple[float, float]] = []
    for size, at, factor in sorted(found, reverse=True):
        far = all(abs(at - other) > SPEED_STEPS * float(np.median(np.diff(t))) for other, _ in chosen)
        if size > math.log(MIN_CLOCK_FACTOR) and far and len(chosen) < MAX_CHANGES:
            chosen.append((at, factor))
    return sorted(chosen)


@dataclass(frozen=True, kw_only=True)
class RowShift:
    """Columns of a table that stand in other rows than the rest."""

    columns: str
    """Which: a channel, or "heavy" for all of the heavy mass's."""
    rows: int
    """By how many rows their points are late; negative: early."""

    @property
    def text(self) -> str:
        """Return what is shifted, and by how much, in words."""
        what = "the heavy mass's points" if self.columns == "heavy" else f"{self.columns[-1]} of the light mass"
        plural = "s" if abs(self.rows) > 1 else ""
        return f"{what} {abs(self.rows)} row{plural} {'later' if self.rows > 0 else 'earlier'} than the other columns"


def with_rows_together(declared: DeclaredTrial) -> DeclaredTrial | None:
    """Return the trial with all columns in the same rows, if the string's length says that they are not."""
    shift = row_shift(declared)
    return None if shift is None else _shifted(declared.upright(), shift)


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
    if not {"light_x", "light_y", "heavy_y"} <= channels.keys() or min(map(len, channels.values())) < 4 * SPEED_STEPS:
        return None
    before, noise = _string_misfit(declared), _string_noise(channels)
    best, least = None, math.inf
    limit = min(MAX_SHIFT, len(channels["light_x"]) // 10)
    for columns, usual_ratio in MIN_SHIFT_RATIOS.items():
        shifts = [RowShift(columns=columns, rows=n) for n in range(-limit, limit + 1)]
        misfits = [before if not s.rows else _string_misfit(_shifted(declared, s)) for s in shifts]
        at = int(np.argmin(misfits))
        # Far shifts leave few rows, which the terms of the picture fit better than their noise allows
        clear = before > max(usual_ratio, least_ratio) * max(misfits[at], noise)
        if shifts[at].rows and 0 < at < len(shifts) - 1 and clear and misfits[at] < least:
            best, least = shifts[at], misfits[at]
    free_length = declared.study.parameters({}, declared.trial).free_length
    if best is None or math.sqrt(least) > MAX_STRING_ERROR * free_length:
        return None
    return best


def _shifted(declared: DeclaredTrial, shift: RowShift) -> DeclaredTrial:
    """Return the trial with columns earlier by so many rows."""

    def earlier(channel: Channel) -> Channel:
        is_shifted = channel.name.startswith(shift.columns)
        return dataclasses.replace(channel, t=channel.t - shift.rows * channel.time_step) if is_shifted else channel

    return declared.with_channels(earlier)


def _string_noise(channels: Mapping[str, Channel]) -> float:
    """Return the mean square by which noise alone makes the string's two ends differ [m^2]."""
    x, y, heavy = (scatter(channels[name]) ** 2 for name in ("light_x", "light_y", "heavy_y"))
    return (x + y) / 2 + heavy


def _string_misfit(declared: DeclaredTrial) -> float:
    """Return the mean square of what the string's two ends differ by [m^2].

    What scale, turn and place of the picture change is fitted; large differences count less, as of outliers.
    """
    channels = {c.name: c for c in declared.observations.channels}
    x, y, heavy = (channels[name] for name in ("light_x", "light_y", "heavy_y"))
    camera = Camera(**{name: known.value for name, known in declared.trial.camera.items()})
    parameters = declared.study.parameters({}, declared.trial)
    inside = (x.t >= max(y.t[0], heavy.t[0])) & (x.t <= min(y.t[-1], heavy.t[-1]))
    t = x.t[inside]
    if len(t) < 4 * SPEED_STEPS:
        return math.inf
    place = camera.true_position(np.stack([x.value[inside], np.interp(t, y.t, y.value)], axis=1))
    length, angle = string_coordinates(place, parameters.rod_radius, parameters.release_angle)
    wound = length + parameters.rod_radius * angle
    below = camera.true_position(np.stack([np.full(len(t), camera.origin_x), np.interp(t, heavy.t, heavy.value)], axis=1))
    picture = np.stack([*place.T, place[:, 0] ** 2, place[:, 0] * place[:, 1], place[:, 1] ** 2])
    picture /= np.maximum(length, 0.1 * parameters.free_length)
    design = np.stack([np.ones(len(t)), below[:, 1], *picture], axis=1)
    difference = wound - design @ np.linalg.lstsq(design, wound, rcond=None)[0]
    limit = 3 * 1.4826 * float(np.median(np.abs(difference)))
    return float(np.mean(np.minimum(difference**2, limit**2)))
