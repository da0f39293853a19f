"""What runs in the process of one engine (see `isolation`), and the data exchanged with it: its job, and samples as they come.

Every run starts a process that imports this module, so it imports little else.
"""

from __future__ import annotations

import faulthandler
import os
import pickle
import shutil
import threading
import traceback
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.engines.protocol import Engine, declared
from looping_pendulum.engines.result_check import validate_trajectory
from looping_pendulum.errors import HarnessError
from looping_pendulum.runs.trajectory import COLUMNS, Provenance, RunStatus, from_samples, padded_row
from looping_pendulum.scenarios.scenario import Scenario

ROW_BYTES = 8 * len(COLUMNS)
"""Size of one row of a recorder's file: 8-byte floats [bytes]."""
JOB, OUTPUT, SAMPLES, RESULT = "job.pickle", "output.txt", "samples.bin", "trajectory.pickle"
"""Files in a worker's folder: its input (engine, scenario and time limit [s]), everything that it prints, the samples as they
are computed, and the pickled trajectory that the engine returned."""
EXTRA_TIME = 60.0
"""Time beyond its limit after which a worker ends itself [s]: its parent, which would have ended it, is gone."""


def main(folder_path: str) -> None:
    """Run the job in the folder at ``folder_path``, and write the trajectory to the same folder."""
    folder = Path(folder_path)
    end_with_parent(folder)
    engine: Engine
    scenario: Scenario
    engine, scenario, time_limit = pickle.loads((folder / JOB).read_bytes())
    # By a clock outside Python, as an engine that hangs in its own code lets no thread of Python run
    faulthandler.dump_traceback_later(time_limit + EXTRA_TIME, exit=True)
    recorder = FileRecorder(folder / SAMPLES)
    try:
        trajectory = validate_trajectory(engine.simulate(scenario, recorder), engine, scenario)
        # Within the try, as a result that cannot be pickled is a failed run. The parent adds the output, which may still grow.
        result = pickle.dumps(replace(trajectory, output=""))
    except Exception as error:  # foreign code may raise anything; the parent gets it as a failed run, with the samples so far
        if not isinstance(error, HarnessError):  # whose message says what was found and needed
            traceback.print_exc()
        failed = from_samples(
            recorder.rows(),
            parameters=scenario.parameters,
            status=RunStatus.FAILED,
            message=str(error) if isinstance(error, HarnessError) else f"{type(error).__name__}: {error}",
            **identity(engine, scenario),
        )
        result = pickle.dumps(failed)
    # Renaming is atomic, so the parent never reads half a result.
    partial = folder / "trajectory.part"
    partial.write_bytes(result)
    partial.rename(folder / RESULT)


def end_with_parent(folder: Path) -> None:
    """End this process, with all that it has started and its folder, when its standard input ends: its parent has ended.

    The engine gets an empty standard input.
    """
    parent = os.dup(0)
    empty = os.open(os.devnull, os.O_RDONLY)
    os.dup2(empty, 0)
    os.close(empty)

    def wait_for_end() -> None:
        os.read(parent, 1)
        try:
            from looping_pendulum.processes import MARK, end_marked

            end_marked(os.environ[MARK])
        finally:
            shutil.rmtree(folder, ignore_errors=True)
            os._exit(1)

    threading.Thread(target=wait_for_end, daemon=True).start()


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
