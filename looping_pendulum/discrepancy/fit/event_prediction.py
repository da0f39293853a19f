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

from looping_pendulum.compare.landmarks import EVENT_QUANTITIES, EventQuantity, event_value, reference_event_times
from looping_pendulum.engines.landmarks import EXTREMUM_BAND, Extremum, Landmarks, Stop
from looping_pendulum.engines.reference import event_names
from looping_pendulum.engines.string_motion import turning_points
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.measurement import FIT_TOLERANCE, PLACING_ENTRIES, differentiate
from looping_pendulum.measured.observations import DataError, EventObservation, Observations
from looping_pendulum.reference_ode.geometry import Array, light_velocity, xy_pairs
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.sensitivity import COMPLEX_STEP, DifferentiatedRun, run_with_derivatives
from looping_pendulum.reference_ode.solution import Samples, light_mass_position, string_overlap
from looping_pendulum.reference_ode.solve import DURATION, solve_at
from looping_pendulum.reference_ode.state import State, heavy_drop
from looping_pendulum.scenarios.document import quote

SAMPLE_STEP = 1e-3
"""Time step of the samples in which extrema are looked for [s]; the sixth turn of the paper's 10:1 trial lasts 120 ms."""
MISSED_EVENT_ERRORS = 100.0
"""Residual, in standard errors, of a measured event that does not happen in the model's run.

It is more than that of any event that does happen after the first iterations, so that a fit never gains by losing an event. How
far the event would have to move to happen is not known, so the value means "qualitatively wrong" and no more.
"""
SAMPLED_QUANTITIES = ("x1_extremum", "y1_extremum")
"""Quantities that are computed from samples, not from the run's own events."""
SAMPLING_MARGIN = 1.25
"""Time up to which a run is sampled at first, in units of the time of the table's last row."""
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


def run_for_events(parameters: Parameters, until: float = DURATION) -> Samples:
    """Run to the end, which the halt needs, with samples up to ``until`` [s], which extrema need."""
    times = _SAMPLE_TIMES[: np.searchsorted(_SAMPLE_TIMES, until, side="right")]
    return solve_at(parameters, times, duration=DURATION, tolerance=FIT_TOLERANCE)


class EventRun:
    """A run for the rows of an event table, sampled only as far as they need."""

    def __init__(self, parameters: Parameters, rows: Sequence[EventObservation]) -> None:
        self.parameters = parameters
        self._rows = rows
        self._until = min(SAMPLING_MARGIN * event_times(rows, 0.0).max(initial=0.0), DURATION)
        self._samples = run_for_events(parameters, self._until)

    @property
    def samples(self) -> Samples:
        """Return samples up to the run's end."""
        if self._until < min(self._samples.run.end_time, DURATION):
            self._until, self._samples = DURATION, run_for_events(self.parameters)
        return self._samples

    def landmarks(self, camera: Camera) -> Landmarks:
        """Return the landmarks of the run, as far as the rows need them."""
        found = landmarks(self._samples, camera)
        # More samples do not change an extremum that was found; one that was not may come later.
        sampled = [row for row in self._rows if row.quantity in SAMPLED_QUANTITIES]
        if any(event_value(found, row.quantity, row.index) is None for row in sampled):
            found = landmarks(self.samples, camera)
        return found

    def predict(self, camera: Camera) -> Array:
        """Predict the measured values of the rows [SI], shape (n,); NaN: the event does not happen in this run."""
        return measured_values(self.landmarks(camera), camera, self._rows)

    def predict_with_derivatives(self, camera: Camera, wrt: Sequence[str], camera_wrt: Sequence[str]) -> tuple[Array, Array]:
        """Predict the rows, shape (n,), and their derivatives, shape (n, m).

        Derivatives are by parameters of the model and then by values of the camera: 0 of an event that does not happen, nan
        where none exist (`run_with_derivatives`). What is measured at an event changes at fixed time, and as the event moves.
        """
        found = self.landmarks(camera)
        values = measured_values(found, camera, self._rows)
        derivatives = np.zeros((len(values), len(wrt) + len(camera_wrt)))
        happens = [i for i, value in enumerate(values) if math.isfinite(value)]
        if not happens:
            return values, derivatives
        quantities = [EVENT_QUANTITIES[self._rows[i].quantity] for i in happens]
        times = np.array(
            [event_value(found, q.measured_at, self._rows[i].index) for q, i in zip(quantities, happens, strict=True)]
        )
        t, place = np.unique(times, return_inverse=True)
        run = run_with_derivatives(self.parameters, t, wrt, duration=DURATION, tolerance=FIT_TOLERANCE)
        time_slopes = _slopes_of_times(run, place, quantities, camera, camera_wrt)

        def true_values(state: State, p: SimpleNamespace, camera: Camera) -> NDArray[Any]:
            drop = heavy_drop(np, state, string_overlap(state, run.effects), p, run.effects)
            by_kind = {
                "time": 0.0 * drop, "height": -drop, "drop": drop, "length": state.free_length, "angle": state.wrap_angle,
            }  # fmt: skip
            shape = np.broadcast_shapes(*map(np.shape, by_kind.values()))
            return np.stack(
                [np.broadcast_to(by_kind[q.kind], shape)[:, i] for q, i in zip(quantities, place, strict=True)], axis=1
            )

        true = differentiate(true_values, run, place, PLACING_ENTRIES, camera, camera_wrt)
        is_time = np.array([q.kind == "time" for q in quantities])
        slopes = true.derivatives + np.where(is_time, 1.0, true.by_time)[:, None] * time_slopes
        steps = 1j * COMPLEX_STEP * np.eye(1 + len(camera_wrt))[:, :, None]
        stepped = camera.stepped(camera_wrt, steps[1:])
        for i, q, time, value, slope in zip(happens, quantities, times, true.values, slopes, strict=True):
            measured = _as_measured((time if q.kind == "time" else value) + steps[0], q.kind, stepped)
            by_value, *by_camera = np.broadcast_to(np.imag(measured)[:, 0] / COMPLEX_STEP, len(steps))
            derivatives[i] = by_value * slope
            derivatives[i, len(wrt) :] += by_camera
        return values, derivatives


def landmarks(samples: Samples, camera: Camera) -> Landmarks:
    """Return the landmarks of a run by its own events [SI, true time]; extrema are those in the picture."""
    run = samples.run
    times = reference_event_times(event_names(run))
    # The times below are those of the events themselves, equal in every bit, so that they can be keys
    states = {event.time: event.state for event in run.events}
    halt = run.halt
    # Scale and origin do not change when the extrema are
    unscaled = replace(camera, scale=1.0, origin_x=0.0, origin_y=0.0)
    position = unscaled.project(samples.light_position)
    velocity = unscaled.project_displacement(samples.light_position, samples.light_velocity)
    x1, y1 = (_extrema_of_coordinate(samples.t, position[:, i], velocity[:, i]) for i in (0, 1))
    return Landmarks(
        stops=tuple(Stop(time=t, height_change=-float(run.heavy_drop(states[t]))) for t in times.stops),
        slip_onsets=times.slip_onsets,
        halting_time=times.halting_time,
        halting_confirmed=halt is not None,
        drop_at_halt=None if halt is None else float(run.heavy_drop(halt.state)),
        wrap_angle_at_halt=None if halt is None else float(halt.state.wrap_angle),
        free_length_at_halt=None if halt is None else float(halt.state.free_length),
        light_reaches_rod=times.light_reaches_rod,
        x1_extrema=x1,
        y1_extrema=y1,
    )


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
    """Return the derivatives of the times of events, shape (n, m), as `EventRun.predict_with_derivatives` has them.

    Parameters
    ----------
    place
        Samples at the events, shape (n,).
    """
    # The extrema are zeros of a velocity in the picture
    axis = np.array([q.measured_at == "y1_extremum" for q in quantities], dtype=np.intp)

    def velocity(state: State, p: SimpleNamespace, camera: Camera) -> NDArray[Any]:
        position = xy_pairs(*light_mass_position(np, state, string_overlap(state, run.effects), p, run.effects))
        true = xy_pairs(*light_velocity(np, state.wrap_angle, state.retreat_speed, state.across_speed))
        return camera.project_displacement(position, true)[:, place, axis]

    shown = differentiate(
        velocity, run, place, {"free_length", "wrap_angle", "retreat_speed", "across_speed"}, camera, camera_wrt
    )
    own = np.abs(run.runs.events[:, 2] - run.t[place][:, None]).argmin(axis=1)
    slopes = np.zeros_like(shown.derivatives)
    slopes[:, : len(run.wrt)] = run.runs.event_partials[own]
    is_extremum = np.array([q.measured_at in SAMPLED_QUANTITIES for q in quantities])
    slopes[is_extremum] = -shown.derivatives[is_extremum] / shown.by_time[is_extremum, None]
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
    # A sample may fall exactly on an extremum: its zero velocity takes the sign before it, so that the sign changes once.
    sign = np.sign(velocity)
    if not sign[1:].all():
        sign = sign[np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), 0))]
    before = np.flatnonzero(sign[:-1] * sign[1:] < 0)
    share, value = _hermite_zero(
        t[before + 1] - t[before], position[before], position[before + 1], velocity[before], velocity[before + 1]
    )
    times = t[before] + share * (t[before + 1] - t[before])
    # The ends of the run come with them, because an extremum counts by how far the coordinate turns back after it
    chosen = turning_points(np.concatenate([position[:1], value, position[-1:]]), EXTREMUM_BAND)
    return tuple(Extremum(time=float(times[i - 1]), value=float(value[i - 1])) for i in chosen)


def _hermite_zero(h: Array, p0: Array, p1: Array, v0: Array, v1: Array) -> tuple[Array, Array]:
    """Return the extremum of the cubic through two positions and velocities: place in its interval, from 0 to 1, and value.

    Parameters
    ----------
    h
        Lengths of the intervals [s].
    p0, p1, v0, v1
        Positions and velocities at their ends.
    """
    mean = (p1 - p0) / h
    a, b = 3 * (v0 + v1 - 2 * mean), 2 * (3 * mean - 2 * v0 - v1)
    # the stable form of the quadratic formula: no cancellation between b and the root
    q = -0.5 * (b + np.copysign(np.sqrt(np.maximum(b * b - 4 * a * v0, 0.0)), b))
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = np.stack([q / a, v0 / q])
    inside = np.isfinite(roots) & (roots >= 0) & (roots <= 1)
    s = np.where(inside[1], roots[1], roots[0])
    return s, p0 + h * (v0 * s + b * s * s / 2 + a * s**3 / 3)
