"""The metrics: how far an engine's run is from the reference, a function with its specification for each.

Another package adds one in the same way (docs/write-a-metric.md).
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from looping_pendulum.compare.align import Aligned
from looping_pendulum.compare.deviation import Tube, largest_stretch
from looping_pendulum.pages.numbers import DisplayUnit
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.effects import GRAVITY, EffectKind
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.events import Landmarks
from looping_pendulum.runs.trajectory import finite_length
from looping_pendulum.scenarios.metrics import METRICS, Metric, MetricWarning, metric

RMS_END_TIMES = MappingProxyType({f"rms_{end_time}s": end_time for end_time in (0.35, 0.7, 1.0)})
"""Metric -> time [s] up to which the deviation is averaged: the fall, the first loops, nearly all of a trial."""

END_TIME_TOLERANCE = 1e-6
"""A run whose last sample is at most this long [s] before an end time counts as reaching it: for rounding."""

SECONDS = DisplayUnit("s", 1.0)


@dataclass(frozen=True, kw_only=True)
class ComparedRun:
    """One engine's run beside the reference: all from which its metrics are computed."""

    aligned: Aligned
    """The run, and the reference at the run's own sample times."""
    parameters: Parameters
    """Parameters of the scenario."""
    landmarks: Landmarks
    """Landmarks of the run's samples."""
    reference_landmarks: Landmarks
    """Landmarks of the reference's samples, found by the same detector."""
    tube: Tube
    """Result of `evaluate_tube`."""
    stretch: Array
    """How much longer the run's string is than it should be [m], shape (n,); see `deviation.string_stretch`."""
    comparable: bool = True
    """Whether both runs are long enough to compare their halting times (`landmarks.why_not_comparable`)."""


def metrics(run: ComparedRun) -> dict[str, float | None]:
    """Return every metric of one run, SI; None where it is not defined."""
    return {name: _value(each, run) for name, each in METRICS.items()}


def _value(metric: Metric, run: ComparedRun) -> float | None:
    """Return a metric's value; a function of another package that fails costs its own value alone."""
    if metric.function.__module__ == __name__:
        return metric.function(run)
    try:
        value = metric.function(run)
        return None if value is None else _finite(float(value))
    except Exception as error:
        why = " ".join(f"{type(error).__name__}: {error}".split())
        message = f"metric {metric.name!r} has no value for {run.aligned.run.label}: {metric.function.__module__}: {why}"
        warnings.warn(MetricWarning(f"{message}; correct that function"), stacklevel=2)
        return None


@metric("rms_0.35s", unit="m", heading="RMS to 0.35 s", table="")
def rms_of_the_fall(run: ComparedRun) -> float | None:
    """Root mean square distance of the light mass from the reference's in the first 0.35 s."""
    return rms_until(run.aligned, 0.35)


@metric("rms_0.7s", unit="m", heading="RMS to 0.7 s", table="")
def rms_of_the_first_loops(run: ComparedRun) -> float | None:
    """Root mean square distance of the light mass from the reference's in the first 0.7 s."""
    return rms_until(run.aligned, 0.7)


@metric("rms_1.0s", unit="m", heading="RMS to 1.0 s", table="")
def rms_of_nearly_all(run: ComparedRun) -> float | None:
    """Root mean square distance of the light mass from the reference's in the first 1.0 s."""
    return rms_until(run.aligned, 1.0)


@metric("rms_halt", unit="m", heading="RMS to halt", table="")
def rms_until_halt(run: ComparedRun) -> float | None:
    """Root mean square distance of the light mass from the reference's until the reference halts."""
    return rms_until(run.aligned, run.reference_landmarks.halting_time)


@metric(unit="s", heading="halting error", has_sign=True, table="")
def halting_time_error(run: ComparedRun) -> float | None:
    """Halting time less the reference's."""
    return error_at_halt(run, run.landmarks.halting_time, run.reference_landmarks.halting_time)


@metric(unit="m", heading="rebound", table="")
def rebound(run: ComparedRun) -> float | None:
    """Distance between the string's extreme positions after its first rest."""
    return None if run.landmarks.rebound is None else run.landmarks.rebound.travel


@metric(unit="m", heading="drop error", has_sign=True, table="")
def drop_error(run: ComparedRun) -> float | None:
    """Drop of the heavy mass at the halt less the reference's."""
    return error_at_halt(run, run.landmarks.drop_at_halt, run.reference_landmarks.drop_at_halt)


@metric(unit="rad", heading="wrap angle error", has_sign=True, table="")
def wrap_angle_error(run: ComparedRun) -> float | None:
    """Wrap angle at the halt less the reference's."""
    return error_at_halt(run, run.landmarks.wrap_angle_at_halt, run.reference_landmarks.wrap_angle_at_halt)


@metric(unit="m", heading="free length error", has_sign=True, table="")
def free_length_error(run: ComparedRun) -> float | None:
    """Free length at the halt less the reference's."""
    return error_at_halt(run, run.landmarks.free_length_at_halt, run.reference_landmarks.free_length_at_halt)


@metric(unit="m", heading="stretch", table="")
def string_stretch(run: ComparedRun) -> float | None:
    """Largest stretch of the string, by the positions of the masses or the engine's own word, whichever is larger."""
    return largest_stretch(run.stretch)


@metric("acceleration_error", unit="", heading="acceleration error", has_sign=True, table="")
def relative_acceleration_error(run: ComparedRun) -> float | None:
    """Relative error of the heavy mass's acceleration in a vertical release."""
    return acceleration_error(run.aligned, run.parameters)


@metric(unit="", heading="in tube", has_lower_limit=True, table="")
def tube_fraction(run: ComparedRun) -> float | None:
    """Share of the samples that lie in the tube around the reference."""
    return run.tube.fraction


@metric(unit="s", shown_in=SECONDS, heading="simulated time", has_lower_limit=True, table="")
def simulated_time(run: ComparedRun) -> float | None:
    """Time of the run's last sample."""
    samples = finite_length(run.aligned.run)
    return float(run.aligned.run.t[samples - 1]) if samples else None


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


def error_at_halt(run: ComparedRun, own: float | None, expected: float | None) -> float | None:
    """Return ``own`` less the reference's ``expected``; None unless both halt and their halts are comparable."""
    both_halt = run.landmarks.halting_time is not None and run.reference_landmarks.halting_time is not None
    if not (run.comparable and both_halt) or own is None or expected is None:
        return None
    return _finite(own - expected)


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


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
