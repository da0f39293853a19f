"""Small map files, and what a map left on the disk."""

import os
import subprocess
import sys
from pathlib import Path

from looping_pendulum.sweep.store import LOCK

ROOT = Path(__file__).parents[2]

GRID = """
title: A grid
scenario: ten_to_one
parameters:
  release_angle: {from: 60 deg, to: 130 deg, count: 6}
  mass_ratio: {from: 1, to: 12, count: 12}
tolerance: 1e-6
chunk: 12
"""
"""72 runs in 6 chunks."""
LONG = GRID.replace("count: 6", "count: 15")
"""180 runs in 15 chunks: for what happens in the middle of a map."""
SAMPLE = """
title: A sample
scenario: ten_to_one
parameters:
  release_angle: {from: 60 deg, to: 130 deg}
  rod_radius: {from: 1 mm, to: 20 mm, spacing: log}
sample: {method: sobol, count: 100, seed: 7}
chunk: 16
"""


def program(*arguments, **also):
    """Command, environment and folder of a Python program that finds this project."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1", "COLUMNS": "200"} | also
    return {"args": [sys.executable, "-m", *map(str, arguments)], "env": environment}


def run(*arguments, timeout=120, **also):
    """Run such a program to its end."""
    return subprocess.run(**program(*arguments, **also), capture_output=True, text=True, timeout=timeout)


def contents(folder):
    """Bytes of every file, which must be the same whenever and wherever a map is made."""
    files = [path for path in sorted(Path(folder).rglob("*")) if path.is_file() and path.name != LOCK]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def chunk_files(folder):
    """Files of the field of each chunk so far that is written last."""
    return [path for path in Path(folder).glob("map.zarr/end/c/**/*") if path.is_file() and path.suffix != ".partial"]


def field_files(folder):
    """Files of the fields of each chunk so far."""
    return [path for path in Path(folder).glob("map.zarr/*/c/*/*") if path.suffix != ".partial"]
