"""Main function of the process in which one engine runs (see `isolation`)."""

from __future__ import annotations

import pickle
import traceback
from dataclasses import replace
from pathlib import Path

from looping_pendulum.engines.job import RESULT, SAMPLES, EngineJob, FileRecorder, identity
from looping_pendulum.engines.result_check import validate_trajectory
from looping_pendulum.engines.trajectory import RunStatus, Trajectory, from_samples
from looping_pendulum.errors import HarnessError
from looping_pendulum.process_start import JOB


def main(folder_path: str) -> None:
    """Run the job in the folder at ``folder_path`` and write the trajectory to the same folder."""
    folder = Path(folder_path)
    job: EngineJob = pickle.loads((folder / JOB).read_bytes())
    recorder = FileRecorder(folder / SAMPLES)
    try:
        trajectory = validate_trajectory(job.engine.simulate(job.scenario, recorder), job.engine, job.scenario)
        # Within the try, as a result that cannot be pickled is a failed run. The parent adds the output, which may still grow.
        result = pickle.dumps(replace(trajectory, output=""))
    except Exception as error:  # foreign code may raise anything; the parent gets it as a failed run
        if not isinstance(error, HarnessError):  # whose message says what was found and needed
            traceback.print_exc()
        result = pickle.dumps(_failed_trajectory(job, recorder, error))
    # Renaming is atomic, so the parent never reads half a result.
    partial = folder / "trajectory.part"
    partial.write_bytes(result)
    partial.rename(folder / RESULT)


def _failed_trajectory(job: EngineJob, recorder: FileRecorder, error: Exception) -> Trajectory:
    """Return a trajectory of the samples recorded before ``error``."""
    return from_samples(
        recorder.rows(),
        parameters=job.scenario.parameters,
        status=RunStatus.FAILED,
        message=str(error) if isinstance(error, HarnessError) else f"{type(error).__name__}: {error}",
        **identity(job.engine, job.scenario),
    )
