"""Computes the runs of one chunk: what a map stores of each run, with units, and how a run may have ended."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from looping_pendulum import __version__
from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.reference import STATUS_OF_END
from looping_pendulum.engines.registry import select
from looping_pendulum.errors import ParameterError
from looping_pendulum.reference_ode.batch import COLUMNS, ENDS, RunColumn, solve_batch
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.transitions import Event
from looping_pendulum.runs.events import Landmarks, run_landmarks
from looping_pendulum.runs.trajectory import RunStatus, Trajectory
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.sweep.plan import REFERENCE, MapPlan, Region
from looping_pendulum.versions import installed_version

IMPOSSIBLE = "impossible"
"""Ending of a run that was not made because its parameters contradict each other."""
ENDINGS: tuple[str, ...] = tuple(
    # The reference's endings first, so that its codes are those of `ENDS`, which a batch gives
    dict.fromkeys([*map(str, ENDS), IMPOSSIBLE, *(status.name.lower() for status in RunStatus if not status.ok)])
)
"""Endings of a run; the field `end` is the index into this tuple."""
ENDING_DESCRIPTIONS = {
    str(Event.LIGHT_REACHES_ROD): "the light mass reached the rod",
    str(Event.HEAVY_REACHES_ROD): "the heavy mass reached the rod",
    str(Event.UNWRAPPED): "the string left the rod",
    str(Event.TIME_UP): "still moving when its time was up",
    **{status.name.lower(): status.value for status in RunStatus if not status.ok},
    "failed": "the run broke down",
    IMPOSSIBLE: "impossible parameters, not run",
}
"""Ending -> its description."""
UNKNOWN_COUNT = -1
"""Value of a count that an engine does not report."""
NOT_YET_RUN = -1
"""Value of the field `end` of runs that are not computed yet."""

Values = dict[str, NDArray[np.generic]]
"""Name of a field -> its values, shape (n,)."""


@dataclass(frozen=True, kw_only=True)
class Field:
    """A field of a map: one value per run."""

    name: str
    unit: str
    """SI unit; '' for a plain number."""
    dtype: str
    meaning: str
    fill: float
    """Value of runs that are not computed yet, and of what an engine does not report."""


def _field(name: str, column: RunColumn) -> Field:
    kind = np.dtype(column.kind)
    # An unsigned field has no -1
    fill = {"f": float("nan"), "i": UNKNOWN_COUNT, "u": 0}[kind.kind]
    # A code has its words in the attributes of its field, and a number that is not known is NaN
    unknown = "" if kind.kind == "f" or name == "end" else f"; {fill}: the engine does not tell"
    return Field(name=name, unit=column.unit, dtype=kind.name, meaning=f"{column.meaning}{unknown}", fill=fill)


FIELDS = tuple(_field(name, column) for name, column in COLUMNS.items())
PACKAGES = ("numpy", "scipy", "wasmtime")
"""Packages that results depend on, beside this package; SciPy chooses the points of a sample."""


@dataclass(frozen=True, kw_only=True)
class ChunkResult:
    """Values of the runs of a chunk."""

    values: Values
    versions: dict[str, str]
    """Package -> version that the values depend on."""


def solve_chunk(
    plan: MapPlan,
    region: Region,
    *,
    time_limit: float,
    memory_limit: int,
    cancelled: threading.Event | None = None,
) -> ChunkResult:
    """Compute the runs of one chunk of a map, on this machine or on one of a cluster.

    Parameters
    ----------
    time_limit, memory_limit
        Limits of each run of an engine [s], [bytes].
    cancelled
        Event that ends the work early.

    Raises
    ------
    CancelledError
        If ``cancelled`` is set meanwhile.
    """
    engine = plan.engine(region)
    if engine == REFERENCE:
        values = _reference_values(plan, region, cancelled)
    else:
        limited = partial(run_isolated, time_limit=time_limit, memory_limit=memory_limit, cancelled=cancelled)
        values = _engine_values(plan, region, limited)
    if cancelled is not None and cancelled.is_set():
        raise CancelledError
    return ChunkResult(values=values, versions=versions(engine, plan.profile))


def versions(engine: str, profile: Profile) -> dict[str, str]:
    """Return package -> version for all that an engine's results depend on; "none" if a package is not installed."""
    packages = {*PACKAGES, *(() if engine == REFERENCE else engine_called(engine, profile).abilities.packages)}
    return {"looping-pendulum": __version__} | {package: installed_version(package) for package in sorted(packages)}


def differing_versions(one: Mapping[str, str], other: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Return (package, version in ``one``, in ``other``) where they differ; "none" if one has no such package."""
    pairs = [(package, one.get(package, "none"), other.get(package, "none")) for package in sorted({*one, *other})]
    return [pair for pair in pairs if pair[1] != pair[2]]


def engine_called(name: str, profile: Profile) -> Engine:
    """Return the engine variant with this label."""
    return select([name], profile)[0]


def _reference_values(plan: MapPlan, region: Region, cancelled: threading.Event | None) -> Values:
    def stop_if_cancelled(done: int, runs: int) -> None:
        if cancelled is not None and cancelled.is_set():
            raise CancelledError

    base, columns = plan.scenario.parameters, plan.columns(region)
    batch = solve_batch(base, columns, duration=plan.duration, tolerance=plan.tolerance, progress=stop_if_cancelled)
    values: Values = {field.name: np.array(getattr(batch, field.name)) for field in FIELDS}
    refused = [run for run, error in batch.errors.items() if isinstance(error, ParameterError)]
    values["end"][refused] = ENDINGS.index(IMPOSSIBLE)
    return values


def _engine_values(plan: MapPlan, region: Region, limited: Callable[[Engine, Scenario], Trajectory]) -> Values:
    engine, columns = engine_called(plan.engine(region), plan.profile), plan.columns(region)
    n = len(next(iter(columns.values())))
    values: Values = {field.name: np.full(n, field.fill, dtype=field.dtype) for field in FIELDS}
    # For the runs that the loop leaves out; the others write over it
    values["end"][:] = ENDINGS.index(IMPOSSIBLE)
    for i in range(n):
        parameters = _parameters_of_run(plan.scenario.parameters, columns, i)
        if parameters is not None:
            scenario = replace(plan.scenario, parameters=parameters, duration=plan.duration, tolerances=(), measured=None)
            run = limited(engine, scenario)
            for name, value in _summary(run, run_landmarks(run, parameters)).items():
                values[name][i] = value
    return values


def _parameters_of_run(base: Parameters, columns: Mapping[str, Array], i: int) -> Parameters | None:
    """Return the parameters of run ``i``; None if they contradict each other."""
    try:
        return base.replace(**{name: float(column[i]) for name, column in columns.items()})
    except ParameterError:
        return None


def _summary(run: Trajectory, landmarks: Landmarks) -> dict[str, float]:
    """Return the fields of a map for an engine's run."""
    # A map uses the reference's words for the ends that an engine's run and the reference have in common
    known = {status: str(event) for event, status in STATUS_OF_END.items()} | {RunStatus.FINISHED: str(Event.TIME_UP)}
    summary: dict[str, float] = {"end": ENDINGS.index(known.get(run.status) or run.status.name.lower())}
    if len(run.t) == 0:
        return summary
    # A run that was cut while its string rested might have slid again, which a map must not show as a halt
    if landmarks.halting_confirmed:
        at_halt = (landmarks.halting_time, landmarks.wrap_angle_at_halt, landmarks.free_length_at_halt)
        for name, value in zip(("halting_time", "halting_wrap_angle", "halting_free_length"), at_halt, strict=True):
            summary[name] = float("nan") if value is None else value
    return summary | {
        "drop": float(run.heavy_drop[-1]),
        "wrap_angle": float(run.wrap_angle[-1]),
        "free_length": float(run.free_length[-1]),
        "stops": len(landmarks.stops),
        "slip_count": len(landmarks.slip_onsets),
        "slack_intervals": UNKNOWN_COUNT,
        "end_time": float(run.t[-1]),
    }
