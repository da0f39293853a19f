"""An engine that dies takes nothing with it: the others' results, and what it had computed itself, stay."""

from __future__ import annotations

import threading

import pytest

from looping_pendulum.engines.isolation import run_all, run_isolated
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import ReferenceEngine
from looping_pendulum.engines.trajectory import RunStatus
from looping_pendulum.errors import EngineError
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE
from tests.engines.faulty import FAULT_AT, FaultyEngine

SCENARIO = Scenario(name="s", title="", description="", parameters=TEN_TO_ONE, duration=0.05)
KEPT = round(FAULT_AT * 1000)
"""Samples that come before the fault."""


@pytest.mark.parametrize(
    ("fault", "status", "message"),
    [
        ("segfault", RunStatus.CRASHED, "SIGSEGV"),
        ("exit", RunStatus.CRASHED, "exit status 3"),
        ("hang", RunStatus.TIME_LIMIT, "limit"),
        ("nan", RunStatus.NOT_FINITE, ""),
        ("stretches", RunStatus.STRING_DRIFT, ""),
    ],
)
def test_a_fault_is_reported_as_what_it_was_and_earlier_samples_stay(fault, status, message):
    run = run_isolated(FaultyEngine(fault), SCENARIO, time_limit=3 if fault == "hang" else 60)
    assert run.status is status
    assert message in run.message
    assert len(run.t) in (KEPT, KEPT + 1)  # the sample that shows a stretched string is kept too
    with pytest.raises(EngineError, match=f"faulty:{fault}"):
        run.raise_if_failed()


def test_an_exception_is_a_failed_run_with_its_message_and_traceback():
    run = run_isolated(FaultyEngine("raises"), SCENARIO)
    assert run.status is RunStatus.FAILED
    assert run.message == "ValueError: no rod today"
    assert "Traceback" in run.output
    assert len(run.t) == 0


def test_what_an_engine_prints_is_kept_apart():
    run = run_isolated(FaultyEngine("prints"), SCENARIO)
    assert run.status is RunStatus.FINISHED
    assert "chatter on stdout" in run.output


def test_a_crash_leaves_the_others_results():
    reference = ReferenceEngine("scipy", Profile.QUICK)
    faulty, good = run_all([FaultyEngine("segfault"), reference], SCENARIO)
    assert faulty.status is RunStatus.CRASHED
    assert good.status.ok
    assert len(good.t) == 51


def test_a_missing_package_is_a_gap_with_the_way_out_and_no_process():
    run = run_isolated(FaultyEngine("nan", packages=("no_such_package",)), SCENARIO)
    assert run.status is RunStatus.MISSING
    assert "pip install no_such_package" in run.message


def test_a_release_beyond_an_engines_abilities_is_a_gap():
    scenario = Scenario(name="s", title="", description="", parameters=TEN_TO_ONE.replace(release="drop"), duration=0.05)
    assert run_isolated(FaultyEngine("nan"), scenario).status is RunStatus.UNSUPPORTED


def test_an_effect_that_does_not_reach_an_engine_is_a_gap_not_a_wrong_result():
    for name, value in (("string_thickness", 1e-4), ("friction_per_wrap", 0.1)):
        parameters = TEN_TO_ONE.replace(**{name: value})
        scenario = Scenario(name="s", title="", description="", parameters=parameters, duration=0.05)
        run = run_isolated(FaultyEngine("nan"), scenario)
        assert run.status is RunStatus.UNSUPPORTED
        assert name in run.message
        assert run_isolated(ReferenceEngine("scipy", Profile.QUICK), scenario).status.ok


def test_an_interrupted_run_keeps_what_it_had():
    cancelled = threading.Event()

    def stop_once_it_samples(engine, share):
        if share > 0:
            cancelled.set()

    run = run_isolated(FaultyEngine("hang"), SCENARIO, progress=stop_once_it_samples, cancelled=cancelled, time_limit=60)
    assert run.status is RunStatus.INTERRUPTED
    assert len(run.t) > 0


def test_progress_runs_to_one():
    shares = []
    run_isolated(ReferenceEngine("scipy", Profile.QUICK), SCENARIO, progress=lambda engine, share: shares.append(share))
    assert shares[-1] == 1.0
    assert all(0 <= share <= 1 for share in shares)
