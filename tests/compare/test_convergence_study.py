"""Whole studies: of an engine whose error is known, and of one real ladder."""

import dataclasses
import io
import re
import threading
import warnings
import zipfile

import numpy as np
import pytest
from typer.testing import CliRunner

from looping_pendulum.cli.main import app
from looping_pendulum.compare import run_cache
from looping_pendulum.compare.convergence import report as plots
from looping_pendulum.compare.convergence.report import convergence_markdown
from looping_pendulum.compare.convergence.result import HALT, ConvergenceResult, Verdict
from looping_pendulum.compare.convergence.study import (
    changed_starts,
    cut_to_watched,
    evaluate_variant,
    plan_variant,
    reference_target,
    study_convergence,
    write,
)
from looping_pendulum.compare.run_cache import DamagedRunWarning, RunTask, load_run, make_runs, run_key, store_run
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import select
from looping_pendulum.engines.studies import Ladder, Studies
from looping_pendulum.runs.storage import RECORD, ROW, SAMPLES
from looping_pendulum.runs.trajectory import RunStatus
from looping_pendulum.scenarios import load
from tests.compare.delayed import DelayedEngine

PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def scenario():
    return cut_to_watched(load("ten_to_one"), None)


@pytest.fixture(scope="module")
def targets(scenario):
    starts = changed_starts(scenario)
    return (
        reference_target(scenario, Reference(scenario)),
        {what: reference_target(where, Reference(where)) for what, where in starts},
        starts,
    )


def studied(engine, scenario, targets):
    """Study of one variant, its runs made in this process."""
    reference, moved, starts = targets
    made = plan_variant(engine, scenario, starts)
    return evaluate_variant(made, {task.key: task.engine.simulate(task.scenario) for task in made.tasks()}, reference, moved)


def halting(study):
    """Return the verdicts on the halting time: of the first ladder, and of all ladders."""
    return tuple(next(v for v in verdicts if v.quantity == HALT) for verdicts in (study.ladders[0].verdicts, study.verdicts))


def test_a_first_order_delay_leads_to_the_reference_but_is_not_there(scenario, targets):
    study = studied(DelayedEngine(order=1.0, slope=5.0), scenario, targets)
    ladder, variant = halting(study)
    assert ladder.order == pytest.approx(1.0, abs=0.05)
    assert ladder.limit_error == pytest.approx(0.0, abs=ladder.uncertainty)
    assert (ladder.verdict, variant.verdict) == (Verdict.NOT_CONVERGED, Verdict.NOT_CONVERGED)
    assert study.own.errors[HALT] == pytest.approx(5.0 * 4e-4, abs=2e-6)
    assert variant.refinement == pytest.approx(2e-3, abs=variant.uncertainty)
    assert study.verdicts[1].verdict is Verdict.NOT_CONVERGED, "the path to 0.7 s"
    assert "add finer rungs" in ladder.sentence
    assert "refine time_step further, which changes it by 2 ms" in variant.sentence


def test_a_small_delay_is_converged(scenario, targets):
    study = studied(DelayedEngine(order=2.0, slope=100.0), scenario, targets)
    ladder, variant = halting(study)
    assert (ladder.verdict, variant.verdict) == (Verdict.CONVERGED, Verdict.CONVERGED)
    assert ladder.order == pytest.approx(2.0, abs=0.1)
    assert "0.8 ms is fine enough" in ladder.sentence


def test_an_offset_is_another_limit(scenario, targets):
    ladder, variant = halting(studied(DelayedEngine(order=2.0, slope=100.0, offset=4e-4), scenario, targets))
    assert (ladder.verdict, variant.verdict) == (Verdict.ANOTHER_LIMIT, Verdict.ANOTHER_LIMIT)
    assert ladder.limit_error == pytest.approx(4e-4, abs=ladder.uncertainty)
    assert variant.limit_error == pytest.approx(4e-4, abs=variant.uncertainty)
    assert variant.refinement == pytest.approx(100 * 4e-4**2, abs=variant.uncertainty)


def test_an_offset_that_another_choice_takes_away_names_that_choice(scenario, targets):
    study = studied(DelayedEngine(slope=0.01, offset=4e-4, other_offset=-1e-4), scenario, targets)
    _, variant = halting(study)
    assert variant.verdict is Verdict.ANOTHER_LIMIT
    assert variant.sentence.endswith("try the other choice, when it starts: then")
    assert study.choice(HALT) == pytest.approx(5e-4, abs=3e-6)
    assert study.defaults[0].change[HALT] == pytest.approx(0.01 * 4e-4, abs=2e-6)  # read off to a microsecond each


def test_a_jittering_halt_is_not_converged(scenario, targets):
    study = studied(DelayedEngine(slope=0.0, offset=4e-4, jitter=3e-4), scenario, targets)
    ladder, variant = halting(study)
    assert (ladder.verdict, variant.verdict) == (Verdict.NOT_CONVERGED, Verdict.NOT_CONVERGED)
    assert study.spread[HALT] == pytest.approx(3e-4 / 3**0.5, rel=0.6)  # of a uniform one, from seven runs


def test_the_ladder_of_mujocos_capstan_is_of_second_order(scenario, targets):
    pytest.importorskip("mujoco")
    short = dataclasses.replace(scenario, duration=0.36)
    engine = select(["mujoco:capstan"], Profile.QUICK)[0]
    ladder = next(x for x in engine.studies().ladders if x.setting == "time_step")
    kept = [changes for changes in ladder.changes if changes["time_step"] >= 1e-4]
    engine.studies = lambda: Studies(ladders=(Ladder("time_step", "s", kept),))
    study = studied(engine, short, (dataclasses.replace(targets[0], scenario=short), {}, []))
    verdict = study.ladders[0].verdicts[0]
    assert (verdict.quantity, verdict.verdict) == ("path_0.35s", Verdict.CONVERGED)
    assert verdict.order == pytest.approx(2.0, abs=0.1)
    assert abs(verdict.limit_error) <= verdict.uncertainty  # up to here the law that the adapter feeds in is the reference's


@pytest.fixture
def counted(monkeypatch):
    """Runs are made in this process and counted."""
    made: list[float] = []

    def run(engine, scenario, **_):
        made.append(engine.settings.time_step)
        return engine.simulate(scenario)

    monkeypatch.setattr(run_cache, "run_isolated", run)
    return made


@pytest.fixture
def in_this_process(monkeypatch):
    """Runs are made in this process, which is faster."""
    monkeypatch.setattr(run_cache, "run_isolated", lambda engine, scenario, **_: engine.simulate(scenario))


@pytest.mark.long
def test_a_study_is_kept_and_goes_on(tmp_path, scenario, counted):
    engine = DelayedEngine()
    first = study_convergence(scenario, [engine], tmp_path, jobs=1)
    assert len(counted) == 4 + 6  # rungs, of which one is its own and one the default's; changed starts
    again = study_convergence(scenario, [engine], tmp_path, jobs=1)
    assert len(counted) == 10, "all were kept"
    assert again.variants == first.variants
    next((tmp_path / "runs").iterdir()).write_bytes(b"half a file")
    with pytest.warns(DamagedRunWarning, match="its run is made again"):
        study_convergence(scenario, [engine], tmp_path, jobs=1)
    assert len(counted) == 11, "a damaged file is a run to be made again"
    assert ConvergenceResult.from_json(first.to_json()) == first


@pytest.fixture
def figures_without_pixels(monkeypatch):
    """Make every figure but draw none, which takes a second each: test_figures.py and test_appearance.py draw them."""
    monkeypatch.setattr(plots, "png", lambda figure: b"")


@pytest.mark.long
def test_what_the_report_says_is_what_was_found(tmp_path, scenario, counted, monkeypatch):
    result = study_convergence(scenario, [DelayedEngine()], tmp_path, jobs=1)
    report = write(result, tmp_path).read_text(encoding="utf-8")
    written = {path.name: path.read_bytes() for path in (tmp_path / "figures").iterdir()}
    assert all(picture.startswith(PNG) for picture in written.values())
    monkeypatch.setattr(plots, "png", lambda figure: b"")  # which figures there are is known without drawing them again
    assert written.keys() == plots.draw(result).keys()
    assert "(order 1)" in report
    assert "| delayed:exact | not converged | 0.52 |" in report
    assert "| delayed:exact | step | 0.8 ms | 0.4 ms | lateness | 0.52 |" in report
    assert convergence_markdown(result)


@pytest.mark.long
def test_the_command_writes_all_and_says_how_it_went(tmp_path, in_this_process, figures_without_pixels):
    done = CliRunner().invoke(app, ["converge", "ten_to_one", "-e", "reference", "--until", "0.45", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "- reference: halting_time: converged: all ladders together lead to" in done.output
    assert (tmp_path / "convergence.md").exists()
    result = ConvergenceResult.from_json((tmp_path / "convergence.json").read_text(encoding="utf-8"))
    assert result.until == 0.45
    assert result.variants[0].own.errors["path_0.7s"] is None, "the run ended before"
    assert {one.verdict for one in result.variants[0].verdicts} == {Verdict.CONVERGED}
    assert [one.quantity for one in result.variants[0].verdicts] == ["path_0.35s", "halting_time", "drop_at_halt"]


def test_a_time_limit_leaves_out_what_would_take_longer(tmp_path, scenario, monkeypatch):
    def run(engine, scenario, **_):
        status = RunStatus.TIME_LIMIT if engine.settings.time_step < 3e-4 else RunStatus.FINISHED
        return dataclasses.replace(engine.simulate(scenario), status=status)

    monkeypatch.setattr(run_cache, "run_isolated", run)
    result = study_convergence(scenario, [DelayedEngine()], tmp_path, jobs=1, time_limit=0.6)
    rungs = result.variants[0].ladders[0].rungs
    assert [rung.run.status for rung in rungs] == ["FINISHED", "FINISHED", "TIME_LIMIT", "NOT_RUN"]
    assert result.time_limit == 0.6
    assert "not run: a coarser rung reached the time limit" in convergence_markdown(result)


def archive(**files):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as stored:
        for name, content in files.items():
            stored.writestr({"samples": SAMPLES, "record": RECORD}.get(name, name), content)
    return out.getvalue()


TWO_ROWS = np.tile(np.arange(len(ROW), dtype=float), (2, 1))
DAMAGED = {
    "nothing": b"",
    "text": b"half a file",
    "a zip's begin": b"PK\x03\x04" + bytes(100),  # BadZipFile, which is no ValueError, ended the command
    "another archive": archive(other=b"x"),
    "samples alone": archive(samples=TWO_ROWS.tobytes()),
    "times that stay": archive(samples=TWO_ROWS.tobytes(), record="{}", time_limit="10"),
    "no JSON": archive(samples=b"", record="{", time_limit="10"),
    "a list": archive(samples=b"", record="[]", time_limit="10"),
    "deep": archive(samples=b"", record="[" * 10**5, time_limit="10"),
    "no limit": archive(samples=b"", record="{}", time_limit="long"),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_file_of_a_run_is_a_run_to_be_made_again(tmp_path, scenario, in_this_process, damage):
    engine = DelayedEngine()
    task = RunTask(key=run_key(engine, scenario), engine=engine, scenario=scenario, what="run")
    path = tmp_path / f"{task.key}.zip"
    path.write_bytes(DAMAGED[damage])
    with pytest.warns(DamagedRunWarning, match=f"{re.escape(task.key)}.zip is damaged"):
        done = make_runs([task], tmp_path, jobs=1, time_limit=10.0, cancelled=threading.Event())
    assert done[task.key].status.ok
    again = load_run(path, task, 10.0)  # it has taken the damaged one's place
    assert np.array_equal(again.light_position, done[task.key].light_position)


def test_a_kept_run_cut_anywhere_or_with_a_flipped_bit_is_never_a_traceback(tmp_path, scenario):
    engine = DelayedEngine()
    task = RunTask(key=run_key(engine, scenario), engine=engine, scenario=scenario, what="run")
    path = tmp_path / "run.zip"
    store_run(path, engine.simulate(scenario), 10.0)
    whole, good = path.read_bytes(), load_run(path, task, 10.0)
    rng = np.random.default_rng(1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DamagedRunWarning)
        for _ in range(60):
            data, place = bytearray(whole), int(rng.integers(len(whole)))
            data[place] ^= 1 << int(rng.integers(8))
            for bad in (bytes(data), whole[:place]):
                path.write_bytes(bad)
                cached_run = load_run(path, task, 10.0)
                assert cached_run is None or np.array_equal(cached_run.light_position, good.light_position)
