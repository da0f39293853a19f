"""What the whole suite needs to be quick: the longest tests first, and no processes beside those of the tests."""

from __future__ import annotations

import pytest

from looping_pendulum.discrepancy import workers

LONGEST = "tests/test_tolerances.py"


def pytest_collection_modifyitems(items):
    """Put the longest first, so that two workers end together."""
    items.sort(key=lambda item: LONGEST not in item.nodeid)


@pytest.fixture(scope="session", autouse=True)
def _fits_without_helpers():
    """Two tests at once keep two cores busy: a fit's helper would only start, import and compile once more.

    That the result is the same with helpers is for tests/discrepancy/test_identify.py, which asks for two.
    """
    workers.MOST = 1
