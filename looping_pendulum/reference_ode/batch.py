"""Solve many runs that differ in some parameters, and return their results as arrays."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from looping_pendulum.errors import IntegrationError, ParameterError
from looping_pendulum.reference_ode.core.host import Runs, this_threads_core, traced
from looping_pendulum.reference_ode.core.trace import EVENTS
from looping_pendulum.reference_ode.effects import COEFFICIENTS, EFFECTS
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import (
    NUMBERS,
    HasParameters,
    Parameters,
    Release,
    derived_values,
    effect_tables,
    parameters_of,
)
from looping_pendulum.reference_ode.solution import MAX_RESTING_ROD_SPEED, string_overlap
from looping_pendulum.reference_ode.solve import TOLERANCE, default_duration, failure
from looping_pendulum.reference_ode.state import Effects, State, heavy_drop
from looping_pendulum.reference_ode.transitions import PHASE_EVENTS, Event, Mode

Columns = Mapping[str, ArrayLike]
"""Name, one of `column_names` -> one value per run, shape (n,), SI."""
Progress = Callable[[int, int], None]
"""Called with the number of runs that have ended and the number of all runs."""
ENDS: tuple[str, ...] = (
    Event.LIGHT_REACHES_ROD,
    Event.HEAVY_REACHES_ROD,
    Event.UNWRAPPED,
    Event.TIME_UP,
    "failed",
)
"""Values of `BatchResult.end`, by index: the event that ended a run, or "failed"."""
FAILED = ENDS.index("failed")
SWITCH_COEFFICIENTS = frozenset(e.switch for e in EFFECTS.values() if e.switch)
"""Coefficients at whose null value an effect sets in, so that no derivative exists there."""
MOST_RUNS = 500
"""Number of runs that are carried out at once by one thread: some 50 ms."""

# Offset basis and prime of the 64-bit FNV-1a hash
_HASH_START, _HASH_FACTOR = np.uint64(0xCBF29CE484222325), np.uint64(0x100000001B3)


class EventTable:
    """The events of many runs, one run after another: rows of the driver, and the values of the parameters."""

    def __init__(self, runs: Runs, values: Mapping[str, Any], effects: Effects) -> None:
        rows = runs.events
        self.n, self._values, self._effects = len(runs.event_counts), values, effects
        self.last = np.cumsum(runs.event_counts) - 1
        """Row of each run's end, shape (n,)."""
        self.run = np.repeat(np.arange(self.n), runs.event_counts)
        """Run of each row."""
        self.code, self.mode = rows[:, 0].astype(np.int64), rows[:, 1].astype(np.int64)
        self.time, self.state = rows[:, 2], State(*rows[:, 3 : 3 + len(State._fields)].T)
        self.ended = runs.failures == 0
        self.is_mode_change = ~np.isin(self.code, _codes(*PHASE_EVENTS))
        """Rows after which a mode begins, or the run is over; the release is one."""

    def count(self, rows: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return how many of these rows each run has."""
        return np.bincount(self.run[rows], minlength=self.n)

    @cached_property
    def halt(self) -> NDArray[np.int64]:
        """Row of the event that began the sticking that lasted until the light mass reached the rod, or -1, shape (n,)."""
        before = np.append(-1, np.maximum.accumulate(np.where(self.is_mode_change, np.arange(len(self.run)), -1)))[self.last]
        # In the table of all runs the row before a run's first is another run's; a run has a release and an end at least
        halts = (self.code[self.last] == _codes(Event.LIGHT_REACHES_ROD)[0]) & (self.mode[before] == Mode.STICKING)
        return np.where(halts & self.ended, before, -1)

    def at_halt(self, column: Array) -> Array:
        """Return the values of a column of the rows at the halts; nan without one."""
        return np.where(self.halt >= 0, column[self.halt], np.nan)

    def heavy_drop(self) -> Array:
        """Return how far the heavy mass is below its release at the end of each run [m]."""
        end = State(*(column[self.last] for column in self.state))
        p = SimpleNamespace(**self._values)
        return np.asarray(heavy_drop(np, end, string_overlap(end, self._effects), p, self._effects))

    def ends(self) -> NDArray[np.int64]:
        """Return how each run ended, an index into `ENDS`."""
        place = {code: i for i, code in enumerate(_codes(*map(Event, ENDS[:FAILED])))}
        return np.array([place.get(code, FAILED) for code in self.code[self.last].tolist()])

    def sequences(self) -> NDArray[np.uint64]:
        """Return the hash of each run's sequence of modes (`sequence_hash`)."""
        rows = np.flatnonzero(self.is_mode_change)
        run, mode = self.run[rows], self.mode[rows].astype(np.uint64)
        place = np.arange(len(rows)) - np.searchsorted(run, run)
        hashes = np.full(self.n, _HASH_START)
        with np.errstate(over="ignore"):  # the product is taken modulo 2^64
            for k in range(place.max(initial=-1) + 1):
                now = place == k
                hashes[run[now]] = (hashes[run[now]] ^ mode[now]) * _HASH_FACTOR
        return hashes


def _codes(*events: Event) -> list[int]:
    return [EVENTS.index(event) for event in events]


def sequence_hash(modes: Iterable[int]) -> int:
    """Return the 64-bit FNV-1a hash of a sequence of modes."""
    value = _HASH_START
    with np.errstate(over="ignore"):
        for mode in modes:
            value = (value ^ np.uint64(mode)) * _HASH_FACTOR
    return int(value)


@dataclass(frozen=True, kw_only=True)
class RunColumn:
    """What a batch, and a map, hold of every run."""

    unit: str
    """SI unit; '' for a plain number."""
    meaning: str
    of_runs: Callable[[EventTable], Any]
    """Its values for the runs of a table."""
    kind: type[np.generic]
    failed: float
    """Its value for a run that broke down."""

    @property
    def missing(self) -> float:
        """Its value for a run of which it is not known, as an array of its kind can hold it."""
        return {"f": float("nan"), "i": -1, "u": 0}[np.dtype(self.kind).kind]


def _column(
    unit: str, meaning: str, of_runs: Callable[[EventTable], Any], kind: type[np.generic] = np.float64, failed: float = np.nan
) -> Any:
    column = RunColumn(unit=unit, meaning=meaning, of_runs=of_runs, kind=kind, failed=failed)
    return dataclasses.field(metadata={"column": column})


def _at_halt(unit: str, meaning: str, value: Callable[[EventTable], Array]) -> Any:
    return _column(unit, f"{meaning}; NaN without one", lambda table: table.at_halt(value(table)))


@dataclass(frozen=True, kw_only=True)
class BatchResult:
    """Result of each run; every array has shape (n,). A failed run has nan, zero counts and a sequence of 0, and an error."""

    halting_time: Array = _at_halt(
        "s", "start of the sticking that lasts until the light mass reaches the rod", lambda table: table.time
    )
    halting_wrap_angle: Array = _at_halt("rad", "wrap angle at the halting time", lambda table: table.state.wrap_angle)
    halting_free_length: Array = _at_halt("m", "free length at the halting time", lambda table: table.state.free_length)
    drop: Array = _column("m", "how far the heavy mass is below its release at the end of the run", EventTable.heavy_drop)
    wrap_angle: Array = _column("rad", "wrap angle at the end of the run", lambda table: table.state.wrap_angle[table.last])
    free_length: Array = _column("m", "free length at the end of the run", lambda table: table.state.free_length[table.last])
    stops: NDArray[np.int32] = _column(
        "", "how often the heavy mass's speed became zero",
        lambda table: table.count(
            np.isin(table.code, _codes(Event.STOP, Event.ROD_STOPS)) & (abs(table.state.rod_speed) < MAX_RESTING_ROD_SPEED)
        ), np.int32, 0,
    )  # fmt: skip
    slip_count: NDArray[np.int32] = _column(
        "", "how often a string at rest on the rod began to slide again",
        lambda table: table.count(np.isin(table.code, _codes(Event.SLIP_ONSET_DOWN, Event.SLIP_ONSET_UP))), np.int32, 0,
    )  # fmt: skip
    slack_intervals: NDArray[np.int32] = _column(
        "", "how often the string was, or became, slack",
        lambda table: table.count(table.is_mode_change & np.isin(table.mode, (Mode.SLACK, Mode.CLAMPED_SLACK))), np.int32, 0,
    )  # fmt: skip
    end: NDArray[np.int8] = _column("", "how the run ended", EventTable.ends, np.int8, FAILED)
    """An index into `ENDS`."""
    end_time: Array = _column("s", "end of the run", lambda table: table.time[table.last])
    sequence: NDArray[np.uint64] = _column("", "hash of the sequence of modes", EventTable.sequences, np.uint64, 0)
    """`sequence_hash`."""
    errors: dict[int, ParameterError | IntegrationError] = dataclasses.field(default_factory=dict)
    """Index of a failed run -> the error that `solve` raises for it: impossible values, or an integration that broke down."""

    def __len__(self) -> int:
        return len(self.end)

    @classmethod
    def empty(cls, n: int) -> BatchResult:
        """Return results of ``n`` runs, all marked as failed until they are filled in."""
        arrays: dict[str, Any] = {name: np.full(n, column.failed, dtype=column.kind) for name, column in COLUMNS.items()}
        return cls(**arrays)


COLUMNS: dict[str, RunColumn] = {
    field.name: field.metadata["column"] for field in dataclasses.fields(BatchResult) if "column" in field.metadata
}
"""Name of an array of `BatchResult` -> what it is."""


def column_names(base: Parameters) -> tuple[str, ...]:
    """Return the names that a column may have."""
    return (*NUMBERS, *base.coefficients)


def solve_batch(
    base: Parameters | HasParameters,
    columns: Columns,
    *,
    duration: ArrayLike | None = None,
    tolerance: float = TOLERANCE,
    threads: int = 1,
    progress: Progress | None = None,
) -> BatchResult:
    """Integrate many runs that share ``base`` but for ``columns``; each result equals that of `solve`.

    A result does not depend, in any bit, on the other runs, on their order, or on the thread that computes it.

    Parameters
    ----------
    base
        Parameters that the runs have in common; or a scenario, which has them.
    columns
        Parameters that differ between the runs: fields of `Parameters` or coefficients of effects, by name; arrays of
        shape (n,), SI.
    duration
        Limit on the simulated time [s], of all runs or of each, shape (n,); None: `default_duration` of ``base``.
    tolerance
        Relative tolerance of a step.
    threads
        Number of threads that share the work.
    progress
        Called now and then with the number of runs that have ended and the number of all runs.

    Raises
    ------
    ParameterError
        If a column has an unknown name or another length than the others. A run that is impossible (a mass of 0 or NaN, a
        static friction below the kinetic one), or that breaks down, raises nothing and does not disturb the others: its ``end``
        is `FAILED`, and `BatchResult.errors` has the error that `solve` raises for it.
    """
    if threads < 1:
        raise ParameterError(f"threads: found {threads}, needed 1 or more")
    base = parameters_of(base)
    n = _checked_length(base, columns)
    arrays = {name: np.asarray(column, dtype=float) for name, column in columns.items()}
    durations = np.broadcast_to(np.asarray(default_duration(base) if duration is None else duration, dtype=float), n)
    all_values = parameter_values(base, arrays)
    result = BatchResult.empty(n)
    result.errors.update(impossible_runs(base, all_values, n))
    valid, ended = np.delete(np.arange(n), list(result.errors)), len(result.errors)

    def carry_out(effects_and_runs: tuple[Effects, NDArray[np.int64]]) -> tuple[NDArray[np.int64], EventTable, Runs]:
        effects, part = effects_and_runs
        model = traced(base.release, effects, derivatives=False)
        values = {name: value[part] if np.ndim(value) else value for name, value in all_values.items()}
        p = np.empty((len(part), len(model.names)))
        for column, name in zip(p.T, model.names, strict=True):
            column[:] = values[name]
        no_samples = np.zeros(len(part) + 1, dtype=np.int32)
        runs = this_threads_core().carry_out(model, p, durations[part], np.zeros(0), no_samples, tolerance=tolerance)
        return part, EventTable(runs, values, effects), runs

    parts = [
        (effects, runs[begin : begin + MOST_RUNS])
        for effects, runs in _by_effects(base, arrays, all_values, valid)
        for begin in range(0, len(runs), MOST_RUNS)
    ]
    with ThreadPoolExecutor(threads) if threads > 1 else nullcontext() as pool:
        for part, table, runs in pool.map(carry_out, parts) if pool else map(carry_out, parts):
            for name, column in COLUMNS.items():
                values = column.of_runs(table)
                getattr(result, name)[part[table.ended]] = values[table.ended]
            for i in np.flatnonzero(runs.failures).tolist():
                result.errors[int(part[i])] = failure(runs, i)
            ended += len(part)
            if progress is not None:
                progress(ended, n)
    return result


def _by_effects(
    base: Parameters, columns: Mapping[str, Array], values: Mapping[str, Any], valid: NDArray[np.int64]
) -> Iterator[tuple[Effects, NDArray[np.int64]]]:
    """Yield effects and the valid runs in which they act: only an effect that sets in is left out at its null value."""
    names = [name for name in columns if name in base.coefficients]
    switches = sorted(SWITCH_COEFFICIENTS.intersection(names))
    is_off = np.zeros(len(valid), dtype=np.int64)
    for bit, name in enumerate(switches):
        is_off |= (values[name][valid] == COEFFICIENTS[name].null) << np.int64(bit)
    for pattern in np.unique(is_off).tolist():
        off = {name: COEFFICIENTS[name].null for bit, name in enumerate(switches) if pattern >> bit & 1}
        with_off = base.replace(**off) if off else base
        yield with_off.effects_with([name for name in names if name not in off]), valid[is_off == pattern]


def parameter_values(base: Parameters, columns: Columns) -> dict[str, Any]:
    """Return every parameter, and what follows from it, by name: one value, or one per run, shape (n,)."""
    values: dict[str, Any] = {name: getattr(base, name) for name in NUMBERS} | dict(base.coefficients)
    values |= base.with_static_friction({name: np.asarray(column, dtype=float) for name, column in columns.items()})
    # As in `Parameters.replace`, a vertical release keeps its angle
    if base.release is Release.VERTICAL:
        values["release_angle"] = base.release_angle
    with np.errstate(invalid="ignore"):  # impossible values are refused afterwards
        # What follows stands back: the least damping is the equations' alone
        return derived_values(values, np.where) | values


def impossible_runs(base: Parameters, values: Mapping[str, Any], n: int) -> dict[int, ParameterError]:
    """Return the index of each of ``n`` runs with impossible values -> the error that `Parameters` raises for it."""
    refused: dict[int, ParameterError] = {}
    # All other coefficients are those of `base`, which was checked
    given = [name for name in base.coefficients if isinstance(values[name], np.ndarray)]
    for requirement in effect_tables(base.own_effects).requirements(given):
        for run in np.flatnonzero(~np.broadcast_to(requirement.is_met(values), n)).tolist():
            if run not in refused:
                own = {name: value[run] if np.ndim(value) else value for name, value in values.items()}
                refused[run] = ParameterError(requirement.message(own))
    return refused


def _checked_length(base: Parameters, columns: Columns) -> int:
    """Check the names and shapes of the columns and return the number of runs."""
    if not columns:
        raise ParameterError("columns: found none, needed at least one array of values, one value per run")
    lengths: dict[str, int] = {}
    for name, values in columns.items():
        if name not in column_names(base):
            raise ParameterError(f"columns: found {name!r}, needed one of {', '.join(column_names(base))}")
        shape = np.shape(values)
        if len(shape) != 1:
            raise ParameterError(f"columns: {name}: found shape {shape}, needed one value per run, shape (n,)")
        lengths[name] = shape[0]
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise ParameterError(f"columns: found lengths {listed}, needed the same for all")
    return next(iter(lengths.values()))
