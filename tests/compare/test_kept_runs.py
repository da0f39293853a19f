"""What is kept of runs and comparisons comes back as it was, and what a run will cost is estimated from the runs before it."""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.compare import compare, write
from looping_pendulum.compare.run_cache import EndedRun, RunCache, Runner, RunTask, run_key
from looping_pendulum.compare.trajectories import stored_result
from looping_pendulum.engines.trajectory import COLUMNS, RunStatus
from looping_pendulum.reference_ode.transitions import Mode
from tests.compare.delayed import DelayedEngine


@pytest.fixture
def runner(tmp_path):
    return Runner(RunCache(tmp_path), jobs=1, time_limit=10.0, budget=None)


def knows(runner, make_run, **costs):
    """Tell the runner what runs cost [s]; None: it was left out, and expected to take 7 s."""
    for key, cost in costs.items():
        run = None if cost is None else make_run(wall_time=cost)
        runner.done[key] = EndedRun(run=run, seconds=1e3, expected=7.0 if cost is None else None)


def rung(size, coarser, like=""):
    return RunTask(key="x", engine=None, scenario=None, what="x", like=like, size=size, coarser=coarser)


LADDER = (("a", 8e-4), ("b", 4e-4), ("c", 2e-4))


def test_without_any_run_nothing_is_expected(runner, make_run):
    assert runner.expected(rung(1e-4, LADDER)) is None
    knows(runner, make_run, own=3.0)
    assert runner.expected(rung(1e-4, LADDER, like="own")) == 3.0
    assert runner.expected(rung(1e-4, (), like="own")) == 3.0


@pytest.mark.parametrize(("size", "factor"), [(4e-4, 2), (1e-4, 8), (1e-5, 10), (8e-4, 1)])
def test_the_second_rung_costs_as_many_times_more_as_it_is_finer_but_no_more_than_ten(runner, make_run, size, factor):
    knows(runner, make_run, a=2.0)
    assert runner.expected(rung(size, LADDER[:1])) == pytest.approx(2.0 * factor)


@pytest.mark.parametrize(("costs", "power"), [((1.0, 2.0), 1), ((1.0, 4.0), 2), ((1.0, 64.0), 3), ((4.0, 1.0), 0)])
def test_further_rungs_cost_what_the_last_two_say(runner, make_run, costs, power):
    # Oracle: cost = c size^-power, the power between 0 and 3.
    knows(runner, make_run, a=50.0, b=costs[0], c=costs[1])
    assert runner.expected(rung(0.5e-4, LADDER)) == pytest.approx(costs[1] * 4.0**power)


def test_a_rung_that_was_left_out_counts_as_expected(runner, make_run):
    knows(runner, make_run, a=1.0, b=None)
    assert runner.expected(rung(2e-4, LADDER[:2])) == pytest.approx(7.0 * 2.0 ** math.log2(7))
    assert runner.expected(rung(0.0, LADDER[:2])) == 7.0


def test_a_run_without_a_wall_time_costs_what_its_process_took(runner, make_run):
    runner.done["a"] = EndedRun(run=make_run(wall_time=math.nan), seconds=4.0)
    assert runner.expected(rung(8e-4, LADDER[:1])) == pytest.approx(4.0)


def test_progress_is_the_share_of_the_time_and_not_of_the_runs(tmp_path, make_run):
    reports = []
    tasks = [RunTask(key=k, engine=None, scenario=None, what=f"run {k}", like="a") for k in "abcd"]
    runner = Runner(RunCache(tmp_path), jobs=1, time_limit=10.0, budget=5.0, progress=lambda *what: reports.append(what))
    runner.done["a"] = EndedRun(run=make_run(wall_time=2.0), seconds=2.0)
    runner.done["b"] = EndedRun(run=make_run(wall_time=6.0), seconds=6.0)
    runner._running["c"] = 0.5
    runner._report(tasks)
    # 8 s are done, half of c's 2 s; d is expected to take 2 s.
    assert reports == [(pytest.approx(9 / 12), "2 of 4 runs; run c")]


def test_what_is_beyond_the_budget_does_not_hold_the_progress_back(tmp_path, make_run):
    reports = []
    tasks = [RunTask(key="a", engine=None, scenario=None, what="a"), rung(1e-4, (("a", 8e-4),))]
    runner = Runner(RunCache(tmp_path), jobs=1, time_limit=10.0, budget=5.0, progress=lambda *what: reports.append(what))
    runner.done["a"] = EndedRun(run=make_run(wall_time=2.0), seconds=2.0)
    runner._report(tasks)
    assert reports == [(1.0, "1 of 2 runs; ")], "16 s is more than 5 s: it will be left out"


def test_without_a_callback_no_progress_is_reported(runner):
    runner._report([])


@pytest.fixture
def kept(tmp_path, scenario, make_run):
    """A task, what was kept of its run, and the run."""
    engine = DelayedEngine()
    task = RunTask(key=run_key(engine, scenario), engine=engine, scenario=scenario, what="run")
    run = make_run(message="as said", wall_time=2.5, status=RunStatus.LIGHT_REACHED_ROD)
    return RunCache(tmp_path), task, run


def test_a_kept_run_comes_back_whole(kept):
    cache, task, run = kept
    cache.put(task, EndedRun(run=run, seconds=3.5), 10.0)
    again = cache.get(task, 10.0)
    assert again.seconds == 3.5
    assert (again.run.status, again.run.message, again.run.wall_time) == (run.status, "as said", 2.5)
    assert again.run.provenance.versions == run.provenance.versions
    for name in ("t", "light_position", "light_velocity", "heavy_position", "heavy_velocity", "string_stretch"):
        np.testing.assert_array_equal(getattr(again.run, name), getattr(run, name))


@pytest.mark.parametrize("status", [RunStatus.INTERRUPTED, RunStatus.MISSING, RunStatus.MEMORY_LIMIT])
def test_runs_that_are_worth_another_try_are_not_kept(kept, status):
    cache, task, run = kept
    cache.put(task, EndedRun(run=dataclasses.replace(run, status=status), seconds=1.0), 10.0)
    cache.put(task, EndedRun(run=None, seconds=None, expected=9.0), 10.0)
    assert cache.get(task, 10.0) is None


def test_a_wall_time_that_is_not_known_stays_so(kept):
    cache, task, run = kept
    cache.put(task, EndedRun(run=dataclasses.replace(run, wall_time=math.nan), seconds=1.0), 10.0)
    assert math.isnan(cache.get(task, 10.0).run.wall_time)


def test_a_run_without_samples_is_kept_too(kept, make_run):
    cache, task, _ = kept
    empty = make_run(samples=np.empty((0, len(COLUMNS))), status=RunStatus.CRASHED)
    cache.put(task, EndedRun(run=empty, seconds=1.0), 10.0)
    assert len(cache.get(task, 10.0).run.t) == 0


@pytest.fixture(autouse=True)
def no_figures(monkeypatch):
    """Nothing here looks at figures, and they take a second each time."""
    monkeypatch.setattr("looping_pendulum.compare.figures.charts", lambda result: [])
    monkeypatch.setattr("looping_pendulum.compare.report.render_page", lambda *_: "")


@pytest.fixture
def stored(tmp_path, scenario, reference, make_run, missing):
    """A folder with a comparison, the result, and the engines that it is of."""
    engines = [DelayedEngine(), DelayedEngine(order=2.0)]
    scenario = dataclasses.replace(scenario, name="ten_to_one")
    pulled = make_run(
        shift=(3e-3, 0.0),
        mode=np.full(1051, Mode.SLIDING_UP, dtype=np.int8),
        light_tension=np.linspace(0, 1, 1051),
        heavy_tension=np.linspace(2, 3, 1051),
    )
    result = compare(scenario, reference, [pulled, missing])
    result = dataclasses.replace(result, run_keys=tuple(run_key(e, scenario) for e in engines))
    write(result, tmp_path)
    return tmp_path, scenario, engines, result


def test_a_stored_comparison_comes_back_with_its_trajectories(stored):
    # Oracle: the result itself. Bound: nine significant digits in the CSV.
    folder, scenario, engines, result = stored
    again = stored_result(folder, scenario, engines)
    assert again == result
    for ours, theirs in zip(again.samples.aligned, result.samples.aligned, strict=True):
        for name in ("t", "light_position", "light_velocity", "heavy_position", "heavy_velocity", "free_length", "wrap_angle"):
            np.testing.assert_allclose(getattr(ours.run, name), getattr(theirs.run, name), rtol=1e-8, atol=1e-12)
        np.testing.assert_array_equal(ours.run.mode, theirs.run.mode)
        np.testing.assert_allclose(ours.reference.light_position, theirs.reference.light_position, rtol=1e-8)
        assert (ours.run.label, ours.run.profile, ours.run.status) == (theirs.run.label, theirs.run.profile, theirs.run.status)
    pulled = again.samples.aligned[0].run
    np.testing.assert_allclose(pulled.light_tension, np.linspace(0, 1, 1051), rtol=1e-8)
    np.testing.assert_allclose(pulled.heavy_tension, np.linspace(2, 3, 1051), rtol=1e-8)
    assert again.samples.reference.light_tension is None
    assert [e.name for e in again.samples.reference.events] == [name for name, _ in result.reference.events]
    assert pulled.provenance.settings == result.engines[0].provenance.settings


@pytest.mark.parametrize(
    "changes", [{"title": "other"}, {"description": "other"}, {"duration": 1.0}, {"name": "other"}, {"parameters": None}]
)
def test_a_comparison_of_another_scenario_is_not_taken(stored, changes):
    folder, scenario, engines, _ = stored
    if "parameters" in changes:
        changes = {"parameters": scenario.parameters.replace(light_mass=0.011)}
    assert stored_result(folder, dataclasses.replace(scenario, **changes), engines) is None


def test_a_comparison_of_other_engines_or_of_a_run_cut_short_is_not_taken(stored):
    folder, scenario, engines, result = stored
    assert stored_result(folder, scenario, engines[:1]) is None
    assert stored_result(folder, scenario, engines[::-1]) is None
    for status in ("INTERRUPTED", "TIME_LIMIT", "MEMORY_LIMIT"):
        cut = dataclasses.replace(result.engines[0], status=status)
        write(dataclasses.replace(result, engines=(cut, result.engines[1])), folder)
        assert stored_result(folder, scenario, engines) is None


def test_a_stored_comparison_with_a_damaged_file_is_not_taken(stored):
    folder, scenario, engines, _ = stored
    csv = folder / "trajectories/reference.csv"
    csv.write_text(csv.read_text().replace("light_x", "left_x", 1))
    assert stored_result(folder, scenario, engines) is None
    csv.unlink()
    assert stored_result(folder, scenario, engines) is None
    assert stored_result(folder / "nowhere", scenario, engines) is None
