"""The process in which one engine runs: `python -m looping_pendulum.engines.worker FOLDER` (see `isolation`)."""

from __future__ import annotations

import pickle
import sys
import traceback
from dataclasses import replace
from pathlib import Path

from looping_pendulum.engines.isolation import FileRecorder, Job, identity
from looping_pendulum.engines.trajectory import RunStatus, Trajectory, from_samples


def main(folder: Path) -> None:
    """Run the job that lies in ``folder`` and leave the trajectory beside it."""
    job: Job = pickle.loads((folder / "job.pickle").read_bytes())
    recorder = FileRecorder(folder / "samples.bin")
    try:
        trajectory = job.engine.simulate(job.scenario, recorder)
    except Exception as error:
        traceback.print_exc()
        trajectory = _failed(job, recorder, error)
    finished = folder / "trajectory.part"
    finished.write_bytes(pickle.dumps(replace(trajectory, output="")))
    finished.rename(folder / "trajectory.pickle")


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
