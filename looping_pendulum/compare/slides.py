"""Where the string slides over the rod and where it rests, read from positions alone.

One detector serves the reference and every engine, so that an engine with the exact motion gets exactly the reference's values.
What it can resolve is stated in millimetres and milliseconds: a string that moves by less than `RESOLUTION` rests, and a rest
shorter than `REST_TIME` is not told from a turn. Speeds are no criterion: a chain that creeps slowly but far is still sliding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.reference_ode.geometry import Array

RESOLUTION = 1e-4
"""Motion of the string that does not count as sliding [m]: a tenth of a millimetre, less than a pixel of a good video."""

RESOLUTIONS = (1e-5, 3e-5, 1e-4, 3e-4, 1e-3)
"""Resolutions at which the halting time is given, so that a reader sees how much it depends on them [m]."""

NEARBY = (0.8, 1.25)
"""Shares of `RESOLUTION` between which a halting time must not depend on it, or it is blurred by as much as it does."""

COARSE = 1e-3
"""A string that stays within this [m] for good has come to its first rest; what it does after that is its rebound."""

REST_TIME = 0.01
"""Shortest rest [s] that is told from a turn: under 8 m/s^2 a turning mass stays within `RESOLUTION` for as long."""

MIN_REST = 0.05
"""A rest must be watched for this long [s] to be called halting where the run was cut: a turn at its very end is none."""


@dataclass(frozen=True, kw_only=True)
class Rest:
    """The string came to a stop: it turned, or it rested."""

    stop: float
    """When its sliding ended [s]."""
    first: int
    """First sample of the rest; of a turn, the sample nearest to it."""
    last: int
    """Last sample of the rest; equal to `first` for a turn."""


def slid(run: Trajectory, count: int) -> Array:
    """How far the string has slid towards the heavy mass [m] in the first ``count`` samples of ``run``.

    The engine's own reading where it has one; else the heavy mass's drop, which is the same for a string that does not stretch.
    """
    if run.string_slip is not None and np.isfinite(run.string_slip[:count]).all():
        return np.asarray(run.string_slip[:count])
    return np.asarray(run.heavy_drop[:count])


def turns(values: Array, band: float) -> list[int]:
    """Indices of the extrema at which ``values`` turn back by more than ``band``."""
    found: list[int] = []
    best = start = 0
    rising = 0
    for i in range(1, len(values)):
        if rising == 0:
            if abs(values[i] - values[start]) > band:
                rising = 1 if values[i] > values[start] else -1
                best = i
        elif rising * (values[i] - values[best]) > 0:
            best = i
        elif rising * (values[best] - values[i]) > band:
            found.append(best)
            rising, best = -rising, i
    return found


def resting(place: Array, resolution: float) -> Array:
    """Which samples lie in a stretch of `REST_TIME` in which the string moves by at most ``resolution`` [m], shape (n,)."""
    width = round(REST_TIME / SAMPLE_INTERVAL) + 1
    rests = np.zeros(len(place), dtype=bool)
    if len(place) < width:
        return rests
    windows = np.lib.stride_tricks.sliding_window_view(place, width)
    for start in np.flatnonzero(np.ptp(windows, axis=1) <= resolution):
        rests[start : start + width] = True
    return rests


def final_rest(place: Array, resolution: float) -> int:
    """First sample from which on the string moves by no more than ``resolution`` [m]."""
    backwards = place[::-1]
    spread = np.maximum.accumulate(backwards) - np.minimum.accumulate(backwards)
    return len(place) - int(np.searchsorted(spread, resolution, side="right"))


def stop_time(t: Array, place: Array, first: int, resolution: float) -> float:
    """When the sliding ends that has at most the resolution left to go at sample ``first``, and more at the one before it [s].

    The apex of the parabola through the last three samples before the stop: friction flips or sets in there, so that samples
    beyond it would bias it. They are the first three whose apex comes before the next sample. Sample ``first`` may already lie
    beyond the stop, the one before it may not; without one before it, the string rests since the release.

    A string that friction stops needs twice the time that it would take at the speed it has. One that is not there after three
    times that time creeps to rest ever more slowly: it has no end, and counts as stopped from sample ``first`` on.
    """
    if first == 0:
        return float(t[0])
    sliding = first - 1
    speed_left = abs(place[first] - place[sliding]) / (t[first] - t[sliding])
    for k in range(max(first - 2, 2), len(t) - 1):
        if speed_left * (t[k] - t[first]) > 3 * resolution:
            break
        way = 1.0 if place[k - 1] >= place[k - 2] else -1.0
        before = way * (place[k - 1] - place[k - 2]) / (t[k - 1] - t[k - 2])
        speed = way * (place[k] - place[k - 1]) / (t[k] - t[k - 1])
        if speed <= 0 and k - 1 >= sliding:  # it turned since, or rests since
            return float(t[k - 1])
        if 0 < speed < before:
            apex = 0.5 * (t[k] + t[k - 1]) + speed * 0.5 * (t[k] - t[k - 2]) / (before - speed)
            if t[sliding] <= apex <= t[k + 1]:
                return float(apex)
    return float(t[first])


def slip_onset(t: Array, place: Array, rest: Rest, power: int) -> float | None:
    """When a string at rest began to slide again [s]; None if it only turned there, or did not move again.

    The distance slid grows as the time's ``power``; the line through its root at two distances is carried back to zero. Good to
    some 3 ms: the power law is only the leading term, and the resolution hides the start.
    """
    if rest.last == rest.first:
        return None
    moved = np.abs(place[rest.last :] - np.median(place[rest.first : rest.last + 1]))
    near, far = (np.flatnonzero(moved > times * RESOLUTION) for times in (1, 8))
    if not len(far):
        return None
    i, j = rest.last + int(near[0]), rest.last + int(far[0])
    onset = float(t[i])
    if j > i:
        a, b = (moved[k - rest.last] ** (1 / power) for k in (i, j))
        onset -= float(a * (t[j] - t[i]) / (b - a))
    return max(onset, rest.stop) if onset - rest.stop >= REST_TIME else None


def rests(t: Array, place: Array, resolution: float = RESOLUTION) -> list[Rest]:
    """Every stop of the string, in the order of time: turns, and rests of at least `REST_TIME`.

    A rest that lasts since the release is the first of the list, with a stop at the first sample's time.
    """
    still = resting(place, resolution)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    found = [
        Rest(stop=stop_time(t, place, int(first), resolution), first=int(first), last=int(end) - 1)
        for first, end in zip(edges[::2], edges[1::2], strict=True)
    ]
    for turn in turns(place, resolution):
        if not still[turn]:
            near = turn - 1
            while near > 0 and abs(place[near] - place[turn]) <= resolution:
                near -= 1
            found.append(Rest(stop=stop_time(t, place, near + 1, resolution), first=turn, last=turn))
    return sorted(found, key=lambda rest: rest.stop)


def halting_time(t: Array, place: Array, resolution: float, *, ended: bool) -> float | None:
    """Start of the rest that lasts to the last sample [s]: from there on the string moves by at most ``resolution`` [m].

    None if there is none, or if it was not watched long enough: `MIN_REST` where the run was cut, `REST_TIME` where it
    ``ended`` because the light mass reached the rod.
    """
    if len(t) < 3:
        return None
    first = final_rest(place, resolution)
    time = stop_time(t, place, first, resolution)
    return time if t[-1] - time >= (REST_TIME if ended else MIN_REST) else None
