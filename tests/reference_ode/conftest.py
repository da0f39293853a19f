"""Compile without optimisation in sweeps over all effects, under every backend.

Sweeps compile hundreds of systems, each for a run or two, and test the equations, which are the same.
"""

from __future__ import annotations

from functools import cache

import pytest

from looping_pendulum.reference_ode import heyoka_backend, sensitivity
from looping_pendulum.reference_ode.solve import available_integrators
from tests.conftest import leave_code_unoptimised

SWEEPS = ("test_effects", "test_sensitivity", "test_effects_against_blind")


@pytest.fixture(scope="module", autouse=True)
def _sweeps_are_not_optimised(request):
    if request.path.stem not in SWEEPS or "heyoka" not in available_integrators():
        yield
        return
    with pytest.MonkeyPatch.context() as patch:
        leave_code_unoptimised(patch)
        # Caches for this module: unlimited, as a sweep comes back to each effect, and dropped with the unoptimised code
        for backend, name in ((heyoka_backend, "_compiled"), (sensitivity, "_variational")):
            patch.setattr(backend, name, cache(getattr(backend, name).__wrapped__))
        yield
