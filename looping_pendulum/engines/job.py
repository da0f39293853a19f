"""Data exchanged with an engine's process: its job, and the samples as they are computed.

Every run starts a process that imports this module, so it imports little else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.engines.protocol import Engine, declared
from looping_pendulum.engines.trajectory import COLUMNS, Provenance, padded_row
from looping_pendulum.scenarios.scenario import Scenario

ROW_BYTES = 8 * len(COLUMNS)
"""Size of one row of a recorder's file: 8-byte floats [bytes]."""

SAMPLES, RESULT = "samples.bin", "trajectory.pickle"
"""Files in a worker's folder: the samples as they are computed, and the pickled trajectory that the engine returned."""


class FileRecorder:
    """Appends samples to a file, each with its own write, so that a crash of this process loses none."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("ab", buffering=0)

    def add(self, row: Sequence[float]) -> None:
        """Store one row of `COLUMNS`; one of another length is refused, because all later rows would be read wrongly."""
        self._file.write(np.array(padded_row(row), dtype=float).tobytes())

    def rows(self) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        """Return all rows stored so far, shape (n, len(COLUMNS))."""
        return read_rows(self._path)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_rows(path: Path) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Return the complete rows of a recorder's file; a half-written last one is left out."""
    data = path.read_bytes() if path.exists() else b""
    rows = len(data) // ROW_BYTES
    # A copy, as an array over bytes cannot be written to
    return np.frombuffer(data[: rows * ROW_BYTES], dtype=float).reshape(rows, len(COLUMNS)).copy()


@dataclass(frozen=True, kw_only=True)
class EngineJob:
    """The task of a worker, sent to it as a pickle."""

    engine: Engine
    scenario: Scenario


def identity(engine: Engine, scenario: Scenario) -> dict[str, Any]:
    """Return the fields that name a run, for a trajectory that its engine could not return itself."""
    provenance = Provenance(versions={}, settings=vars(engine.settings), supplies=engine.abilities.supplies)
    return {
        "engine": engine.name,
        "variant": engine.variant,
        "profile": engine.profile.value,
        "scenario": scenario.name,
        "provenance": provenance,
        **declared(engine, scenario.parameters),
    }
