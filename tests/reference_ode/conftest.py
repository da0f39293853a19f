"""Compile without optimisation in sweeps over all effects, under every backend.

Sweeps compile hundreds of systems, each for a run or two, and test the equations, which are the same.
"""

import pytest

from looping_pendulum.reference_ode.solve import available_integrators
from tests.conftest import keep_compiled_apart, leave_code_unoptimised

SWEEPS = ("test_effects", "test_sensitivity", "test_effects_against_blind")


@pytest.fixture(scope="module", autouse=True)
def _sweeps_are_not_optimised(request):
    if request.path.stem not in SWEEPS or "heyoka" not in available_integrators():
        yield
        return
    with pytest.MonkeyPatch.context() as patch:
        leave_code_unoptimised(patch)
        keep_compiled_apart(patch)  # all of it, as a sweep comes back to each effect
        yield
