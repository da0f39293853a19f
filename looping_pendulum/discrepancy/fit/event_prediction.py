"""What a model says of the rows of an event table: its own stops, halts and extrema, as the camera would have timed them.

Stops, break-aways, the halt and the end are the run's own events, exact to the integrator's tolerance. Extrema are turns of the
light mass's place as the camera sees it: zeros of the speed, found by cubic Hermite interpolation of samples a millisecond
apart, which is good to 0.1 us and smooth in the parameters. A time t is read off the file's clock as
(t - clock_offset) / clock_ratio, a length as scale times itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from looping_pendulum.compare.event_quantities import EVENT_QUANTITIES, event_value
from looping_pendulum.compare.landmarks import EXTREMUM_BAND, reference_event_times
from looping_pendulum.compare.result import Extremum, Landmarks, Stop
from looping_pendulum.compare.slides import turns
from looping_pendulum.discrepancy.data.measurement import Camera
from looping_pendulum.discrepancy.data.observations import DataError, EventObservation, Observations
from looping_pendulum.engines.reference import event_names
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.solve import DURATION, available_integrators, solve_at
from looping_pendulum.scenarios.document import quote

SAMPLE_STEP = 1e-3
"""[s]; the sixth turn of the paper's 10:1 trial lasts 120 ms."""
MISSED = 100.0
"""Standard errors by which a measured event counts as missed that does not happen in the model's run. More than any event that
does happen is off by after the first iterations, so that a fit never gains by losing one; how far it would have to move to
happen is not known, so the number says "qualitatively wrong" and no more."""
EXTREMA = ("x1_extremum", "y1_extremum")
"""Quantities that are read from samples."""
BEYOND = 1.25
"""Share of the time of a table's last row up to which a run is sampled first."""
_GRID: Array = np.arange(round(DURATION / SAMPLE_STEP) + 1, dtype=np.float64) * SAMPLE_STEP


def check_events(observations: Observations) -> None:
    """Refuse rows that no model predicts.

    Raises
    ------
    DataError
        In one line, with the file and what is known.
    """
    seen: set[tuple[str, int]] = set()
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
        if (row.quantity, row.index) in seen:
            raise DataError(f"{where}: found it in a second table, needed it once; delete one")
        seen.add((row.quantity, row.index))


def run_for_events(parameters: Parameters, until: float = DURATION) -> Samples:
    """Run to its end, as halts need, at the times up to ``until`` [s] that extrema need."""
    times = _GRID[: np.searchsorted(_GRID, until, side="right")]
    return solve_at(parameters, times, duration=DURATION, integrator=available_integrators()[0])


class EventRun:
    """A run, sampled as far as its table's rows ask for, and what its last camera saw of them."""

    def __init__(self, parameters: Parameters, rows: Sequence[EventObservation]) -> None:
        self.parameters = parameters
        self._rows = rows
        self._until = min(BEYOND * moments_of(rows, 0.0).max(initial=0.0), DURATION)
        self._samples = run_for_events(parameters, self._until)
        self._seen: tuple[Camera, Array] | None = None

    @property
    def samples(self) -> Samples:
        """To the run's end."""
        if self._until < min(self._samples.run.end_time, DURATION):
            self._until, self._samples = DURATION, run_for_events(self.parameters)
        return self._samples

    def predicted(self, camera: Camera) -> Array:
        """As `predict_events`."""
        if self._seen is None or self._seen[0] != camera:
            found = predict_events(self._samples, camera, self._rows)
            # a turn that is found stays, whatever comes after it; one that is not may come later
            if any(row.quantity in EXTREMA for row, value in zip(self._rows, found, strict=True) if math.isnan(value)):
                found = predict_events(self.samples, camera, self._rows)
            self._seen = camera, found
        return self._seen[1]


def landmarks(samples: Samples, camera: Camera) -> Landmarks:
    """Landmarks of a run by its own events [SI, true time]; the extrema are those of the picture, which may be tilted."""
    run = samples.run
    moments = reference_event_times(event_names(run))
    states = {event.time: event.state for event in run.events}
    halt = run.halt
    x1, y1 = _extrema(samples, camera)
    return Landmarks(
        stops=tuple(Stop(time=t, height_change=-float(run.heavy_drop(states[t]))) for t in moments.stops),
        slip_onsets=moments.slip_onsets,
        halting_time=moments.halting_time,
        halting_confirmed=halt is not None,
        drop_at_halt=None if halt is None else float(run.heavy_drop(halt.state)),
        wrap_angle_at_halt=None if halt is None else float(halt.state.wrap_angle),
        free_length_at_halt=None if halt is None else float(halt.state.free_length),
        light_reaches_rod=moments.light_reaches_rod,
        x1_extrema=x1,
        y1_extrema=y1,
    )


def predict_events(samples: Samples, camera: Camera, rows: Sequence[EventObservation]) -> Array:
    """Predict what ``camera`` and its operator would have written into ``rows`` [SI], shape (n,); NaN: it does not happen."""
    found = landmarks(samples, camera)
    return np.array([_seen(event_value(found, row.quantity, row.index), row.quantity, camera) for row in rows], dtype=float)


def counted(predicted: Array, rows: Sequence[EventObservation]) -> Array:
    """Put in place of every event that does not happen a value that is `MISSED` standard errors off."""
    missed = np.array([row.value - MISSED * row.sigma for row in rows], dtype=float)
    return np.where(np.isfinite(predicted), predicted, missed)


def moments_of(rows: Sequence[EventObservation], otherwise: float) -> Array:
    """When each row was measured, by the table itself [s], shape (n,); ``otherwise`` where it does not say."""
    times = {(row.quantity, row.index): row.value for row in rows if row.unit == "s"}
    last = max([*times.values(), otherwise])
    return np.array([times.get((EVENT_QUANTITIES[row.quantity].moment, row.index), last) for row in rows], dtype=float)


def _seen(value: float | None, quantity: str, camera: Camera) -> float:
    if value is None:
        return math.nan
    kind = EVENT_QUANTITIES[quantity].kind
    if kind == "time":
        return (value - camera.clock_offset) / camera.clock_ratio
    if kind == "angle":
        return value + camera.tilt
    return value * camera.scale * (math.cos(camera.tilt) if kind in ("height", "drop") else 1.0)


def _extrema(samples: Samples, camera: Camera) -> tuple[tuple[Extremum, ...], tuple[Extremum, ...]]:
    """Turns of the seen x and y of the light mass, up to the run's end."""
    upright = Camera(tilt=camera.tilt)
    places, speeds = upright.seen(samples.light_position), upright.seen(samples.light_velocity)
    return _turns(samples.t, places[:, 0], speeds[:, 0]), _turns(samples.t, places[:, 1], speeds[:, 1])


def _turns(t: Array, place: Array, speed: Array) -> tuple[Extremum, ...]:
    """Extrema of one coordinate, by the zeros of its speed; which count is said by `slides.turns`."""
    # A sample may fall on the very turn: of what rests then, the way it came from counts.
    sign = np.sign(speed)
    if not sign[1:].all():
        sign = sign[np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), 0))]
    before = np.flatnonzero(sign[:-1] * sign[1:] < 0)
    share, value = _hermite_zero(t[before + 1] - t[before], place[before], place[before + 1], speed[before], speed[before + 1])
    times = t[before] + share * (t[before + 1] - t[before])
    chosen = turns(np.concatenate([place[:1], value, place[-1:]]), EXTREMUM_BAND)
    return tuple(Extremum(time=float(times[i - 1]), value=float(value[i - 1])) for i in chosen)


def _hermite_zero(h: Array, p0: Array, p1: Array, v0: Array, v1: Array) -> tuple[Array, Array]:
    """Where in its interval of length ``h`` [s] the cubic through two places and speeds turns, from 0 to 1, and its value."""
    mean = (p1 - p0) / h
    a, b = 3 * (v0 + v1 - 2 * mean), 2 * (3 * mean - 2 * v0 - v1)
    q = -0.5 * (b + np.copysign(np.sqrt(np.maximum(b * b - 4 * a * v0, 0.0)), b))
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = np.stack([q / a, v0 / q])
    inside = np.isfinite(roots) & (roots >= 0) & (roots <= 1)
    s = np.where(inside[1], roots[1], roots[0])
    return s, p0 + h * (v0 * s + b * s * s / 2 + a * s**3 / 3)
