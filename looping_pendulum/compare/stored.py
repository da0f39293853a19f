"""Reads a comparison back from its folder, with its trajectories, so that a page can be made without running engines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.compare.align import SAME_TIME, align
from looping_pendulum.compare.export import CSV_COLUMNS, trajectory_files
from looping_pendulum.compare.json_text import plain
from looping_pendulum.compare.result import ComparisonResult, ResultSamples, RunProvenance
from looping_pendulum.compare.run_cache import run_key
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.trajectory import (
    UNKNOWN_MODE,
    Provenance,
    RunStatus,
    Supplier,
    Supplies,
    Supply,
    Trajectory,
    TrajectoryEvent,
)
from looping_pendulum.errors import ResultError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.scenarios.scenario import Scenario

RETRIED_STATUSES = (RunStatus.INTERRUPTED, RunStatus.TIME_LIMIT, RunStatus.MEMORY_LIMIT)
"""Statuses of runs that are made again, because another try may succeed."""


def stored_result(folder: Path, scenario: Scenario, engines: Sequence[Engine] | None) -> ComparisonResult | None:
    """Return the comparison in ``folder``, with trajectories, if it is of these ``engines`` on this ``scenario``.

    None if there is none, if it is of another input or version, if a run was cut short, or if a file cannot be read. With
    ``engines`` None it may be of any engines and versions, and of runs that were cut short.
    """
    try:
        result = ComparisonResult.from_json((folder / "result.json").read_text(encoding="utf-8"))
        wanted = scenario.name, scenario.title, scenario.description, plain(scenario.parameters.as_dict()), scenario.duration
        if (result.scenario, result.title, result.description, result.parameters, result.duration) != wanted:
            return None
        if engines is not None and not _is_of_engines(result, scenario, engines):
            return None
        return replace(result, samples=_samples(result, folder / "trajectories"))
    # Whatever is wrong with the files, making the runs again repairs it
    except (OSError, ValueError, KeyError, IndexError, ResultError):
        return None


def _is_of_engines(result: ComparisonResult, scenario: Scenario, engines: Sequence[Engine]) -> bool:
    """Return whether the runs are those that these engines would make."""
    if result.run_keys != tuple(run_key(engine, scenario) for engine in engines):
        return False
    return not any(RunStatus[engine.status] in RETRIED_STATUSES for engine in result.engines)


def _samples(result: ComparisonResult, folder: Path) -> ResultSamples:
    """Read the trajectories of ``result`` from their CSV files."""
    exact = result.reference
    reference = _trajectory(
        folder / "reference.csv",
        engine=exact.engine,
        variant=exact.variant,
        profile="",
        scenario=result.scenario,
        events=tuple(TrajectoryEvent(name=name, time=time) for name, time in exact.events),
        provenance=_provenance(exact.provenance),
    )

    def at(times: Array) -> Trajectory:
        # Times were rounded when the files were written, so that equal ones may differ in their last digits
        place = np.clip(np.searchsorted(reference.t, times - SAME_TIME), 0, len(reference.t) - 1)
        return _rows(reference, place[np.abs(reference.t[place] - times) < SAME_TIME])

    runs = [
        _trajectory(
            # A run without samples has no file
            folder / file if e.samples else None,
            engine=e.engine,
            variant=e.variant,
            profile=e.profile,
            scenario=result.scenario,
            status=RunStatus[e.status],
            message=e.message,
            provenance=_provenance(e.provenance),
        )
        for e, file in zip(result.engines, trajectory_files(result), strict=True)
    ]
    return ResultSamples(reference=reference, aligned=tuple(align(run, at) for run in runs))


def _trajectory(path: Path | None, **fields: Any) -> Trajectory:
    """Read a file that `export.trajectory_csv` wrote; without a path, return a run without samples."""
    lines = [] if path is None else path.read_text(encoding="utf-8").splitlines()
    head = [name for name, _ in CSV_COLUMNS]
    if lines and lines[0].split(",") != [*head, "mode"]:
        raise ResultError(f"{path}: found other columns, needed {','.join(head)},mode")
    cells = [line.split(",") for line in lines[1:]]
    numbers = np.array([[float(c) if c else np.nan for c in row[: len(head)]] for row in cells]).reshape(-1, len(head))
    column = dict(zip((name.partition(" [")[0] for name in head), numbers.T, strict=True))

    def pair(mass: str, quantity: str = "") -> Array:
        return np.column_stack([column[f"{mass}_{quantity}x"], column[f"{mass}_{quantity}y"]])

    def if_known(name: str) -> Array | None:
        return None if np.isnan(column[name]).all() else column[name]

    modes = [UNKNOWN_MODE if not row[-1] else Mode[row[-1].upper()] for row in cells]
    return Trajectory(
        t=column["t"],
        light_position=pair("light"),
        light_velocity=pair("light", "v"),
        heavy_position=pair("heavy"),
        heavy_velocity=pair("heavy", "v"),
        free_length=column["free_length"],
        wrap_angle=column["wrap_angle"],
        string_stretch=column["string_stretch"],
        string_slip=if_known("string_slip"),
        mode=np.array(modes, dtype=np.int8),
        light_tension=if_known("light_tension"),
        heavy_tension=if_known("heavy_tension"),
        **fields,
    )


def _rows(run: Trajectory, indices: np.ndarray) -> Trajectory:
    """Return ``run`` at the samples ``indices``."""
    names = ("t", "light_position", "light_velocity", "heavy_position", "heavy_velocity", "free_length", "wrap_angle", "mode")
    changed: dict[str, Any] = {name: getattr(run, name)[indices] for name in (*names, "string_stretch")}
    return replace(run, **changed)


def _provenance(stored: RunProvenance) -> Provenance:
    # The result has these names with spaces, for its readers
    supplies = {s.what.replace(" ", "_"): Supply(by=Supplier(s.by), how=s.how) for s in stored.supplies}
    return Provenance(versions=stored.versions, settings=stored.settings, supplies=Supplies(**supplies), seed=stored.seed)
