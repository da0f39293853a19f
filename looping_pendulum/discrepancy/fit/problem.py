"""The least-squares problem of a fit: free parameters, data, priors; residuals and their derivatives.

A parameter has the value init_value + scale x, with x of order one. Its prior is a further row of the residuals.

Every run of a model asks whether the time is over, so that no fit, table of derivatives or sampling outlasts it.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.event_prediction import (
    predict_events,
    predict_events_with_derivatives,
    run_for_events,
    with_missed_events,
)
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.camera import CAMERA, Camera
from looping_pendulum.measured.free_parameter import FreeParameter, ParameterRole
from looping_pendulum.measured.measurement import FIT_TOLERANCE, predict, predict_with_derivatives, sample_times
from looping_pendulum.measured.study import Study, Trial
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.sensitivity import COMPLEX_STEP, changes_kind
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.solve import solve_at

_stop: ContextVar[float] = ContextVar("stop", default=math.inf)
_settle: ContextVar[float] = ContextVar("settle", default=math.inf)


class OutOfTime(KeyboardInterrupt):
    """Raised by the next run of a model where the time is over: it ends a search as Ctrl-C does."""


@contextlib.contextmanager
def time_limits(*, stop: float = math.inf, settle: float = math.inf) -> Iterator[None]:
    """Set when what runs within this context ends; both are of the clock `time.monotonic` [s].

    Parameters
    ----------
    stop
        From then on the next run of a model raises `OutOfTime`.
    settle
        From then on fits end where they are, with a result that has not converged.
    """
    tokens = _stop.set(stop), _settle.set(settle)
    try:
        yield
    finally:
        _stop.reset(tokens[0])
        _settle.reset(tokens[1])


def refuse_if_time_is_over() -> None:
    """Raise `OutOfTime` where no further run of a model may begin."""
    if time.monotonic() > _stop.get():
        raise OutOfTime


def fits_end_now() -> bool:
    """Return whether fits are to end where they are."""
    return time.monotonic() > _settle.get()


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
                        name=f"{trial.name}.{name}", parameter=name, role=ParameterRole.CAMERA, trials=(trial.name,),
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
        self._init_values, self._scales = np.array([(n.init_value, n.scale) for n in self.free_parameters]).reshape(-1, 2).T
        self._bounds = np.array([n.bounds for n in self.free_parameters]).reshape(-1, 2).T
        self.low, self.high = np.array([n.limits for n in self.free_parameters]).reshape(-1, 2).T
        self._acting_in_trial = [[i for i, n in enumerate(self.free_parameters) if d.trial.name in n.trials] for d in self.data]
        # Made once, and only changed for each run: making and checking all parameters takes longer
        self.base = [study.parameters({}, d.trial) for d in self.data]
        self._camera = [{n: e.value for n, e in d.trial.camera.items()} for d in self.data]

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
            n, value = self.free_parameters[i], values[i]
            if n.role is ParameterRole.CAMERA:
                # A parameter of all cameras alike is an error beside what each trial states or fits of its own
                own = camera.get(n.parameter) if n.shared else None
                camera[n.parameter] = value if own is None else own + value - CAMERA[n.parameter].null
            elif n.role is ParameterRole.TIMES:
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
        return changes, camera

    def _values_at(self, x: Array) -> Sequence[Any]:
        """Return the values of the free parameters [SI] at ``x``, cut off at their bounds, numbers or arrays of shape (m,).

        An imaginary step from a bound is one to its inner side, and beyond it changes nothing.
        """
        values = self._init_values + self._scales * x.T
        within: NDArray[Any] = np.clip(values.real, *self._bounds)
        if np.iscomplexobj(values):
            inside = (x.real.T >= self.low) & (x.real.T <= self.high)
            within = within + 1j * np.where(inside, values.imag, 0.0)
        return within.tolist() if x.ndim == 1 else list(within.T)  # arithmetic of Python's floats is faster than NumPy's

    def run(self, x: Array, k: int) -> Samples:
        """Return the run of trial ``k`` at the true times of its points, or every millisecond if it has only events."""
        parameters, camera = self.parameters_and_camera(x, k)
        d = self.data[k]
        if not d.channels:
            return run_for_events(parameters)
        times = sample_times(camera, d.channels)
        return solve_at(parameters, times.times, duration=times.duration, tolerance=FIT_TOLERANCE)

    def predict_events(self, x: Array, k: int) -> Array:
        """Predict the events of trial ``k`` [SI], shape (events,); NaN: the event does not happen."""
        parameters, camera = self.parameters_and_camera(x, k)
        return predict_events(parameters, camera, self.data[k].events)

    def events_that_happen(self, x: Array) -> NDArray[np.bool_]:
        """Return which measured events happen in the model's runs, all trials end to end, shape (events,)."""
        parts = [np.isfinite(self.predict_events(x, k)) for k, d in enumerate(self.data) if d.events]
        return np.concatenate([np.zeros(0, dtype=bool), *parts])

    def predict(self, x: Array, k: int) -> Array:
        """Predict all values of trial ``k`` [SI], shape (n,); nan: the model cannot run.

        After a run's end everything is at rest where it ended. An event that does not happen counts as missed by
        `event_prediction.MISSED_EVENT_ERRORS` standard errors.
        """
        refuse_if_time_is_over()
        d = self.data[k]
        values = np.full(len(d.value), np.nan)
        with contextlib.suppress(HarnessError, ArithmeticError):
            parameters, camera = self.parameters_and_camera(x, k)
            if d.channels:
                shown = predict(parameters, camera, d.channels, dropped=d.trial.dropped)
                values[: d.event_slice.start] = np.concatenate([*shown.values()])
            if d.events:
                values[d.event_slice] = with_missed_events(predict_events(parameters, camera, d.events), d.events)
        return values

    def predict_with_derivatives(self, x: Array, k: int) -> tuple[Array, Array]:
        """Predict all values of trial ``k`` [SI], shape (n,), as `predict` does, and their derivatives by ``x``, shape (n, p).

        Derivatives are 0 where none exist: after an event that is only grazed, and by what `without_derivative` names.
        """
        refuse_if_time_is_over()
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
                happened, partials = predict_events_with_derivatives(at.parameters, at.camera, d.events, at.wrt, at.camera_wrt)
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
        stepped = np.tile(x[:, None].astype(complex), len(acting))
        stepped[acting, np.arange(len(acting))] += 1j * COMPLEX_STEP
        slopes: list[dict[str, Array]] = []
        for changed in self.changes(stepped, k):
            imaginary = {name: np.imag(value) / COMPLEX_STEP for name, value in changed.items()}
            slopes.append({name: slope for name, slope in imaginary.items() if np.any(slope)})
        parameters, camera = self.parameters_and_camera(x, k)
        return _LinearisedChanges(
            parameters=parameters,
            camera=camera,
            wrt=[*slopes[0]],
            camera_wrt=[*slopes[1]],
            slopes=np.array([*slopes[0].values(), *slopes[1].values()]).reshape(-1, len(acting)),
        )

    def residuals(self, x: Array) -> Array | None:
        """Return standardised residuals, then those of the prior, shape (n + p,); None if the model cannot run."""
        return self._residuals_of(x, [self.predict(x, k) for k in range(len(self.data))])

    def residuals_and_jacobian(self, x: Array) -> tuple[Array | None, Array]:
        """Return the residuals at ``x``, None if the model cannot run, and minus their derivative, shape (n + p, p)."""
        predicted, derivatives = [], []
        for k, d in enumerate(self.data):
            values, slopes = self.predict_with_derivatives(x, k)
            if not np.isfinite(values).all():  # a run that fails may take a hundred times as long as others
                return None, np.zeros((self.measured_rows + len(x), len(x)))
            predicted.append(values)
            derivatives.append(d.standardise(slopes))
        return self._residuals_of(x, predicted), np.vstack([*derivatives, self.prior_weights])

    def jacobian(self, x: Array) -> Array:
        """Return minus the derivative of the residuals at ``x``, shape (n + p, p)."""
        return self.residuals_and_jacobian(x)[1]

    def _residuals_of(self, x: Array, predicted: Sequence[Array]) -> Array | None:
        """Return the residuals at ``x`` from what is predicted there of each trial."""
        parts = [d.standardise(d.value - values) for d, values in zip(self.data, predicted, strict=True)]
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
