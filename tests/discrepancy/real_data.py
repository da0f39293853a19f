"""Where the measured data files are."""

from __future__ import annotations

from pathlib import Path

import pytest

from looping_pendulum.scenarios.measured import find_data

ROOT = Path(__file__).parents[2]


def real(file):
    """Path of a file; the test is skipped where the data are not."""
    path = find_data(file, ROOT / ".." / "shared" / "data")
    if path is None:
        pytest.skip(f"no data folder with {file}: set LOOPING_PENDULUM_DATA to it")
    return path
