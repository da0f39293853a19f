"""Files that are whole or absent, and trajectories as CSV."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from looping_pendulum.engines.trajectory import UNKNOWN_MODE, Trajectory
from looping_pendulum.reference_ode.transitions import Mode

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
"""Header with unit, and what stands under it; a last column ``mode`` has the mode's name."""


def write_whole(path: Path, content: bytes | str) -> None:
    """Write a file under a temporary name and rename it, so that a crash never leaves half of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    data = content.encode() if isinstance(content, str) else content
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        partial.write_bytes(data)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def trajectory_csv(run: Trajectory) -> str:
    """Every sample as one line, nine significant digits (a nanometre in a metre); an unknown value is an empty cell."""
    columns = np.stack([values(run) for _, values in CSV_COLUMNS], axis=1)
    out = io.StringIO()
    out.write(",".join([*(name for name, _ in CSV_COLUMNS), "mode"]) + "\n")
    for row, mode in zip(columns, run.mode, strict=True):
        cells = ["" if np.isnan(value) else f"{value:.9g}" for value in row]
        cells.append("" if mode == UNKNOWN_MODE else Mode(mode).name.lower())
        out.write(",".join(cells) + "\n")
    return out.getvalue()


def file_stem(*parts: str) -> str:
    """Return a file name that every file system takes: ("pymunk:chain", "quick") -> "pymunk-chain-quick"."""
    return re.sub(r"[^A-Za-z0-9.]+", "-", "-".join(p for p in parts if p)).strip("-.") or "run"


def unknown_as_nan(values: np.ndarray | None, run: Trajectory) -> np.ndarray:
    """Return ``values`` of a run, shape (n,), or NaN at every sample where the engine does not say them."""
    return np.full(len(run.t), np.nan) if values is None else values
