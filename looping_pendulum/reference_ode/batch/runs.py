"""The runs of a batch: their parameters and results as arrays."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import (
    NUMBERS,
    POINT_MASS_END,
    Parameters,
    Release,
    effect_tables,
    string_length,
    touching_length,
)
from looping_pendulum.reference_ode.solution import Run
from looping_pendulum.reference_ode.transitions import Event, Mode

Columns = Mapping[str, Array]
"""Name, one of `column_names` -> one value per run, shape (n,), SI."""
Index = NDArray[np.int64]
"""Indices of runs in the batch, shape (n,)."""
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

# Offset basis and prime of the 64-bit FNV-1a hash
HASH_START, _HASH_FACTOR = np.uint64(0xCBF29CE484222325), np.uint64(0x100000001B3)


def column_names(base: Parameters) -> tuple[str, ...]:
    """Return the names that a column may have."""
    return (*NUMBERS, *base.coefficients)


def parameters_of_run(base: Parameters, columns: Columns, i: int) -> Parameters:
    """Return the parameters of run ``i``."""
    return base.replace(**{name: float(values[i]) for name, values in columns.items()})


def equation_parameters(base: Parameters, columns: Columns) -> dict[str, Any]:
    """Return every parameter that the equations read, by name: one value, or one per run.

    Derived ones (`end_length`, `string_length`) and the defaults are those of `Parameters`.
    """
    values: dict[str, Any] = {name: getattr(base, name) for name in NUMBERS} | dict(base.coefficients)
    values |= base.with_static_friction({name: np.asarray(column, dtype=float) for name, column in columns.items()})
    # As in `Parameters.replace`, a vertical release keeps its angle
    if base.release is Release.VERTICAL:
        values["release_angle"] = base.release_angle
    light_radius, rod_radius = values["light_radius"], values["rod_radius"]
    point = POINT_MASS_END * rod_radius
    values["end_length"] = np.where(np.greater(light_radius, 0), touching_length(light_radius, rod_radius), point)
    values["string_length"] = string_length(
        values["free_length"], rod_radius, values["release_angle"], values["hanging_length"], values["heavy_swing"]
    )
    return values


def valid_runs(base: Parameters, values: Mapping[str, Any], n: int) -> NDArray[np.bool_]:
    """Return which of ``n`` runs have values that `Parameters` accepts."""
    valid = np.ones(n, dtype=bool)
    for requirement in effect_tables(base.own_effects).requirements(base.coefficients):
        valid &= requirement.is_met(values)
    return valid


@dataclass(frozen=True, kw_only=True)
class RunColumn:
    """What a batch, and a map, hold of every run."""

    unit: str
    """SI unit; '' for a plain number."""
    meaning: str
    of_run: Callable[[Run], Any]
    """Its value for a single run."""
    at_end: str
    """Entry of the state whose value at the end of the run it is; '' if it is none."""
    kind: type[np.generic]
    failed: float
    """Its value for a run that broke down."""
    in_maps: bool


def _column(
    unit: str, meaning: str, of_run: Callable[[Run], Any], kind: type[np.generic] = np.float64, failed: float = np.nan,
    *, in_maps: bool = True, at_end: str = "",
) -> Any:  # fmt: skip
    column = RunColumn(unit=unit, meaning=meaning, of_run=of_run, at_end=at_end, kind=kind, failed=failed, in_maps=in_maps)
    return dataclasses.field(metadata={"column": column})


def _at_halt(unit: str, meaning: str, value: Callable[[Any], Any]) -> Any:
    return _column(unit, f"{meaning}; NaN without one", lambda run: np.nan if run.halt is None else value(run.halt))


def _at_end(unit: str, meaning: str, name: str) -> Any:
    return _column(unit, f"{meaning} at the end of the run", attrgetter(f"end.state.{name}"), at_end=name)


@dataclass(frozen=True, kw_only=True)
class BatchResult:
    """Result of each run; every array has shape (n,). A failed run has nan, zero counts and a sequence of 0."""

    halting_time: Array = _at_halt(
        "s", "start of the sticking that lasts until the light mass reaches the rod", attrgetter("time")
    )
    halting_wrap_angle: Array = _at_halt("rad", "wrap angle at the halting time", attrgetter("state.wrap_angle"))
    halting_free_length: Array = _at_halt("m", "free length at the halting time", attrgetter("state.free_length"))
    drop: Array = _column(
        "m", "how far the heavy mass is below its release at the end of the run", lambda run: run.heavy_drop(run.end.state)
    )
    wrap_angle: Array = _at_end("rad", "wrap angle", "wrap_angle")
    free_length: Array = _at_end("m", "free length", "free_length")
    stops: NDArray[np.int32] = _column(
        "", "how often the heavy mass's speed became zero", lambda run: len(run.stops), np.int32, 0
    )
    slip_count: NDArray[np.int32] = _column(
        "", "how often a string at rest on the rod began to slide again",
        lambda run: sum(event.event in (Event.SLIP_ONSET_DOWN, Event.SLIP_ONSET_UP) for event in run.events), np.int32, 0,
    )  # fmt: skip
    slack_intervals: NDArray[np.int32] = _column(
        "", "how often the string was, or became, slack",
        lambda run: sum(mode in (Mode.SLACK, Mode.CLAMPED_SLACK) for mode in run.modes), np.int32, 0,
    )  # fmt: skip
    end: NDArray[np.int8] = _column("", "how the run ended", lambda run: ENDS.index(run.end.event), np.int8, FAILED)
    """An index into `ENDS`."""
    end_time: Array = _column("s", "end of the run", attrgetter("end_time"))
    sequence: NDArray[np.uint64] = _column(
        "", "hash of the sequence of modes", lambda run: sequence_hash(run.modes), np.uint64, 0
    )
    """`sequence_hash`."""
    handed_over: NDArray[np.int8] = _column(
        "", "1 where heyoka gave up and SciPy solved the run, else 0", lambda run: int(bool(run.handed_over)), np.int8, 0,
        in_maps=False,
    )  # fmt: skip

    def __len__(self) -> int:
        return len(self.end)

    @classmethod
    def empty(cls, n: int) -> BatchResult:
        """Return results of ``n`` runs, all marked as failed until they are filled in."""
        return cls(**{name: np.full(n, column.failed, dtype=column.kind) for name, column in COLUMNS.items()})

    def put(self, runs: NDArray[np.int64], part: BatchResult) -> None:
        """Fill in the results ``part`` of ``runs``."""
        for name in COLUMNS:
            getattr(self, name)[runs] = getattr(part, name)


COLUMNS: dict[str, RunColumn] = {field.name: field.metadata["column"] for field in dataclasses.fields(BatchResult)}
"""Name of a field of `BatchResult` -> what it is."""
AT_END = tuple((name, column.at_end) for name, column in COLUMNS.items() if column.at_end)
"""Name of a field -> entry of the state at the end, of those that are one."""


def sequence_hash(modes: Iterable[int]) -> int:
    """Return the 64-bit FNV-1a hash of a sequence of modes."""
    value = HASH_START
    with np.errstate(over="ignore"):  # the product is taken modulo 2^64
        for mode in modes:
            value = update_hash(value, np.uint64(mode))
    return int(value)


def update_hash(value: Any, mode: Any) -> Any:
    """Return the hash of a sequence with one mode more (numbers or arrays of np.uint64)."""
    return (value ^ mode) * _HASH_FACTOR


def summary(run: Run) -> dict[str, Any]:
    """Return the entries of a `BatchResult` for one run."""
    return {name: column.of_run(run) for name, column in COLUMNS.items()}


@dataclass(frozen=True, kw_only=True)
class Batch:
    """Runs that share ``base`` but for ``columns``."""

    base: Parameters
    columns: Columns
    n: int
    """Number of runs."""
    durations: Array
    """Limit on the simulated time of each run [s], shape (n,)."""
    tolerance: float
    acting: frozenset[str] = frozenset()
    """Coefficients whose effects are compiled in even at their null values."""

    def part(self, runs: Index) -> Batch:
        """Return the batch of some of the runs."""
        columns = {name: values[runs] for name, values in self.columns.items()}
        return dataclasses.replace(self, columns=columns, n=len(runs), durations=self.durations[runs])


class BatchRuns:
    """The runs of a batch as they are taken, with their parameters and results."""

    def __init__(self, batch: Batch, progress: Progress | None = None) -> None:
        self.batch, self._progress = batch, progress
        self.result = BatchResult.empty(batch.n)
        self._taken_count = self._ended_count = 0

    def take(self, most: int) -> Index:
        """Take the next runs, at most ``most``."""
        runs = np.arange(self._taken_count, min(self.batch.n, self._taken_count + most))
        self._taken_count += len(runs)
        return runs

    def parameter_values(self, runs: Index) -> dict[str, Any]:
        """Return every parameter of ``runs`` that the equations read, by name: one value, or one per run."""
        return equation_parameters(self.batch.base, {name: values[runs] for name, values in self.batch.columns.items()})

    def take_valid(self, most: int) -> tuple[Index, dict[str, Any]]:
        """Take the next runs; return those whose values `Parameters` accepts, and their parameters. The others stay failed."""
        while len(runs := self.take(most)):
            values = self.parameter_values(runs)
            valid = valid_runs(self.batch.base, values, len(runs))
            if valid.any():
                return runs[valid], {name: v[valid] if np.ndim(v) else v for name, v in values.items()}
        return runs, {}

    def report_ended(self, runs: int) -> None:
        """Count ``runs`` more runs that have ended, and report the progress."""
        self._ended_count += runs
        if self._progress is not None:
            self._progress(self._ended_count, self.batch.n)
