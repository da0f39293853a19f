"""What a teacher would point at: stops, halting, slip, extrema, and what the apparatus looks like then.

Engines and reference are read by the same detector (`slides`), from samples at the same times, so that an engine with the exact
motion gets exactly the reference's values. The reference also says the same things by its own events, to rounding; how far the
two are apart is the detector's error on this very run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.compare.align import SAME_TIME, Reference, sample_reference
from looping_pendulum.compare.result import Extremum, HaltingTimeAt, Landmarks, Rebound, Stop
from looping_pendulum.compare.slides import (
    COARSE,
    NEARBY,
    RESOLUTION,
    RESOLUTIONS,
    halting_time,
    rests,
    slid,
    slip_onset,
    turns,
)
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.engines.trajectory import RunStatus, Trajectory, TrajectoryEvent
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import DURATION

EXTREMUM_BAND = 1e-3
"""A turn of a coordinate smaller than this [m] is noise, not an extremum."""

STRINGLESS = (Release.HELD, Release.DROP)
"""Releases whose heavy mass cannot stop: it is clamped, or falls freely."""


def extrema(t: Array, values: Array) -> tuple[Extremum, ...]:
    """Turns by more than `EXTREMUM_BAND` inside the run, each at the apex of the parabola through three samples."""
    return tuple(_apex(t, values, i) for i in turns(values, EXTREMUM_BAND))


def _apex(t: Array, values: Array, i: int) -> Extremum:
    before, after = t[i] - t[i - 1], t[i + 1] - t[i]
    d1, d2 = (values[i] - values[i - 1]) / before, (values[i + 1] - values[i]) / after
    curvature = (d2 - d1) / (before + after)
    if curvature == 0:  # three samples of the very same value: none of them is the apex more than another
        return Extremum(time=float(t[i]), value=float(values[i]))
    slope = (d1 * after + d2 * before) / (before + after)
    shift = float(np.clip(-slope / (2 * curvature), -before, after))
    return Extremum(time=float(t[i] + shift), value=float(values[i] + slope * shift + curvature * shift**2))


def run_landmarks(run: Trajectory, parameters: Parameters) -> Landmarks:
    """Landmarks of a run, an engine's or the reference's, from its samples alone."""
    count = finite_length(run)
    t = run.t[:count]
    if count < 3:
        return Landmarks()
    ended = run.status is RunStatus.LIGHT_REACHED_ROD
    light = run.light_position[:count]
    fields: dict[str, Any] = {
        "light_reaches_rod": float(t[-1]) if ended else None,
        "x1_extrema": extrema(t, light[:, 0]),
        "y1_extrema": extrema(t, light[:, 1]),
    }
    if parameters.release in STRINGLESS:
        return Landmarks(**fields)
    place = slid(run, count)
    times = tuple(
        HaltingTimeAt(resolution=resolution, time=halting_time(t, place, resolution, ended=ended)) for resolution in RESOLUTIONS
    )
    halt = next(each.time for each in times if each.resolution == RESOLUTION)
    first_rest = next(each.time for each in times if each.resolution == COARSE)

    def at(time: float, values: Array) -> float:
        return float(np.interp(time, t, values[:count]))

    resting = rests(t, place)
    power = 3 if parameters.coefficients["static_friction"] == parameters.coefficients["kinetic_friction"] else 2
    onsets = (slip_onset(t, place, rest, power) for rest in resting)
    return Landmarks(
        stops=tuple(Stop(time=rest.stop, height_change=-at(rest.stop, run.heavy_drop)) for rest in resting if rest.stop > t[0]),
        slip_onsets=tuple(onset for onset in onsets if onset is not None),
        halting_time=halt,
        halting_confirmed=halt is not None and ended,
        halting_times=times,
        halting_time_blur=None if halt is None else _blur(t, place, halt, ended=ended),
        rebound=None if first_rest is None else _rebound(t, place, first_rest),
        drop_at_halt=None if halt is None else at(halt, run.heavy_drop),
        wrap_angle_at_halt=None if halt is None else at(halt, run.wrap_angle),
        free_length_at_halt=None if halt is None else at(halt, run.free_length),
        **fields,
    )


def _blur(t: Array, place: Array, halt: float, *, ended: bool) -> float | None:
    """How far the halting time moves with a somewhat finer and a somewhat coarser resolution [s]."""
    others = [halting_time(t, place, share * RESOLUTION, ended=ended) for share in NEARBY]
    moved = [abs(time - halt) for time in others if time is not None]
    return max(moved) if len(moved) == len(others) else None


def _rebound(t: Array, place: Array, first_rest: float) -> Rebound:
    """How far and how fast the string still moves after its first rest."""
    after = np.flatnonzero(t >= first_rest)
    moving = place[after]
    speeds = np.abs(np.diff(moving) / np.diff(t[after]))
    return Rebound(travel=float(np.ptp(moving)), speed=float(speeds.max(initial=0.0)))


@dataclass(frozen=True, kw_only=True)
class EventTimes:
    """When what happened in a run of the reference [s]."""

    stops: tuple[float, ...]
    """Zeros of the heavy mass's speed."""
    slip_onsets: tuple[float, ...]
    halting_time: float | None
    light_reaches_rod: float | None


def reference_event_times(events: Iterable[TrajectoryEvent]) -> EventTimes:
    """Moments of the reference by its own named events."""
    named: dict[str, list[float]] = {}
    for event in events:
        named.setdefault(event.name, []).append(event.time)
    at_rest = named.get("stop", []) + named.get("stick", []) + named.get("halt", [])
    stops = _merged([time for time in at_rest if time > 0])  # a string that sticks from the release on has not stopped
    return EventTimes(
        stops=tuple(stops),
        slip_onsets=tuple(_merged(named.get("slip_onset", []))),
        halting_time=named["halt"][0] if "halt" in named else None,
        light_reaches_rod=named["light_reaches_rod"][0] if "light_reaches_rod" in named else None,
    )


def reference_landmarks(reference: Reference, grid: Array) -> Landmarks:
    """Landmarks of the reference, by its own events; only the extrema come from its samples at ``grid`` [s]."""
    run = reference(grid)
    count = finite_length(run)
    moments = reference_event_times(run.events)
    stops, halt = moments.stops, moments.halting_time
    at = sample_reference(reference, np.array([0.0, *([] if halt is None else [halt]), *stops]))
    first = float(at.heavy_height[0])
    return Landmarks(
        stops=tuple(
            Stop(time=time, height_change=float(height) - first)
            for time, height in zip(stops, at.heavy_height[-len(stops) :], strict=True)
        )
        if stops
        else (),
        slip_onsets=moments.slip_onsets,
        halting_time=halt,
        halting_confirmed=halt is not None,
        drop_at_halt=None if halt is None else first - float(at.heavy_height[1]),
        wrap_angle_at_halt=None if halt is None else float(at.wrap_angle[1]),
        free_length_at_halt=None if halt is None else float(at.free_length[1]),
        light_reaches_rod=moments.light_reaches_rod,
        x1_extrema=extrema(run.t[:count], run.light_position[:count, 0]),
        y1_extrema=extrema(run.t[:count], run.light_position[:count, 1]),
    )


class SampledReference:
    """The reference's run as an engine's would be seen: sampled every `SAMPLE_INTERVAL`, watched as long as the engine was."""

    def __init__(self, reference: Reference, parameters: Parameters) -> None:
        whole = reference(np.arange(round(DURATION / SAMPLE_INTERVAL) + 1, dtype=np.float64) * SAMPLE_INTERVAL)
        ended = reference_event_times(whole.events).light_reaches_rod is not None
        self.parameters = parameters
        self.run = dataclasses.replace(whole, status=RunStatus.LIGHT_REACHED_ROD if ended else RunStatus.FINISHED)
        """From the release to the reference's own end, which may be later than the scenario's."""
        self._whole = run_landmarks(self.run, parameters)

    def until(self, end: float) -> Landmarks:
        """Landmarks of the reference as if it, too, had been cut at the time ``end`` [s]."""
        count = int(np.searchsorted(self.run.t, end + SAME_TIME))
        return run_landmarks(dataclasses.replace(first_samples(self.run, count), status=RunStatus.FINISHED), self.parameters)

    def beside(self, run: Trajectory | None = None) -> Landmarks:
        """Landmarks of the reference over its whole run.

        Beside an engine's ``run`` that ended because its light mass reached the rod, the reference ends where it has as little
        straight string left: what the last millimetres do is not seen of the engine.
        """
        if run is None or not self.run.status is run.status is RunStatus.LIGHT_REACHED_ROD:
            return self._whole
        left = run.free_length[finite_length(run) - 1] - SHORTEST
        shorter = np.flatnonzero(self.run.free_length < left)
        return run_landmarks(first_samples(self.run, int(shorter[0]) if len(shorter) else len(self.run.t)), self.parameters)


SHORTEST = 1e-9
"""Difference of lengths [m] that is rounding."""


def first_samples(run: Trajectory, count: int) -> Trajectory:
    """Return ``run`` with its first ``count`` samples only."""
    if count >= len(run.t):
        return run
    per_sample: dict[str, Any] = {
        f.name: value[:count] for f in dataclasses.fields(run) if isinstance(value := getattr(run, f.name), np.ndarray)
    }
    return dataclasses.replace(run, **per_sample)


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
