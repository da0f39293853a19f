"""The stored study of the engines' errors: its tables and figures, and how single variants are renewed in it."""

import csv
import dataclasses

import pytest

from benchmarks.engine_study_page import ERRORS, FILES, cells, data_files, kind_of_ladder, ladder_line
from benchmarks.stored_study import SUMMARY, EngineStudy, Point, front, read, renewed, runs_of
from benchmarks.study_sample import measured_again, same, stored_runs
from looping_pendulum.compare.convergence.result import HALT
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import ADAPTERS, all_engines, label
from looping_pendulum.pages.markdown import table
from looping_pendulum.scenarios import load


@pytest.fixture(scope="module")
def study() -> EngineStudy:
    return read(SUMMARY.read_text(encoding="utf-8"))


def only(study: EngineStudy, *labels: str) -> EngineStudy:
    """The study of some variants alone, measured on a later day."""
    result = study.convergence
    variants = tuple(v for v in result.variants if v.label in labels)
    keys = {run.key for v in variants for run in runs_of(v)}
    times = tuple(one for one in result.clock.run_times if one.key in keys)
    return EngineStudy(
        convergence=dataclasses.replace(
            result, variants=variants, clock=dataclasses.replace(result.clock, written="2030-01-02T03:04:05", run_times=times)
        ),
        pareto=tuple(p for p in study.pareto if p.variant in labels),
        measurements=tuple(dataclasses.replace(m, errors="2030-01-02") for m in study.measurements if m.variant in labels),
    )


def test_each_table_has_a_cell_under_every_heading(study):
    tables = data_files(study)
    assert set(tables) == set(FILES)
    for name, text in tables.items():
        rows = list(csv.reader(text.splitlines()))
        assert {len(row) for row in rows} == {len(rows[0])}, name
        assert all(rows[0]), name


def test_a_cell_of_a_table_may_have_a_bar():
    assert cells("## a | b\n\n" + table(["x", "y"], [["a|b", "1"], ["", "2"]])) == [["x", "y"], ["a|b", "1"], ["", "2"]]


def test_a_ladder_is_drawn_against_the_variants_own_setting(study):
    (v,) = (v for v in study.convergence.variants if v.label == "mujoco:drum")
    (steps,) = (ladder for ladder in v.ladders if ladder.setting == "time_step")
    refinement, errors = ladder_line(v, steps)
    at_own = dict(zip(refinement, errors, strict=True))[1.0]
    assert at_own == pytest.approx(1e3 * v.own.rms["path_0.7s"])
    assert refinement == sorted(refinement)
    assert min(errors) == ERRORS[0], "errors below the axis are drawn on its edge"


@pytest.mark.parametrize(
    ("setting", "kind"),
    [
        ("time_step", "time step"),
        ("bend", "link length"),
        ("solver_iterations", "solver's effort"),
        ("stiction_tolerance", "softness"),
        ("tolerance", "solver's effort"),
        ("bead_mass_ratio", "string's mass"),
        ("weather", "other"),
    ],
)
def test_kinds_of_ladders(setting, kind):
    assert kind_of_ladder(setting) == kind


def test_every_variant_is_in_the_study(study):
    own = {label(engine) for engine in all_engines(Profile.QUICK) if engine.name in ADAPTERS}
    assert own <= {v.label for v in study.convergence.variants}, "make it again: python -m benchmarks.engine_study"


@pytest.mark.long
def test_stored_numbers_read_back(study):
    assert read(study.to_json()) == study


def test_a_renewed_variant_takes_its_place_and_the_others_stay(study):
    name = "mujoco:beads"
    new = only(study, name)
    (before,) = new.convergence.variants
    # Of other settings: its run at its own ones has another key, and the former one is not in the study any more
    again = dataclasses.replace(before, own=dataclasses.replace(before.own, key="anew"), ladders=(), starts=())
    new = dataclasses.replace(new, convergence=dataclasses.replace(new.convergence, variants=(again,)), pareto=())
    result = renewed(study, new)
    assert [v.label for v in result.convergence.variants] == [v.label for v in study.convergence.variants]
    assert [v for v in result.convergence.variants if v.label != name] == [
        v for v in study.convergence.variants if v.label != name
    ]
    assert again in result.convergence.variants
    assert result.pareto == tuple(p for p in study.pareto if p.variant != name)
    assert {m.variant for m in result.measurements if m.errors == "2030-01-02"} == {name}
    known = {one.key for one in result.convergence.clock.run_times}
    assert before.own.key in {one.key for one in study.convergence.clock.run_times} - known
    assert known <= {run.key for v in result.convergence.variants for run in runs_of(v)}


def test_an_added_variant_stands_behind_the_others(study):
    name = "pymunk:chain"
    others = [v.label for v in study.convergence.variants if v.label != name]
    result = renewed(only(study, *others), only(study, name))
    assert [v.label for v in result.convergence.variants] == [*others, name]
    assert [m.variant for m in result.measurements] == [*others, name]
    assert sorted(result.pareto, key=lambda p: p.key) == sorted(study.pareto, key=lambda p: p.key)
    assert result.convergence.clock.run_times == study.convergence.clock.run_times


@pytest.mark.parametrize("change", ["budget", "reference_values"])
def test_a_study_made_otherwise_is_refused(study, change):
    new = only(study, "pymunk:chain")
    values = study.convergence.reference_values
    moved = {
        "budget": {"budget": 20.0},
        "reference_values": {"reference_values": {**values, HALT: values[HALT] + 2 * study.convergence.floors[HALT]}},
    }[change]
    new = dataclasses.replace(new, convergence=dataclasses.replace(new.convergence, **moved))
    with pytest.raises(ValueError, match=r"budget: found 20|reference: halting_time"):
        renewed(study, new)


def test_points_that_nothing_beats():
    base = Point(variant="a", where="", key="", contact=True, rms=1.0, wall=1.0, cpu=1.0, runs=1, slowest=1.0)
    fast, near, beaten = (dataclasses.replace(base, cpu=seconds, rms=e) for seconds, e in ((0.5, 2.0), (2.0, 0.5), (2.5, 0.6)))
    assert front([beaten, near, base, fast]) == [fast, base, near]


# ---- a sample of the engine study measured again: which stored runs can be made again, and when an error counts as the same


@pytest.mark.parametrize(
    ("stored", "again", "expected"),
    [(1e-3, 1.009e-3, True), (1e-3, 1.02e-3, False), (1e-12, 5e-10, True), (None, None, True), (None, 1e-3, False)],
)
def test_errors_are_the_same_within_a_hundredth(stored, again, expected):
    assert same(stored, again) is expected


@pytest.mark.long
def test_a_stored_run_is_made_again_and_stands():
    # Oracle: the stored figures of the capstan variant's own settings, which take 0.06 s per s.
    pytest.importorskip("mujoco")
    runs = {run.name: run for run in stored_runs(read(SUMMARY.read_text(encoding="utf-8")), budget=1.0)}
    run = runs["mujoco:capstan, its own settings"]
    again = measured_again(run, Reference(load("ten_to_one")))
    assert all(same(stored, again[name]) for name, stored in run.summary.rms.items())
    assert any("left out" in name for name in runs), "choices are among them"
    assert any("time_step" in name for name in runs), "rungs are among them"
