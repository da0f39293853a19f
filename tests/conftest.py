"""What the whole suite needs: the longest tests first, and the backend."""

import contextlib
import gc
import os
import shutil
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings

from scripts.live_page import ESBUILD
from tests.backends import BACKENDS, current

BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
"""Browsers to test with, the quickest first: a window that nobody sees costs a third of the pages' time."""
LONGEST = "tests/test_tolerances.py"

# One commit says the same everywhere; `make fuzz` looks for new inputs, and what it finds becomes an example
# A machine that is busy is no fault of a function: no deadline
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("fuzz", derandomize=False, database=None)
settings.load_profile("fuzz" if os.environ.get("FUZZ_EXAMPLES") else "repeatable")


def pytest_collection_modifyitems(items):
    """Put the longest first, so that all processes end together."""
    items.sort(key=lambda item: LONGEST not in item.nodeid)


def pytest_collection_finish():
    """Take what collection made out of the garbage collector's reach: it would go through all of it again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def esbuild():
    """Skip what needs esbuild where it is not."""
    if not ESBUILD.exists():
        pytest.skip("esbuild is not installed: npm ci")


@pytest.fixture
def offer(tmp_path):
    """Install adapters of another package: name -> source."""
    from tests.engines.faulty import adapters_of_another_package

    with contextlib.ExitStack() as installed:
        yield lambda **sources: installed.enter_context(adapters_of_another_package(tmp_path, sources))


@pytest.fixture(scope="session")
def backend():
    """The backend that this process is under."""
    return BACKENDS[current()]


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """One real browser for all tests of a process: Playwright takes no second one beside it."""
    path = next((browser_path for name in BROWSERS if (browser_path := shutil.which(name))), None)
    if path is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is installed (Debian: apt install chromium-headless-shell)")
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()
