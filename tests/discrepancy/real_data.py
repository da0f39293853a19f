"""Find the files of measured data."""

from pathlib import Path

import pytest

from looping_pendulum.measured.tables.events import find_data

ROOT = Path(__file__).parents[2]


def real(file):
    """Return the path of a file; skip the test if there is no data folder."""
    path = find_data(file, ROOT / ".." / "shared" / "data")
    if path is None:
        pytest.skip(f"no data folder with {file}: set LOOPING_PENDULUM_DATA to it")
    return path
