"""One suite for every engine, the reference included."""

from __future__ import annotations

import pytest

from looping_pendulum.engines.conformance import CHECKS
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import all_engines, label, missing_packages


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("engine", all_engines(Profile.QUICK), ids=label)
def test_conformance(engine, check):
    missing = missing_packages(engine)
    if missing:
        pytest.skip(f"{missing[0]} is not installed")
    check(engine)
