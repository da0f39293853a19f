"""A run of the stored study of the engines' errors, made again."""

import pytest

from looping_pendulum.engines.reference import Reference
from looping_pendulum.scenarios import load
from research.stored_study import SUMMARY, read
from research.study_sample import measured_again, same, stored_runs


@pytest.mark.long
def test_a_stored_run_is_made_again_and_stands():
    # Oracle: the stored figures of the capstan variant's own settings, which take 0.06 s per s.
    pytest.importorskip("mujoco")
    runs = {run.name: run for run in stored_runs(read(SUMMARY.read_text(encoding="utf-8")), budget=1.0)}
    run = runs["mujoco:capstan, its own settings"]
    again = measured_again(run, Reference(load("ten_to_one")))
    assert all(same(run.summary.errors[name], value) for name, value in again.items())
    assert any("left out" in name for name in runs), "choices are among them"
    assert any("time_step" in name for name in runs), "rungs are among them"
