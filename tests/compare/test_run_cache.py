"""Names of runs, what is kept of them, and how many are made: by engines that are nothing but their settings."""

import dataclasses
import hashlib
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import scipy

from looping_pendulum import versions
from looping_pendulum.compare import run_cache
from looping_pendulum.compare.run_cache import EndedRun, RunCache, Runner, RunTask, run_key
from looping_pendulum.engines.trajectory import RunStatus
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
    runner = Runner(RunCache(tmp_path), jobs=1, time_limit=9.0, budget=3.0, progress=lambda *what: reports.append(what))
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
