"""The process in which one engine runs (see `isolation`)."""

from __future__ import annotations

import pickle
import traceback
from dataclasses import replace
from pathlib import Path

from looping_pendulum.engines.job import RESULT, SAMPLES, EngineJob, FileRecorder, identity
from looping_pendulum.engines.returned import checked
from looping_pendulum.engines.trajectory import RunStatus, Trajectory, from_samples
from looping_pendulum.process_start import JOB


def main(place: str) -> None:
    """Run the job that lies in the folder ``place`` and leave the trajectory beside it."""
    folder = Path(place)
    job: EngineJob = pickle.loads((folder / JOB).read_bytes())
    recorder = FileRecorder(folder / SAMPLES)
    try:
        trajectory = checked(job.engine.simulate(job.scenario, recorder), job.engine, job.scenario)
        result = pickle.dumps(replace(trajectory, output=""))
    except Exception as error:
        traceback.print_exc()
        result = pickle.dumps(_failed(job, recorder, error))
    finished = folder / "trajectory.part"
    finished.write_bytes(result)
    finished.rename(folder / RESULT)


def _failed(job: EngineJob, recorder: FileRecorder, error: Exception) -> Trajectory:
    return from_samples(
        recorder.rows(),
        parameters=job.scenario.parameters,
        status=RunStatus.FAILED,
        message=f"{type(error).__name__}: {error}",
        **identity(job.engine, job.scenario),
    )
