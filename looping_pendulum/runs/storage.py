"""A run on disk: one file of samples, to which a run appends while it goes on, and one of how it ended.

The process of a run writes both, and everybody else reads them with the same checks, whether the run came to its end or died,
and whoever computed it: reports and files rely on the shapes, types and magnitudes that `Trajectory` states.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np

from looping_pendulum.errors import EngineError
from looping_pendulum.files import write_atomically
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.runs.trajectory import (
    FIELDS,
    OPTIONAL,
    ROW,
    SAMPLE_INTERVAL,
    UNKNOWN_MODE,
    Provenance,
    RunStatus,
    Supplies,
    Supply,
    Trajectory,
    TrajectoryEvent,
    check_column_count,
    from_samples,
)

SAMPLES, RECORD = "samples.bin", "run.json"
"""Files in the folder of a run: its samples, and how it ended (`RECORDED`)."""
MODE = ROW.index("mode")
MODES = (UNKNOWN_MODE, *(mode.value for mode in Mode))
"""Column of the mode, and the values that it may have."""
ROW_BYTES = 8 * len(ROW)
"""Size of a sample in the file [bytes]: `ROW` as 8-byte floats."""
MAX_VALUE = 1e12
"""Largest magnitude that a position, velocity or force can have [SI]: its fourth power is still a number."""
RECORDED = (
    *("engine", "variant", "profile", "scenario", "status", "message", "events", "provenance", "wall_time", "cpu_time"),
)
"""Fields of a trajectory that say how its run ended, beside its samples."""


def _rows(folder: Path) -> Array:
    """Return the complete rows of the file of samples; a half-written last one is left out."""
    path = folder / SAMPLES
    data = path.read_bytes() if path.exists() else b""
    rows = len(data) // ROW_BYTES
    # A copy, as an array over bytes cannot be written to
    return np.frombuffer(data[: rows * ROW_BYTES], dtype=float).reshape(rows, len(ROW)).copy()


# ---- writing, in the process of the run


@contextlib.contextmanager
def recording(folder: Path) -> Iterator[Callable[[Sequence[float]], None]]:
    """Give a function that appends a row of `COLUMNS` to the samples in ``folder``, with its own write: a crash loses none."""
    with (folder / SAMPLES).open("ab", buffering=0) as file:

        def record(row: Sequence[float]) -> None:
            # One of another length is refused, because all later rows would be read wrongly
            check_column_count(len(row))
            file.write(np.array([*row, *[np.nan] * (len(ROW) - len(row))], dtype=float).tobytes())

        yield record


def write_run(folder: Path, run: object) -> None:
    """Write ``run`` to ``folder``: the samples that it states, then how it ended.

    Raises
    ------
    EngineError
        If ``run`` is no `Trajectory`, or its arrays have not the shapes stated there; then the recorded samples stay.
    """
    if not isinstance(run, Trajectory):
        raise EngineError(f"simulate returned {type(run).__name__}, needed a Trajectory")
    count = np.size(run.t)
    columns = [_numbers(name, getattr(run, name), count) for name in FIELDS]
    rows = np.column_stack(columns)
    write_atomically(folder / SAMPLES, rows.tobytes())
    record = {name: getattr(run, name) for name in RECORDED}
    write_atomically(folder / RECORD, json.dumps(record, default=_as_json))


def _as_json(value: object) -> Any:
    """Return ``value`` as what JSON knows; what it does not know as a list with its type, which no field may be."""
    if isinstance(value, (Provenance, Supplies, Supply, TrajectoryEvent)):
        return vars(value)
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    return [type(value).__name__]


def _numbers(name: str, value: object, count: int) -> Array:
    """Return a field of ``count`` samples as an array of real numbers; NaN for an array that may be None and is."""
    components = len(FIELDS[name])
    shape = (count,) if components == 1 else (count, components)
    if value is None and name in OPTIONAL:
        return np.full(shape, np.nan)
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise field_error(name, f"what is no array ({error})", f"an array of shape {shape}") from None
    # Floats and integers, signed or not: no complex numbers, flags, texts or objects
    if array.dtype.kind not in "fiu":
        raise field_error(name, f"an array of {array.dtype}", "one of real numbers")
    if array.shape != shape:
        raise field_error(name, f"shape {array.shape}", f"{shape}")
    return np.array(array, dtype=float)


def field_error(field: str, actual: str, required: str) -> EngineError:
    """Return the error for one field of a run."""
    return EngineError(f"simulate returned {field}: found {actual}, needed {required}")


# ---- reading, anywhere


def read_run(folder: Path, *, parameters: Parameters, duration: float, **fields: Any) -> Trajectory:
    """Return the run in ``folder``, checked; ``fields`` are those of the trajectory that its reader knows.

    A run that claims to have ended properly but has positions that are not finite gets the status NOT_FINITE.

    Parameters
    ----------
    parameters, duration
        Of its scenario; ``duration`` in s.

    Raises
    ------
    FileNotFoundError
        If the run has not ended: then `read_samples` returns what there is.
    EngineError
        If something is not as `Trajectory` states; the message names the field, what was found and what was needed.
    """
    record = _read_record((folder / RECORD).read_bytes())
    for name in ("engine", "variant", "profile", "scenario"):
        if record[name] != fields.get(name, record[name]):
            raise field_error(name, repr(record[name]), f"the engine's own, {fields[name]!r}")
    rows = _rows(folder)
    t = rows[:, 0]
    good = _leading_times(t, duration)
    if good < len(t):
        found = f"{t[good]:g} s after {t[good - 1]:g} s" if good else f"{t[0]:g} s"
        raise field_error("t", found, f"rising times within the scenario's 0 to {duration:g} s")
    if record["status"].ok and not len(t):
        raise field_error("t", f"no sample of a run that {record['status'].value!r}", "at least one")
    modes = rows[:, MODE]
    if not (known := np.isnan(modes) | np.isin(modes, MODES)).all():
        named = ", ".join(f"{mode.value} ({mode.name.lower()})" for mode in Mode)
        raise field_error("mode", f"{modes[~known][0]:g}", f"one of {named} or {UNKNOWN_MODE} (unknown)")
    run = from_samples(_only_possible(rows), parameters=parameters, **(record | fields))
    finite = np.isfinite(run.light_position).all() and np.isfinite(run.heavy_position).all()
    return dataclasses.replace(run, status=RunStatus.NOT_FINITE) if run.status.ok and not finite else run


def read_samples(folder: Path, *, duration: float) -> Array:
    """Return the samples that a run left which died, up to the first whose time cannot be, shape (n, len(ROW))."""
    rows = _rows(folder)
    return _only_possible(rows[: _leading_times(rows[:, 0], duration)])


def recorded_count(folder: Path) -> int:
    """Return how many samples a run has recorded so far."""
    with contextlib.suppress(OSError):
        return (folder / SAMPLES).stat().st_size // ROW_BYTES
    return 0


def _leading_times(t: Array, duration: float) -> int:
    """Return how many of the times from the first on are finite, rise, and lie within 0 to ``duration`` [s]."""
    from_there = np.concatenate([[-np.inf], t])[:-1]
    # Half a sample is left for rounding
    good = (t > from_there) & (t >= 0) & (t <= duration + SAMPLE_INTERVAL / 2)
    return len(t) if good.all() else int(np.argmin(good))


def _only_possible(rows: Array) -> Array:
    """Return ``rows`` with NaN in place of what is infinite or larger than `MAX_VALUE`, and of modes that there are not."""
    possible = np.abs(rows) <= MAX_VALUE
    possible[:, MODE] &= np.isin(rows[:, MODE], MODES)
    return np.where(possible, rows, np.nan)


def _read_record(text: bytes) -> dict[str, Any]:
    """Return the fields of a trajectory in a file of how its run ended.

    Raises
    ------
    EngineError
        If one is not as `Trajectory` states.
    """
    # Not at the top: the process of a run only writes, and pydantic takes longer to import than a short run
    from pydantic import ValidationError, create_model

    types = get_type_hints(Trajectory)
    fields: dict[str, Any] = {name: (types[name], ...) for name in RECORDED}
    try:
        record = dict(create_model("Record", **fields).model_validate_json(text, strict=True))
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or "a record"
        found, needed = repr(first["input"])[:60], first["msg"].removeprefix("Input should be ")
        raise field_error(field, found, needed) from None
    for event in record["events"]:
        if not math.isfinite(event.time):
            raise field_error("events", f"a time of {event.time} s", "a finite one")
    return record
