"""Finds the landmarks of a run: stops, halting time, slip onsets, extrema, and the state of the apparatus at them.

Engines and reference are read by the same detector (`slides`), from samples at the same times, so that an engine with the exact
motion gets exactly the reference's values. The reference's own events give the same times to rounding; the difference of the
two is the error of the detector on this run.
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
    FIRST_REST_RESOLUTION,
    RESOLUTION,
    RESOLUTIONS,
    UNCERTAINTY_FACTORS,
    find_rests,
    halting_time,
    slip_distance,
    slip_onset,
    turning_points,
)
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.engines.trajectory import RunStatus, Trajectory, TrajectoryEvent
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import DURATION

EXTREMUM_BAND = 1e-3
"""Smallest turn of a coordinate that counts as an extremum [m]; smaller ones are noise."""

RELEASES_WITHOUT_STOPS = (Release.HELD, Release.DROP)
"""Releases whose heavy mass cannot stop: it is clamped, or falls freely."""


def extrema(t: Array, values: Array) -> tuple[Extremum, ...]:
    """Return turns by more than `EXTREMUM_BAND` within the run, each at the apex of the parabola through three samples."""
    return tuple(_parabola_apex(t, values, i) for i in turning_points(values, EXTREMUM_BAND))


def _parabola_apex(t: Array, values: Array, i: int) -> Extremum:
    before, after = t[i] - t[i - 1], t[i + 1] - t[i]
    d1, d2 = (values[i] - values[i - 1]) / before, (values[i + 1] - values[i]) / after
    curvature = (d2 - d1) / (before + after)
    if curvature == 0:  # three equal samples: the parabola has no apex
        return Extremum(time=float(t[i]), value=float(values[i]))
    slope = (d1 * after + d2 * before) / (before + after)
    shift = float(np.clip(-slope / (2 * curvature), -before, after))
    return Extremum(time=float(t[i] + shift), value=float(values[i] + slope * shift + curvature * shift**2))


def run_landmarks(run: Trajectory, parameters: Parameters) -> Landmarks:
    """Return the landmarks of a run, an engine's or the reference's, from its samples alone."""
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
    if parameters.release in RELEASES_WITHOUT_STOPS:
        return Landmarks(**fields)
    slip = slip_distance(run, count)
    times = tuple(
        HaltingTimeAt(resolution=resolution, time=halting_time(t, slip, resolution, ended=ended)) for resolution in RESOLUTIONS
    )
    halt = next(each.time for each in times if each.resolution == RESOLUTION)
    first_rest = next(each.time for each in times if each.resolution == FIRST_REST_RESOLUTION)

    def at(time: float, values: Array) -> float:
        return float(np.interp(time, t, values[:count]))

    stops_and_rests = find_rests(t, slip)
    # With one friction coefficient the force that starts the sliding grows from zero, so the distance grows as t^3; a static
    # friction above the kinetic one leaves a finite force at the onset, hence t^2.
    power = 3 if parameters.coefficients["static_friction"] == parameters.coefficients["kinetic_friction"] else 2
    onsets = (slip_onset(t, slip, rest, power) for rest in stops_and_rests)
    return Landmarks(
        stops=tuple(
            Stop(time=rest.stop, height_change=-at(rest.stop, run.heavy_drop)) for rest in stops_and_rests if rest.stop > t[0]
        ),
        slip_onsets=tuple(onset for onset in onsets if onset is not None),
        halting_time=halt,
        halting_confirmed=halt is not None and ended,
        halting_times=times,
        halting_time_uncertainty=None if halt is None else _halting_time_uncertainty(t, slip, halt, ended=ended),
        rebound=None if first_rest is None else _rebound(t, slip, first_rest),
        drop_at_halt=None if halt is None else at(halt, run.heavy_drop),
        wrap_angle_at_halt=None if halt is None else at(halt, run.wrap_angle),
        free_length_at_halt=None if halt is None else at(halt, run.free_length),
        **fields,
    )


def _halting_time_uncertainty(t: Array, slip: Array, halt: float, *, ended: bool) -> float | None:
    """Return how far the halting time moves [s] with a slightly different resolution; None if one of these gives no halt."""
    others = [halting_time(t, slip, factor * RESOLUTION, ended=ended) for factor in UNCERTAINTY_FACTORS]
    moved = [abs(time - halt) for time in others if time is not None]
    return max(moved) if len(moved) == len(others) else None


def _rebound(t: Array, slip: Array, first_rest: float) -> Rebound:
    """Return how far and how fast the string still moves after its first rest."""
    after = np.flatnonzero(t >= first_rest)
    moving = slip[after]
    speeds = np.abs(np.diff(moving) / np.diff(t[after]))
    return Rebound(travel=float(np.ptp(moving)), speed=float(speeds.max(initial=0.0)))


@dataclass(frozen=True, kw_only=True)
class EventTimes:
    """Times of the events in a run of the reference [s]."""

    stops: tuple[float, ...]
    """Times at which the heavy mass's speed is zero."""
    slip_onsets: tuple[float, ...]
    halting_time: float | None
    light_reaches_rod: float | None


def reference_event_times(events: Iterable[TrajectoryEvent]) -> EventTimes:
    """Collect the times of the reference's own named events."""
    named: dict[str, list[float]] = {}
    for event in events:
        named.setdefault(event.name, []).append(event.time)
    at_rest = named.get("stop", []) + named.get("stick", []) + named.get("halt", [])
    stops = _without_repetitions(
        [time for time in at_rest if time > 0]
    )  # A string that sticks from the release on has not stopped.
    return EventTimes(
        stops=tuple(stops),
        slip_onsets=tuple(_without_repetitions(named.get("slip_onset", []))),
        halting_time=named["halt"][0] if "halt" in named else None,
        light_reaches_rod=named["light_reaches_rod"][0] if "light_reaches_rod" in named else None,
    )


def reference_landmarks(reference: Reference, grid: Array) -> Landmarks:
    """Return the landmarks of the reference from its own events; only the extrema come from its samples at ``grid`` [s]."""
    run = reference(grid)
    count = finite_length(run)
    times = reference_event_times(run.events)
    stops, halt = times.stops, times.halting_time
    at = sample_reference(reference, np.array([0.0, *([] if halt is None else [halt]), *stops]))
    release_height = float(at.heavy_height[0])
    return Landmarks(
        stops=tuple(
            Stop(time=time, height_change=float(height) - release_height)
            for time, height in zip(stops, at.heavy_height[-len(stops) :], strict=True)
        )
        if stops
        else (),
        slip_onsets=times.slip_onsets,
        halting_time=halt,
        halting_confirmed=halt is not None,
        drop_at_halt=None if halt is None else release_height - float(at.heavy_height[1]),
        wrap_angle_at_halt=None if halt is None else float(at.wrap_angle[1]),
        free_length_at_halt=None if halt is None else float(at.free_length[1]),
        light_reaches_rod=times.light_reaches_rod,
        x1_extrema=extrema(run.t[:count], run.light_position[:count, 0]),
        y1_extrema=extrema(run.t[:count], run.light_position[:count, 1]),
    )


class SampledReference:
    """The reference's run, sampled every `SAMPLE_INTERVAL` and cut like an engine's, so that both are read in the same way."""

    def __init__(self, reference: Reference, parameters: Parameters) -> None:
        whole = reference(np.arange(round(DURATION / SAMPLE_INTERVAL) + 1, dtype=np.float64) * SAMPLE_INTERVAL)
        ended = reference_event_times(whole.events).light_reaches_rod is not None
        self.parameters = parameters
        self.run = dataclasses.replace(whole, status=RunStatus.LIGHT_REACHED_ROD if ended else RunStatus.FINISHED)
        """The run from the release to the reference's own end, which may be later than the scenario's."""
        self._whole = run_landmarks(self.run, parameters)

    def landmarks_until(self, end: float) -> Landmarks:
        """Return the landmarks of the reference as if its run had been cut at the time ``end`` [s]."""
        count = int(np.searchsorted(self.run.t, end + SAME_TIME))
        return run_landmarks(dataclasses.replace(first_samples(self.run, count), status=RunStatus.FINISHED), self.parameters)

    def landmarks_beside(self, run: Trajectory | None = None) -> Landmarks:
        """Return the landmarks of the reference that an engine's ``run`` is compared with; those of its whole run without one.

        If the engine's run ended because its light mass reached the rod, the reference is cut where its free length is as
        short: the engine's run does not show the last millimetres.
        """
        if run is None or not self.run.status is run.status is RunStatus.LIGHT_REACHED_ROD:
            return self._whole
        shortest = run.free_length[finite_length(run) - 1] - LENGTH_ROUNDING
        shorter = np.flatnonzero(self.run.free_length < shortest)
        return run_landmarks(first_samples(self.run, int(shorter[0]) if len(shorter) else len(self.run.t)), self.parameters)


LENGTH_ROUNDING = 1e-9
"""Difference of two lengths that is due to rounding [m]."""


def first_samples(run: Trajectory, count: int) -> Trajectory:
    """Return ``run`` reduced to its first ``count`` samples."""
    if count >= len(run.t):
        return run
    per_sample: dict[str, Any] = {
        f.name: value[:count] for f in dataclasses.fields(run) if isinstance(value := getattr(run, f.name), np.ndarray)
    }
    return dataclasses.replace(run, **per_sample)


def finite_length(run: Trajectory) -> int:
    """Return the number of samples before the first that is not finite."""
    if len(run.t) == 0:
        return 0
    columns = (run.light_position, run.heavy_position, run.heavy_velocity)
    bad = ~np.isfinite(np.hstack(columns)).all(axis=1)
    return int(np.argmax(bad)) if bad.any() else len(run.t)


def _without_repetitions(times: list[float]) -> list[float]:
    """Sort ``times``; of those that are equal (one event under two names) keep one."""
    kept: list[float] = []
    for time in sorted(times):
        if not kept or time - kept[-1] > SAME_TIME:
            kept.append(time)
    return kept
