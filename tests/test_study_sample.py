"""A sample of the engine study measured again: which stored runs can be made again, and when an error counts as the same."""

import pytest

from benchmarks.stored_study import SUMMARY, read
from benchmarks.study_sample import measured_again, same, stored_runs
from looping_pendulum.engines.reference import Reference
from looping_pendulum.scenarios import load


@pytest.mark.parametrize(
    ("stored", "again", "expected"),
    [(1e-3, 1.009e-3, True), (1e-3, 1.02e-3, False), (1e-12, 5e-10, True), (None, None, True), (None, 1e-3, False)],
)
def test_errors_are_the_same_within_a_hundredth(stored, again, expected):
    assert same(stored, again) is expected


def test_a_stored_run_is_made_again_and_stands():
    # Oracle: the stored figures of the capstan variant's own settings, which take 0.06 s per s.
    pytest.importorskip("mujoco")
    runs = {run.name: run for run in stored_runs(read(SUMMARY.read_text(encoding="utf-8")), budget=1.0)}
    run = runs["mujoco:capstan, its own settings"]
    again = measured_again(run, Reference(load("ten_to_one")))
    assert all(same(stored, again[name]) for name, stored in run.summary.rms.items())
    assert any("left out" in name for name in runs), "choices are among them"
    assert any("time_step" in name for name in runs), "rungs are among them"
