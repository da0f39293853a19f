"""What the whole suite needs: the longest tests first, no processes beside those of the tests, and the backend."""

import gc
import shutil
from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest

from looping_pendulum.discrepancy import workers
from looping_pendulum.reference_ode import batch, heyoka_backend, sensitivity
from looping_pendulum.reference_ode.heyoka_library import COMPILER_OPTIONS
from looping_pendulum.reference_ode.solve import available_integrators
from tests.backends import BACKENDS, DEFAULT, current

BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
"""Browsers to test with, the quickest first: a window that nobody sees costs a third of the pages' time."""
LONGEST = "tests/test_tolerances.py"


def pytest_configure(config):
    config.addinivalue_line(
        "markers", "fails_on(*backends, reason, raises): runs under these backends, to ensure that it does fail"
    )


def pytest_collection_modifyitems(items):
    """Put the longest first, so that all processes end together, and expect failures that a backend is known for."""
    items.sort(key=lambda item: LONGEST not in item.nodeid)
    for item in items:
        for marker in item.iter_markers("fails_on"):
            unknown = set(marker.args) - BACKENDS.keys()
            if unknown or not marker.kwargs.get("reason"):
                raise pytest.UsageError(f"{item.nodeid}: fails_on: found {marker}, needed names of backends and a reason")
            if current() in marker.args:
                item.add_marker(pytest.mark.xfail(strict=True, **marker.kwargs))


def pytest_collection_finish():
    """Take what collection made out of the garbage collector's reach: it would go through all of it again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _fits_without_helpers():
    """Two tests at once keep two cores busy: a fit's helper would only start, import and compile once more.

    That the result is the same with helpers is for tests/discrepancy/test_identify.py, which asks for two.
    """
    workers.MAX_PROCESSES = 1


@pytest.fixture(scope="session", autouse=True)
def _no_optimisation_in_this_process():
    """Compile in a third of the time, which on a machine that has no compiled code yet takes 90 s of a processor less.

    A run then takes up to half as long again. The processes that tests start optimise, as users' do; so do all other backends.
    """
    if current() != DEFAULT or "heyoka" not in available_integrators():
        yield
        return
    with pytest.MonkeyPatch.context() as patch:
        leave_code_unoptimised(patch)
        yield


def leave_code_unoptimised(patch):
    """Have heyoka's compilers optimise nothing, until ``patch`` is undone."""
    patch.setitem(COMPILER_OPTIONS, "opt_level", 0)


@pytest.fixture
def optimised(monkeypatch):
    """Compile in this process as in those that it starts, for a test that compares the results of both in every bit."""
    monkeypatch.delitem(COMPILER_OPTIONS, "opt_level", raising=False)
    keep_compiled_apart(monkeypatch)


def keep_compiled_apart(patch):
    """Keep all that is compiled until ``patch`` is undone, and use nothing that was compiled before."""
    for module, name in ((heyoka_backend, "_compiled"), (sensitivity, "_variational")):
        patch.setattr(module, name, cache(getattr(module, name).__wrapped__))
    for module in (batch.compiled, batch.roots, batch.samples, batch.steps):  # what others import by name
        for function in vars(module).values():
            if hasattr(function, "cache_clear") and function.__module__ == module.__name__:
                function.cache_clear()


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
