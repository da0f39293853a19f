"""Names of runs, what is kept of them, and which are made: by engines that are nothing but their settings."""

import dataclasses
import hashlib
import math
import sys
import threading
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import scipy

from looping_pendulum import versions
from looping_pendulum.compare import compare, run_cache, write
from looping_pendulum.compare.run_cache import RunTask, load_run, make_runs, run_key, store_run
from looping_pendulum.compare.trajectories import stored_result
from looping_pendulum.engines.reference import Reference
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.runs.trajectory import COLUMNS, RunStatus
from tests.compare.delayed import DelayedEngine


@pytest.fixture
def tasks(scenario):
    """Three tasks of three engines."""
    engines = [DelayedEngine(offset=1e-3 * k) for k in range(3)]
    return [RunTask(key=run_key(e, scenario), engine=e, scenario=scenario, what=f"run {k}") for k, e in enumerate(engines)]


@pytest.fixture
def made_by(make_run):
    """A run of the closed form as an engine would make it: only then is it taken for that engine's."""

    def make(engine, scenario, **fields):
        names = {"engine": engine.name, "variant": engine.variant, "profile": engine.profile.value, "scenario": scenario.name}
        return make_run(**names, **fields)

    return make


@pytest.fixture
def made(monkeypatch, made_by):
    """Engines and limits of the runs that are made; they are of the closed form."""
    asked = []

    def run(engine, scenario, *, progress, **limits):
        asked.append((engine, limits))
        progress(engine, 0.25)
        return made_by(engine, scenario, status=RunStatus.FINISHED)

    monkeypatch.setattr(run_cache, "run_isolated", run)
    return asked


def runs_of(tasks, folder, *, time_limit=7.0, cancelled=None, **options):
    return make_runs(tasks, folder, **{"jobs": 1} | options, time_limit=time_limit, cancelled=cancelled or threading.Event())


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
def test_a_run_that_a_shorter_time_limit_has_cut_is_made_again(tmp_path, tasks, made_by, limit, asked, taken):
    path = tmp_path / "run.zip"
    store_run(path, made_by(tasks[0].engine, tasks[0].scenario, until=0.2, status=RunStatus.TIME_LIMIT), limit)
    assert (load_run(path, tasks[0], asked) is not None) is taken
    store_run(path, made_by(tasks[0].engine, tasks[0].scenario), limit)
    assert load_run(path, tasks[0], 2 * asked) is not None, "one that came to its end did not need the limit"


def test_a_kept_run_comes_back_whole(tmp_path, tasks, made_by):
    path = tmp_path / "run.zip"
    slip = np.linspace(0, 1, 1051)
    run = made_by(tasks[0].engine, tasks[0].scenario, message="as said", wall_time=2.5, status=RunStatus.LIGHT_REACHED_ROD)
    store_run(path, dataclasses.replace(run, string_slip=slip), 10.0)
    again = load_run(path, tasks[0], 10.0)
    assert (again.status, again.message, again.wall_time) == (run.status, "as said", 2.5)
    assert again.provenance.versions == run.provenance.versions
    assert again.label == run.label
    np.testing.assert_array_equal(again.string_slip, slip)
    for name in ("t", "light_position", "light_velocity", "heavy_position", "heavy_velocity", "string_stretch"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))


def test_a_kept_run_without_samples_slip_or_a_wall_time_comes_back_so(tmp_path, tasks, made_by):
    path = tmp_path / "run.zip"
    empty = made_by(tasks[0].engine, tasks[0].scenario, samples=np.empty((0, len(COLUMNS))), status=RunStatus.CRASHED)
    store_run(path, dataclasses.replace(empty, wall_time=math.nan), 10.0)
    again = load_run(path, tasks[0], 10.0)
    assert len(again.t) == 0
    assert again.string_slip is None
    assert math.isnan(again.wall_time)


def test_every_run_is_made_once_and_what_is_kept_not_again(tmp_path, tasks, made):
    done = runs_of([*tasks, tasks[0]], tmp_path, memory_limit=123)
    assert [engine for engine, _ in made] == [task.engine for task in tasks], "in their order, a task that is there twice once"
    assert set(done) == {task.key for task in tasks}
    assert [(limits["time_limit"], limits["memory_limit"]) for _, limits in made] == [(7.0, 123)] * 3
    assert set(runs_of(tasks, tmp_path, jobs=2)) == set(done)
    assert len(made) == 3


@pytest.mark.parametrize("status", [RunStatus.MISSING, RunStatus.MEMORY_LIMIT])
def test_runs_that_are_worth_another_try_are_not_kept(tmp_path, tasks, monkeypatch, make_run, status):
    monkeypatch.setattr(run_cache, "run_isolated", lambda *_, **__: make_run(until=0.2, status=status))
    done = runs_of(tasks[:1], tmp_path)
    assert done[tasks[0].key].status is status
    assert not list(tmp_path.iterdir())


def test_rungs_finer_than_one_that_reached_the_time_limit_are_left_out(tmp_path, tasks, monkeypatch, made_by):
    """The second of three rungs takes too long: the third is not begun, another ladder's run is; a longer limit makes all."""
    coarse, middle, other = tasks
    middle = dataclasses.replace(middle, coarser=(coarse.key,))
    fine = dataclasses.replace(other, key="fine", coarser=(coarse.key, middle.key))
    begun = []

    def run(engine, scenario, *, time_limit, **_):
        begun.append(engine)
        slow = engine is middle.engine and time_limit < 9.0
        return made_by(engine, scenario, **({"until": 0.2, "status": RunStatus.TIME_LIMIT} if slow else {}))

    monkeypatch.setattr(run_cache, "run_isolated", run)
    reports = []
    done = runs_of([coarse, middle, fine, other], tmp_path, progress=lambda what, share: reports.append((what, share)))
    assert set(done) == {coarse.key, middle.key, other.key}
    assert reports[-1] == ("3 of 4 runs; ", 1.0), "what is left out does not hold the progress back"
    assert len(begun) == 3
    assert set(runs_of([coarse, middle, fine, other], tmp_path)) == set(done), "the cut run is kept"
    assert len(begun) == 3
    assert len(runs_of([coarse, middle, fine, other], tmp_path, time_limit=9.0)) == 4
    assert len(begun) == 5


def test_after_an_interrupt_no_run_is_begun_and_the_cut_one_is_not_done(tmp_path, tasks, monkeypatch, made_by):
    begun, interrupted = [], threading.Event()

    def run(engine, scenario, *, cancelled, **_):
        begun.append(engine)
        if len(begun) == 2:
            cancelled.set()
            return made_by(engine, scenario, until=0.2, status=RunStatus.INTERRUPTED)
        return made_by(engine, scenario)

    monkeypatch.setattr(run_cache, "run_isolated", run)
    assert set(runs_of(tasks, tmp_path, cancelled=interrupted)) == {tasks[0].key}
    assert len(begun) == 2
    assert interrupted.is_set()
    assert set(runs_of(tasks, tmp_path)) == {task.key for task in tasks}
    assert len(begun) == 4


def test_there_are_as_many_jobs_as_are_asked_for_or_as_there_are_cores(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(run_cache, "core_count", lambda: 8)
    monkeypatch.setattr(run_cache, "run_many", lambda calls, jobs, **_: asked.append(jobs))
    for jobs in (3, None):
        runs_of([], tmp_path, jobs=jobs)
    assert asked == [3, 8]


def test_progress_names_the_runs_that_go_on_and_counts_their_shares(tmp_path, tasks, monkeypatch, make_run):
    reports, go_on = [], threading.Event()

    def run(engine, scenario, *, progress, **_):
        progress(engine, 0.5)
        assert go_on.wait(10.0)
        return make_run()

    def told(what, share):
        reports.append((what, share))
        if share >= 0.5:
            go_on.set()

    monkeypatch.setattr(run_cache, "run_isolated", run)
    runs_of(tasks[:2], tmp_path, jobs=2, progress=told)
    assert {("0 of 2 runs; run 0, run 1", 0.5), ("0 of 2 runs; run 1, run 0", 0.5)} & set(reports)
    assert reports[-1] == ("2 of 2 runs; ", 1.0)
    runs_of([], tmp_path, progress=told)
    assert reports[-1] == ("2 of 2 runs; ", 1.0), "without a run there is nothing to tell"


# ---- comparisons that are kept come back as they were


@pytest.fixture(autouse=True)
def no_figures(monkeypatch):
    """Nothing here looks at figures, and they take a second each time."""
    monkeypatch.setattr("looping_pendulum.compare.figures.charts", lambda result: [])
    monkeypatch.setattr("looping_pendulum.compare.report.render_page", lambda *_: "")


@pytest.fixture
def stored(tmp_path, scenario, make_run, missing):
    """A folder with a comparison, the result, and the engines that it is of."""
    engines = [DelayedEngine(), DelayedEngine(order=2.0)]
    scenario = dataclasses.replace(scenario, name="ten_to_one")
    pulled = make_run(
        shift=(3e-3, 0.0),
        mode=np.full(1051, Mode.SLIDING_UP, dtype=np.int8),
        light_tension=np.linspace(0, 1, 1051),
        heavy_tension=np.linspace(2, 3, 1051),
    )
    result = compare(scenario, Reference(scenario), [pulled, missing])
    result = dataclasses.replace(result, run_keys=tuple(run_key(e, scenario) for e in engines))
    write(result, tmp_path)
    return tmp_path, scenario, engines, result


def test_a_stored_comparison_comes_back_with_its_trajectories(stored):
    # Oracle: the result itself. Bound: nine significant digits in the CSV; the reference is solved again.
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
    np.testing.assert_array_equal(again.samples.reference.light_tension, result.samples.reference.light_tension)
    assert [e.name for e in again.samples.reference.events] == [name for name, _ in result.reference.events]
    assert pulled.provenance.settings == result.engines[0].provenance.settings


@pytest.mark.parametrize(
    "changes", [{"title": "other"}, {"description": "other"}, {"duration": 1.0}, {"name": "other"}, {"parameters": None}]
)
def test_a_comparison_of_another_scenario_is_not_taken(stored, changes):
    folder, scenario, engines, _ = stored
    if "parameters" in changes:
        changes = {"parameters": scenario.parameters.replace(light_mass=0.011)}
    for asked_for in (engines, None):
        assert stored_result(folder, dataclasses.replace(scenario, **changes), asked_for) is None


def test_a_comparison_of_other_engines_or_of_a_run_cut_short_is_not_taken(stored):
    folder, scenario, engines, result = stored
    assert stored_result(folder, scenario, None) == result, "of any engines, where none are asked for"
    assert stored_result(folder, scenario, engines[:1]) is None
    assert stored_result(folder, scenario, engines[::-1]) is None
    for status in ("INTERRUPTED", "TIME_LIMIT", "MEMORY_LIMIT"):
        cut = dataclasses.replace(result.engines[0], status=status)
        write(dataclasses.replace(result, engines=(cut, result.engines[1])), folder)
        assert stored_result(folder, scenario, engines) is None


@pytest.mark.parametrize(
    ("file", "damaged"),
    [
        ("result.json", lambda text: "{"),
        ("result.json", lambda text: "{}"),
        ("trajectories/pymunk-chain-quick.csv", lambda text: "t [s]\n0\n"),
        ("trajectories/pymunk-chain-quick.csv", lambda text: text.replace("light_x", "left_x", 1)),
    ],
)
def test_a_stored_comparison_with_a_damaged_or_missing_file_is_not_taken(stored, file, damaged):
    folder, scenario, engines, _ = stored
    path = folder / file
    path.write_text(damaged(path.read_text()))
    assert stored_result(folder, scenario, engines) is None
    path.unlink()
    assert stored_result(folder, scenario, engines) is None
