"""Detects from positions alone when the string slides over the rod and when it rests.

The same detector serves the reference and every engine, so that an engine with the exact motion gets exactly the reference's
values. Its resolution is a length and a time: a string that moves by less than `RESOLUTION` rests, and a rest shorter than
`REST_TIME` cannot be distinguished from a turn. Speed is not a criterion: a chain that creeps slowly but far is still sliding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.runs.trajectory import Trajectory

RESOLUTION = 1e-4
"""Largest motion of the string that does not count as sliding [m]: 0.1 mm, less than a pixel of a good video."""

RESOLUTIONS = (1e-5, 3e-5, 1e-4, 3e-4, 1e-3)
"""Resolutions [m] for which reports give the halting time; how far these times lie apart is its uncertainty."""

FIRST_REST_RESOLUTION = 1e-3
"""Resolution that defines the first rest [m]: from then on the string stays within it, and its motion is called rebound."""

REST_TIME = 0.01
"""Shortest rest [s] that differs from a turn: at 8 m/s^2 a turning mass stays within `RESOLUTION` for as long."""

MIN_REST = 0.05
"""Shortest rest [s] at the end of a run that was cut that counts as a halt: the last samples before a turn must not."""


@dataclass(frozen=True, kw_only=True)
class Rest:
    """A stop of the string: the rest that follows its sliding, or the instant at which it turns."""

    stop: float
    """Time at which the sliding ended [s]."""
    first: int
    """Index of the first sample of the rest; for a turn, of the sample nearest to it."""
    last: int
    """Index of the last sample of the rest; equal to `first` for a turn."""


def slip_distance(run: Trajectory, count: int) -> Array:
    """Return how far the string has slid towards the heavy mass [m] in the first ``count`` samples of ``run``.

    Uses the engine's own value where it reports one; otherwise the heavy mass's drop, which equals it if the string is rigid.
    """
    if run.string_slip is not None and np.isfinite(run.string_slip[:count]).all():
        return np.asarray(run.string_slip[:count])
    return np.asarray(run.heavy_drop[:count])


def turning_points(values: Array, band: float) -> list[int]:
    """Return the indices of the extrema after which ``values`` turn back by more than ``band``."""
    extrema: list[int] = []
    best = start = 0
    rising = 0  # +1 or -1 once the values have left the band about the first one
    for i in range(1, len(values)):
        if rising == 0:
            if abs(values[i] - values[start]) > band:
                rising = 1 if values[i] > values[start] else -1
                best = i
        elif rising * (values[i] - values[best]) > 0:
            best = i
        elif rising * (values[best] - values[i]) > band:
            extrema.append(best)
            rising, best = -rising, i
    return extrema


def resting_samples(slip: Array, resolution: float) -> Array:
    """Mark the samples of every interval of `REST_TIME` in which the string moves by at most ``resolution`` [m], shape (n,)."""
    width = round(REST_TIME / SAMPLE_INTERVAL) + 1
    still = np.zeros(len(slip), dtype=bool)
    if len(slip) < width:
        return still
    windows = np.lib.stride_tricks.sliding_window_view(slip, width)
    for start in np.flatnonzero(np.ptp(windows, axis=1) <= resolution):
        still[start : start + width] = True
    return still


def final_rest_start(slip: Array, resolution: float) -> int:
    """Return the index of the first sample from which on the string moves by at most ``resolution`` [m]."""
    backwards = slip[::-1]
    spread = np.maximum.accumulate(backwards) - np.minimum.accumulate(backwards)
    return len(slip) - int(np.searchsorted(spread, resolution, side="right"))


def stop_time(t: Array, slip: Array, first: int, resolution: float) -> float:
    """Return the time [s] at which the sliding ends.

    At sample ``first`` the string has at most ``resolution`` left to slide, and at the sample before it more. The stop is the
    apex of the parabola through three samples before it: friction reverses or sets in there, so later samples would bias it.
    They are the first three whose apex comes before the next sample. Sample ``first`` may already lie after the stop, the one
    before it may not. If ``first`` is 0, the string rests since the release.

    Friction stops a string in twice the time that the remaining distance would take at its present speed. A string that needs
    more than three times that time creeps to rest ever more slowly; its stop has no definite time and is taken at ``first``.
    """
    if first == 0:
        return float(t[0])
    sliding = first - 1
    last_speed = abs(slip[first] - slip[sliding]) / (t[first] - t[sliding])
    for k in range(max(first - 2, 2), len(t) - 1):
        if last_speed * (t[k] - t[first]) > 3 * resolution:
            break
        direction = 1.0 if slip[k - 1] >= slip[k - 2] else -1.0
        speed_before = direction * (slip[k - 1] - slip[k - 2]) / (t[k - 1] - t[k - 2])
        speed = direction * (slip[k] - slip[k - 1]) / (t[k] - t[k - 1])
        if speed <= 0 and k - 1 >= sliding:  # It has turned or come to rest between the samples.
            return float(t[k - 1])
        if 0 < speed < speed_before:
            apex = 0.5 * (t[k] + t[k - 1]) + speed * 0.5 * (t[k] - t[k - 2]) / (speed_before - speed)
            if t[sliding] <= apex <= t[k + 1]:
                return float(apex)
    return float(t[first])


def slip_onset(t: Array, slip: Array, rest: Rest, power: int) -> float | None:
    """Return when a string at rest began to slide again [s]; None if it only turned there, or did not move again.

    The distance grows as the time since the onset to the ``power``: its root is a straight line, which is extrapolated to zero
    from two distances. Accurate to about 3 ms: the power law is only the leading term, and the resolution hides the start.
    """
    if rest.last == rest.first:
        return None
    moved = np.abs(slip[rest.last :] - np.median(slip[rest.first : rest.last + 1]))
    # Two distances whose ratio is 8: with the cubic law their roots differ by a factor of 2.
    near, far = (np.flatnonzero(moved > times * RESOLUTION) for times in (1, 8))
    if not len(far):
        return None
    i, j = rest.last + int(near[0]), rest.last + int(far[0])
    onset = float(t[i])
    if j > i:
        a, b = (moved[k - rest.last] ** (1 / power) for k in (i, j))
        onset -= float(a * (t[j] - t[i]) / (b - a))
    return max(onset, rest.stop) if onset - rest.stop >= REST_TIME else None


def find_rests(t: Array, slip: Array) -> list[Rest]:
    """Return every stop of the string in order of time: turns, and rests of at least `REST_TIME`.

    A rest that lasts since the release comes first, with its stop at the time of the first sample.
    """
    still = resting_samples(slip, RESOLUTION)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    stops = [
        Rest(stop=stop_time(t, slip, int(first), RESOLUTION), first=int(first), last=int(end) - 1)
        for first, end in zip(edges[::2], edges[1::2], strict=True)
    ]
    for turn in turning_points(slip, RESOLUTION):
        if not still[turn]:
            near = turn - 1
            while near > 0 and abs(slip[near] - slip[turn]) <= RESOLUTION:
                near -= 1
            stops.append(Rest(stop=stop_time(t, slip, near + 1, RESOLUTION), first=turn, last=turn))
    return sorted(stops, key=lambda rest: rest.stop)


def halting_time(t: Array, slip: Array, resolution: float, *, ended: bool) -> float | None:
    """Return the start [s] of the final rest, in which the string moves by at most ``resolution`` [m].

    None if there is no such rest, or if it is too short: `MIN_REST` is needed where the run was cut, `REST_TIME` where it
    ``ended`` because the light mass reached the rod.
    """
    if len(t) < 3:
        return None
    first = final_rest_start(slip, resolution)
    time = stop_time(t, slip, first, resolution)
    return time if t[-1] - time >= (REST_TIME if ended else MIN_REST) else None
