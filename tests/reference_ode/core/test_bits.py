"""The core's results are the same in every bit on every machine."""

import subprocess
import sys

import pytest

from looping_pendulum.reference_ode.effects import LIBRARY
from tests.reference_ode.core.bits import carried_out, cases, digest

CASES = cases()


def test_the_stored_runs_are_of_all_kinds():
    assert len(CASES) == 20
    assert {parameters.release for parameters, _ in CASES} == {"looping", "held", "vertical", "drop"}
    acting = {effect.name for parameters, _ in CASES for effect in parameters.effects}
    assert len(acting) > 0.8 * len(LIBRARY)


@pytest.mark.parametrize("number", range(len(CASES)))
def test_a_run_has_the_bits_that_it_has_everywhere(number):
    parameters, expected = CASES[number]
    assert digest(carried_out(parameters)) == expected


def test_no_process_leaves_words_behind():
    # wasmtime's objects complain when they go after its functions
    code = "import looping_pendulum as lp; lp.solve(lp.load('ten_to_one'))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout + done.stderr == ""
