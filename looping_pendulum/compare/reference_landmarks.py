"""Reads the landmarks of the reference: from its own events, and from samples by the detector that also reads the engines'.

An engine's landmarks are compared with those from samples, so that an engine with the exact motion has no errors. The
reference's own events give the same times to rounding; the difference of the two is the error of the detector on this run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from looping_pendulum.compare.align import SAME_TIME, Reference, sample_reference
from looping_pendulum.engines.landmarks import Landmarks, Stop, extrema, run_landmarks
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.engines.trajectory import RunStatus, Trajectory, TrajectoryEvent, finite_length, first_samples
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import DURATION

LENGTH_ROUNDING = 1e-9
"""Difference of two lengths that is due to rounding [m]."""


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
    return EventTimes(
        # A string that sticks from the release on has not stopped.
        stops=tuple(_without_repetitions([time for time in at_rest if time > 0])),
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
        # Not left to the slice: with no stops, [-0:] is the whole array
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
        # As long as the reference goes, because only what follows it shows whether a rest is the halt
        whole = reference(np.arange(round(DURATION / SAMPLE_INTERVAL) + 1, dtype=np.float64) * SAMPLE_INTERVAL)
        ended = reference_event_times(whole.events).light_reaches_rod is not None
        self.parameters = parameters
        # The detector takes a rest for a confirmed halt by this status, as it does for an engine's run
        self.run = dataclasses.replace(whole, status=RunStatus.LIGHT_REACHED_ROD if ended else RunStatus.FINISHED)
        """The run from the release to the reference's own end, which may be later than the scenario's."""
        # Kept, since it is asked for beside every engine
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
        # One chain of comparisons: both runs ended because the light mass reached the rod
        if run is None or not self.run.status is run.status is RunStatus.LIGHT_REACHED_ROD:
            return self._whole
        shortest = run.free_length[finite_length(run) - 1] - LENGTH_ROUNDING
        shorter = np.flatnonzero(self.run.free_length < shortest)
        return run_landmarks(first_samples(self.run, int(shorter[0]) if len(shorter) else len(self.run.t)), self.parameters)


def _without_repetitions(times: list[float]) -> list[float]:
    """Sort ``times``; of those that are equal (one event under two names) keep one."""
    kept: list[float] = []
    for time in sorted(times):
        if not kept or time - kept[-1] > SAME_TIME:
            kept.append(time)
    return kept
