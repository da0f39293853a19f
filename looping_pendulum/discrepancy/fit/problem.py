"""The least-squares problem of a fit: free parameters, data of all trials, priors; residuals and their derivatives.

A parameter has the value init_value + scale x, with x of order one. Its prior is a further row of the residuals.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.fit.correlated_noise import CorrelatedNoise, Whitening
from looping_pendulum.discrepancy.fit.event_prediction import EventRun, event_times, with_missed_events
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.camera import CAMERA, Camera
from looping_pendulum.measured.free_parameter import FreeParameter, ParameterRole
from looping_pendulum.measured.measurement import FIT_TOLERANCE, predict
from looping_pendulum.measured.observations import BODIES, Channel, EventObservation
from looping_pendulum.measured.study import Study, Trial
from looping_pendulum.reference_ode.batch import supports
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.solve import available_integrators, solve_at

DIFFERENCE_STEP = 1e-3
"""Step of finite differences, in units of the scale.

Derivatives are good to about 2e-4 as long as the sequence of events stays the same.
"""
_TIMES, _CAMERA = ParameterRole.TIMES, ParameterRole.CAMERA  # for an inner loop


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialData:
    """Data of one trial as one vector: its channels, end to end, then its events."""

    trial: Trial
    channels: tuple[Channel, ...]
    events: tuple[EventObservation, ...] = ()
    sigma: Array
    """Standard deviation of every value's white noise [SI], shape (n,); infinite: left out of the fit."""
    outliers: NDArray[np.bool_] | None = None
    """Values that are left out because they do not show the mass, shape (n,); None: none were looked for yet."""
    correlated: Mapping[str, CorrelatedNoise] = field(default_factory=dict)
    """Channel -> the correlated part of its noise, beside the white one of `sigma`; channels without one are left out."""

    @property
    def is_outlier(self) -> NDArray[np.bool_]:
        """Return which values are left out as outliers, shape (n,); none if none were looked for."""
        return np.zeros(len(self.sigma), dtype=bool) if self.outliers is None else self.outliers

    @cached_property
    def value(self) -> Array:
        """Return the measured values [SI], shape (n,)."""
        return np.concatenate([*(c.value for c in self.channels), [e.value for e in self.events]])

    @cached_property
    def t(self) -> Array:
        """Return the measured times [s], shape (n,); that of an event is when it happened by its table."""
        times = np.concatenate([np.zeros(0), *(c.t for c in self.channels)])
        return np.concatenate([times, event_times(self.events, float(times.max(initial=0.0)))])

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Return channel -> its part of the vector."""
        ends = np.cumsum([0] + [len(c) for c in self.channels]).tolist()
        return {c.name: slice(a, b) for c, a, b in zip(self.channels, ends, ends[1:], strict=False)}

    @cached_property
    def _whitening(self) -> dict[str, Whitening]:
        return {c.name: Whitening(c.t, self.sigma[self.slices[c.name]], self.correlated[c.name])
                for c in self.channels if c.name in self.correlated}  # fmt: skip

    def standardise(self, difference: Array) -> Array:
        """Return differences from the values in units of the noise, shape (n,) or (n, m) as given; 0: left out."""
        standardised = np.asarray(difference / (self.sigma if difference.ndim == 1 else self.sigma[:, None]))
        for name, whitening in self._whitening.items():
            standardised[self.slices[name]] = whitening(difference[self.slices[name]])
        return standardised

    def with_noises(self, noises: Mapping[str, CorrelatedNoise]) -> TrialData:
        """Return data with white noise alone as data with correlated parts, of which the white one is made smaller.

        Parameters
        ----------
        noises
            Body, of `observations.BODIES`, -> its correlated noise; bodies with white noise alone are left out.
        """
        sigma, correlated = self.sigma.copy(), {}
        for c in self.channels:
            noise = next((n for body, n in noises.items() if c.name in BODIES[body]), None)
            if noise is not None and len(c) > 1:
                correlated[c.name] = noise
                sigma[self.slices[c.name]] = noise.white_sigma(self.sigma[self.slices[c.name]], c.time_step)
        return dataclasses.replace(self, sigma=sigma, correlated=correlated)

    @property
    def log_determinant(self) -> float:
        """Return the logarithm of the determinant of the noise's covariance, without values that are left out."""
        kept = np.isfinite(self.sigma)
        for name in self._whitening:
            kept[self.slices[name]] = False
        white = 2 * float(np.sum(np.log(self.sigma[kept])))
        return white + sum(w.log_determinant for w in self._whitening.values())

    @property
    def event_slice(self) -> slice:
        """Return the part of the vector that holds the events."""
        return slice(len(self.value) - len(self.events), len(self.value))

    def until(self, time: float) -> TrialData:
        """Return only the data up to ``time`` [s]."""
        kept = self.t <= time
        if kept.all():
            return self
        channels = tuple(
            dataclasses.replace(c, t=c.t[: (n := int(np.searchsorted(c.t, time, side="right")))], value=c.value[:n])
            for c in self.channels
        )
        events = tuple(e for e, k in zip(self.events, kept[self.event_slice], strict=True) if k)
        outliers = None if self.outliers is None else self.outliers[kept]
        return dataclasses.replace(self, channels=channels, events=events, sigma=self.sigma[kept], outliers=outliers)


def noises_of(data: Iterable[TrialData]) -> dict[str, CorrelatedNoise]:
    """Return body -> correlated noise of its tracked points, which is the same in all trials."""
    named = {name: noise for d in data for name, noise in d.correlated.items()}
    return {body: named[n] for body, names in BODIES.items() for n in names if n in named}


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
                parameters.append(_camera_parameter(name, trial, known.value, known.sigma))
    return tuple(parameters)


def _camera_parameter(name: str, trial: Trial, value: float, sigma: float | None) -> FreeParameter:
    """Return a parameter of one trial's camera as a free parameter."""
    scale = sigma or {"origin_x": 0.1, "origin_y": 0.1}.get(name, 0.05)
    return FreeParameter(
        name=f"{trial.name}.{name}", parameter=name, role=ParameterRole.CAMERA, trials=(trial.name,), init_value=value,
        scale=scale, prior=1.0 if sigma else None,
    )  # fmt: skip


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
        self._acting_in_trial = [[i for i, n in enumerate(self.free_parameters) if d.trial.name in n.trials] for d in self.data]
        # Made once, and only changed for each run: making and checking all parameters takes longer
        self.base = [study.parameters({}, d.trial) for d in self.data]
        self._camera = [{n: e.value for n, e in d.trial.camera.items()} for d in self.data]
        self._cached_run: list[tuple[Parameters, Array, Samples] | None] = [None] * len(self.data)
        self._cached_event_run: list[EventRun | None] = [None] * len(self.data)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the cached runs."""
        return Problem, (self.study, self.data, self.free_parameters, (self.prior_mean, self.prior_weights))

    def until(self, share: float) -> Problem:
        """Return the problem with data up to ``share`` of the longest trial's time."""
        longest = max(float(d.t.max()) for d in self.data)
        # All trials up to one time, however long each film is: the time since the release is what makes the motion complex
        shorter = [d.until(share * longest) for d in self.data]
        return Problem(self.study, shorter, self.free_parameters, (self.prior_mean, self.prior_weights))

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

    @cached_property
    def runs_singly(self) -> bool:
        """Return whether every run is made by itself: of swings, of effects that a batch does not take, without heyoka."""
        names = [n.parameter for n in self.free_parameters]
        return self.is_swing or not all(supports(b, [n for n in names if n in b.coefficients]) for b in self.base)

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
        changes, camera = self.changes(x.tolist(), k)  # arithmetic of Python's floats is faster than that of NumPy's
        return self.base[k].replace(**changes), Camera(**camera)

    def changes(self, x: Sequence[Any], k: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the parameters of the model that ``x`` changes in trial ``k``, and the values of its camera.

        Both are numbers if ``x`` has p numbers, and have the shape (m,) if it has p arrays of that shape.
        """
        changes: dict[str, Any] = {}
        camera: dict[str, Any] = dict(self._camera[k])
        factors = []
        base = self.base[k]
        for i in self._acting_in_trial[k]:
            n = self.free_parameters[i]
            value = _between(n.init_value + n.scale * x[i], *n.bounds)
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
            changes["static_friction"] = _between(changes["static_friction"], kinetic, math.inf)
        return dict(self.study.changes_of_model(changes)), camera

    def run(self, x: Array, k: int) -> Samples:
        """Return the run of trial ``k`` at the true times of its points, or every millisecond if it has only events."""
        if not self.data[k].channels:
            return self._run_for_events(self.parameters_and_camera(x, k)[0], k).samples
        self.predict(x, k)
        last = self._cached_run[k]
        assert last is not None
        return last[2]

    def _run_for_events(self, parameters: Parameters, k: int) -> EventRun:
        last = self._cached_event_run[k]
        if last is None or last.parameters != parameters:
            self._cached_event_run[k] = last = EventRun(parameters, self.data[k].events)
        return last

    def predict_events(self, x: Array, k: int) -> Array:
        """Predict the events of trial ``k`` [SI], shape (events,); NaN: the event does not happen."""
        return self._predict_events(*self.parameters_and_camera(x, k), k)

    def _predict_events(self, parameters: Parameters, camera: Camera, k: int) -> Array:
        return self._run_for_events(parameters, k).predict(camera)

    def predict(self, x: Array, k: int) -> Array:
        """Predict all values of trial ``k`` [SI], shape (n,); after a run's end everything is at rest where it ended.

        An event that does not happen counts as missed by `event_prediction.MISSED_EVENT_ERRORS` standard errors.
        """
        parameters, camera = self.parameters_and_camera(x, k)

        def sample(t: Array) -> Samples:
            last = self._cached_run[k]
            # By identity, which costs nothing: `measurement` keeps the array of a clock and returns it again
            if last is None or last[1] is not t or last[0] != parameters:
                # A millisecond longer, so that the run does not end just before the last point
                run = solve_at(
                    parameters,
                    t,
                    duration=float(t[-1]) + 1e-3,
                    tolerance=FIT_TOLERANCE,
                    integrator=available_integrators()[0],
                )
                self._cached_run[k] = last = parameters, t, run
            return last[2]

        d = self.data[k]
        parts = []
        if d.channels:
            values = predict(sample, camera, d.channels, dropped=d.trial.dropped).values
            parts = [values[c.name] for c in d.channels]
        if d.events:
            parts.append(with_missed_events(self._predict_events(parameters, camera, k), d.events))
        return np.concatenate(parts or [np.zeros(0)])

    def events_that_happen(self, x: Array) -> NDArray[np.bool_]:
        """Return which measured events happen in the model's runs, all trials end to end, shape (events,)."""
        parts = [np.isfinite(self.predict_events(x, k)) for k, d in enumerate(self.data) if d.events]
        return np.concatenate([np.zeros(0, dtype=bool), *parts])

    def residuals(self, x: Array) -> Array | None:
        """Return standardised residuals, then those of the prior, shape (n + p,); None if the model cannot run."""
        try:
            predicted = np.concatenate([self.predict(x, k) for k in range(len(self.data))])
        except (HarnessError, ValueError, ArithmeticError):
            return None
        return self.residuals_of(x, predicted)

    def residuals_of(self, x: Array, predicted: Array) -> Array | None:
        """Return the residuals at ``x`` from what is predicted there of all trials, shape (n,)."""
        ends = np.cumsum([len(d.value) for d in self.data])[:-1]
        parts = [d.standardise(d.value - part) for d, part in zip(self.data, np.split(predicted, ends), strict=True)]
        r = np.concatenate([*parts, -self.prior_weights @ (x - self.prior_mean)])
        return r if np.all(np.isfinite(r)) else None

    def rows_of_jacobian(self, x: Array) -> Array:
        """Return parameters at which predictions make the Jacobian: ``x``, then two for each parameter.

        Where runs are made singly, one of the two is ``x`` again.
        """
        # Beyond a bound the value would be cut off, and the difference zero
        down = x - DIFFERENCE_STEP >= self.low
        up = (x + DIFFERENCE_STEP <= self.high) | ~down
        down &= ~up | (not self.runs_singly)
        steps = DIFFERENCE_STEP * np.stack([np.diag(up * 1.0), np.diag(down * -1.0)], axis=1)
        return x + np.vstack([np.zeros(len(x)), steps.reshape(-1, len(x))])

    def jacobian_of(self, x: Array, rows: Array, predicted: Array) -> Array:
        """Return minus the derivative of `residuals`, shape (n + p, p), from what is predicted at `rows_of_jacobian`.

        Where the model of a trial cannot run at one of a parameter's two places, the difference is that to ``x``; where it
        cannot at either, it is 0.
        """
        ends = np.cumsum([0] + [len(d.value) for d in self.data])
        jacobian = np.zeros((ends[-1] + len(x), len(x)))
        jacobian[ends[-1] :] = self.prior_weights
        i = np.arange(len(x))
        step = (rows[1:] - x)[np.arange(2 * len(i)), np.repeat(i, 2)]
        failed = np.isnan(predicted[1:])
        change = np.where(failed, 0.0, predicted[1:] - predicted[0])
        steps = np.where(failed, 0.0, step[:, None])
        with np.errstate(invalid="ignore"):
            derivatives = ((change[::2] - change[1::2]) / (steps[::2] - steps[1::2])).T
        # A value that no derivative is known for must not spoil those after it, which a correlation ties to it
        derivatives = np.nan_to_num(derivatives, nan=0.0, posinf=0.0, neginf=0.0)
        for k, d in enumerate(self.data):
            part = slice(ends[k], ends[k + 1])
            jacobian[part] = d.standardise(derivatives[part])
        return jacobian


def _between(value: Any, low: Any, high: Any) -> Any:
    """Return a number, or an array, cut off at bounds."""
    return min(max(value, low), high) if isinstance(value, float) else np.clip(value, low, high)
