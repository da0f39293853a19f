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
from looping_pendulum.engines.reference import Reference
from looping_pendulum.errors import HarnessError, ResultError
from looping_pendulum.files import file_stems
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.runs.trajectory import (
    ROW,
    UNKNOWN_MODE,
    RunStatus,
    Trajectory,
    from_samples,
    sample_rows,
    sample_times,
)
from looping_pendulum.scenarios.scenario import Scenario

CSV_UNITS = (
    {"t": "s", "light_x": "m", "light_y": "m", "light_vx": "m/s", "light_vy": "m/s"}
    | {"heavy_x": "m", "heavy_y": "m", "heavy_vx": "m/s", "heavy_vy": "m/s", "free_length": "m", "wrap_angle": "rad"}
    | {"string_stretch": "m", "string_slip": "m", "light_tension": "N", "heavy_tension": "N"}
)
"""Column of numbers -> its unit; a last column ``mode`` has the name of the mode."""
CSV_HEADER = [*(f"{name} [{unit}]" for name, unit in CSV_UNITS.items()), "mode"]
PLACES = [ROW.index(name) for name in CSV_UNITS]
"""Place of each column in a row of one sample."""
RETRIED_STATUSES = (RunStatus.INTERRUPTED, RunStatus.TIME_LIMIT, RunStatus.MEMORY_LIMIT)
"""Statuses of runs that are made again, because another try may succeed."""


def trajectory_csv(run: Trajectory) -> str:
    """Return CSV text, one line per sample, with nine significant digits (a nanometre in a metre); unknown values are empty."""
    out = io.StringIO()
    out.write(",".join(CSV_HEADER) + "\n")
    modes = {int(mode): mode.name.lower() for mode in Mode} | {UNKNOWN_MODE: ""}
    for row, mode in zip(sample_rows(run)[:, PLACES].tolist(), run.mode.tolist(), strict=True):
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
        return dataclasses.replace(result, samples=_samples(result, scenario, folder / "trajectories"))
    # Whatever is wrong with the files, making the runs again repairs it
    except (OSError, ValueError, KeyError, IndexError, HarnessError):
        return None


def _samples(result: ComparisonResult, scenario: Scenario, folder: Path) -> ResultSamples:
    """Read the trajectories of the engines of ``result`` from their CSV files; the reference is solved again."""
    reference = Reference(scenario)
    runs = [
        _trajectory(
            # A run without samples has no file
            folder / file if e.samples else None,
            parameters=result.parameters,
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
    return ResultSamples(
        reference=reference(sample_times(result.duration)), aligned=tuple(align(run, reference) for run in runs)
    )


def _trajectory(path: Path | None, **fields: Any) -> Trajectory:
    """Read a file that `trajectory_csv` wrote; without a path, return a run without samples."""
    lines = [] if path is None else path.read_text(encoding="utf-8").splitlines()
    if lines and lines[0].split(",") != CSV_HEADER:
        raise ResultError(f"{path}: found other columns, needed {','.join(CSV_HEADER)}")
    rows = np.full((max(len(lines) - 1, 0), len(ROW)), np.nan)
    for row, line in zip(rows, lines[1:], strict=True):
        *numbers, mode = line.split(",")
        row[PLACES] = [float(cell) if cell else np.nan for cell in numbers]
        row[ROW.index("mode")] = Mode[mode.upper()] if mode else np.nan
    return from_samples(rows, **fields)
