"""Writes trajectories as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable

import numpy as np

from looping_pendulum.compare.result import ComparisonResult, ResultSamples
from looping_pendulum.compare.trial import TrialComparison, residual
from looping_pendulum.engines.trajectory import UNKNOWN_MODE, Trajectory
from looping_pendulum.files import file_stem, file_stems, write_atomically
from looping_pendulum.reference_ode.transitions import Mode

__all__ = ["CSV_COLUMNS", "file_stem", "trajectory_csv", "write_atomically"]

CSV_COLUMNS: tuple[tuple[str, Callable[[Trajectory], np.ndarray]], ...] = (
    ("t [s]", lambda run: run.t),
    ("light_x [m]", lambda run: run.light_position[:, 0]),
    ("light_y [m]", lambda run: run.light_position[:, 1]),
    ("light_vx [m/s]", lambda run: run.light_velocity[:, 0]),
    ("light_vy [m/s]", lambda run: run.light_velocity[:, 1]),
    ("heavy_x [m]", lambda run: run.heavy_position[:, 0]),
    ("heavy_y [m]", lambda run: run.heavy_position[:, 1]),
    ("heavy_vx [m/s]", lambda run: run.heavy_velocity[:, 0]),
    ("heavy_vy [m/s]", lambda run: run.heavy_velocity[:, 1]),
    ("free_length [m]", lambda run: run.free_length),
    ("wrap_angle [rad]", lambda run: run.wrap_angle),
    ("string_stretch [m]", lambda run: run.string_stretch),
    ("string_slip [m]", lambda run: unknown_as_nan(run.string_slip, run)),
    ("light_tension [N]", lambda run: unknown_as_nan(run.light_tension, run)),
    ("heavy_tension [N]", lambda run: unknown_as_nan(run.heavy_tension, run)),
)
"""Header with unit, and the function that gives the column; a last column ``mode`` has the name of the mode."""


def trajectory_csv(run: Trajectory) -> str:
    """Return CSV text, one line per sample, with nine significant digits (a nanometre in a metre); unknown values are empty."""
    columns = np.stack([values(run) for _, values in CSV_COLUMNS], axis=1)
    out = io.StringIO()
    out.write(",".join([*(name for name, _ in CSV_COLUMNS), "mode"]) + "\n")
    modes = {int(mode): mode.name.lower() for mode in Mode} | {UNKNOWN_MODE: ""}
    for row, mode in zip(columns.tolist(), run.mode.tolist(), strict=True):
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


def unknown_as_nan(values: np.ndarray | None, run: Trajectory) -> np.ndarray:
    """Return ``values`` of a run, shape (n,), or NaN at every sample if the engine does not report them."""
    return np.full(len(run.t), np.nan) if values is None else values
