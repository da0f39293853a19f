"""How far an engine's run is from the reference: a function for each metric that `scenarios.metrics.METRICS` specifies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from looping_pendulum.compare.align import Aligned, Reference, sample_reference
from looping_pendulum.compare.result import Departure, Tube
from looping_pendulum.compare.stories import events_to_show, mode_description
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.effects import GRAVITY, EffectKind
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.events import Landmarks
from looping_pendulum.runs.trajectory import TrajectoryEvent, finite_length
from looping_pendulum.scenarios.metrics import METRICS, RMS_END_TIMES

TUBE = (5e-3, 5e-3)
"""Half-widths of the tube in time [s] and distance [m]: half of the last digit that the paper prints of each."""

DEPARTURE_THRESHOLDS = (1e-3, 1e-2)
"""Deviations [m] at whose first crossing a departure is recorded.

A 1 % error in mu or M1 moves the ten-to-one trial by about the larger one; the smaller is a tenth of it.
"""

END_TIME_TOLERANCE = 1e-6
"""A run whose last sample is at most this long [s] before an end time counts as reaching it: for rounding."""


def rms_until(aligned: Aligned, end_time: float | None) -> float | None:
    """Return the root mean square of the light mass's deviation over the samples up to ``end_time`` [m].

    None without an end time, or if the run or the reference ends before it.
    """
    if end_time is None or len(aligned.t) == 0 or aligned.t[-1] < end_time - END_TIME_TOLERANCE:
        return None
    distance = aligned.distance[aligned.t <= end_time + END_TIME_TOLERANCE]
    if not np.isfinite(distance).all():
        return None
    return float(np.sqrt(np.mean(distance**2)))


def evaluate_tube(aligned: Aligned, reference: Reference, half_time: float = TUBE[0], half_width: float = TUBE[1]) -> Tube:
    """Test which samples lie in a tube around the reference, in time and amplitude (as Modelica's csv-compare does).

    A sample is inside if some point of the reference's path, within +/- ``half_time`` of its time, is within ``half_width``.
    """
    parts = 10  # The reference's path is taken as chords of a tenth of half_time: they miss an arc by microns.
    offsets = np.linspace(-half_time, half_time, 2 * parts + 1)
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
    inside = np.asarray((distance <= half_width).any(axis=1))
    outside = known & ~inside
    compared = int(known.sum())
    return Tube(
        half_time=half_time,
        half_width=half_width,
        compared=compared,
        fraction=float((known & inside).sum() / compared) if compared else None,
        first_exit=float(aligned.t[np.argmax(outside)]) if outside.any() else None,
    )


def departures(aligned: Aligned, events: tuple[TrajectoryEvent, ...]) -> tuple[Departure, ...]:
    """Return the first crossing of each of `DEPARTURE_THRESHOLDS`, with the state of the reference at that time."""
    crossings = []
    for threshold in DEPARTURE_THRESHOLDS:
        # NaN, where either run has ended, compares as false
        beyond = np.flatnonzero(aligned.distance > threshold)
        if len(beyond):
            crossings.append(_departure(aligned, int(beyond[0]), threshold, events))
    return tuple(crossings)


def _departure(aligned: Aligned, i: int, threshold: float, events: tuple[TrajectoryEvent, ...]) -> Departure:
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
        along=_number(run.free_length[i] - free_length) or 0.0,
        across=_number(free_length * angle_error) or 0.0,
        heavy=float(aligned.heavy_deviation[i]),
        stretch=largest_stretch(run.string_stretch[: i + 1]),
    )


def largest_stretch(stretch: Array) -> float | None:
    """Return the largest magnitude of a string's stretch [m] in the samples that are finite; None without any."""
    known = stretch[np.isfinite(stretch)]
    return float(np.abs(known).max()) if len(known) else None


def growth_rate(departures: tuple[Departure, ...]) -> float | None:
    """Return the rate [1/s] of the exponential through the first and the last departure; None without two times."""
    if len(departures) < 2 or departures[-1].time <= departures[0].time:
        return None
    return math.log(departures[-1].threshold / departures[0].threshold) / (departures[-1].time - departures[0].time)


def fitted_acceleration(t: Array, drop: Array) -> float | None:
    """Return the constant acceleration [m/s^2] that fits ``drop`` [m], from rest at t = 0, by least squares."""
    # The drop is a t^2 / 2, so that least squares give a = 2 sum(drop t^2) / sum(t^4)
    weight = float((t**4).sum())
    return float(2 * (drop * t**2).sum() / weight) if weight > 0 and np.isfinite(drop).all() else None


def drag_acts(parameters: Parameters) -> bool:
    """Return whether a force other than gravity acts on the masses, so that no acceleration is constant."""
    return any(
        effect.kind is EffectKind.FORCE
        and effect is not GRAVITY
        and any(parameters.coefficients[c.name] != c.null for c in effect.coefficients)
        for effect in parameters.effects
    )


def acceleration_error(aligned: Aligned, parameters: Parameters) -> float | None:
    """Return the relative error of the heavy mass's fitted acceleration in a vertical release.

    The exact value is the closed form; with drag, where that does not hold, the same fit to the reference at the same times.
    """
    if parameters.release is not Release.VERTICAL:
        return None
    known = np.isfinite(aligned.heavy_deviation)
    if known.sum() < 3:
        return None
    t = aligned.t[known]
    fitted = fitted_acceleration(t, aligned.run.heavy_drop[known])
    height = aligned.reference.heavy_position[known, 1]
    # With the same fit on both sides, an engine with the exact motion has no error, although its acceleration is not constant
    exact = fitted_acceleration(t, height[0] - height) if drag_acts(parameters) else atwood_acceleration(parameters)
    return None if fitted is None or not exact else fitted / exact - 1


@dataclass(frozen=True, kw_only=True)
class ComparedRun:
    """One engine's run beside the reference: all from which its metrics are computed."""

    aligned: Aligned
    parameters: Parameters
    landmarks: Landmarks
    """Landmarks of the run's samples."""
    reference_landmarks: Landmarks
    """Landmarks of the reference's samples, found by the same detector."""
    tube: Tube
    """Result of `evaluate_tube`."""
    comparable: bool = True
    """Whether both runs are long enough to compare their halting times (`landmarks.why_not_comparable`)."""


MetricFunction = Callable[[ComparedRun], float | None]
"""Function that returns a metric's value [SI] for a run; None where it is not defined."""
FUNCTIONS: dict[str, MetricFunction] = {}
"""Metric -> the function that computes it; `metric` registers it."""


def metric(name: str) -> Callable[[MetricFunction], MetricFunction]:
    """Return a decorator for the function that computes the metric ``name`` of `scenarios.metrics.METRICS`."""
    specification = METRICS[name]

    def register(function: MetricFunction) -> MetricFunction:
        FUNCTIONS[specification.name] = function
        return function

    return register


@metric("rms_0.35s")
def rms_of_the_fall(run: ComparedRun) -> float | None:
    """Return the root mean square of the light mass's deviation until about the halt of a trial at ten to one [m]."""
    return rms_until(run.aligned, RMS_END_TIMES["rms_0.35s"])


@metric("rms_0.7s")
def rms_of_the_first_loops(run: ComparedRun) -> float | None:
    """Return the root mean square of the light mass's deviation until it has looped some times [m]."""
    return rms_until(run.aligned, RMS_END_TIMES["rms_0.7s"])


@metric("rms_1.0s")
def rms_of_nearly_all(run: ComparedRun) -> float | None:
    """Return the root mean square of the light mass's deviation over nearly all of a trial [m]."""
    return rms_until(run.aligned, RMS_END_TIMES["rms_1.0s"])


@metric("rms_halt")
def rms_until_halt(run: ComparedRun) -> float | None:
    """Return the root mean square of the light mass's deviation up to the reference's halt [m]."""
    return rms_until(run.aligned, run.reference_landmarks.halting_time)


@metric("halting_time_error")
def halting_time_error(run: ComparedRun) -> float | None:
    """Return the halting time less the reference's [s]."""
    return error_at_halt(run, run.landmarks.halting_time, run.reference_landmarks.halting_time)


@metric("rebound")
def rebound(run: ComparedRun) -> float | None:
    """Return the distance between the string's extreme positions after its first rest [m]."""
    return None if run.landmarks.rebound is None else run.landmarks.rebound.travel


@metric("drop_error")
def drop_error(run: ComparedRun) -> float | None:
    """Return the heavy mass's drop at the halt less the reference's [m]."""
    return error_at_halt(run, run.landmarks.drop_at_halt, run.reference_landmarks.drop_at_halt)


@metric("wrap_angle_error")
def wrap_angle_error(run: ComparedRun) -> float | None:
    """Return the wrap angle at the halt less the reference's [rad]."""
    return error_at_halt(run, run.landmarks.wrap_angle_at_halt, run.reference_landmarks.wrap_angle_at_halt)


@metric("free_length_error")
def free_length_error(run: ComparedRun) -> float | None:
    """Return the free length at the halt less the reference's [m]."""
    return error_at_halt(run, run.landmarks.free_length_at_halt, run.reference_landmarks.free_length_at_halt)


@metric("string_stretch")
def string_stretch(run: ComparedRun) -> float | None:
    """Return the largest magnitude of the stretch in the samples that are finite [m]."""
    return largest_stretch(run.aligned.run.string_stretch[: finite_length(run.aligned.run)])


@metric("acceleration_error")
def relative_acceleration_error(run: ComparedRun) -> float | None:
    """Return the relative error of the heavy mass's acceleration in a vertical release; see `acceleration_error`."""
    return acceleration_error(run.aligned, run.parameters)


@metric("tube_fraction")
def tube_fraction(run: ComparedRun) -> float | None:
    """Return the share of the samples that lie in the tube around the reference."""
    return run.tube.fraction


@metric("simulated_time")
def simulated_time(run: ComparedRun) -> float | None:
    """Return the time of the last finite sample [s]."""
    samples = finite_length(run.aligned.run)
    return float(run.aligned.run.t[samples - 1]) if samples else None


def error_at_halt(run: ComparedRun, own: float | None, expected: float | None) -> float | None:
    """Return ``own`` less the reference's ``expected``; None unless both halt and their halts are comparable."""
    both_halt = run.landmarks.halting_time is not None and run.reference_landmarks.halting_time is not None
    if not (run.comparable and both_halt) or own is None or expected is None:
        return None
    return _number(own - expected)


def metrics(run: ComparedRun) -> dict[str, float | None]:
    """Return every metric of one run, SI; None where it is not defined."""
    return {name: FUNCTIONS[name](run) for name in METRICS}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
