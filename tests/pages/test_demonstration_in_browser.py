"""A demonstration's page in a real browser: no requests or complaints, fits a phone, dark on request, hostile text as text."""

import dataclasses

import pytest

from looping_pendulum.teaching.demonstrations.demonstration import run_demonstration
from looping_pendulum.teaching.demonstrations.page import DEMONSTRATIONS, html
from tests.pages.axe import violations
from tests.pages.conftest import PHONE


@pytest.fixture(scope="module")
def result():
    return run_demonstration(DEMONSTRATIONS["drag-and-spiral"])


def asked_for_nothing(opened):
    opened.requests[:] = [url for url in opened.requests if not url.startswith("data:")]
    opened.assert_no_requests_or_complaints(opened.page.url)


def test_a_page_asks_for_nothing_and_fits_a_phone(visit, result):
    opened = visit(html(result), viewport=PHONE)
    asked_for_nothing(opened)
    opened.page.click("summary")
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    assert opened.page.evaluate("document.querySelector('figure svg').getBoundingClientRect().width") > 500, "can be read"
    assert opened.page.locator("figure [role=img]").get_attribute("aria-label") == result.demonstration.picture.caption


@pytest.mark.long
def test_the_guess_is_read_first_and_the_answer_unfolded_then(visit, result):
    page = visit(html(result)).page
    assert result.demonstration.guess in page.inner_text("main")
    answers = [claim.text for claim in result.answer] + [result.demonstration.picture.caption]
    assert not any(words in page.inner_text("main") for words in answers)
    assert not page.is_visible("table")
    page.click("summary")
    assert all(words in page.inner_text("main") for words in answers)
    assert page.is_visible("table")


@pytest.mark.long
def test_dark_on_request_and_axe_finds_nothing_in_either(visit, result):
    opened = visit(html(result), color_scheme="light")
    assert violations(opened.page) == []
    opened.page.click("summary")
    assert violations(opened.page) == []
    ground = "getComputedStyle(document.body).backgroundColor"
    light = opened.page.evaluate(ground)
    ink = """[...document.querySelectorAll("figure svg path")].filter((p) => p.style.stroke === "var(--reference)").map(
      (p) => getComputedStyle(p).stroke)"""
    assert set(opened.page.evaluate(ink)) == {"rgb(0, 0, 0)"}
    opened.page.locator("#theme").click()
    assert opened.page.evaluate(ground) != light
    assert violations(opened.page) == []
    assert set(opened.page.evaluate(ink)) == {"rgb(255, 255, 255)"}, "the figure follows"


def test_hostile_text_does_not_run(visit, result):
    hostile = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"
    d = dataclasses.replace(result.demonstration, title=hostile, question=hostile, change=hostile)
    opened = visit(html(dataclasses.replace(result, demonstration=d)))
    asked_for_nothing(opened)
    assert opened.page.locator("h1").inner_text() == hostile
