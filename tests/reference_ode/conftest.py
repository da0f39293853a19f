"""Sweeps over all effects compile hundreds of systems, each for a run or two: a ninth of the time without optimisation.

What is swept are the equations, which are the same. What users run, optimised, is what all other tests run.
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
        # Caches of a module's own: larger, as a sweep comes back to each effect, and gone with what was not optimised.
        for backend, name in ((heyoka_backend, "_compiled"), (sensitivity, "_variational")):
            patch.setattr(backend, name, cache(getattr(backend, name).__wrapped__))
        yield
