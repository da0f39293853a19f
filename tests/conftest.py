"""What the whole suite needs: the longest tests first, no processes beside those of the tests, and the backend."""

from __future__ import annotations

import pytest

from looping_pendulum.discrepancy import workers
from tests.backends import BACKENDS, current

LONGEST = "tests/test_tolerances.py"


def pytest_configure(config):
    config.addinivalue_line(
        "markers", "fails_on(*backends, reason, raises): runs under these backends, to ensure that it does fail"
    )


def pytest_collection_modifyitems(items):
    """Put the longest first, so that two workers end together."""
    items.sort(key=lambda item: LONGEST not in item.nodeid)
    for item in items:
        for marker in item.iter_markers("fails_on"):
            unknown = set(marker.args) - BACKENDS.keys()
            if unknown or not marker.kwargs.get("reason"):
                raise pytest.UsageError(f"{item.nodeid}: fails_on: found {marker}, needed names of backends and a reason")
            if current() in marker.args:
                item.add_marker(pytest.mark.xfail(strict=True, **marker.kwargs))


@pytest.fixture(scope="session", autouse=True)
def _fits_without_helpers():
    """Two tests at once keep two cores busy: a fit's helper would only start, import and compile once more.

    That the result is the same with helpers is for tests/discrepancy/test_identify.py, which asks for two.
    """
    workers.MOST = 1


@pytest.fixture(scope="session")
def backend():
    """The backend that this process is under."""
    return BACKENDS[current()]
