"""Landmarks of a run: stops, halting time, slip onsets, extrema, and the state of the apparatus at the halt.

Engines and reference are read by the same detector (`string_motion`), from samples at the same times, so that an engine with
the exact motion gets exactly the reference's values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.string_motion import (
    FIRST_REST_RESOLUTION,
    RESOLUTION,
    RESOLUTIONS,
    find_rests,
    halting_time,
    slip_distance,
    slip_onset,
    turning_points,
)
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import HasParameters, Parameters, Release, parameters_of
from looping_pendulum.runs.trajectory import RunStatus, Trajectory, finite_length

EXTREMUM_BAND = 1e-3
"""Smallest turn of a coordinate that counts as an extremum [m]; smaller ones are noise."""

RELEASES_WITHOUT_STOPS = (Release.HELD, Release.DROP)
"""Releases whose heavy mass cannot stop: it is clamped, or falls freely."""


@dataclass(frozen=True, kw_only=True)
class Stop:
    """An instant at which the heavy mass's speed is zero."""

    time: float
    """[s]"""
    height_change: float
    """Height of the heavy mass less its height at release [m]; negative below."""


@dataclass(frozen=True, kw_only=True)
class Extremum:
    """An extremum of a coordinate."""

    time: float
    """[s]"""
    value: float
    """[m]"""


@dataclass(frozen=True, kw_only=True)
class HaltingTimeAt:
    """The halting time that the detector finds with one resolution."""

    resolution: float
    """Largest motion of the string that does not count as sliding [m]."""
    time: float | None
    """[s]; None if the string slid by more until the end of the run."""


@dataclass(frozen=True, kw_only=True)
class Rebound:
    """Motion of the string after its first rest, from which on it stays within `string_motion.FIRST_REST_RESOLUTION`."""

    travel: float
    """Distance between the extreme positions [m]."""
    speed: float
    """Largest mean speed over one sample interval [m/s]."""


@dataclass(frozen=True, kw_only=True)
class Landmarks:
    """Landmarks of one run: times of events, and the state of the apparatus at the halt."""

    stops: tuple[Stop, ...] = ()
    """Stops of the string: it turns, or comes to rest."""
    slip_onsets: tuple[float, ...] = ()
    """Times at which a string at rest began to slide again [s]."""
    halting_time: float | None = None
    """Time at which the string stops sliding for good: until the light mass reaches the rod, or the run ends [s].

    Read from samples with the resolution `string_motion.RESOLUTION`; the reference's own events give it to rounding.
    """
    halting_confirmed: bool = False
    """Whether that rest lasted until the light mass reached the rod; if not, the run was cut during the rest."""
    halting_times: tuple[HaltingTimeAt, ...] = ()
    """Halting times with several resolutions, the finest first; empty for landmarks that come from exact events."""
    halting_time_uncertainty: float | None = None
    """Largest distance of the other `halting_times` from the halting time [s]; None: no halt."""
    rebound: Rebound | None = None
    """Motion after the first rest; None where the string never comes to rest."""
    drop_at_halt: float | None = None
    """How far the heavy mass is below its height at release, at the halt [m]."""
    wrap_angle_at_halt: float | None = None
    """Wrap angle at the halt [rad]."""
    free_length_at_halt: float | None = None
    """Free length at the halt [m]."""
    light_reaches_rod: float | None = None
    """Time at which the light mass reaches the rod [s], beyond the last sample; the reference's events give it to rounding."""
    x1_extrema: tuple[Extremum, ...] = ()
    """Extrema of the light mass's x."""
    y1_extrema: tuple[Extremum, ...] = ()
    """Extrema of the light mass's y."""

    @property
    def at_least(self) -> str:
        """Return the words before the uncertainty: it is a lower bound if there is no halt with some resolution."""
        return "at least " if self.halting_time is not None and any(each.time is None for each in self.halting_times) else ""


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


def run_landmarks(run: Trajectory, parameters: Parameters | HasParameters) -> Landmarks:
    """Return the landmarks of a run, an engine's or the reference's, from its samples alone.

    Parameters
    ----------
    run
        The run.
    parameters
        Those that it ran with; or its scenario, which has them.
    """
    parameters = parameters_of(parameters)
    count = finite_length(run)
    t = run.t[:count]
    if count < 3:
        return Landmarks()
    ended = run.status is RunStatus.LIGHT_REACHED_ROD
    light = run.light_position[:count]
    fields: dict[str, Any] = {
        "light_reaches_rod": arrival_time(t, run.free_length[:count], parameters) if ended else None,
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
    rebound = None
    if first_rest is not None:
        after = np.flatnonzero(t >= first_rest)
        speeds = np.abs(np.diff(slip[after]) / np.diff(t[after]))
        rebound = Rebound(travel=float(np.ptp(slip[after])), speed=float(speeds.max(initial=0.0)))
    return Landmarks(
        stops=tuple(
            Stop(time=rest.stop, height_change=-at(rest.stop, run.heavy_drop)) for rest in stops_and_rests if rest.stop > t[0]
        ),
        slip_onsets=tuple(onset for onset in onsets if onset is not None),
        halting_time=halt,
        halting_confirmed=halt is not None and ended,
        halting_times=times,
        halting_time_uncertainty=None
        if halt is None
        else max(abs(each.time - halt) for each in times if each.time is not None),
        rebound=rebound,
        drop_at_halt=None if halt is None else at(halt, run.heavy_drop),
        wrap_angle_at_halt=None if halt is None else at(halt, run.wrap_angle),
        free_length_at_halt=None if halt is None else at(halt, run.free_length),
        **fields,
    )


def arrival_time(t: Array, free_length: Array, parameters: Parameters) -> float:
    """Return the time [s] at which the light mass reaches the rod, from the last two samples before it.

    A light mass that loops keeps its speed w across the string, so that l l' = -R w: the square of the free length falls
    evenly. In a vertical release the free length itself does.
    """
    power = 1 if parameters.release is Release.VERTICAL else 2
    before, last, end = (float(length) ** power for length in (free_length[-2], free_length[-1], parameters.end_length))
    if not end < last < before:
        return float(t[-1])
    return float(t[-1] + (t[-1] - t[-2]) * (last - end) / (before - last))
