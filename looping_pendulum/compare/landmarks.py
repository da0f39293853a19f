"""Reads the landmarks of the reference, and from landmarks the quantities of event tables.

The reference's landmarks come from its own events, and from samples by the detector that also reads the engines'. An engine's
landmarks are compared with those from samples, so that an engine with the exact motion has no errors. The reference's own
events give the same times to rounding; the difference of the two is the error of the detector on this run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from looping_pendulum.compare.align import SAME_TIME, Reference, sample_reference
from looping_pendulum.engines.landmarks import Landmarks, Stop, extrema, run_landmarks
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL
from looping_pendulum.engines.string_motion import MIN_REST
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import DURATION
from looping_pendulum.runs.trajectory import RunStatus, Trajectory, TrajectoryEvent, finite_length, first_samples

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
    heights = at.heavy_position[:, 1]
    release_height = float(heights[0])
    return Landmarks(
        stops=tuple(
            Stop(time=time, height_change=float(height) - release_height)
            for time, height in zip(stops, heights[-len(stops) :], strict=True)
        )
        # Not left to the slice: with no stops, [-0:] is the whole array
        if stops
        else (),
        slip_onsets=times.slip_onsets,
        halting_time=halt,
        halting_confirmed=halt is not None,
        drop_at_halt=None if halt is None else release_height - float(heights[1]),
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


def why_not_comparable(run: Trajectory, own: Landmarks, reference: SampledReference) -> str:
    """Return why the halt of ``run``, or its lack of one, cannot be compared with the reference's; empty: it can.

    A run that ended because its light mass reached the rod is complete. One that was cut must last for `MIN_REST` beyond the
    reference's halt, or it can neither confirm nor refute that halt. If the reference never halts, a cut run that is at rest at
    its end is not comparable where the reference is at rest at that time as well: the reference slides again later.

    Parameters
    ----------
    own
        Landmarks of ``run``.
    """
    if len(run.t) == 0 or run.status is RunStatus.LIGHT_REACHED_ROD:
        return ""
    end, halt = float(run.t[-1]), reference.landmarks_beside().halting_time
    if halt is None:
        if own.halting_time is None or reference.landmarks_until(end).halting_time is None:
            return ""
        return f"the run ends at {end:.3f} s, when its string rests; the reference's rests then too, but slides again later"
    if end >= halt + MIN_REST:
        return ""
    rests = "" if own.halting_time is None else f"; its string rests from {own.halting_time:.3f} s to the end of the run"
    if end < halt:
        return f"the run ends at {end:.3f} s, before the reference halts at {halt:.3f} s{rests}"
    return f"the run ends at {end:.3f} s, less than {MIN_REST * 1e3:.0f} ms after the reference halts at {halt:.3f} s{rests}"


@dataclass(frozen=True, kw_only=True)
class EventQuantity:
    """One quantity of an event table, such as the time of a stop."""

    kind: str
    """"time", "height" (of the heavy mass, less its height at release), "drop" (the same, downward), "length" or "angle"."""
    values: Callable[[Landmarks], Sequence[float | None]]
    """Function that returns all values of it in a run [SI], in order of time; None in place of one that the run lacks."""
    measured_at: str
    """Name of the quantity that is the time at which this one is measured; a time names itself."""
    several: bool
    """Whether a run can have more than one, told apart by their index."""

    @property
    def unit(self) -> str:
        """Return the SI unit."""
        return {"time": "s", "angle": "rad"}.get(self.kind, "m")


_QUANTITIES: tuple[tuple[str, str, str, bool, Callable[[Landmarks], Sequence[float | None]]], ...] = (
    ("x1_extremum", "time", "x1_extremum", True, lambda m: [e.time for e in m.x1_extrema]),
    ("y1_extremum", "time", "y1_extremum", True, lambda m: [e.time for e in m.y1_extrema]),
    ("stop_time", "time", "stop_time", True, lambda m: [s.time for s in m.stops]),
    ("height_change_at_stop", "height", "stop_time", True, lambda m: [s.height_change for s in m.stops]),
    ("slip_onset_time", "time", "slip_onset_time", True, lambda m: m.slip_onsets),
    ("t_A", "time", "t_A", False, lambda m: [s.time for s in m.stops[:1]]),
    ("height_change_at_A", "height", "t_A", False, lambda m: [s.height_change for s in m.stops[:1]]),
    ("t_B", "time", "t_B", False, lambda m: [s.time for s in m.stops[1:2]]),
    ("height_change_at_B", "height", "t_B", False, lambda m: [s.height_change for s in m.stops[1:2]]),
    ("t_C", "time", "t_C", False, lambda m: [t for t in m.slip_onsets if m.halting_time and t < m.halting_time][-1:]),
    ("halting_time", "time", "halting_time", False, lambda m: [m.halting_time]),
    ("height_change_at_halt", "height", "halting_time", False, lambda m: [] if m.drop_at_halt is None else [-m.drop_at_halt]),
    ("drop_at_halt", "drop", "halting_time", False, lambda m: [m.drop_at_halt]),
    ("wrap_angle_at_halt", "angle", "halting_time", False, lambda m: [m.wrap_angle_at_halt]),
    ("free_length_at_halt", "length", "halting_time", False, lambda m: [m.free_length_at_halt]),
    ("time_light_reaches_rod", "time", "time_light_reaches_rod", False, lambda m: [m.light_reaches_rod]),
)
EVENT_QUANTITIES = MappingProxyType(
    {
        name: EventQuantity(kind=kind, measured_at=measured_at, several=several, values=values)
        for name, kind, measured_at, several, values in _QUANTITIES
    }
)
"""Event quantity by name.

As in the paper, A and B are the first two stops of the heavy mass, C is the last slip onset before the halt: the start of
the final plunge. Stops and slip onsets are also there by number. The halt is the start of the rest that lasts to the end."""


def event_value(landmarks: Landmarks, quantity: str, index: int) -> float | None:
    """Return the value [SI] of a quantity of an event table; None where the run has none, or the quantity is not known."""
    known = EVENT_QUANTITIES.get(quantity)
    if known is None or index < 1:
        return None
    values, place = known.values(landmarks), index - 1 if known.several else 0
    return values[place] if place < len(values) else None


def quantity_label(quantity: str, index: int) -> str:
    """Return a label, ("x1_extremum", 3) -> "x1 extremum 3"; the number only where there can be several."""
    several = quantity in EVENT_QUANTITIES and EVENT_QUANTITIES[quantity].several
    return f"{quantity.replace('_', ' ')} {index}" if several else quantity.replace("_", " ")
