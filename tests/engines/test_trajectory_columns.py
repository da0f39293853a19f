"""A reading may leave out the string's slip, and what it says of it survives a run's file, its cache and its CSV."""

import math

import numpy as np
import pytest

from looping_pendulum.engines.protocol import MemoryRecorder
from looping_pendulum.engines.trajectory import COLUMNS, Provenance, from_samples
from looping_pendulum.engines.worker import FileRecorder, read_rows
from looping_pendulum.scenarios import load
from tests.compare.conftest import SUPPLIES

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
