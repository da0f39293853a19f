"""Compile without optimisation in sweeps over all effects, which takes a ninth of the time.

Sweeps compile hundreds of systems, each for a run or two, and test the equations, which are the same. All other tests run
optimised code, as users do.
"""

from __future__ import annotations

from functools import cache, partial

import pytest

from looping_pendulum.reference_ode import heyoka_backend, sensitivity
from looping_pendulum.reference_ode.heyoka_library import load_heyoka
from looping_pendulum.reference_ode.solve import available_integrators

SWEEPS = ("test_effects", "test_sensitivity", "test_effects_against_blind")


@pytest.fixture(scope="module", autouse=True)
def _sweeps_are_not_optimised(request):
    if request.path.stem not in SWEEPS or "heyoka" not in available_integrators():
        yield
        return
    with pytest.MonkeyPatch.context() as patch:
        hy = load_heyoka()
        for compiler in ("taylor_adaptive", "cfunc"):
            patch.setattr(hy, compiler, partial(getattr(hy, compiler), opt_level=0))
        # Caches for this module: unlimited, as a sweep comes back to each effect, and dropped with the unoptimised code
        for backend, name in ((heyoka_backend, "_compiled"), (sensitivity, "_variational")):
            patch.setattr(backend, name, cache(getattr(backend, name).__wrapped__))
        yield
