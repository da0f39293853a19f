"""An engine's run in a notebook: how it ended, what happened, and who supplied which physics."""

from __future__ import annotations

from looping_pendulum.engines.trajectory import Trajectory, supplies_as_rows
from looping_pendulum.pages.notebook import shown, table


def html(run: Trajectory) -> str:
    """HTML of a run."""
    until = (
        f"{len(run.t)} samples to {run.t[-1]:.3f} s; the heavy mass fell {run.heavy_drop.max():.4f} m at most. "
        if len(run.t)
        else ""
    )
    versions = ", ".join(f"{name} {version}" for name, version in run.provenance.versions.items())
    parts = [table(["physics", "by", "how"], supplies_as_rows(run.provenance.supplies))]
    if run.events:
        parts.insert(0, table(["time [s]", "event"], [[f"{e.time:.6f}", e.name.replace("_", " ")] for e in run.events]))
    note = f"{run.status.value}. {until}{run.message} {versions}"
    return shown(f"{run.label} on {run.scenario}, {run.profile}", note, *parts)
