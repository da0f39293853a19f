"""How long each step from row to row lasted, by how far the masses moved in it: repeated, lost and uneven pictures.

A mass moves about as far in each step as in those around it. In a picture that is stored again it has not moved, after lost
pictures it has moved twice as far or farther, and where frames last 3.3 and 5 ms in turn, its ways are in that ratio, too. No
model of the motion is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.data.noise import GAUSSIAN_MAD, scatter
from looping_pendulum.discrepancy.data.observations import BODIES, Channel, ReadingNotes
from looping_pendulum.reference_ode.geometry import Array

WINDOWS = (3, 6)
"""Number of steps before and after a step with which it is compared: the longer one holds all patterns of pictures whole, but
with few frames a second the masses turn in it.
"""
MAX_ERROR = 0.2
"""Largest error of a step's duration by the noise, in the mean duration, with which it counts for a pattern."""
MIN_STEPS = 12
"""Smallest number of such steps from which a pattern is told."""
MIN_SIGMAS = 5.0
"""Standard errors by which the duration of a single step, or that at a place of a pattern, must differ from the mean."""
COPY, LOST = 0.35, 1.7
"""Duration of a step below which a picture is stored again, and above which pictures are lost before it."""
MIN_ALONG = 0.95
"""Smallest cosine of the angle between a long way and those around it: a tracker that slips goes another way than the mass."""
REST = 0.15
"""Duration of a step below which both masses rest, whatever the steps around are, and twice its largest error."""
MAX_USUAL = 0.2
"""Largest distance from 1 of the durations of the steps beside such a one: where masses turn fast, all are uneven."""
MAX_PERIOD = 6
"""Longest pattern of repeated or uneven frames [frames]."""
MIN_UNEVEN = 0.08
"""Smallest difference of the durations of frames in turn that is named: at 240 a second, a third of a millisecond."""
MAX_CHANCE_DIGIT = 0.2
"""Last digit, in standard deviations of the noise, up to which equal points are no chance but copies."""
MIN_COPIES = 3
"""Smallest number of points that are equal to the one before of which any is taken for a copy."""
MIN_NOISE = 5e-5
"""Smallest noise, as a part of the range of the values, in which a copy tells anything: made-up data have none."""


def without_copies(channels: Sequence[Channel], notes: ReadingNotes) -> list[Channel]:
    """Return the channels without pictures that are stored again: every picture as often, or single ones with equal points.

    A copy has no noise of its own, so that it would count twice in a fit.
    """
    found = ((steps, _pattern_of_copies(steps)) for window in WINDOWS if (steps := _durations(channels, window)))
    steps, pattern = next(((steps, pattern) for steps, pattern in found if pattern is not None), (None, None))
    if steps is None or pattern is None:
        return [c for body in _by_body(channels) for c in _without_equal_points(body, notes)]
    period, new = len(pattern), int(pattern.sum())
    first = int(np.argmax(pattern))
    by_file, even = [], []
    for c in channels:
        number = steps.number_of(c.t)
        kept = pattern[number % period]
        rank = (np.cumsum(pattern)[number % period] - 1 + new * (number // period))[kept]
        by_file.append(replace(c, t=c.t[kept], value=c.value[kept]))
        # A camera's pictures are even in time, which a film shows twice and three times in turn
        even.append(replace(by_file[-1], t=steps.t[0] + (first + rank * period / new) * steps.step))
    chosen = min((by_file, even), key=lambda those: sum(scatter(c) for c in those))
    every = f"every picture is stored {period} times" if new == 1 else f"{period} rows show {new} pictures"
    rows = f"{len(max(chosen, key=len))} of {len(max(channels, key=len))}"
    notes.assumptions.append(f"{every}: one row of each is kept, {rows}")
    return chosen


def clock_faults(channels: Sequence[Channel]) -> list[str]:
    """Return what the points say against the times: lost, repeated and uneven pictures, which cannot be put right."""
    steps, usual = (_durations(channels, WINDOWS[0], typical) for typical in (np.nanmean, np.nanmedian))
    if steps is None or usual is None:
        return []
    way_out = "export the film's own frame times, or its frame numbers"
    faults = []
    # Points of fast masses scatter more than others
    scores = np.abs(usual.ratio - 1)[usual.error < MAX_ERROR] / usual.error[usual.error < MAX_ERROR]
    widening = max(1.0, GAUSSIAN_MAD * float(np.median(scores))) if len(scores) else 1.0
    # Two masses do not rest at once for a single step, while a pendulum's points may lie on both sides of its turning point
    rests = (usual.ratio < REST) & (usual.error < REST / 2)
    rests[1:-1] &= (usual.ratio[:-2] > 0.5) & (usual.ratio[2:] > 0.5)
    copied = rests & ({c.name.partition("_")[0] for c in channels} >= {"light", "heavy"})
    for jump, what in (
        (
            (usual.ratio > LOST) & (usual.along > MIN_ALONG),
            "the masses move as far as in {} steps, so that pictures are lost there",
        ),
        (usual.ratio < COPY, "the masses do not move, so that a picture is stored again there"),
    ):
        clear = np.abs(usual.ratio - 1) > MIN_SIGMAS * widening * usual.error
        at = np.flatnonzero(jump & clear & (usual.stands_alone | copied))
        if len(at):
            more = f" and {len(at) - 3} more" if len(at) > 3 else ""
            times = ", ".join(f"{t:.4g} s" for t in usual.t[at][:3]) + more
            faults.append(f"after {times} {what.format(f'{usual.ratio[at[0]]:.2g}')}; {way_out}")
    uneven = _uneven_pattern(steps)
    if uneven is not None:
        means = " and ".join(f"{m:.2g}" for m in uneven)
        faults.append(f"frames in turn last {means} of their mean, by the masses' motion, unlike their times; {way_out}")
    return faults


@dataclass(frozen=True, kw_only=True, eq=False)
class _Durations:
    """Duration of each of n - 1 steps by the points, in the mean of those around it."""

    t: Array
    """Times of the rows [s], shape (n,)."""
    step: float
    """Time from row to row by the file [s]."""
    ratio: Array
    """Durations, in what they should be by the times, shape (n - 1,); not a number where the motion does not show them."""
    error: Array
    """Standard error of each by the noise, shape (n - 1,)."""
    along: Array
    """Cosine of the angle between each way and the mean of those around it, shape (n - 1,)."""

    def number_of(self, t: Array) -> NDArray[np.intp]:
        """Return the number of the frame at each time, from the first row."""
        return np.asarray(np.round((t - self.t[0]) / self.step), dtype=np.intp)

    @property
    def stands_alone(self) -> NDArray[np.bool_]:
        """Return which steps have two usual ones on each side: in a jolt, or at an outlier, several in a row are unusual."""
        usual = np.abs(self.ratio - 1) < np.maximum(MAX_USUAL, 3 * self.error)
        alone = np.zeros(len(usual), dtype=bool)
        alone[2:-2] = usual[:-4] & usual[1:-3] & usual[3:-1] & usual[4:]
        return alone

    def means_by_place(self, period: int, end: int) -> tuple[Array, Array] | None:
        """Return the mean duration of the steps at each place of a pattern, and its standard error.

        Parameters
        ----------
        end
            1: the places are those of the rows that the steps lead to; 0: those that they leave.

        None: some place has too few steps.
        """
        at = np.flatnonzero(self.error < MAX_ERROR)
        place = self.number_of(self.t[at + end]) % period
        weight = 1 / np.maximum(self.error[at], 0.02) ** 2
        if np.min(np.bincount(place, minlength=period)) < MIN_STEPS / period:
            return None
        total = np.bincount(place, weight, minlength=period)
        means = np.bincount(place, weight * self.ratio[at], minlength=period) / total
        spread = np.bincount(place, weight * (self.ratio[at] - means[place]) ** 2, minlength=period) / total
        count = total**2 / np.bincount(place, weight**2, minlength=period)
        return means, np.sqrt(np.maximum(spread / np.maximum(count - 1, 1), 1 / total))


def _by_body(channels: Sequence[Channel]) -> list[list[Channel]]:
    """Return the channels in their order, by body; those of no body each alone."""
    bodies = {name: body for body, names in BODIES.items() for name in names}
    grouped: dict[str, list[Channel]] = {}
    for c in channels:
        grouped.setdefault(bodies.get(c.name, c.name), []).append(c)
    return list(grouped.values())


def _without_equal_points(body: list[Channel], notes: ReadingNotes) -> list[Channel]:
    """Return a body's channels without points that repeat the one before in every digit."""
    if any(not np.array_equal(c.t, body[0].t) for c in body) or len(body[0]) < MIN_STEPS:
        return body
    values = np.stack([c.value for c in body], axis=1)
    fresh = np.append(True, np.any(values[1:] != values[:-1], axis=1))
    if fresh.all() or fresh.sum() < MIN_STEPS:
        return body
    left = [replace(c, t=c.t[fresh], value=c.value[fresh]) for c in body]
    # Of rounded points, or of those on a raster such as a picture's pixels, many that are no neighbours are equal, too
    by_chance = max(len(c) - len(np.unique(c.value)) for c in left)
    if (~fresh).sum() < max(MIN_COPIES, by_chance) or not all(map(_has_fine_digits, left)):
        return body
    for c in body:
        notes.unused[f"{c.name}: a copy of the point before"] += int(np.sum(~fresh))
    return left


def _has_fine_digits(channel: Channel) -> bool:
    """Return whether a channel has noise, and digits so far below it that no two points are equal by chance."""
    noise = scatter(channel)
    return noise > max(MIN_NOISE * float(np.ptp(channel.value)), channel.last_digit / MAX_CHANCE_DIGIT)


def _durations(channels: Sequence[Channel], window: int, typical: Callable[..., Array] = np.nanmean) -> _Durations | None:
    """Return the durations of the steps by the masses' ways; None: there are too few rows.

    Parameters
    ----------
    window
        Number of steps before and after a step with which it is compared.
    typical
        What is taken of these: their mean, of which a pattern of copies leaves as much as of even steps, or their median, on
        which a single other step has no influence.
    """
    moving = [c for c in channels if c.name != "angle_rate" and len(c) > 2 * window + MIN_STEPS]
    if not moving:
        return None
    t = np.unique(np.concatenate([c.t for c in moving]))
    values = np.full((len(t), len(moving)), np.nan)
    for i, c in enumerate(moving):
        values[np.searchsorted(t, c.t), i] = c.value
    time = np.diff(t)
    way = np.diff(values, axis=0)
    # All channels, or one whose other points are missing, count in the same steps alone
    speed = np.linalg.norm(way, axis=1) / time
    around = np.append(np.arange(-window, 0), np.arange(1, window + 1))
    inner = np.arange(window, len(speed) - window)
    others = speed[inner[:, None] + around]
    shown = np.isfinite(speed[inner]) & (np.sum(np.isfinite(others), axis=1) > window)
    own = np.ones(len(inner))
    own[shown] = typical(others[shown], axis=1)
    shown &= own > 0
    own[~shown] = 1.0
    ratio, error = np.full(len(speed), np.nan), np.full(len(speed), np.inf)
    ratio[inner] = np.where(shown, speed[inner] / own, np.nan)
    along = np.full(len(speed), np.nan)
    mean_way = np.nanmean(np.where(shown[:, None, None], way[inner[:, None] + around], 0.0), axis=1)
    lengths = np.linalg.norm(way[inner], axis=1) * np.linalg.norm(mean_way, axis=1)
    along[inner] = np.where(shown, np.sum(way[inner] * mean_way, axis=1) / np.maximum(lengths, 1e-300), np.nan)
    step = float(np.median(time))
    # By the usual step where a longer one is a gap, over which noise makes a way no longer
    scale = _noise(moving, way) / (own * np.minimum(time[inner], step))
    error[inner] = np.where(shown, np.sqrt(2) * scale, np.inf)
    return _Durations(t=t, step=step, ratio=ratio, error=error, along=along)


def _noise(channels: Sequence[Channel], ways: Array) -> float:
    """Return the noise of points that may be copies: a picture that is stored again scatters less than others."""
    known = np.abs(ways[np.isfinite(ways) & (ways != 0)])
    return min(max(scatter(c) for c in channels), float(np.percentile(known, 10)) * 5 if len(known) else np.inf)


def _pattern_of_copies(steps: _Durations) -> NDArray[np.bool_] | None:
    """Return which rows of a period show a new picture; None: there is no such pattern."""
    for period in range(2, MAX_PERIOD + 1):
        found = steps.means_by_place(period, end=1)
        if found is None:
            return None
        means, error = found
        copy = means < COPY
        # Far from 1 where a picture is stored again, and far from that elsewhere
        clear = np.where(copy, (1 - means) / MIN_SIGMAS, (means - COPY) / MIN_SIGMAS) > error
        if copy.any() and not copy.all() and np.all(clear):
            return np.asarray(~copy)
    return None


def _uneven_pattern(steps: _Durations) -> Array | None:
    """Return the mean durations of frames in turn; None: they are even."""
    for period in range(2, MAX_PERIOD + 1):
        found = steps.means_by_place(period, end=0)
        if found is None:
            return None
        means, error = found
        if np.ptp(means) > max(MIN_UNEVEN, MIN_SIGMAS * np.sqrt(2) * float(error.max())):
            return means
    return None
