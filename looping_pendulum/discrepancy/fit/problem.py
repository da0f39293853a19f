"""What a fit has to do: numbers to move, data of all trials, what is known beforehand; residuals and their derivatives.

A number is written as start + scale x, with x of order one; what is known of it beforehand is a row of the least squares.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.data.measurement import DIFFERENTIABLE, Camera, differential, predict
from looping_pendulum.discrepancy.data.observations import Channel, DataError, EventObservation
from looping_pendulum.discrepancy.data.study import Study, Trial
from looping_pendulum.discrepancy.fit.event_prediction import EventRun, counted, moments_of
from looping_pendulum.errors import HarnessError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.sensitivity import solve_sensitivities
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.solve import available_integrators, solve_at

STEP = 1e-3
"""Of finite differences, in scales: good to 2e-4 or so while the sequence of events stays the same."""
FREE_SCALE = 1 / 3
"""Scale of a number of which nothing is known, relative to its start."""
FEW_EVENTS = (Release.LOOPING, Release.VERTICAL)
"""Releases whose runs have a few events each: there variational equations cost half of what differences do."""
WEAK = 10.0
"""Standard error of the prior of such a number, in scales: keeps early windows sane and decides nothing."""


class ParameterRole(StrEnum):
    """How a number enters the parameter that it is named after."""

    SET = "is"
    TIMES = "multiplies"
    CAMERA = "is, of the camera,"


_TIMES, _CAMERA = ParameterRole.TIMES, ParameterRole.CAMERA


@dataclass(frozen=True, kw_only=True)
class FreeParameter:
    """One number that a fit moves."""

    name: str
    parameter: str
    how: ParameterRole
    trials: tuple[str, ...]
    """Trials in which it acts."""
    start: float
    """[SI]"""
    scale: float
    """One unit of x [SI]."""
    prior: float | None
    """Standard error of the prior, in scales; None: measured values say nothing, a weak one of `WEAK` is used."""
    bounds: tuple[float, float]

    @property
    def shared(self) -> bool:
        """Whether it is no single trial's own."""
        return "." not in self.name

    @property
    def limits(self) -> tuple[float, float]:
        """Bounds of x."""
        low, high = ((b - self.start) / self.scale for b in self.bounds)
        return low, high


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialData:
    """One trial's channels, end to end, then its events."""

    trial: Trial
    channels: tuple[Channel, ...]
    events: tuple[EventObservation, ...] = ()
    sigma: Array
    """Standard deviation of every value, shape (n,); infinite: left out of the fit."""

    @cached_property
    def value(self) -> Array:
        """Measured values [SI], shape (n,)."""
        return np.concatenate([*(c.value for c in self.channels), [e.value for e in self.events]])

    @cached_property
    def t(self) -> Array:
        """Measured times [s], shape (n,); of an event, when it happened by its table."""
        times = np.concatenate([np.zeros(0), *(c.t for c in self.channels)])
        return np.concatenate([times, moments_of(self.events, float(times.max(initial=0.0)))])

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Where each channel stands."""
        ends = np.cumsum([0] + [len(c) for c in self.channels]).tolist()
        return {c.name: slice(a, b) for c, a, b in zip(self.channels, ends, ends[1:], strict=False)}

    @property
    def event_slice(self) -> slice:
        """Where the events stand."""
        return slice(len(self.value) - len(self.events), len(self.value))

    def until(self, time: float) -> TrialData:
        """Only what was measured up to ``time`` [s]."""
        kept = self.t <= time
        if kept.all():
            return self
        channels = tuple(
            dataclasses.replace(c, t=c.t[: (n := int(np.searchsorted(c.t, time, side="right")))], value=c.value[:n])
            for c in self.channels
        )
        events = tuple(e for e, k in zip(self.events, kept[self.event_slice], strict=True) if k)
        return dataclasses.replace(self, channels=channels, events=events, sigma=self.sigma[kept])


def free_parameters_of(study: Study, trials: Sequence[tuple[Trial, Any]]) -> tuple[FreeParameter, ...]:
    """Every number of the declared model: apparatus, releases and each camera's origin, and what else of it was declared.

    Parameters
    ----------
    trials
        Each with its observations.
    """
    found = []
    for u in study.unknowns(tuple(t for t, _ in trials)):
        scale = u.sigma or FREE_SCALE * abs(u.start) or 1e-3
        prior = 1.0 if u.sigma else None
        found.append(
            FreeParameter(name=u.name, parameter=u.parameter, how=ParameterRole.SET, trials=u.trials, start=u.start, scale=scale, prior=prior,
                   bounds=u.bounds)
        )  # fmt: skip
    for trial, observations in trials:
        for name, known in study.camera_priors(trial, observations).items():
            if name in ("origin_x", "origin_y") or (name in trial.camera and known.uncertain):
                found.append(_camera_number(name, trial, known.value, known.sigma))
    return tuple(found)


def _camera_number(name: str, trial: Trial, value: float, sigma: float | None) -> FreeParameter:
    scale = sigma or {"origin_x": 0.1, "origin_y": 0.1}.get(name, 0.05)
    return FreeParameter(
        name=f"{trial.name}.{name}", parameter=name, how=ParameterRole.CAMERA, trials=(trial.name,), start=value, scale=scale,
        prior=1.0 if sigma else None, bounds=(-math.inf, math.inf),
    )  # fmt: skip


class Problem:
    """Numbers, data and prior: residuals and their derivatives."""

    def __init__(
        self,
        study: Study,
        data: Sequence[TrialData],
        numbers: Sequence[FreeParameter],
        prior: tuple[Array, Array] | None = None,
    ) -> None:
        self.study = study
        self.data = tuple(data)
        self.numbers = tuple(numbers)
        self.names = tuple(n.name for n in numbers)
        weights = np.diag([1 / (n.prior or WEAK) for n in self.numbers])
        self.prior_mean: Array = prior[0] if prior else np.zeros(len(numbers))
        self.prior_weights: Array = prior[1] if prior else weights
        self.low, self.high = np.array([n.limits for n in self.numbers]).reshape(-1, 2).T
        # what a camera moves needs no new run if it comes before all else
        self.order = sorted(range(len(self.numbers)), key=lambda i: self.numbers[i].how is not ParameterRole.CAMERA)
        self._acting = [[i for i, n in enumerate(self.numbers) if d.trial.name in n.trials] for d in self.data]
        self._base = [study.parameters({}, d.trial) for d in self.data]
        self._own = {u.name for u in study.unknowns(study.trials)}
        self._camera = [{n: e.value for n, e in d.trial.camera.items()} for d in self.data]
        self._last: list[tuple[Parameters, Array, Samples] | None] = [None] * len(self.data)
        self._last_events: list[EventRun | None] = [None] * len(self.data)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without what runs are remembered."""
        return Problem, (self.study, self.data, self.numbers, (self.prior_mean, self.prior_weights))

    def until(self, share: float) -> Problem:
        """Return the same for the first ``share`` of the longest trial."""
        longest = max(float(d.t.max()) for d in self.data)
        shorter = [d.until(share * longest) for d in self.data]
        return Problem(self.study, shorter, self.numbers, (self.prior_mean, self.prior_weights))

    def with_data(self, data: Sequence[TrialData]) -> Problem:
        """Return the same with other data."""
        return Problem(self.study, data, self.numbers, (self.prior_mean, self.prior_weights))

    def with_numbers(self, *more: FreeParameter) -> Problem:
        """Return the same with more numbers."""
        return Problem(self.study, self.data, (*self.numbers, *more))

    @property
    def count(self) -> int:
        """Number of values that count."""
        return int(sum(np.isfinite(d.sigma).sum() for d in self.data))

    @property
    def measured_rows(self) -> int:
        """Number of values of all trials: rows of the residuals before the prior's."""
        return sum(len(d.value) for d in self.data)

    def setting(self, x: Array, k: int) -> tuple[Parameters, Camera]:
        """Parameters and camera of trial ``k``."""
        changes: dict[str, float] = {}
        camera: dict[str, float] = dict(self._camera[k])
        factors = []
        base = self._base[k]
        plain = x.tolist()  # arithmetic of plain numbers is faster than NumPy's, and the same
        for i in self._acting[k]:
            n = self.numbers[i]
            low, high = n.bounds
            value = min(max(n.start + n.scale * plain[i], low), high)
            if n.how is _CAMERA:
                camera[n.parameter] = value
            elif n.how is _TIMES:
                factors.append((n.parameter, value))
            else:
                changes[n.parameter] = value
        kinetic = changes.get("kinetic_friction", base.coefficients["kinetic_friction"])
        for parameter, factor in factors:
            # static friction is told as a ratio to the kinetic one, all else as one to its own value
            own = kinetic if parameter == "static_friction" else changes.get(parameter, getattr(base, parameter, math.nan))
            changes[parameter] = factor * own
        if base.coefficients["static_friction"] != base.coefficients["kinetic_friction"]:
            changes.setdefault("static_friction", base.coefficients["static_friction"])
        if "static_friction" in changes:
            changes["static_friction"] = max(changes["static_friction"], kinetic)
        return base.replace(**changes), Camera(**camera)

    def run(self, x: Array, k: int) -> Samples:
        """Run of trial ``k`` at the true times of its marks; every millisecond if it has only events."""
        if not self.data[k].channels:
            return self._run_for_events(self.setting(x, k)[0], k).samples
        self.predict(x, k)
        last = self._last[k]
        assert last is not None
        return last[2]

    def _run_for_events(self, parameters: Parameters, k: int) -> EventRun:
        last = self._last_events[k]
        if last is None or last.parameters != parameters:
            self._last_events[k] = last = EventRun(parameters, self.data[k].events)
        return last

    def predict_events(self, x: Array, k: int) -> Array:
        """What the table of trial ``k`` would say of its events, shape (events,); NaN where one does not happen."""
        return self._predict_events(*self.setting(x, k), k)

    def _predict_events(self, parameters: Parameters, camera: Camera, k: int) -> Array:
        return self._run_for_events(parameters, k).predicted(camera)

    def predict(self, x: Array, k: int) -> Array:
        """What would have been measured in trial ``k``, shape (n,); after a run's end everything rests.

        An event that does not happen counts as missed by `event_prediction.MISSED` standard errors.
        """
        parameters, camera = self.setting(x, k)

        def sample(t: Array) -> Samples:
            last = self._last[k]
            if last is None or last[1] is not t or last[0] != parameters:
                run = solve_at(parameters, t, duration=float(t[-1]) + 1e-3, integrator=available_integrators()[0])
                self._last[k] = last = parameters, t, run
            return last[2]

        d = self.data[k]
        parts = []
        if d.channels:
            values = predict(sample, camera, d.channels, dropped=d.trial.dropped).values
            parts = [values[c.name] for c in d.channels]
            if not np.isfinite(np.concatenate(parts)).all():
                parts = [_resting(part) for part in parts]
        if d.events:
            parts.append(counted(self._predict_events(parameters, camera, k), d.events))
        return np.concatenate(parts or [np.zeros(0)])

    def happening(self, x: Array) -> NDArray[np.bool_]:
        """Which measured events happen in the model's runs, all trials end to end."""
        found = [np.isfinite(self.predict_events(x, k)) for k, d in enumerate(self.data) if d.events]
        return np.concatenate([np.zeros(0, dtype=bool), *found])

    def residuals(self, x: Array) -> Array | None:
        """Standardised residuals, then the prior's; None where the model cannot run."""
        try:
            parts = [(d.value - self.predict(x, k)) / d.sigma for k, d in enumerate(self.data)]
        except (HarnessError, ValueError, ArithmeticError):
            return None
        r = np.concatenate([*parts, -self.prior_weights @ (x - self.prior_mean)])
        return r if np.all(np.isfinite(r)) else None

    def jacobian(self, x: Array, *, central: bool = False) -> Array:
        """Minus the derivative of `residuals`, shape (n + numbers, numbers).

        Parameters
        ----------
        central
            Whether to take variational equations for the study's own numbers where the model is the base one, and central
            differences for the rest; otherwise a swing's many events, and the rest, have one-sided differences.
        """
        edges = np.cumsum([0] + [len(d.t) for d in self.data])
        jacobian = np.zeros((edges[-1] + len(x), len(x)))
        jacobian[edges[-1] :] = self.prior_weights
        for k, d in enumerate(self.data):
            here = self.predict(x, k)
            rows = slice(edges[k], edges[k + 1])
            exact = self._exact(x, k) if central or d.trial.release in FEW_EVENTS else {}
            for i in (i for i in self.order if i in self._acting[k]):
                column = exact[i] if i in exact else self._derivative(x, k, i, here, central)
                jacobian[rows, i] = column / d.sigma
        return np.nan_to_num(jacobian, nan=0.0, posinf=0.0, neginf=0.0)

    def _exact(self, x: Array, k: int) -> dict[int, Array]:
        """Derivatives of trial ``k`` by the study's own numbers, by variational equations; empty where there are none.

        Whatever was added would need equations of its own, whose compilation costs more than differences.
        """
        d = self.data[k]
        parameters, camera = self.setting(x, k)
        moved = [i for i in self._acting[k] if self.numbers[i].name in self._own]
        base_only = all(e.in_base_model for e in parameters.effects) and "heyoka" in available_integrators()
        measured = {c.name for c in d.channels}
        if d.events or not measured or not moved or not base_only or not measured <= DIFFERENTIABLE:
            return {}
        wrt = tuple(self.numbers[i].parameter for i in moved)
        try:
            found = differential(
                lambda t: solve_sensitivities(parameters, t, wrt, duration=float(t[-1]) + 1e-3), camera, d.channels
            )
        except (HarnessError, ValueError, ArithmeticError):  # an event that is only touched has no derivative
            return {}
        slopes = np.concatenate([found[c.name] for c in d.channels])
        return {i: self.numbers[i].scale * slopes[:, j] for j, i in enumerate(moved)}

    def _derivative(self, x: Array, k: int, i: int, here: Array, central: bool) -> Array:
        ahead = STEP if x[i] + STEP <= self.high[i] else -STEP
        try:
            forward = self._moved(x, k, i, ahead)
            if not central or x[i] - ahead < self.low[i] or x[i] - ahead > self.high[i]:
                return (forward - here) / ahead
            return (forward - self._moved(x, k, i, -ahead)) / (2 * ahead)
        except (HarnessError, ValueError, ArithmeticError):
            return np.zeros_like(here)

    def _moved(self, x: Array, k: int, i: int, by: float) -> Array:
        moved = x.copy()
        moved[i] += by
        return self.predict(moved, k)


def _resting(values: Array) -> Array:
    """Hold the last value where a run has ended."""
    known = np.isfinite(values)
    if known.all():
        return values
    if not known.any():
        raise DataError("found no mark during the run, needed some; check the times and the clock offset")
    index = np.maximum.accumulate(np.where(known, np.arange(len(values)), 0))
    return np.asarray(values[index])
