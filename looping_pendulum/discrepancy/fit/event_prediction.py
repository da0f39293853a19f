"""Predict the rows of an event table: stops, slip onsets, the halt and extrema of a run, as the camera would have timed them.

Stops, slip onsets, the halt and the end are events of the run, exact to the tolerance of a step. Extrema are those of the
light mass's position in the picture: zeros of the velocity, by cubic Hermite interpolation of samples a millisecond apart,
which is good to 0.1 us and smooth in the parameters. The file's clock shows (t - clock_offset) / clock_ratio at the time t, and
a length is measured as scale times itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.engines.reference import event_names
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.measurement import FIT_TOLERANCE, PLACING_ENTRIES, differentiate
from looping_pendulum.measured.observations import DataError, EventObservation, Observations
from looping_pendulum.reference_ode.geometry import Array, light_velocity, xy_pairs
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.sensitivity import DifferentiatedRun, run_with_derivatives
from looping_pendulum.reference_ode.solution import Samples, light_mass_position, string_overlap
from looping_pendulum.reference_ode.solve import DURATION, solve_at
from looping_pendulum.reference_ode.state import State, heavy_drop
from looping_pendulum.runs.events import (
    EVENT_QUANTITIES,
    EXTREMUM_BAND,
    EventQuantity,
    Extremum,
    Landmarks,
    event_value,
    exact_landmarks,
    turning_points,
)
from looping_pendulum.scenarios.document import quote

SAMPLE_STEP = 1e-3
"""Time step of the samples in which extrema are looked for [s]; the sixth turn of the paper's 10:1 trial lasts 120 ms."""
MISSED_EVENT_ERRORS = 100.0
"""Residual, in standard errors, of a measured event that does not happen in the model's run.

It is more than that of any event that does happen after the first iterations, so that a fit never gains by losing an event. How
far the event would have to move to happen is not known, so the value means "qualitatively wrong" and no more.
"""
_SAMPLE_TIMES: Array = np.arange(round(DURATION / SAMPLE_STEP) + 1, dtype=np.float64) * SAMPLE_STEP


def check_event_rows(observations: Observations) -> None:
    """Refuse rows of an event table that no model can predict.

    Raises
    ------
    DataError
        If a quantity, unit or index is unknown or occurs twice; the message names the file and the row.
    """
    earlier_rows: set[tuple[str, int]] = set()
    for row in observations.events:
        where = f"{observations.file}: {quote(row.quantity)} {row.index}"
        known = EVENT_QUANTITIES.get(row.quantity)
        if known is None:
            names = ", ".join(EVENT_QUANTITIES)
            raise DataError(f"{where}: found an unknown quantity, needed one of: {names}; rename it or delete the row")
        if known.unit != row.unit:
            raise DataError(f"{where}: found the unit {quote(row.unit)}, needed one that converts to {known.unit}; correct it")
        if row.index > 1 and not known.several:
            raise DataError(f"{where}: found index {row.index}, needed 1: a run has one of it; correct the index")
        if (row.quantity, row.index) in earlier_rows:
            raise DataError(f"{where}: found it in a second table, needed it once; delete one")
        earlier_rows.add((row.quantity, row.index))


def run_for_events(parameters: Parameters) -> Samples:
    """Run to the end, which the halt needs, with the samples that extrema need."""
    return solve_at(parameters, _SAMPLE_TIMES, duration=DURATION, tolerance=FIT_TOLERANCE)


def predict_events(parameters: Parameters, camera: Camera, rows: Sequence[EventObservation]) -> Array:
    """Predict the measured values of rows [SI], shape (n,); NaN: the event does not happen in this run."""
    return measured_values(landmarks(run_for_events(parameters), camera), camera, rows)


def predict_events_with_derivatives(
    parameters: Parameters, camera: Camera, rows: Sequence[EventObservation], wrt: Sequence[str], camera_wrt: Sequence[str]
) -> tuple[Array, Array]:
    """Predict the same, shape (n,), with derivatives, shape (n, m).

    Derivatives are by parameters of the model and then by values of the camera: 0 of an event that does not happen, nan where
    none exist (`run_with_derivatives`). What is measured at an event changes at fixed time, and as the event moves.
    """
    found = landmarks(run_for_events(parameters), camera)
    values = measured_values(found, camera, rows)
    derivatives = np.zeros((len(values), len(wrt) + len(camera_wrt)))
    happens = [i for i, value in enumerate(values) if math.isfinite(value)]
    if not happens:
        return values, derivatives
    quantities = [EVENT_QUANTITIES[rows[i].quantity] for i in happens]
    times = np.array([event_value(found, q.measured_at, rows[i].index) for q, i in zip(quantities, happens, strict=True)])
    t, place = np.unique(times, return_inverse=True)
    run = run_with_derivatives(parameters, t, wrt, duration=DURATION, tolerance=FIT_TOLERANCE)

    def measured(state: State, p: SimpleNamespace, camera: Camera) -> Array:
        drop = heavy_drop(np, state, string_overlap(state, run.effects), p, run.effects)
        true = {"time": t, "height": -drop, "drop": drop, "length": state.free_length, "angle": state.wrap_angle}
        values = [_as_measured(true[q.kind][..., i], q.kind, camera) for q, i in zip(quantities, place, strict=True)]
        return np.stack(np.broadcast_arrays(*values), axis=-1)

    _, slopes, by_time = differentiate(measured, run, place, PLACING_ENTRIES, camera, camera_wrt)
    by_time = np.where([q.kind == "time" for q in quantities], 1 / camera.clock_ratio, by_time)
    derivatives[happens] = slopes + by_time[:, None] * _slopes_of_times(run, place, quantities, camera, camera_wrt)
    return values, derivatives


def landmarks(samples: Samples, camera: Camera) -> Landmarks:
    """Return the landmarks of a run by its own events [SI, true time]; extrema are those in the picture."""
    run = samples.run
    # The times below are those of the events themselves, equal in every bit, so that they can be keys
    states = {event.time: event.state for event in run.events}

    def state_at(times: Sequence[float]) -> tuple[Array, Array, Array]:
        then = [states[time] for time in times]
        values = [(run.heavy_drop(state), state.wrap_angle, state.free_length) for state in then]
        drop, wrap_angle, free_length = np.array(values, dtype=float).reshape(-1, 3).T
        return drop, wrap_angle, free_length

    # Scale and origin do not change when the extrema are
    unscaled = replace(camera, scale=1.0, origin_x=0.0, origin_y=0.0)
    position = unscaled.project(samples.light_position)
    velocity = unscaled.project_displacement(samples.light_position, samples.light_velocity)
    x1, y1 = (_extrema_of_coordinate(samples.t, position[:, i], velocity[:, i]) for i in (0, 1))
    return exact_landmarks(event_names(run), state_at, x1_extrema=x1, y1_extrema=y1)


def measured_values(found: Landmarks, camera: Camera, rows: Sequence[EventObservation]) -> Array:
    """Return the measured values of rows [SI], shape (n,); NaN: the event does not happen."""
    values = [event_value(found, row.quantity, row.index) for row in rows]
    kinds = [EVENT_QUANTITIES[row.quantity].kind for row in rows]
    measured = [math.nan if v is None else _as_measured(v, kind, camera) for v, kind in zip(values, kinds, strict=True)]
    return np.array(measured, dtype=float)


def _slopes_of_times(
    run: DifferentiatedRun,
    place: NDArray[np.intp],
    quantities: Sequence[EventQuantity],
    camera: Camera,
    camera_wrt: Sequence[str],
) -> Array:
    """Return the derivatives of the times of events, shape (n, m), as `predict_events_with_derivatives` has them.

    Parameters
    ----------
    place
        Samples at the events, shape (n,).
    """
    # The extrema are zeros of a velocity in the picture
    axis = np.array([q.measured_at == "y1_extremum" for q in quantities], dtype=np.intp)

    def velocity(state: State, p: SimpleNamespace, camera: Camera) -> Array:
        position = xy_pairs(*light_mass_position(np, state, string_overlap(state, run.effects), p, run.effects))
        true = xy_pairs(*light_velocity(np, state.wrap_angle, state.retreat_speed, state.across_speed))
        return camera.project_displacement(position, true)[..., place, axis]

    _, shown, by_time = differentiate(
        velocity, run, place, {"free_length", "wrap_angle", "retreat_speed", "across_speed"}, camera, camera_wrt
    )
    own = np.abs(run.runs.events[:, 2] - run.t[place][:, None]).argmin(axis=1)
    slopes = np.zeros_like(shown)
    slopes[:, : len(run.wrt)] = run.runs.event_partials[own]
    is_extremum = np.array([q.measured_at in ("x1_extremum", "y1_extremum") for q in quantities])
    slopes[is_extremum] = -shown[is_extremum] / by_time[is_extremum, None]
    return slopes


def with_missed_events(predicted: Array, rows: Sequence[EventObservation]) -> Array:
    """Replace the NaN of every event that does not happen by a value that is `MISSED_EVENT_ERRORS` standard errors off."""
    missed = np.array([row.value - MISSED_EVENT_ERRORS * row.sigma for row in rows], dtype=float)
    return np.where(np.isfinite(predicted), predicted, missed)


def event_times(rows: Sequence[EventObservation], otherwise: float) -> Array:
    """Return when each row was measured, by the table itself [s], shape (n,).

    Rows whose event has no time in the table get that of the last row, or ``otherwise`` if that is later.
    """
    times = {(row.quantity, row.index): row.value for row in rows if row.unit == "s"}
    last = max([*times.values(), otherwise])
    return np.array([times.get((EVENT_QUANTITIES[row.quantity].measured_at, row.index), last) for row in rows], dtype=float)


def _as_measured(value: Any, kind: str, camera: Camera) -> Any:
    """Return the value that the file would have for a true one [SI] of a kind, of `EventQuantity.kind`."""
    if kind == "time":
        return (value - camera.clock_offset) / camera.clock_ratio
    if kind == "angle":
        return value + camera.tilt
    # A height is read along the picture's vertical, where a tilted camera shows only its cosine; quarter turns are undone
    quarters = np.round(np.real(camera.tilt) / (0.5 * math.pi))
    return value * camera.scale * (np.cos(camera.tilt - 0.5 * math.pi * quarters) if kind in ("height", "drop") else 1.0)


def _extrema_of_coordinate(t: Array, position: Array, velocity: Array) -> tuple[Extremum, ...]:
    """Return the extrema of one coordinate, by the zeros of its velocity, of those that `turning_points` counts."""
    from scipy.interpolate import CubicHermiteSpline

    path = CubicHermiteSpline(t, position, velocity)
    times = path.derivative().roots(extrapolate=False)
    times = times[np.isfinite(times)]
    # The ends of the run come with them, because an extremum counts by how far the coordinate turns back after it
    value = path(times)
    chosen = turning_points(np.concatenate([position[:1], value, position[-1:]]), EXTREMUM_BAND)
    return tuple(Extremum(time=float(times[i - 1]), value=float(value[i - 1])) for i in chosen)
