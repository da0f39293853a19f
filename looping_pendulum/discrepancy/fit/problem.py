"""The least-squares problem of a fit: free parameters, data, priors; residuals and their derivatives.

A parameter has the value init_value + scale x, with x of order one. Its prior is a further row of the residuals.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.event_prediction import EventRun, with_missed_events
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.camera import CAMERA, Camera
from looping_pendulum.measured.free_parameter import FreeParameter, ParameterRole
from looping_pendulum.measured.measurement import (
    FIT_STEPS,
    FIT_TOLERANCE,
    PLACES,
    SampledRuns,
    SampleTimes,
    duration_of,
    predict_many,
    predict_with_derivatives,
    sample_times,
)
from looping_pendulum.measured.study import Study, Trial
from looping_pendulum.reference_ode.batch import sample_batch
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.sensitivity import COMPLEX_STEP, changes_kind
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.reference_ode.state import State

_TIMES, _CAMERA = ParameterRole.TIMES, ParameterRole.CAMERA  # for an inner loop


def free_parameters_of(study: Study, trials: Sequence[tuple[Trial, Any]]) -> tuple[FreeParameter, ...]:
    """Return the free parameters of the declared model.

    These are uncertain values of the apparatus and the releases, the offsets of each camera or gyroscope, and other camera
    errors that are declared.

    Parameters
    ----------
    trials
        Pairs of a trial and its observations.
    """
    parameters = list(study.free_parameters(tuple(t for t, _ in trials)))
    for trial, observations in trials:
        for name, known in study.camera_priors(trial, observations).items():
            is_stated = name in trial.camera and known.uncertain
            if name in ("origin_x", "origin_y", "rate_offset", *observations.camera_errors) or is_stated:
                scale = known.sigma or (0.1 if name in ("origin_x", "origin_y") else 0.05)
                parameters.append(
                    FreeParameter(
                        name=f"{trial.name}.{name}", parameter=name, role=_CAMERA, trials=(trial.name,),
                        init_value=known.value, scale=scale, prior=1.0 if known.sigma else None,
                    )
                )  # fmt: skip
    return tuple(parameters)


class Problem:
    """Free parameters, data and prior of a fit: residuals and their derivatives.

    Parameters
    ----------
    prior
        Mean of ``x``, shape (p,), and a square root of the inverse covariance, shape (p, p); None: the parameters' own priors.
    """

    def __init__(
        self,
        study: Study,
        data: Sequence[TrialData],
        free_parameters: Sequence[FreeParameter],
        prior: tuple[Array, Array] | None = None,
    ) -> None:
        self.study = study
        self.data = tuple(data)
        self.free_parameters = tuple(free_parameters)
        self.names = tuple(n.name for n in free_parameters)
        weights = np.diag([1 / n.prior_sigma for n in self.free_parameters])
        self.prior_mean: Array = prior[0] if prior else np.zeros(len(free_parameters))
        self.prior_weights: Array = prior[1] if prior else weights
        self.low, self.high = np.array([n.limits for n in self.free_parameters]).reshape(-1, 2).T
        numbers = np.array([(n.init_value, n.scale, *n.bounds) for n in self.free_parameters])
        self._init_values, self._scales, self._smallest, self._largest = numbers.reshape(-1, 4).T
        self._acting_in_trial = [[i for i, n in enumerate(self.free_parameters) if d.trial.name in n.trials] for d in self.data]
        # Made once, and only changed for each run: making and checking all parameters takes longer
        self.base = [study.parameters({}, d.trial) for d in self.data]
        self._camera = [{n: e.value for n, e in d.trial.camera.items()} for d in self.data]

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle what it is made of."""
        return Problem, (self.study, self.data, self.free_parameters, (self.prior_mean, self.prior_weights))

    def until(self, share: float) -> Problem:
        """Return the problem with data up to ``share`` of the longest trial's time."""
        longest = max(float(d.t.max()) for d in self.data)
        # All trials up to one time, however long each film is: the time since the release is what makes the motion complex
        return self.with_data([d.until(share * longest) for d in self.data])

    def with_data(self, data: Sequence[TrialData]) -> Problem:
        """Return the problem with other data."""
        return Problem(self.study, data, self.free_parameters, (self.prior_mean, self.prior_weights))

    def with_parameters(self, *more: FreeParameter) -> Problem:
        """Return the problem with more free parameters."""
        return Problem(self.study, self.data, (*self.free_parameters, *more))

    @property
    def is_swing(self) -> bool:
        """Return whether all trials are held pendulums, whose runs take as long as their records have turning points."""
        return all(d.trial.release is Release.HELD for d in self.data)

    @property
    def count(self) -> int:
        """Return the number of values that are fitted."""
        return int(sum(np.isfinite(d.sigma).sum() for d in self.data))

    @property
    def measured_rows(self) -> int:
        """Return the number of values of all trials, fitted or not: rows of the residuals before those of the prior."""
        return sum(len(d.value) for d in self.data)

    def parameters_and_camera(self, x: Array, k: int) -> tuple[Parameters, Camera]:
        """Return the model's parameters and the camera of trial ``k``."""
        changes, camera = self.changes(x, k)
        return self.base[k].replace(**changes), Camera(**camera)

    def changes(self, x: Array, k: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the parameters of the model that ``x`` changes in trial ``k``, and the values of its camera.

        Both are numbers if ``x`` has the shape (p,), and have the shape (m,) if it has the shape (p, m); it may be complex.
        """
        changes: dict[str, Any] = {}
        camera: dict[str, Any] = dict(self._camera[k])
        factors = []
        base, values = self.base[k], self._values_at(x)
        for i in self._acting_in_trial[k]:
            n = self.free_parameters[i]
            value = values[i]
            if n.role is _CAMERA:
                # A parameter of all cameras alike is an error beside what each trial states of its own
                stated = self._camera[k].get(n.parameter) if n.shared else None
                camera[n.parameter] = value if stated is None else stated + value - CAMERA[n.parameter].null
            elif n.role is _TIMES:
                factors.append((n.parameter, value))
            else:
                changes[n.parameter] = value
        kinetic = changes.get("kinetic_friction", base.coefficients["kinetic_friction"])
        for parameter, factor in factors:
            # static friction is a ratio to the kinetic one, every other factor is on the parameter's own value
            unscaled = kinetic if parameter == "static_friction" else changes.get(parameter, getattr(base, parameter, math.nan))
            changes[parameter] = factor * unscaled
        if not base.static_equals_kinetic:
            changes.setdefault("static_friction", base.coefficients["static_friction"])
        if "static_friction" in changes:
            # Both may be free, and a step of the fit may take the kinetic one above it
            changes["static_friction"] = _larger(kinetic, changes["static_friction"])
        return dict(self.study.changes_of_model(changes)), camera

    def _values_at(self, x: Array) -> Sequence[Any]:
        """Return the values of the free parameters [SI] at ``x``, cut off at their bounds, numbers or arrays of shape (m,).

        An imaginary step from a bound is one to its inner side, and beyond it changes nothing.
        """
        columns = (self._init_values, self._scales, self._smallest, self._largest)
        init_values, scales, smallest, largest = columns if x.ndim == 1 else (column[:, None] for column in columns)
        values = init_values + scales * x
        within: NDArray[Any] = np.clip(values.real, smallest, largest)
        if np.iscomplexobj(values):
            inside = (x.real >= self.low[:, None]) & (x.real <= self.high[:, None])
            within = within + 1j * np.where(inside, values.imag, 0.0)
        return list(within) if x.ndim > 1 else within.tolist()  # arithmetic of Python's floats is faster than that of NumPy's

    def run(self, x: Array, k: int) -> Samples:
        """Return the run of trial ``k`` at the true times of its points, or every millisecond if it has only events."""
        parameters, camera = self.parameters_and_camera(x, k)
        d = self.data[k]
        if not d.channels:
            return EventRun(parameters, d.events).samples
        t = sample_times(camera.clock_offset, camera.clock_ratio, camera.readout, d.channels).times
        return solve_at(parameters, t, duration=duration_of(t), tolerance=FIT_TOLERANCE)

    def predict_events(self, x: Array, k: int) -> Array:
        """Predict the events of trial ``k`` [SI], shape (events,); NaN: the event does not happen."""
        parameters, camera = self.parameters_and_camera(x, k)
        return EventRun(parameters, self.data[k].events).predict(camera)

    def events_that_happen(self, x: Array) -> NDArray[np.bool_]:
        """Return which measured events happen in the model's runs, all trials end to end, shape (events,)."""
        parts = [np.isfinite(self.predict_events(x, k)) for k, d in enumerate(self.data) if d.events]
        return np.concatenate([np.zeros(0, dtype=bool), *parts])

    def predict(self, x: Array, k: int) -> Array:
        """Predict all values of trial ``k`` [SI], shape (n,), as `predict_many` does."""
        (values,) = self._predict_trial(x[None], k)
        return np.asarray(values)

    def predict_many(self, x: Array) -> Array:
        """Predict all values of all trials [SI] at many parameters of shape (m, p), shape (m, n); nan: the model cannot run.

        After a run's end everything is at rest where it ended. An event that does not happen counts as missed by
        `event_prediction.MISSED_EVENT_ERRORS` standard errors.
        """
        return np.concatenate([self._predict_trial(x, k) for k in range(len(self.data))], axis=1)

    def _predict_trial(self, x: Array, k: int) -> Array:
        """Predict trial ``k`` at many parameters of shape (m, p), shape (m, n)."""
        d = self.data[k]
        found = np.full((len(x), len(d.value)), np.nan)
        if d.channels:
            found[:, : d.event_slice.start] = _Rows(self, x, k).points()
        if d.events:
            found[:, d.event_slice] = self._events_of_many(x, k)
        return found

    def predict_with_derivatives(self, x: Array, k: int) -> tuple[Array, Array]:
        """Predict all values of trial ``k`` [SI], shape (n,), as `predict` does, and their derivatives by ``x``, shape (n, p).

        Derivatives are 0 where none exist: after an event that is only grazed, and by what `without_derivative` names.
        """
        d = self.data[k]
        values, derivatives = np.full(len(d.value), np.nan), np.zeros((len(d.value), len(x)))
        points, acting = slice(0, d.event_slice.start), self._acting_in_trial[k]
        with contextlib.suppress(HarnessError, ArithmeticError):
            at = self._linearised_changes(x, k)
            if d.channels:
                values[points], partials = predict_with_derivatives(
                    at.parameters, at.camera, d.channels, d.trial.dropped, at.wrt, at.camera_wrt
                )
                derivatives[points, acting] = np.nan_to_num(partials, copy=False, nan=0.0) @ at.slopes
            if d.events:
                run = EventRun(at.parameters, d.events)
                happened, partials = run.predict_with_derivatives(at.camera, at.wrt, at.camera_wrt)
                values[d.event_slice] = with_missed_events(happened, d.events)
                derivatives[d.event_slice, acting] = np.nan_to_num(partials, copy=False, nan=0.0) @ at.slopes
        return values, derivatives

    def without_derivative(self, x: Array) -> frozenset[str]:
        """Return the free parameters by which no derivative exists at ``x`` in some trial: the motion `changes_kind` there.

        Raises
        ------
        HarnessError
            If the model cannot run there.
        """
        names = set()
        for k, acting in enumerate(self._acting_in_trial):
            at = self._linearised_changes(x, k)
            values = vars(at.parameters.values())
            missing = [changes_kind(name, values, at.parameters.release) for name in at.wrt]
            _, moving = np.nonzero(at.slopes[: len(at.wrt)][missing])
            names |= {self.names[acting[i]] for i in moving}
        return frozenset(names)

    def _linearised_changes(self, x: Array, k: int) -> _LinearisedChanges:
        """Return the model's parameters and the camera of trial ``k``, and how they move with ``x``."""
        acting = self._acting_in_trial[k]
        at = np.tile(x[:, None].astype(complex), len(acting))
        at[acting, np.arange(len(acting))] += 1j * COMPLEX_STEP
        values: list[dict[str, float]] = []
        moving: list[dict[str, Array]] = []
        for changed in self.changes(at, k):
            arrays = {name: value for name, value in changed.items() if isinstance(value, np.ndarray)}
            values.append(changed | {name: float(value[0].real) for name, value in arrays.items()})
            slopes = {name: value.imag / COMPLEX_STEP for name, value in arrays.items()}
            moving.append({name: slope for name, slope in slopes.items() if slope.any()})
        return _LinearisedChanges(
            parameters=self.base[k].replace(**values[0]),
            camera=Camera(**values[1]),
            wrt=list(moving[0]),
            camera_wrt=list(moving[1]),
            slopes=np.array([*moving[0].values(), *moving[1].values()]).reshape(-1, len(acting)),
        )

    def _events_of_many(self, x: Array, k: int) -> Array:
        """Predict the events of trial ``k`` at many parameters, shape (m, events); nan where the model cannot run."""
        rows, last = self.data[k].events, None
        found = np.full((len(x), len(rows)), np.nan)
        for values, row in zip(found, x, strict=True):
            with contextlib.suppress(HarnessError, ValueError, ArithmeticError):
                parameters, camera = self.parameters_and_camera(row, k)
                if last is None or last.parameters != parameters:  # rows that differ by the camera alone show the same run
                    last = EventRun(parameters, rows)
                values[:] = with_missed_events(last.predict(camera), rows)
        return found

    def residuals(self, x: Array) -> Array | None:
        """Return standardised residuals, then those of the prior, shape (n + p,); None if the model cannot run."""
        return self.residuals_of(x, self.predict_many(x[None])[0])

    def residuals_and_jacobian(self, x: Array) -> tuple[Array | None, Array]:
        """Return the residuals at ``x``, None if the model cannot run, and minus their derivative, shape (n + p, p)."""
        n = self.measured_rows
        predicted, jacobian = np.empty(n), np.zeros((n + len(x), len(x)))
        jacobian[n:] = self.prior_weights
        end = 0
        for k, d in enumerate(self.data):
            part = slice(end, end := end + len(d.value))
            predicted[part], derivatives = self.predict_with_derivatives(x, k)
            if not np.isfinite(predicted[part]).all():  # a run that fails may take a hundred times as long as others
                return None, jacobian
            jacobian[part] = d.standardise(derivatives)
        return self.residuals_of(x, predicted), jacobian

    def jacobian(self, x: Array) -> Array:
        """Return minus the derivative of the residuals at ``x``, shape (n + p, p)."""
        return self.residuals_and_jacobian(x)[1]

    def residuals_of(self, x: Array, predicted: Array) -> Array | None:
        """Return the residuals at ``x`` from what is predicted there of all trials, shape (n,)."""
        ends = np.cumsum([len(d.value) for d in self.data])[:-1]
        parts = [d.standardise(d.value - part) for d, part in zip(self.data, np.split(predicted, ends), strict=True)]
        r = np.concatenate([*parts, -self.prior_weights @ (x - self.prior_mean)])
        return r if np.all(np.isfinite(r)) else None


@dataclass(frozen=True, kw_only=True, eq=False)
class _LinearisedChanges:
    """What a trial's free parameters change, and the derivatives of that."""

    parameters: Parameters
    camera: Camera
    wrt: list[str]
    """Parameters of the model that change."""
    camera_wrt: list[str]
    """Values of the camera that change."""
    slopes: Array
    """Derivatives of ``wrt`` and then of ``camera_wrt`` by the q free parameters that act in the trial, shape (names, q)."""


def _larger(a: Any, b: Any) -> Any:
    """Return the larger of two numbers, or of arrays by their real parts; ``b`` where they are equal."""
    return max(a, b) if isinstance(a, float) and isinstance(b, float) else np.where(np.real(a) > np.real(b), a, b)


class _Rows:
    """The tracked points of trial ``k`` at many parameters ``x``, shape (m, p)."""

    def __init__(self, problem: Problem, x: Array, k: int) -> None:
        self._data, self._base, self._count = problem.data[k], problem.base[k], len(x)
        changes, camera = problem.changes(x.T, k)
        self._columns = {
            name: np.broadcast_to(np.asarray(values, dtype=float), len(x))
            for name, values in self._base.with_static_friction(changes).items()
        }
        """Parameters of the model that are changed, shape (m,) each."""
        self._camera, self._valid = Camera.of_many(camera, len(x))
        """Camera of all rows, and which rows have possible cameras, shape (m,)."""
        c = self._camera
        self._clock = np.column_stack(
            [np.broadcast_to(np.ravel(v), len(x)) for v in (c.clock_offset, c.clock_ratio, c.readout)]
        )
        self._effects = self._base.effects_with([name for name in self._columns if name in self._base.coefficients])

    def points(self) -> Array:
        """Predict the tracked points by a run of each row, shape (m, points); nan where the model cannot run."""
        # Rows that differ by the camera alone show the same run
        keys = np.column_stack([self._clock, *self._columns.values()])
        _, first, run = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        times = [self._times(i).times for i in first]
        samples = sample_batch(
            self._base,
            self._columns_of(first),
            times,
            duration=np.array([duration_of(t) for t in times]),
            tolerance=FIT_TOLERANCE,
            max_steps=FIT_STEPS,
        )
        found = np.full((self._count, sum(map(len, self._data.channels))), np.nan)
        for clock in np.unique(self._clock, axis=0):
            rows = np.flatnonzero(np.all(self._clock == clock, axis=1))
            runs = run[rows]
            at = samples.start[runs][:, None] + np.arange(len(times[runs[0]]))
            found[rows] = self._measured(rows, samples.state[:, at], samples.count[runs])
        return found

    def _measured(self, rows: NDArray[np.intp], state: Array, known: NDArray[np.int64]) -> Array:
        """Return what the cameras of rows with one clock measure of their motions, shape (rows, points).

        Parameters
        ----------
        state
            Motion of each row, shape (entries, rows, times).
        known
            How many of the times lie within it, shape (rows,).
        """
        places = SimpleNamespace(**{name: self._value(name)[rows, None] for name in PLACES})
        runs, d = SampledRuns(State(*state), known, places, self._effects), self._data
        found = predict_many(runs, self._camera.take(rows), d.channels, self._times(rows[0]), d.trial.dropped)
        found[~self._valid[rows]] = np.nan
        return found

    def _times(self, row: int | np.intp) -> SampleTimes:
        return sample_times(*self._clock[row].tolist(), self._data.channels)

    def _columns_of(self, rows: NDArray[np.intp]) -> dict[str, Array]:
        """Return the parameters in which runs of these rows differ, and gravity: a batch needs at least one."""
        return {name: self._value(name)[rows] for name in (*self._columns, "gravity")}

    def _value(self, name: str) -> Array:
        """Return a parameter of all rows, shape (m,)."""
        if name in self._columns:
            return self._columns[name]
        base = self._base
        return np.full(self._count, base.coefficients[name] if name in base.coefficients else getattr(base, name))
