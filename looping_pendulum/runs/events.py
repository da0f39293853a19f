"""Events of a run: stops, rests, slip onsets, the halt, extrema and the arrival at the rod, and the state at the halt.

They come from two sources, as one type. A detector reads them from samples alone: the same one for the reference and for every
engine, so that an engine with the exact motion gets exactly the reference's values. A run of the reference has its own events,
exact to rounding; the difference of the two is the error of the detector on this run.

The detector's resolution is a length and a time: a string that moves by less than `RESOLUTION` rests, and a rest shorter than
`REST_TIME` cannot be distinguished from a turn. Speed is not a criterion: a chain that creeps slowly but far is still sliding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import HasParameters, Parameters, Release, parameters_of
from looping_pendulum.runs.trajectory import SAME_TIME, SAMPLE_INTERVAL, RunStatus, Trajectory, TrajectoryEvent, finite_length

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
    """Motion of the string after its first rest, from which on it stays within `FIRST_REST_RESOLUTION`."""

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

    Read from samples with the resolution `RESOLUTION`; the reference's own events give it to rounding.
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


# ---- the detector: when the string slides, and when it rests


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


# ---- the reference's own events


def exact_landmarks(
    events: Iterable[TrajectoryEvent],
    state_at: Callable[[Sequence[float]], tuple[Array, Array, Array]],
    *,
    x1_extrema: tuple[Extremum, ...],
    y1_extrema: tuple[Extremum, ...],
) -> Landmarks:
    """Return the landmarks of a run of the reference, by its own named events.

    Parameters
    ----------
    state_at
        Function of n of the events' times [s]: how far the heavy mass is below its height at release [m], wrap angle [rad] and
        free length [m] then, each of shape (n,).
    """
    named: dict[str, list[float]] = {}
    for event in events:
        named.setdefault(event.name, []).append(event.time)
    at_rest = named.get("stop", []) + named.get("stick", []) + named.get("halt", [])
    # A string that sticks from the release on has not stopped
    stops = _without_repetitions([time for time in at_rest if time > 0])
    halt = named["halt"][0] if "halt" in named else None
    drops, _, _ = state_at(stops)
    drop, wrap_angle, free_length = (None, None, None) if halt is None else (float(value[0]) for value in state_at([halt]))
    return Landmarks(
        stops=tuple(Stop(time=time, height_change=-float(drop)) for time, drop in zip(stops, drops, strict=True)),
        slip_onsets=tuple(_without_repetitions(named.get("slip_onset", []))),
        halting_time=halt,
        halting_confirmed=halt is not None,
        light_reaches_rod=named["light_reaches_rod"][0] if "light_reaches_rod" in named else None,
        drop_at_halt=drop,
        wrap_angle_at_halt=wrap_angle,
        free_length_at_halt=free_length,
        x1_extrema=x1_extrema,
        y1_extrema=y1_extrema,
    )


def _without_repetitions(times: list[float]) -> list[float]:
    """Sort ``times``; of those that are equal (one event under two names) keep one."""
    kept: list[float] = []
    for time in sorted(times):
        if not kept or time - kept[-1] > SAME_TIME:
            kept.append(time)
    return kept


# ---- quantities of event tables


@dataclass(frozen=True)
class EventQuantity:
    """One quantity of an event table, such as the time of a stop."""

    kind: str
    """"time", "height" (of the heavy mass, less its height at release), "drop" (the same, downward), "length" or "angle"."""
    measured_at: str
    """Name of the quantity that is the time at which this one is measured; a time names itself."""
    several: bool
    """Whether a run can have more than one, distinguished by their index."""
    values: Callable[[Landmarks], Sequence[float | None]]
    """Function that returns all values of it in a run [SI], in order of time; None in place of one that the run lacks."""

    @property
    def unit(self) -> str:
        """Return the SI unit."""
        return {"time": "s", "angle": "rad"}.get(self.kind, "m")


EVENT_QUANTITIES = MappingProxyType(
    {
        "x1_extremum": EventQuantity("time", "x1_extremum", True, lambda m: [e.time for e in m.x1_extrema]),
        "y1_extremum": EventQuantity("time", "y1_extremum", True, lambda m: [e.time for e in m.y1_extrema]),
        "stop_time": EventQuantity("time", "stop_time", True, lambda m: [s.time for s in m.stops]),
        "height_change_at_stop": EventQuantity("height", "stop_time", True, lambda m: [s.height_change for s in m.stops]),
        "slip_onset_time": EventQuantity("time", "slip_onset_time", True, lambda m: m.slip_onsets),
        "t_A": EventQuantity("time", "t_A", False, lambda m: [s.time for s in m.stops[:1]]),
        "height_change_at_A": EventQuantity("height", "t_A", False, lambda m: [s.height_change for s in m.stops[:1]]),
        "t_B": EventQuantity("time", "t_B", False, lambda m: [s.time for s in m.stops[1:2]]),
        "height_change_at_B": EventQuantity("height", "t_B", False, lambda m: [s.height_change for s in m.stops[1:2]]),
        "t_C": EventQuantity(
            "time", "t_C", False, lambda m: [t for t in m.slip_onsets if m.halting_time and t < m.halting_time][-1:]
        ),
        "halting_time": EventQuantity("time", "halting_time", False, lambda m: [m.halting_time]),
        "height_change_at_halt": EventQuantity(
            "height", "halting_time", False, lambda m: [] if m.drop_at_halt is None else [-m.drop_at_halt]
        ),
        "drop_at_halt": EventQuantity("drop", "halting_time", False, lambda m: [m.drop_at_halt]),
        "wrap_angle_at_halt": EventQuantity("angle", "halting_time", False, lambda m: [m.wrap_angle_at_halt]),
        "free_length_at_halt": EventQuantity("length", "halting_time", False, lambda m: [m.free_length_at_halt]),
        "time_light_reaches_rod": EventQuantity("time", "time_light_reaches_rod", False, lambda m: [m.light_reaches_rod]),
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
