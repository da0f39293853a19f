"""What an engine of somebody else's may return: refused where it ran, with the field, what was found and what was needed."""

import math
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.compare import compare, write
from looping_pendulum.engines.isolation import run_all
from looping_pendulum.engines.protocol import MemoryRecorder
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.result_check import validate_trajectory
from looping_pendulum.engines.trajectory import COLUMNS, Provenance, RunStatus, TrajectoryEvent, from_samples
from looping_pendulum.engines.worker import FileRecorder, read_rows
from looping_pendulum.errors import EngineError
from looping_pendulum.scenarios import load
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE
from tests.compare.conftest import SUPPLIES
from tests.engines.faulty import FaultyEngine

SCENARIO = Scenario(name="s", title="", description="", parameters=TEN_TO_ONE, duration=0.05)
ENGINE = FaultyEngine("none")
N = 51


@pytest.fixture(scope="module")
def good():
    return ENGINE.simulate(SCENARIO)


def spoiled(run, what):
    """Return the same run with one wrong field, as an adapter's author may get it wrong."""
    supplies = replace(run.provenance.supplies, drag="the engine")
    return replace(run, **{
        "complex": {"light_position": run.light_position.astype(complex)},
        "text": {"light_position": run.light_position.astype(str)},
        "objects": {"light_velocity": np.full((N, 2), None)},
        "booleans": {"free_length": np.ones(N, dtype=bool)},
        "flat": {"light_position": run.light_position.ravel()},
        "transposed": {"heavy_position": run.heavy_position.T},
        "three columns": {"heavy_velocity": np.zeros((N, 3))},
        "one short": {"wrap_angle": run.wrap_angle[:-1]},
        "a number": {"string_stretch": 0.0},
        "ragged": {"light_position": [[0.0, 0.0]] * (N - 1) + [[0.0]]},
        "tension of another length": {"light_tension": np.zeros(N + 1)},
        "times in a table": {"t": run.t.reshape(-1, 1)},
        "times that fall": {"t": run.t[::-1]},
        "times that stay": {"t": np.zeros(N)},
        "times without number": {"t": np.full(N, np.nan)},
        "times before release": {"t": run.t - 1},
        "milliseconds": {"t": 1e3 * run.t},
        "unknown mode": {"mode": np.full(N, 77)},
        "mode between": {"mode": np.full(N, 0.5)},
        "mode that wraps": {"mode": np.full(N, 256)},  # 0 as an int8
        "modes by name": {"mode": np.full(N, "sticking")},
        "event as a pair": {"events": ((0.1, "stop"),)},
        "event at no time": {"events": (TrajectoryEvent(time=float("nan"), name="stop"),)},
        "event without a list": {"events": TrajectoryEvent(time=0.1, name="stop")},
        "status as text": {"status": "finished"},
        "another's name": {"engine": "mujoco"},
        "no provenance": {"provenance": None},
        "versions as numbers": {"provenance": replace(run.provenance, versions={"toy": 1.0})},
        "settings as a dataclass": {"provenance": replace(run.provenance, settings=ENGINE.settings)},
        "supplies as text": {"provenance": replace(run.provenance, supplies=supplies)},
        "supplies of another kind": {"provenance": Provenance(versions={}, settings={}, supplies=SimpleNamespace())},
        "wall time as text": {"wall_time": "0.1 s"},
        "CPU time as text": {"cpu_time": "0.1 s"},
        "message as bytes": {"message": b"done"},
        "no sample": {name: value[:0] for name, value in vars(run).items() if isinstance(value, np.ndarray)},
    }[what])  # fmt: skip


SPOILED = (
    "complex", "text", "objects", "booleans", "flat", "transposed", "three columns", "one short", "a number", "ragged",
    "tension of another length", "times in a table", "times that fall", "times that stay", "times without number",
    "times before release", "milliseconds", "unknown mode", "mode between", "mode that wraps", "modes by name",
    "event as a pair", "event at no time", "event without a list", "status as text", "another's name", "no provenance",
    "versions as numbers", "settings as a dataclass", "supplies as text", "supplies of another kind", "wall time as text",
    "CPU time as text", "message as bytes", "no sample",
)  # fmt: skip


@pytest.mark.parametrize("what", SPOILED)
def test_a_wrong_field_is_named_with_what_was_found_and_needed(good, what):
    with pytest.raises(EngineError, match=r"^simulate returned [a-z_.]+: found .*, needed [^\n]+$"):
        validate_trajectory(spoiled(good, what), ENGINE, SCENARIO)


def test_a_good_run_comes_back_as_it_was_even_of_other_kinds_of_numbers(good):
    for run in (good, replace(good, light_position=good.light_position.tolist(), mode=good.mode.astype(float))):
        back = validate_trajectory(run, ENGINE, SCENARIO)
        assert back.mode.dtype == np.int8
        assert all(np.array_equal(getattr(back, name), getattr(good, name), equal_nan=True) for name in ("t", "mode"))
        assert np.array_equal(back.light_position, good.light_position)
    assert (
        validate_trajectory(replace(good, light_position=np.full((N, 2), np.nan)), ENGINE, SCENARIO).status
        is RunStatus.NOT_FINITE
    )


def test_a_wrong_return_is_a_gap_and_the_others_results_stay(tmp_path):
    """Such arrays reached `compare`, which ended in "unexpected ValueError" without any engine's result."""
    bad = [FaultyEngine(f"returns_{what}") for what in ("complex", "wrong_shape", "unknown_mode")]
    runs = run_all([*bad, FaultyEngine("none")], SCENARIO, jobs=2)
    assert [run.status for run in runs] == [RunStatus.FAILED] * 3 + [RunStatus.FINISHED]
    assert [len(run.t) for run in runs] == [N] * 4  # what was recorded before stays, too
    assert "complex128" in runs[0].message
    assert "(50, 2)" in runs[1].message
    assert "found 77" in runs[2].message
    report = write(compare(SCENARIO, Reference(SCENARIO), runs), tmp_path).read_text()
    assert all(engine.variant in report for engine in bad)


def test_a_sample_of_another_length_is_refused_before_it_shifts_the_others(tmp_path):
    with closing(FileRecorder(tmp_path / "samples")) as recorder:
        with pytest.raises(EngineError, match="found 9 values with its time, needed 10 or 11"):
            recorder.add([0.0] * 9)
        assert len(recorder.rows()) == 0


# ---- a reading may leave out the string's slip, and what it says of it survives a run's file, its cache and its CSV


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


@pytest.mark.parametrize("slips", [(), (0.003,)])
def test_both_recorders_keep_a_row_with_and_without_its_slip(tmp_path, slips):
    in_file, in_memory = FileRecorder(tmp_path / "samples.bin"), MemoryRecorder()
    for recorder in (in_file, in_memory):
        recorder.add((*SHORT, *slips))
        recorder.add((*SHORT, *slips))
    expected = np.array([(*SHORT, *(slips or (math.nan,)))] * 2)
    for rows in (in_file.rows(), in_memory.rows(), read_rows(tmp_path / "samples.bin")):
        assert rows.shape == (2, len(COLUMNS))
        np.testing.assert_array_equal(rows, expected)
    in_file._file.close()


def test_a_slip_that_nobody_said_is_none():
    assert trajectory(np.array([SHORT, SHORT])).string_slip is None
    assert trajectory(np.array([(*SHORT, math.nan)] * 2)).string_slip is None
    np.testing.assert_array_equal(trajectory(np.array([(*SHORT, 0.003)] * 2)).string_slip, [0.003, 0.003])
