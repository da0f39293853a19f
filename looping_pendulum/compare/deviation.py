"""Where a run leaves the reference: the tube around it, and the first times at which a mass is too far away."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from looping_pendulum.compare.align import Aligned, Reference, sample_reference
from looping_pendulum.reference_ode.geometry import Array, string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.runs.trajectory import SAME_TIME, UNKNOWN_MODE, Trajectory, TrajectoryEvent

HALF_TIME, HALF_WIDTH = 5e-3, 5e-3
"""Half-widths of the tube in time [s] and distance [m]: half of the last digit that the paper prints of each."""

DEPARTURE_THRESHOLDS = (1e-3, 1e-2)
"""Deviations [m] at whose first crossing a departure is recorded.

A 1 % error in mu or M1 moves the ten-to-one trial by about the larger one; the smaller is a tenth of it.
"""

EVENT_DESCRIPTIONS = {
    "release": "the release",
    "stop": "a stop of the heavy mass",
    "stick": "the string began to stick",
    "halt": "the halt",
    "slip_onset": "the string began to slide again",
    "slack": "the string fell slack",
    "taut": "the string became taut again",
    "light_reaches_rod": "the light mass reached the rod",
    "heavy_reaches_rod": "the heavy mass reached the rod",
    "unwrapped": "the string left the rod",
}


@dataclass(frozen=True, kw_only=True)
class Tube:
    """Result of the tube test: how many samples have a point of the reference nearby in time and distance."""

    half_time: float
    """Half-width of the tube in time [s]."""
    half_width: float
    """Half-width of the tube in distance [m]."""
    compared: int
    """Samples that were tested: those before the reference's end."""
    fraction: float | None = None
    """Share of the tested samples that are inside; None if none was tested."""
    first_exit: float | None = None
    """Time of the first sample outside [s]."""


@dataclass(frozen=True, kw_only=True)
class Departure:
    """First time at which a mass is further from the reference's than a threshold, and the state of the reference then."""

    threshold: float
    """Deviation that was exceeded [m]."""
    time: float
    """Time of the first sample beyond it [s]."""
    mode: str
    """Mode of the reference at that time, in words."""
    after: str
    """Last event of the reference before that time; "release" if there was none."""
    after_time: float
    """Time of that event [s]."""
    along: float
    """Deviation of the free length at that time [m]: positive where the engine is further out; 0 without a string."""
    across: float
    """Deviation of the wrap angle, times the free length, at that time [m]: positive where the engine is ahead."""
    heavy: float
    """Deviation of the heavy mass's height at that time [m]."""
    stretch: float | None = None
    """Largest stretch of the string up to that time [m], by the positions of the masses or the engine's own word."""


def events_to_show(events: Iterable[tuple[str, float]]) -> list[tuple[str, float]]:
    """Return (name, time [s]) of the events that a reader should see.

    Of simultaneous events only one is kept: a halt is also a stick and a stop, and is the most informative of the three.
    """
    rank = {name: place for place, name in enumerate(("halt", "stick", "stop"))}
    shown: list[tuple[str, float]] = []
    for name, time in sorted(events, key=lambda e: (e[1], rank.get(e[0], -1))):
        if name == "release" or name not in EVENT_DESCRIPTIONS:
            continue
        if shown and time - shown[-1][1] < SAME_TIME and name in rank:
            continue
        shown.append((name, time))
    return shown


def mode_description(mode: int) -> str:
    """Describe a mode of the reference in plain words."""
    descriptions = {
        Mode.STICKING: "the string sticks to the rod",
        Mode.ROLLING: "the string sticks to the rod, which turns",
        Mode.SLIDING_DOWN: "the string slides and the heavy mass falls",
        Mode.SLIDING_UP: "the string slides and the heavy mass rises",
        Mode.SLACK: "the string is slack",
        Mode.CLAMPED: "the light mass swings and the heavy one is clamped",
        Mode.CLAMPED_SLACK: "the string is slack and the heavy mass clamped",
        Mode.FALLING: "both masses fall freely",
        Mode.ENDED: "the reference ends",
    }
    return "the mode of the reference is unknown" if mode == UNKNOWN_MODE else descriptions[Mode(mode)]


def evaluate_tube(aligned: Aligned, reference: Reference) -> Tube:
    """Test which samples lie in a tube around the reference, in time and amplitude (as Modelica's csv-compare does).

    A sample is inside if some point of the reference's path, within `HALF_TIME` of its time, is within `HALF_WIDTH`.
    """
    parts = 10  # The reference's path is taken as chords of a tenth of it: they miss an arc by microns.
    offsets = np.linspace(-HALF_TIME, HALF_TIME, 2 * parts + 1)
    times = aligned.t[:, None] + offsets[None, :]
    path = sample_reference(reference, times.ravel()).light_position.reshape(*times.shape, 2)
    # Before the release and after the reference's end its path is a point: repeat the nearest known one.
    known = np.isfinite(aligned.reference.light_position).all(axis=1)
    path = np.where(np.isfinite(path), path, aligned.reference.light_position[:, None, :])
    start, chord = path[:, :-1], np.diff(path, axis=1)
    to_sample = aligned.run.light_position[:, None, :] - start
    length_squared = np.maximum((chord**2).sum(axis=2), 1e-30)  # a chord of length 0 must not divide 0 by 0
    fraction_along = np.clip((to_sample * chord).sum(axis=2) / length_squared, 0.0, 1.0)
    distance = np.hypot(*np.moveaxis(to_sample - fraction_along[..., None] * chord, 2, 0))
    inside = np.asarray((distance <= HALF_WIDTH).any(axis=1))
    outside = known & ~inside
    compared = int(known.sum())
    return Tube(
        half_time=HALF_TIME,
        half_width=HALF_WIDTH,
        compared=compared,
        fraction=float((known & inside).sum() / compared) if compared else None,
        first_exit=float(aligned.t[np.argmax(outside)]) if outside.any() else None,
    )


def departures(aligned: Aligned, events: tuple[TrajectoryEvent, ...], stretch: Array | None = None) -> tuple[Departure, ...]:
    """Return the first crossing of each of `DEPARTURE_THRESHOLDS` by one of the masses, with the reference's state then.

    Parameters
    ----------
    stretch
        How much longer the run's string is than it should be [m], shape (n,), see `string_stretch`; None: unknown.
    """
    crossings = []
    stretch = np.full(len(aligned.t), np.nan) if stretch is None else stretch
    # Of both masses: one that is where it should be says nothing of the other
    furthest = np.fmax(aligned.distance, aligned.heavy_distance)
    for threshold in DEPARTURE_THRESHOLDS:
        # NaN, where either run has ended, compares as false
        beyond = np.flatnonzero(furthest > threshold)
        if len(beyond):
            crossings.append(_departure(aligned, int(beyond[0]), threshold, events, stretch))
    return tuple(crossings)


def _departure(aligned: Aligned, i: int, threshold: float, events: tuple[TrajectoryEvent, ...], stretch: Array) -> Departure:
    time, reference, run = float(aligned.t[i]), aligned.reference, aligned.run
    earlier = [("release", 0.0), *events_to_show((e.name, e.time) for e in events if e.time <= time)]
    after, after_time = earlier[-1]
    free_length, angle_error = reference.free_length[i], run.wrap_angle[i] - reference.wrap_angle[i]
    return Departure(
        threshold=threshold,
        time=time,
        mode=mode_description(int(reference.mode[i])),
        after=after,
        after_time=after_time,
        # Lengths and angles are NaN where there is no string
        along=float(np.nan_to_num(run.free_length[i] - free_length)),
        across=float(np.nan_to_num(free_length * angle_error)),
        heavy=float(aligned.heavy_deviation[i]),
        stretch=largest_stretch(stretch[: i + 1]),
    )


def string_stretch(aligned: Aligned, parameters: Parameters) -> Array:
    """Return how much longer the run's string is than it should be [m], shape (n,), by the positions of the masses.

    Its length is that of the straight string, the arc on the rod and the hanging part; it should be that of the reference at
    the same time, or at the release while the reference's string is slack. It is 0 where the string is shorter. Where
    the engine's own word is larger, as of a chain whose links stretch between the masses, that counts.
    """
    own_word = np.abs(aligned.run.string_stretch)
    if parameters.release is Release.DROP:
        return own_word
    exact = _taut_length(aligned.reference, parameters)
    # After the reference's end its length is NaN
    longer = _taut_length(aligned.run, parameters) - np.fmax(exact, exact[:1])
    return np.fmax(np.maximum(longer, 0.0), own_word)


def _taut_length(run: Trajectory, parameters: Parameters) -> Array:
    """Return the length of a taut string between the masses [m], shape (n,)."""
    radius = parameters.rod_radius
    free_length, wrap_angle = string_coordinates(run.light_position, radius, parameters.release_angle)
    hanging = np.hypot(run.heavy_position[:, 0] - radius, run.heavy_position[:, 1])
    return np.asarray(free_length + radius * wrap_angle + hanging)


def largest_stretch(stretch: Array) -> float | None:
    """Return the largest magnitude of a string's stretch [m] in the samples that are finite; None without any."""
    known = stretch[np.isfinite(stretch)]
    return float(np.abs(known).max()) if len(known) else None


def growth_rate(departures: tuple[Departure, ...]) -> float | None:
    """Return the rate [1/s] of the exponential through the first and the last departure; None without two times."""
    if len(departures) < 2 or departures[-1].time <= departures[0].time:
        return None
    return math.log(departures[-1].threshold / departures[0].threshold) / (departures[-1].time - departures[0].time)
