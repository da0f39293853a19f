"""The page of demonstrations in a real browser: no requests or complaints, fits a phone, dark on request, text stays text."""

import matplotlib.pyplot as plt
import pytest

from looping_pendulum.demonstrations.runner import Demonstration, DemonstrationRun, render
from tests.pages.axe import violations
from tests.pages.conftest import PHONE, sideways

HOSTILE = "</pre></script><script>alert(1)</script><img src=x onerror=alert(2)>"
DOCSTRING = f"{HOSTILE}\n\nQuestion: Does it?\n\nGuess: It does.\n\nExperiment: {HOSTILE}\n\nChange it: Do."
SCRIPT = f'"""{DOCSTRING}\n"""\n' + "x = 1  # long" * 99


@pytest.fixture
def opened(visit, tmp_path):
    script = tmp_path / "01_hostile.py"
    script.write_text(SCRIPT)
    plt.figure().savefig(tmp_path / "01_hostile.png")
    plt.close("all")
    one = Demonstration(script)
    held = DemonstrationRun(demonstration=one, printed=HOSTILE, caption=HOSTILE, folder=tmp_path)
    false = DemonstrationRun(demonstration=one, printed="", false_claim=f"assert {HOSTILE}", folder=tmp_path)
    return visit(render([held, false]), viewport=PHONE, color_scheme="light")


def test_a_page_of_hostile_scripts_shows_their_text_and_asks_for_nothing(opened):
    page = opened.page
    assert not page.is_visible("pre"), "the guess is read first"
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    assert page.locator("h2").first.inner_text() == HOSTILE
    assert page.locator("pre").first.inner_text() == HOSTILE
    assert page.locator(".refuted").inner_text() == f"Not borne out by this run: assert {HOSTILE}"
    assert sideways(page) == 0
    opened.requests[:] = [url for url in opened.requests if not url.startswith("data:")]
    opened.assert_no_requests_or_complaints(page.url)


def test_axe_finds_nothing_in_light_or_dark(opened):
    page = opened.page
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    page.evaluate("document.querySelector('section:last-child').remove()")  # two demonstrations never have one name
    assert violations(page) == []
    page.click("#theme")
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    assert violations(page) == []
