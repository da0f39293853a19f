"""The least-squares problem of a fit: free parameters, data, priors; residuals, their derivatives, and many predictions.

A parameter has the value init_value + scale x, with x of order one. Its prior is a further row of the residuals. What is
measured is predicted at many parameters of many problems at once, their runs in a batch, and fits take their steps together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from functools import cached_property
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.event_prediction import EventRun, with_missed_events
from looping_pendulum.discrepancy.workers import Workers
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.camera import CAMERA, Camera
from looping_pendulum.measured.free_parameter import FreeParameter, ParameterRole
from looping_pendulum.measured.measurement import FIT_TOLERANCE, SampledRuns, predict, predict_many, sample_times
from looping_pendulum.measured.study import Study, Trial
from looping_pendulum.reference_ode.batch import sample_batch
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import NUMBERS, Parameters, Release
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.reference_ode.state import Effects

DIFFERENCE_STEP = 1e-3
"""Step of finite differences, in units of the scale.

Derivatives are good to about 2e-4 as long as the sequence of events stays the same.
"""
_TIMES, _CAMERA = ParameterRole.TIMES, ParameterRole.CAMERA  # for an inner loop
PLACES = ("rod_radius", "free_length", "release_angle", "hanging_length", "heavy_swing", "string_thickness")
"""Parameters that say, beside the state, where the masses are."""


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

    @cached_property
    def runs_singly(self) -> bool:
        """Return whether every run is made by itself: of swings, of effects that a batch does not take, without heyoka."""
        return self.is_swing

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
        parameters, camera = self.parameters_and_camera(x, k)
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
                )
                self._cached_run[k] = last = parameters, t, run
            return last[2]

        d = self.data[k]
        parts = []
        if d.channels:
            values = predict(sample, camera, d.channels, dropped=d.trial.dropped)
            parts = [values[c.name] for c in d.channels]
        if d.events:
            parts.append(with_missed_events(self._run_for_events(parameters, k).predict(camera), d.events))
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


T = TypeVar("T")
Request = tuple[Problem, Array]
"""A problem and parameters of it, shape (m, p)."""
Steps = Generator[Request, Array, T]
"""Asks for predictions, is sent each, shape (m, n), and returns a result at last."""


def predict_requests(requests: Sequence[Request]) -> list[Array]:
    """Return what is predicted of all trials of each problem at its parameters, shape (m, n); nan: a trial's model cannot run.

    Single runs are made for swings of a held pendulum, which heyoka alone passes through turning points at once, for tables of
    events, which a batch does not keep, for a rod that turns, for a string that stretches, and where few runs have an effect
    with a model of its own. All others are one batch for the declared model's effects, one for further ones, and one for each
    effect that has a model of its own.
    """
    found = [np.full((len(x), problem.measured_rows), np.nan) for problem, x in requests]
    groups: dict[tuple[Any, ...], list[_Part]] = {}
    for into, (problem, x) in zip(found, requests, strict=True):
        end = 0
        for k, d in enumerate(problem.data):
            begin, end = end, end + len(d.value)
            part = _Part(problem, x, k, into[:, begin:end])
            groups.setdefault(part.model, []).append(part)
    for model, parts in groups.items():
        if model:
            _predict_together(parts)
        else:
            for part in parts:
                _predict_singly(part)
    return found


def jacobian_at(problem: Problem, x: Array) -> Array:
    """Return minus the derivative of the residuals at ``x``, shape (n + p, p), by central differences."""
    rows = problem.rows_of_jacobian(x)
    return problem.jacobian_of(x, rows, predict_requests([(problem, rows)])[0])


def together(steps: Sequence[Steps[T]]) -> list[T]:
    """Take the steps of many fits in step, each step of all one call of `predict_requests`; return their results.

    Raises
    ------
    HarnessError
        That of the first fit, in their order, that has one.
    """
    found = _run(steps)
    for error in (r for r in found if isinstance(r, HarnessError)):
        raise error
    return [r for r in found if not isinstance(r, HarnessError)]


def map_steps(
    workers: Workers, steps: Callable[..., Steps[T]], shared: tuple[Any, ...], items: Sequence[tuple[Any, ...]]
) -> list[T]:
    """Return what ``steps(*shared, *item)`` leads to for each item: every process takes an equal share of them, in step."""
    return workers.map_together(_take_steps, (steps, shared), items)


def _take_steps(call: tuple[Callable[..., Steps[T]], tuple[Any, ...]], items: Sequence[tuple[Any, ...]]) -> list[T]:
    steps, shared = call
    return together([steps(*shared, *item) for item in items])


def alone(steps: Steps[T]) -> T:
    """Take the steps of one fit; return its result, or raise its error."""
    (result,) = _run([steps])
    if isinstance(result, HarnessError):
        raise result
    return result


def _run(steps: Sequence[Steps[T]]) -> list[T | HarnessError]:
    results: dict[int, T | HarnessError] = {}
    waiting = list(enumerate(steps))
    answers: list[Any] = [None] * len(waiting)
    while waiting:
        asking, requests = [], []
        for (i, one), answer in zip(waiting, answers, strict=True):
            try:
                requests.append(one.send(answer))
                asking.append((i, one))
            except StopIteration as end:
                results[i] = end.value
            except HarnessError as error:
                results[i] = error
        waiting, answers = asking, predict_requests(requests)
    return [results[i] for i in range(len(steps))]


class _Part:
    """A trial at many parameters ``x``, shape (m, p), and where its predictions are wanted, ``into`` of shape (m, n)."""

    def __init__(self, problem: Problem, x: Array, k: int, into: Array) -> None:
        self.problem, self.x, self.k, self.into = problem, x, k, into
        self.base = problem.base[k]
        """Parameters that do not differ between the rows."""
        changes, camera = problem.changes(list(x.T), k)
        self.columns = {
            name: np.broadcast_to(values, len(x)) for name, values in self.base.with_static_friction(changes).items()
        }
        """Parameters of the model that differ between the rows, shape (m,) each."""
        self.camera, self.valid = Camera.of_many(camera, len(x))
        """Camera of all rows, and which rows have possible cameras, shape (m,)."""
        clock = [np.ravel(v) for v in (self.camera.clock_offset, self.camera.clock_ratio, self.camera.readout) if np.ndim(v)]
        # Rows that differ by the camera alone show the same run
        keys = np.column_stack([*self.columns.values(), *clock, np.zeros(len(x))])
        seen: dict[bytes, int] = {}
        self.run = np.array([seen.setdefault(row.tobytes(), len(seen)) for row in keys], dtype=np.intp)
        """Run of each row, an index into ``first``."""
        self.first = np.unique(self.run, return_index=True)[1]
        """A row of each run that is made."""

    @property
    def model(self) -> tuple[Any, ...]:
        """What the runs of one batch have in common; empty: these runs are made one by one."""
        d = self.problem.data[self.k]
        if d.events or not d.channels:
            return ()
        return self.base.release, self.base.own_effects, self.effects

    @cached_property
    def effects(self) -> Effects:
        """Effects that act in any of the runs."""
        return self.base.effects_with([name for name in self.columns if name in self.base.coefficients])

    def value(self, name: str) -> Array:
        """Return a parameter of all runs, shape (runs,)."""
        if name in self.columns:
            return self.columns[name][self.first]
        given = self.base.coefficients[name] if name in self.base.coefficients else getattr(self.base, name)
        return np.full(len(self.first), given)

    def clocks(self) -> dict[tuple[float, float, float], NDArray[np.intp]]:
        """Return (offset, ratio, readout) of a clock -> the runs that are sampled by it."""
        found: dict[tuple[float, float, float], list[int]] = {}
        camera = self.camera
        offset, ratio, readout = (
            np.broadcast_to(np.ravel(v), len(self.run))[self.first]
            for v in (camera.clock_offset, camera.clock_ratio, camera.readout)
        )
        for i, clock in enumerate(zip(offset.tolist(), ratio.tolist(), readout.tolist(), strict=True)):
            found.setdefault(clock, []).append(i)
        return {clock: np.array(runs, dtype=np.intp) for clock, runs in found.items()}

    def times(self, clocks: Mapping[tuple[float, float, float], NDArray[np.intp]]) -> list[Array]:
        """Return the times at which each run is sampled [s]."""
        found = [np.zeros(0)] * len(self.first)
        for clock, runs in clocks.items():
            wanted = sample_times(*clock, self.problem.data[self.k].channels).times
            for run in runs:
                found[run] = wanted
        return found


def _predict_together(parts: Sequence[_Part]) -> None:
    """Make the runs of all parts as one batch, and fill in what they predict."""
    base = parts[0].base
    bases = {id(part.base): vars(part.base.values()) for part in parts}.values()
    differing = {name for part in parts for name in part.columns} | {"gravity"}  # at least one column
    differing |= {n for n in (*NUMBERS, *base.coefficients) if any(values[n] != vars(base.values())[n] for values in bases)}
    columns = {name: np.concatenate([part.value(name) for part in parts]) for name in sorted(differing)}
    clocks = [part.clocks() for part in parts]
    times = [t for part, by_clock in zip(parts, clocks, strict=True) for t in part.times(by_clock)]
    # A millisecond longer, so that a run does not end just before the last point
    duration = np.array([t[-1] + 1e-3 for t in times])
    samples = sample_batch(base, columns, times, duration=duration, tolerance=FIT_TOLERANCE)
    begin = 0
    for part, by_clock in zip(parts, clocks, strict=True):
        d = part.problem.data[part.k]
        for clock, runs in by_clock.items():
            wanted = sample_times(*clock, d.channels)
            index = begin + runs
            at = samples.start[index][:, None] + np.arange(len(wanted.times))
            places = SimpleNamespace(**{n: part.value(n)[runs][:, None] for n in PLACES})
            sampled = SampledRuns(samples.state[:, at], samples.count[index], places, part.effects)
            place = np.full(len(part.first), -1, dtype=np.intp)
            place[runs] = np.arange(len(runs))
            rows = np.flatnonzero(place[part.run] >= 0)
            values = predict_many(sampled, place[part.run[rows]], part.camera.take(rows), d.channels, wanted, d.trial.dropped)
            values[~part.valid[rows]] = np.nan
            part.into[rows] = values
        begin += len(part.first)


def _predict_singly(part: _Part) -> None:
    """Fill in what a trial's runs predict, made one by one; a problem keeps the last run for rows that show the same."""
    for row in np.argsort(part.run, kind="stable"):
        try:
            part.into[row] = part.problem.predict(part.x[row], part.k)
        except (HarnessError, ValueError, ArithmeticError):
            part.into[row] = np.nan
