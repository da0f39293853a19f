"""An engine that dies takes nothing with it: the others' results, and what it had computed itself, stay."""

import math
import os
import re
import subprocess
import sys
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum import processes
from looping_pendulum.compare import compare, write
from looping_pendulum.engines.isolation import run_all, run_isolated
from looping_pendulum.engines.protocol import Profile, known_fields
from looping_pendulum.engines.reference import Reference, ReferenceEngine
from looping_pendulum.errors import EngineError
from looping_pendulum.runs.storage import read_run, read_samples, recording, write_run
from looping_pendulum.runs.trajectory import COLUMNS, Provenance, RunStatus, TrajectoryEvent, from_samples
from looping_pendulum.scenarios import load
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE
from tests.compare.conftest import SUPPLIES
from tests.engines.faulty import FAULT_AT, FaultyEngine, alive

SCENARIO = Scenario(name="s", title="", description="", parameters=TEN_TO_ONE, duration=0.05)
KEPT = round(FAULT_AT * 1000)
"""Samples that come before the fault."""


FAULTS = {
    "segfault": (RunStatus.CRASHED, KEPT, "SIGSEGV"),
    "exit": (RunStatus.CRASHED, KEPT, "exit status 3"),
    "hang": (RunStatus.TIME_LIMIT, KEPT, "limit 600 s"),
    "memory": (RunStatus.MEMORY_LIMIT, KEPT, r"held 3\d\d MiB, limit 300 MiB"),
    "nan": (RunStatus.NOT_FINITE, KEPT, ""),
    "stretches": (RunStatus.STRING_DRIFT, KEPT + 1, ""),  # the sample that shows the stretched string is kept too
    "flies_off": (RunStatus.OUT_OF_REACH, KEPT, ""),
    "raises": (RunStatus.FAILED, 0, "ValueError: no rod today"),
    "gives_up": (RunStatus.FAILED, KEPT, "^found a wrap"),
    "prints": (RunStatus.FINISHED, 51, ""),
    "prints_from_c": (RunStatus.FINISHED, 51, ""),
    "returns_nan": (RunStatus.NOT_FINITE, 51, ""),
    "returns_nothing": (RunStatus.FAILED, 51, "needed a Trajectory"),
}
"""What an engine does -> how its run ends, how many of its samples stay, and what is said of it."""
GOOD = [ReferenceEngine(Profile.QUICK), FaultyEngine("none")]


class LeapingClock:
    """The clock that time limits are read from, with leaps, so that no test waits for the limit of an engine that hangs.

    Each run has its thread, so a leap in one is not seen by the others.
    """

    def __init__(self) -> None:
        self._thread = threading.local()
        self.sleep, self.thread_time = time.sleep, time.thread_time

    def monotonic(self) -> float:
        return time.monotonic() + getattr(self._thread, "ahead", 0.0)

    def leap(self) -> None:
        self._thread.ahead = getattr(self._thread, "ahead", 0.0) + 3600.0


def hangs(engine, share):
    """Whether the engine that hangs has sampled all that it will; ``share`` of the scenario is done."""
    return engine.variant == "hang" and share * (round(SCENARIO.duration * 1000) + 1) > KEPT - 0.5


@pytest.fixture(scope="module")
def at_once():
    """Run all faulty engines in parallel, between two without a fault, and return variant -> run."""
    engines = [GOOD[0], *(FaultyEngine(fault) for fault in FAULTS), GOOD[1]]
    clock = LeapingClock()

    def leap_where_it_hangs(engine, share):
        if hangs(engine, share):
            clock.leap()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(processes, "time", clock)
        runs = run_all(
            engines,
            SCENARIO,
            jobs=2,
            time_limit=600,
            memory_limit=300 * 1024**2,
            progress=leap_where_it_hangs,
        )
    return {run.variant: run for run in runs}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_reported_as_what_it_was_and_earlier_samples_stay(at_once, fault):
    run, (status, kept, message) = at_once[fault], FAULTS[fault]
    assert run.status is status
    assert len(run.t) == kept
    assert re.search(message, run.message)
    if not status.ok:
        with pytest.raises(EngineError, match=f"faulty:{fault}"):
            run.raise_if_failed()


def test_an_exception_leaves_its_traceback(at_once):
    assert "Traceback" in at_once["raises"].output


def test_an_adapter_that_says_why_it_gives_up_leaves_that_line_alone(at_once):
    assert at_once["gives_up"].output == ""


def test_what_an_engine_prints_is_kept_apart(at_once, capfd):
    assert "chatter on stdout" in at_once["prints"].output
    assert "chatter on fd 1" in at_once["prints_from_c"].output
    assert "chatter of printf" in at_once["prints_from_c"].output
    run_isolated(FaultyEngine("prints_from_c"), SCENARIO)
    assert capfd.readouterr() == ("", "")


def test_the_memory_limit_says_how_to_raise_it(at_once):
    assert re.fullmatch(FAULTS["memory"][2], at_once["memory"].message)
    assert "--memory-limit" in at_once["memory"].status


def finite(run):
    """Return the samples of a run that are numbers; of an engine that returns NaN, the first `KEPT`."""
    return run.light_position[: KEPT if run.variant == "returns_nan" else len(run.t)]


def test_every_fault_at_once_leaves_the_others_results(at_once, tmp_path):
    runs = list(at_once.values())
    alone = [run_isolated(engine, SCENARIO) for engine in GOOD]
    result = compare(SCENARIO, Reference(SCENARIO), runs)
    by_themselves = compare(SCENARIO, Reference(SCENARIO), alone)
    for beside, lone in ((0, 0), (-1, 1)):  # every bit: the same code on the same processor, each in a process of its own
        assert runs[beside].light_position.tobytes() == alone[lone].light_position.tobytes()
        assert result.engines[beside] == by_themselves.engines[lone]
    for run in runs[1:-1]:
        assert np.isfinite(finite(run)).all()
        assert finite(run).tobytes() == alone[1].light_position[: len(finite(run))].tobytes()
    report = write(result, tmp_path).read_text()
    assert "stopped by its memory limit; raise --memory-limit" in report
    assert all(f"faulty:{fault}" in report for fault in FAULTS)


@pytest.mark.long
def test_an_engine_that_never_stops_printing_fills_no_disk(monkeypatch):
    monkeypatch.setattr(processes, "OUTPUT_LIMIT", 10)
    run = run_isolated(FaultyEngine("hang_after_print"), SCENARIO, time_limit=3)
    assert run.status is RunStatus.TIME_LIMIT
    assert run.output == ""


def test_an_engine_that_cannot_travel_is_a_failed_run():
    engine = FaultyEngine("nan")
    engine.handle = threading.Lock()
    run = run_isolated(engine, SCENARIO)
    assert run.status is RunStatus.FAILED
    assert "cannot be pickled" in run.message


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="POSIX process groups")
def test_what_an_engine_started_ends_with_it(tmp_path, monkeypatch):
    clock = LeapingClock()

    def leap_once_it_has_a_child(engine, share):
        if any(output.read_bytes().endswith(b"\n") for output in tmp_path.glob("*/output.txt")):
            clock.leap()

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(processes, "time", clock)
    run = run_isolated(FaultyEngine("hang_with_child"), SCENARIO, progress=leap_once_it_has_a_child)
    assert run.status is RunStatus.TIME_LIMIT
    child = int(run.output.split()[-1])
    assert not alive(child)


def test_held_memory_sees_what_a_process_takes():
    """In a process of its own: one that has run other tests may give some of theirs back in between."""
    code = (
        "import os; from looping_pendulum.processes import ProcessTree\n"
        "tree = ProcessTree(os.getpid())\n"
        "before = tree.memory(); block = b'x' * 2**28; print((tree.memory() - before) / len(block))"
    )
    share = float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)
    assert 0.9 < share < 1.1


def test_a_missing_package_is_a_gap_with_the_way_out_and_no_process():
    run = run_isolated(FaultyEngine("nan", packages=("no_such_package",)), SCENARIO)
    assert run.status is RunStatus.MISSING
    assert "pip install no_such_package" in run.message


def test_a_release_beyond_an_engines_abilities_is_a_gap():
    scenario = Scenario(name="s", title="", description="", parameters=TEN_TO_ONE.replace(release="drop"), duration=0.05)
    assert run_isolated(FaultyEngine("nan"), scenario).status is RunStatus.UNSUPPORTED


def test_an_effect_that_does_not_reach_an_engine_is_a_gap_not_a_wrong_result():
    effects = {"string_thickness": 1e-4, "friction_per_wrap": 0.1}

    def with_effects(**effects):
        parameters = TEN_TO_ONE.replace(**effects)
        return Scenario(name="s", title="", description="", parameters=parameters, duration=0.05)

    for name, value in effects.items():
        run = run_isolated(FaultyEngine("nan"), with_effects(**{name: value}))
        assert run.status is RunStatus.UNSUPPORTED
        assert name in run.message
    assert run_isolated(ReferenceEngine(Profile.QUICK), with_effects(**effects)).status.ok


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
    run_isolated(FaultyEngine("none"), SCENARIO, progress=lambda engine, share: shares.append(share))
    assert shares[-1] == 1.0
    assert all(0 <= share <= 1 for share in shares)


@pytest.mark.long
@pytest.mark.parametrize("jobs", [1, 3])
def test_runs_come_back_in_the_order_given(jobs):
    variants = ["stretches", "none", "prints"]
    runs = run_all([FaultyEngine(fault) for fault in variants], SCENARIO, jobs=jobs)
    assert [run.variant for run in runs] == variants


def test_runs_that_have_ended_are_handed_over_while_others_go_on():
    handed, other_hangs = [], threading.Event()

    def notice(engine, share):
        if hangs(engine, share):
            other_hangs.set()

    def stop_the_others(ended):
        handed.append([run.variant for run in ended])
        assert other_hangs.wait(60)
        raise KeyboardInterrupt  # also in the middle of what is done with them, it keeps every sample

    engines = [FaultyEngine("hang"), FaultyEngine("none")]
    runs = run_all(engines, SCENARIO, jobs=2, progress=notice, meanwhile=stop_the_others, time_limit=60)
    assert handed == [["none"]]
    assert [run.status for run in runs] == [RunStatus.INTERRUPTED, RunStatus.FINISHED]
    assert len(runs[0].t) == KEPT


# ---- what an engine of somebody else's may return: refused where it ran, with the field, what was found and what was needed


ENGINE = FaultyEngine("none")
N = 51


@pytest.fixture(scope="module")
def good():
    return ENGINE.simulate(SCENARIO)


SPOILED = {
    "complex": lambda run: {"light_position": run.light_position.astype(complex)},
    "text": lambda run: {"light_position": run.light_position.astype(str)},
    "objects": lambda run: {"light_velocity": np.full((N, 2), None)},
    "booleans": lambda run: {"free_length": np.ones(N, dtype=bool)},
    "flat": lambda run: {"light_position": run.light_position.ravel()},
    "transposed": lambda run: {"heavy_position": run.heavy_position.T},
    "three columns": lambda run: {"heavy_velocity": np.zeros((N, 3))},
    "one short": lambda run: {"wrap_angle": run.wrap_angle[:-1]},
    "a number": lambda run: {"string_stretch": 0.0},
    "ragged": lambda run: {"light_position": [[0.0, 0.0]] * (N - 1) + [[0.0]]},
    "tension of another length": lambda run: {"light_tension": np.zeros(N + 1)},
    "times in a table": lambda run: {"t": run.t.reshape(-1, 1)},
    "times that fall": lambda run: {"t": run.t[::-1]},
    "times that stay": lambda run: {"t": np.zeros(N)},
    "times without number": lambda run: {"t": np.full(N, np.nan)},
    "times before release": lambda run: {"t": run.t - 1},
    "milliseconds": lambda run: {"t": 1e3 * run.t},
    "unknown mode": lambda run: {"mode": np.full(N, 77)},
    "mode between": lambda run: {"mode": np.full(N, 0.5)},
    "mode that wraps": lambda run: {"mode": np.full(N, 256)},  # 0 as an int8
    "modes by name": lambda run: {"mode": np.full(N, "sticking")},
    "event as a pair": lambda run: {"events": ((0.1, "stop"),)},
    "event at no time": lambda run: {"events": (TrajectoryEvent(time=float("nan"), name="stop"),)},
    "event without a list": lambda run: {"events": TrajectoryEvent(time=0.1, name="stop")},
    "status as text": lambda run: {"status": "finished"},
    "another's name": lambda run: {"engine": "mujoco"},
    "no provenance": lambda run: {"provenance": None},
    "versions as numbers": lambda run: {"provenance": replace(run.provenance, versions={"toy": 1.0})},
    "settings as a dataclass": lambda run: {"provenance": replace(run.provenance, settings=ENGINE.settings)},
    "supplies as text": lambda run: {
        "provenance": replace(run.provenance, supplies=replace(run.provenance.supplies, drag="the engine"))
    },
    "supplies of another kind": lambda run: {"provenance": Provenance(versions={}, settings={}, supplies=SimpleNamespace())},
    "wall time as text": lambda run: {"wall_time": "0.1 s"},
    "CPU time as text": lambda run: {"cpu_time": "0.1 s"},
    "message as bytes": lambda run: {"message": b"done"},
    "no sample": lambda run: {name: value[:0] for name, value in vars(run).items() if isinstance(value, np.ndarray)},
}
"""What is wrong -> the fields of a run, as an adapter's author may get one wrong."""


def through_files(run, folder):
    """Return ``run`` as its files give it back."""
    write_run(folder, run)
    return read_run(folder, parameters=TEN_TO_ONE, duration=SCENARIO.duration, **known_fields(ENGINE, SCENARIO))


@pytest.mark.parametrize("what", SPOILED)
def test_a_wrong_field_is_named_with_what_was_found_and_needed(good, what, tmp_path):
    with pytest.raises(EngineError, match=r"^simulate returned [a-z_.0-9]+: found .*, needed [^\n]+$"):
        through_files(replace(good, **SPOILED[what](good)), tmp_path)


def test_a_good_run_comes_back_as_it_was_even_of_other_kinds_of_numbers(good, tmp_path):
    for run in (good, replace(good, light_position=good.light_position.tolist(), mode=good.mode.astype(float))):
        back = through_files(run, tmp_path)
        assert back.mode.dtype == np.int8
        assert all(np.array_equal(getattr(back, name), getattr(good, name), equal_nan=True) for name in ("t", "mode"))
        assert np.array_equal(back.light_position, good.light_position)
    for value in (np.nan, np.inf, -np.inf, 1e308):
        lost = through_files(replace(good, light_position=np.full((N, 2), value)), tmp_path)
        assert lost.status is RunStatus.NOT_FINITE
        assert np.isnan(lost.light_position).all()


def test_a_sample_of_another_length_is_refused_before_it_shifts_the_others(tmp_path):
    with recording(tmp_path) as record, pytest.raises(EngineError, match="found 10 values with its time, needed 11"):
        record([0.0] * 10)
    assert len(read_samples(tmp_path, duration=1.0)) == 0


# ---- what a reading says of the string's slip survives a run's file, its cache and its CSV


PARAMETERS = load("ten_to_one").parameters
SHORT = (0.0, 0.1, -0.2, 0.0, 0.0, 0.00625, -0.4, 0.0, 0.0, 1e-4)


def trajectory(rows):
    return from_samples(
        rows,
        parameters=PARAMETERS,
        engine="toy",
        variant="toy",
        profile="quick",
        scenario="ten_to_one",
        provenance=Provenance(versions={}, settings={}, supplies=SUPPLIES),
    )


@pytest.mark.parametrize("slip", [math.nan, 0.003])
def test_a_recorded_row_is_read_with_its_slip(tmp_path, slip):
    expected = np.array([(*SHORT, slip), (0.001, *SHORT[1:], slip)])
    with recording(tmp_path) as record:
        for row in expected:
            record(row)
    np.testing.assert_array_equal(read_samples(tmp_path, duration=1.0)[:, : len(COLUMNS)], expected)


def test_a_slip_that_nobody_said_is_none():
    assert trajectory(np.array([(*SHORT, math.nan)] * 2)).string_slip is None
    np.testing.assert_array_equal(trajectory(np.array([(*SHORT, 0.003)] * 2)).string_slip, [0.003, 0.003])
