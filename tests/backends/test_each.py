"""The tests that no backend may fail, under every backend; `make test BACKEND=NAME` runs all tests under one."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.backends import BACKENDS, DEFAULT, current, environment

PROJECT = Path(__file__).parents[2]
CHECKED = (
    "tests/backends/test_decisions.py",
    "tests/reference_ode/core/test_bits.py::test_a_run_has_the_bits_that_it_has_everywhere",
    "tests/runs/test_tension.py::test_over_half_a_turn_it_is_exact",
    "tests/runs/test_tension.py::test_a_string_that_does_not_slide_is_no_measurement",
    "tests/runs/test_tension.py::test_what_rounding_or_creep_moves_a_stuck_string_is_no_slide",
)


@pytest.mark.long
@pytest.mark.skipif(current() != DEFAULT, reason="this run itself is under one backend")
@pytest.mark.parametrize("name", [name for name in BACKENDS if name != DEFAULT])
def test_no_decision_depends_on(name):
    """Run `CHECKED` in one process: what a backend is can only be set before a process starts."""
    without = [option for name in ("hypothesispytest", "zarr", "cacheprovider") for option in ("-p", f"no:{name}")]
    command = [sys.executable, "-m", "pytest", "-q", *without, "-m", "long or not long", *CHECKED]
    inherited = {variable: value for variable, value in environment(name).items() if not variable.startswith("PYTEST_")}
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, timeout=1800, env=inherited)
    assert done.returncode == 0, done.stdout + done.stderr
    counts = {what: int(number) for number, what in re.findall(r"(\d+) (passed|skipped)", done.stdout)}
    assert "skipped" not in counts, done.stdout  # a check that is left out checks nothing
    assert counts["passed"] >= 30
