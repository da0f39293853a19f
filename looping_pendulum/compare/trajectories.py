"""Trajectories as CSV: written beside a result, and read back with it, so that a page can be made without running engines."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.compare.align import align
from looping_pendulum.compare.result import ComparisonResult, ResultSamples
from looping_pendulum.compare.run_cache import run_key
from looping_pendulum.compare.trial import TrialComparison, residual
from looping_pendulum.engines.protocol import Engine
from looping_pendulum.errors import ResultError
from looping_pendulum.files import file_stems
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.runs.trajectory import (
    SAME_TIME,
    UNKNOWN_MODE,
    RunStatus,
    Trajectory,
    TrajectoryEvent,
)
from looping_pendulum.scenarios.scenario import Scenario

CSV_COLUMNS = (
    ("t [s]", "t", 0),
    ("light_x [m]", "light_position", 0),
    ("light_y [m]", "light_position", 1),
    ("light_vx [m/s]", "light_velocity", 0),
    ("light_vy [m/s]", "light_velocity", 1),
    ("heavy_x [m]", "heavy_position", 0),
    ("heavy_y [m]", "heavy_position", 1),
    ("heavy_vx [m/s]", "heavy_velocity", 0),
    ("heavy_vy [m/s]", "heavy_velocity", 1),
    ("free_length [m]", "free_length", 0),
    ("wrap_angle [rad]", "wrap_angle", 0),
    ("string_stretch [m]", "string_stretch", 0),
    ("string_slip [m]", "string_slip", 0),
    ("light_tension [N]", "light_tension", 0),
    ("heavy_tension [N]", "heavy_tension", 0),
)
"""Header with unit, field of `Trajectory` and component of it; a last column ``mode`` has the name of the mode."""
CSV_HEADER = [*(name for name, _, _ in CSV_COLUMNS), "mode"]
NOT_ALWAYS_KNOWN = ("string_slip", "light_tension", "heavy_tension")
"""Fields that are None where the engine does not report them."""
RETRIED_STATUSES = (RunStatus.INTERRUPTED, RunStatus.TIME_LIMIT, RunStatus.MEMORY_LIMIT)
"""Statuses of runs that are made again, because another try may succeed."""


def trajectory_csv(run: Trajectory) -> str:
    """Return CSV text, one line per sample, with nine significant digits (a nanometre in a metre); unknown values are empty."""
    columns = []
    for _, field, component in CSV_COLUMNS:
        values = getattr(run, field)
        if values is None:
            values = np.full(len(run.t), np.nan)
        columns.append(values if values.ndim == 1 else values[:, component])
    out = io.StringIO()
    out.write(",".join(CSV_HEADER) + "\n")
    modes = {int(mode): mode.name.lower() for mode in Mode} | {UNKNOWN_MODE: ""}
    for row, mode in zip(np.stack(columns, axis=1).tolist(), run.mode.tolist(), strict=True):
        cells = ["" if value != value else f"{value:.9g}" for value in row]  # only NaN differs from itself
        out.write(",".join([*cells, modes[mode]]) + "\n")
    return out.getvalue()


def residual_csv(result: ComparisonResult, samples: ResultSamples, trial: TrialComparison) -> str:
    """Return CSV text of a trial's points, one line per point and coordinate: the measured value, and the residual of each run.

    SI units; a residual is measured less predicted, and empty where the run does not reach.
    """
    labels = ["reference", *(result.short_name(e) for e in result.engines)]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["channel", "unit", "t [s]", "measured", *(f"residual of {label}" for label in labels)])
    for comparison in trial.tracks:
        track = comparison.track
        off = np.stack([residual(track, run) for run in (samples.reference, *(a.run for a in samples.aligned))])
        for k, channel in enumerate(track.channels):
            for i, t in enumerate(track.t):
                values = [track.values[k][i], *off[:, i, k].tolist()]
                writer.writerow([channel, track.unit, f"{t:.9g}", *("" if v != v else f"{v:.9g}" for v in values)])
    return out.getvalue()


def trajectory_files(result: ComparisonResult) -> list[str]:
    """Return a distinct name for the CSV file of each engine's trajectory."""
    # The reference's file is in the same folder, so that its name is taken, too
    return [f"{stem}.csv" for stem in file_stems([("reference",), *((e.label, e.profile) for e in result.engines)])[1:]]


def stored_result(folder: Path, scenario: Scenario, engines: Sequence[Engine] | None) -> ComparisonResult | None:
    """Return the comparison in ``folder``, with trajectories, if it is of these ``engines`` on this ``scenario``.

    None if there is none, if it is of another input or version, if a run was cut short, or if a file cannot be read. With
    ``engines`` None it may be of any engines and versions, and of runs that were cut short.
    """
    try:
        result = ComparisonResult.read(folder / ComparisonResult.FILE)
        wanted = scenario.name, scenario.title, scenario.description, scenario.parameters, scenario.duration
        if (result.scenario, result.title, result.description, result.parameters, result.duration) != wanted:
            return None
        if engines is not None:
            if result.run_keys != tuple(run_key(engine, scenario) for engine in engines):
                return None
            if any(RunStatus[engine.status] in RETRIED_STATUSES for engine in result.engines):
                return None
        return dataclasses.replace(result, samples=_samples(result, folder / "trajectories"))
    # Whatever is wrong with the files, making the runs again repairs it
    except (OSError, ValueError, KeyError, IndexError, ResultError):
        return None


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
        provenance=exact.provenance,
    )

    def at(times: Array) -> Trajectory:
        # Times were rounded when the files were written, so that equal ones may differ in their last digits
        place = np.clip(np.searchsorted(reference.t, times - SAME_TIME), 0, len(reference.t) - 1)
        known = place[np.abs(reference.t[place] - times) < SAME_TIME]
        sampled = ((f.name, getattr(reference, f.name)) for f in dataclasses.fields(reference))
        changed: dict[str, Any] = {name: value[known] for name, value in sampled if isinstance(value, np.ndarray)}
        return dataclasses.replace(reference, **changed)

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
            provenance=e.provenance,
        )
        for e, file in zip(result.engines, trajectory_files(result), strict=True)
    ]
    return ResultSamples(reference=reference, aligned=tuple(align(run, at) for run in runs))


def _trajectory(path: Path | None, **fields: Any) -> Trajectory:
    """Read a file that `trajectory_csv` wrote; without a path, return a run without samples."""
    lines = [] if path is None else path.read_text(encoding="utf-8").splitlines()
    if lines and lines[0].split(",") != CSV_HEADER:
        raise ResultError(f"{path}: found other columns, needed {','.join(CSV_HEADER)}")
    cells = [line.split(",") for line in lines[1:]]
    width = len(CSV_COLUMNS)
    numbers = np.array([[float(c) if c else np.nan for c in row[:width]] for row in cells]).reshape(-1, width)
    for field in dict.fromkeys(field for _, field, _ in CSV_COLUMNS):
        values = numbers[:, [field == one for _, one, _ in CSV_COLUMNS]]
        fields[field] = values if values.shape[1] > 1 else values[:, 0]
    fields |= {field: None for field in NOT_ALWAYS_KNOWN if np.isnan(fields[field]).all()}
    modes = [UNKNOWN_MODE if not row[-1] else Mode[row[-1].upper()] for row in cells]
    return Trajectory(mode=np.array(modes, dtype=np.int8), **fields)
