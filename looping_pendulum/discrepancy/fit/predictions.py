"""Predict what is measured at many parameters of many problems at once, their runs in a batch; and steps of fits in step."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.measurement import FIT_TOLERANCE, SampledRuns, predict_many, sample_times
from looping_pendulum.reference_ode.batch import compiled_alone, sample_batch, supports
from looping_pendulum.reference_ode.effects import EffectKind
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import NUMBERS, Parameters, Release
from looping_pendulum.reference_ode.state import Effects

T = TypeVar("T")
Request = tuple[Problem, Array]
"""A problem and parameters of it, shape (m, p)."""
Steps = Generator[Request, Array, T]
"""Asks for predictions, is sent each, shape (m, n), and returns a result at last."""
MIN_BATCH, MIN_BATCH_OF_OWN_MODEL = 3, 12
"""Number of runs of one trial that are asked for at once, from which on they are made in a batch: where all further effects
share one compiled model, and where an effect needs a model of its own, which a fit is worth, but not what a few values do.

What a batch costs beside its runs is as much as some eight single ones. But whether a run is part of one may not depend on what
else is asked for, as a single run differs from it in the last digits, and results are the same for any number of processes.
"""

PLACES = ("rod_radius", "free_length", "release_angle", "hanging_length", "heavy_swing", "string_thickness")
"""Parameters that say, beside the state, where the masses are."""


def predict(requests: Sequence[Request]) -> list[Array]:
    """Return what is predicted of all trials of each problem at its parameters, shape (m, n); nan: a trial's model cannot run.

    Single runs are made where they are few, for swings of a held pendulum, which heyoka alone passes through turning points at
    once, for tables of events, which a batch does not keep, for a rod that turns and for a string that stretches. All others
    are one batch for the declared model's effects, one for further ones, and one for each effect that has a model of its own.
    """
    found = [np.full((len(x), problem.measured_rows), np.nan) for problem, x in requests]
    groups: dict[tuple[Any, ...], list[_Part]] = {}
    for into, (problem, x) in zip(found, requests, strict=True):
        end = 0
        for k, d in enumerate(problem.data):
            begin, end = end, end + len(d.value)
            part = _Part.of(problem, x, k, into[:, begin:end])
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
    return problem.jacobian_of(x, rows, predict([(problem, rows)])[0])


def together(steps: Sequence[Steps[T]]) -> list[T]:
    """Take the steps of many fits in step, each step of all one call of `predict`; return their results.

    Raises
    ------
    HarnessError
        That of the first fit, in their order, that has one.
    """
    found = _run(steps)
    for error in (r for r in found if isinstance(r, HarnessError)):
        raise error
    return [r for r in found if not isinstance(r, HarnessError)]


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
        waiting, answers = asking, predict(requests)
    return [results[i] for i in range(len(steps))]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Part:
    """A trial at many parameters."""

    problem: Problem
    x: Array
    k: int
    columns: Mapping[str, Array]
    """Parameters of the model that differ between the rows, shape (m,) each."""
    camera: Camera
    """Of all rows."""
    valid: NDArray[np.bool_]
    """Which rows have possible cameras, shape (m,)."""
    into: Array
    """Where the predictions are wanted, shape (m, n)."""
    first: NDArray[np.intp]
    """A row of each run that is made."""
    run: NDArray[np.intp]
    """Run of each row, an index into ``first``."""

    @classmethod
    def of(cls, problem: Problem, x: Array, k: int, into: Array) -> _Part:
        """Return a trial as a part; arguments as the fields."""
        base = problem.base[k]
        changes, camera = problem.changes(list(x.T), k)
        columns = {name: np.broadcast_to(values, len(x)) for name, values in base.with_static_friction(changes).items()}
        many, valid = Camera.of_many(camera, len(x))
        clock = [np.ravel(v) for v in (many.clock_offset, many.clock_ratio, many.readout) if np.ndim(v)]
        # Rows that differ by the camera alone show the same run
        keys = np.column_stack([*columns.values(), *clock, np.zeros(len(x))])
        seen: dict[bytes, int] = {}
        run = np.array([seen.setdefault(row.tobytes(), len(seen)) for row in keys], dtype=np.intp)
        first = np.array([int(np.flatnonzero(run == i)[0]) for i in range(len(seen))], dtype=np.intp)
        return cls(problem=problem, x=x, k=k, columns=columns, camera=many, valid=valid, into=into, first=first, run=run)

    @property
    def base(self) -> Parameters:
        """Parameters that do not differ between the rows."""
        return self.problem.base[self.k]

    @property
    def model(self) -> tuple[Any, ...]:
        """What the runs of one batch have in common; empty: these runs are made one by one."""
        d = self.problem.data[self.k]
        names = [name for name in self.columns if name in self.base.coefficients]
        alone = compiled_alone(self.effects)
        least = MIN_BATCH_OF_OWN_MODEL if alone else MIN_BATCH
        if len(self.first) < least or d.events or not d.channels or self.base.release is Release.HELD:
            return ()
        if not supports(self.base, names):
            return ()
        further = [effect for effect in self.effects if not effect.in_base_model]
        has_closure = any(effect.kind is EffectKind.CLOSURE for effect in further)
        return self.base.release, self.base.own_effects, bool(further), has_closure, alone

    @cached_property
    def effects(self) -> Effects:
        """Effects that act in any of the runs."""
        return self.base.effects_with([name for name in self.columns if name in self.base.coefficients])

    def value(self, name: str) -> Array:
        """Return a parameter of all runs, shape (runs,)."""
        if name in self.columns:
            return self.columns[name][self.first]
        base = self.base
        given = base.coefficients[name] if name in base.coefficients else getattr(base, name)
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
