"""What travels to an engine's process and back: its job, the samples as they are made, and who made them.

Each run starts a process that imports this, and little else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.engines.protocol import Engine, declared
from looping_pendulum.engines.trajectory import COLUMNS, Provenance, whole_row
from looping_pendulum.scenarios.scenario import Scenario

ROW_BYTES = 8 * len(COLUMNS)

SAMPLES, RESULT = "samples.bin", "trajectory.pickle"
"""Files in a worker's folder: samples as they are made, and what the engine returned."""


class FileRecorder:
    """Appends samples to a file, each with its own write, so that a crash of this process loses none."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("ab", buffering=0)

    def add(self, row: Sequence[float]) -> None:
        """Keep one row of `COLUMNS`; one of another length would make all later rows be read wrongly, and is refused."""
        self._file.write(np.array(whole_row(row), dtype=float).tobytes())

    def rows(self) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        """All rows kept so far, shape (n, len(COLUMNS))."""
        return read_rows(self._path)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_rows(path: Path) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Whole rows of a recorder's file; a half-written last one is left out."""
    data = path.read_bytes() if path.exists() else b""
    whole = len(data) // ROW_BYTES
    return np.frombuffer(data[: whole * ROW_BYTES], dtype=float).reshape(whole, len(COLUMNS)).copy()


@dataclass(frozen=True, kw_only=True)
class EngineJob:
    """What a worker is asked to do; it travels to it as a pickle."""

    engine: Engine
    scenario: Scenario


def identity(engine: Engine, scenario: Scenario) -> dict[str, Any]:
    """Fields that name a run, for a trajectory that its engine could not make itself."""
    provenance = Provenance(versions={}, settings=vars(engine.settings), supplies=engine.abilities.supplies)
    return {
        "engine": engine.name,
        "variant": engine.variant,
        "profile": engine.profile.value,
        "scenario": scenario.name,
        "provenance": provenance,
        **declared(engine, scenario.parameters),
    }
