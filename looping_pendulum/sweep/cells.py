"""Computes the runs of one chunk: what a map stores of each run, with units, and how a run may have ended."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import CancelledError
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from looping_pendulum import __version__
from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.reference import STATUS_OF_END
from looping_pendulum.engines.registry import select
from looping_pendulum.errors import EngineError, ParameterError
from looping_pendulum.reference_ode.batch import COLUMNS, impossible_runs, parameter_values, solve_batch
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.transitions import Event
from looping_pendulum.runs.events import run_landmarks
from looping_pendulum.runs.trajectory import RunStatus, Trajectory
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.sweep.map_file import REFERENCE, MapPlan, Region, run_count
from looping_pendulum.versions import MISSING, installed_version

IMPOSSIBLE = "impossible"
"""Ending of a run that was not made because its parameters contradict each other."""
# The reference's endings first, so that their codes are those of `ENDS`, which a batch gives
ENDING_DESCRIPTIONS = {
    str(Event.LIGHT_REACHES_ROD): "the light mass reached the rod",
    str(Event.HEAVY_REACHES_ROD): "the heavy mass reached the rod",
    str(Event.UNWRAPPED): "the string left the rod",
    str(Event.TIME_UP): "still moving when its time was up",
    "failed": "the run broke down",
    IMPOSSIBLE: "impossible parameters, not run",
    **{status.name.lower(): status.value for status in RunStatus if not status.ok and status is not RunStatus.FAILED},
}
"""Ending -> its description."""
ENDINGS = tuple(ENDING_DESCRIPTIONS)
"""Endings of a run; the field `end` is the index into this tuple."""
FIELDS = {
    # A code has its words in the attributes of its field, and a number that is not known is NaN
    name: column
    if name == "end" or column.kind is np.float64
    else replace(column, meaning=f"{column.meaning}; {column.missing}: the engine does not tell")
    for name, column in COLUMNS.items()
}
"""Field of a map -> what it is: one value per run."""
NOT_YET_RUN = FIELDS["end"].missing
"""Value of the field `end` of runs that are not computed yet."""
PACKAGES = ("numpy", "scipy", "wasmtime")
"""Packages that results depend on, beside this package; SciPy chooses the points of a sample."""

Values = dict[str, NDArray[np.generic]]
"""Field -> its values, shape (n,)."""


def solve_chunk(
    plan: MapPlan,
    region: Region,
    *,
    time_limit: float,
    memory_limit: int,
    expected_versions: Mapping[str, str] | None = None,
    cancelled: threading.Event | None = None,
) -> Values:
    """Compute the runs of one chunk of a map, on this machine or on one of a cluster.

    Parameters
    ----------
    time_limit, memory_limit
        Limits of each run of an engine [s], [bytes].
    expected_versions
        Package -> version with which the map is made, for a worker of a cluster to compare with its own.
    cancelled
        Event that ends the work early.

    Raises
    ------
    CancelledError
        If ``cancelled`` is set meanwhile.
    EngineError
        If this machine has another version of a package.
    """
    _stop_if(cancelled)
    expected = expected_versions or {}
    for package, here, needed in differing_versions(versions(plan) if expected else {}, expected):
        found = f"found {package} {here} on a worker, needed {needed} as on the machine that writes the map"
        raise EngineError(f"--cluster: {found}; install {package} {needed} there")
    if plan.engine(region) == REFERENCE:
        return _reference_values(plan, region, cancelled)
    limited = partial(run_isolated, time_limit=time_limit, memory_limit=memory_limit, cancelled=cancelled)
    values = _engine_values(plan, region, limited)
    _stop_if(cancelled)
    return values


def _stop_if(cancelled: threading.Event | None) -> None:
    if cancelled is not None and cancelled.is_set():
        raise CancelledError


def versions(plan: MapPlan) -> dict[str, str]:
    """Return package -> version for all that a map's results depend on; "none" if a package is not installed."""
    engines = select((name for name in plan.engines if name != REFERENCE), plan.profile)
    packages = {*PACKAGES, *(package for engine in engines for package in engine.abilities.packages)}
    listed = {package: installed_version(package) for package in packages}
    return dict(sorted((listed | {"looping-pendulum": __version__}).items()))


def differing_versions(one: Mapping[str, str], other: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Return (package, version in ``one``, in ``other``) where they differ; "none" if one has no such package."""
    pairs = [(package, one.get(package, MISSING), other.get(package, MISSING)) for package in sorted({*one, *other})]
    return [pair for pair in pairs if pair[1] != pair[2]]


def _reference_values(plan: MapPlan, region: Region, cancelled: threading.Event | None) -> Values:
    base, columns = plan.scenario.parameters, plan.columns(region)
    batch = solve_batch(
        base, columns, duration=plan.duration, tolerance=plan.tolerance, progress=lambda done, runs: _stop_if(cancelled)
    )
    refused = [run for run, error in batch.errors.items() if isinstance(error, ParameterError)]
    batch.end[refused] = ENDINGS.index(IMPOSSIBLE)
    return {name: getattr(batch, name) for name in FIELDS}


def _engine_values(plan: MapPlan, region: Region, limited: Callable[[Engine, Scenario], Trajectory]) -> Values:
    (engine,), base, columns = select([plan.engine(region)], plan.profile), plan.scenario.parameters, plan.columns(region)
    n = run_count(region)
    values: Values = {name: np.full(n, field.missing, dtype=field.kind) for name, field in FIELDS.items()}
    impossible = impossible_runs(base, parameter_values(base, columns), n)
    values["end"][list(impossible)] = ENDINGS.index(IMPOSSIBLE)
    for i in (i for i in range(n) if i not in impossible):
        parameters = base.replace(**{name: float(column[i]) for name, column in columns.items()})
        scenario = replace(plan.scenario, parameters=parameters, duration=plan.duration, tolerances=(), measured=None)
        for name, value in _summary(limited(engine, scenario), parameters).items():
            values[name][i] = value
    return values


def _summary(run: Trajectory, parameters: Parameters) -> dict[str, float]:
    """Return the fields of a map for an engine's run; without those that it does not tell."""
    # A map uses the reference's words for the ends that an engine's run and the reference have in common
    known = {status: str(event) for event, status in STATUS_OF_END.items()} | {RunStatus.FINISHED: str(Event.TIME_UP)}
    end = ENDINGS.index(known.get(run.status) or run.status.name.lower())
    if len(run.t) == 0:
        return {"end": end}
    found = run_landmarks(run, parameters)
    at_halt = {
        "halting_time": found.halting_time,
        "halting_wrap_angle": found.wrap_angle_at_halt,
        "halting_free_length": found.free_length_at_halt,
    }
    at_end = {
        "end": end,
        "drop": float(run.heavy_drop[-1]),
        "wrap_angle": float(run.wrap_angle[-1]),
        "free_length": float(run.free_length[-1]),
        "stops": len(found.stops),
        "slip_count": len(found.slip_onsets),
        "end_time": float(run.t[-1]),
    }
    # A run that was cut while its string rested might have slid again, which a map must not show as a halt
    halt = {name: value for name, value in at_halt.items() if found.halting_confirmed and value is not None}
    return at_end | halt
