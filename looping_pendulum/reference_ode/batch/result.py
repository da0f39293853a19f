"""Results of many runs, as arrays."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.solution import Run
from looping_pendulum.reference_ode.transitions import Event, Mode

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


@dataclass(frozen=True, kw_only=True)
class BatchResult:
    """Result of each run; every array has shape (n,). A failed run has nan, zero counts and a sequence of 0."""

    halting_time: Array
    """Start of the sticking that lasts until the light mass reaches the rod [s]; nan without one."""
    halting_wrap_angle: Array
    """Wrap angle at that time [rad]; nan without one."""
    halting_free_length: Array
    """Free length at that time [m]; nan without one."""
    drop: Array
    """How far the heavy mass is below its release at the end [m]."""
    wrap_angle: Array
    """Wrap angle at the end [rad]."""
    free_length: Array
    """Free length at the end [m]."""
    stops: NDArray[np.int32]
    """How often the heavy mass's speed became zero."""
    slip_count: NDArray[np.int32]
    """How often a sticking string began to slide."""
    slack_intervals: NDArray[np.int32]
    """How often the string was, or became, slack."""
    end: NDArray[np.int8]
    """How the run ended, as an index into `ENDS`."""
    end_time: Array
    """Time at which the run ended [s]."""
    sequence: NDArray[np.uint64]
    """Hash of the sequence of modes (`sequence_hash`)."""
    handed_over: NDArray[np.int8]
    """1 where heyoka gave up and SciPy solved the run, else 0."""

    def __len__(self) -> int:
        return len(self.end)

    @classmethod
    def empty(cls, n: int) -> BatchResult:
        """Return results of ``n`` runs, all marked as failed until they are filled in."""
        result = cls.over(bytearray(n * BYTES_PER_RUN), n)
        result.clear()
        return result

    @classmethod
    def over(cls, memory: Any, n: int) -> BatchResult:
        """Return the results of ``n`` runs as views of ``memory``, a buffer of ``n * BYTES_PER_RUN`` bytes.

        Processes may share the buffer.
        """
        columns, offset = {}, 0
        # Largest items first: then every column is aligned, whatever n is
        for name in sorted((field.name for field in dataclasses.fields(cls)), key=lambda name: -_column_type(name)[0].itemsize):
            kind = _column_type(name)[0]
            columns[name] = np.frombuffer(memory, kind, count=n, offset=offset)
            offset += n * kind.itemsize
        return cls(**columns)

    def clear(self) -> None:
        """Mark all runs as failed."""
        for field in dataclasses.fields(self):
            getattr(self, field.name)[:] = _column_type(field.name)[1]

    def put(self, runs: NDArray[np.int64], part: BatchResult) -> None:
        """Fill in the results ``part`` of ``runs``."""
        for field in dataclasses.fields(self):
            getattr(self, field.name)[runs] = getattr(part, field.name)


_COLUMN_TYPES: dict[str, tuple[Any, float]] = {
    "stops": (np.int32, 0),
    "slip_count": (np.int32, 0),
    "slack_intervals": (np.int32, 0),
    "end": (np.int8, FAILED),
    "sequence": (np.uint64, 0),
    "handed_over": (np.int8, 0),
}


def _column_type(name: str) -> tuple[np.dtype[Any], float]:
    """Return the type of a column of results, and its value for a run that failed."""
    kind, start = _COLUMN_TYPES.get(name, (np.float64, np.nan))
    return np.dtype(kind), start


BYTES_PER_RUN = sum(_column_type(field.name)[0].itemsize for field in dataclasses.fields(BatchResult))
"""Memory that the results of one run take [B]."""


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
    end, halt = run.end, run.halt
    assert end.event is not None
    slack = (Mode.SLACK, Mode.CLAMPED_SLACK)
    return {
        "halting_time": np.nan if halt is None else halt.time,
        "halting_wrap_angle": np.nan if halt is None else halt.state.wrap_angle,
        "halting_free_length": np.nan if halt is None else halt.state.free_length,
        "drop": run.heavy_drop(end.state),
        "wrap_angle": end.state.wrap_angle,
        "free_length": end.state.free_length,
        "stops": len(run.stops),
        "slip_count": sum(event.event in (Event.SLIP_ONSET_DOWN, Event.SLIP_ONSET_UP) for event in run.events),
        "slack_intervals": sum(mode in slack for mode in run.modes),
        "end": ENDS.index(end.event),
        "end_time": run.end_time,
        "sequence": sequence_hash(run.modes),
        "handed_over": int(bool(run.handed_over)),
    }
