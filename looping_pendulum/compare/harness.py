"""Runs engines on a scenario and compares them with the reference, in one call."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from pathlib import Path

from looping_pendulum.compare.comparison import compare, with_trial
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.compare.run_cache import run_key
from looping_pendulum.compare.trial import MeasuredTrial
from looping_pendulum.engines import MEMORY_LIMIT
from looping_pendulum.engines.isolation import TIME_LIMIT, Progress, run_all
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import expand_tolerances, label, main_engines, select
from looping_pendulum.errors import EngineError
from looping_pendulum.measured.tables.events import MeasuredEventRow, find_data, read_event_table
from looping_pendulum.runs.trajectory import Trajectory
from looping_pendulum.scenarios.scenario import Scenario


def chosen_engines(engines: Iterable[str | Engine], profile: Profile) -> list[Engine]:
    """Return ``engines``, each given by its name or itself, or one name; without any, every engine but the reference.

    Raises
    ------
    EngineError
        If a name is not known, or something is neither a name nor an engine.
    """
    chosen: list[Engine] = []
    for each in [engines] if isinstance(engines, str) else engines:
        if not isinstance(each, (str, Engine)):
            raise EngineError(f"engines: found {type(each).__name__}, needed a name such as 'pymunk', or an engine")
        named = select([each], profile) if isinstance(each, str) else [each]
        chosen += [engine for engine in named if engine not in chosen]
    return chosen or main_engines(profile)


def compare_engines(
    scenario: Scenario,
    *,
    engines: Iterable[str | Engine] = (),
    profile: Profile | str = Profile.QUICK,
    data_folder: Path | None = None,
    trial: MeasuredTrial | None = None,
    jobs: int | None = None,
    time_limit: float = TIME_LIMIT,
    memory_limit: int = MEMORY_LIMIT,
    progress: Progress | None = None,
    finished: Callable[[Trajectory], None] | None = None,
    meanwhile: Callable[[ComparisonResult, tuple[str, ...]], None] | None = None,
) -> ComparisonResult:
    """Run engines on ``scenario``, each in its own process, and compare them with the exact reference.

    Parameters
    ----------
    scenario
        Scenario to run; `scenarios.load` reads one.
    engines
        "pymunk" for all variants of an engine, "mujoco:capstan" for one, or an engine itself; none means all.
    profile
        "quick" or "accurate": the settings of the engines that are named.
    data_folder
        Folder of measured event tables; they are also looked for in ``$LOOPING_PENDULUM_DATA``.
    trial
        Measured trial to compare with, in place of the scenario's own measured events;
        `compare.trial_files.read_measured_trial` reads one.
    jobs
        Number of runs at the same time; one per core if None.
    time_limit, memory_limit
        Limits of each run [s], [bytes].
    progress, finished
        Callbacks for the progress of runs and for each run that ends; they are called from other threads.
    meanwhile
        Callback for the comparison of the engines that have ended while others go on, with the labels of the latter.

    Returns
    -------
    ComparisonResult
        ``write(result, folder)`` makes the report of it.

    Raises
    ------
    EngineError
        If an engine's name is not known, or something is neither a name nor an engine.
    ScenarioError
        If a tolerance names an engine that is not known.
    """
    profile = Profile(profile)
    # Before the runs: a tolerance that names an unknown engine ends the command at once
    scenario = expand_tolerances(scenario, profile)
    chosen = chosen_engines(engines, profile)
    reference = Reference(scenario)
    # Before the runs, too, so that a faulty table does not waste them; without its file there is nothing to compare with
    measured: tuple[MeasuredEventRow, ...] = ()
    if trial is None and scenario.measured is not None:
        path = find_data(scenario.measured.file, data_folder)
        measured = () if path is None else read_event_table(path, scenario.measured.sha256)

    def compared(runs: list[Trajectory]) -> ComparisonResult:
        result = compare(scenario, reference, runs, measured)
        return result if trial is None else with_trial(result, trial)

    def compare_meanwhile(ended: list[Trajectory]) -> None:
        if meanwhile is not None:
            labels = {run.label for run in ended}
            meanwhile(compared(ended), tuple(label(engine) for engine in chosen if label(engine) not in labels))

    runs = run_all(
        chosen,
        scenario,
        jobs=jobs,
        time_limit=time_limit,
        memory_limit=memory_limit,
        progress=progress,
        finished=finished,
        meanwhile=None if meanwhile is None else compare_meanwhile,
    )
    # `compare` knows trajectories only, and a key takes the engine with its settings
    return dataclasses.replace(compared(runs), run_keys=tuple(run_key(engine, scenario) for engine in chosen))
