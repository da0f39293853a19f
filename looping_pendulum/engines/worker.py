"""What runs in a process of its own, of an engine's run or of another package's adapter: it does a job, and says what failed.

Every run starts a process that imports this module, so it imports little else.
"""

from __future__ import annotations

import faulthandler
import pickle
import traceback
from pathlib import Path

from looping_pendulum.engines.protocol import Engine
from looping_pendulum.errors import HarnessError
from looping_pendulum.files import write_atomically
from looping_pendulum.processes import end_with_parent, finish
from looping_pendulum.runs.storage import recording, write_run
from looping_pendulum.scenarios.scenario import Scenario

WORKER = f"{__name__}:main"
"""The program, as `processes.run_python` takes it."""
JOB = "job.pickle"
"""File in a worker's folder: what it shall do, a function of the folder, and its time limit [s]."""
FAILURE = "failure.txt"
"""File to which it writes what that raised."""
EXTRA_TIME = 60.0
"""Time beyond its limit after which a worker ends itself [s]: its parent, which would have ended it, is gone."""


def main(folder_path: str) -> None:
    """Do the job in the folder at ``folder_path``."""
    folder = Path(folder_path)
    end_with_parent(folder)
    do, time_limit = pickle.loads((folder / JOB).read_bytes())
    # By a clock outside Python, as an engine that hangs in its own code lets no thread of Python run
    faulthandler.dump_traceback_later(time_limit + EXTRA_TIME, exit=True)
    try:
        do(folder)
    # Foreign code may raise anything, also to end this process; the parent gets it as a sentence
    except BaseException as error:
        if not isinstance(error, HarnessError):  # whose message says what was found and needed
            traceback.print_exc()
        message = str(error) if isinstance(error, HarnessError) else f"{type(error).__name__}: {error}"
        write_atomically(folder / FAILURE, message)
    finish()


def simulate(engine: Engine, scenario: Scenario, folder: Path) -> None:
    """Run ``engine`` on ``scenario``, and write its samples, as they come, and how it ended to ``folder``."""
    with recording(folder) as record:
        run = engine.simulate(scenario, record)
    write_run(folder, run)
