"""Fit a model to all trials together: Levenberg-Marquardt in units of prior standard errors, windows of time growing to all.

A number is written as start + scale x, with x of order one; what is known of it beforehand is a row of the least squares. Where
the heavy mass turns several times the cost has many minima; the first part of the motion has one, so fits start there.
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

from looping_pendulum.discrepancy.measurement import Camera, predict
from looping_pendulum.discrepancy.observations import Channel, DataError
from looping_pendulum.discrepancy.study import Study, Trial
from looping_pendulum.errors import HarnessError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.solve import solve_at

WINDOWS = (0.3, 0.5, 0.8, 1.0)
"""Shares of the longest trial that are fitted one after the other."""
STEP = 1e-3
"""Of finite differences, in scales: good to 2e-4 or so while the sequence of events stays the same."""
LARGEST_STEP = 3.0
"""Of one component in one iteration, in scales."""
FREE_SCALE = 1 / 3
"""Scale of a number of which nothing is known, relative to its start."""
WEAK = 10.0
"""Standard error of the prior of such a number, in scales: keeps early windows sane and decides nothing."""
CLOSE, ROUGHLY = 1e-6, 3e-4
"""Relative decrease of the cost below which a fit has ended, in the last window and before."""


class How(StrEnum):
    """How a number enters the parameter that it is named after."""

    SET = "is"
    TIMES = "multiplies"
    CAMERA = "is, of the camera,"


@dataclass(frozen=True, kw_only=True)
class Number:
    """One number that a fit moves."""

    name: str
    parameter: str
    how: How
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
class Data:
    """One trial's channels, end to end."""

    trial: Trial
    channels: tuple[Channel, ...]
    sigma: Array
    """Standard deviation of every value, shape (n,); infinite: left out of the fit."""

    @cached_property
    def value(self) -> Array:
        """Measured values [SI], shape (n,)."""
        return np.concatenate([c.value for c in self.channels])

    @cached_property
    def t(self) -> Array:
        """Measured times [s], shape (n,)."""
        return np.concatenate([c.t for c in self.channels])

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Where each channel stands."""
        ends = np.cumsum([0] + [len(c) for c in self.channels]).tolist()
        return {c.name: slice(a, b) for c, a, b in zip(self.channels, ends, ends[1:], strict=False)}

    def until(self, time: float) -> Data:
        """Only what was measured up to ``time`` [s]."""
        kept = self.t <= time
        if kept.all():
            return self
        channels = tuple(
            dataclasses.replace(c, t=c.t[: (n := int(np.searchsorted(c.t, time, side="right")))], value=c.value[:n])
            for c in self.channels
        )
        return dataclasses.replace(self, channels=channels, sigma=self.sigma[kept])


def numbers_of(study: Study, trials: Sequence[tuple[Trial, Any]]) -> tuple[Number, ...]:
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
            Number(name=u.name, parameter=u.parameter, how=How.SET, trials=u.trials, start=u.start, scale=scale, prior=prior,
                   bounds=u.bounds)
        )  # fmt: skip
    for trial, observations in trials:
        for name, known in study.camera_priors(trial, observations).items():
            if name in ("origin_x", "origin_y") or (name in trial.camera and known.uncertain):
                found.append(_camera_number(name, trial, known.value, known.sigma))
    return tuple(found)


def _camera_number(name: str, trial: Trial, value: float, sigma: float | None) -> Number:
    scale = sigma or {"origin_x": 0.1, "origin_y": 0.1}.get(name, 0.05)
    return Number(
        name=f"{trial.name}.{name}", parameter=name, how=How.CAMERA, trials=(trial.name,), start=value, scale=scale,
        prior=1.0 if sigma else None, bounds=(-math.inf, math.inf),
    )  # fmt: skip


class Problem:
    """Numbers, data and prior: residuals and their derivatives."""

    def __init__(
        self, study: Study, data: Sequence[Data], numbers: Sequence[Number], prior: tuple[Array, Array] | None = None
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
        self.order = sorted(range(len(self.numbers)), key=lambda i: self.numbers[i].how is not How.CAMERA)
        self._acting = [[i for i, n in enumerate(self.numbers) if d.trial.name in n.trials] for d in self.data]
        self._base = [study.parameters({}, d.trial) for d in self.data]
        self._camera = [{n: e.value for n, e in d.trial.camera.items()} for d in self.data]
        self._last: list[tuple[Parameters, Array, Samples] | None] = [None] * len(self.data)

    def until(self, share: float) -> Problem:
        """Return the same for the first ``share`` of the longest trial."""
        longest = max(float(d.t.max()) for d in self.data)
        shorter = [d.until(share * longest) for d in self.data]
        return Problem(self.study, shorter, self.numbers, (self.prior_mean, self.prior_weights))

    def with_data(self, data: Sequence[Data]) -> Problem:
        """Return the same with other data."""
        return Problem(self.study, data, self.numbers, (self.prior_mean, self.prior_weights))

    def with_numbers(self, *more: Number) -> Problem:
        """Return the same with more numbers."""
        return Problem(self.study, self.data, (*self.numbers, *more))

    @property
    def count(self) -> int:
        """Number of values that count."""
        return int(sum(np.isfinite(d.sigma).sum() for d in self.data))

    def setting(self, x: Array, k: int) -> tuple[Parameters, Camera]:
        """Parameters and camera of trial ``k``."""
        changes: dict[str, float] = {}
        camera: dict[str, float] = dict(self._camera[k])
        factors = []
        base = self._base[k]
        for i in self._acting[k]:
            n = self.numbers[i]
            value = float(min(max(n.start + n.scale * x[i], n.bounds[0]), n.bounds[1]))
            if n.how is How.CAMERA:
                camera[n.parameter] = value
            elif n.how is How.TIMES:
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
        """Run of trial ``k`` at the true times of its marks."""
        self.predict(x, k)
        last = self._last[k]
        assert last is not None
        return last[2]

    def predict(self, x: Array, k: int) -> Array:
        """What the camera of trial ``k`` would have measured, shape (n,); after a run's end everything rests."""
        parameters, camera = self.setting(x, k)

        def sample(t: Array) -> Samples:
            last = self._last[k]
            if last is None or last[0] != parameters or not np.array_equal(last[1], t):
                self._last[k] = last = parameters, t, solve_at(parameters, t, duration=float(t[-1]) + 1e-3)
            return last[2]

        d = self.data[k]
        values = predict(sample, camera, d.channels, dropped=d.trial.dropped).values
        return np.concatenate([_resting(values[c.name]) for c in d.channels])

    def residuals(self, x: Array) -> Array | None:
        """Standardised residuals, then the prior's; None where the model cannot run."""
        try:
            parts = [(d.value - self.predict(x, k)) / d.sigma for k, d in enumerate(self.data)]
        except (HarnessError, ValueError, FloatingPointError):
            return None
        r = np.concatenate([*parts, -self.prior_weights @ (x - self.prior_mean)])
        return r if np.all(np.isfinite(r)) else None

    def jacobian(self, x: Array, *, central: bool = False) -> Array:
        """Minus the derivative of `residuals`, shape (n + numbers, numbers)."""
        edges = np.cumsum([0] + [len(d.t) for d in self.data])
        jacobian = np.zeros((edges[-1] + len(x), len(x)))
        jacobian[edges[-1] :] = self.prior_weights
        for k, d in enumerate(self.data):
            here = self.predict(x, k)
            rows = slice(edges[k], edges[k + 1])
            for i in (i for i in self.order if i in self._acting[k]):
                jacobian[rows, i] = self._derivative(x, k, i, here, central) / d.sigma
        return np.nan_to_num(jacobian, nan=0.0, posinf=0.0, neginf=0.0)

    def _derivative(self, x: Array, k: int, i: int, here: Array, central: bool) -> Array:
        ahead = STEP if x[i] + STEP <= self.high[i] else -STEP
        try:
            forward = self._moved(x, k, i, ahead)
            if not central or x[i] - ahead < self.low[i] or x[i] - ahead > self.high[i]:
                return (forward - here) / ahead
            return (forward - self._moved(x, k, i, -ahead)) / (2 * ahead)
        except (HarnessError, ValueError):
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """The minimum that was found."""

    problem: Problem
    x: Array
    residuals: Array
    iterations: int

    @property
    def cost(self) -> float:
        """Sum of squares, prior included."""
        return float(self.residuals @ self.residuals)

    @cached_property
    def jacobian(self) -> Array:
        """By central differences, shape (n + numbers, numbers)."""
        return self.problem.jacobian(self.x, central=True)

    @cached_property
    def covariance(self) -> Array:
        """Of x."""
        return np.asarray(np.linalg.pinv(self.jacobian.T @ self.jacobian, hermitian=True))

    @property
    def condition(self) -> float:
        """Condition number of the scaled Jacobian, prior included."""
        return float(np.linalg.cond(self.jacobian))

    @property
    def values(self) -> dict[str, float]:
        """Number -> value [SI]."""
        return {n.name: n.start + n.scale * float(v) for n, v in zip(self.problem.numbers, self.x, strict=True)}

    @property
    def errors(self) -> dict[str, float]:
        """Number -> standard error [SI]."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return {n.name: n.scale * float(s) for n, s in zip(self.problem.numbers, sigma, strict=True)}

    def correlations(self, above: float = 0.9) -> tuple[tuple[str, str, float], ...]:
        """Pairs of numbers that the data can hardly tell apart, strongest first."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        matrix = self.covariance / np.outer(sigma, sigma)
        names = self.problem.names
        rows, columns = np.triu_indices(len(names), 1)
        found = [(names[i], names[j], float(matrix[i, j])) for i, j in zip(rows, columns, strict=True)]
        return tuple(sorted((f for f in found if abs(f[2]) > above), key=lambda f: -abs(f[2])))

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Numbers that ended on a bound."""
        p = self.problem
        return tuple(n for n, v, lo, hi in zip(p.names, self.x, p.low, p.high, strict=True) if min(v - lo, hi - v) < 1e-9)


class FitError(HarnessError, RuntimeError):
    """No fit could be made."""


def minimise(problem: Problem, x: Array, *, close: float = CLOSE, most: int = 30) -> Fit:
    """Levenberg-Marquardt within the bounds, every component of a step clipped."""
    x = np.clip(x, problem.low, problem.high)
    r = problem.residuals(x)
    if r is None:
        raise FitError("the model cannot run at the start of the fit; check the study's values")
    cost, damping, iterations = float(r @ r), 1e-3, 0
    while iterations < most:
        iterations += 1
        jacobian = problem.jacobian(x)
        gradient, normal = jacobian.T @ r, jacobian.T @ jacobian
        free = ~(((x <= problem.low) & (gradient < 0)) | ((x >= problem.high) & (gradient > 0)))
        before, found = cost, False
        for _ in range(8):
            trial = np.clip(x + _step(normal, gradient, free, damping), problem.low, problem.high)
            new = problem.residuals(trial)
            if new is not None and float(new @ new) < cost:
                x, r, cost, found = trial, new, float(new @ new), True
                break
            damping *= 10
        if not found or before - cost < close * cost:
            break
        damping = max(damping / 10, 1e-9)
    return Fit(problem=problem, x=x, residuals=r, iterations=iterations)


def _step(normal: Array, gradient: Array, free: NDArray[np.bool_], damping: float) -> Array:
    """Clipped step; numbers that press against a bound stay."""
    step = np.zeros(len(gradient))
    part = normal[np.ix_(free, free)]
    step[free] = np.linalg.solve(part + damping * np.diag(np.diag(part) + 1e-12), gradient[free])
    return np.clip(step, -LARGEST_STEP, LARGEST_STEP)


def calibrate(problem: Problem, start: Array | None = None, *, most: int = 30) -> Fit:
    """Fit in growing windows of time, with at most so many iterations in each."""
    x = problem.prior_mean.copy() if start is None else start
    total = 0
    for share in WINDOWS[:-1]:
        fit = minimise(problem.until(share), x, close=ROUGHLY, most=most)
        x, total = fit.x, total + fit.iterations
    fit = minimise(problem, x, most=most)
    return dataclasses.replace(fit, iterations=fit.iterations + total)
