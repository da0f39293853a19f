"""Many runs of the hybrid model at once: what became of each, as arrays."""

from __future__ import annotations

import dataclasses
import multiprocessing
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.errors import HarnessError, ParameterError
from looping_pendulum.reference_ode.batch.lanes import LANES, Lanes
from looping_pendulum.reference_ode.batch.result import ENDS, FAILED, BatchResult, sequence_hash, summary
from looping_pendulum.reference_ode.batch.steps import covered
from looping_pendulum.reference_ode.effects import COEFFICIENTS
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import POINT_MASS_END, Parameters, Release, string_length, touching_length
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.solve import DURATION, TOLERANCE, available_integrators, solve, solve_at

__all__ = ["COLUMNS", "ENDS", "FAILED", "BatchResult", "Progress", "sample_batch", "sequence_hash", "solve_batch"]

_LENGTHS_AND_MASSES = ("light_mass", "heavy_mass", "rod_radius", "free_length", "hanging_length")
_FIELDS = tuple(field.name for field in dataclasses.fields(Parameters) if field.name not in ("release", "coefficients"))
COLUMNS = (*_FIELDS, *COEFFICIENTS)
"""Names that a column may have."""
LEAST_SHARE = LANES
"""Runs that a process takes at a time, at least; of many it takes more, since every share ends with empty lanes."""

Columns = Mapping[str, Array]
Progress = Callable[[int, int], None]
"""Called with the number of runs that are done, and of all."""


def solve_batch(
    base: Parameters,
    columns: Columns,
    *,
    duration: float = DURATION,
    tolerance: float = TOLERANCE,
    processes: int = 1,
    progress: Progress | None = None,
) -> BatchResult:
    """Integrate many runs that share ``base`` but for ``columns``; each result equals that of `solve`.

    With heyoka, and effects that add nothing to the state, all runs are stepped together; else one after another.

    Parameters
    ----------
    base
        What the runs have in common.
    columns
        Fields of `Parameters` or coefficients of effects, by name, SI; arrays of shape (n,).
    duration
        Limit on the simulated time [s].
    tolerance
        Relative tolerance of a step.
    processes
        How many processes share the work. More than one needs a script with ``if __name__ == "__main__":``.
    progress
        Called now and then with the number of runs done and of all.

    Raises
    ------
    ParameterError
        If a column has an unknown name or another length than the others. A run whose values are impossible, or that breaks
        down, is marked as failed and does not disturb the others.
    """
    n = _checked_length(columns)
    if processes == 1 or n == 0:
        return _solve_share(base, columns, duration, tolerance, _Counter(n, progress).add)
    columns = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    spawn = multiprocessing.get_context("spawn")  # not forked: a copy of a process whose libraries have threads may hang
    taken = spawn.Value("q", 0)
    work = partial(_solve_shares, base, columns, duration, tolerance, processes)
    with ProcessPoolExecutor(processes - 1, mp_context=spawn, initializer=_share_out, initargs=(taken,)) as pool:
        others = [pool.submit(work) for _ in range(processes - 1)]
        try:
            parts = work(taken, progress)
        except BaseException:
            taken.value = n  # so that the others take no more
            raise
        for other in others:
            parts |= other.result()
    if progress is not None:
        progress(n, n)
    return BatchResult.joined([parts[start] for start in sorted(parts)])


_taken: Any = None
"""Of a helping process: how many runs all processes together have taken."""


def _share_out(taken: Any) -> None:
    global _taken
    _taken = taken


def _solve_shares(
    base: Parameters,
    columns: Columns,
    duration: float,
    tolerance: float,
    processes: int,
    taken: Any = None,
    progress: Progress | None = None,
) -> dict[int, BatchResult]:
    """Take shares of the runs until all are taken; return the results by their first runs."""
    taken, parts = taken or _taken, dict[int, BatchResult]()
    n = len(next(iter(columns.values())))
    while True:
        with taken.get_lock():
            start = taken.value
            taken.value = end = min(start + _share(n - start, processes), n)
        if start == n:
            return parts
        part = {name: values[start:end] for name, values in columns.items()}
        parts[start] = _solve_share(base, part, duration, tolerance, _Counter(n, progress, start).add)


def _share(left: int, processes: int) -> int:
    """How many of the runs that are ``left`` a process takes: half of what would be its due, so that all end together."""
    return max(min(LEAST_SHARE, -(-left // processes)), left // (2 * processes))


class _Counter:
    """Counts runs for a `Progress`."""

    def __init__(self, n: int, progress: Progress | None, done: int = 0) -> None:
        self._n, self._progress, self._done = n, progress, done

    def add(self, runs: int) -> None:
        self._done += runs
        if self._progress is not None:
            self._progress(self._done, self._n)


def sample_batch(
    base: Parameters,
    columns: Columns,
    runs: Iterable[int],
    t: Array,
    *,
    duration: float = DURATION,
    tolerance: float = TOLERANCE,
) -> list[Samples]:
    """Trajectories of some runs of a batch: samples at times ``t`` [s], ascending, of the runs with these indices.

    Times after a run's end are left out.

    Raises
    ------
    IntegrationError, ParameterError
        If one of these runs fails.
    """
    _checked_length(columns)
    return [solve_at(_member(base, columns, i), t, duration=duration, tolerance=tolerance) for i in runs]


def _checked_length(columns: Columns) -> int:
    """Number of runs."""
    if not columns:
        raise ParameterError("columns: found none, needed at least one array of values, one value per run")
    lengths: dict[str, int] = {}
    for name, values in columns.items():
        if name not in COLUMNS:
            raise ParameterError(f"columns: found {name!r}, needed one of {', '.join(COLUMNS)}")
        shape = np.shape(values)
        if len(shape) != 1:
            raise ParameterError(f"columns: {name}: found shape {shape}, needed one value per run, shape (n,)")
        lengths[name] = shape[0]
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise ParameterError(f"columns: found lengths {found}, needed the same for all")
    return next(iter(lengths.values()))


def _member(base: Parameters, columns: Columns, i: int) -> Parameters:
    """Parameters of run ``i``."""
    return base.replace(**{name: float(values[i]) for name, values in columns.items()})


def _solve_share(
    base: Parameters, columns: Columns, duration: float, tolerance: float, done: Callable[[int], None] = lambda runs: None
) -> BatchResult:
    """What `solve_batch` returns, found in this process."""
    n = len(next(iter(columns.values())))
    numbers = _numbers(base, columns)
    effects = base.effects_with([name for name in columns if name in COEFFICIENTS])
    result, left = BatchResult.empty(n), np.arange(n)
    if "heyoka" in available_integrators() and covered(effects):
        together = np.flatnonzero(_possible(numbers, n))
        chosen = {name: values[together] if np.ndim(values) else values for name, values in numbers.items()}
        lanes = Lanes(chosen, len(together), effects, base.release, duration, tolerance, done)
        result.put(together, lanes.run())
        left = np.flatnonzero(result.end == FAILED)  # a single run says whether these are impossible or break down
    for i in left.tolist():
        try:
            run = solve(_member(base, columns, i), duration=duration, tolerance=tolerance)
        except (HarnessError, ArithmeticError):
            done(1)
            continue
        for name, value in summary(run).items():
            getattr(result, name)[i] = value
        done(1)
    return result


def _numbers(base: Parameters, columns: Columns) -> dict[str, Any]:
    """Every number that the equations need, by name: one value, or one per run."""
    numbers: dict[str, Any] = {name: getattr(base, name) for name in _FIELDS} | dict(base.coefficients)
    numbers |= {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    if base.static_follows and "static_friction" not in columns:
        numbers["static_friction"] = numbers["kinetic_friction"]
    if base.release is Release.VERTICAL:
        numbers["release_angle"] = base.release_angle
    light_radius, rod_radius = numbers["light_radius"], numbers["rod_radius"]
    point = POINT_MASS_END * rod_radius
    numbers["end_length"] = np.where(np.greater(light_radius, 0), touching_length(light_radius, rod_radius), point)
    numbers["string_length"] = string_length(**{name: numbers[name] for name in (*_STRING, "heavy_swing")})
    return numbers


_STRING = ("free_length", "rod_radius", "release_angle", "hanging_length")


def _possible(numbers: Mapping[str, Any], n: int) -> NDArray[np.bool_]:
    """Which runs have values that `Parameters` does not refuse."""
    checks = [np.isfinite(numbers[name]) & np.greater(numbers[name], 0) for name in _LENGTHS_AND_MASSES]
    checks += [np.isfinite(numbers["light_radius"]) & np.greater_equal(numbers["light_radius"], 0)]
    checks += [np.greater(numbers["release_angle"], 0) & np.less(numbers["release_angle"], 2 * np.pi)]
    for name, coefficient in COEFFICIENTS.items():
        low, high = coefficient.bounds
        checks.append(np.greater_equal(numbers[name], low) & np.less_equal(numbers[name], high) & np.isfinite(numbers[name]))
    checks.append(np.greater_equal(numbers["static_friction"], numbers["kinetic_friction"]))
    checks.append(np.greater(numbers["free_length"], numbers["end_length"]))
    possible = np.ones(n, dtype=bool)
    for check in checks:
        possible &= check
    return possible
