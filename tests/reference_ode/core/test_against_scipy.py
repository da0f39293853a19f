"""The core against SciPy's DOP853 in a plain loop, which needs nothing but SciPy."""

import numpy as np
import pytest

from looping_pendulum.reference_ode.solve import TOLERANCE, solve_at
from tests.oracles import scipy_runs
from tests.oracles.agreement import assert_same_run
from tests.oracles.random_apparatus import of_any_kind, of_papers_model

T = np.linspace(0, 3, 301)
STIFF = ("string_stretch", "wind")
"""Effects whose runs take SciPy seconds, or repeat to 1e-8 m only."""


def assert_agree(p, seed):
    ours, other = (solver(p, T, duration=3.0, tolerance=TOLERANCE) for solver in (solve_at, scipy_runs.solve_at))
    try:
        # SciPy's events and samples come from its dense output, one order below its steps
        assert_same_run(ours, other)
    except AssertionError as error:
        raise AssertionError(f"seed {seed}: {error}") from error


@pytest.mark.parametrize("seeds", [range(2000, 2006), pytest.param(range(2006, 2200), marks=pytest.mark.long)])
def test_random_apparatus_of_the_papers_model(seeds):
    for seed in seeds:
        assert_agree(of_papers_model(seed), seed)


@pytest.mark.parametrize("seeds", [range(100, 103), pytest.param(range(103, 144), marks=pytest.mark.long)])
def test_random_apparatus_of_every_release_with_random_effects(seeds):
    for seed in seeds:
        p = of_any_kind(seed)
        if not any(effect.name in STIFF for effect in p.effects):
            assert_agree(p, seed)
