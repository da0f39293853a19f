"""A real browser, and pages opened in it from files; every message and every request of theirs is kept."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.pages import live_page

DESKTOP = {"width": 1280, "height": 900}
PHONE = {"width": 390, "height": 844}
PATIENCE = 180.0
"""How long a test waits for what must come, on however slow a machine [s]."""


@dataclass
class Opened:
    """A page in the browser, and what it did."""

    page: Any
    complaints: list[str] = field(default_factory=list)
    """Errors and warnings of its console, and errors that nothing caught."""
    requests: list[str] = field(default_factory=list)
    dialogs: list[str] = field(default_factory=list)

    def assert_no_requests_or_complaints(self, url: str) -> None:
        """Hold that it asked for nothing but itself and complained of nothing."""
        assert self.requests == [url]
        assert self.complaints == []
        assert self.dialogs == []


@pytest.fixture
def visit(chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Opened]]:
    """Open HTML from a file: ``visit(html, viewport=..., color_scheme=..., reduced_motion=...)``; closed after the test.

    A page that nobody looks at any more still moves and calculates, at the cost of the tests after it.
    """
    with visitor(chromium, tmp_path_factory) as open_page:
        yield open_page


@pytest.fixture(scope="module")
def visit_once(chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Opened]]:
    """Open HTML as `visit` does, for all tests of the file."""
    with visitor(chromium, tmp_path_factory) as open_page:
        yield open_page


@contextmanager
def visitor(chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Opened]]:
    """Give a function that opens pages, and close them in the end."""
    contexts = []

    def open_page(html: str, *, viewport: dict[str, int] = DESKTOP, reduced_motion: str = "reduce", **options: Any) -> Opened:
        file: Path = tmp_path_factory.mktemp("page") / "page.html"
        file.write_text(html, encoding="utf-8")
        context = chromium.new_context(viewport=viewport, reduced_motion=reduced_motion, **options)
        contexts.append(context)
        context.set_default_timeout(1e3 * PATIENCE)
        opened = Opened(page=context.new_page())
        opened.page.on("console", lambda m: opened.complaints.append(m.text) if m.type in ("error", "warning") else None)
        opened.page.on("pageerror", lambda error: opened.complaints.append(str(error)))
        opened.page.on("request", lambda request: opened.requests.append(request.url))
        opened.page.on("dialog", lambda dialog: (opened.dialogs.append(dialog.message), dialog.dismiss()))
        opened.page.goto(file.as_uri())
        opened.page.wait_for_load_state("load")
        # The live page starts when its WebAssembly is compiled
        until(opened.page, "!document.getElementById('live-data') || 'live' in window")
        return opened

    try:
        yield open_page
    finally:
        for context in contexts:
            context.close()


def until(page: Any, expression: str) -> None:
    """Wait until ``expression`` holds on ``page``; its own waiting would need what the page's policy forbids."""
    end = time.monotonic() + PATIENCE
    while not page.evaluate(expression):
        assert time.monotonic() < end, f"never came true: {expression}"
        page.wait_for_timeout(20)


def sideways(page: Any) -> int:
    """How far the page can be scrolled to the side [px]."""
    return int(page.evaluate("document.documentElement.scrollWidth - window.innerWidth"))


@pytest.fixture(scope="module")
def one_page(visit_once):
    return visit_once(live_page.page_text())


@pytest.fixture
def opened(one_page):
    """The live page as it is when just loaded."""
    page = one_page.page
    page.evaluate(
        "() => { live.trial.remove(); live.player.setSlow(4); window.scrollTo(0, 0); document.activeElement.blur(); }"
    )
    for box, on in (("forces", False), ("ghost", True)):
        page.set_checked(f"#{box}", on)
    live_page.preset(page, "ten_to_one")
    one_page.complaints.clear()
    return one_page


@pytest.fixture
def page(opened):
    """The page itself of ``opened``, which a file of tests may have of its own."""
    return opened.page
