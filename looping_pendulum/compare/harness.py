"""The main job in one call: take a scenario, run the engines, hold them against the reference."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from pathlib import Path

from looping_pendulum.compare.comparison import compare
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.compare.run_cache import run_key
from looping_pendulum.engines.isolation import TIME_LIMIT, Progress, run_all
from looping_pendulum.engines.limits import with_variants
from looping_pendulum.engines.memory import MEMORY_LIMIT
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import challengers, select
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.scenarios.measured import MeasuredEventTable, find_data, read_event_table
from looping_pendulum.scenarios.scenario import Scenario


def chosen_engines(names: Iterable[str], profile: Profile) -> list[Engine]:
    """Engines that ``names`` mean, or every engine but the reference if there are none."""
    names = tuple(names)
    return select(names, profile) if names else challengers(profile)


def compare_engines(
    scenario: Scenario,
    *,
    engines: Iterable[str] = (),
    profile: Profile | str = Profile.QUICK,
    data_folder: Path | None = None,
    jobs: int | None = None,
    time_limit: float = TIME_LIMIT,
    memory_limit: int = MEMORY_LIMIT,
    progress: Progress | None = None,
    finished: Callable[[Trajectory], None] | None = None,
) -> ComparisonResult:
    """Run engines on ``scenario``, each in its own process, and compare them with the exact reference.

    Parameters
    ----------
    scenario
        What to rebuild; `scenarios.load` reads one.
    engines
        "pymunk" for all variants of an engine, "mujoco:capstan" for one; none means all.
    profile
        "quick" or "accurate".
    data_folder
        Where measured event tables lie; also looked for in ``$LOOPING_PENDULUM_DATA``.
    jobs
        Runs at once; one per core if None.
    time_limit, memory_limit
        Of each run [s], [bytes].
    progress, finished
        Called as runs go on, from other threads.

    Returns
    -------
    ComparisonResult
        ``write(result, folder)`` makes the report of it.

    Raises
    ------
    EngineError
        If an engine's name is not known.
    ScenarioError
        If a tolerance names an engine that is not known.
    """
    profile = Profile(profile)
    scenario = with_variants(scenario, profile)
    chosen = chosen_engines(engines, profile)
    reference = Reference(scenario)
    measured = measured_table(scenario, data_folder)  # before the runs: a faulty table must not cost them
    runs = run_all(
        chosen,
        scenario,
        jobs=jobs,
        time_limit=time_limit,
        memory_limit=memory_limit,
        progress=progress,
        finished=finished,
    )
    result = compare(scenario, reference, runs, measured)
    return dataclasses.replace(result, run_keys=tuple(run_key(engine, scenario) for engine in chosen))


def measured_table(scenario: Scenario, data_folder: Path | None = None) -> MeasuredEventTable | None:
    """Return the measured event table of ``scenario``, None if it has none or its file is not at hand."""
    if scenario.measured is None:
        return None
    path = find_data(scenario.measured.file, data_folder)
    return None if path is None else read_event_table(path, scenario.measured.sha256)
