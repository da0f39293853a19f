"""Names of runs, what is kept of them, and how many are made: by engines that are nothing but their settings."""

import dataclasses
import hashlib
import math
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import scipy

from looping_pendulum import versions
from looping_pendulum.compare import compare, run_cache, write
from looping_pendulum.compare.run_cache import EndedRun, RunCache, Runner, RunTask, run_key
from looping_pendulum.compare.trajectories import stored_result
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.runs.trajectory import COLUMNS, RunStatus
from tests.compare.delayed import DelayedEngine


@pytest.fixture
def tasks(scenario):
    """Three tasks of three engines."""
    engines = [DelayedEngine(offset=1e-3 * k) for k in range(3)]
    return [RunTask(key=run_key(e, scenario), engine=e, scenario=scenario, what=f"run {k}") for k, e in enumerate(engines)]


@pytest.fixture
def made(monkeypatch, make_run):
    """Keys of the runs that are made; they are of the closed form and take two seconds by a clock of their own."""
    asked, clock = [], [100.0]

    def run(engine, scenario, *, progress, **limits):
        asked.append((engine, limits))
        progress(engine, 0.25)
        clock[0] += 2.0
        return make_run(status=RunStatus.FINISHED)

    monkeypatch.setattr(run_cache, "run_isolated", run)
    monkeypatch.setattr(run_cache.time, "perf_counter", lambda: clock[0])
    return asked


def test_every_attribute_of_an_engine_is_in_the_name_of_its_run_but_for_its_abilities(scenario):
    """Those before "abilities" in the alphabet as well as those after it; abilities say what it can do, not what it does."""

    def key(**attributes):
        engine = DelayedEngine()
        vars(engine).update(attributes)
        return run_key(engine, scenario)

    names = {key(), key(zeta=1), key(zeta=2), key(aa=1), key(aa=2), key(settings=DelayedEngine(order=2.0).settings)}
    assert len(names) == 6
    other = dataclasses.replace(DelayedEngine.abilities, summary="Something else")
    assert key(abilities=other) == key()
    assert key().startswith("delayed-exact-")
    assert len(key().removeprefix("delayed-exact-")) == 20


def test_the_name_of_a_run_changes_with_versions_profile_and_scenario(scenario, monkeypatch):
    engine = DelayedEngine()
    before = run_key(engine, scenario)
    engine.profile = SimpleNamespace(value="accurate")
    assert run_key(engine, scenario) != before
    heavier = dataclasses.replace(scenario, parameters=scenario.parameters.replace(heavy_mass=0.2))
    assert run_key(DelayedEngine(), heavier) != before
    assert run_key(DelayedEngine(), dataclasses.replace(scenario, duration=0.5)) != before
    assert run_key(DelayedEngine(), dataclasses.replace(scenario, title="other", name="other")) == before
    monkeypatch.setattr(run_cache, "installed_version", lambda package: "another")
    assert run_key(DelayedEngine(), scenario) != before


def test_the_adapters_code_is_all_files_beside_it_but_what_only_says_what_to_vary(tmp_path, monkeypatch):
    files = {"adapter.py": b"a", "rig.py": b"b", "studies.py": b"c", "zeta.py": b"d", "notes.txt": b"e"}
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    module = ModuleType("adapter_of_a_test")
    module.__file__ = str(tmp_path / "adapter.py")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    assert run_cache.source_digest(module.__name__) == hashlib.sha256(b"abd").hexdigest()
    assert run_cache.source_digest("no.such.module") == ""


def test_a_version_is_found_under_the_name_of_the_import_too(monkeypatch):
    pip = {"imported_name": ["numpy", "scipy"]}
    monkeypatch.setattr(versions, "packages_distributions", lambda: pip)
    assert versions.installed_version("numpy") == np.__version__
    assert versions.installed_version("imported_name") == f"{np.__version__}, {scipy.__version__}"
    assert versions.installed_version("no_such_package") == "none"


@pytest.mark.parametrize(("limit", "asked", "taken"), [(10.0, 10.0, True), (10.0, 5.0, True), (10.0, 20.0, False)])
def test_a_run_that_a_shorter_time_limit_has_cut_is_made_again(tmp_path, tasks, make_run, limit, asked, taken):
    cache = RunCache(tmp_path)
    cache.put(tasks[0], EndedRun(run=make_run(until=0.2, status=RunStatus.TIME_LIMIT), seconds=9.0), limit)
    assert (cache.get(tasks[0], asked) is not None) is taken
    cache.put(tasks[0], EndedRun(run=make_run(), seconds=9.0), limit)
    assert cache.get(tasks[0], 2 * asked) is not None, "one that came to its end did not need the limit"


def test_the_slip_and_an_unknown_cost_come_back_too(tmp_path, tasks, make_run):
    slip = np.linspace(0, 1, 1051)
    RunCache(tmp_path).put(tasks[0], EndedRun(run=dataclasses.replace(make_run(), string_slip=slip), seconds=None), 1.0)
    again = RunCache(tmp_path).get(tasks[0], 1.0)
    np.testing.assert_array_equal(again.run.string_slip, slip)
    assert again.seconds is None
    RunCache(tmp_path).put(tasks[1], EndedRun(run=make_run(), seconds=1.0), 1.0)
    assert RunCache(tmp_path).get(tasks[1], 1.0).run.string_slip is None
    assert again.run.label == "delayed:exact", "who made it is known from the task"


def test_every_run_is_made_once_and_what_is_kept_not_again(tmp_path, tasks, made):
    runner = Runner(RunCache(tmp_path), jobs=1, time_limit=7.0, budget=None, memory_limit=123)
    done = runner.run([*tasks, tasks[0]])
    assert [engine for engine, _ in made] == [task.engine for task in tasks], "in their order, a task that is there twice once"
    assert set(done) == {task.key for task in tasks}
    assert {one.seconds for one in done.values()} == {2.0}
    assert [(limits["time_limit"], limits["memory_limit"]) for _, limits in made] == [(7.0, 123)] * 3
    assert runner._running == {}
    assert set(Runner(RunCache(tmp_path), jobs=2, time_limit=7.0, budget=None).run(tasks)) == set(done)
    assert len(made) == 3


@pytest.mark.parametrize(("budget", "count"), [(2.0, 1), (2.1, 1), (2.2, 2), (None, 2)])
def test_a_budget_leaves_out_what_would_take_longer(tmp_path, tasks, made, budget, count):
    """The closed form says that it took 2.1 s; the next run costs as much as that."""
    first, second = tasks[0], dataclasses.replace(tasks[1], like=tasks[0].key)
    runner = Runner(RunCache(tmp_path), jobs=1, time_limit=7.0, budget=budget)
    done = runner.run([first, second])
    if budget == 2.1:
        count = 2  # just the budget is within it
    assert len(made) == count
    left_out = done[second.key]
    assert (left_out.run is None) is (count == 1)
    assert left_out.expected == (2.1 if count == 1 else None)
    assert RunCache(tmp_path).get(second, 7.0) is None or count == 2


def test_after_an_interrupt_no_run_is_begun_and_the_cut_one_is_not_done(tmp_path, tasks, monkeypatch, make_run):
    runner = Runner(RunCache(tmp_path), jobs=1, time_limit=7.0, budget=None)
    begun = []

    def run(engine, scenario, *, cancelled, **_):
        begun.append(engine)
        if len(begun) == 2:
            cancelled.set()
            return make_run(until=0.2, status=RunStatus.INTERRUPTED)
        return make_run()

    monkeypatch.setattr(run_cache, "run_isolated", run)
    assert set(runner.run(tasks)) == {tasks[0].key}
    assert len(begun) == 2
    assert runner.cancelled.is_set()
    assert RunCache(tmp_path).get(tasks[1], 7.0) is None
    assert set(Runner(RunCache(tmp_path), jobs=1, time_limit=7.0, budget=None).run(tasks[:2])) == {t.key for t in tasks[:2]}


def test_an_error_of_a_run_is_not_swallowed(tmp_path, tasks, monkeypatch):
    def run(*_, **__):
        raise OSError("no space left")

    monkeypatch.setattr(run_cache, "run_isolated", run)
    with pytest.raises(OSError, match="no space left"):
        Runner(RunCache(tmp_path), jobs=1, time_limit=7.0, budget=None).run(tasks)


def test_a_runner_has_as_many_jobs_as_are_asked_for_or_as_there_are_cores(tmp_path, monkeypatch):
    monkeypatch.setattr(run_cache, "core_count", lambda: 8)
    jobs = [Runner(RunCache(tmp_path), jobs=asked, time_limit=1.0, budget=None).jobs for asked in (3, None)]
    assert jobs == [3, 8]


def test_progress_tells_of_runs_that_go_on_what_share_is_done(tmp_path, tasks, make_run):
    reports = []
    runner = Runner(
        RunCache(tmp_path), jobs=1, time_limit=9.0, budget=3.0, progress=lambda what, share: reports.append((share, what))
    )
    runner._report([])
    assert reports.pop() == (1.0, "0 of 0 runs; ")
    runner._report(tasks)
    assert reports.pop() == (0.0, "0 of 3 runs; ")
    runner.done[tasks[0].key] = EndedRun(run=make_run(wall_time=2.0), seconds=4.0)
    runner._running |= {tasks[1].key: 0.5, tasks[2].key: 0.25}
    runner._report(tasks)
    # 4 s are done; of two that are expected to take the usual 2 s each, a half and a quarter.
    assert reports.pop() == (pytest.approx((4 + 1 + 0.5) / 8), "1 of 3 runs; run 1, run 2")
    runner.done["other"] = EndedRun(run=make_run(wall_time=6.0), seconds=6.0)
    both = [dataclasses.replace(tasks[0], key="other"), *tasks]
    runner._report(both)
    # 4 and 6 s are done; the usual is 4 s, the mean of 2 and 6.
    assert reports.pop() == (pytest.approx((4 + 6 + 2 + 1) / 18), "2 of 4 runs; run 1, run 2")
    dear = dataclasses.replace(tasks[1], coarser=((tasks[0].key, 1.0),), size=0.5)
    runner._report([tasks[0], dear])
    # Twice as fine is expected to take 4 s, beyond the budget of 3 s, but it is running already.
    assert reports.pop() == (pytest.approx((4 + 2) / 8), "1 of 2 runs; run 1")
    del runner._running[tasks[1].key]
    runner._report([tasks[0], dear])
    assert reports.pop() == (1.0, "1 of 2 runs; ")
    runner._report([tasks[0], dataclasses.replace(dear, size=2 / 3)])
    # 3 s are just the budget: it will be made.
    assert reports.pop() == (pytest.approx(4 / 7), "1 of 2 runs; ")


# ---- what is kept of runs and comparisons comes back as it was, and what a run will cost is estimated from the runs before it


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
    runner = Runner(
        RunCache(tmp_path), jobs=1, time_limit=10.0, budget=5.0, progress=lambda what, share: reports.append((share, what))
    )
    runner.done["a"] = EndedRun(run=make_run(wall_time=2.0), seconds=2.0)
    runner.done["b"] = EndedRun(run=make_run(wall_time=6.0), seconds=6.0)
    runner._running["c"] = 0.5
    runner._report(tasks)
    # 8 s are done, half of c's 2 s; d is expected to take 2 s.
    assert reports == [(pytest.approx(9 / 12), "2 of 4 runs; run c")]


def test_what_is_beyond_the_budget_does_not_hold_the_progress_back(tmp_path, make_run):
    reports = []
    tasks = [RunTask(key="a", engine=None, scenario=None, what="a"), rung(1e-4, (("a", 8e-4),))]
    runner = Runner(
        RunCache(tmp_path), jobs=1, time_limit=10.0, budget=5.0, progress=lambda what, share: reports.append((share, what))
    )
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
