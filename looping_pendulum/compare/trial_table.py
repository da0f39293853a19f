"""Renders a measured trial's residuals: one table for a terminal and for the report, and the trial's section."""

from __future__ import annotations

from looping_pendulum.compare import paper_table
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.compare.tables import GAP, fixed, number, signed, table
from looping_pendulum.compare.trial import RunResidual, TrackComparison
from looping_pendulum.pages.notebook import plain
from looping_pendulum.pages.numbers import DisplayUnit

AXES = {"light_x": "right", "heavy_x": "right", "light_y": "up", "heavy_y": "up", "wrap_angle": "ahead"}
"""Channel -> direction in which it grows."""
RESIDUAL_UNITS = {"m": DisplayUnit("mm", 1e3), "rad": DisplayUnit("deg", 57.29577951308232)}
"""SI unit of a track -> unit in which its residuals are shown."""


def residual_rows(result: ComparisonResult) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of the residuals as plain text, the reference first; empty without tracked points."""
    if result.trial is None or not result.trial.tracks:
        return [], []
    tracks = result.trial.tracks
    head = ["run"]
    for comparison in tracks:
        name, unit = comparison.track.name, RESIDUAL_UNITS[comparison.track.unit].name
        means = ", ".join(AXES[channel] for channel in comparison.track.channels)
        head += [f"{name}: RMS residual [{unit}]", f"largest [{unit}] (at [s])", f"mean, {means} [{unit}]", "points"]
    labels = ["reference", *(result.short_name(e) for e in result.engines)]
    rows = []
    for i, label in enumerate(labels):
        row = [label]
        for comparison in tracks:
            row += _cells(comparison, comparison.reference if i == 0 else comparison.engines[i - 1])
        rows.append(row)
    return head, rows


def short_residual_rows(result: ComparisonResult) -> tuple[list[str], list[list[str]]]:
    """Return the RMS columns of `residual_rows` alone, which fit a terminal."""
    head, rows = residual_rows(result)
    columns = [0, *(i for i, cell in enumerate(head) if "RMS" in cell)]
    return [head[i] for i in columns if head], [[row[i] for i in columns] for row in rows]


def _cells(comparison: TrackComparison, residual: RunResidual) -> list[str]:
    unit, total = RESIDUAL_UNITS[comparison.track.unit], len(comparison.track.t)
    points = str(total) if residual.compared == total else f"{residual.compared} of {total}"
    if residual.rms is None:
        return [GAP, GAP, GAP, points]
    scale = unit.per_si_unit
    means = ", ".join(signed(m, scale, 2) for m in residual.mean)
    largest = f"{number(residual.largest, scale)} ({fixed(residual.largest_at, 3)})"
    return [number(residual.rms, scale), largest, means, points]


def render(result: ComparisonResult) -> list[str]:
    """Return the section on the measured trial, or nothing without one."""
    trial = result.trial
    if trial is None:
        return []
    parts = [f"Trial `{_code(trial.name)}`, read from `{_code(trial.source)}`; times are since the release.\n"]
    parts += ["".join(f"- {plain(note)}\n" for note in trial.notes)] if trial.notes else []
    if trial.tracks:
        head, rows = residual_rows(result)
        parts.append(
            "Residual: measured less predicted, at the measured times; the RMS is that of the distance, over the points that a "
            "run covers.\n"
        )
        parts.append(table(head, rows))
    if result.measured:
        parts.append(paper_table.render(result, source=False))
    return ["## Against the measured trial\n\n" + "\n".join(parts)]


def _code(text: str) -> str:
    """Return ``text`` for Markdown's code, which a backtick would end."""
    return " ".join(text.split()).replace("`", "'")
