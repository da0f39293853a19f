"""Makes many runs, each in a process of its own, and caches each on disk when it ends, so that a study can be resumed."""

from __future__ import annotations

import hashlib
import io
import json
import tempfile
import threading
import warnings
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from looping_pendulum import __version__
from looping_pendulum.compare.json_text import plain
from looping_pendulum.engines import MEMORY_LIMIT
from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Engine, known_fields
from looping_pendulum.engines.registry import label
from looping_pendulum.files import file_stem, write_atomically
from looping_pendulum.processes import ReportShare, core_count, run_many
from looping_pendulum.runs.storage import RECORD, SAMPLES, read_run, write_run
from looping_pendulum.runs.trajectory import RunStatus, Trajectory
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import installed_version, source_digest

NOT_CACHED = (RunStatus.INTERRUPTED, RunStatus.MISSING, RunStatus.MEMORY_LIMIT)
"""Statuses of runs that are not cached, because another try may succeed."""
LIMIT = "time_limit"
"""File in the archive of a run with the time limit that it had [s]."""


class DamagedRunWarning(UserWarning):
    """A cached run cannot be read, so it is made again."""


@dataclass(frozen=True, kw_only=True)
class RunTask:
    """A run to be made."""

    key: str
    engine: Engine
    scenario: Scenario
    what: str
    """Description of the run for the progress bar."""
    coarser: tuple[str, ...] = ()
    """Keys of the coarser rungs of its ladder."""


def run_key(engine: Engine, scenario: Scenario) -> str:
    """Return the key of a run: the same for the same settings, scenario, versions and adapter.

    It includes a digest of the adapter's own folder; code that adapters share is represented by the version of this package.
    """
    versions = {package: installed_version(package) for package in engine.abilities.packages} | {
        "looping-pendulum": __version__
    }
    state = {name: plain(value) for name, value in getattr(engine, "__dict__", {}).items() if name != "abilities"}
    what = {
        "class": f"{type(engine).__module__}.{type(engine).__qualname__}",
        "engine": [label(engine), engine.profile.value, state, plain(engine.settings)],
        "scenario": [plain(scenario.parameters), scenario.duration],
        "versions": versions,
        "source": source_digest(type(engine).__module__),
    }
    # Only then a further key, so that runs without such effects keep theirs
    if brought := [effect for effect in scenario.parameters.effects if effect.package]:
        what["effects"] = [[e.name, e.package, installed_version(e.package), source_digest(e.module)] for e in brought]
    # 80 bits, so that no two runs share a name by chance
    digest = hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()[:20]
    return f"{file_stem(label(engine))}-{digest}"


def store_run(path: Path, run: Trajectory, time_limit: float) -> None:
    """Write ``run`` to ``path``, as an archive of the files that its process wrote and the time limit [s] that it had."""
    archive = io.BytesIO()
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as files:
        write_run(Path(folder), run)
        for name in (SAMPLES, RECORD):
            files.write(Path(folder, name), name)
        files.writestr(LIMIT, repr(time_limit))
    write_atomically(path, archive.getvalue())


def load_run(path: Path, task: RunTask, time_limit: float) -> Trajectory | None:
    """Read the run of ``task`` from ``path``; None if there is none, or if a limit shorter than ``time_limit`` [s] has cut it.

    A damaged file counts as none: the run is made again and replaces it.
    """
    if not path.is_file():
        return None
    parameters = task.scenario.parameters
    known = known_fields(task.engine, task.scenario)
    try:
        with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(path) as files:
            for name in (SAMPLES, RECORD):
                files.extract(name, folder)
            had = float(files.read(LIMIT))
            run = read_run(Path(folder), parameters=parameters, duration=task.scenario.duration, **known)
    # A damaged archive may raise anything: of zip, zlib or what is in it
    except Exception as error:
        warnings.warn(DamagedRunWarning(f"{path} is damaged ({type(error).__name__}); its run is made again"), stacklevel=2)
        return None
    return None if run.status is RunStatus.TIME_LIMIT and had < time_limit else run


def make_runs(
    tasks: Sequence[RunTask],
    folder: Path,
    *,
    jobs: int | None,
    time_limit: float,
    memory_limit: int = MEMORY_LIMIT,
    progress: ReportShare | None = None,
    cancelled: threading.Event,
) -> dict[str, Trajectory]:
    """Make all runs that are not cached in ``folder``, in the order of ``tasks``; return key -> run.

    A rung is left out if a coarser one of its ladder has reached the time limit. After an interrupt (Ctrl-C), which sets
    ``cancelled``, only the runs that ended before it are returned.
    """
    # A ladder's rung at the variant's own setting is the same run as the one at its own settings
    tasks = list({task.key: task for task in tasks}.values())
    paths = {task.key: folder / f"{task.key}.zip" for task in tasks}
    cached = {task.key: load_run(paths[task.key], task, time_limit) for task in tasks}
    done = {key: run for key, run in cached.items() if run is not None}
    shares = {task.key: 1.0 if task.key in done else 0.0 for task in tasks}
    running: dict[str, str] = {}

    def make(task: RunTask) -> None:
        if any(key in done and done[key].status is RunStatus.TIME_LIMIT for key in task.coarser):
            shares[task.key] = 1.0
            return
        running[task.key] = task.what
        run = run_isolated(
            task.engine,
            task.scenario,
            time_limit=time_limit,
            memory_limit=memory_limit,
            progress=lambda _, share: shares.update({task.key: share}),
            cancelled=cancelled,
        )
        if run.status not in NOT_CACHED:
            store_run(paths[task.key], run, time_limit)
        del running[task.key]
        # An interrupted run is as good as not begun: the next call makes it
        if run.status is not RunStatus.INTERRUPTED:
            done[task.key], shares[task.key] = run, 1.0

    def report() -> None:
        if progress is not None and tasks:
            # A copy: other threads add and remove runs meanwhile
            what = f"{len(done)} of {len(tasks)} runs; {', '.join(list(running.values()))}"
            progress(what, sum(shares.values()) / len(tasks))

    waiting = [partial(make, task) for task in tasks if task.key not in done]
    run_many(waiting, jobs or core_count(), cancelled=cancelled, meanwhile=lambda _: report())
    return done
