"""Numbers that say how far an engine's run is from the reference. Their names are those of `scenarios.scenario.METRICS`."""

from __future__ import annotations

import math

import numpy as np

from looping_pendulum.compare.align import Aligned, Reference, sample_reference
from looping_pendulum.compare.landmarks import finite_length
from looping_pendulum.compare.result import Departure, Landmarks, Tube
from looping_pendulum.compare.words import mode_words, told_events
from looping_pendulum.engines.trajectory import TrajectoryEvent
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.effects import GRAVITY, EffectKind
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

RMS_MARKS = {"rms_0.35s": 0.35, "rms_0.7s": 0.7, "rms_1.0s": 1.0}
"""Metric name -> time [s] up to which the deviation is averaged: the fall, the first loops, nearly all of a trial."""

TUBE = (5e-3, 5e-3)
"""Half-widths of the tube in time [s] and distance [m]: half of the last digit that the paper prints of either."""

THRESHOLDS = (1e-3, 1e-2)
"""Deviations [m] whose first passing is a departure: a tenth of, and about, what a 1 % error in mu or M1 does to ten to one."""

MARK_SLACK = 1e-6
"""A run whose last sample is this close [s] before a mark has reached it."""


def rms_until(aligned: Aligned, mark: float | None) -> float | None:
    """Root mean square of the light mass's deviation over the samples up to ``mark`` [m].

    None without a mark, or if the run or the reference ends before it.
    """
    if mark is None or len(aligned.t) == 0 or aligned.t[-1] < mark - MARK_SLACK:
        return None
    distance = aligned.distance[aligned.t <= mark + MARK_SLACK]
    if not np.isfinite(distance).all():
        return None
    return float(np.sqrt(np.mean(distance**2)))


def tube(aligned: Aligned, reference: Reference, half_time: float = TUBE[0], half_width: float = TUBE[1]) -> Tube:
    """Test which samples lie in a tube around the reference, in time and amplitude (as Modelica's csv-compare does).

    A sample is inside if some point of the reference's path within +/- ``half_time`` of its time is within ``half_width`` of it.
    """
    parts = 10  # The reference's path is taken as chords of a tenth of half_time: they miss an arc by microns.
    offsets = np.linspace(-half_time, half_time, 2 * parts + 1)
    asked = aligned.t[:, None] + offsets[None, :]
    path = sample_reference(reference, asked.ravel()).light_position.reshape(*asked.shape, 2)
    # Before the release and after the reference's end its path is a point: repeat the nearest known one.
    known = np.isfinite(aligned.reference.light_position).all(axis=1)
    path = np.where(np.isfinite(path), path, aligned.reference.light_position[:, None, :])
    start, chord = path[:, :-1], np.diff(path, axis=1)
    to_sample = aligned.run.light_position[:, None, :] - start
    length = np.maximum((chord**2).sum(axis=2), 1e-30)
    share = np.clip((to_sample * chord).sum(axis=2) / length, 0.0, 1.0)
    distance = np.hypot(*np.moveaxis(to_sample - share[..., None] * chord, 2, 0))
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
    """First passings of each of `THRESHOLDS`, with what the reference was doing then."""
    found = []
    for threshold in THRESHOLDS:
        beyond = np.flatnonzero(aligned.distance > threshold)
        if len(beyond):
            found.append(_departure(aligned, int(beyond[0]), threshold, events))
    return tuple(found)


def _departure(aligned: Aligned, i: int, threshold: float, events: tuple[TrajectoryEvent, ...]) -> Departure:
    time, reference, run = float(aligned.t[i]), aligned.reference, aligned.run
    told = [("release", 0.0), *told_events((e.name, e.time) for e in events if e.time <= time)]
    after, after_time = told[-1]
    free_length, turned = reference.free_length[i], run.wrap_angle[i] - reference.wrap_angle[i]
    stretch = run.string_stretch[: i + 1]
    known = stretch[np.isfinite(stretch)]
    return Departure(
        threshold=threshold,
        time=time,
        mode=mode_words(int(reference.mode[i])),
        after=after,
        after_time=after_time,
        along=_number(run.free_length[i] - free_length) or 0.0,
        across=_number(free_length * turned) or 0.0,
        heavy=float(aligned.heavy_deviation[i]),
        stretch=float(np.abs(known).max()) if len(known) else None,
    )


def growth_rate(found: tuple[Departure, ...]) -> float | None:
    """Rate of the exponential through the first and the last departure [1/s]; None if there are not two at two times."""
    if len(found) < 2 or found[-1].time <= found[0].time:
        return None
    return math.log(found[-1].threshold / found[0].threshold) / (found[-1].time - found[0].time)


def acceleration(t: Array, drop: Array) -> float | None:
    """Constant acceleration of least squares through ``drop`` [m] from rest at t = 0 [m/s^2]."""
    weight = float((t**4).sum())
    return float(2 * (drop * t**2).sum() / weight) if weight > 0 and np.isfinite(drop).all() else None


def drag_acts(parameters: Parameters) -> bool:
    """Whether a force other than gravity acts on the masses, so that no acceleration is constant."""
    return any(
        effect.kind is EffectKind.FORCE
        and effect is not GRAVITY
        and any(parameters.coefficients[c.name] != c.null for c in effect.coefficients)
        for effect in parameters.effects
    )


def acceleration_error(aligned: Aligned, parameters: Parameters) -> float | None:
    """Relative error of the heavy mass's fitted acceleration in a vertical release.

    Against the closed form; with drag, where that does not hold, against the same fit through the reference at the same times.
    """
    if parameters.release is not Release.VERTICAL:
        return None
    known = np.isfinite(aligned.heavy_deviation)
    if known.sum() < 3:
        return None
    t = aligned.t[known]
    fitted = acceleration(t, aligned.run.heavy_drop[known])
    height = aligned.reference.heavy_height[known]
    exact = acceleration(t, height[0] - height) if drag_acts(parameters) else atwood_acceleration(parameters)
    return None if fitted is None or not exact else fitted / exact - 1


def metrics(
    aligned: Aligned, parameters: Parameters, own: Landmarks, true: Landmarks, in_tube: Tube, *, comparable: bool = True
) -> dict[str, float | None]:
    """Every metric of one run, SI; None where it cannot be said.

    Parameters
    ----------
    own, true
        Landmarks of the run's samples and of the reference's, by the same detector.
    comparable
        Whether both were watched long enough to hold their halts against each other (`watching`).
    """
    halts = comparable and own.halting_time is not None and true.halting_time is not None

    def at_halt(name: str) -> float | None:
        return _difference(getattr(own, name), getattr(true, name)) if halts else None

    samples = finite_length(aligned.run)
    stretch = aligned.run.string_stretch[:samples]
    known = stretch[np.isfinite(stretch)]
    return {
        **{name: rms_until(aligned, mark) for name, mark in RMS_MARKS.items()},
        "rms_halt": rms_until(aligned, true.halting_time),
        "halting_time_error": at_halt("halting_time"),
        "rebound": None if own.rebound is None else own.rebound.travel,
        "drop_error": at_halt("drop_at_halt"),
        "wrap_angle_error": at_halt("wrap_angle_at_halt"),
        "free_length_error": at_halt("free_length_at_halt"),
        "string_stretch": float(np.abs(known).max()) if len(known) else None,
        "acceleration_error": acceleration_error(aligned, parameters),
        "tube_fraction": in_tube.fraction,
        "simulated_time": float(aligned.run.t[samples - 1]) if samples else None,
    }


def _difference(own: float | None, true: float | None) -> float | None:
    return None if own is None or true is None else _number(own - true)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
