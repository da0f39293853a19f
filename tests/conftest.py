"""The longest tests first, so that two workers end together."""

from __future__ import annotations

LONGEST = "tests/test_tolerances.py"


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: LONGEST not in item.nodeid)
