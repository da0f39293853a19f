"""The moments a teacher would point at: stops, halting, break-away, extrema, and what the apparatus looks like then.

Engines are noisy and sampled, so "at rest" has a declared dead band here; the truth says the same moments by its own events.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from looping_pendulum.compare.align import SAME_TIME, Truth, sample_truth
from looping_pendulum.compare.result import Extremum, Landmarks, Stop
from looping_pendulum.engines.trajectory import RunStatus, Trajectory, TrajectoryEvent
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

REST_SPEED = 0.02
"""A heavy mass slower than this [m/s] counts as at rest: chains jitter by millimetres per second, and gravity gives a free mass
this speed in 2 ms."""

LEAVE_SPEED = 2 * REST_SPEED
"""A heavy mass at rest must exceed this [m/s] to count as moving again: noise at the band's edge makes no extra stops."""

STICK_TIME = 0.01
"""A rest shorter than this [s] is a turn, not a stick: the time that noise can hide in the dead band at 2 m/s^2."""

MIN_REST = 0.05
"""A rest at the cut end of a run must have lasted this long [s] to be called halting: a turn at the very end is none."""

EXTREMUM_BAND = 1e-3
"""A turn of a coordinate smaller than this [m] is noise, not an extremum."""

STRINGLESS = (Release.HELD, Release.DROP)
"""Releases whose heavy mass cannot stop: it is clamped, or falls freely."""


def rest_intervals(t: Array, speed: Array) -> list[tuple[int, int]]:
    """Find where a noisy signed ``speed`` [m/s] rests after having moved.

    Returns
    -------
    list of (int, int)
        Per stop: index of the last sample that moves before it, and of the first that moves after it (``len(t)`` if none).
        A reversal without a sample inside the band is a rest of no length.
    """
    rests: list[tuple[int, int]] = []
    direction, resting_since = 0, -1
    for i, value in enumerate(speed):
        threshold = REST_SPEED if direction else LEAVE_SPEED
        now = 0 if abs(value) <= threshold else (1 if value > 0 else -1)
        if now == direction:
            continue
        if direction:
            resting_since = i - 1
            if now:
                rests.append((resting_since, i))
        elif resting_since >= 0:
            rests.append((resting_since, i))
        direction = now
    if direction == 0 and resting_since >= 0:
        rests.append((resting_since, len(t)))
    return rests


def stop_time(t: Array, speed: Array, last: int, rest_end: int) -> float:
    """When ``speed`` reached zero after sample ``last``, the last one above the band [s].

    The line through the last two samples above the band is carried on to zero: friction flips or sets in at the stop, so
    samples beyond it would bias the crossing. The crossing seen in the samples, if there is one, bounds it.
    """
    sign = np.sign(speed[last])
    after = speed[last + 1 : min(rest_end + 1, len(t))] * sign
    crossed = np.flatnonzero(after <= 0)
    latest = float(t[-1])
    if len(crossed):
        j = last + 1 + int(crossed[0])
        share = speed[j - 1] / (speed[j - 1] - speed[j])
        latest = float(t[j]) if j - 1 == last else float(t[j - 1] + share * (t[j] - t[j - 1]))
    if last > 0:
        slope = (speed[last] - speed[last - 1]) / (t[last] - t[last - 1])
        if slope * sign < 0:
            return min(float(t[last] - speed[last] / slope), latest)
    return float(t[last + 1]) if last + 1 < len(t) else latest


def break_away_time(t: Array, speed: Array, stop: float, first: int, parameters: Parameters) -> float | None:
    """When a mass at rest since ``stop`` [s] began to move again [s]; None if it only turned there.

    With equal friction coefficients the force leaves zero linearly, so the speed grows as the square of the time since; with a
    larger static one it jumps, and the speed grows linearly, as it does after a turn. Good to some 3 ms: the law is only the
    leading term, and the dead band hides the start.
    """
    if _back_to_rest(t, speed, first, 1.0) - stop < STICK_TIME:
        return None
    c = parameters.coefficients
    power = 0.5 if c["static_friction"] == c["kinetic_friction"] else 1.0
    return max(_back_to_rest(t, speed, first, power), stop)


def _back_to_rest(t: Array, speed: Array, first: int, power: float) -> float:
    """When ``speed**power`` was zero [s], on the line through sample ``first`` and the one at twice its speed."""
    faster = np.flatnonzero(np.abs(speed[first:]) >= 2 * abs(speed[first]))
    if not len(faster):
        return float(t[first])
    second = first + int(faster[0])
    a, b = abs(speed[first]) ** power, abs(speed[second]) ** power
    return float(t[first] - a * (t[second] - t[first]) / (b - a))


def extrema(t: Array, values: Array) -> tuple[Extremum, ...]:
    """Turns by more than `EXTREMUM_BAND` inside the run, each at the apex of the parabola through three samples."""
    return tuple(_apex(t, values, i) for i in turns(values))


def turns(values: Array) -> list[int]:
    """Indices at which ``values`` [m] turn by more than `EXTREMUM_BAND`."""
    found: list[int] = []
    best = start = 0
    rising = 0
    for i in range(1, len(values)):
        if rising == 0:
            if abs(values[i] - values[start]) > EXTREMUM_BAND:
                rising = 1 if values[i] > values[start] else -1
                best = i
        elif rising * (values[i] - values[best]) > 0:
            best = i
        elif rising * (values[best] - values[i]) > EXTREMUM_BAND:
            found.append(best)
            rising, best = -rising, i
    return found


def _apex(t: Array, values: Array, i: int) -> Extremum:
    if not 0 < i < len(t) - 1:
        return Extremum(time=float(t[i]), value=float(values[i]))
    before, after = t[i] - t[i - 1], t[i + 1] - t[i]
    d1, d2 = (values[i] - values[i - 1]) / before, (values[i + 1] - values[i]) / after
    curvature = (d2 - d1) / (before + after)
    if curvature == 0:
        return Extremum(time=float(t[i]), value=float(values[i]))
    slope = (d1 * after + d2 * before) / (before + after)
    shift = float(np.clip(-slope / (2 * curvature), -before, after))
    return Extremum(time=float(t[i] + shift), value=float(values[i] + slope * shift + curvature * shift**2))


def run_landmarks(run: Trajectory, parameters: Parameters) -> Landmarks:
    """Landmarks of an engine's run, from its samples alone."""
    count = finite_length(run)
    t, speed = run.t[:count], run.heavy_velocity[:count, 1]
    if count < 3:
        return Landmarks()
    ends_on_rod = run.status is RunStatus.LIGHT_REACHED_ROD
    height = run.heavy_position[:count, 1]
    rests = [] if parameters.release in STRINGLESS else rest_intervals(t, speed)
    times = [stop_time(t, speed, last, after) for last, after in rests]
    halts = bool(rests) and rests[-1][1] == count and (ends_on_rod or float(t[-1]) - times[-1] >= MIN_REST)
    halt = times[-1] if halts else None

    def at(time: float, values: Array) -> float:
        return float(np.interp(time, t, values))

    return Landmarks(
        stops=tuple(Stop(time=time, height_change=at(time, height) - float(height[0])) for time in times),
        break_aways=tuple(
            moved
            for stop, (_, after) in zip(times, rests, strict=True)
            if after < count and (moved := break_away_time(t, speed, stop, after, parameters)) is not None
        ),
        halting_time=halt,
        halting_confirmed=halts and ends_on_rod,
        drop_at_halt=None if halt is None else float(height[0]) - at(halt, height),
        wrap_angle_at_halt=None if halt is None else at(halt, run.wrap_angle[:count]),
        free_length_at_halt=None if halt is None else at(halt, run.free_length[:count]),
        light_reaches_rod=float(t[-1]) if ends_on_rod else None,
        x1_extrema=extrema(t, run.light_position[:count, 0]),
        y1_extrema=extrema(t, run.light_position[:count, 1]),
    )


@dataclass(frozen=True, kw_only=True)
class Moments:
    """When what happened in a run of the reference [s]."""

    stops: tuple[float, ...]
    """Zeros of the heavy mass's speed."""
    break_aways: tuple[float, ...]
    halting_time: float | None
    light_reaches_rod: float | None


def truth_moments(events: Iterable[TrajectoryEvent]) -> Moments:
    """Moments of the truth by its own named events."""
    named: dict[str, list[float]] = {}
    for event in events:
        named.setdefault(event.name, []).append(event.time)
    at_rest = named.get("stop", []) + named.get("stick", []) + named.get("halt", [])
    stops = _merged([time for time in at_rest if time > 0])  # a string that sticks from the release on has not stopped
    return Moments(
        stops=tuple(stops),
        break_aways=tuple(_merged([time for name, times in named.items() if name.startswith("break") for time in times])),
        halting_time=named["halt"][0] if "halt" in named else None,
        light_reaches_rod=named["light_reaches_rod"][0] if "light_reaches_rod" in named else None,
    )


def truth_landmarks(truth: Truth, grid: Array) -> Landmarks:
    """Landmarks of the truth, by its own events; only the extrema come from its samples at ``grid`` [s]."""
    run = truth(grid)
    count = finite_length(run)
    moments = truth_moments(run.events)
    stops, halt = moments.stops, moments.halting_time
    at = sample_truth(truth, np.array([0.0, *([] if halt is None else [halt]), *stops]))
    first = float(at.heavy_height[0])
    return Landmarks(
        stops=tuple(
            Stop(time=time, height_change=float(height) - first)
            for time, height in zip(stops, at.heavy_height[-len(stops) :], strict=True)
        )
        if stops
        else (),
        break_aways=moments.break_aways,
        halting_time=halt,
        halting_confirmed=halt is not None,
        drop_at_halt=None if halt is None else first - float(at.heavy_height[1]),
        wrap_angle_at_halt=None if halt is None else float(at.wrap_angle[1]),
        free_length_at_halt=None if halt is None else float(at.free_length[1]),
        light_reaches_rod=moments.light_reaches_rod,
        x1_extrema=extrema(run.t[:count], run.light_position[:count, 0]),
        y1_extrema=extrema(run.t[:count], run.light_position[:count, 1]),
    )


def finite_length(run: Trajectory) -> int:
    """Samples before the first that is not a number."""
    if len(run.t) == 0:
        return 0
    columns = (run.light_position, run.heavy_position, run.heavy_velocity)
    bad = ~np.isfinite(np.hstack(columns)).all(axis=1)
    return int(np.argmax(bad)) if bad.any() else len(run.t)


def _merged(times: list[float]) -> list[float]:
    """Sorted, with times that are one moment under two names kept once."""
    kept: list[float] = []
    for time in sorted(times):
        if not kept or time - kept[-1] > SAME_TIME:
            kept.append(time)
    return kept
