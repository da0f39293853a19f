"""The process in which one engine runs: `python -m looping_pendulum.engines.worker FOLDER` (see `isolation`)."""

from __future__ import annotations

import pickle
import sys
import traceback
from dataclasses import replace
from pathlib import Path

import numpy as np

from looping_pendulum.engines.isolation import FileRecorder, Job, identity
from looping_pendulum.engines.trajectory import RunStatus, Trajectory, from_samples


def main(folder: Path) -> None:
    """Run the job that lies in ``folder`` and leave the trajectory beside it."""
    job: Job = pickle.loads((folder / "job.pickle").read_bytes())
    recorder = FileRecorder(folder / "samples.bin")
    try:
        trajectory = _checked(job.engine.simulate(job.scenario, recorder))
    except Exception as error:
        traceback.print_exc()
        trajectory = _failed(job, recorder, error)
    finished = folder / "trajectory.part"
    finished.write_bytes(pickle.dumps(replace(trajectory, output="")))
    finished.rename(folder / "trajectory.pickle")


def _checked(trajectory: Trajectory) -> Trajectory:
    """Return what an engine gave back; a run with a position that is no number did not end as it should."""
    if not isinstance(trajectory, Trajectory):
        raise TypeError(f"simulate returned {type(trajectory).__name__}, needed a Trajectory")
    finite = np.isfinite(trajectory.light_position).all() and np.isfinite(trajectory.heavy_position).all()
    return replace(trajectory, status=RunStatus.NOT_FINITE) if trajectory.status.ok and not finite else trajectory


def _failed(job: Job, recorder: FileRecorder, error: Exception) -> Trajectory:
    return from_samples(
        recorder.rows(),
        parameters=job.scenario.parameters,
        status=RunStatus.FAILED,
        message=f"{type(error).__name__}: {error}",
        **identity(job.engine, job.scenario),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
