"""What runs in the process of one engine (see `isolation`): it reads its job, runs it, and writes the run to its folder.

Every run starts a process that imports this module, so it imports little else.
"""

from __future__ import annotations

import faulthandler
import pickle
import traceback
from pathlib import Path
from typing import Any

from looping_pendulum.engines.protocol import Engine, declared
from looping_pendulum.errors import HarnessError
from looping_pendulum.files import utf8
from looping_pendulum.processes import end_with_parent, finish
from looping_pendulum.runs.storage import FileRecorder, write_record, write_run
from looping_pendulum.runs.trajectory import Provenance, RunStatus
from looping_pendulum.scenarios.scenario import Scenario

JOB = "job.pickle"
"""File in a worker's folder with its input: engine, scenario and time limit [s]."""
EXTRA_TIME = 60.0
"""Time beyond its limit after which a worker ends itself [s]: its parent, which would have ended it, is gone."""


def main(folder_path: str) -> None:
    """Run the job in the folder at ``folder_path``, and write the run to the same folder."""
    folder = Path(folder_path)
    end_with_parent(folder)
    engine: Engine
    scenario: Scenario
    engine, scenario, time_limit = pickle.loads((folder / JOB).read_bytes())
    # By a clock outside Python, as an engine that hangs in its own code lets no thread of Python run
    faulthandler.dump_traceback_later(time_limit + EXTRA_TIME, exit=True)
    try:
        write_run(folder, engine.simulate(scenario, FileRecorder(folder)))
    # Foreign code may raise anything, also to end this process; the parent gets it as a failed run, with the samples so far
    except BaseException as error:
        if not isinstance(error, HarnessError):  # whose message says what was found and needed
            traceback.print_exc()
        message = str(error) if isinstance(error, HarnessError) else f"{type(error).__name__}: {error}"
        write_record(
            folder,
            named(engine, scenario)
            | {
                "provenance": settings_provenance(engine),
                "status": RunStatus.FAILED,
                "message": utf8(message).decode(),
                "events": (),
                "wall_time": float("nan"),
                "cpu_time": float("nan"),
            },
        )
    finish()


def named(engine: Engine, scenario: Scenario) -> dict[str, str]:
    """Return the names of a run, as fields of its trajectory."""
    return {
        "engine": engine.name,
        "variant": engine.variant,
        "profile": engine.profile.value,
        "scenario": scenario.name,
    }


def settings_provenance(engine: Engine) -> Provenance:
    """Return the provenance of a run that its engine could not return itself."""
    return Provenance(versions={}, settings=vars(engine.settings), supplies=engine.abilities.supplies)


def identity(engine: Engine, scenario: Scenario) -> dict[str, Any]:
    """Return the fields that are known of a run, for a trajectory that its engine could not return itself."""
    return named(engine, scenario) | {"provenance": settings_provenance(engine)} | declared(engine, scenario.parameters)
