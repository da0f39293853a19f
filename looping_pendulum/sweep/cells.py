"""The runs of one chunk: the function that travels to another process or machine, and what it is given.

Each worker process imports this module first, so it imports neither the reader of map files nor Zarr.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Protocol

import numpy as np

from looping_pendulum import __version__
from looping_pendulum.engines.isolation import TIME_LIMIT, run_isolated
from looping_pendulum.engines.memory import MEMORY_LIMIT
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import select
from looping_pendulum.engines.trajectory import RunStatus, Trajectory
from looping_pendulum.errors import ParameterError
from looping_pendulum.reference_ode.batch import solve_batch
from looping_pendulum.reference_ode.batch.result import FAILED
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.transitions import Event
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.sweep.fields import FIELDS, IMPOSSIBLE, REFERENCE, UNKNOWN_COUNT, Values, end_code

PACKAGES = ("numpy", "scipy", "heyoka")
"""What the reference's numbers depend on, beside this package."""

_ONE_AT_A_TIME = threading.Lock()
"""The compiled integrators are kept per process and are not for several threads at once (a Dask worker may have some)."""


class RunLandmarks(Protocol):
    """What is read from an engine's run (`compare.result.Landmarks` has it)."""

    @property
    def stops(self) -> tuple[object, ...]:
        """Zeros of the heavy mass's speed."""

    @property
    def slip_onsets(self) -> tuple[float, ...]:
        """When a resting string began to slide again [s]."""

    @property
    def halting_time(self) -> float | None:
        """[s]"""

    @property
    def halting_confirmed(self) -> bool:
        """Whether the rest was seen to last until the light mass reached the rod."""

    @property
    def wrap_angle_at_halt(self) -> float | None:
        """[rad]"""

    @property
    def free_length_at_halt(self) -> float | None:
        """[m]"""


ReadMoments = Callable[[Trajectory, Parameters], RunLandmarks]
"""Finds the moments in an engine's run, from its samples."""


@dataclass(frozen=True, kw_only=True)
class CellTask:
    """What to run; it travels as a pickle."""

    index: int
    """Of the unit."""
    engine: str
    profile: Profile
    scenario: Scenario
    columns: Mapping[str, Array]
    """Fields and coefficients that differ from the scenario's, shape (n,) each."""
    tolerance: float
    duration: float
    """[s]"""
    read_moments: ReadMoments | None = None
    """Needed for engines other than the reference."""
    time_limit: float = TIME_LIMIT
    """Of an engine's run [s]."""
    memory_limit: int = MEMORY_LIMIT
    """Of an engine's run [bytes]."""


@dataclass(frozen=True, kw_only=True)
class CellResult:
    """What came of it."""

    index: int
    values: Values
    versions: dict[str, str]
    """Of what made the numbers."""


def solve(task: CellTask) -> CellResult:
    """Run a chunk."""
    with _ONE_AT_A_TIME:
        values = _reference(task) if task.engine == REFERENCE else _engine(task)
    return CellResult(index=task.index, values=values, versions=versions(task.engine, task.profile))


def versions(engine: str, profile: Profile) -> dict[str, str]:
    """Package -> version of what an engine's numbers depend on; "none" if it is not installed."""
    packages = {*PACKAGES, *(() if engine == REFERENCE else engine_called(engine, profile).abilities.packages)}
    return {"looping-pendulum": __version__} | {package: _version(package) for package in sorted(packages)}


def engine_called(name: str, profile: Profile) -> Engine:
    """Return the engine variant with this label."""
    return select([name], profile)[0]


@cache
def _version(package: str) -> str:
    """Version of an installed package; read once, since every chunk asks and reading takes milliseconds."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


def _reference(task: CellTask) -> Values:
    base = task.scenario.parameters
    batch = solve_batch(base, task.columns, duration=task.duration, tolerance=task.tolerance)
    values: Values = {field.name: np.array(getattr(batch, field.name)) for field in FIELDS}
    for i in np.flatnonzero(batch.end == FAILED):
        if _member(task, int(i)) is None:
            values["end"][i] = end_code(IMPOSSIBLE)
    return values


def _member(task: CellTask, i: int) -> Parameters | None:
    """Parameters of run ``i``, None if they are impossible."""
    try:
        return task.scenario.parameters.replace(**{name: float(column[i]) for name, column in task.columns.items()})
    except ParameterError:
        return None


def _engine(task: CellTask) -> Values:
    assert task.read_moments is not None
    engine = engine_called(task.engine, task.profile)
    n = len(next(iter(task.columns.values())))
    values: Values = {field.name: np.full(n, field.fill, dtype=field.dtype) for field in FIELDS}
    values["end"][:] = end_code(IMPOSSIBLE)
    for i in range(n):
        parameters = _member(task, i)
        if parameters is None:
            continue
        scenario = replace(task.scenario, parameters=parameters, duration=task.duration, tolerances=(), measured=None)
        run = run_isolated(engine, scenario, time_limit=task.time_limit, memory_limit=task.memory_limit)
        for name, value in _summary(run, task.read_moments(run, parameters)).items():
            values[name][i] = value
    return values


def _summary(run: Trajectory, moments: RunLandmarks) -> dict[str, float]:
    """What a map says of an engine's run."""
    known = {RunStatus.LIGHT_REACHED_ROD: str(Event.LIGHT_REACHES_ROD), RunStatus.FINISHED: str(Event.TIME_UP)}
    summary: dict[str, float] = {"end": end_code(known.get(run.status) or run.status.name.lower())}
    if len(run.t) == 0:
        return summary
    if moments.halting_confirmed:
        summary["halting_time"] = _or_nan(moments.halting_time)
        summary["halting_wrap_angle"] = _or_nan(moments.wrap_angle_at_halt)
        summary["halting_free_length"] = _or_nan(moments.free_length_at_halt)
    return summary | {
        "drop": float(run.heavy_drop[-1]),
        "wrap_angle": float(run.wrap_angle[-1]),
        "free_length": float(run.free_length[-1]),
        "stops": len(moments.stops),
        "slip_count": len(moments.slip_onsets),
        "slack_intervals": UNKNOWN_COUNT,
        "end_time": float(run.t[-1]),
    }


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value
